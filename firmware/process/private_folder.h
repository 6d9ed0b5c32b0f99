/* Private folder: temporary files of one process, which other users cannot read and which are
 * removed when the process has ended.
 *
 * Purpose: makes a new folder twinlock-KIND-PID-XXXXXX in $TMPDIR or /tmp, mode 0700, and locks it
 *          while it is in use. First removes unlocked folders of the same kind whose process has
 *          ended.
 * Trust:   the contents may be hostile. Removing follows no links, opens folders whatever their
 *          mode, and needs constant memory and descriptors for any depth and number of files.
 * Another: a process that may not remove files leaves this to its parent, which has given it a
 *          folder: tl_private_folder_leave().
 * Owner:   the caller owns the struct, which must not move until the folder is removed.
 * Errors:  TL_TRY_AGAIN if space or descriptors are missing, or if TMPDIR is no folder.
 * Thread:  one thread at a time per folder.
 */
#ifndef TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H
#define TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H

#include <limits.h>
#include <stdint.h>

#include "master/base/status.h"

enum { TL_PRIVATE_FOLDER_ROOM = 1026 }; /* bytes that PATH_MAX leaves for names below it */

/* Zeroed: no folder. */
typedef struct tl_private_folder {
    char path[PATH_MAX]; /* absolute, no links, no slash at the end; "": no folder */
    int descriptor;      /* of the folder, which it locks */
} tl_private_folder;

/* Makes a folder. `kind`: letters, for example "fmu". `user`: ID of the group that may use it as
 * well, which needs root; 0: none. Removes all on failure. */
tl_status tl_private_folder_make(const char *kind, uint32_t user, tl_private_folder *folder, tl_error *error);

/* Removes the folder and its contents. After tl_private_folder_leave() it is only closed. A struct
 * without a folder is allowed. */
void tl_private_folder_remove(tl_private_folder *folder);

/* Removes the folders of this kind whose process was killed, as tl_private_folder_make() does.
 * Waits up to 0.5 s for one that a dying child still locks. */
void tl_private_folder_sweep(const char *kind);

/* From now on a parent process removes the folders of this process: making removes no old ones, and
 * removing only closes. Call it before the first folder is made, while there is one thread. */
void tl_private_folder_leave(void);

#endif
