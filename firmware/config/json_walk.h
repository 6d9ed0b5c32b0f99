/* All items of a JSON document, one after the other, without recursion.
 *
 * Purpose: each value is met after those around it, in the order of the children.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_JSON_WALK_H
#define TL_FIRMWARE_CONFIG_JSON_WALK_H

#include <stddef.h>

#include <cjson/cJSON.h>

#include "firmware/base/json_text.h"

/* The items around the current one, outermost first; zeroed at the root. The depth was checked with the text. */
typedef struct tl_json_walk {
    cJSON *around[TL_JSON_MAX_DEPTH];
    size_t depth;
} tl_json_walk;

/* The item after this one, NULL after the last below where the walk began. */
cJSON *tl_json_walk_next(tl_json_walk *walk, cJSON *item);

#endif
