/* What it takes to execute a component once, to save its state, and to go back to it: as a distribution.
 *
 * Purpose: what a search costs on this machine is told before it begins (`check`). The longest of many is what a deadline meets.
 * Unit:    ns, by the clock that is handed over; reading it is in each of them.
 * Thread:  the twin's. The twin is of no other use afterwards than to be told of.
 */
#ifndef TL_MASTER_TWIN_TWIN_TIMING_H
#define TL_MASTER_TWIN_TWIN_TIMING_H

#include <stddef.h>
#include <stdint.h>

#include "master/twin/twin.h"

enum { TL_TWIN_TIMINGS = 256 };

typedef struct tl_twin_spread {
    tl_time median;
    tl_time high; /* 99 of 100 are not longer */
    tl_time worst;
} tl_twin_spread;

typedef struct tl_twin_timing {
    uint32_t rounds; /* each: saved, executed, restored, executed; 0: the component cannot, or failed */
    tl_twin_spread step;
    tl_twin_spread save;
    tl_twin_spread restore;
} tl_twin_timing;

/* Of a twin that has begun and whose states are saved, with the inputs as they are; TL_TWIN_TIMINGS rounds, or as many as begin within `longest`, and one at least. It goes on by one step in
 * each, and back to the beginning at the end. */
void tl_twin_time_component(tl_twin *twin, size_t component, tl_time (*now)(void *clock), void *clock, tl_time longest,
                            tl_twin_timing *timing);

#endif
