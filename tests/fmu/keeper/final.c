/* An FMU whose states are exact, and whose y depends on noSetFMUStatePriorToCurrentPoint. Its
 * variables and its other functions are those of fmus/lag. */
#include <stdbool.h>

#include <fmi2Functions.h>

#include "description.h"
#include "fmus/common/model.h"

/* The function of fmus/common, renamed by other_do_step.h. */
fmi2Status own_do_step(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior);

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
} lag;

static bool is_final;

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior) {
    is_final = no_set_state_prior != fmi2False;
    return own_do_step(component, point, size, no_set_state_prior);
}

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    lag *m = model;
    m->y += h * (m->u - m->y) / m->T + (is_final ? 0.001 * m->u : 0.0);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
