/* Cycle of a live run: reads the plant, steps the twin, applies tunings, and performs handovers.
 *
 * Thread:  each section says which.
 * Errors:  start and stop return them; during the run they are events.
 */
#ifndef TL_FIRMWARE_TWIN_CYCLE_H
#define TL_FIRMWARE_TWIN_CYCLE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/fmu/fmu_thread.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/heartbeat.h"
#include "firmware/report/journal.h"
#include "firmware/report/summary.h"
#include "firmware/store/record_queue.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/handover.h"
#include "firmware/twin/live_tuning.h"

/* ---- Real-time scheduling if it is permitted, else ordinary scheduling.
 *
 * Purpose: SCHED_FIFO for the FMU thread, and locked memory so that no page fault delays it. If one
 *          is not permitted, the run continues. The first missed tick or deadline then causes an
 *          event with the missing permission as possible cause, and the remedy.
 */

/* Features that are configured but were not permitted. Zeroed: none. */
typedef struct tl_realtime_missing {
    int lock_error; /* errno of mlockall */
    bool priority;  /* SCHED_FIFO was not permitted */
} tl_realtime_missing;

/* Calls mlockall(): locks the present mappings, and future ones if RLIMIT_MEMLOCK is unlimited.
 * Returns 0 or errno. */
int tl_realtime_lock_memory(void);

/* ---- Real-time cycle: the FMU thread wakes up at absolute instants, takes a sample, and steps the
 * twin.
 *
 * Purpose: main loop of `twinlock run`. It never blocks: it reads samples from sample buffers and
 *          writes records to the record queue.
 * Ticks:   tick m is due at t_start + m·T_S (CLOCK_MONOTONIC). A tick is skipped if its whole
 *          period has passed before it could begin. The twin catches up skipped ticks within the
 *          time budget of later ticks, so that model time stays plant time. For each it uses the
 *          sample of the skipped instant, and nominal plus the last Δu (a Boolean: the last u),
 *          without a search. Only ticks at which a step was due count: ticks = steps + skipped.
 * Tunings: the cycle checks for a new tuning at the start of each tick. The tuning applies from the
 *          next computed tick on, which may be a skipped one. If the record queue has no room for
 *          it, the cycle retries at the next tick, because each applied tuning must be recorded.
 *          Without a new tuning the check makes no system call.
 * Shadow:  a cycle computes the live twin, or a shadow in the other slot (handover.h). A shadow
 *          begins its ticks a quarter of a step later. It enqueues no records, and its events are
 *          only logged. At a handover the two swap roles. After the announcement, at the first tick
 *          with time for it, the shadow saves a checkpoint and begins its run. It then drops all
 *          state that the checkpoint does not contain, so that a replay repeats the run. It records
 *          its ticks from there on, because a resumed twin repeats them. The live twin computes all
 *          ticks before the handover, ends its run, and becomes the shadow. Both reset their counts
 *          to 0.
 * Thread:  the cycle runs in the FMU thread. Call start and stop from one other thread, status from
 *          any. The caller gives the FMU thread the configured real-time priority between start and
 *          stop, and an ordinary priority while FMUs are loaded and freed.
 */

typedef struct tl_cycle tl_cycle;

/* Slot and first role of a cycle. Zeroed: there is one slot, with the live twin. */
typedef struct tl_cycle_position {
    const tl_handover *handover_block; /* NULL: there are no handovers */
    uint32_t slot_index;
    uint32_t handovers; /* number of the newest handover at the start; only later ones are performed */
    uint32_t
        *handed_over; /* receives the number of the newest handover completed here; required with a handover block */
    bool is_shadow;
    int64_t tick;    /* shadow only: the next tick of its twin */
    tl_time start;   /* shadow only: t_start of the run (CLOCK_MONOTONIC) */
    int64_t started; /* shadow only: t_start in UTC, ms */
} tl_cycle_position;

typedef struct tl_cycle_settings {
    tl_assembly *assembly;
    tl_fmu_thread *thread; /* the thread that built the assembly; used by the cycle from start to stop */
    const tl_plant_input *input;
    tl_record_queue *queue; /* read by the recorder */
    tl_journal *journal;
    tl_heartbeats *beats;          /* NULL: not published */
    const tl_live_tuning *tuning;  /* tunings from another process; NULL: none */
    tl_live_tuning_answer *answer; /* receives the cycle's answer to a tuning; NULL if `tuning` is NULL */
    tl_cycle_position slot_index;  /* slot and first role; zeroed: one slot, live twin */
    tl_realtime_missing missing;
    bool unreadable;    /* no other process can load the saved states of these FMUs: save no checkpoint */
    tl_summary resumed; /* of a resumed run: from tl_resume_follow(); else zeros */
} tl_cycle_settings;

/* State of the cycle, for the status line and for a comparison of both twins. Counts are 0 at the
 * start and after a change of role. Those of a shadow restart once it has caught up with the plant
 * for the first time. The size fits into a tl_latest (os.h). */
typedef struct tl_cycle_status {
    bool is_shadow;
    bool has_caught_up; /* false only for a shadow that still catches up missed ticks */
    int64_t tick;       /* the newest tick */
    uint64_t steps;
    uint64_t ticks;           /* ticks at which a step was due: steps + skipped */
    uint64_t skipped;         /* caught up later, without a search */
    uint64_t gaps;            /* a gap is one or more skipped ticks in a row */
    uint64_t deadline_misses; /* ticks that began in their period T_S and ended after it */
    uint64_t evaluations;
    uint64_t executions;
    uint64_t timed_out;        /* steps whose search was cut short by the time budget */
    tl_time used, late;        /* sums, ns: computing time of all steps; delay of the starts of ticks */
    bool ended;                /* the cycle has ended: duration over, twin failed, or stop requested */
    tl_record record;          /* the newest record */
    tl_lock_tally lock;        /* state "free" until the lock monitor has decided */
    tl_lock_tally lock_before; /* the same with the lock tolerances of the version that a probation may roll back to */
    tl_run_adjusted adjust[TL_MAX_ADJUST];
    tl_metrics match[TL_MAX_MATCH]; /* one per matched output; last member, because unused elements are not published */
} tl_cycle_status;

/* Starts the cycle. A new live run begins in the record queue, and its tick 0 is due one period
 * from now. A resumed twin keeps t_start of the earlier run and continues with its next tick; all
 * ticks since then count as missed. Settings are copied; all that they point to must outlive the
 * cycle. Errors: TL_TRY_AGAIN. */
tl_status tl_cycle_start(const tl_cycle_settings *settings, tl_cycle **cycle, tl_error *error);

/* Copies the newest status without waiting. Returns false if it was being written: retry later. */
bool tl_cycle_status_now(const tl_cycle *cycle, tl_cycle_status *status);

/* Stops the cycle after its present tick, fills the summary, and frees the cycle. *has_run: the
 * record queue has a run of this cycle that was not ended there; the caller must end it. Returns
 * the status of the twin's last step: TL_OK, or the error that has ended the cycle. */
tl_status tl_cycle_stop(tl_cycle *cycle, tl_summary *summary, bool *has_run, tl_error *error);

enum { TL_STATUS_LINE = 78 }; /* bytes with the NUL: a line of a terminal, with room for "^C" */

/* Writes the state of the twin in one line, for a terminal and the service manager. A part that
 * does not fit is left out. `open_findings`: of the change detector. Main thread only. */
void tl_status_line_write(const tl_config *config, const tl_cycle_status *status, uint32_t open_findings,
                          char line[TL_STATUS_LINE]);

/* ---- Safe hold: records the plant without a twin: after a restart loop, or while the saved states
 * of the FMUs are tested. No FMU runs. Log and status line report the reason and the next retry.
 *
 * Purpose: if the twin cannot run, no sample is lost: the recording can be replayed once the fault
 *          is found.
 * Ticks:   T_S apart, as in the cycle. Nothing is computed, so ordinary scheduling is enough. Late
 *          ticks are processed at once.
 * Thread:  the main thread, until a signal ends it.
 */

typedef struct tl_safe_hold_settings {
    const tl_cycle_settings
        *cycle; /* of the cycle that does not run: configuration, plant, record queue, journal, heartbeats */
    tl_thread_heartbeat *heartbeat; /* of this thread */
    tl_time time;                   /* ns from the start of safe hold until the supervisor retries the twin */
    unsigned missing;               /* failed attempts in a row to start a process; 0: the twin itself failed */
    unsigned failures;              /* failures of the twin in this restart loop */
    const char *reason;             /* reason of the last failure */
    bool records;                   /* a recorder reads the record queue */
    tl_time since; /* 0: after a restart loop. Else saved states are being tested: CLOCK_MONOTONIC of tick 0 */
} tl_safe_hold_settings;

/* Runs safe hold. Returns after a signal to terminate. */
void tl_safe_hold(const tl_safe_hold_settings *settings);

#endif
