/* Set point: a controller that derives a drive's reference from a start bit: ref = f while enabled,
 *            else 0. The reference follows the bit one macro step later. */
#include "fmus/common/model.h"
#include "description.h"

typedef struct setpoint {
    fmi2Boolean enabled; /* input */
    fmi2Real f;          /* fixed */
    fmi2Real ref;        /* output */
} setpoint;

static void start(void *model) {
    setpoint *s = model;
    s->ref = s->enabled ? s->f : 0.0;
}

static void step(void *model, double h) {
    (void)h;
    start(model); /* there is no state */
}

TL_FMU_MODEL(setpoint, .t_step = TL_FMU_WHOLE_STEPS, .start = start, .step = step);
