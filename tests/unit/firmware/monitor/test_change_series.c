/* Change detection in made-up series: false alarms, size, share, onset, return, gaps. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/change_series.h"

enum { DAY = 86400 };

static const double LEAST = 1e-6;
static const double CORRELATED = 0.9; /* of a value with the one before */

static tl_change_series series;
static uint64_t random_state;
static double noise;
static int found;          /* changes */
static int settled;        /* of these, not only a better estimate of the one before */
static double first_onset; /* of the first change */
static int off;            /* values at which the series was off */

void setUp(void) {
    noise = 0.0;
    found = 0;
    settled = 0;
    off = 0;
    first_onset = -1.0;
}

void tearDown(void) {}

static double uniform(void) {
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return (double)(random_state >> 11) / 9007199254740992.0;
}

/* Correlated noise with deviation 1. */
static double draw(void) {
    double sum = 0.0;
    for (int i = 0; i < 12; i++) {
        sum += uniform() - 0.5;
    }
    noise = CORRELATED * noise + sqrt(1.0 - CORRELATED * CORRELATED) * sum;
    return noise;
}

static void begin(uint32_t block, unsigned seed) {
    random_state = 0x9E3779B97F4A7C15U * (seed + 1);
    const uint64_t blocks = DAY / block;
    tl_change_series_init(&series, block, blocks, 1.0 / (365.0 * (double)blocks), LEAST);
}

static void add(int64_t second, double value, double reference) {
    tl_series_turn turn = tl_change_series_add(&series, second, value, reference);
    if (turn == TL_SERIES_CHANGED) {
        found++;
        first_onset = found == 1 ? series.onset : first_onset;
    }
    settled += turn == TL_SERIES_SETTLED && !series.is_same ? 1 : 0;
}

/* Noise with a shift from `at` to `until`. */
static void add_shifted(int64_t seconds, double shift, int64_t at, int64_t until) {
    for (int64_t i = 0; i < seconds; i++) {
        add(i, draw() + (i >= at && i < until ? shift : 0.0), 0.0);
    }
}

static void test_no_false_alarm_in_ten_days(void) {
    const uint32_t blocks[] = {10, 30, 120};
    for (unsigned seed = 0; seed < 3; seed++) {
        for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) {
            begin(blocks[i], seed);
            add_shifted(10 * (int64_t)DAY, 0.0, 0, 0);
            TEST_ASSERT_TRUE(tl_change_series_is_ready(&series));
            TEST_ASSERT_EQUAL_INT(0, found);
        }
    }
}

/* The mean swings once a day, as with the temperature of the surroundings. */
static void test_no_false_alarm_with_a_daily_cycle(void) {
    const double day = DAY;
    begin(30, 1);
    for (int64_t i = 0; i < 10 * (int64_t)DAY; i++) {
        add(i, draw() + 2.0 * sin(2.0 * 3.14159265358979 * (double)i / day), 0.0);
    }
    TEST_ASSERT_EQUAL_INT(0, found);
}

static void test_nothing_is_said_while_learning(void) {
    begin(30, 2);
    add_shifted(DAY - 30, 5.0, DAY / 2, DAY);
    TEST_ASSERT_FALSE(tl_change_series_is_ready(&series));
    TEST_ASSERT_EQUAL_INT(0, found);
}

/* A shift by one and a half deviations of the noise, in both directions. */
static void test_a_shift_is_found_once(void) {
    for (int sign = -1; sign <= 1; sign += 2) {
        for (unsigned seed = 3; seed < 6; seed++) {
            setUp();
            begin(30, seed);
            const int64_t at = 2 * (int64_t)DAY;
            add_shifted(4 * (int64_t)DAY, 1.5 * sign, at, INT64_MAX);
            TEST_ASSERT_GREATER_OR_EQUAL_INT(1, found);
            TEST_ASSERT_EQUAL_INT(1, settled);
            TEST_ASSERT_DOUBLE_WITHIN(600.0, (double)at, first_onset);
            TEST_ASSERT_DOUBLE_WITHIN(0.3, 1.5 * sign, series.size);
            TEST_ASSERT_TRUE(series.is_off);
            TEST_ASSERT_TRUE(isnan(series.share));
        }
    }
}

/* Two products that alternate, from `from` to `until`. */
static void add_products(int64_t from, int64_t until, double shift) {
    double level = 0.0;
    int64_t next = from;
    for (int64_t i = from; i < until; i++) {
        if (i >= next) {
            level = level < 0.0 ? 0.0 : -6.0;
            next = i + 3600 + (int64_t)(3 * 3600 * uniform());
        }
        add(i, draw() + level + shift, 0.0);
        off += series.is_off ? 1 : 0;
    }
}

/* Levels that were there while learning are normal. A shift beyond them is found, and its
 * end. */
static void test_levels_that_recur(void) {
    for (unsigned seed = 20; seed < 23; seed++) {
        setUp();
        begin(10, seed);
        add_products(0, 10 * (int64_t)DAY, 0.0);
        TEST_ASSERT_TRUE(tl_change_series_is_ready(&series));
        TEST_ASSERT_EQUAL_INT(0, off);
        add_products(10 * (int64_t)DAY, 11 * (int64_t)DAY, -12.0);
        TEST_ASSERT_GREATER_THAN_INT(DAY / 2, off);
        TEST_ASSERT_TRUE(series.is_off);
        add_products(11 * (int64_t)DAY, 12 * (int64_t)DAY, 0.0);
        TEST_ASSERT_FALSE(series.is_off);
    }
}

/* What does not last is no change. */
static void test_a_transient(void) {
    begin(10, 24);
    for (int64_t i = 0; i < 4 * (int64_t)DAY; i++) {
        int64_t since = i - 2 * (int64_t)DAY;
        add(i, draw() + (since >= 0 ? 30.0 * exp(-(double)since / 20.0) : 0.0), 0.0);
        off += series.is_off ? 1 : 0;
    }
    TEST_ASSERT_GREATER_THAN_INT(0, found);
    TEST_ASSERT_EQUAL_INT(0, off);
}

/* A level that a user accepts is normal, also when it returns; another one is not. */
static void test_an_accepted_level(void) {
    begin(30, 25);
    add_shifted(2 * (int64_t)DAY, 5.0, DAY + DAY / 2, INT64_MAX);
    TEST_ASSERT_TRUE(series.is_off);
    tl_change_series_accept(&series, series.size, series.size);
    TEST_ASSERT_FALSE(series.is_off);
    add_shifted(DAY, 5.0, 0, DAY / 2);
    TEST_ASSERT_FALSE(series.is_off);
    add_shifted(DAY, 5.0, DAY / 2, DAY);
    TEST_ASSERT_FALSE(series.is_off);
    add_shifted(DAY, 2.5, 0, DAY);
    TEST_ASSERT_TRUE(series.is_off);
    for (int i = 0; i < 2 * TL_SERIES_RANGES; i++) {
        tl_change_series_accept(&series, 10.0 * i, 10.0 * i + 1.0);
    }
    TEST_ASSERT_EQUAL_UINT64(TL_SERIES_RANGES, series.ranges);
    TEST_ASSERT_DOUBLE_WITHIN(2.0, 10.0 * (2 * TL_SERIES_RANGES - 1) + 1.0, series.normal[TL_SERIES_RANGES - 1][1]);
}

static void test_a_shift_that_ends(void) {
    begin(30, 7);
    const int64_t at = 2 * (int64_t)DAY;
    add_shifted(4 * (int64_t)DAY, 2.0, at, at + DAY);
    TEST_ASSERT_EQUAL_INT(2, found);
    TEST_ASSERT_FALSE(series.is_off);
    TEST_ASSERT_DOUBLE_WITHIN(600.0, (double)(at + DAY), series.onset);
}

/* The share of the reference is found, and no further change although the reference moves. */
static void test_a_part_of_a_reference(void) {
    begin(30, 8);
    const int64_t at = 2 * (int64_t)DAY;
    double reference = 20.0;
    for (int64_t i = 0; i < 5 * (int64_t)DAY; i++) {
        reference = i % 1800 == 0 ? 10.0 + 40.0 * uniform() : reference;
        add(i, draw() - (i >= at ? 0.1 * reference : 0.0), reference);
    }
    TEST_ASSERT_DOUBLE_WITHIN(60.0, (double)at, first_onset);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, -0.1, series.change.gain);
    TEST_ASSERT_TRUE(series.is_off);
    TEST_ASSERT_LESS_OR_EQUAL_INT(4, found); /* until the reference has moved often enough */
}

/* 5 % less of a negative value is −5 %, whether it is fitted as a constant or as a part. */
static void test_the_sign_of_a_share(void) {
    begin(10, 13);
    for (int64_t i = 0; i < 2 * (int64_t)DAY; i++) {
        add(i, i < DAY + 1000 ? 0.0 : 2.0, -40.0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 2.0, series.size);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, -0.05, series.share);
}

/* A series that is always 0 while it learns, like Δu of a lock whose tolerance exceeds the noise. */
static void test_a_series_without_noise(void) {
    begin(10, 9);
    for (int64_t i = 0; i < 2 * (int64_t)DAY; i++) {
        add(i, i < DAY + 1000 ? 0.0 : 1e-3, 1.0);
    }
    TEST_ASSERT_EQUAL_INT(1, found);
    TEST_ASSERT_DOUBLE_WITHIN(20.0, DAY + 1000, first_onset);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 10.0, series.threshold); /* three blocks */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 1e-3, series.share);
}

/* Gaps and values that are not known change nothing. */
static void test_gaps(void) {
    begin(30, 10);
    for (int64_t i = 0; i < 6 * (int64_t)DAY; i++) {
        double value = draw();
        bool is_known = i / 5000 % 7 != 3 && i % 3 != 1;
        add(i, is_known ? value : i % 2 == 0 ? (double)NAN : 1e200, is_known ? 1.0 : (double)INFINITY);
        if (i % 50000 == 49999) {
            tl_change_series_interrupt(&series);
        }
    }
    TEST_ASSERT_TRUE(tl_change_series_is_ready(&series));
    TEST_ASSERT_EQUAL_INT(0, found);
}

/* With fewer blocks in a row than the model has coefficients nothing is learnt, and nothing said. */
static void test_only_gaps(void) {
    begin(10, 12);
    for (int64_t i = 0; i < 3 * (int64_t)DAY; i++) {
        add(i, i < 2 * (int64_t)DAY ? draw() : 50.0, 1.0);
        if (i % 60 == 59) {
            tl_change_series_interrupt(&series);
        }
    }
    TEST_ASSERT_FALSE(tl_change_series_is_ready(&series));
    TEST_ASSERT_EQUAL_INT(0, found);
}

/* Values of any size do not break the histograms. */
static void test_extreme_values(void) {
    begin(10, 11);
    for (int64_t i = 0; i < 2 * (int64_t)DAY; i++) {
        add(i, ldexp(uniform() - 0.5, (int)(uniform() * 600.0) - 300),
            ldexp(uniform(), (int)(uniform() * 600.0) - 300));
    }
    TEST_ASSERT_TRUE(isfinite(series.threshold) && isfinite(series.fit.deviation) && isfinite(series.fit.median));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_no_false_alarm_in_ten_days);
    RUN_TEST(test_no_false_alarm_with_a_daily_cycle);
    RUN_TEST(test_nothing_is_said_while_learning);
    RUN_TEST(test_a_shift_is_found_once);
    RUN_TEST(test_levels_that_recur);
    RUN_TEST(test_a_transient);
    RUN_TEST(test_an_accepted_level);
    RUN_TEST(test_a_shift_that_ends);
    RUN_TEST(test_a_part_of_a_reference);
    RUN_TEST(test_the_sign_of_a_share);
    RUN_TEST(test_a_series_without_noise);
    RUN_TEST(test_gaps);
    RUN_TEST(test_only_gaps);
    RUN_TEST(test_extreme_values);
    return UNITY_END();
}
