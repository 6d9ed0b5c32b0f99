/* Seeded noise: the same numbers on every machine.
 *
 * Purpose: measurement noise and message times of an emulated plant; C's rand() differs between libraries.
 * Method:  SplitMix64 for uniform bits, Marsaglia's polar method for the normal distribution.
 * Thread:  one generator belongs to one thread.
 */
#ifndef TL_FIRMWARE_CLI_NOISE_H
#define TL_FIRMWARE_CLI_NOISE_H

#include <stdint.h>

/* Any value is a seed. */
typedef struct tl_noise {
    uint64_t state;
} tl_noise;

/* Uniform in [0, 1). */
double tl_noise_uniform(tl_noise *noise);

/* Normal with mean 0 and standard deviation 1. */
double tl_noise_normal(tl_noise *noise);

#endif
