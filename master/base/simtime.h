/* Time as signed 64-bit nanoseconds: 292 years, exact, the same on 32-bit ARM as on x86.
 *
 * Purpose: the only time type of the project. t_i = t_start + i·T_S is computed from the integer i
 *          and never accumulated. Each use names the clock that its values belong to.
 */
#ifndef TL_MASTER_BASE_SIMTIME_H
#define TL_MASTER_BASE_SIMTIME_H

#include <math.h>
#include <stdint.h>

typedef int64_t tl_time; /* ns */

#define TL_SECOND ((tl_time)1000000000)
#define TL_TIME_NEVER INT64_MIN /* no instant, for example: no reading yet, no deadline */

/* Converts seconds to ns, rounded to the nearest. |seconds| must be below 9.2e9. */
static inline tl_time tl_time_of_seconds(double seconds) {
    return (tl_time)llround(seconds * 1e9);
}

static inline double tl_seconds(tl_time time) {
    return (double)time / 1e9;
}

/* t_i = start + i·step (thesis, section 4.2). */
static inline tl_time tl_time_of_step(tl_time start, tl_time step, int64_t index) {
    return start + index * step;
}

#endif
