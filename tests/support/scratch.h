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

/* Creates the folder `parent`/`name`_XXXXXX. Ends the program if that fails. */
void tl_scratch_make(tl_scratch *scratch, const char *parent, const char *name);

/* Returns the path of a file in the folder; valid until the next call. */
const char *tl_scratch_path(tl_scratch *scratch, const char *name);

/* Removes the files in the folder; the folder stays. */
void tl_scratch_empty(tl_scratch *scratch);

/* Returns the number of files in the folder; −1 if it cannot be read. */
int tl_scratch_count(const tl_scratch *scratch);

void tl_scratch_remove(tl_scratch *scratch);

/* As tl_scratch_remove(), for the end of main(): returns `failures`, the result of UNITY_END(). */
int tl_scratch_finish(tl_scratch *scratch, int failures);

#endif
