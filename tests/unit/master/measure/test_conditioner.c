/* Conditioning of a measurement: gate, median, low-pass, what is held, and whether the declared delay is the true one. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "firmware/emulate/noise.h"
#include "master/base/arena.h"
#include "master/measure/conditioner.h"

enum { WINDOW = 7, MOST = 99, DRAWS = 200000 };

static tl_arena arena;
static tl_conditioner *conditioner;
static int64_t tick; /* of the next sample */

void setUp(void) {
    tl_arena_init(&arena);
    conditioner = NULL;
}

void tearDown(void) {
    tl_arena_release(&arena);
}

/* A new conditioner at tick 0, T_S = 1 s. */
static void create(tl_plan_condition condition) {
    conditioner = tl_conditioner_create(&arena, &condition, TL_SECOND, WINDOW);
    TEST_ASSERT_NOT_NULL(conditioner);
    tick = 0;
}

static tl_plan_condition low_pass(double samples) {
    return (tl_plan_condition){.low_pass = tl_time_of_seconds(samples)};
}

/* Pushes a good value; what came out, which must be good. */
static double good(double value) {
    tl_quality quality = TL_NO_LINK;
    tl_conditioner_push(conditioner, tick, value, TL_GOOD);
    double result = tl_conditioner_value(conditioner, tick++, &quality);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, quality);
    return result;
}

static void push(double value, tl_quality quality) {
    tl_conditioner_push(conditioner, tick++, value, quality);
}

static void repeat(int times, double value, tl_quality quality) {
    for (int i = 0; i < times; i++) {
        push(value, quality);
    }
}

static void expect_bits(double expected, double found) {
    TEST_ASSERT_EQUAL_MEMORY(&expected, &found, sizeof expected);
}

/* The newest output, to the bit. */
static void expect(double value, tl_quality expected) {
    tl_quality quality = TL_NO_LINK;
    expect_bits(value, tl_conditioner_value(conditioner, tick - 1, &quality));
    TEST_ASSERT_EQUAL_STRING(tl_quality_name(expected), tl_quality_name(quality));
}

static void push_expect(double pushed, double value, tl_quality quality) {
    push(pushed, TL_GOOD);
    expect(value, quality);
}

/* ---- Nothing is done where nothing is asked for ---- */

static void what_is_asked_for_is_needed(void) {
    TEST_ASSERT_FALSE(tl_conditioner_is_needed(&(tl_plan_condition){0}));
    TEST_ASSERT_FALSE(tl_conditioner_is_needed(&(tl_plan_condition){.median = 1}));
    TEST_ASSERT_TRUE(tl_conditioner_is_needed(&(tl_plan_condition){.median = 3}));
    TEST_ASSERT_TRUE(tl_conditioner_is_needed(&(tl_plan_condition){.low_pass = 1}));
    TEST_ASSERT_TRUE(tl_conditioner_is_needed(&(tl_plan_condition){.gate = 1e-300}));
}

static void without_conditioning_every_bit_passes(void) {
    static const double values[] = {0.1, -0.0, 0.0, DBL_MAX, -DBL_MAX, 4.9e-324, -1.0 / 3.0, 1e9};
    for (uint32_t width = 0; width <= 1; width++) {
        create((tl_plan_condition){.median = width});
        for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
            expect_bits(values[i], good(values[i]));
        }
    }
}

static void a_constant_passes_every_filter_to_the_bit(void) {
    create((tl_plan_condition){.median = 5, .low_pass = 7 * TL_SECOND / 3, .gate = 0.01});
    for (int i = 0; i < 100; i++) {
        expect_bits(0.1, good(0.1));
    }
}

/* ---- Delay ---- */

static void the_delay_is_that_of_both_filters(void) {
    static const struct {
        uint32_t median;
        double samples; /* τ/T_S */
        uint32_t delay;
    } rows[] = {
        {0, 0.0, 0},   {1, 0.0, 0},   {3, 0.0, 1},  {99, 0.0, 49}, {0, 0.5, 0}, /* 1/(e^2 − 1) = 0.157 */
        {0, 0.9, 0},                                                            /* 0.491 */
        {0, 1.0, 1},                                                            /* 0.582 */
        {0, 1.6, 1},                                /* 1.152, though τ is nearer to 2 samples */
        {0, 2.4, 2},                                /* 1.935 */
        {0, 10.0, 10},                              /* 9.508 */
        {0, 10.4, 10},                              /* 9.908 */
        {0, 10.9, 10},                              /* 10.408, though τ is nearer to 11 samples */
        {5, 10.0, 12}, {1, 10.0, 10}, {0, 0.001, 0} /* e^1000 is too large for a double */
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        tl_plan_condition condition = low_pass(rows[i].samples);
        condition.median = rows[i].median;
        TEST_ASSERT_EQUAL_UINT32(rows[i].delay, tl_plan_condition_delay(&condition, TL_SECOND));
    }
}

static void the_delay_counts_in_macro_steps(void) {
    const tl_plan_condition condition = {.low_pass = TL_SECOND};
    TEST_ASSERT_EQUAL_UINT32(100, tl_plan_condition_delay(&condition, TL_SECOND / 100));
}

static void a_delay_that_cannot_be_counted_is_the_largest_number(void) {
    const tl_plan_condition condition = {.median = 99, .low_pass = INT64_MAX};
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, tl_plan_condition_delay(&condition, 1));
}

static void a_median_delays_a_ramp_by_exactly_its_delay(void) {
    static const uint32_t sizes[] = {3, 5, 9, 99};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        const tl_plan_condition condition = {.median = sizes[i]};
        int64_t delay = tl_plan_condition_delay(&condition, TL_SECOND);
        for (double slope = -0.3; slope < 0.5; slope += 0.6) {
            create(condition);
            while (tick < 300) {
                double belongs_to = slope * (double)(tick - delay);
                double found = good(slope * (double)tick);
                if (tick >= sizes[i]) {
                    expect_bits(belongs_to, found);
                }
            }
        }
    }
}

/* How far a ramp of slope 1 comes out behind, when all transients are gone. */
static double lag_of(tl_plan_condition condition) {
    create(condition);
    double found = 0.0;
    while (tick < 2000) {
        found = good((double)tick);
    }
    return (double)(tick - 1) - found;
}

static void a_low_pass_delays_a_ramp_by_its_lag(void) {
    for (double samples = 0.25; samples <= 32.0; samples += 0.25) {
        tl_plan_condition condition = low_pass(samples);
        double lag = lag_of(condition);
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.0 / (exp(1.0 / samples) - 1.0), lag);
        TEST_ASSERT_DOUBLE_WITHIN(0.5, tl_plan_condition_delay(&condition, TL_SECOND), lag);
    }
}

/* τ = T_S/ln(1 + 1/n) lags by n samples. T_S is an hour here, so that a τ in whole nanoseconds is exact enough. */
static void a_low_pass_with_a_whole_lag_has_exactly_the_declared_delay(void) {
    const tl_time step = 3600 * TL_SECOND;
    for (uint32_t lag = 1; lag <= 30; lag++) {
        const tl_plan_condition condition = {.median = 5,
                                             .low_pass = tl_time_of_seconds(3600.0 / log(1.0 + 1.0 / lag))};
        TEST_ASSERT_EQUAL_UINT32(lag + 2, tl_plan_condition_delay(&condition, step));
        conditioner = tl_conditioner_create(&arena, &condition, step, WINDOW);
        tick = 0;
        double found = 0.0;
        while (tick < 2000) {
            found = good((double)tick);
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, (double)(tick - 1) - (lag + 2), found);
    }
}

/* ---- Filters ---- */

static void a_low_pass_answers_a_step_as_the_equation_says(void) {
    create(low_pass(4.0));
    expect_bits(2.0, good(2.0)); /* no transient from 0 */
    for (int i = 1; i <= 40; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 2.0 + 3.0 * (1.0 - exp(-i / 4.0)), good(5.0));
    }
}

static void a_median_that_fills_takes_the_newer_of_two_in_the_middle(void) {
    static const double fed[] = {10.0, 20.0, 30.0, 40.0, 50.0, 60.0};
    static const double expected[] = {10.0, 20.0, 20.0, 30.0, 30.0, 40.0};
    for (double sign = -1.0; sign < 2.0; sign += 2.0) {
        create((tl_plan_condition){.median = 5});
        for (size_t i = 0; i < sizeof fed / sizeof *fed; i++) {
            expect_bits(sign * expected[i], good(sign * fed[i]));
        }
    }
}

static int compare(const void *one, const void *other) {
    double a = *(const double *)one;
    double b = *(const double *)other;
    return (a > b) - (a < b);
}

/* The middle one of the last `size` values. */
static double sorted_middle(const double *last, size_t size) {
    double sorted[MOST];
    memcpy(sorted, last - size, size * sizeof *sorted);
    qsort(sorted, size, sizeof *sorted, compare);
    return sorted[size / 2];
}

static void a_median_is_the_middle_of_its_window_sorted(void) {
    static const uint32_t sizes[] = {3, 5, 7, 99};
    static double values[5000];
    tl_noise noise = {7};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        create((tl_plan_condition){.median = sizes[i]});
        while (tick < 5000) {
            values[tick] = floor(20.0 * tl_noise_uniform(&noise)); /* with many equal ones */
            double found = good(values[tick]);
            if (tick >= sizes[i]) {
                expect_bits(sorted_middle(&values[tick], sizes[i]), found);
            }
        }
    }
}

/* Variance of what comes out of normal noise with variance 1. */
static double noise_through(tl_plan_condition condition) {
    tl_noise noise = {42};
    create(condition);
    double squares = 0.0;
    for (int i = 0; i < 1000; i++) {
        (void)good(tl_noise_normal(&noise));
    }
    for (int i = 0; i < DRAWS; i++) {
        double found = good(tl_noise_normal(&noise));
        squares += found * found;
    }
    return squares / DRAWS;
}

/* A low-pass leaves a/(2 − a) of the variance; a median leaves what tables of order statistics say. The bounds are more
 * than four standard errors and less than what a neighbouring size or time constant would give. */
static void noise_is_reduced_as_theory_says(void) {
    static const double samples[] = {2.0, 5.0, 10.0};
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++) {
        double a = 1.0 - exp(-1.0 / samples[i]);
        double expected = a / (2.0 - a);
        TEST_ASSERT_DOUBLE_WITHIN(0.04 * expected, expected, noise_through(low_pass(samples[i])));
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.009, 0.4487, noise_through((tl_plan_condition){.median = 3}));
    TEST_ASSERT_DOUBLE_WITHIN(0.009, 0.2868, noise_through((tl_plan_condition){.median = 5}));
    TEST_ASSERT_DOUBLE_WITHIN(0.007, 0.1661, noise_through((tl_plan_condition){.median = 9}));
}

/* The low-pass gets what the median gives, not the other way round: a spike leaves no trace in it. */
static void the_median_comes_before_the_low_pass(void) {
    create((tl_plan_condition){.median = 3, .low_pass = 4 * TL_SECOND});
    for (int i = 0; i < 50; i++) {
        expect_bits(1.5, good(i == 20 ? 1e6 : 1.5));
    }
}

/* ---- Spikes ---- */

static void spikes_vanish_in_a_gate(void) {
    create((tl_plan_condition){.gate = 1.0});
    for (int spikes = 1; spikes <= 2; spikes++) {
        expect_bits(5.25, good(5.25));
        expect_bits(5.0, good(5.0));
        for (int i = 0; i < spikes; i++) {
            push_expect(100.0, 5.0, TL_OUTLIER);
        }
        expect_bits(5.5, good(5.5));
    }
}

static void spikes_leave_nothing_in_the_filters_behind_a_gate(void) {
    create((tl_plan_condition){.median = 3, .low_pass = 4 * TL_SECOND, .gate = 1.0});
    repeat(5, 5.0, TL_GOOD);
    push_expect(100.0, 5.0, TL_OUTLIER);
    push_expect(-100.0, 5.0, TL_OUTLIER);
    for (int i = 0; i < 10; i++) {
        expect_bits(5.0, good(5.0));
    }
}

static void one_spike_and_two_vanish_in_a_median_of_five(void) {
    for (int spikes = 1; spikes <= 3; spikes++) {
        create((tl_plan_condition){.median = 5});
        bool is_seen = false;
        for (int i = 0; i < 20; i++) {
            is_seen = good(i >= 10 && i < 10 + spikes ? 100.0 : 5.0) > 5.0 || is_seen;
        }
        TEST_ASSERT_EQUAL_INT(spikes == 3, is_seen);
    }
}

/* ---- New levels ---- */

static void the_edge_of_the_gate_is_inside(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(5.0, good(5.0));
    expect_bits(6.0, good(6.0));
    expect_bits(5.0, good(5.0));
    push_expect(6.0 + 1e-9, 5.0, TL_OUTLIER);
}

static void what_drifts_is_followed(void) {
    create((tl_plan_condition){.gate = 1.0});
    while (tick < 100) {
        double value = 0.9 * (double)tick;
        expect_bits(value, good(value));
    }
}

static void a_step_passes_at_its_third_sample(void) {
    create((tl_plan_condition){.gate = 1.0});
    repeat(5, 5.0, TL_GOOD);
    push_expect(20.0, 5.0, TL_OUTLIER);
    push_expect(20.5, 5.0, TL_OUTLIER);
    expect_bits(20.25, good(20.25));
    expect_bits(21.0, good(21.0));
    push_expect(5.0, 21.0, TL_OUTLIER); /* the old level has no rights left */
}

static void behind_a_step_a_median_knows_only_the_new_level(void) {
    create((tl_plan_condition){.median = 5, .gate = 1.0});
    repeat(8, 5.0, TL_GOOD);
    push_expect(20.0, 5.0, TL_OUTLIER);
    push_expect(20.25, 5.0, TL_OUTLIER);
    expect_bits(20.25, good(20.5)); /* of three */
    expect_bits(20.5, good(21.0));  /* of four, with 20.25 and 20.5 in the middle */
    expect_bits(20.5, good(21.0));
}

/* The output of tick m belongs to m − delay: it must be the old level for all m < step + delay. */
static void a_new_level_comes_out_at_the_instant_it_belongs_to(void) {
    const tl_plan_condition condition = {.median = 5, .low_pass = 6 * TL_SECOND, .gate = 1.0};
    int64_t delay = tl_plan_condition_delay(&condition, TL_SECOND);
    TEST_ASSERT_EQUAL_INT64(8, delay);
    create(condition);
    repeat(30, 5.0, TL_GOOD);
    while (tick < 30 + delay) {
        push_expect(20.0, 5.0, TL_OUTLIER);
    }
    while (tick < 100) {
        expect_bits(20.0, good(20.0));
    }
}

static void outliers_that_do_not_agree_are_no_level(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(0.0, good(0.0));
    push_expect(10.0, 0.0, TL_OUTLIER);
    push_expect(11.5, 0.0, TL_OUTLIER);  /* too far from the first */
    push_expect(10.75, 0.0, TL_OUTLIER); /* near to both, but they are not near to each other */
    push_expect(-10.75, 0.0, TL_OUTLIER);
    push_expect(-11.0, 0.0, TL_OUTLIER);
    push_expect(-9.9, 0.0, TL_OUTLIER);  /* near to the first of three, too far from the second */
    push_expect(-10.4, 0.0, TL_OUTLIER); /* −11.0 and −9.9 do not agree */
    expect_bits(-10.2, good(-10.2));     /* the last three agree */
}

static void each_of_three_must_agree_with_each_other(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(0.0, good(0.0));
    push_expect(10.0, 0.0, TL_OUTLIER);
    push_expect(10.75, 0.0, TL_OUTLIER);
    push_expect(11.5, 0.0, TL_OUTLIER); /* near to the second, too far from the first */
    expect_bits(11.25, good(11.25));
}

static void an_accepted_sample_ends_the_row(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(0.0, good(0.0));
    for (int i = 0; i < 5; i++) {
        push_expect(10.0, 0.0, TL_OUTLIER);
        push_expect(10.0, 0.0, TL_OUTLIER);
        expect_bits(0.0, good(0.0));
    }
}

static void a_bad_sample_neither_makes_nor_breaks_the_row(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(0.0, good(0.0));
    push_expect(10.0, 0.0, TL_OUTLIER);
    push(10.0, TL_STALE);
    expect(0.0, TL_STALE);
    push_expect(10.0, 0.0, TL_OUTLIER);
    push(10.0, TL_STALE);
    expect(0.0, TL_STALE);
    expect_bits(10.0, good(10.0));
}

/* ---- Bad samples and gaps ---- */

static void bad_samples_are_held_and_do_not_enter(void) {
    create((tl_plan_condition){.median = 3, .low_pass = 3 * TL_SECOND});
    double last = 0.0;
    double expected[40];
    for (int i = 0; i < 40; i++) {
        expected[i] = good(sin(i));
    }
    create((tl_plan_condition){.median = 3, .low_pass = 3 * TL_SECOND});
    for (int i = 0; i < 40; i++) {
        last = good(sin(i));
        expect_bits(expected[i], last);
        push((double)NAN, TL_NOT_A_NUMBER);
        expect(last, TL_NOT_A_NUMBER);
        push(HUGE_VAL, TL_OUT_OF_RANGE);
        expect(last, TL_OUT_OF_RANGE);
    }
}

static void a_gap_of_ten_is_bridged_and_one_of_eleven_is_not(void) {
    const tl_plan_condition condition = {.low_pass = TL_SECOND}; /* delay 1 */
    create(condition);
    repeat(5, 0.0, TL_GOOD);
    repeat(TL_CONDITIONER_GAP, 0.0, TL_STALE);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.0 - exp(-1.0), good(1.0));
    create(condition);
    repeat(5, 0.0, TL_GOOD);
    repeat(TL_CONDITIONER_GAP + 1, 0.0, TL_STALE);
    push_expect(1.0, 0.0, TL_STALE); /* belongs to an instant in the gap */
    expect_bits(1.0, good(1.0));
}

static void a_gap_empties_the_median(void) {
    create((tl_plan_condition){.median = 3});
    repeat(5, 0.0, TL_GOOD);
    repeat(TL_CONDITIONER_GAP + 1, 0.0, TL_NO_LINK);
    push_expect(7.0, 0.0, TL_NO_LINK);
    expect_bits(8.0, good(8.0));
    expect_bits(7.0, good(6.0));
    expect_bits(6.0, good(1.0));
}

static void behind_a_gap_any_level_is_accepted(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(0.0, good(0.0));
    repeat(TL_CONDITIONER_GAP, 0.0, TL_STALE);
    push_expect(50.0, 0.0, TL_OUTLIER);
    expect_bits(60.0, good(60.0));       /* the outlier made the gap longer */
    push_expect(50.0, 60.0, TL_OUTLIER); /* and is not remembered */
    push_expect(50.0, 60.0, TL_OUTLIER);
    expect_bits(50.0, good(50.0));
}

static void a_gate_does_not_shut_out_for_ever_what_never_agrees(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(0.0, good(0.0));
    for (int i = 1; i <= TL_CONDITIONER_GAP + 1; i++) {
        push_expect(10.0 * i, 0.0, TL_OUTLIER);
    }
    expect_bits(500.0, good(500.0));
}

static void before_the_first_good_sample_there_is_nothing(void) {
    create((tl_plan_condition){.median = 5, .gate = 1.0});
    push(3.0, TL_NO_LINK);
    expect(0.0, TL_NO_LINK);
    push((double)NAN, TL_NOT_A_NUMBER);
    expect(0.0, TL_NOT_A_NUMBER);
    push_expect(8.0, 0.0, TL_NOT_A_NUMBER); /* two samples of delay: the plant of tick 0 is not known */
    push_expect(8.0, 0.0, TL_NOT_A_NUMBER);
    expect_bits(8.0, good(8.0));
}

static void a_first_sample_that_was_wrong_is_replaced(void) {
    create((tl_plan_condition){.gate = 1.0});
    expect_bits(1e6, good(1e6));
    push_expect(1.0, 1e6, TL_OUTLIER);
    push_expect(1.0, 1e6, TL_OUTLIER);
    expect_bits(1.0, good(1.0));
}

/* ---- Ring ---- */

static void the_newest_stands_for_what_is_not_there_yet(void) {
    create((tl_plan_condition){0});
    tl_quality quality = TL_GOOD;
    expect_bits(0.0, tl_conditioner_value(conditioner, 0, &quality));
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, quality);
    push(5.0, TL_GOOD);
    push(6.0, TL_GOOD);
    for (int64_t later = 1; later < 30; later++) {
        expect_bits(6.0, tl_conditioner_value(conditioner, later, &quality));
        TEST_ASSERT_EQUAL_INT(TL_GOOD, quality);
    }
    push(7.0, TL_STALE);
    expect_bits(6.0, tl_conditioner_value(conditioner, INT64_MAX, &quality));
    TEST_ASSERT_EQUAL_INT(TL_STALE, quality);
}

static void each_tick_of_the_window_keeps_its_own_output(void) {
    create((tl_plan_condition){0});
    while (tick < 10000) {
        bool is_bad = tick % 3 == 2;
        push((double)tick, is_bad ? TL_STALE : TL_GOOD);
        for (int64_t asked = tick > WINDOW ? tick - WINDOW : 0; asked < tick; asked++) {
            tl_quality quality = TL_NO_LINK;
            double expected = (double)(asked % 3 == 2 ? asked - 1 : asked);
            expect_bits(expected, tl_conditioner_value(conditioner, asked, &quality));
            TEST_ASSERT_EQUAL_INT(asked % 3 == 2 ? TL_STALE : TL_GOOD, quality);
        }
    }
}

static void no_window_is_one_of_the_newest(void) {
    conditioner = tl_conditioner_create(&arena, &(tl_plan_condition){0}, TL_SECOND, 0);
    TEST_ASSERT_NOT_NULL(conditioner);
    tick = 0;
    expect_bits(1.0, good(1.0));
    expect_bits(2.0, good(2.0));
}

static void without_memory_there_is_no_conditioner(void) {
    const tl_plan_condition condition = {.median = 5};
    TEST_ASSERT_NULL(tl_conditioner_create(&arena, &condition, TL_SECOND, SIZE_MAX));
    tl_arena_seal(&arena);
    TEST_ASSERT_NULL(tl_conditioner_create(&arena, &condition, TL_SECOND, WINDOW));
}

static void nothing_is_taken_after_the_creation(void) {
    create((tl_plan_condition){.median = 99, .low_pass = TL_SECOND, .gate = 1.0});
    size_t used = tl_arena_used(&arena);
    repeat(500, 1.0, TL_GOOD);
    TEST_ASSERT_EQUAL_UINT64(used, tl_arena_used(&arena));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(what_is_asked_for_is_needed);
    RUN_TEST(without_conditioning_every_bit_passes);
    RUN_TEST(a_constant_passes_every_filter_to_the_bit);
    RUN_TEST(the_delay_is_that_of_both_filters);
    RUN_TEST(the_delay_counts_in_macro_steps);
    RUN_TEST(a_delay_that_cannot_be_counted_is_the_largest_number);
    RUN_TEST(a_median_delays_a_ramp_by_exactly_its_delay);
    RUN_TEST(a_low_pass_delays_a_ramp_by_its_lag);
    RUN_TEST(a_low_pass_with_a_whole_lag_has_exactly_the_declared_delay);
    RUN_TEST(a_low_pass_answers_a_step_as_the_equation_says);
    RUN_TEST(a_median_that_fills_takes_the_newer_of_two_in_the_middle);
    RUN_TEST(a_median_is_the_middle_of_its_window_sorted);
    RUN_TEST(noise_is_reduced_as_theory_says);
    RUN_TEST(the_median_comes_before_the_low_pass);
    RUN_TEST(spikes_vanish_in_a_gate);
    RUN_TEST(spikes_leave_nothing_in_the_filters_behind_a_gate);
    RUN_TEST(one_spike_and_two_vanish_in_a_median_of_five);
    RUN_TEST(the_edge_of_the_gate_is_inside);
    RUN_TEST(what_drifts_is_followed);
    RUN_TEST(a_step_passes_at_its_third_sample);
    RUN_TEST(behind_a_step_a_median_knows_only_the_new_level);
    RUN_TEST(a_new_level_comes_out_at_the_instant_it_belongs_to);
    RUN_TEST(outliers_that_do_not_agree_are_no_level);
    RUN_TEST(each_of_three_must_agree_with_each_other);
    RUN_TEST(an_accepted_sample_ends_the_row);
    RUN_TEST(a_bad_sample_neither_makes_nor_breaks_the_row);
    RUN_TEST(bad_samples_are_held_and_do_not_enter);
    RUN_TEST(a_gap_of_ten_is_bridged_and_one_of_eleven_is_not);
    RUN_TEST(a_gap_empties_the_median);
    RUN_TEST(behind_a_gap_any_level_is_accepted);
    RUN_TEST(a_gate_does_not_shut_out_for_ever_what_never_agrees);
    RUN_TEST(before_the_first_good_sample_there_is_nothing);
    RUN_TEST(a_first_sample_that_was_wrong_is_replaced);
    RUN_TEST(the_newest_stands_for_what_is_not_there_yet);
    RUN_TEST(each_tick_of_the_window_keeps_its_own_output);
    RUN_TEST(no_window_is_one_of_the_newest);
    RUN_TEST(without_memory_there_is_no_conditioner);
    RUN_TEST(nothing_is_taken_after_the_creation);
    return UNITY_END();
}
