/* Score test on made-up residuals: the true cause over many seeds, sets, none, nothing, gaps. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/score_test.h"
#include "tests/support/random_numbers.h"

enum { STEPS = 3000, OUTPUTS = 2, LEARN = 200, ONSET = 1200, SEEDS = 20 };

/* Candidates: the input's gain, which acts on both outputs through a lag; an offset of the first
 * output; a gain of the second one; the frozen second one; twice the input's gain. */
enum { INPUT, OFFSET, GAIN, FROZEN, TWIN, COUNT };

static const double NOISE = 0.02;

static double input[STEPS];
static double predicted[STEPS * OUTPUTS], measured[STEPS * OUTPUTS], truth[STEPS * OUTPUTS];
static tl_score_candidate candidate[COUNT];
static tl_score_result result;
static tl_test_random random_state;
static int predictions, allowed; /* predictions until the test is to stop; 0: no limit */

void setUp(void) {
    random_state.state = 88172645463325252U;
    allowed = 0;
    predictions = 0;
}

void tearDown(void) {}

static double uniform(void) {
    return tl_test_random_number(&random_state, 0.0, 1.0);
}

static double draw(void) {
    double sum = 0.0;
    for (int i = 0; i < 12; i++) {
        sum += uniform();
    }
    return sum - 6.0;
}

/* The outputs if the input has this gain from a step on. */
static void simulate(double gain, size_t from, double *y) {
    double x[OUTPUTS] = {1.0, 1.0};
    for (size_t i = 0; i < STEPS; i++) {
        double u = input[i] * (i >= from ? 1.0 + gain : 1.0);
        x[0] += (u - x[0]) / 20.0;
        x[1] += (x[0] - x[1]) / 50.0;
        memcpy(&y[i * OUTPUTS], x, sizeof x);
    }
}

static bool predict(void *context, size_t index, double size, size_t onset, double *y) {
    (void)context;
    predictions++;
    memcpy(y, predicted, sizeof predicted);
    if (index == INPUT || index == TWIN) {
        simulate(index == TWIN ? 2.0 * size : size, onset, y);
        return true;
    }
    for (size_t i = onset; i < STEPS; i++) {
        if (index == OFFSET) {
            y[i * OUTPUTS] += size;
        } else if (index == GAIN) {
            y[i * OUTPUTS + 1] *= 1.0 + size;
        } else {
            y[i * OUTPUTS + 1] = predicted[(onset - 1) * OUTPUTS + 1] + size;
        }
    }
    return true;
}

static bool must_stop(void *context) {
    (void)context;
    return allowed != 0 && predictions >= allowed;
}

/* New commands; what was measured without noise is `truth`. */
static void begin(uint64_t seed) {
    random_state.state = seed;
    double u = 1.0;
    for (size_t i = 0; i < STEPS; i++) {
        u = i % 150 == 0 ? 0.5 + 1.5 * uniform() : u;
        input[i] = u;
    }
    simulate(0.0, 0, predicted);
    memcpy(truth, predicted, sizeof truth);
}

/* White noise, and slow noise of half its size. */
static void add_noise(void) {
    double slow[OUTPUTS] = {0.0, 0.0};
    for (size_t i = 0; i < STEPS * OUTPUTS; i++) {
        double *one = &slow[i % OUTPUTS];
        *one = 0.95 * *one + 0.156 * NOISE * draw();
        measured[i] = truth[i] + *one + NOISE * draw();
    }
}

static bool run_with(size_t count, double spread) {
    const tl_score_test test = {.window = {.steps = STEPS,
                                           .outputs = OUTPUTS,
                                           .learn = LEARN,
                                           .onset = ONSET,
                                           .onset_spread = spread,
                                           .measured = measured,
                                           .predicted = predicted},
                                .predict = predict,
                                .stop = must_stop};
    for (size_t i = 0; i < COUNT; i++) {
        candidate[i] = (tl_score_candidate){.probe = 0.01, .least = -1e3, .most = 1e3, .is_level = i == FROZEN};
    }
    return tl_score_test_run(&test, candidate, count, &result);
}

static size_t members(size_t count) {
    size_t sum = 0;
    for (size_t i = 0; i < count; i++) {
        sum += candidate[i].is_in_set ? 1 : 0;
    }
    return sum;
}

/* Plants a change of `size` at `onset`; returns in how many seeds the cause was found alone. Each
 * answer must contain it, and its size must be within four deviations. */
static int plant(size_t cause, double size, size_t onset) {
    int alone = 0;
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        begin(seed);
        (void)predict(NULL, cause, size, onset, truth);
        add_noise();
        TEST_ASSERT_TRUE(run_with(TWIN, 20.0));
        TEST_ASSERT_EQUAL_INT(TL_SCORE_FOUND, result.verdict);
        TEST_ASSERT_TRUE_MESSAGE(candidate[cause].is_in_set, "the cause is not in the set");
        TEST_ASSERT_TRUE(cause == FROZEN || fabs(candidate[cause].size - size) < 4.0 * candidate[cause].spread);
        TEST_ASSERT_DOUBLE_WITHIN(40.0, (double)onset, candidate[cause].onset);
        alone += members(TWIN) == 1 ? 1 : 0;
    }
    return alone;
}

static void test_the_cause_is_found(void) {
    TEST_ASSERT_GREATER_OR_EQUAL_INT(SEEDS * 9 / 10, plant(INPUT, -0.05, ONSET));
    TEST_ASSERT_GREATER_OR_EQUAL_INT(SEEDS * 9 / 10, plant(OFFSET, 0.05, ONSET));
    TEST_ASSERT_GREATER_OR_EQUAL_INT(SEEDS * 9 / 10, plant(GAIN, 0.08, ONSET));
    TEST_ASSERT_GREATER_OR_EQUAL_INT(SEEDS * 9 / 10, plant(FROZEN, 0.0, ONSET));
}

static void test_a_wrong_onset_is_corrected(void) {
    TEST_ASSERT_GREATER_OR_EQUAL_INT(SEEDS * 9 / 10, plant(INPUT, -0.2, ONSET + 25));
}

static void test_what_cannot_be_told_apart_is_a_set(void) {
    begin(1);
    simulate(-0.1, ONSET, truth);
    add_noise();
    TEST_ASSERT_TRUE(run_with(COUNT, 20.0));
    TEST_ASSERT_EQUAL_size_t(2, members(COUNT));
    TEST_ASSERT_TRUE(candidate[INPUT].is_in_set && candidate[TWIN].is_in_set);
    TEST_ASSERT_EQUAL_size_t(TWIN, candidate[INPUT].alike);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1.0, candidate[INPUT].likeness);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, candidate[INPUT].size, 2.0 * candidate[TWIN].size);
}

static void test_none_of_them(void) {
    begin(2);
    for (size_t i = ONSET; i < STEPS; i++) { /* the first output oscillates */
        truth[i * OUTPUTS] += 0.3 * sin((double)i / 40.0);
    }
    add_noise();
    TEST_ASSERT_TRUE(run_with(TWIN, 20.0));
    TEST_ASSERT_NOT_EQUAL_INT(TL_SCORE_FOUND, result.verdict);
}

/* With `off`, the model's input has been that much wrong all the time. */
static int count_false(double off) {
    int found = 0;
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        begin(seed);
        simulate(off, 0, truth);
        add_noise();
        TEST_ASSERT_TRUE(run_with(TWIN, 20.0));
        found += result.verdict != TL_SCORE_NOT_BETTER ? 1 : 0;
    }
    return found;
}

static void test_nothing_has_changed(void) {
    TEST_ASSERT_LESS_OR_EQUAL_INT(1, count_false(0.0));
    TEST_ASSERT_LESS_OR_EQUAL_INT(1, count_false(0.03));
}

static void test_gaps(void) {
    begin(3);
    simulate(-0.1, ONSET, truth);
    add_noise();
    for (size_t i = 0; i < STEPS * OUTPUTS; i++) {
        bool is_gap = (i > 900 && i < 1100) || i % 7 == 0;
        measured[i] = is_gap ? (double)NAN : measured[i];
    }
    TEST_ASSERT_TRUE(run_with(TWIN, 20.0));
    TEST_ASSERT_EQUAL_INT(TL_SCORE_FOUND, result.verdict);
    TEST_ASSERT_EQUAL_size_t(INPUT, result.best);
    TEST_ASSERT_TRUE(fabs(candidate[INPUT].size + 0.1) < 4.0 * candidate[INPUT].spread);
}

/* The size that is noticed lowers chi squared by 25. */
static void test_least_size(void) {
    begin(4);
    add_noise();
    TEST_ASSERT_TRUE(run_with(TWIN, 20.0));
    double least = candidate[INPUT].noticeable;
    simulate(2.0 * least, ONSET, truth);
    add_noise();
    TEST_ASSERT_TRUE(run_with(TWIN, 20.0));
    TEST_ASSERT_EQUAL_INT(TL_SCORE_FOUND, result.verdict);
}

static void test_stop(void) {
    begin(5);
    simulate(-0.1, ONSET, truth);
    add_noise();
    allowed = 10;
    TEST_ASSERT_FALSE(run_with(TWIN, 20.0));
    TEST_ASSERT_LESS_OR_EQUAL_INT(20, predictions);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_cause_is_found);
    RUN_TEST(test_a_wrong_onset_is_corrected);
    RUN_TEST(test_what_cannot_be_told_apart_is_a_set);
    RUN_TEST(test_none_of_them);
    RUN_TEST(test_nothing_has_changed);
    RUN_TEST(test_gaps);
    RUN_TEST(test_least_size);
    RUN_TEST(test_stop);
    return UNITY_END();
}
