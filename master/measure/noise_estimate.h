/* Noise estimate: variance of the noise of one measurement, separated from the motion of the plant.
 *
 * Purpose: a twin that follows every jump of a noisy measurement is disturbed by noise that the
 *          plant does not have. An error within this variance need not be corrected.
 * Method:  two consecutive second differences of noise with variance σ² have the covariance −4σ².
 *          Those of the plant's motion have almost none, even if its inputs are random. Only new
 *          values count, because a source slower than the twin repeats its last value. The means
 *          decay over about 256 values. Outliers are limited, so that a step of the plant does not
 *          count as noise.
 * Thread:  plain data. Starts as zeros.
 */
#ifndef TL_MASTER_MEASURE_NOISE_ESTIMATE_H
#define TL_MASTER_MEASURE_NOISE_ESTIMATE_H

#include <stdint.h>

#include "master/base/archive.h"

typedef struct tl_noise_estimate {
    double values[2];  /* the newest value and the one before */
    double bend;       /* the newest second difference */
    double square;     /* mean square of the second differences */
    double covariance; /* of each second difference with the one before it */
    uint32_t count;    /* number of new values, at most 256 */
} tl_noise_estimate;

/* Adds the next good measurement; it must be finite. */
void tl_noise_estimate_push(tl_noise_estimate *noise, double value);

void tl_noise_estimate_archive(tl_noise_estimate *noise, tl_archive *archive);

/* σ², in the measurement's unit squared, ≥ 0; 0 until 33 new values have been added. */
double tl_noise_estimate_variance(const tl_noise_estimate *noise);

#endif
