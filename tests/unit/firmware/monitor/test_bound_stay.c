/* Time of a variable at a bound: reported once, ended at a lower share, and not judged before a
 * whole minute. */
#include <string.h>

#include <unity.h>

#include "firmware/monitor/lock_monitor.h"

static tl_bound_stay stay;
static tl_time now;
static int reached;
static int left;

void setUp(void) {
    memset(&stay, 0, sizeof stay);
    now = 0;
    reached = 0;
    left = 0;
}

void tearDown(void) {}

/* Steps of 0.1 s; `there` of ten are at the bound. */
static void pass(int seconds, int there) {
    for (int i = 0; i < 10 * seconds; i++) {
        tl_bound_stay_step(&stay, now, i % 10 < there);
        reached += stay.turn == TL_BOUND_REACHED ? 1 : 0;
        left += stay.turn == TL_BOUND_LEFT ? 1 : 0;
        now += TL_SECOND / 10;
    }
}

static void test_most_of_a_minute(void) {
    pass(60, 6);
    TEST_ASSERT_EQUAL_INT(0, reached);
    pass(7, 6);
    TEST_ASSERT_EQUAL_INT(1, reached);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.6, stay.share);
    pass(600, 4);
    TEST_ASSERT_EQUAL_INT(0, left);
    pass(600, 6);
    TEST_ASSERT_EQUAL_INT(1, reached);
    pass(600, 1);
    TEST_ASSERT_EQUAL_INT(1, left);
    pass(600, 10);
    TEST_ASSERT_EQUAL_INT(2, reached);
}

static void test_half_is_not_most(void) {
    pass(600, 5);
    TEST_ASSERT_EQUAL_INT(0, reached);
}

/* A run that starts at a late time still needs a whole minute. */
static void test_a_run_that_goes_on(void) {
    now = 1000000 * TL_SECOND;
    pass(54, 10);
    TEST_ASSERT_EQUAL_INT(0, reached);
    pass(20, 10);
    TEST_ASSERT_EQUAL_INT(1, reached);
}

/* After an hour without steps, earlier steps do not count. */
static void test_a_gap(void) {
    pass(120, 10);
    now += 3600 * TL_SECOND;
    pass(7, 0);
    TEST_ASSERT_EQUAL_INT(1, left);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_most_of_a_minute);
    RUN_TEST(test_half_is_not_most);
    RUN_TEST(test_a_run_that_goes_on);
    RUN_TEST(test_a_gap);
    return UNITY_END();
}
