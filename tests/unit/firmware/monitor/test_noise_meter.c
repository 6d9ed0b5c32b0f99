/* Noise estimated from readings alone: white noise on several motions, uneven stamps and bad
 * readings; and too few readings. */
#include <float.h>
#include <math.h>

#include <unity.h>

#include "firmware/cli/emulation.h"
#include "firmware/monitor/noise.h"

#define SIGMA 0.3

static tl_noise_meter meter;
static tl_noise_found found;
static tl_random noise;
static tl_time now;

void setUp(void) {
    tl_noise_meter_init(&meter, 0);
    noise = (tl_random){.state = 7};
    now = 1000 * TL_SECOND;
}

void tearDown(void) {}

static double rest(double time) {
    (void)time;
    return 1000.0;
}

static double sine(double time) {
    return 8.0 * sin(2.0 * 3.14159265 * 3.0 * time);
}

static double fast(double time) {
    return 8.0 * sin(2.0 * 3.14159265 * 9.0 * time);
}

static double steps(double time) {
    return fmod(time, 2.0) < 1.0 ? 0.0 : 50.0;
}

/* The next reading, 25 to 40 ms later. */
static double next(double (*motion)(double time)) {
    now += (tl_time)((0.025 + 0.015 * tl_random_uniform(&noise)) * (double)TL_SECOND);
    return motion(tl_seconds(now)) + SIGMA * tl_random_normal(&noise);
}

static size_t put(double value) {
    bool is_outlier = false;
    (void)tl_noise_meter_put(&meter, now, value, &is_outlier);
    return is_outlier ? 1 : 0;
}

static void measure(double (*motion)(double time), int count) {
    for (int i = 0; i < count; i++) {
        (void)put(next(motion));
    }
    tl_noise_meter_estimate(&meter, &found);
}

static void expect_noise(double sigma) {
    TEST_ASSERT_TRUE(found.is_enough);
    TEST_ASSERT_FALSE(found.is_too_fast);
    TEST_ASSERT_DOUBLE_WITHIN(0.15 * sigma, sigma, found.sigma);
}

static void test_what_stands_still(void) {
    measure(rest, 2000);
    expect_noise(SIGMA);
    TEST_ASSERT_EQUAL_UINT64(0, meter.outliers);
    TEST_ASSERT_EQUAL_UINT64(2000, meter.readings);
}

/* The difference of two neighbours takes a sine of 3 Hz for five times the noise. */
static void test_what_moves(void) {
    measure(sine, 2000);
    expect_noise(SIGMA);
    TEST_ASSERT_TRUE(found.by_order[0] > 3.0 * SIGMA);
    TEST_ASSERT_EQUAL_UINT64(0, meter.outliers);
}

static void test_steps_are_no_noise_and_no_outliers(void) {
    measure(steps, 2000);
    expect_noise(SIGMA);
    TEST_ASSERT_EQUAL_UINT64(0, meter.outliers);
}

static void test_what_moves_too_fast_is_not_told(void) {
    measure(fast, 2000);
    TEST_ASSERT_TRUE(found.is_enough && found.is_too_fast);
    TEST_ASSERT_FALSE(tl_noise_exceeds(&found, 1e-9));
}

/* Also two outliers in a row. The first readings only give the scale. */
static void test_outliers(void) {
    uint64_t made = 0;
    measure(sine, 200);
    for (int i = 0; i < 4000; i++) {
        double value = next(rest);
        bool is_bad = i % 50 == 10 || i % 500 == 11;
        made += is_bad ? 1 : 0;
        (void)put(is_bad ? value + 20.0 : value);
    }
    tl_noise_meter_estimate(&meter, &found);
    expect_noise(SIGMA);
    TEST_ASSERT_EQUAL_UINT64(made, meter.outliers);
}

static void test_outliers_of_the_second_look(void) {
    size_t outliers = 0;
    measure(rest, 500);
    tl_noise_meter_init(&meter, 0);
    tl_noise_meter_use(&meter, &found);
    for (int i = 0; i < 20; i++) {
        outliers += put(next(rest) + (i == 6 ? -10.0 : 0.0));
    }
    TEST_ASSERT_EQUAL_size_t(1, outliers);
}

/* Intervals of 1 µs and gaps of 1 s: each reading is weighted by its own stamp. */
static void test_very_uneven_stamps(void) {
    for (int i = 0; i < 3000; i++) {
        now += i % 3 == 0 ? TL_SECOND / 1000000 : i % 100 == 1 ? TL_SECOND : TL_SECOND / 50;
        (void)put(3.0 * tl_seconds(now) + SIGMA * tl_random_normal(&noise));
    }
    tl_noise_meter_estimate(&meter, &found);
    expect_noise(SIGMA);
}

static void test_a_constant_has_none(void) {
    for (int i = 0; i < 200; i++) {
        now += TL_SECOND / 100;
        (void)put(5.0);
    }
    tl_noise_meter_estimate(&meter, &found);
    TEST_ASSERT_TRUE(found.is_enough);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, found.sigma);
    TEST_ASSERT_EQUAL_UINT64(199, meter.repeats);
    TEST_ASSERT_FALSE(tl_noise_exceeds(&found, DBL_MIN));
}

static void test_too_few(void) {
    tl_noise_meter_estimate(&meter, &found);
    TEST_ASSERT_FALSE(found.is_enough);
    measure(rest, TL_NOISE_LEAST + TL_NOISE_WINDOW + TL_NOISE_AROUND - 3);
    TEST_ASSERT_FALSE(found.is_enough);
    TEST_ASSERT_FALSE(tl_noise_exceeds(&found, 1e-9));
    measure(rest, 1);
    TEST_ASSERT_TRUE(found.is_enough);
}

/* Invalid readings are skipped. */
static void test_what_is_no_reading(void) {
    bool is_outlier = true;
    measure(rest, 500);
    double before = found.sigma;
    TEST_ASSERT_FALSE(tl_noise_meter_put(&meter, now + 1, (double)NAN, &is_outlier));
    TEST_ASSERT_FALSE(is_outlier);
    TEST_ASSERT_FALSE(tl_noise_meter_put(&meter, now + 1, (double)INFINITY, &is_outlier));
    TEST_ASSERT_FALSE(tl_noise_meter_put(&meter, now, 7.0, &is_outlier));
    TEST_ASSERT_FALSE(tl_noise_meter_put(&meter, now - TL_SECOND, 7.0, &is_outlier));
    TEST_ASSERT_FALSE(tl_noise_meter_put(&meter, INT64_MAX, 7.0, &is_outlier));
    tl_noise_meter_estimate(&meter, &found);
    TEST_ASSERT_EQUAL_DOUBLE(before, found.sigma);
    TEST_ASSERT_EQUAL_UINT64(500, meter.readings);
}

static void test_stamps_before_everything(void) {
    now = INT64_MIN;
    measure(rest, 500);
    expect_noise(SIGMA);
}

/* Values too large for a difference, or too small for a bin, give finite estimates. */
static void test_huge_and_tiny(void) {
    for (int i = 0; i < 500; i++) {
        now += TL_SECOND / 100;
        (void)put((i % 2 == 0 ? 1.0 : -1.0) * DBL_MAX);
    }
    tl_noise_meter_estimate(&meter, &found);
    TEST_ASSERT_TRUE(isfinite(found.sigma));
    setUp();
    for (int i = 0; i < 500; i++) {
        now += TL_SECOND / 100;
        (void)put(1e-300 * tl_random_normal(&noise));
    }
    tl_noise_meter_estimate(&meter, &found);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, found.sigma);
    setUp();
    for (int i = 0; i < 2000; i++) {
        now += TL_SECOND / 100;
        (void)put(1e12 * tl_random_normal(&noise));
    }
    tl_noise_meter_estimate(&meter, &found);
    expect_noise(1e12);
}

/* Only the last readings count, because the noise may change. */
static void test_it_forgets(void) {
    tl_noise_meter_init(&meter, 1000);
    measure(rest, 5000);
    expect_noise(SIGMA);
    for (int i = 0; i < 5000; i++) {
        now += TL_SECOND / 30;
        (void)put(3.0 * SIGMA * tl_random_normal(&noise));
    }
    tl_noise_meter_estimate(&meter, &found);
    TEST_ASSERT_TRUE(found.count < 1000);
    expect_noise(3.0 * SIGMA);
}

static void test_a_tolerance_within_it(void) {
    found = (tl_noise_found){.count = 1000, .sigma = SIGMA, .is_enough = true};
    TEST_ASSERT_TRUE(tl_noise_exceeds(&found, 2.5 * SIGMA));
    TEST_ASSERT_FALSE(tl_noise_exceeds(&found, 2.6 * SIGMA));
    found.is_too_fast = true;
    TEST_ASSERT_FALSE(tl_noise_exceeds(&found, 2.5 * SIGMA));
    found.is_too_fast = false;
    found.is_enough = false;
    TEST_ASSERT_FALSE(tl_noise_exceeds(&found, 2.5 * SIGMA));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_stands_still);
    RUN_TEST(test_what_moves);
    RUN_TEST(test_steps_are_no_noise_and_no_outliers);
    RUN_TEST(test_what_moves_too_fast_is_not_told);
    RUN_TEST(test_outliers);
    RUN_TEST(test_outliers_of_the_second_look);
    RUN_TEST(test_very_uneven_stamps);
    RUN_TEST(test_a_constant_has_none);
    RUN_TEST(test_too_few);
    RUN_TEST(test_what_is_no_reading);
    RUN_TEST(test_stamps_before_everything);
    RUN_TEST(test_huge_and_tiny);
    RUN_TEST(test_it_forgets);
    RUN_TEST(test_a_tolerance_within_it);
    return UNITY_END();
}
