/* Back-off: who has sent wrong tokens waits, the longer the more there were.
 *
 * Purpose: guessing is slow, from each address by itself, and remembering it takes no more memory than it always does.
 * Rule:    the first three wrong ones cost nothing. Then an address waits 1 s, 2 s, 4 s … at most a minute after each, in which no token of it is
 *          looked at. A right one, or ten minutes of peace, forgets all.
 * Bound:   of more addresses than there is room for, the one that was wrong the longest time ago is forgotten.
 * Thread:  one; times are monotonic.
 */
#ifndef TL_FIRMWARE_DOOR_PENALTIES_H
#define TL_FIRMWARE_DOOR_PENALTIES_H

#include <stdint.h>

#include "firmware/door/address.h"
#include "master/base/simtime.h"

enum { TL_PENALTIES = 256 };

typedef struct tl_penalty {
    tl_address address;
    uint32_t wrong; /* tokens; 0: the row is free */
    tl_time last;   /* when that was */
} tl_penalty;

/* Begins as zeros. */
typedef struct tl_penalties {
    tl_penalty rows[TL_PENALTIES];
} tl_penalties;

/* How long this address still waits; 0: not. */
tl_time tl_penalties_left(const tl_penalties *penalties, const tl_address *address, tl_time now);

void tl_penalties_add(tl_penalties *penalties, const tl_address *address, tl_time now);
void tl_penalties_forget(tl_penalties *penalties, const tl_address *address);

#endif
