/* The state of the lock, and how much of a run was in which: plain data and the words for it.
 *
 * Purpose: what the judge says of a run (lock_monitor.h), for the summary, `--require-lock` and whoever shows it.
 * Thread:  plain data, pure functions.
 */
#ifndef TL_FIRMWARE_MONITOR_LOCK_TALLY_H
#define TL_FIRMWARE_MONITOR_LOCK_TALLY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"

typedef enum tl_lock_state {
    TL_LOCK_FREE,     /* nothing holds the twin: nothing is adjusted, or no matched signal is good */
    TL_LOCK_LOCKED,   /* simulated and measured outputs agree within tolerance */
    TL_LOCK_TRACKING, /* they do, but it takes more correction than usual, or all that the bounds allow */
    TL_LOCK_DEGRADED, /* they do as far as can be seen: a signal of the plant is bad */
    TL_LOCK_LOST      /* they do not */
} tl_lock_state;

enum { TL_LOCK_STATES = TL_LOCK_LOST + 1, TL_LOCK_SENTENCE = 256 };

/* Zeroed at first. */
typedef struct tl_lock_tally {
    tl_lock_state state;            /* the last one */
    uint64_t steps[TL_LOCK_STATES]; /* in each state, made up ones among them; with an event horizon strokes */
    uint64_t windows;               /* that were judged; 0: the run was shorter than one */
    uint64_t within;                /* steps of those tenths of a window in which no step was out of tolerance */
    uint64_t changes;               /* of the state */
    uint64_t losses;                /* how often it was lost */
    uint64_t ran_away;              /* steps in which an output, or J, was beyond all measure */
} tl_lock_tally;

/* By what each matched output is judged, in the order of a configuration's `match`. A weight of 0: the output does not count. */
typedef struct tl_lock_tolerances {
    struct tl_lock_measure {
        double tolerance, weight;
    } match[TL_MAX_MATCH];
} tl_lock_tolerances;

/* Whether it can be one; it may come from another process, or from a disk. */
bool tl_lock_tolerances_is_sound(const tl_lock_tolerances *tolerances);

/* Whether any output counts. */
bool tl_lock_tolerances_is_there(const tl_lock_tolerances *tolerances);

/* "free", "locked", …. */
const char *tl_lock_state_name(tl_lock_state state);

/* Steps in all states. */
uint64_t tl_lock_tally_total(const tl_lock_tally *tally);

/* The share of steps in lock, tracked ones among them, 0 … 100; 0 of a run without a step. */
double tl_lock_tally_percent(const tl_lock_tally *tally);

/* The one sentence with which a run ends, without a full stop. */
void tl_lock_tally_write(const tl_lock_tally *tally, char text[TL_LOCK_SENTENCE]);

/* Whether at least `percent` of the steps were in lock. 0: whether the twin ever was, or was within tolerance in
 * ten steps and more of whole tenths of a window; of a run that was shorter than a window that is not asked. And whether it never ran away. */
bool tl_lock_tally_is_enough(const tl_lock_tally *tally, double percent);

#endif
