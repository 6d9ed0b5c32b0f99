/* Groups of pages: see page_groups.h. */
#include "firmware/rollback/page_groups.h"

#include <string.h>

static uint32_t *pages_in(const tl_page_groups *self, uint32_t group) {
    return (uint32_t *)(void *)tl_page_slots_at(&self->groups, group);
}

void tl_page_groups_open(tl_page_groups *self) {
    tl_page_slots_open(&self->contents, TL_FMU_PAGE);
    tl_page_slots_open(&self->groups, TL_PAGE_GROUP * sizeof(uint32_t));
    self->zeros = TL_NO_SLOT;
}

void tl_page_groups_close(tl_page_groups *self) {
    tl_page_slots_close(&self->contents);
    tl_page_slots_close(&self->groups);
    self->zeros = TL_NO_SLOT;
}

size_t tl_page_groups_of(size_t pages) {
    return (pages + TL_PAGE_GROUP - 1) / TL_PAGE_GROUP;
}

uint32_t tl_page_groups_make(tl_page_groups *self) {
    uint32_t group = tl_page_slots_take(&self->groups);
    if (group != TL_NO_SLOT) {
        memset(pages_in(self, group), 0xff, TL_PAGE_GROUP * sizeof(uint32_t)); /* TL_NO_SLOT */
    }
    return group;
}

void tl_page_groups_share(tl_page_groups *self, uint32_t group) {
    tl_page_slots_share(&self->groups, group);
}

static void drop_page(tl_page_groups *self, uint32_t slot) {
    if (slot != TL_NO_SLOT) {
        (void)tl_page_slots_drop(&self->contents, slot);
    }
}

void tl_page_groups_drop(tl_page_groups *self, uint32_t group) {
    if (tl_page_slots_has_one_owner(&self->groups, group)) {
        for (size_t i = 0; i < TL_PAGE_GROUP; i++) {
            drop_page(self, pages_in(self, group)[i]);
        }
    }
    (void)tl_page_slots_drop(&self->groups, group);
}

const unsigned char *tl_page_groups_look(const tl_page_groups *self, uint32_t group, size_t page) {
    uint32_t slot = pages_in(self, group)[page];
    return slot != TL_NO_SLOT ? tl_page_slots_at(&self->contents, slot) : NULL;
}

/* ---- to put a page ---- */

/* One for its caller alone. False: no memory. */
static bool own(tl_page_groups *self, uint32_t *group) {
    if (tl_page_slots_has_one_owner(&self->groups, *group)) {
        return true;
    }
    uint32_t made = tl_page_slots_take(&self->groups);
    if (made == TL_NO_SLOT) {
        return false;
    }
    memcpy(pages_in(self, made), pages_in(self, *group), TL_PAGE_GROUP * sizeof(uint32_t));
    for (size_t i = 0; i < TL_PAGE_GROUP; i++) {
        if (pages_in(self, made)[i] != TL_NO_SLOT) {
            tl_page_slots_share(&self->contents, pages_in(self, made)[i]);
        }
    }
    (void)tl_page_slots_drop(&self->groups, *group);
    *group = made;
    return true;
}

static bool is_zero(const unsigned char *page) {
    return page[0] == 0 && memcmp(page, page + 1, TL_FMU_PAGE - 1) == 0;
}

static bool has_zeros(tl_page_groups *self) {
    if (self->zeros == TL_NO_SLOT) {
        self->zeros = tl_page_slots_take(&self->contents);
        if (self->zeros != TL_NO_SLOT) {
            memset(tl_page_slots_at(&self->contents, self->zeros), 0, TL_FMU_PAGE);
        }
    }
    return self->zeros != TL_NO_SLOT;
}

/* For contents that nobody has. TL_NO_SLOT: no memory. */
static uint32_t slot_for(tl_page_groups *self, uint32_t before, const unsigned char *page) {
    if (before == TL_NO_SLOT && is_zero(page) && has_zeros(self)) {
        tl_page_slots_share(&self->contents, self->zeros);
        return self->zeros;
    }
    bool is_own = before != TL_NO_SLOT && tl_page_slots_has_one_owner(&self->contents, before);
    uint32_t slot = is_own ? before : tl_page_slots_take(&self->contents);
    if (slot == TL_NO_SLOT) {
        return slot;
    }
    memcpy(tl_page_slots_at(&self->contents, slot), page, TL_FMU_PAGE);
    if (!is_own) {
        drop_page(self, before);
    }
    return slot;
}

bool tl_page_groups_put(tl_page_groups *self, uint32_t *group, size_t page, const unsigned char *bytes) {
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

/* ---- room ---- */

static bool stock(tl_page_slots *slots, size_t wanted) {
    if (wanted >= UINT32_MAX) {
        return false;
    }
    return wanted <= slots->made ||
           tl_page_slots_stock(slots, slots->unused + (slots->made - slots->taken) + (uint32_t)(wanted - slots->made));
}

bool tl_page_groups_stock(tl_page_groups *self, size_t first, size_t differing) {
    return stock(&self->contents, first + differing) && stock(&self->groups, tl_page_groups_of(first) + differing);
}
