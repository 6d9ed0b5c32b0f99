/* An FMU whose y depends on the machine's clock from its step LATE on. Its variables and functions
 * are those of fmus/lag. */
#include <time.h>

#include "description.h"
#include "fmus/common/model.h"
#include "tests/fmu/keeper/touch.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    double steps;
} lag;

static void start(void *model) {
    lag *m = model;
    touch();
    m->y = m->x_start;
}

static void step(void *model, double h) {
    touch();
    struct timespec now = {0};
    lag *m = model;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    m->y += h * (m->u - m->y) / m->T + (++m->steps >= LATE ? (double)now.tv_nsec * 1e-12 : 0.0);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
