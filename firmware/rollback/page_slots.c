/* Pieces of memory of one size: see page_slots.h. */
#include "firmware/rollback/page_slots.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* Slots of a piece, bytes in front of them, and pieces that the table grows by. */
enum { PIECE = 256, HEAD = 4096, MORE = 64 };

typedef char owners_fit_into_the_head[PIECE * sizeof(uint32_t) <= HEAD ? 1 : -1];

static uint32_t *owners_of(const tl_page_slots *self, uint32_t slot) {
    return (uint32_t *)(void *)self->pieces[slot / PIECE] + slot % PIECE;
}

unsigned char *tl_page_slots_at(const tl_page_slots *self, uint32_t slot) {
    return self->pieces[slot / PIECE] + HEAD + slot % PIECE * self->size;
}

void tl_page_slots_open(tl_page_slots *self, size_t size) {
    *self = (tl_page_slots){.size = size, .first_unused = TL_NO_SLOT};
}

void tl_page_slots_close(tl_page_slots *self) {
    for (size_t i = 0; i < self->made / PIECE; i++) {
        (void)munmap(self->pieces[i], HEAD + PIECE * self->size);
    }
    free(self->pieces);
    tl_page_slots_open(self, self->size);
}

static void put_unused(tl_page_slots *self, uint32_t slot) {
    memcpy(tl_page_slots_at(self, slot), &self->first_unused, sizeof self->first_unused);
    self->first_unused = slot;
    self->unused++;
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
                       /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
                       MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (piece == MAP_FAILED) {
        return false;
    }
    self->pieces[count] = piece;
    self->made += PIECE;
    return true;
}

bool tl_page_slots_stock(tl_page_slots *self, uint32_t count) {
    bool is_there = true;
    while (is_there && self->unused + (self->made - self->taken) < count) {
        is_there = make_piece(self);
    }
    return is_there;
}

uint32_t tl_page_slots_take(tl_page_slots *self) {
    if (!tl_page_slots_stock(self, 1)) {
        return TL_NO_SLOT;
    }
    uint32_t slot = self->first_unused;
    if (slot != TL_NO_SLOT) {
        memcpy(&self->first_unused, tl_page_slots_at(self, slot), sizeof self->first_unused);
        self->unused--;
    } else {
        slot = self->taken++;
    }
    *owners_of(self, slot) = 1;
    return slot;
}

void tl_page_slots_share(tl_page_slots *self, uint32_t slot) {
    (*owners_of(self, slot))++;
}

bool tl_page_slots_drop(tl_page_slots *self, uint32_t slot) {
    if (--*owners_of(self, slot) > 0) {
        return false;
    }
    put_unused(self, slot);
    return true;
}

bool tl_page_slots_has_one_owner(const tl_page_slots *self, uint32_t slot) {
    return *owners_of(self, slot) == 1;
}
