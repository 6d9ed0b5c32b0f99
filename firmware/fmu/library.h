/* Shared libraries that an FMU's binary expects the program to have.
 *
 * Purpose: an exporter may leave symbols to the host that are not in the FMU: PythonFMU's binaries, and the extension modules
 *          that Python loads for them, take those of libpython from whoever has it. So such a library is opened with its
 *          symbols for everybody, before the FMU is.
 * Owner:   the process. Nothing closes a library again: an interpreter that has run cannot be unloaded safely.
 *          Where one is open, its exit handlers run at the end of the process (process_end.h).
 * Trust:   opening a library executes code of it, as opening an FMU does.
 * Thread:  one thread at a time.
 */
#ifndef TL_FIRMWARE_FMU_LIBRARY_H
#define TL_FIRMWARE_FMU_LIBRARY_H

#include "master/base/status.h"

/* `path` without a slash is looked up by the loader. Opening one that is open is allowed.
 * Errors:  TL_BAD_DATA where it cannot be opened, and where it is a Python beside another one: the symbols of the first
 *          would hide its own, and all FMUs would run in that. TL_TRY_AGAIN where memory or descriptors are missing. */
tl_status tl_library_open(const char *path, tl_error *error);

#endif
