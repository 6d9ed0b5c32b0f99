/* Captures what the test program writes to stderr.
 *
 * Thread: one capture at a time in a process.
 */
#ifndef TL_TESTS_SUPPORT_STDERR_CAPTURE_H
#define TL_TESTS_SUPPORT_STDERR_CAPTURE_H

#include <stdbool.h>
#include <stddef.h>

/* From now on stderr goes to a temporary file. Returns false if that fails. */
bool tl_stderr_capture_begin(void);

/* Restores stderr and returns the captured text, which the caller frees. NULL: there was no
 * capture. */
char *tl_stderr_capture_end(void);

/* Ends the capture. The test fails unless the captured text is `expected`. */
void tl_stderr_expect(const char *expected);

/* Ends the capture. The test fails unless it has `count` lines, and each line has all its parts
 * (message.h). */
void tl_stderr_expect_lines(const char *const *parts, size_t count);

/* Returns the number of lines of a text. */
size_t tl_test_count_lines(const char *text);

#endif
