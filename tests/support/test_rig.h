/* A co-simulation of a test plan under its ledger, without a search: the test says which candidates there are.
 *
 * Purpose: what the twin does around an evaluation, laid open: candidates one by one, with what each component executed for
 *          it and what the ledger said of it.
 * Owner:   the caller places it (it is large: make it static); tl_test_rig_end() gives everything back.
 * Thread:  one at a time.
 */
#ifndef TL_TESTS_SUPPORT_TEST_RIG_H
#define TL_TESTS_SUPPORT_TEST_RIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/graph/track.h"
#include "master/sync/horizon.h"
#include "master/sync/ledger.h"
#include "tests/support/test_plan.h"

typedef struct tl_test_rig tl_test_rig;

struct tl_test_rig {
    tl_test_plan *plan;
    tl_arena arena;
    tl_graph graph;
    tl_exchange exchange;
    tl_track *track;
    tl_horizon horizon;
    tl_ledger ledger;
    const tl_port *adjusted[TL_MAX_ADJUST];
    const tl_port *matched[TL_MAX_MATCH];
    tl_sample sample; /* the one pushed last */
    int64_t step;     /* i */
    tl_status status; /* of the last candidate or commit */
    uint32_t walked;  /* whole steps of the last candidate */
    tl_error error;
    uint64_t
        before[TL_TEST_COMPONENTS + 1]; /* executions before the last candidate or commit, without those caught up */
    uint64_t foretold[TL_TEST_COMPONENTS + 1];       /* predicted before it */
    uint64_t all_before;                             /* executions of all components, those caught up too */
    bool begun;                                      /* there was a candidate since the last commit */
    void (*watch)(tl_test_rig *rig, uint32_t depth); /* called after each of a candidate's steps; NULL: nobody looks */
};

/* Graph and horizon only; what is wrong is in the plan's report. For a plan whose ports are all there. */
void tl_test_rig_plan(tl_test_rig *rig, tl_test_plan *plan);

/* Everything, initialised at t_0 with a sample of the plant of zeros. `nodes`: of each component's cache. */
void tl_test_rig_start(tl_test_rig *rig, tl_test_plan *plan, uint32_t nodes);

/* Frees all FMUs. Also after tl_test_rig_plan() only, or twice. */
void tl_test_rig_end(tl_test_rig *rig);

/* The next sample of the plant, all signals good. */
void tl_test_rig_push(tl_test_rig *rig, const double *values);

/* Walks one candidate over the horizon; a number that depends on all bits of the matched outputs from T_D on, 0 where it
 * fails. */
uint64_t tl_test_rig_try(tl_test_rig *rig, const double *u);

/* The same, left after so many steps. */
uint64_t tl_test_rig_walk(tl_test_rig *rig, const double *u, uint32_t steps);

/* Commits the step with the first of each variable's unknowns; the values of all ports as one number. */
uint64_t tl_test_rig_commit(tl_test_rig *rig, const double *u);

/* What component k, or the plant, executed in the last candidate or commit, catching up left out, and what was predicted. */
uint64_t tl_test_rig_done(const tl_test_rig *rig, size_t k);
uint64_t tl_test_rig_predicted(const tl_test_rig *rig, size_t k);

/* All that was executed by the last one, catching up included; without the plant. */
uint64_t tl_test_rig_executions(const tl_test_rig *rig);

#endif
