/* Watch: turns samples and records into events for the operator.
 *
 * Purpose: reports changes, not states, so that a fault that lasts an hour gives two events. Plant:
 *          a signal became bad or good, ticks were missed. Lock: the state changed, the twin runs
 *          free. Search: a variable is not identifiable, the fallback solver was used, a stroke
 *          changed u (event horizon).
 * Repeats: after a warning or error about the lock or the search, repeats of the same cause are
 *          notices during a pause: 1 h of plant time. The next warning states their number. If it
 *          comes within twice the pause, the pause doubles, up to 24 h; after an error it does not.
 * Thread:  the one that steps the twin.
 * Memory:  all inside the struct.
 */
#ifndef TL_FIRMWARE_REPORT_WATCH_H
#define TL_FIRMWARE_REPORT_WATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/monitor/lock_monitor.h"
#include "firmware/monitor/noise.h"
#include "firmware/report/journal.h"
#include "master/twin/twin.h"

/* The end of a condition is reported after this many searches in a row without it, and not before
 * TL_WATCH_REST. */
enum { TL_WATCH_STEPS = 20 };

/* Least time from the last step with a condition to the report of its end: 60 s. */
#define TL_WATCH_REST (60 * TL_SECOND)

/* Intermittent condition: it may be absent in some steps. Only its beginning and its end are
 * reported. */
typedef struct tl_watch_trouble {
    unsigned cause;    /* of its warnings: a tl_watch_cause plus an index; some do not use it */
    bool was_reported; /* the beginning was reported */
    uint32_t without;  /* searches since `last`, all without it */
    uint64_t count;    /* number of steps with it */
    int64_t last;      /* newest step with it */
} tl_watch_trouble;

/* Rejected readings of a signal: in each minute the first TL_WATCH_REJECTED are reported one by
 * one. The number of further ones is reported with the first rejected reading after that minute.
 * Without a gate (tl_condition), a rejected reading waits for the next good one, which shows
 * whether it was an outlier or a step. At most TL_WATCH_WAITING readings wait. */
enum { TL_WATCH_REJECTED = 10, TL_WATCH_WAITING = 2 };
#define TL_WATCH_MINUTE (60 * TL_SECOND)

typedef struct tl_watch_rejected {
    tl_time stamp;                    /* of the newest reading */
    double accepted;                  /* the last accepted value; NaN: none yet */
    int64_t since;                    /* first tick of the present minute */
    uint64_t count;                   /* readings rejected in this minute */
    uint64_t total;                   /* readings rejected in this run */
    double waiting[TL_WATCH_WAITING]; /* values of the readings that wait */
    size_t waiting_count;
} tl_watch_rejected;

/* Causes whose repeats are notices. Some have one number for each state, variable or match. */
typedef enum tl_watch_cause {
    TL_WATCH_STATE, /* + tl_lock_state */
    TL_WATCH_HARM = TL_WATCH_STATE + TL_LOCK_STATES,
    TL_WATCH_ALIKE,
    TL_WATCH_FALLBACK,
    TL_WATCH_STAGNATION,
    TL_WATCH_FREE_RUN,
    TL_WATCH_RESET,
    TL_WATCH_STROKE,
    TL_WATCH_ABANDONED,
    TL_WATCH_BOUND,                                 /* + adjusted variable */
    TL_WATCH_HELD = TL_WATCH_BOUND + TL_MAX_ADJUST, /* + adjusted variable */
    TL_WATCH_NOISE = TL_WATCH_HELD + TL_MAX_ADJUST, /* + match */
    TL_WATCH_CAUSES = TL_WATCH_NOISE + TL_MAX_MATCH
} tl_watch_cause;

/* Repeats of one cause. */
typedef struct tl_watch_repeats {
    int64_t since;  /* tick of the last warning */
    int64_t pause;  /* ticks after it in which repeats are notices; 0: no warning yet */
    uint64_t count; /* notices since the last warning */
} tl_watch_repeats;

/* Fields are private, except `started`, which the caller sets. */
typedef struct tl_watch {
    const tl_config *config;
    tl_journal *journal;
    uint8_t quality[TL_MAX_SIGNALS]; /* as reported last */
    bool had_value[TL_MAX_SIGNALS];  /* a good value was seen */
    uint64_t moved;                  /* bit i: it was reported that a value of signal i was moved to a limit */
    tl_watch_rejected rejected[TL_MAX_SIGNALS];
    bool free_run;                           /* reported: no matched signal is good */
    bool out_of_tolerance;                   /* event horizon: result of the last stroke */
    tl_watch_trouble held[TL_MAX_ADJUST];    /* variables to which no matched output reacts */
    tl_watch_trouble alike;                  /* variables share one correction */
    tl_watch_trouble fallback;               /* the fallback solver is used */
    tl_watch_trouble stagnation;             /* solvers make no progress */
    uint64_t abandoned;                      /* event horizon: strokes in a row whose search was not completed */
    double stroke_u;                         /* event horizon: u before the present stroke */
    uint64_t stroke_evaluations;             /* event horizon: evaluations of this stroke's search so far */
    tl_delay_state delay_state;              /* as reported last */
    tl_time delay;                           /* as reported last, ns */
    bool differed;                           /* reported: the rollback of an FMU is not exact */
    tl_watch_trouble bad[TL_CONFIG_OUTPUTS]; /* outputs that are not finite, by bit of a record's bad_outputs */
    uint32_t bad_steps;                      /* steps in a row with such an output */
    bool refused;                            /* reported: a candidate could not be evaluated */
    bool rests;                              /* reported: u stays at nominal */
    bool no_way_back;                        /* reported: an FMU cannot be rolled back by replay */
    bool has_keep;                           /* tl_watch_keep() has reported */
    uint64_t skipped;                        /* missed ticks not reported yet */
    tl_time skipped_since;                   /* `now` of the last report; TL_TIME_NEVER: none */
    tl_noise_watch noise;                    /* of the matched outputs */
    int64_t started;                         /* t_start, ms since 1970 UTC; 0: a replay */
    tl_watch_repeats repeats[TL_WATCH_CAUSES];
} tl_watch;

/* Initialises the watch; `config` and `journal` must outlive it. */
void tl_watch_init(tl_watch *watch, const tl_config *config, tl_journal *journal);

/* Call it for each sample: reports signals that became bad or good, rejected readings, and noise
 * above a tolerance. */
void tl_watch_sample(tl_watch *watch, const tl_sample *sample);

/* Call it for each complete record: reports changes of the search, the rollback, the outputs and
 * the delay. `tick`: tick at which the record was complete. Events have this tick, not the step, so
 * that they are in order. */
void tl_watch_record(tl_watch *watch, int64_t tick, const tl_record *record,
                     const tl_twin_identifiability *identifiability);

/* Call it for each complete record. Reports once what components with "keep": "auto" keep, so that
 * a replay can repeat it. `unsaved` as in tl_twin_unsaved(). */
void tl_watch_keep(tl_watch *watch, int64_t tick, uint64_t unsaved);

/* Reports a change or an update of the lock monitor (lock_monitor.h), found with the record that
 * was complete at this tick. */
void tl_watch_lock(tl_watch *watch, int64_t tick, const tl_lock_change *change);

/* Call it after each record: reports if u is at its bounds, if the corrections do harm, and frozen
 * signals. */
void tl_watch_monitor(tl_watch *watch, int64_t tick, const tl_lock_monitor *monitor);

/* Reports that the twin has the tuning of this configuration from this tick on. */
void tl_watch_retune(const tl_watch *watch, int64_t tick, const char *hash);

/* Reports missed ticks, at most once a second. So call it at every tick, also if `count` is 0.
 * `count`: number of ticks just before `tick` that were missed although a step was due. `now`: ns
 * of any clock that never goes backwards. */
void tl_watch_skipped(tl_watch *watch, int64_t tick, uint64_t count, tl_time now);

#endif
