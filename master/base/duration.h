/* What something is expected to take, from what it took.
 *
 * Purpose: predictions for a deadline. Expected is the longest lately: the last duration, or an earlier longer one that fades
 *          by a sixteenth each time. One slow execution in sixteen must not make every sixteenth prediction wrong.
 * Range:   0 … 1000 s, whatever the clock says: sums of many cannot overflow when a clock jumps.
 */
#ifndef TL_MASTER_BASE_DURATION_H
#define TL_MASTER_BASE_DURATION_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/simtime.h"

/* Between two readings of a clock. */
static inline tl_time tl_duration(tl_time begun, tl_time ended) {
    const tl_time longest = 1000 * TL_SECOND;
    if (ended <= begun) {
        return 0;
    }
    return ended - longest > begun ? longest : ended - begun;
}

static inline tl_time tl_duration_fade(tl_time expected) {
    return expected - expected / 16;
}

static inline tl_time tl_duration_expect(tl_time expected, tl_time took) {
    tl_time faded = tl_duration_fade(expected);
    return took > faded ? took : faded;
}

/* `first`, and so many times `each`; none is below 0. INT64_MAX stands for all that is more. */
static inline tl_time tl_duration_sum(tl_time first, tl_time each, uint64_t times) {
    bool fits = each == 0 || times <= (uint64_t)((INT64_MAX - first) / each);
    return fits ? first + (tl_time)times * each : INT64_MAX;
}

#endif
