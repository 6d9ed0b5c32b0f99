/* The verbs of the command line. Each runs with options that were read and checked, and returns the exit code of the process (option_table.h).
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_CLI_VERBS_H
#define TL_FIRMWARE_CLI_VERBS_H

#include <stdio.h>

#include "firmware/cli/options.h"
#include "firmware/twin/twin_role.h"

int tl_verb_check(const tl_options *options);

/* The page of a check: in the process with the FMUs (twin_role.h). */
tl_status tl_verb_check_page(const tl_assembly *assembly, const tl_twin_job *job, tl_status status,
                             const tl_read_back_host *host, FILE *page, uint32_t *warnings);

/* What the process with the FMUs does of what is above its room. */
extern const tl_twin_role_tasks tl_verb_twin_tasks;

int tl_verb_plant(const tl_options *options);
int tl_verb_reload(const tl_options *options);
int tl_verb_replay(const tl_options *options);
int tl_verb_run(const tl_options *options);
int tl_verb_show(const tl_options *options);

#endif
