/* Tests of a twin for `check`: see twin_trial.h. */
#include "firmware/twin/twin_trial.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
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

/* ---- late verification ---- */

/* Returns true if the test can continue. */
static bool verify_once(const tl_assembly *assembly, tl_late_verification *look) {
    tl_twin_verify_report outcome = {.found = false};
    look->status = tl_twin_verify_until(assembly->twin, TL_TIME_NEVER, &outcome, &look->error);
    look->outcome = outcome.found ? outcome : look->outcome;
    return look->status == TL_OK && (!outcome.found || outcome.mended);
}

void tl_late_verification_get(const tl_assembly *assembly, int64_t tick, tl_late_verification *look) {
    walker walk;
    bool ready = false;
    *look = (tl_late_verification){.first = tick, .status = TL_OK};
    if (assembly->config.verify_every == 0 || assembly->config.adjust_count == 0 ||
        assembly->config.event.start.signal != NULL) {
        return;
    }
    tl_time begun = tl_clock_now(NULL);
    int64_t end = (int64_t)tl_twin_get_facts(assembly->twin).lead + tl_assembly_steps_to_stop(assembly);
    begin_walk(&walk, assembly);
    walk.sample.tick = tick;
    look->status = step_once(&walk, true, &ready, &look->error); /* u is nominal, because there are no readings */
    if (look->status == TL_OK && !ready) {
        look->status = tl_fail(&look->error, TL_FMU_FAILED, "no step was made");
    }
    bool continues = look->status == TL_OK;
    while (continues && walk.steps < TL_FAR_STEPS && walk.sample.tick < end &&
           tl_clock_now(NULL) - begun < TL_FAR_LONGEST) {
        look->status = step_once(&walk, false, &ready, &look->error);
        walk.steps += look->status == TL_OK ? 1 : 0;
        continues = look->status == TL_OK && verify_once(assembly, look);
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
    tl_late_verification_get(assembly, tick, &look);
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
