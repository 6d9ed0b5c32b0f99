/* Synchroniser: one synchronised step of guess, search and commit (algorithm 3 of the thesis, with
 *               the decisions in docs/decisions/README.md).
 *
 * Purpose: finds the u of step i within a budget and commits the step with it. A step is always
 *          committed, unless an FMU fails with nominal u too. Its u is nominal if no candidate is
 *          better. The search is planned to end within the budget.
 * Time:    the cost of a candidate is predicted before it starts: from the executions that the
 *          graph demands, their measured durations, and their overhead. It is predicted again if a
 *          macro step takes far longer than predicted. Time is reserved for three things: for the
 *          solver after the candidate, for the committed step, and for the evaluation of nominal if
 *          it is not done yet. A candidate that is slower than predicted is aborted between two
 *          macro steps. The clock is read once per macro step, once per evaluation, and a few times
 *          per step.
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

/* Parts of a synchroniser that are not in the plan. `horizon`, `adjusted` and `penalties` are
 * copied. All other parts must outlive the synchroniser. */
typedef struct tl_synchroniser_settings {
    tl_exchange *exchange; /* initialised; tl_exchange_place_adjusted() was called for each adjusted variable */
    tl_track *track;       /* simulates candidates (track.h); NULL if nothing is adjusted */
    tl_horizon horizon;
    const tl_objective_term *terms; /* plan->match_count */
    tl_adjusted adjusted[TL_MAX_ADJUST];
    tl_objective_penalty penalties[TL_MAX_ADJUST];
    const tl_optimiser_class *solver;   /* NULL if nothing is adjusted */
    const tl_optimiser_class *fallback; /* NULL: none */
} tl_synchroniser_settings;

/* Creates the solvers and allocates all memory. Returns false if memory is out. Call
 * tl_synchroniser_end() in any case. */
bool tl_synchroniser_init(tl_synchroniser *synchroniser, tl_arena *arena, const tl_plan *plan,
                          const tl_synchroniser_settings *settings);

/* Frees the solvers. A zeroed object is allowed. */
void tl_synchroniser_end(tl_synchroniser *synchroniser);

/* Finds the u of step i and commits the step. Fills the record except `measured` and `used`. */
tl_status tl_synchroniser_step(tl_synchroniser *synchroniser, int64_t step, const tl_budget *budget, tl_record *record,
                               tl_error *error);

/* Mode ahead: step i − 1 ended before the sample of t_i existed, and used an older one. This call
 * sets the FMU inputs to the sample of t_i. Call it if other code uses the inputs between the two
 * steps; tl_synchroniser_step(), _catch_up() and _follow() call it first. Other modes: no effect.
 */
void tl_synchroniser_refresh(tl_synchroniser *synchroniser, int64_t step);

/* Call when the record of a step is complete, only with a clock. Returns the duration of the step,
 * ns since `started` of the budget. */
tl_time tl_synchroniser_end_step(tl_synchroniser *synchroniser, const tl_budget *budget);

/* Commits step i without a search, with nominal plus the Δu committed last. */
tl_status tl_synchroniser_catch_up(tl_synchroniser *synchroniser, int64_t step, tl_record *record, tl_error *error);

/* Commits step i without a search, with this u of an earlier run. */
tl_status tl_synchroniser_follow(tl_synchroniser *synchroniser, int64_t step, const double *u, tl_record *record,
                                 tl_error *error);

/* Call after a reset of all FMUs at the committed instant, with nominal u: drops what was learned
 * about the FMUs. Keeps the noise estimates of the measurements and the durations. */
void tl_synchroniser_reset(tl_synchroniser *synchroniser);

/* Call if the FMUs got another state at the committed instant: drops the extrapolation of the
 * outputs, and resets the execution ledger (ledger.h). */
void tl_synchroniser_forget_course(tl_synchroniser *synchroniser);

/* Between steps: keeps only durations and the data that tl_synchroniser_archive() saves. */
void tl_synchroniser_forget(tl_synchroniser *synchroniser);

/* Applies a tuning from the next step on. The tuning must have passed tl_tuning_check() and
 * tl_tuning_fits(), and its bounds must be within those of the FMUs. `terms`: as in the settings;
 * they are changed. Keeps all learned and committed data. */
void tl_synchroniser_retune(tl_synchroniser *synchroniser, tl_objective_term *terms, const tl_tuning *tuning);

/* Saves or loads the data of earlier steps that a step without a search needs, and the noise
 * estimates. After loading, the solvers have no learned data. */
void tl_synchroniser_archive(tl_synchroniser *synchroniser, tl_archive *archive);

#endif
