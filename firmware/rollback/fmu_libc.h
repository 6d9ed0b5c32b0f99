/* Replaces functions of the C library for calls of FMUs: allocations come from the FMU's heap, and
 * the heap notes everything that a copy of it lacks.
 *
 * Purpose: an FMU and the libraries that it uses allocate memory by malloc() and related functions.
 *          The program defines these functions itself. In a call of an FMU with a heap, a thread is
 *          served from that heap; all other calls are served by the C library.
 * Loader:  the dynamic loader keeps its memory after the call, and this memory must not be rolled
 *          back. So the C library always serves the loader.
 * Random:  random numbers of rand(), random() and drand48() belong to the state of an FMU. But the
 *          C library has one random state for the whole process. So during a call of an FMU with a
 *          heap, these functions use a random state in that heap. Its seed is that of a new
 *          process.
 * Full:    if a heap is full, the C library serves the request. Then the FMU cannot be rolled back
 *          by memory, but it can still run.
 * Mapped:  private memory that an FMU maps by mmap() comes from its heap too. Other writable
 *          mappings, for example shared ones, lie outside of the heap, like memory from the C
 *          library. The heap notes both, because a copy of the heap is then incomplete.
 * Threads: the heap also notes each thread that an FMU starts in a call, even if the thread ends
 *          before the call does. Not noted: raw system calls of an FMU.
 * Keys:    thread-specific values (pthread_setspecific()) lie in the C library. The heap notes the
 *          keys that a call creates. So fmu_memory.h can save the values of the thread that calls
 *          the FMU.
 * Files:   a file that stays open is not part of a copy. So the heap notes the descriptors that a
 *          call opens by functions of the C library. It also notes that files are written, moved or
 *          removed. A file that fopen() opens only for writing may stay open, because its stream
 *          lies outside of the heap. If the FMU opens such a file again after a rollback that left
 *          the stream open, the FMU gets the same stream.
 * Outside: functions that keep data in the C library allocate outside of the heap. These are
 *          functions for environment, locales, time zones, exit handlers, host names and users. If
 *          this data were in the heap, the library would find old contents after a restore. So the
 *          data is not restored: an FMU that changes its environment finds the last change. Not
 *          handled: data that a function stores for one caller (strtok(), hsearch(), a stream).
 * Freeing: a block is returned to the heap that it came from, in any thread and at any time.
 * Sanitizer: has its own allocator. So such a build uses no heap, and tl_fmu_libc_serves() returns
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

/* Maximum number of heaps in a process. */
enum { TL_FMU_LIBC_HEAPS = 256 };

/* Returns true if this program can serve FMUs from heaps. */
bool tl_fmu_libc_serves(void);

/* Creates a heap for an FMU; call it before the FMU is loaded. `reserve`: size of the address
 * range, bytes. The heap exists until the process ends, because the FMU's library may free blocks
 * until then. Returns NULL (TL_TRY_AGAIN in `error`) if addresses or memory are out, if there are
 * already TL_FMU_LIBC_HEAPS heaps, or with a sanitizer. */
tl_fmu_heap *tl_fmu_libc_open(size_t reserve, tl_error *error);

/* Returns the sum of tl_fmu_heap_used() of all heaps, bytes; freed blocks are included. */
size_t tl_fmu_libc_used(void);

/* Returns true if an allowed thread of the FMU has run since the last call of this function, or has
 * not begun yet. Always true with a sanitizer. */
bool tl_fmu_libc_threads_ran(tl_fmu_heap *heap);

/* Returns the number of allowed threads that had not ended at the last tl_fmu_libc_threads_ran().
 */
uint32_t tl_fmu_libc_threads_alive(const tl_fmu_heap *heap);

/* Read and write the values that the present thread has stored under the heap's keys. The second
 * function writes the first `count` values and deletes all later keys. `count`: heap->key_count
 * when the values were read. Both do nothing with a sanitizer. */
void tl_fmu_libc_read_keys(const tl_fmu_heap *heap, void *values[TL_FMU_HEAP_KEYS]);
void tl_fmu_libc_write_keys(tl_fmu_heap *heap, void *const values[TL_FMU_HEAP_KEYS], uint32_t count);

/* From now on never closes the streams of `logs` that the FMU has open now, because a state may
 * contain them. Call it when a state is saved. */
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
