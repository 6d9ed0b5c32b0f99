/* What a twin will take of the box, in words, and whether that can be. */
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
    tl_forecast_write_memory(&answer, 0, text);
    TEST_ASSERT_EQUAL_STRING("its twin takes 30 MiB of memory at most", text);
}

static void test_what_can_be(void) {
    TEST_ASSERT_EQUAL_INT(TL_FORECAST_POSSIBLE, tl_forecast_of(&answer, 30 * MEBIBYTE, text));
    TEST_ASSERT_EQUAL_INT(TL_FORECAST_POSSIBLE, tl_forecast_of(&answer, 0, text));
    answer.least = answer.step;
    answer.worst = INT64_MAX; /* is cut short by the budget */
    TEST_ASSERT_EQUAL_INT(TL_FORECAST_POSSIBLE, tl_forecast_of(&answer, 0, text));
}

static void test_what_cannot_be(void) {
    TEST_ASSERT_EQUAL_INT(TL_FORECAST_NO_MEMORY, tl_forecast_of(&answer, 29 * MEBIBYTE, text));
    TEST_ASSERT_EQUAL_STRING("its twin takes 30 MiB of memory, and the box has 29 MiB left", text);
    answer.least = answer.step + 1;
    TEST_ASSERT_EQUAL_INT(TL_FORECAST_TOO_SLOW, tl_forecast_of(&answer, 0, text));
    TEST_ASSERT_EQUAL_STRING("a step takes 10 ms here without any search, and has 10 ms", text);
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
    RUN_TEST(test_what_can_be);
    RUN_TEST(test_what_cannot_be);
    RUN_TEST(test_this_machine);
    return UNITY_END();
}
