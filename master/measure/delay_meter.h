/* Delay meter: measures by how much a simulated output lags behind its measurement.
 *
 * Purpose: measures Δo, the delay of the measured outputs (eq. 4.15), if the dead times and cycles
 *          that cause it are not known.
 * Method:  the correlation coefficient of y and ŷ for every lag of −N … N steps over a decaying
 *          window. The delay is the lag of its maximum, interpolated by a parabola. Readings of ŷ
 *          count at their own stamps and are interpolated to the instants of y. Gain and offset
 *          between y and ŷ have no effect.
 * Window:  the last TL_DELAY_MEMORY steps in which y moved. Steps in which y is constant contain no
 *          information. They are left out, and older information does not decay during them.
 * Confidence: 0 … 1. It is low if one of these is true: the coefficient is low; the standard
 *             deviation of the lag is not small against a step; another peak is about as high
 *             (periodic signals); there are few steps. The standard deviation follows from the
 *             residual noise and the sharpness of the peak. If the maximum is at −N or N, the
 *             confidence is 0.
 * Result:  known after 2·N + 1 steps with a steady value and a confidence ≥ 0.7. A known delay
 *          changes only if the measured one moves by more than 3/4 of a step and is again confident
 *          and steady. If the confidence falls below 0.4, the state is lost, but the delay stays in
 *          use.
 * Bound:   O(N) per step. Memory: the arena, at start-up. Thread: the twin's.
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
    bool known;        /* a delay is in use */
    bool lost;         /* the confidence has fallen below 0.4 */
    tl_time delay;     /* ns, in use: y at t belongs to ŷ at t − delay; 0 if not known */
    tl_time newest;    /* ns, as measured now */
    double confidence; /* 0 … 1, of `newest` */
} tl_delay_measured;

/* `lags`: N, 1 … TL_DELAY_LAGS. `step`: T_S, ns. `late`: largest number of steps by which a reading
 * may be added before or after the y of its instant. Returns NULL if memory is out. */
tl_delay_meter *tl_delay_meter_create(tl_arena *arena, uint32_t lags, tl_time step, size_t late);

/* Adds a reading of ŷ. `stamp`: ns since t_0. A repeated reading is ignored. A reading that is not
 * good interrupts the series: no values are interpolated across it. */
void tl_delay_meter_see(tl_delay_meter *meter, tl_time stamp, double value, bool good);

/* Adds y at t_j, j = 1, 2, …. `free`: the step that ends at t_j was not corrected. A corrected y
 * follows ŷ with the delay in use, so it shows no other delay. So a step counts only after N free
 * steps in a row. */
void tl_delay_meter_step(tl_delay_meter *meter, int64_t j, double y, bool free);

tl_delay_measured tl_delay_meter_get(const tl_delay_meter *meter);

/* Saves or loads all data. */
void tl_delay_meter_archive(tl_delay_meter *meter, tl_archive *archive);

#endif
