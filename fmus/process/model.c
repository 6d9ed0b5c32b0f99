/* Process: the message-based connection from the control to the twin; a message reports a change.
 *
 *   valid = (enabled ≠ enabled of the step before)      value = enabled if valid, else off
 *
 * A message is present for one macro step, whatever its length. At the start no message has been
 * sent and every belt counts as off, so a belt that is on is reported at once.
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct process {
    fmi2Boolean enabled1, enabled2;             /* inputs */
    fmi2Boolean before1, before2;               /* states: values of the step before */
    fmi2Boolean valid1, value1, valid2, value2; /* outputs */
    fmi2Integer messages;                       /* output: messages sent so far */
} process;

static void tell(process *p) {
    p->valid1 = p->enabled1 != p->before1;
    p->valid2 = p->enabled2 != p->before2;
    p->value1 = p->valid1 && p->enabled1;
    p->value2 = p->valid2 && p->enabled2;
    p->messages += p->valid1 + p->valid2;
    p->before1 = p->enabled1;
    p->before2 = p->enabled2;
}

static void start(void *model) {
    process *p = model;
    p->before1 = fmi2False;
    p->before2 = fmi2False;
    p->messages = 0;
    tell(p);
}

static void step(void *model, double h) {
    (void)h;
    tell(model);
}

TL_FMU_MODEL(process, .t_step = TL_FMU_WHOLE_STEPS, .start = start, .step = step);
