/* Second-order system: T²·x'' + 2·d·T·x' + x = K·u, y = x (eq. 5.6 of the dissertation).
 *
 * Integrated by semi-implicit Euler, the speed first: at a weak damping explicit Euler would add energy in every step.
 */
#include "fmus/common/model.h"

typedef struct second_order {
    fmi2Real u;                        /* input */
    fmi2Real T, d, K;                  /* tunable */
    fmi2Real x_start, v_start, t_step; /* fixed */
    fmi2Real y, v;                     /* states and outputs */
} second_order;

static const second_order defaults = {.T = 0.125, .d = 0.225, .K = 1, .t_step = 0.0001};

static const tl_fmu_variable variables[] = {
    {TL_FMU_REAL, 0, TL_FMU_INPUT, offsetof(second_order, u)},
    {TL_FMU_REAL, 1, TL_FMU_RESULT, offsetof(second_order, y)},
    {TL_FMU_REAL, 2, TL_FMU_RESULT, offsetof(second_order, v)},
    {TL_FMU_REAL, 3, TL_FMU_TUNABLE, offsetof(second_order, T)},
    {TL_FMU_REAL, 4, TL_FMU_TUNABLE, offsetof(second_order, d)},
    {TL_FMU_REAL, 5, TL_FMU_TUNABLE, offsetof(second_order, K)},
    {TL_FMU_REAL, 6, TL_FMU_FIXED, offsetof(second_order, x_start)},
    {TL_FMU_REAL, 7, TL_FMU_FIXED, offsetof(second_order, v_start)},
    {TL_FMU_REAL, 8, TL_FMU_FIXED, offsetof(second_order, t_step)},
};

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
