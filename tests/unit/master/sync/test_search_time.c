/* A step stays within its time, whatever takes the time: executions, solver, states or commit. The
 * ledger's prediction does not count. The clock is read only as often as needed.
 *
 * The parts are real, but each of their calls also advances a fake clock. The linker wraps
 * tl_ledger_evaluate() and tl_ledger_commit(); a class wraps the solver. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/twin/twin_parts.h"
#include "tests/support/test_plan.h"

enum { FMUS = 2, TICKS = 120, EVALUATIONS = 40, SOLVERS = 5 };

static const tl_time EXECUTION = TL_SECOND / 1000;
static const tl_time PERIOD = TL_SECOND / 10;
static const tl_time BUDGET = 6 * (TL_SECOND / 100);

static const char *const solvers[SOLVERS] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"};

static tl_test_log call_log;
static tl_test_fmu fmus[FMUS];
static tl_test_plan plan;
static tl_test_run run;

/* Time of each call of a part, ns. */
typedef struct work {
    tl_time evaluating;
    tl_time committing;
    tl_time thinking;
    tl_time guessing;
    tl_time states;
} work;

static struct {
    tl_time now;
    int64_t readings;
    work work;
} watch;

void setUp(void) {
    memset(&watch, 0, sizeof watch);
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static tl_time read_clock(void *context) {
    (void)context;
    watch.readings++;
    return watch.now;
}

/* ---- parts that take time ---- */

/* For the linker, the first of each two is __real_NAME. The second, __wrap_NAME, is called
 * instead. */
uint64_t plain_evaluate(tl_ledger *ledger) __asm__("__real_tl_ledger_evaluate");
uint64_t slow_evaluate(tl_ledger *ledger) __asm__("__wrap_tl_ledger_evaluate");
void plain_commit(tl_ledger *ledger, const double *values) __asm__("__real_tl_ledger_commit");
void slow_commit(tl_ledger *ledger, const double *values) __asm__("__wrap_tl_ledger_commit");

uint64_t slow_evaluate(tl_ledger *ledger) {
    watch.now += watch.work.evaluating;
    return plain_evaluate(ledger);
}

void slow_commit(tl_ledger *ledger, const double *values) {
    watch.now += watch.work.committing;
    plain_commit(ledger, values);
}

static fmi2Status (*plain_get)(fmi2Component, fmi2FMUstate *);
static fmi2Status (*plain_set)(fmi2Component, fmi2FMUstate);

static fmi2Status costly_get(fmi2Component component, fmi2FMUstate *state) {
    watch.now += watch.work.states;
    return plain_get(component, state);
}

static fmi2Status costly_set(fmi2Component component, fmi2FMUstate state) {
    watch.now += watch.work.states;
    return plain_set(component, state);
}

/* The used solver, with additional time before each evaluation. */
static tl_optimiser_class thoughtful;
static const tl_optimiser_class *plain_solver;
static const tl_search *plain_search;

static bool think_and_ask(void *context, const double *u, double *value, const double **residuals) {
    watch.now += watch.work.thinking;
    return plain_search->evaluate(context, u, value, residuals);
}

static tl_search_end minimise(tl_optimiser *optimiser, const tl_search *search) {
    tl_search own = *search;
    own.evaluate = think_and_ask;
    plain_search = search;
    return plain_solver->minimise(optimiser, &own);
}

static bool guess(tl_optimiser *optimiser, const tl_forecast *forecast, double *u) {
    watch.now += watch.work.guessing;
    return plain_solver->guess(optimiser, forecast, u);
}

static void wrap_solver(tl_synchroniser *synchroniser) {
    plain_solver = synchroniser->solver;
    thoughtful = *plain_solver;
    thoughtful.minimise = minimise;
    thoughtful.guess = plain_solver->guess != NULL ? guess : NULL;
    synchroniser->solver = &thoughtful;
}

/* ---- the twin ---- */

/* cmd → drive → motor. Their targets contradict each other. */
static void build(const char *solver, uint32_t prediction, bool saving) {
    static const char *const names[FMUS] = {"drive", "motor"};
    tl_test_run_end(&run, &plan);
    tl_test_plan_init(&plan, PERIOD);
    for (size_t i = 0; i < FMUS; i++) {
        tl_test_fmu_init(&fmus[i], 2, false, &call_log);
        (void)tl_test_plan_component(&plan, names[i], &fmus[i]);
        tl_test_plan_set(&plan, "u1", 0.0);
        tl_test_plan_set(&plan, "lag", 0.1 + 0.05 * (double)i);
    }
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y0", TL_REAL, "");
    tl_test_plan_signal(&plan, "sum", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "drive.u0");
    tl_test_plan_connect(&plan, "drive.y0", "motor.u0");
    tl_test_plan_adjust(&plan, "motor.u0", 0.1);
    tl_test_plan_match(&plan, "motor.y0", "plant.y0", 0.001);
    tl_test_plan_match(&plan, "motor.sum", "plant.sum", 0.001);
    plan.plan.algorithm = solver;
    plan.plan.prediction = prediction;
    plan.plan.saving = (tl_plan_saving){saving, saving, 0};
    plan.plan.margin = 0.01;
    plan.plan.evaluations = EVALUATIONS;
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = EVALUATIONS;
    run.budget.now = read_clock;
    run.budget.time = BUDGET;
    for (size_t i = 0; i < FMUS; i++) {
        fmus[i].control.clock = &watch.now;
        fmus[i].control.cost = EXECUTION;
        plain_get = fmus[i].functions.get_fmu_state;
        plain_set = fmus[i].functions.set_fmu_state;
        fmus[i].functions.get_fmu_state = costly_get;
        fmus[i].functions.set_fmu_state = costly_set;
    }
    wrap_solver(&run.twin->synchroniser);
}

static void step(void) {
    double t = (double)run.sample.tick;
    run.sample.values[0] = sin(0.2 * t);
    run.sample.values[1] = sin(0.2 * t - 0.6) + 0.3;
    run.sample.values[2] = sin(0.2 * t - 0.6) + 0.5;
    run.budget.started = watch.now;
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
}

/* ---- in time ---- */

/* The first steps, in which the costs are learned, do not count. Returns the number of
 * evaluations. */
static uint32_t run_in_time(const char *solver, uint32_t prediction, bool saving, work costs) {
    uint32_t evaluations = 0;
    setUp();
    build(solver, prediction, saving);
    watch.work = costs;
    for (int64_t tick = 0; tick < TICKS; tick++) {
        step();
        if (run.ready && run.record.step > 3) {
            TEST_ASSERT_TRUE_MESSAGE(run.record.used <= BUDGET, solver);
            TEST_ASSERT_EQUAL_INT64(watch.now - run.budget.started - costs.evaluating, run.record.used);
            evaluations += run.record.evaluations;
        }
    }
    tl_test_run_end(&run, &plan);
    return evaluations;
}

static void all_that_a_search_does_is_in_its_estimate(void) {
    static const work costs[] = {
        {.evaluating = TL_SECOND},
        {.committing = 8 * (TL_SECOND / 1000)},
        {.thinking = 5 * (TL_SECOND / 1000)},
        {.guessing = 20 * (TL_SECOND / 1000)},
        {.states = 700 * (TL_SECOND / 1000000)},
        {TL_SECOND / 500, TL_SECOND / 500, TL_SECOND / 500, TL_SECOND / 500, TL_SECOND / 2000},
    };
    for (size_t c = 0; c < sizeof costs / sizeof costs[0]; c++) {
        for (uint32_t number = 0; number < SOLVERS * 8; number++) {
            uint32_t evaluations =
                run_in_time(solvers[number % SOLVERS], 1 + number / SOLVERS % 4, number / (SOLVERS * 4) != 0, costs[c]);
            TEST_ASSERT_TRUE(evaluations > TICKS); /* searches continue */
        }
    }
}

/* What never fits into the time is tried less and less often. */
static void what_is_never_in_time_is_hardly_ever_late(void) {
    static const work costs[] = {{.guessing = 3 * (TL_SECOND / 50)}, {.thinking = 3 * (TL_SECOND / 50)}};
    for (size_t c = 0; c < 2; c++) {
        uint32_t late = 0;
        setUp();
        build("secant", 3, true);
        for (int64_t tick = 0; tick < 2000; tick++) {
            if (tick == 20) {
                watch.work = costs[c];
            }
            step();
            late += run.ready && run.record.used > BUDGET ? 1 : 0;
        }
        TEST_ASSERT_TRUE(late > 0 && late < 20);
        tl_test_run_end(&run, &plan);
    }
}

/* ---- repeated ---- */

/* One reachable output, with a tolerance that lets u stay on one side. */
static void build_loose(void) {
    build("secant", 1, true);
    tl_twin_destroy(run.twin);
    plan.plan.match_count = 1;
    plan.match[0].tolerance = 0.1;
    const tl_budget budget = run.budget;
    tl_test_run_init(&run, tl_test_plan_build(&plan));
    run.budget = budget;
    wrap_solver(&run.twin->synchroniser);
}

static bool was_late(const tl_record *record) {
    return record->stop == TL_STOP_TIME || (record->flags & TL_FLAG_WITHOUT_NOMINAL) != 0;
}

/* A guess that takes long is sometimes not made, and sometimes not evaluated. A repetition cannot
 * distinguish the two, and need not. */
static void a_guess_that_was_not_evaluated_leaves_nothing_behind(void) {
    static tl_record live[TICKS];
    uint32_t unguessed = 0;
    build_loose();
    for (int64_t tick = 0; tick < TICKS; tick++) {
        watch.work.guessing = tick % 20 == 0 ? 7 * (TL_SECOND / 100) : TL_SECOND / 1000;
        step();
        live[tick] = run.record;
        unguessed += was_late(&run.record) && run.record.evaluations == 0 ? 1 : 0;
    }
    TEST_ASSERT_TRUE(unguessed > 5 && unguessed < TICKS - 20);
    build_loose();
    run.budget.now = NULL;
    for (int64_t tick = 0; tick < TICKS; tick++) {
        const tl_record *first = &live[tick];
        run.budget.repeated = was_late(first);
        run.budget.evaluations = run.budget.repeated ? first->evaluations : EVALUATIONS;
        run.budget.without_nominal = (first->flags & TL_FLAG_WITHOUT_NOMINAL) != 0;
        step();
        if (run.ready) {
            TEST_ASSERT_EQUAL_INT(first->outcome, run.record.outcome);
            TEST_ASSERT_EQUAL_UINT32(first->evaluations, run.record.evaluations);
            TEST_ASSERT_EQUAL_MEMORY(first->u, run.record.u, sizeof first->u[0]);
            TEST_ASSERT_EQUAL_MEMORY(first->y, run.record.y, sizeof first->y[0]);
        }
    }
}

/* ---- the clock ---- */

/* One read per macro step, one per evaluation (the last one may be refused), and some per
 * step. If a step is timed in detail, one more per component. */
static void the_clock_is_read_once_for_each_macro_step(void) {
    for (uint32_t prediction = 1; prediction <= 16; prediction *= 2) {
        for (int saving = 0; saving < 2; saving++) {
            setUp();
            build("nelder-mead", prediction, saving > 0);
            run.budget.time = 1000 * BUDGET;
            int64_t most = 0;
            for (int64_t tick = 0; tick < TICKS; tick++) {
                int64_t before = watch.readings;
                step();
                int64_t questions = (int64_t)run.record.evaluations + 1;
                int64_t macro_steps = (int64_t)run.record.evaluations * prediction + 1;
                most = run.record.evaluations > most ? run.record.evaluations : most;
                if (run.ready && run.record.step > 3) {
                    TEST_ASSERT_TRUE(watch.readings - before <= macro_steps + questions + 3 + FMUS);
                }
            }
            TEST_ASSERT_TRUE(most == EVALUATIONS);
            tl_test_run_end(&run, &plan);
        }
    }
}

/* If nothing is saved, the clock does not split the execution of the components. */
static void a_clock_does_not_part_what_is_executed_in_one_go(void) {
    build("nelder-mead", 4, false);
    run.budget.time = 1000 * BUDGET;
    for (int64_t tick = 0; tick < 60; tick++) {
        step();
        TEST_ASSERT_TRUE(run.twin->exchange.whole);
    }
    TEST_ASSERT_EQUAL_INT64(FMUS * EXECUTION, run.twin->exchange.costs.all.most);
    TEST_ASSERT_EQUAL_INT64(EXECUTION, tl_twin_get_ledger(run.twin, 0).cost);
    TEST_ASSERT_EQUAL_INT64(EXECUTION, tl_twin_get_ledger(run.twin, 1).cost);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(all_that_a_search_does_is_in_its_estimate);
    RUN_TEST(what_is_never_in_time_is_hardly_ever_late);
    RUN_TEST(a_guess_that_was_not_evaluated_leaves_nothing_behind);
    RUN_TEST(the_clock_is_read_once_for_each_macro_step);
    RUN_TEST(a_clock_does_not_part_what_is_executed_in_one_go);
    return UNITY_END();
}
