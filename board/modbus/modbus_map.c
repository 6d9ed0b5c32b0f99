/* Groups Modbus channels into requests: sorted by unit, table and address, then merged greedily. */
#include "board/modbus/modbus_map.h"

#include <stdlib.h>
#include <string.h>

static int compare(const void *a, const void *b) {
    const tl_modbus_slot *left = a;
    const tl_modbus_slot *right = b;
    int order = (int)left->channel.unit_id - (int)right->channel.unit_id;
    if (order == 0) {
        order = (int)left->channel.table - (int)right->channel.table;
    }
    if (order == 0) {
        order = (int)left->channel.address - (int)right->channel.address;
    }
    if (order == 0) {
        order = left->index < right->index ? -1 : 1; /* qsort may not keep the order of equals */
    }
    return order;
}

static size_t end_of(const tl_modbus_channel *channel) {
    return channel->address + tl_modbus_registers(channel->type);
}

static tl_modbus_read single(const tl_modbus_map *map, size_t slot, tl_modbus_grain grain) {
    const tl_modbus_channel *channel = &map->slots[slot].channel;
    tl_modbus_read read = {.unit_id = channel->unit_id,
                           .table = channel->table,
                           .address = channel->address,
                           .count = (uint16_t)tl_modbus_registers(channel->type),
                           .first = slot,
                           .slots = 1,
                           .grain = grain};
    return read;
}

/* Can this request take one more channel? Then it does. */
static bool extend(tl_modbus_read *read, const tl_modbus_channel *channel) {
    bool bits = tl_modbus_is_bit_table(read->table);
    size_t gap = bits ? TL_MODBUS_GAP_BITS : TL_MODBUS_GAP_REGISTERS;
    size_t most = bits ? TL_MODBUS_MAX_BITS : TL_MODBUS_MAX_REGISTERS;
    size_t end = (size_t)read->address + read->count;
    size_t new_end = end_of(channel) > end ? end_of(channel) : end;
    if (channel->unit_id != read->unit_id || channel->table != read->table || read->grain == TL_MODBUS_SINGLE) {
        return false;
    }
    if (channel->address > end + (read->grain == TL_MODBUS_GAPS ? gap : 0) || new_end - read->address > most) {
        return false;
    }
    read->count = (uint16_t)(new_end - read->address);
    read->slots++;
    return true;
}

/* Groups some slots; returns the number of requests written to `reads`. */
static size_t group(const tl_modbus_map *map, size_t first, size_t slots, tl_modbus_grain grain,
                    tl_modbus_read *reads) {
    size_t count = 0;
    for (size_t slot = first; slot < first + slots; slot++) {
        if (count == 0 || !extend(&reads[count - 1], &map->slots[slot].channel)) {
            reads[count] = single(map, slot, grain);
            count++;
        }
    }
    return count;
}

bool tl_modbus_map_make(tl_modbus_map *map, const tl_modbus_channel *channels, size_t count) {
    size_t room = count > 0 ? count : 1;
    *map = (tl_modbus_map){.slots = calloc(room, sizeof *map->slots), .reads = calloc(room, sizeof *map->reads)};
    if (map->slots == NULL || map->reads == NULL) {
        tl_modbus_map_release(map);
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        map->slots[i].channel = channels[i];
        map->slots[i].index = i;
    }
    map->slot_count = count;
    qsort(map->slots, count, sizeof *map->slots, compare);
    tl_modbus_map_reset(map);
    return true;
}

void tl_modbus_map_reset(tl_modbus_map *map) {
    map->read_count = group(map, 0, map->slot_count, TL_MODBUS_GAPS, map->reads);
}

size_t tl_modbus_map_split(tl_modbus_map *map, size_t read) {
    const tl_modbus_read old = map->reads[read];
    size_t tail = map->read_count - read - 1;
    if (old.slots == 1) {
        return 1;
    }
    for (int grain = (int)old.grain + 1; grain <= TL_MODBUS_SINGLE; grain++) {
        tl_modbus_read probe = single(map, old.first, (tl_modbus_grain)grain);
        size_t joined = 1;
        while (joined < old.slots && extend(&probe, &map->slots[old.first + joined].channel)) {
            joined++;
        }
        if (joined < old.slots) { /* this grain does make it smaller */
            /* The rest moves to the far end of the array, so that the new ones have room whatever their number. */
            tl_modbus_read *rest = &map->reads[map->slot_count - tail];
            memmove(rest, &map->reads[read + 1], tail * sizeof *rest);
            size_t count = group(map, old.first, old.slots, (tl_modbus_grain)grain, &map->reads[read]);
            memmove(&map->reads[read + count], rest, tail * sizeof *rest);
            map->read_count = read + count + tail;
            return count;
        }
    }
    return 1;
}

void tl_modbus_map_release(tl_modbus_map *map) {
    free(map->slots);
    free(map->reads);
    memset(map, 0, sizeof *map);
}
