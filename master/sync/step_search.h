/* Step search: evaluates candidates of one step, keeps the best one, and stays within the budget.
 *
 * Purpose: computes J of a u for the synchroniser, which chooses the first candidates, and for the
 *          solvers, which propose further ones. Keeps the best candidate and decides when to stop.
 * Thread:  the twin's. One object per step.
 */
#ifndef TL_MASTER_SYNC_STEP_SEARCH_H
#define TL_MASTER_SYNC_STEP_SEARCH_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/status.h"
#include "master/sync/record.h"
#include "master/sync/synchroniser_state.h"

/* In multiples of a variable's `step`: a smaller move does not show whether it is identifiable. */
#define TL_SIGNIFICANT_MOVE 0.05

typedef struct tl_step_search {
    tl_synchroniser *synchroniser;
    int64_t step;
    const tl_budget *budget;
    uint32_t limit;       /* largest number of evaluations */
    uint32_t evaluations; /* done so far */
    bool dirty;           /* values and states are not those of the committed instant t_i, i = `step` */
    tl_status back;       /* result of the rollback to t_i */
    bool walked;          /* with a clock: an evaluation has ended; the time until the next one is the solver's */
    bool closing;         /* the current candidate is the last one: reserve no time for the solver */
    bool guessed;         /* the solver was asked for a guess */
    tl_time reserved;     /* predicted cost of executions after the current candidate, ns; see predict_costs() */
    bool late;            /* a candidate was aborted because time ran out */
    bool nominal_follows; /* nominal is evaluated after the current candidate: time is reserved for it */
    tl_stop stop;
    uint32_t flags;            /* tl_flag */
    uint32_t held;             /* bit v: variable v is not identifiable, and stays at nominal */
    uint32_t moved_output;     /* bit v: variable v has moved an output */
    bool has_finite;           /* J of some candidate was finite */
    tl_record_refused refused; /* candidates that could not be evaluated (record.h) */
    uint32_t idle;             /* candidates since J was last reduced by at least 1 % */
    bool stagnated;            /* no progress for too long: the solver is stopped */
    bool acquaints;            /* the search continues within tolerance until the solver has data for a guess */
    double start_value;        /* J at the start of the search */
    double best_value;
    double nominal_value;          /* NaN: not evaluated */
    double nominal[TL_MAX_ADJUST]; /* û */
    tl_status fatal;               /* TL_OK, or TL_FMU_FATAL: the twin ends */
    tl_error *error;
} tl_step_search;

/* Starts the search at the committed instant t_i, i = `step`, and reads û. `budget` and `error`
 * must stay valid until the search ends. `budget` NULL: a step without evaluations. */
void tl_step_search_begin(tl_step_search *search, tl_synchroniser *synchroniser, int64_t step, const tl_budget *budget,
                          tl_error *error);

/* Sets the adjusted inputs to the values of u for one macro step of the horizon. `depth`: index of
 * this step, 0 … T_P − 1. */
void tl_step_search_set_inputs(const tl_synchroniser *synchroniser, const double *u, uint32_t depth);

/* may_guess() returns true if there is time for a first guess of the solver; otherwise sets `stop`.
 * end_guess() measures the duration of the guess; call it after the guess. */
bool tl_step_search_may_guess(tl_step_search *search);
void tl_step_search_end_guess(tl_step_search *search);

/* Returns true if the budget allows an evaluation of u, then that of nominal (if it is not done
 * yet), and the committed step. Otherwise sets `stop`. */
bool tl_step_search_may_evaluate(tl_step_search *search, const double *u);

/* Rolls back to the committed instant, if values or states have changed. */
tl_status tl_step_search_go_back(tl_step_search *search);

/* Returns J of u: HUGE_VAL if an FMU fails, J is not finite, or time runs out. Writes the residuals
 * to the synchroniser's memory and keeps the best candidate. Call it only if
 * tl_step_search_may_evaluate() returned true. */
double tl_step_search_evaluate(tl_step_search *search, const double *u);

/* The callback `evaluate` of tl_search (optimiser.h): evaluates a solver's candidate. `search`: a
 * tl_step_search. Returns false if the solver must stop. */
bool tl_step_search_ask(void *search, const double *u, double *value, const double **residuals);

/* Returns true if no adjusted variable is identifiable. */
bool tl_step_search_is_blind(const tl_step_search *search);

/* Sets the unknowns of variables that are not identifiable to nominal, in place in `u`. */
void tl_step_search_hold(const tl_step_search *search, double *u);

#endif
