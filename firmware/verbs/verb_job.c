/* A verb that calls FMUs: see verb_job.h. */
#include "firmware/verbs/verb_job.h"

#include "firmware/fmu/fmu_thread.h"
#include "firmware/process/interrupt.h"
#include "firmware/text/output.h"

int tl_verb_job_run(tl_verb_job *job, void (*work)(void *job)) {
    tl_interrupt_install();
    tl_status status = tl_fmu_thread_run(tl_time_of_seconds(job->options->call_limit_s), work, job);
    if (status == TL_OK) {
        status = job->status;
    }
    return tl_exit_code(job->output != NULL ? tl_output_finish(job->output, status) : status);
}

void tl_verb_job_end(const tl_verb_job *job, tl_assembly *assembly) {
    (void)fflush(job->output);
    tl_assembly_free(assembly);
}
