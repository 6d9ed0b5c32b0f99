/* Tests of a twin for `check`: see twin_trial.h. */
#include "firmware/twin/twin_trial.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "master/twin/twin_candidate.h"
#include "master/twin/twin_timing.h"

static void name_component(char to[TL_ASSEMBLY_NAME], const char *component) {
    (void)snprintf(to, TL_ASSEMBLY_NAME, "%s", component);
}

/* ---- steps ---- */

/* Number of steps with constant inputs. It is more than the verification of one component takes, so
 * that inputs change sometimes within one and sometimes between two. */
enum { STAY = 7 };

/* A twin and its next tick. */
typedef struct walker {
    const tl_assembly *assembly;
    tl_sample sample;
    double nominal[TL_MAX_ADJUST]; /* of the adjusted variables */
    int64_t steps;
} walker;

/* Starts without any reading. */
static void begin_walk(walker *self, const tl_assembly *assembly) {
    *self = (walker){.assembly = assembly};
    memset(self->sample.quality, TL_NO_LINK, assembly->config.signal_count);
}

/* Moves up and down by the first step of its search, or off and on if Boolean. Each variable has
 * another period. */
static double excited(const tl_twin_adjusted *adjusted, double nominal, int64_t step, size_t variable) {
    int64_t turn = step / (STAY + (int64_t)variable) % 3;
    if (!adjusted->is_real) {
        return turn == 1 ? 1.0 - nominal : nominal;
    }
    double value = nominal + (double)(turn - 1) * adjusted->step;
    return fmin(fmax(value, adjusted->lower), adjusted->upper);
}

/* Executes a tick with u at nominal, or moved. */
static tl_status step_once(walker *self, bool is_free, bool *ready, tl_error *error) {
    const tl_budget budget = {.evaluations = 1, .time = INT64_MAX / 4};
    const tl_assembly *assembly = self->assembly;
    double u[TL_MAX_ADJUST] = {0.0};
    tl_record record;
    for (size_t v = 0; v < assembly->config.adjust_count && !is_free; v++) {
        const tl_twin_adjusted adjusted = tl_twin_get_adjusted(assembly->twin, v);
        u[v] = excited(&adjusted, self->nominal[v], self->steps, v);
    }
    tl_status status = is_free ? tl_twin_step(assembly->twin, &self->sample, &budget, &record, ready, error)
                               : tl_twin_follow(assembly->twin, &self->sample,
                                                assembly->config.adjust_count != 0 ? u : NULL, &record, ready, error);
    if (is_free && status == TL_OK && *ready) {
        memcpy(self->nominal, record.nominal, sizeof self->nominal);
    }
    self->sample.tick++;
    return status;
}

/* ---- bounds ---- */

/* Distances of the values of an unbounded side from nominal, in steps of the search. */
static const double FAR[] = {4.0, 16.0, 64.0};

enum { FAR_COUNT = sizeof FAR / sizeof FAR[0], MOST_VALUES = 2 * ((int)FAR_COUNT + 1) * TL_MAX_ADJUST };

/* A search does not reach a bound that is more steps away. */
static const double FARTHEST = 1e9;

typedef struct bound_value {
    size_t variable;
    double value;
    bool is_bound;
    bool has_failed;
} bound_value;

typedef struct bound_test {
    const tl_assembly *assembly;
    tl_late_verification *look;
    size_t width;   /* number of values after a candidate */
    double *values; /* after each first candidate, and after the present one */
    size_t count;
    bound_value tried[MOST_VALUES];
} bound_test;

static void add_value(bound_test *test, size_t variable, double value, bool is_bound) {
    test->tried[test->count++] = (bound_value){.variable = variable, .value = value, .is_bound = is_bound};
}

/* `side`: 1 or -1. */
static void add_far(bound_test *test, const tl_twin_adjusted *adjusted, double nominal, size_t variable, double side) {
    double bound = side > 0.0 ? adjusted->upper : adjusted->lower;
    bool is_bounded = fabs(bound - nominal) <= FARTHEST * adjusted->step;
    for (size_t i = 0; i < (is_bounded ? 1 : FAR_COUNT); i++) {
        add_value(test, variable, is_bounded ? bound : nominal + side * FAR[i] * adjusted->step, is_bounded);
    }
}

static void add_near(bound_test *test, const tl_twin_adjusted *adjusted, double nominal, size_t variable, double side) {
    double value = nominal + side * adjusted->step;
    add_value(test, variable, fmin(fmax(value, adjusted->lower), adjusted->upper), false);
}

typedef void add_values(bound_test *test, const tl_twin_adjusted *adjusted, double nominal, size_t variable,
                        double side);

/* A Boolean has no other values than those of the steps before. */
static void add_all(bound_test *test, const walker *walk, add_values *add) {
    for (size_t v = 0; v < test->assembly->config.adjust_count; v++) {
        const tl_twin_adjusted adjusted = tl_twin_get_adjusted(test->assembly->twin, v);
        if (adjusted.is_real) {
            add(test, &adjusted, walk->nominal[v], v, -1.0);
            add(test, &adjusted, walk->nominal[v], v, 1.0);
        }
    }
}

static void describe_failure(const bound_test *test, const bound_value *tried, const tl_error *failure) {
    char component[TL_ASSEMBLY_NAME] = "";
    char quote[TL_ERROR_TEXT];
    char *text = test->look->bounds[tried->variable];
    tl_assembly_find_component(test->assembly, failure->text, component);
    tl_assembly_quote(failure->text, component, quote, sizeof quote);
    const char *said = component[0] != '\0' ? tl_assembly_last_message(test->assembly, component) : "";
    if (text[0] == '\0') {
        (void)snprintf(text, TL_ERROR_TEXT, "at %.9g%s, %s fails: %.160s%s%.160s%s", tried->value,
                       tried->is_bound ? ", a bound of the search" : "", component[0] != '\0' ? component : "an FMU",
                       quote, said[0] != '\0' ? "; it said: \"" : "", said, said[0] != '\0' ? "\"" : "");
    }
}

static tl_status try_value(const bound_test *test, bound_value *tried, double *values) {
    tl_error failure;
    tl_status status =
        tl_twin_try_value(test->assembly->twin, tried->variable, tried->value, values, &failure, &test->look->error);
    if (status != TL_OK || failure.status != TL_OK) {
        tried->has_failed = true;
        describe_failure(test, tried, failure.status != TL_OK ? &failure : &test->look->error);
    }
    return status;
}

/* The component whose values differ is not restored exactly. */
static void describe_difference(const bound_test *test, const bound_value *tried, const double *first,
                                const double *again) {
    tl_twin_verify_report *outcome = &test->look->outcome;
    const tl_config *config = &test->assembly->config;
    size_t i = 0;
    tl_twin_value value;
    while (!tl_twin_get_value(test->assembly->twin, i, &value) || memcmp(&first[i], &again[i], sizeof *first) == 0) {
        i++;
    }
    *outcome = (tl_twin_verify_report){.found = true};
    name_component(outcome->component, value.component);
    (void)snprintf(outcome->text, sizeof outcome->text,
                   "its %s is %.9g after a candidate with %.9g for %s, but %.9g if further candidates went to the "
                   "bounds: its rollback is not exact; set \"rollback\" to \"memory\" or \"auto\"",
                   value.variable, first[i], tried->value, config->adjust[tried->variable].variable, again[i]);
}

/* Makes all candidates, and then all in reverse order without the results of the first ones. */
static tl_status test_bounds(const walker *walk, tl_late_verification *look) {
    bound_test test = {.assembly = walk->assembly, .look = look, .width = tl_twin_value_count(walk->assembly->twin)};
    tl_time begun = tl_clock_now(NULL);
    bool done = false;
    add_all(&test, walk, add_near); /* first: their second candidates show what the far ones have changed */
    add_all(&test, walk, add_far);
    test.values = calloc(test.width * (test.count + 1) + 1, sizeof *test.values);
    if (test.values == NULL) {
        return TL_OK;
    }
    double *again = test.values + test.count * test.width;
    size_t made = 0;
    bool differs = false;
    tl_status status = TL_OK;
    for (; made < test.count && status == TL_OK && tl_clock_now(NULL) - begun < TL_FAR_LONGEST; made++) {
        status = try_value(&test, &test.tried[made], test.values + made * test.width);
    }
    status = status == TL_OK ? tl_twin_forget(test.assembly->twin, &done, &look->error) : status;
    for (; made > 0 && status == TL_OK && !differs; made--) {
        bound_value *tried = &test.tried[made - 1];
        const double *first = test.values + (made - 1) * test.width;
        status = tried->has_failed ? TL_OK : try_value(&test, tried, again);
        differs = !tried->has_failed && memcmp(first, again, test.width * sizeof *first) != 0;
        if (differs) {
            describe_difference(&test, tried, first, again);
        }
    }
    free(test.values);
    return status;
}

/* ---- late verification ---- */

/* Returns true if the test can continue. */
static bool verify_once(const tl_assembly *assembly, tl_late_verification *look) {
    tl_twin_verify_report outcome = {.found = false};
    look->status = tl_twin_verify_until(assembly->twin, TL_TIME_NEVER, &outcome, &look->error);
    look->outcome = outcome.found ? outcome : look->outcome;
    return look->status == TL_OK && (!outcome.found || outcome.mended);
}

void tl_late_verification_run(const tl_assembly *assembly, int64_t tick, tl_late_verification *look) {
    walker walk;
    bool ready = false;
    *look = (tl_late_verification){.first = tick, .status = TL_OK};
    if (assembly->config.verify_every == 0 || assembly->config.adjust_count == 0 ||
        assembly->config.event.start.signal != NULL) {
        return;
    }
    tl_time begun = tl_clock_now(NULL);
    const tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    int64_t last = (int64_t)facts.lead + tl_assembly_steps_to_stop(assembly) - (int64_t)facts.prediction;
    begin_walk(&walk, assembly);
    walk.sample.tick = tick;
    look->status = step_once(&walk, true, &ready, &look->error); /* u is nominal, because there are no readings */
    if (look->status == TL_OK && !ready) {
        look->status = tl_fail(&look->error, TL_FMU_FAILED, "no step was made");
    }
    bool continues = look->status == TL_OK;
    while (continues && walk.steps < TL_FAR_STEPS && walk.sample.tick < last &&
           tl_clock_now(NULL) - begun < TL_FAR_LONGEST) {
        look->status = step_once(&walk, false, &ready, &look->error);
        walk.steps += look->status == TL_OK ? 1 : 0;
        continues = look->status == TL_OK && verify_once(assembly, look);
    }
    if (continues && walk.sample.tick <= last) {
        look->status = test_bounds(&walk, look);
        /* results of candidates are kept, so a component may still be where its last one has ended */
        look->status = look->status == TL_OK ? step_once(&walk, false, &ready, &look->error) : look->status;
    }
    look->steps = walk.steps;
    look->times = tl_twin_get_facts(assembly->twin).verified;
}

/* ---- comparison ---- */

/* Executes the next step. The first one takes as many ticks as a twin waits for measurements. */
static tl_status step_walk(walker *self, tl_error *error) {
    bool is_free = self->steps == 0 || self->assembly->config.event.start.signal != NULL;
    int64_t last = self->sample.tick + (int64_t)tl_twin_get_facts(self->assembly->twin).lead + 1;
    bool ready = false;
    tl_status status = TL_OK;
    while (status == TL_OK && !ready && self->sample.tick <= last) {
        status = step_once(self, is_free, &ready, error);
    }
    self->steps++;
    return status == TL_OK && !ready ? tl_fail(error, TL_FMU_FAILED, "no step was made") : status;
}

/* ---- values ---- */

/* FNV-1a hash of a value's bytes. */
static uint64_t mark_of(uint64_t mark, double value) {
    unsigned char bytes[sizeof value];
    memcpy(bytes, &value, sizeof value);
    for (size_t i = 0; i < sizeof bytes; i++) {
        mark = (mark ^ bytes[i]) * 1099511628211U;
    }
    return mark;
}

/* Reads tl_twin_value_count() values; 0 for values that no FMU delivers. Returns their hash. */
static uint64_t read_values(const tl_twin *twin, double *values) {
    uint64_t mark = 14695981039346656037U;
    for (size_t i = 0; i < tl_twin_value_count(twin); i++) {
        tl_twin_value value = {.value = 0.0};
        (void)tl_twin_get_value(twin, i, &value);
        values[i] = value.value;
        mark = mark_of(mark, value.value);
    }
    return mark;
}

/* Finds the first value that differs. */
static bool find_difference(const tl_twin *twin, const double *first, const double *second, int64_t number,
                            tl_twin_pair_account *account, tl_error *error) {
    for (size_t i = 0; i < tl_twin_value_count(twin); i++) {
        tl_twin_value value;
        if (tl_twin_get_value(twin, i, &value) && memcmp(&first[i], &second[i], sizeof *first) != 0) {
            name_component(account->component, value.component);
            (void)tl_fail(error, TL_OK, "in step %lld its %s is %.9g, but %.9g in a second instance", (long long)number,
                          value.variable, first[i], second[i]);
            return true;
        }
    }
    return false;
}

/* ---- both twins ---- */

/* Executes as many steps as there is time for. If an FMU rejects one, for example because it has
 * reached its end, the comparison ends there. */
static void run_first(const tl_assembly *first, double *values, size_t width, tl_twin_pair_account *account) {
    tl_time begun = tl_clock_now(NULL);
    tl_error error;
    walker walk;
    begin_walk(&walk, first);
    while (account->steps < TL_PAIR_STEPS &&
           (account->steps < TL_PAIR_LEAST || tl_clock_now(NULL) - begun < TL_PAIR_LONGEST) &&
           step_walk(&walk, &error) == TL_OK) {
        account->marks[account->steps] = read_values(first->twin, values + account->steps * width);
        account->steps++;
    }
}

/* After the values of all steps there is room for those of one more. */
static tl_status run_second(const tl_assembly *second, double *values, size_t width, tl_twin_pair_account *account,
                            bool *differs, tl_error *error) {
    double *own = values + TL_PAIR_STEPS * width;
    walker walk;
    tl_status status = TL_OK;
    begin_walk(&walk, second);
    for (uint32_t i = 0; i < account->steps && status == TL_OK && !*differs; i++) {
        status = step_walk(&walk, error);
        if (status == TL_OK && read_values(second->twin, own) != account->marks[i]) {
            *differs = find_difference(second->twin, values + i * width, own, i, account, error);
        }
    }
    return status;
}

tl_status tl_twin_pair_compare(const tl_assembly *first, tl_assembly *second, bool alone, tl_twin_pair_account *account,
                               tl_error *error) {
    bool differs = false;
    size_t width = tl_twin_value_count(first->twin);
    double *values = calloc(width * (TL_PAIR_STEPS + 1) + 1, sizeof *values);
    if (values == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    run_first(first, values, width, account);
    tl_status status = TL_OK;
    if (!alone && account->steps > 0) {
        __atomic_store_n(&account->has_second, 1, __ATOMIC_RELEASE);
        status = tl_assembly_build_quietly(second, account->component, error);
        if (status == TL_OK) {
            status = run_second(second, values, width, account, &differs, error);
            tl_assembly_find_component(second, error->text, account->component);
        }
    }
    if (status == TL_OK &&
        !differs) { /* a finding that was mended meanwhile, such as a wrong state, is no difference */
        *error = (tl_error){TL_OK, ""};
    }
    free(values);
    return status;
}

/* ---- rollback methods ---- */

/* Steps before the late verification, in addition to those of the proof. */
enum { FIRST_STEPS = 10 };

/* Limit for timing one component. */
static const tl_time LONGEST = TL_SECOND / 10;

void tl_component_methods_note(const tl_assembly *assembly, tl_component_methods *ways) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    ways->rollback_inexact = facts.rollback_inexact ? 1 : 0;
    if (facts.inexact_component != NULL) {
        name_component(ways->component, facts.inexact_component);
    }
    for (size_t i = 0; i < assembly->config.component_count && (facts.returns || facts.rollback_inexact); i++) {
        const tl_fmu *fmu = tl_assembly_fmu(assembly, i);
        ways->of[i] = (tl_component_method){.rollback = (uint32_t)tl_fmu_rollback(fmu),
                                            .is_given_again = tl_fmu_inputs_are_repeated(fmu) ? 1 : 0};
    }
}

/* ---- test of methods ---- */

/* Without any reading, so that u is nominal. */
static tl_status begin_methods(const tl_assembly *assembly, int64_t *tick, tl_error *error) {
    int64_t last = (int64_t)tl_twin_get_facts(assembly->twin).lead + FIRST_STEPS;
    walker walk;
    bool ready = false;
    tl_status status = TL_OK;
    begin_walk(&walk, assembly);
    while (status == TL_OK && walk.sample.tick < last) {
        status = step_once(&walk, true, &ready, error);
    }
    *tick = walk.sample.tick;
    return status;
}

/* Returns true if all rollbacks were exact there too. */
static bool verify_late(const tl_assembly *assembly, int64_t tick, tl_component_methods *ways, tl_error *error) {
    tl_late_verification look;
    tl_late_verification_run(assembly, tick, &look);
    bool is_exact = !look.outcome.found || look.outcome.mended;
    if (!is_exact) {
        name_component(ways->component, look.outcome.component);
        (void)tl_fail(error, TL_FMU_FAILED, "%s", look.outcome.text);
    }
    return is_exact;
}

/* Replay is not measured, because its time depends on the number of steps. */
static void measure_method(const tl_assembly *assembly, size_t component, tl_component_method *method) {
    tl_twin_timing timing;
    if (method->rollback == (uint32_t)TL_ROLLBACK_REPLAY) {
        return;
    }
    tl_twin_time_component(assembly->twin, component, tl_clock_now, NULL, LONGEST, &timing);
    if (timing.rounds != 0) {
        method->is_measured = 1;
        method->save = timing.save.median;
        method->restore = timing.restore.median;
        method->bytes = tl_twin_get_ledger(assembly->twin, component).state_size;
    }
}

tl_status tl_component_methods_try(tl_assembly *assembly, tl_component_methods *ways, tl_error *error) {
    int64_t tick = 0;
    tl_status status = tl_assembly_build_quietly(assembly, ways->component, error);
    if (status != TL_OK) {
        return status;
    }
    status = begin_methods(assembly, &tick, error);
    tl_component_methods_note(assembly, ways);
    if (status != TL_OK) {
        /* A failed step does not mean that a rollback failed. */
        if (ways->rollback_inexact != 0 && ways->component[0] == '\0') {
            tl_assembly_find_component(assembly, error->text, ways->component);
        }
        return status;
    }
    *error = (tl_error){TL_OK, ""};
    if (!verify_late(assembly, tick, ways, error)) {
        return TL_OK;
    }
    tl_component_methods_note(assembly, ways); /* again, because a mended component now has another method */
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        measure_method(assembly, i, &ways->of[i]);
    }
    return TL_OK;
}
