/* Signals in Modbus registers: types, requests that read them, and what an answer says of each.
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

/* ---- What came of one Modbus request, and how that is said. Private to the Modbus driver.
 *
 * Purpose: one answer is right, or says no, or is wrong, or there is none. The driver decides by the kind what that means for
 *          the link; people read the sentence.
 */

typedef enum tl_modbus_kind {
    TL_MODBUS_VALUES,    /* the answer to what was asked, right in every byte that can be checked */
    TL_MODBUS_EXCEPTION, /* the device says no; found: its reason, 0 to 255 */
    /* no whole answer; found: errno, also libmodbus's. ETIMEDOUT: none in time, EPROTO: it breaks off, EBUSY: the line is never
     * quiet, EINTR: interrupted */
    TL_MODBUS_FAILED,
    /* Wrong, so nothing of it is used; found and wanted: the number that is wrong, and what it must be. */
    TL_MODBUS_WRONG_TRANSACTION,
    TL_MODBUS_WRONG_PROTOCOL,
    TL_MODBUS_WRONG_LENGTH, /* as the header gives it */
    TL_MODBUS_WRONG_UNIT,
    TL_MODBUS_WRONG_FUNCTION,
    TL_MODBUS_WRONG_BYTES /* how many there are of values */
} tl_modbus_kind;

/* Zeroed: TL_MODBUS_VALUES. */
typedef struct tl_modbus_outcome {
    tl_modbus_kind kind;
    int found;
    int wanted;
} tl_modbus_outcome;

/* Is the second one no news after the first? Answers that are wrong, in whatever way, are one thing, as are exceptions: who
 * tells another lie each time is told of once. */
bool tl_modbus_outcome_is_same(const tl_modbus_outcome *a, const tl_modbus_outcome *b);

/* In words: what was wrong and what to do about it. Not for TL_MODBUS_VALUES. */
void tl_modbus_outcome_text(const tl_modbus_outcome *outcome, bool on_a_line, tl_time timeout, char *text, size_t size);

/* ---- Modbus channels: where a value stands among a device's registers, and registers to values and back.
 *
 * Purpose: pure arithmetic, for the driver, for the emulated plant and for tests.
 * Values:  value = raw·scale + offset; raw is carried through 64 bits. A bit is one register, 0 or 1.
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

/* ---- Which requests read a list of Modbus channels: as few as their addresses allow. Private to the Modbus driver.
 *
 * Purpose: channels of one unit and table that lie close together share a request. A server that refuses such a
 *          request is asked in smaller ones: first without the registers nobody wants, then value by value.
 * Limits:  125 registers or 2000 bits per request (MODBUS Application Protocol 1.1b3, 6.1 to 6.4); a value is
 *          never spread over two requests, so it is never half old and half new.
 * Bound:   make O(n log n), split O(n); no allocation but in make. Never more requests than channels.
 */

enum {
    TL_MODBUS_MAX_REGISTERS = 125,
    TL_MODBUS_MAX_BITS = 2000,
    TL_MODBUS_GAP_REGISTERS = 16, /* so many unwanted ones are cheaper than one more request */
    TL_MODBUS_GAP_BITS = 256
};

/* How channels share a request, from coarse to fine. */
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
    tl_modbus_outcome trouble; /* that was told last; values: none. For the driver, as are the next */
    tl_backoff backoff;        /* on: it was silent while others answered */
    tl_time hold;              /* ns; not to be asked earlier: its unit owes an answer to another request */
    uint64_t polled;           /* the poll that has seen to it */
    uint64_t silent;           /* the poll in which it was last asked, and was silent or made no sense */
    tl_modbus_outcome failure; /* what came of that */
} tl_modbus_read;

typedef struct tl_modbus_slot {
    tl_modbus_channel channel;
    size_t index; /* of the channel in the list */
} tl_modbus_slot;

/* Placed by the owner. */
typedef struct tl_modbus_map {
    tl_modbus_slot *slots; /* sorted by unit, table, address */
    size_t slot_count;
    tl_modbus_read *reads; /* in the same order */
    size_t read_count;
} tl_modbus_map;

/* Whatever was in it. The channels are copied; they must be valid. false if memory is out: then it is empty. */
bool tl_modbus_map_make(tl_modbus_map *map, const tl_modbus_channel *channels, size_t count);

/* Back to the coarsest grain, troubles forgotten. */
void tl_modbus_map_reset(tl_modbus_map *map);

/* Replaces one request by finer ones; they begin at the same position. Returns how many they are; 1: it stays as
 * it is because there is nothing finer. */
size_t tl_modbus_map_split(tl_modbus_map *map, size_t read);

void tl_modbus_map_release(tl_modbus_map *map);

#endif
