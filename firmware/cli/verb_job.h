/* Job of a verb that needs FMUs: its configuration and its FMU process (twin_child.h).
 *
 * Purpose: the common part of check, replay, plant and explain. The process of the verb owns
 *          files, sockets and the terminal. The FMUs run in another process, the FMU process.
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_CLI_VERB_JOB_H
#define TL_FIRMWARE_CLI_VERB_JOB_H

#include <stdbool.h>
#include <stdio.h>

#include "firmware/cli/options.h"
#include "firmware/config/config.h"
#include "firmware/plant/recording.h"
#include "firmware/twin/twin_child.h"

/* Zeroed at first, except what the caller sets. */
typedef struct tl_verb_job {
    const tl_options *options; /* set by the caller */
    FILE *output;              /* set by the caller: see tl_output_claim(); NULL: the verb prints no result */
    bool counts_problems;      /* set by the caller; true: tl_verb_job_read() also logs the number of problems */
    tl_config config;          /* of tl_verb_job_read() */
    tl_twin_job order;         /* for the FMU process; tl_verb_job_read() sets path, text and unconfined */
    tl_twin_child *child;      /* the FMU process; NULL: not started */
    tl_error error;            /* why the verb fails; "": the reason was logged */
} tl_verb_job;

/* Installs the signal handlers. Reads the configuration from `text` if it is not NULL, else from
 * the file `path`. Relative file names are resolved against the folder of `path`. Problems are
 * logged and returned as the status. Before the call, set job->options, and job->order.attached if
 * the job emulates a plant. The caller also sets job->order.task, before tl_verb_job_start(). */
tl_status tl_verb_job_read(tl_verb_job *job, const char *path, const char *text);

/* Sets job->order to what the recorded run used: time, "keep" of the components, tunings, first
 * tick and checkpoint. If the configuration has a duration, that duration replaces the recorded
 * one. The recording must outlive the start of the process. Errors: those of tl_replay_check(), in
 * job->error. */
tl_status tl_verb_job_use_recording(tl_verb_job *job, const tl_recording *recording);

/* Checks the output file `path` that the command-line option `option` names. It must not be a file
 * that this command also reads or writes: the configuration, an FMU, `recording`, the database or
 * the file of --csv. `path` or `recording` NULL: no such file. Errors: TL_BAD_USAGE. */
tl_status tl_verb_job_check_output(const tl_verb_job *job, const char *option, const char *path, const char *recording,
                                   tl_error *error);

/* Starts the FMU process. `results`: stream for the results of `check` (check_page.h), else NULL.
 * Errors: TL_TRY_AGAIN, with the reason in job->error. */
tl_status tl_verb_job_start(tl_verb_job *job, FILE *results);

/* Returns the settings of an FMU process for this job, which must outlive them. `results`: as for
 * tl_verb_job_start(). */
tl_twin_child_settings tl_verb_job_settings(const tl_verb_job *job, FILE *results);

/* Ends the FMU process, if there is one, and frees everything. Logs job->error, and an error if the
 * process failed at its end. Returns the exit code for `status`. If `status` is TL_OK or
 * TL_NOT_LOCKED, but the FMU process or the output failed, returns the exit code for that failure.
 */
int tl_verb_job_end(tl_verb_job *job, tl_status status);

#endif
