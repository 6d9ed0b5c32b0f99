/* An FMU whose library counts the steps; if its count differs from that of the FMU, y is wrong. The
 * FMU opens the library by its name in its first step. With NEEDED the loader opens it with the
 * FMU. Its variables and functions are those of fmus/lag. */
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

static count_function *count;
static unsigned long steps;

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
    void *library = dlopen("libcount.so", RTLD_NOW | RTLD_LOCAL);
    void *address = library != NULL ? dlsym(library, "count_step") : NULL;
    memcpy(&count, &address, sizeof address);
}
#endif

static void step(void *model, double h) {
    lag *m = model;
    if (count == NULL) {
        open_library();
    }
    steps++;
    m->y += h * (m->u - m->y) / m->T + (count == NULL || count() != steps ? 1.0 : 0.0);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
