/* The options of all verbs: what was given, read and checked.
 *
 * Purpose: a verb is run with values, not with words. option_table.h says which options there are; they are read here, as are the
 *          rules between them, and what is wrong is told with what was probably meant.
 * Owner:   texts are those of the command line, and live as long as it does.
 * Thread:  one thread, at the start of the process.
 */
#ifndef TL_FIRMWARE_CLI_OPTIONS_H
#define TL_FIRMWARE_CLI_OPTIONS_H

#include <limits.h>

#include "firmware/cli/option_types.h"
#include "firmware/config/config.h"

typedef enum tl_options_outcome {
    TL_OPTIONS_READ,   /* the verb can run */
    TL_OPTIONS_HELPED, /* help was asked for, and printed to standard output */
    TL_OPTIONS_WRONG   /* wrong usage; standard error says what, and what to do */
} tl_options_outcome;

/* Reads what is behind the verb: argv[1] is the first word of it. Options may be shortened as long as they stay unambiguous, and may
 * stand before and behind the subject. `argv` is put into another order. */
tl_options_outcome tl_options_read(tl_verb verb, int argc, char **argv, tl_options *options);

/* The path of the recording: the one given, else the one configured. TL_BAD_USAGE if there is neither, TL_BAD_DATA
 * if the file is only there with other letters' case; else who opens it says what is wrong with it. */
tl_status tl_options_find_recording(const tl_options *options, const tl_config *config, char path[PATH_MAX],
                                    tl_error *error);

#endif
