/* The heap of an FMU: memory that it allocates comes from a place of its own, so that it can be copied.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_HEAP_H
#define TL_FIRMWARE_ROLLBACK_FMU_HEAP_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

/* ---- The heap of one FMU: what its calls allocate lies in one range of addresses, so that it can be saved and put back by copying.
 *
 * Purpose: the allocator behind malloc() while a call of the FMU runs (fmu_heap.h). All that it knows of its blocks stands at the beginning of the
 *          range itself: whoever copies the first tl_fmu_heap_used() bytes back has put back what was allocated, too.
 * Range:   addresses are reserved at once, without memory, and made usable in pieces as they are needed. So nothing ever moves, and a process whose memory is
 *          locked has locked what is used, not what is reserved.
 * Blocks:  in classes of size, four to each doubling; a block that is given back waits in a list of its class for the next one of that class. Nothing is
 *          split or joined: the same calls lead to the same addresses, always.
 * Memory:  what was never given out, or lies behind what is used after a restore, is zero.
 * Trust:   an FMU may write into all of it, as into any heap of its process. What it destroys is its own.
 * Thread:  blocks may be taken and given back by any; all else by one at a time.
 */

/* Fields are private. */
typedef struct tl_fmu_heap {
    unsigned char *base; /* NULL: there is none */
    size_t reserved;     /* bytes of addresses */
    size_t usable;       /* bytes from the beginning on that may be touched; never less than once */
    size_t highest;      /* bytes from the beginning on that were ever used since they were zero */
    void *first;         /* the first block that was taken: random numbers of the C library, */
    bool is_not_all;     /* and whether the FMU has memory elsewhere */
    bool has_threads;    /* or threads */
    bool is_taken;       /* by a thread: one of the FMU's may give back what another has taken */
} tl_fmu_heap;

/* It is there until the process ends. Errors: TL_TRY_AGAIN: there are no addresses, or no memory. */
tl_status tl_fmu_heap_open(tl_fmu_heap *heap, size_t reserve, tl_error *error);

/* A block of at least `size` bytes, 0 counts as 1, at a multiple of `alignment`, a power of two and at least 16. NULL: there is no room. */
void *tl_fmu_heap_take(tl_fmu_heap *heap, size_t size, size_t alignment);

/* A block of this heap that was not given back yet. */
void tl_fmu_heap_give_back(tl_fmu_heap *heap, void *block);

/* Bytes that the block has, at least what was asked for. */
size_t tl_fmu_heap_size(const void *block);

static inline bool tl_fmu_heap_holds(const tl_fmu_heap *heap, const void *address) {
    return (size_t)((const unsigned char *)address - heap->base) < heap->reserved;
}

/* Bytes from the beginning of the range on that make up all of its state. */
size_t tl_fmu_heap_used(const tl_fmu_heap *heap);

/* `used` bytes that were saved by a copy are in place again: the rest is zero now. */
void tl_fmu_heap_restored(tl_fmu_heap *heap, size_t used);

/* ---- malloc() and its like: while a call of an FMU runs, they serve from that FMU's heap.
 *
 * Purpose: an FMU is a stranger's library and asks malloc() for memory, as do the libraries that it uses. The program defines the whole family, so that all
 *          of them come by here: who is in a call of an FMU with a heap (fmu_heap.h) is served from that, all others from the C library.
 * Loader:  what it asks for it keeps beyond the call, and nobody may take that back: it is served by the C library always.
 * Random:  the numbers of rand(), random() and drand48() are part of an FMU's state if it asks for them; the C library has one state for all. In
 *          a call of an FMU with a heap they come from that heap's own, seeded as a program's are at its start.
 * Full:    a heap that has no room any more is helped out by the C library: an FMU that is not rolled back by its memory needs no more than that.
 * Mapped:  memory that may be written, and that an FMU asks mmap() for itself, is in no heap, as what the C library has helped out with: that is noted there, since a copy of the heap is not all then.
 * Threads: that an FMU starts in a call are noted in its heap as well, also those that end before the call does.
 * Kept:    functions of the C library that allocate what the library keeps (environment, locales, time zones, exit handlers, users) run outside of the
 *          heap: after a restore the library would find there what was before. What they keep is not restored: an FMU that changes its
 *          environment finds what it has set last. Not here: what a function keeps for one caller (strtok(), hsearch(), an open stream).
 * Given back: a block goes where it came from, whoever gives it back, and when.
 * Sanitizer: it has an allocator of its own; then nothing is served from a heap, and tl_fmu_allocation_serves() says so.
 * Thread:  each thread is in one heap at a time, or in none. Heaps are opened by one thread.
 */

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
