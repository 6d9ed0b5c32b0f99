/* The cheapest FMU there can be: a first-order lag, dy/dt = rate·(gain·u − y), by one explicit Euler step. */
#include "fmi2Functions.h"
#include "tests/bench/fmus/frame.h"

typedef struct lag {
    fmi2Real u;    /* input */
    fmi2Real gain; /* tunable */
    fmi2Real rate; /* fixed, 1/s */
    fmi2Real y;    /* state and output */
} lag;

enum { U, GAIN, RATE, Y };

static const lag defaults = {.gain = 1.0, .rate = 50.0};

const bench_model model = {"{8afc033c-0ad5-492f-88e5-4190d15dc096}", sizeof(lag), &defaults};

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    lag *self = component;
    for (size_t i = 0; i < count; i++) {
        switch (references[i]) {
        case U:
            self->u = values[i];
            break;
        case GAIN:
            self->gain = values[i];
            break;
        case RATE:
            self->rate = values[i];
            break;
        default:
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    const lag *self = component;
    for (size_t i = 0; i < count; i++) {
        switch (references[i]) {
        case U:
            values[i] = self->u;
            break;
        case GAIN:
            values[i] = self->gain;
            break;
        case RATE:
            values[i] = self->rate;
            break;
        case Y:
            values[i] = self->y;
            break;
        default:
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean is_final) {
    lag *self = component;
    (void)now;
    (void)is_final;
    self->y += step * self->rate * (self->gain * self->u - self->y);
    return fmi2OK;
}
