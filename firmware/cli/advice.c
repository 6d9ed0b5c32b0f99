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

static tl_status take_step(const tl_assembly *assembly, tl_sample *sample, tl_error *error) {
    const tl_budget budget = {
        .evaluations = 1, .time = INT64_MAX / 4, .started = tl_clock_now(NULL), .now = tl_clock_now};
    tl_record record;
    bool ready = false;
    tl_status status = tl_twin_step(assembly->twin, sample, &budget, &record, &ready, error);
    sample->tick++;
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

tl_status tl_prognosis_run_dry(const tl_assembly *assembly, int64_t ticks, tl_sample *sample, tl_error *error) {
    tl_status status = TL_OK;
    *sample = (tl_sample){0};
    memset(sample->quality, TL_NO_LINK, assembly->config.signal_count);
    while (status == TL_OK && sample->tick < ticks) {
        status = take_step(assembly, sample, error);
    }
    return status;
}

/* No signal has a reading, so nothing is matched and every step is a free one. */
static void run_dry(const tl_assembly *assembly, tl_prognosis *prognosis) {
    tl_sample sample;
    int64_t before = (int64_t)tl_twin_get_facts(assembly->twin).lead + WARMING_STEPS;
    tl_status status = tl_prognosis_run_dry(assembly, before, &sample, &prognosis->error);
    tl_time begun = tl_clock_now(NULL);
    while (status == TL_OK && prognosis->steps < DRY_STEPS && tl_clock_now(NULL) - begun < LONGEST) {
        status = take_step(assembly, &sample, &prognosis->error);
        note_costs(assembly, prognosis);
        prognosis->steps++;
    }
    prognosis->next_tick = sample.tick;
    if (status != TL_OK || prognosis->steps == 0) {
        prognosis->steps = 0;
        memset(prognosis->cost, 0, sizeof prognosis->cost);
        return;
    }
    prognosis->step_time = (tl_clock_now(NULL) - begun) / (tl_time)prognosis->steps;
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
    if (prognosis->steps != 0 && tl_twin_get_facts(assembly->twin).unknowns != 0) {
        predict_time(assembly, prognosis);
    }
}

/* ---- advice ---- */

enum { INDENT = 4, TEXT = 512 };

static const double LONG_LEAD_S = 60;
static const double LEAST_STEP = 1e-150; /* the square of it and its inverse are still valid numbers */
static const double LEAST_SHARE = 1e-12; /* of the nominal: leaves some digits for the search */

typedef struct advice {
    FILE *file;
    size_t count;
} advice;

static void warn(advice *given, const char *where, const char *format, ...) TL_PRINTF(3, 4);

static void warn(advice *given, const char *where, const char *format, ...) {
    char text[TEXT];
    va_list arguments;
    int length = snprintf(text, sizeof text, "%.200s: ", where);
    va_start(arguments, format);
    (void)vsnprintf(text + length, sizeof text - (size_t)length, format, arguments);
    va_end(arguments);
    (void)fputs(given->count == 0 ? "warnings\n" : "", given->file);
    tl_wrapped_print(given->file, text, INDENT - 2, INDENT);
    given->count++;
}

static void check_step(advice *given, const tl_config *config, const tl_prognosis *prognosis) {
    if (prognosis->steps == 0) {
        const char *why = prognosis->error.text;
        warn(
            given, "plant",
            "the FMUs cannot step with its initial values%s%s%s, and until there is a good measurement there is nothing "
            "else: give its signals an \"initial\"",
            why[0] != '\0' ? " (" : "", why, why[0] != '\0' ? ")" : "");
    }
    if (prognosis->step_time >= config->step) {
        warn(given, "step_s",
             "a free step takes %.3g ms here, and the period is %g ms: `run` cannot keep up on this machine",
             tl_seconds(prognosis->step_time) * 1e3, tl_seconds(config->step) * 1e3);
    }
}

/* The guess, each unknown once, and nominal. A single Boolean has only two values: nominal and its
 * negation. */
static size_t fewest_evaluations(const tl_twin *twin) {
    size_t unknowns = tl_twin_get_facts(twin).unknowns;
    return unknowns == 1 && !tl_twin_get_adjusted(twin, 0).is_real ? 2 : unknowns + 2;
}

static void check_budget(advice *given, const tl_config *config, const tl_prognosis *prognosis, const tl_twin *twin) {
    size_t unknowns = tl_twin_get_facts(twin).unknowns;
    if (config->budget_time >= config->step) {
        warn(given, "synchronise.budget.time_s",
             "%g s is not less than step_s, %g s: a search that uses it up makes the next tick late; the default is "
             "0.6 of step_s",
             tl_seconds(config->budget_time), tl_seconds(config->step));
    }
    if (prognosis->worst_time > config->budget_time) {
        warn(given, "synchronise.budget",
             "%" PRIu32 " evaluations can take %.3g ms here, and the time is %.3g ms: it cuts such a search short, "
             "after about %" PRIu32 " of them; shorten the horizon, or give more time",
             config->budget_evaluations, tl_seconds(prognosis->worst_time) * 1e3, tl_seconds(config->budget_time) * 1e3,
             prognosis->fitting);
    }
    if (config->stagnation != 0 && config->stagnation < unknowns + 2) {
        warn(given, "synchronise.stagnation",
             "%" PRIu32
             " evaluations without progress end a solver before it has tried each of %zu unknowns once: give "
             "more",
             config->stagnation, unknowns);
    }
    if (config->budget_evaluations < fewest_evaluations(twin)) {
        warn(given, "synchronise.budget.evaluations",
             "%" PRIu32 " are not enough to try each of %zu unknowns once, beside the guess and nominal: give more, or "
             "make the horizon shorter or static",
             config->budget_evaluations, unknowns);
    }
}

/* Warns if even a stroke that is wrong in every sample of the window has J < 1, because then no
 * stroke is searched. */
static void check_stroke_tolerance(advice *given, const tl_config *config) {
    tl_time half = config->event.window / config->step / 2;
    double samples = 2.0 * (double)half + 1.0;
    double most = 0.0;
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        bool is_event = strcmp(match->to, config->event.end.signal) == 0;
        most += is_event ? samples * match->weight / (match->tolerance * match->tolerance) : 0.0;
    }
    if (most < 1.0) {
        warn(
            given, "synchronise.horizon.event",
            "J of a stroke that is wrong in all of the window is %.3g, and below 1 nothing is searched: a tolerance of 1 "
            "makes J the number of wrong samples",
            most);
    }
}

/* With an event horizon, the search continues from cycle to cycle. But each cycle needs time for at
 * least one step of a candidate. */
static void check_stroke_budget(advice *given, const tl_config *config, const tl_prognosis *prognosis) {
    if (prognosis->steps != 0 && 2 * prognosis->step_time > config->budget_time) {
        warn(
            given, "synchronise.budget.time_s",
            "%g s has room for the step of a cycle (%.3g ms here), and for no step of a candidate beside it: no stroke "
            "can be searched",
            tl_seconds(config->budget_time), tl_seconds(prognosis->step_time) * 1e3);
    }
}

static void check_saving(advice *given, const tl_config *config) {
    if (!config->saving.structure) {
        warn(given, "synchronise.saving.structure",
             "off: executions that can reach no matched output any more are done all the same; it changes no result");
    }
    if (!config->saving.sequences) {
        warn(given, "synchronise.saving.sequences",
             "off: what is known from an earlier execution is executed again; it changes no result");
    }
    for (size_t i = 0; i < config->component_count && config->saving.sequences; i++) {
        if (config->components[i].keep == TL_KEEP_OUTPUTS) {
            warn(given, config->components[i].where,
                 "keep \"outputs\": executions are repeated to get back to a state, beyond those predicted; worth it "
                 "only where saving a state takes longer than a step");
        }
    }
}

/* Warns if the low-pass delays a step by more than LONG_LEAD_S (60 s), or beyond the end of the
 * run. Such a step does not show the present state of the plant. */
static void check_lead(advice *given, const tl_config *config, uint32_t lead) {
    double seconds = tl_seconds(config->step) * lead;
    bool beyond_end = config->duration != 0 && seconds > tl_seconds(config->duration);
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        if (config->conditions[i].low_pass > 0 && (beyond_end || seconds > LONG_LEAD_S)) {
            warn(given, match->where,
                 "its low-pass makes the measurement %g s late, and a step is computed %g s after its instant%s",
                 tl_seconds(config->conditions[i].low_pass), seconds,
                 beyond_end ? ", which is longer than duration_s" : "");
        }
    }
}

/* Warns only of the component with the largest need. */
static void check_room(advice *given, const tl_config *config, const tl_twin *twin) {
    tl_twin_ledger nodes = {0};
    tl_twin_ledger states = {0};
    for (size_t i = 0; i < config->component_count; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(twin, i);
        nodes = entry.nodes < entry.nodes_worst && entry.nodes_worst > nodes.nodes_worst ? entry : nodes;
        states = entry.states < entry.nodes && entry.state_size > states.state_size ? entry : states;
    }
    if (nodes.nodes_worst != 0) {
        warn(given, "synchronise.saving.nodes",
             "there is room for %" PRIu32 " executions of %s, and the worst case needs %" PRIu64
             ": what finds no room may be executed again; give more, or fewer evaluations, or a shorter horizon",
             nodes.nodes, nodes.name, nodes.nodes_worst);
    }
    if (states.state_size != 0) {
        warn(given, "synchronise.saving.memory_mb",
             "there is room for %" PRIu32 " states of %s of %.4g KiB each, and it may keep %" PRIu32
             " executions: those without a state are caught up with; give more, or fewer evaluations, or a shorter "
             "horizon",
             states.states, states.name, (double)states.state_size / 1024.0, states.nodes);
    }
}

static void check_adjusted(advice *given, const tl_config *config, const tl_twin *twin) {
    for (size_t i = 0; i < config->adjust_count; i++) {
        const tl_twin_adjusted adjusted = tl_twin_get_adjusted(twin, i);
        const char *where = config->adjust[i].where;
        if (!adjusted.is_real) {
            continue;
        }
        if (!adjusted.is_fed && (adjusted.nominal < adjusted.lower || adjusted.nominal > adjusted.upper)) {
            warn(given, where,
                 "its nominal, %g, is outside its bounds, %g to %g; it is used all the same where no correction is "
                 "better",
                 adjusted.nominal, adjusted.lower, adjusted.upper);
        }
        double size = adjusted.is_fed ? 0.0 : fabs(adjusted.nominal);
        if (adjusted.step < LEAST_STEP || adjusted.step < size * LEAST_SHARE) {
            warn(given, where, "its step, %g, is so small that a first move by it is lost in rounding", adjusted.step);
        }
        if (adjusted.step > 1 / LEAST_STEP || adjusted.step > adjusted.upper - adjusted.lower) {
            warn(given, where, "its step, %g, is larger than all there is to search, %g to %g", adjusted.step,
                 adjusted.lower, adjusted.upper);
        }
    }
}

static void check_free_twin(advice *given, const tl_config *config, const tl_prognosis *prognosis,
                            const tl_twin *twin) {
    if (config->free_twin && prognosis->steps != 0 && !tl_twin_get_facts(twin).has_free_twin) {
        warn(given, "synchronise.free_twin",
             "there is none, since an FMU is rolled back by replay, and that leads to one instant only: u never rests");
    }
}

static void check_sources(advice *given, const tl_config *config) {
    for (size_t i = 0; i < config->source_count; i++) {
        bool used = false;
        for (size_t k = 0; k < config->signal_count; k++) {
            used = used || config->signals[k].source == i;
        }
        if (!used) {
            warn(given, config->sources[i].where, "no signal of the plant comes from it");
        }
    }
    for (size_t k = 0; k < config->signal_count; k++) {
        const tl_config_signal *signal = &config->signals[k];
        bool is_silent = signal->source != SIZE_MAX && config->sources[signal->source].driver->is_silent;
        if (is_silent && signal->stale_s == 0 && signal->of == k) {
            warn(given, signal->plan.where,
                 "a sender that falls silent is noticed only by the age of its values, and the signal has no stale_s: "
                 "its last value would be used for ever");
        }
    }
}

/* Only in mode ahead: in the other modes a step waits for its filtered measurement. */
static void check_conditions(advice *given, const tl_config *config) {
    for (size_t i = 0; config->measurements == TL_AHEAD && i < config->match_count; i++) {
        tl_time lag = tl_config_condition_lag(config, i);
        if (lag > 0) {
            warn(given, config->match[i].where,
                 "its condition makes a measurement come up to %g s late, and in mode ahead no step waits for it: the "
                 "newest there is stands for it",
                 tl_seconds(lag));
        }
    }
}

static void warn_of_between(advice *given, const tl_config *config, const char *where) {
    warn(given, where,
         "in mode %s no step waits for the next reading, and the last one stands: \"between\" does nothing",
         tl_pairing_names[config->measurements]);
}

/* Only in mode lag does a step wait for the next reading. */
static void check_between(advice *given, const tl_config *config) {
    if (config->measurements == TL_LAG) {
        return;
    }
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        if (signal->as_input != TL_BETWEEN_LAST && signal->of == i) {
            warn_of_between(given, config, signal->plan.where);
        }
    }
    for (size_t i = 0; i < config->match_count; i++) {
        bool is_smoothed = config->measurements != TL_AHEAD &&
                           config->conditions[i].low_pass > 0; /* the low-pass interpolates in any case */
        if (config->matched_between[i] != TL_BETWEEN_LAST && !is_smoothed) {
            warn_of_between(given, config, config->match[i].where);
        }
    }
}

/* Returns the longest median of all look-ups of a signal; 0 if there is none. */
static uint32_t median_of(const tl_config *config, size_t signal) {
    uint32_t median = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *look = &config->signals[i];
        median = look->of == signal && look->condition.median > median ? look->condition.median : median;
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
static void check_every(advice *given, const tl_config *config) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        uint32_t median = median_of(config, i);
        tl_time oldest = oldest_of(config, signal, median);
        if (median > 1 && signal->every == 0 && tl_config_is_polled(config, signal)) {
            warn(given, signal->plan.where,
                 "its median counts polls, so a bad value that is read several times is not in the minority: say in "
                 "every_s how often its device writes it, and each value counts once");
        }
        if (signal->of == i && signal->every > 0 && signal->stale_s > 0.0 &&
            oldest > tl_time_of_seconds(signal->stale_s)) {
            warn(given, signal->plan.where,
                 "by every_s a value may be %g s old before the next one is there%s, and it is stale after %g s",
                 tl_seconds(oldest), median > 1 ? " and through the median" : "", signal->stale_s);
        }
    }
}

/* In mode ahead no step waits for the readings that a delay requires. */
static void check_delays(advice *given, const tl_config *config) {
    const tl_config_delays *delays = config->delays;
    if (delays != NULL && delays->measure && config->adjust_count != 0) {
        warn(given, "delays.measure",
             "only steps that are not corrected tell a delay, and where it is not known yet what moves is corrected: "
             "measure with \"compare\" first, and give chains that say what was found");
    }
    if (delays == NULL || config->measurements != TL_AHEAD) {
        return;
    }
    int32_t inputs = config->input_lookup.ticks;
    int32_t outputs = config->output_lookup.ticks;
    if (inputs > 0 || outputs > 0) {
        int32_t longest = inputs > outputs ? inputs : outputs;
        warn(given, "delays",
             "what belongs to an instant comes up to %" PRId32
             " step%s later, and in mode ahead no step waits for it: the "
             "newest there is stands for it",
             longest, longest == 1 ? "" : "s");
    }
}

/* The text of the finding begins with the component's name. */
static void check_rollback(advice *given, const tl_far_look *look) {
    char where[64];
    if (look->news.found) {
        (void)snprintf(where, sizeof where, "components.%.*s.rollback", (int)strcspn(look->news.text, " "),
                       look->news.text);
        warn(given, where, "%s", look->news.text);
    }
}

/* Warns if another process cannot load a saved state exactly. There is no warning if the FMU
 * continues differently in the saving process, too: then the cause is not the saved state. */
static void check_saved_states(advice *given, const tl_config *config, const tl_read_back_report *states) {
    for (size_t i = 0; i < states->count && states->is_tried; i++) {
        const tl_read_back_component *found = &states->of[i];
        char where[64];
        (void)snprintf(where, sizeof where, "components.%.40s", config->components[i].name);
        const char *words = tl_read_back_words(found->finding);
        if (tl_read_back_is_useless(found->finding)) {
            warn(
                given, where,
                "a saved state of it %s (%.300s): `run --supervise --state DIR` finds that out, too, and saves none; any "
                "other saves it, and loads it unless \"record.resume_s\" is 0",
                words, found->text);
        } else if (found->finding == TL_READ_BACK_UNKNOWN) {
            warn(given, where, "a saved state of it %s (%.300s)", words, found->text);
        }
    }
}

size_t tl_advice_print(const tl_assembly *assembly, const tl_prognosis *prognosis, const tl_far_look *look,
                       const tl_read_back_report *states, FILE *file) {
    const tl_config *config = &assembly->config;
    advice given = {.file = file};
    check_step(&given, config, prognosis);
    check_rollback(&given, look);
    check_saved_states(&given, config, states);
    if (config->event.start.signal != NULL) {
        check_stroke_budget(&given, config, prognosis);
        check_stroke_tolerance(&given, config);
        check_adjusted(&given, config, assembly->twin);
    } else if (config->adjust_count != 0) {
        check_budget(&given, config, prognosis, assembly->twin);
        check_saving(&given, config);
        check_room(&given, config, assembly->twin);
        check_adjusted(&given, config, assembly->twin);
        check_conditions(&given, config);
        check_lead(&given, config, tl_twin_get_facts(assembly->twin).lead);
        check_free_twin(&given, config, prognosis, assembly->twin);
    }
    check_between(&given, config);
    check_every(&given, config);
    check_delays(&given, config);
    check_sources(&given, config);
    return given.count;
}
