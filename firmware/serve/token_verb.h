/* `twinlock token`: makes, lists and revokes tokens.
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_SERVE_TOKEN_VERB_H
#define TL_FIRMWARE_SERVE_TOKEN_VERB_H

#include "firmware/serve/serve_verb.h"

/* The exit code of the process. */
int tl_token_verb_run(const tl_token_options *options);

#endif
