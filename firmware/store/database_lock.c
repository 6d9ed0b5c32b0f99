/* flock() on a file of our own. Not on the database itself: SQLite has its own locks there. */
#include "firmware/store/database_lock.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "firmware/store/database_fault.h"

static const tl_time PAUSE = TL_SECOND / 20; /* between two tries */

/* Is the file we locked still the one with that name? Its last owner may have removed it meanwhile. */
static bool is_current(const tl_database_lock *lock) {
    struct stat opened;
    struct stat named;
    return fstat(lock->file, &opened) == 0 && stat(lock->path, &named) == 0 && opened.st_ino == named.st_ino &&
           opened.st_dev == named.st_dev;
}

static void say_owner(tl_database_lock *lock) {
    char text[32];
    int length = snprintf(text, sizeof text, "%ld\n", (long)getpid());
    if (ftruncate(lock->file, 0) != 0 || pwrite(lock->file, text, (size_t)length, 0) != length) {
        return; /* only a hint for people */
    }
}

static tl_status fail_taken(const tl_database_lock *lock, const char *database, tl_error *error) {
    char owner[32] = "";
    ssize_t length = pread(lock->file, owner, sizeof owner - 1, 0);
    owner[length > 0 ? strcspn(owner, "\n") : 0] = '\0';
    return tl_database_refuse(
        TL_DATABASE_TAKEN, error, TL_TRY_AGAIN,
        "%s: another twinlock is writing it (process %s): stop that one, or record into another file", database,
        owner[0] == '\0' ? "unknown" : owner);
}

/* Empty, or with the number that a killed owner left. */
static bool is_ours(const tl_database_lock *lock) {
    char text[32];
    struct stat file;
    if (fstat(lock->file, &file) != 0 || !S_ISREG(file.st_mode) || file.st_size >= (off_t)sizeof text) {
        return false;
    }
    ssize_t length = pread(lock->file, text, sizeof text - 1, 0);
    text[length > 0 ? length : 0] = '\0';
    size_t digits = strspn(text, "0123456789");
    return strcmp(text + digits, digits == 0 ? "" : "\n") == 0;
}

/* What this process holds. A child that an FMU forks has the file too, and would hold the lock for as long as it lives: it lets go. */
static int held = -1;

static void let_go(void) {
    if (held >= 0) {
        (void)close(held);
    }
}

static void hold(int file) {
    static bool prepared;
    prepared = prepared || pthread_atfork(NULL, NULL, let_go) == 0;
    held = file;
}

/* 1: taken, 0: somebody else has it, −1: errno. */
static int try_once(tl_database_lock *lock) {
    lock->file = open(lock->path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0640);
    if (lock->file < 0) {
        return -1;
    }
    if (!is_ours(lock)) {
        errno = EEXIST;
        return -1;
    }
    if (flock(lock->file, LOCK_EX | LOCK_NB) != 0) {
        return errno == EWOULDBLOCK || errno == EINTR ? 0 : -1;
    }
    return is_current(lock) ? 1 : 0;
}

/* What is there under the lock's name may be the user's: it is left alone. */
static tl_status fail_impossible(const tl_database_lock *lock, const char *database, int reason, tl_error *error) {
    if (reason == EEXIST || reason == ELOOP || reason == EISDIR) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: %s is there and no lock of twinlock's, which needs that name: move it away",
                                  database, lock->path);
    }
    return tl_database_refuse(tl_database_fault_of_errno(reason), error, TL_TRY_AGAIN,
                              "%s: its lock, %s, cannot be made: %s", database, lock->path, strerror(reason));
}

tl_status tl_database_lock_take(const char *database, tl_time patience, tl_database_lock *lock, tl_error *error) {
    const struct timespec pause = {.tv_nsec = (long)PAUSE};
    int length = snprintf(lock->path, sizeof lock->path, "%s-writer", database);
    if (length < 0 || (size_t)length >= sizeof lock->path) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", database);
    }
    for (tl_time waited = 0;; waited += PAUSE) {
        int result = try_once(lock);
        if (result == 1) {
            say_owner(lock);
            hold(lock->file);
            return TL_OK;
        }
        tl_status status = TL_OK;
        if (result < 0) {
            status = fail_impossible(lock, database, errno, error);
        } else if (waited >= patience) {
            status = fail_taken(lock, database, error);
        }
        if (lock->file >= 0) {
            (void)close(lock->file);
            lock->file = -1;
        }
        if (status != TL_OK) {
            return status;
        }
        (void)nanosleep(&pause, NULL);
    }
}

void tl_database_lock_release(tl_database_lock *lock) {
    if (lock->file >= 0) {
        hold(-1);
        if (is_current(lock)) { /* else it was removed, and what has its name may be another one's lock */
            (void)unlink(lock->path);
        }
        (void)close(lock->file); /* in this order: who finds the file finds it locked */
        lock->file = -1;
    }
}
