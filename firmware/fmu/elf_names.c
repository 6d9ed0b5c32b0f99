/* Changed names: see elf_names.h. */
#include "firmware/fmu/elf_names.h"

#include <elf.h>
#include <stdlib.h>
#include <string.h>

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
