/* Lag: T·dx/dt = u − x, y = x, by explicit Euler. The smallest FMU that has a state, an input and a
 *      parameter. */
#include "fmus/common/model.h"
#include "description.h"

typedef struct lag {
    fmi2Real u;               /* input */
    fmi2Real T;               /* tunable */
    fmi2Real x_start, t_step; /* fixed */
    fmi2Real y;               /* state and output */
} lag;

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    lag *m = model;
    m->y += h * (m->u - m->y) / m->T;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
