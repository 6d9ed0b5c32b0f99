/* Released twins: their outputs against a plant whose course is known, their ages, their cost, and
 * that they never affect the twin. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/sync/released_twin.h"
#include "tests/support/test_plan.h"

enum { STEPS = 20, TICKS = 400 };

/* Change of y in a step, as part of its distance from the input: T_S/lag. */
static const double PART = 0.25;

static tl_test_log call_log;
static tl_test_fmu fmus[2];
static tl_test_plan plan;
static tl_test_run run;
static double plant; /* the true y */

/* Results of a run. */
typedef struct outcome {
    tl_record record[TICKS];
    size_t count;
} outcome;

static outcome with, without;

static void add(const char *name) {
    tl_test_fmu *fmu = &fmus[plan.plan.component_count];
    tl_test_fmu_init(fmu, 1, false, &call_log);
    (void)tl_test_plan_component(&plan, name, fmu);
    tl_test_plan_set(&plan, "lag", 0.4);
}

/* A motor with an input from the plant and a searched offset. A gear follows it and is only
 * compared. */
void setUp(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
    add("motor");
    add("gear");
    tl_test_plan_signal(&plan, "u", TL_REAL, "");
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.u", "motor.u0");
    tl_test_plan_connect(&plan, "motor.y0", "gear.u0");
    tl_test_plan_adjust(&plan, "motor.offset", 0.5);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1e-6);
    tl_test_plan_match(&plan, "gear.y0", "plant.y", 1.0)->weight = 0.0;
    plan.plan.algorithm = "secant";
    plan.plan.released_steps = STEPS;
    plant = 0.0;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* Computes the plant, with `more` added to its input; then the twin's tick. */
static void tick(double more, outcome *seen) {
    int64_t at = run.sample.tick;
    plant = at == 0 ? 0.0 : plant + PART * (run.sample.values[0] + more - plant);
    run.sample.values[0] = sin(0.05 * (double)at);
    run.sample.values[1] = plant;
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    if (run.ready) {
        TEST_ASSERT_EQUAL_INT64(seen->count, run.record.step);
        seen->record[seen->count++] = run.record;
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

static tl_twin_facts facts(void) {
    return tl_twin_get_facts(run.twin);
}

static uint32_t find_age(size_t step) {
    return step < STEPS ? (uint32_t)step + 1 : STEPS / 2 + 1 + (uint32_t)step % (STEPS / 2);
}

static void expect_same_twin(void) {
    TEST_ASSERT_EQUAL_size_t(without.count, with.count);
    for (size_t i = 0; i < with.count; i++) {
        const tl_record *one = &with.record[i];
        const tl_record *other = &without.record[i];
        TEST_ASSERT_EQUAL_MEMORY(other->y, one->y, 2 * sizeof one->y[0]);
        TEST_ASSERT_EQUAL_MEMORY(other->u, one->u, sizeof one->u[0]);
        TEST_ASSERT_EQUAL_UINT32(other->flags, one->flags);
        TEST_ASSERT_EQUAL_UINT32(other->executions, one->executions);
        TEST_ASSERT_EQUAL_UINT32(other->predicted, one->predicted);
        TEST_ASSERT_EQUAL_UINT32(0, other->release_age);
    }
}

/* ---- outputs and ages ---- */

/* The locked twin adds 2 to its input, a released one does not. So their distance is known. */
static void a_released_twin_returns_to_the_uncorrected_model(void) {
    begin(&with);
    lead(&with, TICKS, 2.0);
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_ON, facts().released_state);
    for (size_t i = 0; i < with.count; i++) {
        const tl_record *record = &with.record[i];
        TEST_ASSERT_EQUAL_UINT32(find_age(i), record->release_age);
        double left = 2.0 * (1.0 - pow(1.0 - PART, record->release_age));
        if (i >= 3 * STEPS) {
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.0, record->y[0] - record->measured[0]);
            TEST_ASSERT_DOUBLE_WITHIN(1e-5, left, record->y[0] - record->released[0]);
            TEST_ASSERT_TRUE(record->released[1] < record->y[1]);
        }
    }
    const tl_metrics *released = tl_twin_released(run.twin, 0);
    TEST_ASSERT_EQUAL_UINT64(with.count, released->pairs);
    TEST_ASSERT_TRUE(tl_metrics_mse(released) > 3.0 && tl_metrics_mse(tl_twin_metrics(run.twin, 0)) < 0.1);
}

/* The plant has 2 more than nominal. Without the bound, the released twin would follow it. */
static void an_approved_correction_is_no_error(void) {
    plan.adjust[0].approved = 2.0;
    begin(&with);
    lead(&with, TICKS, 2.0);
    for (size_t i = 3 * STEPS; i < with.count; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-5, with.record[i].measured[0], with.record[i].released[0]);
    }
    tl_test_run_end(&run, &plan);
    plan.adjust[0].upper = 1.5;
    begin(&with);
    plant = 0.0;
    lead(&with, TICKS, 1.0);
    for (size_t i = 3 * STEPS; i < with.count; i++) {
        double left = 0.5 * (1.0 - pow(1.0 - PART, with.record[i].release_age));
        TEST_ASSERT_DOUBLE_WITHIN(1e-5, with.record[i].measured[0] + left, with.record[i].released[0]);
    }
}

/* Both released twins have run without it, so they end. The twin's bits are those of a twin without
 * released twins. */
static void a_correction_that_is_approved_in_place(void) {
    tl_tuning tuning;
    begin(&with);
    lead(&with, TICKS / 2, 2.0);
    tl_twin_get_tuning(run.twin, &tuning);
    tuning.adjust[0].approved = 2.0;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_retune(run.twin, &tuning, &run.error));
    size_t first = with.count;
    lead(&with, TICKS / 2, 2.0);
    TEST_ASSERT_EQUAL_UINT32(0, with.record[first].release_age);
    bool is_released = false;
    for (size_t i = first; i < with.count; i++) {
        bool has_one = with.record[i].release_age != 0;
        TEST_ASSERT_TRUE(has_one || !is_released);
        is_released = has_one;
        if (has_one) {
            TEST_ASSERT_DOUBLE_WITHIN(1e-5, with.record[i].measured[0], with.record[i].released[0]);
        }
    }
    TEST_ASSERT_TRUE(with.record[first + STEPS / 2].release_age != 0);
    tl_twin_get_tuning(run.twin, &tuning);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, tuning.adjust[0].approved);
    tl_test_run_end(&run, &plan);
    plan.plan.released_steps = 0;
    begin(&without);
    plant = 0.0;
    lead(&without, TICKS, 2.0);
    expect_same_twin();
}

static void with_a_right_model_it_stays_at_the_plant(void) {
    begin(&with);
    lead(&with, TICKS, 0.0);
    for (size_t i = 0; i < with.count; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-5, with.record[i].measured[0], with.record[i].released[0]);
    }
}

/* ---- errors by age ---- */

/* Both twins count. The gear is only compared, so it does not. */
static void errors_are_added_by_age(void) {
    begin(&with);
    lead(&with, TICKS, 2.0);
    const tl_released_counts counts = facts().released;
    uint64_t total = 0;
    for (size_t age = 0; age < TL_RELEASED_AGES; age++) {
        double square = counts.squares[age] / (double)counts.steps[age];
        total += counts.steps[age];
        if (age <= 4) { /* a tolerance is 1e-6: each error counts as the largest one */
            TEST_ASSERT_DOUBLE_WITHIN(0.01 * TL_RELEASED_MOST, TL_RELEASED_MOST, square);
        } else {
            TEST_ASSERT_EQUAL_UINT64(0, counts.steps[age]);
        }
    }
    TEST_ASSERT_EQUAL_UINT64(2 * with.count - STEPS / 2, total);
    tearDown();
    setUp();
    plan.match[0].tolerance = 1.0;
    plan.match[0].weight = 4.0;
    begin(&with);
    lead(&with, TICKS, 2.0);
    for (size_t age = 0; age <= 4; age++) {
        double least = 2.0 * (1.0 - pow(1.0 - PART, pow(2.0, (double)age)));
        double square = facts().released.squares[age] / (double)facts().released.steps[age] / 4.0;
        TEST_ASSERT_TRUE(square > 0.3 * least * least && square < 4.0);
    }
}

static void without_a_measurement_no_error_counts(void) {
    begin(&with);
    for (int i = 0; i < 40; i++) {
        run.sample.quality[1] = TL_STALE;
        tick(2.0, &with);
    }
    TEST_ASSERT_EQUAL_UINT64(0, facts().released.steps[0]);
    TEST_ASSERT_TRUE(facts().released.executions > 0);
}

/* ---- cost and effect ---- */

static void run_with_and_without(double more) {
    begin(&with);
    lead(&with, TICKS, more);
    tl_twin_facts had = facts();
    uint64_t young = STEPS / 2;
    TEST_ASSERT_EQUAL_UINT64(had.components * (2 * with.count - young), had.released.executions);
    TEST_ASSERT_EQUAL_UINT64(1 + with.count / young, had.released.releases);
    tl_test_run_end(&run, &plan);
    plan.plan.released_steps = 0;
    begin(&without);
    plant = 0.0;
    lead(&without, TICKS, more);
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_OFF, facts().released_state);
    TEST_ASSERT_EQUAL_UINT64(0, facts().released.executions);
    expect_same_twin();
}

static void the_twin_is_the_same_to_the_bit(void) {
    run_with_and_without(3.0);
}

static void with_caches_of_each_kind_and_each_pairing(void) {
    for (int way = 0; way < 12; way++) {
        tearDown();
        setUp();
        plan.plan.saving = (tl_plan_saving){.structure = (way & 1) != 0, .sequences = (way & 2) != 0};
        plan.plan.measurements = (tl_pairing)(way / 4);
        plan.plan.prediction = 3;
        plan.plan.verify_every = 9;
        plan.plan.algorithm = way % 2 == 0 ? "nelder-mead" : "secant";
        run_with_and_without(1.0);
    }
}

/* An odd number of steps is rounded up. */
static void two_steps_are_the_fewest(void) {
    plan.plan.released_steps = 1;
    begin(&with);
    lead(&with, 30, 1.0);
    TEST_ASSERT_EQUAL_UINT32(2, facts().released_steps);
    for (size_t i = 1; i < with.count; i++) {
        TEST_ASSERT_EQUAL_UINT32(2, with.record[i].release_age);
    }
}

/* ---- when there are none ---- */

static void expect_state(tl_released_state state, int64_t ticks) {
    begin(&with);
    lead(&with, ticks, 1.0);
    TEST_ASSERT_EQUAL_UINT32(state, facts().released_state);
    TEST_ASSERT_EQUAL_UINT32(0, run.record.release_age);
    tearDown();
    setUp();
}

/* Each state has 200 bytes. */
static size_t heap_of_states(void) {
    return 200 * (fmus[0].states + fmus[1].states);
}

static void there_are_none_if_they_are_not_possible(void) {
    plan.plan.adjust_count = 0;
    expect_state(TL_RELEASED_OFF, 10);
    plan.components[1].keep = TL_KEEP_OUTPUTS;
    expect_state(TL_RELEASED_OUTPUTS, 10);
    fmus[1].functions.replay.most = 100000;
    expect_state(TL_RELEASED_REPLAY, 10);
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    plan.plan.heap = heap_of_states;
    plan.plan.state_bytes = 4 * 2 * 3 * 200 - 1;
    expect_state(TL_RELEASED_MEMORY, 10);
}

static void a_quarter_of_the_memory_is_enough(void) {
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    plan.plan.heap = heap_of_states;
    plan.plan.state_bytes = 4 * 2 * 3 * 200;
    begin(&with);
    lead(&with, 10, 1.0);
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_ON, facts().released_state);
}

static tl_time clock_time;
static tl_time step_time;

static tl_time read_clock(void *context) {
    (void)context;
    clock_time += step_time;
    return clock_time;
}

/* A reading of the clock takes `step_time`, so a follow takes as long. Only one twin is released yet. */
static void without_time_they_end(void) {
    step_time = TL_SECOND / 10 / 10 / 2 + 1;
    begin(&with);
    run.budget.now = read_clock;
    run.budget.time = TL_SECOND * 1000;
    lead(&with, TL_RELEASED_TIMED, 1.0);
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_ON, facts().released_state);
    lead(&with, 2, 1.0);
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_SLOW, facts().released_state);
    TEST_ASSERT_EQUAL_UINT32(0, run.record.release_age);
    TEST_ASSERT_EQUAL_INT64(2 * step_time, facts().released_time);
}

/* A shadow, for example: no replay would repeat its decision. */
static void an_unrecorded_twin_keeps_them(void) {
    step_time = TL_SECOND;
    begin(&with);
    run.budget.now = read_clock;
    run.budget.time = TL_SECOND * 1000000;
    run.budget.unrecorded = true;
    lead(&with, 40, 1.0);
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_ON, facts().released_state);
    run.budget.unrecorded = false;
    lead(&with, TL_RELEASED_TIMED, 1.0);
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_SLOW, facts().released_state);
}

/* A run whose released twins end for lack of time, and a replay that ends them as recorded. */
static void a_replay_ends_them_at_the_same_step(void) {
    for (int pairing = 0; pairing < 3; pairing++) {
        tearDown();
        setUp();
        plan.plan.measurements = (tl_pairing)pairing;
        plan.plan.prediction = 3;
        step_time = TL_SECOND;
        begin(&without);
        run.budget.now = read_clock;
        run.budget.time = TL_SECOND * 1000000;
        lead(&without, 40, 1.0);
        TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_SLOW, facts().released_state);
        int64_t waits = facts().lead; /* ticks from a step's own to the one that computes it */
        tl_test_run_end(&run, &plan);
        plant = 0.0;
        begin(&with);
        for (int64_t i = 0; i < 40; i++) {
            size_t step = (size_t)(i - waits);
            bool has_step = i >= waits && step < without.count;
            tl_twin_end_released(run.twin, has_step && (without.record[step].flags & TL_FLAG_RELEASED_SLOW) != 0);
            lead(&with, 1, 1.0);
        }
        TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_SLOW, facts().released_state);
        TEST_ASSERT_EQUAL_size_t(without.count, with.count);
        for (size_t i = 0; i < with.count; i++) {
            TEST_ASSERT_EQUAL_UINT32(0, (without.record[i].flags ^ with.record[i].flags) & TL_FLAG_RELEASED_SLOW);
            TEST_ASSERT_EQUAL_UINT32(without.record[i].release_age, with.record[i].release_age);
        }
    }
}

static void a_pause_does_not_end_them(void) {
    begin(&with);
    run.budget.now = read_clock;
    run.budget.time = TL_SECOND * 1000;
    for (int i = 0; i < 60; i++) {
        step_time = i % 4 == 0 ? 1 : TL_SECOND;
        lead(&with, 1, 1.0);
    }
    TEST_ASSERT_EQUAL_UINT32(TL_RELEASED_ON, facts().released_state);
}

/* ---- when something else happens ---- */

static void a_reset_releases_again(void) {
    begin(&with);
    lead(&with, 55, 1.0);
    tl_twin_reset(run.twin);
    for (uint32_t age = 1; age <= STEPS; age++) {
        lead(&with, 1, 1.0);
        TEST_ASSERT_EQUAL_UINT32(age, run.record.release_age);
    }
}

static void a_missed_tick_and_a_followed_one_count(void) {
    begin(&with);
    lead(&with, 30, 1.0);
    tl_test_run_catch_up(&run);
    TEST_ASSERT_EQUAL_UINT32(find_age((size_t)run.record.step), run.record.release_age);
    tl_test_run_follow(&run, (const double[]){0.0});
    TEST_ASSERT_EQUAL_UINT32(find_age((size_t)run.record.step), run.record.release_age);
}

/* ---- FMUs that fail ---- */

/* The gear steps for the twin, then for each released twin. */
static void a_failure_of_a_released_twin_does_not_affect_the_twin(void) {
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    begin(&without);
    lead(&without, TICKS, 1.0);
    tearDown();
    setUp();
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    begin(&with);
    lead(&with, 43, 1.0);
    TEST_ASSERT_EQUAL_UINT32(find_age((size_t)run.record.step), run.record.release_age);
    uint64_t steps = fmus[1].calls[TL_TEST_DO_STEP];
    tl_test_fmu_fail(&fmus[1], TL_TEST_DO_STEP, TL_TEST_ERROR, steps + 3, steps + 3);
    lead(&with, 1, 1.0);
    uint32_t young = run.record.release_age;
    TEST_ASSERT_TRUE(young > 0 && young <= STEPS / 2); /* the other one */
    lead(&with, TICKS - 44, 1.0);
    TEST_ASSERT_EQUAL_UINT32(find_age((size_t)run.record.step), run.record.release_age);
    for (size_t i = 0; i < with.count; i++) {
        TEST_ASSERT_EQUAL_MEMORY(without.record[i].y, with.record[i].y, 2 * sizeof with.record[i].y[0]);
    }
}

static void a_fatal_one_ends_the_twin(void) {
    begin(&with);
    lead(&with, 43, 1.0);
    uint64_t steps = fmus[0].calls[TL_TEST_DO_STEP];
    tl_test_run_step(&run);
    uint64_t each = fmus[0].calls[TL_TEST_DO_STEP] - steps;
    tl_test_fmu_fail(&fmus[0], TL_TEST_DO_STEP, TL_TEST_FATAL, steps + 2 * each, UINT64_MAX);
    tl_test_run_step(&run);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
}

static void states_that_cannot_be_had_end_the_twin(void) {
    begin(&with);
    lead(&with, 43, 1.0);
    tl_test_fmu_fail(&fmus[0], TL_TEST_SET_STATE, TL_TEST_ERROR, fmus[0].calls[TL_TEST_SET_STATE] + 1, UINT64_MAX);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_released_twin_returns_to_the_uncorrected_model);
    RUN_TEST(an_approved_correction_is_no_error);
    RUN_TEST(a_correction_that_is_approved_in_place);
    RUN_TEST(with_a_right_model_it_stays_at_the_plant);
    RUN_TEST(errors_are_added_by_age);
    RUN_TEST(without_a_measurement_no_error_counts);
    RUN_TEST(the_twin_is_the_same_to_the_bit);
    RUN_TEST(with_caches_of_each_kind_and_each_pairing);
    RUN_TEST(two_steps_are_the_fewest);
    RUN_TEST(there_are_none_if_they_are_not_possible);
    RUN_TEST(a_quarter_of_the_memory_is_enough);
    RUN_TEST(without_time_they_end);
    RUN_TEST(an_unrecorded_twin_keeps_them);
    RUN_TEST(a_replay_ends_them_at_the_same_step);
    RUN_TEST(a_pause_does_not_end_them);
    RUN_TEST(a_reset_releases_again);
    RUN_TEST(a_missed_tick_and_a_followed_one_count);
    RUN_TEST(a_failure_of_a_released_twin_does_not_affect_the_twin);
    RUN_TEST(a_fatal_one_ends_the_twin);
    RUN_TEST(states_that_cannot_be_had_end_the_twin);
    return UNITY_END();
}
