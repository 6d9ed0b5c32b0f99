/* Supervisor: starts, monitors and restarts the processes of a run.
 *
 * Purpose:  an FMU may hang, or corrupt the memory of its process; a device may hang a driver; a
 *           disk may hang the recorder. So each has its own process. The supervisor has no FMU, no
 *           plant and no database. It monitors the heartbeats (heartbeat.h), kills a silent
 *           process, starts a new one, and sends keepalives to the watchdog of the box and of
 *           systemd.
 * Members:  the *twin* is the purpose of the run. *io* reads the plant, the *recorder* writes the
 *           database; the twin continues without them. A *shadow* is a second twin, as long as it
 *           is ordered (see Shadow). The *config manager* changes the configuration.
 * Watchdog: gets keepalives as long as the twin is alive, or the supervisor can restart it. A
 *           failed disk or device never resets the box. No keepalive is sent while a thread of the
 *           twin is silent, or after safe hold has failed TL_RESTARTS_MOST (5) times in a row. Nor
 *           if a dead twin was not reaped within 30 s after its pause, or no process could be
 *           started for it for about 5 min.
 * Damage:   a process may have heartbeats although its memory is corrupted. The reader of its data
 *           reports that. The supervisor then kills the process like a silent one, also if the run
 *           is not supervised. A false report is possible. So the first report costs one failure. A
 *           later one counts only after the process has lived for TL_RESTARTS_FORGIVEN (120 s). So
 *           damage alone cannot cause safe hold.
 * Ends:     an end is orderly only if the process announced it (heartbeat.h): the run is over (only
 *           if it has a duration, because an FMU could forge that); the process could not start
 *           before anything had run (the exit code reports that); or the supervisor was asked to
 *           end. Then it asks shadow, config manager, twin, io and recorder, in this order; the
 *           recorder writes the remaining data. Any other end is a failure. It is reported, with
 *           the FMU and its function if a call was running.
 * Restart:  the twin: at once after the first failure; then the pause doubles with each failure
 *           that is not forgiven, from 0.25 s up to 8 s. io and recorder: without limit; after at
 *           most 0.25 s if they were ready before, else with the same doubling pauses. If the
 *           kernel provides no process, that is no failure of the twin; the start is retried with
 *           the same pauses.
 * Log:      a restart loop logs at most one line per minute, with the number of failures since the
 *           line before.
 * Hold:     after a restart loop of the twin (restarts.h), the supervisor starts a twin process in
 *           safe hold: without FMUs; it only records samples. When the time for a retry has come,
 *           that process is replaced by a twin. If that fails, safe hold follows again, for twice
 *           as long.
 * Wait:     the first twin may have to wait while io and recorder run. The watchdogs get keepalives
 *           as long as `wait` reports that. A twin process that only waits does not count as a run:
 *           the twin after it may still refuse to start.
 * Alone:    a twin that fails is not restarted: the run ends with exit code 70. The twin may be
 *           silent for TL_FMU_CALL_TIMEOUT_CALLS times `call_limit`; while it is stopped or traced
 *           (child.h), without limit.
 * Signals:  SIGTERM, SIGINT and SIGHUP (not under nohup) end all. The twin and the recorder are
 *           killed after 6 s, or when all processes together have taken 8 s, but not before 2 s; io
 *           is killed after 1 s. 6 s is 1 s more than the timeout of a hung FMU call
 *           (fmu_call_timeout.h). An FMU may block or catch the signal, so it is sent to the twin
 *           again until the twin has received it. Such an end is orderly: all failures are
 *           forgiven. If asked again after 1 s or later, each process gets 2 s. If the supervisor
 *           is killed, all its processes end.
 * Shadow:   started on order, and asked to end when it is not ordered any more. It is monitored
 *           like the others but not restarted. Its end is reported to the process that ordered it.
 *           Keepalives, restart record, exit code and safe hold do not depend on it. When all end,
 *           it is asked first and killed after 2 s, because none of its data is kept.
 * Manager:  the config manager is started on order and ends when it has no work. After a failure it
 *           is restarted after a pause that doubles from 0.25 s to 8 s, or after 1 s if it is
 *           ordered then. It ends before the twin, and is killed after 2 s. The run, its exit code
 *           and the restart record do not depend on it.
 * Swap:     on order, twin and shadow swap roles with all that belongs to their processes;
 *           keepalives, restart record and status then follow the new twin. If the new twin is
 *           dead, it is started at once. That death is not in the restart record, because the
 *           record counts failures of the live twin only. The old twin continues as the shadow; if
 *           it is dead, it is not restarted.
 * Exchange: on order the recorder is asked to end and another one is started. That is orderly: no
 *           failure, no log line, no event. It also happens after the end of all, if the recorder
 *           that ended left data for another one.
 * Last:     if a recorder fails during the end, or cannot be started then, another one writes the
 *           remaining data: at most two, or one if the recorder had to be killed.
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

/* Must the first twin wait? */
typedef enum tl_wait {
    TL_WAIT_OVER,
    TL_WAIT_BRIEF, /* no process is started meanwhile */
    TL_WAIT_LONG   /* a process in safe hold is started, and replaced when the wait is over */
} tl_wait;

/* Orders, read in each loop. An order applies while it is given; `swap` is executed each time. */
typedef struct tl_orders {
    bool end;            /* end all */
    bool shadow;         /* a shadow is wanted; restarted as long as this is ordered */
    bool config_manager; /* a config manager is wanted; started if there is none */
    bool kill_twin;      /* the twin is late in a swap */
    bool swap;           /* ignored once all end */
    bool recorder;       /* replace the recorder */
    bool soon;           /* an event is expected: the next loop is in 2 ms */
} tl_orders;

typedef struct tl_supervisor_settings {
    bool alone;
    bool has_duration;    /* the run ends after a duration */
    tl_time call_limit;   /* alone: limit of an FMU call, ns */
    tl_time hold_time;    /* first safe hold of a loop; 0: TL_RESTARTS_HOLD (60 s) */
    const char *state;    /* folder of the restart record of one supervisor; NULL: none */
    const char *watchdog; /* the device; NULL: none */
    int watchdog_s;
    tl_heartbeats *beats[TL_MEMBERS]; /* of each member at the start; NULL: no such member */
    void *context;                    /* of the callbacks below; they must not block */

    /* Starts a process (role.h). `start` is valid for a twin. Returns its process id, or 0 and the
     * reason in `error`. */
    pid_t (*begin)(void *context, tl_member which, const tl_start *start, tl_error *error);

    /* Called when a member has ended and is not reaped yet. `reason` may be replaced by a better
     * one. `by_others`: SIGKILL from outside of the run or from the kernel. For a twin, returns the
     * number of the FMU files whose saved state caused the end (restarts.h), else 0. */
    uint64_t (*ended)(void *context, tl_member which, bool by_others, char reason[TL_RESTARTS_REASON]);

    /* Records a failure in the database; it was logged before. Not called for a twin that is
     * restarted, because the start information of the next twin has the reason. */
    void (*tell)(void *context, const char *text);

    /* Returns 0 if the reader of this member's data can continue. Else the data is damaged, and the
     * result is a lower bound of the time of the check that found it (CLOCK_MONOTONIC). */
    tl_time (*damaged)(void *context, tl_member which);

    /* Called for the first twin. NULL: it never waits. */
    tl_wait (*wait)(void *context);

    /* Called in each loop. `ends`: all processes are ending. `orders` is zeroed before. */
    void (*look)(void *context, bool ends, tl_orders *orders);
} tl_supervisor_settings;

/* Runs the processes until all have ended. *stopped (may be NULL): the signal that asked it to end,
 * else 0. Returns the exit code that the twin announced last, or that of the recorder if the twin's
 * is 0; 75 if a process had to be killed at the end; 70 if the twin failed and the run is not
 * supervised. A process that ended last is not reaped; the kernel reaps it when this process ends.
 * Sets SIGCHLD to its default. The caller's other threads must block the signals of
 * tl_supervisor_block_signals(). */
int tl_supervise(const tl_supervisor_settings *settings, int *stopped);

/* Blocks the signals that a supervisor waits for. `before` (may be NULL): the mask until now. */
void tl_supervisor_block_signals(sigset_t *blocked, sigset_t *before);

#endif
