/* Ages of the plant's values: which are counted, and percentiles within a bin of the true ones. */
#include "firmware/report/ages.h"

#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/random_numbers.h"

enum { SIGNALS = 6, VALUES = 1000 };

static tl_config_source source;
static tl_config_signal signals[SIGNALS];
static tl_config config;
static tl_sample sample;
static tl_ages ages;

void setUp(void) {
    memset(signals, 0, sizeof signals);
    memset(&sample, 0, sizeof sample);
    memset(&ages, 0, sizeof ages);
    config = (tl_config){.sources = &source, .source_count = 1, .signals = signals, .signal_count = 1};
    sample.instant = 1000 * TL_SECOND;
}

void tearDown(void) {}

static void add_age(tl_time age) {
    sample.instant += TL_SECOND;
    sample.stamps[0] = sample.instant - age;
    tl_ages_add_sample(&ages, &config, &sample);
}

static int compare_times(const void *one, const void *other) {
    const tl_time *a = one;
    const tl_time *b = other;
    return (*a > *b) - (*a < *b);
}

/* A percentile is the end of the bin that contains the true one. */
static void expect_percentile(tl_time age, unsigned percent) {
    tl_time found = tl_ages_percentile(&ages, percent);
    TEST_ASSERT_TRUE(found > age);
    TEST_ASSERT_TRUE(found - age <= age / 16 + 1024);
}

static void without_values_it_is_zero(void) {
    TEST_ASSERT_EQUAL_INT64(0, tl_ages_percentile(&ages, 50));
    TEST_ASSERT_EQUAL_INT64(0, tl_ages_percentile(&ages, 100));
}

static void percentiles_are_within_a_bin(void) {
    tl_test_random random = {.state = 3};
    static tl_time all[VALUES];
    for (int spread = 1; spread < 36; spread++) {
        memset(&ages, 0, sizeof ages);
        for (int i = 0; i < VALUES; i++) {
            all[i] = (tl_time)(tl_test_random_bits(&random) >> (64 - spread));
            add_age(all[i]);
        }
        qsort(all, VALUES, sizeof all[0], compare_times);
        expect_percentile(all[VALUES / 2 - 1], 50);
        expect_percentile(all[VALUES * 99 / 100 - 1], 99);
        TEST_ASSERT_EQUAL_UINT64(VALUES, ages.values);
    }
}

static void extremes_have_a_bin(void) {
    add_age(-5); /* later than its tick */
    TEST_ASSERT_EQUAL_INT64(1024, tl_ages_percentile(&ages, 100));
    sample.stamps[0] = INT64_MIN + 1;
    tl_ages_add_sample(&ages, &config, &sample);
    TEST_ASSERT_EQUAL_INT64((tl_time)1 << 36, tl_ages_percentile(&ages, 100));
    TEST_ASSERT_EQUAL_UINT64(2, ages.values);
}

/* Another process may have written any counts. */
static void any_content_is_safe(void) {
    memset(&ages, 0xff, sizeof ages);
    TEST_ASSERT_TRUE(tl_ages_percentile(&ages, 99) > 0);
    memset(ages.bins, 0, sizeof ages.bins);
    TEST_ASSERT_EQUAL_INT64((tl_time)1 << 36, tl_ages_percentile(&ages, 99));
}

static void each_reading_counts_once(void) {
    add_age(10);
    sample.instant += TL_SECOND;
    tl_ages_add_sample(&ages, &config, &sample);
    TEST_ASSERT_EQUAL_UINT64(1, ages.values);
}

static void only_live_values_of_the_tick_count(void) {
    config.signal_count = SIGNALS;
    signals[0].source = SIZE_MAX;
    signals[1].look_back = 1;
    signals[2].between = TL_BETWEEN_LINE;
    signals[3].condition.median = 3;
    sample.quality[4] = TL_STALE;
    for (size_t i = 0; i < SIGNALS; i++) {
        sample.stamps[i] = sample.instant - TL_SECOND;
    }
    tl_ages_add_sample(&ages, &config, &sample);
    TEST_ASSERT_EQUAL_UINT64(1, ages.values);
}

static void the_text(void) {
    char text[TL_AGES_TEXT];
    for (int i = 0; i < 98; i++) {
        add_age(10);
    }
    add_age(70 * TL_SECOND);
    add_age(70 * TL_SECOND);
    tl_ages_write(&ages, text);
    TEST_ASSERT_TRUE_MESSAGE(tl_test_has_line(text, "0.001 ms|p50|68719.477 ms|p99"), text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(without_values_it_is_zero);
    RUN_TEST(percentiles_are_within_a_bin);
    RUN_TEST(extremes_have_a_bin);
    RUN_TEST(any_content_is_safe);
    RUN_TEST(each_reading_counts_once);
    RUN_TEST(only_live_values_of_the_tick_count);
    RUN_TEST(the_text);
    return UNITY_END();
}
