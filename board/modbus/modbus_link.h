/* A connection to a Modbus server: serial line or TCP, frames and their answers.
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

/* ---- A serial line that Modbus (RTU) is spoken on, as it is configured.
 *
 * Purpose: the parameters that all devices of the line share, and which of them there can be. 8 data bits always.
 * Owner:   the device's name belongs to the caller. Thread: any.
 * Source:  MODBUS over Serial Line 1.02, section 2.5.1.
 */

typedef struct tl_modbus_line {
    const char *device; /* a path, best one that stays: /dev/serial/by-id/… */
    uint32_t baud;      /* one of tl_modbus_bauds */
    char parity;        /* 'N', 'E', 'O' */
    uint8_t stop_bits;  /* 1, 2 */
    bool rs485;         /* the port's driver shall switch between sending and receiving (TIOCSRS485) */
} tl_modbus_line;

/* The speeds there are, rising, up to a 0. */
extern const uint32_t tl_modbus_bauds[];

/* TL_BAD_DATA for a line that there cannot be, or whose device has no name. Opens nothing. */
tl_status tl_modbus_line_check(const tl_modbus_line *line, tl_error *error);

/* ---- Modbus requests and answers as bytes. Private to the Modbus driver.
 *
 * Purpose: pure functions: the bytes of a request, and whether bytes that came are the answer to it. Whoever is at the other
 *          end, nothing of an answer is taken unless all that can be checked has been: transaction, protocol, length, unit,
 *          function, number of bytes.
 * Bound:   nothing behind `size` is read.
 * Source:  MODBUS Application Protocol 1.1b3, sections 4 to 7; MODBUS Messaging on TCP/IP 1.0b, section 3.1.3.
 */

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

/* ---- What is below the Modbus driver: a TCP connection (modbus_tcp.c) or a serial line (modbus_rtu.c). Private to the driver.
 *
 * Purpose: asks one request and waits for its response; any other thread can end the wait.
 * Owner:   one thread makes, connects, looks, asks, closes, releases; any other may call `wake`.
 * Discipline: a failure that is no exception is told by failed() before the next request, so that what still
 *          arrives of the old response is not taken for the answer to another: TCP begins a new connection, a serial line is
 *          listened to until it is quiet.
 */

enum { TL_MODBUS_LINK_NAME = 160 }; /* bytes, the end included */

typedef struct tl_modbus_link tl_modbus_link;

/* What has happened to an open link since it was asked last. */
typedef enum tl_modbus_health {
    TL_MODBUS_SOUND,
    TL_MODBUS_GONE,     /* closed by the other end */
    TL_MODBUS_TALKATIVE /* more came than was asked for */
} tl_modbus_health;

typedef struct tl_modbus_link_kind {
    /* Devices are asked in turn on one line: after silence the next unit may be asked at once, over the same link. */
    bool is_line;

    /* Waits at most the link's timeout. Else false, and `cause` says why; the cause means nothing where it was
     * interrupted. */
    bool (*connect)(tl_modbus_link *link, char *cause, size_t cause_size);

    /* What is not sound must be closed before it is asked: what came could be taken for an answer. */
    tl_modbus_health (*look)(const tl_modbus_link *link);

    /* `values` are those of the answer where the outcome is TL_MODBUS_VALUES, else anything. */
    tl_modbus_outcome (*ask)(tl_modbus_link *link, const tl_modbus_read *read, tl_modbus_values *values);

    /* The last request came to this, neither values nor an exception: closes the link, or makes it ready for another. */
    void (*failed)(tl_modbus_link *link, const tl_modbus_outcome *outcome);

    void (*close)(tl_modbus_link *link);

    /* Closes, and frees what the kind has added, and the link. */
    void (*release)(tl_modbus_link *link);
} tl_modbus_link_kind;

struct tl_modbus_link {
    const tl_modbus_link_kind *kind;
    char name[TL_MODBUS_LINK_NAME]; /* for people: "Modbus server HOST:PORT" */
    tl_time timeout;                /* ns; of one response */
    int descriptor;                 /* −1: not connected */
    tl_wake wake;                   /* of a thread that connects or asks */
};

/* To an address or name; NULL where a resource is missing, errno says which. Does not connect. any_unit_id: answers may name
 * another unit than was asked. */
tl_modbus_link *tl_modbus_tcp_make(const char *host, uint16_t port, bool any_unit_id, tl_time timeout);

/* To a serial line; the same. */
tl_modbus_link *tl_modbus_rtu_make(const tl_modbus_line *line, tl_time timeout);

/* For the kinds: what they begin the part that all have with. */
typedef struct tl_modbus_link_settings {
    const tl_modbus_link_kind *kind;
    tl_time timeout;  /* ns; of one response */
    const char *name; /* for people; copied */
} tl_modbus_link_settings;

/* Not connected. false if a resource is missing, and errno says which; nothing needs to be
 * done() then. */
bool tl_modbus_link_init(tl_modbus_link *link, const tl_modbus_link_settings *settings);
void tl_modbus_link_done(tl_modbus_link *link);

/* Waits until `descriptor` has one of `events` (of poll()), or is hung up. 0, or errno: ETIMEDOUT, EINTR if `wake` was
 * called. */
int tl_modbus_link_await(const tl_modbus_link *link, int descriptor, short events, tl_time deadline);

#endif
