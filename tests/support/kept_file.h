/* Keeps the content of a file in memory, so that each test can get a copy without making the file
 * again.
 *
 * Errors: a file that cannot be read or written fails the test.
 * Thread: one thread.
 */
#ifndef TL_TESTS_SUPPORT_KEPT_FILE_H
#define TL_TESTS_SUPPORT_KEPT_FILE_H

#include <stddef.h>

typedef struct tl_kept_file {
    unsigned char *bytes; /* NULL: nothing is kept */
    size_t size;
} tl_kept_file;

/* Reads the file, which must not change meanwhile, and replaces the content kept before. */
void tl_kept_file_read(tl_kept_file *kept, const char *path);

/* Writes the kept content to `path`; an existing file is overwritten. */
void tl_kept_file_write(const tl_kept_file *kept, const char *path);

void tl_kept_file_free(tl_kept_file *kept);

#endif
