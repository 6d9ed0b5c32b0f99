/* Product: a position in the plane, moved by the velocities of two belts.
 *
 *   dx/dt = p_v_x1 + p_v_x2      dy/dt = p_v_y1 + p_v_y2
 *
 * Integrated by explicit Euler, which is exact here because the velocities are constant over a
 * macro step.
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct product {
    fmi2Real p_v_x1, p_v_y1, p_v_x2, p_v_y2; /* inputs */
    fmi2Real x_start, y_start, t_step;       /* fixed */
    fmi2Real x, y;                           /* outputs, which are also states */
} product;

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
