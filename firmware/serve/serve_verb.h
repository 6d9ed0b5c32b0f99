/* `twinlock serve`: from its options to its end.
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_SERVE_SERVE_VERB_H
#define TL_FIRMWARE_SERVE_SERVE_VERB_H

#include "firmware/serve/serve_options.h"

/* The exit code of the process. */
int tl_serve_verb_run(const tl_serve_options *options);

#endif
