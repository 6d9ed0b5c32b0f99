/* Real-time scheduling where it is permitted, ordinary scheduling where it is not.
 *
 * Purpose: SCHED_FIFO for the cycle thread, memory locked so that no page fault delays it. What is not permitted is said
 *          once, with what would permit it, and the run goes on.
 */
#ifndef TL_FIRMWARE_TWIN_REALTIME_H
#define TL_FIRMWARE_TWIN_REALTIME_H

#include "firmware/twin/journal.h"

/* mlockall: what is mapped, and what will be where the limit allows it. */
void tl_realtime_lock_memory(tl_journal *journal);

/* An event: the cycle's thread did not get its priority. */
void tl_realtime_tell_refused(tl_journal *journal);

/* The calling thread has touched the next TL_REALTIME_STACK bytes of its stack: what the cycle calls does not fault for pages where memory is
 * not locked. */
enum { TL_REALTIME_STACK = 256 * 1024 };
void tl_realtime_touch_stack(void);

#endif
