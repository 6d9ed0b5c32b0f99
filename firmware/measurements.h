/* The modes of `synchronise.horizon.measurements`: their names, and when a step is computed in each.
 *
 * Purpose: the one list that the configuration, the database and the pages for people share, and the one place that
 *          knows at which tick a step is due.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_MEASUREMENTS_H
#define TL_FIRMWARE_MEASUREMENTS_H

#include <stdint.h>

#include "master/plan.h"

/* The names by tl_measurements, then NULL: "lag", "ahead", "hold". */
extern const char *const tl_measurements_names[];

const char *tl_measurements_name(tl_measurements measurements);

/* The mode of that name; TL_LAG where there is none. NULL is allowed. */
tl_measurements tl_measurements_named(const char *name);

/* The tick at which a step is computed, minus the step; `prediction` is T_P. */
int64_t tl_measurements_delay(tl_measurements measurements, uint32_t prediction);

#endif
