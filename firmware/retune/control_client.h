/* A client's dialogue with a plant, over restarts, and what is printed of it: `twinlock reload`.
 *
 * Follows: a change that takes an end and a new start of the run ends the connection. Who waits (TL_CONTROL_WAIT) asks the run that comes next how it is,
 *          until the change is kept or returned from: printed as steps and an end like any others.
 * Signals: who ends the program by SIGINT or SIGTERM while a change is under way is told on standard error that the change goes on.
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

/* The subject that is standard input. */
#define TL_CONTROL_CLIENT_INPUT "-"

typedef struct tl_control_client_settings {
    const char *path;    /* of the socket */
    FILE *output;        /* problems, and an end that is none, go to the log instead */
    const char *subject; /* what a problem is in: the name of the file */
} tl_control_client_settings;

/* Of the run whose configuration is called `subject` (/etc/twinlock/motor.json: TL_CONTROL_FOLDER/motor), unless one is given. TL_BAD_USAGE: TL_CONTROL_CLIENT_INPUT has no name. */
tl_status tl_control_client_find(const char *subject, const char *given, char path[PATH_MAX], tl_error *error);

/* `who` of a request that nobody has filled in yet: the name of a user of this box. */
void tl_control_client_name(uid_t user, char who[TL_CONTROL_NAME]);

/* Sends a request, as in control.h, and prints all replies. *result: of the last one, with TL_OK.
 * Errors: TL_PLANT_DOWN: nobody is there, or is no more; TL_TRY_AGAIN: no answer; TL_BAD_DATA: what is none. */
tl_status tl_control_client_run(const tl_control_client_settings *settings, const tl_control_request *request,
                                const char *text, size_t size, tl_control_result *result, tl_error *error);

#endif
