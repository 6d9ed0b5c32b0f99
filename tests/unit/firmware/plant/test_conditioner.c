/* Conditioning of readings: gate, median, low-pass, bad readings and gaps; and the stamps of the
 * results. */
#include <float.h>
#include <math.h>
#include <string.h>
#include <unity.h>

#include "firmware/plant/conditioner.h"
#include "tests/support/random_numbers.h"

enum { MOST = 99 };

static const tl_time MS = TL_SECOND / 1000;

static tl_conditioner conditioner;
static tl_conditioned out[TL_CONDITIONER_LEVEL];
static bool is_rejected;
static tl_time now;

void setUp(void) {}

void tearDown(void) {}

static void create(tl_condition condition) {
    tl_conditioner_init(&conditioner, &condition, 0);
    now = 0;
}

/* Adds a reading that comes `wait` later. Returns the number of results. */
static size_t take_after(tl_time wait, double value, tl_quality quality) {
    now += wait;
    const tl_reading reading = {.value = value, .stamp = now, .quality = quality};
    return tl_conditioner_take(&conditioner, &reading, &is_rejected, out);
}

static size_t take(double value) {
    return take_after(10 * MS, value, TL_GOOD);
}

static void expect_one(size_t count, double value, tl_time stamp) {
    TEST_ASSERT_EQUAL_size_t(1, count);
    TEST_ASSERT_EQUAL_MEMORY(&value, &out[0].reading.value, sizeof value);
    TEST_ASSERT_EQUAL_INT64(stamp, out[0].reading.stamp);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, out[0].reading.quality);
    TEST_ASSERT_FALSE(is_rejected);
}

/* The result has the stamp of the newest reading. */
static void expect_here(size_t count, double value) {
    expect_one(count, value, now);
}

static void expect_rejected(double value) {
    TEST_ASSERT_EQUAL_size_t(0, take(value));
    TEST_ASSERT_TRUE(is_rejected);
}

/* ---- without a condition ---- */

static void what_is_asked_for_is_needed(void) {
    TEST_ASSERT_FALSE(tl_condition_is_needed(&(tl_condition){0}));
    TEST_ASSERT_FALSE(tl_condition_is_needed(&(tl_condition){.median = 1}));
    TEST_ASSERT_TRUE(tl_condition_is_needed(&(tl_condition){.median = 3}));
    TEST_ASSERT_TRUE(tl_condition_is_needed(&(tl_condition){.low_pass = 1}));
    TEST_ASSERT_TRUE(tl_condition_is_needed(&(tl_condition){.gate = 1e-300}));
    TEST_ASSERT_TRUE(tl_condition_is_needed(&(tl_condition){.leap = 1e-300}));
    TEST_ASSERT_FALSE(tl_condition_is_needed(&(tl_condition){.keeps_outliers = true}));
}

static void without_conditioning_every_bit_passes(void) {
    static const double values[] = {0.1, -0.0, 0.0, DBL_MAX, -DBL_MAX, 4.9e-324, -1.0 / 3.0, 1e9};
    create((tl_condition){.median = 1});
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        expect_here(take(values[i]), values[i]);
    }
}

/* ---- median ---- */

/* Until the window is full, the median uses as many readings as there are if that is odd. */
static void a_median_belongs_to_the_reading_in_its_middle(void) {
    create((tl_condition){.median = 5});
    expect_one(take(3), 3, 10 * MS);
    TEST_ASSERT_EQUAL_size_t(0, take(1));
    expect_one(take(2), 2, 20 * MS);
    TEST_ASSERT_EQUAL_size_t(0, take(9));
    expect_one(take(8), 3, 30 * MS);
    expect_one(take(7), 7, 40 * MS); /* 1 2 9 8 7 */
    expect_one(take(-5), 7, 50 * MS);
    expect_one(take(-6), 7, 60 * MS); /* 9 8 7 −5 −6 */
    expect_one(take(-7), -5, 70 * MS);
}

/* Compares with a sorted copy of each window. */
static void the_median_is_that_of_its_window(void) {
    static double values[1000];
    uint32_t seed = 5;
    for (uint32_t size = 3; size <= MOST; size += 16) {
        create((tl_condition){.median = size});
        for (size_t i = 0; i < 1000; i++) {
            values[i] = (double)tl_test_any(&seed, 40);
            size_t count = take(values[i]);
            if (i + 1 < size) {
                continue;
            }
            size_t below = 0;
            size_t equal = 0;
            for (size_t k = i + 1 - size; k <= i; k++) {
                below += values[k] < out[0].reading.value ? 1 : 0;
                equal += values[k] <= out[0].reading.value && values[k] >= out[0].reading.value ? 1 : 0;
            }
            TEST_ASSERT_EQUAL_size_t(1, count);
            TEST_ASSERT_TRUE(below <= size / 2 && below + equal > size / 2);
        }
    }
}

/* ---- low-pass ---- */

static const tl_time TAU = 30 * TL_SECOND / 1000;

/* The smoothed value halfway between the previous result and the present one. */
static double smooth_in_the_middle(const tl_conditioned *before) {
    tl_time middle = before->reading.stamp + (out[0].reading.stamp - before->reading.stamp) / 2;
    return tl_conditioner_between(TAU, before, &out[0].reading, middle);
}

/* With readings at uneven times, a ramp comes out τ later once the start is forgotten, also
 * between readings. */
static void a_low_pass_lags_a_ramp_by_its_time_constant(void) {
    uint32_t seed = 3;
    tl_conditioned before = {.smooth = 0};
    create((tl_condition){.low_pass = TAU});
    for (int i = 0; i < 1000; i++) {
        tl_time wait = (tl_time)(25 + tl_test_any(&seed, 16)) * MS;
        TEST_ASSERT_EQUAL_size_t(1, take_after(wait, 2.0 + 5.0 * tl_seconds(now + wait), TL_GOOD));
        if (i > 40) {
            double half = 0.5 * tl_seconds(now - before.reading.stamp);
            TEST_ASSERT_DOUBLE_WITHIN(1e-9, 2.0 + 5.0 * tl_seconds(now - TAU), out[0].smooth);
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, out[0].smooth - 5.0 * half, smooth_in_the_middle(&before));
        }
        before = out[0];
    }
}

/* The solution of τ dy/dt = x − y: a thousand readings on the same line give the same result. */
static void a_low_pass_is_the_same_however_often_its_line_is_read(void) {
    static const double values[] = {1, 5, -3, 4, 4, 4, 0};
    tl_conditioner often;
    tl_conditioned fine[TL_CONDITIONER_LEVEL];
    const tl_condition condition = {.low_pass = TAU};
    tl_conditioner_init(&often, &condition, 0);
    create(condition);
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        double from = i == 0 ? values[0] : values[i - 1];
        for (int k = 1; k <= 1000; k++) {
            const tl_reading reading = {.value = from + (values[i] - from) * k / 1000, .stamp = now + k * MS / 100};
            (void)tl_conditioner_take(&often, &reading, &is_rejected, fine);
        }
        (void)take_after(10 * MS, values[i], TL_GOOD);
        TEST_ASSERT_DOUBLE_WITHIN(i == 0 ? 1e-12 : 1e-6, fine[0].smooth, out[0].smooth);
    }
}

/* The largest finite values do not make the filter infinite or NaN. */
static void the_largest_numbers_pass(void) {
    create((tl_condition){.low_pass = 10 * MS});
    for (int i = 0; i < 10; i++) {
        (void)take(i % 2 == 0 ? DBL_MAX : -DBL_MAX);
        TEST_ASSERT_TRUE(isfinite(out[0].smooth));
    }
    for (int i = 0; i < 2000; i++) {
        (void)take(1.0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.0, out[0].smooth);
}

/* ---- gate ---- */

static void one_wild_reading_is_rejected(void) {
    create((tl_condition){.gate = 5});
    expect_here(take(100), 100); /* the first reading is always accepted */
    expect_rejected(106);
    expect_here(take(105), 105);
    expect_rejected(99);
    expect_rejected(111);
    expect_here(take(101), 101);
}

static void the_third_reading_of_a_new_level_is_accepted(void) {
    create((tl_condition){.gate = 5});
    (void)take(100);
    expect_rejected(200);
    expect_rejected(203);
    TEST_ASSERT_EQUAL_size_t(3, take(198));
    TEST_ASSERT_FALSE(is_rejected);
    for (size_t i = 0; i < 3; i++) {
        static const double values[] = {200, 203, 198};
        TEST_ASSERT_EQUAL_DOUBLE(values[i], out[i].reading.value);
        TEST_ASSERT_EQUAL_INT64(now - (tl_time)(2 - i) * 10 * MS, out[i].reading.stamp);
    }
    expect_here(take(202), 202);
}

static void three_that_do_not_agree_are_no_level(void) {
    create((tl_condition){.gate = 5});
    (void)take(100);
    expect_rejected(200);
    expect_rejected(150);
    expect_rejected(152);
    TEST_ASSERT_EQUAL_size_t(3, take(154));
}

/* A bad reading neither counts as a jump of the level nor interrupts the count. */
static void a_row_goes_on_behind_a_bad_reading(void) {
    create((tl_condition){.gate = 5});
    (void)take(100);
    expect_rejected(200);
    expect_rejected(201);
    TEST_ASSERT_EQUAL_size_t(1, take_after(10 * MS, 0, TL_NO_LINK));
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, out[0].reading.quality);
    /* The rejected readings before the bad one are older than its stamp, so they are dropped. */
    expect_here(take(202), 202);
}

/* After a jump of the level, the filters contain nothing of the old level. */
static void the_filters_begin_anew_at_a_new_level(void) {
    create((tl_condition){.gate = 5, .median = 3, .low_pass = 1000 * MS});
    for (int i = 0; i < 50; i++) {
        (void)take(100);
    }
    expect_rejected(200);
    expect_rejected(200);
    TEST_ASSERT_EQUAL_size_t(2, take(200)); /* 200 alone, then the median of three */
    TEST_ASSERT_EQUAL_DOUBLE(200, out[0].reading.value);
    TEST_ASSERT_EQUAL_DOUBLE(200, out[1].reading.value);
    TEST_ASSERT_EQUAL_DOUBLE(200, out[1].smooth);
}

/* ---- leap ---- */

/* Noise with a uniform distribution of this width. */
static double noise(uint32_t *seed, double width) {
    return width * ((double)tl_test_any(seed, 1001) / 1000.0 - 0.5);
}

/* Takes a reading that must pass at once, with every bit. */
static void passes(double value) {
    expect_here(take(value), value);
}

static void create_with_noise(uint32_t *seed) {
    create((tl_condition){.leap = 6});
    for (int i = 0; i < 100; i++) {
        passes(50 + noise(seed, 2));
    }
}

static void isolated_outliers_are_rejected(void) {
    uint32_t seed = 5;
    create_with_noise(&seed);
    for (int i = 0; i < 1000; i++) {
        if (i % 50 == 20) {
            expect_rejected(50 + (i % 100 == 20 ? 1.0 : -1.0) * (10 + tl_test_any(&seed, 1000)));
        }
        passes(50 + noise(&seed, 2));
    }
}

static void two_outliers_in_a_row_are_rejected(void) {
    uint32_t seed = 5;
    create_with_noise(&seed);
    expect_rejected(90);
    expect_rejected(86); /* further from the first one than any move so far */
    passes(50);
    expect_rejected(20);
    expect_rejected(70);
    passes(50);
}

/* The next reading confirms a step, and both are used with their own stamps. The low-pass does not
 * restart. */
static void a_step_is_accepted_with_its_second_reading(void) {
    create((tl_condition){.leap = 6, .low_pass = 1000 * MS});
    (void)take(50);
    (void)take(50.5);
    expect_rejected(80);
    TEST_ASSERT_EQUAL_size_t(2, take(80.25));
    TEST_ASSERT_EQUAL_DOUBLE(80, out[0].reading.value);
    TEST_ASSERT_EQUAL_INT64(now - 10 * MS, out[0].reading.stamp);
    TEST_ASSERT_EQUAL_DOUBLE(80.25, out[1].reading.value);
    TEST_ASSERT_TRUE(out[1].smooth < 60);
    passes(80);
}

/* A reading in the middle shows a motion, not an outlier. */
static void a_turn_of_the_plant_is_no_outlier(void) {
    create((tl_condition){.leap = 6});
    passes(50);
    passes(50.5);
    expect_rejected(57);
    TEST_ASSERT_EQUAL_size_t(2, take(53));
    passes(53);
    expect_rejected(62);
    passes(54); /* clearly nearer */
}

/* From rest to 100 times the limit per reading: the third reading shows the motion. */
static void a_steep_ramp_is_accepted_with_its_third_reading(void) {
    uint32_t seed = 5;
    create_with_noise(&seed);
    expect_rejected(650);
    expect_rejected(1250);
    TEST_ASSERT_EQUAL_size_t(3, take(1850));
    for (int i = 0; i < 300; i++) {
        passes(2450 + 600 * i);
    }
}

/* Each move is less than twice the largest one before. */
static void a_motion_that_grows_passes(void) {
    double value = 0;
    create((tl_condition){.leap = 6});
    passes(value);
    for (double move = 0.1; move < 1e6; move *= 1.2) {
        value += move;
        passes(value);
    }
}

/* A tolerance that is too small for the noise: the limit follows the noise within some readings. */
static void noise_above_the_limit_passes(void) {
    uint32_t seed = 7;
    create((tl_condition){.leap = 1});
    for (int i = 0; i < 50; i++) {
        (void)take(noise(&seed, 3));
    }
    for (int i = 0; i < 10000; i++) {
        passes(noise(&seed, 3));
    }
}

/* The smallest move is the resolution: twice that is never a leap, however long the signal rests. */
static void a_coarse_signal_passes(void) {
    create((tl_condition){.leap = 1});
    for (int i = 0; i < 20; i++) {
        for (int k = 0; k < 3000; k++) {
            passes(0);
        }
        passes(i % 2 == 0 ? 100 : -200);
    }
}

/* A value that was frozen continues anywhere. */
static void a_freeze_passes(void) {
    uint32_t seed = 5;
    create_with_noise(&seed);
    double value = 50 + noise(&seed, 2);
    for (int i = 0; i < 3000; i++) {
        passes(value);
    }
    expect_rejected(75);
    TEST_ASSERT_EQUAL_size_t(2, take(75.001));
}

/* An outlier within the limit is used, but it does not widen the limit so far that the next ones
 * are used too. */
static void a_used_outlier_does_not_hide_others(void) {
    uint32_t seed = 5;
    create_with_noise(&seed);
    for (int i = 0; i < 5; i++) {
        passes(55);
        passes(50);
    }
    expect_rejected(65);
    passes(50);
}

/* A source that reports changes only: after four intervals without a next reading, a leap counts,
 * however often it is asked. */
static void a_last_reading_is_accepted_in_time(void) {
    for (int asks = 0; asks < 2; asks++) {
        create((tl_condition){.leap = 6});
        passes(50);
        passes(50.5);
        expect_rejected(80);
        TEST_ASSERT_EQUAL_size_t(0, tl_conditioner_wait(&conditioner, now + 40 * MS, out));
        if (asks == 0) {
            TEST_ASSERT_EQUAL_size_t(2, take_after(41 * MS, 79, TL_GOOD));
            TEST_ASSERT_FALSE(is_rejected);
        } else {
            TEST_ASSERT_EQUAL_size_t(1, tl_conditioner_wait(&conditioner, now + 41 * MS, out));
        }
        TEST_ASSERT_EQUAL_DOUBLE(80, out[0].reading.value);
        TEST_ASSERT_EQUAL_size_t(0, tl_conditioner_wait(&conditioner, now + TL_SECOND, out));
    }
}

/* ---- gaps ---- */

static void after_a_gap_any_reading_is_accepted(void) {
    create((tl_condition){.gate = 5});
    (void)take(100);
    for (int i = 0; i < TL_CONDITIONER_GAP; i++) {
        (void)take_after(10 * MS, 0, TL_OUT_OF_RANGE);
    }
    expect_rejected(200);
    expect_here(take(300), 300);
}

static void after_what_makes_one_stale_any_reading_is_accepted(void) {
    static const tl_condition condition = {.gate = 5};
    tl_conditioner_init(&conditioner, &condition, 200 * MS);
    now = 0;
    (void)take(100);
    TEST_ASSERT_EQUAL_size_t(0, take_after(200 * MS, 200, TL_GOOD));
    expect_here(take_after(1, 300, TL_GOOD), 300);
}

/* Stamps of results increase, for all kinds of conditions and readings. */
static void stamps_go_up(void) {
    uint32_t seed = 11;
    for (int i = 0; i < 200; i++) {
        tl_time newest = -1;
        double gate = (double)tl_test_any(&seed, 3);
        create((tl_condition){.gate = gate,
                              .leap = gate > 0 ? 0 : (double)tl_test_any(&seed, 3),
                              .median = 2 * tl_test_any(&seed, 5) + 1,
                              .low_pass = (tl_time)tl_test_any(&seed, 3) * 20 * MS});
        for (int k = 0; k < 300; k++) {
            tl_quality quality = tl_test_any(&seed, 5) == 0 ? TL_NO_LINK : TL_GOOD;
            size_t count = take_after(1 + (tl_time)tl_test_any(&seed, 30) * MS, tl_test_any(&seed, 7), quality);
            TEST_ASSERT_TRUE(count <= TL_CONDITIONER_LEVEL && !(is_rejected && gate > 0 && count != 0));
            for (size_t n = 0; n < count; n++) {
                TEST_ASSERT_TRUE(out[n].reading.stamp > newest && out[n].reading.stamp <= now);
                newest = out[n].reading.stamp;
            }
        }
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(what_is_asked_for_is_needed);
    RUN_TEST(without_conditioning_every_bit_passes);
    RUN_TEST(a_median_belongs_to_the_reading_in_its_middle);
    RUN_TEST(the_median_is_that_of_its_window);
    RUN_TEST(a_low_pass_lags_a_ramp_by_its_time_constant);
    RUN_TEST(a_low_pass_is_the_same_however_often_its_line_is_read);
    RUN_TEST(the_largest_numbers_pass);
    RUN_TEST(one_wild_reading_is_rejected);
    RUN_TEST(the_third_reading_of_a_new_level_is_accepted);
    RUN_TEST(three_that_do_not_agree_are_no_level);
    RUN_TEST(a_row_goes_on_behind_a_bad_reading);
    RUN_TEST(the_filters_begin_anew_at_a_new_level);
    RUN_TEST(isolated_outliers_are_rejected);
    RUN_TEST(two_outliers_in_a_row_are_rejected);
    RUN_TEST(a_step_is_accepted_with_its_second_reading);
    RUN_TEST(a_turn_of_the_plant_is_no_outlier);
    RUN_TEST(a_steep_ramp_is_accepted_with_its_third_reading);
    RUN_TEST(a_motion_that_grows_passes);
    RUN_TEST(noise_above_the_limit_passes);
    RUN_TEST(a_coarse_signal_passes);
    RUN_TEST(a_freeze_passes);
    RUN_TEST(a_used_outlier_does_not_hide_others);
    RUN_TEST(a_last_reading_is_accepted_in_time);
    RUN_TEST(after_a_gap_any_reading_is_accepted);
    RUN_TEST(after_what_makes_one_stale_any_reading_is_accepted);
    RUN_TEST(stamps_go_up);
    return UNITY_END();
}
