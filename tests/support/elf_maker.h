/* Makes small shared libraries in memory, byte by byte: of both classes and byte orders, and with names that share bytes as a linker's do.
 *
 * Purpose: what no compiler of the machine makes, and what no linker would. They are for readers of ELF, not for the loader.
 * Owner:   the caller has the bytes. Thread: any.
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

/* Each text must be in `strings`, as a whole or as the end of one. NULL: there is none. */
typedef struct tl_elf_plan {
    bool is_wide;
    bool is_big;
    bool has_old_hashes; /* the older table of hashes, else the younger one */
    bool has_no_hashes;
    const char *strings; /* all names, each with its end */
    size_t strings_size;
    const char *name;
    const char *needed[TL_ELF_MADE_NEEDED];
    const char *path;                                /* of libraries */
    const char *version_of;                          /* a library of which a version is needed */
    const char *version;                             /* which */
    const char *defined_base;                        /* the version of the whole library */
    const char *defined;                             /* and another one */
    tl_elf_made_symbol symbols[TL_ELF_MADE_SYMBOLS]; /* those that are not defined first */
} tl_elf_plan;

/* Returns the size. */
size_t tl_elf_make(const tl_elf_plan *plan, uint8_t bytes[TL_ELF_MADE]);

/* Where the text begins that ends as `text` does, or SIZE_MAX. */
size_t tl_elf_made_offset(const char *strings, size_t size, const char *text);

#endif
