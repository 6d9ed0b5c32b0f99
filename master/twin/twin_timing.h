/* Timing of a component: its step, the save of its state, and its restore, as distributions.
 *
 * Purpose: `check` shows what a search costs on this machine. A deadline must allow for the longest
 *          of many.
 * Unit:    ns, by the given clock; each value includes one reading of it.
 * Thread:  the twin's. Afterwards the twin can only be queried.
 */
#ifndef TL_MASTER_TWIN_TWIN_TIMING_H
#define TL_MASTER_TWIN_TWIN_TIMING_H

#include <stddef.h>
#include <stdint.h>

#include "master/twin/twin.h"

enum { TL_TWIN_TIMINGS = 256 };

typedef struct tl_twin_spread {
    tl_time median;
    tl_time high; /* 99 % are not longer */
    tl_time worst;
} tl_twin_spread;

typedef struct tl_twin_timing {
    uint32_t rounds; /* each: save, step, restore, step; 0: not possible, or failed */
    tl_twin_spread step;
    tl_twin_spread save;
    tl_twin_spread restore;
} tl_twin_timing;

/* For a started twin whose states are saved, with its present inputs: TL_TWIN_TIMINGS rounds, or
 * those that start within `longest`, at least one. Each round continues by one step; at the end the
 * twin is restored to the start. */
void tl_twin_time_component(tl_twin *twin, size_t component, tl_time (*now)(void *clock), void *clock, tl_time longest,
                            tl_twin_timing *timing);

#endif
