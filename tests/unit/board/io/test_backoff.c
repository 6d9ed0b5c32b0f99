/* Waits that double after each failure. The test sets the clock. */
#include <unity.h>

#include "board/io/link.h"

void setUp(void) {}

void tearDown(void) {}

/* Not due 1 ns before the end of the wait, and due at the end. */
static void expect_wait(const tl_backoff *backoff, tl_time from, tl_time wait) {
    TEST_ASSERT_TRUE(tl_backoff_is_on(backoff));
    TEST_ASSERT_FALSE(tl_backoff_is_due(backoff, from));
    TEST_ASSERT_FALSE(tl_backoff_is_due(backoff, from + wait - 1));
    TEST_ASSERT_TRUE(tl_backoff_is_due(backoff, from + wait));
    TEST_ASSERT_TRUE(tl_backoff_is_due(backoff, from + 100 * wait));
}

static void test_nothing_has_failed(void) {
    const tl_backoff backoff = {.pause = 0};
    TEST_ASSERT_FALSE(tl_backoff_is_on(&backoff));
    TEST_ASSERT_TRUE(tl_backoff_is_due(&backoff, 0));
}

static void test_waits_double_up_to_the_last(void) {
    static const tl_time WAITS_MS[] = {100, 200, 400, 800, 1600, 2000, 2000, 2000};
    tl_backoff backoff = {.pause = 0};
    tl_time now = 5 * TL_SECOND;
    for (size_t i = 0; i < sizeof WAITS_MS / sizeof WAITS_MS[0]; i++) {
        tl_backoff_fail(&backoff, now);
        expect_wait(&backoff, now, WAITS_MS[i] * (TL_SECOND / 1000));
        now += 3 * TL_SECOND; /* after the end of the wait */
    }
}

/* A wait starts at the failure, not at the end of the previous wait. */
static void test_a_failure_before_the_wait_is_over(void) {
    tl_backoff backoff = {.pause = 0};
    tl_backoff_fail(&backoff, 0);
    tl_backoff_fail(&backoff, TL_SECOND / 100);
    expect_wait(&backoff, TL_SECOND / 100, 2 * TL_BACKOFF_FIRST);
}

static void test_reset_begins_anew(void) {
    tl_backoff backoff = {.pause = 0};
    for (int i = 0; i < 6; i++) {
        tl_backoff_fail(&backoff, 0);
    }
    tl_backoff_reset(&backoff);
    TEST_ASSERT_FALSE(tl_backoff_is_on(&backoff));
    TEST_ASSERT_TRUE(tl_backoff_is_due(&backoff, 0));
    tl_backoff_fail(&backoff, TL_SECOND);
    expect_wait(&backoff, TL_SECOND, TL_BACKOFF_FIRST);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_nothing_has_failed);
    RUN_TEST(test_waits_double_up_to_the_last);
    RUN_TEST(test_a_failure_before_the_wait_is_over);
    RUN_TEST(test_reset_begins_anew);
    return UNITY_END();
}
