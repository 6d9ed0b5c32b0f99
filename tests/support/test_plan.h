/* A plan of a twin made of test FMUs, put together in a few lines, and one run of that twin.
 *
 * Purpose: tests of the master write what is special about their plan and nothing else. Each item gets the JSON path a
 *          configuration would give it as its `where`; what the build reports is collected.
 * Use:     tearDown() is tl_test_run_end(), and so is whatever a test begins anew after.
 * Owner:   the caller places a plan (it is large: make it static) and a run, both zero at first; names given must outlive
 *          them.
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
    tl_plan_signal signals[TL_MAX_SIGNALS + 1]; /* one too many is possible, here and below */
    tl_plan_connection connections[TL_TEST_CONNECTIONS];
    tl_plan_adjust adjust[TL_MAX_ADJUST + 1];
    tl_plan_match match[TL_MAX_MATCH + 1];
    char where[512][TL_TEST_WHERE];
    size_t where_count;
    tl_report report;
    tl_test_problem problems[TL_TEST_PROBLEMS];
} tl_test_plan;

/* An empty plan: Nelder-Mead, lag, no margin, T_P as short as possible. */
void tl_test_plan_init(tl_test_plan *plan, tl_time step);

/* Each adds an item and gives it back, so that the test can change more of it. */
tl_plan_component *tl_test_plan_component(tl_test_plan *plan, const char *name, tl_test_fmu *fmu);
tl_plan_signal *tl_test_plan_signal(tl_test_plan *plan, const char *name, tl_type type, const char *unit);
void tl_test_plan_connect(tl_test_plan *plan, const char *from, const char *to);
tl_plan_adjust *tl_test_plan_adjust(tl_test_plan *plan, const char *variable, double step);
tl_plan_match *tl_test_plan_match(tl_test_plan *plan, const char *variable, const char *to, double tolerance);

/* A value before initialisation for the component that was added last: a number, or any value. */
void tl_test_plan_set(tl_test_plan *plan, const char *variable, double value);
void tl_test_plan_set_value(tl_test_plan *plan, const char *variable, tl_value value);

/* tl_twin_build(), with its problems collected anew. */
tl_twin *tl_test_plan_build(tl_test_plan *plan);

/* The first problem whose text has `words` in it and whose `where` is equal; NULL where there is none. */
const tl_test_problem *tl_test_plan_problem(const tl_test_plan *plan, const char *where, const char *words);

/* "m", the FMU with one channel: u0 is the plant's cmd, y0 is to be the plant's y0 within 0.01. */
enum { TL_TEST_CMD, TL_TEST_Y0 }; /* its signals */
void tl_test_plan_single(tl_test_plan *plan, tl_test_fmu *fmu, tl_test_log *log);

/* A twin and all that is given to it and comes from it, tick by tick. */
typedef struct tl_test_run {
    tl_twin *twin;
    tl_budget budget;
    tl_sample sample; /* of the next tick; all of good quality at first */
    tl_record record;
    bool ready;
    tl_status status;
    tl_error error;
} tl_test_run;

/* For a twin that was built; a budget of 200 evaluations without a clock. */
void tl_test_run_init(tl_test_run *run, tl_twin *twin);

/* Builds the twin, which nothing is wrong with; else as above. */
void tl_test_run_build(tl_test_run *run, tl_test_plan *plan);

/* Destroys the twin, if there is one: its FMUs have nothing left then, were never called in a way that FMI forbids, and
 * their logs begin anew. */
void tl_test_run_end(tl_test_run *run, tl_test_plan *plan);

/* One tick with the sample as it stands; then the sample's tick and stamps move on. */
void tl_test_run_step(tl_test_run *run);

/* Ticks, which go well, until one has made a record; the log has that one's calls only. */
const tl_record *tl_test_run_tick(tl_test_run *run, tl_test_log *log);

/* The same of the plan with a single component, of a plant that stays at these values. */
const tl_record *tl_test_run_single(tl_test_run *run, tl_test_log *log, double cmd, double y0);

/* As tl_test_run_step(), for a tick that was missed; and for one of an earlier run. */
void tl_test_run_catch_up(tl_test_run *run);
void tl_test_run_follow(tl_test_run *run, const double *u);

#endif
