/* Unpacks an untrusted FMU (a ZIP file) into a new private folder.
 *
 * Purpose: creates nothing outside of that folder, and removes the folder if unpacking fails. The
 *          folder is a private folder (private_folder.h) of the kind "fmu". Each unpacking first
 *          removes the folders that ended processes have left.
 * Links:   a symbolic link to a file of the archive becomes a copy of that file. No link is ever
 *          created.
 * Limits:  see below. Bytes are counted while they are written; the sizes stated in the archive are
 *          ignored. Only stored and deflated entries are accepted, as FMI requires. Rejected:
 *          absolute paths, drive letters, "..", other symbolic links, devices, encrypted entries,
 *          duplicate names and control characters in names. A backslash counts as a separator.
 * Skipped: files in documentation/, sources/ and binaries for Windows and macOS are not written,
 *          because they would fill the memory of a small box. Their names are checked, and their
 *          folders are created.
 * Errors:  TL_BAD_DATA if the file is invalid; TL_TRY_AGAIN if disk, memory or descriptors are
 *          missing.
 * Thread:  one thread at a time for each folder.
 * Trust:   the archive is untrusted.
 */
#ifndef TL_FIRMWARE_FMU_FMU_ARCHIVE_H
#define TL_FIRMWARE_FMU_FMU_ARCHIVE_H

#include "firmware/process/private_folder.h"
#include "master/base/status.h"

enum {
    TL_FMU_FILE_BYTES = 1024 * 1024 * 1024,  /* the FMU file */
    TL_FMU_TOTAL_BYTES = 1024 * 1024 * 1024, /* all entries, unpacked */
    TL_FMU_ENTRY_BYTES = 512 * 1024 * 1024,  /* one entry, unpacked */
    TL_FMU_ENTRIES = 10000,                  /* number of entries */
    TL_FMU_ENTRY_PATH = 1024,                /* bytes of an entry's path */
    TL_FMU_ENTRY_DEPTH = 64,                 /* parts of an entry's path, between slashes */
    TL_FMU_LINKS = 8,                        /* maximum length of a chain of symbolic links */
    /* If the unpacked size exceeds TL_FMU_RATIO_FROM_BYTES, it may be at most TL_FMU_RATIO times
     * the size of the FMU file. */
    TL_FMU_RATIO_FROM_BYTES = 16 * 1024 * 1024,
    TL_FMU_RATIO = 200
};

/* Unpacks the FMU file at `path` into a new folder. `opened`: descriptor of the file if the caller
 * has opened it (for a process that may not open files any more); it stays open. -1: this function
 * opens `path`. `label` names the FMU in errors. On success the caller must later remove the folder
 * (tl_private_folder_remove()). On failure there is no folder. */
tl_status tl_fmu_archive_unpack(const char *path, int opened, const char *label, tl_private_folder *folder,
                                tl_error *error);

#endif
