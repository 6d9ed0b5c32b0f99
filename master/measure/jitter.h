/* How much a measurement jitters: its noise, as far as it can be told from what the plant does.
 *
 * Purpose: a twin that is made to follow every jump of a noisy measurement is pushed about by noise that the plant never
 *          felt; what cannot be known better than to this variance need not be corrected any further.
 * Method:  second differences of noise of variance σ² have the covariance −4σ² with the ones before them; those of a plant,
 *          even one that is pushed about at random, have next to none. Only values that are new count: a source slower than
 *          the twin repeats its last. The means fade over some 256 of them, and what is far beyond them counts as little
 *          more, so that a step of the plant is not taken for noise.
 * Thread:  plain data. All zeros is the beginning.
 */
#ifndef TL_MASTER_MEASURE_JITTER_H
#define TL_MASTER_MEASURE_JITTER_H

#include <stdint.h>

#include "master/base/archive.h"

typedef struct tl_jitter {
    double values[2];  /* the newest, and the one before */
    double bend;       /* the newest second difference */
    double square;     /* their mean square */
    double covariance; /* with the ones before them */
    uint32_t count;    /* new values, up to what matters */
} tl_jitter;

/* The next good measurement. */
void tl_jitter_push(tl_jitter *jitter, double value);

void tl_jitter_archive(tl_jitter *jitter, tl_archive *archive);

/* σ², in the measurement's unit squared, ≥ 0; 0 while nothing is known. */
double tl_jitter_variance(const tl_jitter *jitter);

#endif
