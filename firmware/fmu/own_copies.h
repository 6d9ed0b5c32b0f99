/* Renamed copies of an FMU's libraries, so that each component has its own global variables.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_FMU_OWN_COPIES_H
#define TL_FIRMWARE_FMU_OWN_COPIES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"

/* ---- A shared library (ELF file) in memory: finds all names in it, to change them in place.
 *
 * Purpose: for the loader, two libraries with the same name are one library. So a copy gets new
 *          names. A name is only replaced by a name of the same length, so that nothing in the file
 *          moves.
 * Reads:   the segment table, as the loader does. Sections are ignored, because they may be missing
 *          or wrong. Only ELF files of this program's width and byte order are accepted, because no
 *          other can be loaded.
 * Trust:   the file is untrusted. No byte outside of it is read or written, and every loop is
 *          bounded. An invalid file is rejected at opening; an invalid name is treated as missing.
 * Owner:   the caller owns the bytes and keeps them while the file is used.
 * Thread:  one at a time for each file.
 */

enum {
    TL_ELF_SEGMENTS = 64,       /* maximum number of program headers; typical: 10 */
    TL_ELF_ENTRIES = 4096,      /* maximum number of entries of the dynamic section; typical: 30 */
    TL_ELF_VERSIONS = 16 * 1024 /* maximum number of needed or defined symbol versions, and of their names */
};

/* A part of the file: `size` bytes from `offset` on, which the loader maps from `address` on. */
typedef struct tl_elf_segment {
    uint64_t address;
    uint64_t offset;
    uint64_t size;
} tl_elf_segment;

/* Fields are private, unless marked as public. */
typedef struct tl_elf_file {
    uint8_t *bytes;
    size_t size;
    unsigned machine; /* public: EM_… */
    tl_elf_segment loads[TL_ELF_SEGMENTS];
    size_t load_count;
    tl_elf_segment dynamic;
    size_t entry_count; /* of the dynamic section, without its end mark */
    size_t strings;     /* offset of the string table */
    size_t strings_size;
    size_t symbols;      /* offset of the symbol table */
    size_t symbol_count; /* public: number of symbols */
} tl_elf_file;

/* Opens a library of `size` bytes. `bytes` must outlive `file`. Returns false if this is not a
 * shared library, if no loader could use it, or if it exceeds a limit: number of segments or
 * entries, or total length of the symbol names. */
bool tl_elf_open(tl_elf_file *file, uint8_t *bytes, size_t size);

typedef enum tl_elf_kind {
    TL_ELF_NEEDED,  /* a library that is loaded with this one */
    TL_ELF_NAME,    /* its own name (SONAME) */
    TL_ELF_VERSION, /* library name in a version table: the needed library (verneed), or this library (verdef) */
    TL_ELF_OTHER    /* not a library: a symbol, a version or a path */
} tl_elf_kind;

/* A name that the file refers to. `offset` counts bytes in the string table and is below its size;
 * its terminating 0 may be missing. */
typedef struct tl_elf_reference {
    tl_elf_kind kind;
    size_t offset;
} tl_elf_reference;

/* Callback for each name. Returns false to end the visit. */
typedef bool tl_elf_visitor(void *context, tl_elf_reference reference);

/* Visits all names that the file refers to; those of symbols come last. */
void tl_elf_visit(const tl_elf_file *file, tl_elf_visitor *visitor, void *context);

/* Returns the text at an offset of the string table. Returns NULL if its terminating 0 is missing.
 */
const char *tl_elf_text(const tl_elf_file *file, size_t offset);

/* One symbol of the file. */
typedef struct tl_elf_symbol {
    size_t name;     /* offset of its name, as in a reference; TL_ELF_NO_NAME: not within the string table */
    uint8_t *info;   /* binding and type (st_info); points into the file */
    bool is_defined; /* false: the library uses this symbol from another library */
} tl_elf_symbol;

#define TL_ELF_NO_NAME SIZE_MAX

/* Returns a symbol. `index` must be below symbol_count. */
tl_elf_symbol tl_elf_symbol_at(const tl_elf_file *file, size_t index);

/* ---- Changes names in a shared library in memory, so that the loader treats it as another
 * library.
 *
 * Purpose: the loader does not load a library if it already knows the name, even if the file is
 *          another one. So a copy that needs its own global variables gets a new name, and all
 *          references to the old name are changed.
 * Shared:  linkers store one text for several names, and one name may begin inside another. So
 *          after renaming, tl_elf_rename_libraries() reads all names of the file again: each must
 *          have its old text, or the new name for it.
 * Trust:   the file is untrusted, see above.
 * Thread:  one at a time for each file.
 */

enum { TL_ELF_LIBRARY = 256 }; /* bytes of a library's file name, with its terminating 0 */

/* Both names have the same length, above 0. */
typedef struct tl_elf_rename {
    char old_name[TL_ELF_LIBRARY];
    char new_name[TL_ELF_LIBRARY];
} tl_elf_rename;

typedef enum tl_elf_outcome {
    TL_ELF_DONE,     /* success, also if there was nothing to change */
    TL_ELF_CONFLICT, /* another name shares bytes with a changed one; the file in memory must not be used any more */
    TL_ELF_NO_MEMORY
} tl_elf_outcome;

/* Renames all references to libraries with these `count` names, and the library's own name. */
tl_elf_outcome tl_elf_rename_libraries(tl_elf_file *file, const tl_elf_rename *renames, size_t count);

/* Changes the binding of symbols from STB_GNU_UNIQUE (one in the process) to STB_GLOBAL. C++ uses
 * unique symbols for static variables of templates and inline functions. Symbols of the C++
 * standard library stay unique: that library is shared, and some of its symbols are compared by
 * address. Returns the number of changed symbols. */
size_t tl_elf_unshare_symbols(tl_elf_file *file);

/* Returns true if the library uses dlopen() or dlmopen(): then it may open other libraries at run
 * time. */
bool tl_elf_opens_libraries(const tl_elf_file *file);

/* ---- Gives an unpacked FMU its own libraries, so that it shares no global variables with other
 * FMUs.
 *
 * Purpose: each component is a separate model. But the loader identifies a library by its name: the
 *          second FMU that needs libtable.so silently gets the library of the first FMU, with its
 *          variables. C++ also has symbols that are unique in the process. Both are changed in the
 *          files of the later FMU before the loader reads these files.
 * Unchanged: the first FMU of the process, names that no earlier FMU has loaded, and libraries of
 *            the system. Libraries inside an FMU that must exist once per process stay shared too;
 *            they are recognised by name (libc, libm, libgcc_s, libstdc++, libgfortran and
 *            similar).
 * Method:  a renamed library exists twice in the FMU's folder, under both names, so that its old
 *          path still works.
 * Limits:  a library that an FMU opens at run time (dlopen) by a name without a path stays shared.
 *          A warning is logged if an FMU uses dlopen() and an earlier FMU contains a library at the
 *          same relative path.
 * Owner:   the process. The binaries of FMUs are never closed, so the folders of all FMUs are
 *          remembered until the process ends.
 * Thread:  the thread that calls the FMUs.
 */

/* Renames the libraries of one FMU. `folder`: absolute path of an unpacked FMU of which nothing is
 * loaded yet. `binary`: path of its binary in that folder. `label` names the FMU in errors.
 * Errors:  TL_TRY_AGAIN if memory, descriptors or disk are missing. TL_BAD_DATA if a name cannot be
 *          changed because another name shares its bytes, or because no new name is free. */
tl_status tl_own_copies_make(const char *folder, const char *binary, const char *label, tl_error *error);

#endif
