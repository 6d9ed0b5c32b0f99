/* The live plant: the configured sources, opened and polled, posting into one plant input.
 *
 * Purpose: from tl_config to running plant readers; what `run` sees of the plant.
 * Thread:  open and close from one thread; the input is read by the cycle.
 */
#ifndef TL_FIRMWARE_PLANT_LIVE_PLANT_H
#define TL_FIRMWARE_PLANT_LIVE_PLANT_H

#include <stdbool.h>

#include "firmware/config/config.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/heartbeat.h"
#include "master/base/status.h"

typedef struct tl_live_plant tl_live_plant;

/* Errors: TL_BAD_DATA where a signal has no live source, TL_PLANT_DOWN where a source can never work. A device that is
 * merely absent is no error: on_link says so, and it is tried again. Each source beats in `beats` (NULL: nobody listens). */
tl_status tl_live_plant_open(const tl_config *config, tl_heartbeats *beats,
                             void (*on_link)(void *context, const char *source, bool up, const char *text),
                             void *context, tl_live_plant **plant, tl_error *error);

const tl_plant_input *tl_live_plant_input(const tl_live_plant *plant);

/* Every signal has had a good reading. */
bool tl_live_plant_is_complete(const tl_live_plant *plant);

/* NULL is allowed. */
void tl_live_plant_close(tl_live_plant *plant);

/* The limits by which the configuration judges its signals. */
void tl_live_plant_set_limits(tl_plant_input *input, const tl_config *config);

#endif
