/* A free twin beside a locked one: its cost, its effects, and when it is nearer to a plant with a
 * known true value. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "tests/support/random_numbers.h"
#include "tests/support/test_plan.h"

enum { TICKS = 4000, GUARD = 2, DIES_AT = 700 };

/* Standard deviation of the measurements. */
static const double NOISE = 0.2;

static tl_test_log call_log;
static tl_test_fmu fmus[2];
static tl_test_plan plan;
static tl_test_run run;
static tl_test_random numbers;
static double plant; /* the true y */

/* Results of a run. */
typedef struct outcome {
    double y[TICKS], truth[TICKS];
    uint32_t flags[TICKS], executions[TICKS];
    size_t count;
} outcome;

static outcome with, without;

static void add(const char *name) {
    tl_test_fmu *fmu = &fmus[plan.plan.component_count];
    tl_test_fmu_init(fmu, 1, false, &call_log);
    (void)tl_test_plan_component(&plan, name, fmu);
    tl_test_plan_set(&plan, "lag", 0.4);
}

/* A motor with an input from the plant and a searched offset. A gear follows it and is not
 * matched. */
void setUp(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
    add("motor");
    add("gear");
    tl_test_plan_signal(&plan, "u", TL_REAL, "");
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.u", "motor.u0");
    tl_test_plan_connect(&plan, "motor.y0", "gear.u0");
    tl_test_plan_adjust(&plan, "motor.offset", 0.5);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 4.0 * NOISE);
    plan.plan.algorithm = "secant";
    plan.plan.free_twin = GUARD;
    numbers = (tl_test_random){11};
    plant = 0.0;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static double noise(void) {
    double sum = -6.0;
    for (int i = 0; i < 12; i++) {
        sum += tl_test_random_number(&numbers, 0.0, 1.0);
    }
    return NOISE * sum;
}

static double input_at(int64_t tick) {
    return sin(0.05 * (double)tick);
}

/* Computes the plant, with `more` added to its input; then the twin's tick. */
static void tick(double more, outcome *seen) {
    int64_t at = run.sample.tick;
    plant = at == 0 ? 0.0 : plant + 0.25 * (input_at(at - 1) + more - plant);
    run.sample.values[0] = input_at(at);
    run.sample.values[1] = plant + noise();
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    if (run.ready && seen != NULL) {
        TEST_ASSERT_EQUAL_INT64(seen->count, run.record.step);
        seen->y[seen->count] = run.record.y[0];
        seen->truth[seen->count] = plant;
        seen->flags[seen->count] = run.record.flags;
        seen->executions[seen->count] = run.record.executions;
        seen->count++;
    }
}

static void lead(outcome *seen, int64_t ticks, double more) {
    for (int64_t i = 0; i < ticks; i++) {
        tick(more, seen);
    }
}

static void begin(outcome *seen) {
    memset(seen, 0, sizeof *seen);
    tl_test_run_build(&run, &plan);
}

static bool rests(void) {
    return (run.record.flags & TL_FLAG_RESTS) != 0;
}

static double mean_square(const outcome *seen, size_t from, size_t to) {
    double sum = 0.0;
    for (size_t i = from; i < to; i++) {
        sum += pow(seen->y[i] - seen->truth[i], 2);
    }
    return sum / (double)(to - from);
}

/* ---- what it costs ---- */

static void until_it_rests_the_twin_is_the_same_to_the_bit(void) {
    plan.plan.free_twin = 0;
    begin(&without);
    lead(&without, 1000, 3.0);
    TEST_ASSERT_FALSE(tl_twin_get_facts(run.twin).has_free_twin);
    tearDown();
    setUp();
    begin(&with);
    lead(&with, 1000, 3.0);
    TEST_ASSERT_EQUAL_size_t(without.count, with.count);
    TEST_ASSERT_EQUAL_MEMORY(without.y, with.y, with.count * sizeof with.y[0]);
    TEST_ASSERT_EQUAL_MEMORY(without.flags, with.flags, with.count * sizeof with.flags[0]);
    TEST_ASSERT_EQUAL_MEMORY(without.executions, with.executions, with.count * sizeof with.executions[0]);
    tl_twin_facts facts = tl_twin_get_facts(run.twin);
    TEST_ASSERT_TRUE(facts.has_free_twin);
    TEST_ASSERT_EQUAL_UINT64(2 * facts.components * with.count, facts.free_twin.executions);
    TEST_ASSERT_EQUAL_UINT64(0, facts.free_twin.rested + facts.free_twin.turns + facts.free_twin.adopted);
}

static void with_caches_of_each_kind(void) {
    for (int way = 0; way < 4; way++) {
        tearDown();
        setUp();
        plan.plan.saving = (tl_plan_saving){.structure = (way & 1) != 0, .sequences = (way & 2) != 0};
        plan.plan.prediction = 3;
        plan.plan.verify_every = 9;
        begin(&with);
        lead(&with, 600, 0.0);
        TEST_ASSERT_TRUE(rests());
        lead(&with, 200, 2.0);
        TEST_ASSERT_FALSE(rests());
    }
}

/* Each state has 200 bytes. */
static size_t heap_of_states(void) {
    return 200 * (fmus[0].states + fmus[1].states);
}

static void lead_with_states_of(uint64_t bytes, outcome *seen) {
    tearDown();
    setUp();
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    plan.plan.algorithm = "nelder-mead";
    plan.plan.prediction = 3;
    plan.plan.state_bytes = bytes;
    plan.plan.heap = heap_of_states;
    begin(seen);
    lead(seen, 400, 2.0);
}

/* At most two states per FMU: if a candidate is committed, the state of its end is not kept, and
 * an FMU must catch up to it. */
static void with_as_few_states_as_can_be(void) {
    lead_with_states_of(0, &without);
    TEST_ASSERT_EQUAL_UINT64(0, tl_twin_get_ledger(run.twin, 0).repeated);
    lead_with_states_of(1, &with);
    tl_twin_ledger ledger = tl_twin_get_ledger(run.twin, 0);
    TEST_ASSERT_GREATER_THAN_UINT64(0, ledger.repeated);
    TEST_ASSERT_EQUAL_INT64(0, ledger.difference);
    TEST_ASSERT_EQUAL_MEMORY(without.y, with.y, with.count * sizeof with.y[0]);
}

/* ---- what it changes ---- */

static void u_rests_if_the_model_is_right_and_the_twin_is_true(void) {
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    begin(&with);
    lead(&with, 2000, 0.0);
    TEST_ASSERT_TRUE(rests());
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, run.record.outcome);
    TEST_ASSERT_EQUAL_UINT32(1, run.record.evaluations); /* nominal, to know its error */
    TEST_ASSERT_EQUAL_UINT32(3, run.record.executions);
    TEST_ASSERT_EQUAL_DOUBLE(run.record.objective_nominal, run.record.objective);
    TEST_ASSERT_TRUE(isfinite(run.record.objective));
    tl_twin_facts facts = tl_twin_get_facts(run.twin);
    TEST_ASSERT_EQUAL_UINT64(1, facts.free_twin.turns);
    TEST_ASSERT_EQUAL_UINT64(1, facts.free_twin.adopted);
    TEST_ASSERT_GREATER_THAN_UINT64(1000, facts.free_twin.rested);
    TEST_ASSERT_TRUE(mean_square(&with, 1000, with.count) < 1e-20); /* the noise has no effect any more */
    TEST_ASSERT_TRUE(mean_square(&with, 0, 40) > 0.2 * NOISE * NOISE);
}

/* After two trials and the steps until their result, the twin is as near as without a free twin. */
static void a_plant_that_changes_is_followed_at_once(void) {
    begin(&with);
    lead(&with, 1500, 0.0);
    TEST_ASSERT_TRUE(rests());
    size_t changed = with.count;
    lead(&with, 1500, 2.0);
    for (size_t i = changed + 3 * GUARD; i < with.count; i++) {
        TEST_ASSERT_EQUAL_UINT32(0, with.flags[i] & TL_FLAG_RESTS);
    }
    tearDown();
    setUp();
    plan.plan.free_twin = 0;
    begin(&without);
    lead(&without, 1500, 0.0);
    lead(&without, 1500, 2.0);
    double ratio = mean_square(&with, changed + 20, with.count) / mean_square(&without, changed + 20, without.count);
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 1.0, ratio);
}

/* The plant had an offset for a while: the free twin forgets it, and u rests again. */
static void it_rests_again_when_the_plant_is_back(void) {
    begin(&with);
    lead(&with, 1000, 0.0);
    lead(&with, 1000, 2.0);
    TEST_ASSERT_FALSE(rests());
    lead(&with, 1900, 0.0);
    TEST_ASSERT_TRUE(rests());
    TEST_ASSERT_EQUAL_UINT64(2, tl_twin_get_facts(run.twin).free_twin.turns);
}

static void a_model_that_is_wrong_for_long_gets_a_new_free_twin(void) {
    begin(&with);
    lead(&with, 2000, 2.0);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(1, tl_twin_get_facts(run.twin).free_twin.renewed);
}

/* A step is followed when it is complete, which is at the next sample. */
static void in_mode_ahead_too(void) {
    for (int on = 0; on < 2; on++) {
        tearDown();
        setUp();
        plan.plan.measurements = TL_AHEAD;
        plan.plan.free_twin = on == 1 ? GUARD : 0;
        begin(on == 1 ? &with : &without);
        lead(on == 1 ? &with : &without, 1000, 3.0);
        TEST_ASSERT_FALSE(rests());
    }
    TEST_ASSERT_EQUAL_size_t(without.count, with.count);
    TEST_ASSERT_EQUAL_MEMORY(without.y, with.y, with.count * sizeof with.y[0]);
    tl_twin_facts facts = tl_twin_get_facts(run.twin);
    TEST_ASSERT_EQUAL_UINT64(2 * facts.components * with.count, facts.free_twin.executions);
    lead(&with, 2000, 0.0);
    TEST_ASSERT_TRUE(rests());
    TEST_ASSERT_TRUE(mean_square(&with, with.count - 500, with.count) < 1e-20); /* no noise, and the input in time */
    size_t changed = with.count;
    lead(&with, 300, 3.0);
    for (size_t i = changed + 3 * GUARD; i < with.count; i++) {
        TEST_ASSERT_EQUAL_UINT32(0, with.flags[i] & TL_FLAG_RESTS);
    }
}

static void there_is_none_if_nothing_is_adjusted(void) {
    plan.plan.adjust_count = 0;
    begin(&with);
    TEST_ASSERT_FALSE(tl_twin_get_facts(run.twin).has_free_twin);
}

static void there_is_none_by_replay(void) {
    fmus[1].functions.replay.most = 100000;
    begin(&with);
    TEST_ASSERT_TRUE(tl_twin_get_facts(run.twin).has_free_twin); /* known from the start */
    lead(&with, 100, 0.0);
    TEST_ASSERT_FALSE(tl_twin_get_facts(run.twin).has_free_twin);
    TEST_ASSERT_EQUAL_UINT64(0, tl_twin_get_facts(run.twin).free_twin.executions);
}

/* ---- when something else changes ---- */

static void a_reset_and_a_tuning_end_a_rest(void) {
    begin(&with);
    lead(&with, 1000, 0.0);
    TEST_ASSERT_TRUE(rests());
    tl_twin_reset(run.twin);
    lead(&with, 1, 0.0);
    TEST_ASSERT_FALSE(rests());
    lead(&with, 1000, 0.0);
    TEST_ASSERT_TRUE(rests());
    tl_tuning tuning;
    tl_twin_get_tuning(run.twin, &tuning);
    tuning.match[0].tolerance *= 2.0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_retune(run.twin, &tuning, &run.error), run.error.text);
    lead(&with, 1, 0.0);
    TEST_ASSERT_FALSE(rests());
    lead(&with, 1000, 0.0);
    TEST_ASSERT_TRUE(rests());
}

/* ---- FMUs that fail ---- */

/* No candidate needs the gear: in a tick it steps for the twin, the free twin and the
 * prediction. */
static void fail_next(uint64_t nth) {
    uint64_t steps = fmus[1].calls[TL_TEST_DO_STEP];
    tl_test_fmu_fail(&fmus[1], TL_TEST_DO_STEP, TL_TEST_ERROR, steps + nth, steps + nth);
    lead(&with, 1, 0.0);
    TEST_ASSERT_EQUAL_UINT64(steps + 3, fmus[1].calls[TL_TEST_DO_STEP]);
}

static void a_failure_beside_the_twin_is_none_of_the_twin(void) {
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    begin(&with);
    lead(&with, 20, 0.0);
    fail_next(2);
    TEST_ASSERT_EQUAL_UINT64(1, tl_twin_get_facts(run.twin).free_twin.renewed);
    lead(&with, 5, 0.0);
    fail_next(3);
    TEST_ASSERT_EQUAL_UINT64(1, tl_twin_get_facts(run.twin).free_twin.renewed);
    lead(&with, 1000, 0.0);
    TEST_ASSERT_TRUE(rests());
}

static void a_fatal_one_ends_the_twin(void) {
    begin(&with);
    lead(&with, DIES_AT, 0.0);
    uint64_t steps = fmus[0].calls[TL_TEST_DO_STEP];
    TEST_ASSERT_TRUE(rests());
    tl_test_fmu_fail(&fmus[0], TL_TEST_DO_STEP, TL_TEST_FATAL, steps + 2, steps + 2); /* the step of the free twin */
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
}

static void states_that_cannot_be_had_end_the_twin(void) {
    begin(&with);
    lead(&with, DIES_AT, 0.0);
    tl_test_fmu_fail(&fmus[0], TL_TEST_SET_STATE, TL_TEST_ERROR, fmus[0].calls[TL_TEST_SET_STATE] + 1, UINT64_MAX);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(until_it_rests_the_twin_is_the_same_to_the_bit);
    RUN_TEST(with_caches_of_each_kind);
    RUN_TEST(with_as_few_states_as_can_be);
    RUN_TEST(u_rests_if_the_model_is_right_and_the_twin_is_true);
    RUN_TEST(a_plant_that_changes_is_followed_at_once);
    RUN_TEST(it_rests_again_when_the_plant_is_back);
    RUN_TEST(a_model_that_is_wrong_for_long_gets_a_new_free_twin);
    RUN_TEST(in_mode_ahead_too);
    RUN_TEST(there_is_none_if_nothing_is_adjusted);
    RUN_TEST(there_is_none_by_replay);
    RUN_TEST(a_reset_and_a_tuning_end_a_rest);
    RUN_TEST(a_failure_beside_the_twin_is_none_of_the_twin);
    RUN_TEST(a_fatal_one_ends_the_twin);
    RUN_TEST(states_that_cannot_be_had_end_the_twin);
    return UNITY_END();
}
