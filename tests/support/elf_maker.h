/* Makes small shared libraries in memory: 32 or 64 bits, either byte order, with names that share
 * bytes as those of a linker do.
 *
 * Purpose: libraries for tests of ELF readers that this machine's compiler and linker cannot make.
 *          They are not meant for the loader.
 * Owner:   the caller provides the memory. Thread: any.
 */
#ifndef TL_TESTS_SUPPORT_ELF_MAKER_H
#define TL_TESTS_SUPPORT_ELF_MAKER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { TL_ELF_MADE = 2048, TL_ELF_MADE_NEEDED = 3, TL_ELF_MADE_SYMBOLS = 4 };

typedef struct tl_elf_made_symbol {
    const char *name; /* NULL: no symbol */
    uint8_t info;
    bool is_defined;
} tl_elf_made_symbol;

/* Each text must be one of `strings`, or the end of one. NULL: none. */
typedef struct tl_elf_plan {
    bool is_wide;        /* 64 bits */
    bool is_big;         /* big-endian */
    bool has_old_hashes; /* DT_HASH; else DT_GNU_HASH */
    bool has_no_hashes;
    const char *strings; /* all names, each with its NUL */
    size_t strings_size;
    const char *name; /* DT_SONAME */
    const char *needed[TL_ELF_MADE_NEEDED];
    const char *path;                                /* DT_RUNPATH */
    const char *version_of;                          /* library of which a version is needed */
    const char *version;                             /* that version */
    const char *defined_base;                        /* version of the whole library (VER_FLG_BASE) */
    const char *defined;                             /* another version that it defines */
    tl_elf_made_symbol symbols[TL_ELF_MADE_SYMBOLS]; /* undefined symbols first */
} tl_elf_plan;

/* Writes the library and returns its size in bytes. */
size_t tl_elf_make(const tl_elf_plan *plan, uint8_t bytes[TL_ELF_MADE]);

/* Returns the offset of the first place in `strings` with `text` and its NUL, or SIZE_MAX. */
size_t tl_elf_made_offset(const char *strings, size_t size, const char *text);

#endif
