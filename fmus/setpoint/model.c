/* Set point: what a start bit makes of a drive's reference: ref = f while enabled, else 0. A controller between them, so the
 * reference follows the bit one macro step later.
 */
#include "fmus/common/model.h"

typedef struct setpoint {
    fmi2Boolean enabled; /* input */
    fmi2Real f;          /* fixed */
    fmi2Real ref;        /* output */
} setpoint;

static const setpoint defaults = {.enabled = fmi2True, .f = 10};

static const tl_fmu_variable variables[] = {
    {TL_FMU_REAL, 0, TL_FMU_RESULT, offsetof(setpoint, ref)},
    {TL_FMU_REAL, 1, TL_FMU_FIXED, offsetof(setpoint, f)},
    {TL_FMU_BOOLEAN, 0, TL_FMU_INPUT, offsetof(setpoint, enabled)},
};

static void start(void *model) {
    setpoint *s = model;
    s->ref = s->enabled ? s->f : 0.0;
}

static void step(void *model, double h) {
    (void)h;
    start(model); /* there is no state */
}

TL_FMU_MODEL(setpoint, .t_step = TL_FMU_WHOLE_STEPS, .start = start, .step = step);
