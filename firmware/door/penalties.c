/* Back-off: see penalties.h. */
#include "firmware/door/penalties.h"

#include <stddef.h>

enum { FREE_OF_CHARGE = 3, MOST_DOUBLINGS = 6 };

static const tl_time LONGEST = 60 * TL_SECOND;
static const tl_time PEACE = 600 * TL_SECOND;

static tl_time wait_of(uint32_t wrong) {
    if (wrong <= FREE_OF_CHARGE) {
        return 0;
    }
    uint32_t doublings = wrong - FREE_OF_CHARGE - 1;
    tl_time wait = TL_SECOND << (doublings < MOST_DOUBLINGS ? doublings : MOST_DOUBLINGS);
    return wait < LONGEST ? wait : LONGEST;
}

/* NULL: nothing is known of it. */
static const tl_penalty *find_row(const tl_penalties *penalties, const tl_address *address) {
    for (size_t i = 0; i < TL_PENALTIES; i++) {
        if (penalties->rows[i].wrong > 0 && tl_address_is(&penalties->rows[i].address, address)) {
            return &penalties->rows[i];
        }
    }
    return NULL;
}

tl_time tl_penalties_left(const tl_penalties *penalties, const tl_address *address, tl_time now) {
    const tl_penalty *row = find_row(penalties, address);
    tl_time left = row == NULL ? 0 : row->last + wait_of(row->wrong) - now;
    return left > 0 ? left : 0;
}

/* A free one, else that of the longest time ago. */
static tl_penalty *oldest_row(tl_penalties *penalties) {
    tl_penalty *oldest = &penalties->rows[0];
    for (size_t i = 0; i < TL_PENALTIES && oldest->wrong > 0; i++) {
        tl_penalty *row = &penalties->rows[i];
        oldest = row->wrong == 0 || row->last < oldest->last ? row : oldest;
    }
    return oldest;
}

void tl_penalties_add(tl_penalties *penalties, const tl_address *address, tl_time now) {
    const tl_penalty *known = find_row(penalties, address);
    tl_penalty *row = known == NULL ? oldest_row(penalties) : &penalties->rows[known - penalties->rows];
    if (known == NULL || now - known->last > PEACE) {
        *row = (tl_penalty){.address = *address};
    }
    row->wrong += row->wrong < UINT32_MAX ? 1 : 0;
    row->last = now;
}

void tl_penalties_forget(tl_penalties *penalties, const tl_address *address) {
    const tl_penalty *row = find_row(penalties, address);
    if (row != NULL) {
        penalties->rows[row - penalties->rows].wrong = 0;
    }
}
