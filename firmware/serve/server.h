/* Main loop of the server: connections, requests, answers, audit.
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

/* The server copies the structure. All that it points to must stay valid until tl_server_close().
 */
typedef struct tl_server_settings {
    int listener;       /* a listening, nonblocking socket; the caller closes it */
    const char *folder; /* of the plants' control sockets: TL_CONTROL_FOLDER */
    const char *tokens; /* file of the tokens, which may change at any time */
    const tl_certificate *certificate;
    const tl_host_names *names;
} tl_server_settings;

/* Starts the server. Errors: TL_TRY_AGAIN if memory or descriptors are missing, or GnuTLS rejects
 * the certificate. */
tl_status tl_server_open(const tl_server_settings *settings, tl_server **server, tl_error *error);

/* Waits for events at most `most` ns, and processes them. */
void tl_server_turn(tl_server *server, tl_time most);

/* Closes all connections and frees the server. NULL is allowed. */
void tl_server_close(tl_server *server);

#endif
