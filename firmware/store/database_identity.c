/* Which files a database was in: see database_identity.h. */
#include "firmware/store/database_identity.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/store/database_lock.h"
#include "master/base/simtime.h"

/* Of an open file (name "") or of one with this name; false: errno. */
static bool look(int handle, const char *name, tl_database_inode *inode) {
    struct statx found;
    if (statx(handle, name, AT_EMPTY_PATH, STATX_INO | STATX_BTIME, &found) != 0) {
        return false;
    }
    inode->device = (uint64_t)found.stx_dev_major << 32 | found.stx_dev_minor;
    inode->number = found.stx_ino;
    inode->born =
        (found.stx_mask & STATX_BTIME) != 0 ? found.stx_btime.tv_sec * TL_SECOND + found.stx_btime.tv_nsec : 0;
    return true;
}

static bool is_same(const tl_database_inode *inode, const tl_database_inode *other) {
    return inode->device == other->device && inode->number == other->number && inode->born == other->born;
}

tl_database_identity tl_database_identify(const tl_database_file *file) {
    const tl_database_inode none = {.number = 0};
    tl_database_identity identity = {.file = none};
    if (!look(file->handle, "", &identity.file)) {
        identity.file = none;
    }
    if (!look(file->log, "", &identity.log)) {
        identity.log = none;
    }
    return identity;
}

bool tl_database_is_gone(const char *path, const tl_database_identity *identity) {
    tl_database_inode now;
    if (identity->file.number == 0) {
        return false;
    }
    return look(AT_FDCWD, path, &now) ? !is_same(&now, &identity->file) : errno == ENOENT || errno == ENOTDIR;
}

/* Its log is there, without it. */
static bool is_stray(const char *path, const char *log, const tl_database_identity *identity) {
    tl_database_inode now;
    return identity->log.number != 0 && tl_database_is_gone(path, identity) && look(AT_FDCWD, log, &now) &&
           is_same(&now, &identity->log);
}

/* Under the lock, since another twinlock may be writing there, with this log for its own. The index goes first: one that is there is believed,
 * and who reads the other file at this moment may have made it of this log. */
void tl_database_remove_stray_log(const char *path, const tl_database_identity *identity) {
    char log[PATH_MAX];
    char index[PATH_MAX];
    tl_database_lock lock = {.file = -1};
    if (snprintf(log, sizeof log, "%s-wal", path) >= PATH_MAX ||
        snprintf(index, sizeof index, "%s-shm", path) >= PATH_MAX || !is_stray(path, log, identity) ||
        tl_database_lock_take(path, 0, &lock, NULL) != TL_OK) {
        return;
    }
    if (is_stray(path, log, identity)) {
        (void)unlink(index);
        (void)unlink(log);
    }
    tl_database_lock_release(&lock);
}
