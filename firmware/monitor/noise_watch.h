/* The noise of what is matched, while it is matched: whether a tolerance is below three times of it.
 *
 * Purpose: a lock whose tolerance is within the noise follows the noise, and states behind its outputs may drift for hours. `check --recording` says so of a recording;
 *          this says so of the plant as it is, by the same meter (noise_meter.h), live and in replay by the same samples.
 * Readings: one a tick, as it came (NAME@reading if the signal is conditioned or on a line); rejected ones are not taken.
 * Judged:  at each 256th reading, by the last 2048 to 4096. Told when a tolerance is below for sure, over when it is not below at all.
 * Memory:  its own, 6 KiB for each match. Thread: plain data; one thread at a time.
 */
#ifndef TL_FIRMWARE_MONITOR_NOISE_WATCH_H
#define TL_FIRMWARE_MONITOR_NOISE_WATCH_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/config.h"
#include "firmware/monitor/noise_meter.h"
#include "master/base/signal.h"

enum { TL_NOISE_WATCH_EACH = 256, TL_NOISE_WATCH_MOST = 4096 };

typedef enum tl_noise_turn { TL_NOISE_AS_BEFORE, TL_NOISE_IS_LARGE, TL_NOISE_IS_SMALL } tl_noise_turn;

/* Fields are private. */
typedef struct tl_noise_watch {
    const tl_config *config;
    size_t signal[TL_MAX_MATCH]; /* whose readings are taken; SIZE_MAX: none's */
    tl_time newest[TL_MAX_MATCH];
    bool is_told[TL_MAX_MATCH];
    tl_noise_meter meters[TL_MAX_MATCH];
} tl_noise_watch;

/* The configuration has its further look-ups in use; its tolerances may change later. */
void tl_noise_watch_init(tl_noise_watch *watch, const tl_config *config);

/* A sample, for one match. `sigma`: the noise, if there is a turn. */
tl_noise_turn tl_noise_watch_sample(tl_noise_watch *watch, const tl_sample *sample, size_t match, double *sigma);

#endif
