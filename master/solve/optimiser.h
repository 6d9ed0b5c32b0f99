/* The contract of a solver: from a start point, ask for objective values until told to stop or nothing improves.
 *
 * Purpose: one small door for NLopt's solvers and our own. The asker keeps the best point, decides when J is good
 *          enough and when the budget is spent; a solver only proposes points.
 * Add one: a file with a tl_optimiser_class, and a line in optimiser.c.
 * Thread:  the twin's. Allocation: none of ours after create. NLopt takes and gives back small blocks: a constant number per
 *          search (BOBYQA, L-BFGS), or at most about one per question (Nelder-Mead, Sbplx).
 */
#ifndef TL_MASTER_SOLVE_OPTIMISER_H
#define TL_MASTER_SOLVE_OPTIMISER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"

/* J below this: every output is within its tolerance. */
#define TL_OBJECTIVE_TOLERANCE 1.0

/* The unknowns: for each adjusted variable one (static horizon) or several, one after the other in time (dynamic). All arrays have `count`
 * entries. Bounds and residual_count may be others from search to search (see `retune`); the rest is fixed for the life of a solver. */
typedef struct tl_optimiser_space {
    size_t count;
    const double *step;    /* first step, > 0; 1 for a Boolean */
    const double *lower;   /* −infinity: none; 0 for a Boolean */
    const double *upper;   /* +infinity: none; 1 for a Boolean */
    const uint32_t *dwell; /* Boolean: macro steps it stays after a change; else 0 */
    size_t residual_count; /* of a search: samples, what may be damped, then penalties */
    size_t residual_most;  /* that it will ever be */
    size_t sample_count;
    size_t damping_count;
    const bool
        *damped; /* of each of these: in this search it belongs to J; else it is as it would be, and counts nothing */
    bool held;   /* static over several samples: what is found will do for later steps too */
} tl_optimiser_space;

/* One search. */
typedef struct tl_search {
    const double *start; /* within the bounds */
    double start_value;  /* J at the start, already known; finite or HUGE_VAL */
    /* The residuals behind it: J = Σ residuals² of those that belong to J. Not meaningful where start_value is HUGE_VAL. Valid until the first
     * question. */
    const double *start_residuals;
    /* J at u and the residuals behind it (valid until the next question), or false: stop now. The value is finite or
     * HUGE_VAL, never NaN; at HUGE_VAL the residuals mean nothing. `residuals` may be NULL. A u that is not finite or
     * outside the bounds is answered with HUGE_VAL. */
    bool (*evaluate)(void *context, const double *u, double *value, const double **residuals);
    void *context;
} tl_search;

/* What a first guess can be made from, before anything is evaluated. */
typedef struct tl_forecast {
    const double *u;         /* the unknowns that go on from the step before; within the bounds */
    const double *residuals; /* expected at u */
    const double *noise;     /* what of their squares is noise of the measurements, on average */
    const bool *free;        /* those that may be guessed; the others stay, so that executions are not wasted */
    const double *nominal;   /* what to go back to where nothing needs correcting; may be outside the bounds */
} tl_forecast;

typedef enum tl_search_end {
    TL_SEARCH_STOPPED, /* by the asker */
    TL_SEARCH_DONE,    /* the solver finds nothing better */
    TL_SEARCH_FAILED   /* the solver gave up: a numerical failure of its own */
} tl_search_end;

typedef struct tl_optimiser tl_optimiser;

typedef struct tl_optimiser_class {
    const char *name; /* as configured */
    int number;       /* the thesis's (table 5.1): 1, 100, 1000; 0: it has none */
    bool booleans;    /* takes Boolean unknowns and no others; else Real ones and no others */
    /* NULL when memory is out. `space` and what it points to must outlive the solver. */
    tl_optimiser *(*create)(tl_arena *arena, const tl_optimiser_space *space);
    /* A first guess that is better than nominal, from a forecast and from what the solver remembers of earlier searches;
     * false: it has none yet. NULL: it never has. */
    bool (*guess)(tl_optimiser *optimiser, const tl_forecast *forecast, double *u);
    /* Takes the last guess back, because nothing was evaluated in its step: as if it had not been asked for. There must have been one.
     * NULL where `guess` is. */
    void (*retract)(tl_optimiser *optimiser);
    tl_search_end (*minimise)(tl_optimiser *optimiser, const tl_search *search);
    /* Has it nothing yet to make guesses from? Then it is let search once, though all is within tolerance, until it has.
     * NULL: it never guesses. */
    bool (*is_new)(const tl_optimiser *optimiser);
    /* Puts unknowns that must stay as they were committed last back to that. NULL: none must. */
    void (*rest)(const tl_optimiser *optimiser, double *u);
    /* Told of each commit, with the unknowns that were committed. NULL: of no interest. */
    void (*committed)(tl_optimiser *optimiser, const double *u);
    /* From now on residuals are in other units: residual i of the residual_most is factors[i] times what it was. `space` is what it is now.
     * NULL: it remembers nothing of them. */
    void (*retune)(tl_optimiser *optimiser, const double *factors);
    /* Forgets what it remembers of earlier steps: as it was created. NULL: it remembers nothing. */
    void (*forget)(tl_optimiser *optimiser);
    void (*destroy)(tl_optimiser *optimiser);
} tl_optimiser_class;

/* The solver of that name, or NULL. */
const tl_optimiser_class *tl_optimiser_find(const char *name);

/* The solver of that number of the thesis, or NULL. */
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
