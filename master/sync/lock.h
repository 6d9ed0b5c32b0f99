/* One synchronised step: guess, search, commit (algorithm 3 of the thesis, with DESIGN.md's decisions).
 *
 * Purpose: finds the u of step i within a budget and commits the step with it; never worse than nominal, never later
 *          than the budget, never nothing.
 * Future:  state and sequence caches (master/cache/) will make restoring and executing cheaper, not different.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_LOCK_H
#define TL_MASTER_SYNC_LOCK_H

#include <stdbool.h>
#include <stdint.h>

#include "master/graph/exchange.h"
#include "master/sync/objective.h"
#include "master/sync/optimiser.h"
#include "master/sync/record.h"

/* One adjusted variable. */
typedef struct tl_adjusted {
    double *input;           /* where u is set */
    const double *delivered; /* û, where a connection delivers it; else NULL */
    double nominal;          /* û otherwise */
} tl_adjusted;

typedef struct tl_lock {
    tl_exchange *exchange;
    tl_objective objective;
    size_t count; /* adjusted variables; 0: runs free */
    tl_adjusted adjusted[TL_MAX_ADJUST];
    double step[TL_MAX_ADJUST];
    double lower[TL_MAX_ADJUST];
    double upper[TL_MAX_ADJUST];
    tl_optimiser_space space;
    const tl_optimiser_class *solver;
    tl_optimiser *optimiser;
    uint32_t distance;   /* T_D */
    uint32_t prediction; /* T_P */
    double margin;
    double last[TL_MAX_ADJUST]; /* committed last */
    bool has_last;
} tl_lock;

/* Creates the solver and takes what the lock needs; the fields above, but optimiser and space, are set. */
bool tl_lock_init(tl_lock *lock, tl_arena *arena);

void tl_lock_end(tl_lock *lock);

/* Finds and commits step i. Fills the record but y_hat and `used`. */
tl_status tl_lock_step(tl_lock *lock, int64_t step, const tl_budget *budget, tl_record *record, tl_error *error);

/* Commits step i with the last u, without a search. */
tl_status tl_lock_make_up(tl_lock *lock, int64_t step, tl_record *record, tl_error *error);

#endif
