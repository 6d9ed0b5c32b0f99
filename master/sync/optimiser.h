/* The contract of a solver: from a start point, ask for objective values until told to stop or nothing improves.
 *
 * Purpose: one small door for NLopt's solvers and our own. The asker keeps the best point, decides when J is good
 *          enough and when the budget is spent; a solver only proposes points.
 * Add one: a file with a tl_optimiser_class, and a line in optimiser.c.
 * Thread:  the twin's. Allocation: none of ours after create; NLopt's Nelder-Mead takes and gives back a constant number
 *          of blocks per search.
 */
#ifndef TL_MASTER_SYNC_OPTIMISER_H
#define TL_MASTER_SYNC_OPTIMISER_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/arena.h"

/* The variables, fixed for the life of a solver. */
typedef struct tl_optimiser_space {
    size_t count;
    const double *step;  /* first step, > 0 */
    const double *lower; /* −infinity: none */
    const double *upper; /* +infinity: none */
} tl_optimiser_space;

/* One search. */
typedef struct tl_search {
    const double *start; /* within the bounds */
    double start_value;  /* J at the start, already known */
    /* J at u, or false: stop now. The value is finite or HUGE_VAL, never NaN. */
    bool (*evaluate)(void *context, const double *u, double *value);
    void *context;
} tl_search;

typedef struct tl_optimiser tl_optimiser;

typedef struct tl_optimiser_class {
    const char *name; /* as configured */
    /* NULL when memory is out. `space` and what it points to must outlive the solver. */
    tl_optimiser *(*create)(tl_arena *arena, const tl_optimiser_space *space);
    void (*minimise)(tl_optimiser *optimiser, const tl_search *search);
    void (*destroy)(tl_optimiser *optimiser);
} tl_optimiser_class;

/* The solver of that name, or NULL. */
const tl_optimiser_class *tl_optimiser_find(const char *name);

/* The names, comma separated, for messages. */
const char *tl_optimiser_names(void);

extern const tl_optimiser_class tl_nelder_mead;

#endif
