/* Solver interface: from a start point, evaluate J until told to stop or until nothing improves.
 *
 * Purpose: one interface for NLopt's solvers and our own. The caller keeps the best point and
 *          decides when J is good enough and when the budget is spent; a solver only proposes
 *          points.
 * Add one: a file with a tl_optimiser_class, and a line in optimiser.c.
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

/* J below this: every output is within its tolerance. */
#define TL_OBJECTIVE_TOLERANCE 1.0

/* Unknowns: per adjusted variable one (static horizon) or several in order of time (dynamic). All
 *           arrays have `count` entries. Bounds and residual_count may change between searches (see
 *           `retune`); the rest is fixed. */
typedef struct tl_optimiser_space {
    size_t count;
    const double *step;    /* first step, > 0; 1 for a Boolean */
    const double *lower;   /* −infinity: none; 0 for a Boolean */
    const double *upper;   /* +infinity: none; 1 for a Boolean */
    const uint32_t *dwell; /* Boolean: macro steps without change after a change; else 0 */
    size_t residual_count; /* of a search: samples, damping, penalties */
    size_t residual_most;  /* largest residual_count */
    size_t sample_count;
    size_t damping_count;
    const bool
        *damped; /* of each damping residual: it belongs to J in this search; else it is computed and not counted */
    bool held;   /* static horizon over several samples: the result will be used in later steps too */
} tl_optimiser_space;

/* One search. */
typedef struct tl_search {
    const double *start; /* within the bounds */
    double start_value;  /* J at the start, already known; finite or HUGE_VAL */
    /* Residuals at the start: J = Σ residuals² of those that belong to J. Undefined if start_value
     * is HUGE_VAL. Valid until the first evaluation. */
    const double *start_residuals;
    /* Evaluates J and residuals at u (valid until the next evaluation), or returns false: stop now.
     * The value is finite or HUGE_VAL, never NaN; with HUGE_VAL the residuals are undefined.
     * `residuals` may be NULL. A u that is not finite or outside the bounds gives HUGE_VAL. */
    bool (*evaluate)(void *context, const double *u, double *value, const double **residuals);
    void *context;
} tl_search;

/* Data for a first guess, before anything is evaluated. */
typedef struct tl_forecast {
    const double *u;         /* the unknowns that continue from the step before; within the bounds */
    const double *residuals; /* expected at u */
    const double *noise;     /* mean noise of the measurements in their squares */
    const bool *free;        /* those that may be guessed; the others stay, so that their executions are reused */
    const double *nominal;   /* target if nothing needs a correction; may be outside the bounds */
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
    bool booleans;    /* takes only Boolean unknowns; else only Real ones */
    /* NULL if memory is out. `space` and what it points to must outlive the solver. */
    tl_optimiser *(*create)(tl_arena *arena, const tl_optimiser_space *space);
    /* Makes a first guess that is better than nominal, from a forecast and from earlier searches.
     * Returns false if it cannot yet. NULL: it never can. */
    bool (*guess)(tl_optimiser *optimiser, const tl_forecast *forecast, double *u);
    /* Undoes the last guess, of which there must be one, because nothing was evaluated in its step.
     * NULL if `guess` is NULL. */
    void (*retract)(tl_optimiser *optimiser);
    tl_search_end (*minimise)(tl_optimiser *optimiser, const tl_search *search);
    /* True if it has no data for a guess yet. Then it may search once although all is within
     * tolerance. NULL: it never guesses. */
    bool (*is_new)(const tl_optimiser *optimiser);
    /* Sets unknowns that must not change yet to their committed values. NULL: none must. */
    void (*rest)(const tl_optimiser *optimiser, double *u);
    /* Reports each committed step with its unknowns. NULL: not needed. */
    void (*committed)(tl_optimiser *optimiser, const double *u);
    /* From now on residual i, of residual_most, is factors[i] times what it was. `space` is up to
     * date. NULL: it remembers no residuals. */
    void (*retune)(tl_optimiser *optimiser, const double *factors);
    /* Drops all that it remembers of earlier steps. NULL: it remembers nothing. */
    void (*forget)(tl_optimiser *optimiser);
    void (*destroy)(tl_optimiser *optimiser);
} tl_optimiser_class;

/* Finds a solver by name, or NULL. */
const tl_optimiser_class *tl_optimiser_find(const char *name);

/* Finds a solver by its number in the thesis, or NULL. */
const tl_optimiser_class *tl_optimiser_numbered(int number);

/* The names, comma separated and quoted, for messages. */
const char *tl_optimiser_names(void);

extern const tl_optimiser_class tl_secant;      /* secant.c: ours, on the residual vector */
extern const tl_optimiser_class tl_boolean;     /* boolean.c: the better of value and negation */
extern const tl_optimiser_class tl_nelder_mead; /* nlopt_solver.c, this one and the following */
extern const tl_optimiser_class tl_bobyqa;
extern const tl_optimiser_class tl_lbfgs;
extern const tl_optimiser_class tl_sbplx;

#endif
