/* An archive: memory copied into bytes and back, both by the same walk over what is to be kept.
 *
 * Purpose: whoever has a state names its parts once; what is saved and what is loaded cannot differ then.
 * Bytes:   as they lie in memory, so they are for the same program on the same kind of machine only.
 * Bound:   nothing is written or read beyond `size`; the walk goes on and counts what it would have needed.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_BASE_ARCHIVE_H
#define TL_MASTER_BASE_ARCHIVE_H

#include <stdbool.h>
#include <stddef.h>

typedef struct tl_archive {
    unsigned char *to;         /* saving; NULL: what would be saved is counted */
    const unsigned char *from; /* loading; NULL: saving */
    size_t size;               /* of either */
    size_t at;                 /* bytes so far; above `size`: they did not fit, or there were not as many */
} tl_archive;

tl_archive tl_archive_saving(unsigned char *to, size_t size);
tl_archive tl_archive_loading(const unsigned char *from, size_t size);

bool tl_archive_is_loading(const tl_archive *archive);

/* The next `size` bytes are those at `memory`. When loading, `memory` stays as it is where they are not all there. */
void tl_archive_part(tl_archive *archive, void *memory, size_t size);

/* The next `size` bytes, in place: to be filled, or to be read. NULL where they do not fit, or only count. */
unsigned char *tl_archive_room(tl_archive *archive, size_t size);
const unsigned char *tl_archive_bytes(tl_archive *archive, size_t size);

/* The next byte is this flag. A byte that is none is refused when loading: a bool must never hold it. */
void tl_archive_flag(tl_archive *archive, bool *flag);

/* When loading: what came so far must be so, else the archive is not whole. Bytes may be damaged, or made to do harm, so whoever
 * loads an index, a count, a time or a number says what it has to be. */
void tl_archive_require(tl_archive *archive, bool right);

/* The same of numbers: they must be finite. */
void tl_archive_require_finite(tl_archive *archive, const double *values, size_t count);

/* False: something did not fit, was not there, or was refused. */
bool tl_archive_is_whole(const tl_archive *archive);

#endif
