/* `twinlock push`: from its options to its end.
 *
 * Thread: the main thread.
 */
#ifndef TL_FIRMWARE_PUSH_PUSH_VERB_H
#define TL_FIRMWARE_PUSH_PUSH_VERB_H

#include "firmware/push/push_options.h"

/* The exit code of the process. */
int tl_push_verb_run(const tl_push_options *options);

#endif
