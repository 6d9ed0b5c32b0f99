/* An FMU with limits. If u is above LIMIT, a step returns the fmi2Status REFUSES (default 0), and y
 * is NaN. From second NAN_FROM to NAN_TO y is NaN too. Its variables and its other functions are
 * those of fmus/lag. */
#include <math.h>
#include <stdbool.h>

#include <fmi2Functions.h>

#include "description.h"
#include "fmus/common/model.h"

#ifndef LIMIT
#define LIMIT 1e9
#endif
#ifndef REFUSES
#define REFUSES 0
#endif
#ifndef NAN_FROM
#define NAN_FROM 1e9
#endif
#ifndef NAN_TO
#define NAN_TO 1e9
#endif

/* The functions of fmus/common, renamed by other_do_step.h and other_get_real.h. */
fmi2Status own_do_step(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior);
fmi2Status own_get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                        fmi2Real values[]);

enum { Y = 1 }; /* its value reference */

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    fmi2Real time;
} lag;

/* Of the last step: outputs are read directly after it. */
static bool is_beyond;
static bool stands;

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior) {
    fmi2Status status = own_do_step(component, point, size, no_set_state_prior);
    return is_beyond ? (fmi2Status)REFUSES : status;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    fmi2Status status = own_get_real(component, references, count, values);
    for (size_t i = 0; i < count; i++) {
        values[i] = references[i] == Y && (is_beyond || stands) ? NAN : values[i];
    }
    return status;
}

static void look(const lag *m) {
    is_beyond = m->u > LIMIT;
    stands = m->time > NAN_FROM && m->time < NAN_TO;
}

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
    m->time = 0.0;
    look(m);
}

static void step(void *model, double h) {
    lag *m = model;
    m->time += h;
    m->y += h * (m->u - m->y) / m->T;
    look(m);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
