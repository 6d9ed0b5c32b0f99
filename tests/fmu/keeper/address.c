/* An FMU whose y depends on the address of a block that each step allocates, as results of a hash
 * table of pointers do. Its variables and functions are those of fmus/lag. */
#include <stdint.h>
#include <stdlib.h>

#include "description.h"
#include "fmus/common/model.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
} lag;

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    lag *m = model;
    void *block = malloc(100);
    m->y += h * (m->u - m->y) / m->T + 1e-6 * (double)((uintptr_t)block % 65521);
    free(block);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
