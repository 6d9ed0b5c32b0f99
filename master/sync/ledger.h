/* The ledger: how many executions the graph predicts, against which those that were done can be held.
 *
 * Purpose: eq. 4.5 to 4.13 as accounting. It knows paths, the u of every candidate and the numbers of the plant's samples, but
 *          neither caches nor outputs: what it says of component k is that an execution at horizon step j is needed where
 *          j < Γ_k and no earlier candidate agrees in everything that can have reached k by then. Executions done are
 *          the same number, for any FMU whose outputs tell different inputs apart; see DESIGN.md, "Fewest executions".
 * Limits:  a catching-up of TL_KEEP_OUTPUTS and what a full cache repeats are counted by the cache, not predicted here.
 *          Candidates are remembered in a fixed pool; where it is too small, `incomplete` says that the prediction is
 *          too high.
 * Cost:    per candidate, linear in the nodes, and in the candidates that are remembered: those of the step, and of up to T_P
 *          earlier ones. Where the newest sample stands for later ones (hold, ahead) they all stay until they end; otherwise
 *          they go as soon as no later candidate can share more with them than what was committed since does.
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

/* One candidate that was walked. */
typedef struct tl_ledger_entry {
    int64_t first;                  /* macro step it began with */
    int64_t newest;                 /* sample that was the plant's newest then */
    uint32_t depth;                 /* macro steps it completed */
    size_t partial;                 /* components before this one took one more */
    int64_t compared;               /* step up to which it has been held against what was committed, */
    int64_t parted[TL_MAX_ADJUST];  /* and the first one of these at which each variable differs */
    int64_t differs[TL_MAX_ADJUST]; /* scratch: first step at which each variable differs from the candidate at hand */
} tl_ledger_entry;

typedef struct tl_ledger {
    const tl_horizon *horizon;
    const tl_plant *plant;
    size_t signal_count;
    tl_plan_saving saving;
    bool ahead;   /* mode: when step i is committed, the newest sample is that of tick i */
    int64_t step; /* i */
    size_t capacity;
    size_t oldest; /* ring of entries */
    size_t count;
    tl_ledger_entry *entries;
    double *sequences; /* by entry, then depth, then variable */
    double *committed; /* by step in a ring of T_P, then variable */
    double *current;   /* the candidate at hand: by depth, then variable */
    uint32_t *known;   /* of it: steps of each node that need no execution */
    int64_t *settled;  /* up to which step each node agrees with candidates that what was committed since has left */
    int64_t *until;    /* scratch: up to which step each node agrees with one earlier candidate */
    uint64_t *saved;   /* executions of each node that are not needed; the plant last */
    uint64_t saved_in_all; /* their sum */
    uint64_t plain;        /* executions of each node, if nothing were saved */
    bool incomplete;
} tl_ledger;

/* `evaluations`: the most there are in a step. False when memory is out. */
bool tl_ledger_init(tl_ledger *ledger, tl_arena *arena, const tl_horizon *horizon, const tl_plant *plant,
                    const tl_plan *plan, uint32_t evaluations);

/* A candidate is about to be walked from the committed instant: finds what is known of it. `u` are the unknowns. */
void tl_ledger_expect(tl_ledger *ledger, const double *u);

/* Expected cost of the candidate from `depth` on, ns, from that of one execution of each component. */
tl_time tl_ledger_cost(const tl_ledger *ledger, const tl_cost *cost, uint32_t depth);

/* The candidate has been walked for `depth` whole steps, and where one failed in the next step, up to that component;
 * SIZE_MAX: none did. */
void tl_ledger_walked(tl_ledger *ledger, uint32_t depth, size_t failed);

/* Step i is committed with these values of the adjusted variables. */
void tl_ledger_commit(tl_ledger *ledger, const double *values);

/* All FMUs have begun anew at the committed instant: nothing that was executed before is known of what comes. */
void tl_ledger_begin_anew(tl_ledger *ledger);

/* The same, and what was predicted counts from 0. */
void tl_ledger_forget(tl_ledger *ledger);

/* Executions of a node that the graph predicts so far, and of all. */
uint64_t tl_ledger_predicted(const tl_ledger *ledger, size_t node);
uint64_t tl_ledger_total(const tl_ledger *ledger);

#endif
