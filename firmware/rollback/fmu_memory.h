/* Rollback by memory: saves and restores the whole memory of one FMU. Used if the FMU has no state
 * functions, or if they do not restore every bit or are slower.
 *
 * Purpose: a *state* is a copy of all memory that belongs to the FMU. It contains the FMU's heap
 *          (fmu_heap.h), its global and thread-local variables (fmu_regions.h), its thread-specific
 *          values and random numbers (fmu_libc.h), and the exception flags of the floating-point
 *          unit. A state contains all instances of the FMU.
 * Large:   from TL_FMU_MEMORY_LARGE bytes on, only changed pages are copied and stored
 *          (fmu_pages.h). For a smaller FMU, a copy of everything is faster.
 * Exact:   a restored state is equal in every bit if the FMU keeps no data elsewhere. Data that the
 *          kernel or another library keeps for the FMU is not included: threads, open files,
 *          sockets, shared mappings. So the rollback is always tested before it is used.
 * States:  are valid only in this process and only for this load of the FMU. They can be restored
 *          in any order and any number of times.
 * Python:  all FMUs in Python share one memory, because they share one interpreter. So they are
 *          saved and restored together: a state contains all of them.
 * Owner:   the guard (fmu_guard.h) has one tl_fmu_memory for each loaded FMU.
 * Thread:  the thread that calls the FMUs.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_MEMORY_H
#define TL_FIRMWARE_ROLLBACK_FMU_MEMORY_H

#include <fenv.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/rollback/fmu_heap.h"
#include "firmware/rollback/fmu_libc.h"
#include "firmware/rollback/fmu_pages.h"
#include "firmware/rollback/fmu_regions.h"

/* ---- Side effects: threads, processes and descriptors that an FMU creates.
 *
 * Purpose: the kernel keeps them, and a restore of memory does not change them. An FMU with such
 *          side effects is not rolled back by memory, and the side effect is reported. Threads that
 *          sleep between calls are allowed if the heap allows threads (decision 068). Shared
 *          mappings are detected by fmu_libc.h.
 * Detects: threads, child processes and descriptors that appear during a call. A file that is
 *          opened, written and closed within one call is not detected here, but by fmu_libc.h.
 * Limits:  side effects of other threads of the process during the call count as the FMU's.
 * Cost:    some hundred µs per check.
 * Thread:  any, one at a time.
 */

/* Only descriptors below this number are checked. Bytes of a text with its terminating 0. */
enum { TL_FMU_SIDE_EFFECTS_DESCRIPTORS = 1024, TL_FMU_SIDE_EFFECT_TEXT = 160 };

typedef struct tl_fmu_side_effects {
    unsigned long threads; /* number of threads */
    bool has_children;
    bool is_open[TL_FMU_SIDE_EFFECTS_DESCRIPTORS]; /* indexed by descriptor */
} tl_fmu_side_effects;

/* Lists the threads, child processes and descriptors that this process has now. */
void tl_fmu_side_effects_list(tl_fmu_side_effects *effects);

/* ---- the memory ---- */

/* Number of calls, from the FMU's first one on, that are checked for side effects. In later calls
 * only new threads, and descriptors that the C library opens, are detected. */
enum { TL_FMU_MEMORY_WATCHED = 24 };

/* An FMU with this many bytes is large: a copy of everything takes longer than a query for written
 * pages. On x86-64 with 4 changed pages, a copy takes 2.6 µs at 48 KiB and 0.2 µs at 16 KiB, a
 * query 1.2 µs. The second limit holds if the kernel cannot report written pages, so that all pages
 * are compared. It is higher, because memcmp() is much slower than memcpy() on some ARM boxes. */
enum { TL_FMU_MEMORY_LARGE = 48 * 1024, TL_FMU_MEMORY_LARGE_COMPARED = 256 * 1024 };

typedef struct tl_fmu_memory {
    tl_fmu_heap *heap;       /* serves the FMU's allocations; NULL: not open */
    unsigned calls_to_check; /* number of further calls to check for side effects */
    bool
        has_flags; /* set by the guard: saves exception flags for the FMU. It costs as much as a small step, so set it only with rollback by memory */
    int raised;    /* the FMU's floating-point exceptions, as fetestexcept() returns them */
    fexcept_t flags;        /* the same in the format of the machine */
    const char *folder;     /* from which the FMU is loaded; NULL: this is the memory of all FMUs in Python */
    bool is_given_up;       /* set by the guard: another FMU in Python uses another method, so none is copied */
    tl_fmu_regions regions; /* private, from here on */
    bool has_regions;       /* `regions` is valid */
    unsigned char
        *opened_as[TL_FMU_REGIONS]; /* per region of a library that a call opened: contents just after; NULL: unknown */
    uint32_t opened_in
        [TL_FMU_REGIONS]; /* per region: value of `openings` when a call opened its library; 0: not opened by a call */
    uint32_t openings;    /* how often calls have opened a library since the first state was saved */
    size_t loaded;        /* number of objects (program, libraries) just before the FMU last opened a library */
    size_t paged;         /* regions that existed when `pages` was created */
    uint32_t settled_threads;   /* heap->threads_started when all of the FMU's threads were last found asleep */
    uint32_t live_threads;      /* how many of these threads had not ended then */
    uint32_t started_before;    /* heap->threads_started before the present call */
    unsigned long long changed; /* tl_fmu_regions_changed() when `regions` was filled */
    size_t most_used;           /* largest number of heap bytes at a save or restore */
    tl_fmu_pages *pages;        /* NULL: the FMU is not large */
    struct tl_fmu_memory_state *reserved;      /* list of reserved states; NULL: none */
    tl_fmu_side_effects before;                /* side effects before the present call */
    char side_effect[TL_FMU_SIDE_EFFECT_TEXT]; /* side effect that was found; "": none */
} tl_fmu_memory;

/* Creates the heap of an FMU; call it before the FMU is loaded. `folder`: absolute path without
 * links, from which the FMU will be loaded; the text must remain valid. The heap exists until the
 * process ends, as the FMU's library does. Errors: TL_TRY_AGAIN if memory, addresses or heaps are
 * out, or with a sanitizer (tl_fmu_libc_serves() is false). */
tl_status tl_fmu_memory_open(const char *folder, tl_fmu_memory *memory, tl_error *error);

/* Returns the memory that all FMUs in Python share. Call it for each of these FMUs before the FMU
 * is loaded. Errors: returns NULL, and `error` contains TL_TRY_AGAIN. */
tl_fmu_memory *tl_fmu_memory_of_python(tl_error *error);

/* Call the first function before and the second one after each call of the FMU, in the same thread.
 * With `has_flags`, the first one restores the FMU's floating-point exception flags, and the second
 * one saves them. */
static inline void tl_fmu_memory_enter(tl_fmu_memory *memory);
static inline void tl_fmu_memory_leave(tl_fmu_memory *memory);

/* Saves the present memory of the FMU in *state, which is reused if it is not NULL. Call it between
 * two calls of the FMU, after at least one call. If the FMU has started threads since the last
 * check, waits until they sleep: 50 ms to about 1 s.
 * Errors:  TL_TRY_AGAIN: memory is out. TL_FMU_FAILED: the FMU has side effects or libraries that a
 *          copy cannot restore. After an error *state is unchanged. */
tl_status tl_fmu_memory_save(tl_fmu_memory *memory, void **state, tl_error *error);

/* Reserves memory for `states` more states; call it after one state was saved. Saving such a state
 * allocates nothing, unless it is larger than all earlier ones or has more changed pages. The
 * second function frees the unused memory; call it before the FMU is freed. Errors: TL_TRY_AGAIN if
 * memory is out. */
tl_status tl_fmu_memory_reserve(tl_fmu_memory *memory, size_t states, tl_error *error);
void tl_fmu_memory_free_reserve(tl_fmu_memory *memory);

/* Returns the side effect that prevents a copy, as a text that continues "it has"; NULL: none was
 * found. */
const char *tl_fmu_memory_side_effect(const tl_fmu_memory *memory);

/* The first function returns the cause that prevents the restore of a state, as a text; NULL: the
 * state can be restored. It waits for new threads as tl_fmu_memory_save() does. The second function
 * returns true if the FMU has opened or closed a library since the state was saved. A restore
 * resets an opened library to its contents after opening, except for memory that its constructors
 * allocated. If these contents are not known, the state cannot be restored. */
const char *tl_fmu_memory_obstacle(tl_fmu_memory *memory, const void *state);
bool tl_fmu_memory_has_new_library(tl_fmu_memory *memory, const void *state);

/* Restores a state. tl_fmu_memory_obstacle() must have returned NULL before. */
void tl_fmu_memory_restore(tl_fmu_memory *memory, void *state);

/* Returns true if the memory has the same bits as the state. Exception flags and thread-specific
 * values are not compared. May return false for equal memory if a call has opened a library. */
bool tl_fmu_memory_is_same(const tl_fmu_memory *memory, const void *state);

/* Frees a state; NULL is allowed. */
void tl_fmu_memory_forget(void *state);

/* Restarts the tracking of pages, so that it includes libraries that the FMU has opened since the
 * first state was saved. Call it after all states are freed. */
void tl_fmu_memory_restart_storage(tl_fmu_memory *memory);

/* Restarts the size estimates. Call it after the FMU has freed its own FMI states, because they
 * were in its heap. */
void tl_fmu_memory_remeasure(tl_fmu_memory *memory);

/* While `freezes` is true, saves and restores do not change the size estimate of a large FMU. */
void tl_fmu_memory_freeze_estimate(tl_fmu_memory *memory, bool freezes);

/* Returns the bytes of one state if the FMU uses as much memory as now. For a large FMU: estimated
 * bytes of one more state. 0: no state was saved yet. */
size_t tl_fmu_memory_size(const tl_fmu_memory *memory);

/* ---- inline ---- */

/* Private. The first function checks for all side effects after a call. The second one checks only
 * for descriptors that the call opened through the C library. The third one saves the present
 * exception flags. */
void tl_fmu_memory_watched(tl_fmu_memory *memory);
void tl_fmu_memory_check_opened(tl_fmu_memory *memory);
void tl_fmu_memory_keep_flags(tl_fmu_memory *memory);

static inline void tl_fmu_memory_enter(tl_fmu_memory *memory) {
    if (memory->calls_to_check > 0) {
        memory->started_before = memory->heap->threads_started;
        tl_fmu_side_effects_list(&memory->before);
    }
    if (memory->has_flags && fetestexcept(FE_ALL_EXCEPT) != memory->raised) {
        (void)fesetexceptflag(&memory->flags, FE_ALL_EXCEPT);
    }
    memory->heap->was_written = true;
    (void)tl_fmu_libc_enter(memory->heap);
}

static inline void tl_fmu_memory_leave(tl_fmu_memory *memory) {
    (void)tl_fmu_libc_enter(NULL);
    if (memory->has_flags && fetestexcept(FE_ALL_EXCEPT) != memory->raised) {
        tl_fmu_memory_keep_flags(memory);
    }
    if (memory->calls_to_check > 0) {
        tl_fmu_memory_watched(memory);
    }
    if (memory->heap->has_opened) {
        tl_fmu_memory_check_opened(memory);
    }
}

#endif
