/* Main loop of the HTTPS server: connections, requests and answers. Logs who requests a change.
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
    int listener;       /* a listening, nonblocking socket; the caller closes it after tl_server_close() */
    const char *folder; /* folder of the plants' control sockets; usually TL_CONTROL_FOLDER */
    const char *tokens; /* path of the token file, which is read again when it has changed */
    const tl_certificate *certificate;
    const tl_host_names *names; /* names of this server, to check the Host header of requests (address.h) */
} tl_server_settings;

/* Starts the server. Errors: TL_TRY_AGAIN if memory or a descriptor is missing, or if GnuTLS
 * rejects the certificate; libmicrohttpd does not report which. */
tl_status tl_server_open(const tl_server_settings *settings, tl_server **server, tl_error *error);

/* Waits for events and processes them. `longest_wait`: ns, ≥ 0. Errors are logged. */
void tl_server_turn(tl_server *server, tl_time longest_wait);

/* Closes all connections and frees the server. NULL is allowed. */
void tl_server_close(tl_server *server);

#endif
