/* Connection to a Modbus server by TCP or serial line: frames and their answers.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_LINK_H
#define TL_BOARD_MODBUS_MODBUS_LINK_H

#include <stdbool.h>
#include <stdint.h>

#include "board/io/wake.h"
#include "board/modbus/modbus_map.h"
#include "master/base/status.h"

/* ---- Configuration of a serial line for Modbus RTU.
 *
 * Purpose: the parameters that all devices of the line share, and their valid values. Always 8 data
 *          bits.
 * Owner:   the device's name belongs to the caller. Thread: any.
 * Source:  MODBUS over Serial Line 1.02, section 2.5.1.
 */

typedef struct tl_modbus_line {
    const char *device; /* a path, preferably a stable one: /dev/serial/by-id/… */
    uint32_t baud;      /* one of tl_modbus_bauds */
    char parity;        /* 'N', 'E', 'O' */
    uint8_t stop_bits;  /* 1, 2 */
    bool rs485;         /* the kernel's driver switches between sending and receiving (TIOCSRS485) */
} tl_modbus_line;

/* Valid speeds in increasing order, ended by a 0. */
extern const uint32_t tl_modbus_bauds[];

/* TL_BAD_DATA for an invalid line or a device without a name. Opens nothing. */
tl_status tl_modbus_line_check(const tl_modbus_line *line, tl_error *error);

/* ---- Modbus requests and answers as bytes. Private to the Modbus driver.
 *
 * Purpose: pure functions that build requests and check answers. No value of an answer is used
 *          unless all checks pass: transaction, protocol, length, unit, function, number of bytes.
 * Bound:   reads nothing beyond `size`.
 * Source:  MODBUS Application Protocol 1.1b3, sections 4 to 7; MODBUS Messaging on TCP/IP 1.0b,
 *          section 3.1.3.
 */

enum {
    TL_MODBUS_BODY_REQUEST = 6,    /* unit, function; two bytes each: address, count */
    TL_MODBUS_TCP_PREFIX = 6,      /* two bytes each: transaction, protocol, length of what follows */
    TL_MODBUS_TCP_REQUEST = 6 + 6, /* prefix, body */
    TL_MODBUS_TCP_ANSWER = 6 + 3 + TL_MODBUS_MAX_REGISTERS * 2, /* the longest valid answer */
    TL_MODBUS_TCP_FIRST = 6 + 3 /* the shortest: up to the exception code or the number of bytes */
};

/* Values of an answer; large enough for any. */
typedef struct tl_modbus_values {
    uint8_t bits[TL_MODBUS_MAX_BITS];
    uint16_t registers[TL_MODBUS_MAX_REGISTERS];
} tl_modbus_values;

/* A request by TCP. */
typedef struct tl_modbus_question {
    const tl_modbus_read *read;
    uint16_t transaction;
    bool any_unit_id; /* the answer may have another unit */
} tl_modbus_question;

/* Bytes of values in the answer to a request. */
size_t tl_modbus_value_bytes(const tl_modbus_read *read);

/* The request without the parts that TCP or a line adds. */
void tl_modbus_put_body(const tl_modbus_read *read, uint8_t request[TL_MODBUS_BODY_REQUEST]);

void tl_modbus_put_request(const tl_modbus_question *asked, uint8_t request[TL_MODBUS_TCP_REQUEST]);

/* Checks the first `size` bytes from TCP. *missing: bytes needed before the check can continue;
 * never beyond the end of the answer, nor beyond TL_MODBUS_TCP_ANSWER bytes in all. 0: the outcome
 * is final. */
tl_modbus_outcome tl_modbus_check_tcp(const tl_modbus_question *asked, const uint8_t *answer, size_t size,
                                      size_t *missing);

/* Checks a whole answer from a line: unit, function and so on, without check sum, at least 3 bytes.
 */
tl_modbus_outcome tl_modbus_check_rtu(const tl_modbus_read *asked, const uint8_t *answer, size_t size);

/* Decodes `bytes`, tl_modbus_value_bytes() of them. */
void tl_modbus_take_values(const tl_modbus_read *read, const uint8_t *bytes, tl_modbus_values *values);

/* ---- Transport below the Modbus driver: TCP (modbus_tcp.c) or serial line (modbus_rtu.c). Private
 * to the driver.
 *
 * Purpose: sends one request and waits for its response; any thread can end the wait.
 * Owner:   one thread makes, connects, checks, asks, closes, releases; any thread may call `wake`.
 * Failures: done() reports a failed request before the next one, so that late bytes are not taken
 *           for another answer: TCP opens a new connection, a serial line is read until it is
 *           quiet.
 */

enum { TL_MODBUS_LINK_NAME = 160 }; /* bytes, with the end */

typedef struct tl_modbus_link tl_modbus_link;

/* Events on an open link since the last request. */
typedef enum tl_modbus_health {
    TL_MODBUS_SOUND,
    TL_MODBUS_CLOSED,   /* closed by the other end */
    TL_MODBUS_TALKATIVE /* more bytes came than were asked for */
} tl_modbus_health;

typedef struct tl_modbus_link_kind {
    /* All devices share one line: after a timeout the next unit may be asked at once on the same
     * link. */
    bool is_line;

    /* Waits at most the link's timeout. Otherwise returns false, and `cause` has the reason;
     * undefined if interrupted. */
    bool (*connect)(tl_modbus_link *link, char *cause, size_t cause_size);

    /* A link with an event must be closed before the next request, because its bytes could be taken
     * for an answer. */
    tl_modbus_health (*look)(const tl_modbus_link *link);

    /* `values` are those of the answer if the outcome is TL_MODBUS_VALUES, else undefined. */
    tl_modbus_outcome (*ask)(tl_modbus_link *link, const tl_modbus_read *read, tl_modbus_values *values);

    /* The last request failed, without values or exception: closes the link or prepares it for the
     * next request. */
    void (*failed)(tl_modbus_link *link, const tl_modbus_outcome *outcome);

    void (*close)(tl_modbus_link *link);

    /* Closes and frees the link. */
    void (*release)(tl_modbus_link *link);
} tl_modbus_link_kind;

struct tl_modbus_link {
    const tl_modbus_link_kind *kind;
    char name[TL_MODBUS_LINK_NAME]; /* for messages: "Modbus server HOST:PORT" */
    tl_time timeout;                /* ns; of one response */
    int descriptor;                 /* −1: not connected */
    tl_wake wake;                   /* of the thread that connects or asks */
};

/* Makes a TCP link to an address or name; NULL with errno if a resource is missing. Does not
 * connect. any_unit_id: answers may have another unit than the request. */
tl_modbus_link *tl_modbus_tcp_make(const char *host, uint16_t port, bool any_unit_id, tl_time timeout);

/* Makes a serial link in the same way. */
tl_modbus_link *tl_modbus_rtu_make(const tl_modbus_line *line, tl_time timeout);

/* For both kinds: settings of the common part. */
typedef struct tl_modbus_link_settings {
    const tl_modbus_link_kind *kind;
    tl_time timeout;  /* ns; of one response */
    const char *name; /* for messages; copied */
} tl_modbus_link_settings;

/* Not connected. Returns false with errno if a resource is missing; then done() is not needed. */
bool tl_modbus_link_init(tl_modbus_link *link, const tl_modbus_link_settings *settings);
void tl_modbus_link_done(tl_modbus_link *link);

/* Waits for one of `events` (of poll()) on `descriptor`, or its end. Returns 0 or errno: ETIMEDOUT,
 * EINTR after a `wake` call. */
int tl_modbus_link_await(const tl_modbus_link *link, int descriptor, short events, tl_time deadline);

#endif
