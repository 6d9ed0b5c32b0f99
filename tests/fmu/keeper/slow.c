/* An FMU whose own states are exact, but slow: a restore takes PAUSE ns. Its variables and its
 * other functions are those of fmus/lag.
 *
 * OUTSIDE  from this step on (0: never) y also depends on an environment variable. A restore of a
 *          state restores it; a restore of a memory copy does not.
 * MAPS     in this step (0: never) it maps memory, which a restore need not undo.
 */
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

#include <fmi2Functions.h>

#include "description.h"
#include "fmus/common/instance.h"

/* The function of fmus/common, renamed by other_set_state.h. */
fmi2Status own_set_state(fmi2Component component, fmi2FMUstate state);

#ifndef PAUSE
#define PAUSE 500000
#endif
#ifndef OUTSIDE
#define OUTSIDE 0
#endif
#ifndef MAPS
#define MAPS 0
#endif

static const char NAME[] = "TL_TEST_OUTSIDE";

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    double steps;
    double outside; /* value of the environment variable */
} lag;

static void put_outside(double number) {
    char text[40];
    (void)snprintf(text, sizeof text, "%a", number);
    (void)setenv(NAME, text, 1);
}

static double get_outside(void) {
    const char *text = getenv(NAME);
    return text != NULL ? strtod(text, NULL) : 0.0;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    const struct timespec pause = {.tv_nsec = PAUSE};
    (void)nanosleep(&pause, NULL);
    fmi2Status status = own_set_state(component, state);
    put_outside(((const lag *)((tl_fmu_instance *)component)->state->model)->outside);
    return status;
}

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    lag *m = model;
    m->y += h * (m->u - m->y) / m->T;
    if (++m->steps == MAPS) {
        (void)mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    }
    if (m->steps >= OUTSIDE && OUTSIDE != 0) {
        m->y += 0.01 * get_outside();
        m->outside = m->u;
        put_outside(m->outside);
    }
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
