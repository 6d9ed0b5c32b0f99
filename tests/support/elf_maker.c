/* Small shared libraries: see elf_maker.h. One segment holds the file, at BASE in memory. */
#include "tests/support/elf_maker.h"

#include <elf.h>
#include <string.h>

enum {
    BASE = 0x4000,
    DYNAMIC = 0x100,
    HASHES = 0x240,
    NEEDS = 0x2C0,
    DEFINES = 0x300,
    SYMBOLS = 0x380,
    STRINGS = 0x480
};

typedef struct making {
    const tl_elf_plan *plan;
    uint8_t *bytes;
    size_t entries; /* of the dynamic section */
} making;

size_t tl_elf_made_offset(const char *strings, size_t size, const char *text) {
    size_t length = strlen(text) + 1;
    for (size_t i = 0; i + length <= size; i++) {
        if (memcmp(strings + i, text, length) == 0) {
            return i;
        }
    }
    return SIZE_MAX;
}

static size_t offset_of(const making *work, const char *text) {
    return tl_elf_made_offset(work->plan->strings, work->plan->strings_size, text);
}

static void put(const making *work, size_t offset, size_t width, uint64_t value) {
    for (size_t i = 0; i < width; i++) {
        size_t at = work->plan->is_big ? width - 1 - i : i;
        work->bytes[offset + at] = (uint8_t)(value >> (8 * i));
    }
}

#define PUT(work, offset, type, member, value)                                                                         \
    put(work, (offset) + ((work)->plan->is_wide ? offsetof(Elf64_##type, member) : offsetof(Elf32_##type, member)),    \
        (work)->plan->is_wide ? sizeof(((Elf64_##type *)NULL)->member) : sizeof(((Elf32_##type *)NULL)->member),       \
        value)
#define SIZE(work, type) ((work)->plan->is_wide ? sizeof(Elf64_##type) : sizeof(Elf32_##type))

static void put_entry(making *work, uint64_t tag, uint64_t value) {
    size_t at = DYNAMIC + work->entries * SIZE(work, Dyn);
    PUT(work, at, Dyn, d_tag, tag);
    PUT(work, at, Dyn, d_un, value);
    work->entries++;
}

static void put_named(making *work, uint64_t tag, const char *text) {
    if (text != NULL) {
        put_entry(work, tag, offset_of(work, text));
    }
}

static void put_headers(const making *work, size_t size) {
    memcpy(work->bytes, ELFMAG, SELFMAG);
    work->bytes[EI_CLASS] = work->plan->is_wide ? ELFCLASS64 : ELFCLASS32;
    work->bytes[EI_DATA] = work->plan->is_big ? ELFDATA2MSB : ELFDATA2LSB;
    work->bytes[EI_VERSION] = EV_CURRENT;
    size_t table = SIZE(work, Ehdr);
    PUT(work, 0, Ehdr, e_type, ET_DYN);
    PUT(work, 0, Ehdr, e_machine, work->plan->is_wide ? EM_AARCH64 : EM_ARM);
    PUT(work, 0, Ehdr, e_phoff, table);
    PUT(work, 0, Ehdr, e_phentsize, SIZE(work, Phdr));
    PUT(work, 0, Ehdr, e_phnum, 2);
    PUT(work, table, Phdr, p_type, PT_LOAD);
    PUT(work, table, Phdr, p_vaddr, BASE);
    PUT(work, table, Phdr, p_filesz, size);
    table += SIZE(work, Phdr);
    PUT(work, table, Phdr, p_type, PT_DYNAMIC);
    PUT(work, table, Phdr, p_vaddr, BASE + DYNAMIC);
    PUT(work, table, Phdr, p_offset, DYNAMIC);
    PUT(work, table, Phdr, p_filesz, HASHES - DYNAMIC);
}

/* Writes the symbols after the empty first one. Returns their number including that one, and sets
 * *undefined to the number of undefined ones, also including it. */
static size_t put_symbols(const making *work, size_t *undefined) {
    size_t count = 1;
    *undefined = 1;
    for (size_t i = 0; i < TL_ELF_MADE_SYMBOLS && work->plan->symbols[i].name != NULL; i++) {
        const tl_elf_made_symbol *symbol = &work->plan->symbols[i];
        size_t at = SYMBOLS + count * SIZE(work, Sym);
        PUT(work, at, Sym, st_name, offset_of(work, symbol->name));
        PUT(work, at, Sym, st_info, symbol->info);
        PUT(work, at, Sym, st_shndx, symbol->is_defined ? 1 : SHN_UNDEF);
        count++;
        *undefined += symbol->is_defined ? 0 : 1;
    }
    return count;
}

/* Writes a hash table with one bucket. The chain of the defined symbols ends with the last one. */
static void put_hashes(making *work, size_t count, size_t undefined) {
    if (work->plan->has_no_hashes) {
        return;
    }
    if (work->plan->has_old_hashes) {
        put(work, HASHES, 4, 1);
        put(work, HASHES + 4, 4, count);
        put_entry(work, DT_HASH, BASE + HASHES);
        return;
    }
    size_t filter = work->plan->is_wide ? 8 : 4;
    put(work, HASHES, 4, 1);
    put(work, HASHES + 4, 4, undefined);
    put(work, HASHES + 8, 4, 1);
    put(work, HASHES + 16 + filter, 4, count > undefined ? undefined : 0);
    if (count > undefined) {
        put(work, HASHES + 20 + filter + 4 * (count - undefined - 1), 4, 1);
    }
    put_entry(work, DT_GNU_HASH, BASE + HASHES);
}

static void put_needs(making *work) {
    if (work->plan->version_of == NULL) {
        return;
    }
    PUT(work, NEEDS, Verneed, vn_cnt, 1);
    PUT(work, NEEDS, Verneed, vn_file, offset_of(work, work->plan->version_of));
    PUT(work, NEEDS, Verneed, vn_aux, sizeof(Elf64_Verneed));
    PUT(work, NEEDS + sizeof(Elf64_Verneed), Vernaux, vna_name, offset_of(work, work->plan->version));
    put_entry(work, DT_VERNEED, BASE + NEEDS);
    put_entry(work, DT_VERNEEDNUM, 1);
}

static void put_defines(making *work) {
    enum { STRIDE = sizeof(Elf64_Verdef) + sizeof(Elf64_Verdaux) };
    if (work->plan->defined_base == NULL) {
        return;
    }
    const char *names[] = {work->plan->defined_base, work->plan->defined};
    size_t count = names[1] == NULL ? 1 : 2;
    for (size_t i = 0; i < count; i++) {
        size_t at = DEFINES + i * STRIDE;
        PUT(work, at, Verdef, vd_flags, i == 0 ? VER_FLG_BASE : 0);
        PUT(work, at, Verdef, vd_cnt, 1);
        PUT(work, at, Verdef, vd_aux, sizeof(Elf64_Verdef));
        PUT(work, at, Verdef, vd_next, i + 1 < count ? STRIDE : 0);
        PUT(work, at + sizeof(Elf64_Verdef), Verdaux, vda_name, offset_of(work, names[i]));
    }
    put_entry(work, DT_VERDEF, BASE + DEFINES);
    put_entry(work, DT_VERDEFNUM, count);
}

size_t tl_elf_make(const tl_elf_plan *plan, uint8_t bytes[TL_ELF_MADE]) {
    making work = {.plan = plan, .bytes = bytes};
    size_t undefined = 0;
    memset(bytes, 0, TL_ELF_MADE);
    size_t count = put_symbols(&work, &undefined);
    size_t strings = plan->has_no_hashes ? SYMBOLS + count * SIZE(&work, Sym) : STRINGS;
    size_t size = strings + plan->strings_size;
    put_headers(&work, size);
    put_named(&work, DT_SONAME, plan->name);
    for (size_t i = 0; i < TL_ELF_MADE_NEEDED; i++) {
        put_named(&work, DT_NEEDED, plan->needed[i]);
    }
    put_named(&work, DT_RUNPATH, plan->path);
    put_entry(&work, DT_STRTAB, BASE + strings);
    put_entry(&work, DT_STRSZ, plan->strings_size);
    put_entry(&work, DT_SYMTAB, BASE + SYMBOLS);
    put_hashes(&work, count, undefined);
    put_needs(&work);
    put_defines(&work);
    memcpy(bytes + strings, plan->strings, plan->strings_size);
    return size;
}
