/* The memory of one FMU, saved and restored as a whole: a rollback for FMUs that cannot do it themselves, or not exactly.
 *
 * Purpose: what an FMU knows lies in memory: what it has allocated (fmu_heap.h), its globals and thread-local variables (fmu_pages.h), the
 *          random numbers of the C library, the exception flags of the floating-point unit. A *state* is a copy of these. All
 *          instances that an FMU has are in it.
 * Large:   from TL_FMU_MEMORY_LARGE on only the pages that differ are copied and kept (fmu_pages.h); below that all is, which is faster.
 * Exact:   a state leads back to the bit if that is all there is. What the kernel or another library keeps for the FMU is not in it: threads, open files,
 *          sockets, memory that it maps itself. So a rollback is always proved before it is used.
 * States:  never leave the process, and are of no use once the FMU is loaded anew. They may be restored in any order, any number of times.
 * Owner:   the guard (fmu_guard.h) has one for each FMU that is loaded.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_MEMORY_H
#define TL_FIRMWARE_ROLLBACK_FMU_MEMORY_H

#include <fenv.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/rollback/fmu_heap.h"
#include "firmware/rollback/fmu_pages.h"

/* ---- What an FMU leaves behind a call that no copy of its memory takes back.
 *
 * Purpose: a thread, a child, an open file or socket: the kernel keeps these, and they are as they are, whatever is restored. So an FMU that has any is not
 *          rolled back by its memory; which one it was is told. Memory that it maps itself is seen where it asks for it (fmu_heap.h).
 * Seen:    what is there after a call and was not before. A file that is opened and closed within one call leaves nothing, and may be
 *          written all the same.
 * Limits:  what other threads of the process do at the same time is taken for the FMU's.
 * Cost:    some hundred µs a look.
 * Thread:  any, one at a time.
 */

enum { TL_FMU_SIDE_EFFECTS_DESCRIPTORS = 1024, TL_FMU_SIDE_EFFECT_TEXT = 160 };

typedef struct tl_fmu_side_effects {
    unsigned long threads;
    bool has_children;
    bool is_open[TL_FMU_SIDE_EFFECTS_DESCRIPTORS]; /* by descriptor */
} tl_fmu_side_effects;

void tl_fmu_side_effects_look(tl_fmu_side_effects *traces);

/* ---- the memory ---- */

/* Calls after which it is looked for what the FMU has left, from its first one on. */
enum { TL_FMU_MEMORY_WATCHED = 24 };

/* Bytes from which on an FMU is large: a copy of all takes longer than to ask what was written. If nobody can be asked, and all is compared, it is kept for its size. */
enum { TL_FMU_MEMORY_LARGE = 256 * 1024 };

typedef struct tl_fmu_memory {
    tl_fmu_heap *heap; /* the FMU's calls are served from it; NULL: it has none */
    unsigned watched;  /* calls that are still to be watched */
    bool
        has_flags; /* set by its user: exceptions are kept for it; not before it is rolled back by this, since to look at them takes as long as a small step */
    int raised;    /* exceptions of the floating-point unit as the FMU knows them, as fetestexcept() tells them, */
    fexcept_t flags; /* and as the machine has them */
    const char *folder;
    tl_fmu_regions places;                /* private, from here on */
    bool are_found;                       /* the places, */
    unsigned long long opened;            /* when so many libraries had been opened */
    size_t most_used;                     /* bytes of the heap, when it was saved or left */
    tl_fmu_pages *pages;                  /* NULL: it is not large */
    struct tl_fmu_memory_state *reserved; /* for states to come */
    tl_fmu_side_effects before;           /* the call that is under way */
    char left[TL_FMU_SIDE_EFFECT_TEXT];   /* what no copy takes back; "": nothing that was seen */
} tl_fmu_memory;

/* If tl_fmu_allocation_serves(): before the FMU is loaded from `folder`, an absolute path without links, which must stay. It is there as long as the FMU's library: until the process ends. Errors: TL_TRY_AGAIN. */
tl_status tl_fmu_memory_open(const char *folder, tl_fmu_memory *memory, tl_error *error);

/* Around each call of the FMU. With `has_flags` it does not see exceptions that others have raised, nor others its own. */
static inline void tl_fmu_memory_enter(tl_fmu_memory *memory);
static inline void tl_fmu_memory_leave(tl_fmu_memory *memory);

/* Between two calls of the FMU, at least one of which was made: what its memory holds now, in *state, which is reused unless it is NULL.
 * Errors: TL_TRY_AGAIN: not enough memory; TL_FMU_FAILED: the FMU has what no copy takes back; *state is as it was. */
tl_status tl_fmu_memory_save(tl_fmu_memory *memory, void **state, tl_error *error);

/* After one was saved: memory for so many more, which takes none when it is saved then, if it is not larger than any before, and has not more pages that differ. What is left of it is given back before the
 * FMU goes. Errors: TL_TRY_AGAIN. */
tl_status tl_fmu_memory_reserve(tl_fmu_memory *memory, size_t states, tl_error *error);
void tl_fmu_memory_give_up_reserve(tl_fmu_memory *memory);

/* What the FMU was seen to have that no copy of its memory takes back; NULL: nothing. */
const char *tl_fmu_memory_left(const tl_fmu_memory *memory);

/* Back to it. */
void tl_fmu_memory_restore(tl_fmu_memory *memory, void *state);

/* NULL is allowed. */
void tl_fmu_memory_forget(void *state);

/* States that were there until now say nothing of those to come: an FMU's own states were in its memory, too, and are no more. */
void tl_fmu_memory_remeasure(tl_fmu_memory *memory);

/* Nor do those that are saved and restored while it passes. */
void tl_fmu_memory_pass(tl_fmu_memory *memory, bool passes);

/* Bytes that a state takes, if the FMU has as much as it ever had; of a large one: that one more takes. 0: not known yet. */
size_t tl_fmu_memory_size(const tl_fmu_memory *memory);

/* ---- inline ---- */

/* Private: after a call that is watched; flags that are not as the FMU knows them. */
void tl_fmu_memory_watched(tl_fmu_memory *memory);
void tl_fmu_memory_keep_flags(tl_fmu_memory *memory);

static inline void tl_fmu_memory_enter(tl_fmu_memory *memory) {
    if (memory->watched > 0) {
        tl_fmu_side_effects_look(&memory->before);
    }
    if (memory->has_flags && fetestexcept(FE_ALL_EXCEPT) != memory->raised) {
        (void)fesetexceptflag(&memory->flags, FE_ALL_EXCEPT);
    }
    (void)tl_fmu_allocation_enter(memory->heap);
}

static inline void tl_fmu_memory_leave(tl_fmu_memory *memory) {
    (void)tl_fmu_allocation_enter(NULL);
    if (memory->has_flags && fetestexcept(FE_ALL_EXCEPT) != memory->raised) {
        tl_fmu_memory_keep_flags(memory);
    }
    if (memory->watched > 0) {
        tl_fmu_memory_watched(memory);
    }
}

#endif
