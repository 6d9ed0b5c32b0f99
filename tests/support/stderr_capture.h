/* Catches what a test makes the program write to stderr.
 *
 * Thread: one capture at a time in a process.
 */
#ifndef TL_TESTS_SUPPORT_STDERR_CAPTURE_H
#define TL_TESTS_SUPPORT_STDERR_CAPTURE_H

#include <stdbool.h>

/* From now on stderr goes to a file of its own. false where that fails. */
bool tl_stderr_capture_begin(void);

/* stderr is as it was; the result is what was written, free() it. NULL where there was no capture. */
char *tl_stderr_capture_end(void);

#endif
