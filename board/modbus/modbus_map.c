/* Signals in Modbus registers: see modbus_map.h. */
#include "board/modbus/modbus_map.h"

#include <errno.h>
#include <math.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board/io/bits.h"

/* ---- Description of the outcome of a Modbus request. */

bool tl_modbus_outcome_is_same(const tl_modbus_outcome *a, const tl_modbus_outcome *b) {
    if (a->kind > TL_MODBUS_FAILED && b->kind > TL_MODBUS_FAILED) {
        return true;
    }
    return a->kind == b->kind && (a->kind != TL_MODBUS_FAILED || a->found == b->found);
}

/* libmodbus describes the codes that Modbus defines; others are numbers. */
static void exception_text(int code, char *text, size_t size) {
    static const char *const REMEDIES[] = {
        [1] = ": the device does not serve this table: check table (holding or input, coil or discrete)",
        [2] = ": the device has no such address. Addresses here count from 0: 40003 in a manual is holding, address 2",
        [3] = ": the device refuses this number of values: check type and address",
        [4] = ": look for the fault in the device",
        [6] = ": set pause_s, or raise period_s, so that it is polled less often",
        [10] = ": the gateway has no path to this unit: check unit_id and the gateway",
        [11] = ": no device answers as this unit behind the gateway: check unit_id",
    };
    if ((code >= 1 && code <= 8) || code == 10 || code == 11) {
        (void)snprintf(text, size, "%s%s", modbus_strerror(MODBUS_ENOBASE + code),
                       REMEDIES[code] != NULL ? REMEDIES[code] : "");
    } else {
        (void)snprintf(text, size, "exception %d, which Modbus does not define: see the manual of the device", code);
    }
}

static void failure_text(int failure, bool on_a_line, tl_time timeout, char *text, size_t size) {
    const char *reason = modbus_strerror(failure);
    if (failure == ETIMEDOUT) {
        (void)snprintf(text, size, "%sno answer within timeout_s = %g s: raise timeout_s, or check unit_id%s",
                       on_a_line ? "" : "connected, but ", tl_seconds(timeout),
                       on_a_line ? ", baud and parity" : " and framing");
    } else if (failure == EPROTO) {
        (void)snprintf(text, size, "the answer is incomplete: check the device and the %s",
                       on_a_line ? "wiring" : "network");
    } else if (failure == EBUSY) {
        (void)snprintf(text, size, "the line is never quiet: check baud and parity; only one master may use the line");
    } else if (failure == EBADMSG) {
        (void)snprintf(text, size, "the adapter does not receive what it sends: check the wiring, or remove echo");
    } else if (failure == ECONNRESET || failure == EPIPE) {
        (void)snprintf(text, size,
                       "the device closes the connection without an answer (%s): end other programs that use it",
                       reason);
    } else if (failure > MODBUS_ENOBASE) {
        (void)snprintf(text, size, "%s: check %s", reason,
                       on_a_line ? "baud, parity, stop_bits, echo and wiring"
                                 : "the line behind the gateway, and framing");
    } else {
        (void)snprintf(text, size, "%s: check the %s", reason, on_a_line ? "adapter" : "network");
    }
}

void tl_modbus_outcome_text(const tl_modbus_outcome *outcome, bool on_a_line, tl_time timeout, char *text,
                            size_t size) {
    const int found = outcome->found;
    const int wanted = outcome->wanted;
    switch (outcome->kind) {
    case TL_MODBUS_EXCEPTION:
        exception_text(found, text, size);
        break;
    case TL_MODBUS_WRONG_TRANSACTION:
        (void)snprintf(
            text, size,
            "answered transaction %d instead of %d: check host and port; a device may answer only once. If it "
            "always answers so, add \"any_transaction_id\": true to its source",
            found, wanted);
        break;
    case TL_MODBUS_WRONG_PROTOCOL:
        (void)snprintf(text, size, "answered with protocol %d instead of %d (Modbus): check host and port", found,
                       wanted);
        break;
    case TL_MODBUS_WRONG_LENGTH:
        (void)snprintf(text, size, "answered with a length of %d bytes instead of %d: check the device%s", found,
                       wanted, on_a_line ? "" : ", host and port");
        break;
    case TL_MODBUS_WRONG_UNIT:
        (void)snprintf(text, size, "answered as unit %d instead of %d: %s", found, wanted,
                       on_a_line ? "check that only one master uses the line"
                                 : "if it always answers so, add \"any_unit_id\": true to its source");
        break;
    case TL_MODBUS_WRONG_FUNCTION:
        (void)snprintf(text, size, "answered function %d instead of %d: check the device%s", found, wanted,
                       on_a_line ? "" : " and the gateway before it");
        break;
    case TL_MODBUS_WRONG_BYTES:
        (void)snprintf(text, size, "answered %d bytes of values instead of %d: check the device%s", found, wanted,
                       on_a_line ? "" : " and the gateway before it");
        break;
    case TL_MODBUS_FAILED:
    case TL_MODBUS_VALUES:
        failure_text(found, on_a_line, timeout, text, size);
        break;
    }
}

/* ---- Modbus registers to values and back: data types, word order, byte order, scale.
 *
 * A value is carried through 64 bits: registers are joined most significant first, whatever their
 * order.
 */

const char *tl_modbus_table_name(tl_modbus_table table) {
    static const char *const names[] = {"", "coil", "discrete input", "holding register", "input register"};
    return names[table];
}

bool tl_modbus_is_bit_table(tl_modbus_table table) {
    return table == TL_MODBUS_COIL || table == TL_MODBUS_DISCRETE;
}

size_t tl_modbus_registers(tl_modbus_type type) {
    switch (type) {
    case TL_MODBUS_INT32:
    case TL_MODBUS_UINT32:
    case TL_MODBUS_FLOAT32:
    case TL_MODBUS_BCD32:
        return 2;
    case TL_MODBUS_INT64:
    case TL_MODBUS_UINT64:
    case TL_MODBUS_FLOAT64:
        return 4;
    case TL_MODBUS_BIT:
    case TL_MODBUS_INT16:
    case TL_MODBUS_UINT16:
    case TL_MODBUS_BCD16:
    case TL_MODBUS_REGISTER_BIT:
    case TL_MODBUS_INT8:
    case TL_MODBUS_UINT8:
        break;
    }
    return 1;
}

unsigned tl_modbus_part_bits(tl_modbus_type type) {
    if (type == TL_MODBUS_REGISTER_BIT) {
        return 1;
    }
    return type == TL_MODBUS_INT8 || type == TL_MODBUS_UINT8 ? 8 : 0;
}

/* Swaps a register between wire order and most significant byte first. */
static uint16_t swap_bytes(const tl_modbus_channel *channel, uint16_t word) {
    if (channel->bytes_little) {
        return (uint16_t)((unsigned)word << 8 | (unsigned)word >> 8);
    }
    return word;
}

/* Index of the i-th most significant register of a value. */
static size_t word_index(const tl_modbus_channel *channel, size_t count, size_t i) {
    return channel->words_little ? count - 1 - i : i;
}

static uint64_t join_words(const tl_modbus_channel *channel, const uint16_t *registers) {
    size_t count = tl_modbus_registers(channel->type);
    uint64_t bits = 0;
    for (size_t i = 0; i < count; i++) {
        bits = bits << 16 | swap_bytes(channel, registers[word_index(channel, count, i)]);
    }
    return bits;
}

static void split_words(const tl_modbus_channel *channel, uint64_t bits, uint16_t *registers) {
    size_t count = tl_modbus_registers(channel->type);
    for (size_t i = count; i-- > 0; bits >>= 16) {
        registers[word_index(channel, count, i)] = swap_bytes(channel, (uint16_t)(bits & 0xFFFF));
    }
}

/* NaN if a digit is above 9. */
static double bcd_to_number(uint64_t bits) {
    double number = 0;
    for (int shift = 28; shift >= 0; shift -= 4) {
        const unsigned digit = bits >> shift & 0xF;
        number = digit <= 9 ? 10 * number + digit : (double)NAN;
    }
    return number;
}

static uint64_t bcd_of_number(uint64_t number) {
    uint64_t bits = 0;
    for (int shift = 0; number > 0; shift += 4, number /= 10) {
        bits |= number % 10 << shift;
    }
    return bits;
}

static double raw_of(tl_modbus_type type, uint64_t bits) {
    switch (type) {
    case TL_MODBUS_BIT:
        return bits != 0 ? 1 : 0;
    case TL_MODBUS_UINT16:
    case TL_MODBUS_UINT32:
    case TL_MODBUS_UINT64:
        break;
    case TL_MODBUS_INT16:
        return tl_bits_to_signed(bits, 16);
    case TL_MODBUS_INT32:
        return tl_bits_to_signed(bits, 32);
    case TL_MODBUS_INT64:
        return tl_bits_to_signed(bits, 64);
    case TL_MODBUS_FLOAT32:
        return tl_bits_to_float32(bits);
    case TL_MODBUS_FLOAT64:
        return tl_bits_to_float64(bits);
    case TL_MODBUS_BCD16:
    case TL_MODBUS_BCD32:
        return bcd_to_number(bits);
    case TL_MODBUS_REGISTER_BIT:
        return (double)(bits & 1);
    case TL_MODBUS_INT8:
        return tl_bits_to_signed(bits, 8);
    case TL_MODBUS_UINT8:
        return (double)(bits & 0xFF);
    }
    return (double)bits;
}

static bool is_available(const tl_modbus_channel *channel, double raw) {
    size_t i = 0;
    while (i < channel->code_count && raw != channel->codes[i]) {
        i++;
    }
    return i == channel->code_count;
}

bool tl_modbus_decode(const tl_modbus_channel *channel, const uint16_t *registers, double *value) {
    const double raw = raw_of(channel->type, join_words(channel, registers) >> channel->bit);
    *value = raw * channel->scale + channel->offset;
    if (!isfinite(*value) || !is_available(channel, raw)) {
        *value = 0;
        return false;
    }
    return true;
}

/* Nearest integer within the range, as the lower bits of 64. */
static uint64_t integer_bits(double raw, double minimum, double maximum) {
    if (isnan(raw)) {
        return 0;
    }
    return (uint64_t)(int64_t)fmin(fmax(round(raw), minimum), maximum);
}

/* The same for 64 bits, whose largest integers no double has. */
static uint64_t wide_bits(double raw, bool is_signed) {
    if (isnan(raw)) {
        return 0;
    }
    if (raw >= (is_signed ? 0x1p63 : 0x1p64)) {
        return is_signed ? INT64_MAX : UINT64_MAX;
    }
    return is_signed ? (uint64_t)(int64_t)fmax(round(raw), -0x1p63) : (uint64_t)fmax(round(raw), 0);
}

static void put_part(const tl_modbus_channel *channel, uint64_t bits, uint16_t *registers) {
    const uint64_t mask = ((1U << tl_modbus_part_bits(channel->type)) - 1U) << channel->bit;
    split_words(channel, (join_words(channel, registers) & ~mask) | (bits << channel->bit & mask), registers);
}

void tl_modbus_encode(const tl_modbus_channel *channel, double value, uint16_t *registers) {
    double raw = (value - channel->offset) / channel->scale;
    switch (channel->type) {
    case TL_MODBUS_BIT:
        registers[0] = (uint16_t)integer_bits(raw, 0, 1);
        break;
    case TL_MODBUS_INT16:
        split_words(channel, integer_bits(raw, INT16_MIN, INT16_MAX), registers);
        break;
    case TL_MODBUS_UINT16:
        split_words(channel, integer_bits(raw, 0, UINT16_MAX), registers);
        break;
    case TL_MODBUS_INT32:
        split_words(channel, integer_bits(raw, INT32_MIN, INT32_MAX), registers);
        break;
    case TL_MODBUS_UINT32:
        split_words(channel, integer_bits(raw, 0, UINT32_MAX), registers);
        break;
    case TL_MODBUS_FLOAT32:
        split_words(channel, tl_bits_of_float32(raw), registers);
        break;
    case TL_MODBUS_FLOAT64:
        split_words(channel, tl_bits_of_float64(raw), registers);
        break;
    case TL_MODBUS_INT64:
    case TL_MODBUS_UINT64:
        split_words(channel, wide_bits(raw, channel->type == TL_MODBUS_INT64), registers);
        break;
    case TL_MODBUS_BCD16:
        split_words(channel, bcd_of_number(integer_bits(raw, 0, 9999)), registers);
        break;
    case TL_MODBUS_BCD32:
        split_words(channel, bcd_of_number(integer_bits(raw, 0, 99999999)), registers);
        break;
    case TL_MODBUS_REGISTER_BIT:
        put_part(channel, integer_bits(raw, 0, 1), registers);
        break;
    case TL_MODBUS_INT8:
        put_part(channel, integer_bits(raw, INT8_MIN, INT8_MAX), registers);
        break;
    case TL_MODBUS_UINT8:
        put_part(channel, integer_bits(raw, 0, UINT8_MAX), registers);
        break;
    }
}

/* ---- Groups Modbus channels into requests: sorted by unit, table and address, then merged
 * greedily. */

static int compare(const void *a, const void *b) {
    const tl_modbus_entry *left = a;
    const tl_modbus_entry *right = b;
    int order = (int)left->channel.unit_id - (int)right->channel.unit_id;
    if (order == 0) {
        order = (int)left->channel.table - (int)right->channel.table;
    }
    if (order == 0) {
        order = (int)left->channel.address - (int)right->channel.address;
    }
    if (order == 0) {
        order = left->index < right->index ? -1 : 1; /* qsort may change the order of equal elements */
    }
    return order;
}

static size_t end_of(const tl_modbus_channel *channel) {
    return channel->address + tl_modbus_registers(channel->type);
}

static tl_modbus_read single(const tl_modbus_map *map, size_t entry, tl_modbus_grain grain) {
    const tl_modbus_channel *channel = &map->entries[entry].channel;
    tl_modbus_read read = {.unit_id = channel->unit_id,
                           .table = channel->table,
                           .address = channel->address,
                           .count = (uint16_t)tl_modbus_registers(channel->type),
                           .first = entry,
                           .entries = 1,
                           .grain = grain};
    return read;
}

/* Adds a channel to this request if possible; returns whether it was. */
static bool extend(tl_modbus_read *read, const tl_modbus_channel *channel, size_t most_registers) {
    bool bits = tl_modbus_is_bit_table(read->table);
    size_t gap = bits ? TL_MODBUS_GAP_BITS : TL_MODBUS_GAP_REGISTERS;
    size_t most = bits ? TL_MODBUS_MAX_BITS : most_registers;
    size_t end = (size_t)read->address + read->count;
    size_t new_end = end_of(channel) > end ? end_of(channel) : end;
    bool is_same_register =
        tl_modbus_part_bits(channel->type) > 0 && channel->address == read->address && read->count == 1;
    if (channel->unit_id != read->unit_id || channel->table != read->table ||
        (read->grain == TL_MODBUS_SINGLE && !is_same_register)) {
        return false;
    }
    if (channel->address > end + (read->grain == TL_MODBUS_GAPS ? gap : 0) || new_end - read->address > most) {
        return false;
    }
    read->count = (uint16_t)(new_end - read->address);
    read->entries++;
    return true;
}

/* Groups some entries; returns the number of requests written to `reads`. */
static size_t group(const tl_modbus_map *map, size_t first, size_t entries, tl_modbus_grain grain,
                    tl_modbus_read *reads) {
    size_t count = 0;
    for (size_t entry = first; entry < first + entries; entry++) {
        if (count == 0 || !extend(&reads[count - 1], &map->entries[entry].channel, map->most_registers)) {
            reads[count] = single(map, entry, grain);
            count++;
        }
    }
    return count;
}

bool tl_modbus_map_make(tl_modbus_map *map, const tl_modbus_channel *channels, size_t count, size_t most_registers) {
    size_t room = count > 0 ? count : 1;
    *map = (tl_modbus_map){.entries = calloc(room, sizeof *map->entries), .reads = calloc(room, sizeof *map->reads)};
    if (map->entries == NULL || map->reads == NULL) {
        tl_modbus_map_release(map);
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        map->entries[i].channel = channels[i];
        map->entries[i].index = i;
    }
    map->entry_count = count;
    map->most_registers = most_registers;
    qsort(map->entries, count, sizeof *map->entries, compare);
    tl_modbus_map_reset(map, TL_MODBUS_GAPS);
    return true;
}

void tl_modbus_map_reset(tl_modbus_map *map, tl_modbus_grain grain) {
    map->read_count = group(map, 0, map->entry_count, grain, map->reads);
}

size_t tl_modbus_map_split(tl_modbus_map *map, size_t read) {
    const tl_modbus_read old = map->reads[read];
    size_t tail = map->read_count - read - 1;
    if (old.entries == 1) {
        return 1;
    }
    for (int grain = (int)old.grain + 1; grain <= TL_MODBUS_SINGLE; grain++) {
        tl_modbus_read probe = single(map, old.first, (tl_modbus_grain)grain);
        size_t joined = 1;
        while (joined < old.entries && extend(&probe, &map->entries[old.first + joined].channel, map->most_registers)) {
            joined++;
        }
        if (joined < old.entries) { /* this grain makes it smaller */
            /* Moves the other requests to the far end of the array, to make room for any number of
             * new ones. */
            tl_modbus_read *rest = &map->reads[map->entry_count - tail];
            memmove(rest, &map->reads[read + 1], tail * sizeof *rest);
            size_t count = group(map, old.first, old.entries, (tl_modbus_grain)grain, &map->reads[read]);
            memmove(&map->reads[read + count], rest, tail * sizeof *rest);
            map->read_count = read + count + tail;
            return count;
        }
    }
    return 1;
}

void tl_modbus_map_release(tl_modbus_map *map) {
    free(map->entries);
    free(map->reads);
    memset(map, 0, sizeof *map);
}
