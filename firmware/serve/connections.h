/* Table of the client connections: limits their number, and selects connections to close.
 *
 * Purpose: a client that opens many connections, or is slow on purpose, must not block other
 *          clients. The number of connections is limited, in total and for each address
 *          (address.h). The caller sets a deadline for each connection.
 * Rule:    only a connection without a valid token is closed for a new one. If the new client's
 *          address has reached its limit, the address's oldest such connection is closed. If all
 *          entries are used, the oldest such connection of the address with the most connections is
 *          closed.
 * Safe:    a connection is not closed for a new one in its first second, so that its client can
 *          finish a request. Exception: all entries are used, and the old connection's address has
 *          more connections than the new client's address would have with the new one.
 * Thread:  one; times are monotonic. The functions do not use sockets.
 */
#ifndef TL_FIRMWARE_SERVE_CONNECTIONS_H
#define TL_FIRMWARE_SERVE_CONNECTIONS_H

#include <stdbool.h>

#include "firmware/serve/address.h"
#include "master/base/simtime.h"

/* Maximum numbers of connections: in total, and of one address. */
enum { TL_CONNECTIONS = 64, TL_CONNECTIONS_OF_ADDRESS = 8 };

typedef struct tl_connection_entry {
    bool is_there;
    bool is_known; /* its client has sent a valid token; set by the caller */
    tl_address address;
    tl_time since;    /* instant when it was added, ns */
    tl_time deadline; /* instant, set by the caller, ns; TL_TIME_NEVER: none */
} tl_connection_entry;

/* Starts as zeros. */
typedef struct tl_connections {
    tl_connection_entry rows[TL_CONNECTIONS];
} tl_connections;

/* Adds a connection, at first without a token and without a deadline. Returns its index, or −1 if
 * there is no room. In the latter case *evicted is the index of an old connection: the caller must
 * close it, call tl_connections_leave(), and add the new connection again. If *evicted is −1 too,
 * the caller must close the new connection. */
int tl_connections_admit(tl_connections *connections, const tl_address *address, tl_time now, int *evicted);

/* Frees the entry of a connection. The caller closes the socket. */
void tl_connections_leave(tl_connections *connections, int index);

/* Returns the first index, from `first` on, of a connection whose deadline has passed; −1: none. */
int tl_connections_overdue(const tl_connections *connections, int first, tl_time now);

/* Returns the earliest deadline; TL_TIME_NEVER: none. */
tl_time tl_connections_next(const tl_connections *connections);

#endif
