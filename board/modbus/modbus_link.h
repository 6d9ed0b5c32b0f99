/* What is below the Modbus driver: a TCP connection (modbus_tcp.c) or a serial line (modbus_rtu.c). Private to the driver.
 *
 * Purpose: asks one request and waits for its response; any other thread can end the wait.
 * Owner:   one thread makes, connects, looks, asks, closes, releases; any other may call `wake`.
 * Discipline: a failure that is no exception is told by failed() before the next request, so that what still
 *          arrives of the old response is not taken for the answer to another: TCP begins a new connection, a serial line is
 *          listened to until it is quiet.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_LINK_H
#define TL_BOARD_MODBUS_MODBUS_LINK_H

#include "board/io/wake.h"
#include "board/modbus/modbus_frame.h"
#include "board/modbus/modbus_line.h"

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
