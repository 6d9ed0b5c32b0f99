/* The cycle of a live run: reads the plant, steps the twin, takes a tuning, changes twins.
 *
 * Thread:  the cycle's.
 */
#ifndef TL_FIRMWARE_TWIN_CYCLE_H
#define TL_FIRMWARE_TWIN_CYCLE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/fmu/fmu_thread.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/heartbeat.h"
#include "firmware/report/summary.h"
#include "firmware/store/record_queue.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/handover.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/live_tuning.h"

/* ---- Real-time scheduling where it is permitted, ordinary scheduling where it is not.
 *
 * Purpose: SCHED_FIFO for the cycle thread, memory locked so that no page fault delays it. What is not permitted is said
 *          once, with what would permit it, and the run goes on.
 */

/* mlockall: what is mapped, and what will be where the limit allows it. */
void tl_realtime_lock_memory(tl_journal *journal);

/* An event: the cycle's thread did not get its priority. */
void tl_realtime_tell_refused(tl_journal *journal);

/* ---- The real-time cycle: the thread of the FMUs wakes at absolute instants, takes a sample, and steps the twin.
 *
 * Purpose: the heart of `twinlock run`. Nothing in it waits: samples come from mailboxes, records go into rings.
 * Ticks:   tick m is due at t_start + m·T_S (CLOCK_MONOTONIC). A tick whose whole period has passed before it could be
 *          begun is skipped: its sample is looked up at its own instant and its step made up without a search, with nominal
 *          plus the last Δu (a Boolean: the last u), within the time budget of a later tick, so that model time stays plant
 *          time. Of the ticks at which a step was due,
 *          ticks = steps + skipped.
 * Tunings: looked for at the start of each tick, and in force from the first one on that is computed then: a load where there is none, no system call.
 *          One that finds no room in the outbox waits for the next tick: nobody shall have it who cannot say so.
 * Shadow:  a cycle is the run's, or a shadow beside it in the other place (handover.h): that one begins its ticks a quarter of a step later, puts nothing
 *          into its outbox, and its events go to the log only. The two change at a flip. The shadow has begun its run some ticks before: as soon as there
 *          was time to save the twin, which knows no more from there on than what is saved, so that a replay of the run repeats it. The ticks from
 *          there to the flip are in its records as well, as those are that a warm restart follows. The run's computes all ticks before the flip, ends
 *          its run, and is the shadow. Each counts from 0 then.
 * Thread:  start and stop from one thread; status from any. Between them the thread of the FMUs should have the configured real-time
 *          priority, and an ordinary one before and after, while FMUs are loaded and freed: whoever starts it sees to that.
 */

typedef struct tl_cycle tl_cycle;

/* Which of two places a cycle is in, and what it is there at first. Zeroed: there is one place, and it is the run's. */
typedef struct tl_cycle_place {
    const tl_handover *stage; /* where flips are announced; NULL: none is */
    uint32_t place;
    uint32_t handovers;    /* number of the newest flip that is of no concern any more */
    uint32_t *handed_over; /* gets the number of the newest in which it has done its part; with a stage */
    bool is_shadow;
    int64_t tick;    /* of a shadow: the next one, which its twin is ready for, */
    tl_time start;   /* and t_start of the run (CLOCK_MONOTONIC), */
    int64_t started; /* and UTC, ms */
} tl_cycle_place;

typedef struct tl_cycle_settings {
    tl_assembly *assembly;
    tl_fmu_thread *thread; /* in which the assembly was built; it belongs to the cycle from start to stop */
    const tl_plant_input *input;
    tl_record_queue *queue; /* for whoever records it */
    tl_journal *journal;
    tl_heartbeats *beats;          /* NULL: nobody listens */
    const tl_live_tuning *tuning;  /* what another process tells; NULL: nobody does */
    tl_live_tuning_answer *answer; /* what the cycle says of it; NULL: as `tuning` */
    tl_cycle_place place;
    bool unreadable; /* saved states of these FMUs are not to be loaded: none are saved */
    tl_summary
        resumed; /* what was done before the first tick, where the twin goes on with an earlier run; else zeroes */
} tl_cycle_settings;

/* What the cycle is doing, for a status line and who compares it. Counts are since it began, or since it became what it is: of a shadow, since it was
 * at the plant's ticks for the first time. Fits tl_latest. */
typedef struct tl_cycle_status {
    bool is_shadow;
    bool is_live; /* false: a shadow is on its way to the plant's ticks, over what was missed before */
    int64_t tick; /* the newest */
    uint64_t steps;
    uint64_t ticks;
    uint64_t skipped;
    uint64_t gaps; /* times that ticks were skipped, however many at once */
    uint64_t deadline_misses;
    uint64_t evaluations;
    uint64_t executions;
    uint64_t timed_out;             /* steps whose search the time has cut short */
    tl_time used;                   /* ns in all steps */
    tl_metrics match[TL_MAX_MATCH]; /* by match */
    bool ended;                     /* the duration is over, or the twin failed */
    tl_record record;               /* the newest */
    tl_lock_tally lock;             /* free until it is judged */
    tl_lock_tally lock_before;      /* the same by the yardstick of the version that a probation may return to */
} tl_cycle_status;

/* Tick 0 is due one period from now, and the run begins in the outbox; of a twin that goes on with an earlier run, its next tick at that run's own time, and
 * all ticks since then are missed ones. Settings and what they point to must outlive the cycle. */
tl_status tl_cycle_start(const tl_cycle_settings *settings, tl_cycle **cycle, tl_error *error);

/* false where nothing new could be read without waiting. */
bool tl_cycle_status_now(const tl_cycle *cycle, tl_cycle_status *status);

/* Ends the cycle within one period at most, fills the summary, and frees it. *has_run: a run of its own is in the outbox, and has not ended there. The
 * status is that of the twin's last step; TL_OK where it was only asked to stop. */
tl_status tl_cycle_stop(tl_cycle *cycle, tl_summary *summary, bool *has_run, tl_error *error);

enum { TL_STATUS_LINE = 512 };

/* How the twin is, in one line, for a terminal and for the service manager. What matters first: the end is cut off where there is no room. Valid UTF-8. For
 * the main thread. */
void tl_status_line_write(const tl_config *config, const tl_cycle_status *status, char line[TL_STATUS_LINE]);

/* ---- Safe hold: what is left of a run after a restart loop, or what there is before its twin may begin. There is no twin and no FMU; the plant is read, and its
 * samples are recorded. Log and status line say what has happened, and when the twin is tried again.
 *
 * Purpose: a box that cannot keep its twin alive still loses nothing: what it records can be replayed once the fault is found.
 * Ticks:   as the cycle's, T_S apart; nothing is computed, so ordinary scheduling will do, and what was late is taken up at once.
 * Thread:  the main thread, until it is told to end.
 */

typedef struct tl_safe_hold_settings {
    const tl_cycle_settings
        *cycle; /* that there would be: configuration, plant, outbox, journal and beats of it are used */
    tl_thread_heartbeat *heartbeat; /* of the thread */
    tl_time time;                   /* until the supervisor tries the twin again */
    unsigned missing;               /* starts in a row that got no process; 0: the twin failed */
    unsigned failures;              /* of this loop, */
    const char *reason;             /* and why the last of them */
    bool records;                   /* somebody writes down what goes into the outbox */
    tl_time
        since; /* 0: after a restart loop. Else: until the saved states of the FMUs are tested; samples from then on */
} tl_safe_hold_settings;

/* Returns once a signal to end has come. */
void tl_safe_hold(const tl_safe_hold_settings *settings);

#endif
