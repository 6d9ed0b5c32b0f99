/* The clock of the drivers: CLOCK_MONOTONIC, in nanoseconds.
 *
 * Purpose: the one place in board/ that reads it. Stamps of readings are on it, and so is whatever a driver waits for.
 * Range:   0 or more; it never goes back, and nobody can set it.
 * Thread:  any. Errors: none; Linux always has this clock.
 */
#ifndef TL_BOARD_IO_MONOTONIC_H
#define TL_BOARD_IO_MONOTONIC_H

#include "master/base/simtime.h"

tl_time tl_monotonic_now(void);

#endif
