/* What must be the same: see identity.h. */
#include "firmware/base/identity.h"

#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <unistd.h>

#ifndef TL_VERSION
#define TL_VERSION "unknown"
#endif

/* All of it; false: it cannot be read. */
static bool read_all(int descriptor, unsigned char *bytes, size_t size) {
    size_t done = 0;
    ssize_t part = 1;
    while (done < size && part > 0) {
        part = pread(descriptor, bytes + done, size - done, (off_t)done);
        done += part > 0 ? (size_t)part : 0;
    }
    return done == size;
}

bool tl_identity_open_file(int descriptor, char text[TL_SHA256_TEXT]) {
    struct stat about;
    text[0] = '\0';
    if (fstat(descriptor, &about) != 0 || about.st_size <= 0) {
        return false;
    }
    size_t size = (size_t)about.st_size;
    unsigned char *bytes = malloc(size);
    bool whole = bytes != NULL && read_all(descriptor, bytes, size);
    if (whole) {
        tl_sha256(bytes, size, text);
    }
    free(bytes);
    return whole;
}

void tl_identity_open_files(const int *descriptors, size_t count, char text[TL_SHA256_TEXT]) {
    char digests[TL_IDENTITY_FILES * TL_SHA256_TEXT];
    text[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        if (!tl_identity_open_file(descriptors[i], digests + i * TL_SHA256_TEXT)) {
            return;
        }
    }
    tl_sha256(digests, count * TL_SHA256_TEXT, text);
}

void tl_identity_files(const char *const *paths, size_t count, char text[TL_SHA256_TEXT]) {
    int descriptors[TL_IDENTITY_FILES] = {0};
    for (size_t i = 0; i < count; i++) {
        descriptors[i] = open(paths[i], O_RDONLY | O_CLOEXEC);
    }
    tl_identity_open_files(descriptors, count, text);
    for (size_t i = 0; i < count; i++) {
        if (descriptors[i] >= 0) {
            (void)close(descriptors[i]);
        }
    }
}

uint64_t tl_identity_number_of_open_files(const int *descriptors, size_t count) {
    char digest[TL_SHA256_TEXT] = ""; /* of the files before, and this one */
    for (size_t i = 0; i < count; i++) {
        struct stat about;
        char text[TL_SHA256_TEXT + 100];
        if (fstat(descriptors[i], &about) == 0) {
            int length = snprintf(text, sizeof text, "%s %" PRIuMAX " %" PRIdMAX " %" PRIdMAX ".%09ld", digest,
                                  (uintmax_t)about.st_ino, (intmax_t)about.st_size, (intmax_t)about.st_mtim.tv_sec,
                                  about.st_mtim.tv_nsec);
            tl_sha256(text, (size_t)length, digest);
        }
    }
    digest[2 * sizeof(uint64_t)] = '\0';
    uint64_t number = strtoull(digest, NULL, 16);
    return number == 0 ? 1 : number;
}

bool tl_identity_is_sound(const char text[TL_SHA256_TEXT]) {
    size_t length = strnlen(text, TL_SHA256_TEXT);
    return length == 0 || (length == TL_SHA256_TEXT - 1 && strspn(text, "0123456789abcdef") == length);
}

void tl_identity_boot(char text[TL_IDENTITY_TEXT]) {
    FILE *file = fopen("/proc/sys/kernel/random/boot_id", "r");
    text[0] = '\0';
    if (file != NULL) {
        (void)!fgets(text, TL_IDENTITY_TEXT, file);
        text[strcspn(text, "\n")] = '\0';
        (void)fclose(file);
    }
}

void tl_identity_format(char text[TL_IDENTITY_TEXT]) {
    struct utsname system;
    const char *machine = uname(&system) == 0 ? system.machine : "unknown";
    (void)snprintf(text, TL_IDENTITY_TEXT, "twinlock %s, %.32s, %zu bit", TL_VERSION, machine, sizeof(void *) * 8);
}
