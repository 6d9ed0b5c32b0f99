/* Unpacks an FMU, a ZIP file from a stranger, into a fresh folder of its own.
 *
 * Purpose: nothing is created outside of that folder, and nothing remains when unpacking fails. Folders are
 *          private ones (private_folder.h) of the kind "fmu"; each unpacking first removes those that killed processes left.
 * Limits:  below; bytes are counted as they are written, whatever sizes the archive claims. Only stored and deflated
 *          entries, as FMI demands. Refused: absolute paths, drive letters, "..", symbolic links and devices, encrypted
 *          entries, a name twice, control characters in names. Backslashes are taken for separators.
 * Skipped: documentation/, sources/ and binaries of other systems are checked by name, and only folders are created
 *          for them: they would fill the memory of a small box.
 * Errors:  TL_BAD_DATA for anything wrong in the file, TL_TRY_AGAIN where disk, memory or descriptors are missing.
 * Thread:  one thread at a time for each folder.
 */
#ifndef TL_FIRMWARE_FMU_FMU_ARCHIVE_H
#define TL_FIRMWARE_FMU_FMU_ARCHIVE_H

#include "firmware/process/private_folder.h"
#include "master/base/status.h"

enum {
    TL_FMU_FILE_BYTES = 1024 * 1024 * 1024,  /* of the FMU itself */
    TL_FMU_TOTAL_BYTES = 1024 * 1024 * 1024, /* unpacked */
    TL_FMU_ENTRY_BYTES = 512 * 1024 * 1024,  /* one entry, unpacked */
    TL_FMU_ENTRIES = 10000,
    TL_FMU_ENTRY_PATH = 1024, /* bytes in the path of an entry */
    TL_FMU_ENTRY_DEPTH = 64,  /* folders in it */
    /* Unpacked more than this, an archive may not have grown by more than this factor. */
    TL_FMU_RATIO_FROM_BYTES = 16 * 1024 * 1024,
    TL_FMU_RATIO = 200
};

/* `opened`: the file's descriptor, if it was opened before (by a process that may not open it any more); -1: it is opened by its path.
 * `label` names the FMU in errors. On failure there is no folder and nothing remains; else the caller removes it. */
tl_status tl_fmu_archive_unpack(const char *path, int opened, const char *label, tl_private_folder *folder,
                                tl_error *error);

#endif
