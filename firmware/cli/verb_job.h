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
} tl_verb_job;

/* Installs what hears signals, and reads the configuration; what is wrong with it was said on the log. */
tl_status tl_verb_job_read(tl_verb_job *job);

/* Starts the process. `config`: as its twin takes it (twin_child.h). `page`: where a check prints to; else NULL. */
tl_status tl_verb_job_start(tl_verb_job *job, const tl_config *config, FILE *page, tl_error *error);

/* With what it is started. */
tl_twin_child_settings tl_verb_job_settings(const tl_verb_job *job, const tl_config *config, FILE *page);

/* Ends the process, if there is one, and frees all. Says on the log what it did wrong in its end. The exit code. */
int tl_verb_job_end(tl_verb_job *job, tl_status status);

#endif
