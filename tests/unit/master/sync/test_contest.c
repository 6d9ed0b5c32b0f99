/* The free-run check: which of two twins is nearer to the plant. The test knows the true value;
 * the check sees only errors. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/sync/free_twin.h"
#include "tests/support/random_numbers.h"

enum { GUARD = 4, TRIALS = 600 };

/* A plant whose true value is 0, and two twins of it. */
typedef struct world {
    double noise;  /* standard deviation of a measurement */
    double gain;   /* the part of the noise that the locked twin follows */
    double bias;   /* constant error of the free twin */
    double drift;  /* its change in each trial */
    double unrest; /* random error of the free twin and of a prediction, new in each trial */
    double swing;  /* amplitude of a periodic error of both */
    double pace;   /* its phase per trial */
    bool spikes;   /* one of fifty measurements is far off */
} world;

static tl_free_run_check free_run_check;
static tl_free_run_check_verdict verdict;
static tl_test_random numbers;
static double followed; /* noise of the last measurement that the locked twin follows */
static uint32_t trial;  /* trials so far */

void setUp(void) {
    free_run_check = (tl_free_run_check){.guard = GUARD};
    verdict = (tl_free_run_check_verdict){0};
    numbers = (tl_test_random){7};
    followed = 0.0;
    trial = 0;
}

void tearDown(void) {}

/* Approximately normal: the sum of twelve uniform numbers. */
static double normal(double deviation) {
    double sum = -6.0;
    for (int i = 0; i < 12; i++) {
        sum += tl_test_random_number(&numbers, 0.0, 1.0);
    }
    return deviation * sum;
}

/* The prediction starts from the locked twin, which had followed the noise of that moment. */
static void one_trial(const world *of) {
    double began = followed;
    double swing = of->swing * sin(of->pace * trial);
    double unknown = normal(of->unrest) + swing;
    double free = of->bias + of->drift * trial + normal(of->unrest) + swing;
    for (int step = 0; step < GUARD && !verdict.turned && !verdict.renew; step++) {
        double noise = normal(of->noise);
        noise += of->spikes && tl_test_random_chance(&numbers, 2) ? 40.0 : 0.0;
        followed = free_run_check.rests ? 0.0 : of->gain * noise;
        double rested = free_run_check.rests ? of->bias + of->drift * trial : followed;
        const tl_free_run_check_errors errors = {
            .locked = {rested - noise}, .free = {free - noise}, .predicted = {began + unknown - noise}, .weight = 1.0};
        verdict = tl_free_run_check_step(&free_run_check, &errors, true);
        TEST_ASSERT_EQUAL_INT(step == GUARD - 1 && !free_run_check.rests, verdict.predict);
    }
    trial++;
}

/* Until a verdict, at most `most` trials. */
static void go_on(const world *of, uint32_t most) {
    verdict = (tl_free_run_check_verdict){0};
    for (trial = 0; trial < most && !verdict.turned && !verdict.renew;) {
        one_trial(of);
    }
}

/* ---- while it is locked ---- */

static void u_rests_if_the_model_is_right(void) {
    go_on(&(world){.noise = 0.3, .gain = 1.0}, TRIALS);
    TEST_ASSERT_TRUE(verdict.turned && verdict.adopt && free_run_check.rests);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(TL_FREE_RUN_CHECK_LEAST, trial);
    TEST_ASSERT_LESS_THAN_UINT32(100, trial);
}

static void and_if_it_is_a_little_off(void) {
    go_on(&(world){.noise = 0.3, .gain = 1.0, .bias = 0.15}, TRIALS);
    TEST_ASSERT_TRUE(verdict.turned && free_run_check.rests);
}

/* Against the measurements, the locked twin would seem nearer, because it follows part of their
 * noise. */
static void and_if_the_lock_follows_only_a_part_of_the_noise(void) {
    go_on(&(world){.noise = 0.3, .gain = 0.7, .bias = 0.05}, TRIALS);
    TEST_ASSERT_TRUE(verdict.turned && free_run_check.rests);
}

static void it_stays_locked_if_the_free_twin_is_further_off(void) {
    go_on(&(world){.noise = 0.3, .gain = 1.0, .bias = 0.45}, 5 * TL_FREE_RUN_CHECK_TRIALS);
    TEST_ASSERT_FALSE(verdict.turned || free_run_check.rests);
}

/* A prediction is then no better than the free twin, but the measurement is. */
static void it_stays_locked_if_nobody_can_predict(void) {
    go_on(&(world){.noise = 0.3, .gain = 1.0, .unrest = 0.5}, 5 * TL_FREE_RUN_CHECK_TRIALS);
    TEST_ASSERT_FALSE(verdict.turned || free_run_check.rests);
}

/* A swing has opposite signs in two consecutive predictions, like noise. But noise is below half a
 * tolerance. */
static void it_stays_locked_if_what_it_does_not_know_swings(void) {
    for (int i = 1; i <= 31; i++) {
        setUp();
        go_on(&(world){.noise = 0.3, .gain = 1.0, .swing = 2.0, .pace = 0.1 * i}, 5 * TL_FREE_RUN_CHECK_TRIALS);
        TEST_ASSERT_FALSE(verdict.turned || free_run_check.rests);
    }
}

static void it_stays_locked_if_there_is_no_noise(void) {
    go_on(&(world){.noise = 0.0, .gain = 1.0}, TRIALS);
    TEST_ASSERT_FALSE(verdict.turned || verdict.renew || free_run_check.rests);
}

static void outliers_do_not_decide(void) {
    go_on(&(world){.noise = 0.3, .gain = 0.0, .bias = 0.6, .spikes = true}, 5 * TL_FREE_RUN_CHECK_TRIALS);
    TEST_ASSERT_FALSE(verdict.turned || free_run_check.rests);
}

/* The free twin was nearer on average, but is not any more. */
static void a_free_twin_that_drifts_away_is_not_adopted(void) {
    uint32_t adopted = 0;
    uint32_t turned = 0;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        setUp();
        numbers.state = seed;
        go_on(&(world){.noise = 0.3, .gain = 1.0, .bias = -0.3, .drift = 0.02}, TL_FREE_RUN_CHECK_TRIALS);
        turned += verdict.turned ? 1 : 0;
        adopted += verdict.adopt ? 1 : 0;
    }
    TEST_ASSERT_GREATER_THAN_UINT32(adopted, turned + 1);
}

static void one_that_has_lost_for_long_begins_anew(void) {
    go_on(&(world){.noise = 0.3, .gain = 1.0, .bias = 2.0}, TRIALS);
    TEST_ASSERT_TRUE(verdict.renew && !free_run_check.rests);
    TEST_ASSERT_EQUAL_UINT32(TL_FREE_RUN_CHECK_LOST * TL_FREE_RUN_CHECK_TRIALS, trial);
}

/* Returns the number of trials until u rests, at most `most`. A restart of the free twin does not
 * end the count. */
static uint32_t trials_to_rest(const world *of, uint32_t most) {
    for (trial = 0; trial < most && !free_run_check.rests;) {
        verdict = (tl_free_run_check_verdict){0};
        one_trial(of);
    }
    return trial;
}

/* The disturbance hid the noise. An average over a thousand trials would contain it for minutes. */
static void it_forgets_what_was_before_times_have_changed(void) {
    uint32_t most = TL_FREE_RUN_CHECK_MEMORY;
    TEST_ASSERT_EQUAL_UINT32(most,
                             trials_to_rest(&(world){.noise = 0.3, .gain = 1.0, .swing = 1.0, .pace = 0.6}, most));
    TEST_ASSERT_TRUE(free_run_check.known.noise.mean < 0.0);
    TEST_ASSERT_LESS_THAN_UINT32(8 * TL_FREE_RUN_CHECK_TRIALS,
                                 trials_to_rest(&(world){.noise = 0.3, .gain = 1.0}, most));
    TEST_ASSERT_TRUE(free_run_check.known.noise.mean > 0.0);
}

/* The noise is so much larger that each prediction looks like a disturbance of the plant. */
static void and_if_a_sensor_becomes_worse(void) {
    uint32_t most = 5 * TL_FREE_RUN_CHECK_TRIALS;
    TEST_ASSERT_EQUAL_UINT32(most, trials_to_rest(&(world){.noise = 0.1, .gain = 1.0, .bias = 0.2}, most));
    TEST_ASSERT_LESS_THAN_UINT32(most, trials_to_rest(&(world){.noise = 0.4, .gain = 1.0, .bias = 0.2}, most));
}

/* ---- while u rests ---- */

static void let_it_rest(void) {
    go_on(&(world){.noise = 0.3, .gain = 1.0}, TRIALS);
    TEST_ASSERT_TRUE(free_run_check.rests);
}

static void it_rests_on_while_the_model_is_right(void) {
    let_it_rest();
    go_on(&(world){.noise = 0.3, .gain = 1.0}, 20 * TRIALS);
    TEST_ASSERT_TRUE(free_run_check.rests && !verdict.renew);
}

static void what_jumps_ends_it_at_once(void) {
    let_it_rest();
    go_on(&(world){.noise = 0.3, .gain = 1.0, .bias = 1.5}, TRIALS);
    TEST_ASSERT_TRUE(verdict.turned && verdict.predict && !free_run_check.rests);
    TEST_ASSERT_EQUAL_UINT32(2, trial);
}

static void what_is_off_for_long_ends_it(void) {
    let_it_rest();
    go_on(&(world){.noise = 0.3, .gain = 1.0, .bias = 0.45}, TRIALS);
    TEST_ASSERT_TRUE(verdict.turned && !free_run_check.rests);
    TEST_ASSERT_LESS_THAN_UINT32(TL_FREE_RUN_CHECK_TRIALS, trial);
}

/* ---- missing and invalid values ---- */

static void nothing_measured_says_nothing(void) {
    const tl_free_run_check_errors errors = {.weight = 1.0};
    for (uint32_t i = 0; i < GUARD * TRIALS; i++) {
        verdict = tl_free_run_check_step(&free_run_check, &errors, i % 3 == 0);
        TEST_ASSERT_FALSE(verdict.turned || verdict.renew || verdict.adopt);
    }
    TEST_ASSERT_EQUAL_UINT32(0, free_run_check.known.count); /* no prediction ended with a measurement */
}

static void what_is_not_finite_is_as_far_as_can_be(void) {
    const tl_free_run_check_errors errors = {
        .locked = {0.1}, .free = {(double)NAN, HUGE_VAL}, .predicted = {-HUGE_VAL}, .weight = 1.0};
    for (uint32_t i = 0; i < GUARD * TL_FREE_RUN_CHECK_LOST * TL_FREE_RUN_CHECK_TRIALS; i++) {
        verdict = tl_free_run_check_step(&free_run_check, &errors, true);
        TEST_ASSERT_FALSE(verdict.turned);
    }
    TEST_ASSERT_TRUE(verdict.renew && isfinite(free_run_check.known.noise.mean));
}

/* ---- as bytes ---- */

static unsigned char bytes[4096];

static size_t save(void) {
    tl_archive archive = tl_archive_saving(bytes, sizeof bytes);
    tl_free_run_check_archive(&free_run_check, &archive);
    TEST_ASSERT_TRUE(tl_archive_is_whole(&archive));
    return archive.at;
}

static bool load(tl_free_run_check *into, size_t size) {
    *into = (tl_free_run_check){.guard = GUARD};
    tl_archive archive = tl_archive_loading(bytes, size);
    tl_free_run_check_archive(into, &archive);
    return tl_archive_is_whole(&archive);
}

static void it_comes_back_from_its_bytes(void) {
    static tl_free_run_check other;
    let_it_rest();
    size_t size = save();
    TEST_ASSERT_TRUE(load(&other, size));
    TEST_ASSERT_TRUE(other.rests);
    TEST_ASSERT_EQUAL_MEMORY(&free_run_check.trial, &other.trial, sizeof free_run_check.trial);
    TEST_ASSERT_EQUAL_MEMORY(&free_run_check.known, &other.known, sizeof free_run_check.known);
    TEST_ASSERT_EQUAL_MEMORY(&free_run_check.recent, &other.recent, sizeof free_run_check.recent);
    TEST_ASSERT_FALSE(load(&other, size - 1));
}

static void counts_that_cannot_be_are_refused(void) {
    static tl_free_run_check other;
    free_run_check.at = TL_FREE_RUN_CHECK_TRIALS;
    TEST_ASSERT_FALSE(load(&other, save()));
    free_run_check.at = 0;
    free_run_check.steps = GUARD;
    TEST_ASSERT_FALSE(load(&other, save()));
    free_run_check.steps = 0;
    free_run_check.excess = (double)NAN;
    TEST_ASSERT_FALSE(load(&other, save()));
    free_run_check.excess = 0.0;
    free_run_check.recent.count = TL_FREE_RUN_CHECK_RECENT + 1;
    TEST_ASSERT_FALSE(load(&other, save()));
    free_run_check.recent.count = 0;
    free_run_check.known.noise.square = HUGE_VAL;
    TEST_ASSERT_FALSE(load(&other, save()));
    free_run_check.known.noise.square = 0.0;
    TEST_ASSERT_TRUE(load(&other, save()));
}

static void to_begin_anew_keeps_what_is_known_of_the_noise(void) {
    let_it_rest();
    double noise = free_run_check.known.noise.mean;
    TEST_ASSERT_DOUBLE_WITHIN(0.03, 0.09, noise);
    tl_free_run_check_reset(&free_run_check);
    TEST_ASSERT_FALSE(free_run_check.rests);
    TEST_ASSERT_EQUAL_UINT32(0, free_run_check.count);
    TEST_ASSERT_EQUAL_DOUBLE(noise, free_run_check.known.noise.mean);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(u_rests_if_the_model_is_right);
    RUN_TEST(and_if_it_is_a_little_off);
    RUN_TEST(and_if_the_lock_follows_only_a_part_of_the_noise);
    RUN_TEST(it_stays_locked_if_the_free_twin_is_further_off);
    RUN_TEST(it_stays_locked_if_nobody_can_predict);
    RUN_TEST(it_stays_locked_if_what_it_does_not_know_swings);
    RUN_TEST(it_stays_locked_if_there_is_no_noise);
    RUN_TEST(outliers_do_not_decide);
    RUN_TEST(a_free_twin_that_drifts_away_is_not_adopted);
    RUN_TEST(one_that_has_lost_for_long_begins_anew);
    RUN_TEST(it_forgets_what_was_before_times_have_changed);
    RUN_TEST(and_if_a_sensor_becomes_worse);
    RUN_TEST(it_rests_on_while_the_model_is_right);
    RUN_TEST(what_jumps_ends_it_at_once);
    RUN_TEST(what_is_off_for_long_ends_it);
    RUN_TEST(nothing_measured_says_nothing);
    RUN_TEST(what_is_not_finite_is_as_far_as_can_be);
    RUN_TEST(it_comes_back_from_its_bytes);
    RUN_TEST(counts_that_cannot_be_are_refused);
    RUN_TEST(to_begin_anew_keeps_what_is_known_of_the_noise);
    return UNITY_END();
}
