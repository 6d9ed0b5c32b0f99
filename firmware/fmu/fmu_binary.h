/* Finds, checks and opens the binary of an unpacked FMU.
 *
 * Purpose: from a folder to a guard with its functions. What can be checked without running the binary (ELF class, byte order,
 *          machine, kind) is checked before it is opened, so that the text can say what is wrong with it.
 * Owner:   the process. A binary is never closed: it may have left threads behind, or registered what runs at the end, and both would
 *          be in memory that is gone.
 * Errors:  TL_BAD_DATA; the text names the binary, what was found and what this machine needs. TL_TRY_AGAIN where
 *          the folder is mounted noexec, or descriptors, memory or disk are missing.
 * Thread:  one thread, that which calls the FMU's functions.
 */
#ifndef TL_FIRMWARE_FMU_FMU_BINARY_H
#define TL_FIRMWARE_FMU_FMU_BINARY_H

#include "firmware/fmu/fmu_guard.h"
#include "master/base/status.h"
#include "master/fmi/model.h"

/* `folder` is that of the unpacked FMU, absolute. The whole folder of the binary must be there: it may load its
 * neighbours. What it shares a name with another FMU's is made its own before (own_copies.h). Optional functions that the model does not claim are NULL in the table. */
tl_status tl_fmu_binary_open(const char *folder, const tl_model *model, const char *label, tl_fmu_guard *guard,
                             tl_error *error);

#endif
