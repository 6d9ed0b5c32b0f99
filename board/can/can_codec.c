/* Signals in CAN frames: see can_codec.h. */
#include "board/can/can_codec.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "board/io/bits.h"

/* ---- CAN signals to values and back.
 *
 * A field is processed in pieces, one per byte: at most nine.
 */

/* One piece of a field: `count` bits of a byte from bit `low` on. */
typedef struct piece {
    size_t byte;
    unsigned low;
    unsigned count;
} piece;

bool tl_can_is_length(unsigned bytes) {
    static const uint8_t longer[] = {12, 16, 20, 24, 32, 48, 64};
    bool found = bytes <= 8;
    for (size_t i = 0; i < sizeof longer; i++) {
        found = found || bytes == longer[i];
    }
    return found;
}

bool tl_can_pgn_is_addressed(uint32_t pgn) {
    return (pgn & 0xFF00) < 0xF000;
}

uint32_t tl_can_pgn_id(uint32_t pgn, uint8_t source) {
    const uint32_t to_all = tl_can_pgn_is_addressed(pgn) ? 0xFF : 0;
    return UINT32_C(6) << 26 | (pgn | to_all) << 8 | source;
}

/* The bits of an id that choose the channel. */
static uint32_t mask_of_channel(const tl_can_channel *channel) {
    if (channel->match == TL_CAN_BY_ID) {
        return UINT32_MAX;
    }
    const uint32_t pgn = tl_can_pgn_is_addressed(channel->id >> 8) ? 0x3FF0000 : 0x3FFFF00;
    return pgn | (channel->match == TL_CAN_BY_PGN_AND_SOURCE ? 0xFF : 0);
}

/* Number of bits before the most significant one of a Motorola field, in the order of transmission.
 */
static unsigned sent_before(const tl_can_field *field) {
    return (unsigned)field->start / 8 * 8 + (7 - (unsigned)field->start % 8);
}

size_t tl_can_field_bytes(const tl_can_field *field) {
    unsigned first = field->order == TL_CAN_INTEL ? field->start : sent_before(field);
    return (first + field->length + 7U) / 8;
}

size_t tl_can_channel_bytes(const tl_can_channel *channel) {
    size_t bytes = tl_can_field_bytes(&channel->field);
    for (size_t i = 0; i < channel->condition_count; i++) {
        size_t needed = tl_can_field_bytes(&channel->conditions[i].field);
        bytes = needed > bytes ? needed : bytes;
    }
    return bytes;
}

/* The piece that starts `done` bits after the field's start, in the order of its bits. */
static piece piece_at(const tl_can_field *field, unsigned done) {
    unsigned left = field->length - done;
    unsigned at = (field->order == TL_CAN_INTEL ? field->start : sent_before(field)) + done;
    unsigned room = 8 - at % 8;
    piece found = {.byte = at / 8, .count = left < room ? left : room};
    found.low = field->order == TL_CAN_INTEL ? at % 8 : room - found.count;
    return found;
}

static uint64_t mask_of(unsigned count) {
    return count < 64 ? ((uint64_t)1 << count) - 1 : UINT64_MAX;
}

/* Distance of a piece from the least significant end of the value. */
static unsigned shift_of(const tl_can_field *field, unsigned done, const piece *one) {
    return field->order == TL_CAN_INTEL ? done : field->length - done - one->count;
}

uint64_t tl_can_read_bits(const tl_can_field *field, const uint8_t *data) {
    uint64_t bits = 0;
    for (unsigned done = 0; done < field->length;) {
        piece one = piece_at(field, done);
        uint64_t part = (uint64_t)data[one.byte] >> one.low & mask_of(one.count);
        bits |= part << shift_of(field, done, &one);
        done += one.count;
    }
    return bits;
}

void tl_can_write_bits(const tl_can_field *field, uint64_t bits, uint8_t *data) {
    for (unsigned done = 0; done < field->length;) {
        piece one = piece_at(field, done);
        uint64_t mask = mask_of(one.count);
        uint64_t part = bits >> shift_of(field, done, &one) & mask;
        data[one.byte] = (uint8_t)((data[one.byte] & ~(mask << one.low)) | part << one.low);
        done += one.count;
    }
}

static bool holds(const tl_can_condition *condition, const uint8_t *data) {
    uint64_t found = tl_can_read_bits(&condition->field, data);
    for (size_t i = 0; i < condition->value_count; i++) {
        if (found >= condition->values[i] && found - condition->values[i] <= condition->further[i]) {
            return true;
        }
    }
    return false;
}

bool tl_can_is_present(const tl_can_channel *channel, const uint8_t *data) {
    for (size_t i = 0; i < channel->condition_count; i++) {
        if (!holds(&channel->conditions[i], data)) {
            return false;
        }
    }
    return true;
}

/* "Error" is 0xFE, "not available" 0xFF in the most significant byte; of a field below 8 bits, the
 * last two values. */
static bool is_not_available(const tl_can_channel *channel, uint64_t bits) {
    const unsigned length = channel->field.length;
    return channel->not_available && (length < 8 ? bits >= mask_of(length) - 1 : bits >> (length - 8) >= 0xFE);
}

bool tl_can_decode(const tl_can_channel *channel, const uint8_t *data, double *value) {
    uint64_t bits = tl_can_read_bits(&channel->field, data);
    double raw = 0;
    switch (channel->type) {
    case TL_CAN_UNSIGNED:
        raw = (double)bits;
        break;
    case TL_CAN_SIGNED:
        raw = tl_bits_to_signed(bits, channel->field.length);
        break;
    case TL_CAN_FLOAT32:
        raw = tl_bits_to_float32(bits);
        break;
    case TL_CAN_FLOAT64:
        raw = tl_bits_to_float64(bits);
        break;
    }
    *value = raw * channel->scale + channel->offset;
    if (!isfinite(*value) || is_not_available(channel, bits)) {
        *value = 0;
        return false;
    }
    return true;
}

/* Nearest integer of so many bits. The limits of 64 bits are no doubles: values that reach them
 * saturate. */
static uint64_t unsigned_bits(double raw, unsigned length) {
    double nearest = round(raw);
    if (!(nearest > 0)) {
        return 0;
    }
    return nearest < ldexp(1, (int)length) ? (uint64_t)nearest : mask_of(length);
}

static uint64_t signed_bits(double raw, unsigned length) {
    double limit = ldexp(1, (int)length - 1);
    double nearest = round(raw);
    if (isnan(nearest)) {
        return 0;
    }
    if (nearest >= limit) {
        return mask_of(length - 1);
    }
    return (uint64_t)(int64_t)fmax(nearest, -limit) & mask_of(length);
}

void tl_can_encode(const tl_can_channel *channel, double value, uint8_t *data) {
    double raw = (value - channel->offset) / channel->scale;
    uint64_t bits = 0;
    switch (channel->type) {
    case TL_CAN_UNSIGNED:
        bits = unsigned_bits(raw, channel->field.length);
        break;
    case TL_CAN_SIGNED:
        bits = signed_bits(raw, channel->field.length);
        break;
    case TL_CAN_FLOAT32:
        bits = tl_bits_of_float32(raw);
        break;
    case TL_CAN_FLOAT64:
        bits = tl_bits_of_float64(raw);
        break;
    }
    tl_can_write_bits(&channel->field, bits, data);
    for (size_t i = 0; i < channel->condition_count; i++) {
        tl_can_write_bits(&channel->conditions[i].field, channel->conditions[i].values[0], data);
    }
}

/* ---- Groups CAN channels by id and mask: sorted, then one entry per run of equal ones. */

/* Standard ids before extended ones, each by mask and number. */
static int compare_entries(const void *a, const void *b) {
    const tl_can_entry *left = a;
    const tl_can_entry *right = b;
    if (left->channel.extended != right->channel.extended) {
        return left->channel.extended ? 1 : -1;
    }
    if (left->mask != right->mask) {
        return left->mask < right->mask ? -1 : 1;
    }
    if (left->id != right->id) {
        return left->id < right->id ? -1 : 1;
    }
    return left->index < right->index ? -1 : 1; /* qsort may change the order of equal elements */
}

static void group(tl_can_map *map) {
    for (size_t i = 0; i < map->entry_count; i++) {
        const tl_can_entry *entry = &map->entries[i];
        const tl_can_channel *channel = &entry->channel;
        tl_can_id *last = map->id_count > 0 ? &map->ids[map->id_count - 1] : NULL;
        if (last == NULL || last->id != entry->id || last->mask != entry->mask || last->extended != channel->extended) {
            last = &map->ids[map->id_count];
            *last = (tl_can_id){.id = entry->id,
                                .mask = entry->mask,
                                .extended = channel->extended,
                                .is_pgn = channel->match != TL_CAN_BY_ID,
                                .first = i};
            map->id_count++;
        }
        last->entries++;
    }
}

bool tl_can_map_make(tl_can_map *map, const tl_can_channel *channels, size_t count) {
    size_t room = count > 0 ? count : 1;
    *map = (tl_can_map){.entries = calloc(room, sizeof *map->entries), .ids = calloc(room, sizeof *map->ids)};
    if (map->entries == NULL || map->ids == NULL) {
        tl_can_map_release(map);
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        map->entries[i].channel = channels[i];
        map->entries[i].mask = mask_of_channel(&channels[i]);
        map->entries[i].id = channels[i].id & map->entries[i].mask;
        map->entries[i].index = i;
        map->entries[i].bytes = tl_can_channel_bytes(&channels[i]);
    }
    map->entry_count = count;
    qsort(map->entries, count, sizeof *map->entries, compare_entries);
    group(map);
    return true;
}

tl_can_id *tl_can_map_find(const tl_can_map *map, const tl_can_id *previous, uint32_t id, bool extended) {
    for (size_t i = previous != NULL ? (size_t)(previous - map->ids) + 1 : 0; i < map->id_count; i++) {
        tl_can_id *at = &map->ids[i];
        if (at->extended == extended && (id & at->mask) == at->id) {
            return at;
        }
    }
    return NULL;
}

void tl_can_map_release(tl_can_map *map) {
    free(map->entries);
    free(map->ids);
    memset(map, 0, sizeof *map);
}
