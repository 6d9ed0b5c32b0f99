/* Modbus registers to values and back: data types, word order, byte order, scale.
 *
 * A value is carried through 64 bits: registers are joined most significant first, whatever order they come in.
 */
#include "board/modbus/modbus_codec.h"

#include <math.h>

#include "board/io/bits.h"

bool tl_modbus_is_bit_table(tl_modbus_table table) {
    return table == TL_MODBUS_COIL || table == TL_MODBUS_DISCRETE;
}

size_t tl_modbus_registers(tl_modbus_type type) {
    switch (type) {
    case TL_MODBUS_INT32:
    case TL_MODBUS_UINT32:
    case TL_MODBUS_FLOAT32:
        return 2;
    case TL_MODBUS_FLOAT64:
        return 4;
    case TL_MODBUS_BIT:
    case TL_MODBUS_INT16:
    case TL_MODBUS_UINT16:
        break;
    }
    return 1;
}

/* A register between the order on the wire and most significant byte first. */
static uint16_t ordered(const tl_modbus_channel *channel, uint16_t word) {
    if (channel->bytes_little) {
        return (uint16_t)((unsigned)word << 8 | (unsigned)word >> 8);
    }
    return word;
}

/* Where the i-th most significant register of a value stands. */
static size_t place(const tl_modbus_channel *channel, size_t count, size_t i) {
    return channel->words_little ? count - 1 - i : i;
}

static uint64_t join(const tl_modbus_channel *channel, const uint16_t *registers) {
    size_t count = tl_modbus_registers(channel->type);
    uint64_t bits = 0;
    for (size_t i = 0; i < count; i++) {
        bits = bits << 16 | ordered(channel, registers[place(channel, count, i)]);
    }
    return bits;
}

static void part(const tl_modbus_channel *channel, uint64_t bits, uint16_t *registers) {
    size_t count = tl_modbus_registers(channel->type);
    for (size_t i = count; i-- > 0; bits >>= 16) {
        registers[place(channel, count, i)] = ordered(channel, (uint16_t)(bits & 0xFFFF));
    }
}

bool tl_modbus_decode(const tl_modbus_channel *channel, const uint16_t *registers, double *value) {
    double raw = 0;
    switch (channel->type) {
    case TL_MODBUS_BIT:
        raw = registers[0] != 0 ? 1 : 0;
        break;
    case TL_MODBUS_UINT16:
    case TL_MODBUS_UINT32:
        raw = (double)join(channel, registers);
        break;
    case TL_MODBUS_INT16:
        raw = tl_bits_to_signed(join(channel, registers), 16);
        break;
    case TL_MODBUS_INT32:
        raw = tl_bits_to_signed(join(channel, registers), 32);
        break;
    case TL_MODBUS_FLOAT32:
        raw = tl_bits_to_float32(join(channel, registers));
        break;
    case TL_MODBUS_FLOAT64:
        raw = tl_bits_to_float64(join(channel, registers));
        break;
    }
    *value = raw * channel->scale + channel->offset;
    if (!isfinite(*value)) {
        *value = 0;
        return false;
    }
    return true;
}

/* The nearest integer within the range, as the lower bits of 64. */
static uint64_t integer_bits(double raw, double minimum, double maximum) {
    if (isnan(raw)) {
        return 0;
    }
    return (uint64_t)(int64_t)fmin(fmax(round(raw), minimum), maximum);
}

void tl_modbus_encode(const tl_modbus_channel *channel, double value, uint16_t *registers) {
    double raw = (value - channel->offset) / channel->scale;
    switch (channel->type) {
    case TL_MODBUS_BIT:
        registers[0] = (uint16_t)integer_bits(raw, 0, 1);
        break;
    case TL_MODBUS_INT16:
        part(channel, integer_bits(raw, INT16_MIN, INT16_MAX), registers);
        break;
    case TL_MODBUS_UINT16:
        part(channel, integer_bits(raw, 0, UINT16_MAX), registers);
        break;
    case TL_MODBUS_INT32:
        part(channel, integer_bits(raw, INT32_MIN, INT32_MAX), registers);
        break;
    case TL_MODBUS_UINT32:
        part(channel, integer_bits(raw, 0, UINT32_MAX), registers);
        break;
    case TL_MODBUS_FLOAT32:
        part(channel, tl_bits_of_float32(raw), registers);
        break;
    case TL_MODBUS_FLOAT64:
        part(channel, tl_bits_of_float64(raw), registers);
        break;
    }
}
