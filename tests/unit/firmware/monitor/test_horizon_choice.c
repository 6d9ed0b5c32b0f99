/* Choice of the horizon: each rule with trials whose errors are given. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/horizon_choice.h"

enum { AGES = 12, STEPS = 5000 };

static tl_horizon_choice choice;

/* A trial whose released twins have the mean square error `square` at each age. */
static tl_horizon_trial *add(uint32_t prediction, double square) {
    tl_horizon_trial *trial = &choice.trial[choice.count++];
    *trial = (tl_horizon_trial){.prediction = prediction,
                                .steps = STEPS,
                                .corrected = STEPS / 2,
                                .squares = 0.01 * STEPS,
                                .compared = STEPS,
                                .time = 1000};
    for (size_t age = 0; age < AGES; age++) {
        trial->released.steps[age] = 100;
        trial->released.squares[age] = 100 * square;
    }
    return trial;
}

static void set_square(tl_horizon_trial *trial, size_t age, double square) {
    trial->released.squares[age] = square * (double)trial->released.steps[age];
}

/* Expects a prediction, or none (0). */
static const tl_horizon_trial *expect(uint32_t prediction) {
    tl_horizon_choose(&choice, TL_SECOND, TL_SECOND / 2);
    if (prediction == 0) {
        TEST_ASSERT_TRUE(choice.chosen == SIZE_MAX);
        return NULL;
    }
    TEST_ASSERT_TRUE(choice.chosen < choice.count);
    TEST_ASSERT_EQUAL_UINT32(prediction, choice.trial[choice.chosen].prediction);
    return &choice.trial[choice.chosen];
}

void setUp(void) {
    choice = (tl_horizon_choice){.count = 0};
}

void tearDown(void) {}

static void test_the_shortest_of_equal_ones(void) {
    add(1, 4.0);
    add(2, 1.015);
    add(5, 1.0);
    add(10, 1.2);
    const tl_horizon_trial *chosen = expect(2);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.015, chosen->regret);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, sqrt(1.015), chosen->error);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.1, chosen->locked);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 4.0, choice.trial[0].regret);
}

/* The wrong states of the first one show at one age only. */
static void test_the_largest_ratio_counts(void) {
    set_square(add(2, 1.0), 5, 3.0);
    add(4, 1.5);
    expect(4);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 2.0, choice.trial[0].regret);
    TEST_ASSERT_EQUAL_INT64(32 * TL_SECOND, choice.trial[0].age);
}

static void test_ages_below_the_horizon_are_not_compared(void) {
    add(2, 1.0);
    tl_horizon_trial *trial = add(64, 1.0);
    for (size_t age = 0; age < 6; age++) {
        set_square(trial, age, 0.01);
    }
    expect(2);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.0, choice.trial[0].regret);
}

static void test_an_age_with_few_steps_is_not_compared(void) {
    tl_horizon_trial *trial = add(2, 1.0);
    trial->released.steps[11] = 19;
    trial->released.squares[11] = 1e4;
    add(4, 1.0);
    expect(2);
}

static void test_a_horizon_that_corrects_is_preferred(void) {
    add(1, 1.0)->corrected = 0;
    add(2, 1.0)->corrected = STEPS / 100 - 1;
    add(5, 1.2)->corrected = STEPS / 100;
    add(10, 1.19);
    expect(5);
    choice.trial[2].corrected = choice.trial[3].corrected = 0;
    expect(1);
}

static void test_but_not_if_it_is_much_worse(void) {
    add(1, 1.0)->corrected = 0;
    add(2, 1.3);
    expect(1);
}

/* A long horizon smooths a fast change of u: the error in lock rises, but not after a release. */
static void test_the_error_in_lock_counts(void) {
    add(1, 1.0);
    add(10, 0.8)->squares = 0.5 * STEPS;
    expect(1);
    TEST_ASSERT_EQUAL_INT64(0, choice.trial[1].age);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, (0.5 + 1.0 / 9.0) / (0.01 + 1.0 / 9.0), choice.trial[1].regret);
}

/* Both are far below the noise of a tolerance of three times σ. */
static void test_errors_in_lock_within_the_noise_are_equal(void) {
    add(1, 1.0)->squares = 0.001 * STEPS;
    add(2, 0.5)->squares = 0.004 * STEPS;
    expect(2);
}

static void test_what_failed_or_is_too_slow_is_left_out(void) {
    (void)snprintf(add(1, 0.1)->fault, sizeof choice.trial[0].fault, "the FMU failed");
    add(2, 1.0);
    add(5, 0.2)->time = TL_SECOND / 2 + 1;
    expect(2);
    TEST_ASSERT_TRUE(isnan(choice.trial[0].regret) && isnan(choice.trial[2].regret));
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.0, choice.trial[1].regret);
}

static void test_resting_must_be_better(void) {
    add(5, 1.0);
    tl_horizon_trial *rests = add(5, 0.99);
    rests->rests = true; /* within the margin */
    TEST_ASSERT_FALSE(expect(5)->rests);
    for (size_t age = 0; age < AGES; age++) {
        set_square(rests, age, 0.5);
    }
    TEST_ASSERT_TRUE(expect(5)->rests);
}

/* If it is configured and no better, it is not proposed. */
static void test_a_trial_without_resting_is_preferred(void) {
    add(2, 3.0)->rests = true;
    add(5, 1.0)->rests = true;
    add(5, 1.0);
    TEST_ASSERT_FALSE(expect(5)->rests);
}

static void test_without_results_there_is_no_choice(void) {
    expect(0);
    tl_horizon_trial *trial = add(1, 1.0);
    memset(&trial->released, 0, sizeof trial->released);
    expect(0);
    TEST_ASSERT_TRUE(isnan(trial->error));
    (void)snprintf(trial->fault, sizeof trial->fault, "no FMU");
    expect(0);
}

/* Perfect agreement is no division by zero. */
static void test_no_error_at_all(void) {
    add(1, 0.0);
    add(2, 0.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.0, expect(1)->regret);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_shortest_of_equal_ones);
    RUN_TEST(test_the_largest_ratio_counts);
    RUN_TEST(test_ages_below_the_horizon_are_not_compared);
    RUN_TEST(test_an_age_with_few_steps_is_not_compared);
    RUN_TEST(test_a_horizon_that_corrects_is_preferred);
    RUN_TEST(test_but_not_if_it_is_much_worse);
    RUN_TEST(test_the_error_in_lock_counts);
    RUN_TEST(test_errors_in_lock_within_the_noise_are_equal);
    RUN_TEST(test_what_failed_or_is_too_slow_is_left_out);
    RUN_TEST(test_resting_must_be_better);
    RUN_TEST(test_a_trial_without_resting_is_preferred);
    RUN_TEST(test_without_results_there_is_no_choice);
    RUN_TEST(test_no_error_at_all);
    return UNITY_END();
}
