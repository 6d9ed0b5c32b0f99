/* Noise of matched signals against their tolerance: reported once, ended once. Only new, good,
 * unconditioned readings count. */
#include <string.h>

#include <unity.h>

#include "firmware/cli/emulation.h"
#include "firmware/monitor/noise.h"

static tl_config_signal signals[3];
static tl_plan_match match[2];
static const char *matched_as[2];
static const char *reading_as[2];
static tl_config config;
static tl_noise_watch watch;
static tl_sample sample;
static tl_random noise;
static int large, small;
static double sigma; /* from the last change */

void setUp(void) {
    memset(&sample, 0, sizeof sample);
    memset(signals, 0, sizeof signals);
    signals[0] = (tl_config_signal){.plan.name = "torque", .of = 0};
    signals[1] = (tl_config_signal){.plan.name = "omega", .of = 1, .between = TL_BETWEEN_LINE};
    signals[2] = (tl_config_signal){.plan.name = "omega@reading", .of = 1, .is_reading = true, .shows = 1};
    match[0] = (tl_plan_match){.variable = "motor.omega", .to = "plant.omega", .tolerance = 1.0, .weight = 1.0};
    match[1] = (tl_plan_match){.variable = "motor.M", .to = "plant.torque", .tolerance = 0.001, .weight = 0.0};
    matched_as[0] = "plant.omega";
    matched_as[1] = "plant.torque";
    reading_as[0] = "plant.omega@reading";
    reading_as[1] = NULL;
    config = (tl_config){.signals = signals,
                         .signal_count = 3,
                         .match = match,
                         .match_count = 2,
                         .matched_as = matched_as,
                         .reading_as = reading_as,
                         .synchronise = true,
                         .step = TL_SECOND / 100};
    noise = (tl_random){.state = 3};
    large = small = 0;
    tl_noise_watch_init(&watch, &config);
}

void tearDown(void) {}

/* A reading each tick with this noise. The matched signal is on the line between its readings. */
static void pass(int ticks, double deviation) {
    for (int i = 0; i < ticks; i++) {
        sample.tick++;
        sample.instant += config.step;
        for (int k = 0; k < 3; k++) {
            sample.stamps[k] = sample.instant;
            sample.values[k] = k == 2 ? deviation * tl_random_normal(&noise) : 0.0;
        }
        for (size_t k = 0; k < 2; k++) {
            double was_reported = 0.0;
            tl_noise_turn turn = tl_noise_watch_sample(&watch, &sample, k, &was_reported);
            large += turn == TL_NOISE_IS_LARGE ? 1 : 0;
            small += turn == TL_NOISE_IS_SMALL ? 1 : 0;
            sigma = turn != TL_NOISE_AS_BEFORE ? was_reported : sigma;
        }
    }
}

static void expect_turns(int to_large, int to_small) {
    TEST_ASSERT_EQUAL_INT(to_large, large);
    TEST_ASSERT_EQUAL_INT(to_small, small);
}

static void test_a_tolerance_of_more_is_not_told(void) {
    pass(20000, 0.3);
    expect_turns(0, 0);
}

static void test_a_tolerance_of_less_is_told_once(void) {
    pass(TL_NOISE_WATCH_EACH - 1, 0.6);
    expect_turns(0, 0);
    pass(1, 0.6);
    expect_turns(1, 0);
    TEST_ASSERT_DOUBLE_WITHIN(0.12, 0.6, sigma);
    pass(20000, 0.6);
    expect_turns(1, 0);
}

/* The noise decreases, or the tolerance increases. */
static void test_it_is_over(void) {
    pass(1000, 0.6);
    pass(20000, 0.1);
    expect_turns(1, 1);
    pass(20000, 0.6);
    expect_turns(2, 1);
    match[0].tolerance = 2.0;
    pass(TL_NOISE_WATCH_EACH, 0.6);
    expect_turns(2, 2);
}

/* Repeated, rejected and stale readings do not count. */
static void test_which_readings_count(void) {
    for (int i = 0; i < 5000; i++) {
        pass(1, 0.6);
        sample.stamps[2] = 1;
        sample.quality[2] = i % 2 == 0 ? TL_OUTLIER : TL_STALE;
    }
    expect_turns(0, 0);
}

static void test_polls_of_one_value_tell_nothing(void) {
    for (int i = 0; i < 5000; i++) {
        sample.instant += config.step;
        sample.stamps[2] = sample.instant;
        sample.values[2] = i % 2 == 0 ? tl_random_normal(&noise) : sample.values[2];
        TEST_ASSERT_EQUAL_INT(TL_NOISE_AS_BEFORE, tl_noise_watch_sample(&watch, &sample, 0, &sigma));
    }
}

/* Not judged: no synchronisation, strokes, no reading signal, or a signal that is not Real. */
static void test_what_is_not_judged(void) {
    config.synchronise = false;
    tl_noise_watch_init(&watch, &config);
    pass(1000, 10.0);
    config.synchronise = true;
    config.event.start.signal = "plant.torque";
    tl_noise_watch_init(&watch, &config);
    pass(1000, 10.0);
    config.event.start.signal = NULL;
    reading_as[0] = NULL;
    tl_noise_watch_init(&watch, &config);
    pass(1000, 10.0);
    reading_as[0] = "plant.omega@reading";
    signals[2].plan.type = TL_INTEGER;
    tl_noise_watch_init(&watch, &config);
    pass(1000, 10.0);
    expect_turns(0, 0);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_tolerance_of_more_is_not_told);
    RUN_TEST(test_a_tolerance_of_less_is_told_once);
    RUN_TEST(test_it_is_over);
    RUN_TEST(test_which_readings_count);
    RUN_TEST(test_polls_of_one_value_tell_nothing);
    RUN_TEST(test_what_is_not_judged);
    return UNITY_END();
}
