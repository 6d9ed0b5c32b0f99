/* A verb that needs FMUs: its configuration, and the process that holds them (twin_child.h).
 *
 * Purpose: what check, replay and plant do alike. They hold files, sockets and the terminal; FMUs run in the other process.
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_CLI_VERB_JOB_H
#define TL_FIRMWARE_CLI_VERB_JOB_H

#include <stdbool.h>
#include <stdio.h>

#include "firmware/cli/options.h"
#include "firmware/config/config.h"
#include "firmware/twin/twin_child.h"

typedef struct tl_verb_job {
    const tl_options *options;
    FILE *output;         /* what tl_output_claim() gave; NULL: the verb prints no result */
    bool counts_problems; /* says how many a configuration has */
    tl_config config;     /* of the subject */
    tl_twin_job order;    /* for the process; path, text and what options say are filled in by read */
    tl_twin_child *child;
    tl_error error; /* why the verb fails; "": the log has it already */
} tl_verb_job;

/* Installs the signal handlers and reads the configuration. Problems are reported on the log. */
tl_status tl_verb_job_read(tl_verb_job *job);

/* Starts the process. `page`: where a check prints to; else NULL. Errors: TL_TRY_AGAIN, in job->error. */
tl_status tl_verb_job_start(tl_verb_job *job, FILE *page);

/* Settings of a process with these FMUs. */
tl_twin_child_settings tl_verb_job_settings(const tl_verb_job *job, FILE *page);

/* Ends the process, if there is one, and frees all. Logs job->error, and a failure of the process at its end. Returns the exit code. */
int tl_verb_job_end(tl_verb_job *job, tl_status status);

#endif
