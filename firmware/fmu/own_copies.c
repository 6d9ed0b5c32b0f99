/* Copies of an FMU's libraries: names are changed in ELF files, so that each component has variables of its own: see own_copies.h. */
#include "firmware/fmu/own_copies.h"

#include <dirent.h>
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <link.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"

/* ---- A shared library in memory: Every number of the file goes through read_word(), every place through locate(), and both know the
 * file's size. */

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

/* ---- elf names ---- */

/* ---- Libraries ----------------------------------------------------------------------------------------- */

/* One change of a file. */
typedef struct change {
    tl_elf_file *file;
    const tl_elf_rename *renames;
    size_t count;
    uint8_t *before; /* all names as they were; NULL until the first is changed */
    bool failed;
    bool no_memory;
} change;

/* What a library of this name is to be called, or NULL. */
static const char *new_name_of(const change *work, const char *name) {
    for (size_t i = 0; i < work->count; i++) {
        if (strcmp(work->renames[i].old_name, name) == 0) {
            return work->renames[i].new_name;
        }
    }
    return NULL;
}

static uint8_t *names_of(const change *work) {
    return work->file->bytes + work->file->strings;
}

/* The text as it was, or NULL if it had no end. */
static const char *text_before(const change *work, size_t offset) {
    const uint8_t *text = work->before + offset;
    return memchr(text, '\0', work->file->strings_size - offset) != NULL ? (const char *)text : NULL;
}

static bool keep_names(change *work) {
    if (work->before == NULL) {
        work->before = malloc(work->file->strings_size);
        if (work->before == NULL) {
            work->no_memory = true;
            return false;
        }
        memcpy(work->before, names_of(work), work->file->strings_size);
    }
    return true;
}

/* Looks at the names as they were: a change may have made one of them another's. */
static bool write_name(void *context, tl_elf_reference reference) {
    change *work = context;
    if (reference.kind == TL_ELF_OTHER) {
        return true;
    }
    const char *text =
        work->before == NULL ? tl_elf_text(work->file, reference.offset) : text_before(work, reference.offset);
    const char *wanted = text == NULL ? NULL : new_name_of(work, text);
    if (wanted == NULL) {
        return true;
    }
    if (!keep_names(work)) {
        return false;
    }
    memcpy(names_of(work) + reference.offset, wanted, strlen(wanted));
    return true;
}

/* Its end has not moved, as a new name has the length of the old one. */
static bool check_name(void *context, tl_elf_reference reference) {
    change *work = context;
    const char *was = text_before(work, reference.offset);
    if (was == NULL) {
        return true; /* the loader cannot use it either */
    }
    const char *wanted = reference.kind == TL_ELF_OTHER ? NULL : new_name_of(work, was);
    wanted = wanted != NULL ? wanted : was;
    work->failed = memcmp(names_of(work) + reference.offset, wanted, strlen(wanted) + 1) != 0;
    return !work->failed;
}

tl_elf_outcome tl_elf_rename_libraries(tl_elf_file *file, const tl_elf_rename *renames, size_t count) {
    change work = {.file = file, .renames = renames, .count = count};
    if (count == 0) {
        return TL_ELF_DONE;
    }
    tl_elf_visit(file, write_name, &work);
    if (work.before != NULL) {
        tl_elf_visit(file, check_name, &work);
    }
    free(work.before);
    if (work.no_memory) {
        return TL_ELF_NO_MEMORY;
    }
    return work.failed ? TL_ELF_CONFLICT : TL_ELF_DONE;
}

/* ---- Symbols ------------------------------------------------------------------------------------------- */

static bool begins_with(const char *text, const char *beginning) {
    return strncmp(text, beginning, strlen(beginning)) == 0;
}

/* By its mangled name: after what is said of it (a guard, a local of a function, a nested name, const) comes std:: or __gnu_cxx::. */
static bool is_of_language(const char *name) {
    static const char *const libraries[] = {"St", "Sa", "Ss", "Sb", "Si", "So", "Sd", "9__gnu_cxx", "10__cxxabiv1"};
    static const char *const said[] = {"GV", "GR", "TV", "TI", "TS", "TT", "Z", "N", "K"};
    if (!begins_with(name, "_Z")) {
        return false;
    }
    const char *rest = name + 2;
    for (size_t i = 0; i < sizeof said / sizeof said[0];) {
        bool is_said = begins_with(rest, said[i]);
        rest += is_said ? strlen(said[i]) : 0;
        i = is_said ? 0 : i + 1;
    }
    for (size_t i = 0; i < sizeof libraries / sizeof libraries[0]; i++) {
        if (begins_with(rest, libraries[i])) {
            return true;
        }
    }
    return false;
}

size_t tl_elf_part_unique(tl_elf_file *file) {
    size_t parted = 0;
    for (size_t i = 0; i < file->symbol_count; i++) {
        tl_elf_symbol symbol = tl_elf_symbol_at(file, i);
        if (ELF64_ST_BIND(*symbol.info) != STB_GNU_UNIQUE || !symbol.is_defined || symbol.name == TL_ELF_NO_NAME) {
            continue;
        }
        const char *name = tl_elf_text(file, symbol.name);
        if (name != NULL && !is_of_language(name)) {
            *symbol.info = (uint8_t)ELF64_ST_INFO(STB_GLOBAL, ELF64_ST_TYPE(*symbol.info));
            parted++;
        }
    }
    return parted;
}

bool tl_elf_opens_libraries(const tl_elf_file *file) {
    for (size_t i = 0; i < file->symbol_count; i++) {
        tl_elf_symbol symbol = tl_elf_symbol_at(file, i);
        const char *name = symbol.is_defined || symbol.name == TL_ELF_NO_NAME ? NULL : tl_elf_text(file, symbol.name);
        if (name != NULL && (strcmp(name, "dlopen") == 0 || strcmp(name, "dlmopen") == 0)) {
            return true;
        }
    }
    return false;
}

/* ---- own copies ---- */

/* A library of the FMU. */
typedef struct own_library {
    char *path;
    const char *name; /* the end of the path */
    uint8_t *bytes;   /* the file, shared: what is changed here is changed there */
    size_t size;
    tl_elf_file file;
} own_library;

/* One FMU. */
typedef struct making {
    const char *folder;
    const char *label;
    tl_error *error;
    char **folders; /* the FMU's, then those in it */
    size_t folder_count;
    own_library *libraries; /* the binary first */
    size_t library_count;
    tl_elf_rename *renames;
    size_t rename_count;
} making;

static bool is_below(const char *path, const char *folder) {
    size_t length = strlen(folder);
    return strncmp(path, folder, length) == 0 && path[length] == '/';
}

/* `path`: of a library, or the folder for all of them. */
static tl_status fail_system(const making *work, const char *path, const char *doing, int code) {
    const char *shown = is_below(path, work->folder) ? path + strlen(work->folder) + 1 : "in its folder";
    return tl_fail(work->error, TL_TRY_AGAIN,
                   "%s: its library %.120s cannot be %s: %s; free memory, descriptors or disk and try again",
                   work->label, shown, doing, strerror(code));
}

static tl_status fail_memory(const making *work) {
    return tl_fail(work->error, TL_TRY_AGAIN, "%s: out of memory; free some and try again", work->label);
}

/* One more element of an array that has `count`. NULL: no memory; the array stays. */
static void *grow(void *array, size_t count, size_t size) {
    return (count & (count - 1)) == 0 ? realloc(array, (count == 0 ? 1 : 2 * count) * size) : array;
}

/* ---- Folders of FMUs ----------------------------------------------------------------------------------- */

typedef struct fmu_folder {
    struct fmu_folder *next;
    char path[];
} fmu_folder;

/* Of all FMUs that the process has had. */
static fmu_folder *folders;

static bool remember(const char *path) {
    size_t size = strlen(path) + 1;
    fmu_folder *folder = malloc(sizeof *folder + size);
    if (folder == NULL) {
        return false;
    }
    memcpy(folder->path, path, size);
    folder->next = folders;
    folders = folder;
    return true;
}

static bool is_of_an_fmu(const char *path) {
    for (const fmu_folder *folder = folders; folder != NULL; folder = folder->next) {
        if (is_below(path, folder->path)) {
            return true;
        }
    }
    return false;
}

/* ---- Libraries of this one ------------------------------------------------------------------------------ */

static tl_status map_file(const making *work, int file, own_library *library) {
    struct stat about;
    if (fstat(file, &about) != 0 || !S_ISREG(about.st_mode) || about.st_size <= 0) {
        return TL_OK;
    }
    library->size = (size_t)about.st_size;
    void *bytes = mmap(NULL, library->size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (bytes == MAP_FAILED) {
        return fail_system(work, library->path, "read", errno);
    }
    library->bytes = bytes;
    return TL_OK;
}

static void forget_library(own_library *library) {
    if (library->bytes != NULL) {
        (void)munmap(library->bytes, library->size);
    }
    free(library->path);
}

/* A file that is no library of the binary's kind is left out. */
static tl_status add_library(making *work, const char *path) {
    own_library *grown = grow(work->libraries, work->library_count, sizeof *grown);
    if (grown == NULL) {
        return fail_memory(work);
    }
    work->libraries = grown;
    own_library *added = &grown[work->library_count];
    *added = (own_library){.path = strdup(path)};
    if (added->path == NULL) {
        return fail_memory(work);
    }
    added->name = strrchr(added->path, '/') + 1;
    int file = open(path, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) {
        tl_status status = fail_system(work, path, "opened", errno);
        free(added->path);
        return status;
    }
    tl_status status = map_file(work, file, added);
    (void)close(file);
    const tl_elf_file *binary = &grown[0].file;
    if (status == TL_OK && added->bytes != NULL && tl_elf_open(&added->file, added->bytes, added->size) &&
        (work->library_count == 0 ||
         (added->file.machine == binary->machine && added->file.is_wide == binary->is_wide &&
          added->file.is_big == binary->is_big))) {
        work->library_count++;
    } else {
        forget_library(added);
    }
    return status;
}

static tl_status add_folder(making *work, const char *path) {
    char **grown = grow(work->folders, work->folder_count, sizeof *grown);
    if (grown == NULL) {
        return fail_memory(work);
    }
    work->folders = grown;
    grown[work->folder_count] = strdup(path);
    if (grown[work->folder_count] == NULL) {
        return fail_memory(work);
    }
    work->folder_count++;
    return TL_OK;
}

/* A folder is for later. Links are not followed. */
static tl_status add_entry(making *work, const char *folder, const char *name) {
    char path[PATH_MAX];
    struct stat about;
    if (strcmp(name, ".") == 0 || strcmp(name, "..") == 0) {
        return TL_OK;
    }
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path) {
        return fail_system(work, folder, "found", ENAMETOOLONG);
    }
    if (lstat(path, &about) != 0) {
        return fail_system(work, path, "found", errno);
    }
    if (S_ISDIR(about.st_mode)) {
        return add_folder(work, path);
    }
    bool is_other = strstr(name, ".so") != NULL && strcmp(path, work->libraries[0].path) != 0;
    return is_other && S_ISREG(about.st_mode) ? add_library(work, path) : TL_OK;
}

static tl_status look_into(making *work, const char *folder) {
    DIR *entries = opendir(folder);
    if (entries == NULL) {
        return fail_system(work, folder, "found", errno);
    }
    tl_status status = TL_OK;
    errno = 0;
    for (const struct dirent *entry = readdir(entries); entry != NULL && status == TL_OK;) {
        status = add_entry(work, folder, entry->d_name);
        errno = 0;
        entry = readdir(entries);
    }
    int code = errno;
    (void)closedir(entries);
    return status == TL_OK && code != 0 ? fail_system(work, folder, "found", code) : status;
}

/* All of the folder, wherever they are: an FMU may have some among its resources. */
static tl_status find_libraries(making *work, const char *binary) {
    tl_status status = add_library(work, binary);
    if (status != TL_OK || work->library_count == 0) {
        return status;
    }
    status = add_folder(work, work->folder);
    for (size_t i = 0; i < work->folder_count && status == TL_OK; i++) {
        status = look_into(work, work->folders[i]);
    }
    return status;
}

static const own_library *library_called(const making *work, const char *name) {
    for (size_t i = 0; i < work->library_count; i++) {
        if (strcmp(work->libraries[i].name, name) == 0) {
            return &work->libraries[i];
        }
    }
    return NULL;
}

/* ---- Names ---------------------------------------------------------------------------------------------- */

/* What the loader has by this name, or NULL. Nothing is loaded. */
static void *find_loaded(const char *name) {
    void *found = dlopen(name, RTLD_LAZY | RTLD_NOLOAD);
    (void)dlerror();
    return found;
}

/* The loader would take another FMU's library. */
static bool is_taken(const char *name) {
    struct link_map *map = NULL;
    void *found = find_loaded(name);
    if (found == NULL) {
        return false;
    }
    bool taken = dlinfo(found, RTLD_DI_LINKMAP, &map) == 0 && map != NULL && is_of_an_fmu(map->l_name);
    (void)dlclose(found);
    return taken;
}

/* One of those that are one for the whole process. */
static bool is_of_the_system(const char *name) {
    static const char *const known[] = {"libc.so",        "libm.so",        "libdl.so",     "librt.so",
                                        "libpthread.so",  "ld-linux",       "libgcc_s.so",  "libstdc++.so",
                                        "libgfortran.so", "libquadmath.so", "libatomic.so", "libgomp.so"};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        if (strncmp(name, known[i], strlen(known[i])) == 0) {
            return true;
        }
    }
    return false;
}

static bool is_renamed(const making *work, const char *name) {
    for (size_t i = 0; i < work->rename_count; i++) {
        if (strcmp(work->renames[i].old_name, name) == 0 || strcmp(work->renames[i].new_name, name) == 0) {
            return true;
        }
    }
    return false;
}

/* Nobody has it: neither this FMU nor the loader. */
static bool is_free(const making *work, const char *name) {
    void *found = find_loaded(name);
    if (found != NULL) {
        (void)dlclose(found);
    }
    return found == NULL && library_called(work, name) == NULL && !is_renamed(work, name);
}

/* In place of its first characters a number that no library of the process has had: libtable.so becomes 001table.so. False: none is free. */
static bool find_name(const making *work, const char *name, char found[TL_ELF_LIBRARY]) {
    static const char digits[] = "0123456789abcdefghijklmnopqrstuvwxyz";
    enum { BASE = sizeof digits - 1, WIDTH = 3, MOST = BASE * BASE * BASE };
    static unsigned number;
    size_t length = strlen(name);
    size_t width = length < WIDTH ? length : WIDTH;
    (void)snprintf(found, TL_ELF_LIBRARY, "%s", name);
    for (unsigned tries = 0; tries < MOST; tries++) {
        number = (number + 1) % MOST;
        unsigned rest = number;
        for (size_t i = width; i > 0; i--) {
            found[i - 1] = digits[rest % BASE];
            rest /= BASE;
        }
        if (is_free(work, found)) {
            return true;
        }
    }
    return false;
}

static tl_status add_rename(making *work, const char *name) {
    tl_elf_rename *grown = grow(work->renames, work->rename_count, sizeof *grown);
    if (grown == NULL) {
        return fail_memory(work);
    }
    work->renames = grown;
    tl_elf_rename *added = &grown[work->rename_count];
    (void)snprintf(added->old_name, sizeof added->old_name, "%s", name);
    if (!find_name(work, name, added->new_name)) {
        return tl_fail(
            work->error, TL_BAD_DATA,
            "%s: another FMU has a library %.120s too, and no name is left for a copy; rename it in one of them",
            work->label, name);
    }
    work->rename_count++;
    return TL_OK;
}

/* One library's names. */
typedef struct looking {
    making *work;
    const tl_elf_file *file;
    tl_status status;
} looking;

/* It is not in the FMU, so there is nothing to make a copy of. */
static void warn_of_strange(const looking *look, const char *name) {
    tl_log(
        TL_LOG_WARNING,
        "%s needs %.120s, which is not in it: it gets that of another FMU, and both share its variables; export it with that library",
        look->work->label, name);
}

/* What it needs and would get from another FMU, of which it has one beside it. A name with a slash is a path, and so it is its own. */
static bool look_at(void *context, tl_elf_reference reference) {
    looking *look = context;
    const char *name = reference.kind == TL_ELF_NEEDED ? tl_elf_text(look->file, reference.offset) : NULL;
    if (name == NULL || name[0] == '\0' || strchr(name, '/') != NULL || is_renamed(look->work, name) ||
        is_of_the_system(name) || !is_taken(name)) {
        return true;
    }
    if (library_called(look->work, name) == NULL) {
        warn_of_strange(look, name);
        return true;
    }
    look->status = add_rename(look->work, name);
    return look->status == TL_OK;
}

static tl_status find_renames(making *work) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < work->library_count && status == TL_OK; i++) {
        looking look = {work, &work->libraries[i].file, TL_OK};
        tl_elf_visit(look.file, look_at, &look);
        status = look.status;
    }
    return status;
}

/* ---- Changing ------------------------------------------------------------------------------------------- */

static tl_status change_library(const making *work, own_library *library) {
    switch (tl_elf_rename_libraries(&library->file, work->renames, work->rename_count)) {
    case TL_ELF_NO_MEMORY:
        return fail_memory(work);
    case TL_ELF_CONFLICT:
        return tl_fail(
            work->error, TL_BAD_DATA,
            "%s: its libraries have names that another FMU's have, such as %.80s, and in %.80s another name is part of one of "
            "them, so that no copy can be made; rename the libraries of one of the FMUs",
            work->label, work->renames[0].old_name, library->name);
    case TL_ELF_DONE:
        break;
    }
    (void)tl_elf_part_unique(&library->file);
    return TL_OK;
}

/* Beside it, by its new name. */
static tl_status write_copy(const making *work, const own_library *library, const char *name) {
    char path[PATH_MAX];
    int length = snprintf(path, sizeof path, "%.*s%s", (int)(library->name - library->path), library->path, name);
    int file = length < (int)sizeof path
                   ? open(path, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, S_IRUSR | S_IWUSR | S_IXUSR)
                   : -1;
    bool done = file >= 0 && tl_file_bytes_write(file, library->bytes, library->size);
    int code = errno;
    if (file >= 0 && close(file) != 0 && done) {
        done = false;
        code = errno;
    }
    return done ? TL_OK : fail_system(work, library->path, "copied", code);
}

static tl_status change_all(making *work) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < work->library_count && status == TL_OK; i++) {
        status = change_library(work, &work->libraries[i]);
    }
    for (size_t i = 0; i < work->library_count && status == TL_OK; i++) {
        for (size_t k = 0; k < work->rename_count && status == TL_OK; k++) {
            if (strcmp(work->renames[k].old_name, work->libraries[i].name) == 0) {
                status = write_copy(work, &work->libraries[i], work->renames[k].new_name);
            }
        }
    }
    return status;
}

/* ---- What cannot be seen -------------------------------------------------------------------------------- */

/* Another FMU has had a library in the same place. */
static bool others_have(const making *work, const own_library *library) {
    char path[PATH_MAX];
    for (const fmu_folder *folder = folders; folder != NULL; folder = folder->next) {
        int length = snprintf(path, sizeof path, "%s%s", folder->path, library->path + strlen(work->folder));
        if (length < (int)sizeof path && access(path, F_OK) == 0) {
            return true;
        }
    }
    return false;
}

/* The binary itself does not count, as nobody opens it by a bare name. */
static void warn_of_opening(const making *work) {
    bool opens = false;
    for (size_t i = 0; i < work->library_count && !opens; i++) {
        opens = tl_elf_opens_libraries(&work->libraries[i].file);
    }
    for (size_t i = 1; i < work->library_count && opens; i++) {
        const own_library *library = &work->libraries[i];
        if (others_have(work, library)) {
            tl_log(
                TL_LOG_WARNING,
                "%s can open libraries while it runs (dlopen), and has a %.120s as another FMU has: if it opens that by its bare name, "
                "both share its variables",
                work->label, library->name);
            return;
        }
    }
}

/* ---- All of it ------------------------------------------------------------------------------------------ */

static tl_status make_copies(making *work, const char *binary) {
    tl_status status = find_libraries(work, binary);
    if (status == TL_OK) {
        status = find_renames(work);
    }
    if (status == TL_OK) {
        status = change_all(work);
    }
    if (status == TL_OK) {
        warn_of_opening(work);
    }
    return status;
}

tl_status tl_own_copies_make(const char *folder, const char *binary, const char *label, tl_error *error) {
    making work = {.folder = folder, .label = label, .error = error};
    tl_status status = folders == NULL ? TL_OK : make_copies(&work, binary);
    for (size_t i = 0; i < work.library_count; i++) {
        forget_library(&work.libraries[i]);
    }
    for (size_t i = 0; i < work.folder_count; i++) {
        free(work.folders[i]);
    }
    free(work.folders);
    free(work.libraries);
    free(work.renames);
    if (status == TL_OK && !remember(folder)) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory; free some and try again", label);
    }
    return status;
}
