/* The asking end of a control socket.
 *
 * Purpose: a connection, one request, its replies.
 * Waiting: never for longer than it is told.
 * Errors:  TL_PLANT_DOWN if nobody is there; TL_BAD_DATA for a reply that is none; TL_TRY_AGAIN for time and resources.
 * Thread:  one, one client at a time.
 */
#ifndef TL_FIRMWARE_RETUNE_CONTROL_CLIENT_H
#define TL_FIRMWARE_RETUNE_CONTROL_CLIENT_H

#include <stddef.h>

#include "firmware/retune/control_wire.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* Where the plants of a box have their sockets: TL_CONTROL_FOLDER/NAME/control. */
#define TL_CONTROL_FOLDER "/run/twinlock"
#define TL_CONTROL_SOCKET "control"

/* A connected socket, which does not block and is closed on exec; the caller's to close. */
tl_status tl_control_connect(const char *path, int *socket, tl_error *error);

/* `protocol` and `hash` are filled in; `text` is what TAKE hands over, NULL of all others. */
tl_status tl_control_ask(int socket, const tl_control_request *request, const char *text, size_t size, tl_error *error);

/* The next reply, within `time` (ns; 0: if it is there). `text`, of TL_CONTROL_MOST + 1 bytes, is filled by a TL_CONTROL_CONFIGURATION: `more` bytes, and a NUL
 * behind them. All texts of a reply end. TL_TRY_AGAIN: none came in time. TL_PLANT_DOWN: the other end is gone before TL_CONTROL_END. */
tl_status tl_control_next(int socket, tl_time time, tl_control_reply *reply, char *text, tl_error *error);

#endif
