/* One synchronised step: the guess, the search, its budgets, its failures, and the committed
 * values. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "tests/support/test_plan.h"

enum { CMD, Y0, Y1 }; /* signals */

static tl_test_log call_log;
static tl_test_fmu fmus[3];
static tl_test_plan plan;
static tl_test_run run;
static tl_time now; /* of the fake clock */

void setUp(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
    now = 0;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* "m" with two channels: cmd drives u0, and u1 is constant at 0. y0 is matched with a tolerance of
 * 0.01. */
static void make_plan(void) {
    tl_test_fmu_init(&fmus[0], 2, false, &call_log);
    tl_test_plan_component(&plan, "m", &fmus[0]);
    tl_test_plan_set(&plan, "u1", 0.0);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y0", TL_REAL, "");
    tl_test_plan_signal(&plan, "y1", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "m.u0");
    tl_test_plan_match(&plan, "m.y0", "plant.y0", 0.01);
}

/* make_plan() with u0 adjusted: û is cmd, and y0 = u0. */
static tl_plan_adjust *make_observer(void) {
    make_plan();
    return tl_test_plan_adjust(&plan, "m.u0", 1.0);
}

/* Values of the next samples. */
static void plant(double cmd, double y0) {
    run.sample.values[CMD] = cmd;
    run.sample.values[Y0] = y0;
}

/* Returns u0 of the n-th step of "m" in this tick, including candidates. */
static double tried(size_t n) {
    const tl_test_entry *entry = tl_test_log_step(&call_log, &fmus[0], n);
    TEST_ASSERT_NOT_NULL(entry);
    return entry->u[0];
}

static tl_time read_clock(void *context) {
    return *(tl_time *)context;
}

/* From now on, each step of "m" takes 1 ms of the fake clock. The next step has this budget. */
static void use_clock(tl_time budget_ms) {
    if (run.sample.tick == 0) {
        tl_test_run_step(&run); /* initialises, which takes time */
    }
    fmus[0].control.clock = &now;
    fmus[0].control.cost = TL_SECOND / 1000;
    run.budget.now = read_clock;
    run.budget.context = &now;
    run.budget.time = budget_ms * (TL_SECOND / 1000);
    run.budget.started = now;
}

/* ---- guess and search ---- */

static void a_guess_within_tolerance_is_committed_without_a_search(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(2.0, 2.005);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
    TEST_ASSERT_EQUAL_INT(TL_STOP_NONE, record->stop);
    TEST_ASSERT_EQUAL_UINT32(1, record->evaluations);
    TEST_ASSERT_EQUAL_UINT32(4, record->executions); /* K = 2: one candidate and the commit */
    TEST_ASSERT_TRUE(record->u[0] == 2.0);
    TEST_ASSERT_TRUE(record->nominal[0] == 2.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.25, record->objective);
    TEST_ASSERT_TRUE(record->objective_nominal == record->objective);
    TEST_ASSERT_TRUE(record->y[0] == 2.0);
}

static void a_guess_out_of_tolerance_is_searched_from(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(2.0, 5.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_EQUAL_INT(TL_STOP_TOLERANCE, record->stop);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 5.0, record->u[0]);
    TEST_ASSERT_TRUE(record->objective < 1.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 90000.0, record->objective_nominal);
    TEST_ASSERT_TRUE(record->nominal[0] == 2.0);
    TEST_ASSERT_TRUE(record->y[0] == record->u[0]);
    TEST_ASSERT_TRUE(tried(0) == 2.0); /* û first */
    TEST_ASSERT_TRUE(tried(record->evaluations) == record->u[0]);
}

static void the_best_point_is_committed_not_the_last(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = 7;
    plant(0.0, 2.6);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    double best = 0.0;
    for (size_t i = 0; i < record->evaluations; i++) {
        best = fabs(tried(i) - 2.6) < fabs(best - 2.6) ? tried(i) : best;
    }
    TEST_ASSERT_TRUE(tried(record->evaluations - 1) != best); /* otherwise the test proves nothing */
    TEST_ASSERT_TRUE(record->u[0] == best);
    TEST_ASSERT_EQUAL_DOUBLE(pow((best - 2.6) / 0.01, 2.0), record->objective);
}

static void the_start_is_evaluated_once(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(2.0, 5.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    for (size_t i = 1; i < record->evaluations; i++) {
        TEST_ASSERT_TRUE(tried(i) != 2.0);
    }
}

static void trials_may_go_back_and_the_commit_may_not(void) {
    (void)make_observer();
    plan.plan.prediction = 3;
    tl_test_run_build(&run, &plan);
    for (int i = 0; i < 4; i++) {
        plant((double)i, 5.0 - (double)i);
        const tl_record *record = tl_test_run_tick(&run, &call_log);
        size_t steps = 3 * (size_t)record->evaluations;
        TEST_ASSERT_EQUAL_UINT64(steps + 1, tl_test_log_count(&call_log, &fmus[0], TL_TEST_DO_STEP));
        for (size_t n = 0; n <= steps; n++) {
            const tl_test_entry *entry = tl_test_log_step(&call_log, &fmus[0], n);
            TEST_ASSERT_EQUAL_INT(n == steps, entry->final);
            size_t ahead = n == steps ? 0 : n % 3;
            TEST_ASSERT_TRUE(entry->time == (double)(record->step + (int64_t)ahead) / 10.0);
        }
    }
}

static void a_step_saves_once_and_restores_once_per_evaluation(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    for (int i = 0; i < 3; i++) {
        plant(0.0, 3.0 + (double)i);
        const tl_record *record = tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_EQUAL_UINT64(1, tl_test_log_count(&call_log, NULL, TL_TEST_GET_STATE));
        TEST_ASSERT_EQUAL_UINT64(record->evaluations, tl_test_log_count(&call_log, NULL, TL_TEST_SET_STATE));
    }
    TEST_ASSERT_EQUAL_UINT64(1, fmus[0].states);
}

static void a_candidate_is_held_over_the_horizon(void) {
    (void)make_observer();
    plan.plan.prediction = 4;
    tl_test_run_build(&run, &plan);
    plant(1.0, 3.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    for (size_t i = 0; i < record->evaluations; i++) {
        for (size_t j = 1; j < 4; j++) {
            TEST_ASSERT_TRUE(tried(4 * i) == tried(4 * i + j));
        }
    }
}

static void steps_before_the_distance_do_not_count(void) {
    make_plan();
    tl_test_fmu_init(&fmus[1], 1, false, &call_log);
    tl_test_plan_component(&plan, "out", &fmus[1]);
    tl_test_plan_connect(&plan, "m.y0", "out.u0");
    plan.match[0].variable = "out.y0";
    tl_test_plan_adjust(&plan, "m.offset", 1.0);
    plan.plan.prediction = 3; /* T_D = 2: J has the samples i + 2 and i + 3 */
    tl_test_run_build(&run, &plan);
    plant(0.0, 3.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(0, record->step);
    TEST_ASSERT_EQUAL_DOUBLE(2.0 * 90000.0, record->objective_nominal);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 3.0, record->u[0]);
    TEST_ASSERT_TRUE(record->y[0] == 0.0); /* the committed step does not reach it yet */
}

/* ---- a solver that guesses ---- */

static void it_learns_at_the_first_step_though_all_is_well(void) {
    (void)make_observer();
    plan.plan.algorithm = "secant";
    tl_test_run_build(&run, &plan);
    plant(2.0, 2.005);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_UINT32(2, record->evaluations);
    TEST_ASSERT_TRUE(tried(0) == 2.0);
    TEST_ASSERT_TRUE(tried(1) == 3.0); /* one step away */
    TEST_ASSERT_TRUE(record->u[0] == 2.0);
    for (int i = 0; i < 2; i++) { /* forecasts need two outputs */
        record = tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_EQUAL_UINT32(1, record->evaluations);
        TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.03, record->objective); /* within tolerance; a guess goes no nearer */
    TEST_ASSERT_TRUE(record->u[0] > 2.0 && record->u[0] < 2.005);
}

static void it_learns_once_only_and_without_a_word_where_nothing_matters(void) {
    make_plan();
    (void)tl_test_plan_adjust(&plan, "m.u1", 1.0);
    plan.plan.algorithm = "secant";
    tl_test_run_build(&run, &plan);
    plant(2.0, 2.005);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_UINT32(2, record->evaluations);
    TEST_ASSERT_EQUAL_UINT32(0, record->held);
    record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_UINT32(1, record->evaluations);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
}

static void it_does_not_learn_beyond_the_budget(void) {
    (void)make_observer();
    plan.plan.algorithm = "secant";
    tl_test_run_build(&run, &plan);
    plant(2.0, 2.005);
    run.budget.evaluations = 1;
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_UINT32(1, record->evaluations);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
    TEST_ASSERT_EQUAL_INT(TL_STOP_NONE, record->stop);
    TEST_ASSERT_TRUE(record->u[0] == 2.0);
}

/* ---- the first guess ---- */

static void at_the_shortest_prediction_the_guess_is_nominal(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    for (int i = 0; i < 5; i++) {
        plant((double)i, 10.0);
        (void)tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_EQUAL_DOUBLE(i == 0 ? 0.0 : (double)i - 1.0, run.record.nominal[0]); /* lag: the sample of t_i */
        TEST_ASSERT_TRUE(tried(0) == run.record.nominal[0]);
    }
}

static void at_a_longer_prediction_the_guess_is_the_last_u(void) {
    (void)make_observer();
    plan.plan.prediction = 2;
    tl_test_run_build(&run, &plan);
    plant(1.0, 4.0);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(tried(0) == 1.0); /* no u yet: nominal */
    for (int i = 0; i < 4; i++) {
        double last = run.record.u[0];
        plant(1.0, 5.0 + (double)i);
        (void)tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_TRUE(tried(0) == last);
        TEST_ASSERT_TRUE(tried(1) == last);
    }
}

static void the_last_u_is_evaluated_once_too(void) {
    (void)make_observer();
    plan.plan.prediction = 2;
    tl_test_run_build(&run, &plan);
    plant(1.0, 4.0);
    (void)tl_test_run_tick(&run, &call_log);
    double last = run.record.u[0];
    plant(1.0, 9.0);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(run.record.evaluations > 3);
    for (size_t i = 2; i < 2 * (size_t)run.record.evaluations; i++) {
        TEST_ASSERT_TRUE(tried(i) != last);
    }
}

/* ---- bounds ---- */

static void the_search_stays_within_the_bounds(void) {
    static const double configured[] = {1.0, 3.0};
    for (size_t c = 0; c < 2; c++) {
        setUp();
        tl_plan_adjust *adjust = make_observer();
        adjust->lower = -configured[c]; /* the narrower one of these bounds and those of the FMU applies */
        adjust->upper = configured[c];
        tl_test_fmu_variable(&fmus[0], "u0")->minimum = -2.0;
        tl_test_fmu_variable(&fmus[0], "u0")->maximum = 2.0;
        tl_test_run_build(&run, &plan);
        double limit = fmin(configured[c], 2.0);
        for (int i = 0; i < 6; i++) {
            plant(0.0, i < 3 ? 5.0 : -5.0);
            const tl_record *record = tl_test_run_tick(&run, &call_log);
            for (size_t n = 0; n < record->evaluations; n++) {
                TEST_ASSERT_TRUE(fabs(tried(n)) <= limit);
            }
            TEST_ASSERT_DOUBLE_WITHIN(1e-3, limit, fabs(record->u[0]));
        }
        tl_test_run_end(&run, &plan);
    }
}

static void a_nominal_outside_the_bounds_stays_what_it_is(void) {
    tl_plan_adjust *adjust = make_observer();
    adjust->lower = 0.0;
    adjust->upper = 3.0;
    tl_test_run_build(&run, &plan);
    plant(7.0, 2.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(record->nominal[0] == 7.0);
    TEST_ASSERT_TRUE(tried(0) == 7.0); /* evaluated although out of bounds */
    TEST_ASSERT_TRUE(tried(1) == 3.0); /* the search starts from the nearest point within */
    for (size_t n = 1; n < record->evaluations; n++) {
        TEST_ASSERT_TRUE(tried(n) >= 0.0 && tried(n) <= 3.0);
        TEST_ASSERT_TRUE(n == 1 || tried(n) != 3.0); /* evaluated once */
    }
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 2.0, record->u[0]);
}

static void a_nominal_outside_the_bounds_may_be_right(void) {
    tl_plan_adjust *adjust = make_observer();
    adjust->lower = 0.0;
    adjust->upper = 3.0;
    tl_test_run_build(&run, &plan);
    plant(7.0, 7.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
    TEST_ASSERT_TRUE(record->u[0] == 7.0);
    plant(7.0, 8.0); /* no u within the bounds is better */
    record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
    TEST_ASSERT_TRUE(record->u[0] == 7.0);
}

static void an_old_nominal_outside_the_bounds_is_not_guessed_again(void) {
    tl_plan_adjust *adjust = make_observer();
    adjust->lower = 0.0;
    adjust->upper = 3.0;
    plan.plan.prediction = 2;
    tl_test_run_build(&run, &plan);
    plant(7.0, 7.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(record->u[0] == 7.0); /* û may be out of bounds */
    plant(9.0, 7.0);
    for (int i = 0; i < 4; i++) {
        record = tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_TRUE(record->u[0] == record->nominal[0] || record->u[0] <= 3.0);
    }
}

/* ---- never worse than nominal ---- */

static const tl_record *correct_a_little(double margin) {
    tl_plan_adjust *adjust = make_observer();
    adjust->lower = -1.0;
    adjust->upper = 0.05; /* 10 are needed: J decreases by 1 % at most */
    plan.plan.margin = margin;
    tl_test_run_build(&run, &plan);
    plant(0.0, 10.0);
    return tl_test_run_tick(&run, &call_log);
}

static void a_small_gain_is_worth_it_without_a_margin(void) {
    const tl_record *record = correct_a_little(0.0);
    TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, record->outcome);
    TEST_ASSERT_EQUAL_INT(TL_STOP_SOLVER, record->stop);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.05, record->u[0]);
    TEST_ASSERT_TRUE(record->objective < record->objective_nominal);
}

static void a_gain_below_the_margin_is_not_worth_it(void) {
    const tl_record *record = correct_a_little(0.02);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
    TEST_ASSERT_TRUE(record->u[0] == 0.0);
    TEST_ASSERT_TRUE(record->objective == record->objective_nominal);
    TEST_ASSERT_EQUAL_DOUBLE(1e6, record->objective);
    TEST_ASSERT_TRUE(record->y[0] == 0.0);
}

static void a_gain_above_the_margin_is_worth_it(void) {
    TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, correct_a_little(0.009)->outcome);
}

static void nothing_better_than_nominal_is_nominal(void) {
    make_plan();
    tl_test_plan_adjust(&plan, "m.gain", 1.0)->lower = 0.5; /* u0 is 0, so J does not depend on the gain */
    tl_test_run_build(&run, &plan);
    plant(0.0, 5.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
    TEST_ASSERT_TRUE(record->u[0] == 1.0);
}

static void a_bad_last_u_is_held_against_the_nominal(void) {
    (void)make_observer();
    plan.plan.prediction = 2;
    tl_test_run_build(&run, &plan);
    plant(0.0, 6.0);
    (void)tl_test_run_tick(&run, &call_log);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 6.0, run.record.u[0]);
    run.budget.evaluations = 3; /* the guess, one evaluation of the search, nominal */
    plant(0.0, 0.005);
    (void)tl_test_run_tick(&run, &call_log); /* one sample of J is still 6 */
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_UINT32(3, run.record.evaluations);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, run.record.outcome);
    TEST_ASSERT_TRUE(run.record.u[0] == 0.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.5, run.record.objective);
}

/* ---- budgets ---- */

static void the_budget_of_evaluations_is_kept(void) {
    for (uint32_t prediction = 1; prediction <= 3; prediction++) {
        for (uint32_t limit = 1; limit < 15; limit++) {
            setUp();
            tl_plan_adjust *adjust = make_observer();
            adjust->lower = -1.0;
            adjust->upper = 1.0;
            plan.plan.prediction = prediction;
            tl_test_run_build(&run, &plan);
            run.budget.evaluations = limit;
            for (int i = 0; i < 4; i++) {
                plant(0.1 * (double)i, 9.0 + (double)i); /* out of reach */
                const tl_record *record = tl_test_run_tick(&run, &call_log);
                TEST_ASSERT_TRUE(record->evaluations >= 1 && record->evaluations <= limit);
                TEST_ASSERT_TRUE(isfinite(record->objective_nominal)); /* nominal is always evaluated */
                TEST_ASSERT_TRUE(record->objective <= record->objective_nominal);
                TEST_ASSERT_EQUAL_UINT32(2 + 2 * prediction * record->evaluations, record->executions);
            }
            tl_test_run_end(&run, &plan);
        }
    }
}

static void the_end_of_the_budget_is_told(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = 5;
    plant(0.0, 50.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_STOP_EVALUATIONS, record->stop);
    TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, record->outcome);
    TEST_ASSERT_EQUAL_UINT32(5, record->evaluations);
}

static void time_stops_the_search_before_it_is_over(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    use_clock(8);
    plant(0.0, 1000.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_STOP_TIME, record->stop);
    TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, record->outcome);
    TEST_ASSERT_TRUE(record->evaluations >= 4);
    TEST_ASSERT_TRUE(record->evaluations * (TL_SECOND / 1000) <= run.budget.time);
    TEST_ASSERT_EQUAL_INT64((record->evaluations + 1) * (TL_SECOND / 1000), record->used);
}

static void time_is_kept_for_the_nominal(void) {
    (void)make_observer();
    plan.plan.prediction = 2;
    tl_test_run_build(&run, &plan);
    plant(0.0, 1.0);
    (void)tl_test_run_tick(&run, &call_log);
    use_clock(11);
    plant(0.0, 1000.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_STOP_TIME, record->stop);
    TEST_ASSERT_TRUE(isfinite(record->objective_nominal));
    TEST_ASSERT_TRUE(record->evaluations >= 3);
    TEST_ASSERT_TRUE(2 * record->evaluations * (TL_SECOND / 1000) <= run.budget.time);
}

static void no_time_at_all_commits_nominal(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(3.0, 1000.0);
    use_clock(8);
    now += 9 * (TL_SECOND / 1000);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
    TEST_ASSERT_EQUAL_INT(TL_STOP_TIME, record->stop);
    TEST_ASSERT_EQUAL_UINT32(0, record->evaluations);
    TEST_ASSERT_EQUAL_UINT32(2, record->executions);
    TEST_ASSERT_TRUE(record->u[0] == 3.0);
    TEST_ASSERT_TRUE(isnan(record->objective));
    TEST_ASSERT_TRUE(isnan(record->objective_nominal));
}

static void without_a_clock_time_does_not_matter(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    run.budget.time = 1;
    plant(0.0, 30.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_EQUAL_INT64(0, record->used);
}

/* A clock that jumps at its n-th reading. */
static tl_time jump;
static int jump_at;
static int readings;

static tl_time read_jumping_clock(void *context) {
    tl_time *time = context;
    *time += 1000 + (++readings == jump_at ? jump : 0);
    return *time;
}

static void a_clock_that_jumps_neither_hangs_nor_harms(void) {
    static const tl_time jumps[] = {3600 * TL_SECOND, -3600 * TL_SECOND, INT64_MAX / 2, -(INT64_MAX / 2)};
    for (size_t i = 0; i < sizeof jumps / sizeof jumps[0]; i++) {
        for (jump_at = 1; jump_at < 30; jump_at++) {
            setUp();
            (void)make_observer();
            tl_test_run_build(&run, &plan);
            jump = jumps[i];
            readings = 0;
            run.budget.now = read_jumping_clock;
            run.budget.context = &now;
            run.budget.time = TL_SECOND / 100;
            run.budget.evaluations = 40;
            plant(0.0, 1e6);
            const tl_record *record = tl_test_run_tick(&run, &call_log);
            TEST_ASSERT_TRUE(record->evaluations <= 40);
            TEST_ASSERT_TRUE(record->outcome == TL_BEST_SO_FAR || record->outcome == TL_NOMINAL);
            TEST_ASSERT_TRUE(record->evaluations == 0 || record->objective <= record->objective_nominal);
            if (jump > 0 && jump_at < 15) {
                TEST_ASSERT_EQUAL_INT(TL_STOP_TIME, record->stop);
            }
            tl_test_run_end(&run, &plan);
        }
    }
}

/* ---- failing candidates ---- */

static const tl_test_fault_kind survivable[] = {TL_TEST_DISCARD, TL_TEST_ERROR, TL_TEST_NAN};

static void failing_candidates_are_worst_and_never_end_the_run(void) {
    for (size_t kind = 0; kind < 3; kind++) {
        for (uint32_t prediction = 1; prediction <= 2; prediction++) {
            setUp();
            (void)make_observer();
            plan.plan.prediction = prediction;
            tl_test_run_build(&run, &plan);
            tl_test_fmu_fail_above(&fmus[0], survivable[kind], 2.5);
            for (int i = 0; i < 6; i++) {
                plant(0.0, i < 3 ? 2.4 : 3.0); /* below the limit, then beyond it */
                const tl_record *record = tl_test_run_tick(&run, &call_log);
                TEST_ASSERT_TRUE(record->u[0] <= 2.5);
                TEST_ASSERT_TRUE(isfinite(record->objective));
                TEST_ASSERT_FALSE(record->objective > record->objective_nominal);
                if (prediction == 1) {
                    TEST_ASSERT_EQUAL_INT(i < 3 ? TL_OPTIMISED : TL_BEST_SO_FAR, record->outcome);
                }
            }
            tl_test_run_end(&run, &plan);
        }
    }
}

static void a_failing_guess_is_left(void) {
    for (size_t kind = 0; kind < 3; kind++) {
        setUp();
        (void)make_observer();
        tl_test_run_build(&run, &plan);
        plant(0.0, 0.0);
        (void)tl_test_run_tick(&run, &call_log);
        tl_test_fmu_fail_above(&fmus[0], survivable[kind], 2.5);
        plant(5.0, 1.0);                         /* û fails */
        (void)tl_test_run_tick(&run, &call_log); /* lag: cmd is an input from the next tick on */
        const tl_record *record = tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
        TEST_ASSERT_EQUAL_UINT32(2, record->evaluations); /* the last u is good enough */
        TEST_ASSERT_DOUBLE_WITHIN(0.01, 1.0, record->u[0]);
        TEST_ASSERT_TRUE(isnan(record->objective_nominal));
        TEST_ASSERT_TRUE(record->nominal[0] == 5.0);
        tl_test_run_end(&run, &plan);
    }
}

static void a_search_after_a_failing_guess_has_the_whole_budget(void) {
    (void)make_observer();
    plan.plan.prediction = 2;
    tl_test_run_build(&run, &plan);
    plant(0.0, 3.0);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 3.0, run.record.u[0]);
    tl_test_fmu_fail_above(&fmus[0], TL_TEST_DISCARD, 2.5); /* now the last u fails */
    run.budget.evaluations = 9;
    plant(0.0, 100.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_STOP_EVALUATIONS, record->stop);
    TEST_ASSERT_EQUAL_UINT32(9, record->evaluations);
    TEST_ASSERT_TRUE(tried(1) == 0.0);                              /* nominal is second, and evaluated once */
    TEST_ASSERT_EQUAL_DOUBLE(9e4 + 1e8, record->objective_nominal); /* the samples are 3 and 100 */
    TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, record->outcome);
}

static void the_last_u_is_not_used_outside_the_bounds(void) {
    tl_plan_adjust *adjust = make_observer();
    adjust->lower = 0.0;
    adjust->upper = 3.0;
    tl_test_run_build(&run, &plan);
    plant(7.0, 7.0);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(run.record.u[0] == 7.0); /* û */
    plant(9.0, 7.0);
    (void)tl_test_run_tick(&run, &call_log);
    tl_test_fmu_fail_above(&fmus[0], TL_TEST_DISCARD, 8.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(record->nominal[0] == 9.0);
    TEST_ASSERT_TRUE(record->u[0] <= 3.0);
}

static void a_failing_nominal_loses_against_anything(void) {
    (void)make_observer();
    plan.plan.margin = 0.9;
    tl_test_run_build(&run, &plan);
    plant(0.0, 0.0);
    (void)tl_test_run_tick(&run, &call_log);
    tl_test_fmu_fail_above(&fmus[0], TL_TEST_DISCARD, 2.5);
    plant(3.0, 50.0);
    (void)tl_test_run_tick(&run, &call_log);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, record->outcome);
    TEST_ASSERT_TRUE(record->u[0] <= 2.5);
    TEST_ASSERT_TRUE(isnan(record->objective_nominal));
}

static void where_everything_fails_the_step_fails(void) {
    for (size_t kind = 0; kind < 2; kind++) {
        setUp();
        (void)make_observer();
        tl_test_run_build(&run, &plan);
        plant(0.0, 1.0);
        (void)tl_test_run_tick(&run, &call_log);
        tl_test_fmu_fail_above(&fmus[0], survivable[kind], -HUGE_VAL);
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
        TEST_ASSERT_FALSE(run.ready);
        TEST_ASSERT_NOT_NULL(strstr(run.error.text, "m: "));
        tl_test_run_end(&run, &plan);
    }
}

/* No u is the cause: no candidate counts as refused, and nominal is committed. */
static void where_an_output_is_never_finite_it_is_nominal(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(0.0, 1.0);
    (void)tl_test_run_tick(&run, &call_log);
    tl_test_fmu_fail_above(&fmus[0], TL_TEST_NAN, -HUGE_VAL);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
    TEST_ASSERT_TRUE(isnan(record->y[0]) && isnan(record->objective));
    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_NOT_FINITE, record->flags);
    TEST_ASSERT_EQUAL_UINT64(1, record->bad_outputs);
    TEST_ASSERT_EQUAL_UINT32(0, record->refused.count);
    tl_test_fmu_fail_above(&fmus[0], TL_TEST_NAN, HUGE_VAL);
    record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(record->objective < 1.0 && record->flags == 0 && record->bad_outputs == 0);
}

static void a_commit_that_fails_is_replaced_by_nominal(void) {
    for (size_t kind = 0; kind < 2; kind++) {
        setUp();
        (void)make_observer();
        tl_test_run_build(&run, &plan);
        plant(0.0, 3.0);
        (void)tl_test_run_tick(&run, &call_log);
        uint64_t commit = fmus[0].calls[TL_TEST_DO_STEP] + run.record.evaluations + 1; /* if the search is the same */
        tl_test_fmu_fail(&fmus[0], TL_TEST_DO_STEP, survivable[kind], commit, commit);
        const tl_record *record = tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
        TEST_ASSERT_TRUE(record->u[0] == 0.0);
        TEST_ASSERT_TRUE(record->y[0] == 0.0);
        TEST_ASSERT_EQUAL_DOUBLE(90000.0, record->objective);
        TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, tl_test_run_tick(&run, &call_log)->outcome); /* the run continues */
        tl_test_run_end(&run, &plan);
    }
}

/* ---- fatal ---- */

static void nothing_is_called_after_fatal(void) {
    static const tl_test_call calls[] = {TL_TEST_SET_REAL, TL_TEST_DO_STEP, TL_TEST_GET_REAL, TL_TEST_GET_STATE,
                                         TL_TEST_SET_STATE};
    for (size_t i = 0; i < sizeof calls / sizeof calls[0]; i++) {
        for (uint64_t later = 1; later < 12; later++) { /* in the guess, the search, the commit, or the next step */
            setUp();
            tl_test_fmu_init(&fmus[1], 1, false, &call_log);
            tl_test_plan_component(&plan, "bystander", &fmus[1]); /* another FMU, first in each step */
            tl_test_plan_set(&plan, "u0", 0.0);
            (void)make_observer();
            plan.plan.prediction = 1 + (uint32_t)(later % 2);
            tl_test_run_build(&run, &plan);
            plant(0.0, 3.0);
            (void)tl_test_run_tick(&run, &call_log);
            plant(0.0, 9.0);
            uint64_t number = fmus[0].calls[calls[i]] + later;
            tl_test_fmu_fail(&fmus[0], calls[i], TL_TEST_FATAL, number, number);
            for (int n = 0; n < 20 && run.status == TL_OK; n++) {
                tl_test_run_step(&run);
            }
            TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
            TEST_ASSERT_FALSE(run.ready);
            TEST_ASSERT_NOT_NULL(strstr(run.error.text, "fmi2Fatal"));
            TEST_ASSERT_EQUAL_INT(calls[i], call_log.entries[call_log.count - 1].call);
            TEST_ASSERT_EQUAL_PTR(&fmus[0], call_log.entries[call_log.count - 1].fmu);
            size_t count = call_log.count;
            tl_test_run_step(&run); /* the caller steps the twin all the same */
            TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
            tl_test_run_catch_up(&run);
            TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
            TEST_ASSERT_EQUAL_UINT64(count, call_log.count);
            tl_twin_destroy(run.twin);
            run.twin = NULL;
            TEST_ASSERT_EQUAL_UINT64(1, fmus[0].living); /* not freed, */
            TEST_ASSERT_EQUAL_UINT64(0, fmus[1].living); /* but the bystander is */
            tl_test_run_end(&run, &plan);
        }
    }
}

static void fatal_is_for_all_instances_of_the_fmu(void) {
    (void)make_observer();
    tl_test_plan_component(&plan, "other", &fmus[0]); /* a second instance of the same FMU */
    tl_test_plan_set(&plan, "u0", 0.0);
    tl_test_plan_set(&plan, "u1", 0.0);
    tl_test_fmu_init(&fmus[1], 1, false, &call_log);
    tl_test_plan_component(&plan, "another", &fmus[1]); /* another FMU */
    tl_test_plan_set(&plan, "u0", 0.0);
    tl_test_run_build(&run, &plan);
    plant(0.0, 3.0);
    (void)tl_test_run_tick(&run, &call_log);
    tl_test_fmu_fail(&fmus[0], TL_TEST_DO_STEP, TL_TEST_FATAL, fmus[0].calls[TL_TEST_DO_STEP] + 1, UINT64_MAX);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
    tl_twin_destroy(run.twin);
    run.twin = NULL;
    TEST_ASSERT_EQUAL_UINT64(2, fmus[0].living); /* not freed */
    TEST_ASSERT_EQUAL_UINT64(0, fmus[1].living);
}

/* ---- quality ---- */

static void without_a_good_measurement_nothing_is_searched(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(1.0, 1.0);
    (void)tl_test_run_tick(&run, &call_log);
    run.sample.quality[Y0] = TL_STALE;
    plant(2.0, 1e9);
    for (int i = 0; i < 3; i++) {
        const tl_record *record = tl_test_run_tick(&run, &call_log);
        TEST_ASSERT_EQUAL_INT(TL_FREE_RUN, record->outcome);
        TEST_ASSERT_EQUAL_INT(TL_STOP_NONE, record->stop);
        TEST_ASSERT_EQUAL_UINT32(0, record->evaluations);
        TEST_ASSERT_EQUAL_UINT32(2, record->executions);
        TEST_ASSERT_TRUE(record->u[0] == record->nominal[0]);
        TEST_ASSERT_TRUE(isnan(record->objective));
        TEST_ASSERT_EQUAL_UINT8(TL_STALE, record->measured_quality[0]);
        TEST_ASSERT_TRUE(record->measured[0] == 1.0); /* the last good value */
        TEST_ASSERT_TRUE(tl_test_log_step(&call_log, &fmus[0], 0)->final);
        TEST_ASSERT_EQUAL_UINT64(1, tl_test_log_count(&call_log, NULL, TL_TEST_GET_STATE)); /* in case the step fails */
        TEST_ASSERT_EQUAL_UINT64(0, tl_test_log_count(&call_log, NULL, TL_TEST_SET_STATE));
    }
    run.sample.quality[Y0] = TL_GOOD;
    plant(2.0, 4.0);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, tl_test_run_tick(&run, &call_log)->outcome);
}

static void a_bad_input_signal_holds_its_last_good_value(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(1.5, 1.5);
    (void)tl_test_run_tick(&run, &call_log);
    run.sample.quality[CMD] = TL_NO_LINK;
    plant(99.0, 1.5);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_TRUE(tl_test_run_tick(&run, &call_log)->nominal[0] == 1.5);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, run.record.outcome);
}

static void one_of_two_matches_may_be_bad(void) {
    make_plan();
    tl_test_plan_match(&plan, "m.y1", "plant.y1", 0.01);
    tl_test_plan_adjust(&plan, "m.offset", 1.0);
    tl_test_run_build(&run, &plan);
    run.sample.values[Y1] = 7.0;
    plant(0.0, 2.0);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, run.record.outcome); /* 2 and 7 contradict each other */
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 4.5, run.record.u[0]);
    run.sample.quality[Y1] = TL_OUT_OF_RANGE;
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome); /* y0 alone */
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 2.0, record->u[0]);
    TEST_ASSERT_EQUAL_UINT8(TL_GOOD, record->measured_quality[0]);
    TEST_ASSERT_EQUAL_UINT8(TL_OUT_OF_RANGE, record->measured_quality[1]);
}

static void a_bad_sample_in_the_horizon_is_left_out(void) {
    (void)make_observer();
    plan.plan.prediction = 3;
    tl_test_run_build(&run, &plan);
    plant(0.0, 2.0);
    (void)tl_test_run_tick(&run, &call_log);
    run.sample.quality[Y0] = TL_STALE;
    plant(0.0, 1e9);
    (void)tl_test_run_tick(&run, &call_log); /* two good samples of 2.0 and a bad one */
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, run.record.outcome);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, run.record.outcome);
    (void)tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_FREE_RUN, run.record.outcome);
    run.sample.quality[Y0] = TL_GOOD;
    plant(0.0, 5.0);
    (void)tl_test_run_tick(&run, &call_log); /* only the newest one is good */
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, run.record.outcome);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 5.0, run.record.u[0]);
}

/* ---- several variables ---- */

static void two_variables_and_two_matches_are_found(void) {
    make_plan();
    plan.plan.connection_count = 0;
    plan.components[0].set_count = 0;
    tl_test_plan_match(&plan, "m.y1", "plant.y1", 0.01);
    tl_test_plan_adjust(&plan, "m.u0", 1.0);
    tl_test_plan_adjust(&plan, "m.u1", 1.0);
    tl_test_run_build(&run, &plan);
    run.sample.values[Y1] = -3.0;
    plant(0.0, 2.0);
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 2.0, record->u[0]);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, -3.0, record->u[1]);
    TEST_ASSERT_TRUE(record->nominal[0] == 0.0 && record->nominal[1] == 0.0);
    TEST_ASSERT_TRUE(record->y[0] == record->u[0] && record->y[1] == record->u[1]);
}

static void an_input_and_a_parameter_are_found_together(void) {
    (void)make_observer();
    tl_test_plan_match(&plan, "m.y1", "plant.y1", 0.01);
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "m.offset", 1.0);
    adjust->has_nominal = true;
    adjust->nominal = 0.5;
    tl_test_run_build(&run, &plan);
    run.sample.values[Y1] = 1.0; /* offset 1 */
    plant(0.0, 4.0);             /* u0 3 */
    const tl_record *record = tl_test_run_tick(&run, &call_log);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, record->outcome);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 3.0, record->u[0]);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 1.0, record->u[1]);
    TEST_ASSERT_TRUE(record->nominal[1] == 0.5);
    const tl_test_entry *commit = tl_test_log_step(&call_log, &fmus[0], record->evaluations);
    TEST_ASSERT_TRUE(commit->offset == record->u[1]);
}

/* ---- made up ---- */

static void a_missed_step_is_made_up_with_the_last_u(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(1.0, 4.0);
    (void)tl_test_run_tick(&run, &call_log);
    double last = run.record.u[0];
    tl_test_log_clear(&call_log);
    plant(2.0, 9.0);
    tl_test_run_catch_up(&run);
    TEST_ASSERT_EQUAL_INT(TL_OK, run.status);
    TEST_ASSERT_TRUE(run.ready);
    TEST_ASSERT_EQUAL_INT(TL_CAUGHT_UP, run.record.outcome);
    TEST_ASSERT_TRUE(run.record.u[0] == last);
    TEST_ASSERT_TRUE(run.record.y[0] == last);
    TEST_ASSERT_TRUE(run.record.nominal[0] == 1.0);
    TEST_ASSERT_EQUAL_UINT32(0, run.record.evaluations);
    TEST_ASSERT_EQUAL_UINT32(2, run.record.executions);
    TEST_ASSERT_TRUE(isnan(run.record.objective));
    TEST_ASSERT_TRUE(tl_test_log_step(&call_log, &fmus[0], 0)->final);
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, tl_test_run_tick(&run, &call_log)->outcome); /* searched again */
}

static void before_any_step_it_is_made_up_with_nominal(void) {
    (void)make_observer();
    tl_test_run_build(&run, &plan);
    plant(1.0, 4.0);
    tl_test_run_catch_up(&run); /* tick 0: initialises */
    TEST_ASSERT_EQUAL_INT(TL_OK, run.status);
    TEST_ASSERT_FALSE(run.ready);
    tl_test_run_catch_up(&run);
    TEST_ASSERT_TRUE(run.ready);
    TEST_ASSERT_EQUAL_INT(TL_CAUGHT_UP, run.record.outcome);
    TEST_ASSERT_TRUE(run.record.u[0] == 1.0);
}

static void run_search(void) {
    RUN_TEST(a_guess_within_tolerance_is_committed_without_a_search);
    RUN_TEST(a_guess_out_of_tolerance_is_searched_from);
    RUN_TEST(it_learns_at_the_first_step_though_all_is_well);
    RUN_TEST(it_learns_once_only_and_without_a_word_where_nothing_matters);
    RUN_TEST(it_does_not_learn_beyond_the_budget);
    RUN_TEST(the_best_point_is_committed_not_the_last);
    RUN_TEST(the_start_is_evaluated_once);
    RUN_TEST(trials_may_go_back_and_the_commit_may_not);
    RUN_TEST(a_step_saves_once_and_restores_once_per_evaluation);
    RUN_TEST(a_candidate_is_held_over_the_horizon);
    RUN_TEST(steps_before_the_distance_do_not_count);
    RUN_TEST(at_the_shortest_prediction_the_guess_is_nominal);
    RUN_TEST(at_a_longer_prediction_the_guess_is_the_last_u);
    RUN_TEST(the_last_u_is_evaluated_once_too);
    RUN_TEST(the_search_stays_within_the_bounds);
    RUN_TEST(a_nominal_outside_the_bounds_stays_what_it_is);
    RUN_TEST(a_nominal_outside_the_bounds_may_be_right);
    RUN_TEST(an_old_nominal_outside_the_bounds_is_not_guessed_again);
    RUN_TEST(a_small_gain_is_worth_it_without_a_margin);
    RUN_TEST(a_gain_below_the_margin_is_not_worth_it);
    RUN_TEST(a_gain_above_the_margin_is_worth_it);
    RUN_TEST(nothing_better_than_nominal_is_nominal);
    RUN_TEST(a_bad_last_u_is_held_against_the_nominal);
}

static void run_limits(void) {
    RUN_TEST(the_budget_of_evaluations_is_kept);
    RUN_TEST(the_end_of_the_budget_is_told);
    RUN_TEST(time_stops_the_search_before_it_is_over);
    RUN_TEST(time_is_kept_for_the_nominal);
    RUN_TEST(no_time_at_all_commits_nominal);
    RUN_TEST(without_a_clock_time_does_not_matter);
    RUN_TEST(a_clock_that_jumps_neither_hangs_nor_harms);
    RUN_TEST(failing_candidates_are_worst_and_never_end_the_run);
    RUN_TEST(a_failing_guess_is_left);
    RUN_TEST(a_search_after_a_failing_guess_has_the_whole_budget);
    RUN_TEST(the_last_u_is_not_used_outside_the_bounds);
    RUN_TEST(a_failing_nominal_loses_against_anything);
    RUN_TEST(where_everything_fails_the_step_fails);
    RUN_TEST(where_an_output_is_never_finite_it_is_nominal);
    RUN_TEST(a_commit_that_fails_is_replaced_by_nominal);
    RUN_TEST(nothing_is_called_after_fatal);
    RUN_TEST(fatal_is_for_all_instances_of_the_fmu);
}

static void run_plant(void) {
    RUN_TEST(without_a_good_measurement_nothing_is_searched);
    RUN_TEST(a_bad_input_signal_holds_its_last_good_value);
    RUN_TEST(one_of_two_matches_may_be_bad);
    RUN_TEST(a_bad_sample_in_the_horizon_is_left_out);
    RUN_TEST(two_variables_and_two_matches_are_found);
    RUN_TEST(an_input_and_a_parameter_are_found_together);
    RUN_TEST(a_missed_step_is_made_up_with_the_last_u);
    RUN_TEST(before_any_step_it_is_made_up_with_nominal);
}

int main(void) {
    UNITY_BEGIN();
    run_search();
    run_limits();
    run_plant();
    return UNITY_END();
}
