/* Versions of large memory, see fmu_pages.h. */
#include "firmware/rollback/fmu_pages.h"

#include <fcntl.h>
#include <linux/userfaultfd.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

/* ---- Slots: memory blocks of one size, each with a count of owners.
 *
 * Purpose: data that several versions share is stored once, and its slot becomes free when its last
 *          owner releases it.
 * Memory:  grows by 64 slots at a time, when a slot is needed or reserved (tl_page_slots_stock()).
 *          Reserved slots are not touched. Only tl_page_slots_close() frees memory.
 * Thread:  one at a time.
 */

#define TL_NO_SLOT UINT32_MAX

/* Fields are private. */
typedef struct tl_page_slots {
    size_t size;            /* bytes of a slot, a multiple of 16 */
    uint32_t made;          /* number of slots */
    uint32_t taken;         /* number of slots that were used at least once, from the first on */
    uint32_t first_unused;  /* head of the list of free slots; the first bytes of each contain the next one */
    unsigned char **pieces; /* each: the owner counts of its slots, then the slots */
} tl_page_slots;

/* ---- Groups of pages: versions share groups, and groups share pages.
 *
 * Purpose: a version is a list of groups, and a group is a list of pages. A version that differs in
 *          one page has its own copy of that page and of its group, and shares all others.
 * Written: a group or page with several owners is copied before it is changed.
 * Memory:  allocated when a page is stored, or before by tl_page_groups_stock(). Only
 *          tl_page_groups_close() frees it.
 * Thread:  one at a time.
 */

enum { TL_PAGE_GROUP = 32 }; /* pages per group; a page that changes costs the copy of a group */

/* Fields are private. */
typedef struct tl_page_groups {
    tl_page_slots contents; /* slots of pages */
    tl_page_slots groups;
    uint32_t zeros; /* shared page of zeros; TL_NO_SLOT: none yet */
} tl_page_groups;

/* ---- page slots ---- */

/* Slots per piece, bytes before the slots, and pieces by which the table grows. */
enum { PIECE = 64, HEAD = 4096, MORE = 256 };

typedef char owners_fit_into_the_head[PIECE * sizeof(uint32_t) <= HEAD ? 1 : -1];

static uint32_t *owners_of(const tl_page_slots *self, uint32_t slot) {
    return (uint32_t *)(void *)self->pieces[slot / PIECE] + slot % PIECE;
}

static unsigned char *tl_page_slots_at(const tl_page_slots *self, uint32_t slot) {
    return self->pieces[slot / PIECE] + HEAD + slot % PIECE * self->size;
}

static void tl_page_slots_open(tl_page_slots *self, size_t size) {
    *self = (tl_page_slots){.size = size, .first_unused = TL_NO_SLOT};
}

/* Frees all slots; the same state as after opening. */
static void tl_page_slots_close(tl_page_slots *self) {
    for (size_t i = 0; i < self->made / PIECE; i++) {
        (void)munmap(self->pieces[i], HEAD + PIECE * self->size);
    }
    free(self->pieces);
    tl_page_slots_open(self, self->size);
}

static bool make_piece(tl_page_slots *self) {
    size_t count = self->made / PIECE;
    if (self->made > UINT32_MAX - 2 * PIECE) {
        return false;
    }
    if (count % MORE == 0) {
        unsigned char **grown = realloc(self->pieces, (count + MORE) * sizeof *grown);
        if (grown == NULL) {
            return false;
        }
        self->pieces = grown;
    }
    void *piece = mmap(NULL, HEAD + PIECE * self->size, PROT_READ | PROT_WRITE,
                       /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file,
                        * which is -1 */
                       MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (piece == MAP_FAILED) {
        return false;
    }
    self->pieces[count] = piece;
    self->made += PIECE;
    return true;
}

/* Ensures that at least `wanted` slots exist. Returns false if memory is out. */
static bool tl_page_slots_stock(tl_page_slots *self, size_t wanted) {
    bool is_there = wanted < UINT32_MAX;
    while (is_there && self->made < wanted) {
        is_there = make_piece(self);
    }
    return is_there;
}

/* Returns a slot with one owner and undefined contents; TL_NO_SLOT if memory is out. */
static uint32_t tl_page_slots_take(tl_page_slots *self) {
    uint32_t slot = self->first_unused;
    if (slot != TL_NO_SLOT) {
        memcpy(&self->first_unused, tl_page_slots_at(self, slot), sizeof self->first_unused);
    } else if (tl_page_slots_stock(self, (size_t)self->taken + 1)) {
        slot = self->taken++;
    } else {
        return TL_NO_SLOT;
    }
    *owners_of(self, slot) = 1;
    return slot;
}

/* Removes one owner. After the last one the contents, except the first four bytes, remain until a
 * slot is taken. */
static void tl_page_slots_drop(tl_page_slots *self, uint32_t slot) {
    if (--*owners_of(self, slot) == 0) {
        memcpy(tl_page_slots_at(self, slot), &self->first_unused, sizeof self->first_unused);
        self->first_unused = slot;
    }
}

/* ---- page groups ---- */

static uint32_t *pages_in(const tl_page_groups *self, uint32_t group) {
    return (uint32_t *)(void *)tl_page_slots_at(&self->groups, group);
}

static void tl_page_groups_open(tl_page_groups *self) {
    tl_page_slots_open(&self->contents, TL_FMU_PAGE);
    tl_page_slots_open(&self->groups, TL_PAGE_GROUP * sizeof(uint32_t));
    self->zeros = TL_NO_SLOT;
}

/* Frees all groups and pages; the same state as after opening. */
static void tl_page_groups_close(tl_page_groups *self) {
    tl_page_slots_close(&self->contents);
    tl_page_slots_close(&self->groups);
    self->zeros = TL_NO_SLOT;
}

/* Number of groups for `pages` pages. */
static size_t tl_page_groups_of(size_t pages) {
    return (pages + TL_PAGE_GROUP - 1) / TL_PAGE_GROUP;
}

static void drop_page(tl_page_groups *self, uint32_t slot) {
    if (slot != TL_NO_SLOT) {
        tl_page_slots_drop(&self->contents, slot);
    }
}

static void tl_page_groups_drop(tl_page_groups *self, uint32_t group) {
    if (*owners_of(&self->groups, group) == 1) {
        for (size_t i = 0; i < TL_PAGE_GROUP; i++) {
            drop_page(self, pages_in(self, group)[i]);
        }
    }
    tl_page_slots_drop(&self->groups, group);
}

/* The contents of a page; NULL: not stored yet. Groups that share a page return the same address.
 */
static const unsigned char *tl_page_groups_look(const tl_page_groups *self, uint32_t group, size_t page) {
    uint32_t slot = pages_in(self, group)[page];
    return slot != TL_NO_SLOT ? tl_page_slots_at(&self->contents, slot) : NULL;
}

/* ---- storing a page ---- */

/* Makes a group exclusive to the caller: copies it if it has several owners. Returns false if
 * memory is out. */
static bool own(tl_page_groups *self, uint32_t *group) {
    if (*owners_of(&self->groups, *group) == 1) {
        return true;
    }
    uint32_t made = tl_page_slots_take(&self->groups);
    if (made == TL_NO_SLOT) {
        return false;
    }
    memcpy(pages_in(self, made), pages_in(self, *group), TL_PAGE_GROUP * sizeof(uint32_t));
    for (size_t i = 0; i < TL_PAGE_GROUP; i++) {
        if (pages_in(self, made)[i] != TL_NO_SLOT) {
            (*owners_of(&self->contents, pages_in(self, made)[i]))++;
        }
    }
    tl_page_slots_drop(&self->groups, *group);
    *group = made;
    return true;
}

static bool is_zero(const unsigned char *page) {
    return page[0] == 0 && memcmp(page, page + 1, TL_FMU_PAGE - 1) == 0;
}

/* Stores contents that differ from those before. Returns TL_NO_SLOT if memory is out. */
static uint32_t slot_for(tl_page_groups *self, uint32_t before, const unsigned char *page) {
    bool is_own = before != TL_NO_SLOT && *owners_of(&self->contents, before) == 1;
    bool is_of_zeros = before == TL_NO_SLOT && is_zero(page);
    if (is_of_zeros && self->zeros != TL_NO_SLOT) {
        (*owners_of(&self->contents, self->zeros))++;
        return self->zeros;
    }
    uint32_t slot = is_own ? before : tl_page_slots_take(&self->contents);
    if (slot == TL_NO_SLOT) {
        return slot;
    }
    memcpy(tl_page_slots_at(&self->contents, slot), page, TL_FMU_PAGE);
    if (is_of_zeros) { /* the first page of zeros becomes the shared one */
        (*owners_of(&self->contents, slot))++;
        self->zeros = slot;
    } else if (!is_own) {
        drop_page(self, before);
    }
    return slot;
}

/* Stores the contents of a page; afterwards the group is exclusive to the caller. Returns false if
 * memory is out; then no version has changed. */
static bool tl_page_groups_put(tl_page_groups *self, uint32_t *group, size_t page, const unsigned char *bytes) {
    if (!own(self, group)) {
        return false;
    }
    uint32_t slot = slot_for(self, pages_in(self, *group)[page], bytes);
    if (slot == TL_NO_SLOT) {
        return false;
    }
    pages_in(self, *group)[page] = slot;
    return true;
}

/* ---- reserving memory ---- */

/* Reserves memory for `first` pages and `differing` more pages, each in its own group in the worst
 * case. Returns false if memory is out. */
static bool tl_page_groups_stock(tl_page_groups *self, size_t first, size_t differing) {
    return tl_page_slots_stock(&self->contents, first + differing) &&
           tl_page_slots_stock(&self->groups, tl_page_groups_of(first) + differing);
}

/* ---- written pages ---- */

/* Constants of Linux 6.7, which older headers lack. */
enum {
    USER_MODE_ONLY = 1,        /* UFFD_USER_MODE_ONLY */
    UNPOPULATED_TOO = 1 << 13, /* UFFD_FEATURE_WP_UNPOPULATED */
    ASYNCHRONOUS = 1 << 15,    /* UFFD_FEATURE_WP_ASYNC */
    IS_WRITTEN = 1 << 1,       /* PAGE_IS_WRITTEN */
    PROTECT_FOUND = 1 << 0,
    ONLY_WATCHED = 1 << 1 /* PM_SCAN_WP_MATCHING, PM_SCAN_CHECK_WPASYNC */
};

typedef struct found_run {
    uint64_t begin;
    uint64_t end;
    uint64_t categories;
} found_run;

typedef struct scan_order {
    uint64_t size;
    uint64_t flags;
    uint64_t begin;
    uint64_t end;
    uint64_t walked; /* result: end of the scanned part */
    uint64_t runs;
    uint64_t room;
    uint64_t most_pages;
    uint64_t inverted;
    uint64_t all_of;
    uint64_t any_of;
    uint64_t returned;
} scan_order;

#define SCAN _IOWR('f', 16, scan_order)

enum { RUNS = 256 };

/* Receives a run of written pages. */
typedef void take_written(void *context, size_t first, size_t count);

static bool has_begun;
static bool serves;
static int watcher = -1;
static int map = -1;

/* Starts the detection for a range: whole pages of private memory, until the process ends. Returns
 * false if the kernel refuses. */
static bool watch_range(const unsigned char *begin, size_t size) {
    struct uffdio_register order = {.range = {.start = (uintptr_t)begin, .len = size}, .mode = UFFDIO_REGISTER_MODE_WP};
    return ioctl(watcher, UFFDIO_REGISTER, &order) == 0;
}

/* Reports, in order, all pages of a watched range that were written since the last reset. `forget`
 * resets them. Returns false if not all could be reported. */
static bool find_written(const unsigned char *begin, size_t size, bool forget, take_written *take, void *context) {
    found_run runs[RUNS];
    scan_order order = {.size = sizeof order,
                        .flags = ONLY_WATCHED | (forget ? PROTECT_FOUND : 0),
                        .walked = (uintptr_t)begin,
                        .end = (uintptr_t)begin + size,
                        .runs = (uintptr_t)runs,
                        .room = RUNS,
                        .all_of = IS_WRITTEN,
                        .returned = IS_WRITTEN};
    while (order.walked < order.end) {
        order.begin = order.walked;
        int count = ioctl(map, SCAN, &order);
        if (count < 0 || order.walked <= order.begin) {
            return false;
        }
        for (int i = 0; i < count; i++) {
            take(context, (size_t)(runs[i].begin - (uintptr_t)begin) / TL_FMU_PAGE,
                 (size_t)(runs[i].end - runs[i].begin) / TL_FMU_PAGE);
        }
    }
    return true;
}

static void count_pages(void *context, size_t first, size_t count) {
    (void)first;
    *(size_t *)context += count;
}

static size_t count_written(const unsigned char *page) {
    size_t count = 0;
    return find_written(page, TL_FMU_PAGE, true, count_pages, &count) ? count : SIZE_MAX;
}

/* Tests detection with one page: after a write, without a write, and after another write. */
static bool try_watching(void) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    unsigned char *page = mmap(NULL, TL_FMU_PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (page == MAP_FAILED) {
        return false;
    }
    page[0] = 1;
    bool is_true = watch_range(page, TL_FMU_PAGE) && count_written(page) == 1;
    is_true = is_true && count_written(page) == 0;
    page[1] = 1;
    is_true = is_true && count_written(page) == 1;
    (void)munmap(page, TL_FMU_PAGE);
    return is_true;
}

void tl_fmu_written_begin(void) {
    struct uffdio_api wanted = {.api = UFFD_API, .features = ASYNCHRONOUS | UNPOPULATED_TOO};
    if (has_begun) {
        return;
    }
    has_begun = true;
    if (sysconf(_SC_PAGESIZE) != TL_FMU_PAGE) {
        return;
    }
    watcher = (int)syscall(SYS_userfaultfd, O_CLOEXEC | O_NONBLOCK | USER_MODE_ONLY);
    map = open("/proc/self/pagemap", O_RDONLY | O_CLOEXEC);
    serves = watcher >= 0 && map >= 0 && ioctl(watcher, UFFDIO_API, &wanted) == 0 && try_watching();
    if (!serves) {
        (void)close(watcher); /* may be −1 */
        (void)close(map);
    }
}

bool tl_fmu_written_serves(void) {
    tl_fmu_written_begin();
    return serves;
}

/* ---- versions ---- */

/* ASSUMED_PAGES: default number of pages that differ between two versions; the largest number seen
 * in large FMUs. It is used until versions differ or a restore has copied pages. After KNOWN_SAVES
 * versions that differed, restores no longer count, because they contain the changes of several
 * steps. */
enum { ASSUMED_PAGES = 64, KNOWN_SAVES = 4 };

/* Largest unused reserve after a save: 64 MiB. */
enum { MOST_AHEAD = (64 << 20) / TL_FMU_PAGE };

/* A protected page costs a page fault of about 1 µs at its next write. An unprotected page costs a
 * comparison of about 0.1 µs in each save, and in each restore after a call. So pages that are
 * written in every step stay unprotected. The next save protects the pages that it finds if a save
 * or restore found more than FEW_PAGES plus twice the differing pages. */
enum { FEW_PAGES = 4 };

struct tl_fmu_pages {
    size_t count;
    tl_fmu_region range[TL_FMU_REGIONS + 1];
    size_t before[TL_FMU_REGIONS + 1]; /* pages in all ranges before this one */
    bool are_reported;
    tl_page_groups groups;
    tl_fmu_version now; /* memory at the last save or restore */
    uint32_t versions;  /* number of versions */
    size_t most;        /* most pages that differed between two versions */
    unsigned times;     /* number of versions that differed */
    size_t most_put;    /* most pages copied by one restore */
    bool passes;        /* while true, `most`, `times` and `most_put` are not updated */
    bool protects;      /* the next save protects what it finds */
    size_t hot;         /* most pages that differed in a restore since the last save */
    bool is_full;       /* present call: memory is out */
    size_t found;       /* present call: pages that were reported or compared */
    size_t differing;   /* present call: pages that differ or were copied */
};

/* Pages found in a range are restored from `version`; NULL: they are saved. */
typedef struct found_pages {
    tl_fmu_pages *pages;
    size_t range;
    const tl_fmu_version *version;
} found_pages;

static size_t pages_of(size_t bytes) {
    return (bytes + TL_FMU_PAGE - 1) / TL_FMU_PAGE;
}

static unsigned char *address_of(const tl_fmu_pages *self, size_t page) {
    size_t i = self->count - 1;
    while (self->before[i] > page) {
        i--;
    }
    return self->range[i].begin + (page - self->before[i]) * TL_FMU_PAGE;
}

static bool make_room(tl_fmu_version *version, size_t leaves) {
    if (leaves <= version->room) {
        return true;
    }
    size_t room = leaves + leaves / 4;
    uint32_t *grown = realloc(version->leaf, room * sizeof *grown);
    if (grown == NULL) {
        return false;
    }
    version->leaf = grown;
    version->room = room;
    return true;
}

/* Grows the present version to `pages` pages; new ones are empty. */
static bool grow(tl_fmu_pages *self, size_t pages) {
    if (!make_room(&self->now, tl_page_groups_of(pages))) {
        return false;
    }
    while (self->now.leaves < tl_page_groups_of(pages)) {
        uint32_t leaf = tl_page_slots_take(&self->groups.groups);
        if (leaf == TL_NO_SLOT) {
            return false;
        }
        memset(pages_in(&self->groups, leaf), 0xff, TL_PAGE_GROUP * sizeof(uint32_t)); /* TL_NO_SLOT */
        self->now.leaf[self->now.leaves++] = leaf;
    }
    return true;
}

static void shrink(tl_fmu_pages *self, size_t leaves) {
    while (self->now.leaves > leaves) {
        tl_page_groups_drop(&self->groups, self->now.leaf[--self->now.leaves]);
    }
}

/* ---- applying written pages ---- */

static bool keep_page(tl_fmu_pages *self, size_t number, const unsigned char *page) {
    uint32_t *group = &self->now.leaf[number / TL_PAGE_GROUP];
    const unsigned char *before = tl_page_groups_look(&self->groups, *group, number % TL_PAGE_GROUP);
    if (before != NULL && memcmp(before, page, TL_FMU_PAGE) == 0) {
        return true;
    }
    self->differing++;
    return tl_page_groups_put(&self->groups, group, number % TL_PAGE_GROUP, page);
}

/* Returns true if a page has the same slot in the present version and in another one. */
static bool is_shared(const tl_fmu_pages *self, const tl_fmu_version *version, size_t number) {
    size_t leaf = number / TL_PAGE_GROUP;
    return number < self->now.pages && (self->now.leaf[leaf] == version->leaf[leaf] ||
                                        pages_in(&self->groups, self->now.leaf[leaf])[number % TL_PAGE_GROUP] ==
                                            pages_in(&self->groups, version->leaf[leaf])[number % TL_PAGE_GROUP]);
}

static void restore_page(tl_fmu_pages *self, size_t number, unsigned char *page, const tl_fmu_version *version) {
    memcpy(page, tl_page_groups_look(&self->groups, version->leaf[number / TL_PAGE_GROUP], number % TL_PAGE_GROUP),
           TL_FMU_PAGE);
    self->differing++;
}

/* Restores a page that may have been written, if both versions share it. restore_different()
 * restores the others. */
static void restore_written(tl_fmu_pages *self, size_t number, unsigned char *page, const tl_fmu_version *version) {
    if (is_shared(self, version, number) &&
        memcmp(page, tl_page_groups_look(&self->groups, version->leaf[number / TL_PAGE_GROUP], number % TL_PAGE_GROUP),
               TL_FMU_PAGE) != 0) {
        restore_page(self, number, page, version);
    }
}

static void meet_pages(void *context, size_t first, size_t count) {
    const found_pages *found = context;
    tl_fmu_pages *self = found->pages;
    self->found += count;
    for (size_t i = first; i < first + count && !self->is_full; i++) {
        unsigned char *page = self->range[found->range].begin + i * TL_FMU_PAGE;
        size_t number = self->before[found->range] + i;
        if (found->version != NULL) {
            restore_written(self, number, page, found->version);
        } else {
            self->is_full = !keep_page(self, number, page);
        }
    }
}

/* Applies all changes in the first `pages` pages. */
static void find(tl_fmu_pages *self, size_t pages, const tl_fmu_version *version) {
    bool protects = version == NULL && self->protects;
    for (size_t i = 0; i < self->count; i++) {
        found_pages found = {.pages = self, .range = i, .version = version};
        size_t count = (i + 1 < self->count ? self->before[i + 1] : pages) - self->before[i];
        if (!self->are_reported ||
            !find_written(self->range[i].begin, count * TL_FMU_PAGE, protects, meet_pages, &found)) {
            meet_pages(&found, 0, count);
        }
    }
}

/* ---- save ---- */

static void share_leaves(tl_fmu_pages *self, tl_fmu_version *version) {
    for (size_t i = 0; i < self->now.leaves; i++) {
        (*owners_of(&self->groups.groups, self->now.leaf[i]))++;
    }
    for (size_t i = 0; i < version->leaves; i++) {
        tl_page_groups_drop(&self->groups, version->leaf[i]);
    }
    memcpy(version->leaf, self->now.leaf, self->now.leaves * sizeof *version->leaf);
    version->leaves = self->now.leaves;
    version->pages = self->now.pages;
}

/* Later versions are expected to differ as much. A large block that moves once must not use up the
 * limit of the process, so the unused reserve is bounded. If memory is out now, it is requested
 * again when it is needed. */
static void stock_ahead(tl_fmu_pages *self) {
    size_t most = self->groups.contents.taken + MOST_AHEAD;
    size_t wanted = self->now.pages + self->most * self->versions;
    wanted = wanted < most ? wanted : most;
    size_t differing = wanted > self->now.pages ? wanted - self->now.pages : 0;
    (void)tl_page_groups_stock(&self->groups, self->now.pages, differing);
}

tl_status tl_fmu_pages_save(tl_fmu_pages *self, size_t used, bool was_written, tl_fmu_version *version,
                            tl_error *error) {
    size_t pages = self->before[self->count - 1] + pages_of(used);
    bool is_first = self->now.pages == 0;
    bool is_new = version->leaves == 0;
    self->found = 0;
    self->differing = 0;
    self->is_full = !grow(self, pages) || !make_room(version, tl_page_groups_of(pages));
    bool is_same = !was_written && !self->protects && pages == self->now.pages;
    if (!self->is_full && !is_same) {
        find(self, pages, NULL);
    }
    for (size_t i = self->now.pages; i < pages && !self->is_full; i++) {
        self->is_full = !keep_page(self, i, address_of(self, i));
    }
    if (self->is_full) {
        self->now.pages = 0; /* some pages may be protected already, so the next save must compare all pages */
        if (is_new) {
            free(version->leaf);
            *version = (tl_fmu_version){.pages = 0};
        }
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a copy of %zu pages", pages);
    }
    if (!is_same) {
        self->hot = self->differing > self->hot ? self->differing : self->hot;
        self->protects = self->found > FEW_PAGES + 2 * self->hot;
        self->hot = 0;
    }
    self->now.pages = pages;
    shrink(self, tl_page_groups_of(pages));
    share_leaves(self, version);
    self->versions += is_new ? 1 : 0;
    if (!is_first && self->differing > 0 && !self->passes) {
        self->most = self->differing > self->most ? self->differing : self->most;
        self->times++;
    }
    stock_ahead(self);
    return TL_OK;
}

/* ---- restore ---- */

static void restore_different(tl_fmu_pages *self, const tl_fmu_version *version) {
    for (size_t i = 0; i < version->pages; i++) {
        if (!is_shared(self, version, i)) {
            restore_page(self, i, address_of(self, i), version);
        } else if (self->now.leaf[i / TL_PAGE_GROUP] ==
                   version->leaf[i / TL_PAGE_GROUP]) { /* skip to the last common page of the group */
            size_t end = (i / TL_PAGE_GROUP + 1) * TL_PAGE_GROUP;
            i = (end < self->now.pages ? end : self->now.pages) - 1;
        }
    }
}

/* There is enough room, because the version was a copy of the present version once. */
static void follow_version(tl_fmu_pages *self, const tl_fmu_version *version) {
    shrink(self, version->leaves);
    for (size_t i = 0; i < version->leaves; i++) {
        if (i < self->now.leaves && self->now.leaf[i] == version->leaf[i]) {
            continue;
        }
        (*owners_of(&self->groups.groups, version->leaf[i]))++;
        if (i < self->now.leaves) {
            tl_page_groups_drop(&self->groups, self->now.leaf[i]);
        }
        self->now.leaf[i] = version->leaf[i];
    }
    self->now.leaves = version->leaves;
    self->now.pages = version->pages;
}

void tl_fmu_pages_restore(tl_fmu_pages *self, const tl_fmu_version *version, bool was_written) {
    self->is_full = false;
    self->found = 0;
    self->differing = 0;
    if (was_written) {
        find(self, version->pages, version);
    }
    restore_different(self, version);
    self->hot = self->differing > self->hot ? self->differing : self->hot;
    self->protects = self->protects || self->found > FEW_PAGES + 2 * self->hot;
    self->most_put = self->differing > self->most_put && !self->passes ? self->differing : self->most_put;
    follow_version(self, version);
}

bool tl_fmu_pages_are_same(const tl_fmu_pages *self, const tl_fmu_version *version, size_t used) {
    bool is_same = version->pages == self->before[self->count - 1] + pages_of(used);
    for (size_t i = 0; i < version->pages && is_same; i++) {
        const unsigned char *page =
            tl_page_groups_look(&self->groups, version->leaf[i / TL_PAGE_GROUP], i % TL_PAGE_GROUP);
        is_same = memcmp(address_of(self, i), page, TL_FMU_PAGE) == 0;
    }
    return is_same;
}

void tl_fmu_pages_invalidate(tl_fmu_pages *self) {
    self->now.pages = 0;
}

void tl_fmu_pages_forget(tl_fmu_pages *self, tl_fmu_version *version) {
    for (size_t i = 0; i < version->leaves; i++) {
        tl_page_groups_drop(&self->groups, version->leaf[i]);
    }
    self->versions -= version->leaves > 0 ? 1 : 0;
    free(version->leaf);
    *version = (tl_fmu_version){.pages = 0};
    if (self->versions == 0) { /* without versions the stored pages are useless */
        tl_page_groups_close(&self->groups);
        self->now.leaves = 0;
        self->now.pages = 0;
    }
}

/* ---- all of it ---- */

/* Estimated number of pages of one more version. */
static size_t pages_that_differ(const tl_fmu_pages *self) {
    size_t most_restored = self->most_put > self->most ? self->most_put : self->most;
    size_t assumed = self->now.pages < ASSUMED_PAGES ? self->now.pages : ASSUMED_PAGES;
    return self->times >= KNOWN_SAVES ? self->most : most_restored > 0 ? most_restored : assumed;
}

size_t tl_fmu_pages_size(const tl_fmu_pages *self) {
    return self->now.leaves * sizeof(uint32_t) +
           pages_that_differ(self) * (TL_FMU_PAGE + TL_PAGE_GROUP * sizeof(uint32_t));
}

void tl_fmu_pages_remeasure(tl_fmu_pages *self) {
    self->most = 0;
    self->times = 0;
    self->most_put = 0;
}

void tl_fmu_pages_freeze_estimate(tl_fmu_pages *self, bool passes) {
    self->passes = passes;
}

bool tl_fmu_pages_reserve(tl_fmu_pages *self, size_t versions) {
    return tl_page_groups_stock(&self->groups, self->now.pages, pages_that_differ(self) * (self->versions + versions));
}

bool tl_fmu_pages_reserve_version(const tl_fmu_pages *self, tl_fmu_version *version) {
    return make_room(version, self->now.leaves);
}

tl_fmu_pages *tl_fmu_pages_open(const tl_fmu_region *ranges, size_t count, tl_error *error) {
    tl_fmu_pages *self = calloc(1, sizeof *self);
    if (self == NULL) {
        (void)tl_fail(error, TL_TRY_AGAIN, "not enough memory for copies of an FMU");
        return NULL;
    }
    tl_page_groups_open(&self->groups);
    self->are_reported = tl_fmu_written_serves();
    self->count = count;
    for (size_t i = 0; i < count; i++) {
        self->range[i] = ranges[i];
        self->before[i] = i == 0 ? 0 : self->before[i - 1] + pages_of(ranges[i - 1].size);
        self->are_reported = self->are_reported && watch_range(ranges[i].begin, ranges[i].size);
    }
    return self;
}
