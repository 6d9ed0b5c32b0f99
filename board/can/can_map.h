/* Which CAN ids carry which channels. Private to the CAN driver.
 *
 * Purpose: from the id of a frame to the channels in it; the list of ids for the kernel's filters.
 * Bound:   make O(n log n), find O(log n); no allocation but in make. Never more ids than channels.
 */
#ifndef TL_BOARD_CAN_CAN_MAP_H
#define TL_BOARD_CAN_CAN_MAP_H

#include "board/can/can_codec.h"

/* One id, and its slots. */
typedef struct tl_can_id {
    uint32_t id;
    bool extended;
    size_t first; /* of its slots */
    size_t slots;
    bool too_short; /* the last frame had not all of its bytes; for the driver */
} tl_can_id;

typedef struct tl_can_slot {
    tl_can_channel channel;
    size_t index; /* of the channel in the list */
    size_t bytes; /* that a frame must have */
} tl_can_slot;

/* Placed by the owner. */
typedef struct tl_can_map {
    tl_can_slot *slots; /* sorted by id */
    size_t slot_count;
    tl_can_id *ids; /* in the same order */
    size_t id_count;
} tl_can_map;

/* Whatever was in it. The channels are copied; they must be valid. false if memory is out: then it is empty. */
bool tl_can_map_make(tl_can_map *map, const tl_can_channel *channels, size_t count);

/* NULL where no channel has that id. A standard and an extended id of the same number are two. */
tl_can_id *tl_can_map_find(const tl_can_map *map, uint32_t id, bool extended);

void tl_can_map_release(tl_can_map *map);

#endif
