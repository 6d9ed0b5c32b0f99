/* A file that is dear to make, kept in memory: each test that wants the same gets a copy of its own.
 *
 * Errors: what cannot be read or written fails the test.
 * Thread: one thread.
 */
#ifndef TL_TESTS_SUPPORT_KEPT_FILE_H
#define TL_TESTS_SUPPORT_KEPT_FILE_H

#include <stddef.h>

typedef struct tl_kept_file {
    unsigned char *bytes; /* NULL: nothing is kept */
    size_t size;
} tl_kept_file;

/* Keeps what is in a file that nobody is writing, in the place of what was kept before. */
void tl_kept_file_read(tl_kept_file *kept, const char *path);

/* Makes the file anew. */
void tl_kept_file_write(const tl_kept_file *kept, const char *path);

void tl_kept_file_free(tl_kept_file *kept);

#endif
