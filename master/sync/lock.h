/* One synchronised step: guess, search, commit (algorithm 3 of the thesis, with DESIGN.md's decisions).
 *
 * Purpose: finds the u of step i within a budget and commits the step with it; never worse than nominal, never later
 *          than the budget, never nothing.
 * Time:    what a candidate will cost is known before it is begun, from the executions the ledger expects, the time that
 *          executions have taken, and all that is done beside them; room is kept for the solver's thinking after it, for the
 *          committing step, and for nominal's evaluation where that is to come. A candidate that turns out slower is left between
 *          two macro steps. The clock is read once for each macro step, once or twice for each question, and a few times a step.
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

/* What a lock is made of, beside what the plan says. Horizon, adjusted and penalties are copied; all else must outlive it. */
typedef struct tl_lock_settings {
    tl_exchange *exchange; /* its values are placed, and the adjusted inputs are known to it */
    tl_track *track;       /* NULL where nothing is adjusted */
    tl_horizon horizon;
    const tl_objective_term *terms; /* plan->match_count */
    tl_adjusted adjusted[TL_MAX_ADJUST];
    tl_objective_penalty penalties[TL_MAX_ADJUST];
    const tl_optimiser_class *solver;   /* NULL where nothing is adjusted */
    const tl_optimiser_class *fallback; /* NULL: none */
} tl_lock_settings;

/* Creates the solvers and takes what the lock needs. False when memory is out; tl_lock_end() must be called all the same. */
bool tl_lock_init(tl_lock *lock, tl_arena *arena, const tl_plan *plan, const tl_lock_settings *settings);

/* A zeroed lock is allowed. */
void tl_lock_end(tl_lock *lock);

/* Finds and commits step i. Fills the record but y_hat and `used`. */
tl_status tl_lock_step(tl_lock *lock, int64_t step, const tl_budget *budget, tl_record *record, tl_error *error);

/* Before step i: what the plant feeds is that of t_i, also if it was stood for (mode ahead) when step i − 1 was computed. Done by each of the
 * next three itself. */
void tl_lock_refresh(tl_lock *lock, int64_t step);

/* The step's record is made: ns since the budget was begun. There must be a clock. */
tl_time tl_lock_end_step(tl_lock *lock, const tl_budget *budget);

/* Commits step i with nominal and the Δu committed last, without a search. */
tl_status tl_lock_make_up(tl_lock *lock, int64_t step, tl_record *record, tl_error *error);

/* Commits step i with this u, which an earlier run has committed, without a search. */
tl_status tl_lock_follow(tl_lock *lock, int64_t step, const double *u, tl_record *record, tl_error *error);

/* All FMUs have begun anew at the committed instant, with nominal u: what was learned of the twin is forgotten. What is known of the
 * measurements and of what things take stays. */
void tl_lock_begin_anew(tl_lock *lock);

/* The FMUs have come to another state at the committed instant: where the outputs seemed to go means nothing any more. */
void tl_lock_go_on_elsewhere(tl_lock *lock);

/* Between steps: what tl_lock_archive() does not keep is forgotten, but for what things take. */
void tl_lock_forget(tl_lock *lock);

/* From the next step on. The tuning was checked, and fits; its bounds are within those that the FMUs declare. `terms` are those of the settings.
 * What was learned of the twin, and what was committed, stays. */
void tl_lock_retune(tl_lock *lock, tl_objective_term *terms, const tl_tuning *tuning);

/* What a step without a search needs of the steps before it, and the noise of the measurements; solvers begin anew. */
void tl_lock_archive(tl_lock *lock, tl_archive *archive);

#endif
