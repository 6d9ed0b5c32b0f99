/* Poll phase: schedules the polls of one source so that they end just before ticks.
 *
 * Purpose: a value is then as young at its tick as the device permits. Without alignment it is up
 *          to one period older, depending on the start of the polls.
 * Method:  polls should end before the instants origin + i·period. If the period divides T_S or is
 *          a multiple of T_S, a poll ends before each tick, or before every n-th. The *lead* is the
 *          time from the start of a poll to its instant. It is computed after each window of 2, 4,
 *          8 … 512 polls from the durations of these polls. It is 0.2 ms longer than the duration d
 *          that minimises d + 3·period·(share of longer durations). d makes each value older. A
 *          poll longer than d ends late, so the tick uses a value that is one period older. This
 *          delay has the weight 3, so that late polls are rare. A duration counts from the planned
 *          start, so it includes a late wake-up. A poll that is longer than the period is not
 *          counted, because no lead makes it end in time.
 * Rate:    at most one poll per instant. Instants missed during a slow poll are skipped.
 * Thread:  pure functions; plain data of the thread of the source.
 */
#ifndef TL_FIRMWARE_PLANT_POLL_PHASE_H
#define TL_FIRMWARE_PLANT_POLL_PHASE_H

#include <stdint.h>

#include "master/base/simtime.h"

enum { TL_POLL_PHASE_WINDOW = 512 };

typedef struct tl_poll_phase {
    tl_time period; /* ns, > 0 */
    tl_time due;    /* instant before which the present poll should end, CLOCK_MONOTONIC */
    tl_time lead;   /* the poll starts this time before `due`, 0 … period */
    /* private: */
    uint32_t window, polls;               /* polls of this window: planned, done */
    tl_time needed[TL_POLL_PHASE_WINDOW]; /* durations of the polls, ns */
} tl_poll_phase;

/* Begins with a poll at `now`. `period`: ns, > 0. */
void tl_poll_phase_begin(tl_poll_phase *self, tl_time period, tl_time now);

/* Call it when the present poll has ended, at `now`. Returns the start of the next poll; it may be
 * in the past if the lead has grown. `origin`: instant of any tick, ns, > 0; 0: not known, so the
 * instants stay as they are; negative: the source is not aligned, so the lead stays 0. */
tl_time tl_poll_phase_next(tl_poll_phase *self, tl_time origin, tl_time now);

#endif
