/* Durations: measured and expected ones, for operations that must meet a deadline.
 *
 * Thread:  any; pure.
 */
#ifndef TL_MASTER_BASE_ESTIMATE_H
#define TL_MASTER_BASE_ESTIMATE_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/simtime.h"

/* ---- Expected duration of an operation that runs often.
 *
 * Purpose: predictions for a deadline. The estimate is the longest recent duration: the last one,
 *          or an earlier longer one that decays by 1/16 each time. So the prediction stays high for
 *          some time after a slow execution.
 * Range:   0 … 1000 s, also if the clock jumps: sums of many durations cannot overflow.
 */

/* Time between two readings of a clock, ns, limited to 0 … 1000 s. */
static inline tl_time tl_duration(tl_time begun, tl_time ended) {
    const tl_time longest = 1000 * TL_SECOND;
    if (ended <= begun) {
        return 0;
    }
    return ended - longest > begun ? longest : ended - begun;
}

/* Decays an expected duration once, by 1/16. */
static inline tl_time tl_duration_fade(tl_time expected) {
    return expected - expected / 16;
}

/* Expected duration after an execution that took `took`, ns. */
static inline tl_time tl_duration_expect(tl_time expected, tl_time took) {
    tl_time faded = tl_duration_fade(expected);
    return took > faded ? took : faded;
}

/* first + times·each; none of them is negative. Saturates at INT64_MAX. */
static inline tl_time tl_duration_sum(tl_time first, tl_time each, uint64_t times) {
    bool fits = each == 0 || times <= (uint64_t)((INT64_MAX - first) / each);
    return fits ? first + (tl_time)times * each : INT64_MAX;
}

/* ---- Expected duration of an operation that a deadline can suppress.
 *
 * Purpose: an operation that was slow once must be retried, or one stall would disable it for ever.
 *          So the estimate decays by 1/16 in each step in which there is no time for the operation.
 *          If the operation is always slow, each retry misses a deadline. So each failed retry
 *          halves the rate of decay.
 */

/* The rate of decay is halved at most this often: to 1/4096. */
enum { TL_ESTIMATE_PATIENCE = 8 };

typedef struct tl_estimate {
    tl_time most; /* ns: expected duration */
    int patience; /* failed retries in a row: each took longer than expected; at most TL_ESTIMATE_PATIENCE */
    bool tried;   /* it ran in this step; the caller clears it at the start of a step */
    bool rested;  /* it has been suppressed since it last ran, so that its next run is a retry */
} tl_estimate;

/* Notes that the operation ran in this step and took `took`, ns. */
static inline void tl_estimate_took(tl_estimate *estimate, tl_time took) {
    if (estimate->rested) {
        bool vain = took > estimate->most;
        estimate->patience = !vain ? 0 : estimate->patience + (estimate->patience < TL_ESTIMATE_PATIENCE);
        estimate->rested = false;
    }
    estimate->most = tl_duration_expect(estimate->most, took);
    estimate->tried = true;
}

/* Call it after a step in which there was no time for the operation. No effect if it ran. */
static inline void tl_estimate_rest(tl_estimate *estimate) {
    if (!estimate->tried) {
        estimate->most -= estimate->most >> (4 + estimate->patience);
        estimate->rested = true;
    }
}

#endif
