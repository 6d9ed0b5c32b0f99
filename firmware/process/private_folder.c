/* Private folders, and how what an enemy has put into one is removed: see private_folder.h.
 *
 * A tree is removed flat: whatever is a folder in a folder is moved up to the root of the tree, under a new name, until the root has no folder
 * that is not empty. So two descriptors, with one more for a folder that forbids to be opened, are enough for any depth, and no path gets long. */
#include "firmware/process/private_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"

#define PREFIX "twinlock-"

enum { NAME_ROOM = 32, LETTERS = 6 };

/* ---- Removing ------------------------------------------------------------------------------------------ */

/* One tree that is being removed. */
typedef struct removal {
    int root;
    unsigned long names; /* given to folders that were moved */
    size_t changes;      /* entries removed or moved so far */
} removal;

/* Its entries can be changed. */
static void make_ours(int folder) {
    struct stat about;
    if (folder >= 0 && fstat(folder, &about) == 0 && (about.st_mode & S_IRWXU) != S_IRWXU) {
        (void)fchmod(folder, S_IRWXU);
    }
}

/* Opens a folder in a folder whatever its mode, and so that its entries can be changed. Descriptor, or −1. Links are not followed. */
static int open_folder(int parent, const char *name) {
    char path[NAME_ROOM];
    int folder = openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder < 0 && errno == EACCES) {
        int place = openat(parent, name, O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        (void)snprintf(path, sizeof path, "/proc/self/fd/%d", place);
        bool is_opened = place >= 0 && chmod(path, S_IRWXU) == 0;
        (void)close(place);
        folder = is_opened ? openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC) : -1;
    }
    make_ours(folder);
    return folder;
}

/* Under a name that is not taken. */
static void move_up(removal *work, int parent, const char *name) {
    char fresh[NAME_ROOM];
    int result = -1;
    int folder = open_folder(parent, name); /* who may not write into it may not move it */
    if (folder < 0) {
        return;
    }
    (void)close(folder);
    do {
        (void)snprintf(fresh, sizeof fresh, "%lu", work->names++);
        result = renameat(parent, name, work->root, fresh);
    } while (result != 0 && (errno == ENOTEMPTY || errno == EEXIST || errno == ENOTDIR));
    work->changes += result == 0 ? 1 : 0;
}

static void remove_entry(removal *work, int parent, const char *name) {
    if (unlinkat(parent, name, 0) == 0 || unlinkat(parent, name, AT_REMOVEDIR) == 0) {
        work->changes++;
    } else if (errno == ENOTEMPTY || errno == EEXIST || errno == EACCES) {
        move_up(work, parent, name);
    }
}

/* Does something to each entry of a folder, until a whole pass changes nothing: entries may be left out while others vanish. Closes it. */
static void for_each(removal *work, int folder, void (*act)(removal *work, int folder, const char *name)) {
    DIR *entries = fdopendir(folder);
    size_t before = 0;
    if (entries == NULL) {
        (void)close(folder);
        return;
    }
    do {
        before = work->changes;
        rewinddir(entries);
        for (struct dirent *entry = readdir(entries); entry != NULL; entry = readdir(entries)) {
            if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
                act(work, folder, entry->d_name);
            }
        }
    } while (work->changes != before);
    (void)closedir(entries);
}

/* Of the root: what is a folder is emptied into the root first. */
static void remove_root_entry(removal *work, int root, const char *name) {
    if (unlinkat(root, name, 0) == 0 || unlinkat(root, name, AT_REMOVEDIR) == 0) {
        work->changes++;
        return;
    }
    int folder = open_folder(root, name);
    if (folder >= 0) {
        for_each(work, folder, remove_entry);
        work->changes += unlinkat(root, name, AT_REMOVEDIR) == 0 ? 1 : 0;
    }
}

/* The folder of this path, opened as `root`, which is closed, with all that is in it. What is mounted there, or immutable, stays. */
static void remove_tree(int root, const char *path) {
    removal work = {.root = root};
    if (root >= 0) {
        make_ours(root);
        for_each(&work, root, remove_root_entry);
    }
    if (rmdir(path) != 0 && errno != ENOENT) {
        tl_log(TL_LOG_WARNING, "%s cannot be removed completely; remove it by hand", path);
    }
}

/* Another process removes what is made. */
static bool leaves;

void tl_private_folder_leave(void) {
    leaves = true;
}

void tl_private_folder_remove(tl_private_folder *folder) {
    if (folder->path[0] != '\0' && leaves) {
        (void)close(folder->descriptor);
    } else if (folder->path[0] != '\0') {
        remove_tree(folder->descriptor, folder->path);
    }
    folder->path[0] = '\0';
    folder->descriptor = -1;
}

/* ---- What killed processes left ------------------------------------------------------------------------ */

/* The process in twinlock-KIND-PID-XXXXXX, 0 where the name has another form. */
static pid_t owner_of(const char *name, const char *kind) {
    size_t length = strlen(kind);
    if (strncmp(name, PREFIX, strlen(PREFIX)) != 0 || strncmp(name + strlen(PREFIX), kind, length) != 0 ||
        name[strlen(PREFIX) + length] != '-') {
        return 0;
    }
    const char *digits = name + strlen(PREFIX) + length + 1;
    char *end = NULL;
    errno = 0;
    long pid = digits[0] >= '1' && digits[0] <= '9' ? strtol(digits, &end, 10) : 0;
    bool is_whole = pid > 0 && errno == 0 && pid <= INT32_MAX && end[0] == '-' && strlen(end) == LETTERS + 1;
    return is_whole ? (pid_t)pid : 0;
}

/* A process of that number may be alive in another container that shares the folder: then it holds the lock. */
static bool sweep_one(int parent, const char *parent_path, const char *name) {
    struct stat status;
    if (fstatat(parent, name, &status, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISDIR(status.st_mode) ||
        status.st_uid != geteuid()) {
        return true;
    }
    int folder = open_folder(parent, name);
    if (folder < 0) {
        return true;
    }
    char path[PATH_MAX];
    int length = snprintf(path, sizeof path, "%s/%s", parent_path, name);
    if (flock(folder, LOCK_EX | LOCK_NB) != 0 || length <= 0 || (size_t)length >= sizeof path) {
        (void)close(folder);
        return false;
    }
    tl_log(TL_LOG_INFO, "removing %s, left by a process that was killed", path);
    remove_tree(folder, path);
    return true;
}

/* A child that the owner has just forked has the lock as well, and dies a moment later than its parent. */
enum { SWEEPS = 50, SWEEP_PAUSE_US = 10000 };

/* False: one is still locked. */
static bool sweep(const char *parent_path, const char *kind) {
    DIR *parent = opendir(parent_path);
    bool is_clean = true;
    if (parent == NULL) {
        return true;
    }
    for (struct dirent *entry = readdir(parent); entry != NULL; entry = readdir(parent)) {
        pid_t pid = owner_of(entry->d_name, kind);
        /* Our own number counts as gone: in a container it is always the same, and our own folders are locked. */
        if (pid > 0 && (pid == getpid() || (kill(pid, 0) != 0 && errno == ESRCH))) {
            is_clean = sweep_one(dirfd(parent), parent_path, entry->d_name) && is_clean;
        }
    }
    (void)closedir(parent);
    return is_clean;
}

/* The folder for temporary files, without links in it. False, with errno, where it cannot be used. */
static bool find_parent(const char **name, char parent[PATH_MAX]) {
    const char *wanted = getenv("TMPDIR");
    *name = wanted != NULL && wanted[0] != '\0' ? wanted : "/tmp";
    return realpath(*name, parent) != NULL;
}

void tl_private_folder_sweep(const char *kind) {
    const char *name = NULL;
    char parent[PATH_MAX];
    if (!find_parent(&name, parent)) {
        return;
    }
    for (int i = 0; i < SWEEPS && !sweep(parent, kind); i++) {
        (void)usleep(SWEEP_PAUSE_US);
    }
}

/* ---- Making -------------------------------------------------------------------------------------------- */

/* Locks it, and shares it. It stays ours, so that our sweep knows it. */
static tl_status claim(uint32_t user, tl_private_folder *folder, tl_error *error) {
    folder->descriptor = open(folder->path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder->descriptor < 0 || flock(folder->descriptor, LOCK_EX | LOCK_NB) != 0) {
        return tl_fail(error, TL_TRY_AGAIN, "%s cannot be locked: %s; try again", folder->path, strerror(errno));
    }
    if (user != 0 && (fchown(folder->descriptor, (uid_t)-1, (gid_t)user) != 0 ||
                      fchmod(folder->descriptor, S_IRWXU | S_IRWXG) != 0)) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "%s cannot be shared with user %u: %s; start the program as root, or set no user", folder->path,
                       user, strerror(errno));
    }
    return TL_OK;
}

tl_status tl_private_folder_make(const char *kind, uint32_t user, tl_private_folder *folder, tl_error *error) {
    const char *name = NULL;
    char parent[PATH_MAX];
    *folder = (tl_private_folder){.descriptor = -1};
    if (!find_parent(&name, parent)) {
        return tl_fail(error, TL_TRY_AGAIN, "the folder for temporary files, %s, cannot be used: %s; set TMPDIR", name,
                       strerror(errno));
    }
    if (!leaves) {
        (void)sweep(parent, kind);
    }
    int length =
        snprintf(folder->path, sizeof folder->path, "%s/" PREFIX "%s-%ld-XXXXXX", parent, kind, (long)getpid());
    if (length < 0 || (size_t)length > sizeof folder->path - TL_PRIVATE_FOLDER_ROOM) {
        folder->path[0] = '\0';
        return tl_fail(error, TL_TRY_AGAIN, "TMPDIR is too long a path; set a shorter one");
    }
    if (mkdtemp(folder->path) == NULL) {
        int code = errno;
        folder->path[0] = '\0';
        return tl_fail(error, TL_TRY_AGAIN, "no folder can be made in %s: %s; free space or set TMPDIR", parent,
                       strerror(code));
    }
    tl_status status = claim(user, folder, error);
    if (status != TL_OK) {
        tl_private_folder_remove(folder);
    }
    return status;
}
