/* Second-order system: T²·x'' + 2·d·T·x' + x = K·u, y = x (eq. 5.6 of the dissertation).
 *
 * Integrated by semi-implicit Euler, the speed first. With weak damping, explicit Euler would add
 * energy in every step.
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct second_order {
    fmi2Real u;                        /* input */
    fmi2Real T, d, K;                  /* tunable */
    fmi2Real x_start, v_start, t_step; /* fixed */
    fmi2Real y, v;                     /* states and outputs */
} second_order;

static void start(void *model) {
    second_order *m = model;
    m->y = m->x_start;
    m->v = m->v_start;
}

static void step(void *model, double h) {
    second_order *m = model;
    m->v += h * ((m->K * m->u - m->y) / m->T - 2 * m->d * m->v) / m->T;
    m->y += h * m->v;
}

TL_FMU_MODEL(second_order, .t_step = offsetof(second_order, t_step), .start = start, .step = step);
