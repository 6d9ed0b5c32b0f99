/* A delay meter: by how much a simulated output is later than the measurement of the same, found from both.
 *
 * Purpose: Δo where nobody knows the dead times and cycles that it is made of.
 * Method:  the correlation coefficient of y and ŷ for every lag of −N … N steps, over a window that fades; the lag of its
 *          largest value, between steps by a parabola. Readings of ŷ count at their own stamps, and are interpolated to the
 *          instants of y. Gain and offset between y and ŷ do not matter.
 * Window:  the last TL_DELAY_MEMORY steps in which y moved. A step around which it stands still tells nothing of a delay: it is
 *          left out, and what was learned before does not fade.
 * Confidence: 0 … 1. It falls where the coefficient is low, where the lag's standard deviation (of white noise, from what is
 *          left beside the coefficient, and from how sharp its peak is) is not small against a step, where another peak is
 *          about as high (periodic signals), where there are few steps, and it is 0 at the end of the range.
 * Result:  known when it was sure (≥ 0.7) and steady for 2·N + 1 steps; what is in force then changes only when the lag has moved by
 *          more than 3/4 of a step, sure and steady again. Below 0.4 it is lost; what is in force stays.
 * Bound:   O(N) a step. Memory: the arena, at start-up. Thread: the twin's.
 */
#ifndef TL_MASTER_MEASURE_DELAY_METER_H
#define TL_MASTER_MEASURE_DELAY_METER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/simtime.h"
#include "master/plan/plan.h"

enum { TL_DELAY_MEMORY = 512 /* steps */ };

typedef struct tl_delay_meter tl_delay_meter;

typedef struct tl_delay_measured {
    bool known;        /* there is a delay in force */
    bool lost;         /* and nothing is sure any more */
    tl_time delay;     /* in force: y at t belongs to ŷ at t − delay; 0 where not known */
    tl_time newest;    /* as it looks now, sure or not */
    double confidence; /* 0 … 1, of that */
} tl_delay_measured;

/* `lags` is N, 1 … TL_DELAY_LAGS; `step` is T_S; `late`: by so many steps at most readings come before the y of their instant, or after. NULL
 * when memory is out. */
tl_delay_meter *tl_delay_meter_create(tl_arena *arena, uint32_t lags, tl_time step, size_t late);

/* A reading of ŷ: when it was read, from t_0 on. The same one again is not another; one that is not good breaks the row. */
void tl_delay_meter_see(tl_delay_meter *meter, tl_time stamp, double value, bool good);

/* y at t_j, j = 1, 2, …; `free`: nothing was corrected in the step before it. A twin that is corrected follows ŷ as it is paired, and
 * says nothing but that: steps count again when N of them in a row were free. */
void tl_delay_meter_step(tl_delay_meter *meter, int64_t j, double y, bool free);

tl_delay_measured tl_delay_meter_get(const tl_delay_meter *meter);

/* All that it has learned. */
void tl_delay_meter_archive(tl_delay_meter *meter, tl_archive *archive);

#endif
