/* Delays after wrong tokens, one for each address.
 *
 * Purpose: limits how fast an address can guess tokens.
 * Rule:    the first three wrong tokens cost nothing. After each further one the address must wait 1 s, 2 s, 4 s … 64 s, in which the server checks no
 *          token of it. Only time resets the count: ten minutes without a wrong token. A right token does not, because its owner could guess
 *          other tokens between two requests.
 * Bound:   TL_TOKEN_DELAYS addresses. If the table is full, a new address replaces the one whose last wrong token is the oldest.
 * Thread:  one; times are monotonic.
 */
#ifndef TL_FIRMWARE_SERVE_TOKEN_DELAYS_H
#define TL_FIRMWARE_SERVE_TOKEN_DELAYS_H

#include "firmware/serve/address.h"
#include "master/base/simtime.h"

enum { TL_TOKEN_DELAYS = 256 };

typedef struct tl_token_delay {
    tl_address address;
    unsigned wrong; /* tokens; 0: the row is free */
    tl_time last;   /* time of the last wrong token */
} tl_token_delay;

/* Begins as zeros. */
typedef struct tl_token_delays {
    tl_token_delay rows[TL_TOKEN_DELAYS];
} tl_token_delays;

/* Time that the address still has to wait; 0: none. */
tl_time tl_token_delays_left(const tl_token_delays *delays, const tl_address *address, tl_time now);

/* Counts a wrong token of the address. */
void tl_token_delays_add(tl_token_delays *delays, const tl_address *address, tl_time now);

#endif
