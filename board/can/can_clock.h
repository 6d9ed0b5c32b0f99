/* The kernel's receive stamps, which tell the wall clock, as CLOCK_MONOTONIC. Private to the CAN driver.
 *
 * Purpose: a frame's age is what the wall clock says, as long as that makes sense. The wall clock may be set between
 *          the reception of a frame and its reading; but it was received after the queue had last been empty (or after
 *          the frame before it), and before now. So a stamp that leaves this interval is converted as the clock stood
 *          before, and where that leaves it too, is moved to the nearer end.
 * Bound:   with a clock that is set, a stamp is wrong by no more than that interval; it never goes back.
 * Thread:  one; no clock is asked here.
 */
#ifndef TL_BOARD_CAN_CAN_CLOCK_H
#define TL_BOARD_CAN_CAN_CLOCK_H

#include <stdbool.h>

#include "master/base/simtime.h"

/* Zeroed is a beginning. */
typedef struct tl_can_clock {
    tl_time floor; /* CLOCK_MONOTONIC: nothing that comes was received before */
    tl_time ahead; /* wall clock − CLOCK_MONOTONIC, when the queue was last empty */
    bool known;    /* `ahead` is */
} tl_can_clock;

/* The queue is empty: now, by both clocks. */
void tl_can_clock_empty(tl_can_clock *clock, tl_time monotonic, tl_time wall);

/* The stamp of a frame that the kernel received at `received` (wall clock; 0: it does not say), read now. */
tl_time tl_can_clock_stamp(tl_can_clock *clock, tl_time received, tl_time monotonic, tl_time wall);

#endif
