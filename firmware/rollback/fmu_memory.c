/* Rollback by memory, see fmu_memory.h. */
#include "firmware/rollback/fmu_memory.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <fenv.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/text.h"
#include "firmware/rollback/fmu_heap.h"
#include "firmware/rollback/fmu_libc.h"
#include "firmware/rollback/fmu_pages.h"
#include "firmware/rollback/fmu_regions.h"

/* Extra room in a state, so that it can be reused if the FMU allocates a little memory in each
 * step. */
enum { SPARE = 4096, SPARE_PART = 8 };

/* Addresses reserved for a heap: 1 GiB, or 32 MiB on a 32-bit machine. */
enum { RESERVED = sizeof(void *) > 4 ? 1 << 30 : 32 << 20 };

/* Smaller regions are copied completely; tracking their pages is not worthwhile. */
enum { PAGED_REGION = 4 * TL_FMU_PAGE };

typedef struct tl_fmu_memory_state {
    struct tl_fmu_memory_state *next; /* next unused state */
    size_t room;                      /* bytes of `bytes` */
    size_t used;                      /* bytes of the heap */
    size_t regions;                   /* number of regions in it */
    uint32_t openings;                /* as in tl_fmu_memory */
    tl_fmu_pages *
        pages; /* NULL: `bytes` contains everything, first the heap, then the regions; else `bytes` contains only the regions outside of `version` */
    tl_fmu_version version;
    int raised; /* as in tl_fmu_memory */
    fexcept_t flags;
    uint32_t key_count;
    void *keys[TL_FMU_HEAP_KEYS]; /* values of the heap's keys */
    unsigned char bytes[];
} memory_state;

static tl_fmu_heap_note_opening note_opening;

tl_status tl_fmu_memory_open(const char *folder, tl_fmu_memory *memory, tl_error *error) {
    *memory = (tl_fmu_memory){.folder = folder, .calls_to_check = TL_FMU_MEMORY_WATCHED};
    memory->heap = tl_fmu_libc_open(RESERVED, error);
    if (memory->heap == NULL) {
        return TL_TRY_AGAIN;
    }
    memory->heap->note_opening = note_opening;
    memory->heap->context = memory;
    return TL_OK;
}

void tl_fmu_memory_restart_storage(tl_fmu_memory *memory) {
    memory->pages = NULL;
    memory->paged = 0;
}

tl_fmu_memory *tl_fmu_memory_of_python(tl_error *error) {
    static tl_fmu_memory shared;
    if (shared.heap == NULL && tl_fmu_memory_open(NULL, &shared, error) != TL_OK) {
        return NULL;
    }
    shared.heap->allows_threads = true;
    shared.calls_to_check = TL_FMU_MEMORY_WATCHED;
    return &shared;
}

static const char *name_of(const tl_fmu_memory *memory) {
    return memory->folder != NULL ? memory->folder : "FMUs in Python";
}

/* ---- side effects ---- */

enum { FOLDER_LINKS = 2 }; /* a folder has two links besides those of its subfolders */

static unsigned long count_threads(void) {
    struct stat tasks;
    return stat("/proc/self/task", &tasks) == 0 ? (unsigned long)tasks.st_nlink - FOLDER_LINKS : 0;
}

/* The text remains empty if the descriptor is already closed: then another thread of this process
 * had opened it for a short time. */
static void describe_descriptor(unsigned number, char text[TL_FMU_SIDE_EFFECT_TEXT]) {
    char link[64];
    char target[96];
    char name[96];
    (void)snprintf(link, sizeof link, "/proc/self/fd/%u", number);
    ssize_t length = readlink(link, target, sizeof target);
    if (length < 0 && fcntl((int)number, F_GETFD) < 0) {
        return;
    }
    (void)tl_clean_text(target, length > 0 ? (size_t)length : 0, name, sizeof name);
    (void)snprintf(text, TL_FMU_SIDE_EFFECT_TEXT, "an open file or socket, %s", name);
}

void tl_fmu_side_effects_list(tl_fmu_side_effects *effects) {
    siginfo_t about;
    *effects = (tl_fmu_side_effects){.threads = count_threads(),
                                     .has_children = waitid(P_ALL, 0, &about, WEXITED | WNOHANG | WNOWAIT) == 0};
    for (unsigned i = 0; i < TL_FMU_SIDE_EFFECTS_DESCRIPTORS; i++) {
        effects->is_open[i] = fcntl((int)i, F_GETFD) >= 0;
    }
}

/* Returns true if there is something new; `text` names it: "a thread", "an open file or socket,
 * /tmp/log". */
static bool find_new(const tl_fmu_side_effects *before, const tl_fmu_side_effects *after,
                     char text[TL_FMU_SIDE_EFFECT_TEXT]) {
    text[0] = '\0';
    if (after->threads > before->threads) {
        (void)snprintf(text, TL_FMU_SIDE_EFFECT_TEXT, "a thread");
    } else if (after->has_children && !before->has_children) {
        (void)snprintf(text, TL_FMU_SIDE_EFFECT_TEXT, "a process");
    }
    for (unsigned i = 0; i < TL_FMU_SIDE_EFFECTS_DESCRIPTORS && text[0] == '\0'; i++) {
        if (after->is_open[i] && !before->is_open[i]) {
            describe_descriptor(i, text);
        }
    }
    return text[0] != '\0';
}

/* ---- around a call ---- */

void tl_fmu_memory_keep_flags(tl_fmu_memory *memory) {
    memory->raised = fetestexcept(FE_ALL_EXCEPT);
    (void)fegetexceptflag(&memory->flags, FE_ALL_EXCEPT);
}

void tl_fmu_memory_watched(tl_fmu_memory *memory) {
    tl_fmu_side_effects after;
    tl_fmu_side_effects_list(&after);
    after.threads -= memory->heap->threads_started - memory->started_before;
    memory->calls_to_check--;
    if (memory->side_effect[0] == '\0') {
        (void)find_new(&memory->before, &after, memory->side_effect);
    }
}

void tl_fmu_memory_check_opened(tl_fmu_memory *memory) {
    memory->heap->has_opened = false;
    for (unsigned i = 0; i < TL_FMU_HEAP_DESCRIPTORS; i++) {
        if (memory->heap->is_opened[i] && memory->side_effect[0] == '\0' && fcntl((int)i, F_GETFD) >= 0) {
            describe_descriptor(i, memory->side_effect);
        }
        memory->heap->is_opened[i] = false;
    }
}

/* ---- states ---- */

static void note_used(tl_fmu_memory *memory) {
    size_t used = tl_fmu_heap_used(memory->heap);
    memory->most_used = used > memory->most_used ? used : memory->most_used;
}

/* If `*state` has no room, replaces it by a new one, and the caller frees the old one. */
static tl_status make_room(tl_fmu_memory *memory, memory_state **state, size_t need, tl_error *error) {
    if (*state != NULL && (*state)->room >= need) {
        return TL_OK;
    }
    size_t room = need + SPARE + need / SPARE_PART;
    memory_state *made = malloc(sizeof *made + room);
    if (made == NULL) {
        (void)tl_fail(error, TL_TRY_AGAIN, "not enough memory for a copy of %zu bytes (%s)", need, name_of(memory));
        return TL_TRY_AGAIN;
    }
    *made = (memory_state){.room = room};
    *state = made;
    return TL_OK;
}

static bool is_in_pages(const tl_fmu_memory *memory, size_t region) {
    const tl_fmu_region *one = &memory->regions.place[region];
    return region < memory->paged && one->has_pages && one->size >= PAGED_REGION;
}

/* ---- libraries that were opened after the page storage was created ---- */

/* A state contains only those pages of such a region that have changed since the library was
 * opened: their number, then the number and contents of each. */
static bool is_late(const tl_fmu_memory *memory, size_t region) {
    return memory->pages != NULL && region >= memory->paged && memory->opened_as[region] != NULL &&
           memory->regions.place[region].size >= PAGED_REGION;
}

static size_t page_size_at(const tl_fmu_region *region, size_t at) {
    return region->size - at < TL_FMU_PAGE ? region->size - at : TL_FMU_PAGE;
}

/* Returns the number of bytes. `bytes` NULL: only this. */
static size_t save_late(const tl_fmu_memory *memory, size_t number, unsigned char *bytes) {
    const tl_fmu_region *region = &memory->regions.place[number];
    uint32_t count = 0;
    size_t used = sizeof count;
    for (size_t at = 0; at < region->size; at += TL_FMU_PAGE) {
        const uint32_t page = (uint32_t)(at / TL_FMU_PAGE);
        size_t size = page_size_at(region, at);
        if (memcmp(region->begin + at, memory->opened_as[number] + at, size) == 0) {
            continue;
        }
        if (bytes != NULL) {
            memcpy(bytes + used, &page, sizeof page);
            memcpy(bytes + used + sizeof page, region->begin + at, size);
        }
        used += sizeof page + size;
        count++;
    }
    if (bytes != NULL) {
        memcpy(bytes, &count, sizeof count);
    }
    return used;
}

/* Returns the number of bytes. `bytes` NULL: the library had not been opened yet. */
static size_t restore_late(const tl_fmu_memory *memory, size_t number, const unsigned char *bytes) {
    const tl_fmu_region *region = &memory->regions.place[number];
    uint32_t left = 0;
    uint32_t page = 0;
    size_t used = sizeof left;
    if (bytes != NULL) {
        memcpy(&left, bytes, sizeof left);
    }
    for (size_t at = 0; at < region->size; at += TL_FMU_PAGE) {
        const unsigned char *from = memory->opened_as[number] + at;
        size_t size = page_size_at(region, at);
        if (left > 0) {
            memcpy(&page, bytes + used, sizeof page);
        }
        if (left > 0 && page == at / TL_FMU_PAGE) {
            from = bytes + used + sizeof page;
            used += sizeof page + size;
            left--;
        }
        if (memcmp(region->begin + at, from, size) != 0) {
            memcpy(region->begin + at, from, size);
        }
    }
    return used;
}

static size_t bytes_outside_pages(const tl_fmu_memory *memory) {
    size_t sum = 0;
    for (size_t i = 0; i < memory->regions.count; i++) {
        sum += is_in_pages(memory, i) ? 0
               : is_late(memory, i)   ? save_late(memory, i, NULL)
                                      : memory->regions.place[i].size;
    }
    return sum;
}

size_t tl_fmu_memory_size(const tl_fmu_memory *memory) {
    if (!memory->has_regions) {
        return 0;
    }
    return sizeof(memory_state) + (memory->pages == NULL
                                       ? tl_fmu_heap_used(memory->heap) + memory->regions.bytes
                                       : tl_fmu_pages_size(memory->pages) + bytes_outside_pages(memory));
}

/* ---- pages ---- */

/* Creates the page storage once the FMU has become large. */
static tl_status choose_storage(tl_fmu_memory *memory, size_t used, tl_error *error) {
    tl_fmu_region ranges[TL_FMU_REGIONS + 1];
    size_t count = 0;
    size_t large = tl_fmu_written_serves() ? TL_FMU_MEMORY_LARGE : TL_FMU_MEMORY_LARGE_COMPARED;
    if (memory->pages != NULL || used + memory->regions.bytes < large) {
        return TL_OK;
    }
    memory->paged = memory->regions.count;
    for (size_t i = 0; i < memory->regions.count; i++) {
        const tl_fmu_region *region = &memory->regions.place[i];
        size_t before = (uintptr_t)region->begin % TL_FMU_PAGE; /* bytes between the start of the page and the region */
        size_t size = (before + region->size + TL_FMU_PAGE - 1) / TL_FMU_PAGE * TL_FMU_PAGE;
        if (is_in_pages(memory, i)) {
            ranges[count++] = (tl_fmu_region){.begin = region->begin - before, .size = size, .has_pages = true};
        }
    }
    ranges[count++] = (tl_fmu_region){.begin = memory->heap->base, .size = memory->heap->reserved, .has_pages = true};
    memory->pages = tl_fmu_pages_open(ranges, count, error);
    memory->paged = memory->pages != NULL ? memory->paged : 0;
    return memory->pages != NULL ? TL_OK : TL_TRY_AGAIN;
}

/* ---- check for side effects ---- */

const char *tl_fmu_memory_side_effect(const tl_fmu_memory *memory) {
    if (memory->side_effect[0] != '\0') {
        return memory->side_effect;
    }
    return memory->heap->has_threads          ? "a thread"
           : memory->heap->has_outside_memory ? "memory outside of its heap"
           : memory->is_given_up              ? "an interpreter in common with FMUs that are not copied"
                                              : NULL;
}

static bool begins_with(const tl_fmu_regions *now, const tl_fmu_regions *known) {
    bool is_same = now->count >= known->count;
    for (size_t i = 0; i < known->count && is_same; i++) {
        is_same = now->place[i].begin == known->place[i].begin && now->place[i].size == known->place[i].size;
    }
    return is_same;
}

/* Finds the regions once. Checks them again if a library was opened since; then its regions follow
 * the others. */
static tl_status find_regions(tl_fmu_memory *memory, tl_error *error) {
    tl_fmu_regions now;
    unsigned long long changed = tl_fmu_regions_changed();
    if (memory->has_regions && changed == memory->changed) {
        return TL_OK;
    }
    tl_status status = tl_fmu_regions_find(memory->folder, &now, error);
    if (status == TL_OK && memory->has_regions && !begins_with(&now, &memory->regions)) {
        return tl_fail(error, TL_FMU_FAILED,
                       "its memory cannot be copied, because it has closed a library, or another FMU has opened the "
                       "same one");
    }
    memory->regions = now;
    memory->has_regions = status == TL_OK;
    memory->changed = changed;
    return status;
}

/* Regions of a closed library leave the list if they are the last ones and have no page storage. */
static void note_closing(tl_fmu_memory *memory) {
    tl_fmu_regions now;
    tl_fmu_regions_forget_closed();
    if (!memory->has_regions) {
        return;
    }
    bool has_regions = tl_fmu_regions_find(memory->folder, &now, NULL) == TL_OK;
    if (has_regions && begins_with(&now, &memory->regions)) {
        return; /* all regions remain; others may be new */
    }
    if (!has_regions || now.count < memory->paged || !begins_with(&memory->regions, &now)) {
        (void)snprintf(memory->side_effect, sizeof memory->side_effect, "closed a library that its copies contain");
        return;
    }
    while (memory->regions.count > now.count) {
        free(memory->opened_as[--memory->regions.count]);
        memory->opened_as[memory->regions.count] = NULL;
    }
    memory->regions = now;
}

/* The contents of new regions are kept, because earlier copies lack them. */
static void note_opening(void *context, tl_fmu_library_change change, void *library) {
    tl_fmu_memory *memory = context;
    size_t known = memory->regions.count;
    if (change == TL_FMU_LIBRARY_OPENS) {
        memory->loaded = tl_fmu_regions_loaded();
        return;
    }
    if (change == TL_FMU_LIBRARY_CLOSED) {
        note_closing(memory);
        return;
    }
    tl_fmu_regions_claim(memory->folder, library, memory->loaded);
    if (!memory->has_regions || find_regions(memory, NULL) != TL_OK) {
        return;
    }
    memory->openings++;
    for (size_t i = known; i < memory->regions.count; i++) {
        memory->opened_in[i] = memory->openings;
        const tl_fmu_region *region = &memory->regions.place[i];
        memory->opened_as[i] = malloc(region->size);
        if (memory->opened_as[i] != NULL) {
            memcpy(memory->opened_as[i], region->begin, region->size);
        }
    }
}

/* ---- threads ---- */

/* A new thread may run for some time before it sleeps. */
enum { QUIET_ROUNDS = 50, MOST_ROUNDS = 1000, ROUND_NS = 1000 * 1000 };

static bool wait_until_asleep(tl_fmu_heap *heap) {
    int quiet = 0;
    for (int i = 0; i < MOST_ROUNDS && quiet < QUIET_ROUNDS; i++) {
        (void)nanosleep(&(struct timespec){.tv_nsec = ROUND_NS}, NULL);
        quiet = tl_fmu_libc_threads_ran(heap) ? 0 : quiet + 1;
    }
    return quiet >= QUIET_ROUNDS;
}

/* A thread that sleeps between all calls does not change the memory. New threads are allowed until
 * the first state is saved; later ones must have ended. */
static bool are_threads_asleep(tl_fmu_memory *memory) {
    tl_fmu_heap *heap = memory->heap;
    if (heap->threads_started == memory->settled_threads) {
        heap->has_threads = heap->has_threads || (heap->threads_started > 0 && tl_fmu_libc_threads_ran(heap));
        return !heap->has_threads;
    }
    bool is_asleep = wait_until_asleep(heap);
    uint32_t live = tl_fmu_libc_threads_alive(heap);
    heap->has_threads = heap->has_threads || !is_asleep || (memory->has_regions && live > memory->live_threads);
    memory->settled_threads = heap->threads_started;
    memory->live_threads = live;
    return !heap->has_threads;
}

/* ---- save ---- */

/* Copies between a state and the first `count` regions: all, or only those outside of the page
 * storage. */
static void copy_regions(const tl_fmu_memory *memory, size_t count, bool all, unsigned char *bytes, bool restore) {
    for (size_t i = 0; i < count; i++) {
        const tl_fmu_region *region = &memory->regions.place[i];
        if (!all && is_late(memory, i)) {
            bytes += restore ? restore_late(memory, i, bytes) : save_late(memory, i, bytes);
        } else if (all || !is_in_pages(memory, i)) {
            memcpy(restore ? region->begin : bytes, restore ? bytes : region->begin, region->size);
            bytes += region->size;
        }
    }
}

static tl_status save_pages(tl_fmu_memory *memory, memory_state **state, size_t used, tl_error *error) {
    tl_status status = make_room(memory, state, bytes_outside_pages(memory), error);
    if (status == TL_OK) {
        bool was_written = memory->heap->was_written;
        memory->heap->was_written = false;
        status = tl_fmu_pages_save(memory->pages, used, was_written, &(*state)->version, error);
    }
    if (status == TL_OK) {
        (*state)->pages = memory->pages;
        copy_regions(memory, memory->regions.count, false, (*state)->bytes, false);
    }
    return status;
}

/* Returns NULL if no reserved state remains. */
static memory_state *take_reserved(tl_fmu_memory *memory) {
    memory_state *taken = memory->reserved;
    if (taken != NULL) {
        memory->reserved = taken->next;
        taken->next = NULL;
    }
    return taken;
}

/* The C library keeps the address of the loader's last error, which may lie in the heap. Two calls
 * free it. */
static void forget_loader_error(void) {
    while (dlerror() != NULL) {
    }
}

tl_status tl_fmu_memory_save(tl_fmu_memory *memory, void **state, tl_error *error) {
    forget_loader_error();
    const char *side_effect = are_threads_asleep(memory) ? tl_fmu_memory_side_effect(memory) : "a thread";
    if (side_effect != NULL) {
        return tl_fail(error, TL_FMU_FAILED, "its memory cannot be copied, because it has %s", side_effect);
    }
    memory_state *before = *state != NULL ? *state : take_reserved(memory);
    memory_state *kept = before;
    size_t used = tl_fmu_heap_used(memory->heap);
    tl_status status = find_regions(memory, error);
    status = status == TL_OK ? choose_storage(memory, used, error) : status;
    if (status == TL_OK && memory->pages != NULL) {
        status = save_pages(memory, &kept, used, error);
    } else if (status == TL_OK) {
        status = make_room(memory, &kept, used + memory->regions.bytes, error);
    }
    if (kept != before) {
        tl_fmu_memory_forget(status == TL_OK ? before : kept);
    }
    if (status != TL_OK) {
        if (*state == NULL && before != NULL) {
            before->next = memory->reserved;
            memory->reserved = before;
        }
        return status;
    }
    if (memory->pages == NULL) {
        memcpy(kept->bytes, memory->heap->base, used);
        copy_regions(memory, memory->regions.count, true, kept->bytes + used, false);
    }
    *state = kept;
    note_used(memory);
    kept->used = used;
    kept->regions = memory->regions.count;
    kept->openings = memory->openings;
    kept->raised = memory->raised;
    kept->flags = memory->flags;
    kept->key_count = memory->heap->key_count;
    tl_fmu_libc_read_keys(memory->heap, kept->keys);
    tl_fmu_libc_keep_logs(memory->heap);
    return TL_OK;
}

/* ---- reserve ---- */

static tl_status reserve_one(tl_fmu_memory *memory, tl_error *error) {
    memory_state *made = NULL;
    size_t need = memory->pages != NULL ? bytes_outside_pages(memory) : memory->most_used + memory->regions.bytes;
    tl_status status = make_room(memory, &made, need, error);
    if (status == TL_OK && memory->pages != NULL && !tl_fmu_pages_reserve_version(memory->pages, &made->version)) {
        status = tl_fail(error, TL_TRY_AGAIN, "not enough memory for copies (%s)", name_of(memory));
    }
    if (status != TL_OK) {
        tl_fmu_memory_forget(made);
        return status;
    }
    made->next = memory->reserved;
    memory->reserved = made;
    return TL_OK;
}

tl_status tl_fmu_memory_reserve(tl_fmu_memory *memory, size_t states, tl_error *error) {
    tl_status status = TL_OK;
    if (memory->pages != NULL && !tl_fmu_pages_reserve(memory->pages, states)) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for %zu copies (%s)", states, name_of(memory));
    }
    for (size_t i = 0; i < states && status == TL_OK; i++) {
        status = reserve_one(memory, error);
    }
    return status;
}

void tl_fmu_memory_remeasure(tl_fmu_memory *memory) {
    memory->most_used = 0;
    note_used(memory);
    if (memory->pages != NULL) {
        tl_fmu_pages_remeasure(memory->pages);
    }
}

void tl_fmu_memory_freeze_estimate(tl_fmu_memory *memory, bool freezes) {
    if (memory->pages != NULL) {
        tl_fmu_pages_freeze_estimate(memory->pages, freezes);
    }
}

void tl_fmu_memory_free_reserve(tl_fmu_memory *memory) {
    for (memory_state *state = take_reserved(memory); state != NULL; state = take_reserved(memory)) {
        tl_fmu_memory_forget(state);
    }
}

/* ---- restore ---- */

/* Returns true if the FMU has opened a library whose contents after opening are not known. FMUs in
 * Python may open one by a name without a path, which is noticed only here. */
static bool has_unknown_library(tl_fmu_memory *memory, const memory_state *kept) {
    tl_error ignored;
    bool is_unknown = memory->folder == NULL && find_regions(memory, &ignored) != TL_OK;
    for (size_t i = kept->regions; i < memory->regions.count; i++) {
        is_unknown = is_unknown || memory->opened_as[i] == NULL;
    }
    return is_unknown;
}

bool tl_fmu_memory_has_new_library(tl_fmu_memory *memory, const void *state) {
    const memory_state *kept = state;
    return has_unknown_library(memory, kept) || kept->regions != memory->regions.count;
}

/* Returns true if a library in the state was closed since; it may have been opened again. */
static bool lacks_library(const tl_fmu_memory *memory, const memory_state *kept) {
    return kept->regions > memory->regions.count ||
           (kept->regions > 0 && memory->opened_in[kept->regions - 1] > kept->openings);
}

const char *tl_fmu_memory_obstacle(tl_fmu_memory *memory, const void *state) {
    return has_unknown_library(memory, state) ? "opened a library since the copy was made"
           : lacks_library(memory, state)     ? "closed a library since the copy was made"
           : !are_threads_asleep(memory)      ? "a thread"
                                              : tl_fmu_memory_side_effect(memory);
}

void tl_fmu_memory_restore(tl_fmu_memory *memory, void *state) {
    memory_state *kept = state;
    bool is_complete = kept->pages == NULL;
    forget_loader_error();
    bool was_written = memory->heap->was_written;
    note_used(memory);
    memory->heap->was_written = false;
    if (is_complete) {
        memcpy(memory->heap->base, kept->bytes, kept->used);
    } else {
        tl_fmu_pages_restore(memory->pages, &kept->version, was_written);
    }
    copy_regions(memory, kept->regions, is_complete, kept->bytes + (is_complete ? kept->used : 0), true);
    for (size_t i = kept->regions; i < memory->regions.count; i++) {
        (void)restore_late(memory, i, NULL);
    }
    if (is_complete && memory->pages != NULL) { /* the state was saved before the FMU became large */
        tl_fmu_pages_invalidate(memory->pages);
    }
    tl_fmu_heap_restored(memory->heap, kept->used);
    memory->raised = kept->raised;
    memory->flags = kept->flags;
    tl_fmu_libc_write_keys(memory->heap, kept->keys, kept->key_count);
}

bool tl_fmu_memory_is_same(const tl_fmu_memory *memory, const void *state) {
    const memory_state *kept = state;
    bool is_complete = kept->pages == NULL;
    const unsigned char *bytes = kept->bytes + (is_complete ? kept->used : 0);
    bool is_same = tl_fmu_heap_used(memory->heap) == kept->used && memory->regions.count == kept->regions &&
                   (is_complete ? memcmp(memory->heap->base, kept->bytes, kept->used) == 0
                                : tl_fmu_pages_are_same(memory->pages, &kept->version, kept->used));
    for (size_t i = 0; i < kept->regions && is_same; i++) {
        const tl_fmu_region *region = &memory->regions.place[i];
        if (is_complete || !is_in_pages(memory, i)) {
            is_same = !is_late(memory, i) && memcmp(region->begin, bytes, region->size) == 0;
            bytes += region->size;
        }
    }
    return is_same;
}

void tl_fmu_memory_forget(void *state) {
    memory_state *kept = state;
    if (kept != NULL && kept->pages != NULL) {
        tl_fmu_pages_forget(kept->pages, &kept->version);
    } else if (kept != NULL) {
        free(kept->version.leaf); /* it was reserved and never used */
    }
    free(kept);
}
