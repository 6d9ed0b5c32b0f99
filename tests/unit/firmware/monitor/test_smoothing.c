/* Error of a low-pass, by noise and by delayed motion: the estimate from readings against the true
 * error. */
#include <math.h>

#include <unity.h>

#include "firmware/cli/emulation.h"
#include "firmware/monitor/survey.h"
#include "firmware/plant/conditioner.h"

enum { COUNT = 3000 };

static tl_noise_point points[COUNT];
static double truth[COUNT];

void setUp(void) {}
void tearDown(void) {}

/* Readings each 25 to 40 ms. */
static void make(double amplitude, double hertz, double sigma) {
    tl_random noise = {.state = 5};
    tl_time now = 0;
    for (int i = 0; i < COUNT; i++) {
        now += (tl_time)((0.025 + 0.015 * tl_random_uniform(&noise)) * (double)TL_SECOND);
        truth[i] = 60.0 + amplitude * sin(2.0 * 3.14159265 * hertz * tl_seconds(now));
        points[i] = (tl_noise_point){.stamp = now, .value = truth[i] + sigma * tl_random_normal(&noise)};
    }
}

/* The true error of the conditioner's low-pass, compared τ later. */
static double true_error(tl_time low_pass) {
    const tl_condition condition = {.low_pass = low_pass};
    static tl_conditioned out[COUNT];
    tl_conditioner conditioner;
    double sum = 0.0;
    int terms = 0;
    int next = 1;
    tl_conditioner_init(&conditioner, &condition, 0);
    for (int i = 0; i < COUNT; i++) {
        const tl_reading reading = {.value = points[i].value, .stamp = points[i].stamp, .quality = TL_GOOD};
        tl_conditioned came[TL_CONDITIONER_LEVEL];
        bool is_rejected = false;
        TEST_ASSERT_EQUAL_size_t(1, tl_conditioner_take(&conditioner, &reading, &is_rejected, came));
        out[i] = came[0];
    }
    for (int i = 1; i < COUNT; i++) {
        tl_time at = points[i].stamp + low_pass;
        while (next < COUNT && points[next].stamp < at) {
            next++;
        }
        if (next == COUNT) {
            break;
        }
        double off = tl_conditioner_between(low_pass, &out[next - 1], &out[next].reading, at) - truth[i];
        sum += off * off;
        terms++;
    }
    return sum / terms;
}

static void expect_true(tl_time low_pass, double accuracy) {
    double wanted = true_error(low_pass);
    TEST_ASSERT_DOUBLE_WITHIN(accuracy * wanted, wanted, tl_smoothing_error(points, COUNT, 0.3, low_pass));
}

static void test_of_noise_alone(void) {
    make(0.0, 1.0, 0.3);
    for (tl_time low_pass = TL_SECOND / 200; low_pass <= TL_SECOND / 20; low_pass *= 2) {
        expect_true(low_pass, 0.15);
        TEST_ASSERT_TRUE(tl_smoothing_error(points, COUNT, 0.3, low_pass) < 0.09);
    }
}

/* A long low-pass flattens the signal and is worse than none. */
static void test_of_what_moves(void) {
    make(8.0, 1.0, 0.3);
    expect_true(TL_SECOND / 100, 0.15);
    expect_true(TL_SECOND / 50, 0.15);
    expect_true(TL_SECOND / 10, 0.1);
    TEST_ASSERT_TRUE(tl_smoothing_error(points, COUNT, 0.3, TL_SECOND / 50) < 0.09);
    TEST_ASSERT_TRUE(tl_smoothing_error(points, COUNT, 0.3, TL_SECOND / 10) > 0.09);
}

static void test_too_few(void) {
    make(0.0, 1.0, 0.3);
    for (size_t count = 0; count < 3; count++) {
        TEST_ASSERT_EQUAL_DOUBLE(0.25, tl_smoothing_error(points, count, 0.5, TL_SECOND / 50));
    }
}

/* A low-pass longer than all readings cannot be compared with them. */
static void test_longer_than_all(void) {
    make(0.0, 1.0, 0.3);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, tl_smoothing_error(points, COUNT, 0.5, 1000 * TL_SECOND));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_of_noise_alone);
    RUN_TEST(test_of_what_moves);
    RUN_TEST(test_too_few);
    RUN_TEST(test_longer_than_all);
    return UNITY_END();
}
