/* Copies of an FMU's libraries: names are changed in ELF files, so that each component has variables of its own.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_FMU_OWN_COPIES_H
#define TL_FIRMWARE_FMU_OWN_COPIES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"

/* ---- A shared library in memory, as the loader of the machine sees it: names that it asks for, has and refers to, and how to change them in place.
 *
 * Purpose: two libraries of one name are one for the loader. So a copy gets names of its own. A name is only ever replaced by another of the same
 *          length: nothing in the file moves.
 * Reads:   by the table of segments, as the loader does, never by sections, which a file may lack or lie in. ELF of the width and byte
 *          order of this program: no other can be loaded.
 * Trust:   the file is a stranger's. Nothing outside of its bytes is read or written, every loop has an end, and what makes no sense is no library
 *          (open) or a name that is not there.
 * Owner:   the bytes are the caller's, and must stay while the file is used.
 * Thread:  one at a time for each file.
 */

enum {
    TL_ELF_SEGMENTS = 64,       /* in its table; files have about ten */
    TL_ELF_ENTRIES = 4096,      /* of its dynamic section; files have about thirty */
    TL_ELF_VERSIONS = 16 * 1024 /* of symbols, needed or defined, and their names */
};

/* Bytes of the file that hold `size` bytes of memory from `address` on. */
typedef struct tl_elf_segment {
    uint64_t address;
    uint64_t offset;
    uint64_t size;
} tl_elf_segment;

/* Fields are private, but for those that say otherwise. */
typedef struct tl_elf_file {
    uint8_t *bytes;
    size_t size;
    unsigned machine; /* public: EM_… */
    tl_elf_segment loads[TL_ELF_SEGMENTS];
    size_t load_count;
    tl_elf_segment dynamic;
    size_t entry_count; /* of the dynamic section, without its end */
    size_t strings;     /* offset of all names */
    size_t strings_size;
    size_t symbols; /* offset */
    size_t symbol_count;
} tl_elf_file;

/* False: this is no shared library, or one that no loader could use. */
bool tl_elf_open(tl_elf_file *file, uint8_t *bytes, size_t size);

typedef enum tl_elf_kind {
    TL_ELF_NEEDED,  /* a library that is loaded with this one */
    TL_ELF_NAME,    /* its own: SONAME */
    TL_ELF_VERSION, /* of a library: that which versions of symbols are of, or its own name once more */
    TL_ELF_OTHER    /* no library: a symbol, a version, a path */
} tl_elf_kind;

/* A name that the file refers to: it begins at `offset` of its names, of which there is at least one byte, and may have no end. */
typedef struct tl_elf_reference {
    tl_elf_kind kind;
    size_t offset;
} tl_elf_reference;

/* False: no more of them. */
typedef bool tl_elf_visitor(void *context, tl_elf_reference reference);

/* All names that it refers to, those of symbols last. */
void tl_elf_visit(const tl_elf_file *file, tl_elf_visitor *visitor, void *context);

/* The text of one, or NULL if it has no end. */
const char *tl_elf_text(const tl_elf_file *file, size_t offset);

/* One symbol: the bytes are those of the file. */
typedef struct tl_elf_symbol {
    size_t name;   /* as the offset of a reference; TL_ELF_NO_NAME: none within the file's names */
    uint8_t *info; /* binding and type */
    bool is_defined;
} tl_elf_symbol;

#define TL_ELF_NO_NAME SIZE_MAX

/* `index` is below symbol_count. */
tl_elf_symbol tl_elf_symbol_at(const tl_elf_file *file, size_t index);

/* ---- Changes names in a shared library in memory, so that the loader takes it for another one than its original.
 *
 * Purpose: a library that the loader knows by its name already is not loaded again, whatever file is meant. A copy that is to have globals of its own
 *          is renamed, and whoever needs it asks for it by the new name.
 * Linkers keep one text for several names, and let a name begin in the midst of another. So after each change all names of the file are read again:
 *          every one must be what it was, or what it was to become.
 * Trust:   as in own_copies.h. Thread: one at a time for each file.
 */

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

/* ---- Makes the libraries of an unpacked FMU its own: no other FMU of the process has the globals that they have.
 *
 * Purpose: a component is a model of its own. But the loader knows a library by its name: the second FMU that needs libtable.so gets that of the first
 *          one, with all that is in its variables, and no word is said. And C++ has symbols that are one for the whole process. Both are changed in
 *          the files of the later FMU before the loader sees them (own_copies.h).
 * What stays: the first FMU of the process, an FMU whose names nobody else has, and what is not the FMU's: libraries of the system stay shared, by
 *          their names also those of a compiler's that an FMU brings (libc, libm, libgcc_s, libstdc++, libgfortran and their like).
 * How:     in an FMU's folder a library that is renamed is there twice, by both names: who opens it by its path finds it.
 * Unseen:  what an FMU opens itself (dlopen) by a bare name. That it might is said.
 * Owner:   the process: the loader never forgets a library, so folders that FMUs were in are remembered for good.
 * Thread:  that of the FMUs.
 */

/* `folder`: absolute, of an FMU that is unpacked and of which nothing is loaded yet. `binary`: the path of its binary, below it. `label` names it in
 * errors. Errors: TL_TRY_AGAIN: memory, descriptors or disk are missing. TL_BAD_DATA: a name cannot be changed, as another one is part of it. */
tl_status tl_own_copies_make(const char *folder, const char *binary, const char *label, tl_error *error);

#endif
