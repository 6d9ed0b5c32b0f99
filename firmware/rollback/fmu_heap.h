/* The heap of an FMU: its allocations come from one memory range that can be copied.
 *
 * Thread:  as each section says.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_HEAP_H
#define TL_FIRMWARE_ROLLBACK_FMU_HEAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#include "master/base/status.h"

/* ---- The heap of one FMU: one address range for all memory that its calls allocate. A copy saves
 * and restores it.
 *
 * Purpose: the allocator behind malloc() while a call of the FMU runs. Its management data lies at
 *          the beginning of the range itself. So a copy of the first tl_fmu_heap_used() bytes also
 *          restores which blocks are allocated.
 * Range:   all addresses are reserved at once, without memory, and made usable in pieces when they
 *          are needed. So no block ever moves, and a process with locked memory locks only the used
 *          part.
 * Blocks:  in size classes, four per doubling. A freed block waits in a list of its class for the
 *          next allocation of that class. Blocks are never split or joined, so that the same calls
 *          always yield the same addresses.
 * Memory:  bytes that were never allocated, or that lie after the used part after a restore, are
 *          zero.
 * Trust:   an FMU may write to the whole range, as to any heap of its process. It can only destroy
 *          its own data.
 * Thread:  any thread may allocate and free blocks; all other functions: one thread at a time.
 */

/* Most threads of an FMU that are watched, most keys of thread-specific values, and most
 * descriptors. */
enum { TL_FMU_HEAP_THREADS = 16, TL_FMU_HEAP_KEYS = 32, TL_FMU_HEAP_DESCRIPTORS = 1024 };

typedef struct tl_fmu_heap_thread {
    clockid_t clock; /* of its processor time */
    int64_t ran;     /* processor time when it was last checked, ns; -1: it has ended */
} tl_fmu_heap_thread;

/* Called before and after a call of the FMU opens a library whose path is known. `library`: what
 * dlopen() has returned; NULL before. */
typedef void tl_fmu_heap_note_opening(void *context, bool is_opened, void *library);

/* Fields are private, except those that the user sets. */
typedef struct tl_fmu_heap {
    unsigned char *base;     /* NULL: no heap */
    size_t reserved;         /* bytes of address range */
    size_t usable;           /* bytes from the beginning that are accessible; never decreases */
    size_t highest;          /* bytes from the beginning that may differ from zero */
    void *first;             /* the first block: state of rand() and similar functions */
    bool has_outside_memory; /* the FMU also has memory outside of the heap */
    bool has_reserved;       /* the FMU has reserved addresses outside of the heap, without access */
    bool has_threads;        /* the FMU has started threads that are not allowed */
    bool
        allows_threads; /* set by the user: threads that calls start are served from this heap too, and may sleep between calls */
    bool
        opens_outside; /* set by the user: constructors of libraries that a call opens by a path are served by the C library */
    bool has_constructed;                   /* such a constructor has allocated memory */
    tl_fmu_heap_note_opening *note_opening; /* set by the user, may be NULL */
    void *context;                          /* of note_opening */
    uint32_t threads_started;               /* allowed threads that calls have started */
    uint32_t threads_begun;                 /* those of them that run by now */
    uint32_t thread_count;                  /* used entries of `threads`; may exceed their number */
    tl_fmu_heap_thread threads[TL_FMU_HEAP_THREADS];
    uint32_t key_count;                      /* keys that calls have created and not deleted */
    unsigned keys[TL_FMU_HEAP_KEYS];         /* of type pthread_key_t, in order of creation */
    bool writes_files;                       /* a call has opened a file for writing, or has changed a folder */
    bool changes_environment;                /* a call has changed an environment variable */
    bool has_opened;                         /* `is_opened` has an entry; cleared by the user, like the entries */
    bool is_opened[TL_FMU_HEAP_DESCRIPTORS]; /* descriptors that calls have opened, and perhaps closed again */
    bool was_written; /* a call has begun or a block was freed; cleared by fmu_memory.h at each save and restore */
    bool is_taken;    /* spin lock: a thread of the FMU may free a block while another thread allocates */
} tl_fmu_heap;

/* Creates a heap, which exists until the process ends. `reserve`: size of the address range, bytes.
 * Errors: TL_TRY_AGAIN if there are not enough addresses or memory. */
tl_status tl_fmu_heap_open(tl_fmu_heap *heap, size_t reserve, tl_error *error);

/* Allocates at least `size` bytes (0 counts as 1), aligned to `alignment`, a power of two of at
 * least 16. Returns NULL if the heap is full. */
void *tl_fmu_heap_allocate(tl_fmu_heap *heap, size_t size, size_t alignment);

/* Frees a block of this heap. */
void tl_fmu_heap_release(tl_fmu_heap *heap, void *block);

/* Usable bytes of a block: at least the requested size. */
size_t tl_fmu_heap_size(const void *block);

/* Returns true if the address lies in the reserved range of this heap. */
static inline bool tl_fmu_heap_holds(const tl_fmu_heap *heap, const void *address) {
    return (size_t)((const unsigned char *)address - heap->base) < heap->reserved;
}

/* Like mmap() and munmap() of private memory: zeroed, and aligned to pages of 4096 bytes. A partly
 * unmapped mapping stays whole. The first function returns NULL if the heap is full. */
void *tl_fmu_heap_map(tl_fmu_heap *heap, size_t size);
void tl_fmu_heap_unmap(tl_fmu_heap *heap, void *address, size_t size);

/* Returns true if an allowed thread has run since the last call of this function. */
bool tl_fmu_heap_threads_ran(tl_fmu_heap *heap);

/* Number of allowed threads that had not ended at the last tl_fmu_heap_threads_ran(). */
uint32_t tl_fmu_heap_threads_alive(const tl_fmu_heap *heap);

/* The values that the present thread has stored under the keys. The second function also deletes
 * the keys that were created since `count` values were read. Do nothing with a sanitizer. */
void tl_fmu_heap_read_keys(const tl_fmu_heap *heap, void *values[TL_FMU_HEAP_KEYS]);
void tl_fmu_heap_write_keys(tl_fmu_heap *heap, void *const values[TL_FMU_HEAP_KEYS], uint32_t count);

/* Bytes from the beginning of the range that contain its whole state. */
size_t tl_fmu_heap_used(const tl_fmu_heap *heap);

/* Call it after the first `used` bytes were restored from a copy: sets all other bytes to zero. */
void tl_fmu_heap_restored(tl_fmu_heap *heap, size_t used);

/* ---- malloc() and related functions: they serve a call of an FMU from that FMU's heap.
 *
 * Purpose: an FMU and the libraries that it uses allocate memory by malloc(). The program defines
 *          this whole family of functions. A thread in a call of an FMU with a heap is served from
 *          that heap; all other calls are served by the C library.
 * Loader:  the dynamic loader keeps its memory after the call, and this memory must not be rolled
 *          back. So the C library always serves the loader.
 * Random:  the numbers of rand(), random() and drand48() belong to the state of an FMU that uses
 *          them, but the C library has one state for the whole process. During a call of an FMU
 *          with a heap they use a state in that heap, with the seed of a newly started program.
 * Full:    if a heap is full, the C library serves the request. Then the FMU cannot be rolled back
 *          by memory, but it can still run.
 * Mapped:  private memory that an FMU maps by mmap() comes from its heap too. Other writable
 *          mappings, for example shared ones, are outside, like memory from the C library. The heap
 *          notes both, because a copy of the heap is then incomplete.
 * Threads: the heap also notes each thread that an FMU starts in a call, even if the thread ends
 *          before the call does. Not noted: raw system calls of an FMU.
 * Keys:    thread-specific values (pthread_setspecific()) lie in the C library. The heap notes the
 *          keys that a call creates, so that fmu_memory.h can save the values of the thread that
 *          calls the FMU.
 * Files:   the heap notes the descriptors that a call opens by functions of the C library, because
 *          a file that stays open is not part of a copy. It also notes that files are written,
 *          moved or removed; a file that is only written may stay open.
 * Outside: functions of the C library that store data in the library run outside of the heap. These
 *          are functions for environment, locales, time zones, exit handlers and users. If this
 *          data were in the heap, the library would find old contents after a restore. So the data
 *          is not restored: an FMU that changes its environment finds the last change. Not handled:
 *          data that a function stores for one caller (strtok(), hsearch(), an open stream).
 * Freeing: a block is returned to the heap that it came from, in any thread and at any time.
 * Sanitizer: it has its own allocator. Then no heap is used and tl_fmu_allocation_serves() returns
 *            false.
 * Thread:  each thread uses one heap at a time, or none. One thread opens the heaps.
 */

/* Heaps per process. */
enum { TL_FMU_ALLOCATION_HEAPS = 256 };

/* Returns true if this program can serve FMUs from heaps. */
bool tl_fmu_allocation_serves(void);

/* Creates a heap for an FMU before the FMU is loaded. `reserve`: size of the address range, bytes.
 * The heap exists until the process ends, because the FMU's library may free blocks until then.
 * Returns NULL with TL_TRY_AGAIN if there are not enough addresses, or if there are already
 * TL_FMU_ALLOCATION_HEAPS heaps. */
tl_fmu_heap *tl_fmu_allocation_open(size_t reserve, tl_error *error);

/* Bytes that all heaps have used so far, freed blocks included. */
size_t tl_fmu_allocation_used(void);

extern __thread tl_fmu_heap *tl_fmu_allocation_heap __attribute__((tls_model("initial-exec"))); /* private */

/* Serves this thread from `heap` from now on; NULL: from the C library. Returns the previous heap.
 */
static inline tl_fmu_heap *tl_fmu_allocation_enter(tl_fmu_heap *heap) {
    tl_fmu_heap *before = tl_fmu_allocation_heap;
    tl_fmu_allocation_heap = heap;
    __asm__ volatile("" : : : "memory"); /* compilers assume that malloc() reads no variable */
    return before;
}

#endif
