/* Recovery of a lost twin: when and how often it is reset, and which outputs count. */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/lock_monitor.h"

enum { WINDOW = 100, PART = 10 }; /* steps of 10 ms */

static tl_plan_adjust adjust[1];
static tl_plan_match match[1];
static tl_config config;
static tl_account account;
static tl_recovery recovery;
static tl_record record;
static int64_t resets[32]; /* steps before which a reset was due */
static int count;

void setUp(void) {
    memset(&record, 0, sizeof record);
    memset(&config, 0, sizeof config);
    count = 0;
    adjust[0].variable = "motor.d";
    match[0] = (tl_plan_match){.variable = "motor.omega", .to = "plant.omega", .tolerance = 1, .weight = 1};
    config.adjust = adjust;
    config.adjust_count = 1;
    config.match = match;
    config.match_count = 1;
    config.step = TL_SECOND / 100;
    account.adjust[0] = (tl_account_adjust){.type = TL_REAL, .step = 0.1, .lower = -1, .upper = 2};
    tl_recovery_init(&recovery, &config, &account);
    record.outcome = TL_OPTIMISED;
}

void tearDown(void) {}

/* Steps with an error of so many tolerances, of alternating sign. The twin is reset when that is
 * due. */
static void run(double away, int steps) {
    for (int i = 0; i < steps; i++) {
        const tl_lock_change *change = NULL;
        record.y[0] = i % 2 == 0 ? away : -away;
        bool is_due = tl_recovery_step(&recovery, &record, &change);
        record.flags = is_due ? TL_FLAG_RESET : 0;
        record.step++;
        if (is_due) {
            TEST_ASSERT_LESS_THAN_INT(32, count);
            resets[count++] = record.step;
        }
    }
}

static void test_a_twin_in_lock_is_left_alone(void) {
    run(0.5, 100 * WINDOW);
    TEST_ASSERT_EQUAL_INT(0, count);
}

/* Out of tolerance is not astray: a slightly wrong model must not be reset again and again. */
static void test_a_twin_that_is_a_little_off_is_left_alone(void) {
    run(4.9, 100 * WINDOW);
    TEST_ASSERT_EQUAL_INT(0, count);
}

static void test_a_twin_that_is_astray_begins_anew(void) {
    run(0.5, 5 * WINDOW);
    run(1000, 3 * PART);
    TEST_ASSERT_EQUAL_INT(1, count);
    TEST_ASSERT_EQUAL_INT64(5 * WINDOW + 3 * PART, resets[0]);
    run(0.5, 100 * WINDOW);
    TEST_ASSERT_EQUAL_INT(1, count);
}

/* After each reset without success, the pause doubles, up to ten minutes. */
static void test_ever_more_seldom(void) {
    run(1000, 100000);
    TEST_ASSERT_GREATER_THAN_INT(5, count);
    TEST_ASSERT_EQUAL_INT64(WINDOW, resets[0]);
    for (int i = 2; i < count; i++) {
        TEST_ASSERT_GREATER_THAN_INT64((resets[i - 1] - resets[i - 2]) * 3 / 2, resets[i] - resets[i - 1]);
    }
    run(1000, 400000);
    int before = count;
    run(1000, 2 * TL_LOCK_PAUSE_LAST * PART);
    TEST_ASSERT_INT_WITHIN(1, before + 2, count);
}

/* After some time in lock, the next reset does not wait. */
static void test_what_is_forgiven(void) {
    run(1000, 10000);
    int before = count;
    run(0.5, (TL_LOCK_RECOVERED + 20) * PART);
    run(1000, 3 * PART);
    TEST_ASSERT_EQUAL_INT(before + 1, count);
}

static void test_strokes_are_left_alone(void) {
    config.event.start.signal = "plant.valve";
    tl_recovery_init(&recovery, &config, &account);
    record.outcome = TL_NOMINAL;
    record.objective = 1e9;
    run(1000, 1000);
    TEST_ASSERT_EQUAL_INT(0, count);
}

/* These outputs are not finite in the steps. */
static void bad(uint64_t outputs, int steps) {
    record.bad_outputs = outputs;
    run(outputs == 0 ? 0.5 : (double)NAN, steps);
    record.bad_outputs = 0;
}

/* A reset after 10, 20, 40 … bad steps in a row; from 10 again after 100 good ones. */
static void test_outputs_that_are_not_finite(void) {
    static const int64_t expected[] = {10, 30, 70, 150};
    bad(1, 200);
    TEST_ASSERT_EQUAL_INT(4, count);
    TEST_ASSERT_EQUAL_INT64_ARRAY(expected, resets, 4);
    bad(0, TL_FINITE_STEPS - 1);
    bad(1, 9 + 10);
    TEST_ASSERT_EQUAL_INT(4, count);
    bad(0, TL_FINITE_STEPS);
    bad(2, 9);
    TEST_ASSERT_EQUAL_INT(4, count);
    bad(2, 1);
    TEST_ASSERT_EQUAL_INT(5, count);
}

/* Bad outputs also count for a free twin and with strokes. Outputs of weight 0, and steps of an
 * earlier run, do not count. */
static void test_which_outputs_count(void) {
    config.event.start.signal = "plant.valve";
    tl_recovery_init(&recovery, &config, &account);
    bad(1, 10);
    TEST_ASSERT_EQUAL_INT(1, count);
    config.event.start.signal = NULL;
    config.adjust_count = 0;
    tl_recovery_init(&recovery, &config, &account);
    bad(2, 10);
    TEST_ASSERT_EQUAL_INT(2, count);
    match[0].weight = 0;
    bad(1, 100);
    TEST_ASSERT_EQUAL_INT(2, count);
    record.outcome = TL_RESUMED;
    bad(2, 100);
    TEST_ASSERT_EQUAL_INT(2, count);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_twin_in_lock_is_left_alone);
    RUN_TEST(test_a_twin_that_is_a_little_off_is_left_alone);
    RUN_TEST(test_a_twin_that_is_astray_begins_anew);
    RUN_TEST(test_ever_more_seldom);
    RUN_TEST(test_what_is_forgiven);
    RUN_TEST(test_strokes_are_left_alone);
    RUN_TEST(test_outputs_that_are_not_finite);
    RUN_TEST(test_which_outputs_count);
    return UNITY_END();
}
