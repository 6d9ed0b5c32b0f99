/* A snapshot: the newest copy of a small struct, from one writer to any readers, wait-free for the writer.
 *
 * Purpose: the cycle shows what it does; the status line and, later, the server look.
 * Bound:   read tries TL_SNAPSHOT_TRIES times while the writer overtakes it, then says so.
 */
#ifndef TL_FIRMWARE_BASE_SNAPSHOT_H
#define TL_FIRMWARE_BASE_SNAPSHOT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { TL_SNAPSHOT_WORDS = 256, TL_SNAPSHOT_TRIES = 8 };

/* A zeroed snapshot holds zeroes. Fields are private. */
typedef struct tl_snapshot {
    uint64_t sequence; /* odd while written */
    uint64_t words[TL_SNAPSHOT_WORDS];
} tl_snapshot;

/* `size` is at most 8·TL_SNAPSHOT_WORDS, and the same at every call. */
void tl_snapshot_publish(tl_snapshot *snapshot, const void *data, size_t size);
bool tl_snapshot_read(const tl_snapshot *snapshot, void *data, size_t size);

#endif
