/* Forecast of the costs and advice on a configuration, for `check`.
 *
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CLI_ADVICE_H
#define TL_FIRMWARE_CLI_ADVICE_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/base/json.h"
#include "firmware/cli/response.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/read_back.h"
#include "firmware/twin/twin_trial.h"

/* ---- Prognosis: forecast of the cost of a step.
 *
 * Purpose: predicts how often components execute (one execution: one component makes one step) from
 *          the graph (eq. 4.5, 4.13), and the time from the cost of one execution of each FMU. A
 *          dry run measures this cost on this machine: free steps before any signal has a reading.
 *          Not included: the time of the solver, and the executions that "keep": "outputs" needs to
 *          catch up from an older state.
 * Thread:  one thread. The twin must not have started, and cannot be used for a run afterwards.
 */

typedef struct tl_prognosis {
    /* Numbers of executions, all components together: */
    uint64_t step;  /* of a free step */
    uint64_t plain; /* of an evaluation (one candidate, T_P steps) that reuses no earlier result */
    uint64_t first; /* of the first evaluation in a step, at most */
    uint64_t next;  /* of each later evaluation in a step, at most */
    uint64_t worst; /* of a step that uses all its evaluations, including the committed step */

    /* Results of the dry run; times in ns on this machine, 0: unknown. */
    size_t steps;                         /* number of measured steps */
    tl_error error;                       /* failure of the dry run; then only next_tick is valid among these */
    uint64_t bad_outputs;                 /* outputs that were not finite in step `bad_step`; bits as in tl_record */
    int64_t bad_step;                     /* first step with an output that was not finite */
    int64_t next_tick;                    /* first tick after the dry run; after a failure: after the failed tick */
    tl_time step_time;                    /* of a free step */
    tl_time cost[TL_RECORDER_COMPONENTS]; /* of one execution of each component, including saving its state */
    tl_time worst_time;                   /* of a step with `worst` executions; INT64_MAX: too large for tl_time */
    uint32_t fitting;                     /* number of evaluations that fit into the time budget in the worst case */
} tl_prognosis;

/* Executes `ticks` ticks as the dry run does, from tick 0, but measures nothing. Sets *sample to
 * the sample of the next tick. Errors: those of tl_twin_step(). */
tl_status tl_prognosis_run_dry(const tl_assembly *assembly, int64_t ticks, tl_sample *sample, tl_error *error);

/* Counts the executions, and executes the dry run: 1600 steps, or fewer if they take 1 s or the
 * stop time is near. Sets prognosis->error if the dry run fails. */
void tl_prognosis_make(const tl_assembly *assembly, tl_prognosis *prognosis);

/* ---- Advice: settings that are valid but may not be intended.
 *
 * Purpose: the warnings of `check`. None of them is an error: each such setting is valid and has a
 *          defined effect.
 * Thread:  one thread.
 */

/* Prints each warning as a paragraph that begins with the JSON path, at most 79 columns wide. If
 * `json` is not NULL, adds each one to its innermost array instead (tl_problems_add_json()).
 * Returns the number of warnings. `prognosis`: its error is that of the responses' measurement.
 * `responses`: one per adjusted variable (response.h). `rollback`: result of the rollback test
 * after the dry run (twin_trial.h). `states`: result of the test of saved states (read_back.h). */
size_t tl_advice_print(const tl_assembly *assembly, const tl_prognosis *prognosis, const tl_response *responses,
                       const tl_late_verification *rollback, const tl_read_back_report *states, FILE *file,
                       tl_json_writer *json);

#endif
