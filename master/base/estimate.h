/* Durations: measured, expected, and estimates of rare long ones.
 *
 * Thread:  any; pure.
 */
#ifndef TL_MASTER_BASE_ESTIMATE_H
#define TL_MASTER_BASE_ESTIMATE_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/simtime.h"

/* ---- What something is expected to take, from what it took.
 *
 * Purpose: predictions for a deadline. Expected is the longest lately: the last duration, or an earlier longer one that fades
 *          by a sixteenth each time. One slow execution in sixteen must not make every sixteenth prediction wrong.
 * Range:   0 … 1000 s, whatever the clock says: sums of many cannot overflow when a clock jumps.
 */

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

/* ---- What something will take that is not done in every step, from what it took.
 *
 * Purpose: as tl_duration_expect(), for what a deadline can keep from being tried at all. What was long once must be tried again, or a
 *          single stall would end it for ever; so it fades while there is no time, by a sixteenth in each step. What is found to be as long all
 *          the same would be late every time it is tried; so each time that happens it fades half as fast from then on.
 */

/* Half as fast, so often at most: by a 4096th. */
enum { TL_ESTIMATE_PATIENCE = 8 };

typedef struct tl_estimate {
    tl_time most; /* ns, what it is expected to take */
    int patience; /* how often it was tried again in vain, one after the other */
    bool tried;   /* in this step */
    bool rested;  /* before it was tried last */
} tl_estimate;

static inline void tl_estimate_took(tl_estimate *estimate, tl_time took) {
    if (estimate->rested) {
        bool vain = took > estimate->most;
        estimate->patience = !vain ? 0 : estimate->patience + (estimate->patience < TL_ESTIMATE_PATIENCE);
        estimate->rested = false;
    }
    estimate->most = tl_duration_expect(estimate->most, took);
    estimate->tried = true;
}

/* A step has ended in which there was no time for something. */
static inline void tl_estimate_rest(tl_estimate *estimate) {
    if (!estimate->tried) {
        estimate->most -= estimate->most >> (4 + estimate->patience);
        estimate->rested = true;
    }
}

#endif
