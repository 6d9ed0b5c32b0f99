/* Archive: see archive.h. */
#include "master/base/archive.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

tl_archive tl_archive_saving(unsigned char *to, size_t size) {
    return (tl_archive){.to = to, .size = to != NULL ? size : 0};
}

tl_archive tl_archive_loading(const unsigned char *from, size_t size) {
    return (tl_archive){.from = from, .size = size};
}

bool tl_archive_is_loading(const tl_archive *archive) {
    return archive->from != NULL;
}

/* Advances by a part; returns whether it fits. Sizes may come from damaged bytes. */
static bool move_on(tl_archive *archive, size_t size, size_t *begin) {
    *begin = archive->at;
    archive->at = size <= SIZE_MAX - archive->at ? archive->at + size : SIZE_MAX;
    return archive->at <= archive->size;
}

void tl_archive_part(tl_archive *archive, void *memory, size_t size) {
    size_t begin = 0;
    if (!move_on(archive, size, &begin) || size == 0) {
        return;
    }
    if (archive->from != NULL) {
        memcpy(memory, archive->from + begin, size);
    } else {
        memcpy(archive->to + begin, memory, size);
    }
}

unsigned char *tl_archive_room(tl_archive *archive, size_t size) {
    size_t begin = 0;
    return move_on(archive, size, &begin) && archive->to != NULL ? archive->to + begin : NULL;
}

const unsigned char *tl_archive_bytes(tl_archive *archive, size_t size) {
    size_t begin = 0;
    return move_on(archive, size, &begin) && archive->from != NULL ? archive->from + begin : NULL;
}

void tl_archive_flag(tl_archive *archive, bool *flag) {
    unsigned char byte = *flag ? 1 : 0;
    tl_archive_part(archive, &byte, sizeof byte);
    tl_archive_require(archive, byte <= 1);
    *flag = byte == 1;
}

void tl_archive_require(tl_archive *archive, bool right) {
    if (archive->from != NULL && !right) {
        archive->at = SIZE_MAX;
    }
}

void tl_archive_require_finite(tl_archive *archive, const double *values, size_t count) {
    bool finite = true;
    for (size_t i = 0; i < count; i++) {
        finite = finite && isfinite(values[i]);
    }
    tl_archive_require(archive, finite);
}

bool tl_archive_is_whole(const tl_archive *archive) {
    return archive->at <= archive->size;
}
