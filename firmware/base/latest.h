/* A latest-value register: the newest copy of a small struct, from one writer to any readers, wait-free for the writer.
 *
 * Purpose: the cycle shows what it does; the status line and, later, the server look.
 * Bound:   read tries TL_LATEST_TRIES times while the writer overtakes it, then says so.
 */
#ifndef TL_FIRMWARE_BASE_LATEST_H
#define TL_FIRMWARE_BASE_LATEST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { TL_LATEST_WORDS = 256, TL_LATEST_TRIES = 8 };

/* A zeroed register holds zeroes. Fields are private. */
typedef struct tl_latest {
    uint64_t sequence; /* odd while written */
    uint64_t words[TL_LATEST_WORDS];
} tl_latest;

/* `size` is at most 8·TL_LATEST_WORDS, and the same at every call. */
void tl_latest_publish(tl_latest *latest, const void *data, size_t size);
bool tl_latest_read(const tl_latest *latest, void *data, size_t size);

#endif
