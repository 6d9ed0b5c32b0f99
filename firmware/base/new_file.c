/* A file that appears whole or not at all: see new_file.h. */
#include "firmware/base/new_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

bool tl_new_file_is(const char *path, const char *other) {
    struct stat first;
    struct stat second;
    return strcmp(path, other) == 0 || (stat(path, &first) == 0 && stat(other, &second) == 0 &&
                                        first.st_dev == second.st_dev && first.st_ino == second.st_ino);
}

/* Where it will be; `mode` is what the file at that place has, or what a new one gets. */
static tl_status find_place(const char *given, char path[PATH_MAX], mode_t *mode, tl_error *error) {
    struct stat file;
    if (given[0] == '\0') {
        return tl_fail(error, TL_BAD_USAGE, "the name of the file is empty: give one, for example report.html");
    }
    if (strcmp(given, "-") == 0) {
        return tl_fail(error, TL_BAD_USAGE,
                       "\"-\" is no file, and this cannot go to standard output: give a name, for example report.html");
    }
    if (realpath(given, path) != NULL && stat(path, &file) == 0) {
        *mode = file.st_mode & 0777;
        return S_ISREG(file.st_mode)
                   ? TL_OK
                   : tl_fail(error, TL_BAD_DATA, "%.300s: is no ordinary file, and left as it is", given);
    }
    if (lstat(given, &file) == 0) {
        return tl_fail(error, TL_BAD_DATA, "%.300s: is a symbolic link that leads nowhere, and left as it is", given);
    }
    mode_t mask = umask(0);
    (void)umask(mask);
    *mode = 0666 & ~mask;
    return snprintf(path, PATH_MAX, "%s", given) < PATH_MAX
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "%.300s…: the name is too long", given);
}

/* A name that nobody had before; −1 where there can be none. */
static int take_name(const char *path, char name[PATH_MAX]) {
    for (int i = 0;; i++) {
        if (snprintf(name, PATH_MAX, "%s.new-%ld-%d", path, (long)getpid(), i) >= PATH_MAX) {
            errno = ENAMETOOLONG;
            return -1;
        }
        int file = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
        if (file >= 0 || errno != EEXIST) {
            return file;
        }
    }
}

tl_status tl_new_file_open(const char *path, tl_new_file *new_file, tl_error *error) {
    mode_t mode = 0;
    *new_file = (tl_new_file){0};
    tl_status status = find_place(path, new_file->path, &mode, error);
    if (status != TL_OK) {
        return status;
    }
    int opened = take_name(new_file->path, new_file->name);
    if (opened < 0) {
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be written: %s", path, strerror(errno));
    }
    (void)fchmod(opened, mode);
    new_file->file = fdopen(opened, "w");
    if (new_file->file == NULL) {
        status = tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be written: %s", path, strerror(errno));
        (void)close(opened);
        (void)unlink(new_file->name);
    }
    return status;
}

/* So that the name survives a power cut, as the content does. Not every file system can, and then nothing is wrong with the
 * file. */
static void keep_name(const char *path) {
    char folder[PATH_MAX];
    (void)snprintf(folder, sizeof folder, "%s", path);
    char *end = strrchr(folder, '/');
    if (end == NULL) {
        (void)snprintf(folder, sizeof folder, ".");
    } else {
        end[end == folder ? 1 : 0] = '\0';
    }
    int opened = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (opened >= 0) {
        (void)fsync(opened);
        (void)close(opened);
    }
}

tl_status tl_new_file_keep(tl_new_file *new_file, tl_error *error) {
    FILE *file = new_file->file;
    bool failed = ferror(file) != 0;
    errno = failed ? EIO : 0; /* what an earlier failure is called where nothing is left to fail */
    failed = fflush(file) != 0 || failed;
    failed = fsync(fileno(file)) != 0 || failed;
    failed = fclose(file) != 0 || failed;
    int cause = errno;
    new_file->file = NULL;
    if (failed) {
        (void)unlink(new_file->name);
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: not everything could be written: %s", new_file->path,
                       strerror(cause));
    }
    if (rename(new_file->name, new_file->path) != 0) {
        cause = errno;
        (void)unlink(new_file->name);
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be put in place: %s", new_file->path, strerror(cause));
    }
    keep_name(new_file->path);
    return TL_OK;
}

void tl_new_file_discard(tl_new_file *new_file) {
    if (new_file->file != NULL) {
        (void)fclose(new_file->file);
        (void)unlink(new_file->name);
    }
    new_file->file = NULL;
}
