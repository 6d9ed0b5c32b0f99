/* Plan of a twin with test FMUs, and one run of that twin.
 *
 * Purpose: a test of the master writes only what is special in its plan. Each item gets as `where`
 *          the JSON path that it would have in a configuration. The plan collects the problems that
 *          the build reports.
 * Use:     call tl_test_run_end() in tearDown(), and before a test starts another twin.
 * Owner:   the caller provides the memory of plan and run, zeroed at first. A plan is large, so
 *          make it static. Names must outlive both.
 * Thread:  one at a time.
 */
#ifndef TL_TESTS_SUPPORT_TEST_PLAN_H
#define TL_TESTS_SUPPORT_TEST_PLAN_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/twin/twin.h"
#include "tests/support/test_fmu.h"

enum {
    TL_TEST_COMPONENTS = 32,
    TL_TEST_SETS = 6, /* per component */
    TL_TEST_CONNECTIONS = 128,
    TL_TEST_PROBLEMS = 32,
    TL_TEST_WHERE = 48
};

typedef struct tl_test_problem {
    tl_status status;
    char where[TL_TEST_WHERE];
    char text[TL_ERROR_TEXT];
} tl_test_problem;

typedef struct tl_test_plan {
    tl_plan plan; /* points to the arrays below */
    tl_plan_component components[TL_TEST_COMPONENTS];
    tl_test_fmu *fmus[TL_TEST_COMPONENTS]; /* of the components */
    tl_plan_set sets[TL_TEST_COMPONENTS][TL_TEST_SETS];
    tl_plan_signal signals[TL_MAX_SIGNALS + 1]; /* here and below: room for one too many, for tests of the limit */
    tl_plan_connection connections[TL_TEST_CONNECTIONS];
    tl_plan_adjust adjust[TL_MAX_ADJUST + 1];
    tl_plan_match match[TL_MAX_MATCH + 1];
    char where[512][TL_TEST_WHERE];
    size_t where_count;
    tl_report report;
    tl_test_problem problems[TL_TEST_PROBLEMS];
} tl_test_plan;

/* Makes an empty plan: Nelder-Mead, lag, no margin, T_P as short as possible. */
void tl_test_plan_init(tl_test_plan *plan, tl_time step);

/* Each adds an item and returns it, so that the test can change its other fields. */
tl_plan_component *tl_test_plan_component(tl_test_plan *plan, const char *name, tl_test_fmu *fmu);
tl_plan_signal *tl_test_plan_signal(tl_test_plan *plan, const char *name, tl_type type, const char *unit);
void tl_test_plan_connect(tl_test_plan *plan, const char *from, const char *to);
tl_plan_adjust *tl_test_plan_adjust(tl_test_plan *plan, const char *variable, double step);
tl_plan_match *tl_test_plan_match(tl_test_plan *plan, const char *variable, const char *to, double tolerance);

/* Sets a start value of the component that was added last: a Real, or a value of any type. */
void tl_test_plan_set(tl_test_plan *plan, const char *variable, double value);
void tl_test_plan_set_value(tl_test_plan *plan, const char *variable, tl_value value);

/* Calls tl_twin_build() and collects its problems; earlier ones are deleted. */
tl_twin *tl_test_plan_build(tl_test_plan *plan);

/* Returns the first problem with this `where` whose text has all parts of `words` (message.h);
 * NULL: there is none. */
const tl_test_problem *tl_test_plan_problem(const tl_test_plan *plan, const char *where, const char *words);

/* Makes a plan with one component "m" of one channel: plant.cmd drives u0, and y0 is matched with
 * plant.y0, tolerance 0.01. */
enum { TL_TEST_CMD, TL_TEST_Y0 }; /* its signals */
void tl_test_plan_single(tl_test_plan *plan, tl_test_fmu *fmu, tl_test_log *log);

/* A twin, its inputs for the next tick, and the results of the last tick. */
typedef struct tl_test_run {
    tl_twin *twin;
    tl_budget budget;
    tl_sample sample; /* of the next tick; all of good quality at first */
    tl_record record;
    bool ready;
    tl_status status;
    tl_error error;
} tl_test_run;

/* Starts a run of a built twin, with a budget of 200 evaluations and without a clock. */
void tl_test_run_init(tl_test_run *run, tl_twin *twin);

/* Builds the twin, which must have no problem, and starts its run as above. */
void tl_test_run_build(tl_test_run *run, tl_test_plan *plan);

/* Destroys the twin, if there is one, and clears the logs of its FMUs. The test fails if an FMU
 * still has an instance or a state, or was called in a way that FMI forbids. */
void tl_test_run_end(tl_test_run *run, tl_test_plan *plan);

/* Executes one tick with the present sample. Then advances the sample's tick and stamps. */
void tl_test_run_step(tl_test_run *run);

/* Executes ticks, which must succeed, until one makes a record. The log then has the calls of that
 * tick only. */
const tl_record *tl_test_run_tick(tl_test_run *run, tl_test_log *log);

/* The same for a plan of tl_test_plan_single(), with these values of the plant's signals. */
const tl_record *tl_test_run_single(tl_test_run *run, tl_test_log *log, double cmd, double y0);

/* As tl_test_run_step(), but catches up a missed tick; or follows a tick of an earlier run with its
 * `u`. */
void tl_test_run_catch_up(tl_test_run *run);
void tl_test_run_follow(tl_test_run *run, const double *u);

#endif
