/* Reading meter: compares y with each raw reading of the plant, at the time of the reading. This
 *                time may lie between two steps of the twin.
 *
 * Purpose: the MSE of the match compares y with a measured value that may be filtered or
 *          interpolated. This module compares y with the raw readings, so no filter can improve the
 *          figure. A perfect twin has the noise of the readings as its error.
 * Between: y is interpolated linearly between two steps. If the twin was reset between them, there
 *          is no y, and the readings there are dropped.
 * Waiting: a reading waits until the step that contains its time is committed. A reading of an
 *          earlier step is dropped. If there is no room, the oldest reading is dropped. Dropped
 *          readings are not counted.
 * Units:   of the output. Times in ns since t_start of the twin; the caller subtracts a delay
 *          between plant and twin.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_TWIN_READING_METER_H
#define TL_MASTER_TWIN_READING_METER_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/twin/metrics.h"

typedef struct tl_reading_meter tl_reading_meter;

/* `step`: macro step T_S, ns, > 0. `room`: most waiting readings, > 0. Returns NULL if memory is
 * out. */
tl_reading_meter *tl_reading_meter_create(tl_arena *arena, tl_time step, size_t room);

/* Adds the newest reading at a tick. A reading that is not later than the previous one is ignored.
 * An outlier (TL_OUTLIER) is only counted, in metrics->left_out. Any other reading that is not good
 * is ignored. */
void tl_reading_meter_add_reading(tl_reading_meter *meter, tl_time time, double value, tl_quality quality,
                                  tl_metrics *metrics);

/* Adds the step that ends at `end` with output `y`, and compares the readings within it.
 * `continues`: the step started from the end of the step before, without a reset. */
void tl_reading_meter_step(tl_reading_meter *meter, tl_time end, double y, bool continues, tl_metrics *metrics);

/* Saves or loads all data (archive.h), but not the metrics, which belong to the caller. */
void tl_reading_meter_archive(tl_reading_meter *meter, tl_archive *archive);

#endif
