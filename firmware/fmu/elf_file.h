/* A shared library in memory, as the loader of the machine sees it: names that it asks for, has and refers to, and how to change them in place.
 *
 * Purpose: two libraries of one name are one for the loader. So a copy gets names of its own. A name is only ever replaced by another of the same
 *          length: nothing in the file moves.
 * Reads:   by the table of segments, as the loader does, never by sections, which a file may lack or lie in. ELF of 32 and 64 bits, both byte
 *          orders, any machine.
 * Trust:   the file is a stranger's. Nothing outside of its bytes is read or written, every loop has an end, and what makes no sense is no library
 *          (open) or a name that is not there.
 * Owner:   the bytes are the caller's, and must stay while the file is used.
 * Thread:  one at a time for each file.
 */
#ifndef TL_FIRMWARE_FMU_ELF_FILE_H
#define TL_FIRMWARE_FMU_ELF_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

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
    bool is_wide;     /* public: 64 bits */
    bool is_big;      /* public: most significant byte first */
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

#endif
