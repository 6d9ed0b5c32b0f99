/* Timing of a component with a fake clock that its steps advance: the reported times are right,
 * and the FMU returns to its state. */
#include <string.h>
#include <unity.h>

#include "master/twin/twin_timing.h"
#include "tests/support/test_plan.h"

enum { COST = 1000, LONG = 100 * COST, TICKS = 10 };

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;
static tl_time now;

static tl_time read_clock(void *context) {
    (void)context;
    return now;
}

static void make_plan(void) {
    now = 0;
    tl_test_plan_init(&plan, TL_SECOND / 10);
    tl_test_fmu_init(&fmu, 1, true, &call_log);
    (void)tl_test_plan_component(&plan, "motor", &fmu);
    tl_test_plan_set(&plan, "lag", 0.4);
    tl_test_plan_set(&plan, "u0", 1.0);
    tl_test_plan_set(&plan, "count", 1.0);
    tl_test_plan_set(&plan, "mode", 1.0);
    tl_test_plan_set_value(&plan, "flag", (tl_value){.type = TL_BOOLEAN, .integer = 1});
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_adjust(&plan, "motor.offset", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 0.01);
}

static void run_some_steps(void) {
    tl_test_run_build(&run, &plan);
    for (int i = 0; i < TICKS; i++) {
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    }
}

void setUp(void) {
    make_plan();
    run_some_steps();
    fmu.control.clock = &now;
    fmu.control.cost = COST;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static void expect(const tl_twin_spread *spread, tl_time each) {
    TEST_ASSERT_EQUAL_INT64(each, spread->median);
    TEST_ASSERT_EQUAL_INT64(each, spread->high);
    TEST_ASSERT_EQUAL_INT64(each, spread->worst);
}

static void what_the_clock_says(void) {
    tl_twin_timing timing;
    size_t states = fmu.states;
    tl_twin_time_component(run.twin, 0, read_clock, NULL, TL_SECOND, &timing);
    TEST_ASSERT_EQUAL_UINT32(TL_TWIN_TIMINGS, timing.rounds);
    expect(&timing.step, COST);
    expect(&timing.save, 0);
    expect(&timing.restore, 0);
    TEST_ASSERT_EQUAL_UINT64(states, fmu.states);
}

/* A round has two steps. */
static void no_longer_than_it_may_take(void) {
    tl_twin_timing timing;
    tl_twin_time_component(run.twin, 0, read_clock, NULL, 20 * COST, &timing);
    TEST_ASSERT_EQUAL_UINT32(10, timing.rounds);
    tl_twin_time_component(run.twin, 0, read_clock, NULL, 0, &timing);
    TEST_ASSERT_EQUAL_UINT32(1, timing.rounds);
}

/* One long call is the worst time. It is among the longest hundredth, so the high time leaves it
 * out. */
static tl_time read_jumping_clock(void *context) {
    int *calls = context;
    now += ++*calls == 101 ? 77 * COST : 0;
    return now;
}

static void the_worst_is_one_of_many(void) {
    tl_twin_timing timing;
    int calls = 0;
    tl_twin_time_component(run.twin, 0, read_jumping_clock, &calls, TL_SECOND, &timing);
    tl_time worst = timing.step.worst + timing.save.worst + timing.restore.worst;
    TEST_ASSERT_TRUE(worst == 78 * COST || worst == COST);
    TEST_ASSERT_EQUAL_INT64(COST, timing.step.high);
    TEST_ASSERT_EQUAL_INT64(0, timing.restore.high);
}

static void one_that_fails_is_not_told_of(void) {
    static const tl_test_call calls[] = {TL_TEST_GET_STATE, TL_TEST_SET_STATE, TL_TEST_DO_STEP};
    for (size_t i = 0; i < sizeof calls / sizeof calls[0]; i++) {
        tl_twin_timing timing;
        uint64_t next = fmu.calls[calls[i]] + 5;
        size_t states = fmu.states;
        tl_test_fmu_fail(&fmu, calls[i], TL_TEST_ERROR, next, next);
        tl_twin_time_component(run.twin, 0, read_clock, NULL, TL_SECOND, &timing);
        TEST_ASSERT_EQUAL_UINT32(0, timing.rounds);
        TEST_ASSERT_EQUAL_UINT64(states, fmu.states);
        tearDown();
        setUp();
    }
}

/* Builds the twin again, with a choice at its start. `costs`: of a step and of a save. If step number `failing` (0: none) is made, it
 * fails. */
static void start_with(tl_keep keep, const tl_time costs[2], bool has_clock, uint64_t failing) {
    tearDown();
    make_plan();
    plan.components[0].keep = keep;
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    plan.plan.now = has_clock ? read_clock : NULL;
    fmu.control.clock = &now;
    fmu.control.cost = costs[0];
    fmu.control.save_cost = costs[1];
    if (failing != 0) {
        tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, failing, failing);
    }
    run_some_steps();
}

static void states_are_kept_if_that_is_faster(void) {
    static const struct {
        tl_time costs[2];
        bool has_clock;
        tl_keep chosen;
    } cases[] = {{{LONG, 0}, true, TL_KEEP_STATES},
                 {{LONG, LONG}, true, TL_KEEP_NONE},
                 {{LONG, LONG}, false, TL_KEEP_STATES},
                 {{10, 0}, true, TL_KEEP_NONE}}; /* the bookkeeping takes longer */
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        start_with(TL_KEEP_AUTO, cases[i].costs, cases[i].has_clock, 0);
        tl_twin_ledger entry = tl_twin_get_ledger(run.twin, 0);
        TEST_ASSERT_EQUAL_INT(cases[i].chosen, entry.keep);
        bool is_kept = cases[i].chosen == TL_KEEP_STATES;
        TEST_ASSERT_EQUAL_UINT64(is_kept ? 0 : 1, tl_twin_unsaved(run.twin));
        TEST_ASSERT_EQUAL(is_kept, tl_twin_get_facts(run.twin).sequences);
        start_with(cases[i].chosen, cases[i].costs, false, 0);
        tl_twin_ledger same = tl_twin_get_ledger(run.twin, 0);
        TEST_ASSERT_EQUAL_UINT64(same.executions, entry.executions);
        TEST_ASSERT_EQUAL_UINT64(same.predicted, entry.predicted);
        TEST_ASSERT_EQUAL_UINT64(entry.predicted, entry.executions);
    }
}

/* The third of the repeated steps, which follow those of the proof. */
static void states_are_kept_if_a_repeated_step_fails(void) {
    static const tl_time costs[2] = {LONG, LONG};
    start_with(TL_KEEP_STATES, costs, true, 0);
    start_with(TL_KEEP_AUTO, costs, true, tl_twin_get_facts(run.twin).proved_executions + 3);
    TEST_ASSERT_EQUAL_INT(TL_KEEP_STATES, tl_twin_get_ledger(run.twin, 0).keep);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(what_the_clock_says);
    RUN_TEST(no_longer_than_it_may_take);
    RUN_TEST(the_worst_is_one_of_many);
    RUN_TEST(one_that_fails_is_not_told_of);
    RUN_TEST(states_are_kept_if_that_is_faster);
    RUN_TEST(states_are_kept_if_a_repeated_step_fails);
    return UNITY_END();
}
