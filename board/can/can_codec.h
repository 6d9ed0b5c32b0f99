/* Signals in CAN frames: bits, scales, and the map from frames to signals.
 *
 * Thread:  any; pure.
 */
#ifndef TL_BOARD_CAN_CAN_CODEC_H
#define TL_BOARD_CAN_CAN_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- CAN signals: converts bits of a frame to values and back, as a DBC file describes them.
 *
 * Purpose: pure arithmetic, for the driver, for the emulated plant and for tests.
 * Bits:    bit b of a frame is bit b % 8 (0: least significant) of byte b / 8.
 *          Intel: `start` is the least significant bit of the value; the other bits follow upwards.
 *          Motorola: `start` is the most significant bit of the value; the other bits follow
 *          downwards in the byte, then from bit 7 of the next byte.
 * Values:  value = raw·scale + offset, in the signal's unit. raw has at most 64 bits; as a double
 *          it is exact up to 2^53.
 * Source:  DBC file format (start bits, byte order, multiplexing); ISO 11898-1 (lengths of frames);
 *          SAE J1939-71, table 1 (values that are not available).
 */

enum {
    TL_CAN_BYTES = 64,            /* data bytes of the longest frame (CAN FD); a classic frame has 8 */
    TL_CAN_CONDITIONS = 4,        /* maximum number of multiplexors of one signal */
    TL_CAN_CONDITION_VALUES = 16, /* maximum number of values of one multiplexor that select the signal */
    TL_CAN_MULTIPLEXOR_BITS = 32
};

typedef enum tl_can_order { TL_CAN_INTEL, TL_CAN_MOTOROLA } tl_can_order;

/* How frames are chosen: by the whole id, or by the parameter group number (PGN) of SAE J1939, from
 * any sender or one. The PGN excludes priority and source address, and below 0xF000 in its lower 16
 * bits (PDU1) also the destination address. */
typedef enum tl_can_match { TL_CAN_BY_ID, TL_CAN_BY_PGN, TL_CAN_BY_PGN_AND_SOURCE } tl_can_match;

typedef enum tl_can_type { TL_CAN_UNSIGNED, TL_CAN_SIGNED, TL_CAN_FLOAT32, TL_CAN_FLOAT64 } tl_can_type;

/* Position of a bit field. */
typedef struct tl_can_field {
    uint16_t start;  /* bit in the frame, 0..511 */
    uint16_t length; /* bits, 1..64 */
    tl_can_order order;
} tl_can_field;

/* A multiplexor: a frame contains the signal only if this field has one of these raw values. */
typedef struct tl_can_condition {
    tl_can_field field; /* at most TL_CAN_MULTIPLEXOR_BITS long; unsigned */
    uint32_t values[TL_CAN_CONDITION_VALUES];
    uint32_t further[TL_CAN_CONDITION_VALUES]; /* so many values after each one also select the signal */
    size_t value_count;                        /* 1..TL_CAN_CONDITION_VALUES */
} tl_can_condition;

/* Position and meaning of one signal on the bus. */
typedef struct tl_can_channel {
    uint32_t id; /* 11 bits; 29 bits if extended. By PGN: what the emulated plant sends */
    bool extended;
    tl_can_match match; /* by PGN: extended */
    bool fd;            /* the emulated plant sends CAN FD frames; the driver accepts both formats */
    uint8_t bytes;      /* data bytes of the whole frame, see tl_can_is_length() */
    tl_can_field field;
    tl_can_type type; /* a float's field has 32 or 64 bits */
    double scale;     /* not 0 */
    double offset;
    bool not_available; /* "error" and "not available" of J1939 are invalid; unsigned, 2 bits or more */
    tl_can_condition conditions[TL_CAN_CONDITIONS]; /* all must be true; none: the signal is always present */
    size_t condition_count;
} tl_can_channel;

/* The id of a J1939 frame with priority 6; PDU1: to all (SAE J1939-21). `pgn`: 18 bits. */
uint32_t tl_can_pgn_id(uint32_t pgn, uint8_t source);

/* True if the PGN is of PDU1, whose last byte is 0. */
bool tl_can_pgn_is_addressed(uint32_t pgn);

/* True for a possible frame length: 0 to 8; with CAN FD also 12, 16, 20, 24, 32, 48, 64. */
bool tl_can_is_length(unsigned bytes);

/* Number of data bytes up to the last bit of a field; it need not be a possible frame length. More
 * than TL_CAN_BYTES if the field fits into no frame. */
size_t tl_can_field_bytes(const tl_can_field *field);

/* The largest tl_can_field_bytes() of a channel's field and its multiplexors. */
size_t tl_can_channel_bytes(const tl_can_channel *channel);

/* Reads or writes a field as an unsigned number: the lowest `length` bits of a uint64_t. `data` has
 * at least tl_can_field_bytes(). tl_can_write_bits() ignores higher bits and changes no other bit
 * of `data`. */
uint64_t tl_can_read_bits(const tl_can_field *field, const uint8_t *data);
void tl_can_write_bits(const tl_can_field *field, uint64_t bits, uint8_t *data);

/* True if the values of all multiplexors select this signal; `data` has at least
 * tl_can_channel_bytes(). */
bool tl_can_is_present(const tl_can_channel *channel, const uint8_t *data);

/* Reads the signal's value in its unit; `data` has at least tl_can_channel_bytes(). If the value is
 * not finite or not available, returns false and sets *value to 0. */
bool tl_can_decode(const tl_can_channel *channel, const uint8_t *data, double *value);

/* Writes a value to its field, and the first value of each multiplexor; `data` has at least
 * tl_can_channel_bytes(). An integer field gets the nearest integer: values out of range saturate,
 * also infinities, and NaN becomes 0. A float32 field saturates finite values only. */
void tl_can_encode(const tl_can_channel *channel, double value, uint8_t *data);

/* ---- Map from CAN ids to channels. Private to the CAN driver.
 *
 * Purpose: finds the channels of a frame by its id, and lists the ids for the kernel's filters.
 * Bound:   make O(n log n), find O(n); only make allocates. There are never more ids than
 *          channels.
 */

/* One id; its channels are consecutive elements of the map's array `entries`. */
typedef struct tl_can_id {
    uint32_t id; /* the bits in `mask` */
    uint32_t mask;
    bool extended;
    bool is_pgn;
    size_t first;   /* index of its first element in tl_can_map.entries */
    size_t entries; /* number of its elements there */
    bool too_short; /* of the driver: the last frame with this id was too short */
} tl_can_id;

/* One channel in the map. */
typedef struct tl_can_entry {
    tl_can_channel channel;
    uint32_t id; /* the bits in `mask` */
    uint32_t mask;
    size_t index; /* of the channel in the caller's list */
    size_t bytes; /* tl_can_channel_bytes() */
} tl_can_entry;

/* The caller owns the struct. Only the CAN driver uses its fields. */
typedef struct tl_can_map {
    tl_can_entry *entries; /* sorted by id */
    size_t entry_count;
    tl_can_id *ids; /* in the same order */
    size_t id_count;
} tl_can_map;

/* Initialises the map without freeing an old one. Copies the channels, which must be valid
 * (tl_can_open() checks them). Returns false if memory is out; then the map is empty. */
bool tl_can_map_make(tl_can_map *map, const tl_can_channel *channels, size_t count);

/* Returns the next element of `ids` for an id after `previous` (NULL: the first one); NULL after
 * the last. A standard and an extended id with the same number are different. */
tl_can_id *tl_can_map_find(const tl_can_map *map, const tl_can_id *previous, uint32_t id, bool extended);

/* Frees the content. Allowed twice. */
void tl_can_map_release(tl_can_map *map);

#endif
