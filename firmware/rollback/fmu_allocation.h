/* malloc() and its like: while a call of an FMU runs, they serve from that FMU's heap.
 *
 * Purpose: an FMU is a stranger's library and asks malloc() for memory, as do the libraries that it uses. The program defines the whole family, so that all
 *          of them come by here: who is in a call of an FMU with a heap (fmu_heap.h) is served from that, all others from the C library.
 * Loader:  what it asks for it keeps beyond the call, and nobody may take that back: it is served by the C library always.
 * Random:  the numbers of rand(), random() and drand48() are part of an FMU's state if it asks for them; the C library has one state for all. In
 *          a call of an FMU with a heap they come from that heap's own, seeded as a program's are at its start.
 * Full:    a heap that has no room any more is helped out by the C library: an FMU that is not rolled back by its memory needs no more than that.
 * Mapped:  memory that may be written, and that an FMU asks mmap() for itself, is in no heap, as what the C library has helped out with: that is noted there, since a copy of the heap is not all then.
 * Threads: that an FMU starts in a call are noted in its heap as well, also those that end before the call does.
 * Given back: a block goes where it came from, whoever gives it back, and when.
 * Sanitizer: it has an allocator of its own; then nothing is served from a heap, and tl_fmu_allocation_serves() says so.
 * Thread:  each thread is in one heap at a time, or in none. Heaps are opened by one thread.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_ALLOCATION_H
#define TL_FIRMWARE_ROLLBACK_FMU_ALLOCATION_H

#include <stdbool.h>

#include "firmware/rollback/fmu_heap.h"

/* Heaps of a process. */
enum { TL_FMU_ALLOCATION_HEAPS = 256 };

/* Whether this program serves FMUs from heaps at all. */
bool tl_fmu_allocation_serves(void);

/* A heap for an FMU that is to be loaded, with so many bytes of addresses. It is there until the process ends, as the FMU's library is, which may give back
 * blocks at the very end. NULL: TL_TRY_AGAIN: there are no addresses, or TL_FMU_ALLOCATION_HEAPS. */
tl_fmu_heap *tl_fmu_allocation_open(size_t reserve, tl_error *error);

/* Bytes that all heaps have used so far: what was given back counts still. */
size_t tl_fmu_allocation_used(void);

extern __thread tl_fmu_heap *tl_fmu_allocation_heap __attribute__((tls_model("initial-exec"))); /* private */

/* This thread is served from this heap from now on; NULL: by the C library. Returns what was before. */
static inline tl_fmu_heap *tl_fmu_allocation_enter(tl_fmu_heap *heap) {
    tl_fmu_heap *before = tl_fmu_allocation_heap;
    tl_fmu_allocation_heap = heap;
    __asm__ volatile("" : : : "memory"); /* a compiler believes that malloc() looks at no variable */
    return before;
}

#endif
