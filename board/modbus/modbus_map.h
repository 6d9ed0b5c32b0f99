/* Signals in Modbus registers: types, read requests, and the outcome of a request.
 *
 * Thread:  any; pure.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_MAP_H
#define TL_BOARD_MODBUS_MODBUS_MAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/io/link.h"
#include "master/base/simtime.h"

/* ---- Outcome of a Modbus request, and its description. Private to the Modbus driver.
 *
 * Purpose: an answer is right, an exception, wrong, or missing. The driver derives the link state
 *          from the kind of the outcome. Messages contain the description.
 */

typedef enum tl_modbus_kind {
    TL_MODBUS_VALUES,    /* the answer is right in every byte that can be checked */
    TL_MODBUS_EXCEPTION, /* the device answers with an exception; found: its code, 0 to 255 */
    /* No complete answer. found: an errno or an error number of libmodbus. ETIMEDOUT: no answer in
     * time; EPROTO: incomplete answer; EBUSY: the line is never quiet; EINTR: interrupted. */
    TL_MODBUS_FAILED,
    /* Wrong answers, which are not used. found: the number in the answer; wanted: the right one. */
    TL_MODBUS_WRONG_TRANSACTION,
    TL_MODBUS_WRONG_PROTOCOL,
    TL_MODBUS_WRONG_LENGTH, /* in bytes, by the header or as received */
    TL_MODBUS_WRONG_UNIT,
    TL_MODBUS_WRONG_FUNCTION,
    TL_MODBUS_WRONG_BYTES /* number of value bytes */
} tl_modbus_kind;

/* All zeros: TL_MODBUS_VALUES. */
typedef struct tl_modbus_outcome {
    tl_modbus_kind kind;
    int found;  /* see tl_modbus_kind */
    int wanted; /* see tl_modbus_kind */
} tl_modbus_outcome;

/* True if both outcomes are the same problem, so that the second one need not be reported. All
 * wrong answers are the same problem; all exceptions too; failures only with the same errno. */
bool tl_modbus_outcome_is_same(const tl_modbus_outcome *a, const tl_modbus_outcome *b);

/* Writes to `text` what was wrong and what to do. `on_a_line`: by a serial line, else by TCP.
 * `timeout`: ns, for the text. Not for TL_MODBUS_VALUES. */
void tl_modbus_outcome_text(const tl_modbus_outcome *outcome, bool on_a_line, tl_time timeout, char *text, size_t size);

/* ---- Modbus channels: position of a value in a device's registers, and conversion.
 *
 * Purpose: pure arithmetic for the driver, the emulated plant and tests.
 * Values:  value = raw·scale + offset, in the signal's unit. raw has at most 64 bits. In arrays of
 *          registers, a bit is one register with the value 0 or 1.
 * Thread:  any. Errors: none, because tl_modbus_open() has checked that a channel fits its table.
 * Source:  MODBUS Application Protocol 1.1b3, section 4.3.
 */

/* The table in the device. Its number is the function code that reads it. */
typedef enum tl_modbus_table {
    TL_MODBUS_COIL = 1,
    TL_MODBUS_DISCRETE = 2,
    TL_MODBUS_HOLDING = 3,
    TL_MODBUS_INPUT = 4
} tl_modbus_table;

typedef enum tl_modbus_type {
    TL_MODBUS_BIT, /* the only type in coil and discrete; no other table has it */
    TL_MODBUS_INT16,
    TL_MODBUS_UINT16,
    TL_MODBUS_INT32,
    TL_MODBUS_UINT32,
    TL_MODBUS_FLOAT32,
    TL_MODBUS_FLOAT64,
    TL_MODBUS_INT64, /* beyond 2^53 rounded to the nearest double, also UINT64 */
    TL_MODBUS_UINT64,
    TL_MODBUS_BCD16, /* one decimal digit in 4 bits */
    TL_MODBUS_BCD32,
    TL_MODBUS_REGISTER_BIT, /* part of a register: one bit; a byte */
    TL_MODBUS_INT8,
    TL_MODBUS_UINT8
} tl_modbus_type;

enum { TL_MODBUS_CODES = 4 }; /* most values of a channel that mean "not available" */

/* Position of one signal in the server's register map. */
typedef struct tl_modbus_channel {
    uint8_t unit_id; /* 0..247, 255; on a line 1..247 */
    tl_modbus_table table;
    uint16_t address; /* of the first register or bit, counted from 0 */
    tl_modbus_type type;
    bool words_little; /* several registers: least significant word first; default: most significant first */
    bool bytes_little; /* within a register: least significant byte first; default: most significant first */
    uint8_t bit;       /* part of a register: its lowest bit, 0 … 15; of a byte 0 or 8 */
    double scale;      /* value = raw·scale + offset; not 0 */
    double offset;
    double codes[TL_MODBUS_CODES]; /* raw values that mean "not available" */
    size_t code_count;
} tl_modbus_channel;

/* Returns "coil", "discrete input", "holding register" or "input register". */
const char *tl_modbus_table_name(tl_modbus_table table);

/* True for coils and discrete inputs, which contain bits. The other tables contain registers. */
bool tl_modbus_is_bit_table(tl_modbus_table table);

/* Returns the number of registers of a value of this type; 1 for a bit. */
size_t tl_modbus_registers(tl_modbus_type type);

/* Returns the number of bits if the type is a part of a register, else 0. */
unsigned tl_modbus_part_bits(tl_modbus_type type);

/* Converts raw registers to a value and back. `registers` has tl_modbus_registers() elements.
 * decode: if the value is not finite, a BCD digit is above 9, or raw is one of `codes`, returns
 *         false and sets *value to 0.
 * encode: an integer or bit gets the nearest integer: values out of range saturate, also
 *         infinities, and NaN becomes 0. A float32 saturates finite values only. A part of a
 *         register does not change the other bits. */
bool tl_modbus_decode(const tl_modbus_channel *channel, const uint16_t *registers, double *value);
void tl_modbus_encode(const tl_modbus_channel *channel, double value, uint16_t *registers);

/* ---- Read requests for a list of Modbus channels: as few as possible. Private to the Modbus
 * driver.
 *
 * Purpose: channels of one unit and table with near addresses share a request. If a server rejects
 *          such a request, the driver splits it: first into requests without unused registers, then
 *          into one request per value. Parts of one register stay together.
 * Limits:  most_registers (at most 125) or 2000 bits per request (MODBUS Application Protocol
 *          1.1b3, 6.1 to 6.4). A value is never split over two requests, so it is always
 *          consistent.
 * Bound:   make O(n log n), split O(n); only make allocates. There are never more requests than
 *          channels.
 */

enum {
    TL_MODBUS_MAX_REGISTERS = 125,
    TL_MODBUS_MAX_BITS = 2000,
    TL_MODBUS_GAP_REGISTERS = 16, /* most unused registers between two channels of a request */
    TL_MODBUS_GAP_BITS = 256      /* most unused bits between them */
};

/* Which channels share a request: near ones, also with unused registers between them; only adjacent
 * ones; none. */
typedef enum tl_modbus_grain { TL_MODBUS_GAPS, TL_MODBUS_NO_GAPS, TL_MODBUS_SINGLE } tl_modbus_grain;

/* One request; its channels are consecutive entries of the map. Only the driver uses the fields
 * after `grain`. A request is silent if its answer is missing or wrong. */
typedef struct tl_modbus_read {
    uint8_t unit_id;
    tl_modbus_table table;
    uint16_t address;
    uint16_t count; /* registers or bits */
    size_t first;   /* index of its first entry */
    size_t entries; /* number of its entries */
    tl_modbus_grain grain;
    tl_modbus_outcome trouble; /* last reported problem; TL_MODBUS_VALUES: none */
    tl_backoff backoff;        /* on while this request is silent and others are answered */
    tl_time hold;    /* earliest next try, CLOCK_MONOTONIC, ns; before it a late answer of the unit may come */
    uint64_t polled; /* number of the last poll in which the request was answered */
    uint64_t silent; /* number of the last poll in which the request was silent */
    tl_modbus_outcome failure; /* outcome in the poll `silent` */
} tl_modbus_read;

/* One channel in the map. */
typedef struct tl_modbus_entry {
    tl_modbus_channel channel;
    size_t index; /* of the channel in the caller's list */
} tl_modbus_entry;

/* The caller owns the struct. Only the Modbus driver uses its fields. */
typedef struct tl_modbus_map {
    tl_modbus_entry *entries; /* sorted by unit, table, address */
    size_t entry_count;
    tl_modbus_read *reads; /* in the same order */
    size_t read_count;
    size_t most_registers; /* of a request with several values */
} tl_modbus_map;

/* Initialises the map without freeing an old one. Copies the channels, which must be valid
 * (tl_modbus_open() checks them). `most_registers`: 1 to TL_MODBUS_MAX_REGISTERS. Returns false if
 * memory is out; then the map is empty. */
bool tl_modbus_map_make(tl_modbus_map *map, const tl_modbus_channel *channels, size_t count, size_t most_registers);

/* Undoes all splits: groups the channels again, with TL_MODBUS_GAPS as tl_modbus_map_make() does.
 * Clears the driver's fields of all requests. */
void tl_modbus_map_reset(tl_modbus_map *map, tl_modbus_grain grain);

/* Splits the request at index `read`. Its parts replace it; the indices of later requests increase.
 * Returns the number of parts; 1: the request cannot be split. */
size_t tl_modbus_map_split(tl_modbus_map *map, size_t read);

/* Frees the content. Allowed twice. */
void tl_modbus_map_release(tl_modbus_map *map);

#endif
