/* Versions of much memory: see fmu_pages.h. */
#include "firmware/rollback/fmu_pages.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "firmware/rollback/fmu_written.h"

/* ---- slots: pieces of memory of one size, each of which may have several owners ---- */

enum { SLOTS_PIECE = 256, SLOTS_HEAD = 4096 };

#define NO_SLOT UINT32_MAX

typedef struct slots {
    size_t size;            /* bytes of each, a multiple of 16 */
    uint32_t made;          /* slots that there are, */
    uint32_t unused;        /* of which nobody owns so many; */
    uint32_t first_unused;  /* each has the next one in its first bytes */
    unsigned char **pieces; /* each: how many owners its slots have, then the slots from SLOTS_HEAD on */
} slots;

static unsigned char *slots_at(const slots *self, uint32_t slot) {
    return self->pieces[slot / SLOTS_PIECE] + SLOTS_HEAD + slot % SLOTS_PIECE * self->size;
}

static uint32_t *slots_owners(const slots *self, uint32_t slot) {
    return (uint32_t *)(void *)self->pieces[slot / SLOTS_PIECE] + slot % SLOTS_PIECE;
}

/* One owner more. */
static void slots_share(slots *self, uint32_t slot) {
    (*slots_owners(self, slot))++;
}

/* Pieces that the table grows by. */
enum { MORE = 64 };

typedef char owners_fit_into_the_head[SLOTS_PIECE * sizeof(uint32_t) <= SLOTS_HEAD ? 1 : -1];

static void slots_open(slots *self, size_t size) {
    *self = (slots){.size = size, .first_unused = NO_SLOT};
}

static void slots_close(slots *self) {
    for (size_t i = 0; i < self->made / SLOTS_PIECE; i++) {
        (void)munmap(self->pieces[i], SLOTS_HEAD + SLOTS_PIECE * self->size);
    }
    free(self->pieces);
    slots_open(self, self->size);
}

static void put_unused(slots *self, uint32_t slot) {
    memcpy(slots_at(self, slot), &self->first_unused, sizeof self->first_unused);
    self->first_unused = slot;
    self->unused++;
}

static bool make_piece(slots *self) {
    size_t count = self->made / SLOTS_PIECE;
    if (self->made > UINT32_MAX - 2 * SLOTS_PIECE) {
        return false;
    }
    if (count % MORE == 0) {
        unsigned char **grown = realloc(self->pieces, (count + MORE) * sizeof *grown);
        if (grown == NULL) {
            return false;
        }
        self->pieces = grown;
    }
    void *piece = mmap(NULL, SLOTS_HEAD + SLOTS_PIECE * self->size, PROT_READ | PROT_WRITE,
                       /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
                       MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (piece == MAP_FAILED) {
        return false;
    }
    self->pieces[count] = piece;
    self->made += SLOTS_PIECE;
    for (uint32_t i = 1; i <= SLOTS_PIECE; i++) {
        put_unused(self, self->made - i);
    }
    return true;
}

/* So many can be taken without asking for memory. False: there is none. */
static bool slots_stock(slots *self, uint32_t count) {
    bool is_there = true;
    while (is_there && self->unused < count) {
        is_there = make_piece(self);
    }
    return is_there;
}

/* A slot with one owner, its bytes being anything; NO_SLOT: there is no memory. */
static uint32_t slots_take(slots *self) {
    if (!slots_stock(self, 1)) {
        return NO_SLOT;
    }
    uint32_t slot = self->first_unused;
    memcpy(&self->first_unused, slots_at(self, slot), sizeof self->first_unused);
    self->unused--;
    *slots_owners(self, slot) = 1;
    return slot;
}

/* One owner less. True: that was the last; the slot's bytes, but for the first four, are as they were until one is taken. */
static bool slots_drop(slots *self, uint32_t slot) {
    if (--*slots_owners(self, slot) > 0) {
        return false;
    }
    put_unused(self, slot);
    return true;
}

/* ---- pages ---- */

/* Pages in a group. A version has the slot of each group, and shares the group with others in which no page of it differs. */
enum { LEAF = 64 };

/* Pages that are supposed to be written between two versions, the most that was seen of large FMUs: until some were put back, which is what several steps
 * have written, and until so many versions differed from the one before. */
enum { SUPPOSED = 64, KNOWN = 4 };

struct tl_fmu_pages {
    size_t count;
    tl_fmu_place range[TL_FMU_PLACES + 1];
    size_t before[TL_FMU_PLACES + 1]; /* pages in the ranges before this one */
    bool are_told;
    slots contents; /* of pages */
    slots leaves;
    uint32_t zeros;     /* a page of zeros; NO_SLOT: not yet */
    tl_fmu_version now; /* what memory was when it was last saved or restored; but for what was written since */
    uint32_t versions;  /* that there are */
    size_t most;        /* pages that differed in a version from what was before, */
    unsigned times;     /* that any did */
    size_t most_put;    /* pages that were put back in one go */
    bool is_full;       /* in the call that is under way: no memory, */
    size_t differing;   /* and pages that differ, or were put back */
};

/* What was found in one of the ranges is for this version to come; NULL: it is saved. */
typedef struct found_pages {
    tl_fmu_pages *pages;
    size_t range;
    const tl_fmu_version *version;
} found_pages;

static size_t pages_of(size_t bytes) {
    return (bytes + TL_FMU_PAGE - 1) / TL_FMU_PAGE;
}

static size_t leaves_of(size_t pages) {
    return (pages + LEAF - 1) / LEAF;
}

static unsigned char *address_of(const tl_fmu_pages *self, size_t page) {
    size_t i = self->count - 1;
    while (self->before[i] > page) {
        i--;
    }
    return self->range[i].begin + (page - self->before[i]) * TL_FMU_PAGE;
}

static uint32_t *slots_in(const tl_fmu_pages *self, uint32_t leaf) {
    return (uint32_t *)(void *)slots_at(&self->leaves, leaf);
}

/* ---- leaves ---- */

static void drop_page(tl_fmu_pages *self, uint32_t slot) {
    if (slot != NO_SLOT) {
        (void)slots_drop(&self->contents, slot);
    }
}

static void drop_leaf(tl_fmu_pages *self, uint32_t leaf) {
    if (*slots_owners(&self->leaves, leaf) == 1) {
        for (size_t i = 0; i < LEAF; i++) {
            drop_page(self, slots_in(self, leaf)[i]);
        }
    }
    (void)slots_drop(&self->leaves, leaf);
}

/* A leaf of its own for what memory is now. False: no memory. */
static bool own_leaf(tl_fmu_pages *self, size_t which) {
    uint32_t leaf = self->now.leaf[which];
    if (*slots_owners(&self->leaves, leaf) == 1) {
        return true;
    }
    uint32_t own = slots_take(&self->leaves);
    if (own == NO_SLOT) {
        return false;
    }
    memcpy(slots_in(self, own), slots_in(self, leaf), LEAF * sizeof(uint32_t));
    for (size_t i = 0; i < LEAF; i++) {
        if (slots_in(self, own)[i] != NO_SLOT) {
            slots_share(&self->contents, slots_in(self, own)[i]);
        }
    }
    (void)slots_drop(&self->leaves, leaf);
    self->now.leaf[which] = own;
    return true;
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

/* As many as so many pages need; new ones are empty. */
static bool grow(tl_fmu_pages *self, size_t pages) {
    if (!make_room(&self->now, leaves_of(pages))) {
        return false;
    }
    while (self->now.leaves < leaves_of(pages)) {
        uint32_t leaf = slots_take(&self->leaves);
        if (leaf == NO_SLOT) {
            return false;
        }
        memset(slots_in(self, leaf), 0xff, LEAF * sizeof(uint32_t)); /* NO_SLOT */
        self->now.leaf[self->now.leaves++] = leaf;
    }
    return true;
}

static void shrink(tl_fmu_pages *self, size_t leaves) {
    while (self->now.leaves > leaves) {
        drop_leaf(self, self->now.leaf[--self->now.leaves]);
    }
}

/* ---- what was written ---- */

static void find_in_range(found_pages *found, size_t pages, tl_fmu_written_take *take) {
    const tl_fmu_pages *self = found->pages;
    bool is_told = self->are_told && tl_fmu_written_find(self->range[found->range].begin, pages * TL_FMU_PAGE,
                                                         found->version == NULL, take, found);
    if (!is_told) {
        take(found, 0, pages);
    }
}

/* Of the first so many pages of all. */
static void find(tl_fmu_pages *self, size_t pages, const tl_fmu_version *version, tl_fmu_written_take *take) {
    for (size_t i = 0; i < self->count; i++) {
        found_pages found = {.pages = self, .range = i, .version = version};
        size_t behind = i + 1 < self->count ? self->before[i + 1] : pages;
        find_in_range(&found, behind - self->before[i], take);
    }
}

/* ---- to save ---- */

static bool is_zero(const unsigned char *page) {
    return page[0] == 0 && memcmp(page, page + 1, TL_FMU_PAGE - 1) == 0;
}

static bool has_zeros(tl_fmu_pages *self) {
    if (self->zeros == NO_SLOT) {
        self->zeros = slots_take(&self->contents);
        if (self->zeros != NO_SLOT) {
            memset(slots_at(&self->contents, self->zeros), 0, TL_FMU_PAGE);
        }
    }
    return self->zeros != NO_SLOT;
}

/* For contents that no version has. NO_SLOT: no memory. */
static uint32_t slot_for(tl_fmu_pages *self, uint32_t before, const unsigned char *page) {
    if (before == NO_SLOT && is_zero(page) && has_zeros(self)) {
        slots_share(&self->contents, self->zeros);
        return self->zeros;
    }
    bool is_own = before != NO_SLOT && *slots_owners(&self->contents, before) == 1;
    uint32_t slot = is_own ? before : slots_take(&self->contents);
    if (slot == NO_SLOT) {
        return slot;
    }
    memcpy(slots_at(&self->contents, slot), page, TL_FMU_PAGE);
    if (!is_own) {
        drop_page(self, before);
    }
    return slot;
}

static bool keep_page(tl_fmu_pages *self, size_t number, const unsigned char *page) {
    size_t which = number / LEAF;
    uint32_t before = slots_in(self, self->now.leaf[which])[number % LEAF];
    if (before != NO_SLOT && memcmp(slots_at(&self->contents, before), page, TL_FMU_PAGE) == 0) {
        return true;
    }
    if (!own_leaf(self, which)) {
        return false;
    }
    uint32_t slot = slot_for(self, before, page);
    if (slot == NO_SLOT) {
        return false;
    }
    slots_in(self, self->now.leaf[which])[number % LEAF] = slot;
    self->differing++;
    return true;
}

static void keep_pages(void *context, size_t first, size_t count) {
    const found_pages *found = context;
    tl_fmu_pages *self = found->pages;
    for (size_t i = first; i < first + count && !self->is_full; i++) {
        const unsigned char *page = self->range[found->range].begin + i * TL_FMU_PAGE;
        self->is_full = !keep_page(self, self->before[found->range] + i, page);
    }
}

/* Versions to come are supposed to differ as much as those that were. If there is no memory now, it is asked for when it is needed. */
static void stock(tl_fmu_pages *self, bool is_first) {
    if (!is_first && self->differing > 0) {
        self->most = self->differing > self->most ? self->differing : self->most;
        self->times++;
    }
    size_t pages = self->most * self->versions;
    size_t most = self->now.pages + pages;
    if (most < UINT32_MAX && most > self->contents.made) {
        (void)slots_stock(&self->contents, self->contents.unused + (uint32_t)(most - self->contents.made));
    }
}

static void share_leaves(tl_fmu_pages *self, tl_fmu_version *version) {
    for (size_t i = 0; i < self->now.leaves; i++) {
        slots_share(&self->leaves, self->now.leaf[i]);
    }
    for (size_t i = 0; i < version->leaves; i++) {
        drop_leaf(self, version->leaf[i]);
    }
    memcpy(version->leaf, self->now.leaf, self->now.leaves * sizeof *version->leaf);
    version->leaves = self->now.leaves;
    version->pages = self->now.pages;
}

tl_status tl_fmu_pages_save(tl_fmu_pages *self, size_t used, tl_fmu_version *version, tl_error *error) {
    size_t pages = self->before[self->count - 1] + pages_of(used);
    bool is_first = self->now.pages == 0;
    bool is_new = version->leaf == NULL;
    self->differing = 0;
    self->is_full = !grow(self, pages) || !make_room(version, leaves_of(pages));
    if (!self->is_full) {
        find(self, pages, NULL, keep_pages);
    }
    for (size_t i = self->now.pages; i < pages && !self->is_full; i++) {
        self->is_full = !keep_page(self, i, address_of(self, i));
    }
    if (self->is_full) {
        self->now.pages = 0; /* what was written is forgotten: all is looked at the next time */
        if (is_new) {
            free(version->leaf);
            *version = (tl_fmu_version){.pages = 0};
        }
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a state of %zu pages", pages);
    }
    self->now.pages = pages;
    shrink(self, leaves_of(pages));
    share_leaves(self, version);
    self->versions += is_new ? 1 : 0;
    stock(self, is_first);
    return TL_OK;
}

/* ---- to restore ---- */

static void put_page(tl_fmu_pages *self, size_t number, unsigned char *page, const tl_fmu_version *version) {
    uint32_t slot = slots_in(self, version->leaf[number / LEAF])[number % LEAF];
    const unsigned char *kept = slots_at(&self->contents, slot);
    if (self->are_told || memcmp(page, kept, TL_FMU_PAGE) != 0) {
        memcpy(page, kept, TL_FMU_PAGE);
        self->differing++;
    }
}

static void put_pages(void *context, size_t first, size_t count) {
    const found_pages *found = context;
    tl_fmu_pages *self = found->pages;
    for (size_t i = first; i < first + count; i++) {
        put_page(self, self->before[found->range] + i, self->range[found->range].begin + i * TL_FMU_PAGE,
                 found->version);
    }
}

/* Both are full up to `pages`. */
static void put_leaf(tl_fmu_pages *self, size_t which, const tl_fmu_version *version, size_t pages) {
    const uint32_t *now = slots_in(self, self->now.leaf[which]);
    const uint32_t *then = slots_in(self, version->leaf[which]);
    for (size_t i = 0; i < LEAF && which * LEAF + i < pages; i++) {
        if (now[i] != then[i]) {
            put_page(self, which * LEAF + i, address_of(self, which * LEAF + i), version);
        }
    }
}

static void put_what_differs(tl_fmu_pages *self, const tl_fmu_version *version) {
    size_t common = version->pages < self->now.pages ? version->pages : self->now.pages;
    for (size_t i = 0; i < leaves_of(common); i++) {
        if (self->now.leaf[i] != version->leaf[i]) {
            put_leaf(self, i, version, common);
        }
    }
    for (size_t i = common; i < version->pages; i++) {
        put_page(self, i, address_of(self, i), version);
    }
}

/* There is room: the version was made of what memory was then. */
static void follow(tl_fmu_pages *self, const tl_fmu_version *version) {
    shrink(self, version->leaves);
    for (size_t i = 0; i < version->leaves; i++) {
        if (i < self->now.leaves && self->now.leaf[i] == version->leaf[i]) {
            continue;
        }
        slots_share(&self->leaves, version->leaf[i]);
        if (i < self->now.leaves) {
            drop_leaf(self, self->now.leaf[i]);
        }
        self->now.leaf[i] = version->leaf[i];
    }
    self->now.leaves = version->leaves;
    self->now.pages = version->pages;
}

void tl_fmu_pages_restore(tl_fmu_pages *self, const tl_fmu_version *version) {
    self->differing = 0;
    find(self, version->pages, version, put_pages);
    self->most_put = self->differing > self->most_put ? self->differing : self->most_put;
    if (self->are_told) {
        put_what_differs(self, version);
    }
    follow(self, version);
}

void tl_fmu_pages_lose(tl_fmu_pages *self) {
    self->now.pages = 0;
}

/* Nobody has a version: what memory was is of no use. */
static void give_back_all(tl_fmu_pages *self) {
    slots_close(&self->contents);
    slots_close(&self->leaves);
    self->zeros = NO_SLOT;
    self->now.leaves = 0;
    self->now.pages = 0;
}

void tl_fmu_pages_forget(tl_fmu_pages *self, tl_fmu_version *version) {
    for (size_t i = 0; i < version->leaves; i++) {
        drop_leaf(self, version->leaf[i]);
    }
    self->versions -= version->leaves > 0 ? 1 : 0;
    free(version->leaf);
    *version = (tl_fmu_version){.pages = 0};
    if (self->versions == 0) {
        give_back_all(self);
    }
}

/* ---- the whole ---- */

bool tl_fmu_pages_are_told(const tl_fmu_pages *self) {
    return self->are_told;
}

size_t tl_fmu_pages_size(const tl_fmu_pages *self) {
    size_t put = self->most_put > self->most ? self->most_put : self->most;
    size_t pages = self->times >= KNOWN ? self->most : put > 0 ? put : SUPPOSED;
    return self->now.leaves * sizeof(uint32_t) + pages * (TL_FMU_PAGE + LEAF * sizeof(uint32_t));
}

tl_fmu_pages *tl_fmu_pages_open(const tl_fmu_place *ranges, size_t count, tl_error *error) {
    tl_fmu_pages *self = calloc(1, sizeof *self);
    if (self == NULL) {
        (void)tl_fail(error, TL_TRY_AGAIN, "not enough memory for states of an FMU");
        return NULL;
    }
    slots_open(&self->contents, TL_FMU_PAGE);
    slots_open(&self->leaves, LEAF * sizeof(uint32_t));
    self->zeros = NO_SLOT;
    self->are_told = tl_fmu_written_serves();
    self->count = count;
    for (size_t i = 0; i < count; i++) {
        self->range[i] = ranges[i];
        self->before[i] = i == 0 ? 0 : self->before[i - 1] + pages_of(ranges[i - 1].size);
        self->are_told = self->are_told && tl_fmu_written_watch(ranges[i].begin, ranges[i].size);
    }
    return self;
}
