/* Real-time scheduling where it is permitted, ordinary scheduling where it is not.
 *
 * Purpose: SCHED_FIFO for the cycle thread, memory locked so that no page fault delays it. What is not permitted is said
 *          once, with what would permit it, and the run goes on.
 */
#ifndef TL_FIRMWARE_REALTIME_H
#define TL_FIRMWARE_REALTIME_H

#include <pthread.h>

#include "firmware/journal.h"

/* mlockall: what is mapped, and what will be where the limit allows it. */
void tl_realtime_lock_memory(tl_journal *journal);

/* Starts a thread with SCHED_FIFO `priority` (0: ordinary). 0 or an errno. */
int tl_realtime_start(pthread_t *thread, int priority, void *(*run)(void *), void *context, tl_journal *journal);

#endif
