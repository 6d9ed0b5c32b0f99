/* The clock of the appliance: CLOCK_MONOTONIC in nanoseconds.
 *
 * Purpose: the one place that reads it, in the shape tl_budget wants; and the absolute sleep of everything periodic.
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_BASE_CLOCK_H
#define TL_FIRMWARE_BASE_CLOCK_H

#include "master/base/simtime.h"

/* `context` is not used. */
tl_time tl_clock_now(void *context);

/* Sleeps until the instant, or until a signal comes. */
void tl_clock_sleep_until(tl_time instant);

#endif
