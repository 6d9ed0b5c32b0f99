/* Process: the way from the control to the twin, which is message based: what is told is what has changed.
 *
 *   valid = (enabled ≠ enabled of the step before)      value = enabled where valid, else off
 *
 * A message stands for one macro step, however long that is. At the start nothing has been told yet, and every belt counts as
 * off: one that is on is told at once.
 */
#include "fmus/common/model.h"
#include "description.h"

typedef struct process {
    fmi2Boolean enabled1, enabled2;             /* inputs */
    fmi2Boolean before1, before2;               /* states: as in the step before */
    fmi2Boolean valid1, value1, valid2, value2; /* outputs */
    fmi2Integer messages;                       /* output: told so far */
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
