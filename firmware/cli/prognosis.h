/* The prognosis: what a step will cost, before anything runs.
 *
 * Purpose: executions by the graph (eq. 4.5, 4.13), and time from what an execution of each FMU takes here: measured by a
 *          dry run of free steps on the plant's initial values. What the solver itself needs is not in it, nor what
 *          "keep": "outputs" catches up.
 * Thread:  one thread; the twin must not have begun, and is of no other use afterwards.
 */
#ifndef TL_FIRMWARE_CLI_PROGNOSIS_H
#define TL_FIRMWARE_CLI_PROGNOSIS_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"

typedef struct tl_prognosis {
    /* executions, of all components together */
    uint64_t step;  /* of a free step */
    uint64_t plain; /* of an evaluation, if nothing were saved */
    uint64_t first; /* of a step's first evaluation, at most */
    uint64_t next;  /* of each later one, at most */
    uint64_t worst; /* of a step that uses all its evaluations, the committing step included */

    /* ns here; 0: not known */
    size_t steps;                         /* of the dry run; 0: the FMUs cannot step with the plant's initial values: */
    tl_error error;                       /* why */
    int64_t next_tick;                    /* the one after it */
    tl_time step_time;                    /* of a free step */
    tl_time cost[TL_RECORDER_COMPONENTS]; /* of one execution of each component, saving its state included */
    tl_time worst_time;                   /* of `worst`; INT64_MAX stands for all that is more */
    uint32_t fitting;                     /* evaluations that fit into the time budget in the worst case */
} tl_prognosis;

/* The same dry run alone, of so many ticks. */
tl_status tl_prognosis_run_dry(const tl_assembly *assembly, int64_t ticks, tl_error *error);

void tl_prognosis_make(const tl_assembly *assembly, tl_prognosis *prognosis);

#endif
