/* The live plant: the configured sources, opened and polled, posting into the mailboxes of their signals.
 *
 * Purpose: from tl_config to running plant readers; the writing side of the mail (sample_buffer.h). The reading side is a tl_plant_input over the
 *          same memory.
 * Death:   mailboxes that a predecessor has left are mended and gone on with.
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

/* A set of kinds of sources: tl_driver_bit(). */
enum { TL_LIVE_PLANT_ALL = INT_MAX };

typedef struct tl_live_plant_settings {
    const tl_config *config;
    unsigned kinds; /* which sources are opened; other processes open the others */
    const tl_sample_buffer *
        buffers; /* one for each signal, copied; their memory outlives the plant, and those of `kinds` have no other writer */
    tl_heartbeats *beats; /* each source beats there; NULL: nobody listens */
    void (*on_link)(void *context, const char *source, bool up, const char *text);
    void *context;
} tl_live_plant_settings;

/* Errors: TL_BAD_DATA where a signal has no live source, TL_PLANT_DOWN where a source can never work. A device that is
 * merely absent is no error: on_link says so, and it is tried again. A source hangs after hang_s, or after its poll's
 * time-outs if those are longer, and two periods. */
tl_status tl_live_plant_open(const tl_live_plant_settings *settings, tl_live_plant **plant, tl_error *error);

/* Whether every signal has a live source, without opening any. Errors: TL_BAD_DATA. */
tl_status tl_live_plant_check(const tl_config *config, tl_error *error);

/* NULL is allowed. */
void tl_live_plant_close(tl_live_plant *plant);

/* All of an input but its mailboxes and what it opens: the limits by which the configuration judges its signals, and where they are looked up. */
void tl_live_plant_set_limits(tl_plant_input *input, const tl_config *config);

#endif
