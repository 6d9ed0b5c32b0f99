/* What io and the recorder give up: all files and system calls that their work does not need.
 *
 * Purpose: neither has an FMU. But io understands what whoever sits on the plant's network says, and the recorder a file that anybody may have written: a hole
 *          in one of them must not be a way into the other, or anywhere else.
 * io:      opens what its kinds of sources need: TCP to their ports (and names of hosts, if they are looked up), CAN, serial lines, GPIO lines, or CSV
 *          files. It writes no file.
 * Recorder: writes in the folder of the database, reads the FMUs' files (whose digests it records). It has no socket.
 * Neither:  starts a program, listens, traces, or signals another process.
 * Missing: what the kernel does not offer is passed over, as for the twin, which tells it.
 * Thread:  the main thread, before any other is started. Errors: TL_TRY_AGAIN.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_PLACES_H
#define TL_FIRMWARE_LIVE_LIVE_PLACES_H

#include "firmware/config/config.h"
#include "master/base/status.h"

/* `kinds`: of the sources that this process reads (live_plant.h). */
tl_status tl_live_places_confine_io(const tl_config *config, unsigned kinds, tl_error *error);

/* `database`: the path of its file. */
tl_status tl_live_places_confine_recorder(const tl_config *config, const char *database, tl_error *error);

#endif
