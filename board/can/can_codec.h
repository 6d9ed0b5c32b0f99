/* Signals in CAN frames: bits, scales, and the map from frames to signals.
 *
 * Thread:  any; pure.
 */
#ifndef TL_BOARD_CAN_CAN_CODEC_H
#define TL_BOARD_CAN_CAN_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- CAN signals: bits of a frame to values and back, as a DBC file describes them.
 *
 * Purpose: pure arithmetic, for the driver, for the emulated plant and for tests.
 * Bits:    bit b of a frame is bit b % 8 (0: least significant) of byte b / 8. Intel: `start` is
 *          the least significant
 *          bit of the value, the others follow upwards. Motorola: `start` is its most significant
 *          bit, the others follow
 *          downwards within a byte, then from bit 7 of the next byte on.
 * Values:  value = raw·scale + offset; raw is carried through 64 bits.
 * Source:  DBC file format (start bits, byte order, multiplexing); ISO 11898-1 (lengths of frames).
 */

enum {
    TL_CAN_BYTES = 64,     /* of the longest frame (CAN FD); a classic frame has 8 */
    TL_CAN_CONDITIONS = 4, /* nested multiplexors */
    TL_CAN_CONDITION_VALUES = 16,
    TL_CAN_MULTIPLEXOR_BITS = 32
};

typedef enum tl_can_order { TL_CAN_INTEL, TL_CAN_MOTOROLA } tl_can_order;

typedef enum tl_can_type { TL_CAN_UNSIGNED, TL_CAN_SIGNED, TL_CAN_FLOAT32, TL_CAN_FLOAT64 } tl_can_type;

/* Position of a bit field. */
typedef struct tl_can_field {
    uint16_t start;  /* 0..511 */
    uint16_t length; /* bits, 1..64 */
    tl_can_order order;
} tl_can_field;

/* A multiplexor, and its raw values (unsigned) with which the signal is in the frame. */
typedef struct tl_can_condition {
    tl_can_field field; /* of at most TL_CAN_MULTIPLEXOR_BITS */
    uint32_t values[TL_CAN_CONDITION_VALUES];
    size_t value_count; /* 1 or more */
} tl_can_condition;

/* Position and meaning of one signal on the bus. */
typedef struct tl_can_channel {
    uint32_t id; /* 11 or 29 bits */
    bool extended;
    bool fd;       /* format that the emulated plant sends; the driver accepts both */
    uint8_t bytes; /* of the whole frame */
    tl_can_field field;
    tl_can_type type; /* a float's field has 32 or 64 bits */
    double scale;     /* not 0 */
    double offset;
    tl_can_condition conditions[TL_CAN_CONDITIONS]; /* all must hold */
    size_t condition_count;
} tl_can_channel;

/* True for a possible frame length: 0 to 8; with CAN FD also 12, 16, 20, 24, 32, 48, 64. */
bool tl_can_is_length(unsigned bytes);

/* Smallest frame length with all bits of a field; more than TL_CAN_BYTES if none is long enough. */
size_t tl_can_field_bytes(const tl_can_field *field);

/* The same for a channel with its multiplexors. */
size_t tl_can_channel_bytes(const tl_can_channel *channel);

/* Reads and writes the bits of a field, most significant first; put does not change other bits of
 * `data`. */
uint64_t tl_can_take(const tl_can_field *field, const uint8_t *data);
void tl_can_put(const tl_can_field *field, uint64_t bits, uint8_t *data);

/* True if the values of all multiplexors select this signal. */
bool tl_can_is_present(const tl_can_channel *channel, const uint8_t *data);

/* Reads the signal's value; `data` has at least tl_can_channel_bytes(). Returns false, and 0, if it
 * is not finite. */
bool tl_can_decode(const tl_can_channel *channel, const uint8_t *data, double *value);

/* Writes the bits of a value and of its multiplexors (the first value of each). Rounds to the
 * nearest integer; values out of range saturate; NaN as an integer is 0. */
void tl_can_encode(const tl_can_channel *channel, double value, uint8_t *data);

/* ---- Map from CAN ids to channels. Private to the CAN driver.
 *
 * Purpose: finds the channels of a frame by its id, and lists the ids for the kernel's filters.
 * Bound:   make O(n log n), find O(log n); only make allocates. There are never more ids than
 *          channels.
 */

/* One id, and its slots. */
typedef struct tl_can_id {
    uint32_t id;
    bool extended;
    size_t first; /* of its slots */
    size_t slots;
    bool too_short; /* the last frame was too short; used by the driver */
} tl_can_id;

typedef struct tl_can_slot {
    tl_can_channel channel;
    size_t index; /* of the channel in the list */
    size_t bytes; /* shortest frame */
} tl_can_slot;

/* Placed by the owner; fields are private. */
typedef struct tl_can_map {
    tl_can_slot *slots; /* sorted by id */
    size_t slot_count;
    tl_can_id *ids; /* in the same order */
    size_t id_count;
} tl_can_map;

/* Overwrites the map. Copies the channels, which must be valid. Returns false if memory is out;
 * then the map is empty. */
bool tl_can_map_make(tl_can_map *map, const tl_can_channel *channels, size_t count);

/* NULL if no channel has that id. A standard and an extended id of the same number are different.
 */
tl_can_id *tl_can_map_find(const tl_can_map *map, uint32_t id, bool extended);

void tl_can_map_release(tl_can_map *map);

#endif
