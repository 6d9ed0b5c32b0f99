/* Private folder: temporary files of one process. Other users cannot read it, and it is removed
 * when the process has ended.
 *
 * Purpose: makes a new folder twinlock-KIND-PID-XXXXXX in $TMPDIR (default: /tmp), mode 0700, and
 *          locks it while it is in use. Before that, removes older folders of the same kind that
 *          are not locked and whose process has ended.
 * Trust:   the contents may be hostile. Removing follows no links, opens folders whatever their
 *          mode, and needs constant memory and descriptors for any depth and number of files.
 * Parent:  a confined process may not remove files. So it calls tl_private_folder_leave(), and its
 *          parent removes its folders.
 * Owner:   the caller owns the struct, which must not move until the folder is removed.
 * Errors:  TL_TRY_AGAIN if space or descriptors are missing, or if TMPDIR cannot be used.
 * Thread:  one thread at a time per folder.
 */
#ifndef TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H
#define TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H

#include <limits.h>
#include <stdint.h>

#include "master/base/status.h"

enum { TL_PRIVATE_FOLDER_ROOM = 1026 }; /* bytes of PATH_MAX that `path` leaves free, for file names */

/* Zeroed: no folder. */
typedef struct tl_private_folder {
    char path[PATH_MAX]; /* absolute, no links, no slash at the end; "": no folder */
    int descriptor;      /* the open folder; it holds the lock (flock) */
} tl_private_folder;

/* Makes a folder. `kind`: letters, for example "fmu". `user`: ID of a group that gets access too
 * (mode 0770), which needs root; 0: no group. After a failure no folder is left. */
tl_status tl_private_folder_make(const char *kind, uint32_t user, tl_private_folder *folder, tl_error *error);

/* Removes the folder and its contents; after tl_private_folder_leave() only closes it. A struct
 * without a folder is allowed. */
void tl_private_folder_remove(tl_private_folder *folder);

/* Removes the folders of this kind whose process was killed, as tl_private_folder_make() does. If a
 * child that is just ending still holds the lock of a folder, waits up to 0.5 s for the lock. */
void tl_private_folder_sweep(const char *kind);

/* From now on the parent process removes the folders of this process. So tl_private_folder_make()
 * removes no old folders, and tl_private_folder_remove() only closes the descriptor. Call it before
 * the first folder is made, while there is one thread. */
void tl_private_folder_leave(void);

#endif
