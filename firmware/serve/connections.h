/* Table of the client connections: limits their number, and selects connections to close.
 *
 * Purpose: a client that opens many connections, or is slow on purpose, must not block others. The
 *          number of connections is limited, in total and for each address. The caller sets a
 *          deadline for each connection.
 * Rule:    if all entries are used, an old connection is closed for a new one: the oldest of the
 *          address with the most connections. If the limit of the new client's address is reached,
 *          the oldest connection of this address is closed. A connection with a valid token is
 *          never closed for another one, only at its deadline.
 * Safe:    in its first second a connection is not closed for another one, so that its client can
 *          finish a request. Exception: all entries are used, and the address of the old connection
 *          has more connections than that of the new client, the new one included.
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
    bool is_known; /* it has sent a valid token; set by the caller */
    tl_address address;
    tl_time since;    /* when it was added, ns */
    tl_time deadline; /* set by the caller, ns; TL_TIME_NEVER: none */
} tl_connection_entry;

/* Starts as zeros. */
typedef struct tl_connections {
    tl_connection_entry rows[TL_CONNECTIONS];
} tl_connections;

/* Adds a connection, at first without a token and without a deadline. Returns its index, or −1 if
 * there is no room. Then, if *evicted is not −1, the caller must close the connection of that
 * index, call tl_connections_leave(), and add the new one again. If *evicted is −1, it must close
 * the new connection. */
int tl_connections_admit(tl_connections *connections, const tl_address *address, tl_time now, int *evicted);

/* Frees the entry. The caller closes the socket. */
void tl_connections_leave(tl_connections *connections, int index);

/* Returns the first index from `first` on whose deadline has expired; −1: none. */
int tl_connections_overdue(const tl_connections *connections, int first, tl_time now);

/* Returns the earliest deadline; TL_TIME_NEVER: none. */
tl_time tl_connections_next(const tl_connections *connections);

#endif
