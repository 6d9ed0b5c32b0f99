/* Seeded noise: see noise.h. */
#include "firmware/cli/noise.h"

#include <math.h>

static uint64_t next(tl_noise *noise) {
    noise->state += UINT64_C(0x9e3779b97f4a7c15);
    uint64_t mixed = noise->state;
    mixed = (mixed ^ (mixed >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    mixed = (mixed ^ (mixed >> 27)) * UINT64_C(0x94d049bb133111eb);
    return mixed ^ (mixed >> 31);
}

double tl_noise_uniform(tl_noise *noise) {
    return (double)(next(noise) >> 11) * 0x1p-53;
}

double tl_noise_normal(tl_noise *noise) {
    for (;;) {
        double a = 2.0 * tl_noise_uniform(noise) - 1.0;
        double b = 2.0 * tl_noise_uniform(noise) - 1.0;
        double square = a * a + b * b;
        if (square > 0.0 && square < 1.0) {
            return a * sqrt(-2.0 * log(square) / square);
        }
    }
}
