/* Opens the binary of an FMU and the libraries that it needs.
 *
 * Thread:  see each section.
 */
#ifndef TL_FIRMWARE_FMU_FMU_BINARY_H
#define TL_FIRMWARE_FMU_FMU_BINARY_H

#include "firmware/fmu/fmu_guard.h"
#include "master/base/status.h"
#include "master/fmi/model.h"

/* ---- Shared libraries that an FMU's binary expects in the program.
 *
 * Purpose: the binaries of some exporters use symbols of a library that they do not open
 *          themselves. For example, PythonFMU's binaries and the extension modules of Python use
 *          libpython. So such a library is opened with global symbols before the FMU is opened.
 * Owner:   the process. A library is never closed, because an interpreter that has run cannot be
 *          unloaded safely. The exit handlers of open libraries run at the end of the process
 *          (process_end.h).
 * Trust:   opening a library executes its code, as opening an FMU does.
 * Thread:  one thread at a time.
 */

/* Opens the library `path`, which may be open already. The loader searches for a `path` without a
 * slash. With a Python library, sets OPENBLAS_NUM_THREADS=1 if the variable is missing, because
 * threads of NumPy would prevent rollback by memory.
 * Errors:  TL_BAD_DATA if the library cannot be opened, or if it is a second Python library: all
 *          FMUs would use the symbols of the first one. TL_TRY_AGAIN if memory or descriptors are
 *          missing. */
tl_status tl_library_open(const char *path, tl_error *error);

/* ---- Finds, checks and opens the binary of an unpacked FMU.
 *
 * Purpose: fills a guard with the FMU's functions. ELF class, byte order, machine and file type are
 *          checked before the binary is opened, so that the error can name the problem.
 * Owner:   the process. A binary is never closed: it may have started threads or registered exit
 *          handlers, and their code would be unmapped.
 * Errors:  TL_BAD_DATA: the text names the binary, what was found and what this machine needs.
 *          TL_TRY_AGAIN if the folder is mounted noexec, or if descriptors, memory or disk are
 *          missing.
 * Thread:  one: the thread that calls the FMU's functions.
 */

/* Opens the binary and fills the guard. `folder`: absolute path of the completely unpacked FMU,
 * because the binary may load libraries from that folder. `label` names the FMU in errors. If no
 * binary has the name modelIdentifier, uses and logs the only binary in the folder for this
 * machine, or one whose name differs in letter case only. Libraries that share a name with those of
 * another FMU are replaced by renamed copies first (own_copies.h). State functions are NULL in the
 * guard's table if the model description does not declare them. */
tl_status tl_fmu_binary_open(const char *folder, const tl_model *model, const char *label, tl_fmu_guard *guard,
                             tl_error *error);

/* Assigns the library `path`, opened by tl_library_open(), to the open FMU in `folder`. Then copies
 * of the FMU's memory contain the library's data, unless another FMU uses the library too. */
void tl_library_claim(const char *path, const char *folder, const tl_fmu_guard *guard);

#endif
