/* A byte ring with two counters. The producer's release of `head` hands the bytes over, the consumer's release of `tail` hands the
 * room back; size_t is a machine word everywhere, so both are single loads and stores. */
#include "firmware/record/recorder_ring.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { PAGE = 4096 };

bool tl_recorder_ring_open(tl_recorder_ring *ring, size_t capacity) {
    memset(ring, 0, sizeof *ring);
    size_t rounded = PAGE;
    while (rounded < capacity && rounded <= SIZE_MAX / 4) {
        rounded *= 2;
    }
    ring->bytes = malloc(rounded);
    if (ring->bytes == NULL) {
        return false;
    }
    for (size_t i = 0; i < rounded; i += PAGE) {
        ((volatile unsigned char *)ring->bytes)[i] = 0; /* so that the cycle meets no page fault */
    }
    ring->capacity = rounded;
    return true;
}

void tl_recorder_ring_close(tl_recorder_ring *ring) {
    free(ring->bytes);
    memset(ring, 0, sizeof *ring);
}

bool tl_recorder_ring_has_room(const tl_recorder_ring *ring, size_t size) {
    size_t tail = __atomic_load_n(&ring->tail, __ATOMIC_ACQUIRE);
    return ring->capacity - (ring->written - tail) >= size;
}

void tl_recorder_ring_append(tl_recorder_ring *ring, const void *part, size_t size) {
    size_t at = ring->written & (ring->capacity - 1);
    size_t first = size < ring->capacity - at ? size : ring->capacity - at;
    memcpy(ring->bytes + at, part, first);
    memcpy(ring->bytes, (const unsigned char *)part + first, size - first);
    ring->written += size;
}

void tl_recorder_ring_publish(tl_recorder_ring *ring) {
    __atomic_store_n(&ring->head, ring->written, __ATOMIC_RELEASE);
}

size_t tl_recorder_ring_begin(const tl_recorder_ring *ring) {
    return __atomic_load_n(&ring->tail, __ATOMIC_RELAXED);
}

size_t tl_recorder_ring_end(const tl_recorder_ring *ring) {
    return __atomic_load_n(&ring->head, __ATOMIC_ACQUIRE);
}

void tl_recorder_ring_read(const tl_recorder_ring *ring, size_t *cursor, void *part, size_t size) {
    size_t at = *cursor & (ring->capacity - 1);
    size_t first = size < ring->capacity - at ? size : ring->capacity - at;
    memcpy(part, ring->bytes + at, first);
    memcpy((unsigned char *)part + first, ring->bytes, size - first);
    *cursor += size;
}

void tl_recorder_ring_release(tl_recorder_ring *ring, size_t cursor) {
    __atomic_store_n(&ring->tail, cursor, __ATOMIC_RELEASE);
}

size_t tl_recorder_ring_filled(const tl_recorder_ring *ring) {
    size_t tail = __atomic_load_n(&ring->tail, __ATOMIC_ACQUIRE);
    return __atomic_load_n(&ring->head, __ATOMIC_ACQUIRE) - tail;
}
