/* Page of `twinlock check`: see check_page.h. */
#include "firmware/cli/check_page.h"

#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/text.h"
#include "firmware/cli/advice.h"
#include "firmware/cli/check_json.h"
#include "firmware/cli/response.h"
#include "firmware/config/config.h"
#include "firmware/fmu/common_units.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/live/live_blocks.h"
#include "firmware/store/recorder_database.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_process.h"
#include "master/twin/twin_timing.h"

/* ---- Delays: chains, modes and densities as lines of text. At most 79 columns, unless the name of
 * a participant alone is longer. */

enum { WIDTH = 79, COLUMNS = 48, NAME = 80 };

static double milliseconds(tl_time time) {
    return (double)time / 1e6;
}

/* ---- chains ---- */

/* Prints the names, with = between names on the same time base and → otherwise. Lines break between
 * names. */
static void print_chain(const tl_config_delays *delays, const tl_config_chain *chain, const char *label, FILE *file) {
    int column = fprintf(file, "    %-11s", label);
    for (size_t i = 0; i < chain->length; i++) {
        const char *name = delays->names[chain->parts[i]];
        bool same =
            i > 0 && delays->participants[chain->parts[i - 1]].base == delays->participants[chain->parts[i]].base;
        int length = (int)strlen(name) + (i > 0 ? 3 : 0);
        if (i > 0 && column + length > WIDTH) {
            column = fprintf(file, "\n    %-11s", "") - 1;
        }
        (void)fprintf(file, "%s%.*s", i == 0 ? "" : same ? " = " : " \342\206\222 ", NAME, name);
        column += length;
    }
    (void)fputc('\n', file);
}

/* ---- drawings ---- */

/* Samples the density in the middle of each column. A constant delay fills one column. */
static void print_density(const tl_delay_density *density, tl_time cell, const char *label, FILE *file) {
    const tl_show_style style = {.unicode = true};
    double heights[COLUMNS];
    char curve[TL_SHOW_CURVE];
    for (int i = 0; i < COLUMNS; i++) {
        bool constant = density->count == 0 && density->dead / cell == i;
        heights[i] = constant ? 1.0 : tl_delay_density_at(density, cell * i + cell / 2);
    }
    tl_show_curve(style, heights, COLUMNS, curve, sizeof curve);
    (void)fprintf(file, "    %-11s|%s| to %.3g ms\n", label, curve, milliseconds(cell * COLUMNS));
}

/* Both densities share one time axis, a sixteenth longer than the longer one. */
static void print_densities(const tl_config_pair *pair, FILE *file) {
    tl_time plant = tl_delay_longest(&pair->plant.density);
    tl_time simulation = tl_delay_longest(&pair->simulation.density);
    tl_time longest = plant > simulation ? plant : simulation;
    tl_time cell = (longest + longest / 16) / COLUMNS + 1;
    print_density(&pair->plant.density, cell, "plant", file);
    print_density(&pair->simulation.density, cell, "simulation", file);
}

/* ---- the page ---- */

static bool has_chains(const tl_config_pair *pair) {
    return pair->plant.length > 0;
}

static void print_pair(const tl_config_delays *delays, const tl_config_pair *pair, const char *what, const char *symbol,
                       FILE *file) {
    if (!has_chains(pair)) {
        (void)fprintf(file, "  %-8s%s = %.6g ms, as given\n", what, symbol, milliseconds(pair->delay));
        return;
    }
    (void)fprintf(file, "  %-8s%s = %.6g ms: modes %.6g ms of the simulation, %.6g ms of the plant\n", what, symbol,
                  milliseconds(pair->delay), milliseconds(tl_delay_mode(&pair->simulation.density)),
                  milliseconds(tl_delay_mode(&pair->plant.density)));
    print_chain(delays, &pair->plant, "plant", file);
    print_chain(delays, &pair->simulation, "simulation", file);
}

/* Writes for example "… seen at t" or "… seen 0.5 ms after". */
static void print_shift(const char *what, tl_time shift, FILE *file) {
    if (shift == 0) {
        (void)fprintf(file, "%s at t", what);
    } else {
        (void)fprintf(file, "%s %.6g ms %s", what, milliseconds(shift < 0 ? -shift : shift),
                      shift < 0 ? "before" : "after");
    }
}

static void print_measured(const tl_config_delays *delays, FILE *file) {
    if (delays->measure) {
        (void)fprintf(file,
                      "  measure \316\224o, from y and \305\267, up to %.6g ms either way%s;\n"
                      "          used in whole steps when it is certain; until then:\n",
                      milliseconds(delays->range), delays->has_input ? " of \316\224i" : "");
    }
}

/* Prints nothing if the configuration has no delays. */
static void print_delays(const tl_config *config, FILE *file) {
    const tl_config_delays *delays = config->delays;
    if (delays == NULL) {
        return;
    }
    (void)fputs("delays\n", file);
    if (delays->has_input) {
        print_pair(delays, &delays->input, "input", "\316\224i", file);
    }
    if (delays->has_output) {
        print_pair(delays, &delays->output, "output", "\316\224o", file);
    }
    if (delays->has_output && has_chains(&delays->output)) {
        print_densities(&delays->output, file);
    } else if (delays->has_input && has_chains(&delays->input)) {
        print_densities(&delays->input, file);
    }
    print_measured(delays, file);
    (void)fputs("  used    ", file);
    print_shift("inputs at t are those seen", delays->has_input ? delays->input.delay : 0, file);
    (void)fputs(",\n          ", file);
    print_shift("y at t is paired with the \305\267 seen", delays->shift, file);
    (void)fputs(
        (delays->has_output || delays->measure) && !delays->next ? ",\n          or with the newest before" : "", file);
    if (delays->wait > 0) {
        (void)fprintf(file, ",\n          or with the next one, for which a step waits %.6g ms",
                      milliseconds(delays->wait));
    }
    (void)fputc('\n', file);
}

/* ---- check page ---- */

static void print_start(const tl_variable *variable, FILE *output) {
    if (!variable->has_start) {
        (void)fprintf(output, "%12s", "");
        return;
    }
    switch (variable->type) {
    case TL_REAL:
        (void)fprintf(output, "%12.6g", variable->start.real);
        return;
    case TL_STRING:
        (void)fprintf(output, "%12.12s", variable->start.text);
        return;
    case TL_BOOLEAN:
        (void)fprintf(output, "%12s", variable->start.integer != 0 ? "true" : "false");
        return;
    case TL_INTEGER:
    case TL_ENUMERATION:
        (void)fprintf(output, "%12" PRId32, variable->start.integer);
        return;
    }
}

static void print_variables(const tl_assembly *assembly, FILE *output) {
    for (size_t i = 0; i < assembly->fmu_count; i++) {
        const tl_model *model = &assembly->fmus[i].model;
        (void)fprintf(output, "\nvariables of %s (%s)\n", model->name, assembly->fmus[i].path);
        for (size_t k = 0; k < model->variable_count; k++) {
            const tl_variable *variable = &model->variables[k];
            (void)fprintf(output, "  %-20s %-11s %-10s %-9s", variable->name, tl_type_name(variable->type),
                          tl_variability_name(variable->variability), tl_causality_name(variable->causality));
            print_start(variable, output);
            (void)fprintf(output, " %-12s %s\n", variable->unit == NULL ? "" : variable->unit->name,
                          variable->description);
        }
    }
}

static const tl_fmu *find_fmu(const tl_assembly *assembly, const tl_plan_component *component) {
    for (size_t i = 0; i < assembly->fmu_count; i++) {
        if (&assembly->fmus[i].model == component->model) {
            return &assembly->fmus[i];
        }
    }
    return NULL;
}

/* Also for a twin that never rolls back. */
static const char *describe_rollback(const tl_fmu *fmu, const tl_plan_component *component) {
    tl_rollback method = fmu != NULL ? tl_fmu_rollback(fmu) : TL_ROLLBACK_NONE;
    if (method == TL_ROLLBACK_MEMORY) {
        return "rolled back by its memory";
    }
    if (method == TL_ROLLBACK_REPLAY) {
        return "rolled back by replay: reset, then all its inputs repeated";
    }
    if (method == TL_ROLLBACK_STATE && tl_fmu_inputs_are_repeated(fmu)) {
        return "rolled back by its state; inputs and parameters set again";
    }
    return component->model->capabilities.can_get_and_set_state ? "can save its state" : "cannot save its state";
}

/* The component of "component.variable"; NULL for a signal of the plant. */
static const tl_plan_component *component_of(const tl_assembly *assembly, const char *name) {
    for (size_t i = 0; i < assembly->plan.component_count; i++) {
        const tl_plan_component *component = &assembly->plan.components[i];
        size_t length = strlen(component->name);
        if (strncmp(name, component->name, length) == 0 && name[length] == '.') {
            return component;
        }
    }
    return NULL;
}

/* The unit of "component.variable" or "plant.signal"; name "": none. The FMU of `peer`, on the
 * other side, defines the unit of a signal. */
static tl_unit unit_of(const tl_assembly *assembly, const char *name, const char *peer) {
    const tl_plan_component *own = component_of(assembly, name);
    const tl_plan_component *other = component_of(assembly, peer);
    const tl_unit *unit = own != NULL ? tl_model_variable(own->model, name + strlen(own->name) + 1)->unit : NULL;
    size_t signal = tl_config_signal_of(&assembly->config, name);
    tl_unit found = {.name = ""};
    if (own == NULL && other != NULL && signal != SIZE_MAX && assembly->config.signals[signal].plan.unit != NULL) {
        found.name = assembly->config.signals[signal].plan.unit;
        unit = tl_model_unit(other->model, found.name);
    }
    return unit != NULL ? *unit : found;
}

/* In the line of a connection or match: " (bar → Pa: × 100000)" if the units differ. */
static void print_conversion(const tl_assembly *assembly, const char *from, const char *to, FILE *output) {
    const tl_unit source = unit_of(assembly, from, to);
    const tl_unit target = unit_of(assembly, to, from);
    tl_conversion conversion;
    bool is_known =
        tl_units_convert(&source, &target, &conversion) || tl_common_units_convert(&source, &target, &conversion);
    if (is_known && !tl_conversion_is_identity(&conversion)) {
        (void)fprintf(output, " (%s \342\206\222 %s: \303\227 %.6g", source.name, target.name, conversion.factor);
        if (conversion.offset < 0.0 || conversion.offset > 0.0) {
            (void)fprintf(output, " %c %.6g", conversion.offset < 0.0 ? '-' : '+', fabs(conversion.offset));
        }
        (void)fputc(')', output);
    }
}

/* Start values that come from the plant. */
static void print_starts(const tl_assembly *assembly, FILE *output) {
    const tl_config *config = &assembly->config;
    for (size_t i = 0; i < config->component_count; i++) {
        const tl_config_component *component = &config->components[i];
        for (size_t k = 0; k < component->set_count; k++) {
            const tl_plan_set *set = &component->set[k];
            const tl_variable *variable = tl_model_variable(assembly->plan.components[i].model, set->variable);
            if (set->value.type == TL_STRING && variable->type == TL_REAL) {
                (void)fprintf(output, "  %s \342\206\222 %s.%s, at the start\n", set->value.text, component->name,
                              set->variable);
            }
        }
    }
    for (size_t i = 0; i < config->find_count; i++) {
        (void)fprintf(output, "  %s: found in the first %.15g s\n", config->find[i].variable,
                      tl_seconds(config->step * config->find_steps));
    }
    if (config->find_count != 0) {
        (void)fprintf(output, "    then one tick executes these steps up to %zu times\n",
                      TL_FIND_RUNS(config->find_count));
    }
}

static void print_components(const tl_assembly *assembly, FILE *output) {
    (void)fputs("components\n", output);
    for (size_t i = 0; i < assembly->plan.component_count; i++) {
        const tl_plan_component *component = &assembly->components[i];
        const tl_fmu *fmu = find_fmu(assembly, component);
        const char *rollback = describe_rollback(fmu, component);
        int column = fprintf(output, "  %-12s %s, %zu variables,", component->name, assembly->config.components[i].fmu,
                             component->model->variable_count);
        bool fits = column + 1 + (int)strlen(rollback) <= WIDTH;
        (void)fprintf(output, "%s%s", fits ? " " : "\n               ", rollback);
        const tl_fmi2_times *times = fmu != NULL ? tl_fmu_measured_times(fmu) : NULL;
        if (times != NULL) { /* the copy is faster than the FMU's own states */
            (void)fprintf(output,
                          ",\n               %.3g \302\265s to save, step and restore; by its own state %.3g \302\265s",
                          (double)times->by_copy * 1e-3, (double)times->by_states * 1e-3);
        }
        const tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, i);
        if (component->keep == TL_KEEP_AUTO && entry.keep != TL_KEEP_AUTO) {
            (void)fprintf(output, ",\n               \"keep\": \"auto\" keeps %s, as measured here",
                          entry.keep == TL_KEEP_NONE ? "none" : "states");
        }
        if (entry.reads_late) {
            (void)fputs(",\n               its outputs are read after initialisation, because it refuses that before",
                        output);
        }
        (void)fputc('\n', output);
    }
    size_t signals = 0;
    for (size_t i = 0; i < assembly->plan.signal_count; i++) {
        signals += assembly->config.signals[i].is_reading ? 0 : 1;
    }
    (void)fprintf(output, "  %-12s %zu signal%s\n", "plant", signals, signals == 1 ? "" : "s");
    (void)fputs("connections\n", output);
    for (size_t i = 0; i < assembly->plan.connection_count; i++) {
        const tl_plan_connection *connection = &assembly->plan.connections[i];
        (void)fprintf(output, "  %s \342\206\222 %s", connection->from, connection->to);
        print_conversion(assembly, connection->from, connection->to, output);
        (void)fputc('\n', output);
    }
    print_starts(assembly, output);
}

static const char *edge_name(const tl_plan_edge *edge) {
    return edge->falls ? "not " : "";
}

/* Only if it is not the usual one: from 0, without a stop time. */
static void print_time(const tl_assembly *assembly, FILE *output) {
    const tl_config *config = &assembly->config;
    const tl_experiment experiment = tl_twin_get_facts(assembly->twin).experiment;
    if (!isnan(config->stop_s) || experiment.start_s < 0.0 || experiment.start_s > 0.0) {
        (void)fprintf(output, "time of the FMUs\n  %-12s %.15g s (%s)\n  %-12s %.15g s (%s)\n\n", "start",
                      experiment.start_s, isnan(config->start_s) ? "of their DefaultExperiment" : "start_s", "stop",
                      experiment.stop_s, !isnan(config->stop_s) ? "stop_s" : "far: not configured");
    }
}

/* Limits of signals that come from the inputs that they feed. */
static void print_bounds(const tl_assembly *assembly, FILE *output) {
    bool is_first = true;
    for (size_t i = 0; i < assembly->config.signal_count; i++) {
        const tl_plan_signal *signal = &assembly->config.signals[i].plan;
        const tl_twin_bounds bounds = tl_twin_get_bounds(assembly->twin, i);
        if (bounds.input != NULL) {
            (void)fprintf(output, "%s  plant.%s %.6g \342\200\246 %.6g%s%s (declared by %s.%s)%s\n",
                          is_first ? "limits of plant signals, from inputs of FMUs\n" : "", signal->name, bounds.least,
                          bounds.most, signal->unit != NULL && signal->unit[0] != '\0' ? " " : "",
                          signal->unit != NULL ? signal->unit : "", bounds.component, bounds.input,
                          bounds.least <= bounds.most ? "" : ": not used, because no value satisfies all inputs");
            is_first = false;
        }
    }
}

/* Prints the settings of a search with an event horizon. */
static void print_event(const tl_config *config, const tl_twin_facts *facts, FILE *output) {
    const tl_plan_event *event = &config->event;
    int64_t half = (event->window + config->step / 2) / config->step / 2;
    (void)fprintf(output,
                  "  search  %s; at most %" PRIu32 " evaluations a stroke,\n          in as many cycles as they need\n",
                  facts->algorithm, config->budget_evaluations);
    (void)fprintf(
        output, "  stroke  from %s%s to %s%s, at most %g s;\n          J over T_F = %" PRId64 " steps around its end\n",
        edge_name(&event->start), event->start.signal, edge_name(&event->end), event->end.signal,
        tl_seconds(event->longest), 2 * half);
    (void)fprintf(output,
                  "  timing  measurements %s: a search begins %" PRId64 " steps after the end;\n"
                  "          step i is computed at tick i + %" PRIu32 "\n",
                  tl_pairing_names[config->measurements], config->measurements == TL_HOLD ? 0 : half, facts->lead);
}

static void print_mode(const tl_assembly *assembly, FILE *output) {
    const tl_config *config = &assembly->config;
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    if (!config->synchronise) {
        (void)fprintf(output, "free-running, one step every %g s; step i is computed at tick i + %" PRIu32 "\n",
                      tl_seconds(config->step), facts.lead);
        return;
    }
    (void)fprintf(output, "synchronised, one step every %g s\n", tl_seconds(config->step));
    if (config->event.start.signal != NULL) {
        print_event(config, &facts, output);
        return;
    }
    (void)fprintf(output, "  search  %s%s%s; at most %" PRIu32 " evaluations a step\n", facts.algorithm,
                  facts.fallback[0] != '\0' ? ", then " : "", facts.fallback, config->budget_evaluations);
    (void)fprintf(output, "  horizon T_D = %" PRIu32 ", T_P = %" PRIu32 ", %s: %zu unknown%s\n", facts.distance,
                  facts.prediction, config->shape == TL_DYNAMIC ? "dynamic" : "static", facts.unknowns,
                  facts.unknowns == 1 ? "" : "s");
    (void)fprintf(output, "  timing  measurements %s: step i is computed at tick i + %" PRIu32 "\n",
                  tl_pairing_names[config->measurements], facts.lead);
}

/* Prints whether a step waits for the next reading of these signals. */
static void print_wait(const tl_config *config, const char *what, bool inputs, int32_t ticks, FILE *output) {
    bool any = false;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        bool waits = signal->between != TL_BETWEEN_LAST || (ticks > 0 && tl_condition_is_needed(&signal->condition));
        any = any || (waits && inputs == signal->feeds);
    }
    if (any) {
        (void)fprintf(output, "  wait    %s: a step waits for the next one, %" PRId32 " tick%s\n", what, ticks,
                      ticks == 1 ? "" : "s");
    }
}

static void print_adjusted(const tl_assembly *assembly, size_t index, FILE *output) {
    const tl_plan_adjust *adjust = &assembly->config.adjust[index];
    const char *unit = tl_twin_adjust_unit(assembly->twin, index);
    (void)fprintf(output, "  adjust  %s", adjust->variable);
    if (!tl_twin_get_adjusted(assembly->twin, index).is_real) {
        (void)fprintf(output, ", off or on");
    } else if (adjust->step > 0.0) {
        (void)fprintf(output, ", first step %g%s%s", adjust->step, unit[0] != '\0' ? " " : "", unit);
    }
    if (isfinite(adjust->lower) || isfinite(adjust->upper)) {
        (void)fprintf(output, ", within %g \342\200\246 %g", adjust->lower, adjust->upper);
    }
    if (adjust->dwell > 0) {
        (void)fprintf(output, ", each for at least %g s", tl_seconds(adjust->dwell));
    }
    (void)fputc('\n', output);
}

/* By one step of the variable, on the output that it moves first. */
static void print_response(const tl_assembly *assembly, const tl_response *response, FILE *output) {
    const tl_plan_match *match = &assembly->config.match[response->match];
    const char *unit = tl_twin_match_unit(assembly->twin, response->match);
    unit = strcmp(unit, "1") == 0 ? "" : unit;
    if (!response->is_known) {
        return;
    }
    if (response->most <= 0.0) {
        (void)fprintf(output, "          moves no matched output within %g s of the start\n",
                      tl_seconds(response->length));
        return;
    }
    (void)fprintf(
        output, "          which moves %s by %.3g%s%s within T_P,\n          by %.3g within %g s, half of it in %g s\n",
        match->variable, response->soon, unit[0] != '\0' ? " " : "", unit, response->most, tl_seconds(response->length),
        tl_seconds(response->half));
}

static void print_synchronisation(const tl_assembly *assembly, const tl_response *responses, FILE *output) {
    const tl_config *config = &assembly->config;
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        bool is_matched = config->synchronise && match->weight > 0.0;
        const char *unit = tl_twin_match_unit(assembly->twin, i);
        (void)fprintf(output, "  %s %s \342\206\224 %s", is_matched ? "match  " : "compare", match->variable,
                      match->to);
        print_conversion(assembly, match->to, match->variable, output);
        if (is_matched) {
            (void)fprintf(output, ", tolerance %g%s%s, weight %g", match->tolerance, unit[0] != '\0' ? " " : "", unit,
                          match->weight);
        }
        (void)fputc('\n', output);
    }
    print_wait(config, "readings that are matched", false, config->output_lookup.ticks, output);
    print_wait(config, "readings that feed inputs", true, config->input_lookup.ticks, output);
    for (size_t i = 0; i < config->adjust_count; i++) {
        print_adjusted(assembly, i, output);
        print_response(assembly, &responses[i], output);
    }
}

/* Prints a dash if the value is not known. */
static void print_cell(bool is_known, int width, int digits, double value, FILE *output) {
    if (is_known) {
        (void)fprintf(output, " %*.*f", width, digits, value);
    } else {
        (void)fprintf(output, " %*s", width, "-");
    }
}

static void print_need(const tl_twin_ledger *entry, uint32_t prediction, tl_time cost, FILE *output) {
    (void)fprintf(output, "  %-16s %4" PRIu32, entry->name, entry->reach);
    print_cell(entry->on_path, 4, 0, entry->longer, output);
    (void)fprintf(output, " %6" PRIu32 " %6" PRIu32 " %6" PRIu32, prediction, entry->first_need, entry->next_need);
    print_cell(entry->nodes != 0, 6, 0, entry->nodes, output);
    print_cell(entry->nodes != 0, 9, 1, (double)entry->memory / 1024.0, output);
    print_cell(cost != 0, 8, 2, tl_seconds(cost) * 1e6, output);
    (void)fputc('\n', output);
}

/* Prints the executions that the graph predicts: eq. 4.5 and 4.13. */
static void print_needs(const tl_assembly *assembly, const tl_prognosis *prognosis, FILE *output) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    double plain = (double)prognosis->plain;
    if (facts.unknowns == 0 || assembly->config.event.start.signal != NULL) {
        return;
    }
    (void)fprintf(output,
                  "executions of an evaluation, saved by structure: %s, by sequences: %s\n"
                  "  component         \316\223_k  C_k  plain  first   then  nodes cache KiB  \302\265s each\n",
                  facts.structure ? "yes" : "no", facts.sequences ? "yes" : "no");
    for (size_t k = 0; k < facts.components; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, k);
        print_need(&entry, facts.prediction, prognosis->cost[k], output);
    }
    (void)fprintf(output, "  %-26s %6" PRIu64 " %6" PRIu64 " %6" PRIu64 "\n", "sum", prognosis->plain, prognosis->first,
                  prognosis->next);
    (void)fprintf(output, "  %-26s %6.3f %6.3f %6.3f\n", "ratio", 1.0, (double)prognosis->first / plain,
                  (double)prognosis->next / plain);
    (void)fputs("  plain: without saving; first: at most, in the first evaluation of a step;\n"
                "  then: at most, in each later one; cache KiB: without the states of the FMUs\n",
                output);
}

static void print_worst(const tl_config *config, const tl_prognosis *prognosis, FILE *output) {
    (void)fprintf(output, "  worst step   %" PRIu64 " executions: %" PRIu32 " evaluations and the commit\n",
                  prognosis->worst, config->budget_evaluations);
    if (prognosis->worst_time != 0) {
        double worst = tl_seconds(prognosis->worst_time);
        (void)fprintf(output, "               %.4g \302\265s here: %.3g %% of its budget of %g ms\n", worst * 1e6,
                      100.0 * worst / tl_seconds(config->budget_time), tl_seconds(config->budget_time) * 1e3);
    }
}

/* The search of a stroke uses the time that the steps of the cycles leave. */
static void print_stroke(const tl_config *config, const tl_prognosis *prognosis, FILE *output) {
    tl_time each = config->budget_time - prognosis->step_time;
    (void)fprintf(output, "  evaluation   %" PRIu64 " executions at most\n", prognosis->plain);
    (void)fprintf(output, "  worst stroke %" PRIu64 " executions: %" PRIu32 " evaluations\n", prognosis->worst,
                  config->budget_evaluations);
    if (prognosis->worst_time != 0 && each > 0) {
        (void)fprintf(output, "               %.4g ms here: %" PRId64 " cycles of the budget of %g ms\n",
                      tl_seconds(prognosis->worst_time) * 1e3, prognosis->worst_time / each + 1,
                      tl_seconds(config->budget_time) * 1e3);
    }
}

/* Prints a size for people: "10.6 KiB", "130.1 MiB". */
static void print_size(FILE *output, double bytes) {
    double kibibytes = bytes / 1024.0;
    bool large = kibibytes >= 10000.0;
    (void)fprintf(output, "%.1f %s", large ? kibibytes / 1024.0 : kibibytes, large ? "MiB" : "KiB");
}

/* Prints the memory of the FMUs' states, which is not part of `memory`. */
static void print_states(const tl_assembly *assembly, FILE *output) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    tl_twin_ledger largest = {0};
    for (size_t k = 0; k + 1 < facts.components; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, k);
        largest = entry.state_size > largest.state_size ? entry : largest;
    }
    if (largest.state_size != 0) {
        (void)fputs("  states       ", output);
        print_size(output, (double)facts.state_memory);
        (void)fprintf(output, " at most for FMU states; one of %s has ", largest.name);
        print_size(output, (double)largest.state_size);
        (void)fputs("\n", output);
    }
}

/* Prints the limits of a rollback by replay. It repeats all steps since the beginning, so it takes
 * longer and longer. Printed are the last instant with a rollback, and the instant after which it
 * no longer fits into the budget of a step. */
static void print_replay(const tl_config *config, const tl_twin_ledger *entry, tl_time each, FILE *output) {
    const tl_fmi2_replay *replay = &entry->replay;
    tl_time longest = replay->longest_reset + each * (tl_time)replay->most;
    (void)fprintf(output,
                  "  replay       %s is rolled back in its first %" PRIu32 " steps,\n"
                  "               %g s of plant time, and then runs free;\n"
                  "               its inputs take ",
                  entry->name, replay->most, tl_seconds(config->step * (tl_time)replay->most));
    print_size(output, (double)replay->bytes);
    if (each != 0) {
        (void)fprintf(output, ", the longest rollback %.4g \302\265s", tl_seconds(longest) * 1e6);
    }
    if (each == 0 || longest <= config->budget_time) {
        (void)fputs("\n", output);
        return;
    }
    tl_time remaining = config->budget_time - replay->longest_reset;
    tl_time fitting = remaining > 0 ? remaining / each : 0;
    (void)fprintf(output, ";\n               from %g s on longer than the budget of %g ms\n",
                  tl_seconds(config->step * fitting), tl_seconds(config->budget_time) * 1e3);
}

static void print_replays(const tl_assembly *assembly, const tl_prognosis *prognosis, FILE *output) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    for (size_t k = 0; k + 1 < facts.components; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, k);
        if (entry.replay.most != 0) {
            print_replay(&assembly->config, &entry, prognosis->cost[k], output);
        }
    }
}

static void print_block(const char *name, size_t bytes, const char *purpose, FILE *output) {
    if (bytes != 0) {
        (void)fprintf(output, "  %-13s", name);
        print_size(output, (double)bytes);
        (void)fprintf(output, " %s\n", purpose);
    }
}

/* Returns the size in bytes of the saved twin after the dry run; 0 if the twin is not saved or
 * cannot be. */
static size_t saved_size(const tl_assembly *assembly) {
    bool is_saved = assembly->config.record_resume != 0 && tl_twin_can_save(assembly->twin);
    size_t size = 0;
    tl_error error;
    return is_saved && tl_twin_save(assembly->twin, NULL, 0, &size, &error) == TL_OK ? size : 0;
}

/* Prints the memory that `run` needs for a live plant. */
static void print_blocks(const tl_live_blocks *blocks, FILE *output) {
    print_block("samples", blocks->sample_memory, "in `run`, for the newest readings of the plant", output);
    print_block("record queue", blocks->queue, "in `run`, for results that are not recorded yet", output);
    print_block("checkpoint", blocks->checkpoints, "in `run`, for saved states of the twin", output);
    print_block("resume", blocks->resume, "in `run`, at most, while it resumes an earlier run", output);
    print_block("second twin", blocks->shadow, "in `run`, at most, while `reload` tests a second twin", output);
}

static void print_record(const tl_config *config, FILE *output) {
    char ticks[32];
    char minutes[32];
    char hours[32];
    if (config->record_file != NULL) {
        const tl_recorder_span span = tl_recorder_settings_span(config);
        tl_show_duration(span.ticks_s, ticks, sizeof ticks);
        tl_show_duration(span.minutes_s, minutes, sizeof minutes);
        tl_show_duration(span.hours_s, hours, sizeof hours);
        (void)fprintf(output,
                      "  record       %.6g MB hold about %s of all steps,\n"
                      "               %s of their minutes, and %s of their hours\n",
                      (double)config->record_max_bytes / 1e6, ticks, minutes, hours);
    }
}

static void print_released(const tl_config *config, tl_twin_facts facts, FILE *output) {
    if (facts.released_state == TL_RELEASED_ON) {
        (void)fprintf(output,
                      "  released     two twins without corrections, for %g s each:\n"
                      "               %" PRIu64 " executions beside each step, included in the time above",
                      tl_seconds(config->step * (tl_time)facts.released_steps), 2 * (uint64_t)facts.components);
        if (facts.released_time != 0) {
            (void)fprintf(output, ",\n               %.4g \302\265s here: %.3g %% of the period",
                          tl_seconds(facts.released_time) * 1e6,
                          100.0 * tl_seconds(facts.released_time) / tl_seconds(config->step));
        }
        (void)fputs("\n", output);
    } else if (facts.released_state != TL_RELEASED_OFF) {
        (void)fprintf(output, "  released     none: %s\n", tl_released_state_text(facts.released_state));
    }
}

static void print_costs(const tl_assembly *assembly, const tl_prognosis *prognosis, const tl_live_blocks *blocks,
                        FILE *output) {
    const tl_config *config = &assembly->config;
    (void)fputs("cost\n", output);
    (void)fprintf(output, "  free step    %" PRIu64 " executions\n", prognosis->step);
    (void)fprintf(output, "               %.4g \302\265s here: %.3g %% of the period\n",
                  tl_seconds(prognosis->step_time) * 1e6,
                  100.0 * tl_seconds(prognosis->step_time) / tl_seconds(config->step));
    if (tl_twin_get_facts(assembly->twin).has_free_twin) {
        (void)fprintf(output,
                      "  free twin    %" PRIu64 " executions beside each step, twice that while u is\n"
                      "               searched; included in the time above\n",
                      prognosis->step);
    }
    print_released(config, tl_twin_get_facts(assembly->twin), output);
    if (config->event.start.signal != NULL) {
        print_stroke(config, prognosis, output);
    } else if (config->adjust_count != 0) {
        print_worst(config, prognosis, output);
    }
    (void)fprintf(output, "  memory       %.1f KiB for the twin, allocated at the start\n",
                  (double)tl_twin_get_facts(assembly->twin).memory / 1024.0);
    (void)fprintf(output, "               and %d MiB of stack for FMUs%s\n", TL_FMU_THREAD_STACK >> 20,
                  config->realtime_lock_memory ? "; `run` locks both in RAM" : "");
    print_states(assembly, output);
    print_replays(assembly, prognosis, output);
    if (config->source_count != 0) {
        print_blocks(blocks, output);
        print_record(&assembly->config, output);
    }
    (void)fprintf(output, "  measured by %zu free steps with the plant's initial values, without a search\n",
                  prognosis->steps);
}

/* Prints the limits of the FMUs, and the paths that they may read in addition to those of all
 * programs. */
static void print_limits(const tl_assembly *assembly, uint64_t memory, FILE *output) {
    tl_readable_paths places = {.count = 0};
    (void)fprintf(output,
                  "limits of the FMUs\n  FMUs may take %" PRIu64 " MiB (--memory-limit), %d MiB of files, %d threads\n",
                  memory >> 20, TL_TWIN_FOLDER_MIB, TL_TWIN_THREADS);
    tl_readable_paths_find(assembly, &places);
    for (size_t i = 0; i < places.count; i++) {
        char clean[PATH_MAX];
        (void)tl_clean_text(places.path[i], strlen(places.path[i]), clean, sizeof clean);
        (void)fprintf(output, "%s    %s\n", i == 0 ? "  FMUs may also read\n" : "", clean);
    }
    tl_readable_paths_free(&places);
    if (geteuid() == 0) {
        (void)fputs("  FMUs run as root, without capabilities: TMPDIR is closed to other users,\n"
                    "  or this container has no user for them\n",
                    output);
    }
}

/* A shorter time is worth a line only from here on. */
static const double WORTH_A_LINE = 0.5;

/* Returns the time of a component in a search without results kept, as a part of that with all
 * states kept; 1 if it cannot be measured. */
static double part_without_states(const tl_assembly *assembly, size_t component) {
    const tl_time longest = TL_SECOND / 100;
    tl_twin_timing timing = {.rounds = 0};
    if (assembly->config.components[component].keep == TL_KEEP_STATES &&
        tl_fmu_rollback(tl_assembly_fmu(assembly, component)) != TL_ROLLBACK_REPLAY) {
        tl_twin_time_component(assembly->twin, component, tl_clock_now, NULL, longest, &timing);
    }
    return timing.rounds == 0 ? 1.0 : tl_twin_part_without_states(assembly->twin, component, &timing);
}

/* Prints components that are faster if no results are kept. Measures them: the twin cannot step
 * afterwards. */
static void print_faster_keep(const tl_assembly *assembly, FILE *output) {
    const char *title = "faster\n";
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    for (size_t k = 0; facts.sequences && facts.returns && k < assembly->config.component_count; k++) {
        double part = part_without_states(assembly, k);
        if (part < WORTH_A_LINE) {
            (void)fprintf(output, "%s  %-12s \"keep\": \"none\" would take %.2g times as long in a search\n", title,
                          assembly->config.components[k].name, part);
            title = "";
        }
    }
}

/* Prints how rollback was tested: by the proof at the start, and later. A brief check (of a trial,
 * whose caller waits) has only the proof. */
static void print_rollback_test(const tl_assembly *assembly, const tl_late_verification *test, FILE *output) {
    tl_time step = assembly->config.step;
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    if (facts.proved_executions != 0) {
        (void)fprintf(output,
                      "rollback\n  tested at the start by %" PRIu64 " executions, which no other count includes\n",
                      facts.proved_executions);
    }
    if (test->times != 0) {
        (void)fprintf(output, "  tested %" PRIu64 " times, %g \342\200\246 %g s from the start: %s\n", test->times,
                      tl_seconds(tl_time_of_step(0, step, test->first)),
                      tl_seconds(tl_time_of_step(0, step, test->first + test->steps)),
                      test->outcome.found ? "not exact" : "exact");
    }
}

static const char *describe_read_back(const tl_read_back_component *found) {
    switch (found->finding) {
    case TL_READ_BACK_IS_EXACT:
        return "read back exactly";
    case TL_READ_BACK_ENDS:
        return "ends the process that loads it";
    case TL_READ_BACK_IS_REFUSED:
        return "refused";
    case TL_READ_BACK_IS_OTHER:
        return "loaded, but then gives other values";
    case TL_READ_BACK_NOT_REPEATABLE:
        return "gives other values after loading, also in the process that saved it";
    case TL_READ_BACK_UNKNOWN:
        break;
    }
    return "unknown: not tested";
}

/* Prints whether saved states can be loaded by another process, if that was tried. */
static void print_read_back(const tl_assembly *assembly, const tl_read_back_report *report, FILE *output) {
    if (report->is_tried) {
        (void)fputs("saved states, loaded by another process\n", output);
    }
    for (size_t i = 0; i < report->count && report->is_tried; i++) {
        (void)fprintf(output, "  %-12s %s\n", assembly->config.components[i].name, describe_read_back(&report->of[i]));
    }
}

/* Logs a failure of the dry run. With constant inputs, often a stop time causes a failure after the
 * first steps: some exporters write one into the FMU. */
static void report_failure(const tl_assembly *assembly, const tl_prognosis *prognosis) {
    int64_t lead = (int64_t)tl_twin_get_facts(assembly->twin).lead;
    int64_t step = prognosis->next_tick - 1 > lead ? prognosis->next_tick - 1 - lead : 0;
    char component[TL_ASSEMBLY_NAME] = "";
    char quote[TL_ERROR_TEXT];
    tl_assembly_find_component(assembly, prognosis->error.text, component);
    if (tl_twin_get_facts(assembly->twin).rollback_inexact || component[0] == '\0') {
        tl_log(TL_LOG_ERROR, "%s", prognosis->error.text);
        return;
    }
    tl_assembly_quote(prognosis->error.text, component, quote, sizeof quote);
    const char *said = tl_assembly_last_message(assembly, component);
    tl_log(TL_LOG_ERROR,
           "%s: components.%s: fails in step %" PRId64 ", at %g s, with constant inputs: %.200s; %s%.240s%s; %s",
           assembly->config.path, component, step, tl_seconds(tl_time_of_step(0, assembly->config.step, step)), quote,
           said[0] != '\0' ? "it said: \"" : "it said nothing (\"logging\": true may help)", said,
           said[0] != '\0' ? "\"" : "",
           step < 1 ? "give it other values (\"set\" of the component, \"initial\" of its signals), or export it again"
                    : "if it has a stop time, export it without one");
}

static void print_reactions(const tl_assembly *assembly, const tl_response *responses, FILE *output) {
    for (size_t i = 0; i < assembly->config.adjust_count; i++) {
        const tl_response *response = &responses[i];
        if (response->is_known) {
            (void)fprintf(output, "%zu %zu %.17g %.17g\n", i, response->match, response->most,
                          tl_seconds(response->half));
        }
    }
}

static void print_forecast(const tl_assembly *assembly, const tl_prognosis *prognosis, const tl_response *responses,
                           const tl_live_blocks *blocks, FILE *output) {
    const tl_config *config = &assembly->config;
    (void)fprintf(output, "%s: %s\n", config->path, config->name);
    print_components(assembly, output);
    print_time(assembly, output);
    print_bounds(assembly, output);
    print_mode(assembly, output);
    print_synchronisation(assembly, responses, output);
    print_delays(config, output);
    print_needs(assembly, prognosis, output);
    print_costs(assembly, prognosis, blocks, output);
}

static void print_tests(const tl_assembly *assembly, const tl_twin_job *job, const tl_late_verification *rollback,
                        const tl_read_back_report *states, FILE *output) {
    print_rollback_test(assembly, rollback, output);
    print_read_back(assembly, states, output);
    if (!job->unconfined) {
        print_limits(assembly, job->memory, output);
    }
}

static tl_status print_page(const tl_assembly *assembly, const tl_twin_job *job, const tl_read_back_host *host,
                            FILE *output, tl_twin_check *found) {
    const tl_config *config = &assembly->config;
    tl_prognosis prognosis;
    tl_live_blocks blocks;
    tl_late_verification rollback = {.times = 0};
    tl_read_back_report states;
    tl_response responses[TL_MAX_ADJUST];
    tl_prognosis_make(assembly, &prognosis);
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    if (prognosis.error.status != TL_OK) {
        report_failure(assembly, &prognosis);
        return prognosis.error.status;
    }
    tl_time longest = job->brief ? 0 : TL_RESPONSE_LONGEST;
    tl_status status = tl_response_measure(assembly, prognosis.step_time, longest, responses, &prognosis.error);
    bool is_usable = status == TL_OK; /* else the twin cannot be tested any more */
    if (job->reactions) {
        print_reactions(assembly, responses, output);
        return TL_OK;
    }
    tl_live_blocks_of(config, saved_size(assembly), &blocks);
    if (!job->json) {
        print_forecast(assembly, &prognosis, responses, &blocks, output);
    }
    if (!job->brief && is_usable) {
        tl_late_verification_run(assembly, prognosis.next_tick, &rollback);
    }
    tl_read_back_run(assembly, is_usable ? host : NULL, &states);
    if (job->json) {
        const tl_check_facts check = {assembly, &prognosis, responses, &rollback, &states};
        return tl_check_json_print(&check, output, &prognosis.error);
    }
    print_tests(assembly, job, &rollback, &states, output);
    if (!job->brief && is_usable && config->event.start.signal == NULL) {
        print_faster_keep(assembly, output);
    }
    found->warnings = (uint32_t)tl_advice_print(assembly, &prognosis, responses, &rollback, &states, output, NULL);
    found->least = prognosis.step_time;
    found->worst = prognosis.worst_time;
    found->memory = (uint64_t)facts.memory + facts.state_memory + blocks.queue + blocks.checkpoints;
    return TL_OK;
}

/* Steps before the state is saved for the test, in addition to the twin's lead. */
enum { TRIED_AFTER = 20 };

/* Writes to `why` why another process cannot use the saved states; leaves it unchanged if no reason
 * was found. A state that cannot be tested is assumed to be good. */
static void find_useless_states(const tl_assembly *assembly, const tl_read_back_host *host,
                                char why[TL_TWIN_CHECK_WHY]) {
    tl_read_back_report report;
    tl_sample sample;
    tl_error error;
    tl_status status =
        tl_prognosis_run_dry(assembly, tl_twin_get_facts(assembly->twin).lead + (int64_t)TRIED_AFTER, &sample, &error);
    tl_read_back_run(assembly, status == TL_OK ? host : NULL, &report);
    for (size_t i = 0; i < report.count; i++) {
        const tl_read_back_component *found = &report.of[i];
        if (tl_read_back_prevents_resume(found->finding)) {
            (void)snprintf(why, TL_TWIN_CHECK_WHY, "a saved state of %.40s %s (%.250s)",
                           assembly->config.components[i].name, tl_read_back_text(found->finding), found->text);
            break;
        }
    }
}

tl_status tl_check_page_print(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                              const tl_read_back_host *host, FILE *page, tl_twin_check *found) {
    if (status == TL_OK && job->states_only) {
        find_useless_states(assembly, host, found->why);
    } else if (status == TL_OK) {
        status = print_page(assembly, job, host, page, found);
    } else if (assembly->problems.report.count > 1 && !job->json) {
        tl_log(TL_LOG_ERROR, "%zu problems", assembly->problems.report.count);
    }
    if (job->variables) {
        print_variables(assembly, page);
    }
    return status;
}
