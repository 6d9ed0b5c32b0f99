/* Event to cyclic: holds what messages have told, so that cyclic components can read it in every step.
 *
 *   enabled = value of the newest message about the belt; enabled_start before the first one
 *   missed  = messages that the sender counts, less those that came
 */
#include "fmus/common/model.h"

typedef struct event_to_cyclic {
    fmi2Boolean valid1, value1, valid2, value2; /* inputs */
    fmi2Integer messages;                       /* input */
    fmi2Boolean enabled1_start, enabled2_start; /* fixed */
    fmi2Integer received;                       /* state */
    fmi2Boolean enabled1, enabled2;             /* outputs; states too */
    fmi2Integer missed;                         /* output */
} event_to_cyclic;

static const event_to_cyclic defaults = {.valid1 = fmi2False};

static const tl_fmu_variable variables[] = {
    {TL_FMU_BOOLEAN, 0, TL_FMU_INPUT, offsetof(event_to_cyclic, valid1)},
    {TL_FMU_BOOLEAN, 1, TL_FMU_INPUT, offsetof(event_to_cyclic, value1)},
    {TL_FMU_BOOLEAN, 2, TL_FMU_INPUT, offsetof(event_to_cyclic, valid2)},
    {TL_FMU_BOOLEAN, 3, TL_FMU_INPUT, offsetof(event_to_cyclic, value2)},
    {TL_FMU_BOOLEAN, 4, TL_FMU_FIXED, offsetof(event_to_cyclic, enabled1_start)},
    {TL_FMU_BOOLEAN, 5, TL_FMU_FIXED, offsetof(event_to_cyclic, enabled2_start)},
    {TL_FMU_BOOLEAN, 6, TL_FMU_RESULT, offsetof(event_to_cyclic, enabled1)},
    {TL_FMU_BOOLEAN, 7, TL_FMU_RESULT, offsetof(event_to_cyclic, enabled2)},
    {TL_FMU_INTEGER, 0, TL_FMU_INPUT, offsetof(event_to_cyclic, messages)},
    {TL_FMU_INTEGER, 1, TL_FMU_RESULT, offsetof(event_to_cyclic, missed)},
};

/* What is told at the start itself comes in the first step, as every message does in the step after it. */
static void start(void *model) {
    event_to_cyclic *c = model;
    c->enabled1 = c->enabled1_start;
    c->enabled2 = c->enabled2_start;
    c->received = 0;
    c->missed = 0;
}

static void step(void *model, double h) {
    event_to_cyclic *c = model;
    (void)h;
    c->enabled1 = c->valid1 ? c->value1 : c->enabled1;
    c->enabled2 = c->valid2 ? c->value2 : c->enabled2;
    c->received += c->valid1 + c->valid2;
    c->missed = c->messages - c->received;
}

TL_FMU_MODEL(event_to_cyclic, .t_step = TL_FMU_WHOLE_STEPS, .start = start, .step = step);
