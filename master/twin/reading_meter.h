/* Reading meter: error of a twin at each reading of the plant, at the instant of that reading
 *                between the twin's steps.
 *
 * Purpose: MSE compares the twin with what it was matched with, which may be filtered or
 *          interpolated. This compares it with the readings as they came, so no filter can improve
 *          the figure. The error of a perfect twin is their noise.
 * Between: the twin is interpolated linearly between two steps. If it was reset between them, it
 *          has no value there.
 * Waiting: a reading waits until the step that contains it is committed. A reading of an earlier
 *          step is left out, and so is the oldest one if there is no room.
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

/* `room`: most waiting readings, > 0. NULL if memory is out. */
tl_reading_meter *tl_reading_meter_create(tl_arena *arena, tl_time step, size_t room);

/* Adds the newest reading at a tick; a repeated time is ignored. A rejected one (TL_OUTLIER) counts
 * as left out; others that are not good do not count. */
void tl_reading_meter_see(tl_reading_meter *meter, tl_time time, double value, tl_quality quality, tl_metrics *metrics);

/* Reports the step that ends at `end` with y there. `goes_on`: it continues from the end of the
 * step before. */
void tl_reading_meter_step(tl_reading_meter *meter, tl_time end, double y, bool goes_on, tl_metrics *metrics);

/* Archives all data; the metrics belong to the caller. */
void tl_reading_meter_archive(tl_reading_meter *meter, tl_archive *archive);

#endif
