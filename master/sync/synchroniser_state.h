/* State of the synchroniser from step to step.
 *
 * Purpose: shared by synchroniser.c, which chooses candidates, and step_search.c, which evaluates
 *          them.
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
#include "master/sync/sensitivity.h"

/* Expected durations of the parts of a step beside executions, ns, if there is a clock. Before the
 * first evaluation, time that is not `guessing` is in no part. */
typedef struct tl_synchroniser_times {
    tl_estimate guessing;   /* the solver's guess, before the first evaluation of a step */
    tl_estimate within;     /* an evaluation, without its executions */
    tl_estimate thinking;   /* the solver and the rollback, from an evaluation to the start of the next one */
    tl_estimate committing; /* from the last evaluation to the end of the step, without executions */
    tl_time beside;         /* ns: duration of the current part so far, without executions */
    bool refused;           /* there was no time for a part of this step */
} tl_synchroniser_times;

/* Search range of one adjusted variable. */
typedef struct tl_adjusted {
    double step; /* first step of a search, > 0, in the variable's unit like the bounds */
    double lower;
    double upper;
    double approved; /* u − û that released twins get; Boolean: 0 */
    uint32_t dwell;  /* Boolean: macro steps for which a changed value stays; else 0 */
    bool is_boolean; /* else Real */
} tl_adjusted;

/* Buffers for sequences of unknowns and vectors of residuals. */
typedef struct tl_synchroniser_memory {
    double *committed; /* unknowns of the step committed last */
    double *nominal;   /* unknowns at nominal, except those in their dwell time */
    double *guess;
    double *start;            /* start point of the solver */
    double *best;             /* best candidate so far */
    double *evaluated_u;      /* the solver's point as it is evaluated: see evaluated_point() in step_search.c */
    double *residuals;        /* of the candidate evaluated last */
    double *start_residuals;  /* at `start` */
    double *best_residuals;   /* at `best` */
    double *forecast;         /* residuals expected if u continues from the step before */
    double *noise;            /* see tl_objective_noise() */
    double *candidate_course; /* y of the matched outputs along the horizon, of the candidate evaluated last */
    double *best_course;      /* the same of the best candidate */
    double *course;           /* the same of the step committed last */
    double *earlier;          /* y of the matched outputs, one sample before the last one of `course` */
    double *lower;            /* bounds of the unknowns */
    double *upper;
    double *factors;              /* scale factors of the residuals after a change of the tuning */
    bool *free;                   /* unknowns that a guess may change */
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
    tl_sensitivity sensitivity; /* not of a Boolean variable, and then zeroed */
    const tl_optimiser_class *solver;
    tl_optimiser *optimiser;
    const tl_optimiser_class *fallback; /* NULL: none */
    tl_optimiser *second;               /* the solver of `fallback` */
    uint32_t stagnation;                /* stagnation, margin and noise_floor: see plan.h */
    double margin;
    double noise_floor;
    tl_synchroniser_memory memory;
    double last_delta[TL_MAX_ADJUST]; /* u − û of the step committed last */
    bool has_last;                    /* a step was committed */
    int courses;                      /* number of steps in a row whose `course` is known: 0, 1, or 2 for more */
    bool uses_newest_sample;          /* mode ahead: each step uses the newest sample in place of a later one */
    bool runs_free;                   /* set by the owner: a component cannot be rolled back, so nothing is evaluated */
    bool rests;                       /* set by the owner: u rests at nominal; only nominal is evaluated */
    bool was_blind;                   /* no variable was identifiable in the step before */
    bool has_taught_solver; /* the solver has made its one search within tolerance, which gives it data for guesses */
    tl_synchroniser_times times;
    tl_time *rest; /* predicted cost of a candidate's macro steps from each depth on, ns: T_P + 1 values */
} tl_synchroniser;

#endif
