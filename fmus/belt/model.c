/* Belt: a conveyor, a rectangle in the plane, and the velocity that it gives to a product on it.
 *
 *   p_v = (v_x, v_y) while enabled and the product's square overlaps the rectangle, else 0
 *
 * x and y are the rectangle's lower corner; p_x and p_y are the middle of the product's square.
 */
#include "fmus/common/model.h"

typedef struct belt {
    fmi2Real p_x, p_y;                     /* inputs */
    fmi2Boolean enabled;                   /* input */
    fmi2Real x, y, w, h, v_x, v_y, p_half; /* fixed */
    fmi2Real p_v_x, p_v_y;                 /* outputs */
} belt;

static const belt defaults = {.w = 270, .h = 30, .v_x = 70, .p_half = 20};

static const tl_fmu_variable variables[] = {
    {TL_FMU_REAL, 0, TL_FMU_INPUT, offsetof(belt, p_x)},     {TL_FMU_REAL, 1, TL_FMU_INPUT, offsetof(belt, p_y)},
    {TL_FMU_REAL, 2, TL_FMU_RESULT, offsetof(belt, p_v_x)},  {TL_FMU_REAL, 3, TL_FMU_RESULT, offsetof(belt, p_v_y)},
    {TL_FMU_REAL, 4, TL_FMU_FIXED, offsetof(belt, x)},       {TL_FMU_REAL, 5, TL_FMU_FIXED, offsetof(belt, y)},
    {TL_FMU_REAL, 6, TL_FMU_FIXED, offsetof(belt, w)},       {TL_FMU_REAL, 7, TL_FMU_FIXED, offsetof(belt, h)},
    {TL_FMU_REAL, 8, TL_FMU_FIXED, offsetof(belt, v_x)},     {TL_FMU_REAL, 9, TL_FMU_FIXED, offsetof(belt, v_y)},
    {TL_FMU_REAL, 10, TL_FMU_FIXED, offsetof(belt, p_half)}, {TL_FMU_BOOLEAN, 0, TL_FMU_INPUT, offsetof(belt, enabled)},
};

/* True where two spans have more than a point in common. */
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
