/* Key figures of a run: sums, and unknown values. */
#include <unity.h>

#include "firmware/report/run_figures.h"

static tl_run_figures figures;

void setUp(void) {
    figures = (tl_run_figures){0};
}

void tearDown(void) {}

static void add(int64_t outcome, uint64_t evaluations, tl_time used) {
    const tl_history_step step = {.outcome = outcome, .evaluations = (int64_t)evaluations, .used = used};
    tl_run_figures_add_step(&figures, &step, 100);
}

static void test_steps(void) {
    add(TL_FIRST_GUESS, 1, 100);
    add(TL_OPTIMISED, 7, 101);
    add(TL_CAUGHT_UP, 0, 0);
    add(TL_RESUMED, 0, 0);
    TEST_ASSERT_EQUAL_UINT64(2, figures.steps);
    TEST_ASSERT_EQUAL_UINT64(4, tl_run_figures_committed(&figures));
    TEST_ASSERT_EQUAL_UINT64(8, figures.evaluations);
    TEST_ASSERT_EQUAL_UINT64(1, figures.optimised_steps);
    TEST_ASSERT_EQUAL_UINT64(1, figures.late);
    TEST_ASSERT_EQUAL_INT64(101, figures.longest);
    TEST_ASSERT_EQUAL_UINT64(1, figures.outcomes[TL_OPTIMISED]);
}

/* A newer release may record unknown outcomes. */
static void test_an_unknown_outcome_counts_as_a_step(void) {
    add(TL_OUTCOMES, 1, 0);
    add(INT64_MAX, 1, 0);
    add(-1, 1, 0);
    TEST_ASSERT_EQUAL_UINT64(3, figures.steps);
    TEST_ASSERT_EQUAL_UINT64(3, tl_run_figures_committed(&figures));
    TEST_ASSERT_EACH_EQUAL_UINT64(0, figures.outcomes, TL_OUTCOMES);
}

static void test_searches_that_time_ended(void) {
    const tl_history_step step = {.outcome = TL_BEST_SO_FAR, .stop = TL_STOP_TIME};
    tl_run_figures_add_step(&figures, &step, 100);
    TEST_ASSERT_EQUAL_UINT64(1, figures.time_limited);
}

static void test_an_adjusted_variable(void) {
    tl_run_figures_add_adjusted(&figures, 2, 3.0, 1.0);
    tl_run_figures_add_adjusted(&figures, 2, 7.0, 8.0);
    TEST_ASSERT_EQUAL_DOUBLE(3.0, figures.adjust[2].first);
    TEST_ASSERT_EQUAL_DOUBLE(7.0, figures.adjust[2].last);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, tl_run_figures_mean(&figures, 2));
    TEST_ASSERT_EQUAL_DOUBLE(0.5, tl_run_figures_correction_mean(&figures, 2));
    TEST_ASSERT_DOUBLE_IS_NAN(tl_run_figures_mean(&figures, 0));
    TEST_ASSERT_DOUBLE_IS_NAN(tl_run_figures_correction_mean(&figures, 0));
}

/* Missing data must not look like a perfect fit. */
static void test_too_few_pairs(void) {
    TEST_ASSERT_DOUBLE_IS_NAN(tl_run_figures_maximum(&figures, 0));
    tl_metrics_add(&figures.match[0], 1.0, 3.0, TL_GOOD);
    TEST_ASSERT_DOUBLE_IS_NAN(tl_run_figures_mse(&figures, 0));
    TEST_ASSERT_EQUAL_DOUBLE(2.0, tl_run_figures_maximum(&figures, 0));
    tl_metrics_add(&figures.match[0], 1.0, 1.0, TL_GOOD);
    TEST_ASSERT_EQUAL_DOUBLE(4.0, tl_run_figures_mse(&figures, 0));
}

static void test_the_ledger(void) {
    figures.ledger[0] = (tl_run_component){"drive", {10, 4, 6, 1, 2}};
    figures.ledger[1] = (tl_run_component){"motor", {1, 5, 3, 0, 0}};
    figures.ledger_count = 2;
    tl_execution_counts total = tl_run_figures_total(&figures);
    const tl_execution_counts wanted = {11, 9, 9, 1, 2};
    TEST_ASSERT_EQUAL_MEMORY(&wanted, &total, sizeof wanted);
    TEST_ASSERT_EQUAL_DOUBLE(-2.0, tl_run_component_saved(&figures.ledger[1].counts));
    TEST_ASSERT_EQUAL_INT64(-2, tl_run_component_difference(&figures.ledger[1].counts));
    TEST_ASSERT_EQUAL_INT64(1, tl_run_component_difference(&figures.ledger[0].counts));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_steps);
    RUN_TEST(test_an_unknown_outcome_counts_as_a_step);
    RUN_TEST(test_searches_that_time_ended);
    RUN_TEST(test_an_adjusted_variable);
    RUN_TEST(test_too_few_pairs);
    RUN_TEST(test_the_ledger);
    return UNITY_END();
}
