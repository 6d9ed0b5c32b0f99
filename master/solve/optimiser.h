/* Solver interface: a solver proposes points from a start point on, until the caller stops it or
 * until it finds no better point.
 *
 * Purpose: one interface for NLopt's solvers and our own. The caller evaluates J, keeps the best
 *          point and stops the solver if J is good enough or the budget is spent.
 * Add one: docs/add-a-solver.md.
 * Thread:  the twin's. Allocation: our code allocates nothing after create. NLopt allocates small
 *          blocks: a constant number per search (BOBYQA, L-BFGS), or at most about one per
 *          evaluation (Nelder-Mead, Sbplx).
 */
#ifndef TL_MASTER_SOLVE_OPTIMISER_H
#define TL_MASTER_SOLVE_OPTIMISER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"

/* If J is below this, the outputs count as within tolerance. */
#define TL_OBJECTIVE_TOLERANCE 1.0

/* Unknowns of a search. Static horizon: one per adjusted variable, constant over the horizon.
 * Dynamic: several per variable, ordered by variable, then by time (horizon.h). `step`, `lower`,
 * `upper` and `dwell` have `count` entries, `damped` has damping_count. Only bounds, residual_count
 * and the content of `damped` may change between searches (see `retune`). */
typedef struct tl_optimiser_space {
    size_t count;
    const double *step;    /* first step, > 0; 1 for a Boolean */
    const double *lower;   /* −infinity: none; 0 for a Boolean */
    const double *upper;   /* +infinity: none; 1 for a Boolean */
    const uint32_t *dwell; /* Boolean: macro steps for which a changed value stays, from the change on; else 0 */
    size_t residual_count; /* residuals of a search: of samples, damping and penalties, in this order (objective.h) */
    size_t residual_most;  /* largest possible residual_count */
    size_t sample_count;   /* residuals of samples */
    size_t damping_count;  /* residuals of damping: one per unknown, or 0 */
    const bool
        *damped; /* for each damping residual: true if it is part of J in this search; it is computed in any case */
    bool held;   /* u is constant over several samples: if a step keeps it, later steps reuse cached results */
} tl_optimiser_space;

/* One search. */
typedef struct tl_search {
    const double *start; /* within the bounds */
    double start_value;  /* J at the start, already known; finite or HUGE_VAL */
    /* Residuals at the start: J = Σ residuals² of those that belong to J. Undefined if start_value
     * is HUGE_VAL. Valid until the first evaluation. */
    const double *start_residuals;
    /* Evaluates J and the residuals at u. Returns false if the solver must stop now. *value is
     * finite or HUGE_VAL, never NaN: HUGE_VAL if u is not finite or outside the bounds. The
     * residuals are valid until the next evaluation, and undefined with HUGE_VAL. `residuals` may
     * be NULL. */
    bool (*evaluate)(void *context, const double *u, double *value, const double **residuals);
    void *context;
} tl_search;

/* Data for a first guess, before anything is evaluated. */
typedef struct tl_forecast {
    const double *u;         /* the unknowns as they continue from the step before; within the bounds */
    const double *residuals; /* residuals that are expected at u */
    const double *noise;     /* mean square that the measurement noise alone gives each residual */
    const bool *free; /* of each unknown: a guess may change it; others keep `u`, so that cached results are reused */
    const double *nominal; /* target if nothing needs a correction; may be outside the bounds */
} tl_forecast;

typedef enum tl_search_end {
    TL_SEARCH_STOPPED, /* by the caller */
    TL_SEARCH_DONE,    /* the solver found no better point */
    TL_SEARCH_FAILED   /* numerical failure of the solver */
} tl_search_end;

typedef struct tl_optimiser tl_optimiser;

typedef struct tl_optimiser_class {
    const char *name; /* as configured */
    int number;       /* number in the thesis (table 5.1): 1, 100, 1000; 0: none */
    bool booleans;    /* true: for Boolean unknowns only; false: for Real unknowns only */
    /* NULL if memory is out. `space` and what it points to must outlive the solver. */
    tl_optimiser *(*create)(tl_arena *arena, const tl_optimiser_space *space);
    /* Makes a first guess from a forecast and from earlier searches. Returns false if the solver
     * does not know enough for a guess yet. NULL: the solver never guesses. */
    bool (*guess)(tl_optimiser *optimiser, const tl_forecast *forecast, double *u);
    /* Undoes the last guess, because nothing was evaluated in its step. There must be a guess. NULL
     * if `guess` is NULL. */
    void (*retract)(tl_optimiser *optimiser);
    /* Searches until evaluate() returns false, or until the solver finds no better point. */
    tl_search_end (*minimise)(tl_optimiser *optimiser, const tl_search *search);
    /* True if the solver has no data for a guess yet. Then it may search once although all outputs
     * are within tolerance. NULL: the solver never guesses. */
    bool (*is_new)(const tl_optimiser *optimiser);
    /* Returns the slope: change of each residual if an unknown moves by its `step`, at [residual ·
     * count + unknown]. Returns NULL if it is not known for all unknowns. NULL: the solver stores
     * no slope. */
    const double *(*slope)(const tl_optimiser *optimiser);
    /* Sets unknowns within their dwell time to their committed values. NULL: there is no dwell
     * time. */
    void (*rest)(const tl_optimiser *optimiser, double *u);
    /* Reports each committed step with its unknowns. NULL: not needed. */
    void (*committed)(tl_optimiser *optimiser, const double *u);
    /* A tuning changes the residuals: scales remembered residual i by factors[i] (residual_most
     * entries). `space` has the new values already. NULL: the solver remembers no residuals. */
    void (*retune)(tl_optimiser *optimiser, const double *factors);
    /* Drops all data of earlier steps. NULL: the solver has none. */
    void (*forget)(tl_optimiser *optimiser);
    /* Frees what NLopt allocated; the solver's own memory is in the arena. */
    void (*destroy)(tl_optimiser *optimiser);
} tl_optimiser_class;

/* Finds a solver by name, or NULL. */
const tl_optimiser_class *tl_optimiser_find(const char *name);

/* Finds a solver by its number in the thesis, or NULL. */
const tl_optimiser_class *tl_optimiser_numbered(int number);

/* The names, comma separated and quoted, for messages. */
const char *tl_optimiser_names(void);

extern const tl_optimiser_class tl_secant;      /* secant.c: own solver, uses the residual vector */
extern const tl_optimiser_class tl_boolean;     /* boolean.c: tries the negation of each value */
extern const tl_optimiser_class tl_nelder_mead; /* this one and the following: nlopt_solver.c */
extern const tl_optimiser_class tl_bobyqa;
extern const tl_optimiser_class tl_lbfgs;
extern const tl_optimiser_class tl_sbplx;

#endif
