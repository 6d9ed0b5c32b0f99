/* The limits of a correction: when its mean counts as outside, and since when. */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/limit_window.h"

static tl_limit_window window;
static tl_config_alarm alarm;
static int64_t step;

void setUp(void) {
    memset(&window, 0, sizeof window);
    alarm = (tl_config_alarm){.above = 0.3, .below = -0.3, .averaging_time = 160 * TL_SECOND};
    step = 0;
}

void tearDown(void) {}

/* Adds values, and returns the newest side that was judged. */
static tl_limit_side add(int64_t count, double value) {
    tl_limit_side newest = TL_LIMIT_UNKNOWN;
    for (int64_t i = 0; i < count; i++) {
        tl_limit_side side = tl_limit_window_add(&window, &alarm, TL_SECOND, step++, value);
        newest = side != TL_LIMIT_UNKNOWN ? side : newest;
    }
    return newest;
}

static void test_nothing_before_the_window_is_full(void) {
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_UNKNOWN, add(159, 1.0));
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(1, 1.0));
    TEST_ASSERT_EQUAL_INT64(0, window.onset);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, window.size);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, window.whole);
}

static void test_a_change(void) {
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_WITHIN, add(400, 0.1));
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_WITHIN, add(60, -1.1));  /* the mean is within until 5 parts are there */
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_UNKNOWN, add(10, -1.1)); /* 7 of 16 parts */
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(10, -1.1));
    TEST_ASSERT_EQUAL_INT64(400, window.onset);
    TEST_ASSERT_INT64_WITHIN(1, 6, window.spread);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, -1.1, window.size);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, -0.5, window.whole);
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_WITHIN, add(160, 0.1));
}

static void test_a_value_at_the_limit_is_within(void) {
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_WITHIN, add(160, 0.3));
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(160, 0.30001));
    alarm.above = HUGE_VAL;
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_WITHIN, add(160, 1e9));
}

/* A single step, however large, and some parts without the mean. */
static void test_a_spike(void) {
    (void)add(400, 0.0);
    (void)add(1, 1e6);
    for (int i = 0; i < 400; i++) {
        TEST_ASSERT_NOT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(1, 0.0));
    }
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_WITHIN, add(160, 0.0));
    for (int i = 0; i < 200; i++) { /* both sides: the mean is within */
        TEST_ASSERT_NOT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(1, 2.0));
        TEST_ASSERT_NOT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(1, -2.0));
    }
}

static void test_lengths(void) {
    alarm.averaging_time = TL_SECOND / 10; /* less than a step */
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(1, 1.0));
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_WITHIN, add(1, 0.0));
    setUp();
    alarm.averaging_time = 40 * TL_SECOND; /* 14 parts of 3 steps */
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_UNKNOWN, add(41, 1.0));
    TEST_ASSERT_EQUAL_INT(TL_LIMIT_OUTSIDE, add(1, 1.0));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_nothing_before_the_window_is_full);
    RUN_TEST(test_a_change);
    RUN_TEST(test_a_value_at_the_limit_is_within);
    RUN_TEST(test_a_spike);
    RUN_TEST(test_lengths);
    return UNITY_END();
}
