/* A verb that calls FMUs: in their thread, with a limit for each call, and to its end.
 *
 * Thread: begin it in the main thread; the work is done in the FMUs' one (fmu_thread.h), which ends before this does.
 */
#ifndef TL_FIRMWARE_VERBS_VERB_JOB_H
#define TL_FIRMWARE_VERBS_VERB_JOB_H

#include <stdio.h>

#include "firmware/twin/assembly.h"
#include "firmware/verbs/options.h"

typedef struct tl_verb_job {
    const tl_options *options;
    FILE *output;     /* what tl_output_claim() gave; NULL: the verb prints no result */
    tl_status status; /* set by the work */
} tl_verb_job;

/* Hands the job to `work`, which says on the log what fails. The exit code of the process. */
int tl_verb_job_run(tl_verb_job *job, void (*work)(void *job));

/* The end of the work: an FMU may crash in being freed, and what was printed is out before. */
void tl_verb_job_end(const tl_verb_job *job, tl_assembly *assembly);

#endif
