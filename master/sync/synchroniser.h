/* Synchroniser: one synchronised step of guess, search and commit (algorithm 3 of the thesis, with
 *               the decisions in docs/decisions/README.md).
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
#ifndef TL_MASTER_SYNC_SYNCHRONISER_H
#define TL_MASTER_SYNC_SYNCHRONISER_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/plan/tuning.h"
#include "master/sync/record.h"
#include "master/sync/synchroniser_state.h"

/* Parts of a synchroniser beside those in the plan. Horizon, adjusted and penalties are copied; all
 * else must outlive it. */
typedef struct tl_synchroniser_settings {
    tl_exchange *exchange; /* initialised, with the adjusted inputs placed */
    tl_track *track;       /* NULL if nothing is adjusted */
    tl_horizon horizon;
    const tl_objective_term *terms; /* plan->match_count */
    tl_adjusted adjusted[TL_MAX_ADJUST];
    tl_objective_penalty penalties[TL_MAX_ADJUST];
    const tl_optimiser_class *solver;   /* NULL if nothing is adjusted */
    const tl_optimiser_class *fallback; /* NULL: none */
} tl_synchroniser_settings;

/* Creates the solvers and allocates all memory. Returns false if memory is out;
 * tl_synchroniser_end() must
 * be called in any case. */
bool tl_synchroniser_init(tl_synchroniser *synchroniser, tl_arena *arena, const tl_plan *plan,
                          const tl_synchroniser_settings *settings);

/* Frees the solvers. A zeroed object is allowed. */
void tl_synchroniser_end(tl_synchroniser *synchroniser);

/* Finds and commits step i. Fills the record except `measured` and `used`. */
tl_status tl_synchroniser_step(tl_synchroniser *synchroniser, int64_t step, const tl_budget *budget, tl_record *record,
                               tl_error *error);

/* Before step i: delivers the plant's sample of t_i, if the newest one stood in for it (mode ahead)
 *                in step i − 1. The next three functions do this themselves. */
void tl_synchroniser_refresh(tl_synchroniser *synchroniser, int64_t step);

/* Time that the step took, ns since the start of the budget. Called when the record is complete;
 * needs a clock. */
tl_time tl_synchroniser_end_step(tl_synchroniser *synchroniser, const tl_budget *budget);

/* Commits step i without a search, with nominal plus the Δu committed last. */
tl_status tl_synchroniser_catch_up(tl_synchroniser *synchroniser, int64_t step, tl_record *record, tl_error *error);

/* Commits step i without a search, with this u of an earlier run. */
tl_status tl_synchroniser_follow(tl_synchroniser *synchroniser, int64_t step, const double *u, tl_record *record,
                                 tl_error *error);

/* After a reset of all FMUs at the committed instant, with nominal u: drops what was learned of the
 * twin. Keeps the noise of the measurements and the durations. */
void tl_synchroniser_reset(tl_synchroniser *synchroniser);

/* The FMUs have another state at the committed instant: drops the extrapolation of the outputs. */
void tl_synchroniser_forget_course(tl_synchroniser *synchroniser);

/* Between steps: drops all that tl_synchroniser_archive() does not keep, except durations. */
void tl_synchroniser_forget(tl_synchroniser *synchroniser);

/* Applies a tuning from the next step on. The tuning is checked and fits, and its bounds are within
 * those of the FMUs. `terms` are those of the settings. All that was learned and committed stays.
 */
void tl_synchroniser_retune(tl_synchroniser *synchroniser, tl_objective_term *terms, const tl_tuning *tuning);

/* Archives what steps without a search need of earlier steps, and the noise of the measurements.
 * Solvers start empty. */
void tl_synchroniser_archive(tl_synchroniser *synchroniser, tl_archive *archive);

#endif
