/* How many states of each FMU may be kept: see state_room.h. */
#include "master/graph/state_room.h"

static uint64_t need_of(const tl_state_room *room) {
    return (uint64_t)room->size * room->most;
}

/* Of those that need more than `share`, how many there are, and what the others leave of the bound. */
static uint64_t left_by_others(const tl_state_room *rooms, size_t count, uint64_t share, uint64_t bytes,
                               size_t *larger) {
    *larger = 0;
    for (size_t k = 0; k < count; k++) {
        uint64_t need = need_of(&rooms[k]);
        if (need > share) {
            (*larger)++;
        } else {
            bytes -= need;
        }
    }
    return bytes;
}

/* The share of each that needs more: it grows with what the others leave, until nobody else does with less. */
static uint64_t find_share(const tl_state_room *rooms, size_t count, uint64_t bytes) {
    uint64_t share = count != 0 ? bytes / count : 0;
    size_t larger = count;
    size_t before = count + 1;
    while (larger != 0 && larger < before) {
        before = larger;
        uint64_t left = left_by_others(rooms, count, share, bytes, &larger);
        share = larger != 0 ? left / larger : share;
    }
    return share;
}

void tl_state_room_share(tl_state_room *rooms, size_t count, uint64_t bytes) {
    uint64_t share = find_share(rooms, count, bytes);
    for (size_t k = 0; k < count; k++) {
        tl_state_room *room = &rooms[k];
        room->kept = room->most;
        if (bytes != 0 && need_of(room) > share) {
            uint64_t fitting = share / room->size;
            room->kept = fitting > TL_STATES_LEAST ? (uint32_t)fitting : TL_STATES_LEAST;
        }
    }
}

uint64_t tl_state_room_bytes(const tl_state_room *rooms, size_t count) {
    uint64_t sum = 0;
    for (size_t k = 0; k < count; k++) {
        sum += (uint64_t)rooms[k].size * rooms[k].kept;
    }
    return sum;
}
