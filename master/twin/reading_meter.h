/* How far a twin is from each reading of the plant at that reading's own instant, between the twin's steps.
 *
 * Purpose: MSE holds the twin against what it was matched with, which may have been filtered, or lie on a line between readings. This holds it against
 *          the readings themselves as they came, so that no filter can flatter it. A twin that follows the plant exactly is off by their noise.
 * Between: two steps the twin is on the line between what was committed at both ends. Where it began anew between them it is nowhere.
 * Waiting: a reading waits until the step that it falls into is committed. One of a step that was committed before is left out, and so is the oldest if
 *          more wait than there is room for.
 * Units:   of the output. Times in ns since t_start, of the twin: a delay between plant and twin is taken off by who calls.
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

/* For so many readings that wait, > 0. NULL when memory is out. */
tl_reading_meter *tl_reading_meter_create(tl_arena *arena, tl_time step, size_t room);

/* What is known of the newest reading at a tick: the same time as before is no new one. One that was rejected (TL_OUTLIER) is counted as left out; no
 * other that is not good counts. */
void tl_reading_meter_see(tl_reading_meter *meter, tl_time time, double value, tl_quality quality, tl_metrics *metrics);

/* The step that ends at `end` is committed with y there. `goes_on`: from where the step before has ended. */
void tl_reading_meter_step(tl_reading_meter *meter, tl_time end, double y, bool goes_on, tl_metrics *metrics);

/* All that it knows; the metrics are the caller's. */
void tl_reading_meter_archive(tl_reading_meter *meter, tl_archive *archive);

#endif
