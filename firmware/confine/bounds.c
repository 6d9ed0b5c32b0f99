/* Bounds: see bounds.h. */
#include "firmware/confine/bounds.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LARGE = 500, LOOKS_APART = 5, STAT_TEXT = 1024, BLOCK = 512 };

/* ---- the folder ---- */

/* A walk without following links, at most as far as the bounds: folders that are open, from the outermost on. */
typedef struct walk {
    const tl_bounds *bounds;
    DIR *open[TL_BOUNDS_DEPTH];
    int depth;
    uint64_t files;
    uint64_t bytes;
    const char *barred; /* why it could not go on */
} walk;

static DIR *open_folder(int above, const char *name) {
    int descriptor = openat(above, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *folder = descriptor < 0 ? NULL : fdopendir(descriptor);
    if (descriptor >= 0 && folder == NULL) {
        (void)close(descriptor);
    }
    return folder;
}

static void enter(walk *at, const char *name) {
    if (at->depth == TL_BOUNDS_DEPTH) {
        at->barred = "folders lie too deep in each other";
        return;
    }
    DIR *folder = open_folder(dirfd(at->open[at->depth - 1]), name);
    if (folder != NULL) {
        at->open[at->depth++] = folder;
    } else if (errno != ENOENT) { /* it may be gone again */
        at->barred = "a folder cannot be looked into";
    }
}

static void count(walk *at, const char *name) {
    struct stat what;
    if (fstatat(dirfd(at->open[at->depth - 1]), name, &what, AT_SYMLINK_NOFOLLOW) != 0) {
        return;
    }
    at->files++;
    at->bytes += (uint64_t)what.st_blocks * BLOCK;
    if (S_ISDIR(what.st_mode)) {
        enter(at, name);
    }
}

static bool is_beyond(uint64_t found, uint64_t bound) {
    return bound != 0 && found > bound;
}

static bool goes_on(const walk *at) {
    return at->depth > 0 && at->barred == NULL && !is_beyond(at->files, at->bounds->files) &&
           !is_beyond(at->bytes, at->bounds->bytes);
}

static void step(walk *at) {
    const struct dirent *entry = readdir(at->open[at->depth - 1]);
    if (entry == NULL) {
        (void)closedir(at->open[--at->depth]);
    } else if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
        count(at, entry->d_name);
    }
}

static bool folder_is_kept(tl_bounds *bounds, char text[TL_BOUNDS_TEXT]) {
    walk at = {.bounds = bounds};
    at.open[0] = open_folder(AT_FDCWD, bounds->folder);
    at.depth = at.open[0] != NULL ? 1 : 0;
    while (goes_on(&at)) {
        step(&at);
    }
    while (at.depth > 0) {
        (void)closedir(at.open[--at.depth]);
    }
    bounds->looks_left = at.files > LARGE ? LOOKS_APART - 1 : 0;
    if (at.barred != NULL) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%s in the folder of the FMUs", at.barred);
    } else if (is_beyond(at.files, bounds->files)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "more than %" PRIu64 " files in the folder of the FMUs", bounds->files);
    } else if (is_beyond(at.bytes, bounds->bytes)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "more than %" PRIu64 " MB in the folder of the FMUs",
                       bounds->bytes / 1000000);
    }
    return text[0] == '\0';
}

/* ---- the process ---- */

enum { NAME_FIELD = 2, THREADS_FIELD = 20, PAGES_FIELD = 24 }; /* proc(5) */

/* A field after the name, at whose end `text` is: they have a blank between them. 0 where there is none. */
static uint64_t read_field(const char *text, int field) {
    for (int i = NAME_FIELD; i < field && text != NULL; i++) {
        text = strchr(text + 1, ' ');
    }
    return text != NULL ? strtoull(text, NULL, 10) : 0;
}

/* From /proc/PID/stat, which everybody may read: threads and pages in memory. False: it is gone. */
static bool read_process(pid_t process, uint64_t *threads, uint64_t *pages) {
    char path[64];
    char stat[STAT_TEXT];
    (void)snprintf(path, sizeof path, "/proc/%ld/stat", (long)process);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t length = file < 0 ? -1 : read(file, stat, sizeof stat - 1);
    if (file >= 0) {
        (void)close(file);
    }
    stat[length > 0 ? length : 0] = '\0';
    const char *name_end = strrchr(stat, ')'); /* a name may hold anything, this too */
    if (name_end == NULL) {
        return false;
    }
    *threads = read_field(name_end, THREADS_FIELD);
    *pages = read_field(name_end, PAGES_FIELD);
    return true;
}

static bool process_is_kept(const tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]) {
    uint64_t threads = 0;
    uint64_t pages = 0;
    if (!read_process(process, &threads, &pages)) {
        return true;
    }
    const uint64_t resident = pages * (uint64_t)sysconf(_SC_PAGESIZE);
    if (is_beyond(threads, bounds->threads)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%" PRIu64 " threads, of which %" PRIu64 " are allowed", threads,
                       bounds->threads);
    } else if (is_beyond(resident, bounds->resident)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%" PRIu64 " MB of memory, of which %" PRIu64 " are allowed",
                       resident / 1000000, bounds->resident / 1000000);
    }
    return text[0] == '\0';
}

bool tl_bounds_are_kept(tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]) {
    text[0] = '\0';
    if (!process_is_kept(bounds, process, text)) {
        return false;
    }
    if (bounds->folder == NULL || bounds->looks_left > 0) {
        bounds->looks_left -= bounds->looks_left > 0 ? 1 : 0;
        return true;
    }
    return folder_is_kept(bounds, text);
}
