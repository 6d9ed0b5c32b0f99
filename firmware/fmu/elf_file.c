/* A shared library in memory: see elf_file.h. Every number of the file goes through read_word(), every place through locate(), and both know the
 * file's size. */
#include "firmware/fmu/elf_file.h"

#include <elf.h>
#include <string.h>

/* ---- Numbers ------------------------------------------------------------------------------------------- */

/* `width` bytes at `offset`, 0 beyond the end of the file. */
static uint64_t read_word(const tl_elf_file *file, size_t offset, size_t width) {
    uint64_t value = 0;
    if (offset > file->size || file->size - offset < width) {
        return 0;
    }
    for (size_t i = 0; i < width; i++) {
        size_t at = file->is_big ? i : width - 1 - i;
        value = value << 8 | file->bytes[offset + at];
    }
    return value;
}

/* A member of a structure that both classes have. */
#define READ(file, offset, type, member)                                                                               \
    read_word(file, (offset) + ((file)->is_wide ? offsetof(Elf64_##type, member) : offsetof(Elf32_##type, member)),    \
              (file)->is_wide ? sizeof(((Elf64_##type *)NULL)->member) : sizeof(((Elf32_##type *)NULL)->member))
#define SIZE(file, type) ((file)->is_wide ? sizeof(Elf64_##type) : sizeof(Elf32_##type))

/* ---- Places -------------------------------------------------------------------------------------------- */

/* Where the file holds the byte of memory at `address`, and how many follow. False: nowhere. Of two segments the later one is what is seen. */
static bool locate(const tl_elf_file *file, uint64_t address, size_t *offset, size_t *room) {
    for (size_t i = file->load_count; i > 0; i--) {
        const tl_elf_segment *load = &file->loads[i - 1];
        if (address >= load->address && address - load->address < load->size) {
            *offset = (size_t)(load->offset + (address - load->address));
            *room = (size_t)(load->size - (address - load->address));
            return true;
        }
    }
    return false;
}

/* What of a segment lies within the file. */
static tl_elf_segment read_segment(const tl_elf_file *file, size_t header) {
    tl_elf_segment segment = {
        .address = READ(file, header, Phdr, p_vaddr),
        .offset = READ(file, header, Phdr, p_offset),
        .size = READ(file, header, Phdr, p_filesz),
    };
    if (segment.offset > file->size) {
        segment.size = 0;
    } else if (segment.size > file->size - segment.offset) {
        segment.size = file->size - segment.offset;
    }
    return segment;
}

static bool read_segments(tl_elf_file *file) {
    size_t table = (size_t)READ(file, 0, Ehdr, e_phoff);
    size_t count = (size_t)READ(file, 0, Ehdr, e_phnum);
    if (READ(file, 0, Ehdr, e_phentsize) != SIZE(file, Phdr) || count > TL_ELF_SEGMENTS || table > file->size ||
        count * SIZE(file, Phdr) > file->size - table) {
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        size_t header = table + i * SIZE(file, Phdr);
        uint64_t type = READ(file, header, Phdr, p_type);
        if (type == PT_LOAD) {
            file->loads[file->load_count++] = read_segment(file, header);
        } else if (type == PT_DYNAMIC) {
            file->dynamic = read_segment(file, header);
        }
    }
    return true;
}

/* ---- The dynamic section ------------------------------------------------------------------------------- */

static size_t entry_at(const tl_elf_file *file, size_t index) {
    return (size_t)file->dynamic.offset + index * SIZE(file, Dyn);
}

static uint64_t tag_of(const tl_elf_file *file, size_t index) {
    return READ(file, entry_at(file, index), Dyn, d_tag);
}

static uint64_t value_of(const tl_elf_file *file, size_t index) {
    return READ(file, entry_at(file, index), Dyn, d_un);
}

/* The value of the last entry with this tag. False: there is none. */
static bool find_entry(const tl_elf_file *file, uint64_t tag, uint64_t *value) {
    for (size_t i = file->entry_count; i > 0; i--) {
        if (tag_of(file, i - 1) == tag) {
            *value = value_of(file, i - 1);
            return true;
        }
    }
    return false;
}

/* The loader knows it by its address. */
static bool read_dynamic(tl_elf_file *file) {
    size_t offset = 0;
    size_t room = 0;
    if (!locate(file, file->dynamic.address, &offset, &room)) {
        return false;
    }
    file->dynamic.offset = offset;
    size_t most = room / SIZE(file, Dyn);
    most = most < TL_ELF_ENTRIES ? most : TL_ELF_ENTRIES;
    while (file->entry_count < most && tag_of(file, file->entry_count) != DT_NULL) {
        file->entry_count++;
    }
    return file->entry_count < most;
}

static bool read_strings(tl_elf_file *file) {
    uint64_t address = 0;
    uint64_t size = 0;
    if (!find_entry(file, DT_STRTAB, &address) || !find_entry(file, DT_STRSZ, &size) ||
        !locate(file, address, &file->strings, &file->strings_size)) {
        return false;
    }
    file->strings_size = file->strings_size < size ? file->strings_size : (size_t)size;
    return file->strings_size > 0;
}

/* ---- Symbols ------------------------------------------------------------------------------------------- */

#define WORD ((size_t)4) /* of both tables of hashes, on all machines of ours */

/* How many symbols the younger table of hashes knows: the last chain ends with an odd word. 0: none of the file's own. */
static size_t count_hashed(const tl_elf_file *file, size_t table, size_t room) {
    uint64_t buckets = read_word(file, table, WORD);
    uint64_t first = read_word(file, table + WORD, WORD);
    uint64_t filter = read_word(file, table + 2 * WORD, WORD) * (file->is_wide ? 8 : 4);
    uint64_t chains = 4 * WORD + filter + buckets * WORD; /* from the table */
    uint64_t last = 0;
    if (chains > room) {
        return 0;
    }
    for (uint64_t i = 0; i < buckets; i++) {
        uint64_t begin = read_word(file, table + (size_t)(4 * WORD + filter + i * WORD), WORD);
        last = begin > last ? begin : last;
    }
    if (last < first) {
        return 0;
    }
    uint64_t at = chains + (last - first) * WORD;
    while (at + WORD <= room && (read_word(file, table + (size_t)at, WORD) & 1U) == 0) {
        at += WORD;
        last++;
    }
    return (size_t)last + 1;
}

/* Without one of its own a library still has symbols that it asks for; linkers put the names behind them. */
static size_t count_before_names(const tl_elf_file *file, uint64_t symbols) {
    uint64_t names = 0;
    (void)find_entry(file, DT_STRTAB, &names);
    return names > symbols ? (size_t)((names - symbols) / SIZE(file, Sym)) : 0;
}

static void read_symbols(tl_elf_file *file) {
    uint64_t address = 0;
    uint64_t hashes = 0;
    size_t room = 0;
    size_t table = 0;
    size_t rest = 0;
    if (!find_entry(file, DT_SYMTAB, &address) || !locate(file, address, &file->symbols, &room)) {
        return;
    }
    size_t count = 0;
    if (find_entry(file, DT_HASH, &hashes) && locate(file, hashes, &table, &rest)) {
        count = (size_t)read_word(file, table + WORD, WORD);
    } else if (find_entry(file, DT_GNU_HASH, &hashes) && locate(file, hashes, &table, &rest)) {
        count = count_hashed(file, table, rest);
    }
    count = count != 0 ? count : count_before_names(file, address);
    file->symbol_count = count < room / SIZE(file, Sym) ? count : room / SIZE(file, Sym);
}

tl_elf_symbol tl_elf_symbol_at(const tl_elf_file *file, size_t index) {
    size_t at = file->symbols + index * SIZE(file, Sym);
    size_t name = (size_t)READ(file, at, Sym, st_name);
    return (tl_elf_symbol){
        .name = name < file->strings_size ? name : TL_ELF_NO_NAME,
        .info = file->bytes + at + (file->is_wide ? offsetof(Elf64_Sym, st_info) : offsetof(Elf32_Sym, st_info)),
        .is_defined = READ(file, at, Sym, st_shndx) != SHN_UNDEF,
    };
}

/* Symbols may share names, but no linker lets millions of them share one that is millions of bytes long: to look at all of them must not last. */
static bool names_are_bounded(const tl_elf_file *file) {
    enum { SHARED = 16, SMALL = 1 << 20 };
    uint64_t left = (uint64_t)file->strings_size * SHARED + SMALL;
    for (size_t i = 0; i < file->symbol_count; i++) {
        size_t name = tl_elf_symbol_at(file, i).name;
        if (name == TL_ELF_NO_NAME) {
            continue;
        }
        size_t room = file->strings_size - name;
        room = room < left ? room : (size_t)left;
        size_t length = strnlen((const char *)file->bytes + file->strings + name, room) + 1;
        if (length > left) {
            return false;
        }
        left -= length;
    }
    return true;
}

/* ---- Opening ------------------------------------------------------------------------------------------- */

bool tl_elf_open(tl_elf_file *file, uint8_t *bytes, size_t size) {
    *file = (tl_elf_file){.bytes = bytes, .size = size};
    if (size < sizeof(Elf32_Ehdr) || memcmp(bytes, ELFMAG, SELFMAG) != 0) {
        return false;
    }
    file->is_wide = bytes[EI_CLASS] == ELFCLASS64;
    file->is_big = bytes[EI_DATA] == ELFDATA2MSB;
    if ((!file->is_wide && bytes[EI_CLASS] != ELFCLASS32) || (!file->is_big && bytes[EI_DATA] != ELFDATA2LSB) ||
        size < SIZE(file, Ehdr) || READ(file, 0, Ehdr, e_type) != ET_DYN) {
        return false;
    }
    file->machine = (unsigned)READ(file, 0, Ehdr, e_machine);
    if (!read_segments(file) || !read_dynamic(file) || !read_strings(file)) {
        return false;
    }
    read_symbols(file);
    return names_are_bounded(file);
}

/* ---- References ---------------------------------------------------------------------------------------- */

/* One visit. */
typedef struct visiting {
    const tl_elf_file *file;
    tl_elf_visitor *visitor;
    void *context;
    size_t versions_left;
} visiting;

/* A name outside of the names is none. */
static bool tell(const visiting *work, tl_elf_kind kind, uint64_t offset) {
    tl_elf_reference reference = {kind, (size_t)offset};
    return offset >= work->file->strings_size || work->visitor(work->context, reference);
}

static bool visit_entries(const visiting *work) {
    static const struct {
        uint64_t tag;
        tl_elf_kind kind;
    } known[] = {{DT_NEEDED, TL_ELF_NEEDED},  {DT_SONAME, TL_ELF_NAME},     {DT_RPATH, TL_ELF_OTHER},
                 {DT_RUNPATH, TL_ELF_OTHER},  {DT_AUXILIARY, TL_ELF_OTHER}, {DT_FILTER, TL_ELF_OTHER},
                 {DT_DEPAUDIT, TL_ELF_OTHER}, {DT_AUDIT, TL_ELF_OTHER},     {DT_CONFIG, TL_ELF_OTHER}};
    for (size_t i = 0; i < work->file->entry_count; i++) {
        uint64_t tag = tag_of(work->file, i);
        for (size_t k = 0; k < sizeof known / sizeof known[0]; k++) {
            if (tag == known[k].tag && !tell(work, known[k].kind, value_of(work->file, i))) {
                return false;
            }
        }
    }
    return true;
}

/* The tables of versions are lists, each member of which has a list: numbers in a member say how far it is to the next one and to its own list. */
typedef struct version_table {
    uint64_t tag;      /* of its address */
    size_t size;       /* of a member; the same in both classes */
    size_t name;       /* offset of the library's name in it; SIZE_MAX: the first name of its list is it */
    size_t list;       /* offset of how far its list is */
    size_t next;       /* offset of how far the next member is */
    size_t inner_size; /* of a member of its list */
    size_t inner_name;
    size_t inner_next;
    bool (*is_library)(const tl_elf_file *file, size_t member); /* the first name of its list is a library's */
} version_table;

static bool is_never(const tl_elf_file *file, size_t member) {
    (void)file;
    (void)member;
    return false;
}

/* The version of the library as a whole is called as it is. */
static bool is_base(const tl_elf_file *file, size_t member) {
    return (READ(file, member, Verdef, vd_flags) & VER_FLG_BASE) != 0;
}

static const version_table version_tables[] = {
    {DT_VERNEED, sizeof(Elf64_Verneed), offsetof(Elf64_Verneed, vn_file), offsetof(Elf64_Verneed, vn_aux),
     offsetof(Elf64_Verneed, vn_next), sizeof(Elf64_Vernaux), offsetof(Elf64_Vernaux, vna_name),
     offsetof(Elf64_Vernaux, vna_next), is_never},
    {DT_VERDEF, sizeof(Elf64_Verdef), SIZE_MAX, offsetof(Elf64_Verdef, vd_aux), offsetof(Elf64_Verdef, vd_next),
     sizeof(Elf64_Verdaux), offsetof(Elf64_Verdaux, vda_name), offsetof(Elf64_Verdaux, vda_next), is_base},
};

/* The member that is `far` behind `*at`; false: there is none within the file. */
static bool step_on(const tl_elf_file *file, size_t *at, uint64_t far, size_t size) {
    if (far == 0 || far > file->size || *at > file->size - (size_t)far || file->size - *at - (size_t)far < size) {
        return false;
    }
    *at += (size_t)far;
    return true;
}

static bool visit_list(visiting *work, const version_table *table, size_t member) {
    size_t at = member;
    tl_elf_kind kind = table->is_library(work->file, member) ? TL_ELF_VERSION : TL_ELF_OTHER;
    bool more = step_on(work->file, &at, read_word(work->file, member + table->list, WORD), table->inner_size);
    while (more && work->versions_left > 0) {
        work->versions_left--;
        if (!tell(work, kind, read_word(work->file, at + table->inner_name, WORD))) {
            return false;
        }
        kind = TL_ELF_OTHER;
        more = step_on(work->file, &at, read_word(work->file, at + table->inner_next, WORD), table->inner_size);
    }
    return true;
}

static bool visit_versions(visiting *work, const version_table *table) {
    uint64_t address = 0;
    size_t at = 0;
    size_t room = 0;
    if (!find_entry(work->file, table->tag, &address) || !locate(work->file, address, &at, &room) ||
        room < table->size) {
        return true;
    }
    bool more = true;
    while (more && work->versions_left > 0) {
        work->versions_left--;
        if (table->name != SIZE_MAX && !tell(work, TL_ELF_VERSION, read_word(work->file, at + table->name, WORD))) {
            return false;
        }
        if (!visit_list(work, table, at)) {
            return false;
        }
        more = step_on(work->file, &at, read_word(work->file, at + table->next, WORD), table->size);
    }
    return true;
}

void tl_elf_visit(const tl_elf_file *file, tl_elf_visitor *visitor, void *context) {
    visiting work = {.file = file, .visitor = visitor, .context = context, .versions_left = TL_ELF_VERSIONS};
    bool more = visit_entries(&work);
    for (size_t i = 0; i < sizeof version_tables / sizeof version_tables[0] && more; i++) {
        more = visit_versions(&work, &version_tables[i]);
    }
    for (size_t i = 0; i < file->symbol_count && more; i++) {
        size_t name = tl_elf_symbol_at(file, i).name;
        more = name == TL_ELF_NO_NAME || tell(&work, TL_ELF_OTHER, name);
    }
}

const char *tl_elf_text(const tl_elf_file *file, size_t offset) {
    const char *text = (const char *)file->bytes + file->strings + offset;
    return offset < file->strings_size && memchr(text, '\0', file->strings_size - offset) != NULL ? text : NULL;
}
