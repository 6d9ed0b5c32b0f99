/* Table of the client connections: limits their number, and selects connections to close.
 *
 * Purpose: a client that opens many connections, or is slow on purpose, must not block others. The
 *          number of connections is limited, in total and for each address, and each connection has
 *          a deadline.
 * Rule:    if there is no free entry, a connection without a valid token is closed: of the address
 *          with the most connections the oldest. If the limit of an address is reached, one of the
 *          same address is closed. During its first second a connection is not closed, because no
 *          client could finish a request. Exception: the total is reached and its address has more
 *          connections than the new client. A connection with a valid token is closed only by its
 *          deadline.
 * Thread:  one; times are monotonic. The functions do not use sockets.
 */
#ifndef TL_FIRMWARE_SERVE_CONNECTIONS_H
#define TL_FIRMWARE_SERVE_CONNECTIONS_H

#include <stdbool.h>

#include "firmware/serve/address.h"
#include "master/base/simtime.h"

enum { TL_CONNECTIONS = 64, TL_CONNECTIONS_OF_ADDRESS = 8 };

typedef struct tl_connection_entry {
    bool is_there;
    bool is_known; /* it has sent a valid token */
    tl_address address;
    tl_time since;
    tl_time deadline; /* TL_TIME_NEVER: none */
} tl_connection_entry;

/* Starts as zeros. */
typedef struct tl_connections {
    tl_connection_entry rows[TL_CONNECTIONS];
} tl_connections;

/* Adds a connection, at first without a token. Returns its entry, or −1 if there is none. Then
 * *evicted is the entry of a connection to close for it, or −1: the new connection must be
 * closed. */
int tl_connections_admit(tl_connections *connections, const tl_address *address, tl_time now, int *evicted);

void tl_connections_leave(tl_connections *connections, int slot);

/* Returns the next entry, from `slot` on, whose deadline has expired; −1: none. */
int tl_connections_overdue(const tl_connections *connections, int slot, tl_time now);

/* Returns the earliest deadline; TL_TIME_NEVER: none. */
tl_time tl_connections_next(const tl_connections *connections);

#endif
