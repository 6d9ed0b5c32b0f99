/* Text of the forecast of the time and the memory that a twin needs. */
#include <string.h>

#include <unity.h>

#include "firmware/retune/comparison.h"
#include "tests/support/message.h"

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

/* The text has all parts, and no other time. */
static void expect_time(const char *parts, size_t times) {
    size_t found = 0;
    tl_forecast_write_time(&answer, text);
    TL_EXPECT_PARTS(parts, text);
    for (const char *at = text; (at = strstr(at, " ms")) != NULL; at++) {
        found++;
    }
    TEST_ASSERT_EQUAL_size_t_MESSAGE(times, found, text);
}

static void expect_memory(uint64_t left, const char *parts) {
    tl_forecast_write_memory(&answer, left, text);
    TL_EXPECT_PARTS(parts, text);
}

static void test_time(void) {
    expect_time("1 ms|10 ms|5 ms|search", 3);
    answer.worst = INT64_MAX;
    expect_time("1 ms|10 ms|8 ms|search|budget", 3);
    answer.worst = 0;
    expect_time("1 ms|10 ms", 2);
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "search"));
    answer.least = 0;
    expect_time("10 ms|not known", 1);
}

static void test_memory(void) {
    expect_memory(900 * MEBIBYTE, "30 MiB|900 MiB");
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "two twins"));
    expect_memory(29 * MEBIBYTE, "30 MiB|29 MiB|two twins");
    expect_memory(0, "30 MiB"); /* the free memory is unknown */
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "0 MiB"));
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "two twins"));
}

static void test_a_step_that_is_too_slow(void) {
    answer.least = answer.step;
    expect_time("10 ms|5 ms", 3);
    answer.least = answer.step + 1;
    expect_time("10 ms|step_s", 2);
}

/* Reads the free memory of this machine. */
static void test_this_machine(void) {
    uint64_t left = tl_forecast_memory_left();
    TEST_ASSERT_TRUE(left > MEBIBYTE);
    TEST_ASSERT_TRUE(left < (uint64_t)1 << 50);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_time);
    RUN_TEST(test_memory);
    RUN_TEST(test_a_step_that_is_too_slow);
    RUN_TEST(test_this_machine);
    return UNITY_END();
}
