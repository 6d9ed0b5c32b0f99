/* The memory of one FMU: see fmu_memory.h. */
#include "firmware/rollback/fmu_memory.h"

#include <fenv.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/rollback/fmu_allocation.h"
#include "firmware/rollback/fmu_random.h"

/* A state's heap has room for some more than was used when it was made: an FMU that allocates a little in each step need not have new states for it. */
enum { SPARE = 4096, SPARE_PART = 8 };

typedef struct memory_state {
    size_t room; /* bytes of `bytes` */
    size_t used; /* bytes of the heap; they come first, then the places */
    int raised;  /* as in tl_fmu_memory */
    fexcept_t flags;
    unsigned char bytes[];
} memory_state;

bool tl_fmu_memory_serves(void) {
    return tl_fmu_allocation_serves();
}

tl_status tl_fmu_memory_open(const char *folder, tl_fmu_memory *memory, tl_error *error) {
    *memory = (tl_fmu_memory){.folder = folder, .watched = TL_FMU_MEMORY_WATCHED};
    memory->heap = tl_fmu_allocation_open(tl_fmu_heap_most(), error);
    if (memory->heap == NULL) {
        return TL_TRY_AGAIN;
    }
    return tl_fmu_random_begin(memory->heap) ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "no memory for an FMU");
}

/* ---- around a call ---- */

void tl_fmu_memory_set_flags(tl_fmu_memory *memory) {
    (void)fesetexceptflag(&memory->flags, FE_ALL_EXCEPT);
}

void tl_fmu_memory_keep_flags(tl_fmu_memory *memory) {
    memory->raised = fetestexcept(FE_ALL_EXCEPT);
    (void)fegetexceptflag(&memory->flags, FE_ALL_EXCEPT);
}

void tl_fmu_memory_watch(tl_fmu_memory *memory) {
    tl_fmu_traces_look(&memory->before);
}

void tl_fmu_memory_watched(tl_fmu_memory *memory) {
    tl_fmu_traces after;
    tl_fmu_traces_look(&after);
    memory->watched--;
    if (memory->left[0] == '\0') {
        (void)tl_fmu_traces_differ(&memory->before, &after, memory->left);
    }
}

/* ---- states ---- */

static tl_status make_room(tl_fmu_memory *memory, memory_state **state, size_t need, tl_error *error) {
    if (*state != NULL && (*state)->room >= need) {
        return TL_OK;
    }
    size_t room = need + SPARE + need / SPARE_PART;
    memory_state *made = malloc(sizeof *made + room);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a state of %zu bytes of %s", need, memory->folder);
    }
    made->room = room;
    free(*state);
    *state = made;
    return TL_OK;
}

size_t tl_fmu_memory_size(const tl_fmu_memory *memory) {
    return memory->are_found ? sizeof(memory_state) + tl_fmu_heap_used(memory->heap) + memory->places.bytes : 0;
}

const char *tl_fmu_memory_left(const tl_fmu_memory *memory) {
    if (memory->left[0] != '\0') {
        return memory->left;
    }
    return memory->heap->has_threads  ? "a thread"
           : memory->heap->is_not_all ? "memory elsewhere than in its heap"
                                      : NULL;
}

/* Once; and whether they are still the same if any library was opened since. */
static tl_status find_places(tl_fmu_memory *memory, tl_error *error) {
    tl_fmu_places now;
    unsigned long long opened = tl_fmu_places_opened();
    if (memory->are_found && opened == memory->opened) {
        return TL_OK;
    }
    tl_status status = tl_fmu_places_find(memory->folder, &now, error);
    if (status == TL_OK && memory->are_found && now.bytes != memory->places.bytes) {
        return tl_fail(error, TL_FMU_FAILED, "has opened a library since, which no copy of its memory takes back");
    }
    memory->places = now;
    memory->are_found = status == TL_OK;
    memory->opened = opened;
    return status;
}

tl_status tl_fmu_memory_save(tl_fmu_memory *memory, void **state, tl_error *error) {
    memory_state *kept = *state;
    const char *left = tl_fmu_memory_left(memory);
    if (left != NULL) {
        return tl_fail(error, TL_FMU_FAILED, "has %s, which no copy of its memory takes back", left);
    }
    tl_status status = find_places(memory, error);
    if (status != TL_OK) {
        return status;
    }
    size_t used = tl_fmu_heap_used(memory->heap);
    status = make_room(memory, &kept, used + memory->places.bytes, error);
    if (status != TL_OK) {
        return status;
    }
    *state = kept;
    kept->used = used;
    kept->raised = memory->raised;
    kept->flags = memory->flags;
    memcpy(kept->bytes, memory->heap->base, used);
    unsigned char *to = kept->bytes + used;
    for (size_t i = 0; i < memory->places.count; i++) {
        const tl_fmu_place *place = &memory->places.place[i];
        memcpy(to, place->begin, place->size);
        to += place->size;
    }
    return TL_OK;
}

void tl_fmu_memory_restore(tl_fmu_memory *memory, const void *state) {
    const memory_state *kept = state;
    memcpy(memory->heap->base, kept->bytes, kept->used);
    tl_fmu_heap_restored(memory->heap, kept->used);
    const unsigned char *from = kept->bytes + kept->used;
    for (size_t i = 0; i < memory->places.count; i++) {
        const tl_fmu_place *place = &memory->places.place[i];
        memcpy(place->begin, from, place->size);
        from += place->size;
    }
    memory->raised = kept->raised;
    memory->flags = kept->flags;
}

void tl_fmu_memory_forget(void *state) {
    free(state);
}
