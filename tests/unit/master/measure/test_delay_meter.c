/* Delay between y and ŷ, estimated from both: with noise, without excitation, and while it
 * drifts. */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "master/measure/delay_meter.h"
#include "tests/support/random_numbers.h"

#define MS ((tl_time)1000000)

enum { LAGS = 16, STEP = 4 };

static tl_arena arena;
static tl_delay_meter *meter;
static tl_test_random chance;

/* A plant and its measurement. */
typedef struct scene {
    double delay;  /* of y against ŷ, ms: the expected result */
    double period; /* interval of readings of ŷ, ms */
    double phase;
    double noise;
    double gain, offset;
    double length; /* s */
} scene;

static const scene CLEAN = {.delay = 10, .period = 8, .phase = 3, .gain = 1, .length = 8};

void setUp(void) {
    tl_arena_init(&arena);
    meter = tl_delay_meter_create(&arena, LAGS, STEP * MS, 64);
    TEST_ASSERT_NOT_NULL(meter);
    chance.state = 5;
}

void tearDown(void) {
    tl_arena_release(&arena);
}

/* Approximately normal, of variance 1. */
static double normal(void) {
    double sum = -6.0;
    for (int i = 0; i < 12; i++) {
        sum += tl_test_random_number(&chance, 0.0, 1.0);
    }
    return sum;
}

/* The step response of eq. 5.6 with the values of table 5.16. */
static double response(double t) {
    const double d = 0.225;
    const double omega = 8.0;
    double damped = omega * sqrt(1.0 - d * d);
    return t <= 0.0 ? 0.0 : 1.0 - exp(-d * omega * t) * (cos(damped * t) + d * omega / damped * sin(damped * t));
}

/* Steps up and down at irregular times, about one a second. */
static double plant(double t) {
    double sum = 0.0;
    for (int i = 0; i < 24; i++) {
        sum += (i % 2 == 0 ? 1.0 : -1.0) * response(t - 0.5 - 0.9 * i - 0.13 * (i % 3));
    }
    return sum;
}

static double still(double t) {
    (void)t;
    return 0.75;
}

static double wave(double t) {
    return sin(6.283185307179586 * t / 0.06); /* the period is shorter than the range */
}

static double ramp(double t) {
    return 3.0 * t;
}

/* Plays all ticks from `from` (s) on. */
static void play(const scene *s, double (*course)(double t), double from, bool free) {
    double next = s->phase + s->period * ceil((from * 1e3 - s->phase) / s->period);
    for (int64_t tick = llround(from * 1e3 / STEP) + 1; tick * STEP <= llround((from + s->length) * 1e3); tick++) {
        for (; next <= (double)(tick * STEP); next += s->period) {
            double value = s->gain * (course(next / 1e3) + s->noise * normal()) + s->offset;
            tl_delay_meter_see(meter, llround(next * 1e6), value, true);
        }
        tl_delay_meter_step(meter, tick, course(((double)(tick * STEP) - s->delay) / 1e3), free);
    }
}

static void expect_delay(double milliseconds, double within) {
    tl_delay_measured found = tl_delay_meter_get(meter);
    TEST_ASSERT_TRUE(found.known);
    TEST_ASSERT_FALSE(found.lost);
    TEST_ASSERT_TRUE(found.confidence >= 0.7 && found.confidence <= 1.0);
    TEST_ASSERT_DOUBLE_WITHIN(within, milliseconds, (double)found.delay / 1e6);
    TEST_ASSERT_DOUBLE_WITHIN(within, milliseconds, (double)found.newest / 1e6);
}

static void expect_unknown(void) {
    tl_delay_measured found = tl_delay_meter_get(meter);
    TEST_ASSERT_FALSE(found.known);
    TEST_ASSERT_FALSE(found.lost);
    TEST_ASSERT_EQUAL_INT64(0, found.delay);
    TEST_ASSERT_TRUE(found.confidence < 0.7);
}

static void restarted(void) {
    tearDown();
    setUp();
}

static void delays_of_both_signs_and_parts_of_a_step(void) {
    for (double delay = -40.0; delay <= 40.0; delay += 6.1) {
        scene s = CLEAN;
        s.delay = delay;
        play(&s, plant, 0.0, true);
        expect_delay(delay, 0.3 * STEP);
        restarted();
    }
}

static void readings_at_any_rate(void) {
    static const double periods[] = {0.9, 4, 7.3, 20, 31};
    for (size_t i = 0; i < sizeof periods / sizeof periods[0]; i++) {
        scene s = CLEAN;
        s.period = periods[i];
        play(&s, plant, 0.0, true);
        expect_delay(10, 0.5 * STEP);
        restarted();
    }
}

static void gain_and_offset_do_not_matter(void) {
    scene s = CLEAN;
    s.gain = 37.0;
    s.offset = 1e7;
    play(&s, plant, 0.0, true);
    expect_delay(10, 0.3 * STEP);
}

/* σ = 5 % of the step: the error is within one cycle. TL_TEST_NOISES is the number of
 * repetitions. */
static void noise(void) {
    size_t count = tl_test_campaign("TL_TEST_NOISES", 25);
    double squares = 0.0;
    for (size_t i = 0; i < count; i++) {
        scene s = CLEAN;
        s.noise = 0.05;
        s.delay = tl_test_random_number(&chance, -30.0, 30.0);
        s.phase = tl_test_random_number(&chance, 0.0, 8.0);
        uint64_t state = chance.state;
        play(&s, plant, 0.0, true);
        expect_delay(s.delay, STEP);
        double off = (double)tl_delay_meter_get(meter).newest / 1e6 - s.delay;
        squares += off * off;
        restarted();
        chance.state = state + i;
    }
    TEST_ASSERT_TRUE(sqrt(squares / (double)count) < 0.5 * STEP);
}

static void nothing_that_moves_tells_nothing(void) {
    scene s = CLEAN;
    play(&s, still, 0.0, true);
    expect_unknown();
    s.noise = 0.3;
    play(&s, still, 8.0, true);
    expect_unknown();
}

/* y moves, but the measurement is unrelated. */
static void what_does_not_belong_together_is_not_taken_for_it(void) {
    for (uint64_t seed = 1; seed <= 20; seed++) {
        restarted();
        chance.state = seed;
        for (int64_t tick = 1; tick <= 2000; tick++) {
            tl_delay_meter_see(meter, tick * STEP * MS, normal(), true);
            tl_delay_meter_step(meter, tick, plant((double)tick * STEP / 1e3), true);
        }
        expect_unknown();
    }
}

static void a_ramp_has_no_delay_to_be_found(void) {
    scene s = CLEAN;
    s.noise = 0.01;
    play(&s, ramp, 0.0, true);
    expect_unknown();
}

static void one_of_many_equal_peaks_is_not_believed(void) {
    scene s = CLEAN;
    s.period = 4;
    play(&s, wave, 0.0, true);
    expect_unknown();
}

static void beyond_its_range_it_is_not_found(void) {
    scene s = CLEAN;
    s.delay = 90.0; /* the range is 64 ms */
    play(&s, plant, 0.0, true);
    expect_unknown();
}

static void what_was_learned_stays_while_nothing_moves(void) {
    scene s = CLEAN;
    s.noise = 0.02;
    play(&s, plant, 0.0, true);
    tl_delay_measured before = tl_delay_meter_get(meter);
    expect_delay(10, STEP);
    for (int64_t tick = 2001; tick < 100000; tick++) {
        tl_delay_meter_see(meter, tick * STEP * MS, 0.02 * normal(), true);
        tl_delay_meter_step(meter, tick, 1e-4 * sin(0.3 * (double)tick), true); /* a model that never quite rests */
    }
    tl_delay_measured after = tl_delay_meter_get(meter);
    TEST_ASSERT_EQUAL_INT64(before.delay, after.delay);
    TEST_ASSERT_FALSE(after.lost);
}

/* The delay drifts from 10 to 22 ms. The estimate follows in few changes and is never far from
 * both. */
static void drift(void) {
    scene s = CLEAN;
    size_t changes = 0;
    tl_time last = 0;
    s.noise = 0.03;
    play(&s, plant, 0.0, true);
    expect_delay(10, STEP);
    last = tl_delay_meter_get(meter).delay;
    s.delay = 22;
    s.length = 0.1;
    for (int i = 0; i < 110; i++) {
        play(&s, plant, 8.0 + 0.1 * i, true);
        tl_delay_measured now = tl_delay_meter_get(meter);
        TEST_ASSERT_TRUE(now.known && now.delay > 6 * MS && now.delay < 26 * MS);
        changes += now.delay != last;
        last = now.delay;
    }
    expect_delay(22, STEP);
    TEST_ASSERT_TRUE(changes >= 1 && changes <= 6);
}

/* Also if they agree well. */
static void a_few_steps_are_not_enough(void) {
    scene s = CLEAN;
    double first = 0.0;
    s.length = STEP / 1e3;
    for (int i = 0; i < 400 && first == 0.0; i++) {
        play(&s, plant, i * STEP / 1e3, true);
        first = tl_delay_meter_get(meter).confidence;
    }
    TEST_ASSERT_TRUE(first > 0.0 && first < 0.6);
}

static void lost_and_found_again(void) {
    scene s = CLEAN;
    play(&s, plant, 0.0, true);
    expect_delay(10, STEP);
    for (int64_t tick = 2001; tick <= 5000; tick++) { /* the sensor gives only noise */
        tl_delay_meter_see(meter, tick * STEP * MS, normal(), true);
        tl_delay_meter_step(meter, tick, plant((double)(tick % 3000) * STEP / 1e3), true);
    }
    tl_delay_measured found = tl_delay_meter_get(meter);
    TEST_ASSERT_TRUE(found.lost && found.known);
    TEST_ASSERT_DOUBLE_WITHIN(STEP, 10.0, (double)found.delay / 1e6);
    for (int64_t tick = 5001; tick <= 9000; tick++) {
        tl_delay_meter_see(meter, tick * STEP * MS, plant((double)(tick % 3000) * STEP / 1e3), true);
        tl_delay_meter_step(meter, tick, plant((double)(tick % 3000 - 2) * STEP / 1e3), true);
    }
    expect_delay(8, STEP);
}

/* A corrected twin follows the paired measurements, so y seems to have no delay. */
static void steps_that_were_corrected_do_not_count(void) {
    scene s = CLEAN;
    s.delay = 0.0;
    play(&s, plant, 0.0, false);
    expect_unknown();
    TEST_ASSERT_TRUE(tl_delay_meter_get(meter).confidence == 0.0);
    s.delay = 10.0;
    play(&s, plant, 8.0, true);
    expect_delay(10, 0.3 * STEP);
}

static void a_gap_counts_nothing_and_breaks_nothing(void) {
    scene s = CLEAN;
    s.length = 3;
    play(&s, plant, 0.0, true);
    for (int64_t tick = 751; tick <= 3000; tick++) {
        tl_delay_meter_see(meter, tick * STEP * MS, (double)NAN, tick % 2 == 0);
        tl_delay_meter_step(meter, tick, plant((double)tick * STEP / 1e3), true);
    }
    s.length = 8;
    play(&s, plant, 12.0, true);
    expect_delay(10, 0.3 * STEP);
}

static void readings_that_come_long_after_their_y(void) {
    for (int64_t tick = 1; tick <= 2000; tick++) {
        if (tick > 60) {
            int64_t read = (tick - 60) * STEP;
            tl_delay_meter_see(meter, read * MS, plant((double)read / 1e3), true);
        }
        tl_delay_meter_step(meter, tick, plant((double)(tick * STEP - 10) / 1e3), true);
    }
    expect_delay(10, 0.3 * STEP);
}

static void and_y_long_after_its_readings(void) {
    for (int64_t tick = 1; tick <= 2000; tick++) {
        tl_delay_meter_see(meter, tick * STEP * MS, plant((double)tick * STEP / 1e3), true);
        if (tick > 60) {
            tl_delay_meter_step(meter, tick - 60, plant((double)((tick - 60) * STEP - 10) / 1e3), true);
        }
    }
    expect_delay(10, 0.3 * STEP);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(delays_of_both_signs_and_parts_of_a_step);
    RUN_TEST(readings_at_any_rate);
    RUN_TEST(gain_and_offset_do_not_matter);
    RUN_TEST(noise);
    RUN_TEST(nothing_that_moves_tells_nothing);
    RUN_TEST(what_does_not_belong_together_is_not_taken_for_it);
    RUN_TEST(a_ramp_has_no_delay_to_be_found);
    RUN_TEST(one_of_many_equal_peaks_is_not_believed);
    RUN_TEST(beyond_its_range_it_is_not_found);
    RUN_TEST(what_was_learned_stays_while_nothing_moves);
    RUN_TEST(drift);
    RUN_TEST(a_few_steps_are_not_enough);
    RUN_TEST(lost_and_found_again);
    RUN_TEST(steps_that_were_corrected_do_not_count);
    RUN_TEST(a_gap_counts_nothing_and_breaks_nothing);
    RUN_TEST(readings_that_come_long_after_their_y);
    RUN_TEST(and_y_long_after_its_readings);
    return UNITY_END();
}
