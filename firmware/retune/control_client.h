/* Client of a control socket for `twinlock reload`: sends a request and prints its replies.
 *
 * Restart: if a change restarts the run, the run closes the connection. With TL_CONTROL_WAIT, the
 *          client then queries the next run once a second until the change is kept or rolled back,
 *          and prints the result. The client fails if no run answers for 60 s.
 * Signals: SIGINT and SIGTERM end the client, but not a change. The client then prints to standard
 *          error that the change continues. tl_control_client_run() sets the handlers.
 * Thread:  one, the main thread.
 */
#ifndef TL_FIRMWARE_RETUNE_CONTROL_CLIENT_H
#define TL_FIRMWARE_RETUNE_CONTROL_CLIENT_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/types.h>

#include "firmware/retune/control.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* Value of `subject` if the configuration comes from standard input. */
#define TL_CONTROL_CLIENT_INPUT "-"

typedef struct tl_control_client_settings {
    const char *path;    /* of the socket */
    FILE *output;        /* receives the replies as text; problems and failures are logged instead */
    const char *subject; /* name of the configuration file, for messages about problems */
} tl_control_client_settings;

/* Writes the path of the socket: `given`, or if that is NULL, the socket of the run with the
 * configuration file `subject` (/etc/twinlock/motor.json: TL_CONTROL_FOLDER/motor/control). Errors:
 * TL_BAD_USAGE if `subject` is TL_CONTROL_CLIENT_INPUT and `given` is NULL, or if the path is too
 * long. */
tl_status tl_control_client_find(const char *subject, const char *given, char path[PATH_MAX], tl_error *error);

/* Writes the name of a user of this box, or "user UID"; for `who` of a request. */
void tl_control_client_name(uid_t user, char who[TL_CONTROL_NAME]);

/* Sends a request, as tl_control_ask() does, and prints all replies. `request` must not be a
 * TL_CONTROL_READ, because the client cannot print its reply. If TL_OK is returned, *result is the
 * result of the request. Errors: TL_PLANT_DOWN if no run answers, or if the connection was closed
 * early; TL_TRY_AGAIN if no reply came in time (200 s, more with a shadow or a probation);
 * TL_BAD_DATA for an invalid reply. */
tl_status tl_control_client_run(const tl_control_client_settings *settings, const tl_control_request *request,
                                const char *text, size_t size, tl_control_result *result, tl_error *error);

#endif
