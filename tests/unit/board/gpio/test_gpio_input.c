/* Debouncing, and readings from edges and levels. */
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "board/gpio/gpio_input.h"

#define MS (TL_SECOND / 1000)

static tl_gpio_input input;
static tl_reading reading;

void setUp(void) {
    memset(&input, 0xA5, sizeof input); /* start() must set every field */
}

void tearDown(void) {}

static void start(tl_time debounce, bool level) {
    const tl_gpio_input_settings settings = {.debounce = debounce, .level = level, .stamp = 100 * MS};
    tl_gpio_input_start(&input, &settings, &reading);
    TEST_ASSERT_EQUAL_DOUBLE(level ? 1 : 0, reading.value);
    TEST_ASSERT_EQUAL_INT64(100 * MS, reading.stamp);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, reading.quality);
}

static void expect_reading(bool some, double value, tl_time stamp) {
    TEST_ASSERT_TRUE(some);
    TEST_ASSERT_EQUAL_DOUBLE(value, reading.value);
    TEST_ASSERT_EQUAL_INT64(stamp, reading.stamp);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, reading.quality);
}

static bool edge(bool level, tl_time ms) {
    return tl_gpio_input_edge(&input, level, ms * MS, ms * MS, &reading);
}

/* ---- without debouncing ---- */

static void test_each_edge_counts(void) {
    start(0, false);
    expect_reading(edge(true, 101), 1, 101 * MS);
    expect_reading(edge(false, 102), 0, 102 * MS);
    expect_reading(edge(true, 103), 1, 103 * MS);
    TEST_ASSERT_EQUAL_UINT64(0, input.missed);
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_gpio_input_due(&input));
}

static void test_a_level_keeps_a_reading_young(void) {
    start(0, true);
    expect_reading(tl_gpio_input_level(&input, true, 110 * MS, &reading), 1, 110 * MS);
    expect_reading(tl_gpio_input_level(&input, true, 120 * MS, &reading), 1, 120 * MS);
    expect_reading(edge(false, 125), 0, 125 * MS);
    expect_reading(tl_gpio_input_level(&input, false, 130 * MS, &reading), 0, 130 * MS);
}

static void test_an_edge_that_is_on_its_way(void) {
    start(0, false);
    TEST_ASSERT_FALSE(tl_gpio_input_level(&input, true, 110 * MS, &reading));
    TEST_ASSERT_TRUE(input.doubtful);
    expect_reading(tl_gpio_input_edge(&input, true, 109 * MS, 111 * MS, &reading), 1, 109 * MS);
    TEST_ASSERT_FALSE(input.doubtful);
    TEST_ASSERT_EQUAL_UINT64(0, input.missed);
}

/* A line that was lost and found again keeps its count of missed edges. */
static void test_what_was_missed_before(void) {
    const tl_gpio_input_settings again = {.level = true, .stamp = 200 * MS, .missed = 7};
    tl_gpio_input_start(&input, &again, &reading);
    expect_reading(true, 1, 200 * MS);
    TEST_ASSERT_EQUAL_UINT64(7, input.missed);
    TEST_ASSERT_FALSE(edge(true, 201)); /* the falling edge before it was missed */
    TEST_ASSERT_EQUAL_UINT64(8, input.missed);
}

static void test_an_edge_that_was_missed(void) {
    start(0, false);
    TEST_ASSERT_FALSE(tl_gpio_input_level(&input, true, 110 * MS, &reading));
    expect_reading(tl_gpio_input_level(&input, true, 112 * MS, &reading), 1, 112 * MS);
    TEST_ASSERT_EQUAL_UINT64(1, input.missed);
}

static void test_doubt_that_goes_by(void) {
    start(0, false);
    TEST_ASSERT_FALSE(tl_gpio_input_level(&input, true, 110 * MS, &reading));
    expect_reading(tl_gpio_input_level(&input, false, 112 * MS, &reading), 0, 112 * MS);
    TEST_ASSERT_FALSE(tl_gpio_input_level(&input, true, 120 * MS, &reading)); /* first sign of a missed edge */
    TEST_ASSERT_EQUAL_UINT64(0, input.missed);
}

static void test_two_edges_to_the_same_level(void) {
    start(0, false);
    expect_reading(edge(true, 101), 1, 101 * MS);
    TEST_ASSERT_FALSE(edge(true, 103));
    TEST_ASSERT_EQUAL_UINT64(1, input.missed);
    expect_reading(edge(false, 104), 0, 104 * MS);
}

static void test_the_newest_level_wins(void) {
    start(0, false);
    expect_reading(tl_gpio_input_resync(&input, true, 110 * MS, &reading), 1, 110 * MS);
    TEST_ASSERT_EQUAL_UINT64(1, input.missed);
    TEST_ASSERT_FALSE(edge(true, 105)); /* late edges of the burst are dropped */
    TEST_ASSERT_FALSE(edge(false, 106));
    expect_reading(tl_gpio_input_resync(&input, true, 112 * MS, &reading), 1, 112 * MS);
    TEST_ASSERT_EQUAL_UINT64(1, input.missed);
}

static void test_stamps_never_go_back(void) {
    start(0, false);
    expect_reading(tl_gpio_input_level(&input, false, 120 * MS, &reading), 0, 120 * MS);
    expect_reading(edge(true, 110), 1, 120 * MS);
    expect_reading(edge(false, 130), 0, 130 * MS);
    /* Kernels before 5.7 stamp edges with the wall clock. */
    expect_reading(tl_gpio_input_edge(&input, true, 1700000000 * TL_SECOND, 140 * MS, &reading), 1, 140 * MS);
    expect_reading(edge(false, 150), 0, 150 * MS);
}

/* ---- with debouncing ---- */

static void test_a_bounce_counts_once(void) {
    start(5 * MS, false);
    TEST_ASSERT_FALSE(edge(true, 200));
    TEST_ASSERT_FALSE(edge(false, 201));
    TEST_ASSERT_FALSE(edge(true, 203));
    TEST_ASSERT_EQUAL_INT64(208 * MS, tl_gpio_input_due(&input));
    TEST_ASSERT_FALSE(tl_gpio_input_level(&input, true, 204 * MS, &reading)); /* too early */
    TEST_ASSERT_FALSE(tl_gpio_input_advance(&input, 208 * MS - 1, &reading));
    expect_reading(tl_gpio_input_advance(&input, 208 * MS, &reading), 1, 203 * MS);
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_gpio_input_due(&input));
    expect_reading(tl_gpio_input_level(&input, true, 210 * MS, &reading), 1, 210 * MS);
    TEST_ASSERT_EQUAL_UINT64(0, input.missed);
}

static void test_a_spike_counts_not_at_all(void) {
    start(5 * MS, false);
    TEST_ASSERT_FALSE(edge(true, 200));
    TEST_ASSERT_FALSE(edge(false, 201));
    TEST_ASSERT_FALSE(tl_gpio_input_advance(&input, 206 * MS, &reading));
    expect_reading(tl_gpio_input_level(&input, false, 207 * MS, &reading), 0, 207 * MS);
}

/* The driver reads the second edge late. The stamps show that the first level was stable long
 * enough. */
static void test_edges_that_are_read_late(void) {
    start(5 * MS, false);
    TEST_ASSERT_FALSE(edge(true, 200));
    expect_reading(edge(false, 205), 1, 200 * MS);
    expect_reading(edge(true, 300), 0, 205 * MS);
    expect_reading(tl_gpio_input_level(&input, true, 400 * MS, &reading), 1, 300 * MS);
}

static void test_a_line_that_is_never_still(void) {
    start(5 * MS, false);
    for (tl_time ms = 200; ms < 300; ms++) {
        TEST_ASSERT_FALSE(edge(ms % 2 == 0, ms));
        TEST_ASSERT_FALSE(tl_gpio_input_level(&input, ms % 2 == 0, ms * MS, &reading));
    }
    TEST_ASSERT_TRUE(input.debounce.pending);
}

static void test_a_missed_edge_begins_the_time_anew(void) {
    start(5 * MS, false);
    TEST_ASSERT_FALSE(edge(true, 200));
    TEST_ASSERT_FALSE(edge(true, 204)); /* the falling edge between them was missed */
    TEST_ASSERT_EQUAL_UINT64(1, input.missed);
    TEST_ASSERT_FALSE(tl_gpio_input_advance(&input, 206 * MS, &reading));
    expect_reading(tl_gpio_input_advance(&input, 209 * MS, &reading), 1, 204 * MS);
    TEST_ASSERT_FALSE(tl_gpio_input_resync(&input, true, 220 * MS, &reading)); /* the earlier level is unknown, too */
    expect_reading(tl_gpio_input_level(&input, true, 225 * MS, &reading), 1, 225 * MS);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_each_edge_counts);
    RUN_TEST(test_a_level_keeps_a_reading_young);
    RUN_TEST(test_an_edge_that_is_on_its_way);
    RUN_TEST(test_what_was_missed_before);
    RUN_TEST(test_an_edge_that_was_missed);
    RUN_TEST(test_doubt_that_goes_by);
    RUN_TEST(test_two_edges_to_the_same_level);
    RUN_TEST(test_the_newest_level_wins);
    RUN_TEST(test_stamps_never_go_back);
    RUN_TEST(test_a_bounce_counts_once);
    RUN_TEST(test_a_spike_counts_not_at_all);
    RUN_TEST(test_edges_that_are_read_late);
    RUN_TEST(test_a_line_that_is_never_still);
    RUN_TEST(test_a_missed_edge_begins_the_time_anew);
    return UNITY_END();
}
