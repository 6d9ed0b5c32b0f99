/* Plant I/O driver: Modbus TCP client that only reads (function codes 1 to 4).
 *
 * Purpose: polls the registers of one server, in as few requests as their addresses allow.
 * Link:    absent, dying and returning servers are survived: reconnect with back-off (from 0.1 s, doubling, to at
 *          most 2 s). The link is up while anything answers. One unit behind a gateway that is silent, or answers
 *          with an exception, costs its own channels only: it is asked last, and with the same back-off.
 * Bound:   a poll waits at most timeout_s to connect and timeout_s for each response; the first response that does
 *          not come ends it. Where `host` is a name, resolving it comes on top (once per attempt to connect) and
 *          cannot be interrupted.
 * Stamp:   when the response had arrived.
 * Source:  MODBUS Application Protocol 1.1b3, section 6.1 to 6.4.
 */
#ifndef TL_BOARD_IO_MODBUS_H
#define TL_BOARD_IO_MODBUS_H

#include <stdint.h>

#include "board/io/plant_io.h"

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
    uint8_t unit_id; /* 0..247, 255 */
    tl_modbus_table table;
    uint16_t address; /* 0-based, of the first register or bit */
    tl_modbus_type type;
    bool words_little; /* several registers: least significant word first; default: most significant first */
    bool bytes_little; /* within a register: least significant byte first; default: most significant first */
    double scale;      /* value = raw·scale + offset */
    double offset;
} tl_modbus_channel;

typedef struct tl_modbus_settings {
    const char *host; /* name or address */
    uint16_t port;
    double timeout_s; /* of one response and of a connect, > 0 */
    const tl_modbus_channel *channels;
    size_t channel_count;
} tl_modbus_settings;

extern const tl_plant_io_driver tl_modbus_driver;

/* Copies what it needs of `settings`. Does not connect yet. Errors: TL_BAD_DATA for a setting out of its range,
 * a type that its table cannot hold, a value beyond address 65535. */
tl_status tl_modbus_open(const tl_modbus_settings *settings, tl_plant_io **io, tl_error *error);

/* Registers (or bits: 1) that a value of that type takes. */
size_t tl_modbus_registers(tl_modbus_type type);

/* Raw registers to value and back, as the channel says; for the driver, the emulated plant and tests. A bit is
 * one register, 0 or 1.
 * decode: false, and 0, where the value is not finite.
 * encode: rounds to the nearest integer; out-of-range integers and floats saturate; NaN as an integer is 0. */
bool tl_modbus_decode(const tl_modbus_channel *channel, const uint16_t *registers, double *value);
void tl_modbus_encode(const tl_modbus_channel *channel, double value, uint16_t *registers);

#endif
