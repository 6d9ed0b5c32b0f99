/* Search of an event horizon: proposes the next u from all earlier candidates.
 *
 * Purpose: a candidate of an event horizon is a whole stroke of the plant, so a search takes many
 *          cycles. It stores every candidate and computes the next u from them. It can be called in
 *          any cycle and has no other state. One Real variable.
 * Method:  the first guess, then a solver of optimiser.h. The solver is deterministic: it is run
 *          again from its start through the stored candidates, at no cost, until it asks for a u
 *          that is not stored.
 * Plateau: if the simulated event falls outside the window, J is constant and a solver cannot use
 *          it. But the side is known. So the search first moves away from the guess, to both sides
 *          in turn. It doubles the distance until a candidate falls inside the window or on the
 *          other side. Then it bisects until a candidate falls inside. It never goes beyond a
 *          candidate that failed. The solver continues from the candidate inside. If the solver
 *          ends outside the tolerance, bisection continues between the nearest early and late
 *          candidates.
 * Source:  thesis 5.6.3 (eq. 5.4, 5.5); the method for the plateau is not from the thesis.
 * Thread:  the twin's. Memory: the arena, at start-up; NLopt allocates in each call (optimiser.h).
 */
#ifndef TL_MASTER_EVENT_EVENT_SEARCH_H
#define TL_MASTER_EVENT_EVENT_SEARCH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/solve/optimiser.h"

/* Time of the simulated event relative to the plant's. */
typedef enum tl_event_side {
    TL_EVENT_UNKNOWN, /* the candidate failed */
    TL_EVENT_BEFORE,  /* before the window: on the plateau */
    TL_EVENT_EARLY,   /* within the window */
    TL_EVENT_EXACT,   /* in the same step */
    TL_EVENT_LATE,    /* within the window */
    TL_EVENT_AFTER    /* after the window: on the plateau */
} tl_event_side;

/* A candidate that was simulated. */
typedef struct tl_event_candidate {
    double u;
    double value; /* J; HUGE_VAL if it failed */
    tl_event_side side;
} tl_event_candidate;

typedef struct tl_event_search {
    const tl_optimiser_class *solver;
    tl_optimiser *optimiser;
    tl_optimiser_space space; /* search space of the solver's variable z; u = origin + scale·z */
    double z_step;
    double z_lower;
    double z_upper;
    double origin;
    double scale;
    double step; /* of the adjusted variable */
    double lower;
    double upper;
    uint32_t stagnation; /* candidates without progress that stop the solver */
    tl_event_candidate *candidates;
    size_t count;
    size_t most;  /* largest number of candidates of a search */
    double asked; /* u that the solver proposed and that is not evaluated yet */
    bool asks;    /* `asked` is valid */
} tl_event_search;

enum { TL_EVENT_STAGNATION = 6 };

typedef struct tl_event_search_settings {
    const tl_optimiser_class *solver;
    double step; /* of the adjusted variable, and its bounds */
    double lower;
    double upper;
    uint32_t stagnation;  /* candidates without progress that stop the solver; 0: TL_EVENT_STAGNATION */
    uint32_t evaluations; /* maximum number of candidates of a search */
} tl_event_search_settings;

/* Returns false if memory is out. */
bool tl_event_search_init(tl_event_search *search, tl_arena *arena, const tl_event_search_settings *settings);
void tl_event_search_end(tl_event_search *search);

/* Changes the bounds and the number of candidates (at most that of the settings). A search in
 * progress uses them. */
void tl_event_search_retune(tl_event_search *search, double lower, double upper, size_t evaluations);

/* Drops all candidates. */
void tl_event_search_begin(tl_event_search *search);

/* The next u after the guess, which must have been reported. Returns false if nothing is left to
 * try or if J is within tolerance. */
bool tl_event_search_next(tl_event_search *search, double *u);

/* Reports the result of a candidate. The search must not be full. */
void tl_event_search_report(tl_event_search *search, double u, double value, tl_event_side side);

bool tl_event_search_is_full(const tl_event_search *search);

/* The best candidate (the first of equal ones); and the candidate at u, or NULL. */
const tl_event_candidate *tl_event_search_best(const tl_event_search *search);
const tl_event_candidate *tl_event_search_find(const tl_event_search *search, double u);

/* True if the guess was on the plateau. */
bool tl_event_search_met_plateau(const tl_event_search *search);

#endif
