/* The watch: turns samples and records into events worth telling.
 *
 * Purpose: what a technician wants to read: a signal became bad or good, the twin runs free, the state of the lock has changed, a variable does not matter, a solver had to be helped, a stroke changed u, ticks were missed. Changes are told, not
 *          states, so that a bad hour is two lines.
 * Thread:  the thread that steps.
 */
#ifndef TL_FIRMWARE_TWIN_WATCH_H
#define TL_FIRMWARE_TWIN_WATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/monitor/lock_monitor.h"
#include "firmware/monitor/noise.h"
#include "firmware/twin/journal.h"
#include "master/twin/twin.h"

/* Searches in a row without a trouble before its end is told. */
enum { TL_WATCH_STEPS = 20 };

/* A trouble's last step is at least this long ago before its end is told. */
#define TL_WATCH_REST (60 * TL_SECOND)

/* Something that may be so in many steps, and not in all of a row: its beginning is told, and its end. */
typedef struct tl_watch_trouble {
    bool told;        /* its beginning */
    uint32_t without; /* searches since `last`, none of which had it */
    uint64_t count;   /* steps that had it */
    int64_t last;     /* of them */
} tl_watch_trouble;

/* Readings of a signal that were rejected: the first ones of a minute are told one by one, how many more there were, at its end. */
enum { TL_WATCH_REJECTED = 10 };
#define TL_WATCH_MINUTE (60 * TL_SECOND)

typedef struct tl_watch_rejected {
    tl_time stamp;   /* of the newest reading */
    double accepted; /* the last one that was; NaN: none was yet */
    int64_t since;   /* the minute's first tick */
    uint64_t count;  /* in it */
} tl_watch_rejected;

typedef struct tl_watch {
    const tl_config *config;
    tl_journal *journal;
    uint8_t quality[TL_MAX_SIGNALS]; /* as last told */
    tl_watch_rejected rejected[TL_MAX_SIGNALS];
    bool free_run;
    bool out_of_tolerance;                /* event horizon: the last stroke */
    tl_watch_trouble held[TL_MAX_ADJUST]; /* variables that are not identifiable */
    tl_watch_trouble fallback;            /* the second solver takes over */
    tl_watch_trouble stagnation;          /* solvers make no progress */
    uint64_t abandoned;                   /* event horizon: strokes in a row that were not searched to their end; */
    double stroke_u;                      /* event horizon: u in force before the stroke at hand, */
    uint64_t stroke_evaluations;          /* and what its search has evaluated so far */
    tl_delay_state delay_state;           /* as last told */
    tl_time delay;                        /* the measured delay as last told */
    bool differed;                        /* an FMU does not come back to where it was: told */
    bool rests;                           /* u, at nominal: told */
    bool no_way_back;                     /* an FMU cannot be led back by replay: told */
    uint64_t skipped;                     /* not told yet */
    tl_time skipped_since;
    tl_noise_watch noise; /* of what is matched */
} tl_watch;

void tl_watch_init(tl_watch *watch, const tl_config *config, tl_journal *journal);

void tl_watch_sample(tl_watch *watch, const tl_sample *sample);

/* `tick`: at which the record was complete. Events carry it, and not the step, so that they follow each other. */
void tl_watch_record(tl_watch *watch, int64_t tick, const tl_record *record);

/* The judge has found another state (lock_monitor.h) with the record that was complete at this tick. */
void tl_watch_lock(const tl_watch *watch, int64_t tick, const tl_lock_change *change);

/* What the judge says of u at its bounds, after each record. */
void tl_watch_bounds(const tl_watch *watch, int64_t tick, const tl_lock_monitor *judge);

/* The twin has the tuning of this configuration from this tick on. */
void tl_watch_retune(const tl_watch *watch, int64_t tick, const char *hash);

/* `count` ticks before `tick`, at which a step was due, were missed; told at most once a second, so call it with 0 too.
 * `now` is any clock's that does not go back. */
void tl_watch_skipped(tl_watch *watch, int64_t tick, uint64_t count, tl_time now);

#endif
