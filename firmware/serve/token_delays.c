/* Delays after wrong tokens: see token_delays.h. */
#include "firmware/serve/token_delays.h"

#include <stddef.h>

enum { FREE_OF_CHARGE = 3, MOST_COUNTED = 10 };

static const tl_time RESET_AFTER = 600 * TL_SECOND;

tl_time tl_token_delays_left(const tl_token_delays *delays, const tl_address *address, tl_time now) {
    for (size_t i = 0; i < TL_TOKEN_DELAYS; i++) {
        const tl_token_delay *row = &delays->rows[i];
        if (row->wrong > FREE_OF_CHARGE && tl_address_is(&row->address, address)) {
            tl_time left = row->last + (TL_SECOND << (row->wrong - FREE_OF_CHARGE - 1)) - now;
            return left > 0 ? left : 0;
        }
    }
    return 0;
}

void tl_token_delays_add(tl_token_delays *delays, const tl_address *address, tl_time now) {
    tl_token_delay *row = &delays->rows[0]; /* the address's own, else a free one, else the oldest */
    for (size_t i = 0; i < TL_TOKEN_DELAYS; i++) {
        tl_token_delay *one = &delays->rows[i];
        if (one->wrong > 0 && tl_address_is(&one->address, address)) {
            row = one;
            break;
        }
        row = row->wrong > 0 && (one->wrong == 0 || one->last < row->last) ? one : row;
    }
    if (row->wrong == 0 || !tl_address_is(&row->address, address) || now - row->last > RESET_AFTER) {
        *row = (tl_token_delay){.address = *address};
    }
    row->wrong += row->wrong < MOST_COUNTED ? 1 : 0;
    row->last = now;
}
