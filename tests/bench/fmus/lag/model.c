/* The cheapest FMU there can be: a first-order lag, dy/dt = rate·(gain·u − y), by one explicit Euler step. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

static const char guid[] = "{8afc033c-0ad5-492f-88e5-4190d15dc096}";

typedef struct lag {
    fmi2Real u;    /* input */
    fmi2Real gain; /* tunable */
    fmi2Real rate; /* fixed, 1/s */
    fmi2Real y;    /* state and output */
} lag;

enum { U, GAIN, RATE, Y };

static const lag defaults = {.gain = 1.0, .rate = 50.0};

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String expected, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name;
    (void)resources;
    (void)callbacks;
    (void)visible;
    (void)logging;
    lag *self = type == fmi2CoSimulation && strcmp(expected, guid) == 0 ? malloc(sizeof *self) : NULL;
    if (self != NULL) {
        *self = defaults;
    }
    return self;
}

void fmi2FreeInstance(fmi2Component component) {
    free(component);
}

fmi2Status fmi2Reset(fmi2Component component) {
    lag *self = component;
    *self = defaults;
    return fmi2OK;
}

/* ---- State ---- */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
    if (*state == NULL) {
        *state = malloc(sizeof(lag));
    }
    if (*state == NULL) {
        return fmi2Error;
    }
    memcpy(*state, component, sizeof(lag));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    memcpy(component, state, sizeof(lag));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
    (void)component;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* ---- A step ---- */

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
