/* Connection to a Modbus server by TCP or serial line: requests and answers.
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
 * Owner:   the caller owns the text `device`. Thread: any.
 * Source:  MODBUS over Serial Line 1.02, section 2.5.1.
 */

typedef struct tl_modbus_line {
    const char *device; /* a path, preferably one that does not change: /dev/serial/by-id/… */
    uint32_t baud;      /* bit/s, one of tl_modbus_bauds */
    char parity;        /* 'N', 'E', 'O' */
    uint8_t stop_bits;  /* 1, 2 */
    bool echo;          /* true: the adapter also receives what it sends */
    bool rs485;         /* true: the port's kernel driver switches the direction (TIOCSRS485) */
} tl_modbus_line;

/* Valid speeds in bit/s, in increasing order; a 0 ends the list. */
extern const uint32_t tl_modbus_bauds[];

/* Checks the parameters; opens nothing. Errors: TL_BAD_DATA for an invalid parameter or an empty
 * `device`. */
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
    TL_MODBUS_BODY_REQUEST = 6,    /* one byte each: unit, function; two bytes each: address, count */
    TL_MODBUS_TCP_PREFIX = 6,      /* two bytes each: transaction, protocol, length of what follows */
    TL_MODBUS_TCP_REQUEST = 6 + 6, /* prefix, body */
    TL_MODBUS_TCP_ANSWER = 6 + 3 + TL_MODBUS_MAX_REGISTERS * 2, /* the longest valid answer */
    TL_MODBUS_TCP_FIRST = 6 + 3, /* the shortest: ends with the exception code or the number of bytes */
    TL_MODBUS_SUM = 2,           /* check sum at the end of a frame of a line, which has no prefix */
    TL_MODBUS_RTU_FIRST = 3      /* bytes before the values in such a frame */
};

/* Values of an answer: bits or registers, depending on the table of the request. */
typedef struct tl_modbus_values {
    uint8_t bits[TL_MODBUS_MAX_BITS];
    uint16_t registers[TL_MODBUS_MAX_REGISTERS];
} tl_modbus_values;

/* A request by TCP. */
typedef struct tl_modbus_question {
    const tl_modbus_read *read;
    uint16_t transaction;
    bool any_unit_id;        /* accept an answer with another unit */
    bool any_transaction_id; /* accept an answer with another transaction */
} tl_modbus_question;

/* Returns the number of value bytes in the answer to a request. */
size_t tl_modbus_value_bytes(const tl_modbus_read *read);

/* Writes a request without its TCP prefix or check sum. */
void tl_modbus_put_body(const tl_modbus_read *read, uint8_t request[TL_MODBUS_BODY_REQUEST]);

/* Writes a whole request for TCP. */
void tl_modbus_put_request(const tl_modbus_question *asked, uint8_t request[TL_MODBUS_TCP_REQUEST]);

/* Checks the first `size` bytes of an answer from TCP. Sets *missing to the number of bytes to
 * receive before the next check; 0: the outcome is final. `size` + *missing never exceeds the
 * length of the answer or TL_MODBUS_TCP_ANSWER. */
tl_modbus_outcome tl_modbus_check_tcp(const tl_modbus_question *asked, const uint8_t *answer, size_t size,
                                      size_t *missing);

/* The same two for frames of a line that are sent by TCP. The request also gets the check sum. A
 * wrong one in the answer is TL_MODBUS_FAILED with EMBBADCRC of libmodbus. */
void tl_modbus_put_framed(const tl_modbus_question *asked, uint8_t request[TL_MODBUS_TCP_REQUEST]);
tl_modbus_outcome tl_modbus_check_framed(const tl_modbus_question *asked, const uint8_t *answer, size_t size,
                                         size_t *missing);

/* Checks a whole answer from a line, without its check sum: unit, function and number of bytes.
 * `size` is at least 3. */
tl_modbus_outcome tl_modbus_check_rtu(const tl_modbus_read *asked, const uint8_t *answer, size_t size);

/* Converts the tl_modbus_value_bytes() value bytes of a correct answer. */
void tl_modbus_take_values(const tl_modbus_read *read, const uint8_t *bytes, tl_modbus_values *values);

/* ---- Transport below the Modbus driver: TCP (modbus_tcp.c) or serial line (modbus_rtu.c). Private
 * to the driver.
 *
 * Purpose: sends one request and waits for its response; any thread can end the wait.
 * Thread:  one thread calls all functions; any thread may call tl_wake_call() for `wake`.
 * Failures: after a failed request the driver calls failed() before the next request, so that late
 *           bytes are not taken for another answer. With TCP, failed() closes the connection. On a
 *           serial line, the next request first waits until the line is quiet.
 */

enum { TL_MODBUS_LINK_NAME = 160 }; /* bytes, including the NUL */

typedef struct tl_modbus_link tl_modbus_link;

/* What has happened on an open link since the last request. */
typedef enum tl_modbus_health {
    TL_MODBUS_SOUND,    /* nothing */
    TL_MODBUS_CLOSED,   /* closed by the other end */
    TL_MODBUS_TALKATIVE /* more bytes came than requested */
} tl_modbus_health;

/* Functions of one kind of link. */
typedef struct tl_modbus_link_kind {
    /* True for a serial line, which all its units share. After a timeout the driver may ask another
     * unit on the same link. */
    bool is_line;

    /* Connects, or opens the serial line. Waits at most the link's timeout, and to resolve a host
     * name. Returns false on failure: `cause` has the reason, but not after an interruption. */
    bool (*connect)(tl_modbus_link *link, char *cause, size_t cause_size);

    /* Checks an open link without waiting. If the result is not TL_MODBUS_SOUND, close the link
     * before the next request, because its bytes could be taken for an answer. */
    tl_modbus_health (*check)(const tl_modbus_link *link);

    /* Sends a request on an open link and waits for the answer. *values has the answer's values if
     * the outcome is TL_MODBUS_VALUES; else it is undefined. */
    tl_modbus_outcome (*ask)(tl_modbus_link *link, const tl_modbus_read *read, tl_modbus_values *values);

    /* Call it if the outcome of ask() is neither values nor an exception. Closes a TCP link, or a
     * serial port that failed. */
    void (*failed)(tl_modbus_link *link, const tl_modbus_outcome *outcome);

    /* Closes the link, which can connect again. Allowed if it is not connected. */
    void (*close)(tl_modbus_link *link);

    /* Closes and frees the link. */
    void (*release)(tl_modbus_link *link);
} tl_modbus_link_kind;

struct tl_modbus_link {
    const tl_modbus_link_kind *kind;
    char name[TL_MODBUS_LINK_NAME]; /* for messages: "Modbus server HOST:PORT" */
    tl_time timeout;                /* ns; longest wait for a connection, and for a response */
    tl_time pause;                  /* ns; after connecting, and between a response and the next request */
    tl_time pause_end;              /* end of the present pause, CLOCK_MONOTONIC, ns */
    int descriptor;                 /* −1: not connected */
    tl_wake wake;                   /* ends the wait of connect() or ask() */
};

/* A server by TCP. */
typedef struct tl_modbus_server {
    const char *host; /* name or address; copied */
    uint16_t port;
    bool any_unit_id;        /* accept answers with another unit than the request */
    bool any_transaction_id; /* accept answers with another transaction than the request */
    bool rtu_framing;        /* frames of a line instead of those of Modbus TCP */
} tl_modbus_server;

/* Creates a TCP link; does not connect. The caller frees it by kind->release(). Returns NULL with
 * errno if a resource is missing. */
tl_modbus_link *tl_modbus_tcp_make(const tl_modbus_server *server, tl_time timeout);

/* Creates a serial link in the same way. */
tl_modbus_link *tl_modbus_rtu_make(const tl_modbus_line *line, tl_time timeout);

/* Settings of the common part of both kinds. */
typedef struct tl_modbus_link_settings {
    const tl_modbus_link_kind *kind;
    tl_time timeout;  /* ns */
    const char *name; /* for messages; copied */
} tl_modbus_link_settings;

/* Initialise and release the common part of a link, which is not connected. If a resource is
 * missing, init returns false with errno; then do not call done. */
bool tl_modbus_link_init(tl_modbus_link *link, const tl_modbus_link_settings *settings);
void tl_modbus_link_done(tl_modbus_link *link);

/* Begins the pause after connecting or after a response. */
void tl_modbus_link_begin_pause(tl_modbus_link *link);

/* Waits for the end of the pause, or until the other end closes the link. Returns false after a
 * `wake` call, which stays unanswered. */
bool tl_modbus_link_await_pause(const tl_modbus_link *link);

/* Waits until poll() reports `events`, an error or a hang-up for `descriptor`. `deadline` is on
 * CLOCK_MONOTONIC, ns. Returns 0 or errno: ETIMEDOUT; EINTR after a `wake` call, which stays
 * unanswered. */
int tl_modbus_link_await(const tl_modbus_link *link, int descriptor, short events, tl_time deadline);

#endif
