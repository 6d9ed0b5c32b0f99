/* Forecast and advice of `check`: see advice.h. */
#include "firmware/cli/advice.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/config/drivers.h"
#include "master/base/estimate.h"
#include "master/plan/plan.h"

/* ---- prognosis ---- */

/* Steps of the dry run; fewer if they take longer than LONGEST. A twin that saves nothing measures
 * the cost of each component only in every sixteenth step. The first steps only warm up and are not
 * counted. */
enum { DRY_STEPS = 1600, WARMING_STEPS = 10 };
static const tl_time LONGEST = TL_SECOND;

/* ---- executions ---- */

static void count_executions(const tl_assembly *assembly, tl_prognosis *prognosis) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    uint64_t evaluations = assembly->config.budget_evaluations;
    prognosis->step = facts.executions_per_step;
    prognosis->plain = facts.executions_per_evaluation;
    for (size_t k = 0; k < facts.components; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, k);
        prognosis->first += entry.first_need;
        prognosis->next += entry.next_need;
    }
    prognosis->worst = prognosis->step;
    if (facts.unknowns != 0) {
        prognosis->worst += prognosis->first + (evaluations - 1) * prognosis->next;
    }
}

/* ---- time ---- */

/* `noted` receives the first outputs that are not finite; may be NULL. */
static tl_status take_step(const tl_assembly *assembly, tl_sample *sample, tl_prognosis *noted, tl_error *error) {
    const tl_budget budget = {
        .evaluations = 1, .time = INT64_MAX / 4, .started = tl_clock_now(NULL), .now = tl_clock_now};
    tl_record record;
    bool ready = false;
    tl_status status = tl_twin_step(assembly->twin, sample, &budget, &record, &ready, error);
    sample->tick++;
    if (status == TL_OK && ready && noted != NULL && noted->bad_outputs == 0) {
        noted->bad_outputs = record.bad_outputs;
        noted->bad_step = record.step;
    }
    return status;
}

/* The twin's cost is the longest recent time. The minimum of these is not disturbed by other load
 * of the machine. */
static void note_costs(const tl_assembly *assembly, tl_prognosis *prognosis) {
    size_t count = tl_twin_get_facts(assembly->twin).components;
    assert(count <= TL_RECORDER_COMPONENTS);
    for (size_t k = 0; k < count; k++) {
        tl_time cost = tl_twin_get_ledger(assembly->twin, k).cost;
        prognosis->cost[k] = prognosis->steps == 0 || cost < prognosis->cost[k] ? cost : prognosis->cost[k];
    }
}

static tl_status warm_up(const tl_assembly *assembly, int64_t ticks, tl_sample *sample, tl_prognosis *noted,
                         tl_error *error) {
    tl_status status = TL_OK;
    *sample = (tl_sample){0};
    memset(sample->quality, TL_NO_LINK, assembly->config.signal_count);
    while (status == TL_OK && sample->tick < ticks) {
        status = take_step(assembly, sample, noted, error);
    }
    return status;
}

tl_status tl_prognosis_run_dry(const tl_assembly *assembly, int64_t ticks, tl_sample *sample, tl_error *error) {
    return warm_up(assembly, ticks, sample, NULL, error);
}

/* At most `most` steps, and at most this part of those before the stop time: the late verification
 * needs some. */
static int64_t limit_steps(const tl_assembly *assembly, int64_t most, double part) {
    int64_t limit = (int64_t)(part * (double)tl_assembly_steps_to_stop(assembly));
    return limit < 1 ? 1 : limit < most ? limit : most;
}

/* No signal has a reading, so nothing is matched and every step is a free one. */
static void run_dry(const tl_assembly *assembly, tl_prognosis *prognosis) {
    tl_sample sample;
    int64_t before = (int64_t)tl_twin_get_facts(assembly->twin).lead + limit_steps(assembly, WARMING_STEPS, 0.2);
    uint32_t most = (uint32_t)limit_steps(assembly, DRY_STEPS, 0.4);
    tl_status status = warm_up(assembly, before, &sample, prognosis, &prognosis->error);
    tl_time began = tl_clock_now(NULL);
    while (status == TL_OK && prognosis->steps < most &&
           (prognosis->steps == 0 || tl_clock_now(NULL) - began < LONGEST)) {
        status = take_step(assembly, &sample, prognosis, &prognosis->error);
        note_costs(assembly, prognosis);
        prognosis->steps++;
    }
    prognosis->next_tick = sample.tick;
    if (status == TL_OK && prognosis->steps > 0) {
        prognosis->error = (tl_error){TL_OK, ""}; /* of a finding that was mended */
        prognosis->step_time = (tl_clock_now(NULL) - began) / (tl_time)prognosis->steps;
    }
}

static void predict_time(const tl_assembly *assembly, tl_prognosis *prognosis) {
    size_t count = tl_twin_get_facts(assembly->twin).components;
    uint32_t evaluations = assembly->config.budget_evaluations;
    tl_time once = 0;
    tl_time next = 0;
    for (size_t k = 0; k < count; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, k);
        once = tl_duration_sum(once, prognosis->cost[k], 1 + (uint64_t)entry.first_need);
        next = tl_duration_sum(next, prognosis->cost[k], entry.next_need);
    }
    tl_time left = assembly->config.budget_time - once;
    prognosis->worst_time = tl_duration_sum(once, next, evaluations - 1);
    prognosis->fitting = left < 0 ? 0 : evaluations;
    if (left >= 0 && next > 0 && left / next + 1 < (tl_time)evaluations) {
        prognosis->fitting = (uint32_t)(left / next + 1);
    }
}

void tl_prognosis_make(const tl_assembly *assembly, tl_prognosis *prognosis) {
    *prognosis = (tl_prognosis){0};
    count_executions(assembly, prognosis);
    run_dry(assembly, prognosis);
    if (prognosis->error.status == TL_OK && tl_twin_get_facts(assembly->twin).unknowns != 0) {
        predict_time(assembly, prognosis);
    }
}

/* ---- advice ---- */

enum { INDENT = 4, TEXT = 512 };

static const double LONG_LEAD_S = 60;
static const double LEAST_STEP = 1e-150; /* the square of it and its inverse are still valid numbers */
static const double LEAST_SHARE = 1e-12; /* of the nominal: leaves some digits for the search */

typedef struct warnings {
    FILE *file;
    tl_json_writer *json; /* NULL: as text */
    const tl_config *config;
    size_t count;
} warnings;

static void warn(warnings *list, const char *path, const char *format, ...) TL_PRINTF(3, 4);

static void warn(warnings *list, const char *path, const char *format, ...) {
    char text[TEXT];
    va_list arguments;
    int length = snprintf(text, sizeof text, "%.200s: ", path);
    va_start(arguments, format);
    (void)vsnprintf(text + length, sizeof text - (size_t)length, format, arguments);
    va_end(arguments);
    if (list->json != NULL) {
        tl_problems_add_json(list->json, path, tl_config_line(list->config, path), text + length);
        list->count++;
        return;
    }
    (void)fputs(list->count == 0 ? "warnings\n" : "", list->file);
    tl_wrapped_print(list->file, text, INDENT - 2, INDENT);
    list->count++;
}

/* Each output once, though it may be matched and drive inputs. */
static void check_outputs(warnings *list, const tl_config *config, const tl_prognosis *prognosis) {
    const char *name = "";
    for (size_t bit = 0; name != NULL && bit < TL_CONFIG_OUTPUTS; bit++) {
        name = tl_config_output_name(config, bit);
        if (name != NULL && tl_config_is_bad_output(config, prognosis->bad_outputs, bit)) {
            warn(list, name,
                 "not finite (NaN or infinity) in step %" PRId64
                 " of the dry run, at %g s, with the plant's initial values: "
                 "such a value is left out of the matching, and inputs that it drives keep their last value; check the "
                 "model, for example for 0/0",
                 prognosis->bad_step, tl_seconds(tl_time_of_step(0, config->step, prognosis->bad_step)));
        }
    }
}

static void check_step(warnings *list, const tl_config *config, const tl_prognosis *prognosis) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        if (signal->of == i && signal->stale_s > 0.0 && tl_seconds(config->step) > signal->stale_s) {
            warn(
                list, "step_s",
                "%g s is longer than stale_s of %s, %g s: values are stale before the next step. Take a smaller step_s, "
                "about the time between two readings",
                tl_seconds(config->step), signal->plan.where, signal->stale_s);
            break;
        }
    }
    if (prognosis->step_time >= config->step) {
        warn(
            list, "step_s",
            "a step without a search takes %.3g ms here, more than the period of %g ms: raise step_s, or use a faster machine",
            tl_seconds(prognosis->step_time) * 1e3, tl_seconds(config->step) * 1e3);
    }
}

/* The guess, each unknown once, and nominal. A single Boolean has only two values: nominal and its
 * negation. */
static size_t fewest_evaluations(const tl_twin *twin) {
    size_t unknowns = tl_twin_get_facts(twin).unknowns;
    return unknowns == 1 && !tl_twin_get_adjusted(twin, 0).is_real ? 2 : unknowns + 2;
}

static void check_budget(warnings *list, const tl_config *config, const tl_prognosis *prognosis, const tl_twin *twin) {
    size_t unknowns = tl_twin_get_facts(twin).unknowns;
    if (config->budget_time >= config->step) {
        warn(list, "synchronise.budget.time_s",
             "%g s is not less than step_s, %g s: a long search makes the next tick late. Take 0.6 of step_s, the "
             "default",
             tl_seconds(config->budget_time), tl_seconds(config->step));
    }
    if (prognosis->worst_time > config->budget_time) {
        warn(list, "synchronise.budget",
             "%" PRIu32
             " evaluations can take %.3g ms here, but time_s is %.3g ms: such a search ends after about %" PRIu32
             ". Shorten the horizon, or raise time_s",
             config->budget_evaluations, tl_seconds(prognosis->worst_time) * 1e3, tl_seconds(config->budget_time) * 1e3,
             prognosis->fitting);
    }
    if (config->stagnation != 0 && config->stagnation < unknowns + 2) {
        warn(list, "synchronise.stagnation",
             "%" PRIu32
             " evaluations without progress end a solver before it has tried each of %zu unknowns once: raise it",
             config->stagnation, unknowns);
    }
    if (config->budget_evaluations < fewest_evaluations(twin)) {
        warn(list, "synchronise.budget.evaluations",
             "%" PRIu32
             " are not enough to try the first guess, nominal, and each of %zu unknowns once: raise it, or make "
             "the horizon shorter or static",
             config->budget_evaluations, unknowns);
    }
}

/* Warns if even a stroke that is wrong in every sample of the window has J < 1, because then no
 * stroke is searched. */
static void check_stroke_tolerance(warnings *list, const tl_config *config) {
    tl_time half = config->event.window / config->step / 2;
    double samples = 2.0 * (double)half + 1.0;
    double most = 0.0;
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        bool is_event = strcmp(match->to, config->event.end.signal) == 0;
        most += is_event ? samples * match->weight / (match->tolerance * match->tolerance) : 0.0;
    }
    if (most < 1.0) {
        warn(list, "synchronise.horizon.event",
             "if all samples of the window are wrong, J is %.3g, and below 1 nothing is searched. Take a tolerance of "
             "1: J is then the number of wrong samples",
             most);
    }
}

/* With an event horizon, the search continues from cycle to cycle. But each cycle needs time for at
 * least one step of a candidate. */
static void check_stroke_budget(warnings *list, const tl_config *config, const tl_prognosis *prognosis) {
    if (2 * prognosis->step_time > config->budget_time) {
        warn(
            list, "synchronise.budget.time_s",
            "%g s is too short for the step of a cycle (%.3g ms here) and one step of a candidate, so no stroke can be "
            "searched: raise it",
            tl_seconds(config->budget_time), tl_seconds(prognosis->step_time) * 1e3);
    }
}

static void check_saving(warnings *list, const tl_config *config) {
    if (!config->saving.structure) {
        warn(list, "synchronise.saving.structure",
             "off: components execute even if they can no longer reach a matched output. The results are the same");
    }
    if (!config->saving.sequences) {
        warn(list, "synchronise.saving.sequences",
             "off: executions with known results are repeated. The results are the same");
    }
    for (size_t i = 0; i < config->component_count && config->saving.sequences; i++) {
        if (config->components[i].keep == TL_KEEP_OUTPUTS) {
            warn(list, config->components[i].where,
                 "keep \"outputs\": executions are repeated to restore a state, in addition to those predicted. Use it "
                 "only "
                 "if saving a state takes longer than a step");
        }
    }
}

/* Warns if the low-pass delays a step by more than LONG_LEAD_S (60 s), or beyond the end of the
 * run. Such a step does not show the present state of the plant. */
static void check_lead(warnings *list, const tl_config *config, uint32_t lead) {
    double seconds = tl_seconds(config->step) * lead;
    bool beyond_end = config->duration != 0 && seconds > tl_seconds(config->duration);
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        if (config->conditions[i].low_pass > 0 && (beyond_end || seconds > LONG_LEAD_S)) {
            warn(list, match->where,
                 "its low-pass delays the measurement by %g s, so a step is computed %g s after its instant%s: shorten "
                 "low_pass_s",
                 tl_seconds(config->conditions[i].low_pass), seconds, beyond_end ? ", which is after duration_s" : "");
        }
    }
}

/* Warns only of the component with the largest need. */
static void check_room(warnings *list, const tl_config *config, const tl_twin *twin) {
    tl_twin_ledger nodes = {0};
    tl_twin_ledger states = {0};
    for (size_t i = 0; i < config->component_count; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(twin, i);
        nodes = entry.nodes < entry.nodes_worst && entry.nodes_worst > nodes.nodes_worst ? entry : nodes;
        states = entry.states < entry.nodes && entry.state_size > states.state_size ? entry : states;
    }
    if (nodes.nodes_worst != 0) {
        warn(list, "synchronise.saving.nodes",
             "room for %" PRIu32 " executions of %s, but the worst case needs %" PRIu64
             ": the others may be executed again. Raise it, or lower budget.evaluations or the horizon",
             nodes.nodes, nodes.name, nodes.nodes_worst);
    }
    if (states.state_size != 0) {
        warn(list, "synchronise.saving.memory_mb",
             "room for %" PRIu32 " states of %s of %.4g KiB each, but up to %" PRIu32
             " executions are kept: to restore one without a state, steps are repeated. Raise it, or lower "
             "budget.evaluations or the horizon",
             states.states, states.name, (double)states.state_size / 1024.0, states.nodes);
    }
}

/* In first steps of the search, to both sides of nominal. */
static const double LEAST_RANGE = 2.0;

typedef struct proposed_bounds {
    double least, most;
    char why[100]; /* "": nothing is proposed */
} proposed_bounds;

/* Proposes the limits of the plant's signal that delivers û, or else û and its usual size to both
 * sides. No recording is used, because the same error of wiring may be in it. */
static proposed_bounds propose_bounds(const tl_config *config, const tl_twin_adjusted *adjusted, const char *variable) {
    proposed_bounds bounds = {.why = ""};
    for (size_t i = 0; i < config->connection_count; i++) {
        size_t k = tl_config_signal_of(config, config->connections[i].from);
        const tl_config_signal *signal = k < config->signal_count ? &config->signals[k] : NULL;
        if (strcmp(config->connections[i].to, variable) == 0 && signal != NULL && isfinite(signal->minimum) &&
            isfinite(signal->maximum)) {
            bounds = (proposed_bounds){.least = signal->minimum, .most = signal->maximum};
            (void)snprintf(bounds.why, sizeof bounds.why, "the limits of %.60s", config->connections[i].from);
        }
    }
    if (!adjusted->is_fed) {
        bool is_declared = adjusted->size < 1.0 || adjusted->size > 1.0;
        double size = fmax(is_declared ? adjusted->size : fabs(adjusted->nominal), LEAST_RANGE * adjusted->step);
        bounds = (proposed_bounds){.least = adjusted->nominal - size, .most = adjusted->nominal + size};
        (void)snprintf(bounds.why, sizeof bounds.why, "nominal \302\261 %.3g", size);
    }
    return bounds;
}

/* Without bounds, a search can correct any error of wiring, and the twin is in lock all the same.
 */
static void check_bounds(warnings *list, const tl_config *config, const tl_twin_adjusted *adjusted, size_t index) {
    bool has_lower = isfinite(adjusted->lower);
    bool has_upper = isfinite(adjusted->upper);
    char example[TEXT / 2] = "";
    proposed_bounds bounds = propose_bounds(config, adjusted, config->adjust[index].variable);
    if (bounds.why[0] != '\0') {
        (void)snprintf(example, sizeof example, ", for example %.3g \342\200\246 %.3g (%s)",
                       has_lower ? adjusted->lower : bounds.least, has_upper ? adjusted->upper : bounds.most,
                       bounds.why);
    }
    if (!has_lower || !has_upper) {
        warn(
            list, config->adjust[index].where,
            "neither configuration nor FMU has %s: the twin can be in lock with a wrong address, scale or sign. Set it "
            "to what the plant can have%s",
            has_lower   ? "\"max\""
            : has_upper ? "\"min\""
                        : "\"min\" or \"max\"",
            example);
    }
}

static void check_adjusted(warnings *list, const tl_config *config, const tl_twin *twin) {
    for (size_t i = 0; i < config->adjust_count; i++) {
        const tl_twin_adjusted adjusted = tl_twin_get_adjusted(twin, i);
        const char *path = config->adjust[i].where;
        if (!adjusted.is_real) {
            continue;
        }
        check_bounds(list, config, &adjusted, i);
        if (!adjusted.is_fed && (adjusted.nominal < adjusted.lower || adjusted.nominal > adjusted.upper)) {
            warn(list, path,
                 "nominal %g is outside its bounds, %g to %g, and is still used if no correction is better: widen the "
                 "bounds, or correct nominal",
                 adjusted.nominal, adjusted.lower, adjusted.upper);
        }
        double size = adjusted.is_fed ? 0.0 : fabs(adjusted.nominal);
        if (adjusted.step < LEAST_STEP || adjusted.step < size * LEAST_SHARE) {
            warn(list, path, "step %g is so small that the first move is lost in rounding: raise it", adjusted.step);
        }
        if (adjusted.step > 1 / LEAST_STEP || adjusted.step > adjusted.upper - adjusted.lower) {
            warn(
                list, path,
                "step %g is larger than the range of the search, %g to %g: lower it, or widen min and max to what the plant "
                "can have",
                adjusted.step, adjusted.lower, adjusted.upper);
        }
    }
}

/* In tolerances. Tried with tanks and TCLab: below 0.02 the twin was not corrected at all; above
 * 0.03 it was in lock. */
static const double LEAST_MOVEMENT = 0.05;
static const double LEAST_FIRST_MOVE = 0.01; /* in tolerances, by one `step` */
static const double LEAST_STEP_OF_RANGE = 1e-3;

/* A small first step wastes evaluations, until the search has found the size of its moves. */
static void check_first_move(warnings *list, const tl_config *config, size_t index, const tl_response *response) {
    const tl_plan_match *match = &config->match[response->match];
    double step = config->adjust[index].step;
    double moved = response->soon / match->tolerance;
    const tl_plan_adjust *adjust = &config->adjust[index];
    bool is_small = step < LEAST_STEP_OF_RANGE * (adjust->upper - adjust->lower); /* not without bounds */
    if (is_small && isfinite(adjust->upper - adjust->lower) && response->soon > 0.0 && moved < LEAST_FIRST_MOVE) {
        warn(list, config->adjust[index].where,
             "step %g moves %s by %.3g within T_P, %.2g of its tolerance: raise it to about %.2g", step,
             match->variable, response->soon, moved, 0.1 * step / moved);
    }
}

/* The search cannot tell Real variables apart that outnumber the matched outputs. Only those count
 * that have an effect. */
static void check_surplus(warnings *list, const tl_config *config, const tl_twin *twin, const tl_response *responses) {
    char names[TEXT / 2] = "";
    size_t count = 0;
    size_t matched = 0;
    for (size_t i = 0; i < config->match_count; i++) {
        matched += config->match[i].weight > 0.0 ? 1 : 0;
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        size_t used = strlen(names);
        if (tl_twin_get_adjusted(twin, i).is_real && responses[i].is_known && responses[i].most > 0.0) {
            (void)snprintf(names + used, sizeof names - used, "%s%.60s", count > 0 ? ", " : "",
                           config->adjust[i].variable);
            count++;
        }
    }
    if (count > matched) {
        warn(
            list, "synchronise.adjust",
            "%zu adjusted variables (%s), but %zu matched output%s: they can act alike, and their corrections are then "
            "not unique: remove one of them, or match another output",
            count, names, matched, matched == 1 ? "" : "s");
    }
}

/* Not for a variable without any effect, because that may depend on the initial values. */
static void check_responses(warnings *list, const tl_assembly *assembly, const tl_response *responses) {
    const tl_config *config = &assembly->config;
    for (size_t i = 0; i < config->adjust_count; i++) {
        const tl_response *response = &responses[i];
        if (response->is_known && response->steps != 0 && response->tolerances < LEAST_MOVEMENT) {
            warn(list, config->adjust[i].where,
                 "horizon.prediction is too short: within it, %s moves %s by %.2g tolerances only, so a search finds "
                 "nothing to correct. A whole tolerance takes %" PRIu32 " steps: set \"prediction\" to about %" PRIu32
                 ", or let check --recording try horizons; if tolerance %g is above three times the noise, lower it",
                 response->has_range ? "its whole range" : "ten times its step",
                 config->match[response->match].variable, response->tolerances, response->steps, response->steps,
                 config->match[response->match].tolerance);
        } else if (response->is_known) {
            check_first_move(list, config, i, response);
        }
    }
}

static void check_free_twin(warnings *list, const tl_config *config, const tl_twin *twin) {
    if (config->free_twin && !tl_twin_get_facts(twin).has_free_twin) {
        warn(list, "synchronise.free_twin",
             "has no effect, because an FMU is rolled back by replay, which restores one instant only: u never rests");
    }
}

static void check_sources(warnings *list, const tl_config *config) {
    for (size_t i = 0; i < config->source_count; i++) {
        bool used = false;
        for (size_t k = 0; k < config->signal_count; k++) {
            used = used || config->signals[k].source == i;
        }
        if (!used) {
            warn(list, config->sources[i].where, "no signal uses this source: remove it");
        }
    }
    for (size_t k = 0; k < config->signal_count; k++) {
        const tl_config_signal *signal = &config->signals[k];
        bool is_silent = signal->source != SIZE_MAX && config->sources[signal->source].driver->is_silent;
        if (is_silent && signal->stale_s == 0 && signal->of == k) {
            warn(list, signal->plan.where,
                 "no stale_s: if its sender falls silent, the last value is used for ever. Set stale_s above the "
                 "longest time "
                 "between two values");
        }
    }
}

/* Only in mode ahead: in the other modes a step waits for its filtered measurement. */
static void check_conditions(warnings *list, const tl_config *config) {
    for (size_t i = 0; config->measurements == TL_AHEAD && i < config->match_count; i++) {
        tl_time lag = tl_config_condition_lag(config, i);
        if (lag > 0) {
            warn(list, config->match[i].where,
                 "its condition delays a measurement by up to %g s, but in mode ahead no step waits for it: an older "
                 "one is used",
                 tl_seconds(lag));
        }
    }
}

static void warn_of_between(warnings *list, const tl_config *config, const char *path) {
    warn(list, path, "\"between\" has no effect: in mode %s no step waits for the next reading",
         tl_pairing_names[config->measurements]);
}

/* Only in mode lag does a step wait for the next reading. */
static void check_between(warnings *list, const tl_config *config) {
    if (config->measurements == TL_LAG) {
        return;
    }
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        if (signal->as_input != TL_BETWEEN_LAST && signal->of == i) {
            warn_of_between(list, config, signal->plan.where);
        }
    }
    for (size_t i = 0; i < config->match_count; i++) {
        bool is_smoothed = config->measurements != TL_AHEAD &&
                           config->conditions[i].low_pass > 0; /* the low-pass interpolates in any case */
        if (config->matched_between[i] != TL_BETWEEN_LAST && !is_smoothed) {
            warn_of_between(list, config, config->match[i].where);
        }
    }
}

/* Returns the longest median of all look-ups of a signal; 0 if there is none. */
static uint32_t median_of(const tl_config *config, size_t signal) {
    uint32_t median = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *lookup = &config->signals[i];
        median = lookup->of == signal && lookup->condition.median > median ? lookup->condition.median : median;
    }
    return median;
}

/* Returns the maximum age of a value, ns, before the next one arrives. A median also needs half of
 * its readings from later. */
static tl_time oldest_of(const tl_config *config, const tl_config_signal *signal, uint32_t median) {
    tl_time readings = 1 + (median > 1 ? (tl_time)(median - 1) / 2 : 0);
    bool is_polled = tl_config_is_polled(config, signal);
    tl_time poll = is_polled ? tl_time_of_seconds(config->sources[signal->source].period_s) : 0;
    return readings * signal->every + poll;
}

/* Warns if every_s is missing where a median needs it, or if it contradicts stale_s. */
static void check_every(warnings *list, const tl_config *config) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        uint32_t median = median_of(config, i);
        tl_time oldest = oldest_of(config, signal, median);
        if (median > 1 && signal->every == 0 && tl_config_is_polled(config, signal)) {
            warn(list, signal->plan.where,
                 "its median counts polls, so a bad value that is polled several times can pass: set every_s to the "
                 "time between "
                 "two values of the device");
        }
        if (signal->of == i && signal->every > 0 && signal->stale_s > 0.0 &&
            oldest > tl_time_of_seconds(signal->stale_s)) {
            warn(list, signal->plan.where,
                 "by every_s a value may be %g s old before the next one comes%s, but stale_s is %g s: raise stale_s",
                 tl_seconds(oldest), median > 1 ? " and has passed the median" : "", signal->stale_s);
        }
    }
}

/* In mode ahead no step waits for the readings that a delay requires. */
static void check_delays(warnings *list, const tl_config *config) {
    const tl_config_delays *delays = config->delays;
    if (delays != NULL && delays->measure && config->adjust_count != 0 && config->released_steps == 0) {
        warn(list, "delays.measure",
             "without released twins a delay can be measured only in steps without a correction: set "
             "synchronise.release_s, or measure with \"compare\" first, then write the result as chains");
    }
    if (delays == NULL || config->measurements != TL_AHEAD) {
        return;
    }
    int32_t inputs = config->input_lookup.ticks;
    int32_t outputs = config->output_lookup.ticks;
    if (inputs > 0 || outputs > 0) {
        int32_t longest = inputs > outputs ? inputs : outputs;
        warn(list, "delays",
             "values of an instant come up to %" PRId32
             " step%s later, but in mode ahead no step waits for them: older ones are used",
             longest, longest == 1 ? "" : "s");
    }
}

static void check_rollback(warnings *list, const tl_late_verification *rollback) {
    char path[64];
    if (rollback->outcome.found) {
        (void)snprintf(path, sizeof path, "components.%.40s.rollback", rollback->outcome.component);
        warn(list, path, "%s", rollback->outcome.text);
    }
}

/* A candidate that fails costs a search an evaluation, and it may end the FMU. */
static void check_failures_at_bounds(warnings *list, const tl_config *config, const tl_late_verification *rollback) {
    for (size_t i = 0; i < config->adjust_count; i++) {
        if (rollback->bounds[i][0] != '\0') {
            warn(list, config->adjust[i].where, "%s; set \"min\" and \"max\" so that the search does not get there",
                 rollback->bounds[i]);
        }
    }
}

/* Warns if another process cannot load a saved state exactly. There is no warning if the FMU
 * continues differently in the saving process, too: then the cause is not the saved state. */
static void check_saved_states(warnings *list, const tl_config *config, const tl_read_back_report *states) {
    for (size_t i = 0; i < states->count && states->is_tried; i++) {
        const tl_read_back_component *found = &states->of[i];
        char path[64];
        (void)snprintf(path, sizeof path, "components.%.40s", config->components[i].name);
        const char *words = tl_read_back_text(found->finding);
        if (tl_read_back_prevents_resume(found->finding)) {
            warn(list, path,
                 "a saved state of it %s (%.300s): start it with `run --supervise --state DIR`, which detects that and "
                 "saves none, or set \"record.resume_s\" to 0",
                 words, found->text);
        } else if (found->finding == TL_READ_BACK_UNKNOWN) {
            warn(list, path, "a saved state of it %s (%.300s)", words, found->text);
        }
    }
}

static void check_filled_in(warnings *list, const tl_config *config) {
    for (size_t i = 0; i < config->fill_in_count; i++) {
        warn(list, "fill_in", "%.200s: %.300s", config->fill_in[i].where, config->fill_in[i].name);
    }
    if (config->fill_in_count != 0) {
        warn(list, "fill_in", "remove each entry when it is done; `run` waits for that");
    }
}

/* Inputs get it until the first good value. */
static void check_initial(warnings *list, const tl_assembly *assembly) {
    for (size_t i = 0; i < assembly->config.signal_count; i++) {
        const tl_plan_signal *signal = &assembly->config.signals[i].plan;
        const tl_twin_bounds bounds = tl_twin_get_bounds(assembly->twin, i);
        if (signal->has_initial && bounds.least <= bounds.most &&
            (signal->initial < bounds.least || signal->initial > bounds.most)) {
            char path[128];
            (void)snprintf(path, sizeof path, "plant.%s.initial", signal->name);
            warn(list, path, "%.6g is outside %.6g \342\200\246 %.6g, which %.80s.%.80s declares: give a value within",
                 signal->initial, bounds.least, bounds.most, bounds.component, bounds.input);
        }
    }
}

size_t tl_advice_print(const tl_assembly *assembly, const tl_prognosis *prognosis, const tl_response *responses,
                       const tl_late_verification *rollback, const tl_read_back_report *states, FILE *file,
                       tl_json_writer *json) {
    const tl_config *config = &assembly->config;
    warnings list = {.file = file, .json = json, .config = config};
    if (prognosis->error.status != TL_OK) {
        warn(&list, "synchronise.adjust", "%.300s, with one step of an adjusted variable: a search would end the run",
             prognosis->error.text);
    }
    check_outputs(&list, config, prognosis);
    check_step(&list, config, prognosis);
    check_rollback(&list, rollback);
    check_failures_at_bounds(&list, config, rollback);
    check_saved_states(&list, config, states);
    if (config->event.start.signal != NULL) {
        check_stroke_budget(&list, config, prognosis);
        check_stroke_tolerance(&list, config);
        check_adjusted(&list, config, assembly->twin);
    } else if (config->adjust_count != 0) {
        check_budget(&list, config, prognosis, assembly->twin);
        check_saving(&list, config);
        check_room(&list, config, assembly->twin);
        check_adjusted(&list, config, assembly->twin);
        check_surplus(&list, config, assembly->twin, responses);
        check_responses(&list, assembly, responses);
        check_conditions(&list, config);
        check_lead(&list, config, tl_twin_get_facts(assembly->twin).lead);
        check_free_twin(&list, config, assembly->twin);
    }
    check_initial(&list, assembly);
    check_filled_in(&list, config);
    check_between(&list, config);
    check_every(&list, config);
    check_delays(&list, config);
    check_sources(&list, config);
    return list.count;
}
