/* Recorded samples of the run that is under way, for a twin that begins beside it: a shadow has minutes behind it before it is compared.
 *
 * Purpose: who reads the database makes images of some seconds each, one after the other; who has the twin takes the samples out of them.
 * Run:     the newest one of this boot that is being written; of ticks before it begins, those of the run that it goes on with, which has the same t_start, if
 *          that has the same signals.
 * Image:   as bytes without pointers: a head, and packed ticks (past_ticks.h) of the plant's signals only. It is for the same program and machine only.
 * Trust:   none in the database (history.h), nor in an image: tl_past_samples_read() checks all of it. What is checked may not change any more.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_TWIN_PAST_SAMPLES_H
#define TL_FIRMWARE_TWIN_PAST_SAMPLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/twin/past_ticks.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* In an image at most: reading more takes too long for who records besides. */
enum { TL_PAST_SAMPLES = 5000 };

/* From where the newest are given, if nobody says from which tick on. */
#define TL_PAST_SAMPLES_BEFORE (60 * TL_SECOND)

typedef struct tl_past_samples {
    int64_t first;
    size_t count;
    tl_time start; /* t_start on CLOCK_MONOTONIC */
    tl_recorder_shape shape;
    const unsigned char *ticks; /* in the image */
} tl_past_samples;

/* Into `image`, which has `room` bytes: samples from tick `from` on, up to a hole; below 0: from a minute before the newest on. `boot` is
 * tl_identity_boot(). *size is 0 if there are none. Errors: those of history.h. */
tl_status tl_past_samples_find(const char *path, const char *boot, int64_t from, void *image, size_t room, size_t *size,
                               tl_error *error);

/* `start`: t_start of the run that they must be of. Errors: TL_BAD_DATA: it is no image, or of another run, or of other signals than those of `config`, the run's,
 * whose second look-ups are signals. */
tl_status tl_past_samples_read(const void *image, size_t size, const tl_config *config, tl_time start,
                               tl_past_samples *samples, tl_error *error);

/* One of them, its stamps and instant on CLOCK_MONOTONIC; false: it is none of them. `step` is T_S. */
bool tl_past_samples_at(const tl_past_samples *samples, int64_t tick, tl_time step, tl_sample *sample);

#endif
