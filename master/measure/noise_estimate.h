/* Noise estimate: variance of the noise of one measurement, separated from the motion of the plant.
 *
 * Purpose: a twin that follows every jump of a noisy measurement is disturbed by noise that the
 *          plant does not have. An error within this variance need not be corrected.
 * Method:  second differences of noise with variance σ² have the covariance −4σ² with the ones
 *          before them; those of a plant, even one with random inputs, have almost none. Only new
 *          values count, because a source slower than the twin repeats its last one. The means
 *          decay over some 256 values. Outliers count little more than usual values, so that a step
 *          of the plant is not taken for noise.
 * Thread:  plain data. Starts as zeros.
 */
#ifndef TL_MASTER_MEASURE_NOISE_ESTIMATE_H
#define TL_MASTER_MEASURE_NOISE_ESTIMATE_H

#include <stdint.h>

#include "master/base/archive.h"

typedef struct tl_noise_estimate {
    double values[2];  /* the newest, and the one before */
    double bend;       /* the newest second difference */
    double square;     /* their mean square */
    double covariance; /* with the ones before them */
    uint32_t count;    /* new values, up to a limit */
} tl_noise_estimate;

/* Adds the next good measurement. */
void tl_noise_estimate_push(tl_noise_estimate *noise, double value);

void tl_noise_estimate_archive(tl_noise_estimate *noise, tl_archive *archive);

/* σ², in the measurement's unit squared, ≥ 0; 0 while it is not known. */
double tl_noise_estimate_variance(const tl_noise_estimate *noise);

#endif
