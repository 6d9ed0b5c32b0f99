/* See json_walk.h. */
#include "firmware/config/json_walk.h"

cJSON *tl_json_walk_next(tl_json_walk *walk, cJSON *item) {
    if (item->child != NULL && walk->depth < TL_JSON_MAX_DEPTH) {
        walk->around[walk->depth++] = item;
        return item->child;
    }
    while (walk->depth > 0 && item->next == NULL) {
        item = walk->around[--walk->depth];
    }
    return walk->depth > 0 ? item->next : NULL;
}
