/* Identifiability: an adjusted variable that no matched output reacts to is held at nominal for
 * the step. The record names it. */
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "master/sync/sensitivity.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_plan.h"

enum { SOLVERS = 5 };

static const char *const solvers[SOLVERS] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"};

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;

void setUp(void) {}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* y0 = gain·cmd + offset. If cmd is 0, the gain has no effect. */
static void begin(const char *algorithm) {
    tl_test_run_end(&run, &plan);
    tl_test_plan_single(&plan, &fmu, &call_log);
    plan.plan.algorithm = algorithm;
    plan.plan.noise_floor = 0.5;
    plan.plan.margin = 0.01;
}

static void build(void) {
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = 60;
}

static void build_with_gain(const char *algorithm, uint32_t prediction) {
    begin(algorithm);
    tl_test_plan_adjust(&plan, "m.gain", 0.1);
    plan.plan.prediction = prediction;
    build();
}

static const tl_record *tick(double cmd, double y0) {
    return tl_test_run_single(&run, &call_log, cmd, y0);
}

/* A solver that moves a variable by at least a twentieth of its step can judge it. L-BFGS moves it
 * less. */
static bool judges(size_t solver) {
    return strcmp(solvers[solver], "l-bfgs") != 0;
}

static void assert_nominal(const tl_record *record, size_t variable) {
    TEST_ASSERT_TRUE(record->u[variable] == record->nominal[variable]);
}

/* ---- one variable ---- */

static void what_does_not_matter_is_held_at_nominal(void) {
    for (size_t s = 0; s < SOLVERS; s++) {
        for (uint32_t prediction = 1; prediction <= 3; prediction++) {
            build_with_gain(solvers[s], prediction);
            for (int i = 0; i < 10; i++) {
                const tl_record *record = tick(0.0, 2.0 + 0.1 * i);
                TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
                assert_nominal(record, 0);
                TEST_ASSERT_TRUE(!judges(s) || record->held == 1);
                TEST_ASSERT_TRUE(!judges(s) || record->evaluations == 2); /* nominal, and one without effect */
            }
        }
    }
}

static void without_a_noise_floor_nothing_is_held(void) {
    begin("nelder-mead");
    tl_test_plan_adjust(&plan, "m.gain", 0.1);
    plan.plan.noise_floor = 0.0;
    build();
    const tl_record *record = tick(0.0, 2.0);
    TEST_ASSERT_EQUAL_UINT32(0, record->held);
    TEST_ASSERT_TRUE(record->evaluations > 2);
}

/* The noise floor is in tolerances per step. Here a step moves y0 by cmd·0.1/0.01 tolerances. */
static void the_noise_floor_is_in_tolerances_for_a_step(void) {
    for (size_t s = 0; s < SOLVERS; s++) {
        for (int above = 0; above < 2; above++) {
            begin(solvers[s]);
            tl_test_plan_adjust(&plan, "m.gain", 0.1);
            build();
            const tl_record *record = tick(above != 0 ? 0.051 : 0.049, 0.1);
            TEST_ASSERT_TRUE(!judges(s) || record->held == (above != 0 ? 0 : 1));
            TEST_ASSERT_TRUE(above == 0 || record->outcome == TL_OPTIMISED);
        }
    }
}

static void it_comes_back_when_it_matters_again(void) {
    for (size_t s = 0; s < SOLVERS; s++) {
        for (uint32_t prediction = 1; prediction <= 3; prediction++) {
            build_with_gain(solvers[s], prediction);
            for (int i = 0; i < 60; i++) {
                bool matters = i / 10 % 2 == 0;
                const tl_record *record = tick(matters ? 1.0 : 0.04, 1.5); /* the gain would help a little */
                if (i % 10 > (int)prediction) {                            /* the whole horizon has the same cmd */
                    TEST_ASSERT_TRUE(!judges(s) || record->held == (matters ? 0 : 1));
                    TEST_ASSERT_TRUE(!matters || record->outcome <= TL_OPTIMISED);
                    TEST_ASSERT_TRUE(!matters || fabs(record->u[0] - 1.5) < 0.01);
                    TEST_ASSERT_TRUE(matters || record->u[0] == record->nominal[0]);
                }
            }
        }
    }
}

/* ---- two variables ---- */

static void the_other_one_is_still_adjusted(void) {
    static const char *const names[] = {"m.gain", "m.offset"};
    for (size_t s = 0; s < SOLVERS; s++) {
        for (size_t blind = 0; blind < 2; blind++) {
            begin(solvers[s]);
            tl_test_plan_adjust(&plan, names[blind], 0.1);
            tl_test_plan_adjust(&plan, names[1 - blind], 0.1);
            build();
            for (int i = 0; i < 10; i++) {
                const tl_record *record = tick(0.0, 2.0 + 0.1 * i);
                bool guessed = s == 0 && i > 0; /* a known slope does not move a variable without effect */
                TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
                TEST_ASSERT_DOUBLE_WITHIN(0.01, 2.0 + 0.1 * i, record->u[1 - blind]);
                TEST_ASSERT_DOUBLE_WITHIN(judges(s) ? 0.0 : 1e-9, record->nominal[blind], record->u[blind]);
                TEST_ASSERT_TRUE(!judges(s) || guessed || record->held == 1U << blind);
            }
        }
    }
}

/* ---- what the user is told ---- */

static void begin_two(size_t solver, uint32_t prediction, tl_shape shape) {
    begin(solvers[solver]);
    plan.plan.prediction = prediction;
    plan.plan.shape = shape;
    tl_test_plan_adjust(&plan, "m.offset", 0.1);
    tl_test_plan_adjust(&plan, "m.gain", 0.1);
    build();
}

static tl_twin_identifiability found_after(int ticks, double cmd) {
    for (int i = 0; i < ticks; i++) {
        (void)tick(cmd, 2.0 + 0.3 * (i % 7));
    }
    return tl_twin_get_identifiability(run.twin);
}

static void every_solver_tells_what_does_not_matter(void) {
    for (size_t s = 0; s < SOLVERS; s++) {
        begin_two(s, 1, TL_STATIC);
        TEST_ASSERT_EQUAL_UINT32(0, found_after(TL_SENSITIVITY_TESTS - 1, 0.0).unseen);
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(2, found_after(20, 0.0).unseen, solvers[s]);
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(0, found_after(20, 0.0).alike, solvers[s]);
        tl_twin_reset(run.twin);
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(0, found_after(2, 0.0).unseen, solvers[s]);
    }
}

/* One output shows only the sum of gain·cmd and offset. */
static void every_solver_tells_what_acts_alike(void) {
    for (size_t s = 0; s < SOLVERS; s++) {
        for (uint32_t prediction = 1; prediction <= 3; prediction += 2) {
            begin_two(s, prediction, prediction == 1 ? TL_STATIC : TL_DYNAMIC);
            tl_twin_identifiability found = found_after(60, 0.8);
            TEST_ASSERT_EQUAL_HEX32_MESSAGE(3, found.alike, solvers[s]);
            TEST_ASSERT_EQUAL_HEX32_MESSAGE(0, found.unseen, solvers[s]);
            TEST_ASSERT_TRUE_MESSAGE(found.since >= 0 && found.since < 50, solvers[s]);
        }
    }
}

/* A budget too small for a judgement does not let a variable drift either. */
static void under_a_tight_budget_nothing_drifts(void) {
    for (size_t s = 0; s < SOLVERS; s++) {
        for (uint32_t budget = 2; budget < 12; budget++) {
            begin(solvers[s]);
            tl_test_plan_adjust(&plan, "m.offset", 0.1);
            tl_test_plan_adjust(&plan, "m.gain", 0.1);
            plan.plan.prediction = 1 + budget % 2;
            build();
            run.budget.evaluations = budget;
            for (int i = 0; i < 40; i++) {
                double faint = s == 0 || !judges(s) ? 0.0 : 0.01; /* a known slope is used, however small */
                const tl_record *record = tick(faint, 2.0 + 0.1 * (i % 7));
                TEST_ASSERT_DOUBLE_WITHIN(judges(s) ? 0.0 : 1e-9, 1.0, record->u[1]);
            }
        }
    }
}

static uint32_t seed;

/* With any budget and horizon: each variable that the record names is committed at nominal. */
static void what_is_named_is_at_nominal(void) {
    uint32_t named = 0;
    for (uint32_t number = 1; number <= 400; number++) {
        seed = number * 7919U;
        begin(solvers[tl_test_any(&seed, SOLVERS)]);
        bool swapped = tl_test_any(&seed, 2) == 0;
        tl_test_plan_adjust(&plan, swapped ? "m.gain" : "m.offset", 0.1);
        tl_test_plan_adjust(&plan, swapped ? "m.offset" : "m.gain", 0.1);
        plan.plan.prediction = 1 + tl_test_any(&seed, 4);
        plan.plan.shape = (tl_shape)tl_test_any(&seed, 2);
        plan.plan.fallback = tl_test_any(&seed, 2) == 0 ? solvers[tl_test_any(&seed, SOLVERS)] : NULL;
        build();
        for (int i = 0; i < 40; i++) {
            run.budget.evaluations = 1 + tl_test_any(&seed, 25);
            const tl_record *record = tick(tl_test_any(&seed, 3) == 0 ? 0.0 : 0.02 * tl_test_any(&seed, 4),
                                           1.0 + 0.1 * tl_test_any(&seed, 10));
            for (size_t v = 0; v < 2; v++) {
                if ((record->held >> v & 1U) != 0) {
                    named++;
                    assert_nominal(record, v);
                }
            }
        }
    }
    TEST_ASSERT_TRUE(named > 1000);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(what_does_not_matter_is_held_at_nominal);
    RUN_TEST(without_a_noise_floor_nothing_is_held);
    RUN_TEST(the_noise_floor_is_in_tolerances_for_a_step);
    RUN_TEST(it_comes_back_when_it_matters_again);
    RUN_TEST(the_other_one_is_still_adjusted);
    RUN_TEST(every_solver_tells_what_does_not_matter);
    RUN_TEST(every_solver_tells_what_acts_alike);
    RUN_TEST(under_a_tight_budget_nothing_drifts);
    RUN_TEST(what_is_named_is_at_nominal);
    return UNITY_END();
}
