/* Plant I/O driver: Modbus client, by TCP or on a serial line (RTU), that only reads (function codes 1 to 4).
 *
 * Purpose: polls the registers of one server, or of the units of one line, in as few requests as their addresses allow.
 * Link:    absent, dying and returning servers are survived: reconnect with back-off (from 0.1 s, doubling, to at
 *          most 2 s). The link is up while anything answers. One unit behind a gateway or on a line that is silent, or
 *          answers with an exception, costs its own channels only: it is asked last, with the same back-off, and so
 *          rarely that waiting for such units takes at most a fifth of the time.
 * Believed: only an answer that is right in transaction, protocol, length, unit, function and number of bytes. Of any
 *          other nothing is posted, and the connection is given up, so that nothing late or extra on it is taken for a
 *          later answer; what was wrong is told once.
 * Bound:   a poll waits at most timeout_s to connect (before each request, where the server sends more than it was asked
 *          for) and timeout_s for each response; by TCP the first response that does not come, or is wrong, ends it, on a
 *          line the second. Where `host` is a name, resolving it comes on top (once per attempt to connect) and cannot be
 *          interrupted. On a line the time on the wire is added, and up to 50 ms (after
 *          a failure) until it is quiet; a response that has begun can only be interrupted where it breaks off, after 0.2 s.
 * Line:    it has one master, us, and is opened exclusively. Parameters are 8 data bits, and those of tl_modbus_line. A
 *          response has no number: one that comes later than timeout_s and the silence after it could be taken for that
 *          of a later request of the same kind to the same unit. So timeout_s must be longer than the slowest unit takes,
 *          and after a silence nothing else is asked of the unit for that time.
 * Stamp:   when the response had arrived.
 * Source:  MODBUS Application Protocol 1.1b3, section 6.1 to 6.4; MODBUS over Serial Line 1.02, section 2.5.1.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_H
#define TL_BOARD_MODBUS_MODBUS_H

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
    uint8_t unit_id; /* 0..247, 255; on a line 1..247 */
    tl_modbus_table table;
    uint16_t address; /* 0-based, of the first register or bit */
    tl_modbus_type type;
    bool words_little; /* several registers: least significant word first; default: most significant first */
    bool bytes_little; /* within a register: least significant byte first; default: most significant first */
    double scale;      /* value = raw·scale + offset */
    double offset;
} tl_modbus_channel;

/* A serial line. */
typedef struct tl_modbus_line {
    const char *device; /* a path, best one that stays: /dev/serial/by-id/… */
    uint32_t baud;      /* one of tl_modbus_bauds */
    char parity;        /* 'N', 'E', 'O' */
    uint8_t stop_bits;  /* 1, 2 */
    bool rs485;         /* the port's driver shall switch between sending and receiving (TIOCSRS485) */
} tl_modbus_line;

/* The speeds there are, rising, up to a 0. */
extern const uint32_t tl_modbus_bauds[];

typedef struct tl_modbus_settings {
    const char *host; /* name or address; not read where line.device is given */
    uint16_t port;
    bool any_unit_id;    /* TCP: an answer may name another unit than was asked, as some devices and gateways do */
    tl_modbus_line line; /* line.device: NULL for TCP */
    double timeout_s;    /* of one response and of a connect, > 0 */
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
