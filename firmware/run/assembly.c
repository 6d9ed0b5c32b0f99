/* An assembly: see assembly.h. */
#include "firmware/run/assembly.h"

#include <assert.h>
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/heap.h"
#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/other_case.h"
#include "firmware/fmu/library.h"

enum { PLANT_NAME = 80 }; /* "plant." and at most 63 characters */

/* Of one component; FMUs are opened only when all of them are there. */
static void open_libraries(tl_assembly *assembly, const tl_config_component *component) {
    for (size_t i = 0; i < component->library_count; i++) {
        const tl_config_library *library = &component->libraries[i];
        char path[PATH_MAX];
        tl_error error;
        if (!tl_config_library_path(&assembly->config, library->name, path, sizeof path)) {
            tl_report_add(&assembly->problems.report, TL_BAD_DATA, library->where, "the path is too long; shorten it");
            continue;
        }
        tl_status status = tl_library_open(path, &error);
        if (status != TL_OK) {
            tl_report_add(&assembly->problems.report, status, library->where, "%s", error.text);
        }
    }
}

/* Python imports a name once: the second of two FMUs with modules of one name would silently run the first one's. */
static bool check_module(tl_assembly *assembly, const tl_fmu *fmu, const char *where) {
    for (const tl_fmu *other = assembly->fmus; other < fmu && fmu->module[0] != '\0'; other++) {
        if (strcmp(other->module, fmu->module) == 0) {
            tl_report_add(
                &assembly->problems.report, TL_BAD_DATA, where,
                "%.120s and %.120s both have a Python module \"%.60s\", and Python imports a name once: rename "
                "one of the scripts and export it again, or use the same FMU for both",
                fmu->path, other->path, fmu->module);
            return false;
        }
    }
    return true;
}

/* The FMU at `path`, loaded once; NULL where reported. */
static const tl_fmu *load_fmu(tl_assembly *assembly, const char *path, const char *where) {
    for (size_t i = 0; i < assembly->fmu_count; i++) {
        if (strcmp(assembly->fmus[i].path, path) == 0) {
            return &assembly->fmus[i];
        }
    }
    tl_error error;
    tl_fmu *fmu = &assembly->fmus[assembly->fmu_count];
    tl_status status = tl_fmu_load(path, fmu, &error);
    if (status != TL_OK) {
        tl_report_add(&assembly->problems.report, status, where, "%s", error.text);
        return NULL;
    }
    assembly->fmu_count++;
    return check_module(assembly, fmu, where) ? fmu : NULL;
}

static void load_component(tl_assembly *assembly, size_t index) {
    const tl_config_component *configured = &assembly->config.components[index];
    tl_plan_component *component = &assembly->components[index];
    char path[PATH_MAX];
    if (!tl_config_fmu_path(&assembly->config, configured->fmu, path, sizeof path)) {
        char other[TL_OTHER_CASE_TEXT];
        tl_report_add(
            &assembly->problems.report, TL_BAD_DATA, configured->where,
            "no file \"%s\" here, in TWINLOCK_FMU_PATH, or in ../fmus or ../lib/twinlock/fmus beside the program (looked "
            "for \"%s\" first)%s",
            configured->fmu, path, tl_other_case(path, other));
        return;
    }
    const tl_fmu *fmu = load_fmu(assembly, path, configured->where);
    if (fmu != NULL) {
        *component = (tl_plan_component){
            .where = configured->where,
            .name = configured->name,
            .model = &fmu->model,
            .functions = &fmu->guard.functions,
            .callbacks = &fmu->guard.callbacks,
            .resources = fmu->resources,
            .set = configured->set,
            .set_count = configured->set_count,
            .keep = configured->keep,
            .logging = configured->logging,
        };
    }
}

/* The variables of FMUs that `emulate` reads; returns how many. */
static size_t fill_outputs(tl_assembly *assembly) {
    size_t count = 0;
    for (size_t i = 0; i < assembly->config.emulated_count; i++) {
        const tl_config_emulated *emulated = &assembly->config.emulated[i];
        if (strncmp(emulated->from, "plant.", 6) != 0) {
            assembly->outputs[count++] = (tl_plan_output){emulated->where, emulated->from};
        }
    }
    return count;
}

/* N is one more than what is used, so that a peak at the end of the range is one. */
static tl_plan_measure measure_of(const tl_config *config) {
    const tl_config_delays *delays = config->delays;
    if (delays == NULL || !delays->measure) {
        return (tl_plan_measure){0};
    }
    return (tl_plan_measure){
        .lags = (uint32_t)((delays->range + config->step - 1) / config->step) + 1,
        .range = delays->range,
        .look_back = delays->output_lookup.look_back,
    };
}

/* The end of a stroke is an effect: it is looked up as what is matched. */
static tl_plan_event event_of(const tl_config *config) {
    tl_plan_event event = config->event;
    for (size_t i = 0; i < config->match_count && event.start.signal != NULL; i++) {
        if (strcmp(config->match[i].to, config->event.end.signal) == 0) {
            event.end.signal = config->matched_as[i];
        }
    }
    return event;
}

static void fill_plan(tl_assembly *assembly) {
    const tl_config *config = &assembly->config;
    for (size_t i = 0; i < config->signal_count; i++) {
        assembly->signals[i] = config->signals[i].plan;
    }
    for (size_t i = 0; i < config->match_count; i++) {
        assembly->match[i] = config->match[i];
        assembly->match[i].to = config->matched_as[i];
    }
    assembly->plan = (tl_plan){
        .step = config->step,
        .components = assembly->components,
        .component_count = config->component_count,
        .signals = assembly->signals,
        .signal_count = config->signal_count,
        .connections = config->connections,
        .connection_count = config->connection_count,
        .adjust = config->adjust,
        .adjust_count = config->adjust_count,
        .match = assembly->match,
        .match_count = config->match_count,
        .outputs = assembly->outputs,
        .output_count = fill_outputs(assembly),
        .prediction = config->prediction,
        .shape = config->shape,
        .measurements = config->measurements,
        .event = event_of(config),
        .input_ticks = config->delays != NULL ? config->delays->input_lookup.ticks : 0,
        .measure = measure_of(config),
        .output_ticks = config->delays != NULL ? config->delays->output_lookup.ticks : 0,
        .algorithm = config->algorithm,
        .fallback = config->fallback,
        .stagnation = config->stagnation,
        .margin = config->margin,
        .noise_floor = config->noise_floor,
        .evaluations = config->budget_evaluations,
        .saving = config->saving,
        .state_bytes = (uint64_t)config->saving_memory << 20,
        .heap = tl_heap_used,
    };
}

tl_status tl_assembly_build(tl_assembly *assembly) {
    const tl_config *config = &assembly->config;
    tl_report *report = &assembly->problems.report;
    tl_config_use_lookups(&assembly->config);
    assembly->fmus = calloc(config->component_count, sizeof *assembly->fmus);
    assembly->components = calloc(config->component_count, sizeof *assembly->components);
    assembly->signals = calloc(config->signal_count, sizeof *assembly->signals);
    assembly->match = calloc(config->match_count + 1, sizeof *assembly->match);
    assembly->outputs = calloc(config->emulated_count + 1, sizeof *assembly->outputs);
    if (assembly->fmus == NULL || assembly->components == NULL || assembly->signals == NULL ||
        assembly->match == NULL || assembly->outputs == NULL) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory");
        return report->worst;
    }
    for (size_t i = 0; i < config->component_count; i++) {
        open_libraries(assembly, &config->components[i]);
    }
    bool opened = report->count == 0; /* where a library is missing, each FMU that needs it would only say so again */
    for (size_t i = 0; i < config->component_count && opened; i++) {
        load_component(assembly, i);
    }
    if (report->count == 0) {
        fill_plan(assembly);
        assembly->twin = tl_twin_build(&assembly->plan, report);
    }
    return report->worst;
}

tl_status tl_assembly_rebuild(tl_assembly *assembly) {
    tl_twin_destroy(assembly->twin);
    assembly->twin = tl_twin_build(&assembly->plan, &assembly->problems.report);
    return assembly->twin != NULL ? TL_OK : assembly->problems.report.worst;
}

tl_status tl_assembly_read(const char *path, tl_assembly *assembly) {
    *assembly = (tl_assembly){0};
    tl_problems_init(&assembly->problems, path);
    tl_status status = tl_config_read(path, &assembly->config, &assembly->problems.report);
    assembly->problems.config = status == TL_OK ? &assembly->config : NULL;
    return status;
}

tl_status tl_assembly_load(const char *path, tl_assembly *assembly) {
    tl_status status = tl_assembly_read(path, assembly);
    return status == TL_OK ? tl_assembly_build(assembly) : status;
}

/* Of a variable that is matched or adjusted, of a twin that could be built: its component and its name are known to be right. */
static tl_type type_of(const tl_assembly *assembly, const char *reference) {
    size_t length = strcspn(reference, ".");
    for (size_t i = 0; i < assembly->plan.component_count; i++) {
        const tl_plan_component *component = &assembly->components[i];
        if (strlen(component->name) == length && strncmp(component->name, reference, length) == 0) {
            return tl_model_variable(component->model, reference + length + 1)->type;
        }
    }
    return TL_REAL;
}

void tl_assembly_signals(const tl_assembly *assembly, tl_recorder_signal match[TL_MAX_MATCH],
                         tl_recorder_signal adjust[TL_MAX_ADJUST]) {
    const tl_config *config = &assembly->config;
    for (size_t i = 0; i < config->match_count; i++) {
        const char *variable = config->match[i].variable;
        match[i] = (tl_recorder_signal){variable, tl_twin_match_unit(assembly->twin, i), config->match[i].to,
                                        type_of(assembly, variable)};
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        const char *variable = config->adjust[i].variable;
        adjust[i] =
            (tl_recorder_signal){variable, tl_twin_adjust_unit(assembly->twin, i), NULL, type_of(assembly, variable)};
    }
}

void tl_assembly_identify(const tl_assembly *assembly, char text[TL_SHA256_TEXT]) {
    const char *paths[TL_RECORDER_COMPONENTS];
    for (size_t i = 0; i < assembly->plan.component_count; i++) {
        const tl_fmu *fmu = assembly->fmus;
        while (&fmu->model != assembly->components[i].model) {
            fmu++;
        }
        paths[i] = fmu->path;
    }
    tl_identity_files(paths, assembly->plan.component_count, text);
}

/* The plant's signals as the recorder names them. */
static void plant_signals(const tl_config *config, char names[TL_MAX_SIGNALS][PLANT_NAME],
                          tl_recorder_signal plant[TL_MAX_SIGNALS]) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_plan_signal *signal = &config->signals[i].plan;
        (void)snprintf(names[i], PLANT_NAME, "plant.%s", signal->name);
        plant[i] = (tl_recorder_signal){names[i], signal->unit, NULL, signal->type};
    }
}

tl_status tl_assembly_record(const tl_assembly *assembly, const char *verb, const char *path, bool wait_when_full,
                             tl_heartbeats *beats, tl_recorder **recorder, tl_error *error) {
    const tl_config *config = &assembly->config;
    const char *components[TL_RECORDER_COMPONENTS];
    char names[TL_MAX_SIGNALS][PLANT_NAME];
    tl_recorder_signal plant[TL_MAX_SIGNALS];
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
    char fmus[TL_SHA256_TEXT];
    char boot[TL_IDENTITY_TEXT];
    char format[TL_IDENTITY_TEXT];
    plant_signals(config, names, plant);
    tl_assembly_identify(assembly, fmus);
    tl_identity_boot(boot);
    tl_identity_format(format);
    tl_recorder_settings settings = {
        .path = path,
        .max_bytes = config->record_max_bytes,
        .commit = config->record_commit,
        .verb = verb,
        .name = config->name,
        .configuration = config->text,
        .step = config->step,
        .measurements = config->measurements,
        .plant = plant,
        .match = match,
        .adjust = adjust,
        .plant_count = config->signal_count,
        .fmus = fmus,
        .boot = boot,
        .format = format,
        .components = components,
        .wait_when_full = wait_when_full,
        .beats = beats,
    };
    if (assembly->twin != NULL) {
        tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
        tl_assembly_signals(assembly, match, adjust);
        assert(facts.components <= TL_RECORDER_COMPONENTS);
        for (size_t i = 0; i < facts.components; i++) {
            components[i] = tl_twin_component_name(assembly->twin, i);
        }
        settings.prediction = facts.prediction;
        settings.lead = facts.lead;
        settings.match_count = config->match_count;
        settings.adjust_count = config->adjust_count;
        settings.component_count = facts.components;
    }
    return tl_recorder_open(&settings, recorder, error);
}

void tl_assembly_put_step(const tl_assembly *assembly, tl_recorder *recorder, const tl_record *record) {
    tl_recorder_component ledger[TL_RECORDER_COMPONENTS];
    size_t count = tl_twin_get_facts(assembly->twin).components;
    for (size_t i = 0; i < count; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, i);
        ledger[i] = (tl_recorder_component){
            entry.plain, entry.predicted, entry.executions, entry.caught_up, entry.unstored,
        };
    }
    tl_recorder_put_step(recorder, record, ledger);
}

void tl_assembly_check_ledger(const tl_assembly *assembly, tl_recorder *recorder) {
    for (size_t i = 0; i < tl_twin_get_facts(assembly->twin).components; i++) {
        char text[224];
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, i);
        if (entry.difference <= 0) {
            continue;
        }
        (void)snprintf(text, sizeof text,
                       "%s: %" PRId64 " executions more than predicted: results found no room (%" PRIu64
                       ", see saving.nodes), or a committed step failed and was repeated",
                       entry.name, entry.difference, entry.unstored);
        tl_log(TL_LOG_WARNING, "%s", text);
        if (recorder != NULL) {
            tl_recorder_event(recorder, -1, TL_EVENT_WARNING, "twin", text);
        }
    }
}

void tl_assembly_free(tl_assembly *assembly) {
    tl_twin_destroy(assembly->twin);
    for (size_t i = 0; i < assembly->fmu_count; i++) {
        tl_fmu_unload(&assembly->fmus[i]);
    }
    free(assembly->fmus);
    free(assembly->components);
    free(assembly->signals);
    free(assembly->match);
    free(assembly->outputs);
    tl_config_free(&assembly->config);
    *assembly = (tl_assembly){0};
}
