/* Configurations as texts: read, edited, and judged by the reader.
 *
 * Purpose: a test says which words of a valid configuration it replaces, and gets back what the reader says about it.
 * Owner:   texts are the caller's, to free(); a verdict holds its texts itself.
 * Thread:  one thread.
 */
#ifndef TL_TESTS_SUPPORT_CONFIG_TEXT_H
#define TL_TESTS_SUPPORT_CONFIG_TEXT_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/config.h"
#include "master/base/status.h"

enum { TL_TEST_PROBLEMS = 24 };

typedef struct tl_test_problem {
    tl_status status;
    char where[300];
    char text[TL_ERROR_TEXT];
} tl_test_problem;

/* What the reader said: the first TL_TEST_PROBLEMS problems, and the number of all. */
typedef struct tl_test_verdict {
    tl_status status;
    size_t count;
    tl_test_problem problems[TL_TEST_PROBLEMS];
    tl_config config; /* where status is TL_OK: for tl_config_free() */
} tl_test_verdict;

/* The whole file, with a NUL behind it; NULL where it cannot be read. */
char *tl_test_read_text(const char *path);

/* A copy of `text` in which `old` is replaced by `new`; NULL where `old` is not there exactly once. */
char *tl_test_replaced(const char *text, const char *old, const char *new);

/* The same of a whole file, into another one; false where `old` is not there exactly once, or a file cannot be used. */
bool tl_test_write_replaced(const char *from, const char *to, const char *old, const char *new);

/* The line (from 1) on which `part` begins in `text`; 0 where it is not there. */
size_t tl_test_line_of(const char *text, const char *part);

/* One change of a valid text: `old` becomes `new`; the one problem is then at `where`, on the line of `at` (NULL: of `old`). */
typedef struct tl_test_change {
    const char *old;
    const char *new;
    const char *where;
    const char *parts; /* of its message, see message.h; it begins with "line N: " */
    const char *at;
} tl_test_change;

/* Each of the changes makes the reader find just that problem; else the test fails. */
void tl_test_expect_problems(const char *base, const tl_test_change *changes, size_t count);

void tl_test_judge_text(const char *text, size_t size, tl_test_verdict *verdict);
void tl_test_judge_file(const char *path, tl_test_verdict *verdict);

#endif
