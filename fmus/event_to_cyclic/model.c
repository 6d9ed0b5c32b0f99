/* Event to cyclic: stores the newest messages, so that cyclic components can read their values in
 * every step.
 *
 *   enabled = value of the newest message about the belt; enabled_start before the first one
 *   missed  = messages that the sender has counted, minus those received
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct event_to_cyclic {
    fmi2Boolean valid1, value1, valid2, value2; /* inputs */
    fmi2Integer messages;                       /* input */
    fmi2Boolean enabled1_start, enabled2_start; /* fixed */
    fmi2Integer received;                       /* state */
    fmi2Boolean enabled1, enabled2;             /* outputs, which are also states */
    fmi2Integer missed;                         /* output */
} event_to_cyclic;

/* A message that is present at the start is processed by the first step, like any message by the
 * step after it. */
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
