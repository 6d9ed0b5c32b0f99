/* The server's loop: connections, requests, answers, audit.
 *
 * Thread:  the server's.
 */
#ifndef TL_FIRMWARE_SERVE_SERVER_H
#define TL_FIRMWARE_SERVE_SERVER_H

#include "firmware/serve/address.h"
#include "firmware/serve/certificate.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_server tl_server;

/* All of it lives as long as the server. */
typedef struct tl_server_settings {
    int listener;       /* listens, does not block; stays the caller's */
    const char *folder; /* of plants: TL_CONTROL_FOLDER */
    const char *tokens; /* the file of them, which may change at any time */
    const tl_certificate *certificate;
    const tl_host_names *names;
} tl_server_settings;

/* TL_TRY_AGAIN: memory or descriptors are missing. */
tl_status tl_server_open(const tl_server_settings *settings, tl_server **server, tl_error *error);

/* Does what there is to do; waits for it at most so long (ns). */
void tl_server_turn(tl_server *server, tl_time most);

/* Ends all connections. NULL is allowed. */
void tl_server_close(tl_server *server);

#endif
