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

enum { MANY_FILES = 500, LARGE_INTERVAL = 5, STATUS_TEXT = 4096, BLOCK = 512, FREE_PART = 20, MOST_REMOVED = 256 };

/* ---- the folder ---- */

/* Walk through a folder, without following links, until a bound is exceeded. `open`: open folders,
 * from the outermost on. */
typedef struct folder_walk {
    const tl_bounds *bounds;
    DIR *open[TL_BOUNDS_DEPTH];
    int depth;
    uint64_t files;
    uint64_t bytes;
    const char *fault; /* why it cannot continue */
} folder_walk;

static DIR *open_folder(int above, const char *name) {
    int descriptor = openat(above, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *folder = descriptor < 0 ? NULL : fdopendir(descriptor);
    if (descriptor >= 0 && folder == NULL) {
        (void)close(descriptor);
    }
    return folder;
}

static void open_subfolder(folder_walk *at, const char *name) {
    if (at->depth == TL_BOUNDS_DEPTH) {
        at->fault = "folders are nested too deep";
        return;
    }
    DIR *folder = open_folder(dirfd(at->open[at->depth - 1]), name);
    if (folder != NULL) {
        at->open[at->depth++] = folder;
    } else if (errno != ENOENT) { /* it may have been removed meanwhile */
        at->fault = "a folder cannot be read";
    }
}

static void count_entry(folder_walk *at, const char *name) {
    struct stat facts;
    if (fstatat(dirfd(at->open[at->depth - 1]), name, &facts, AT_SYMLINK_NOFOLLOW) != 0) {
        return;
    }
    at->files++;
    at->bytes += (uint64_t)facts.st_blocks * BLOCK;
    if (S_ISDIR(facts.st_mode)) {
        open_subfolder(at, name);
    }
}

static bool is_above(uint64_t found, uint64_t bound) {
    return bound != 0 && found > bound;
}

static bool continues(const folder_walk *at) {
    return at->depth > 0 && at->fault == NULL && !is_above(at->files, at->bounds->files) &&
           !is_above(at->bytes, at->bounds->bytes);
}

static void read_entry(folder_walk *at) {
    const struct dirent *entry = readdir(at->open[at->depth - 1]);
    if (entry == NULL) {
        (void)closedir(at->open[--at->depth]);
    } else if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
        count_entry(at, entry->d_name);
    }
}

static uint64_t difference(uint64_t from, uint64_t what) {
    return from > what ? from - what : 0;
}

/* `disk` is older than what was counted, so that nothing written meanwhile is missed. */
static void schedule_count(tl_bounds *bounds, const struct statvfs *disk, const folder_walk *at) {
    const uint64_t bytes = bounds->bytes != 0 ? difference(bounds->bytes, at->bytes) : UINT64_MAX;
    const uint64_t files = bounds->files != 0 ? difference(bounds->files, at->files) : UINT64_MAX;
    bounds->least_bytes = difference((uint64_t)disk->f_bfree * disk->f_frsize, bytes);
    bounds->least_files = difference(disk->f_ffree, files);
    bounds->is_large = at->files > MANY_FILES;
    bounds->checks_left = TL_BOUNDS_CHECKS;
}

/* Called once per check. */
static bool is_count_due(tl_bounds *bounds, const struct statvfs *disk) {
    bounds->checks_left -= bounds->checks_left > 0 ? 1 : 0;
    const bool is_shrunk =
        (uint64_t)disk->f_bfree * disk->f_frsize < bounds->least_bytes || disk->f_ffree < bounds->least_files;
    const bool rests = bounds->is_large && bounds->checks_left > TL_BOUNDS_CHECKS - LARGE_INTERVAL;
    return bounds->checks_left == 0 || (is_shrunk && !rests);
}

static bool check_folder(tl_bounds *bounds, const struct statvfs *disk, char text[TL_BOUNDS_TEXT]) {
    folder_walk at = {.bounds = bounds};
    at.open[0] = open_folder(AT_FDCWD, bounds->folder);
    at.depth = at.open[0] != NULL ? 1 : 0;
    while (continues(&at)) {
        read_entry(&at);
    }
    while (at.depth > 0) {
        (void)closedir(at.open[--at.depth]);
    }
    schedule_count(bounds, disk, &at);
    if (at.fault != NULL) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%s in the folder of the FMUs", at.fault);
    } else if (is_above(at.files, bounds->files)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "more than %" PRIu64 " files in the folder of the FMUs", bounds->files);
    } else if (is_above(at.bytes, bounds->bytes)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "more than %" PRIu64 " MB in the folder of the FMUs",
                       bounds->bytes / 1000000);
    }
    return text[0] == '\0';
}

/* ---- the disk ---- */

/* Counts each file once, if there is room to remember it. */
typedef struct removed_files {
    dev_t disk;
    ino_t seen[MOST_REMOVED];
    size_t count;
    uint64_t bytes;
} removed_files;

static void add_removed(removed_files *files, const struct stat *facts) {
    for (size_t i = 0; i < files->count; i++) {
        if (files->seen[i] == facts->st_ino) {
            return;
        }
    }
    if (files->count < MOST_REMOVED) {
        files->seen[files->count++] = facts->st_ino;
    }
    files->bytes += (uint64_t)facts->st_blocks * BLOCK;
}

/* Counts removed files in `name`, a folder of links in /proc/PID. Does nothing if it cannot be
 * read. */
static void count_removed(removed_files *files, pid_t process, const char *name) {
    char path[64];
    (void)snprintf(path, sizeof path, "/proc/%ld/%s", (long)process, name);
    DIR *folder = opendir(path);
    const struct dirent *entry = NULL;
    while (folder != NULL && (entry = readdir(folder)) != NULL) {
        struct stat facts;
        if (fstatat(dirfd(folder), entry->d_name, &facts, 0) == 0 && S_ISREG(facts.st_mode) && facts.st_nlink == 0 &&
            facts.st_dev == files->disk) {
            add_removed(files, &facts);
        }
    }
    if (folder != NULL) {
        (void)closedir(folder);
    }
}

/* Returns the bytes of removed files on that disk that the process still has open or mapped. */
static uint64_t count_removed_bytes(const char *folder, pid_t process) {
    struct stat facts;
    removed_files files = {.count = 0};
    if (stat(folder, &facts) == 0) {
        files.disk = facts.st_dev;
        count_removed(&files, process, "fd");
        count_removed(&files, process, "map_files");
    }
    return files.bytes;
}

/* Includes what a process has written to removed files. They are counted again only if a quarter of
 * the bound was used since the last count. */
static bool check_disk(tl_bounds *bounds, const struct statvfs *disk, pid_t process, char text[TL_BOUNDS_TEXT]) {
    if (bounds->bytes == 0) {
        return true;
    }
    uint64_t left = (uint64_t)disk->f_bavail * disk->f_frsize;
    uint64_t total = (uint64_t)disk->f_blocks * disk->f_frsize;
    if (bounds->free_before == 0) {
        bounds->free_before = left;
    }
    const uint64_t used = difference(bounds->free_before, left);
    bounds->gone_before = used < bounds->gone_before ? used : bounds->gone_before;
    if (used > bounds->bytes && used - bounds->bytes / 4 >= bounds->gone_before) {
        const uint64_t removed = count_removed_bytes(bounds->folder, process);
        bounds->gone_before = used;
        if (removed > bounds->bytes) {
            (void)snprintf(text, TL_BOUNDS_TEXT,
                           "%" PRIu64 " MB in files that the FMUs removed but keep open (limit %" PRIu64 " MB)",
                           removed / 1000000, bounds->bytes / 1000000);
            return false;
        }
    }
    if (left < total / FREE_PART && used > bounds->bytes) {
        (void)snprintf(text, TL_BOUNDS_TEXT,
                       "the disk of %.100s is nearly full, with %" PRIu64
                       " MB less free space than at the start; free space, or set TMPDIR",
                       bounds->folder, used / 1000000);
    }
    return text[0] == '\0';
}

/* ---- the process ---- */

/* Returns the number after `name`, which starts with a newline; 0 if there is none. The kernel
 * escapes newlines in the process's own name. */
static uint64_t number_after(const char *text, const char *name) {
    const char *found = strstr(text, name);
    return found != NULL ? strtoull(found + strlen(name), NULL, 10) : 0;
}

/* Reads /proc/PID/status, which any user may read. Memory: resident memory, swapped memory, and
 * page tables. */
static bool check_process(const tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]) {
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
    const uint64_t threads = number_after(status, "\nThreads:");
    const uint64_t memory = KILOBYTE * (number_after(status, "\nVmRSS:") + number_after(status, "\nVmPTE:") +
                                        number_after(status, "\nVmSwap:"));
    if (is_above(threads, bounds->threads)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%" PRIu64 " threads (limit %" PRIu64 ")", threads, bounds->threads);
    } else if (is_above(memory, bounds->memory)) {
        (void)snprintf(text, TL_BOUNDS_TEXT, "%" PRIu64 " MB of memory (limit %" PRIu64 " MB)", memory / 1000000,
                       bounds->memory / 1000000);
    }
    return text[0] == '\0';
}

bool tl_bounds_are_kept(tl_bounds *bounds, pid_t process, char text[TL_BOUNDS_TEXT]) {
    struct statvfs disk;
    text[0] = '\0';
    if (!check_process(bounds, process, text)) {
        return false;
    }
    if (bounds->folder == NULL || statvfs(bounds->folder, &disk) != 0) {
        return true;
    }
    return check_disk(bounds, &disk, process, text) &&
           (!is_count_due(bounds, &disk) || check_folder(bounds, &disk, text));
}
