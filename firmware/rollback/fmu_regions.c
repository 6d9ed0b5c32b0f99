/* Regions of an FMU's libraries, see fmu_regions.h. */
#include "firmware/rollback/fmu_regions.h"

#include <dlfcn.h>
#include <elf.h>
#include <limits.h>
#include <link.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Compiled code calls this function of the loader for a thread-local variable. It creates the
 * variables of this thread if necessary. */
typedef struct tls_index {
    unsigned long module;
    unsigned long offset;
} tls_index;
extern void *get_thread_local(tls_index *index) __asm__("__tls_get_addr");

typedef struct region_search {
    const char *folder; /* NULL: all libraries that are not excluded */
    size_t length;
    tl_fmu_regions *places;
    bool is_full;
} region_search;

/* The users of libraries. The program is also the user of shared libraries. */
static const char PROGRAM[] = "the program";
static const char PYTHON[] = "FMUs in Python";

typedef struct library_user {
    uintptr_t address;  /* load address */
    const char *folder; /* of the FMU, or one of the texts above */
    bool is_found;      /* it was found as a region, so that states may contain it */
    bool is_loaded;     /* buffer of tl_fmu_regions_forget_closed() */
} library_user;

/* If there are more libraries, the last ones have no user. */
enum { LIBRARIES = 1024 };
static library_user library_users[LIBRARIES];
static size_t library_count;
static unsigned long long shared_count; /* how often a library became shared */

static void add(region_search *self, uintptr_t begin, uintptr_t end, bool has_pages) {
    tl_fmu_regions *places = self->places;
    if (begin >= end) {
        return;
    }
    if (places->count == TL_FMU_REGIONS) {
        self->is_full = true;
        return;
    }
    tl_fmu_region *region = &places->place[places->count++];
    memcpy(&region->begin, &begin, sizeof region->begin);
    region->size = end - begin;
    region->has_pages = has_pages;
    places->bytes += end - begin;
}

/* Returns the end of the part that becomes read-only after relocation. */
static uintptr_t end_of_relro(const struct dl_phdr_info *object, uintptr_t begin, uintptr_t end) {
    uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE);
    for (size_t i = 0; i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *header = &object->dlpi_phdr[i];
        uintptr_t at = object->dlpi_addr + header->p_vaddr;
        if (header->p_type == PT_GNU_RELRO && at >= begin && at < end) {
            uintptr_t end_of_section = (at + header->p_memsz) / page * page;
            return end_of_section > begin ? end_of_section : begin;
        }
    }
    return begin;
}

static void add_object(region_search *self, struct dl_phdr_info *object) {
    for (size_t i = 0; i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *header = &object->dlpi_phdr[i];
        uintptr_t begin = object->dlpi_addr + header->p_vaddr;
        uintptr_t end = begin + header->p_memsz;
        if (header->p_type == PT_LOAD && (header->p_flags & PF_W) != 0) {
            add(self, end_of_relro(object, begin, end), end, true);
        } else if (header->p_type == PT_TLS && object->dlpi_tls_modid != 0) {
            tls_index index = {.module = object->dlpi_tls_modid, .offset = 0};
            uintptr_t variables = (uintptr_t)get_thread_local(&index);
            add(self, variables, variables + header->p_memsz, false);
        }
    }
}

static bool is_below(const region_search *self, const char *name) {
    char path[PATH_MAX];
    return name != NULL && name[0] != '\0' && realpath(name, path) != NULL &&
           strncmp(path, self->folder, self->length) == 0 && path[self->length] == '/';
}

/* NULL: none. */
static library_user *find_user(uintptr_t address) {
    size_t i = 0;
    while (i < library_count && library_users[i].address != address) {
        i++;
    }
    return i < library_count ? &library_users[i] : NULL;
}

static int read_object(struct dl_phdr_info *object, size_t size, void *context) {
    region_search *self = context;
    library_user *user = find_user(object->dlpi_addr);
    (void)size;
    if (self->folder != NULL ? is_below(self, object->dlpi_name) || (user != NULL && user->folder == self->folder)
                             : user == NULL || user->folder == PYTHON) {
        add_object(self, object);
        if (user != NULL) {
            user->is_found = true;
        }
    }
    return 0;
}

static int count_object(struct dl_phdr_info *object, size_t size, void *context) {
    (void)object;
    (void)size;
    ++*(size_t *)context;
    return 0;
}

size_t tl_fmu_regions_loaded(void) {
    size_t count = 0;
    (void)dl_iterate_phdr(count_object, &count);
    return count;
}

/* Returns true if the path contains one of the names. */
static bool is_one_of(const char *path, const char *const *names) {
    while (*names != NULL && strstr(path, *names) == NULL) {
        names++;
    }
    return *names != NULL;
}

/* In a process with FMUs, only the FMUs use these libraries of the program. */
static const char *const unused_by_program[] = {"/libcrypto.so", "/libssl.so", "/libsqlite3.so", NULL};

/* Nearly all FMUs in C++ share these libraries, and their data seldom changes. */
static const char *const of_all[] = {"/libgcc_s.so", NULL};

/* The same, but this data has addresses in the heap of an FMU that sets the global locale. If
 * states of one FMU contain it, it stays with this FMU. */
static const char *const of_first[] = {"/libstdc++.so", NULL};

/* Returns true if the user of the library has changed. */
static bool assign(uintptr_t address, const char *name, const char *folder) {
    library_user *user = find_user(address);
    if (user != NULL) {
        bool stays = user->is_found && is_one_of(name, of_first);
        bool is_new = user->folder != folder && user->folder != PROGRAM && !stays;
        user->folder = is_new ? PROGRAM : user->folder;
        shared_count += is_new;
        return is_new;
    }
    if (library_count == LIBRARIES) {
        return false;
    }
    library_users[library_count++] =
        (library_user){.address = address, .folder = is_one_of(name, of_all) ? PROGRAM : folder};
    return true;
}

static int exclude_object(struct dl_phdr_info *object, size_t size, void *context) {
    (void)size;
    (void)context;
    if (!is_one_of(object->dlpi_name, unused_by_program)) {
        (void)assign(object->dlpi_addr, object->dlpi_name, PROGRAM);
    }
    return 0;
}

void tl_fmu_regions_exclude(void) {
    (void)dl_iterate_phdr(exclude_object, NULL);
}

/* Some machines do not relocate the addresses in this table. */
static const char *text_at(const struct link_map *library, uintptr_t texts, uintptr_t offset) {
    uintptr_t address = (texts < library->l_addr ? library->l_addr : 0) + texts + offset;
    const char *text;
    memcpy(&text, &address, sizeof text);
    return text;
}

/* Libraries with a new user. Their needs follow. */
typedef struct library_queue {
    size_t count;
    struct link_map *library[LIBRARIES];
} library_queue;

/* The needs of a library whose user has not changed were claimed before. */
static void enqueue(library_queue *queue, const char *folder, void *opened) {
    struct link_map *library = NULL;
    if (dlinfo(opened, RTLD_DI_LINKMAP, &library) == 0 && queue->count < LIBRARIES &&
        assign(library->l_addr, library->l_name, folder)) {
        queue->library[queue->count++] = library;
    }
}

static void enqueue_needs(library_queue *queue, const char *folder, const struct link_map *library) {
    uintptr_t texts = 0;
    for (const ElfW(Dyn) *entry = library->l_ld; entry->d_tag != DT_NULL; entry++) {
        texts = entry->d_tag == DT_STRTAB ? entry->d_un.d_ptr : texts;
    }
    for (const ElfW(Dyn) *entry = library->l_ld; entry->d_tag != DT_NULL; entry++) {
        void *needed = entry->d_tag == DT_NEEDED
                           ? dlopen(text_at(library, texts, entry->d_un.d_val), RTLD_LAZY | RTLD_NOLOAD)
                           : NULL;
        if (needed != NULL) {
            enqueue(queue, folder, needed);
            (void)dlclose(needed); /* stays open, because the library needs it */
        }
    }
}

typedef struct library_claim {
    const char *folder;
    size_t skipped; /* objects that are still to be skipped; the loader lists them in order of opening */
} library_claim;

static int claim_object(struct dl_phdr_info *object, size_t size, void *context) {
    library_claim *claim = context;
    (void)size;
    if (claim->skipped > 0) {
        claim->skipped--;
    } else {
        (void)assign(object->dlpi_addr, object->dlpi_name, claim->folder);
    }
    return 0;
}

void tl_fmu_regions_claim(const char *folder, void *opened, size_t from) {
    library_claim claim = {.folder = folder != NULL ? folder : PYTHON, .skipped = from};
    library_queue queue = {.count = 0};
    if (opened != NULL) {
        enqueue(&queue, claim.folder, opened);
        for (size_t i = 0; i < queue.count; i++) {
            enqueue_needs(&queue, claim.folder, queue.library[i]);
        }
        (void)dlerror(); /* clears the errors of needs that are not open */
    }
    (void)dl_iterate_phdr(claim_object, &claim);
}

static int note_changed(struct dl_phdr_info *object, size_t size, void *context) {
    (void)size;
    *(unsigned long long *)context = object->dlpi_adds + object->dlpi_subs;
    return 1; /* all objects contain the same number */
}

static int find_loaded(struct dl_phdr_info *object, size_t size, void *context) {
    library_user *user = find_user(object->dlpi_addr);
    (void)size;
    (void)context;
    if (user != NULL) {
        user->is_loaded = true;
    }
    return 0;
}

void tl_fmu_regions_forget_closed(void) {
    size_t count = 0;
    for (size_t i = 0; i < library_count; i++) {
        library_users[i].is_loaded = false;
    }
    (void)dl_iterate_phdr(find_loaded, NULL);
    for (size_t i = 0; i < library_count; i++) {
        if (library_users[i].is_loaded) {
            library_users[count++] = library_users[i];
        }
    }
    library_count = count;
}

unsigned long long tl_fmu_regions_changed(void) {
    unsigned long long changed = 0;
    (void)dl_iterate_phdr(note_changed, &changed);
    return changed + shared_count;
}

tl_status tl_fmu_regions_find(const char *folder, tl_fmu_regions *places, tl_error *error) {
    region_search self = {.folder = folder, .length = folder != NULL ? strlen(folder) : 0, .places = places};
    *places = (tl_fmu_regions){.count = 0};
    (void)dl_iterate_phdr(read_object, &self);
    return self.is_full
               ? tl_fail(error, TL_FMU_FAILED, "its libraries have more than %d writable regions", TL_FMU_REGIONS)
               : TL_OK;
}
