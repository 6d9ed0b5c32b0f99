/* Renamed copies of an FMU's libraries, see own_copies.h. */
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

/* ---- A shared library in memory. Only read_at() copies structures from the file and only locate()
 * finds positions; both check the file's size. */

/* ---- Numbers --------------------------------------------------------------------------------- */

/* Copies `size` bytes at `offset`; zeros if they are not all within the file. */
static void read_at(const tl_elf_file *file, size_t offset, void *to, size_t size) {
    memset(to, 0, size);
    if (offset <= file->size && file->size - offset >= size) {
        memcpy(to, file->bytes + offset, size);
    }
}

static uint32_t word_at(const tl_elf_file *file, size_t offset) {
    uint32_t word;
    read_at(file, offset, &word, sizeof word);
    return word;
}

/* ---- Positions ------------------------------------------------------------------------------- */

/* Finds the file offset of memory `address`, and the number of bytes from there to the end of the
 * segment. Returns false if no segment contains it. If two segments overlap, the later one counts,
 * as for the loader. */
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

/* Segments are cut at the end of the file. */
static bool read_segments(tl_elf_file *file, const ElfW(Ehdr) * head) {
    if (head->e_phentsize != sizeof(ElfW(Phdr)) || head->e_phnum > TL_ELF_SEGMENTS) {
        return false;
    }
    for (size_t i = 0; i < head->e_phnum; i++) {
        ElfW(Phdr) header;
        read_at(file, (size_t)head->e_phoff + i * sizeof header, &header, sizeof header);
        uint64_t rest = header.p_offset < file->size ? file->size - header.p_offset : 0;
        tl_elf_segment segment = {header.p_vaddr, header.p_offset, header.p_filesz < rest ? header.p_filesz : rest};
        if (header.p_type == PT_LOAD) {
            file->loads[file->load_count++] = segment;
        } else if (header.p_type == PT_DYNAMIC) {
            file->dynamic = segment;
        }
    }
    return true;
}

/* ---- The dynamic section --------------------------------------------------------------------- */

static ElfW(Dyn) entry_at(const tl_elf_file *file, size_t index) {
    ElfW(Dyn) entry;
    read_at(file, (size_t)file->dynamic.offset + index * sizeof entry, &entry, sizeof entry);
    return entry;
}

/* The value of the last entry with this tag. Returns false if no entry has it. */
static bool find_entry(const tl_elf_file *file, int64_t tag, uint64_t *value) {
    for (size_t i = file->entry_count; i > 0; i--) {
        ElfW(Dyn) entry = entry_at(file, i - 1);
        if (entry.d_tag == tag) {
            *value = entry.d_un.d_val;
            return true;
        }
    }
    return false;
}

/* The loader finds the section by its address, not by its file offset. */
static bool read_dynamic(tl_elf_file *file) {
    size_t offset = 0;
    size_t room = 0;
    if (!locate(file, file->dynamic.address, &offset, &room)) {
        return false;
    }
    file->dynamic.offset = offset;
    size_t most = room / sizeof(ElfW(Dyn));
    most = most < TL_ELF_ENTRIES ? most : TL_ELF_ENTRIES;
    while (file->entry_count < most && entry_at(file, file->entry_count).d_tag != DT_NULL) {
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

/* ---- Symbols --------------------------------------------------------------------------------- */

#define WORD sizeof(uint32_t) /* in both hash tables, on all supported machines */

/* Number of symbols according to DT_GNU_HASH: the last chain ends with an odd value. 0: the file
 * defines no symbols. */
static size_t count_hashed(const tl_elf_file *file, size_t table, size_t room) {
    uint64_t buckets = word_at(file, table);
    uint64_t first = word_at(file, table + WORD);
    uint64_t filter = (uint64_t)word_at(file, table + 2 * WORD) * sizeof(ElfW(Addr));
    uint64_t chains = 4 * WORD + filter + buckets * WORD; /* offset from the start of the table */
    uint64_t last = 0;
    if (chains > room) {
        return 0;
    }
    for (uint64_t i = 0; i < buckets; i++) {
        uint64_t begin = word_at(file, table + (size_t)(4 * WORD + filter + i * WORD));
        last = begin > last ? begin : last;
    }
    if (last < first) {
        return 0;
    }
    uint64_t at = chains + (last - first) * WORD;
    while (at + WORD <= room && (word_at(file, table + (size_t)at) & 1U) == 0) {
        at += WORD;
        last++;
    }
    return (size_t)last + 1;
}

static void read_symbols(tl_elf_file *file) {
    uint64_t address = 0;
    uint64_t hashes = 0;
    uint64_t names = 0;
    size_t room = 0;
    size_t table = 0;
    size_t rest = 0;
    if (!find_entry(file, DT_SYMTAB, &address) || !locate(file, address, &file->symbols, &room)) {
        return;
    }
    size_t count = 0;
    if (find_entry(file, DT_HASH, &hashes) && locate(file, hashes, &table, &rest)) {
        count = word_at(file, table + WORD);
    } else if (find_entry(file, DT_GNU_HASH, &hashes) && locate(file, hashes, &table, &rest)) {
        count = count_hashed(file, table, rest);
    }
    if (count == 0 && find_entry(file, DT_STRTAB, &names) && names > address) {
        count = (size_t)((names - address) / sizeof(ElfW(Sym))); /* no defined symbols; the string table follows */
    }
    file->symbol_count = count < room / sizeof(ElfW(Sym)) ? count : room / sizeof(ElfW(Sym));
}

tl_elf_symbol tl_elf_symbol_at(const tl_elf_file *file, size_t index) {
    ElfW(Sym) symbol;
    size_t at = file->symbols + index * sizeof symbol;
    read_at(file, at, &symbol, sizeof symbol);
    return (tl_elf_symbol){
        .name = symbol.st_name < file->strings_size ? symbol.st_name : TL_ELF_NO_NAME,
        .info = file->bytes + at + offsetof(ElfW(Sym), st_info),
        .is_defined = symbol.st_shndx != SHN_UNDEF,
    };
}

/* Symbols may share names. A hostile file could let millions of symbols share a name of millions of
 * bytes, and reading them all would take too long. */
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

/* ---- Opening --------------------------------------------------------------------------------- */

bool tl_elf_open(tl_elf_file *file, uint8_t *bytes, size_t size) {
    enum { CLASS = sizeof(void *) == 8 ? ELFCLASS64 : ELFCLASS32 };
    enum { ORDER = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? ELFDATA2LSB : ELFDATA2MSB };
    ElfW(Ehdr) head;
    *file = (tl_elf_file){.bytes = bytes, .size = size};
    read_at(file, 0, &head, sizeof head);
    if (memcmp(head.e_ident, ELFMAG, SELFMAG) != 0 || head.e_ident[EI_CLASS] != CLASS ||
        head.e_ident[EI_DATA] != ORDER || head.e_type != ET_DYN) {
        return false;
    }
    file->machine = head.e_machine;
    if (!read_segments(file, &head) || !read_dynamic(file) || !read_strings(file)) {
        return false;
    }
    read_symbols(file);
    return names_are_bounded(file);
}

/* ---- References ------------------------------------------------------------------------------ */

typedef struct visit_work {
    const tl_elf_file *file;
    tl_elf_visitor *visitor;
    void *context;
    size_t versions_left;
} visit_work;

/* A name outside of the string table is ignored. */
static bool report_name(const visit_work *work, tl_elf_kind kind, uint64_t offset) {
    tl_elf_reference reference = {kind, (size_t)offset};
    return offset >= work->file->strings_size || work->visitor(work->context, reference);
}

static bool visit_entries(const visit_work *work) {
    static const struct {
        int64_t tag;
        tl_elf_kind kind;
    } known[] = {{DT_NEEDED, TL_ELF_NEEDED},  {DT_SONAME, TL_ELF_NAME},     {DT_RPATH, TL_ELF_OTHER},
                 {DT_RUNPATH, TL_ELF_OTHER},  {DT_AUXILIARY, TL_ELF_OTHER}, {DT_FILTER, TL_ELF_OTHER},
                 {DT_DEPAUDIT, TL_ELF_OTHER}, {DT_AUDIT, TL_ELF_OTHER},     {DT_CONFIG, TL_ELF_OTHER}};
    for (size_t i = 0; i < work->file->entry_count; i++) {
        ElfW(Dyn) entry = entry_at(work->file, i);
        for (size_t k = 0; k < sizeof known / sizeof known[0]; k++) {
            if (entry.d_tag == known[k].tag && !report_name(work, known[k].kind, entry.d_un.d_val)) {
                return false;
            }
        }
    }
    return true;
}

/* The version tables are lists of entries, and each entry has an inner list. All entries end with
 * two 32-bit values: the distance to the inner list (or the offset of a name), and the distance to
 * the next entry. */
typedef struct member_end {
    uint32_t inner;
    uint32_t next;
} member_end;

static member_end read_end(const tl_elf_file *file, size_t member, size_t size) {
    member_end end;
    read_at(file, member + size - sizeof end, &end, sizeof end);
    return end;
}

/* Advances *at by `distance` bytes. Returns false if there is no entry within the file. */
static bool advance_entry(const tl_elf_file *file, size_t *at, uint64_t distance, size_t size) {
    if (distance == 0 || distance > file->size || *at > file->size - (size_t)distance ||
        file->size - *at - (size_t)distance < size) {
        return false;
    }
    *at += (size_t)distance;
    return true;
}

/* `kind` belongs to the first name; all others are TL_ELF_OTHER. */
static bool visit_list(visit_work *work, size_t at, uint64_t distance, size_t size, tl_elf_kind kind) {
    for (bool more = advance_entry(work->file, &at, distance, size); more && work->versions_left > 0;) {
        member_end end = read_end(work->file, at, size);
        work->versions_left--;
        if (!report_name(work, kind, end.inner)) {
            return false;
        }
        kind = TL_ELF_OTHER;
        more = advance_entry(work->file, &at, end.next, size);
    }
    return true;
}

/* An entry of needed versions contains the name of a library. The base entry of defined versions
 * contains the name of this library. */
static bool visit_versions(visit_work *work, bool needed) {
    size_t size = needed ? sizeof(ElfW(Verneed)) : sizeof(ElfW(Verdef));
    size_t inner_size = needed ? sizeof(ElfW(Vernaux)) : sizeof(ElfW(Verdaux));
    uint64_t address = 0;
    size_t at = 0;
    size_t room = 0;
    if (!find_entry(work->file, needed ? DT_VERNEED : DT_VERDEF, &address) ||
        !locate(work->file, address, &at, &room) || room < size) {
        return true;
    }
    for (bool more = true; more && work->versions_left > 0;) {
        member_end end = read_end(work->file, at, size);
        ElfW(Verdef) defined;
        read_at(work->file, at, &defined, sizeof defined);
        bool is_base = !needed && (defined.vd_flags & VER_FLG_BASE) != 0;
        work->versions_left--;
        if ((needed &&
             !report_name(work, TL_ELF_VERSION, word_at(work->file, at + offsetof(ElfW(Verneed), vn_file)))) ||
            !visit_list(work, at, end.inner, inner_size, is_base ? TL_ELF_VERSION : TL_ELF_OTHER)) {
            return false;
        }
        more = advance_entry(work->file, &at, end.next, size);
    }
    return true;
}

void tl_elf_visit(const tl_elf_file *file, tl_elf_visitor *visitor, void *context) {
    visit_work work = {.file = file, .visitor = visitor, .context = context, .versions_left = TL_ELF_VERSIONS};
    bool more = visit_entries(&work) && visit_versions(&work, true) && visit_versions(&work, false);
    for (size_t i = 0; i < file->symbol_count && more; i++) {
        size_t name = tl_elf_symbol_at(file, i).name;
        more = name == TL_ELF_NO_NAME || report_name(&work, TL_ELF_OTHER, name);
    }
}

const char *tl_elf_text(const tl_elf_file *file, size_t offset) {
    const char *text = (const char *)file->bytes + file->strings + offset;
    return offset < file->strings_size && memchr(text, '\0', file->strings_size - offset) != NULL ? text : NULL;
}

/* ---- elf names ---- */

/* ---- Libraries ------------------------------------------------------------------------------- */

typedef struct change {
    tl_elf_file *file;
    const tl_elf_rename *renames;
    size_t count;
    tl_elf_file was; /* the original names only */
    bool failed;
} change;

/* The new name of a library; NULL: it is not renamed. */
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

/* Reads the original names, because a change may have made one name equal to another. */
static bool write_name(void *context, tl_elf_reference reference) {
    change *work = context;
    const char *text = reference.kind == TL_ELF_OTHER ? NULL : tl_elf_text(&work->was, reference.offset);
    const char *wanted = text == NULL ? NULL : new_name_of(work, text);
    if (wanted != NULL) {
        memcpy(names_of(work) + reference.offset, wanted, strlen(wanted));
    }
    return true;
}

/* The end of the name is unchanged, because the new name has the same length. */
static bool check_name(void *context, tl_elf_reference reference) {
    change *work = context;
    const char *was = tl_elf_text(&work->was, reference.offset);
    if (was == NULL) {
        return true; /* without an end the loader cannot use it either */
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
    work.was = (tl_elf_file){.bytes = malloc(file->strings_size), .strings_size = file->strings_size};
    if (work.was.bytes == NULL) {
        return TL_ELF_NO_MEMORY;
    }
    memcpy(work.was.bytes, names_of(&work), file->strings_size);
    tl_elf_visit(file, write_name, &work);
    tl_elf_visit(file, check_name, &work);
    free(work.was.bytes);
    return work.failed ? TL_ELF_CONFLICT : TL_ELF_DONE;
}

/* ---- Symbols --------------------------------------------------------------------------------- */

static bool begins_with(const char *text, const char *prefix) {
    return strncmp(text, prefix, strlen(prefix)) == 0;
}

/* Reads the mangled name: after prefixes (guard, local of a function, nested name, const) comes
 * std:: or __gnu_cxx::. */
static bool is_language_symbol(const char *name) {
    static const char *const libraries[] = {"St", "Sa", "Ss", "Sb", "Si", "So", "Sd", "9__gnu_cxx", "10__cxxabiv1"};
    static const char *const prefixes[] = {"GV", "GR", "TV", "TI", "TS", "TT", "Z", "N", "K"};
    if (!begins_with(name, "_Z")) {
        return false;
    }
    const char *rest = name + 2;
    for (size_t i = 0; i < sizeof prefixes / sizeof prefixes[0];) {
        bool is_prefix = begins_with(rest, prefixes[i]);
        rest += is_prefix ? strlen(prefixes[i]) : 0;
        i = is_prefix ? 0 : i + 1;
    }
    for (size_t i = 0; i < sizeof libraries / sizeof libraries[0]; i++) {
        if (begins_with(rest, libraries[i])) {
            return true;
        }
    }
    return false;
}

size_t tl_elf_unshare_symbols(tl_elf_file *file) {
    size_t changed = 0;
    for (size_t i = 0; i < file->symbol_count; i++) {
        tl_elf_symbol symbol = tl_elf_symbol_at(file, i);
        if (ELF64_ST_BIND(*symbol.info) != STB_GNU_UNIQUE || !symbol.is_defined || symbol.name == TL_ELF_NO_NAME) {
            continue;
        }
        const char *name = tl_elf_text(file, symbol.name);
        if (name != NULL && !is_language_symbol(name)) {
            *symbol.info = (uint8_t)ELF64_ST_INFO(STB_GLOBAL, ELF64_ST_TYPE(*symbol.info));
            changed++;
        }
    }
    return changed;
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

typedef struct own_library {
    struct own_library *next;
    const char *name; /* points to the last part of `path` */
    uint8_t *bytes;   /* the file, mapped shared: changes here are written to the file */
    size_t size;
    tl_elf_file file;
    char path[];
} own_library;

typedef struct fmu_folder {
    struct fmu_folder *next;
    char path[];
} fmu_folder;

typedef struct copy_work {
    const char *folder;
    fmu_folder *subfolders; /* subfolders that are still to be searched */
    const char *label;
    tl_error *error;
    own_library *libraries; /* the first one is the binary */
    own_library **end;      /* end of that list */
    tl_elf_rename *renames;
    size_t rename_count;
} copy_work;

static bool is_below(const char *path, const char *folder) {
    size_t length = strlen(folder);
    return strncmp(path, folder, length) == 0 && path[length] == '/';
}

/* `path`: of a library, or of the folder if all are affected. */
static tl_status fail_system(const copy_work *work, const char *path, const char *doing, int code) {
    const char *shown = is_below(path, work->folder) ? path + strlen(work->folder) + 1 : "(its folder)";
    return tl_fail(work->error, TL_TRY_AGAIN,
                   "%s: its library %.120s cannot be %s: %s; free memory, descriptors or disk and try again",
                   work->label, shown, doing, strerror(code));
}

static tl_status fail_memory(const copy_work *work) {
    return tl_fail(work->error, TL_TRY_AGAIN, "%s: not enough memory; free memory and try again", work->label);
}

/* ---- Folders of FMUs ------------------------------------------------------------------------- */

/* Folders of all FMUs that this process has loaded. */
static fmu_folder *fmu_folders;

static bool add_folder(fmu_folder **list, const char *path) {
    size_t size = strlen(path) + 1;
    fmu_folder *folder = malloc(sizeof *folder + size);
    if (folder == NULL) {
        return false;
    }
    memcpy(folder->path, path, size);
    folder->next = *list;
    *list = folder;
    return true;
}

/* ---- Libraries of this one ------------------------------------------------------------------- */

static tl_status map_file(const copy_work *work, own_library *library) {
    struct stat facts;
    tl_status status = TL_OK;
    int file = open(library->path, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) {
        return fail_system(work, library->path, "opened", errno);
    }
    if (fstat(file, &facts) == 0 && S_ISREG(facts.st_mode) && facts.st_size > 0) {
        library->size = (size_t)facts.st_size;
        void *bytes = mmap(NULL, library->size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        if (bytes == MAP_FAILED) {
            status = fail_system(work, library->path, "read", errno);
        } else {
            library->bytes = bytes;
        }
    }
    (void)close(file);
    return status;
}

static void free_library(own_library *library) {
    if (library->bytes != NULL) {
        (void)munmap(library->bytes, library->size);
    }
    free(library);
}

/* Skips files that are not libraries for the binary's machine. */
static tl_status add_library(copy_work *work, const char *path) {
    size_t size = strlen(path) + 1;
    own_library *added = calloc(1, sizeof *added + size);
    if (added == NULL) {
        return fail_memory(work);
    }
    memcpy(added->path, path, size);
    added->name = strrchr(added->path, '/') + 1;
    tl_status status = map_file(work, added);
    if (added->bytes != NULL && tl_elf_open(&added->file, added->bytes, added->size) &&
        (work->libraries == NULL || added->file.machine == work->libraries->file.machine)) {
        *work->end = added;
        work->end = &added->next;
    } else {
        free_library(added);
    }
    return status;
}

/* Remembers folders for later. Links are not followed. */
static tl_status add_entry(copy_work *work, const char *folder, const char *name) {
    char path[PATH_MAX];
    struct stat facts;
    if (strcmp(name, ".") == 0 || strcmp(name, "..") == 0) {
        return TL_OK;
    }
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path) {
        return fail_system(work, folder, "found", ENAMETOOLONG);
    }
    if (lstat(path, &facts) != 0) {
        return fail_system(work, path, "found", errno);
    }
    if (S_ISDIR(facts.st_mode)) {
        return add_folder(&work->subfolders, path) ? TL_OK : fail_memory(work);
    }
    bool is_library = strstr(name, ".so") != NULL && strcmp(path, work->libraries->path) != 0;
    return is_library && S_ISREG(facts.st_mode) ? add_library(work, path) : TL_OK;
}

static tl_status read_folder(copy_work *work, const char *folder) {
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

/* Searches the whole folder, because an FMU may have libraries among its resources. */
static tl_status find_libraries(copy_work *work, const char *binary) {
    tl_status status = add_library(work, binary);
    if (status != TL_OK || work->libraries == NULL) {
        return status;
    }
    status = read_folder(work, work->folder);
    while (work->subfolders != NULL) {
        fmu_folder *folder = work->subfolders;
        work->subfolders = folder->next;
        status = status == TL_OK ? read_folder(work, folder->path) : status;
        free(folder);
    }
    return status;
}

static const own_library *find_library(const copy_work *work, const char *name) {
    const own_library *library = work->libraries;
    while (library != NULL && strcmp(library->name, name) != 0) {
        library = library->next;
    }
    return library;
}

/* ---- Names ----------------------------------------------------------------------------------- */

/* The loader's handle of this name; NULL: not loaded. Loads nothing. */
static void *find_loaded(const char *name) {
    void *found = dlopen(name, RTLD_LAZY | RTLD_NOLOAD);
    (void)dlerror();
    return found;
}

/* Returns true if the loader would use another FMU's library for this name. */
static bool is_taken(const char *name) {
    struct link_map *map = NULL;
    void *found = find_loaded(name);
    if (found == NULL) {
        return false;
    }
    bool taken = false;
    bool is_known = dlinfo(found, RTLD_DI_LINKMAP, &map) == 0 && map != NULL;
    for (const fmu_folder *folder = fmu_folders; folder != NULL && is_known; folder = folder->next) {
        taken = taken || is_below(map->l_name, folder->path);
    }
    (void)dlclose(found);
    return taken;
}

/* Libraries that must exist once per process. */
static bool is_system_library(const char *name) {
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

static bool is_renamed(const copy_work *work, const char *name) {
    for (size_t i = 0; i < work->rename_count; i++) {
        if (strcmp(work->renames[i].old_name, name) == 0 || strcmp(work->renames[i].new_name, name) == 0) {
            return true;
        }
    }
    return false;
}

/* Replaces the first characters by a number that is free in this process: libtable.so becomes
 * 001table.so. Returns false if none is free. */
static bool find_name(const copy_work *work, const char *name, char found[TL_ELF_LIBRARY]) {
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
        void *loaded = find_loaded(found);
        if (loaded != NULL) {
            (void)dlclose(loaded);
        } else if (find_library(work, found) == NULL && !is_renamed(work, found)) {
            return true; /* free: neither this FMU nor the loader has it */
        }
    }
    return false;
}

static tl_status add_rename(copy_work *work, const char *name) {
    tl_elf_rename *grown = realloc(work->renames, (work->rename_count + 1) * sizeof *grown);
    if (grown == NULL) {
        return fail_memory(work);
    }
    work->renames = grown;
    tl_elf_rename *added = &grown[work->rename_count];
    (void)snprintf(added->old_name, sizeof added->old_name, "%s", name);
    if (!find_name(work, name, added->new_name)) {
        return tl_fail(
            work->error, TL_BAD_DATA,
            "%s: library %.120s also exists in another FMU, and no free name is left for a copy: rename it in one FMU",
            work->label, name);
    }
    work->rename_count++;
    return TL_OK;
}

/* The visit of one library's names. */
typedef struct needed_search {
    copy_work *work;
    const tl_elf_file *file;
    tl_status status;
} needed_search;

/* Finds a needed library that the loader would take from another FMU, and that this FMU contains
 * too. A name with a slash is a path and needs no change. */
static bool check_needed(void *context, tl_elf_reference reference) {
    needed_search *search = context;
    const char *name = reference.kind == TL_ELF_NEEDED ? tl_elf_text(search->file, reference.offset) : NULL;
    if (name == NULL || name[0] == '\0' || strchr(name, '/') != NULL || is_renamed(search->work, name) ||
        is_system_library(name) || !is_taken(name)) {
        return true;
    }
    if (find_library(search->work, name) == NULL) {
        tl_log(
            TL_LOG_WARNING, /* no file to copy */
            "%s: library %.120s is missing, so the FMU uses that of another FMU and shares its variables: export the "
            "FMU with this library",
            search->work->label, name);
        return true;
    }
    search->status = add_rename(search->work, name);
    return search->status == TL_OK;
}

/* ---- Changing -------------------------------------------------------------------------------- */

static tl_status change_library(const copy_work *work, own_library *library) {
    switch (tl_elf_rename_libraries(&library->file, work->renames, work->rename_count)) {
    case TL_ELF_NO_MEMORY:
        return fail_memory(work);
    case TL_ELF_CONFLICT:
        return tl_fail(
            work->error, TL_BAD_DATA,
            "%s: library %.80s also exists in another FMU, and cannot be copied because %.80s uses a part of its "
            "name: rename the libraries of one FMU",
            work->label, work->renames[0].old_name, library->name);
    case TL_ELF_DONE:
        break;
    }
    (void)tl_elf_unshare_symbols(&library->file);
    return TL_OK;
}

/* Writes the copy into the same folder under its new name. */
static tl_status write_copy(const copy_work *work, const own_library *library, const char *name) {
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

static tl_status change_all(copy_work *work) {
    tl_status status = TL_OK;
    for (own_library *library = work->libraries; library != NULL && status == TL_OK; library = library->next) {
        status = change_library(work, library);
        for (size_t i = 0; i < work->rename_count && status == TL_OK; i++) {
            if (strcmp(work->renames[i].old_name, library->name) == 0) {
                status = write_copy(work, library, work->renames[i].new_name);
            }
        }
    }
    return status;
}

/* ---- Undetected sharing -------------------------------------------------------------------- */

/* Returns true if another FMU has had a library at the same relative path. */
static bool exists_elsewhere(const copy_work *work, const own_library *library) {
    char path[PATH_MAX];
    for (const fmu_folder *folder = fmu_folders; folder != NULL; folder = folder->next) {
        int length = snprintf(path, sizeof path, "%s%s", folder->path, library->path + strlen(work->folder));
        if (length < (int)sizeof path && access(path, F_OK) == 0) {
            return true;
        }
    }
    return false;
}

/* The binary itself does not count, because libraries do not open it by its name. */
static void warn_shared(const copy_work *work) {
    bool opens = false;
    for (const own_library *library = work->libraries; library != NULL && !opens; library = library->next) {
        opens = tl_elf_opens_libraries(&library->file);
    }
    for (const own_library *library = work->libraries; opens && library != NULL; library = library->next) {
        if (library != work->libraries && exists_elsewhere(work, library)) {
            tl_log(TL_LOG_WARNING,
                   "%s: opens libraries at run time (dlopen), and library %.120s also exists in another FMU: if opened "
                   "by name, both share its variables; rename it in one FMU",
                   work->label, library->name);
            return;
        }
    }
}

/* ---- All of it ------------------------------------------------------------------------------- */

static tl_status make_copies(copy_work *work, const char *binary) {
    tl_status status = find_libraries(work, binary);
    for (const own_library *library = work->libraries; library != NULL && status == TL_OK; library = library->next) {
        needed_search search = {work, &library->file, TL_OK};
        tl_elf_visit(search.file, check_needed, &search);
        status = search.status;
    }
    if (status == TL_OK) {
        status = change_all(work);
    }
    if (status == TL_OK) {
        warn_shared(work);
    }
    return status;
}

tl_status tl_own_copies_make(const char *folder, const char *binary, const char *label, tl_error *error) {
    copy_work work = {.folder = folder, .label = label, .error = error, .end = &work.libraries};
    tl_status status = fmu_folders == NULL ? TL_OK : make_copies(&work, binary);
    for (own_library *library = work.libraries, *next = NULL; library != NULL; library = next) {
        next = library->next;
        free_library(library);
    }
    free(work.renames);
    return status == TL_OK && !add_folder(&fmu_folders, folder) ? fail_memory(&work) : status;
}
