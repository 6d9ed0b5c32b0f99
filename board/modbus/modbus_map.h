/* Which requests read a list of Modbus channels: as few as their addresses allow. Private to the Modbus driver.
 *
 * Purpose: channels of one unit and table that lie close together share a request. A server that refuses such a
 *          request is asked in smaller ones: first without the registers nobody wants, then value by value.
 * Limits:  125 registers or 2000 bits per request (MODBUS Application Protocol 1.1b3, 6.1 to 6.4); a value is
 *          never spread over two requests, so it is never half old and half new.
 * Bound:   make O(n log n), split O(n); no allocation but in make. Never more requests than channels.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_MAP_H
#define TL_BOARD_MODBUS_MODBUS_MAP_H

#include "board/io/backoff.h"
#include "board/modbus/modbus_codec.h"
#include "board/modbus/modbus_outcome.h"

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
