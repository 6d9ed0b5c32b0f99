/* Private folders, and the safe removal of hostile contents: see private_folder.h.
 *
 * A tree is removed without recursion: non-empty subfolders are moved to the root of the tree under
 * a new name and emptied there. So two descriptors, plus one for a folder that cannot be opened
 * directly, are enough for any depth, and no path gets long.
 */
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

/* ---- Removing -------------------------------------------------------------------------------- */

/* Removal of one tree. */
typedef struct removal {
    int root;
    unsigned long names; /* number of the next new name */
    size_t changes;      /* entries removed or moved so far */
} removal;

/* Sets the mode so that entries can be removed. */
static void make_ours(int folder) {
    struct stat facts;
    if (folder >= 0 && fstat(folder, &facts) == 0 && (facts.st_mode & S_IRWXU) != S_IRWXU) {
        (void)fchmod(folder, S_IRWXU);
    }
}

/* Opens a subfolder whatever its mode, so that its entries can be removed. Returns a descriptor, or
 * −1. Follows no links. */
static int open_folder(int parent, const char *name) {
    char path[NAME_ROOM];
    int folder = openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder < 0 && errno == EACCES) {
        int folder_link = openat(parent, name, O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        (void)snprintf(path, sizeof path, "/proc/self/fd/%d", folder_link);
        bool is_opened = folder_link >= 0 && chmod(path, S_IRWXU) == 0;
        (void)close(folder_link);
        folder = is_opened ? openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC) : -1;
    }
    make_ours(folder);
    return folder;
}

/* Moves a subfolder to the root under an unused name. */
static void move_up(removal *work, int parent, const char *name) {
    char new_name[NAME_ROOM];
    int result = -1;
    int folder = open_folder(parent, name); /* moving a folder needs write permission for it */
    if (folder < 0) {
        return;
    }
    (void)close(folder);
    do {
        (void)snprintf(new_name, sizeof new_name, "%lu", work->names++);
        result = renameat(parent, name, work->root, new_name);
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

/* Calls `action` for each entry, until a whole pass changes nothing: readdir() may skip entries
 * while others are removed. Closes the folder. */
static void for_each(removal *work, int folder, void (*action)(removal *work, int folder, const char *name)) {
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
                action(work, folder, entry->d_name);
            }
        }
    } while (work->changes != before);
    (void)closedir(entries);
}

/* A subfolder of the root is emptied before it is removed. */
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

/* Removes the folder `path`, which is open as `root`, with its contents. Closes `root`. Mount
 * points and immutable files stay. */
static void remove_tree(int root, const char *path) {
    removal work = {.root = root};
    if (root >= 0) {
        make_ours(root);
        for_each(&work, root, remove_root_entry);
    }
    if (rmdir(path) != 0 && errno != ENOENT) {
        tl_log(TL_LOG_WARNING, "%s: cannot be removed completely; remove it by hand", path);
    }
}

/* The parent removes the folders of this process. */
static bool parent_removes;

void tl_private_folder_leave(void) {
    parent_removes = true;
}

void tl_private_folder_remove(tl_private_folder *folder) {
    if (folder->path[0] != '\0' && parent_removes) {
        (void)close(folder->descriptor);
    } else if (folder->path[0] != '\0') {
        remove_tree(folder->descriptor, folder->path);
    }
    folder->path[0] = '\0';
    folder->descriptor = -1;
}

/* ---- Folders of killed processes
 * ------------------------------------------------------------------------ */

/* Returns the process in twinlock-KIND-PID-XXXXXX; 0 if the name has another form. */
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

/* Removes one folder if it is not locked. Its process may be alive in another container that shares
 * the parent folder, and then holds the lock. Returns false if it is locked. */
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
    tl_log(TL_LOG_INFO, "%s: removing it, because its process was killed", path);
    remove_tree(folder, path);
    return true;
}

/* A child that the owner has just forked shares the lock and may end a moment later than its
 * parent. */
enum { SWEEPS = 50, SWEEP_PAUSE_US = 10000 };

/* Returns false if a folder is still locked. */
static bool sweep_parent(const char *parent_path, const char *kind) {
    DIR *parent = opendir(parent_path);
    bool is_clean = true;
    if (parent == NULL) {
        return true;
    }
    for (struct dirent *entry = readdir(parent); entry != NULL; entry = readdir(parent)) {
        pid_t pid = owner_of(entry->d_name, kind);
        /* A folder with our own process ID is checked too: in a container a new process may have
         * the same ID as before. Our own folders are locked. */
        if (pid > 0 && (pid == getpid() || (kill(pid, 0) != 0 && errno == ESRCH))) {
            is_clean = sweep_one(dirfd(parent), parent_path, entry->d_name) && is_clean;
        }
    }
    (void)closedir(parent);
    return is_clean;
}

/* Finds the folder for temporary files and resolves its links. Returns false with errno if it
 * cannot be used. */
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
    for (int i = 0; i < SWEEPS && !sweep_parent(parent, kind); i++) {
        (void)usleep(SWEEP_PAUSE_US);
    }
}

/* ---- Making ---------------------------------------------------------------------------------- */

/* Locks and shares the folder. The owner does not change, because sweep_one() removes only our own
 * folders. */
static tl_status lock_folder(uint32_t user, tl_private_folder *folder, tl_error *error) {
    folder->descriptor = open(folder->path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder->descriptor < 0 || flock(folder->descriptor, LOCK_EX | LOCK_NB) != 0) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: cannot be locked: %s; try again", folder->path, strerror(errno));
    }
    if (user != 0 && (fchown(folder->descriptor, (uid_t)-1, (gid_t)user) != 0 ||
                      fchmod(folder->descriptor, S_IRWXU | S_IRWXG) != 0)) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "%s: cannot be shared with user %u: %s; start twinlock as root, or set no user", folder->path,
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
    if (!parent_removes) {
        (void)sweep_parent(parent, kind);
    }
    int length =
        snprintf(folder->path, sizeof folder->path, "%s/" PREFIX "%s-%ld-XXXXXX", parent, kind, (long)getpid());
    if (length < 0 || (size_t)length > sizeof folder->path - TL_PRIVATE_FOLDER_ROOM) {
        folder->path[0] = '\0';
        return tl_fail(error, TL_TRY_AGAIN, "TMPDIR: the path is too long; set a shorter one");
    }
    if (mkdtemp(folder->path) == NULL) {
        int code = errno;
        folder->path[0] = '\0';
        return tl_fail(error, TL_TRY_AGAIN, "%s: no folder can be created here: %s; free space or set TMPDIR", parent,
                       strerror(code));
    }
    tl_status status = lock_folder(user, folder, error);
    if (status != TL_OK) {
        tl_private_folder_remove(folder);
    }
    return status;
}
