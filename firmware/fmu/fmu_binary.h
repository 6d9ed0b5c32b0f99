/* The binary of an FMU: opening it and the libraries that it needs.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_FMU_FMU_BINARY_H
#define TL_FIRMWARE_FMU_FMU_BINARY_H

#include "firmware/fmu/fmu_guard.h"
#include "master/base/status.h"
#include "master/fmi/model.h"

/* ---- Shared libraries that an FMU's binary expects the program to have.
 *
 * Purpose: an exporter may leave symbols to the host that are not in the FMU: PythonFMU's binaries, and the extension modules
 *          that Python loads for them, take those of libpython from whoever has it. So such a library is opened with its
 *          symbols for everybody, before the FMU is.
 * Owner:   the process. Nothing closes a library again: an interpreter that has run cannot be unloaded safely.
 *          Where one is open, its exit handlers run at the end of the process (process_end.h).
 * Trust:   opening a library executes code of it, as opening an FMU does.
 * Thread:  one thread at a time.
 */

/* `path` without a slash is looked up by the loader. Opening one that is open is allowed.
 * Errors:  TL_BAD_DATA where it cannot be opened, and where it is a Python beside another one: the symbols of the first
 *          would hide its own, and all FMUs would run in that. TL_TRY_AGAIN where memory or descriptors are missing. */
tl_status tl_library_open(const char *path, tl_error *error);

/* ---- Finds, checks and opens the binary of an unpacked FMU.
 *
 * Purpose: from a folder to a guard with its functions. What can be checked without running the binary (ELF class, byte order,
 *          machine, kind) is checked before it is opened, so that the text can say what is wrong with it.
 * Owner:   the process. A binary is never closed: it may have left threads behind, or registered what runs at the end, and both would
 *          be in memory that is gone.
 * Errors:  TL_BAD_DATA; the text names the binary, what was found and what this machine needs. TL_TRY_AGAIN where
 *          the folder is mounted noexec, or descriptors, memory or disk are missing.
 * Thread:  one thread, that which calls the FMU's functions.
 */

/* `folder` is that of the unpacked FMU, absolute. The whole folder of the binary must be there: it may load its
 * neighbours. What it shares a name with another FMU's is made its own before (own_copies.h). Optional functions that the model does not claim are NULL in the table. */
tl_status tl_fmu_binary_open(const char *folder, const tl_model *model, const char *label, tl_fmu_guard *guard,
                             tl_error *error);

#endif
