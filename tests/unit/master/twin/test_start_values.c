/* Start values from the plant: copied from a signal and found in the first steps, against a plant
 * whose start is known. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/test_plan.h"

enum { STEPS = 10, TICKS = 60 };

/* Change of y in a step, as part of its distance from the input: T_S/lag. */
static const double PART = 0.25;

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;
static tl_plan_find finds[TL_MAX_ADJUST + 1];
static double plant; /* the true y */
static size_t first_good;
static tl_record records[TICKS];

static tl_value text(const char *name) {
    return (tl_value){.type = TL_STRING, .text = name};
}

/* A first-order lag with an input from the plant and a searched offset. */
static void begin(tl_pairing pairing) {
    tl_test_plan_single(&plan, &fmu, &call_log);
    tl_test_plan_set(&plan, "lag", 0.4);
    tl_test_plan_adjust(&plan, "m.offset", 0.5);
    plan.plan.measurements = pairing;
    plan.plan.find = finds;
    plan.plan.find_steps = STEPS;
    plant = 2.5;
    first_good = 0;
}

static void find(const char *variable, double lower, double upper) {
    finds[plan.plan.find_count++] =
        (tl_plan_find){.where = "synchronise.start.find", .variable = variable, .lower = lower, .upper = upper};
}

void setUp(void) {
    begin(TL_HOLD);
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* The plant's input changes, so that y never rests. */
static double input_at(int64_t tick) {
    return 1.0 + 0.5 * sin(0.3 * (double)tick);
}

/* One tick of plant and twin; the record is stored by its step. */
static void tick(void) {
    int64_t at = run.sample.tick;
    bool good = (size_t)at >= first_good;
    run.sample.values[TL_TEST_CMD] = input_at(at);
    run.sample.values[TL_TEST_Y0] = good ? plant : -9.0;
    run.sample.quality[TL_TEST_Y0] = good ? TL_GOOD : TL_STALE;
    plant += PART * (input_at(at) - plant);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    if (run.ready) {
        records[run.record.step] = run.record;
    }
}

static void run_to(int64_t last) {
    while (run.sample.tick <= last) {
        tick();
    }
}

static void expect_exact(int64_t first, int64_t last, double within) {
    for (int64_t i = first; i <= last; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(within, records[i].measured[0], records[i].y[0]);
        TEST_ASSERT_EQUAL_INT(0, records[i].u[0] < 0.0 || records[i].u[0] > 0.0);
    }
}

static void expect_balanced(void) {
    for (size_t k = 0; k < tl_twin_get_facts(run.twin).components; k++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(run.twin, k).difference);
    }
}

static void test_a_good_signal_is_the_start(void) {
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    tl_test_run_build(&run, &plan);
    run_to(20);
    expect_exact(0, 19, 1e-12);
    TEST_ASSERT_EQUAL_UINT32(0, records[0].flags & (TL_FLAG_RESET | TL_FLAG_STARTS));
    expect_balanced();
}

/* Until then the FMU runs from its own start value, 0. */
static void test_a_late_signal_starts_the_twin_again(void) {
    static const tl_pairing pairings[] = {TL_HOLD, TL_LAG};
    for (size_t p = 0; p < sizeof pairings / sizeof pairings[0]; p++) {
        if (p != 0) {
            tearDown();
            begin(pairings[p]);
        }
        tl_test_plan_set_value(&plan, "start", text("plant.y0"));
        first_good = 7;
        tl_test_run_build(&run, &plan);
        TEST_ASSERT_FALSE(tl_twin_is_starting(run.twin));
        tick();
        TEST_ASSERT_TRUE(tl_twin_is_starting(run.twin));
        run_to(25);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, PART * input_at(0), records[0].y[0]);
        for (int64_t i = 0; i < 24; i++) {
            uint32_t expected = i == 7 ? (uint32_t)TL_FLAG_RESET | TL_FLAG_STARTS : 0U;
            TEST_ASSERT_EQUAL_UINT32(expected, records[i].flags & (TL_FLAG_RESET | TL_FLAG_STARTS));
        }
        TEST_ASSERT_EQUAL_UINT32(0, records[7].found.evaluations);
        expect_exact(7, 23, 1e-12);
        TEST_ASSERT_FALSE(tl_twin_is_starting(run.twin));
        expect_balanced();
    }
}

static void test_initial_is_the_start_until_then(void) {
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    plan.signals[TL_TEST_Y0].has_initial = true;
    plan.signals[TL_TEST_Y0].initial = 1.5;
    first_good = TICKS;
    tl_test_run_build(&run, &plan);
    run_to(3);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.5 + PART * (input_at(0) - 1.5), records[0].y[0]);
}

static void test_a_value_stays_within_declared_bounds(void) {
    plan.plan.adjust_count = 0;
    tl_test_fmu_variable(&fmu, "start")->maximum = 2.0;
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    tl_test_run_build(&run, &plan);
    run_to(1);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 2.0 + PART * (input_at(0) - 2.0), records[0].y[0]);
}

static void test_a_reset_takes_the_present_value(void) {
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    tl_test_run_build(&run, &plan);
    run_to(20);
    plant += 5.0;
    tl_twin_reset(run.twin);
    run_to(30);
    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_RESET, records[20].flags & (TL_FLAG_RESET | TL_FLAG_STARTS));
    expect_exact(21, 29, 5.0); /* the plant jumped within step 20, so y follows with the search */
    TEST_ASSERT_DOUBLE_WITHIN(1.3, records[20].measured[0], records[20].y[0]);
}

/* A hidden start value, which only acts through y. */
static void test_a_start_value_is_found(void) {
    static const tl_pairing pairings[] = {TL_HOLD, TL_LAG};
    for (size_t p = 0; p < sizeof pairings / sizeof pairings[0]; p++) {
        if (p != 0) {
            tearDown();
            begin(pairings[p]);
        }
        find("m.start", 0.0, 10.0);
        tl_test_run_build(&run, &plan);
        run_to(30);
        const tl_record *found = &records[STEPS];
        TEST_ASSERT_EQUAL_UINT32((uint32_t)TL_FLAG_RESET | TL_FLAG_STARTS,
                                 found->flags & (TL_FLAG_RESET | TL_FLAG_STARTS));
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 2.5, found->found.values[0]);
        TEST_ASSERT_TRUE(found->found.before > 10.0);
        TEST_ASSERT_TRUE(found->found.after < 1e-3);
        TEST_ASSERT_TRUE(found->found.evaluations <= 10);
        TEST_ASSERT_EQUAL_UINT32(0, records[STEPS + 1].flags & (TL_FLAG_RESET | TL_FLAG_STARTS));
        expect_exact(STEPS, 28, 1e-6);
        expect_balanced();
    }
}

/* Each search begins with the configured guess, so a reset twin repeats the first one. */
static void test_a_reset_searches_again(void) {
    find("m.start", 0.0, 10.0);
    tl_test_run_build(&run, &plan);
    run_to(30);
    tl_twin_reset(run.twin);
    plant = 2.5;
    run_to(50);
    const tl_record *second = &records[30 + STEPS];
    TEST_ASSERT_EQUAL_UINT32((uint32_t)TL_FLAG_RESET | TL_FLAG_STARTS,
                             second->flags & (TL_FLAG_RESET | TL_FLAG_STARTS));
    TEST_ASSERT_TRUE(second->found.before > 10.0);
    TEST_ASSERT_TRUE(second->found.after < 1e-3);
}

static void test_no_checkpoint_within_a_search(void) {
    static unsigned char bytes[1 << 16];
    size_t size = 1;
    tl_error error;
    find("m.start", 0.0, 10.0);
    fmu.model.capabilities.can_serialize_state = true;
    tl_test_run_build(&run, &plan);
    run_to(5);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run.twin, bytes, sizeof bytes, &size, &error));
    TEST_ASSERT_EQUAL_size_t(0, size);
    run_to(20);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run.twin, bytes, sizeof bytes, &size, &error));
    TEST_ASSERT_TRUE(size > 0);
}

static void test_two_values_are_found_without_a_search(void) {
    find("m.start", 0.0, 10.0);
    find("m.offset", -1.0, 1.0);
    plan.plan.adjust_count = 0;
    tl_test_run_build(&run, &plan);
    run_to(30);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 2.5, records[STEPS].found.values[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0.0, records[STEPS].found.values[1]);
}

static void test_nothing_measured_changes_nothing(void) {
    find("m.start", 0.5, 10.0);
    first_good = TICKS;
    tl_test_run_build(&run, &plan);
    run_to(20);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.5, records[STEPS].found.values[0]);
    TEST_ASSERT_TRUE(isnan(records[STEPS].found.after));
}

static void test_the_search_waits_for_the_copied_values(void) {
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    find("m.start", 0.0, 10.0);
    first_good = 2 * STEPS;
    tl_test_run_build(&run, &plan);
    run_to(45);
    for (int64_t i = 0; i < 44; i++) {
        bool is_restart = i == 2 * STEPS || i == 3 * STEPS;
        TEST_ASSERT_EQUAL_INT(is_restart, (records[i].flags & TL_FLAG_STARTS) != 0);
    }
    TEST_ASSERT_TRUE(records[(size_t)3 * STEPS].found.evaluations > 0);
    expect_exact((int64_t)2 * STEPS, 43, 1e-6);
}

static void test_an_fmu_that_fails_in_the_search(void) {
    find("m.start", 0.0, 10.0);
    tl_test_run_build(&run, &plan);
    run_to(STEPS);
    tl_test_fmu_fail(&fmu, TL_TEST_EXIT_INITIALIZATION, TL_TEST_ERROR, 2, 1000);
    run.sample.values[TL_TEST_CMD] = 0.0;
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    tearDown();
    begin(TL_HOLD);
    find("m.start", 0.0, 10.0);
    tl_test_run_build(&run, &plan);
    run_to(STEPS);
    tl_test_fmu_fail(&fmu, TL_TEST_EXIT_INITIALIZATION, TL_TEST_FATAL, 2, 1000);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
}

static void test_an_fmu_that_rejects_all_values_starts_again(void) {
    find("m.start", 0.0, 10.0);
    tl_test_run_build(&run, &plan);
    run_to(STEPS);
    uint64_t before = fmu.calls[TL_TEST_DO_STEP];
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, before + 1, before + 2);
    run_to(25);
    TEST_ASSERT_TRUE((records[STEPS].flags & TL_FLAG_STARTS) != 0);
    TEST_ASSERT_EQUAL_UINT32(2, records[STEPS].found.evaluations);
    TEST_ASSERT_FALSE(isfinite(records[STEPS].found.after));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, records[24].measured[0], records[24].y[0]);
}

static void test_a_checkpoint_keeps_the_waiting(void) {
    static unsigned char bytes[1 << 16];
    size_t size = 0;
    tl_error error;
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    first_good = 12;
    fmu.model.capabilities.can_serialize_state = true;
    tl_test_run_build(&run, &plan);
    run_to(5);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run.twin, bytes, sizeof bytes, &size, &error));
    tl_twin *first = run.twin;
    tl_sample sample = run.sample;
    run.twin = tl_test_plan_build(&plan);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_load(run.twin, 5, bytes, size, &error), error.text);
    TEST_ASSERT_TRUE(tl_twin_is_starting(run.twin));
    run.sample = sample;
    run_to(20);
    TEST_ASSERT_TRUE((records[12].flags & TL_FLAG_STARTS) != 0);
    expect_exact(12, 18, 1e-12);
    tl_twin_destroy(first);
}

static void expect_problem(const char *where, const char *words) {
    TEST_ASSERT_NULL(tl_test_plan_build(&plan));
    TEST_ASSERT_NOT_NULL_MESSAGE(tl_test_plan_problem(&plan, where, words), plan.problems[0].text);
}

static void test_problems_of_copied_values(void) {
    tl_test_plan_set_value(&plan, "start", text("plant.level"));
    expect_problem("set.start", "plant.level|no such signal");
    begin(TL_HOLD);
    tl_test_plan_set_value(&plan, "u0", text("plant.y0"));
    expect_problem("set.u0", "u0|connect plant.y0");
    begin(TL_HOLD);
    tl_test_plan_set_value(&plan, "start", text("y0"));
    expect_problem("set.start", "expected a number");
    begin(TL_HOLD);
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    plan.signals[TL_TEST_Y0].type = TL_BOOLEAN;
    expect_problem("set.start", "plant.y0 is Boolean");
    begin(TL_HOLD);
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    tl_test_fmu_variable(&fmu, "start")->has_start = false;
    expect_problem("set.start", "initial");
    begin(TL_HOLD);
    tl_test_plan_set_value(&plan, "start", text("plant.y0"));
    static const tl_unit unit = {.name = "m"};
    tl_test_fmu_variable(&fmu, "start")->unit = &unit;
    plan.signals[TL_TEST_Y0].unit = "bar";
    expect_problem("set.start", "\"bar\"|\"m\"");
}

static void test_problems_of_found_values(void) {
    static const char where[] = "synchronise.start.find";
    find("m.begin", 0.0, 1.0);
    expect_problem(where, "m.begin");
    begin(TL_HOLD);
    find("m.u0", 0.0, 1.0);
    expect_problem(where, "m.u0|input");
    begin(TL_HOLD);
    find("m.start", 3.0, 4.0);
    tl_test_fmu_variable(&fmu, "start")->maximum = 2.0;
    expect_problem(where, "no range|3|2");
    begin(TL_HOLD);
    find("m.start", 0.0, 1.0);
    plan.match[0].weight = 0.0;
    expect_problem(where, "match");
    begin(TL_HOLD);
    find("m.offset", 0.0, 1.0);
    expect_problem(where, "m.offset is adjusted");
    begin(TL_HOLD);
    tl_test_plan_set_value(&plan, "offset", text("plant.y0"));
    expect_problem("set.offset", "m.offset is adjusted");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_good_signal_is_the_start);
    RUN_TEST(test_a_late_signal_starts_the_twin_again);
    RUN_TEST(test_initial_is_the_start_until_then);
    RUN_TEST(test_a_value_stays_within_declared_bounds);
    RUN_TEST(test_a_reset_takes_the_present_value);
    RUN_TEST(test_a_start_value_is_found);
    RUN_TEST(test_a_reset_searches_again);
    RUN_TEST(test_no_checkpoint_within_a_search);
    RUN_TEST(test_two_values_are_found_without_a_search);
    RUN_TEST(test_nothing_measured_changes_nothing);
    RUN_TEST(test_the_search_waits_for_the_copied_values);
    RUN_TEST(test_an_fmu_that_fails_in_the_search);
    RUN_TEST(test_an_fmu_that_rejects_all_values_starts_again);
    RUN_TEST(test_a_checkpoint_keeps_the_waiting);
    RUN_TEST(test_problems_of_copied_values);
    RUN_TEST(test_problems_of_found_values);
    return UNITY_END();
}
