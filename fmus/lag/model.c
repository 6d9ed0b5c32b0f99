/* Lag: T·dx/dt = u − x, y = x, by explicit Euler. The smallest FMU that has a state, an input and a parameter. */
#include "fmus/common/model.h"

typedef struct lag {
    fmi2Real u;               /* input */
    fmi2Real T;               /* tunable */
    fmi2Real x_start, t_step; /* fixed */
    fmi2Real y;               /* state and output */
} lag;

static const lag defaults = {.u = 0, .T = 0.1, .x_start = 0, .t_step = 0.001};

static const tl_fmu_variable variables[] = {
    {TL_FMU_REAL, 0, TL_FMU_INPUT, offsetof(lag, u)},      {TL_FMU_REAL, 1, TL_FMU_RESULT, offsetof(lag, y)},
    {TL_FMU_REAL, 2, TL_FMU_TUNABLE, offsetof(lag, T)},    {TL_FMU_REAL, 3, TL_FMU_FIXED, offsetof(lag, x_start)},
    {TL_FMU_REAL, 4, TL_FMU_FIXED, offsetof(lag, t_step)},
};

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    lag *m = model;
    m->y += h * (m->u - m->y) / m->T;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
