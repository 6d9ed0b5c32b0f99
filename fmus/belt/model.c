/* Belt: a conveyor, modelled as a rectangle in the plane. It outputs the velocity that it gives to
 *       a product on it.
 *
 *   p_v = (v_x, v_y) if enabled and the product's square overlaps the rectangle, else 0
 *
 * x and y are the rectangle's lower corner; p_x and p_y are the centre of the product's square.
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct belt {
    fmi2Real p_x, p_y;                     /* inputs */
    fmi2Boolean enabled;                   /* input */
    fmi2Real x, y, w, h, v_x, v_y, p_half; /* fixed */
    fmi2Real p_v_x, p_v_y;                 /* outputs */
} belt;

/* Returns true if two intervals have more than one point in common. */
static int overlap(double from, double length, double middle, double half) {
    return middle + half > from && middle - half < from + length;
}

static void start(void *model) {
    belt *b = model;
    const int carries = b->enabled && overlap(b->x, b->w, b->p_x, b->p_half) && overlap(b->y, b->h, b->p_y, b->p_half);
    b->p_v_x = carries ? b->v_x : 0.0;
    b->p_v_y = carries ? b->v_y : 0.0;
}

static void step(void *model, double h) {
    (void)h;
    start(model); /* there is no state */
}

TL_FMU_MODEL(belt, .t_step = TL_FMU_WHOLE_STEPS, .start = start, .step = step);
