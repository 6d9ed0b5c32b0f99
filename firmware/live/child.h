/* Child processes of the supervisor: starting, reaping, looking at them.
 *
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

/* ---- The reaper: makes the kernel forget a child that is dead, so that nobody of a real-time priority has to.
 *
 * Purpose: the last wait for a dead process takes its entries out of /proc. The kernel spins there while somebody else is half-way
 *          through the same: a thread of the dead process that is not quite gone, or whoever was reading about it. A spin at a
 *          real-time priority, on the processor that the other one needs, lasts until the kernel throttles it, or for ever. So a
 *          thread of ordinary priority waits, and lives for no longer than that.
 * Before:  whoever has a child reaped knows already how it ended (waitid() with WNOWAIT). Memory, files, locks and devices of the
 *          child are free by then.
 * fork():  only while the reaper rests, since the process has one thread then.
 * Thread:  the supervisor's.
 */

/* Zeroed: it rests. Fields are private. */
typedef struct tl_reaper {
    pthread_t thread;
    bool works; /* there is a thread */
} tl_reaper;

/* A child that has ended, while the reaper rests; its number means nothing any more. Where no thread can be had, that is said on the
 * log, and the dead child stays in the list of processes until its parent ends. */
void tl_reaper_take(tl_reaper *reaper, pid_t dead);

/* False while it works. Does not wait. */
bool tl_reaper_rests(tl_reaper *reaper);

/* The process ends: nobody asks any more. */
void tl_reaper_leave(tl_reaper *reaper);

/* ---- A child of the supervisor: a process with a role, watched by its heartbeats until it has ended.
 *
 * Purpose: one child is silent, is killed, is told to end, has ended, and why: the same for all of them. What follows from it is
 *          the supervisor's to decide (supervisor.h).
 * Trust:   what is in its heartbeats may be a lie. Numbers are bounded, names are shown without control characters.
 * Reaping: no thread of a real-time priority does it (child.h).
 * Thread:  the supervisor's.
 */

/* How a child ended. */
typedef struct tl_child_end {
    bool known;
    bool by_signal;
    int number; /* of the signal, or the exit code */
    tl_end_cause farewell;
    int code; /* announced */
} tl_child_end;

/* A zeroed one with heartbeats is none yet. */
typedef struct tl_child {
    tl_heartbeats *beats; /* in memory that it writes */
    pid_t pid;            /* 0: none */
    tl_child_end end;     /* of the last one */
    bool asked;           /* it was asked to end, */
    int signal;           /* by this signal */
    bool killed;          /* by us */
    tl_heartbeats_seen seen;
    tl_reaper reaper; /* rests once the one before is reaped */
    /* private */
    char fault[TL_RESTARTS_REASON];
    tl_time blamed; /* the FMU call that is to blame has lasted for so long */
    tl_time asking; /* what has passed since it was asked to end the last time, of its life */
} tl_child;

/* Before it is started: nothing was heard of it. */
void tl_child_prepare(tl_child *child);

/* True: it has ended, and child->end says how. It is not reaped. */
bool tl_child_has_ended(tl_child *child);

/* Kills it, if that was not done, after so long a wait (INT64_MAX: no FMU call is to blame). The text says why, as a sentence that begins with "it". */
void tl_child_kill(tl_child *child, tl_time waited, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* It may be silent for as long again. */
void tl_child_let_be(tl_child *child);

/* Asks it to end, each time anew, and gives it as much time again. */
void tl_child_ask(tl_child *child, int signal);

/* Time between two looks as a patience counts it: without what this process was stopped. */
tl_time tl_child_passed(tl_time passed);

/* `passed` of its life since the last look. Asked to end, and still there after `grace`, it is killed. */
void tl_child_press(tl_child *child, tl_time passed, tl_time grace);

/* After its end: why, as a sentence that begins with "it". */
void tl_child_describe(const tl_child *child, char reason[TL_RESTARTS_REASON]);

/* The same: it said that it would end, and then did as it had said. */
bool tl_child_kept_its_word(const tl_child *child);

/* Has it reaped; its number is nobody's any more. */
void tl_child_bury(tl_child *child);

/* ---- Somebody who looks at a process: it is silent because he holds it, and not because it hangs.
 *
 * Purpose: who debugs an FMU stops its process for as long as he likes, and so does Ctrl-Z or `kill -STOP`. That is told from a hang by what the kernel says of
 *          each thread: that it is stopped, or that another process traces it (gdb, strace).
 * Cost:    some files of /proc for each thread: for who has found the process silent, not for each look.
 * Limits:  who has stopped it is not known: an FMU may have stopped its own process. If the kernel hides /proc, nobody looks.
 * Thread:  any.
 */

/* A thread of this process is traced or stopped. */
bool tl_onlooker_holds(pid_t process);

#endif
