/* What a lock is made of, and what it remembers from step to step.
 *
 * Purpose: lock.c, which decides what to try, and attempt.c, which tries it, work on the same state.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_LOCK_STATE_H
#define TL_MASTER_SYNC_LOCK_STATE_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/estimate.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/graph/exchange.h"
#include "master/graph/track.h"
#include "master/solve/optimiser.h"
#include "master/sync/horizon.h"
#include "master/sync/ledger.h"
#include "master/sync/objective.h"

/* What the parts of a step take beside executions. Under a clock, all of a search is one of these or an execution. */
typedef struct tl_lock_times {
    tl_estimate guessing; /* the solver, before a step's first question */
    tl_estimate asking;   /* by sequences: a question, up to where its candidate may begin: the ledger, the way back */
    tl_estimate within;   /* an evaluation */
    tl_estimate thinking; /* from there to the next question: the solver; and the way back, where nothing is asking */
    tl_estimate committing; /* from the last of these to the end of the step */
    tl_time beside;         /* ns of the one at hand, so far */
    bool refused;           /* there was no time for something in the step */
} tl_lock_times;

/* How one adjusted variable is searched. */
typedef struct tl_adjusted {
    double step; /* the first one of a search */
    double lower;
    double upper;
    uint32_t dwell;  /* Boolean: macro steps */
    bool is_boolean; /* else Real */
} tl_adjusted;

/* Places for sequences of unknowns and vectors of residuals, kept from step to step. */
typedef struct tl_lock_memory {
    double *committed; /* unknowns of the step committed last */
    double *nominal;   /* unknowns at nominal, but those that rest */
    double *guess;
    double *start; /* of the search */
    double *best;
    double *trial;
    double *residuals;       /* of the candidate evaluated last */
    double *start_residuals; /* at start */
    double *best_residuals;
    double *forecast;
    double *noise;            /* as tl_objective_noise() */
    double *candidate_course; /* y of the matched outputs along the horizon: of the candidate evaluated last, */
    double *best_course;      /* of the best, */
    double *course;           /* and of what was committed last */
    double *earlier;          /* the sample before the last one of `course` */
    double *lower;            /* bounds of the unknowns */
    double *upper;
    double *factors;              /* of the residuals, in another tuning */
    bool *free;                   /* unknowns that a guess may move */
    double before[TL_MAX_ADJUST]; /* u of the step before, by variable; nominal where there was none */
} tl_lock_memory;

typedef struct tl_lock {
    tl_exchange *exchange;
    tl_track *track; /* by which candidates are walked; NULL where nothing is adjusted */
    tl_objective objective;
    tl_horizon horizon;
    tl_ledger ledger;
    tl_adjusted adjusted[TL_MAX_ADJUST];
    tl_optimiser_space space;
    const tl_optimiser_class *solver;
    tl_optimiser *optimiser;
    const tl_optimiser_class *fallback; /* NULL: none */
    tl_optimiser *second;
    uint32_t stagnation;
    double margin;
    double noise_floor;
    tl_lock_memory memory;
    double last_delta[TL_MAX_ADJUST]; /* u − û as committed last */
    bool has_last;                    /* a step has been committed */
    int courses;                      /* committed one after the other whose course is known: 0, 1, 2 or more */
    bool held_inputs; /* mode ahead: what the plant feeds was stood for when the step before was computed */
    bool runs_free;   /* set by its user: a component cannot be led back, so nothing is tried */
    bool rests;       /* set by its user: u rests at nominal, and nothing is tried */
    bool was_blind;   /* nothing was identifiable in the step before */
    bool met;         /* the solver has been let search though all was within tolerance: once is enough */
    tl_lock_times times;
} tl_lock;

#endif
