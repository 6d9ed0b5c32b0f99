/* An FMU that no input can control: from its second AT on y grows by GROWTH with each step. Its
 * variables are those of fmus/lag. */
#include "description.h"
#include "fmus/common/model.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    fmi2Real time;
} lag;

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
    m->time = 0.0;
}

static void step(void *model, double h) {
    lag *m = model;
    m->time += h;
    m->y += h * (m->u - m->y) / m->T;
    if (m->time > AT) {
        m->y = (m->y + 1.0) * GROWTH;
    }
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
