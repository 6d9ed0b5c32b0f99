/* Execution ledger: predicts the number of executions from the graph, so that the counted number
 * can be checked.
 *
 * Purpose: counts executions by eq. 4.5 to 4.13. The ledger knows paths, the u of every candidate
 *          and the ticks of the plant's samples, but neither caches nor outputs. It predicts that
 *          component k executes horizon step j if j < Γ_k. Exception: an earlier candidate had the
 *          same values in every u and sample that can have reached k by then, and k keeps its
 *          results (not TL_KEEP_NONE). The counted number is the same if different inputs always
 *          give different outputs; see docs/decisions/013-fewest-executions.md.
 * When:    a search only records its candidates. They are compared when the step is committed and
 *          its duration is measured, so the prediction takes no time of the search.
 * Limits:  the cache counts repeated executions (TL_KEEP_OUTPUTS, or a full cache); the ledger does
 *          not predict them. The candidates are in a ring of fixed size. If it is too small,
 *          `incomplete` is true, and the prediction is too high.
 * Cost:    per candidate, linear in the nodes and in the remembered candidates: those of the step,
 *          and of up to T_P earlier steps. Of an earlier step only candidates remain that differ
 *          from each other in later steps. In the modes hold and ahead, a candidate is remembered
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
#include "master/graph/plant.h"
#include "master/plan/plan.h"
#include "master/sync/horizon.h"

/* One simulated candidate. */
typedef struct tl_ledger_entry {
    int64_t first;  /* its first macro step */
    int64_t newest; /* tick of the plant's newest sample at that time */
    uint32_t depth; /* macro steps it completed */
    size_t failed;  /* component that failed in the next step, which earlier ones executed; SIZE_MAX: none */
    int64_t parted[TL_MAX_ADJUST]; /* first committed step with another u than the candidate; INT64_MAX/2: none yet */
} tl_ledger_entry;

/* Samples now, compared with those that a candidate used. */
typedef struct tl_ledger_samples {
    int64_t step, present, first, newest; /* `differs` is valid for this step, newest sample, and candidate's fields */
    int64_t *differs; /* first step with another value, of each signal; last: first step with another tick's sample */
} tl_ledger_samples;

/* Per node: the first step whose execution is not known yet. */
typedef struct tl_ledger_known {
    int64_t step, present; /* `any` is valid for this step and newest sample */
    int64_t *any;          /* by any candidate */
    int64_t *candidate;    /* by the candidate compared last */
} tl_ledger_known;

typedef struct tl_ledger {
    const tl_horizon *horizon;
    const tl_plant *plant;
    size_t signal_count;
    tl_plan_saving saving;
    bool ahead;   /* mode ahead: when step i is committed, the newest sample is that of tick i */
    int64_t step; /* i: the step to be committed next */
    size_t capacity;
    size_t oldest;    /* index of the oldest entry in the ring `entries` */
    size_t count;     /* number of used entries */
    size_t evaluated; /* entries that were compared and counted; the others are compared after the next commit */
    tl_ledger_entry *entries;
    double *unknowns;                /* by entry */
    double committed[TL_MAX_ADJUST]; /* u of the committed step that was not counted yet */
    bool has_committed;              /* `committed` is valid */
    bool *executes;                  /* of each node: it executes all steps (TL_KEEP_NONE) */
    tl_ledger_known known;
    tl_ledger_samples samples;
    int64_t *settled;      /* of each node: its steps before this one are known from dropped candidates */
    int64_t *until;        /* scratch, of each node: its steps before this one are known from one candidate */
    uint64_t *saved;       /* executions of each node that were not needed; the plant is the last */
    uint64_t saved_in_all; /* their sum */
    uint64_t plain;        /* executions of each node if nothing were saved */
    uint64_t total;        /* predicted executions at the last evaluation */
    bool incomplete;       /* the ring was too small: the prediction is too high */
} tl_ledger;

/* `evaluations`: largest number per step. Returns false if memory is out. */
bool tl_ledger_init(tl_ledger *ledger, tl_arena *arena, const tl_horizon *horizon, const tl_plant *plant,
                    const tl_plan *plan, uint32_t evaluations);

/* Call before the first candidate: no component keeps results, so no candidate is remembered. */
void tl_ledger_drop_candidates(tl_ledger *ledger);

/* Records that the candidate with unknowns `u` was simulated for `depth` whole steps. If a
 * component failed in the next step, `failed` is its index; else SIZE_MAX. `u` may be NULL if
 * saving.sequences is off. */
void tl_ledger_walked(tl_ledger *ledger, const double *u, uint32_t depth, size_t failed);

/* Records that step i was committed with these values of the adjusted variables. */
void tl_ledger_commit(tl_ledger *ledger, const double *values);

/* Predicts the executions of all recorded candidates, and of the committed step if there is one.
 * Call it after each commit, before the plant gets another sample. Returns the number of executions
 * predicted since the last call. */
uint64_t tl_ledger_evaluate(tl_ledger *ledger);

/* Records that all FMUs were reset at the committed instant, so that later steps reuse no earlier
 * executions. */
void tl_ledger_reset(tl_ledger *ledger);

/* As tl_ledger_reset(); also sets the counts of predicted executions to 0. */
void tl_ledger_forget(tl_ledger *ledger);

/* Return the predicted executions at the last evaluation: of one node, and of all nodes. */
uint64_t tl_ledger_predicted(const tl_ledger *ledger, size_t node);
uint64_t tl_ledger_total(const tl_ledger *ledger);

#endif
