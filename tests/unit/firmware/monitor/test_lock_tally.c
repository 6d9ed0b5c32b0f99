/* The summary of the lock states, and when a run was locked long enough. */
#include <unity.h>

#include "firmware/monitor/lock_tally.h"
#include "tests/support/message.h"

void setUp(void) {}

void tearDown(void) {}

static void expect_parts(const char *parts, tl_lock_tally tally) {
    char text[TL_LOCK_SENTENCE];
    tl_lock_tally_write(&tally, "steps", text);
    TL_EXPECT_PARTS(parts, text);
}

static void test_the_summary(void) {
    expect_parts("no steps", (tl_lock_tally){0});
    expect_parts("100.0 %|7 steps|locked", (tl_lock_tally){.state = TL_LOCK_LOCKED, .steps = {[TL_LOCK_LOCKED] = 7}});
    expect_parts("65.0 %|100 steps|free 10.0 %|corrected 15.0 %|degraded 5.0 %|lost 20.0 %",
                 (tl_lock_tally){.state = TL_LOCK_LOST, .steps = {10, 50, 15, 5, 20}});
}

/* No data must not look like a perfect fit. */
static void test_a_run_that_was_never_locked(void) {
    expect_parts("never|signal", (tl_lock_tally){.steps = {[TL_LOCK_FREE] = 1000}});
    expect_parts("never|10 steps|lost 100.0 %", (tl_lock_tally){.state = TL_LOCK_LOST, .steps = {[TL_LOCK_LOST] = 10}});
}

static void test_what_is_enough(void) {
    const tl_lock_tally some = {.steps = {[TL_LOCK_LOCKED] = 90, [TL_LOCK_CORRECTED] = 5, [TL_LOCK_DEGRADED] = 5},
                                .windows = 9};
    TEST_ASSERT_EQUAL_DOUBLE(95, tl_lock_tally_percent(&some));
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&some, 0));
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&some, 95));
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&some, 95.1));
}

/* Without a percentage one step is enough to fail. A percentage ignores it. */
static void test_what_ran_away_is_not_enough(void) {
    const tl_lock_tally tally = {.steps = {[TL_LOCK_LOCKED] = 99, [TL_LOCK_LOST] = 1}, .ran_away = 1, .windows = 9};
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&tally, 0));
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&tally, 99));
    expect_parts("free|99.0 %|lost 1.0 %|1 of them", tally);
}

static void test_what_is_enough_at_least(void) {
    tl_lock_tally never = {.steps = {[TL_LOCK_FREE] = 5, [TL_LOCK_LOST] = 5}, .windows = 1};
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 0));
    expect_parts("never|10 steps|lost 50.0 %", never);
    never.steps[TL_LOCK_DEGRADED] = 100;
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 0));
    never.windows = 0;
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 0));
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 1));
    never.steps[TL_LOCK_LOCKED] = 1;
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&never, 0));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_summary);
    RUN_TEST(test_a_run_that_was_never_locked);
    RUN_TEST(test_what_is_enough);
    RUN_TEST(test_what_ran_away_is_not_enough);
    RUN_TEST(test_what_is_enough_at_least);
    return UNITY_END();
}
