/* An FMU whose instances in one process have different results from step FROM on: an environment
 * variable counts them. With SEED the results depend on the clock at loading, so that they differ
 * in each process. Its variables and functions are those of fmus/lag. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "description.h"
#include "fmus/common/model.h"

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    double steps; /* the inner ones too */
} lag;

static double offset; /* the same for all instances of this copy of the library */

__attribute__((constructor)) static void meet(void) {
    static const char MET[] = "TWINLOCK_TEST_MET";
    const char *before = getenv(MET);
    char text[16];
    struct timespec now = {0};
    int number = before == NULL ? 0 : atoi(before) + 1;
    (void)snprintf(text, sizeof text, "%d", number);
    (void)setenv(MET, text, 1);
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
#if defined(SEED)
    offset = (double)now.tv_nsec * 1e-12;
#else
    offset = number * 1e-3;
#endif
}

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
    m->steps = 0;
}

static void step(void *model, double h) {
    lag *m = model;
    m->steps++;
    m->y += h * (m->u - m->y) / m->T + (m->steps > 10 * FROM ? offset : 0.0);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
