/* The TCP connection below the Modbus driver: one that can be waited for and given up. Private to the driver.
 *
 * Purpose: connects within a time, to each address a name has; any other thread can end the wait, and the wait of
 *          whoever reads from the socket.
 * Owner:   one thread makes, connects, closes, releases; tl_modbus_link_interrupt() is for any other.
 */
#ifndef TL_BOARD_IO_MODBUS_LINK_H
#define TL_BOARD_IO_MODBUS_LINK_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"

typedef struct tl_modbus_link {
    char *host;
    char service[8];
    int socket; /* −1: not connected. Written under the lock, for interrupt() */
    int wake;   /* eventfd: interrupted, and nobody has taken notice yet */
    pthread_mutex_t lock;
} tl_modbus_link;

/* false where a resource is missing; errno says which. Does not connect. */
bool tl_modbus_link_make(tl_modbus_link *link, const char *host, uint16_t port);

/* Waits at most `timeout` ns. The socket does not block. Else false, and `cause` says why; the cause means nothing
 * where it was interrupted. */
bool tl_modbus_link_connect(tl_modbus_link *link, tl_time timeout, char *cause, size_t cause_size);

/* true where something comes while nothing was asked for: the other side has closed, or talks out of turn. */
bool tl_modbus_link_stray(const tl_modbus_link *link);

void tl_modbus_link_close(tl_modbus_link *link);

/* Any thread: ends the waiting of the thread that connects or reads, or else its next one. */
void tl_modbus_link_interrupt(tl_modbus_link *link);

/* Was it interrupted? Takes notice of it, so that the next call says no. */
bool tl_modbus_link_interrupted(tl_modbus_link *link);

void tl_modbus_link_release(tl_modbus_link *link);

/* CLOCK_MONOTONIC in ns. */
tl_time tl_modbus_link_now(void);

#endif
