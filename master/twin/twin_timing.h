/* Timing of a component: distributions of the durations of its step, save and restore; and the
 *                         choice that follows from them.
 *
 * Purpose: `check` shows what a search costs on this machine. A deadline must allow for the longest
 *          of many executions. TL_KEEP_AUTO keeps states only if that takes less time than to
 *          execute all steps again.
 * Unit:    ns, by the given clock; each value includes one clock reading.
 * Thread:  the twin's. After the measurement, execute no steps of the twin; only query it.
 */
#ifndef TL_MASTER_TWIN_TWIN_TIMING_H
#define TL_MASTER_TWIN_TWIN_TIMING_H

#include <stddef.h>
#include <stdint.h>

#include "master/twin/twin.h"

/* Largest number of rounds. */
enum { TL_TWIN_TIMINGS = 256 };

typedef struct tl_twin_spread {
    tl_time median;
    tl_time high;  /* 99 % are not longer */
    tl_time worst; /* longest */
} tl_twin_spread;

typedef struct tl_twin_timing {
    uint32_t rounds; /* number of rounds of save, step, restore, step; 0: a call failed */
    tl_twin_spread step;
    tl_twin_spread save;
    tl_twin_spread restore;
} tl_twin_timing;

/* Measures a component of a started twin that can save states, with its present inputs. Executes at
 * most TL_TWIN_TIMINGS rounds, at least one. After `longest` ns it starts no further round. Each
 * round starts one macro step after the round before. At the end the component is restored to the
 * state of the start. */
void tl_twin_time_component(tl_twin *twin, size_t component, tl_time (*now)(void *clock), void *clock, tl_time longest,
                            tl_twin_timing *timing);

/* Returns how much longer a search takes for this component with TL_KEEP_NONE: its time divided by
 * that with TL_KEEP_STATES. Assumes that the search uses all evaluations of the budget, but two
 * with the solver secant. timing->rounds must be above 0. */
double tl_twin_part_without_states(const tl_twin *twin, size_t component, const tl_twin_timing *timing);

#endif
