/* Modbus requests and answers as bytes. Private to the Modbus driver.
 *
 * Purpose: pure functions: the bytes of a request, and whether bytes that came are the answer to it. Whoever is at the other
 *          end, nothing of an answer is taken unless all that can be checked has been: transaction, protocol, length, unit,
 *          function, number of bytes.
 * Bound:   nothing behind `size` is read.
 * Source:  MODBUS Application Protocol 1.1b3, sections 4 to 7; MODBUS Messaging on TCP/IP 1.0b, section 3.1.3.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_FRAME_H
#define TL_BOARD_MODBUS_MODBUS_FRAME_H

#include <stdint.h>

#include "board/modbus/modbus_map.h"
#include "board/modbus/modbus_outcome.h"

enum {
    TL_MODBUS_BODY_REQUEST = 6,    /* unit, function; two bytes each: address, count */
    TL_MODBUS_TCP_PREFIX = 6,      /* two bytes each: transaction, protocol, length of what follows */
    TL_MODBUS_TCP_REQUEST = 6 + 6, /* prefix, body */
    TL_MODBUS_TCP_ANSWER = 6 + 3 + TL_MODBUS_MAX_REGISTERS * 2, /* the longest that is right */
    TL_MODBUS_TCP_FIRST = 6 + 3 /* the shortest: up to the exception's code, or the number of bytes */
};

/* Where the values of an answer go; enough for any. */
typedef struct tl_modbus_values {
    uint8_t bits[TL_MODBUS_MAX_BITS];
    uint16_t registers[TL_MODBUS_MAX_REGISTERS];
} tl_modbus_values;

/* What was asked by TCP. */
typedef struct tl_modbus_question {
    const tl_modbus_read *read;
    uint16_t transaction;
    bool any_unit_id; /* the answer may name another unit */
} tl_modbus_question;

/* Bytes of values in the answer to that. */
size_t tl_modbus_value_bytes(const tl_modbus_read *read);

/* The request without what TCP or a line adds. */
void tl_modbus_put_body(const tl_modbus_read *read, uint8_t request[TL_MODBUS_BODY_REQUEST]);

void tl_modbus_put_request(const tl_modbus_question *asked, uint8_t request[TL_MODBUS_TCP_REQUEST]);

/* Looks at the first `size` bytes of what came by TCP. *missing: so many must come before more can be said; they never go
 * beyond the end of the answer, nor beyond TL_MODBUS_TCP_ANSWER bytes in all. 0: the outcome is final. */
tl_modbus_outcome tl_modbus_check_tcp(const tl_modbus_question *asked, const uint8_t *answer, size_t size,
                                      size_t *missing);

/* Looks at a whole answer from a line: unit, function and so on, without its check sum, at least 3 bytes. */
tl_modbus_outcome tl_modbus_check_rtu(const tl_modbus_read *asked, const uint8_t *answer, size_t size);

/* Takes `bytes`, tl_modbus_value_bytes() of them, apart. */
void tl_modbus_take_values(const tl_modbus_read *read, const uint8_t *bytes, tl_modbus_values *values);

#endif
