/* The second solver: it continues if the first one fails, stagnates or finds nothing better. The
 * record reports it. */
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "tests/support/test_plan.h"

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;

void setUp(void) {}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* y0 = u0, and û = cmd. */
static tl_plan_adjust *begin(const char *algorithm, const char *fallback, uint32_t stagnation) {
    tl_test_run_end(&run, &plan);
    tl_test_plan_single(&plan, &fmu, &call_log);
    plan.plan.algorithm = algorithm;
    plan.plan.fallback = fallback;
    plan.plan.stagnation = stagnation;
    return tl_test_plan_adjust(&plan, "m.u0", 1.0);
}

static void build(void) {
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = 60;
}

static const tl_record *tick(double cmd, double y0) {
    return tl_test_run_single(&run, &call_log, cmd, y0);
}

static double tried(size_t n) {
    return tl_test_log_step(&call_log, &fmu, n)->u[0];
}

/* ---- nothing better exists ---- */

/* Nelder-Mead ends at the bound after three evaluations. BOBYQA then varies that point by its
 * step. */
static const tl_record *search_out_of_reach(const char *fallback) {
    tl_plan_adjust *adjust = begin("nelder-mead", fallback, 0);
    adjust->lower = -1.0;
    adjust->upper = 1.5;
    build();
    return tick(0.0, 5.0);
}

static void the_second_one_goes_on_from_the_best(void) {
    double alone[4];
    const tl_record *record = search_out_of_reach(NULL);
    TEST_ASSERT_EQUAL_UINT32(4, record->evaluations);
    TEST_ASSERT_EQUAL_UINT32(0, record->flags);
    for (size_t i = 0; i < 4; i++) {
        alone[i] = tried(i);
    }
    record = search_out_of_reach("bobyqa");
    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_FALLBACK, record->flags);
    TEST_ASSERT_EQUAL_INT(TL_STOP_SOLVER, record->stop);
    TEST_ASSERT_TRUE(record->evaluations > 5);
    for (size_t i = 0; i < 4; i++) {
        TEST_ASSERT_TRUE(tried(i) == alone[i]);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 2.5 / 4.0, fabs(tried(4) - alone[3]));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1.5, record->u[0]);
}

static void within_tolerance_nobody_takes_over(void) {
    static const char *const names[] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"};
    for (size_t i = 0; i < 5; i++) {
        (void)begin(names[i], "sbplx", 0);
        build();
        const tl_record *record = tick(0.0, 3.3);
        TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
        TEST_ASSERT_EQUAL_UINT32(0, record->flags);
    }
}

/* The limit of the step covers both solvers. */
static void both_share_the_budget(void) {
    for (uint32_t budget = 1; budget < 12; budget++) {
        tl_plan_adjust *adjust = begin("nelder-mead", "bobyqa", 0);
        adjust->lower = -1.0;
        adjust->upper = 1.5;
        build();
        run.budget.evaluations = budget;
        const tl_record *record = tick(0.0, 5.0);
        TEST_ASSERT_EQUAL_UINT32(budget, record->evaluations);
        TEST_ASSERT_EQUAL_INT(TL_STOP_EVALUATIONS, record->stop);
        TEST_ASSERT_EQUAL_UINT32(budget < 4 ? 0 : TL_FLAG_FALLBACK, record->flags);
    }
}

/* ---- stagnation ---- */

static double objective(size_t n, double y0) {
    return pow((tried(n) - y0) / 0.01, 2.0);
}

/* A solver ends after n evaluations in a row that do not reduce J by a hundredth. */
static void a_solver_is_ended_where_it_makes_no_progress(void) {
    for (uint32_t most = 1; most < 8; most++) {
        (void)begin("nelder-mead", NULL, most);
        build();
        const tl_record *record = tick(0.0, 8.3);
        double best = objective(0, 8.3);
        uint32_t idle = 0;
        for (size_t i = 1; i < record->evaluations; i++) {
            TEST_ASSERT_TRUE(idle < most);
            idle = objective(i, 8.3) < 0.99 * best ? 0 : idle + 1;
            best = fmin(best, objective(i, 8.3));
        }
        bool ended = record->outcome != TL_OPTIMISED;
        TEST_ASSERT_EQUAL_UINT32(ended ? TL_FLAG_STAGNATED : 0, record->flags);
        TEST_ASSERT_TRUE(!ended || idle == most);
        TEST_ASSERT_TRUE(most > 3 || ended);
    }
}

static void one_that_stagnates_hands_over(void) {
    (void)begin("nelder-mead", "secant", 2);
    build();
    const tl_record *record = tick(0.0, 8.3);
    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_STAGNATED | TL_FLAG_FALLBACK, record->flags);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_EQUAL_INT(TL_STOP_TOLERANCE, record->stop);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 8.3, record->u[0]);
    (void)tick(8.3, 8.3);
    record = tick(8.3, 8.3);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
    TEST_ASSERT_EQUAL_UINT32(0, record->flags); /* flags apply to this step only */
}

/* ---- failures ---- */

/* All points except the start are NaN: both solvers end, and nominal is committed. */
static void where_both_find_nothing_it_is_nominal(void) {
    static const char *const names[] = {"secant", "nelder-mead", "bobyqa", "sbplx"};
    for (size_t i = 0; i < 4; i++) {
        begin(names[i], "nelder-mead", 0)->lower = 0.3;
        build();
        (void)tick(0.3, 0.3);
        (void)tick(0.3, 0.3);
        tl_test_fmu_fail_above(&fmu, TL_TEST_NAN, 0.3);
        const tl_record *record = tick(0.3, 0.45);
        TEST_ASSERT_EQUAL_UINT32(TL_FLAG_FALLBACK | TL_FLAG_REFUSED, record->flags);
        TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
        TEST_ASSERT_TRUE(record->u[0] == 0.3);
    }
}

static void expect_found(uint32_t flags, const tl_record *record) {
    TEST_ASSERT_EQUAL_UINT32(flags, record->flags);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.5, record->u[0]);
}

/* Nominal (1.5) fails: our own solver looks for a start near it. */
static void secant_looks_for_a_start(void) {
    static const tl_test_fault_kind kinds[] = {TL_TEST_DISCARD, TL_TEST_ERROR, TL_TEST_NAN};
    for (size_t i = 0; i < 3; i++) {
        (void)begin("secant", "nelder-mead", 0);
        build();
        run.sample.quality[TL_TEST_Y0] = TL_NO_LINK;
        (void)tick(1.5, 0.0);
        run.sample.quality[TL_TEST_Y0] = TL_GOOD;
        tl_test_fmu_fail_above(&fmu, kinds[i], 1.0);
        const tl_record *record = tick(1.5, 0.5);
        expect_found(TL_FLAG_REFUSED, record);
        TEST_ASSERT_EQUAL_UINT32(3, record->refused.count); /* nominal, the last u, and a step up */
        TEST_ASSERT_EQUAL_UINT32(0, record->refused.variable);
        TEST_ASSERT_TRUE(record->refused.u == 1.5);
    }
}

/* Nominal (3) and the last u (2) both fail. */
static void a_solver_that_cannot_begin_hands_over(void) {
    static const tl_test_fault_kind kinds[] = {TL_TEST_DISCARD, TL_TEST_ERROR, TL_TEST_NAN};
    for (size_t i = 0; i < 3; i++) {
        (void)begin("l-bfgs", "nelder-mead", 0);
        build();
        (void)tick(2.0, 2.0);
        (void)tick(3.0, 2.0);
        tl_test_fmu_fail_above(&fmu, kinds[i], 1.0);
        expect_found(TL_FLAG_FALLBACK | TL_FLAG_REFUSED, tick(3.0, 0.5));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(the_second_one_goes_on_from_the_best);
    RUN_TEST(within_tolerance_nobody_takes_over);
    RUN_TEST(both_share_the_budget);
    RUN_TEST(a_solver_is_ended_where_it_makes_no_progress);
    RUN_TEST(one_that_stagnates_hands_over);
    RUN_TEST(where_both_find_nothing_it_is_nominal);
    RUN_TEST(secant_looks_for_a_start);
    RUN_TEST(a_solver_that_cannot_begin_hands_over);
    return UNITY_END();
}
