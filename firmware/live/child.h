/* Child processes of the supervisor: monitoring, killing and reaping.
 *
 * Memory:  the caller owns the objects.
 * Errors:  logged; the functions do not fail.
 * Thread:  the supervisor's.
 */
#ifndef TL_FIRMWARE_LIVE_CHILD_H
#define TL_FIRMWARE_LIVE_CHILD_H

#include <pthread.h>
#include <stdbool.h>
#include <sys/types.h>

#include "firmware/live/restarts.h"
#include "firmware/process/heartbeat.h"
#include "master/base/simtime.h"

/* ---- Reaper: reaps a dead child in a thread of ordinary priority.
 *
 * Purpose: the final waitid() removes the process from /proc. There the kernel busy-waits while
 *          another thread (a dying thread of the child, or a reader of /proc) uses the same
 *          entries. At real-time priority, this busy-wait can stop the other thread until the
 *          kernel throttles real-time threads, or for ever. So a thread of ordinary priority calls
 *          waitid() and then ends.
 * Before:  the caller already knows how the child ended (waitid() with WNOWAIT). Memory, files,
 *          locks and devices of the child are free by then.
 * Restart: the next process of this child starts only when its reaper is idle. The reapers of other
 *          children may be running when the supervisor forks; role.c permits other threads.
 * Thread:  the supervisor's.
 */

/* Zeroed: idle. Fields are private. */
typedef struct tl_reaper {
    pthread_t thread;
    bool works; /* the thread exists */
} tl_reaper;

/* Reaps a child that has ended. The reaper must be idle; the caller must not use the process id any
 * more. If no thread can be created, that is logged, and the dead child stays in the process list
 * until its parent ends. */
void tl_reaper_start(tl_reaper *reaper, pid_t dead);

/* Returns true if the reaper is idle. Does not wait. */
bool tl_reaper_is_idle(tl_reaper *reaper);

/* Detaches the thread if it still runs. Call it before this process ends. */
void tl_reaper_stop(tl_reaper *reaper);

/* ---- Child: a process with a role, monitored by its heartbeats until it has ended.
 *
 * Purpose: detects a silent child, asks a child to end, kills it, and describes its end; the same
 *          for all children. The supervisor (supervisor.h) decides what follows.
 * Trust:   the heartbeats are untrusted. This module limits their numbers, and removes control
 *          characters from the names of FMUs and functions before it logs them.
 * Reaping: never in a thread of real-time priority (see above).
 * Thread:  the supervisor's.
 */

/* How a child ended. */
typedef struct tl_child_end {
    bool known; /* false: the kernel did not report the end */
    bool by_signal;
    int number;                   /* signal number if by_signal, else exit code */
    tl_end_cause announced_cause; /* the child wrote it to its heartbeats before its end */
    int code;                     /* exit code that the child announced with this cause */
} tl_child_end;

/* Before the first start: zeroed, except `beats`. */
typedef struct tl_child {
    tl_heartbeats *beats;    /* in memory that the child writes */
    pid_t pid;               /* 0: none */
    tl_child_end end;        /* of the last process */
    bool asked;              /* the supervisor has asked it to end */
    int signal;              /* signal that was sent when it was asked */
    bool killed;             /* the supervisor has killed it */
    tl_heartbeats_seen seen; /* state of the heartbeats at the last poll */
    tl_reaper reaper;        /* idle: the previous process was reaped */
    /* private */
    char fault[TL_RESTARTS_REASON];
    tl_time blame_after; /* ns; after a kill, an FMU call that lasted at least this long is reported too */
    tl_time asking;      /* ns since the last request to end, without the time in which the supervisor was stopped */
} tl_child;

/* Resets the heartbeats and all states before a start. */
void tl_child_prepare(tl_child *child);

/* Returns true if the child has ended; child->end then describes how. Does not reap it. */
bool tl_child_has_ended(tl_child *child);

/* Kills the child with SIGKILL, unless that was done before. `waited`: ns that the supervisor has
 * waited for the child. The description (tl_child_describe()) also names the FMU call that was
 * running, if that call lasted at least half of `waited`. INT64_MAX: it names no call. `format`
 * gives the reason, which is printed after "the NAME failed: ". */
void tl_child_kill(tl_child *child, tl_time waited, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* Restarts the timeouts of all heartbeats. Call it for a child that is stopped or traced. */
void tl_child_restart_timeouts(tl_child *child);

/* Asks the child to end by sending `signal`. May be called again; each call restarts the grace
 * period (tl_child_kill_late()). */
void tl_child_request_end(tl_child *child, int signal);

/* Returns `passed`, the ns since the last poll, but at most TL_HEARTBEAT_POLL (0.2 s). So the time
 * in which the supervisor was stopped hardly counts. */
tl_time tl_child_passed(tl_time passed);

/* Kills a child that was asked to end if it is still running after `grace` ns. `passed`: ns since
 * the last call. */
void tl_child_kill_late(tl_child *child, tl_time passed, tl_time grace);

/* Call it after the end of the child. Writes how it ended, to be printed after "the NAME failed: ".
 * */
void tl_child_describe(const tl_child *child, char reason[TL_RESTARTS_REASON]);

/* Call it after the end of the child. Returns true if the child announced its end and then ended
 * with the announced exit code. */
bool tl_child_ended_as_announced(const tl_child *child);

/* Gives the child to the reaper; its process id is 0 afterwards. */
void tl_child_reap(tl_child *child);

/* ---- Debugger check: distinguishes a stopped or traced process from a hung one.
 *
 * Purpose: a debugger, Ctrl-Z or `kill -STOP` can stop an FMU process for any length of time. The
 *          kernel reports for each thread whether it is stopped, or traced by another process (gdb,
 *          strace).
 * Cost:    reads a file of /proc for each thread. Call it only for a process that was found silent.
 * Limits:  the function cannot find out which process has stopped `process`: an FMU may have
 *          stopped its own process. If /proc is hidden, the function returns false.
 * Thread:  any.
 */

/* Returns true if a thread of the process with this process id is traced or stopped. */
bool tl_process_is_stopped(pid_t process);

#endif
