/* An FMU that has work to do: a forced Van der Pol oscillator, 100 inner steps a macro step.
 *
 * dx/dt = omega·v, dv/dt = omega·(mu·(1 − x²)·v − x + u), by semi-implicit Euler.
 */
#include "fmi2Functions.h"
#include "tests/bench/fmus/frame.h"

typedef struct oscillator {
    fmi2Real u;     /* input */
    fmi2Real mu;    /* tunable */
    fmi2Real omega; /* fixed, rad/s */
    fmi2Real x;     /* state and output */
    fmi2Real v;     /* state */
} oscillator;

enum { U, MU, OMEGA, Y };

enum { INNER_STEPS = 100 };

static const oscillator defaults = {.mu = 1.0, .omega = 10.0, .x = 1.0};

const bench_model model = {"{1e61de17-6891-403f-b58e-7005d2c5d3fd}", sizeof(oscillator), &defaults};

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    oscillator *self = component;
    for (size_t i = 0; i < count; i++) {
        switch (references[i]) {
        case U:
            self->u = values[i];
            break;
        case MU:
            self->mu = values[i];
            break;
        case OMEGA:
            self->omega = values[i];
            break;
        default:
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    const oscillator *self = component;
    for (size_t i = 0; i < count; i++) {
        switch (references[i]) {
        case U:
            values[i] = self->u;
            break;
        case MU:
            values[i] = self->mu;
            break;
        case OMEGA:
            values[i] = self->omega;
            break;
        case Y:
            values[i] = self->x;
            break;
        default:
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean is_final) {
    oscillator *self = component;
    double angle = self->omega * step / INNER_STEPS;
    double x = self->x;
    double v = self->v;
    (void)now;
    (void)is_final;
    for (int i = 0; i < INNER_STEPS; i++) {
        v += angle * (self->mu * (1.0 - x * x) * v - x + self->u);
        x += angle * v;
    }
    self->x = x;
    self->v = v;
    return fmi2OK;
}
