/* The files of the versions, one by one: for the sources behind versions.h.
 *
 * Purpose: each is written whole, or not at all; none is believed when it is read.
 * Errors:  TL_TRY_AGAIN where the disk refuses.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_RETUNE_VERSIONS_PARTS_H
#define TL_FIRMWARE_RETUNE_VERSIONS_PARTS_H

#include "firmware/base/json_reader.h"
#include "firmware/base/json_writer.h"
#include "firmware/retune/versions.h"

/* A version's number has so many digits at most. */
enum { TL_VERSION_DIGITS = 15 };

/* What a name in the folder means. */
typedef enum tl_version_file {
    TL_VERSION_FILE_FOREIGN,
    TL_VERSION_FILE_RECORD, /* and its number */
    TL_VERSION_FILE_TEXT,   /* and its hash */
    TL_VERSION_FILE_LEFT    /* that a power cut left unfinished */
} tl_version_file;

tl_version_file tl_version_file_of(const char *name, uint64_t *number, char hash[TL_SHA256_TEXT]);

void tl_version_record_path(const tl_versions *versions, uint64_t number, char path[PATH_MAX]);
void tl_version_text_path(const tl_versions *versions, const char *hash, char path[PATH_MAX]);

/* A small file, whole or not at all. */
tl_status tl_version_write_object(const char *path, const tl_json_writer *writer, tl_error *error);

/* False where it cannot be read; `reader` is to be freed in any case. */
bool tl_version_read_object(const char *path, tl_json_reader *reader);

tl_status tl_version_write_record(const tl_versions *versions, const tl_version *version, tl_error *error);

/* False: it is damaged. */
bool tl_version_read_record(const tl_versions *versions, uint64_t number, tl_version *version);

/* *made: it was not there before. */
tl_status tl_version_write_text(const tl_versions *versions, const char *hash, const char *text, size_t size,
                                bool *made, tl_error *error);

/* Of so many bytes with this hash; the caller's to free(). NULL: there is none, and `error` says why. */
char *tl_version_read_text(const tl_versions *versions, const char *hash, uint64_t size, tl_error *error);

/* active.json. */
tl_status tl_version_write_active(const tl_versions *versions, tl_error *error);

typedef enum tl_version_found { TL_VERSION_NONE, TL_VERSION_DAMAGED, TL_VERSION_FOUND } tl_version_found;

/* What it says goes to `versions` if it is found, else nothing. */
tl_version_found tl_version_read_active(tl_versions *versions);

/* What is to hold from now on: from here on it does, on disk and so in `versions`. If the disk refuses, nothing has changed. */
tl_status tl_version_put(tl_versions *versions, const tl_versions *next, tl_error *error);

#endif
