/* How long an adjusted variable has been at a bound: whether that was most of the last minute.
 *
 * Purpose: a correction at its bound is as good as none, and may stay there for hours while the twin is within tolerance, or lost for another reason. So it is told
 *          by itself, beside the state of the lock.
 * Minute:  of plant time, in ten blocks; it is judged at the end of each, once ten have passed. Told when it is more than half of the steps, over at less than a quarter.
 * Thread:  plain data; one thread at a time.
 */
#ifndef TL_FIRMWARE_MONITOR_BOUND_STAY_H
#define TL_FIRMWARE_MONITOR_BOUND_STAY_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/simtime.h"

enum { TL_BOUND_BLOCKS = 10 };

#define TL_BOUND_BLOCK (6 * TL_SECOND)

typedef enum tl_bound_turn { TL_BOUND_AS_BEFORE, TL_BOUND_REACHED, TL_BOUND_LEFT } tl_bound_turn;

/* Zeroed at first. */
typedef struct tl_bound_stay {
    int64_t block;   /* that of the last step, */
    uint32_t passed; /* and how many are over, TL_BOUND_BLOCKS at most */
    uint32_t steps[TL_BOUND_BLOCKS];
    uint32_t there[TL_BOUND_BLOCKS]; /* of them, at a bound */
    bool has_begun;
    bool is_told;
    tl_bound_turn turn; /* of the last step */
    double share;       /* as judged last */
} tl_bound_stay;

/* A step at this time, ns; times do not go back. */
void tl_bound_stay_step(tl_bound_stay *stay, tl_time time, bool is_there);

#endif
