/* Files of a recording, read as UTF-8.
 *
 * Purpose: decodes gzip and UTF-16, and lists the files of a folder.
 * Owner:   the caller closes each file, and frees a list.
 * Thread:  one per file.
 */
#ifndef TL_BOARD_CSV_CSV_FILE_H
#define TL_BOARD_CSV_CSV_FILE_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

typedef struct tl_csv_file tl_csv_file;

/* Opens a file or FIFO. Errors: TL_BAD_DATA: it is a device, or cannot be opened; TL_TRY_AGAIN: out
 * of memory or descriptors. */
tl_status tl_csv_file_open(const char *path, tl_csv_file **file, tl_error *error);

/* Reads up to `room` bytes; *count is 0 at the end. A regular file that begins as gzip is
 * decompressed; a byte order mark of UTF-16 makes it UTF-16. `path`: for error texts. Errors:
 * TL_BAD_DATA: the file cannot be read, or its compressed data is damaged or incomplete. */
tl_status tl_csv_file_read(tl_csv_file *file, const char *path, char *bytes, size_t room, size_t *count,
                           tl_error *error);

/* True for a regular file: reading ahead does not block. */
bool tl_csv_file_is_regular(const tl_csv_file *file);

/* How the bytes read so far are written, for messages: "gzip", "UTF-16", "gzip, UTF-16" or "". */
const char *tl_csv_file_form(const tl_csv_file *file);

/* NULL is allowed. */
void tl_csv_file_close(tl_csv_file *file);

/* Sets *paths to the file `path`, or if it is a folder to all files in it whose names do not begin
 * with a point, in the order of their names; numbers in names count as numbers. The caller frees
 * it, also after an error. Errors: TL_BAD_DATA: the folder is empty; TL_TRY_AGAIN: out of memory.
 */
tl_status tl_csv_file_list(const char *path, char ***paths, size_t *count, tl_error *error);

/* NULL is allowed. */
void tl_csv_file_list_free(char **paths, size_t count);

#endif
