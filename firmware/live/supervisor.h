/* Supervisor: starts, monitors and restarts the processes of a run.
 *
 * Purpose:  an FMU may hang, or corrupt the memory of its process; a device may hang a driver; a
 *           disk may hang the recorder. So FMUs, drivers and the recorder have separate processes.
 *           The supervisor uses no FMU, no plant and no database. It monitors the heartbeats
 *           (heartbeat.h), kills a silent process, and starts a new one. It sends keepalives to the
 *           watchdog of the box and to that of systemd.
 * Members:  the *twin* is the purpose of the run. *io* reads the plant, the *recorder* writes the
 *           database; the twin continues if one of them fails. A *shadow* is a second twin; it runs
 *           as long as the order `shadow` is set. The *config manager* changes the configuration.
 * Watchdog: gets keepalives as long as the twin is alive, or the supervisor can restart it. A
 *           failed disk or device never resets the box. Keepalives stop only in these four cases:
 *           1. a thread of the twin is silent, until the twin has been killed;
 *           2. the process in safe hold has failed TL_RESTARTS_MOST (5) times in a row;
 *           3. the kernel has not released a dead twin 30 s after its restart was due;
 *           4. for about 5 min no process could be started for the twin.
 * Damage:   a process may have heartbeats although its memory is corrupted. The recorder detects
 *           that in its data (callback `damaged`). Then the supervisor kills the process like a
 *           silent one, also if the run is not supervised. A report may be false. So after the
 *           first report about a member, further ones are ignored until its new process has been
 *           ready (heartbeat.h) for TL_RESTARTS_FORGIVEN (120 s). Damage alone cannot cause safe
 *           hold.
 * Ends:     an end is orderly only if the process announced it (heartbeat.h), for one of three
 *           reasons:
 *           1. the run is over. This is accepted only if the run has a duration: without one, an
 *              FMU in the twin's process must have written the announcement;
 *           2. the process could not start, and nothing had run before; the exit code says why;
 *           3. the supervisor was asked to end. It asks shadow, config manager, twin, io and
 *              recorder, in this order; the recorder writes the remaining data.
 *           Any other end is a failure. It is reported, with the FMU and its function if a call was
 *           running.
 * Restart:  the twin restarts at once after the first failure. Then the pause doubles with each
 *           failure that is not forgiven (restarts.h): 0.25 s, 0.5 s, 1 s, and 2 s before safe
 *           hold. io and recorder restart without limit: after at most 0.25 s if they were ready
 *           before, else with doubling pauses up to 8 s. If fork fails, that is no failure of the
 *           twin; the start is retried with the same pauses. After 5 such starts in a row, safe
 *           hold follows, at first for 1/12 of its time.
 * Log:      for a member in a restart loop, at most one line per minute is logged, with the number
 *           of failures since the line before.
 * Hold:     after a restart loop of the twin (restarts.h), the supervisor starts a twin process in
 *           safe hold: without FMUs; it only records samples. At each retry, the supervisor
 *           replaces that process by a twin. If that twin fails, safe hold follows again, for twice
 *           as long.
 * Wait:     the first twin may have to wait until the saved states of its FMUs were tested
 *           (saved_states.h), while io and recorder run. Meanwhile the watchdogs get keepalives. A
 *           process that only waited does not count as a run: the twin after it may still end as
 *           "could not start".
 * Alone:    if the run is not supervised, a failed twin is not restarted: the run ends with exit
 *           code 70. The twin may be silent for TL_FMU_CALL_TIMEOUT_CALLS (10) times `call_limit`;
 *           while it is stopped or traced (child.h), this limit does not apply.
 * Signals:  SIGTERM, SIGINT and SIGHUP (not under nohup) end all. A process that does not end in
 *           time is killed: io after 1 s, twin and recorder after 6 s. All together have 8 s: the
 *           last ones get the rest of this time, at least 2 s (io 1 s). 6 s is 1 s more than the
 *           timeout of a hung FMU call (fmu_call_timeout.h). An FMU may block or catch the signal,
 *           so the supervisor repeats the signal until the twin reports that it has received one.
 *           Such an end is orderly: all failures are forgiven. If another signal follows after 1 s
 *           or later, each process gets 2 s. If the supervisor is killed, all its processes end.
 * Orders:   the callback `read_orders` sets the orders (tl_orders), mostly for a change of the
 *           configuration (handover_control.h).
 * Shadow:   started when the order `shadow` is set, and asked to end when this order is cleared.
 *           The shadow is monitored like the others. If the shadow ends, the supervisor calls
 *           `ended`. It starts another shadow only if the order is still set then. Keepalives,
 *           restart record, exit code and safe hold do not depend on the shadow. When the run ends,
 *           the shadow is asked first and killed after 2 s, because none of its data is kept.
 * Manager:  the config manager is started when its order is set, and ends when it has no work.
 *           After a failure it is restarted to finish its work, after a pause that doubles from
 *           0.25 s to 8 s. If its order is set during the pause, it starts after at most 1 s. When
 *           the run ends, it is asked to end before the twin, and killed 2 s later. The run, its
 *           exit code and the restart record do not depend on it.
 * Swap:     if the order `swap` is set, twin and shadow swap roles with all that belongs to their
 *           processes; keepalives, restart record and status then follow the new twin. If the
 *           shadow died before it became the twin, a new twin process is started at once. That
 *           death is not in the restart record, because the record counts failures of the live twin
 *           only. The old twin continues as the shadow; if it is dead, it is not restarted.
 * Exchange: if the order `recorder` is set, the recorder is asked to end and another one is
 *           started. This end is orderly: no failure, no log line, no event. If the recorder has
 *           already ended with the run, the order starts another one for the data that it left.
 * Last:     if a recorder fails or cannot be started while the run ends, another one writes the
 *           remaining data. At most two others are tried, or one if the first had to be killed.
 * Memory:   the caller owns the settings and the heartbeats.
 * Errors:   logged; tl_supervise() returns an exit code.
 * Thread:   the caller's; the callbacks of the settings run in it.
 */
#ifndef TL_FIRMWARE_LIVE_SUPERVISOR_H
#define TL_FIRMWARE_LIVE_SUPERVISOR_H

#include <signal.h>
#include <stdbool.h>
#include <sys/types.h>

#include "firmware/live/restarts.h"
#include "firmware/process/heartbeat.h"

/* Members of a run, in the order in which they start. */
typedef enum tl_member {
    TL_MEMBER_RECORDER,
    TL_MEMBER_IO,
    TL_MEMBER_TWIN,
    TL_MEMBER_SHADOW,
    TL_MEMBER_CONFIG_MANAGER,
    TL_MEMBERS
} tl_member;

/* Whether and how the first twin must wait (saved_states.h). */
typedef enum tl_wait {
    TL_WAIT_OVER,
    TL_WAIT_BRIEF, /* no twin process is started meanwhile */
    TL_WAIT_LONG   /* a process without FMUs (safe hold) records samples until the wait is over */
} tl_wait;

/* Orders, read in each pass of the supervisor's main loop. An order applies while it is set. While
 * `swap` is set, twin and shadow swap in each pass: set it for one pass only. */
typedef struct tl_orders {
    bool end;            /* end the run */
    bool shadow;         /* a shadow is wanted; started if there is none */
    bool config_manager; /* a config manager is wanted; started if there is none */
    bool kill_twin;      /* kill the live twin, because it did not hand over in time */
    bool swap;           /* twin and shadow swap roles; ignored once the run ends */
    bool recorder;       /* replace the recorder */
    bool soon;           /* an event is expected: the next pass is in 2 ms */
} tl_orders;

typedef struct tl_supervisor_settings {
    bool unsupervised;                /* the run is not supervised: a failed twin ends it */
    bool has_duration;                /* the run ends after a duration */
    tl_time call_limit;               /* if `unsupervised`: limit of an FMU call, ns */
    tl_time hold_time;                /* ns of the first safe hold of a restart loop; 0: TL_RESTARTS_HOLD (60 s) */
    const char *state;                /* folder of the restart record of one supervisor; NULL: none */
    const char *watchdog;             /* the device; NULL: none */
    int watchdog_s;                   /* timeout of the watchdog, s */
    tl_heartbeats *beats[TL_MEMBERS]; /* of each member at the start of the run; NULL: no such member */
    void *context;                    /* context of the callbacks below, which must not block */

    /* Starts a process (role.h). `start`: for the live twin. For other members, also a shadow, only
     * its field `unreadable` is valid. Returns the process id, or 0 and the reason in `error`. */
    pid_t (*begin)(void *context, tl_member which, const tl_start *start, tl_error *error);

    /* Called when a member has ended and is not reaped yet. The callback may replace `reason` by a
     * better one. `by_others`: true if SIGKILL came from a user or the kernel (out of memory). If
     * the twin had `loads` (live_blocks.h) and not by_others, returns the identity number of its
     * FMU files (identity.h): their saved states are not loaded again (restarts.h). Else returns 0.
     */
    uint64_t (*ended)(void *context, tl_member which, bool by_others, char reason[TL_RESTARTS_REASON]);

    /* Records a failure, which was logged before, in the database. Not called for a twin that is
     * restarted, because the next twin gets the reason (tl_start) and records it. */
    void (*report)(void *context, const char *text);

    /* Returns 0 if this member's data is not damaged. Else returns a time (CLOCK_MONOTONIC, ns)
     * before the check that found the damage. A process that became ready after this time did not
     * cause it. */
    tl_time (*damaged)(void *context, tl_member which);

    /* Called before and while the first twin waits. NULL: it never waits. */
    tl_wait (*wait)(void *context);

    /* Called in each pass of the main loop to read the orders. `ends`: all processes are ending.
     * `orders` is zeroed before the call. */
    void (*read_orders)(void *context, bool ends, tl_orders *orders);
} tl_supervisor_settings;

/* Runs the processes until all have ended. Sets *stopped to the signal that requested the end, or
 * to 0; `stopped` may be NULL. Returns the exit code that the twin announced last, or that of the
 * recorder if the twin's is 0; 75 if a process had to be killed at the end; 70 if the twin failed
 * and the run is not supervised. A process that ended last is not reaped; the kernel reaps it when
 * this process ends. Sets SIGCHLD to its default. The caller's other threads must block the signals
 * of tl_supervisor_block_signals(). */
int tl_supervise(const tl_supervisor_settings *settings, int *stopped);

/* Blocks *blocked: the signals that a supervisor waits for. *before (may be NULL): the old mask. */
void tl_supervisor_block_signals(sigset_t *blocked, sigset_t *before);

#endif
