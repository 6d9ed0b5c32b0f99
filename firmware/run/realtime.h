/* Real-time scheduling where it is permitted, ordinary scheduling where it is not.
 *
 * Purpose: SCHED_FIFO for the cycle thread, memory locked so that no page fault delays it. What is not permitted is said
 *          once, with what would permit it, and the run goes on.
 */
#ifndef TL_FIRMWARE_RUN_REALTIME_H
#define TL_FIRMWARE_RUN_REALTIME_H

#include <pthread.h>

#include "firmware/run/journal.h"

/* mlockall: what is mapped, and what will be where the limit allows it. */
void tl_realtime_lock_memory(tl_journal *journal);

/* From now on `thread` has SCHED_FIFO `priority` (0: ordinary); an event where that is not permitted. */
void tl_realtime_raise(pthread_t thread, int priority, tl_journal *journal);

/* Ordinary scheduling again. */
void tl_realtime_lower(pthread_t thread);

/* The calling thread has touched the next TL_REALTIME_STACK bytes of its stack: what the cycle calls does not fault for pages where memory is
 * not locked. */
enum { TL_REALTIME_STACK = 256 * 1024 };
void tl_realtime_touch_stack(void);

#endif
