/* The reaper: makes the kernel forget a child that is dead, so that nobody of a real-time priority has to.
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
#ifndef TL_FIRMWARE_LIVE_REAPER_H
#define TL_FIRMWARE_LIVE_REAPER_H

#include <pthread.h>
#include <stdbool.h>
#include <sys/types.h>

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

#endif
