/* Versions of much memory: see fmu_pages.h. */
#include "firmware/rollback/fmu_pages.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/rollback/fmu_written.h"
#include "firmware/rollback/page_groups.h"

/* ---- pages ---- */

/* Pages that are supposed to be written between two versions, the most that was seen of large FMUs: until some were put back, which is what several steps
 * have written, and until so many versions differed from the one before. */
enum { SUPPOSED = 64, KNOWN = 4 };

struct tl_fmu_pages {
    size_t count;
    tl_fmu_place range[TL_FMU_PLACES + 1];
    size_t before[TL_FMU_PLACES + 1]; /* pages in the ranges before this one */
    bool are_told;
    tl_page_groups groups;
    tl_fmu_version now; /* what memory was when it was last saved or restored; but for what was written since */
    uint32_t versions;  /* that there are */
    size_t most;        /* pages that differed in a version from what was before, */
    unsigned times;     /* that any did */
    size_t most_put;    /* pages that were put back in one go */
    bool passes;        /* none of that is seen */
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

/* As many as so many pages need; new ones are empty. */
static bool grow(tl_fmu_pages *self, size_t pages) {
    if (!make_room(&self->now, tl_page_groups_of(pages))) {
        return false;
    }
    while (self->now.leaves < tl_page_groups_of(pages)) {
        uint32_t leaf = tl_page_groups_make(&self->groups);
        if (leaf == TL_NO_SLOT) {
            return false;
        }
        self->now.leaf[self->now.leaves++] = leaf;
    }
    return true;
}

static void shrink(tl_fmu_pages *self, size_t leaves) {
    while (self->now.leaves > leaves) {
        tl_page_groups_drop(&self->groups, self->now.leaf[--self->now.leaves]);
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

static bool keep_page(tl_fmu_pages *self, size_t number, const unsigned char *page) {
    uint32_t *group = &self->now.leaf[number / TL_PAGE_GROUP];
    const unsigned char *before = tl_page_groups_look(&self->groups, *group, number % TL_PAGE_GROUP);
    if (before != NULL && memcmp(before, page, TL_FMU_PAGE) == 0) {
        return true;
    }
    self->differing++;
    return tl_page_groups_put(&self->groups, group, number % TL_PAGE_GROUP, page);
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
    if (!is_first && self->differing > 0 && !self->passes) {
        self->most = self->differing > self->most ? self->differing : self->most;
        self->times++;
    }
    (void)tl_page_groups_stock(&self->groups, self->now.pages, self->most * self->versions);
}

static void share_leaves(tl_fmu_pages *self, tl_fmu_version *version) {
    for (size_t i = 0; i < self->now.leaves; i++) {
        tl_page_groups_share(&self->groups, self->now.leaf[i]);
    }
    for (size_t i = 0; i < version->leaves; i++) {
        tl_page_groups_drop(&self->groups, version->leaf[i]);
    }
    memcpy(version->leaf, self->now.leaf, self->now.leaves * sizeof *version->leaf);
    version->leaves = self->now.leaves;
    version->pages = self->now.pages;
}

tl_status tl_fmu_pages_save(tl_fmu_pages *self, size_t used, tl_fmu_version *version, tl_error *error) {
    size_t pages = self->before[self->count - 1] + pages_of(used);
    bool is_first = self->now.pages == 0;
    bool is_new = version->leaves == 0;
    self->differing = 0;
    self->is_full = !grow(self, pages) || !make_room(version, tl_page_groups_of(pages));
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
    shrink(self, tl_page_groups_of(pages));
    share_leaves(self, version);
    self->versions += is_new ? 1 : 0;
    stock(self, is_first);
    return TL_OK;
}

/* ---- to restore ---- */

static void put_page(tl_fmu_pages *self, size_t number, unsigned char *page, const tl_fmu_version *version) {
    const unsigned char *kept =
        tl_page_groups_look(&self->groups, version->leaf[number / TL_PAGE_GROUP], number % TL_PAGE_GROUP);
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
    for (size_t i = 0; i < TL_PAGE_GROUP && which * TL_PAGE_GROUP + i < pages; i++) {
        if (tl_page_groups_look(&self->groups, self->now.leaf[which], i) !=
            tl_page_groups_look(&self->groups, version->leaf[which], i)) {
            put_page(self, which * TL_PAGE_GROUP + i, address_of(self, which * TL_PAGE_GROUP + i), version);
        }
    }
}

static void put_what_differs(tl_fmu_pages *self, const tl_fmu_version *version) {
    size_t common = version->pages < self->now.pages ? version->pages : self->now.pages;
    for (size_t i = 0; i < tl_page_groups_of(common); i++) {
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
        tl_page_groups_share(&self->groups, version->leaf[i]);
        if (i < self->now.leaves) {
            tl_page_groups_drop(&self->groups, self->now.leaf[i]);
        }
        self->now.leaf[i] = version->leaf[i];
    }
    self->now.leaves = version->leaves;
    self->now.pages = version->pages;
}

void tl_fmu_pages_restore(tl_fmu_pages *self, const tl_fmu_version *version) {
    self->differing = 0;
    find(self, version->pages, version, put_pages);
    self->most_put = self->differing > self->most_put && !self->passes ? self->differing : self->most_put;
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
    tl_page_groups_close(&self->groups);
    self->now.leaves = 0;
    self->now.pages = 0;
}

void tl_fmu_pages_forget(tl_fmu_pages *self, tl_fmu_version *version) {
    for (size_t i = 0; i < version->leaves; i++) {
        tl_page_groups_drop(&self->groups, version->leaf[i]);
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

/* In one version more. */
static size_t pages_that_differ(const tl_fmu_pages *self) {
    size_t put = self->most_put > self->most ? self->most_put : self->most;
    return self->times >= KNOWN ? self->most : put > 0 ? put : SUPPOSED;
}

size_t tl_fmu_pages_size(const tl_fmu_pages *self) {
    return self->now.leaves * sizeof(uint32_t) +
           pages_that_differ(self) * (TL_FMU_PAGE + TL_PAGE_GROUP * sizeof(uint32_t));
}

void tl_fmu_pages_measure_anew(tl_fmu_pages *self) {
    self->most = 0;
    self->times = 0;
    self->most_put = 0;
}

void tl_fmu_pages_pass(tl_fmu_pages *self, bool passes) {
    self->passes = passes;
}

bool tl_fmu_pages_reserve(tl_fmu_pages *self, size_t versions) {
    return tl_page_groups_stock(&self->groups, self->now.pages, pages_that_differ(self) * (self->versions + versions));
}

bool tl_fmu_pages_reserve_version(const tl_fmu_pages *self, tl_fmu_version *version) {
    return make_room(version, self->now.leaves);
}

tl_fmu_pages *tl_fmu_pages_open(const tl_fmu_place *ranges, size_t count, tl_error *error) {
    tl_fmu_pages *self = calloc(1, sizeof *self);
    if (self == NULL) {
        (void)tl_fail(error, TL_TRY_AGAIN, "not enough memory for states of an FMU");
        return NULL;
    }
    tl_page_groups_open(&self->groups);
    self->are_told = tl_fmu_written_serves();
    self->count = count;
    for (size_t i = 0; i < count; i++) {
        self->range[i] = ranges[i];
        self->before[i] = i == 0 ? 0 : self->before[i - 1] + pages_of(ranges[i - 1].size);
        self->are_told = self->are_told && tl_fmu_written_watch(ranges[i].begin, ranges[i].size);
    }
    return self;
}
