/* Tank: a pump fills it, an outlet at its bottom empties it by Torricelli's law,
 *      A·dh/dt = k·pump − a·√(2·g·h), by explicit Euler. */
#include <math.h>

#include "description.h"
#include "fmus/common/model.h"

static const double GRAVITY = 9.81; /* m/s2 */

typedef struct tank {
    fmi2Real pump;                    /* input */
    fmi2Real pump_flow, outlet, area; /* tunable */
    fmi2Real level_start, t_step;     /* fixed */
    fmi2Real level;                   /* state and output */
} tank;

static void start(void *model) {
    tank *m = model;
    m->level = m->level_start;
}

static void step(void *model, double h) {
    tank *m = model;
    double outflow = m->outlet * sqrt(2.0 * GRAVITY * fmax(m->level, 0.0));
    m->level = fmax(m->level + h * (m->pump_flow * m->pump - outflow) / m->area, 0.0);
}

TL_FMU_MODEL(tank, .t_step = offsetof(tank, t_step), .start = start, .step = step);
