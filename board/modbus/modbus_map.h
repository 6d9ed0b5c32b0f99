/* Signals in Modbus registers: types, read requests, and the outcome of an answer for each signal.
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
 * Purpose: an answer is right, is an exception, is wrong, or is missing. The driver derives the
 *          link state from the kind; people read the sentence.
 */

typedef enum tl_modbus_kind {
    TL_MODBUS_VALUES,    /* the answer is right in every byte that can be checked */
    TL_MODBUS_EXCEPTION, /* the device answers with an exception; found: its code, 0 to 255 */
    /* no complete answer; found: errno, also of libmodbus. ETIMEDOUT: none in time, EPROTO: it is
     * incomplete, EBUSY: the line is never quiet, EINTR: interrupted */
    TL_MODBUS_FAILED,
    /* Wrong answers, which are not used; found and wanted: the wrong number and the right one. */
    TL_MODBUS_WRONG_TRANSACTION,
    TL_MODBUS_WRONG_PROTOCOL,
    TL_MODBUS_WRONG_LENGTH, /* by its header */
    TL_MODBUS_WRONG_UNIT,
    TL_MODBUS_WRONG_FUNCTION,
    TL_MODBUS_WRONG_BYTES /* number of value bytes */
} tl_modbus_kind;

/* Starts as zeros: TL_MODBUS_VALUES. */
typedef struct tl_modbus_outcome {
    tl_modbus_kind kind;
    int found;
    int wanted;
} tl_modbus_outcome;

/* True if the second outcome need not be reported after the first: all wrong answers count as one
 * problem, and so do exceptions. */
bool tl_modbus_outcome_is_same(const tl_modbus_outcome *a, const tl_modbus_outcome *b);

/* Describes what was wrong and what to do. Not for TL_MODBUS_VALUES. */
void tl_modbus_outcome_text(const tl_modbus_outcome *outcome, bool on_a_line, tl_time timeout, char *text, size_t size);

/* ---- Modbus channels: position of a value in a device's registers, and conversion.
 *
 * Purpose: pure arithmetic for the driver, the emulated plant and tests.
 * Values:  value = raw·scale + offset; raw is carried through 64 bits. A bit is one register, 0 or
 *          1.
 * Thread:  any. Errors: none; tl_modbus_open() has checked that a channel fits its table.
 * Source:  MODBUS Application Protocol 1.1b3, section 4.3.
 */

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

/* Position of one signal in the server's register map. */
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

/* Registers (or bits: 1) of a value of that type. */
size_t tl_modbus_registers(tl_modbus_type type);

/* Converts raw registers to a value and back.
 * decode: returns false, and 0, if the value is not finite.
 * encode: rounds to the nearest integer; out-of-range integers and floats saturate; NaN as an
 *         integer is 0. */
bool tl_modbus_decode(const tl_modbus_channel *channel, const uint16_t *registers, double *value);
void tl_modbus_encode(const tl_modbus_channel *channel, double value, uint16_t *registers);

/* ---- Read requests for a list of Modbus channels: as few as possible. Private to the Modbus
 * driver.
 *
 * Purpose: channels of one unit and table that are close together share a request. If a server
 *          rejects such a request, it is split: first without unused registers, then value by
 *          value.
 * Limits:  125 registers or 2000 bits per request (MODBUS Application Protocol 1.1b3, 6.1 to 6.4).
 *          A value is never split over two requests, so it is always consistent.
 * Bound:   make O(n log n), split O(n); only make allocates. There are never more requests than
 *          channels.
 */

enum {
    TL_MODBUS_MAX_REGISTERS = 125,
    TL_MODBUS_MAX_BITS = 2000,
    TL_MODBUS_GAP_REGISTERS = 16, /* up to so many unused registers cost less than one more request */
    TL_MODBUS_GAP_BITS = 256
};

/* Sharing of requests, from coarse to fine. */
typedef enum tl_modbus_grain { TL_MODBUS_GAPS, TL_MODBUS_NO_GAPS, TL_MODBUS_SINGLE } tl_modbus_grain;

/* One request. */
typedef struct tl_modbus_read {
    uint8_t unit_id;
    tl_modbus_table table;
    uint16_t address;
    uint16_t count; /* registers or bits */
    size_t first;   /* of its slots */
    size_t slots;
    tl_modbus_grain grain;
    tl_modbus_outcome trouble; /* last reported problem; TL_MODBUS_VALUES: none. For the driver, as the following */
    tl_backoff backoff;        /* set while it is silent and others answer */
    tl_time hold;    /* ns; not to be asked earlier, because its unit still owes an answer to another request */
    uint64_t polled; /* last poll that has handled it */
    uint64_t silent; /* last poll in which it was silent or its answer was wrong */
    tl_modbus_outcome failure; /* outcome in that poll */
} tl_modbus_read;

typedef struct tl_modbus_slot {
    tl_modbus_channel channel;
    size_t index; /* of the channel in the list */
} tl_modbus_slot;

/* Placed by the owner; fields are private. */
typedef struct tl_modbus_map {
    tl_modbus_slot *slots; /* sorted by unit, table, address */
    size_t slot_count;
    tl_modbus_read *reads; /* in the same order */
    size_t read_count;
} tl_modbus_map;

/* Overwrites the map. Copies the channels, which must be valid. Returns false if memory is out;
 * then the map is empty. */
bool tl_modbus_map_make(tl_modbus_map *map, const tl_modbus_channel *channels, size_t count);

/* Returns to the coarsest requests and drops all problems. */
void tl_modbus_map_reset(tl_modbus_map *map);

/* Splits one request; the parts start at the same index. Returns their number; 1: it cannot be
 * split. */
size_t tl_modbus_map_split(tl_modbus_map *map, size_t read);

void tl_modbus_map_release(tl_modbus_map *map);

#endif
