/* Envelope of long curves: it keeps extremes, order and gaps, with constant memory. */
#include <math.h>

#include <unity.h>

#include "firmware/report/envelope.h"
#include "tests/support/random_numbers.h"

enum { ROOM = 16, STEPS = 5000 };

static tl_envelope envelope;
static tl_error error;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_envelope_init(&envelope, 2, ROOM, &error));
}

void tearDown(void) {
    tl_envelope_free(&envelope);
}

static void expect_pair(size_t channel, size_t bucket, double first, double second) {
    double pair[2];
    tl_envelope_get(&envelope, channel, bucket, pair);
    TEST_ASSERT_EQUAL_DOUBLE(first, pair[0]);
    TEST_ASSERT_EQUAL_DOUBLE(second, pair[1]);
}

static void expect_gap(size_t channel, size_t bucket) {
    double pair[2];
    tl_envelope_get(&envelope, channel, bucket, pair);
    TEST_ASSERT_TRUE(isnan(pair[0]) && isnan(pair[1]));
}

static void test_a_short_curve_is_kept_as_it_is(void) {
    for (int64_t i = 0; i < ROOM; i++) {
        tl_envelope_put(&envelope, 0, i, (double)i / 3.0);
    }
    TEST_ASSERT_EQUAL_INT64(1, envelope.width);
    TEST_ASSERT_EQUAL_size_t(ROOM, envelope.used);
    for (size_t i = 0; i < ROOM; i++) {
        expect_pair(0, i, (double)i / 3.0, (double)i / 3.0);
        expect_gap(1, i);
    }
}

static void test_one_step_more_doubles_the_width(void) {
    for (int64_t i = 0; i <= ROOM; i++) {
        tl_envelope_put(&envelope, 0, i, i % 2 == 0 ? (double)i : -(double)i);
    }
    TEST_ASSERT_EQUAL_INT64(2, envelope.width);
    TEST_ASSERT_EQUAL_size_t(ROOM / 2 + 1, envelope.used);
    TEST_ASSERT_EQUAL_INT64(ROOM + 1, envelope.steps);
    expect_pair(0, 0, 0.0, -1.0); /* the largest came first */
    expect_pair(0, 3, 6.0, -7.0);
    expect_pair(0, ROOM / 2, ROOM, ROOM);
}

/* The pair of a bucket equals the extremes of all its steps. */
static void expect_envelope(const double *values, size_t bucket, size_t width) {
    size_t least = bucket * width;
    size_t largest = bucket * width;
    for (size_t i = bucket * width; i < (bucket + 1) * width && i < STEPS; i++) {
        least = values[i] < values[least] ? i : least;
        largest = values[i] > values[largest] ? i : largest;
    }
    expect_pair(0, bucket, values[least < largest ? least : largest], values[least < largest ? largest : least]);
}

static void test_no_extreme_is_lost(void) {
    static double values[STEPS];
    tl_test_random random = {7};
    for (int round = 0; round < 20; round++) {
        tl_envelope_free(&envelope);
        setUp();
        for (size_t i = 0; i < STEPS; i++) {
            values[i] = tl_test_random_number(&random, -1.0, 1.0);
            tl_envelope_put(&envelope, 0, (int64_t)i, values[i]);
        }
        TEST_ASSERT_EQUAL_INT64(512, envelope.width);
        TEST_ASSERT_EQUAL_size_t(10, envelope.used);
        for (size_t bucket = 0; bucket < envelope.used; bucket++) {
            expect_envelope(values, bucket, 512);
        }
    }
}

static void test_a_gap_stays_a_gap(void) {
    tl_envelope_put(&envelope, 0, 0, 1.0);
    tl_envelope_put(&envelope, 0, 5, (double)NAN);
    tl_envelope_put(&envelope, 0, 6, (double)INFINITY);
    tl_envelope_put(&envelope, 0, 100, 2.0); /* width 8 */
    TEST_ASSERT_EQUAL_INT64(8, envelope.width);
    expect_pair(0, 0, 1.0, 1.0);
    for (size_t i = 1; i < 12; i++) {
        expect_gap(0, i);
    }
    expect_pair(0, 12, 2.0, 2.0);
}

static void test_half_of_a_gap_does_not_hide_the_other(void) {
    tl_envelope_put(&envelope, 0, 1, 3.0);
    tl_envelope_put(&envelope, 0, 2, 4.0);
    tl_envelope_put(&envelope, 0, ROOM, 5.0);
    expect_pair(0, 0, 3.0, 3.0);
    expect_pair(0, 1, 4.0, 4.0);
}

/* As if a database is read table by table. */
static void test_a_channel_that_comes_later(void) {
    for (int64_t i = 0; i < 4 * ROOM; i++) {
        tl_envelope_put(&envelope, 0, i, 1.0);
    }
    for (int64_t i = 0; i < 4 * ROOM; i++) {
        tl_envelope_put(&envelope, 1, i, (double)i);
    }
    expect_pair(1, 0, 0.0, 3.0);
    expect_pair(1, ROOM - 1, 4.0 * ROOM - 4.0, 4.0 * ROOM - 1.0);
}

static void test_marks_are_joined(void) {
    tl_envelope_mark(&envelope, 0, 0, 1);
    tl_envelope_mark(&envelope, 0, 1, 4);
    tl_envelope_mark(&envelope, 1, 2, 2);
    TEST_ASSERT_EQUAL_UINT8(4, tl_envelope_marks(&envelope, 0, 1));
    tl_envelope_put(&envelope, 0, ROOM, 0.0);
    TEST_ASSERT_EQUAL_UINT8(5, tl_envelope_marks(&envelope, 0, 0));
    TEST_ASSERT_EQUAL_UINT8(0, tl_envelope_marks(&envelope, 0, 1));
    TEST_ASSERT_EQUAL_UINT8(2, tl_envelope_marks(&envelope, 1, 1));
}

static void test_a_position_far_away(void) {
    tl_envelope_put(&envelope, 0, 0, 1.0);
    tl_envelope_put(&envelope, 0, INT64_MAX / 4, 2.0);
    TEST_ASSERT_LESS_OR_EQUAL_size_t(ROOM, envelope.used);
    expect_pair(0, 0, 1.0, 1.0);
    expect_pair(0, envelope.used - 1, 2.0, 2.0);
}

static void test_no_channels(void) {
    tl_envelope none;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_envelope_init(&none, 0, ROOM, &error));
    tl_envelope_free(&none);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_short_curve_is_kept_as_it_is);
    RUN_TEST(test_one_step_more_doubles_the_width);
    RUN_TEST(test_no_extreme_is_lost);
    RUN_TEST(test_a_gap_stays_a_gap);
    RUN_TEST(test_half_of_a_gap_does_not_hide_the_other);
    RUN_TEST(test_a_channel_that_comes_later);
    RUN_TEST(test_marks_are_joined);
    RUN_TEST(test_a_position_far_away);
    RUN_TEST(test_no_channels);
    return UNITY_END();
}
