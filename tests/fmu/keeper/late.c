/* An FMU whose states are exact before its step LATE. From then on y also depends on a global that
 * the states do not contain. Its variables and functions are those of fmus/lag. */
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

static double remembered; /* 0 until then */

static void start(void *model) {
    lag *m = model;
    touch();
    m->y = m->x_start;
}

static void step(void *model, double h) {
    touch();
    lag *m = model;
    if (++m->steps >= LATE) {
        remembered = 0.5 * remembered + 0.001 * m->u;
    }
    m->y += h * (m->u - m->y) / m->T + remembered;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
