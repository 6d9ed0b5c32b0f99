/* Live plant: opens and polls the configured sources, and posts into the sample buffers of their
 * signals.
 *
 * Purpose: creates running plant readers from a tl_config: the writing side of the sample memory
 *          (sample_buffer.h). The reading side is a tl_plant_input on the same memory.
 * Death:   sample buffers of an earlier writer that died are repaired and continued.
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

/* A set of kinds of sources: bits of tl_driver_bit(). */
enum { TL_LIVE_PLANT_ALL = INT_MAX };

typedef struct tl_live_plant_settings {
    const tl_config *config;
    unsigned kinds; /* which sources are opened; other processes open the others */
    const tl_sample_buffer
        *buffers;         /* one per signal, copied; the memory outlives the plant; no other writer for `kinds` */
    tl_heartbeats *beats; /* each source has a heartbeat there; NULL: none */
    void (*on_link)(void *context, const char *source, bool good, const char *text); /* see plant_reader.h */
    void *context;
} tl_live_plant_settings;

/* Opens the sources of `kinds` and starts their threads. Errors: TL_BAD_DATA if a signal has no
 * live source; TL_PLANT_DOWN if a source can never work. An absent device is not an error: on_link
 * reports it, and the source retries. The heartbeat of a source times out after hang_s (or the
 * time-outs of its poll, if those are longer) plus two periods. */
tl_status tl_live_plant_open(const tl_live_plant_settings *settings, tl_live_plant **plant, tl_error *error);

/* Checks that every signal has a live source, without opening any. Errors: TL_BAD_DATA. */
tl_status tl_live_plant_check(const tl_config *config, tl_error *error);

/* Stops the threads and closes the sources. NULL is allowed. */
void tl_live_plant_close(tl_live_plant *plant);

/* Sets all of an input except its sample buffers and what tl_plant_input_open() allocates: the
 * limits of the signals, their look-ups and conditions. */
void tl_live_plant_set_limits(tl_plant_input *input, const tl_config *config);

/* Rates the good values of a recorded sample by the limits that FMUs declare
 * (tl_config_use_bounds()). */
void tl_live_plant_apply_bounds(const tl_config *config, tl_sample *sample);

#endif
