/* Clock of the drivers: CLOCK_MONOTONIC in nanoseconds.
 *
 * Purpose: the only function in board/ that reads it. Stamps of readings and waiting times of
 *          drivers use it.
 * Range:   0 or more; it never decreases and cannot be set.
 * Thread:  any. Errors: none; Linux always has this clock.
 */
#ifndef TL_BOARD_IO_MONOTONIC_H
#define TL_BOARD_IO_MONOTONIC_H

#include "master/base/simtime.h"

/* Returns the time in ns. Its zero is arbitrary, for example the boot. */
tl_time tl_monotonic_now(void);

#endif
