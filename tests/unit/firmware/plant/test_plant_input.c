/* Plant input: quality and value of each sample. */
#include <float.h>
#include <math.h>
#include <string.h>

#include <unity.h>

#include "firmware/plant/plant_input.h"

enum { SIGNALS = 2, DEPTH = 256 };

static tl_sample_buffer_slot slots[SIGNALS][DEPTH];
static uint64_t counts[SIGNALS];
static tl_plant_input input;
static tl_sample sample;

static void empty_buffers(void) {
    memset(slots, 0, sizeof slots);
    memset(counts, 0, sizeof counts);
}

void setUp(void) {
    empty_buffers();
    memset(&input, 0, sizeof input);
    memset(&sample, 0xA5, sizeof sample);
    input.count = 1;
    for (size_t i = 0; i < SIGNALS; i++) {
        input.buffers[i] = (tl_sample_buffer){.slots = slots[i], .count = &counts[i], .depth = DEPTH};
    }
    input.limits[0] = (tl_plant_limits){.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .stale = 0, .type = TL_REAL};
}

void tearDown(void) {}

static void post(double value, tl_time stamp, tl_quality quality) {
    tl_reading reading = {.value = value, .stamp = stamp, .quality = quality};
    tl_sample_buffer_post(&input.buffers[0], &reading);
}

/* Posts a value at 1000 and takes the sample at 1000. */
static void expect(double value, tl_quality quality) {
    empty_buffers();
    post(value, 1000, TL_GOOD);
    tl_plant_input_take(&input, 3, 1000, &sample);
    TEST_ASSERT_EQUAL_INT(quality, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(isfinite(value) ? value : 0, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(1000, sample.stamps[0]);
}

static void test_good(void) {
    expect(1.5, TL_GOOD);
    expect(-DBL_MAX, TL_GOOD);
    TEST_ASSERT_EQUAL_INT64(3, sample.tick);
}

static void test_never_read_is_no_link(void) {
    tl_plant_input_take(&input, 0, 1000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, sample.stamps[0]);
}

static void test_later_than_the_instant_is_not_seen(void) {
    post(1, 1001, TL_GOOD);
    tl_plant_input_take(&input, 0, 1000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
    tl_plant_input_take(&input, 1, 1001, &sample);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
}

/* ---- look-ups before the instant ---- */

static void take_back(tl_time back, bool next, tl_time instant) {
    input.looks[0] = (tl_plant_lookup){.back = back, .next = next};
    tl_plant_input_take(&input, 0, instant, &sample);
}

static void post_three(void) {
    post(1, 100, TL_GOOD);
    post(2, 200, TL_GOOD);
    post(3, 300, TL_GOOD);
}

static void test_looking_back(void) {
    post_three();
    take_back(50, false, 300);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(200, sample.stamps[0]);
    take_back(100, false, 300);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
    take_back(50, false, 149); /* no reading up to 99: the next one */
    TEST_ASSERT_EQUAL_DOUBLE(1, sample.values[0]);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    take_back(50, false, 99);
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
}

static void test_the_next_available(void) {
    post_three();
    take_back(100, true, 300);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
    take_back(99, true, 300);
    TEST_ASSERT_EQUAL_DOUBLE(3, sample.values[0]);
    take_back(99, true, 299); /* no next reading yet: the newest before */
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
    take_back(1000, true, 300);
    TEST_ASSERT_EQUAL_DOUBLE(1, sample.values[0]);
}

static void test_age_counts_from_where_it_is_looked_up(void) {
    input.limits[0].stale = 50;
    post(1, 100, TL_GOOD);
    take_back(100, true, 250);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    take_back(100, true, 251);
    TEST_ASSERT_EQUAL_INT(TL_STALE, sample.quality[0]);
    post(2, 400, TL_GOOD);
    take_back(100, true, 400);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
}

static void test_signals_are_apart(void) {
    input.count = 2;
    input.limits[1] = (tl_plant_limits){.minimum = 0, .maximum = 1, .type = TL_REAL};
    tl_reading reading = {.value = 2, .stamp = 5, .quality = TL_GOOD};
    tl_sample_buffer_post(&input.buffers[0], &reading);
    tl_sample_buffer_post(&input.buffers[1], &reading);
    tl_plant_input_take(&input, 0, 5, &sample);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    TEST_ASSERT_EQUAL_INT(TL_OUT_OF_RANGE, sample.quality[1]);
    TEST_ASSERT_EQUAL_INT(0xA5, sample.quality[2]); /* beyond count: unchanged */
}

static void test_range(void) {
    input.limits[0].minimum = -1;
    input.limits[0].maximum = 2;
    expect(-1, TL_GOOD);
    expect(2, TL_GOOD);
    expect(nextafter(-1, -2), TL_OUT_OF_RANGE);
    expect(nextafter(2, 3), TL_OUT_OF_RANGE);
}

static void test_not_a_number(void) {
    expect((double)NAN, TL_NOT_A_NUMBER);
    expect(HUGE_VAL, TL_NOT_A_NUMBER);
    expect(-HUGE_VAL, TL_NOT_A_NUMBER);
    post(7, 1001, TL_NOT_A_NUMBER); /* the driver's verdict counts; the value stays */
    tl_plant_input_take(&input, 0, 1001, &sample);
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(7, sample.values[0]);
}

static void test_no_link_stays(void) {
    input.limits[0].minimum = 10;
    input.limits[0].stale = 1;
    post(1, 1000, TL_NO_LINK);
    tl_plant_input_take(&input, 0, 9000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
    post((double)NAN, 1001, TL_NO_LINK);
    tl_plant_input_take(&input, 0, 9000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, sample.values[0]); /* 0 replaces a value that is not finite */
}

static void test_stale(void) {
    input.limits[0].stale = 100;
    post(1, 1000, TL_GOOD);
    tl_plant_input_take(&input, 0, 1100, &sample);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    tl_plant_input_take(&input, 1, 1101, &sample);
    TEST_ASSERT_EQUAL_INT(TL_STALE, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(1000, sample.stamps[0]);
    input.limits[0].stale = 0; /* 0: never stale */
    tl_plant_input_take(&input, 2, 1000 + TL_PLANT_FARTHEST, &sample);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
}

static void test_the_worst_counts(void) {
    input.limits[0].stale = 100;
    input.limits[0].maximum = 5;
    post(6, 1000, TL_GOOD);
    tl_plant_input_take(&input, 0, 5000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_OUT_OF_RANGE, sample.quality[0]);
    post(1, 1000, TL_OUT_OF_RANGE); /* the driver's verdict counts */
    tl_plant_input_take(&input, 0, 5000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_OUT_OF_RANGE, sample.quality[0]);
}

static void test_a_reading_after_a_forgotten_instant_is_not_stale(void) {
    input.limits[0].stale = 1;
    for (int i = 0; i <= DEPTH; i++) {
        post(i, 1000 + i, TL_GOOD);
    }
    tl_plant_input_take(&input, 0, 500, &sample); /* the oldest kept reading, which is later than this instant */
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    TEST_ASSERT_EQUAL_INT64(1001, sample.stamps[0]);
}

/* The writer is another process. Sanitizers detect an overflow of time differences. */
static void test_a_stamp_that_cannot_be(void) {
    static const tl_time HERE[] = {0, 1000, 1000000 * TL_SECOND};
    for (size_t i = 0; i < sizeof HERE / sizeof HERE[0]; i++) {
        const tl_time cannot[] = {INT64_MIN, INT64_MIN + 1, HERE[i] - TL_PLANT_FARTHEST - 1};
        input.limits[0].stale = 100;
        for (size_t j = 0; j < sizeof cannot / sizeof cannot[0]; j++) {
            empty_buffers();
            post(7, cannot[j], TL_GOOD);
            tl_plant_input_take(&input, 0, HERE[i], &sample);
            TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
            TEST_ASSERT_EQUAL_DOUBLE(0, sample.values[0]);
            TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, sample.stamps[0]);
        }
        post(7, HERE[i] - TL_PLANT_FARTHEST, TL_GOOD);
        tl_plant_input_take(&input, 0, HERE[i], &sample);
        TEST_ASSERT_EQUAL_INT(TL_STALE, sample.quality[0]);
        TEST_ASSERT_EQUAL_DOUBLE(7, sample.values[0]);
    }
}

/* The oldest kept reading is later than any sample. */
static void test_a_stamp_from_the_end_of_time(void) {
    post(7, INT64_MAX, TL_GOOD);
    counts[0] = 5 * DEPTH;
    slots[0][DEPTH - 1] = slots[0][0];
    slots[0][DEPTH - 1].sequence = 2 * counts[0];
    tl_plant_input_take(&input, 0, 1000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, sample.stamps[0]);
}

static void test_complete_once_all_signals_are_good(void) {
    const tl_reading bad = {.value = 2, .stamp = 5, .quality = TL_NO_LINK};
    const tl_reading good = {.value = 2, .stamp = 6, .quality = TL_GOOD};
    input.count = 2;
    TEST_ASSERT_FALSE(tl_plant_input_is_complete(&input));
    post(1, 5, TL_GOOD);
    TEST_ASSERT_FALSE(tl_plant_input_is_complete(&input));
    tl_sample_buffer_post(&input.buffers[1], &bad);
    TEST_ASSERT_FALSE(tl_plant_input_is_complete(&input));
    tl_sample_buffer_post(&input.buffers[1], &good);
    TEST_ASSERT_TRUE(tl_plant_input_is_complete(&input));
}

static void test_boolean(void) {
    input.limits[0].type = TL_BOOLEAN;
    expect(0, TL_GOOD);
    expect(1, TL_GOOD);
    expect(2, TL_OUT_OF_RANGE);
    expect(0.5, TL_OUT_OF_RANGE);
    expect(-1, TL_OUT_OF_RANGE);
}

static void test_integer(void) {
    const tl_type types[] = {TL_INTEGER, TL_ENUMERATION};
    for (size_t i = 0; i < 2; i++) {
        input.limits[0].type = types[i];
        expect(-3, TL_GOOD);
        expect(2147483647.0, TL_GOOD);
        expect(-2147483647.0, TL_GOOD);
        expect(2147483648.0, TL_OUT_OF_RANGE);
        expect(-2147483648.0, TL_OUT_OF_RANGE);
        expect(1.5, TL_OUT_OF_RANGE);
    }
}

/* Slightly beyond a limit: the value is moved to the limit. */
static void expect_moved(double value, double limit) {
    empty_buffers();
    post(value, 1000, TL_GOOD);
    tl_plant_input_take(&input, 3, 1000, &sample);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(limit, sample.values[0]);
    TEST_ASSERT_EQUAL_HEX64(1, sample.moved);
}

static void test_noise_at_a_limit(void) {
    input.limits[0] = (tl_plant_limits){.minimum = 0, .maximum = 50, .below = 0.5, .above = 0.25, .type = TL_REAL};
    expect_moved(-0.5, 0);
    expect_moved(50.25, 50);
    expect(-0.51, TL_OUT_OF_RANGE);
    expect(50.26, TL_OUT_OF_RANGE);
    expect(50, TL_GOOD);
    TEST_ASSERT_EQUAL_HEX64(0, sample.moved);
    expect(-0.0, TL_GOOD);
    TEST_ASSERT_TRUE(signbit(sample.values[0])); /* the sign of zero stays */
}

static void test_items(void) {
    input.limits[0] = (tl_plant_limits){.minimum = -1, .maximum = 62, .type = TL_INTEGER};
    input.limits[0].items = UINT64_C(1) << 63 | 0x5;
    expect(-1, TL_GOOD);
    expect(0, TL_OUT_OF_RANGE);
    expect(1, TL_GOOD);
    expect(62, TL_GOOD);
    expect(63, TL_OUT_OF_RANGE);
    expect(-2, TL_OUT_OF_RANGE);
}

/* ---- between readings ---- */

enum { STEP = 10000000 };

/* A lookup between readings, `back` before the instant. */
static void take_between(tl_between between, tl_time back, tl_time instant) {
    input.looks[0] = (tl_plant_lookup){.back = back, .between = between, .span = STEP};
    tl_plant_input_take(&input, 1, instant, &sample);
}

static void expect_between(double value, tl_time stamp, tl_quality quality) {
    TEST_ASSERT_EQUAL_DOUBLE(value, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(stamp, sample.stamps[0]);
    TEST_ASSERT_EQUAL_INT(quality, sample.quality[0]);
}

/* 1 at 0, 5 at 4 steps, 3 at 6 steps. */
static void post_messages(void) {
    post(1, 0, TL_GOOD);
    post(5, 4 * STEP, TL_GOOD);
    post(3, 6 * STEP, TL_GOOD);
}

static void test_a_line_between_two_readings(void) {
    post_messages();
    take_between(TL_BETWEEN_LINE, 4 * STEP, 5 * STEP);
    expect_between(2, STEP, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 9 * STEP);
    expect_between(4, 5 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 8 * STEP);
    expect_between(5, 4 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_LAST, 4 * STEP, 9 * STEP);
    expect_between(5, 4 * STEP, TL_GOOD);
}

static void test_a_next_reading_that_has_not_come(void) {
    post_messages();
    take_between(TL_BETWEEN_LINE, STEP, 4 * STEP); /* it has just come */
    expect_between(4, 3 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_LINE, STEP, 3 * STEP);
    expect_between(1, 0, TL_GOOD);
    take_between(TL_BETWEEN_LINE, STEP, 7 * STEP + 1);
    expect_between(3, 6 * STEP, TL_GOOD);
    input.limits[0].stale = STEP;
    take_between(TL_BETWEEN_LINE, STEP, 9 * STEP);
    expect_between(3, 6 * STEP, TL_STALE);
}

static void test_no_line_over_a_gap(void) {
    post_messages();
    input.limits[0].stale = 3 * STEP;
    take_between(TL_BETWEEN_LINE, 4 * STEP, 7 * STEP); /* the readings are 4 steps apart */
    expect_between(1, 0, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 7 * STEP + STEP / 2);
    expect_between(1, 0, TL_STALE);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 9 * STEP);
    expect_between(4, 5 * STEP, TL_GOOD);
}

static void test_no_line_to_or_from_what_is_bad(void) {
    post(1, 0, TL_GOOD);
    post(100, 4 * STEP, TL_GOOD);
    post(3, 6 * STEP, TL_GOOD);
    post(0, 8 * STEP, TL_NO_LINK);
    input.limits[0].maximum = 10;
    take_between(TL_BETWEEN_LINE, 4 * STEP, 6 * STEP);
    expect_between(1, 0, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 9 * STEP);
    expect_between(100, 4 * STEP, TL_OUT_OF_RANGE);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 11 * STEP);
    expect_between(3, 6 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 12 * STEP);
    expect_between(0, 8 * STEP, TL_NO_LINK);
}

static void test_no_line_before_the_first_reading(void) {
    post(1, 2 * STEP, TL_GOOD);
    post(5, 4 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 4 * STEP, 5 * STEP);
    expect_between(1, 2 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_MEAN, 4 * STEP, 5 * STEP);
    expect_between(1, 2 * STEP, TL_GOOD);
}

/* If the difference of two readings overflows, there is no line between them. */
static void test_a_line_that_would_be_endless(void) {
    post(-DBL_MAX, 0, TL_GOOD);
    post(DBL_MAX, 2 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 2 * STEP, 3 * STEP);
    expect_between(-DBL_MAX, 0, TL_GOOD);
    take_between(TL_BETWEEN_MEAN, 2 * STEP, 3 * STEP);
    expect_between(0, STEP + STEP / 2, TL_GOOD); /* the mean over the whole line */
}

/* The mean of the line over one step, also across a reading. */
static void test_a_mean_over_a_step(void) {
    post_messages();
    take_between(TL_BETWEEN_MEAN, 5 * STEP, 6 * STEP);
    expect_between(2.5, STEP + STEP / 2, TL_GOOD);
    take_between(TL_BETWEEN_MEAN, 5 * STEP, 8 * STEP + STEP / 2); /* from 3.5 to 4.5: 4.5 to 5 to 4.5 */
    expect_between(4.75, 4 * STEP, TL_GOOD);
    take_between(TL_BETWEEN_MEAN, 2 * STEP, 7 * STEP + STEP / 2); /* 3.5 to 3 at 6, then 3 held */
    expect_between(3.125, 6 * STEP, TL_GOOD);
    input.limits[0].stale = STEP;
    take_between(TL_BETWEEN_MEAN, 2 * STEP, 10 * STEP);
    expect_between(3, 6 * STEP, TL_STALE);
}

/* A thousand readings in a step: the first 256 count, then one line to the last. */
static void test_a_mean_of_a_flood(void) {
    static tl_sample_buffer_slot many[2048];
    input.buffers[0] = (tl_sample_buffer){.slots = many, .count = &counts[0], .depth = 2048};
    for (int i = 0; i <= 1000; i++) {
        post(2, i * (STEP / 1000), TL_GOOD);
    }
    take_between(TL_BETWEEN_MEAN, STEP, STEP);
    expect_between(2, STEP / 2, TL_GOOD);
}

/* ---- stamps of one instant ---- */

static void test_a_stamp_that_is_a_little_late_is_of_the_instant(void) {
    post(1, 0, TL_GOOD);
    post(2, STEP + TL_PLANT_ALIKE, TL_GOOD);
    post(3, 2 * STEP + TL_PLANT_ALIKE + 1, TL_GOOD);
    take_between(TL_BETWEEN_LAST, 0, STEP);
    expect_between(2, STEP + TL_PLANT_ALIKE, TL_GOOD);
    take_between(TL_BETWEEN_LAST, 0, 2 * STEP);
    expect_between(2, STEP + TL_PLANT_ALIKE, TL_GOOD);
    take_between(TL_BETWEEN_LINE, 2 * STEP, 3 * STEP);
    expect_between(2, STEP + TL_PLANT_ALIKE, TL_GOOD);
}

static void test_a_stamp_that_is_a_little_early_is_not_before_the_next_one(void) {
    post(1, 0, TL_GOOD);
    post(2, STEP - TL_PLANT_ALIKE, TL_GOOD);
    post(3, 2 * STEP, TL_GOOD);
    input.looks[0] = (tl_plant_lookup){.back = STEP, .next = true};
    tl_plant_input_take(&input, 1, 2 * STEP, &sample);
    expect_between(2, STEP - TL_PLANT_ALIKE, TL_GOOD);
    take_between(TL_BETWEEN_LINE, STEP, 2 * STEP);
    expect_between(2, STEP - TL_PLANT_ALIKE, TL_GOOD);
}

/* ---- conditioned ---- */

/* Line between readings with half an interval of waiting. Signal 1 shows the readings of signal
 * 0. */
static void open_conditioned(tl_condition condition, tl_time back) {
    input.count = 2;
    input.limits[1] = input.limits[0];
    input.looks[0] = (tl_plant_lookup){.back = back, .between = TL_BETWEEN_LINE};
    input.looks[1] = (tl_plant_lookup){.shows = true, .shown = 0};
    input.conditions[0] = condition;
    TEST_ASSERT_TRUE(tl_plant_input_open(&input));
}

static void expect_shown(double value, tl_time stamp, tl_quality quality) {
    TEST_ASSERT_EQUAL_DOUBLE(value, sample.values[1]);
    TEST_ASSERT_EQUAL_INT64(stamp, sample.stamps[1]);
    TEST_ASSERT_EQUAL_INT(quality, sample.quality[1]);
}

/* The line skips a rejected reading. The signal that shows the readings has it unchanged. */
static void test_a_line_skips_what_is_rejected(void) {
    open_conditioned((tl_condition){.gate = 5}, 100);
    post(10, 100, TL_GOOD);
    post(90, 200, TL_GOOD);
    post(14, 300, TL_GOOD);
    tl_plant_input_take(&input, 0, 250, &sample); /* at 150 only the first one counts */
    TEST_ASSERT_EQUAL_DOUBLE(10, sample.values[0]);
    expect_shown(90, 200, TL_OUTLIER);
    tl_plant_input_take(&input, 0, 300, &sample); /* at 200 */
    TEST_ASSERT_EQUAL_DOUBLE(12, sample.values[0]);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    expect_shown(14, 300, TL_GOOD);
    tl_plant_input_take(&input, 0, 350, &sample);
    expect_shown(14, 300, TL_GOOD);
    tl_plant_input_close(&input);
}

/* As with a gate: an outlier is shown and has no effect. A step without a next reading counts when four
 * intervals have passed. */
static void test_an_outlier_without_a_gate(void) {
    open_conditioned((tl_condition){.leap = 5}, 100);
    post(10, 100, TL_GOOD);
    post(12, 200, TL_GOOD);
    post(90, 300, TL_GOOD);
    tl_plant_input_take(&input, 0, 300, &sample);
    expect_shown(90, 300, TL_OUTLIER);
    post(14, 400, TL_GOOD);
    post(90, 500, TL_GOOD);
    tl_plant_input_take(&input, 0, 400, &sample); /* at 300 */
    TEST_ASSERT_EQUAL_DOUBLE(13, sample.values[0]);
    tl_plant_input_take(&input, 0, 903, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(14, sample.values[0]);
    tl_plant_input_take(&input, 0, 904, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(90, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(500, sample.stamps[0]);
    tl_plant_input_close(&input);
}

/* Each reading of a tick is taken. If one is rejected, that one is shown. */
static void test_several_readings_in_a_tick(void) {
    open_conditioned((tl_condition){.gate = 5, .median = 3}, 30);
    for (int i = 0; i < 9; i++) {
        post(i == 5 ? 77 : i, 10 * (i + 1), TL_GOOD);
    }
    tl_plant_input_take(&input, 0, 90, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(5, sample.values[0]); /* between the medians of 3, 4, 6 at 50 and of 4, 6, 7 at 70 */
    expect_shown(77, 60, TL_OUTLIER);
    tl_plant_input_close(&input);
}

/* A repeated reading counts once. A reading with an older stamp than its predecessor does not
 * count. */
static void test_a_reading_again_is_no_reading(void) {
    open_conditioned((tl_condition){.median = 3}, 0);
    post(1, 10, TL_GOOD);
    post(9, 20, TL_GOOD);
    post(9, 20, TL_GOOD);
    post(9, 15, TL_GOOD);
    post(2, 30, TL_GOOD);
    tl_plant_input_take(&input, 0, 30, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(20, sample.stamps[0]);
    tl_plant_input_close(&input);
}

/* A late tick gets the same sample as one in time. */
static void test_a_tick_that_was_missed_sees_the_same(void) {
    static tl_sample in_time[40];
    const tl_condition condition = {.gate = 20, .median = 3, .low_pass = 7};
    for (int late = 0; late < 2; late++) {
        empty_buffers();
        open_conditioned(condition, 25);
        for (int i = 0; i < 40; i++) {
            for (int k = 0; late == 0 ? k < 3 : i == 0 && k < 120; k++) {
                int n = late == 0 ? 3 * i + k : k;
                post(n % 17 == 3 ? 200 : n % 5, n * 4 + 1, TL_GOOD);
            }
            tl_plant_input_take(&input, i + 1, 12 * i + 9 - TL_PLANT_ALIKE, &sample);
            for (size_t s = 0; s < 2 && late != 0; s++) {
                TEST_ASSERT_EQUAL_MEMORY(&in_time[i].values[s], &sample.values[s], sizeof sample.values[s]);
                TEST_ASSERT_EQUAL_INT64(in_time[i].stamps[s], sample.stamps[s]);
                TEST_ASSERT_EQUAL_UINT8(in_time[i].quality[s], sample.quality[s]);
            }
            in_time[i] = sample;
        }
        tl_plant_input_close(&input);
    }
}

/* A ramp after a low-pass equals the ramp at each instant, because its delay is looked up too. */
static void test_a_low_pass_is_looked_up_where_it_belongs(void) {
    open_conditioned((tl_condition){.low_pass = 300}, 1000);
    for (int i = 0; i < 100; i++) {
        post(3.0 * (500 * i + i % 3), 500 * i + i % 3, TL_GOOD);
    }
    for (tl_time at = 10000; at < 40000; at += 37) {
        tl_plant_input_take(&input, 0, at + 1000, &sample);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0 * (double)at, sample.values[0]);
        TEST_ASSERT_EQUAL_INT64(at, sample.stamps[0]);
    }
    tl_plant_input_close(&input);
}

/* The last reading is held: the output of the low-pass belongs to τ before it. */
static void test_a_low_pass_whose_next_reading_has_not_come(void) {
    open_conditioned((tl_condition){.low_pass = 300}, 1000);
    input.limits[0].stale = 2000;
    post(5, 1000, TL_GOOD);
    tl_plant_input_take(&input, 0, 2700, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(5, sample.values[0]);
    TEST_ASSERT_EQUAL_INT64(700, sample.stamps[0]);
    tl_plant_input_take(&input, 0, 3700, &sample);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    tl_plant_input_take(&input, 0, 3701, &sample);
    TEST_ASSERT_EQUAL_INT(TL_STALE, sample.quality[0]);
    tl_plant_input_close(&input);
}

/* Extreme stamps, whose differences exceed the range of a time. */
static void test_conditioned_stamps_beyond_all(void) {
    open_conditioned((tl_condition){.gate = 5, .median = 3, .low_pass = 10}, 10);
    post(1, INT64_MIN + 1, TL_GOOD);
    post(2, 20, TL_GOOD);
    post(3, INT64_MAX, TL_GOOD);
    post(2, 30, TL_GOOD);
    tl_plant_input_take(&input, 0, 40, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
    expect_shown(2, 30, TL_GOOD);
    tl_plant_input_close(&input);
}

/* A run may get another sample buffer. */
static void test_another_buffer(void) {
    open_conditioned((tl_condition){.median = 3}, 0);
    post(1, 10, TL_GOOD);
    post(2, 20, TL_GOOD);
    tl_plant_input_take(&input, 0, 20, &sample);
    input.buffers[0] = input.buffers[1];
    post(7, 20, TL_GOOD);
    post(3, 30, TL_GOOD);
    tl_plant_input_take(&input, 0, 30, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[0]);
    expect_shown(3, 30, TL_GOOD);
    tl_plant_input_close(&input);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_good);
    RUN_TEST(test_never_read_is_no_link);
    RUN_TEST(test_later_than_the_instant_is_not_seen);
    RUN_TEST(test_looking_back);
    RUN_TEST(test_the_next_available);
    RUN_TEST(test_age_counts_from_where_it_is_looked_up);
    RUN_TEST(test_signals_are_apart);
    RUN_TEST(test_range);
    RUN_TEST(test_not_a_number);
    RUN_TEST(test_no_link_stays);
    RUN_TEST(test_stale);
    RUN_TEST(test_the_worst_counts);
    RUN_TEST(test_a_reading_after_a_forgotten_instant_is_not_stale);
    RUN_TEST(test_a_stamp_that_cannot_be);
    RUN_TEST(test_a_stamp_from_the_end_of_time);
    RUN_TEST(test_complete_once_all_signals_are_good);
    RUN_TEST(test_boolean);
    RUN_TEST(test_integer);
    RUN_TEST(test_noise_at_a_limit);
    RUN_TEST(test_items);
    RUN_TEST(test_a_line_between_two_readings);
    RUN_TEST(test_a_next_reading_that_has_not_come);
    RUN_TEST(test_no_line_over_a_gap);
    RUN_TEST(test_no_line_to_or_from_what_is_bad);
    RUN_TEST(test_no_line_before_the_first_reading);
    RUN_TEST(test_a_line_that_would_be_endless);
    RUN_TEST(test_a_mean_over_a_step);
    RUN_TEST(test_a_mean_of_a_flood);
    RUN_TEST(test_a_stamp_that_is_a_little_late_is_of_the_instant);
    RUN_TEST(test_a_stamp_that_is_a_little_early_is_not_before_the_next_one);
    RUN_TEST(test_a_line_skips_what_is_rejected);
    RUN_TEST(test_an_outlier_without_a_gate);
    RUN_TEST(test_several_readings_in_a_tick);
    RUN_TEST(test_a_reading_again_is_no_reading);
    RUN_TEST(test_a_tick_that_was_missed_sees_the_same);
    RUN_TEST(test_a_low_pass_is_looked_up_where_it_belongs);
    RUN_TEST(test_a_low_pass_whose_next_reading_has_not_come);
    RUN_TEST(test_conditioned_stamps_beyond_all);
    RUN_TEST(test_another_buffer);
    return UNITY_END();
}
