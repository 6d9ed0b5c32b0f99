/* Live plant: opens and polls the configured sources, and posts their readings into the sample
 * buffers.
 *
 * Purpose: creates running plant readers from a tl_config. They write the sample memory
 *          (sample_buffer.h). A tl_plant_input reads the same memory.
 * Death:   if an earlier writer died, its sample buffers are repaired and continued.
 * Owner:   tl_live_plant_close() frees all that tl_live_plant_open() allocates; the caller owns the
 *          sample memory.
 * Thread:  open and close from one thread.
 */
#ifndef TL_FIRMWARE_PLANT_LIVE_PLANT_H
#define TL_FIRMWARE_PLANT_LIVE_PLANT_H

#include <limits.h>
#include <stdbool.h>

#include "firmware/config/config.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/heartbeat.h"
#include "master/base/status.h"

typedef struct tl_live_plant tl_live_plant;

/* All kinds of sources. A set of kinds has one bit for each kind (tl_driver_bit()). */
enum { TL_LIVE_PLANT_ALL = INT_MAX };

typedef struct tl_live_plant_settings {
    const tl_config *config;
    unsigned kinds; /* set of kinds that this process opens; other processes open the others */
    const tl_sample_buffer
        *buffers;         /* one per signal, copied; their memory must outlive the plant; no other writer for `kinds` */
    tl_heartbeats *beats; /* each source has a heartbeat there; NULL: none */
    void (*on_link)(void *context, const char *source, bool good, const char *text); /* see plant_reader.h */
    tl_time (*run_start)(void *context); /* see plant_reader.h; NULL: polls are not aligned to ticks */
    void *context;                       /* of both functions */
} tl_live_plant_settings;

/* Opens the sources of `kinds` and starts their threads. The heartbeat of a source times out after
 * two periods, plus hang_s or the time-outs of its poll, whichever is longer. An absent device is
 * not an error: on_link reports it, and the source retries. Errors: TL_BAD_DATA if a signal has no
 * live source; TL_PLANT_DOWN if a source can never work; TL_TRY_AGAIN. */
tl_status tl_live_plant_open(const tl_live_plant_settings *settings, tl_live_plant **plant, tl_error *error);

/* Checks that every signal has a live source, without opening any. Errors: TL_BAD_DATA. */
tl_status tl_live_plant_check(const tl_config *config, tl_error *error);

/* Stops the threads and closes the sources. NULL is allowed. */
void tl_live_plant_close(tl_live_plant *plant);

/* Sets count, limits, look-ups and conditions of all signals, but neither the sample buffers nor
 * the streams that tl_plant_input_open() allocates. */
void tl_live_plant_set_limits(tl_plant_input *input, const tl_config *config);

/* Applies the limits that FMUs declare (tl_config_use_bounds()) to the good values of a recorded
 * sample. A value beyond a limit gets the quality TL_OUT_OF_RANGE. If it is only slightly beyond
 * (tl_plant_limits), it is moved to the limit instead. */
void tl_live_plant_apply_bounds(const tl_config *config, tl_sample *sample);

#endif
