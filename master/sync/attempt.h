/* The evaluations of one step: candidates simulated, judged, counted, and kept within the budget.
 *
 * Purpose: what lock.c, which decides what to try, and the solvers, which propose, need of the simulation: J of a u. It
 *          keeps the best candidate, and knows when to stop.
 * Thread:  the twin's. Lives for one step.
 */
#ifndef TL_MASTER_SYNC_ATTEMPT_H
#define TL_MASTER_SYNC_ATTEMPT_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/status.h"
#include "master/sync/lock_state.h"
#include "master/sync/record.h"

/* In steps: a smaller move says nothing about identifiability. */
#define TL_TELLING_MOVE 0.05

typedef struct tl_attempt {
    tl_lock *lock;
    int64_t step;
    const tl_budget *budget;
    uint32_t limit;       /* evaluations that may be used */
    uint32_t evaluations; /* used so far */
    bool dirty;           /* values and states are not those of t_i */
    tl_status back;       /* how the way back to them went */
    bool walked;          /* a candidate was; what follows it is the solver's thinking */
    bool closing;         /* no question will follow the one at hand */
    bool guessed;         /* the solver was asked for a guess */
    bool late;            /* a candidate was left because time ran out */
    bool nominal_follows; /* after the candidate at hand: time is kept for it */
    tl_stop stop;
    uint32_t flags;     /* tl_flag */
    uint32_t held;      /* bit v: variable v is not identifiable */
    uint32_t seen;      /* bit v: variable v has moved an output */
    uint32_t idle;      /* evaluations since the last progress */
    bool stagnated;     /* idle for too long: the solver is told to stop */
    bool acquaints;     /* the solver may go on within tolerance until it can guess */
    double start_value; /* J where the search began */
    double best_value;
    double nominal_value;          /* NaN: not evaluated */
    double nominal[TL_MAX_ADJUST]; /* û */
    tl_status fatal;               /* TL_FMU_FATAL: give up */
    tl_error *error;
} tl_attempt;

/* At the committed instant t_step; reads û. */
void tl_attempt_begin(tl_attempt *attempt, tl_lock *lock, int64_t step, const tl_budget *budget, tl_error *error);

/* Sets the adjusted inputs to a candidate's values at a depth. */
void tl_attempt_set_inputs(const tl_lock *lock, const double *u, uint32_t depth);

/* Whether there is time to ask the solver for a guess; else sets `stop`. And: it has answered. */
bool tl_attempt_may_guess(tl_attempt *attempt);
void tl_attempt_has_guess(tl_attempt *attempt);

/* Whether an evaluation of u fits the budget, room for nominal's kept; else sets `stop`. */
bool tl_attempt_may_evaluate(tl_attempt *attempt, const double *u);

/* Back to the committed instant, where values and states are not those already. */
tl_status tl_attempt_go_back(tl_attempt *attempt);

/* J of u, which may be evaluated: HUGE_VAL where an FMU fails on it or time ran out. Its residuals are in the lock's memory. Keeps the best. */
double tl_attempt_evaluate(tl_attempt *attempt, const double *u);

/* A solver's question: see tl_search. The context is a tl_attempt. */
bool tl_attempt_ask(void *attempt, const double *u, double *value, const double **residuals);

/* All adjusted variables are held. */
bool tl_attempt_is_blind(const tl_attempt *attempt);

/* Puts held variables at nominal. */
void tl_attempt_hold(const tl_attempt *attempt, double *u);

#endif
