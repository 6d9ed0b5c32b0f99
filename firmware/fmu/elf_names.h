/* Changes names in a shared library in memory, so that the loader takes it for another one than its original.
 *
 * Purpose: a library that the loader knows by its name already is not loaded again, whatever file is meant. A copy that is to have globals of its own
 *          is renamed, and whoever needs it asks for it by the new name.
 * Linkers keep one text for several names, and let a name begin in the midst of another. So after each change all names of the file are read again:
 *          every one must be what it was, or what it was to become.
 * Trust:   as in elf_file.h. Thread: one at a time for each file.
 */
#ifndef TL_FIRMWARE_FMU_ELF_NAMES_H
#define TL_FIRMWARE_FMU_ELF_NAMES_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/fmu/elf_file.h"

enum { TL_ELF_LIBRARY = 256 }; /* bytes of a file's name, with its end */

/* Both of the same length, above 0. */
typedef struct tl_elf_rename {
    char old_name[TL_ELF_LIBRARY];
    char new_name[TL_ELF_LIBRARY];
} tl_elf_rename;

typedef enum tl_elf_outcome {
    TL_ELF_DONE,     /* also if there was nothing to change */
    TL_ELF_CONFLICT, /* another name shares bytes with one of these; the file in memory is not to be used any more */
    TL_ELF_NO_MEMORY
} tl_elf_outcome;

/* Wherever the file means a library by one of these names, its own name included. */
tl_elf_outcome tl_elf_rename_libraries(tl_elf_file *file, const tl_elf_rename *renames, size_t count);

/* Symbols that are one for the whole process (STB_GNU_UNIQUE: what C++ makes of static variables of templates and inline functions) become
 * ordinary ones. Those of C++'s own library stay: that library is shared, and some of them are compared by address. Returns how many. */
size_t tl_elf_part_unique(tl_elf_file *file);

/* Whether it may open libraries while it runs. */
bool tl_elf_opens_libraries(const tl_elf_file *file);

#endif
