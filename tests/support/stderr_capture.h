/* Catches what a test makes the program write to stderr.
 *
 * Thread: one capture at a time in a process.
 */
#ifndef TL_TESTS_SUPPORT_STDERR_CAPTURE_H
#define TL_TESTS_SUPPORT_STDERR_CAPTURE_H

#include <stdbool.h>
#include <stddef.h>

/* From now on stderr goes to a file of its own. false where that fails. */
bool tl_stderr_capture_begin(void);

/* stderr is as it was; the result is what was written, free() it. NULL where there was no capture. */
char *tl_stderr_capture_end(void);

/* The end of a capture that has caught just that text; else the test fails. */
void tl_stderr_expect(const char *expected);

/* The end of a capture that has caught `count` lines, each with its list of parts (message.h); else the test fails. */
void tl_stderr_expect_lines(const char *const *parts, size_t count);

/* How many lines there are in a text. */
size_t tl_test_count_lines(const char *text);

#endif
