/* A private folder: for files of one process that nobody else may see, and that do not outlive it.
 *
 * Purpose: a fresh folder in $TMPDIR or /tmp, named twinlock-KIND-PID-XXXXXX, mode 0700, and locked as long as it is used. Making one first
 *          removes those of its kind whose process is gone and whose lock is free.
 * Trust:   what is in it may have been put there by an enemy: links are not followed, folders that forbid it are opened all the same,
 *          and neither their depth nor the number of files costs memory or descriptors.
 * Another: a process that may not remove files leaves that to the one that started it and has given it a folder: tl_private_folder_leave().
 * Owner:   the caller places a folder; it must stay where it is until it is removed.
 * Errors:  TL_TRY_AGAIN: space or descriptors are missing, or TMPDIR is no folder.
 * Thread:  one thread at a time for each folder.
 */
#ifndef TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H
#define TL_FIRMWARE_PROCESS_PRIVATE_FOLDER_H

#include <limits.h>
#include <stdint.h>

#include "master/base/status.h"

enum { TL_PRIVATE_FOLDER_ROOM = 1026 }; /* bytes that a path has left below it */

/* A zeroed one is none. */
typedef struct tl_private_folder {
    char path[PATH_MAX]; /* absolute, without links and without a slash at the end; "" where there is none */
    int descriptor;      /* of the folder, which it locks */
} tl_private_folder;

/* `kind`: letters, "fmu". `user`: who shares it, as the group of that number, which takes root; 0: nobody. On failure nothing remains. */
tl_status tl_private_folder_make(const char *kind, uint32_t user, tl_private_folder *folder, tl_error *error);

/* Removes it with all that is in it, unless it is left to another process: then it is only closed. None is allowed. */
void tl_private_folder_remove(tl_private_folder *folder);

/* Removes the folders of this kind whose process was killed, as making one does. Waits up to 0.5 s for one that a dying child still locks. */
void tl_private_folder_sweep(const char *kind);

/* From now on folders are made in one that another process removes with all that is in it: making sweeps nothing, and removing only closes. Before
 * the first is made, while there is one thread. */
void tl_private_folder_leave(void);

#endif
