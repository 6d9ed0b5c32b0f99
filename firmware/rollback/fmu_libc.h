/* The C library for calls of FMUs: they allocate from the FMU's heap, and what a copy of the heap
 * lacks is noted.
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
 *          moved or removed; a file that is only written may stay open. Then its stream lies
 *          outside of the heap, and is used again if the FMU opens the file again.
 * Outside: functions of the C library that store data in the library run outside of the heap. These
 *          are functions for environment, locales, time zones, exit handlers and users. If this
 *          data were in the heap, the library would find old contents after a restore. So the data
 *          is not restored: an FMU that changes its environment finds the last change. Not handled:
 *          data that a function stores for one caller (strtok(), hsearch(), an open stream).
 * Freeing: a block is returned to the heap that it came from, in any thread and at any time.
 * Sanitizer: it has its own allocator. Then no heap is used and tl_fmu_libc_serves() returns
 *            false.
 * Thread:  each thread uses one heap at a time, or none. One thread opens the heaps.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_LIBC_H
#define TL_FIRMWARE_ROLLBACK_FMU_LIBC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/rollback/fmu_heap.h"
#include "master/base/status.h"

/* Heaps per process. */
enum { TL_FMU_LIBC_HEAPS = 256 };

/* Returns true if this program can serve FMUs from heaps. */
bool tl_fmu_libc_serves(void);

/* Creates a heap for an FMU before the FMU is loaded. `reserve`: size of the address range, bytes.
 * The heap exists until the process ends, because the FMU's library may free blocks until then.
 * Returns NULL with TL_TRY_AGAIN if there are not enough addresses, or if there are already
 * TL_FMU_LIBC_HEAPS heaps. */
tl_fmu_heap *tl_fmu_libc_open(size_t reserve, tl_error *error);

/* Bytes that all heaps have used so far, freed blocks included. */
size_t tl_fmu_libc_used(void);

/* Returns true if an allowed thread of the FMU has run since the last call of this function. */
bool tl_fmu_libc_threads_ran(tl_fmu_heap *heap);

/* Number of allowed threads that had not ended at the last tl_fmu_libc_threads_ran(). */
uint32_t tl_fmu_libc_threads_alive(const tl_fmu_heap *heap);

/* The values that the present thread has stored under the keys. The second function also deletes
 * the keys that were created since `count` values were read. Do nothing with a sanitizer. */
void tl_fmu_libc_read_keys(const tl_fmu_heap *heap, void *values[TL_FMU_HEAP_KEYS]);
void tl_fmu_libc_write_keys(tl_fmu_heap *heap, void *const values[TL_FMU_HEAP_KEYS], uint32_t count);

/* Call it when a state is saved: streams that the FMU has open then are never closed. */
void tl_fmu_libc_keep_logs(tl_fmu_heap *heap);

extern __thread tl_fmu_heap *tl_fmu_libc_heap __attribute__((tls_model("initial-exec"))); /* private */

/* Serves this thread from `heap` from now on; NULL: from the C library. Returns the previous heap.
 */
static inline tl_fmu_heap *tl_fmu_libc_enter(tl_fmu_heap *heap) {
    tl_fmu_heap *before = tl_fmu_libc_heap;
    tl_fmu_libc_heap = heap;
    __asm__ volatile("" : : : "memory"); /* compilers assume that malloc() reads no variable */
    return before;
}

#endif
