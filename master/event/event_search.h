/* The search of an event horizon: which u to try next, from what has been tried.
 *
 * Purpose: one candidate of an event horizon is a whole stroke of the plant, so that a search lasts over many cycles. It keeps
 *          every trial, and gives the next u as a function of them: it can be asked in any cycle, and has no state in
 *          between. One Real variable.
 * Method:  the first guess; then a solver of optimiser.h, which is led through the trials again from its start (it
 *          is deterministic, and what is known costs nothing) until it asks for one that is not there.
 * Plateau: where the simulated event falls outside the window, J is the same for every u and tells a solver nothing. The
 *          side on which it falls is known, though. So the search first goes away from the guess, a step to either side
 *          in turn and each twice as wide as the one before, until a trial falls inside, or on the other side; then it
 *          halves the interval between them until one falls inside. Beyond a trial that failed it does not go. From there
 *          the solver goes on. Where it ends outside the tolerance, halving goes on, now between the nearest too early and
 *          too late.
 * Source:  thesis 5.6.3 (eq. 5.4, 5.5); the plateau is ours.
 * Thread:  the twin's. Memory: the arena, at start-up; NLopt's own in each question (optimiser.h).
 */
#ifndef TL_MASTER_EVENT_EVENT_SEARCH_H
#define TL_MASTER_EVENT_EVENT_SEARCH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/solve/optimiser.h"

/* When the simulated event came, against the plant's. */
typedef enum tl_event_side {
    TL_EVENT_UNKNOWN, /* the candidate failed */
    TL_EVENT_BEFORE,  /* before the window: on the plateau */
    TL_EVENT_EARLY,   /* within it, */
    TL_EVENT_EXACT,   /* in the same step, */
    TL_EVENT_LATE,
    TL_EVENT_AFTER /* after it: on the plateau */
} tl_event_side;

/* One u that was tried. */
typedef struct tl_event_trial {
    double u;
    double value; /* J; HUGE_VAL where it failed */
    tl_event_side side;
} tl_event_trial;

typedef struct tl_event_search {
    const tl_optimiser_class *solver;
    tl_optimiser *optimiser;
    tl_optimiser_space space; /* of z: u = origin + scale·z */
    double z_step;
    double z_lower;
    double z_upper;
    double origin;
    double scale;
    double step; /* of the adjusted variable */
    double lower;
    double upper;
    uint32_t stagnation; /* trials without progress that end the solver */
    tl_event_trial *trials;
    size_t count;
    size_t most;  /* of a search, at most */
    double asked; /* by the solver, and not known yet */
    bool asks;
} tl_event_search;

enum { TL_EVENT_STAGNATION = 6 };

typedef struct tl_event_search_settings {
    const tl_optimiser_class *solver;
    double step; /* of the adjusted variable, and its bounds */
    double lower;
    double upper;
    uint32_t stagnation;  /* trials without progress that end the solver; 0: TL_EVENT_STAGNATION */
    uint32_t evaluations; /* the most trials of a search */
} tl_event_search_settings;

/* False when memory is out. */
bool tl_event_search_init(tl_event_search *search, tl_arena *arena, const tl_event_search_settings *settings);
void tl_event_search_end(tl_event_search *search);

/* Other bounds, and another number of trials: at most that of the settings. A search under way goes on with them. */
void tl_event_search_retune(tl_event_search *search, double lower, double upper, size_t evaluations);

/* Forgets all trials. */
void tl_event_search_begin(tl_event_search *search);

/* The next u after the guess, which must have been told; false: nothing is left to try, or J is within tolerance. */
bool tl_event_search_next(tl_event_search *search, double *u);

/* A u was tried; there must be room. */
void tl_event_search_tell(tl_event_search *search, double u, double value, tl_event_side side);

bool tl_event_search_is_full(const tl_event_search *search);

/* The best trial (of equals the first); the one at u, or NULL. */
const tl_event_trial *tl_event_search_best(const tl_event_search *search);
const tl_event_trial *tl_event_search_find(const tl_event_search *search, double u);

/* Was the guess on the plateau? */
bool tl_event_search_met_plateau(const tl_event_search *search);

#endif
