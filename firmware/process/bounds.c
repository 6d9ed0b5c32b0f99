/* Bounds of a process: see bounds.h. */
#include "firmware/process/bounds.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

enum { LARGE = 500, LOOKS_APART = 5, STATUS_TEXT = 4096, BLOCK = 512, ENOUGH = 20, REMEMBERED = 256 };

/* ---- the folder ---- */

/* Walk through a folder, without following links, until a bound is exceeded. `open`: open folders,
 * from the outermost on. */
typedef struct walk {
    const tl_bounds *bounds;
    DIR *open[TL_BOUNDS_DEPTH];
    int depth;
    uint64_t files;
    uint64_t bytes;
    const char *barred; /* why it cannot continue */
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
    } else if (errno != ENOENT) { /* it may have been removed meanwhile */
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

/* ---- the disk ---- */

/* Counts each file once, if there is room to remember it. */
typedef struct removed_files {
    dev_t disk;
    ino_t seen[REMEMBERED];
    size_t count;
    uint64_t bytes;
} removed_files;

static void add_removed(removed_files *files, const struct stat *what) {
    for (size_t i = 0; i < files->count; i++) {
        if (files->seen[i] == what->st_ino) {
            return;
        }
    }
    if (files->count < REMEMBERED) {
        files->seen[files->count++] = what->st_ino;
    }
    files->bytes += (uint64_t)what->st_blocks * BLOCK;
}

/* Counts removed files in `name`, a folder of links in /proc/PID. Does nothing if it cannot be
 * read. */
static void count_removed(removed_files *files, pid_t process, const char *name) {
    char path[64];
    (void)snprintf(path, sizeof path, "/proc/%ld/%s", (long)process, name);
    DIR *folder = opendir(path);
    const struct dirent *entry = NULL;
    while (folder != NULL && (entry = readdir(folder)) != NULL) {
        struct stat what;
        if (fstatat(dirfd(folder), entry->d_name, &what, 0) == 0 && S_ISREG(what.st_mode) && what.st_nlink == 0 &&
            what.st_dev == files->disk) {
            add_removed(files, &what);
        }
    }
    if (folder != NULL) {
        (void)closedir(folder);
    }
}

/* Returns the bytes of removed files on that disk that the process still has open or mapped. */
static uint64_t removed_bytes(const char *folder, pid_t process) {
    struct stat what;
    removed_files files = {.count = 0};
    if (stat(folder, &what) == 0) {
        files.disk = what.st_dev;
        count_removed(&files, process, "fd");
        count_removed(&files, process, "map_files");
    }
    return files.bytes;
}

/* Includes what a process has written to removed files. They are counted again only if a quarter of
 * the bound was used since the last count. */
static bool disk_is_kept(tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]) {
    struct statvfs disk;
    if (bounds->bytes == 0 || statvfs(bounds->folder, &disk) != 0) {
        return true;
    }
    uint64_t left = (uint64_t)disk.f_bavail * disk.f_frsize;
    uint64_t total = (uint64_t)disk.f_blocks * disk.f_frsize;
    if (bounds->free_before == 0) {
        bounds->free_before = left;
    }
    const uint64_t gone = bounds->free_before > left ? bounds->free_before - left : 0;
    bounds->gone_before = gone < bounds->gone_before ? gone : bounds->gone_before;
    if (gone > bounds->bytes && gone - bounds->bytes / 4 >= bounds->gone_before) {
        const uint64_t removed = removed_bytes(bounds->folder, process);
        bounds->gone_before = gone;
        if (removed > bounds->bytes) {
            (void)snprintf(text, TL_BOUNDS_TEXT,
                           "%" PRIu64 " MB in files that FMUs have removed and hold open, of which %" PRIu64
                           " are allowed",
                           removed / 1000000, bounds->bytes / 1000000);
            return false;
        }
    }
    if (left < total / ENOUGH && gone > bounds->bytes) {
        (void)snprintf(text, TL_BOUNDS_TEXT,
                       "the disk of %.100s is nearly full, and %" PRIu64
                       " MB went since the FMUs began; free some, or set TMPDIR",
                       bounds->folder, gone / 1000000);
    }
    return text[0] == '\0';
}

/* ---- the process ---- */

/* Returns the number after `name`, which starts with a newline; 0 if there is none. The kernel
 * escapes newlines in the process's own name. */
static uint64_t number_behind(const char *text, const char *name) {
    const char *found = strstr(text, name);
    return found != NULL ? strtoull(found + strlen(name), NULL, 10) : 0;
}

/* Reads /proc/PID/status, which any user may read. Memory: resident memory, swapped memory, and
 * page tables. */
static bool process_is_kept(const tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]) {
    enum { KILOBYTE = 1024 };
    char path[64];
    char status[STATUS_TEXT];
    (void)snprintf(path, sizeof path, "/proc/%ld/status", (long)process);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t length = file < 0 ? -1 : read(file, status, sizeof status - 1);
    if (file >= 0) {
        (void)close(file);
    }
    status[length > 0 ? length : 0] = '\0';
    const uint64_t threads = number_behind(status, "\nThreads:");
    const uint64_t memory = KILOBYTE * (number_behind(status, "\nVmRSS:") + number_behind(status, "\nVmPTE:") +
                                        number_behind(status, "\nVmSwap:"));
    if (is_beyond(threads, bounds->threads)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%" PRIu64 " threads, of which %" PRIu64 " are allowed", threads,
                       bounds->threads);
    } else if (is_beyond(memory, bounds->memory)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%" PRIu64 " MB of memory, of which %" PRIu64 " are allowed",
                       memory / 1000000, bounds->memory / 1000000);
    }
    return text[0] == '\0';
}

bool tl_bounds_are_kept(tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]) {
    text[0] = '\0';
    if (!process_is_kept(bounds, process, text)) {
        return false;
    }
    if (bounds->folder != NULL && !disk_is_kept(bounds, process, text)) {
        return false;
    }
    if (bounds->folder == NULL || bounds->looks_left > 0) {
        bounds->looks_left -= bounds->looks_left > 0 ? 1 : 0;
        return true;
    }
    return folder_is_kept(bounds, text);
}
