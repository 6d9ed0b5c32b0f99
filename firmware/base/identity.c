/* What must be the same: see identity.h. */
#include "firmware/base/identity.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/utsname.h>

#ifndef TL_VERSION
#define TL_VERSION "unknown"
#endif

/* The whole of a file; NULL where it cannot be read. The caller frees it. */
static void *read_file(const char *path, size_t *size) {
    struct stat about;
    void *bytes = NULL;
    FILE *file = fopen(path, "rb");
    if (file != NULL && fstat(fileno(file), &about) == 0 && about.st_size > 0) {
        *size = (size_t)about.st_size;
        bytes = malloc(*size);
    }
    if (bytes != NULL && fread(bytes, 1, *size, file) != *size) {
        free(bytes);
        bytes = NULL;
    }
    if (file != NULL) {
        (void)fclose(file);
    }
    return bytes;
}

static bool digest_file(const char *path, char text[TL_SHA256_TEXT]) {
    size_t size = 0;
    void *bytes = read_file(path, &size);
    if (bytes == NULL) {
        return false;
    }
    tl_sha256(bytes, size, text);
    free(bytes);
    return true;
}

void tl_identity_files(const char *const *paths, size_t count, char text[TL_SHA256_TEXT]) {
    char digests[TL_IDENTITY_FILES * TL_SHA256_TEXT];
    text[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        if (!digest_file(paths[i], digests + i * TL_SHA256_TEXT)) {
            return;
        }
    }
    tl_sha256(digests, count * TL_SHA256_TEXT, text);
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
