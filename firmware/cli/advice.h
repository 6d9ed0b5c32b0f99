/* What `check` says of a recording and of the costs: a forecast and advice.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_CLI_ADVICE_H
#define TL_FIRMWARE_CLI_ADVICE_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/read_back.h"
#include "firmware/twin/twin_trial.h"

/* ---- The prognosis: what a step will cost, before anything runs.
 *
 * Purpose: executions by the graph (eq. 4.5, 4.13), and time from what an execution of each FMU takes here: measured by a
 *          dry run of free steps on the plant's initial values. What the solver itself needs is not in it, nor what
 *          "keep": "outputs" catches up.
 * Thread:  one thread; the twin must not have begun, and is of no other use afterwards.
 */

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

/* The same dry run alone, of so many ticks; `sample` is the one behind them. */
tl_status tl_prognosis_run_dry(const tl_assembly *assembly, int64_t ticks, tl_sample *sample, tl_error *error);

void tl_prognosis_make(const tl_assembly *assembly, tl_prognosis *prognosis);

/* ---- Advice: what is right in a configuration, and perhaps not meant.
 *
 * Purpose: the warnings of `check`. None of them is an error: everything they warn of is defined and works.
 * Thread:  one thread.
 */

/* A paragraph each, of 79 columns at most, with the JSON path in front; how many there are. */
size_t tl_advice_print(const tl_assembly *assembly, const tl_prognosis *prognosis, const tl_far_look *look,
                       const tl_read_back_report *states, FILE *file);

#endif
