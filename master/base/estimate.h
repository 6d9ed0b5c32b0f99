/* What something will take that is not done in every step, from what it took.
 *
 * Purpose: as tl_duration_expect(), for what a deadline can keep from being tried at all. What was long once must be tried again, or a
 *          single stall would end it for ever; so it fades while there is no time, by a sixteenth in each step. What is found to be as long all
 *          the same would be late every time it is tried; so each time that happens it fades half as fast from then on.
 */
#ifndef TL_MASTER_BASE_ESTIMATE_H
#define TL_MASTER_BASE_ESTIMATE_H

#include <stdbool.h>

#include "master/base/duration.h"

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
