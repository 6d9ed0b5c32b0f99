/* An FMU whose solver restarts after each restore of a state. From its step LATE on this changes y.
 * Its variables and its other functions are those of fmus/lag. */
#include <stdbool.h>
#include <string.h>

#include <fmi2Functions.h>

#include "description.h"
#include "fmus/common/model.h"
#include "tests/fmu/keeper/touch.h"

/* The function of fmus/common, renamed by other_set_state.h. */
fmi2Status own_set_state(fmi2Component component, fmi2FMUstate state);

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    double steps;
} lag;

/* The C library remembers whether the solver is cold, so that no comparison of the FMU's memory
 * finds it. */
static void restart(void) {
    static char text[] = "a,b";
    text[1] = ',';
    (void)strtok(text, ",");
}

static bool is_cold(void) {
    return strtok(NULL, ",") != NULL;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    restart();
    return own_set_state(component, state);
}

static void start(void *model) {
    lag *m = model;
    touch();
    restart();
    (void)is_cold();
    m->y = m->x_start;
}

static void step(void *model, double h) {
    touch();
    lag *m = model;
    bool was_cold = is_cold();
    m->y += h * (m->u - m->y) / m->T + (++m->steps >= LATE && was_cold ? 1e-6 : 0.0);
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
