/* State of the synchroniser from step to step.
 *
 * Purpose: shared by synchroniser.c, which decides what to try, and step_search.c, which tries it.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_SYNCHRONISER_STATE_H
#define TL_MASTER_SYNC_SYNCHRONISER_STATE_H

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

/* Durations of the parts of a step beside executions. Under a clock, each instant of a search
 * belongs to one of these or to an execution. */
typedef struct tl_synchroniser_times {
    tl_estimate guessing; /* the solver, before the first evaluation of a step */
    tl_estimate asking;   /* with saved sequences: from the request to the start of the candidate (ledger, rollback) */
    tl_estimate within;   /* an evaluation */
    tl_estimate thinking; /* from there to the next request: the solver; and the rollback if `asking` is not used */
    tl_estimate committing; /* from the last of these to the end of the step */
    tl_time beside;         /* ns of the current one so far */
    bool refused;           /* there was no time for a part of this step */
} tl_synchroniser_times;

/* Search range of one adjusted variable. */
typedef struct tl_adjusted {
    double step; /* first step of a search */
    double lower;
    double upper;
    uint32_t dwell;  /* Boolean: macro steps */
    bool is_boolean; /* else Real */
} tl_adjusted;

/* Buffers for sequences of unknowns and vectors of residuals. */
typedef struct tl_synchroniser_memory {
    double *committed; /* unknowns of the step committed last */
    double *nominal;   /* unknowns at nominal, except those in their dwell time */
    double *guess;
    double *start; /* of the search */
    double *best;
    double *trial;
    double *residuals;       /* of the candidate evaluated last */
    double *start_residuals; /* at start */
    double *best_residuals;
    double *forecast;
    double *noise;            /* as tl_objective_noise() */
    double *candidate_course; /* y of the matched outputs along the horizon, of the candidate evaluated last */
    double *best_course;      /* of the best candidate */
    double *course;           /* of the step committed last */
    double *earlier;          /* the sample before the last one of `course` */
    double *lower;            /* bounds of the unknowns */
    double *upper;
    double *factors;              /* of the residuals, for another tuning */
    bool *free;                   /* unknowns that a guess may move */
    double before[TL_MAX_ADJUST]; /* u of the step before, by variable; nominal if there was none */
} tl_synchroniser_memory;

typedef struct tl_synchroniser {
    tl_exchange *exchange;
    tl_track *track; /* simulates candidates; NULL if nothing is adjusted */
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
    tl_synchroniser_memory memory;
    double last_delta[TL_MAX_ADJUST]; /* u − û of the step committed last */
    bool has_last;                    /* a step was committed */
    int courses;                      /* steps in a row whose course is known: 0, 1, 2 or more */
    bool held_inputs;                 /* mode ahead: the newest sample stood in for the plant in the step before */
    bool runs_free;                   /* set by the owner: a component cannot be rolled back, so nothing is tried */
    bool rests;                       /* set by the owner: u rests at nominal, and nothing is tried */
    bool was_blind;                   /* no variable was identifiable in the step before */
    bool met;                         /* the solver was once allowed to search although all was within tolerance */
    tl_synchroniser_times times;
} tl_synchroniser;

#endif
