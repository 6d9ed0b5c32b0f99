/* Groups CAN channels by id: sorted, then one entry for each run of equal ids. */
#include "board/can/can_map.h"

#include <stdlib.h>
#include <string.h>

/* Standard ids before extended ones, each by number. */
static int compare_ids(uint32_t left, bool left_extended, uint32_t right, bool right_extended) {
    if (left_extended != right_extended) {
        return left_extended ? 1 : -1;
    }
    return left < right ? -1 : left > right;
}

static int compare_slots(const void *a, const void *b) {
    const tl_can_slot *left = a;
    const tl_can_slot *right = b;
    int order = compare_ids(left->channel.id, left->channel.extended, right->channel.id, right->channel.extended);
    if (order == 0) {
        order = left->index < right->index ? -1 : 1; /* qsort may not keep the order of equals */
    }
    return order;
}

static int compare_entries(const void *a, const void *b) {
    const tl_can_id *left = a;
    const tl_can_id *right = b;
    return compare_ids(left->id, left->extended, right->id, right->extended);
}

static void group(tl_can_map *map) {
    for (size_t i = 0; i < map->slot_count; i++) {
        const tl_can_channel *channel = &map->slots[i].channel;
        tl_can_id *last = map->id_count > 0 ? &map->ids[map->id_count - 1] : NULL;
        if (last == NULL || last->id != channel->id || last->extended != channel->extended) {
            last = &map->ids[map->id_count];
            *last = (tl_can_id){.id = channel->id, .extended = channel->extended, .first = i};
            map->id_count++;
        }
        last->slots++;
    }
}

bool tl_can_map_make(tl_can_map *map, const tl_can_channel *channels, size_t count) {
    size_t room = count > 0 ? count : 1;
    *map = (tl_can_map){.slots = calloc(room, sizeof *map->slots), .ids = calloc(room, sizeof *map->ids)};
    if (map->slots == NULL || map->ids == NULL) {
        tl_can_map_release(map);
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        map->slots[i].channel = channels[i];
        map->slots[i].index = i;
        map->slots[i].bytes = tl_can_channel_bytes(&channels[i]);
    }
    map->slot_count = count;
    qsort(map->slots, count, sizeof *map->slots, compare_slots);
    group(map);
    return true;
}

tl_can_id *tl_can_map_find(const tl_can_map *map, uint32_t id, bool extended) {
    const tl_can_id wanted = {.id = id, .extended = extended};
    return bsearch(&wanted, map->ids, map->id_count, sizeof *map->ids, compare_entries);
}

void tl_can_map_release(tl_can_map *map) {
    free(map->slots);
    free(map->ids);
    memset(map, 0, sizeof *map);
}
