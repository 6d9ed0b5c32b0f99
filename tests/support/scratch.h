/* A folder for one test program's files, removed with everything in it.
 *
 * Thread: one thread.
 */
#ifndef TL_TESTS_SUPPORT_SCRATCH_H
#define TL_TESTS_SUPPORT_SCRATCH_H

#include <limits.h>

typedef struct tl_scratch {
    char folder[PATH_MAX];
    char path[PATH_MAX]; /* of the last tl_scratch_path() */
} tl_scratch;

/* Makes `parent`/`name`_XXXXXX; ends the program where that is not possible. */
void tl_scratch_make(tl_scratch *scratch, const char *parent, const char *name);

/* The path of a file in the folder; valid until the next call. */
const char *tl_scratch_path(tl_scratch *scratch, const char *name);

/* Removes the files in the folder; the folder stays. */
void tl_scratch_empty(tl_scratch *scratch);

/* The number of files in it. */
int tl_scratch_count(const tl_scratch *scratch);

void tl_scratch_remove(tl_scratch *scratch);

/* The same as the last of main(): returns `failures`, what UNITY_END() said. */
int tl_scratch_finish(tl_scratch *scratch, int failures);

#endif
