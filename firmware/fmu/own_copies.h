/* Makes the libraries of an unpacked FMU its own: no other FMU of the process has the globals that they have.
 *
 * Purpose: a component is a model of its own. But the loader knows a library by its name: the second FMU that needs libtable.so gets that of the first
 *          one, with all that is in its variables, and no word is said. And C++ has symbols that are one for the whole process. Both are changed in
 *          the files of the later FMU before the loader sees them (elf_names.h).
 * What stays: the first FMU of the process, an FMU whose names nobody else has, and what is not the FMU's: libraries of the system stay shared, by
 *          their names also those of a compiler's that an FMU brings (libc, libm, libgcc_s, libstdc++, libgfortran and their like).
 * How:     in an FMU's folder a library that is renamed is there twice, by both names: who opens it by its path finds it.
 * Unseen:  what an FMU opens itself (dlopen) by a bare name. That it might is said.
 * Owner:   the process: the loader never forgets a library, so folders that FMUs were in are remembered for good.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_OWN_COPIES_H
#define TL_FIRMWARE_FMU_OWN_COPIES_H

#include "master/base/status.h"

/* `folder`: absolute, of an FMU that is unpacked and of which nothing is loaded yet. `binary`: the path of its binary, below it. `label` names it in
 * errors. Errors: TL_TRY_AGAIN: memory, descriptors or disk are missing. TL_BAD_DATA: a name cannot be changed, as another one is part of it. */
tl_status tl_own_copies_make(const char *folder, const char *binary, const char *label, tl_error *error);

#endif
