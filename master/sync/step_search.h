/* Step search: evaluates candidates of one step, keeps the best one, and stays within the budget.
 *
 * Purpose: gives J of a u to the synchroniser, which decides what to try, and to the solvers, which
 *          propose candidates. It keeps the best candidate and knows when to stop.
 * Thread:  the twin's. One object per step.
 */
#ifndef TL_MASTER_SYNC_STEP_SEARCH_H
#define TL_MASTER_SYNC_STEP_SEARCH_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/status.h"
#include "master/sync/record.h"
#include "master/sync/synchroniser_state.h"

/* In steps: a smaller move says nothing about identifiability. */
#define TL_SIGNIFICANT_MOVE 0.05

typedef struct tl_step_search {
    tl_synchroniser *synchroniser;
    int64_t step;
    const tl_budget *budget;
    uint32_t limit;       /* most evaluations */
    uint32_t evaluations; /* used so far */
    bool dirty;           /* values and states are not those of t_i */
    tl_status back;       /* result of the rollback to t_i */
    bool walked;          /* a candidate was simulated: time that follows is the solver's */
    bool closing;         /* the solver cannot ask again after the current candidate */
    bool guessed;         /* the solver was asked for a guess */
    bool late;            /* a candidate was aborted because time ran out */
    bool nominal_follows; /* nominal is evaluated after the current candidate: time is reserved for it */
    tl_stop stop;
    uint32_t flags; /* tl_flag */
    uint32_t held;  /* bit v: variable v is not identifiable */
    uint32_t seen;  /* bit v: variable v has moved an output */
    bool executed;  /* J of a candidate is finite */
    tl_record_refused refused;
    uint32_t idle;      /* evaluations since the last progress */
    bool stagnated;     /* no progress for too long: the solver is stopped */
    bool acquaints;     /* the solver may continue within tolerance until it can make a guess */
    double start_value; /* J at the start of the search */
    double best_value;
    double nominal_value;          /* NaN: not evaluated */
    double nominal[TL_MAX_ADJUST]; /* û */
    tl_status fatal;               /* TL_FMU_FATAL: the twin ends */
    tl_error *error;
} tl_step_search;

/* Starts the search at the committed instant t_step and reads û. */
void tl_step_search_begin(tl_step_search *search, tl_synchroniser *synchroniser, int64_t step, const tl_budget *budget,
                          tl_error *error);

/* Sets the adjusted inputs to a candidate's values at a depth. */
void tl_step_search_set_inputs(const tl_synchroniser *synchroniser, const double *u, uint32_t depth);

/* True if there is time to ask the solver for a guess; else sets `stop`. The second function is
 * called after the guess. */
bool tl_step_search_may_guess(tl_step_search *search);
void tl_step_search_has_guess(tl_step_search *search);

/* True if an evaluation of u fits the budget, with the evaluation of nominal still to come; else
 * sets `stop`. */
bool tl_step_search_may_evaluate(tl_step_search *search, const double *u);

/* Rolls back to the committed instant, if values or states have changed. */
tl_status tl_step_search_go_back(tl_step_search *search);

/* J of u. HUGE_VAL if an FMU fails at it or if time ran out. Leaves the residuals in the
 * synchroniser's memory and keeps the best candidate. Call only after
 * tl_step_search_may_evaluate(). */
double tl_step_search_evaluate(tl_step_search *search, const double *u);

/* Evaluates a solver's candidate (see tl_search). The context is a tl_step_search. */
bool tl_step_search_ask(void *search, const double *u, double *value, const double **residuals);

/* True if no adjusted variable is identifiable. */
bool tl_step_search_is_blind(const tl_step_search *search);

/* Sets variables that are not identifiable to nominal. */
void tl_step_search_hold(const tl_step_search *search, double *u);

#endif
