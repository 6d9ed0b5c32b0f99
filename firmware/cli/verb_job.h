/* Verb that needs FMUs: its configuration, and the FMU process (twin_child.h).
 *
 * Purpose: the common part of check, replay and plant. These verbs own files, sockets and the
 *          terminal; the FMUs run in another process.
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
    FILE *output;         /* result of tl_output_claim(); NULL: the verb prints no result */
    bool counts_problems; /* logs the number of problems in the configuration */
    tl_config config;     /* of the subject */
    tl_twin_job order;    /* for the FMU process; tl_verb_job_read() fills in path, text and options */
    tl_twin_child *child;
    tl_error error; /* why the verb fails; "": already logged */
} tl_verb_job;

/* Installs the signal handlers and reads the configuration. Problems are logged. */
tl_status tl_verb_job_read(tl_verb_job *job);

/* Rejects an output file of option `option` that this run also reads or writes: the configuration,
 * an FMU, the recording, the database or the file of --csv. NULL: there is no such file. Errors:
 * TL_BAD_USAGE. */
tl_status tl_verb_job_check_output(const tl_verb_job *job, const char *option, const char *path, const char *recording,
                                   tl_error *error);

/* Starts the FMU process. `page`: stream for the page of a check, else NULL. Errors: TL_TRY_AGAIN,
 * with the reason in job->error. */
tl_status tl_verb_job_start(tl_verb_job *job, FILE *page);

/* Returns the settings of an FMU process for this configuration. `page`: as for
 * tl_verb_job_start(). */
tl_twin_child_settings tl_verb_job_settings(const tl_verb_job *job, FILE *page);

/* Ends the FMU process, if there is one, and frees everything. Logs job->error, and an error if the
 * process failed at its end. Returns the exit code for `status`. */
int tl_verb_job_end(tl_verb_job *job, tl_status status);

#endif
