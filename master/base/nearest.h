/* The name that was probably meant.
 *
 * Purpose: of the names there are, the nearest to one that is not there: at most 2 edits away, fewer than half of its
 *          characters. An edit inserts, deletes or replaces a character or swaps two neighbours; case does not count.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_BASE_NEAREST_H
#define TL_MASTER_BASE_NEAREST_H

#include <stddef.h>

typedef struct tl_nearest {
    const char *text; /* what was found; the rest begins as zeros */
    const char *best; /* NULL: none is near; else one of those offered */
    size_t distance;
} tl_nearest;

void tl_nearest_offer(tl_nearest *nearest, const char *candidate);

#endif
