/* The writable memory of an FMU's libraries: see fmu_places.h. */
#include "firmware/rollback/fmu_places.h"

#include <elf.h>
#include <limits.h>
#include <link.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* As the loader is asked by compiled code; it makes the variables if this thread has none yet. */
typedef struct tls_index {
    unsigned long module;
    unsigned long offset;
} tls_index;
extern void *get_thread_local(tls_index *index) __asm__("__tls_get_addr");

typedef struct place_search {
    const char *folder;
    size_t length;
    tl_fmu_places *places;
    bool is_full;
} place_search;

static void add(place_search *self, uintptr_t begin, uintptr_t end, bool has_pages) {
    tl_fmu_places *places = self->places;
    if (begin >= end) {
        return;
    }
    if (places->count == TL_FMU_PLACES) {
        self->is_full = true;
        return;
    }
    tl_fmu_place *place = &places->place[places->count++];
    memcpy(&place->begin, &begin, sizeof place->begin);
    place->size = end - begin;
    place->has_pages = has_pages;
    places->bytes += end - begin;
}

/* The part of a writable segment that becomes read-only once the loader is done with it. */
static uintptr_t end_of_relro(const struct dl_phdr_info *object, uintptr_t begin, uintptr_t end) {
    uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE);
    for (size_t i = 0; i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *header = &object->dlpi_phdr[i];
        uintptr_t at = object->dlpi_addr + header->p_vaddr;
        if (header->p_type == PT_GNU_RELRO && at >= begin && at < end) {
            uintptr_t behind = (at + header->p_memsz) / page * page;
            return behind > begin ? behind : begin;
        }
    }
    return begin;
}

static void add_object(place_search *self, struct dl_phdr_info *object) {
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

static bool is_below(const place_search *self, const char *name) {
    char path[PATH_MAX];
    return name != NULL && name[0] != '\0' && realpath(name, path) != NULL &&
           strncmp(path, self->folder, self->length) == 0 && path[self->length] == '/';
}

static int look_at_object(struct dl_phdr_info *object, size_t size, void *context) {
    place_search *self = context;
    (void)size;
    if (is_below(self, object->dlpi_name)) {
        add_object(self, object);
    }
    return 0;
}

static int note_opened(struct dl_phdr_info *object, size_t size, void *context) {
    (void)size;
    *(unsigned long long *)context = object->dlpi_adds;
    return 1; /* each object says the same */
}

unsigned long long tl_fmu_places_opened(void) {
    unsigned long long opened = 0;
    (void)dl_iterate_phdr(note_opened, &opened);
    return opened;
}

tl_status tl_fmu_places_find(const char *folder, tl_fmu_places *places, tl_error *error) {
    place_search self = {.folder = folder, .length = strlen(folder), .places = places};
    *places = (tl_fmu_places){.count = 0};
    (void)dl_iterate_phdr(look_at_object, &self);
    return self.is_full
               ? tl_fail(error, TL_FMU_FAILED, "its libraries have more than %d writable places", TL_FMU_PLACES)
               : TL_OK;
}
