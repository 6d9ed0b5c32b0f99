/* Modbus channels: where a value stands among a device's registers, and registers to values and back.
 *
 * Purpose: pure arithmetic, for the driver, for the emulated plant and for tests.
 * Values:  value = raw·scale + offset; raw is carried through 64 bits. A bit is one register, 0 or 1.
 * Thread:  any. Errors: none; tl_modbus_open() has checked that a channel fits its table.
 * Source:  MODBUS Application Protocol 1.1b3, section 4.3.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_CODEC_H
#define TL_BOARD_MODBUS_MODBUS_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Also the function code that reads the table. */
typedef enum tl_modbus_table {
    TL_MODBUS_COIL = 1,
    TL_MODBUS_DISCRETE = 2,
    TL_MODBUS_HOLDING = 3,
    TL_MODBUS_INPUT = 4
} tl_modbus_table;

typedef enum tl_modbus_type {
    TL_MODBUS_BIT, /* coil and discrete only */
    TL_MODBUS_INT16,
    TL_MODBUS_UINT16,
    TL_MODBUS_INT32,
    TL_MODBUS_UINT32,
    TL_MODBUS_FLOAT32,
    TL_MODBUS_FLOAT64
} tl_modbus_type;

/* Where one signal stands in the server's register map. */
typedef struct tl_modbus_channel {
    uint8_t unit_id; /* 0..247, 255; on a line 1..247 */
    tl_modbus_table table;
    uint16_t address; /* 0-based, of the first register or bit */
    tl_modbus_type type;
    bool words_little; /* several registers: least significant word first; default: most significant first */
    bool bytes_little; /* within a register: least significant byte first; default: most significant first */
    double scale;      /* value = raw·scale + offset */
    double offset;
} tl_modbus_channel;

/* Coils and discrete inputs hold bits, nothing else; the other tables hold registers. */
bool tl_modbus_is_bit_table(tl_modbus_table table);

/* Registers (or bits: 1) that a value of that type takes. */
size_t tl_modbus_registers(tl_modbus_type type);

/* Raw registers to value and back, as the channel says.
 * decode: false, and 0, if the value is not finite.
 * encode: rounds to the nearest integer; out-of-range integers and floats saturate; NaN as an integer is 0. */
bool tl_modbus_decode(const tl_modbus_channel *channel, const uint16_t *registers, double *value);
void tl_modbus_encode(const tl_modbus_channel *channel, double value, uint16_t *registers);

#endif
