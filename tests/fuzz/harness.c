/* See harness.h. */
#include "tests/fuzz/harness.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { PATH = 64, PIPE_BYTES = 64 * 1024 };

/* Ends the program with exit code 1: a failure of the harness must not look like a finding. */
static void need(int right, const char *what) {
    if (!right) {
        perror(what);
        exit(1);
    }
}

static void note(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    (void)where;
    (void)text;
}

const tl_config *tl_fuzz_config(const char *text) {
    static tl_config config;
    if (config.tree == NULL) {
        tl_report report = {.add = note};
        if (tl_config_read_text("fuzz.json", text, strlen(text), &config, &report) != TL_OK) {
            abort();
        }
    }
    return &config;
}

const char *tl_fuzz_folder(void) {
    const char *folder = getenv("TMPDIR");
    return folder != NULL && folder[0] != '\0' ? folder : "/tmp";
}

/* Writes a path by which the descriptor's file can be opened. */
static void name_descriptor(int descriptor, char *path) {
    (void)snprintf(path, PATH, "/proc/self/fd/%d", descriptor);
}

const char *tl_fuzz_file(const uint8_t *data, size_t size) {
    static int file = -1;
    static char path[PATH];
    if (file < 0) {
        file = memfd_create("input", MFD_CLOEXEC);
        need(file >= 0, "memfd_create");
        name_descriptor(file, path);
    }
    need(ftruncate(file, 0) == 0, "ftruncate");
    need(pwrite(file, data, size, 0) == (ssize_t)size, "pwrite");
    return path;
}

static int reader_of_pipe = -1;

int tl_fuzz_pipe(const uint8_t *data, size_t size, const char **path) {
    static char name[PATH];
    int ends[2] = {-1, -1};
    need(pipe2(ends, O_CLOEXEC | O_NONBLOCK) == 0, "pipe2");
    size = size < PIPE_BYTES ? size : PIPE_BYTES;
    need(write(ends[1], data, size) == (ssize_t)size, "write");
    reader_of_pipe = ends[0];
    name_descriptor(ends[0], name);
    *path = name;
    return ends[1];
}

void tl_fuzz_close_pipe(int writer) {
    (void)close(writer);
    (void)close(reader_of_pipe);
    reader_of_pipe = -1;
}
