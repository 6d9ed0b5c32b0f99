/* FMUs put together in memory and written by libzip. */
#include "tests/support/fmu_maker.h"

#include <elf.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

typedef struct maker_entry {
    char *name;
    unsigned char *bytes; /* `size` and a NUL */
    size_t size;
    unsigned mode;
    bool encrypted;
    bool bzip2;
} maker_entry;

struct tl_fmu_maker {
    maker_entry *entries;
    size_t count;
};

/* ---- Entries
 * ------------------------------------------------------------------------------------------- */

static maker_entry *find(const tl_fmu_maker *maker, const char *name) {
    for (size_t i = 0; i < maker->count; i++) {
        if (strcmp(maker->entries[i].name, name) == 0) {
            return &maker->entries[i];
        }
    }
    return NULL;
}

static maker_entry *append(tl_fmu_maker *maker, const char *name) {
    maker_entry *grown = realloc(maker->entries, (maker->count + 1) * sizeof(maker_entry));
    char *copy = strdup(name);
    if (grown == NULL || copy == NULL) {
        free(copy);
        maker->entries = grown == NULL ? maker->entries : grown;
        return NULL;
    }
    maker->entries = grown;
    maker_entry *entry = &grown[maker->count];
    maker->count++;
    *entry = (maker_entry){.name = copy, .mode = S_IFREG | 0644};
    return entry;
}

/* Stores the bytes, and owns them from now on. */
static bool put(tl_fmu_maker *maker, const char *name, unsigned char *bytes, size_t size) {
    maker_entry *entry = find(maker, name);
    if (entry == NULL) {
        entry = append(maker, name);
    }
    if (entry == NULL) {
        free(bytes);
        return false;
    }
    free(entry->bytes);
    entry->bytes = bytes;
    entry->size = size;
    return true;
}

bool tl_fmu_maker_put(tl_fmu_maker *maker, const char *name, const void *bytes, size_t size) {
    unsigned char *copy = calloc(1, size + 1);
    if (copy == NULL) {
        return false;
    }
    if (bytes != NULL) {
        memcpy(copy, bytes, size);
    }
    return put(maker, name, copy, size);
}

bool tl_fmu_maker_put_text(tl_fmu_maker *maker, const char *name, const char *text) {
    return tl_fmu_maker_put(maker, name, text, strlen(text));
}

bool tl_fmu_maker_remove(tl_fmu_maker *maker, const char *name) {
    maker_entry *entry = find(maker, name);
    if (entry == NULL) {
        return false;
    }
    free(entry->name);
    free(entry->bytes);
    size_t behind = maker->count - 1 - (size_t)(entry - maker->entries);
    memmove(entry, entry + 1, behind * sizeof(maker_entry));
    maker->count--;
    return true;
}

bool tl_fmu_maker_rename(tl_fmu_maker *maker, const char *from, const char *to) {
    maker_entry *entry = find(maker, from);
    char *copy = strdup(to);
    if (entry == NULL || copy == NULL) {
        free(copy);
        return false;
    }
    free(entry->name);
    entry->name = copy;
    return true;
}

bool tl_fmu_maker_set_mode(tl_fmu_maker *maker, const char *name, unsigned mode) {
    maker_entry *entry = find(maker, name);
    if (entry != NULL) {
        entry->mode = mode;
    }
    return entry != NULL;
}

bool tl_fmu_maker_encrypt(tl_fmu_maker *maker, const char *name) {
    maker_entry *entry = find(maker, name);
    if (entry != NULL) {
        entry->encrypted = true;
    }
    return entry != NULL;
}

bool tl_fmu_maker_use_bzip2(tl_fmu_maker *maker, const char *name) {
    maker_entry *entry = find(maker, name);
    if (entry != NULL) {
        entry->bzip2 = true;
    }
    return entry != NULL;
}

const char *tl_fmu_maker_find(const tl_fmu_maker *maker, const char *ending) {
    for (size_t i = 0; i < maker->count; i++) {
        const char *name = maker->entries[i].name;
        size_t length = strlen(name);
        if (length >= strlen(ending) && strcmp(name + length - strlen(ending), ending) == 0) {
            return name;
        }
    }
    return NULL;
}

unsigned char *tl_fmu_maker_content(tl_fmu_maker *maker, const char *name, size_t *size) {
    maker_entry *entry = find(maker, name);
    *size = entry == NULL ? 0 : entry->size;
    return entry == NULL ? NULL : entry->bytes;
}

/* ---- Changes
 * ------------------------------------------------------------------------------------------- */

/* Overwrites each occurrence of `from`. Returns their number. */
static size_t patch(unsigned char *bytes, size_t length, const void *from, const void *to, size_t size) {
    size_t count = 0;
    for (size_t i = 0; i + size <= length; i++) {
        if (memcmp(bytes + i, from, size) == 0) {
            memcpy(bytes + i, to, size);
            count++;
        }
    }
    return count;
}

bool tl_fmu_maker_patch(tl_fmu_maker *maker, const char *name, const void *from, const void *to, size_t size) {
    maker_entry *entry = find(maker, name);
    return entry != NULL && patch(entry->bytes, entry->size, from, to, size) > 0;
}

bool tl_fmu_maker_replace(tl_fmu_maker *maker, const char *name, const char *from, const char *to) {
    maker_entry *entry = find(maker, name);
    if (entry == NULL) {
        return false;
    }
    size_t capacity = entry->size * (1 + strlen(to)) + 1;
    char *result = malloc(capacity);
    if (result == NULL) {
        return false;
    }
    bool found = false;
    char *end = result;
    const char *rest = (const char *)entry->bytes;
    for (const char *hit = strstr(rest, from); hit != NULL; hit = strstr(rest, from)) {
        memcpy(end, rest, (size_t)(hit - rest));
        end += hit - rest;
        memcpy(end, to, strlen(to));
        end += strlen(to);
        rest = hit + strlen(from);
        found = true;
    }
    memcpy(end, rest, strlen(rest) + 1);
    return put(maker, name, (unsigned char *)result, strlen(result)) && found;
}

/* ---- Reading
 * ------------------------------------------------------------------------------------------- */

static bool copy_entry(tl_fmu_maker *maker, zip_t *zip, zip_uint64_t index) {
    zip_stat_t facts;
    if (zip_stat_index(zip, index, 0, &facts) != 0) {
        return false;
    }
    unsigned char *bytes = calloc(1, (size_t)facts.size + 1);
    zip_file_t *file = zip_fopen_index(zip, index, 0);
    if (bytes == NULL || file == NULL) {
        free(bytes);
        return false;
    }
    zip_int64_t got = zip_fread(file, bytes, facts.size);
    (void)zip_fclose(file);
    if (got != (zip_int64_t)facts.size) {
        free(bytes);
        return false;
    }
    return put(maker, facts.name, bytes, (size_t)facts.size);
}

/* Machine of an ELF file: class, byte order, processor. */
typedef struct elf_machine {
    unsigned char bytes[4];
} elf_machine;

static elf_machine machine_of(const unsigned char *head) {
    size_t processor = offsetof(Elf32_Ehdr, e_machine);
    return (elf_machine){{head[EI_CLASS], head[EI_DATA], head[processor], head[processor + 1]}};
}

static bool read_own_machine(elf_machine *own) {
    unsigned char head[sizeof(Elf32_Ehdr)];
    FILE *self = fopen("/proc/self/exe", "rb");
    size_t got = self == NULL ? 0 : fread(head, 1, sizeof head, self);
    bool read = self != NULL && fclose(self) == 0 && got == sizeof head;
    if (read) {
        *own = machine_of(head);
    }
    return read;
}

/* Removes the binaries for other machines than that of this program. */
static bool drop_foreign_binaries(tl_fmu_maker *maker) {
    elf_machine own;
    if (!read_own_machine(&own)) {
        return false;
    }
    for (size_t i = maker->count; i-- > 0;) {
        const maker_entry *entry = &maker->entries[i];
        if (entry->size >= sizeof(Elf32_Ehdr) && memcmp(entry->bytes, ELFMAG, SELFMAG) == 0) {
            elf_machine theirs = machine_of(entry->bytes);
            if (memcmp(&theirs, &own, sizeof own) != 0 && !tl_fmu_maker_remove(maker, entry->name)) {
                return false;
            }
        }
    }
    return true;
}

tl_fmu_maker *tl_fmu_maker_new(const char *path) {
    tl_fmu_maker *maker = calloc(1, sizeof *maker);
    if (maker == NULL || path == NULL) {
        return maker;
    }
    zip_t *zip = zip_open(path, ZIP_RDONLY, NULL);
    bool ok = zip != NULL;
    zip_int64_t count = ok ? zip_get_num_entries(zip, 0) : 0;
    for (zip_int64_t i = 0; i < count && ok; i++) {
        ok = copy_entry(maker, zip, (zip_uint64_t)i);
    }
    if (zip != NULL) {
        zip_discard(zip);
    }
    if (!ok || !drop_foreign_binaries(maker)) {
        tl_fmu_maker_free(maker);
        return NULL;
    }
    return maker;
}

void tl_fmu_maker_free(tl_fmu_maker *maker) {
    if (maker == NULL) {
        return;
    }
    for (size_t i = 0; i < maker->count; i++) {
        free(maker->entries[i].name);
        free(maker->entries[i].bytes);
    }
    free(maker->entries);
    free(maker);
}

/* ---- Writing
 * ------------------------------------------------------------------------------------------- */

static bool add_entry(zip_t *zip, const maker_entry *entry) {
    enum { UNIX = ZIP_OPSYS_UNIX };
    zip_source_t *source = zip_source_buffer(zip, entry->bytes, entry->size, 0);
    if (source == NULL) {
        return false;
    }
    zip_int64_t index = zip_file_add(zip, entry->name, source, ZIP_FL_ENC_UTF_8);
    if (index < 0) {
        zip_source_free(source);
        return false;
    }
    zip_uint64_t at = (zip_uint64_t)index;
    bool ok = zip_file_set_external_attributes(zip, at, 0, UNIX, (zip_uint32_t)entry->mode << 16) == 0;
    if (entry->encrypted) {
        ok = zip_file_set_encryption(zip, at, ZIP_EM_TRAD_PKWARE, "secret") == 0 && ok;
    }
    if (entry->bzip2) {
        ok = zip_set_file_compression(zip, at, ZIP_CM_BZIP2, 0) == 0 && ok;
    }
    return ok;
}

bool tl_fmu_maker_write(const tl_fmu_maker *maker, const char *path) {
    zip_t *zip = zip_open(path, ZIP_CREATE | ZIP_TRUNCATE, NULL);
    bool ok = zip != NULL;
    for (size_t i = 0; i < maker->count && ok; i++) {
        ok = add_entry(zip, &maker->entries[i]);
    }
    if (ok && zip_close(zip) == 0) {
        return true;
    }
    if (zip != NULL) {
        zip_discard(zip);
    }
    return false;
}

/* ---- Files
 * --------------------------------------------------------------------------------------------- */

bool tl_fmu_maker_patch_file(const char *path, const void *from, const void *to, size_t size) {
    FILE *file = fopen(path, "r+b");
    struct stat status;
    if (file == NULL || fstat(fileno(file), &status) != 0) {
        if (file != NULL) {
            (void)fclose(file);
        }
        return false;
    }
    size_t length = (size_t)status.st_size;
    unsigned char *bytes = malloc(length + 1);
    bool ok = bytes != NULL && fread(bytes, 1, length, file) == length && patch(bytes, length, from, to, size) > 0 &&
              fseek(file, 0, SEEK_SET) == 0 && fwrite(bytes, 1, length, file) == length;
    free(bytes);
    return fclose(file) == 0 && ok;
}

bool tl_fmu_maker_cut_file(const char *path, size_t size) {
    return truncate(path, (off_t)size) == 0;
}
