/* Noise estimate of a measurement: see noise_estimate.h. */
#include "master/measure/noise_estimate.h"

#include <math.h>

/* New values over which the means decay, and until they are used. */
enum { MEMORY = 256, BEGINNING = 32 };

/* A change larger than this many mean squares counts as a step of the plant. */
static const double FAR = 9.0;

/* Covariance of neighbouring second differences of noise of variance 1. */
static const double OF_NOISE = -4.0;

static double within(double value, double limit) {
    return fmin(fmax(value, -limit), limit);
}

static void learn(tl_noise_estimate *noise, double bend) {
    double part = 1.0 / (noise->count < MEMORY ? noise->count - 1 : MEMORY);
    double limit = noise->count > BEGINNING ? FAR * noise->square : HUGE_VAL;
    noise->square += part * (within(bend * bend, limit) - noise->square);
    noise->covariance += part * (within(bend * noise->bend, limit) - noise->covariance);
    noise->bend = bend;
}

void tl_noise_estimate_push(tl_noise_estimate *noise, double value) {
    double change = value - noise->values[0];
    if (noise->count != 0 && !(fabs(change) > 0.0)) {
        return;
    }
    if (noise->count >= 2) {
        learn(noise, change - (noise->values[0] - noise->values[1]));
    }
    noise->count += noise->count < MEMORY ? 1 : 0;
    noise->values[1] = noise->values[0];
    noise->values[0] = value;
}

double tl_noise_estimate_variance(const tl_noise_estimate *noise) {
    return noise->count > BEGINNING ? fmax(noise->covariance / OF_NOISE, 0.0) : 0.0;
}

void tl_noise_estimate_archive(tl_noise_estimate *noise, tl_archive *archive) {
    tl_archive_part(archive, noise, sizeof *noise);
    const double numbers[] = {noise->values[0], noise->values[1], noise->bend, noise->square, noise->covariance};
    tl_archive_require_finite(archive, numbers, sizeof numbers / sizeof numbers[0]);
    tl_archive_require(archive, noise->count <= MEMORY);
}
