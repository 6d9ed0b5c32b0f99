/* The program twinlock-serve: options and start.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_SERVE_SERVE_VERB_H
#define TL_FIRMWARE_SERVE_SERVE_VERB_H

#include <stdbool.h>

#include "firmware/base/change.h"
#include "firmware/base/program_options.h"

/* ---- The options of `twinlock serve` and `twinlock token`.
 *
 * Thread: one thread, at the start of the process.
 */

/* Texts are those of the command line. */
typedef struct tl_serve_options {
    const char *listen; /* "127.0.0.1:8443" */
    tl_option_list hosts;
    const char *certificate; /* NULL: one of our own */
    const char *key;
    const char *state; /* folder of that */
    const char *tokens;
    const char *plants;
    bool fingerprint;
    bool unconfined;
} tl_serve_options;

tl_options_outcome tl_serve_options_read(int argc, char **argv, tl_serve_options *options);

typedef enum tl_token_action { TL_TOKEN_ADD, TL_TOKEN_LIST, TL_TOKEN_REVOKE } tl_token_action;

typedef struct tl_token_options {
    tl_token_action action;
    const char *name; /* of ADD and REVOKE */
    tl_change_right role;
    const char *tokens;
} tl_token_options;

/* argv[0] is "token". */
tl_options_outcome tl_token_options_read(int argc, char **argv, tl_token_options *options);

/* ---- `twinlock serve`: from its options to its end.
 *
 * Thread: the main thread.
 */

/* The exit code of the process. */
int tl_serve_verb_run(const tl_serve_options *options);

#endif
