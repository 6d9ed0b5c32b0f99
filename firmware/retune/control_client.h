/* Client of a control socket, also across restarts of the run, and its output: `twinlock reload`.
 *
 * Restart: a change that restarts the run closes the connection. A client that waits
 *          (TL_CONTROL_WAIT) queries the next run until the change is kept or rolled back. It
 *          prints steps and an end as usual.
 * Signals: if SIGINT or SIGTERM ends the program during a change, it prints to standard error that
 *          the change continues.
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

/* `subject` of standard input. */
#define TL_CONTROL_CLIENT_INPUT "-"

typedef struct tl_control_client_settings {
    const char *path;    /* of the socket */
    FILE *output;        /* receives replies; problems and failures are logged instead */
    const char *subject; /* the name of the file, for messages about problems */
} tl_control_client_settings;

/* Finds the socket: `given`, or that of the run whose configuration is `subject`
 * (/etc/twinlock/motor.json: TL_CONTROL_FOLDER/motor). Errors: TL_BAD_USAGE if `subject` is
 * TL_CONTROL_CLIENT_INPUT and `given` is NULL, or if the path is too long. */
tl_status tl_control_client_find(const char *subject, const char *given, char path[PATH_MAX], tl_error *error);

/* Writes the name of a user of this box, as the default for `who` of a request. */
void tl_control_client_name(uid_t user, char who[TL_CONTROL_NAME]);

/* Sends a request, as in control.h, and prints all replies. *result: that of the last reply, valid
 * if TL_OK is returned. Errors: TL_PLANT_DOWN if no server answers, or the connection ended early;
 * TL_TRY_AGAIN if no answer came in time; TL_BAD_DATA for an invalid reply. */
tl_status tl_control_client_run(const tl_control_client_settings *settings, const tl_control_request *request,
                                const char *text, size_t size, tl_control_result *result, tl_error *error);

#endif
