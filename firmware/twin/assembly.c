/* Assembly: see assembly.h. */
#include "firmware/twin/assembly.h"

#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/fmu/common_units.h"
#include "firmware/fmu/fmu_binary.h"

/* ---- opening files ---- */

/* Writes the end of a message about a missing file: what exists instead; empty if nothing does. */
static void describe_path(const char *path, char text[TL_OTHER_CASE_TEXT]) {
    struct stat about;
    if (stat(path, &about) != 0) {
        (void)tl_other_case(path, text);
        return;
    }
    (void)snprintf(text, TL_OTHER_CASE_TEXT, "; this path is %s (expected a file): name the .fmu file itself",
                   S_ISDIR(about.st_mode)    ? "a folder"
                   : S_ISFIFO(about.st_mode) ? "a FIFO"
                   : S_ISSOCK(about.st_mode) ? "a socket"
                                             : "a device");
}

/* Absolute path, because the process changes its current folder later. A bare name is left to the
 * loader. NULL: the path is too long. */
static char *find_library(tl_assembly *assembly, const char *name) {
    char path[PATH_MAX];
    char found[PATH_MAX];
    if (!tl_config_library_path(&assembly->config, name, path, sizeof path)) {
        return NULL;
    }
    bool is_there = strchr(path, '/') != NULL && realpath(path, found) != NULL;
    return tl_arena_text(&assembly->arena, is_there ? found : path);
}

/* Returns false if memory is out. */
static bool open_file(tl_assembly *assembly, const tl_config_component *component, tl_assembly_file *file) {
    char path[PATH_MAX];
    file->descriptor = -1;
    if (tl_config_fmu_path(&assembly->config, component->fmu, path, sizeof path)) {
        file->is_there = true;
        file->descriptor = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    } else {
        describe_path(path, file->other);
    }
    file->path = tl_arena_text(&assembly->arena, path);
    file->libraries = tl_arena_take(&assembly->arena, component->library_count, sizeof *file->libraries);
    for (size_t i = 0; file->libraries != NULL && i < component->library_count; i++) {
        file->libraries[i] = find_library(assembly, component->libraries[i].name);
    }
    return file->path != NULL && file->libraries != NULL;
}

tl_status tl_assembly_open(tl_assembly *assembly, tl_error *error) {
    const tl_config *config = &assembly->config;
    tl_arena *arena = &assembly->arena;
    tl_config_use_lookups(&assembly->config);
    assembly->fmus = tl_arena_take(arena, config->component_count, sizeof *assembly->fmus);
    assembly->components = tl_arena_take(arena, config->component_count, sizeof *assembly->components);
    assembly->signals = tl_arena_take(arena, config->signal_count, sizeof *assembly->signals);
    assembly->match = tl_arena_take(arena, config->match_count, sizeof *assembly->match);
    assembly->outputs = tl_arena_take(arena, config->emulated_count, sizeof *assembly->outputs);
    assembly->files = tl_arena_take(arena, config->component_count, sizeof *assembly->files);
    bool has_room = assembly->fmus != NULL && assembly->components != NULL && assembly->signals != NULL &&
                    assembly->match != NULL && assembly->outputs != NULL && assembly->files != NULL;
    for (size_t i = 0; has_room && i < config->component_count; i++) {
        has_room = open_file(assembly, &config->components[i], &assembly->files[i]);
    }
    return has_room ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "not enough memory");
}

/* ---- building ---- */

/* Python imports a module name only once: a second FMU with the same module name would silently run
 * the code of the first. */
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

/* Each component gets its own copy of the FMU's variables, even if several use one file. An FMU in
 * Python is shared, because Python has its modules only once. Returns NULL if the error was
 * reported. */
static const tl_fmu *load_fmu(tl_assembly *assembly, const tl_assembly_file *file,
                              const tl_config_component *configured) {
    const char *where = configured->where;
    tl_rollback rollback = assembly->config.synchronise ? configured->rollback : TL_ROLLBACK_NONE;
    for (const tl_fmu *known = assembly->fmus; known < assembly->fmus + assembly->fmu_count; known++) {
        if (known->module[0] != '\0' && strcmp(known->path, file->path) == 0) {
            return known;
        }
    }
    tl_error error;
    tl_fmu *fmu = &assembly->fmus[assembly->fmu_count];
    tl_status status = tl_fmu_load(file->path, file->descriptor, rollback, fmu, &error);
    if (status != TL_OK) {
        tl_report_add(&assembly->problems.report, status, where, "%s", error.text);
        return NULL;
    }
    assembly->fmu_count++;
    tl_fmu_set_replay_steps(fmu, configured->replay_steps);
    return check_module(assembly, fmu, where) ? fmu : NULL;
}

/* A configuration written on another machine names the intended FMU by its hash. */
static bool has_expected_hash(tl_assembly *assembly, const tl_config_component *configured,
                              const tl_assembly_file *file) {
    char found[TL_SHA256_TEXT];
    if (configured->sha256 == NULL) {
        return true;
    }
    (void)tl_identity_open_file(file->descriptor, found);
    if (strcmp(found, configured->sha256) != 0) {
        tl_report_add(&assembly->problems.report, TL_BAD_DATA, configured->where,
                      "%.200s: its SHA-256 is %s (expected %s): install the right file, or correct \"sha256\"",
                      file->path, found[0] != '\0' ? found : "unknown, because it cannot be read", configured->sha256);
        return false;
    }
    return true;
}

static void load_component(tl_assembly *assembly, size_t index) {
    const tl_config_component *configured = &assembly->config.components[index];
    const tl_assembly_file *file = &assembly->files[index];
    if (!file->is_there) {
        tl_report_add(
            &assembly->problems.report, TL_BAD_DATA, configured->where,
            "no file \"%s\" here, in TWINLOCK_FMU_PATH, or in ../fmus or ../lib/twinlock/fmus beside the program (looked "
            "for \"%s\" first)%s",
            configured->fmu, file->path, file->other);
        return;
    }
    const tl_fmu *fmu = has_expected_hash(assembly, configured, file) ? load_fmu(assembly, file, configured) : NULL;
    for (size_t i = 0; fmu != NULL && i < configured->library_count; i++) {
        tl_library_claim(file->libraries[i], fmu->folder.path, &fmu->guard);
    }
    if (fmu != NULL) {
        assembly->components[index] = (tl_plan_component){
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

const tl_fmu *tl_assembly_fmu(const tl_assembly *assembly, size_t component) {
    const tl_fmu *fmu = assembly->fmus;
    while (assembly->components[component].model != &fmu->model) {
        fmu++;
    }
    return fmu;
}

int64_t tl_assembly_steps_to_stop(const tl_assembly *assembly) {
    static const double rounding = 1e-6; /* in steps */
    const tl_experiment experiment = tl_twin_get_facts(assembly->twin).experiment;
    const tl_config *config = &assembly->config;
    int64_t steps = (int64_t)((experiment.stop_s - experiment.start_s) / tl_seconds(config->step) + rounding);
    int64_t wanted = config->duration / config->step;
    return config->duration != 0 && wanted < steps ? wanted : steps;
}

/* Several components in Python are rolled back together by memory, or each in another way. */
static void share_memory(tl_assembly *assembly) {
    size_t sharing = 0;
    size_t components = 0;
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        const tl_fmu *fmu = tl_assembly_fmu(assembly, i);
        components += tl_fmu_is_in_python(fmu) ? 1 : 0;
        sharing += tl_fmu_is_in_python(fmu) && tl_fmu_can_share_memory(fmu) ? 1 : 0;
    }
    assembly->shares_memory = sharing > 1 && sharing == components;
    for (size_t i = 0; i < assembly->config.component_count && sharing > 0 && components > 1; i++) {
        const tl_config_component *configured = &assembly->config.components[i];
        if (!assembly->shares_memory && configured->rollback == TL_ROLLBACK_MEMORY &&
            tl_fmu_is_in_python(tl_assembly_fmu(assembly, i))) {
            tl_report_add(&assembly->problems.report, TL_BAD_DATA, configured->where,
                          "\"rollback\" is \"memory\", but not in all components in Python, which have one memory: set "
                          "it in all of them, or in none");
        }
    }
    for (tl_fmu *fmu = assembly->fmus; fmu < assembly->fmus + assembly->fmu_count && components > 1; fmu++) {
        if (tl_fmu_is_in_python(fmu)) {
            tl_fmu_share_memory(fmu, assembly->shares_memory);
        }
    }
}

/* Fills in the FMU variables that `emulate` reads; returns their number. */
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

/* The end of a stroke is an effect, so it is looked up like a matched output. */
static tl_plan_event event_of(const tl_config *config) {
    tl_plan_event event = config->event;
    for (size_t i = 0; i < config->match_count && event.start.signal != NULL; i++) {
        if (strcmp(config->match[i].to, config->event.end.signal) == 0) {
            event.end.signal = config->matched_as[i];
        }
    }
    return event;
}

/* Includes the memory that the FMUs allocate. */
static size_t memory_used(void) {
    return tl_heap_used() + tl_fmu_used();
}

/* The start time that the descriptions declare, s; 0: none does. Reports two that differ. */
static double declared_start(tl_assembly *assembly) {
    const tl_config_component *first = NULL;
    double start = 0.0;
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        const tl_config_component *component = &assembly->config.components[i];
        double own = assembly->components[i].model->start_time;
        if (isfinite(own) && first != NULL && (own < start || own > start)) {
            tl_report_add(&assembly->problems.report, TL_BAD_DATA, component->where,
                          "its DefaultExperiment starts at %.15g s, that of %s at %.15g s: set \"start_s\" to the time "
                          "at which all FMUs start",
                          own, first->name, start);
        } else if (isfinite(own)) {
            first = component;
            start = own;
        }
    }
    return start;
}

/* Start: key, else that of the recorded run, else the declared one. Stop: key, else by duration_s,
 * else as in the recorded run, else by the length of the recording. */
static void place_time(tl_assembly *assembly) {
    const tl_config *config = &assembly->config;
    const tl_recording_time *recorded = &assembly->recorded;
    tl_experiment *experiment = &assembly->plan.experiment;
    experiment->start_s = !isnan(config->start_s) ? config->start_s
                          : recorded->has_start   ? recorded->experiment.start_s
                                                  : declared_start(assembly);
    if (!isnan(config->stop_s)) {
        experiment->stop_s = config->stop_s;
        if (!(experiment->stop_s > experiment->start_s)) {
            tl_report_add(&assembly->problems.report, TL_BAD_DATA, "stop_s",
                          "found %.15g s, expected a time after the start of the FMUs, %.15g s: raise it, or set "
                          "\"start_s\"",
                          experiment->stop_s, experiment->start_s);
        }
        return;
    }
    bool is_other = config->duration != 0 || !recorded->has_start ||
                    memcmp(&experiment->start_s, &recorded->experiment.start_s, sizeof experiment->start_s) != 0;
    experiment->stop_s = is_other ? experiment->start_s : recorded->experiment.stop_s;
    assembly->plan.length = recorded->length;
}

static tl_plan_measure find_measure(const tl_config *config) {
    static const tl_time steps = 16; /* largest delay that is only reported */
    const tl_config_delays *delays = config->delays;
    tl_config_measured measured = tl_config_measures_delay(config);
    tl_time range = measured == TL_DELAY_USED ? delays->range : steps * config->step;
    /* One lag more than needed, so that a peak at the end of the range is detected as one. */
    return (tl_plan_measure){
        .lags = measured == TL_DELAY_NOT_MEASURED ? 0 : (uint32_t)((range + config->step - 1) / config->step) + 1,
        .range = range,
        .look_back = config->output_lookup.look_back,
        .is_unused = measured == TL_DELAY_REPORTED,
        .has_start = measured == TL_DELAY_USED && delays->has_output,
        .start = delays != NULL ? -delays->shift : 0,
    };
}

static void fill_plan(tl_assembly *assembly) {
    const tl_config *config = &assembly->config;
    for (size_t i = 0; i < config->signal_count; i++) {
        assembly->signals[i] = config->signals[i].plan;
    }
    for (size_t i = 0; i < config->match_count; i++) {
        assembly->match[i] = config->match[i];
        assembly->match[i].to = config->matched_as[i];
        assembly->match[i].reading = tl_config_reading_of(config, i);
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
        .find = config->find,
        .find_count = config->find_count,
        .find_steps = config->find_steps,
        .match = assembly->match,
        .match_count = config->match_count,
        .outputs = assembly->outputs,
        .output_count = fill_outputs(assembly),
        .prediction = config->prediction,
        .shape = config->shape,
        .measurements = config->measurements,
        .event = event_of(config),
        .input_ticks = config->input_lookup.ticks,
        .output_ticks = config->output_lookup.ticks,
        .output_look_back = config->output_lookup.look_back,
        .algorithm = config->algorithm,
        .fallback = config->fallback,
        .stagnation = config->stagnation,
        .margin = config->margin,
        .noise_floor = config->noise_floor,
        .verify_every = config->verify_every,
        .free_twin = tl_config_free_twin_guard(config),
        .released_steps = config->released_steps,
        .may_rerun = assembly->may_rerun,
        .evaluations = config->budget_evaluations,
        .saving = config->saving,
        .state_bytes = (uint64_t)config->saving_memory << 20,
        .convert_units = tl_common_units_convert,
        .heap = memory_used,
        .now = assembly->trusts_states ? NULL : tl_clock_now,
    };
    if (assembly->shares_memory) { /* saving rolls back or leaves out single components */
        assembly->plan.saving.structure = false;
        assembly->plan.saving.sequences = false;
    }
    assembly->plan.measure = find_measure(config);
    place_time(assembly);
}

tl_status tl_assembly_build(tl_assembly *assembly) {
    const tl_config *config = &assembly->config;
    tl_report *report = &assembly->problems.report;
    tl_error error;
    if (assembly->files == NULL && tl_assembly_open(assembly, &error) != TL_OK) {
        tl_report_add(report, error.status, "", "%s", error.text);
        return report->first_status;
    }
    for (size_t i = 0; i < config->component_count; i++) { /* FMUs are opened only if all libraries load */
        for (size_t k = 0; k < config->components[i].library_count; k++) {
            const char *path = assembly->files[i].libraries[k];
            tl_status status = path != NULL ? tl_library_open(path, &error)
                                            : tl_fail(&error, TL_BAD_DATA, "the path is too long; shorten it");
            if (status != TL_OK) {
                tl_report_add(report, status, config->components[i].libraries[k].where, "%s", error.text);
            }
        }
    }
    bool opened = report->count == 0; /* if a library is missing, each FMU that needs it would report the same again */
    for (size_t i = 0; i < config->component_count && opened; i++) {
        load_component(assembly, i);
    }
    if (report->count == 0 && config->synchronise) {
        share_memory(assembly);
    }
    if (report->count == 0) {
        tl_config_tuning(config, &assembly->tuning);
        fill_plan(assembly);
        assembly->twin = report->count == 0 ? tl_twin_build(&assembly->plan, report) : NULL;
    }
    return report->first_status;
}

/* ---- quiet build ---- */

/* The first problem. */
typedef struct problem {
    tl_error *error;
    char *component;
} problem;

static void keep_problem(void *context, tl_status status, const char *where, const char *text) {
    static const char COMPONENTS[] = "components.";
    const problem *kept = context;
    if (kept->error->text[0] != '\0') {
        return;
    }
    (void)tl_fail(kept->error, status, "%s", text);
    if (strncmp(where, COMPONENTS, sizeof COMPONENTS - 1) == 0) {
        (void)snprintf(kept->component, TL_ASSEMBLY_NAME, "%s", where + sizeof COMPONENTS - 1);
    }
}

tl_status tl_assembly_build_quietly(tl_assembly *assembly, char component[TL_ASSEMBLY_NAME], tl_error *error) {
    problem kept = {error, component};
    *error = (tl_error){TL_OK, ""};
    component[0] = '\0';
    assembly->problems.report = (tl_report){.add = keep_problem, .context = &kept};
    tl_status status = tl_assembly_build(assembly);
    assembly->problems.report = (tl_report){.add = NULL};
    return status;
}

void tl_assembly_find_component(const tl_assembly *assembly, const char *sentence, char component[TL_ASSEMBLY_NAME]) {
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        const char *name = assembly->config.components[i].name;
        size_t length = strlen(name);
        if (strncmp(sentence, name, length) == 0 && sentence[length] == ':') {
            (void)snprintf(component, TL_ASSEMBLY_NAME, "%s", name);
        }
    }
}

const char *tl_assembly_last_message(const tl_assembly *assembly, const char *component) {
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        if (strcmp(assembly->components[i].name, component) == 0) {
            const tl_fmu_guard *guard = assembly->components[i].callbacks->componentEnvironment;
            return guard->logger.last;
        }
    }
    return "";
}

void tl_assembly_quote(const char *sentence, const char *name, char *text, size_t size) {
    size_t length = strlen(name);
    bool is_named = strncmp(sentence, name, length) == 0 && (sentence[length] == ':' || sentence[length] == ' ');
    sentence += is_named ? length + 1 : 0;
    sentence += strspn(sentence, " ");
    (void)snprintf(text, size, "%.*s", (int)strcspn(sentence, ";"), sentence);
}

tl_status tl_assembly_retune(tl_assembly *assembly, const tl_tuning *tuning, tl_error *error) {
    tl_status status = tl_twin_retune(assembly->twin, tuning, error);
    if (status == TL_OK) {
        tl_config_retune(&assembly->config, tuning);
    }
    return status;
}

tl_status tl_assembly_rebuild(tl_assembly *assembly) {
    tl_twin_destroy(assembly->twin);
    tl_config_retune(&assembly->config, &assembly->tuning);
    assembly->twin = tl_twin_build(&assembly->plan, &assembly->problems.report);
    return assembly->twin != NULL ? TL_OK : assembly->problems.report.first_status;
}

void tl_assembly_free(tl_assembly *assembly) {
    tl_twin_destroy(assembly->twin);
    for (size_t i = 0; i < assembly->fmu_count; i++) {
        tl_fmu_unload(&assembly->fmus[i]);
    }
    for (size_t i = 0; assembly->files != NULL && i < assembly->config.component_count; i++) {
        if (assembly->files[i].is_there && assembly->files[i].descriptor >= 0) {
            (void)close(assembly->files[i].descriptor);
        }
    }
    tl_arena_release(&assembly->arena);
    tl_config_free(&assembly->config);
    *assembly = (tl_assembly){0};
}

/* ---- readable paths of the FMUs ---- */

/* Adds an existing path once, except "/". */
static void add_path(tl_readable_paths *paths, const char *path) {
    char *found = paths->count < TL_READABLE_PATHS_MOST ? realpath(path, NULL) : NULL;
    bool is_new = found != NULL && strcmp(found, "/") != 0;
    for (size_t i = 0; is_new && i < paths->count; i++) {
        is_new = strcmp(paths->path[i], found) != 0;
    }
    if (is_new) {
        paths->path[paths->count++] = found;
    } else {
        free(found);
    }
}

/* Adds the library. Also adds its folder if that is a folder for libraries, because the library may
 * load others from there, as Python's modules do. */
static void add_library(tl_readable_paths *paths, const char *path) {
    char copy[PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s", path);
    const char *folder = dirname(copy);
    const char *name = strrchr(folder, '/');
    add_path(paths, name != NULL && strncmp(name, "/lib", strlen("/lib")) == 0 ? folder : path);
}

static void add_component_paths(tl_readable_paths *paths, const tl_assembly *assembly, size_t index) {
    const tl_config *config = &assembly->config;
    const tl_config_component *component = &config->components[index];
    for (size_t i = 0; i < component->library_count; i++) {
        const char *library = assembly->files[index].libraries[i];
        if (library != NULL && strchr(library, '/') != NULL) {
            add_library(paths, library);
        }
    }
    for (size_t i = 0; i < component->read_count; i++) { /* relative names start at the configuration's folder */
        char path[PATH_MAX];
        const char *file = component->reads[i].name;
        if (file[0] != '\0' && tl_config_file_path(config, file, path, sizeof path)) {
            add_path(paths, path);
        }
    }
    for (size_t i = 0; i < component->set_count; i++) {
        const tl_plan_set *set = &component->set[i];
        if (set->value.type == TL_STRING && strchr(set->value.text, '/') != NULL) {
            add_path(paths, set->value.text);
        }
    }
}

/* Folders that a list of library folders should not contain: "/", a top folder such as "/home", a
 * home, or a parent of a home. */
static bool is_too_wide(const char *folder) {
    const char *home = getenv(TL_READABLE_PATHS_HOME);
    char *real_home = home != NULL && home[0] == '/' ? realpath(home, NULL) : NULL;
    size_t length = strlen(folder);
    bool holds_home = real_home != NULL && strncmp(real_home, folder, length) == 0 &&
                      (real_home[length] == '\0' || real_home[length] == '/');
    free(real_home);
    return holds_home || strrchr(folder, '/') == folder;
}

/* Adds the paths that belong to one folder of a variable. Returns true if the remaining folders are
 * to be skipped. */
typedef bool add_one(tl_readable_paths *paths, const char *folder);

/* Only absolute names, because the process has another current folder. */
static bool add_folder(tl_readable_paths *paths, const char *folder) {
    char *found = folder[0] == '/' ? realpath(folder, NULL) : NULL;
    if (found != NULL && !is_too_wide(found)) {
        add_path(paths, found);
    }
    free(found);
    return false;
}

/* Adds only the parts of a Python installation or environment that Python loads. Its folder may
 * contain other users' files, as ~ does for ~/bin/python3. */
static bool add_installation(tl_readable_paths *paths, const char *prefix) {
    static const char *const parts[] = {"pyvenv.cfg", "lib", "lib64", "lib32"};
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        char path[PATH_MAX];
        if (snprintf(path, sizeof path, "%s/%s", prefix, parts[i]) < (int)sizeof path) {
            (void)add_folder(paths, path);
        }
    }
    return false;
}

/* Python loads the packages of the python3 that comes first in PATH. Those of an environment are
 * beside it; those of the installation from which the environment was made are beside the target of
 * the link. */
static bool add_python(tl_readable_paths *paths, const char *folder) {
    char path[PATH_MAX];
    bool fits = snprintf(path, sizeof path, "%s/python3", folder) < (int)sizeof path;
    char *program = fits ? realpath(path, NULL) : NULL;
    if (program == NULL) {
        return false;
    }
    (void)add_installation(paths, dirname(dirname(path)));
    (void)add_installation(paths, dirname(dirname(program)));
    free(program);
    return true;
}

/* Calls `add_each` for each folder of a variable, separated by colons. */
static void add_variable(tl_readable_paths *paths, const char *name, add_one *add_each) {
    const char *list = getenv(name);
    char *copy = list != NULL ? strdup(list) : NULL;
    char *rest = NULL;
    char *folder = copy != NULL ? strtok_r(copy, ":", &rest) : NULL;
    while (folder != NULL && !add_each(paths, folder)) {
        folder = strtok_r(NULL, ":", &rest);
    }
    free(copy);
}

void tl_readable_paths_find(const tl_assembly *assembly, tl_readable_paths *paths) {
    static const struct {
        const char *name;
        add_one *add;
    } variables[] = {
        {"LD_LIBRARY_PATH", add_folder},  {"PYTHONPATH", add_folder}, {"LOCPATH", add_folder},
        {"PYTHONHOME", add_installation}, {"PATH", add_python},       {"PYTHONUSERBASE", add_installation},
    };
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        add_component_paths(paths, assembly, i);
    }
    for (size_t i = 0; i < sizeof variables / sizeof variables[0]; i++) {
        add_variable(paths, variables[i].name, variables[i].add);
    }
}

void tl_readable_paths_free(tl_readable_paths *paths) {
    for (size_t i = 0; i < paths->count; i++) {
        free(paths->path[i]);
    }
    *paths = (tl_readable_paths){.count = 0};
}
