/* What a twin will take of the box, in words. */
#include <string.h>

#include <unity.h>

#include "firmware/retune/comparison.h"

static const uint64_t MEBIBYTE = (uint64_t)1 << 20;
static tl_trial_answer answer;
static char text[TL_FORECAST_TEXT];

void setUp(void) {
    answer = (tl_trial_answer){.step = TL_SECOND / 100,
                               .budget = 8 * TL_SECOND / 1000,
                               .least = TL_SECOND / 1000,
                               .worst = 5 * TL_SECOND / 1000,
                               .memory = 30 * MEBIBYTE};
}

void tearDown(void) {}

static void expect_time(const char *expected) {
    tl_forecast_write_time(&answer, text);
    TEST_ASSERT_EQUAL_STRING(expected, text);
}

static void test_the_words(void) {
    expect_time("a step takes 1 ms of 10 ms, and 5 ms with all of its search");
    answer.worst = INT64_MAX;
    expect_time(
        "a step takes 1 ms of 10 ms; all of its search would take more than the budget's 8 ms, and is cut short "
        "then");
    answer.worst = 0;
    expect_time("a step takes 1 ms of 10 ms");
    answer.least = 0;
    expect_time("how long a step takes is not known before it runs; it has 10 ms");
    tl_forecast_write_memory(&answer, 900 * MEBIBYTE, text);
    TEST_ASSERT_EQUAL_STRING("its twin takes 30 MiB of memory at most; the box has 900 MiB left", text);
    tl_forecast_write_memory(&answer, 29 * MEBIBYTE, text);
    TEST_ASSERT_EQUAL_STRING("its twin takes 30 MiB of memory at most; the box has 29 MiB left: this box does not "
                             "carry two twins",
                             text);
    tl_forecast_write_memory(&answer, 0, text);
    TEST_ASSERT_EQUAL_STRING("its twin takes 30 MiB of memory at most", text);
}

static void test_a_step_that_is_too_slow(void) {
    answer.least = answer.step;
    expect_time("a step takes 10 ms of 10 ms, and 5 ms with all of its search");
    answer.least = answer.step + 1;
    expect_time("a step takes 10 ms here without any search, and has 10 ms");
}

/* The kernel's own word. */
static void test_this_machine(void) {
    uint64_t left = tl_forecast_memory_left();
    TEST_ASSERT_TRUE(left > MEBIBYTE);
    TEST_ASSERT_TRUE(left < (uint64_t)1 << 50);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_words);
    RUN_TEST(test_a_step_that_is_too_slow);
    RUN_TEST(test_this_machine);
    return UNITY_END();
}
