/* Synchroniser: one synchronised step of guess, search and commit (algorithm 3 of the thesis, with
 *               the decisions of DESIGN.md).
 *
 * Purpose: finds the u of step i within a budget and commits the step with it. The result is never
 *          worse than nominal, never later than the budget, and there always is one.
 * Time:    the cost of a candidate is predicted before it starts: from the executions in the
 *          ledger, their measured durations, and the overhead beside them. Time is reserved for the
 *          solver after it, for the committed step, and for the evaluation of nominal if that is
 *          still to come. A candidate that is slower than predicted is aborted between two macro
 *          steps. The clock is read once per macro step, once or twice per evaluation, and a few
 *          times per step.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_LOCK_H
#define TL_MASTER_SYNC_LOCK_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/plan/tuning.h"
#include "master/sync/lock_state.h"
#include "master/sync/record.h"

/* Parts of a synchroniser beside those in the plan. Horizon, adjusted and penalties are copied; all
 * else must outlive it. */
typedef struct tl_lock_settings {
    tl_exchange *exchange; /* initialised, with the adjusted inputs placed */
    tl_track *track;       /* NULL if nothing is adjusted */
    tl_horizon horizon;
    const tl_objective_term *terms; /* plan->match_count */
    tl_adjusted adjusted[TL_MAX_ADJUST];
    tl_objective_penalty penalties[TL_MAX_ADJUST];
    const tl_optimiser_class *solver;   /* NULL if nothing is adjusted */
    const tl_optimiser_class *fallback; /* NULL: none */
} tl_lock_settings;

/* Creates the solvers and allocates all memory. Returns false if memory is out; tl_lock_end() must
 * be called in any case. */
bool tl_lock_init(tl_lock *lock, tl_arena *arena, const tl_plan *plan, const tl_lock_settings *settings);

/* Frees the solvers. A zeroed object is allowed. */
void tl_lock_end(tl_lock *lock);

/* Finds and commits step i. Fills the record except y_hat and `used`. */
tl_status tl_lock_step(tl_lock *lock, int64_t step, const tl_budget *budget, tl_record *record, tl_error *error);

/* Before step i: delivers the plant's sample of t_i, if the newest one stood in for it (mode ahead)
 *                in step i − 1. The next three functions do this themselves. */
void tl_lock_refresh(tl_lock *lock, int64_t step);

/* Time that the step took, ns since the start of the budget. Called when the record is complete;
 * needs a clock. */
tl_time tl_lock_end_step(tl_lock *lock, const tl_budget *budget);

/* Commits step i without a search, with nominal plus the Δu committed last. */
tl_status tl_lock_make_up(tl_lock *lock, int64_t step, tl_record *record, tl_error *error);

/* Commits step i without a search, with this u of an earlier run. */
tl_status tl_lock_follow(tl_lock *lock, int64_t step, const double *u, tl_record *record, tl_error *error);

/* After a reset of all FMUs at the committed instant, with nominal u: drops what was learned of the
 * twin. Keeps the noise of the measurements and the durations. */
void tl_lock_begin_anew(tl_lock *lock);

/* The FMUs have another state at the committed instant: drops the extrapolation of the outputs. */
void tl_lock_go_on_elsewhere(tl_lock *lock);

/* Between steps: drops all that tl_lock_archive() does not keep, except durations. */
void tl_lock_forget(tl_lock *lock);

/* Applies a tuning from the next step on. The tuning is checked and fits, and its bounds are within
 * those of the FMUs. `terms` are those of the settings. All that was learned and committed stays.
 */
void tl_lock_retune(tl_lock *lock, tl_objective_term *terms, const tl_tuning *tuning);

/* Archives what steps without a search need of earlier steps, and the noise of the measurements.
 * Solvers start empty. */
void tl_lock_archive(tl_lock *lock, tl_archive *archive);

#endif
