/* Boolean variables in a locked twin: the better of a value and its negation, one variable after
 * the other, and a rest after a change. */
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "tests/support/test_plan.h"

enum { MOST = 3, COMMAND = MOST }; /* signals: the true states of the switches, then their commands */

static const char *const names[MOST] = {"a", "b", "c"};
static const char *const inputs[MOST] = {"a.flag", "b.flag", "c.flag"};
static const char *const outputs[MOST] = {"a.flag_out", "b.flag_out", "c.flag_out"};
static const char *const signals[MOST] = {"plant.a", "plant.b", "plant.c"};
static const char *const commands[MOST] = {"plant.cmd_a", "plant.cmd_b", "plant.cmd_c"};

static tl_test_log call_log;
static tl_test_fmu fmus[MOST];
static tl_test_plan plan;
static tl_test_run run;
static size_t switches;
static bool hopeless; /* another match that no switch can satisfy, so no search is ever within tolerance */

void setUp(void) {
    hopeless = false;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static void add_switch(size_t i, tl_time dwell) {
    tl_test_fmu_init(&fmus[i], 1, true, &call_log);
    tl_test_plan_component(&plan, names[i], &fmus[i]);
    tl_test_plan_set(&plan, "u0", 0.0);
    tl_test_plan_set(&plan, "count", 0.0);
    tl_test_plan_set(&plan, "mode", 0.0);
    tl_test_plan_connect(&plan, commands[i], inputs[i]);
    tl_test_plan_adjust(&plan, inputs[i], 0.0)->dwell = dwell;
    tl_test_plan_match(&plan, outputs[i], signals[i], 0.5);
}

/* Each switch is matched by its true state; `dwell` in steps. */
static void build(size_t count, uint32_t prediction, int64_t dwell) {
    tl_test_run_end(&run, &plan);
    switches = count;
    tl_test_plan_init(&plan, TL_SECOND / 10);
    for (size_t i = 0; i < count; i++) {
        tl_test_plan_signal(&plan, signals[i] + strlen("plant."), TL_BOOLEAN, "");
    }
    for (size_t i = 0; i < count; i++) {
        tl_test_plan_signal(&plan, commands[i] + strlen("plant."), TL_BOOLEAN, "");
    }
    for (size_t i = 0; i < count; i++) {
        add_switch(i, dwell * TL_SECOND / 10);
    }
    if (hopeless) {
        tl_test_plan_signal(&plan, "y", TL_REAL, "")->has_initial = true;
        tl_test_plan_match(&plan, "a.y0", "plant.y", 0.5);
    }
    plan.plan.algorithm = "boolean";
    plan.plan.prediction = prediction;
    tl_test_run_build(&run, &plan);
}

/* Bits of the true states and of the commands. */
static const tl_record *tick(unsigned real, unsigned reported) {
    for (size_t i = 0; i < switches; i++) {
        run.sample.values[i] = (double)(real >> i & 1U);
        run.sample.values[switches + i] = (double)(reported >> i & 1U);
    }
    run.sample.values[2 * switches] = 1.0; /* 0 in the twin */
    return tl_test_run_tick(&run, &call_log);
}

static unsigned committed(const tl_record *record) {
    unsigned bits = 0;
    for (size_t i = 0; i < switches; i++) {
        bits |= record->u[i] > 0.5 ? 1U << i : 0U;
    }
    return bits;
}

/* ---- values ---- */

/* All combinations of commands and true states, twice each: found in the first step, guessed in
 * the second. */
static void what_is_real_is_found_whatever_is_told(void) {
    for (size_t count = 1; count <= MOST; count++) {
        build(count, 1, 0);
        (void)tick(0, 0);
        for (unsigned number = 0; number < 4096; number++) {
            unsigned all = (1U << count) - 1;
            unsigned real = (number * 5 + number / 7) & all;
            unsigned reported = (number / 3) & all;
            unsigned before = committed(&run.record);
            const tl_record *record = tick(real, reported);
            TEST_ASSERT_EQUAL_HEX32(real, committed(record));
            TEST_ASSERT_EQUAL_INT(real == before ? TL_FIRST_GUESS : TL_OPTIMISED, record->outcome);
            TEST_ASSERT_TRUE(record->evaluations <= 1 + count); /* the start, and each negation */
            record = tick(real, reported);
            TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
            TEST_ASSERT_EQUAL_UINT32(1, record->evaluations);
        }
    }
}

/* The command is nominal, the true state is u. The record has both as 0 and 1. */
static void the_record_tells_both(void) {
    build(1, 1, 0);
    (void)tick(1, 0);
    const tl_record *record = tick(1, 0);
    TEST_ASSERT_TRUE(record->u[0] == 1.0 && record->nominal[0] == 0.0);
    TEST_ASSERT_TRUE(record->y[0] == 1.0 && record->measured[0] == 1.0);
}

/* The start, then the negation of each variable in turn. A negation without improvement is undone
 * before the next. */
static void one_is_settled_after_the_other(void) {
    build(3, 1, 0);
    (void)tick(0, 0);
    const tl_record *record = tick(1, 0);
    TEST_ASSERT_EQUAL_UINT32(2, record->evaluations); /* within tolerance: the others are not tried */
    record = tick(4, 0);
    TEST_ASSERT_EQUAL_UINT32(4, record->evaluations);
    TEST_ASSERT_EQUAL_HEX32(4, committed(record));
}

/* ---- out of tolerance ---- */

/* There are only two values, one of them nominal. It is evaluated once. */
static void a_switch_costs_two_evaluations_at_most(void) {
    hopeless = true;
    build(1, 1, 0);
    (void)tick(1, 0);
    for (unsigned number = 0; number < 64; number++) {
        const tl_record *record = tick(1, number / 3 & 1U);
        TEST_ASSERT_EQUAL_INT(record->u[0] == record->nominal[0] ? TL_NOMINAL : TL_BEST_SO_FAR, record->outcome);
        TEST_ASSERT_EQUAL_UINT32(2, record->evaluations);
        TEST_ASSERT_TRUE(isfinite(record->objective_nominal));
        TEST_ASSERT_EQUAL_HEX32(1, committed(record));
    }
}

/* ---- rest ---- */

/* The true state flickers: after a change, the variable rests for at least `dwell` steps. */
static void after_a_change_it_rests(void) {
    for (int64_t dwell = 0; dwell <= 4; dwell++) {
        build(1, 1, dwell);
        (void)tick(0, 0);
        int64_t since = 100;
        unsigned changes = 0;
        for (unsigned number = 0; number < 200; number++) {
            unsigned before = committed(&run.record);
            const tl_record *record = tick(number & 1U, 0);
            bool changed = committed(record) != before;
            TEST_ASSERT_TRUE(!changed || since >= dwell);
            TEST_ASSERT_TRUE(changed || since < dwell || before == (number & 1U)); /* but not longer */
            since = changed ? 1 : since + 1;
            changes += changed ? 1 : 0;
        }
        TEST_ASSERT_TRUE(changes > 30);
    }
}

/* A rest of more steps than a counter holds is limited, not truncated. With steps of 10 µs the
 * limit is half a day. */
static void a_rest_of_any_length_is_one(void) {
    static const int64_t rests[] = {UINT32_MAX, (int64_t)UINT32_MAX + 1, (int64_t)UINT32_MAX + 2,
                                    INT64_MAX / TL_SECOND};
    for (size_t i = 0; i < sizeof rests / sizeof rests[0]; i++) {
        build(1, 1, rests[i]);
        (void)tick(0, 0);
        (void)tick(1, 0);
        for (unsigned number = 0; number < 200; number++) {
            TEST_ASSERT_EQUAL_HEX32(1, committed(tick(number & 1U, 0)));
        }
    }
}

/* A rest that ends inside a step lasts until the end of that step, also near the largest time. */
static void a_rest_is_whole_steps(void) {
    build(1, 1, 0);
    tl_plan_adjust *adjust = &plan.adjust[0];
    static const tl_time rests[] = {TL_SECOND / 10 + 1, 2 * TL_SECOND / 10, 2 * TL_SECOND / 10 + 1, INT64_MAX};
    static const unsigned changes[] = {2, 2, 1, 1};
    for (size_t i = 0; i < sizeof rests / sizeof rests[0]; i++) {
        tl_twin_destroy(run.twin);
        adjust->dwell = rests[i];
        tl_test_run_init(&run, tl_test_plan_build(&plan));
        (void)tick(0, 0);
        (void)tick(1, 0); /* changes */
        unsigned seen = 1;
        seen += committed(tick(0, 0)) != 1;
        seen += committed(tick(0, 0)) != 1;
        TEST_ASSERT_EQUAL_UINT(changes[i], seen);
    }
}

/* Each variable has its own rest. */
static void one_that_rests_does_not_keep_the_others(void) {
    build(2, 1, 5);
    (void)tick(0, 0);
    TEST_ASSERT_EQUAL_HEX32(1, committed(tick(1, 0)));
    TEST_ASSERT_EQUAL_HEX32(3, committed(tick(2, 0))); /* the first one rests at 1 */
    TEST_ASSERT_EQUAL_HEX32(3, committed(tick(2, 0)));
    TEST_ASSERT_EQUAL_HEX32(3, committed(tick(2, 0)));
    TEST_ASSERT_EQUAL_HEX32(3, committed(tick(2, 0)));
    TEST_ASSERT_EQUAL_HEX32(2, committed(tick(2, 0)));
}

/* With a longer horizon, the switch is constant over it and follows the majority of its samples. */
static void a_horizon_of_several_steps_is_held(void) {
    build(2, 3, 0);
    for (unsigned number = 0; number < 40; number++) {
        const tl_record *record = tick(number / 10 % 2 == 0 ? 1 : 2, 0);
        if (number % 10 > 3) {
            TEST_ASSERT_EQUAL_HEX32(number / 10 % 2 == 0 ? 1 : 2, committed(record));
            TEST_ASSERT_EQUAL_UINT32(1, record->evaluations);
        }
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(what_is_real_is_found_whatever_is_told);
    RUN_TEST(the_record_tells_both);
    RUN_TEST(one_is_settled_after_the_other);
    RUN_TEST(a_switch_costs_two_evaluations_at_most);
    RUN_TEST(after_a_change_it_rests);
    RUN_TEST(a_rest_of_any_length_is_one);
    RUN_TEST(a_rest_is_whole_steps);
    RUN_TEST(one_that_rests_does_not_keep_the_others);
    RUN_TEST(a_horizon_of_several_steps_is_held);
    return UNITY_END();
}
