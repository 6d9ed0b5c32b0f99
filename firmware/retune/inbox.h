/* The inbox: a folder into which somebody puts configurations, as by SFTP, for a running plant's twin.
 *
 * Purpose: `twinlock inbox`. Each file goes to the run by its control socket, like what `twinlock reload` sends, with the right to retune and no other.
 * Taken:   what is complete (inbox_folder.h): NAME.json becomes NAME.json.taken first, so it is taken once at most, whatever is interrupted then.
 *          NAME.json.result.txt says what came of it, and is replaced whole: on probation first, then at the end.
 * Trust:   whoever may write into the folder. Links, FIFOs, devices, and files with another name elsewhere are not read; nothing is parsed.
 * Waiting: for the folder or the run, half a second at most, and a minute where the folder cannot be written to.
 * Thread:  the main thread of its process.
 */
#ifndef TL_FIRMWARE_RETUNE_INBOX_H
#define TL_FIRMWARE_RETUNE_INBOX_H

#include "master/base/status.h"

/* Until a signal comes (interrupt.h). `folder` and `socket` must stay. Errors: TL_BAD_DATA: there is no such folder; TL_TRY_AGAIN: it is no more. */
tl_status tl_inbox_run(const char *folder, const char *socket, tl_error *error);

#endif
