/* An FMU whose states lack a delay line. y depends on it after 300 inner steps only, so that the proof
 * before a run shows no difference. Its variables and functions are those of fmus/lag. */
#include "description.h"
#include "fmus/common/model.h"
#include "tests/fmu/keeper/touch.h"

enum { PLACES = 512, DELAY = 300 };

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    double steps;
} lag;

static double ring[PLACES];

static void start(void *model) {
    lag *m = model;
    touch();
    m->y = m->x_start;
}

static void step(void *model, double h) {
    touch();
    lag *m = model;
    const int now = (int)m->steps;
    ring[now % PLACES] = m->u;
    m->y += h * (m->u + (now >= DELAY ? 0.2 * ring[(now - DELAY) % PLACES] : 0.0) - m->y) / m->T;
    m->steps++;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
