/* An FMU whose library counts the steps; if its count differs from that of the FMU, y is wrong. The
 * FMU opens the library by its name in its first step. With NEEDED the loader opens it with the
 * FMU. With CLOSES each step opens and closes it, so that it counts from 1. Its variables and
 * functions are those of fmus/lag. */
#include <dlfcn.h>
#include <string.h>

#include "description.h"
#include "fmus/common/model.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
} lag;

typedef unsigned long count_function(void);

static void *library; /* NULL: the loader has opened it */
static count_function *count;
static unsigned long steps;

#ifndef CLOSES
#define CLOSES 0
#endif

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

#ifdef NEEDED
extern count_function count_step;

static void open_library(void) {
    count = count_step;
}
#else
static void open_library(void) {
    library = dlopen("libcount.so", RTLD_NOW | RTLD_LOCAL);
    void *address = library != NULL ? dlsym(library, "count_step") : NULL;
    memcpy(&count, &address, sizeof address);
}
#endif

static void step(void *model, double h) {
    lag *m = model;
    if (count == NULL) {
        open_library();
    }
    steps = CLOSES ? 1 : steps + 1;
    m->y += h * (m->u - m->y) / m->T + (count == NULL || count() != steps ? 1.0 : 0.0);
    if (CLOSES) {
        (void)dlclose(library);
        count = NULL;
    }
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
