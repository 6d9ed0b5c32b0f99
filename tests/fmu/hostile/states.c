/* An FMU whose saved states are wrong in one way, which LIE names. Its variables and its other
 * functions are those of fmus/lag.
 *
 * "parameters" a state does not contain u and T, and y depends on the last change of u
 * "events"     a state does not contain whether u was ever above LEVEL; y depends on that
 * "one"        there is only one state; a second save overwrites it
 * "stranger"   y is wrong after a process loads serialised states before it has serialised one
 * "late"       from inner step LATE on, saving fails
 *
 * In inner step OPENS it opens a file, which a copy of its memory cannot undo.
 */
#include <fcntl.h>
#include <fmi2Functions.h>
#include <stdbool.h>
#include <string.h>

#include "description.h"
#include "fmus/common/instance.h"

fmi2SetRealTYPE own_set_real;
fmi2GetFMUstateTYPE own_get_state;
fmi2SetFMUstateTYPE own_set_state;
fmi2SerializeFMUstateTYPE own_serialize;
fmi2DeSerializeFMUstateTYPE own_deserialize;

#ifndef LEVEL
#define LEVEL 1.3
#endif
#ifndef LATE
#define LATE 30
#endif
#ifndef OPENS
#define OPENS 0
#endif

enum { U = 0 };

typedef struct lag {
    fmi2Real u;
    fmi2Real T;
    fmi2Real x_start, t_step;
    fmi2Real y;
    double before; /* u, before it was set */
} lag;

static bool was_above;
static bool has_bytes; /* this process has serialised a state */
static bool is_stranger;
static long steps;
static fmi2FMUstate only;

static bool lies(const char *how) {
    return strcmp(LIE, how) == 0;
}

static lag *model_of(fmi2Component component) {
    return (lag *)((tl_fmu_instance *)component)->state->model;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    for (size_t i = 0; i < count; i++) {
        lag *m = model_of(component);
        m->before = references[i] == U ? m->u : m->before;
    }
    return own_set_real(component, references, count, values);
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
    if (lies("late") && steps >= LATE) {
        return fmi2Error;
    }
    fmi2Status status = own_get_state(component, state);
    return status == fmi2OK && lies("one") ? own_get_state(component, &only) : status;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    const lag before = *model_of(component);
    fmi2Status status = own_set_state(component, lies("one") ? only : state);
    if (lies("parameters")) {
        model_of(component)->u = before.u;
        model_of(component)->T = before.T;
        model_of(component)->before = before.before;
    }
    return status;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    has_bytes = true;
    return own_serialize(component, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    is_stranger = is_stranger || (lies("stranger") && !has_bytes);
    return own_deserialize(component, bytes, size, state);
}

static void start(void *model) {
    lag *m = model;
    m->y = m->x_start;
}

static void step(void *model, double h) {
    lag *m = model;
    if (++steps == OPENS) {
        (void)open("states.txt", O_RDWR | O_CREAT, 0600);
    }
    was_above = was_above || (lies("events") && m->u > LEVEL);
    m->y += h * (m->u - m->y) / m->T + (was_above || is_stranger ? 1e-4 : 0.0);
    m->y += lies("parameters") ? 0.01 * (m->u - m->before) : 0.0;
}

TL_FMU_MODEL(lag, .t_step = offsetof(lag, t_step), .start = start, .step = step);
