/* An FMU whose solver restarts after each restore of a state. From its step LATE on this changes y.
 * Its variables and its other functions are those of fmus/lag. */
#include <stdbool.h>

#include <fmi2Functions.h>

#include "description.h"
#include "fmus/common/model.h"
#include "tests/fmu/keeper/touch.h"

/* The function of fmus/common, renamed by other_set_state.h. */
fmi2Status own_set_state(fmi2Component component, fmi2FMUstate state);

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
} lag;

static unsigned long steps;
static bool is_cold;

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    is_cold = true;
    return own_set_state(component, state);
}

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    touch();
    lag *m = model;
    m->y += h * (m->u - m->y) / m->T + (++steps >= LATE && is_cold ? 1e-6 : 0.0);
    is_cold = false;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
