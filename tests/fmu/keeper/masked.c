/* An FMU whose solver restarts if a state is restored while its output is at the limit LIMIT: only the
 * internal variable x shows it then. Its functions are those of fmus/lag. */
#include <stdbool.h>

#include <fmi2Functions.h>

#include "description.h"
#include "fmus/common/model.h"
#include "tests/fmu/keeper/touch.h"

/* fmus/common's function, by the name that other_set_state.h gives it. */
fmi2Status own_set_state(fmi2Component component, fmi2FMUstate state);

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    fmi2Real x;
} lag;

static bool is_restored;

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    is_restored = true;
    return own_set_state(component, state);
}

static double limited(double x) {
    return x > LIMIT ? LIMIT : x;
}

static void start(void *model) {
    lag *m = model;
    touch();
    m->x = m->x_start;
    m->y = limited(m->x);
}

static void step(void *model, double h) {
    lag *m = model;
    touch();
    m->x += h * (m->u - m->x) / m->T + (is_restored && m->x > LIMIT ? 1e-6 : 0.0);
    m->y = limited(m->x);
    is_restored = false;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
