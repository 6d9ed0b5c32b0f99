/* The recorder's ring: bytes from one producer to one consumer, in order, wait-free on both sides.
 *
 * Purpose: what the cycle puts waits here until it is committed. The consumer reads on with a cursor of its own and
 *          releases only after the commit, so that a batch that failed is read again.
 * Bound:   capacity is fixed; a put that does not fit is refused, never waited for.
 * Thread:  exactly one producer and one consumer; tl_recorder_ring_filled() from any thread.
 */
#ifndef TL_FIRMWARE_RECORD_RECORDER_RING_H
#define TL_FIRMWARE_RECORD_RECORDER_RING_H

#include <stdbool.h>
#include <stddef.h>

/* Positions count bytes since the start and wrap with size_t; capacity is a power of two, so they wrap together. */
typedef struct tl_recorder_ring {
    unsigned char *bytes;
    size_t capacity;
    size_t written; /* producer's own: end of what is appended, not yet published */
    size_t head;    /* published by the producer */
    size_t tail;    /* released by the consumer */
} tl_recorder_ring;

/* Takes `capacity` bytes, rounded up to a power of two, every page touched. False when memory is out. */
bool tl_recorder_ring_open(tl_recorder_ring *ring, size_t capacity);

/* A zeroed ring is allowed. */
void tl_recorder_ring_close(tl_recorder_ring *ring);

/* Producer: is there room for an entry of `size` bytes? If so, append its parts, `size` bytes in all, and publish. */
bool tl_recorder_ring_has_room(const tl_recorder_ring *ring, size_t size);
void tl_recorder_ring_append(tl_recorder_ring *ring, const void *part, size_t size);
void tl_recorder_ring_publish(tl_recorder_ring *ring);

/* Consumer: entries are between begin and end; read() copies `size` bytes and moves the cursor on. */
size_t tl_recorder_ring_begin(const tl_recorder_ring *ring);
size_t tl_recorder_ring_end(const tl_recorder_ring *ring);
void tl_recorder_ring_read(const tl_recorder_ring *ring, size_t *cursor, void *part, size_t size);
void tl_recorder_ring_release(tl_recorder_ring *ring, size_t cursor);

/* Bytes published and not yet released. */
size_t tl_recorder_ring_filled(const tl_recorder_ring *ring);

#endif
