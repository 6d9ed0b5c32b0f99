/* Lock states and the number of steps in each: plain data and their texts.
 *
 * Purpose: the result of the lock monitor (lock_monitor.h), for the summary, `--require-lock` and
 *          displays.
 * Thread:  plain data, pure functions.
 */
#ifndef TL_FIRMWARE_MONITOR_LOCK_TALLY_H
#define TL_FIRMWARE_MONITOR_LOCK_TALLY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"

typedef enum tl_lock_state {
    TL_LOCK_FREE,      /* no statement: nothing is adjusted, or no matched signal is good */
    TL_LOCK_LOCKED,    /* simulated and measured outputs agree within tolerance */
    TL_LOCK_CORRECTED, /* as locked, but only because of the corrections (lock_monitor.h) */
    TL_LOCK_DEGRADED,  /* within tolerance, but uncertain: a plant signal is bad, or a rollback was not exact */
    TL_LOCK_LOST       /* simulated and measured outputs do not agree */
} tl_lock_state;

enum { TL_LOCK_STATES = TL_LOCK_LOST + 1, TL_LOCK_SENTENCE = 256 };

typedef enum tl_lock_reason {
    TL_LOCK_REASON_NONE,       /* not corrected, or not known */
    TL_LOCK_REASON_CORRECTION, /* u − û differs from the approved correction */
    TL_LOCK_REASON_BOUND,      /* u is at a bound */
    TL_LOCK_REASON_RELEASED    /* an output of the released twin is off */
} tl_lock_reason;

enum { TL_LOCK_VARIABLE = 64, TL_LOCK_UNIT = 24, TL_LOCK_CLAUSE = 192, TL_LOCK_INSTANT = 64 };

/* Reason and start of state CORRECTED. Zeroed in other states. Long texts are truncated. */
typedef struct tl_lock_standing {
    tl_lock_reason reason;
    char variable[TL_LOCK_VARIABLE]; /* name of the adjusted variable; RELEASED: of the matched output */
    char unit[TL_LOCK_UNIT];         /* of `value`; "": none */
    double value;                    /* mean u − û; if BOUND: the bound; if RELEASED: rms error of the output */
    double since_s;                  /* beginning of the state, s since t_start */
    double now_s;                    /* newest step, s since t_start */
    int64_t started;                 /* t_start in UTC, ms; 0: a replay, which has no calendar time */
} tl_lock_standing;

/* Zeroed initially. */
typedef struct tl_lock_tally {
    tl_lock_state state;            /* at the end of the last window */
    uint64_t steps[TL_LOCK_STATES]; /* steps (event horizon: strokes) in each state, including caught-up ones */
    uint64_t windows;               /* windows that were assessed; 0: the run was shorter than one */
    uint64_t changes;               /* number of changes of the state */
    uint64_t losses;                /* number of changes to lost */
    uint64_t ran_away;              /* steps in which an output or J diverged (limit: lock_monitor.h) */
    tl_lock_standing standing;      /* in state CORRECTED; else zeroed */
} tl_lock_tally;

/* Tolerance and weight of each matched output, in the order of the configuration's `match`. Weight
 * 0: the output does not count. */
typedef struct tl_lock_tolerances {
    struct tl_lock_measure {
        double tolerance, weight;
    } match[TL_MAX_MATCH];
} tl_lock_tolerances;

/* Returns true if all values are finite, weights are ≥ 0, and tolerances with a weight are > 0. For
 * values of another process or from disk. */
bool tl_lock_tolerances_is_sound(const tl_lock_tolerances *tolerances);

/* Returns true if any output has a weight above 0. */
bool tl_lock_tolerances_have_weight(const tl_lock_tolerances *tolerances);

/* Returns the name of a state: "free", "locked", …. */
const char *tl_lock_state_name(tl_lock_state state);

/* Returns the number of steps in all states. */
uint64_t tl_lock_tally_total(const tl_lock_tally *tally);

/* Returns the percentage of steps that are locked or corrected, 0 … 100; 0 if there was no step. */
double tl_lock_tally_percent(const tl_lock_tally *tally);

/* Returns an instant of a live run in UTC, ms. `instant_s`: s since t_start. `started`: as in
 * tl_lock_standing. The arguments may come from another process; 0: they are impossible. */
int64_t tl_lock_utc(double instant_s, int64_t started);

/* Writes an instant: "05:00:06 UTC", or "2026-11-28 05:00 UTC" if `now_s` is on another day; in a
 * replay "t = 18006 s". `is_event`: for a live run, UTC and t, because `show` reads t. */
void tl_lock_instant_write(double instant_s, double now_s, int64_t started, bool is_event, char text[TL_LOCK_INSTANT]);

/* Writes the state with its reason: "locked, corrected: heater.Q +5 W since 05:00:06 UTC", or, if
 * RELEASED, "locked, but 3.2 degC off without corrections since …". `is_event`: with t and, if
 * RELEASED, the name of the output. The text is empty if there is no reason. */
void tl_lock_standing_write(const tl_lock_standing *standing, bool is_event, char text[TL_LOCK_CLAUSE]);

/* Writes the advice with the key that approves a correction; empty if the reason is not CORRECTION.
 */
void tl_lock_standing_write_remedy(const tl_lock_standing *standing, char text[TL_LOCK_CLAUSE]);

/* Parses a text that tl_lock_standing_write() wrote for an event. `now_s` and `started` become 0.
 * Returns false for another text; then the reason is NONE. */
bool tl_lock_standing_parse(const char *text, tl_lock_standing *standing);

/* Writes the text that follows "in lock" in the summary, without a full stop. `unit`: "steps" or
 * "strokes". */
void tl_lock_tally_write(const tl_lock_tally *tally, const char *unit, char text[TL_LOCK_SENTENCE]);

/* Returns true if at least `percent` of the steps were locked or corrected. With `percent` 0, it
 * returns true if the twin was ever in lock and nothing diverged. */
bool tl_lock_tally_is_enough(const tl_lock_tally *tally, double percent);

#endif
