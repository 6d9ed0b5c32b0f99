/* Noise of measured signals: estimates it, and warns if a tolerance is too small for it.
 *
 * Memory: plain data of the caller.
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_MONITOR_NOISE_H
#define TL_FIRMWARE_MONITOR_NOISE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"

/* ---- Noise estimate of a signal from its readings alone, without a model.
 *
 * Method:  each reading is compared with the polynomials through its 2, 4 and 6 neighbours, at
 *          their own uneven stamps. The polynomial's value is a weighted sum of the neighbours.
 *          Divided by √(1 + Σ weights²), each difference has the standard deviation σ of white
 *          noise. The plant's motion contributes less with more neighbours. The estimate is the
 *          smaller of two values: σ with 2 neighbours, and the larger of σ with 4 and σ with 6. If
 *          those with 4 and 6 differ, the plant moves too fast between two readings, and the
 *          estimate is an upper limit.
 * Robust:  for each number of neighbours, σ is the mean of three values: the 50, 60 and 70 %
 *          quantiles of the differences, each divided by the same quantile of |x| for a standard
 *          normal x. So single steps of the plant or bad readings have no effect.
 * Outlier: by Hampel's rule, with the median of five readings: the reading and two on each side. A
 *          reading is an outlier if its distance from that median exceeds two limits. One is
 *          TL_NOISE_OUTLIER times σ; this σ is the one with 2 neighbours, so it includes the
 *          plant's motion. The other is TL_NOISE_OUTLIER times the median distance of the five. The
 *          estimate ignores outliers. A step of the plant is not an outlier because the median
 *          follows it. A sharp turn of the signal is not one, because most of the five readings are
 *          then far from the median.
 * Unit:    that of the signal; stamps in ns of any clock. Errors of the stamps count as noise: a
 *          signal that grows by 1 a second, with stamps that are 10 ms wrong, has an error of 0.01.
 * Bound:   constant time for each reading: about 150 floating-point operations and three
 *          logarithms, and at each 32nd reading a search in a histogram. Less than 1 µs on a PC.
 * Memory:  6 KiB in the struct.
 * Thread:  plain data; one thread at a time.
 */

enum {
    TL_NOISE_ORDERS = 3,  /* order 0, 1, 2: 2, 4 and 6 neighbours */
    TL_NOISE_WINDOW = 7,  /* readings for the highest order */
    TL_NOISE_AROUND = 5,  /* a possible outlier, and two readings on each side */
    TL_NOISE_OUTLIER = 6, /* limit for an outlier, σ */
    TL_NOISE_BINS = 512,  /* four per octave, from 2^−64 to 2^64 */
    TL_NOISE_LEAST = 60   /* differences that an estimate needs */
};

typedef struct tl_noise_point {
    tl_time stamp;
    double value;
} tl_noise_point;

/* Histogram of the differences of one order. */
typedef struct tl_noise_sizes {
    uint32_t none;  /* number of differences of 0, or below all bins */
    uint32_t count; /* number of all differences */
    uint32_t bins[TL_NOISE_BINS];
} tl_noise_sizes;

/* Fields are private. */
typedef struct tl_noise_meter {
    uint32_t most; /* number of differences at which all counts are halved; 0: never */
    bool is_known; /* `scale` is given and does not follow the readings */
    double scale;  /* σ for the outlier limit; 0: not known yet */
    tl_noise_point around[TL_NOISE_AROUND];
    uint32_t around_count;
    tl_noise_point window[TL_NOISE_WINDOW];
    uint32_t window_count;
    uint64_t readings, repeats, outliers;
    tl_noise_sizes sizes[TL_NOISE_ORDERS];
} tl_noise_meter;

/* A noise estimate. */
typedef struct tl_noise_found {
    uint32_t count; /* number of differences */
    double sigma;   /* σ, in the signal's unit; 0: no differences yet, or at least 70 % of them are 0 */
    double by_order[TL_NOISE_ORDERS]; /* σ with 2, 4 and 6 neighbours */
    bool is_enough;                   /* at least TL_NOISE_LEAST differences */
    bool is_too_fast;                 /* the plant moves too fast between two readings: sigma is an upper limit */
} tl_noise_found;

/* `most`: number of differences at which all counts are halved, so that the estimate forgets old
 * ones; at least 2 · TL_NOISE_LEAST. 0: never. */
void tl_noise_meter_init(tl_noise_meter *meter, uint32_t most);

/* Fixes σ of the outlier limit to that of `found`, instead of the readings so far. For a second
 * pass over a recording. */
void tl_noise_meter_use(tl_noise_meter *meter, const tl_noise_found *found);

/* Adds the next good reading. Ignores it if its value is not finite, or if its stamp is not later
 * than the one before, or more than 40 years later. The outlier check needs two later readings: if
 * it checks the reading two before this one, returns true and sets *is_outlier for that reading. */
bool tl_noise_meter_put(tl_noise_meter *meter, tl_time stamp, double value, bool *is_outlier);

/* Computes the estimate from the readings so far. */
void tl_noise_meter_estimate(const tl_noise_meter *meter, tl_noise_found *found);

/* Returns true if the tolerance is certainly below three times the noise: by more than 15 %, the
 * accuracy of the estimate. Returns false if `is_enough` is false or `is_too_fast` is true. */
bool tl_noise_exceeds(const tl_noise_found *found, double tolerance);

/* ---- Noise of matched signals during a run: warns if a tolerance is below three times the noise.
 *
 * Purpose:  if the tolerance is below the noise, the twin follows the noise. States that its
 *           outputs do not show may then drift for hours. `check --recording` reports this for a
 *           recording. This code reports it for the running plant with the same estimate, live and
 *           in replay from the same samples.
 * Readings: at most one new reading per tick, unfiltered, if it is good. If the signal has a
 *           `condition` or is matched with "between": "line", the unfiltered reading is taken from
 *           the extra signal NAME@reading (tl_config_reading_of()). Rejected readings are not good,
 *           so they are left out.
 * Period:   checked at each 256th reading, over the last 2048 to 4096 readings. A tolerance is
 *           reported if it is certainly too small. It is not reported if more than a third of the
 *           readings repeat the value before. The report is cleared when the tolerance is at least
 *           three times the noise.
 * Memory:   6 KiB for each match, in the struct.
 * Thread:   plain data; one thread at a time.
 */

enum { TL_NOISE_WATCH_EACH = 256, TL_NOISE_WATCH_MOST = 4096 };

/* Returns the index of the signal with the unfiltered readings of a match. SIZE_MAX: there is none,
 * the match has no weight or is no Real, or there is an event horizon. */
size_t tl_noise_watch_readings(const tl_config *config, size_t match);

/* IS_LARGE: report that the noise is too large for the tolerance. IS_SMALL: clear this report. */
typedef enum tl_noise_turn { TL_NOISE_AS_BEFORE, TL_NOISE_IS_LARGE, TL_NOISE_IS_SMALL } tl_noise_turn;

/* Fields are private. */
typedef struct tl_noise_watch {
    const tl_config *config;
    size_t signal[TL_MAX_MATCH];  /* whose readings are used; SIZE_MAX: none */
    tl_time newest[TL_MAX_MATCH]; /* stamp of the newest reading; TL_TIME_NEVER: none */
    bool is_reported[TL_MAX_MATCH];
    tl_noise_meter meters[TL_MAX_MATCH];
} tl_noise_watch;

/* Call tl_config_use_lookups() on `config` first, so that the NAME@reading signals exist. `config`
 * must outlive the watch. Its tolerances may change. */
void tl_noise_watch_init(tl_noise_watch *watch, const tl_config *config);

/* Adds a sample for one match. If the result is not AS_BEFORE, *sigma is the noise (standard
 * deviation, in the unit of the signal). */
tl_noise_turn tl_noise_watch_sample(tl_noise_watch *watch, const tl_sample *sample, size_t match, double *sigma);

#endif
