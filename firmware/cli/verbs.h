/* The verbs of the command line. Each runs with options that were read and checked, and returns the exit code of the process (options.h).
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_CLI_VERBS_H
#define TL_FIRMWARE_CLI_VERBS_H

#include "firmware/cli/options.h"

int tl_verb_check(const tl_options *options);
int tl_verb_plant(const tl_options *options);
int tl_verb_reload(const tl_options *options);
int tl_verb_replay(const tl_options *options);
int tl_verb_run(const tl_options *options);
int tl_verb_show(const tl_options *options);

#endif
