/* Product: a position in the plane that the velocities of two belts move.
 *
 *   dx/dt = p_v_x1 + p_v_x2      dy/dt = p_v_y1 + p_v_y2
 *
 * Integrated by explicit Euler. The velocities are held over a macro step, so that it is exact.
 */
#include "fmus/common/model.h"

typedef struct product {
    fmi2Real p_v_x1, p_v_y1, p_v_x2, p_v_y2; /* inputs */
    fmi2Real x_start, y_start, t_step;       /* fixed */
    fmi2Real x, y;                           /* outputs; states too */
} product;

static const product defaults = {.y_start = 20, .t_step = 0.01};

static const tl_fmu_variable variables[] = {
    {TL_FMU_REAL, 0, TL_FMU_INPUT, offsetof(product, p_v_x1)},
    {TL_FMU_REAL, 1, TL_FMU_INPUT, offsetof(product, p_v_y1)},
    {TL_FMU_REAL, 2, TL_FMU_INPUT, offsetof(product, p_v_x2)},
    {TL_FMU_REAL, 3, TL_FMU_INPUT, offsetof(product, p_v_y2)},
    {TL_FMU_REAL, 4, TL_FMU_RESULT, offsetof(product, x)},
    {TL_FMU_REAL, 5, TL_FMU_RESULT, offsetof(product, y)},
    {TL_FMU_REAL, 6, TL_FMU_FIXED, offsetof(product, x_start)},
    {TL_FMU_REAL, 7, TL_FMU_FIXED, offsetof(product, y_start)},
    {TL_FMU_REAL, 8, TL_FMU_FIXED, offsetof(product, t_step)},
};

static void start(void *model) {
    product *p = model;
    p->x = p->x_start;
    p->y = p->y_start;
}

static void step(void *model, double h) {
    product *p = model;
    p->x += h * (p->p_v_x1 + p->p_v_x2);
    p->y += h * (p->p_v_y1 + p->p_v_y2);
}

TL_FMU_MODEL(product, .t_step = offsetof(product, t_step), .start = start, .step = step);
