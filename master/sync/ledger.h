/* Execution ledger: predicts the number of executions from the graph, so that the counted number
 * can be checked.
 *
 * Purpose: counts executions by eq. 4.5 to 4.13. The ledger knows paths, the u of every candidate
 *          and the ticks of the plant's samples, but neither caches nor outputs. It predicts that
 *          component k executes horizon step j if j < Γ_k. Exception: an earlier candidate had the
 *          same values in every u and sample that can have reached k by then, and k keeps its
 *          results (not TL_KEEP_NONE). The counted number is
 *          the same if different inputs always give different outputs; see
 *          docs/decisions/README.md, fewest executions.
 * Limits:  the cache counts repeated executions (TL_KEEP_OUTPUTS, or a full cache); the ledger does
 *          not predict them. The candidates are in a ring of fixed size. If it is too small,
 *          `incomplete` is true, and the prediction is too high.
 * Cost:    per candidate, linear in the nodes and in the remembered candidates: those of the step,
 *          and of up to T_P earlier steps. In the modes hold and ahead, a candidate is remembered
 *          until the end of its horizon is committed. In mode lag it is dropped earlier: when no
 *          later candidate can share more steps with it than with the committed steps.
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
    int64_t newest;                 /* tick of the plant's newest sample at that time */
    uint32_t depth;                 /* macro steps it completed */
    size_t partial;                 /* if it failed: components before this index executed one more step */
    int64_t compared;               /* steps before this one were compared with the committed steps */
    int64_t parted[TL_MAX_ADJUST];  /* first of these steps at which each variable differs; INT64_MAX/2: none */
    int64_t differs[TL_MAX_ADJUST]; /* scratch: first step at which each variable differs from the current candidate */
} tl_ledger_entry;

typedef struct tl_ledger {
    const tl_horizon *horizon;
    const tl_plant *plant;
    size_t signal_count;
    tl_plan_saving saving;
    bool ahead;   /* mode ahead: when step i is committed, the newest sample is that of tick i */
    int64_t step; /* i: the step to be committed next */
    size_t capacity;
    size_t oldest; /* index of the oldest entry in the ring `entries` */
    size_t count;  /* used entries */
    tl_ledger_entry *entries;
    double *sequences;     /* by entry, depth, variable */
    double *committed;     /* by step in a ring of T_P, then variable */
    double *current;       /* the current candidate: by depth, then variable */
    bool *executes;        /* of each node: it executes all steps (TL_KEEP_NONE) */
    uint32_t *known;       /* of each node: number of the candidate's first steps that need no execution */
    int64_t *settled;      /* of each node: its steps before this one are known from dropped candidates */
    int64_t *until;        /* scratch, of each node: its steps before this one are known from one candidate */
    uint64_t *saved;       /* executions of each node that were not needed; the plant is the last */
    uint64_t saved_in_all; /* their sum */
    uint64_t plain;        /* executions of each node if nothing were saved */
    bool incomplete;       /* the ring was too small: the prediction is too high */
} tl_ledger;

/* `evaluations`: largest number per step. Returns false if memory is out. */
bool tl_ledger_init(tl_ledger *ledger, tl_arena *arena, const tl_horizon *horizon, const tl_plant *plant,
                    const tl_plan *plan, uint32_t evaluations);

/* Call before the first candidate: no component keeps results, so no candidate is remembered. */
void tl_ledger_drop_candidates(tl_ledger *ledger);

/* Call before a candidate starts at the committed instant: finds its steps that need no execution.
 * `u`: its unknowns. */
void tl_ledger_expect(tl_ledger *ledger, const double *u);

/* Returns the expected cost of the candidate's steps from `depth` on, ns. `cost`: cost of one
 * execution of each component. */
tl_time tl_ledger_cost(const tl_ledger *ledger, const tl_cost *cost, uint32_t depth);

/* Records that the candidate was simulated for `depth` whole steps. If a component failed in the
 * next step, `failed` is its index; else SIZE_MAX. */
void tl_ledger_walked(tl_ledger *ledger, uint32_t depth, size_t failed);

/* Records that step i was committed with these values of the adjusted variables. */
void tl_ledger_commit(tl_ledger *ledger, const double *values);

/* Records that all FMUs were reset at the committed instant: earlier executions say nothing about
 * later ones. */
void tl_ledger_reset(tl_ledger *ledger);

/* As tl_ledger_reset(); also sets the counts of predicted executions to 0. */
void tl_ledger_forget(tl_ledger *ledger);

/* Return the predicted executions so far: of one node, and of all nodes. */
uint64_t tl_ledger_predicted(const tl_ledger *ledger, size_t node);
uint64_t tl_ledger_total(const tl_ledger *ledger);

#endif
