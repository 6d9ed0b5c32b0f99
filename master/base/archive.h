/* Archive: copies memory to bytes and back by one function for both directions.
 *
 * Purpose: a module lists the parts of its state once, so that saving and loading cannot differ.
 * Format:  raw memory. An archive is valid only for the same program on the same kind of machine.
 * Bound:   never reads or writes beyond `size`. On overflow it only counts the bytes that it would
 *          have needed.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_BASE_ARCHIVE_H
#define TL_MASTER_BASE_ARCHIVE_H

#include <stdbool.h>
#include <stddef.h>

typedef struct tl_archive {
    unsigned char *to;         /* saving; NULL: bytes are only counted */
    const unsigned char *from; /* loading; NULL: saving */
    size_t size;               /* bytes at `to` or `from` */
    size_t at;                 /* bytes so far; above `size`: bytes did not fit, were missing, or were rejected */
} tl_archive;

/* `to` NULL: only counts the bytes. The memory must outlive the archive. */
tl_archive tl_archive_saving(unsigned char *to, size_t size);
tl_archive tl_archive_loading(const unsigned char *from, size_t size);

bool tl_archive_is_loading(const tl_archive *archive);

/* Saves or loads the next `size` bytes at `memory`. When loading, `memory` is unchanged if bytes
 * are missing. */
void tl_archive_part(tl_archive *archive, void *memory, size_t size);

/* Return the next `size` bytes of the archive's own memory, without a copy: room() when saving, to
 * write to; bytes() when loading, to read. NULL: they do not fit, are missing, or only counted. */
unsigned char *tl_archive_room(tl_archive *archive, size_t size);
const unsigned char *tl_archive_bytes(tl_archive *archive, size_t size);

/* Saves or loads a flag as one byte. Loading rejects any byte except 0 and 1, because a bool can
 * hold no other value. */
void tl_archive_flag(tl_archive *archive, bool *flag);

/* When loading: rejects the archive if `right` is false. The bytes may be damaged or malicious, so
 *               a module checks each index, count, time and number that it has loaded. */
void tl_archive_require(tl_archive *archive, bool right);

/* When loading: rejects the archive if a value is not finite. */
void tl_archive_require_finite(tl_archive *archive, const double *values, size_t count);

/* False: a part did not fit, was missing, or was rejected; or bytes were only counted. */
bool tl_archive_is_whole(const tl_archive *archive);

#endif
