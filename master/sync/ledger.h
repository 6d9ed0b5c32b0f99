/* Execution ledger: predicts the number of executions from the graph, to check the number that was
 * done.
 *
 * Purpose: eq. 4.5 to 4.13 as accounting. The ledger knows paths, the u of every candidate and the
 *          sample numbers of the plant, but neither caches nor outputs. It predicts that component
 *          k executes horizon step j if j < Γ_k, and if no earlier candidate agrees in everything
 *          that can have reached k by then. The number done is the same for any FMU whose outputs
 *          tell different inputs apart; see docs/decisions/README.md, fewest executions.
 * Limits:  repeated executions of TL_KEEP_OUTPUTS and of a full cache are counted by the cache, not
 *          predicted here. A fixed pool holds the candidates; if it is too small, `incomplete` says
 *          that the prediction is too high.
 * Cost:    per candidate, linear in the nodes and in the remembered candidates: those of the step,
 *          and of up to T_P earlier steps. In the modes hold and ahead they stay until they end. In
 *          mode lag they are dropped once no later candidate can share more with them than with the
 *          steps committed since.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_LEDGER_H
#define TL_MASTER_SYNC_LEDGER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/simtime.h"
#include "master/graph/costs.h"
#include "master/graph/plant.h"
#include "master/plan/plan.h"
#include "master/sync/horizon.h"

/* One simulated candidate. */
typedef struct tl_ledger_entry {
    int64_t first;                  /* its first macro step */
    int64_t newest;                 /* the plant's newest sample at that time */
    uint32_t depth;                 /* macro steps it completed */
    size_t partial;                 /* components before this one executed one more step */
    int64_t compared;               /* last step that was compared with the committed steps */
    int64_t parted[TL_MAX_ADJUST];  /* first of these steps at which each variable differs */
    int64_t differs[TL_MAX_ADJUST]; /* scratch: first step at which each variable differs from the current candidate */
} tl_ledger_entry;

typedef struct tl_ledger {
    const tl_horizon *horizon;
    const tl_plant *plant;
    size_t signal_count;
    tl_plan_saving saving;
    bool ahead;   /* mode ahead: when step i is committed, the newest sample is that of tick i */
    int64_t step; /* i */
    size_t capacity;
    size_t oldest; /* ring of entries */
    size_t count;
    tl_ledger_entry *entries;
    double *sequences; /* by entry, depth, variable */
    double *committed; /* by step in a ring of T_P, then variable */
    double *current;   /* the current candidate: by depth, then variable */
    uint32_t *known;   /* its steps of each node that need no execution */
    int64_t *settled;  /* last step up to which each node agrees with candidates that the committed steps have left */
    int64_t *until;    /* scratch: last step up to which each node agrees with one earlier candidate */
    uint64_t *saved;   /* executions of each node that were not needed; the plant is the last */
    uint64_t saved_in_all; /* their sum */
    uint64_t plain;        /* executions of each node if nothing were saved */
    bool incomplete;
} tl_ledger;

/* `evaluations`: the most per step. Returns false if memory is out. */
bool tl_ledger_init(tl_ledger *ledger, tl_arena *arena, const tl_horizon *horizon, const tl_plant *plant,
                    const tl_plan *plan, uint32_t evaluations);

/* Finds what is known of a candidate that will start at the committed instant. `u`: its unknowns.
 */
void tl_ledger_expect(tl_ledger *ledger, const double *u);

/* Expected cost of the rest of the candidate from `depth` on, ns. `cost`: one execution of each
 * component. */
tl_time tl_ledger_cost(const tl_ledger *ledger, const tl_cost *cost, uint32_t depth);

/* Records that the candidate was simulated for `depth` whole steps. If a component failed in the
 * next step, `failed` is its index; else SIZE_MAX. */
void tl_ledger_walked(tl_ledger *ledger, uint32_t depth, size_t failed);

/* Records that step i was committed with these values of the adjusted variables. */
void tl_ledger_commit(tl_ledger *ledger, const double *values);

/* Records that all FMUs were reset at the committed instant: earlier executions say nothing about
 * later ones. */
void tl_ledger_reset(tl_ledger *ledger);

/* The same, and sets the counts of predicted executions to 0. */
void tl_ledger_forget(tl_ledger *ledger);

/* Predicted executions so far: of a node, and of all nodes. */
uint64_t tl_ledger_predicted(const tl_ledger *ledger, size_t node);
uint64_t tl_ledger_total(const tl_ledger *ledger);

#endif
