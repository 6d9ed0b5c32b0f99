/* Edits configuration texts and collects the problems that the reader reports.
 *
 * Owner:  the caller frees returned texts with free(); a verdict holds copies of all messages.
 * Thread: one thread.
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

/* The first TL_TEST_PROBLEMS problems, and the number of all problems. */
typedef struct tl_test_verdict {
    tl_status status;
    size_t count;
    tl_test_problem problems[TL_TEST_PROBLEMS];
    tl_config config; /* if status is TL_OK: release it with tl_config_free() */
} tl_test_verdict;

/* Returns the whole file with a NUL at its end, or NULL if the file is empty or cannot be read. */
char *tl_test_read_text(const char *path);

/* Returns a copy of `text` in which `new` replaces `old`, or NULL unless `text` has `old` exactly
 * once. */
char *tl_test_replaced(const char *text, const char *old, const char *new);

/* Copies the file `from` to `to` with the same replacement. Returns false unless `from` has `old`
 * exactly once and both files can be used. */
bool tl_test_write_replaced(const char *from, const char *to, const char *old, const char *new);

/* Returns the line (from 1) on which the first `part` begins in `text`, or 0 if there is none. */
size_t tl_test_line_of(const char *text, const char *part);

/* One change of a valid text: `new` replaces `old`. The reader must then report one problem with
 * these properties. */
typedef struct tl_test_change {
    const char *old;
    const char *new;
    const char *where; /* path of the problem */
    const char *parts; /* of its message, see message.h */
    const char *at;    /* a text on the line of the problem; NULL: `old` */
} tl_test_change;

/* Makes each change in a copy of `base`. The test fails unless the reader rejects the text for that
 * one problem. */
void tl_test_expect_problems(const char *base, const tl_test_change *changes, size_t count);

/* Read a configuration into a verdict. A text has the path bench/motor.json. */
void tl_test_judge_text(const char *text, size_t size, tl_test_verdict *verdict);
void tl_test_judge_file(const char *path, tl_test_verdict *verdict);

#endif
