/* An FMU that gives its whole process a locale with a decimal comma: when it is loaded, initialised and stepped. y follows u by one
 * step, and `commas` counts how often the locale was there to be had. */
#include "fmi2Functions.h"
#include "tests/bench/fmus/frame.h"

#include <locale.h>

typedef struct comma {
    fmi2Real u;      /* input */
    fmi2Real y;      /* output */
    fmi2Real commas; /* output */
} comma;

enum { U, Y, COMMAS };

static const comma defaults = {.u = 0};

const bench_model model = {"{2f0d5a3e-6c0f-4a57-8b58-1f1f3a0b7c11}", sizeof(comma), &defaults};

static double choose_locale(void) {
    return setlocale(LC_ALL, "de_DE.UTF-8") != NULL ? 1.0 : 0.0;
}

__attribute__((constructor)) static void load(void) {
    (void)choose_locale();
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    comma *self = component;
    for (size_t i = 0; i < count; i++) {
        if (references[i] != U) {
            return fmi2Error;
        }
        self->u = values[i];
    }
    (void)choose_locale();
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    const comma *self = component;
    const fmi2Real all[] = {[U] = self->u, [Y] = self->y, [COMMAS] = self->commas};
    for (size_t i = 0; i < count; i++) {
        if (references[i] > COMMAS) {
            return fmi2Error;
        }
        values[i] = all[references[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean is_final) {
    comma *self = component;
    (void)now;
    (void)step;
    (void)is_final;
    self->y = self->u;
    self->commas += choose_locale();
    return fmi2OK;
}
