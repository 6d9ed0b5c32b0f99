/* Noise estimate of a measurement: see jitter.h. */
#include "master/measure/jitter.h"

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

static void learn(tl_jitter *jitter, double bend) {
    double part = 1.0 / (jitter->count < MEMORY ? jitter->count - 1 : MEMORY);
    double limit = jitter->count > BEGINNING ? FAR * jitter->square : HUGE_VAL;
    jitter->square += part * (within(bend * bend, limit) - jitter->square);
    jitter->covariance += part * (within(bend * jitter->bend, limit) - jitter->covariance);
    jitter->bend = bend;
}

void tl_jitter_push(tl_jitter *jitter, double value) {
    double change = value - jitter->values[0];
    if (jitter->count != 0 && !(fabs(change) > 0.0)) {
        return;
    }
    if (jitter->count >= 2) {
        learn(jitter, change - (jitter->values[0] - jitter->values[1]));
    }
    jitter->count += jitter->count < MEMORY ? 1 : 0;
    jitter->values[1] = jitter->values[0];
    jitter->values[0] = value;
}

double tl_jitter_variance(const tl_jitter *jitter) {
    return jitter->count > BEGINNING ? fmax(jitter->covariance / OF_NOISE, 0.0) : 0.0;
}

void tl_jitter_archive(tl_jitter *jitter, tl_archive *archive) {
    tl_archive_part(archive, jitter, sizeof *jitter);
    const double numbers[] = {jitter->values[0], jitter->values[1], jitter->bend, jitter->square, jitter->covariance};
    tl_archive_require_finite(archive, numbers, sizeof numbers / sizeof numbers[0]);
    tl_archive_require(archive, jitter->count <= MEMORY);
}
