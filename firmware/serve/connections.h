/* Guests: connections that there are, how many there may be, and who has to go.
 *
 * Purpose: whoever opens connections without end, or is slow on purpose, costs others nothing: the number is bounded, in all and for each address,
 *          and each guest has a time by which it must have done what it is about.
 * Rule:    if there is no room, a stranger gives way (a guest whose token was not yet seen): one of the address that has most of them, the
 *          oldest first. One is safe for its first second, unless its address has more guests than who comes; else an honest one, too,
 *          would never get to its end. Who has shown a token is never put out, but only by its time.
 * Thread:  one; times are monotonic. Nothing is done to a socket here.
 */
#ifndef TL_FIRMWARE_SERVE_CONNECTIONS_H
#define TL_FIRMWARE_SERVE_CONNECTIONS_H

#include <stdbool.h>

#include "firmware/serve/address.h"
#include "master/base/simtime.h"

enum { TL_CONNECTIONS = 64, TL_CONNECTIONS_OF_ADDRESS = 8 };

typedef struct tl_connection_entry {
    bool is_there;
    bool is_known; /* has shown a token */
    tl_address address;
    tl_time since;
    tl_time deadline; /* TL_TIME_NEVER: none */
} tl_connection_entry;

/* Begins as zeros. */
typedef struct tl_connections {
    tl_connection_entry rows[TL_CONNECTIONS];
} tl_connections;

/* The place of who comes, who is a stranger from now on; -1: there is none. Then *gives_way is the place of a guest whose connection may be closed for
 * it, or -1: nobody gives way, and who comes is sent away. */
int tl_connections_admit(tl_connections *guests, const tl_address *address, tl_time now, int *gives_way);

void tl_connections_leave(tl_connections *guests, int place);

/* The next one, from `place` on, whose time is over; -1: none. */
int tl_connections_overdue(const tl_connections *guests, int place, tl_time now);

/* The least deadline there is; TL_TIME_NEVER: none. */
tl_time tl_connections_next(const tl_connections *guests);

#endif
