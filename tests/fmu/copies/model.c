/* A lag like fmus/lag, whose state is not in the instance: it is the variable of tl_integral(). */
#include "fmus/common/model.h"

#include "description.h"
#include "tests/fmu/copies/integral.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
} lag;

static void start(void *model) {
    lag *m = model;
    *tl_integral() = m->x_start;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    lag *m = model;
    double *state = tl_integral();
    *state += h * (m->u - *state) / m->T;
    m->y = *state;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
