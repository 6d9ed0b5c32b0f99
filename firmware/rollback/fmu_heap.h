/* The heap of an FMU: one address range for all memory that its calls allocate. A copy of the range
 * saves and restores this memory.
 *
 * Purpose: the allocator behind malloc() while a call of the FMU runs. Its management data lies at
 *          the beginning of the range itself. So a copy of the first tl_fmu_heap_used() bytes also
 *          restores which blocks are allocated.
 * Range:   all addresses are reserved at once, without memory, and made usable in pieces of 64 KiB
 *          when they are needed. So the heap never moves, and a process with locked memory locks
 *          only the usable part. On 64-bit machines, the heaps of all runs have the same addresses
 *          if these are free.
 * Blocks:  each has a size class: one per 16 bytes up to 1 KiB, above that four per doubling. A
 *          freed block waits in a list of its class for the next allocation of that class. Blocks
 *          are never split or joined, so the same calls always yield the same addresses.
 * Memory:  bytes that were never allocated are zero. After a restore, all bytes after the restored
 *          part are zero.
 * Trust:   an FMU may write to the whole range, as to any heap. This can only destroy data of the
 *          FMU itself.
 * Thread:  any thread may allocate and free blocks; all other functions: one thread at a time.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_HEAP_H
#define TL_FIRMWARE_ROLLBACK_FMU_HEAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>

#include "master/base/status.h"

/* Maximum numbers of one FMU: threads that are watched, keys of thread-specific values, descriptors
 * that are noted, and streams that are only written. */
enum { TL_FMU_HEAP_THREADS = 16, TL_FMU_HEAP_KEYS = 32, TL_FMU_HEAP_DESCRIPTORS = 1024, TL_FMU_HEAP_LOGS = 32 };

typedef struct tl_fmu_heap_thread {
    clockid_t clock; /* clock of the thread's processor time */
    int64_t ran;     /* processor time when it was last checked, ns; -1: it has ended */
} tl_fmu_heap_thread;

typedef enum tl_fmu_library_change {
    TL_FMU_LIBRARY_OPENS,
    TL_FMU_LIBRARY_OPENED,
    TL_FMU_LIBRARY_CLOSED
} tl_fmu_library_change;

/* Called before (OPENS) and after (OPENED) a call of the FMU opens a library whose path is known,
 * and after a call closes one (CLOSED). `library`: the result of dlopen() for OPENED, NULL if it
 * has failed; NULL otherwise. */
typedef void tl_fmu_heap_note_opening(void *context, tl_fmu_library_change change, void *library);

/* Fields are private, except those that the user of the heap (fmu_memory.h, fmu_libc.h) sets. */
typedef struct tl_fmu_heap {
    unsigned char *base;             /* NULL: no heap */
    size_t reserved;                 /* bytes of address range */
    size_t usable;                   /* bytes from the beginning that are accessible; never decreases */
    size_t highest;                  /* bytes from the beginning that may differ from zero */
    struct tl_fmu_heap_first *first; /* the first block: state of rand() and similar functions */
    bool has_outside_memory;         /* the FMU also has memory outside of the heap */
    bool has_reserved;               /* the FMU has mapped memory outside of the heap that is not writable */
    bool has_threads;                /* the FMU has threads that are not allowed, or that do not sleep */
    bool
        allows_threads; /* set by the user: threads that calls start are served from this heap too, and may sleep between calls */
    bool
        opens_outside; /* set by the user: constructors of libraries that a call opens by a path are served by the C library */
    bool has_constructed;                   /* such a constructor has allocated memory */
    tl_fmu_heap_note_opening *note_opening; /* set by the user, may be NULL */
    void *context;                          /* passed to note_opening */
    uint32_t threads_started;               /* allowed threads that calls have started */
    uint32_t threads_begun;                 /* how many of them have begun to run; some may have ended */
    uint32_t thread_count;                  /* as threads_begun; only the first TL_FMU_HEAP_THREADS are in `threads` */
    tl_fmu_heap_thread threads[TL_FMU_HEAP_THREADS];
    uint32_t key_count;                      /* keys that calls have created; a restore deletes later ones */
    unsigned keys[TL_FMU_HEAP_KEYS];         /* of type pthread_key_t, in order of creation */
    bool writes_files;                       /* a call has opened a file for writing, or has changed a folder */
    bool changes_environment;                /* a call has changed an environment variable */
    bool has_opened;                         /* `is_opened` has an entry; cleared by the user, like the entries */
    bool is_opened[TL_FMU_HEAP_DESCRIPTORS]; /* descriptors that calls have opened, and perhaps closed again */
    FILE *logs[TL_FMU_HEAP_LOGS];            /* streams that calls have opened for writing only; NULL: free entry */
    char log_modes[TL_FMU_HEAP_LOGS];        /* how they were opened: 'w' or 'a' */
    uint32_t saved_logs;                     /* bit i: a state may contain stream i of `logs` */
    bool was_written; /* a call has begun or a block was freed; cleared by fmu_memory.h at each save and restore */
    bool is_taken;    /* spin lock: a thread of the FMU may free a block while another thread allocates */
} tl_fmu_heap;

/* Creates a heap, which exists until the process ends. `reserve`: size of the address range, bytes;
 * rounded up to 64 KiB. Errors: TL_TRY_AGAIN if there are not enough addresses or memory. */
tl_status tl_fmu_heap_open(tl_fmu_heap *heap, size_t reserve, tl_error *error);

/* Allocates at least `size` bytes (0 counts as 1), with undefined contents. `alignment`: a power of
 * two, bytes; less than 16 counts as 16. Returns NULL if the heap is full. */
void *tl_fmu_heap_allocate(tl_fmu_heap *heap, size_t size, size_t alignment);

/* Frees a block of this heap; `block`: as returned by tl_fmu_heap_allocate(). */
void tl_fmu_heap_release(tl_fmu_heap *heap, void *block);

/* Returns the usable bytes of a block: at least the requested size. 0: the FMU has overwritten the
 * management data of the block. */
size_t tl_fmu_heap_size(const void *block);

/* Returns true if the address lies in the reserved range of this heap. */
static inline bool tl_fmu_heap_holds(const tl_fmu_heap *heap, const void *address) {
    return (size_t)((const unsigned char *)address - heap->base) < heap->reserved;
}

/* Like mmap() and munmap() of private memory: zeroed, and aligned to pages of 4096 bytes. To unmap
 * only a part of a mapping has no effect. The first function returns NULL if the heap is full. */
void *tl_fmu_heap_map(tl_fmu_heap *heap, size_t size);
void tl_fmu_heap_unmap(tl_fmu_heap *heap, void *address, size_t size);

/* Returns the number of bytes, from the beginning of the range, that contain the whole state of the
 * heap. */
size_t tl_fmu_heap_used(const tl_fmu_heap *heap);

/* Sets all bytes after the first `used` to zero. Call it after these were restored from a copy. */
void tl_fmu_heap_restored(tl_fmu_heap *heap, size_t used);

#endif
