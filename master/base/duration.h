/* What something is expected to take, from what it took.
 *
 * Purpose: predictions for a deadline. Expected is the longest lately: the last duration, or an earlier longer one that fades
 *          by a sixteenth each time. One slow execution in sixteen must not make every sixteenth prediction wrong.
 * Range:   0 … 1000 s, whatever the clock says: sums of many cannot overflow when a clock jumps.
 */
#ifndef TL_MASTER_BASE_DURATION_H
#define TL_MASTER_BASE_DURATION_H

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

#endif
