/* Co-simulation of a test plan with its ledger, without a search. The test chooses the candidates.
 *
 * Purpose: evaluates single candidates, and counts the executions of each component, and those that
 *          the ledger predicted.
 * Owner:   the caller; it is large, so make it static. tl_test_rig_end() frees everything.
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
    tl_sample sample; /* the last one pushed */
    int64_t step;     /* i */
    tl_status status; /* of the last candidate or commit */
    uint32_t walked;  /* whole steps of the last candidate */
    tl_error error;
    uint64_t before[TL_TEST_COMPONENTS + 1];   /* executions before the last candidate or commit, without catching up */
    uint64_t foretold[TL_TEST_COMPONENTS + 1]; /* predicted executions before it */
    uint64_t all_before;                       /* executions of all components, with catching up */
    bool begun;                                /* there was a candidate since the last commit */
    void (*watch)(tl_test_rig *rig, uint32_t depth); /* called after each step of a candidate; may be NULL */
};

/* Builds graph and horizon only. Problems are in the plan's report. All ports must exist. */
void tl_test_rig_plan(tl_test_rig *rig, tl_test_plan *plan);

/* Builds everything, initialised at t_0 with a plant sample of zeros. `nodes`: cache size of each
 * component. */
void tl_test_rig_start(tl_test_rig *rig, tl_test_plan *plan, uint32_t nodes);

/* Frees all FMUs. May be called after tl_test_rig_plan(), and twice. */
void tl_test_rig_end(tl_test_rig *rig);

/* Pushes the next sample of the plant, with all signals good. */
void tl_test_rig_push(tl_test_rig *rig, const double *values);

/* Evaluates one candidate over the horizon. Returns a hash of the matched outputs from T_D on; 0 if
 * a step fails. */
uint64_t tl_test_rig_try(tl_test_rig *rig, const double *u);

/* As tl_test_rig_try(), but stops after `steps` steps. */
uint64_t tl_test_rig_walk(tl_test_rig *rig, const double *u, uint32_t steps);

/* Commits the step with the first unknown of each variable. Returns a hash of the values of all
 * ports. */
uint64_t tl_test_rig_commit(tl_test_rig *rig, const double *u);

/* Executions of component k (or of the plant, k = component count) in the last candidate or commit,
 * without catching up; and the predicted number. */
uint64_t tl_test_rig_done(const tl_test_rig *rig, size_t k);
uint64_t tl_test_rig_predicted(const tl_test_rig *rig, size_t k);

/* Executions of all components in it, with catching up, and without the plant. */
uint64_t tl_test_rig_executions(const tl_test_rig *rig);

#endif
