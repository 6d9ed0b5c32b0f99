/* An FMU whose states do not contain a mode. The mode begins when u is above LIMIT, and changes y
 * only while u is above a tenth of LIMIT. Its variables and functions are those of fmus/lag. */
#include "description.h"
#include "fmus/common/model.h"
#include "tests/fmu/keeper/touch.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
} lag;

static double mode; /* 0 until then */

static void start(void *model) {
    lag *m = model;
    touch();
    m->y = m->x_start;
    mode = 0.0;
}

static void step(void *model, double h) {
    lag *m = model;
    touch();
    m->y += h * (m->u - m->y) / m->T + (m->u > 0.1 * LIMIT ? mode : 0.0);
    mode = m->u > LIMIT ? 1e-3 : mode;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
