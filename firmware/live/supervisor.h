/* The supervisor: keeps the processes of a run alive.
 *
 * Purpose: an FMU may hang, or destroy the memory of the process that it is in; a device may take a driver with it, a disk the recorder.
 *          So each is in a process of its own, and this one, which has no FMU, no plant and no database, listens to their heartbeats
 *          (heartbeat.h), ends a process that is silent, begins a new one, and strokes the box's watchdog and systemd's.
 * Members: the *twin* is what the run is for. *io* reads the plant, the *recorder* writes what is to be kept; the twin goes on without them. A *shadow*
 *          is another twin beside it, for as long as it is ordered: see below.
 * Stroked: as long as the twin is alive, and while the supervisor does something about it if not. A dead disk or device resets no box.
 *          Not while a thread of the twin is silent, and no more once even safe hold could not be kept up TL_RESTARTS_MOST times. Nor once a dead
 *          twin has not been reaped for 30 s, or no process could be started for it for about 5 min.
 * Damage:  a process may be well by its heart, and its memory not: what it writes for others is. Who reads that says so, and it is killed and begun again as
 *          one that is silent; alone, too. But who says so may lie: so it costs a process one failure, and further ones only after a life in which the one
 *          before is forgiven. It never leads to safe hold.
 * Ends:    only one that a process announced (heartbeat.h) is orderly: the run is over (if it has a duration: an FMU may have forged the word), or it could not begin before anything ever
 *          ran, which is told to whoever started the supervisor by the exit code; or the supervisor was asked to end, and asked the
 *          processes: the twin first, then io, then the recorder, which writes the rest. Any other end is a failure, which is named, with the FMU and
 *          its function if one was being called.
 * Restart: of what failed. The twin: at once after the first failure; the pause doubles with each that is not forgiven, up to 8 s. io and the
 *          recorder: for ever; after 0.25 s at most if it could do its work before, else with pauses that double as well. If the kernel gives no
 *          process, that is no failure of the twin; it is tried again with the same pauses.
 * Log:     a restart loop writes at most one line a minute, which counts the failures since the line before.
 * Hold:    after a restart loop of the twin (restarts.h) a new one is told to hold: no FMU, the plant's samples are recorded. It is asked to end
 *          when the time for a retry has come; a twin that fails then is followed by safe hold again, for twice as long.
 * Wait:    the first twin may have to wait, while io and recorder live. The watchdogs are stroked meanwhile, for as long as `wait` says so. A twin that
 *          holds only for this time is none that ran: the one after it may still be refused.
 * Alone:   a twin that fails is not begun again: the run ends with exit code 70. It may be silent for longer than its threads say, for
 *          TL_FMU_CALL_TIMEOUT_CALLS times `call_limit`; while it is stopped or traced (child.h) for as long as it likes.
 * Signals: SIGTERM, SIGINT and SIGHUP (but not under nohup) end all. A process that has not ended 6 s
 *          later is killed, a second after it would have given up an FMU that does not return (fmu_call_timeout.h). An FMU may ignore or take the signal that the twin
 *          gets, so it is sent again until the twin has received it. An orderly end in any case: all failures are forgiven.
 *          Asked again after a second, each has 2 s. A supervisor that is killed takes all with it.
 * Shadow:  there on order, and asked to end once it is not ordered any more. Watched as the others are; but it is not begun again by itself, and its end,
 *          of which who orders it is told, is nobody's failure: no stroke, account, exit code or safe hold depends on it. When all end it is the first, and is
 *          killed after 2 s: nothing of it is kept.
 * Activator: begun on order; ends by itself when it has nothing to do. One that failed is begun again after a pause that doubles from 0.25 s to 8 s, or after
 *          1 s if it is ordered then. It ends before the twin, and is killed after 2 s. The run, its exit code and the account do not depend on it.
 * Swap:    twin and shadow change places on order, with all that belongs to their processes: from then on the other one is the twin, and strokes, account and
 *          status are its. One that is dead by then is begun at once; its death is not in the account, which says whether a *run's* twin can live: whoever
 *          died as a shadow has done no run any harm, and if it cannot live as the twin either, that is soon in there. The old twin goes on as the shadow; if it
 *          is dead there is none, and it is not begun again.
 * Anew:    on order the recorder is asked to end, and another one is begun: an orderly change, without a failure, a line or an event. Also after the end of
 *          all, if the one that has ended left something for another one.
 * Rest:    a recorder that fails in the end, or cannot be started then, is followed by another one, which writes the rest: at most twice, once if it
 *          had to be killed.
 */
#ifndef TL_FIRMWARE_LIVE_SUPERVISOR_H
#define TL_FIRMWARE_LIVE_SUPERVISOR_H

#include <signal.h>
#include <stdbool.h>
#include <sys/types.h>

#include "firmware/live/restarts.h"
#include "firmware/process/heartbeat.h"

/* In the order in which they begin. */
typedef enum tl_member {
    TL_MEMBER_RECORDER,
    TL_MEMBER_IO,
    TL_MEMBER_TWIN,
    TL_MEMBER_SHADOW,
    TL_MEMBER_ACTIVATOR,
    TL_MEMBERS
} tl_member;

/* Whether the first twin has to wait. */
typedef enum tl_wait {
    TL_WAIT_OVER,
    TL_WAIT_BRIEF, /* nothing is begun for it */
    TL_WAIT_LONG   /* a twin is begun that holds, and is replaced once the wait is over */
} tl_wait;

/* What is to be done, looked for again and again: an order stands for as long as it is given, but for `swap`, which is obeyed each time. */
typedef struct tl_orders {
    bool end;       /* all shall */
    bool shadow;    /* there shall be one; if it has ended, it is begun again for as long as this is ordered */
    bool activator; /* there shall be one; begun if there is none */
    bool kill_twin; /* it does not do its part in a swap, and shall not be waited for */
    bool swap;      /* not once all end */
    bool recorder;  /* another one shall be begun */
    bool soon;      /* something is about to happen: the next look is in 2 ms */
} tl_orders;

typedef struct tl_supervisor_settings {
    bool alone;
    bool has_duration;    /* the run is over some time by itself */
    tl_time call_limit;   /* alone: how long a call of an FMU may last */
    tl_time hold_time;    /* of the first safe hold of a loop; 0: TL_RESTARTS_HOLD */
    const char *state;    /* a folder for the account of restarts, of one supervisor at a time; NULL: none */
    const char *watchdog; /* the device; NULL: none */
    int watchdog_s;
    tl_heartbeats *beats[TL_MEMBERS]; /* of each, at first; NULL: there is no such member */
    void *context; /* of all below, which are called in the thread of the supervisor, and must not wait */

    /* Starts a process (role.h). `start` is of the twin. 0: it could not be, for the reason in `error`. */
    pid_t (*begin)(void *context, tl_member which, const tl_start *start, tl_error *error);

    /* One has ended, and is not reaped yet. `reason` says why, and may be bettered. `by_others`: somebody beside the run has killed it. Returns, of a twin, the
     * files of its FMUs if a saved state of them was to blame (restarts.h); 0: none was. */
    uint64_t (*ended)(void *context, tl_member which, bool by_others, char reason[TL_RESTARTS_REASON]);

    /* Which one has failed, and why: for the database; on the log it is already. Not of a twin that is followed by another one, which is told by
     * its start why there is one. */
    void (*tell)(void *context, const char *text);

    /* Whoever reads what this one writes has looked at it at this time at the earliest (CLOCK_MONOTONIC), and cannot read it on; 0: it can. */
    tl_time (*damaged)(void *context, tl_member which);

    /* For the first twin. NULL: it never has to wait. */
    tl_wait (*wait)(void *context);

    /* Between two looks. `ends`: all do by now. `orders` is zeroed. */
    void (*look)(void *context, bool ends, tl_orders *orders);
} tl_supervisor_settings;

/* *stopped (NULL: not wanted): the signal by which it was asked to end; 0: it was not. Returns an exit code once no process runs any more: the one that the twin announced at last, or the recorder if that is worse; 75 if a process
 * had to be killed in its end; 70 if the twin failed and was alone. A process that ended last is not reaped, which is done when this one ends. SIGCHLD is
 * as by default from now on. Threads of the caller's must have its signals blocked. */
int tl_supervise(const tl_supervisor_settings *settings, int *stopped);

/* Blocks the signals that a supervisor waits for. `before`: the mask until now; NULL: not wanted. */
void tl_supervisor_block_signals(sigset_t *blocked, sigset_t *before);

#endif
