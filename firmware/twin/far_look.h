/* A look far from the start: whether the FMUs of a twin come back to where they were, after so many steps, and with inputs that move.
 *
 * Purpose: the proof before the first step sees FMUs at one place, and what some of them forget is of no weight there. A check has time to look further: it goes on with steps of which
 *          the adjusted variables go up and down, or on and off, and after as many of them as it can it asks whether the FMUs come back (tl_twin_look()).
 * Not:     for a twin that adjusts nothing, or has an event horizon: it looks at nothing.
 * Thread:  that of the FMUs. The twin is of no other use afterwards.
 */
#ifndef TL_FIRMWARE_TWIN_FAR_LOOK_H
#define TL_FIRMWARE_TWIN_FAR_LOOK_H

#include <stdint.h>

#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_step.h"
#include "master/base/simtime.h"

enum { TL_FAR_STEPS = 1000 };

#define TL_FAR_LONGEST (TL_SECOND / 2)

typedef struct tl_far_look {
    int64_t first;  /* the tick with which it began */
    int64_t steps;  /* that it took; it ends with the first finding that is not mended, or with an FMU that fails: */
    uint64_t times; /* FMUs were led back and compared */
    tl_twin_look_news news; /* the last finding */
    tl_status status;       /* TL_FMU_FAILED: of what it was given, which says nothing about the rollback */
    tl_error error;
} tl_far_look;

/* Values of the adjusted variables in the `step`-th step, about `nominal`: up and down by the first step of the search, or off and on, each at a pace of its own. */
void tl_far_look_excite(const tl_assembly *assembly, const double nominal[TL_MAX_ADJUST], int64_t step,
                        double u[TL_MAX_ADJUST]);

/* `tick` is the next one of a twin that has begun, none of whose signals has a reading. */
void tl_far_look_take(const tl_assembly *assembly, int64_t tick, tl_far_look *look);

#endif
