/* The noise of measured signals: an estimate, and a warning if it differs from what is configured.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_MONITOR_NOISE_H
#define TL_FIRMWARE_MONITOR_NOISE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"

/* ---- How noisy the readings of a signal are, as told by these alone: no model, no truth.
 *
 * Idea:    each reading is held against the polynomial through its neighbours, by their own uneven stamps: 2, 4 and 6 of them. What is left of white noise has the noise's own
 *          standard deviation once it is divided by √(1 + Σ weights²), whatever the order; what is left of the plant's motion becomes less with each order. So the noise is what is
 *          left by 2, or what is left by more if that is less. If 4 and 6 do not agree, the plant moves too fast between two readings to tell: then it is told at most.
 * Robust:  of each order's distances three quantiles are taken (50, 60 and 70 %), so that a step of the plant, or a bad reading, here and there counts for nothing.
 * Outlier: a reading that is more than TL_NOISE_OUTLIER σ (by 2 neighbours, so with the plant's motion) off the median of the five around it, and as many times as far as these are
 *          from their median on the whole (Hampel's rule). It is left out of all windows after that. A step is none, since the median goes with it, nor is a sharp
 *          turn of the plant, since all five are far from their median there.
 * Unit:    of the signal; stamps in ns, of any clock. What is found includes what is wrong about the stamps: a speed that grows by 1 a second and is stamped 10 ms wrong is 0.01 off.
 * Cost:    constant: some 150 floating-point operations, three logarithms and, each 32nd time, a walk along two histograms; under a microsecond on a PC.
 * Memory:  its own, 6 KiB. Thread: plain data; one thread at a time.
 */

enum {
    TL_NOISE_ORDERS = 3,  /* by 2, 4 and 6 neighbours */
    TL_NOISE_WINDOW = 7,  /* readings of the widest */
    TL_NOISE_AROUND = 5,  /* readings by which an outlier is known, */
    TL_NOISE_OUTLIER = 6, /* if it is off by more σ than that */
    TL_NOISE_BINS = 512,  /* four an octave, from 2^−64 to 2^64 */
    TL_NOISE_LEAST = 60   /* distances that are needed to tell anything */
};

typedef struct tl_noise_point {
    tl_time stamp;
    double value;
} tl_noise_point;

/* Distances of one order, by size. */
typedef struct tl_noise_sizes {
    uint32_t none; /* of no size, or below all bins */
    uint32_t count;
    uint32_t bins[TL_NOISE_BINS];
} tl_noise_sizes;

/* Fields are private. */
typedef struct tl_noise_meter {
    uint32_t most; /* distances, half of which are forgotten then; 0: none ever is */
    bool is_known; /* the scales are given, and do not follow what comes */
    double scale;  /* by which an outlier is known; 0: none yet */
    tl_noise_point around[TL_NOISE_AROUND];
    uint32_t around_count;
    tl_noise_point window[TL_NOISE_WINDOW];
    uint32_t window_count;
    uint64_t readings, repeats, outliers;
    tl_noise_sizes sizes[TL_NOISE_ORDERS];
} tl_noise_meter;

/* What is known of the noise. */
typedef struct tl_noise_found {
    uint32_t count;                   /* distances */
    double sigma;                     /* 0: each reading is where its neighbours say, to the last bit */
    double by_order[TL_NOISE_ORDERS]; /* the same by 2, 4 and 6 neighbours */
    bool is_enough;                   /* TL_NOISE_LEAST and more */
    bool is_too_fast;                 /* the plant, between two readings: the noise is sigma at most */
} tl_noise_found;

/* `most` is what it goes by at last, if the noise may change: 0: all; else at least 2 · TL_NOISE_LEAST. */
void tl_noise_meter_init(tl_noise_meter *meter, uint32_t most);

/* Outliers are known by these from now on, rather than by what comes: for who looks at a recording a second time. */
void tl_noise_meter_know(tl_noise_meter *meter, const tl_noise_found *found);

/* The next good reading. One that is not later than the one before, or more than 40 years later, or no finite number, is passed over. True: the second last one before it was judged. */
bool tl_noise_meter_put(tl_noise_meter *meter, tl_time stamp, double value, bool *is_outlier);

void tl_noise_meter_tell(const tl_noise_meter *meter, tl_noise_found *found);

/* Whether a tolerance is below three times the noise, for sure: 15 % is what the noise is known to. */
bool tl_noise_exceeds(const tl_noise_found *found, double tolerance);

/* ---- The noise of what is matched, while it is matched: whether a tolerance is below three times of it.
 *
 * Purpose: a lock whose tolerance is within the noise follows the noise, and states behind its outputs may drift for hours. `check --recording` says so of a recording;
 *          this says so of the plant as it is, by the same meter (above), live and in replay by the same samples.
 * Readings: one a tick, as it came (NAME@reading if the signal is conditioned or on a line); rejected ones are not taken.
 * Judged:  at each 256th reading, by the last 2048 to 4096. Told when a tolerance is below for sure, over when it is not below at all.
 * Memory:  its own, 6 KiB for each match. Thread: plain data; one thread at a time.
 */

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
