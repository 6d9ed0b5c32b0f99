/* Database file of the recorder: see database_file.h. */
#include "firmware/store/database_file.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/store/database.h"

/* ---- Lock file: flock() on a file of our own, because SQLite has its own locks on the database
 * file. */

static const tl_time PAUSE = TL_SECOND / 20; /* between two tries */

/* Compares the open file with the file of that name. If that is impossible, the result is
 * TL_DATABASE_IN_PLACE. */
static tl_database_file_state compare_file(int handle, const char *name) {
    struct stat ours;
    struct stat named;
    if (handle < 0 || fstat(handle, &ours) != 0) {
        return TL_DATABASE_IN_PLACE;
    }
    bool file_exists = stat(name, &named) == 0;
    if (!file_exists && errno != ENOENT && errno != ENOTDIR) {
        return TL_DATABASE_IN_PLACE; /* no permission to check: continue with the open file */
    }
    if (file_exists && named.st_ino == ours.st_ino && named.st_dev == ours.st_dev) {
        return TL_DATABASE_IN_PLACE;
    }
    return ours.st_nlink == 0 ? TL_DATABASE_REMOVED : TL_DATABASE_MOVED;
}

/* Returns false if the last owner has removed the lock file after it was opened here. */
static bool is_current(const tl_database_lock *lock) {
    struct stat opened;
    struct stat named;
    return fstat(lock->file, &opened) == 0 && stat(lock->path, &named) == 0 && opened.st_ino == named.st_ino &&
           opened.st_dev == named.st_dev;
}

static void write_owner(tl_database_lock *lock) {
    char text[32];
    int length = snprintf(text, sizeof text, "%ld\n", (long)getpid());
    if (ftruncate(lock->file, 0) != 0 || pwrite(lock->file, text, (size_t)length, 0) != length) {
        return; /* only information for users */
    }
}

static tl_status fail_taken(const tl_database_lock *lock, const char *database, tl_error *error) {
    char owner[32] = "";
    ssize_t length = pread(lock->file, owner, sizeof owner - 1, 0);
    owner[length > 0 ? strcspn(owner, "\n") : 0] = '\0';
    return tl_database_refuse(
        TL_DATABASE_IN_USE, error, TL_TRY_AGAIN,
        "%s: another twinlock is writing it (process %s): stop that one, or record into another file", database,
        owner[0] == '\0' ? "unknown" : owner);
}

/* Returns true if the file is empty, or has the process id that a killed owner left. */
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

/* The lock of this process. A child that an FMU forks inherits the descriptor and would keep the
 * lock, so it closes it. */
static int held_lock = -1;

static void close_inherited(void) {
    if (held_lock >= 0) {
        (void)close(held_lock);
    }
}

static void set_held(int file) {
    static bool prepared;
    prepared = prepared || pthread_atfork(NULL, NULL, close_inherited) == 0;
    held_lock = file;
}

/* 1: taken, 0: another recorder has it, −1: errno. */
static int try_lock(tl_database_lock *lock) {
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

/* A foreign file with the lock's name may be the user's and is not changed. */
static tl_status fail_impossible(const tl_database_lock *lock, const char *database, int reason, tl_error *error) {
    if (reason == EEXIST || reason == ELOOP || reason == EISDIR) {
        return tl_database_refuse(
            TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
            "%s: twinlock needs the name %s for its lock, but another file has it: move that file away", database,
            lock->path);
    }
    return tl_database_refuse(tl_database_fault_of_errno(reason), error, TL_TRY_AGAIN,
                              "%.200s: its lock cannot be created: %s%s", database, strerror(reason),
                              reason == EACCES || reason == EPERM ? ": the user may not write in its folder" : "");
}

tl_status tl_database_lock_take(const char *database, tl_time patience, tl_database_lock *lock, tl_error *error) {
    const struct timespec pause = {.tv_nsec = (long)PAUSE};
    int length = snprintf(lock->path, sizeof lock->path, "%s-writer", database);
    if (length < 0 || (size_t)length >= sizeof lock->path) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", database);
    }
    for (tl_time waited = 0;; waited += PAUSE) {
        int result = try_lock(lock);
        if (result == 1) {
            write_owner(lock);
            set_held(lock->file);
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
        set_held(-1);
        if (is_current(lock)) { /* else it was removed, and its name may belong to another lock */
            (void)unlink(lock->path);
        }
        (void)close(lock->file); /* after unlink(): a process that finds the file finds it locked */
        lock->file = -1;
    }
}

/* ---- Open database.
 *
 * A damaged file is renamed last, after its log and its index. So a power cut in between leaves a
 * damaged database under its name. The next opening renames it to the same new name.
 */

enum { CACHE_KIB = 1024 };

void tl_database_file_set_patience(tl_database_file *file, tl_time patience) {
    (void)sqlite3_busy_timeout(file->connection, (int)(patience / (TL_SECOND / 1000)));
}

/* WAL so that users can read while the recorder writes. FULL so that committed data survives a
 * power cut (with NORMAL the log is synced only when it is written back). The recorder writes the
 * log back between batches. */
static tl_status configure(sqlite3 *connection, tl_error *error) {
    char sql[256];
    (void)snprintf(sql, sizeof sql,
                   "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA wal_autocheckpoint = 0;"
                   "PRAGMA cache_size = -%d;",
                   CACHE_KIB);
    return tl_database_execute(connection, sql, error);
}

/* The log or its index may belong to another user; then SQLite opens the file read-only without an
 * error. A lock of another program does not matter here. */
static tl_status prove_writable(sqlite3 *connection, tl_error *error) {
    (void)sqlite3_busy_timeout(connection, 100);
    int code = sqlite3_exec(connection, "BEGIN IMMEDIATE", NULL, NULL, NULL);
    if ((code & 0xFF) == SQLITE_READONLY) {
        return tl_database_fail(connection, code, error);
    }
    (void)sqlite3_exec(connection, "ROLLBACK", NULL, NULL, NULL);
    return TL_OK;
}

static bool file_exists(const char *name) {
    struct stat file;
    return lstat(name, &file) == 0;
}

static void close_handle(int *handle) {
    if (*handle >= 0) {
        (void)close(*handle);
        *handle = -1;
    }
}

static void close_connection(tl_database_file *file) {
    (void)sqlite3_close(file->connection); /* writes the log back and removes it if there is no reader */
    file->connection = NULL;
    close_handle(&file->handle);
    close_handle(&file->log);
}

/* "PATH-wal". A path whose log name is too long was never opened. */
static const char *name_log(const char *path, char name[PATH_MAX + 8]) {
    (void)snprintf(name, PATH_MAX + 8, "%s-wal", path);
    return name;
}

/* The index is removed first, because SQLite trusts an existing index. A reader of another file
 * with that name may just have built it from this log. */
static void remove_log(const char *path) {
    static const char *const ends[] = {"-shm", "-wal"};
    char name[PATH_MAX + 8];
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        (void)snprintf(name, sizeof name, "%s%s", path, ends[i]);
        (void)unlink(name);
    }
}

/* O_PATH: closing an ordinary descriptor of the file would release SQLite's locks. */
static tl_status open_connection(tl_database_file *file, tl_time patience, const tl_database_user *user,
                                 tl_error *error) {
    tl_status status = file_exists(file->path) ? TL_OK : tl_database_create(file->path, error);
    if (status == TL_OK) {
        file->handle = open(file->path, O_PATH | O_CLOEXEC);
        status = tl_database_open(file->path, true, &file->connection, error);
    }
    if (status == TL_OK) {
        status = prove_writable(file->connection, error);
    }
    if (status == TL_OK) {
        tl_database_file_set_patience(file, patience);
        status = configure(file->connection, error);
    }
    if (status == TL_OK) {
        int code = user->begin(user->context, file->connection);
        if (code != SQLITE_OK) {
            status = tl_database_fail(file->connection, code, error);
            user->end(user->context);
        }
    }
    if (status == TL_OK) {
        char name[PATH_MAX + 8];
        file->log = open(name_log(file->path, name), O_PATH | O_CLOEXEC); /* it exists after the first read */
        tl_database_file_note(file);
    }
    if (status != TL_OK) {
        close_connection(file);
    }
    return status;
}

/* ---- Renaming a damaged file ---- */

/* Returns false if the new name exists or is too long. */
static bool rename_one(const char *path, const char *name, const char *end) {
    char from[PATH_MAX];
    char to[PATH_MAX];
    int first = snprintf(from, sizeof from, "%s%s", path, end);
    int second = snprintf(to, sizeof to, "%s%s", name, end);
    if (first >= PATH_MAX || second >= PATH_MAX) {
        return false;
    }
    return !file_exists(from) || (!file_exists(to) && rename(from, to) == 0);
}

static tl_status rename_damaged(const char *path, const char *why, tl_database_renamed *renamed, tl_error *error) {
    char name[PATH_MAX];
    for (int i = 1; i <= TL_DATABASE_DAMAGED_MOST; i++) {
        int length = snprintf(name, sizeof name, "%s.damaged-%d", path, i);
        if (length < PATH_MAX && !file_exists(name) && rename_one(path, name, "-wal") &&
            rename_one(path, name, "-shm") && rename_one(path, name, "")) {
            (void)snprintf(renamed->name, sizeof renamed->name, "%s", name);
            (void)snprintf(renamed->why, sizeof renamed->why, "%s", why);
            return TL_OK;
        }
    }
    return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA, "%.400s; it cannot be renamed either", why);
}

static void close_unflushed(tl_database_file *file) {
    if (file->connection != NULL) {
        (void)sqlite3_db_config(file->connection, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, NULL);
    }
    close_connection(file);
}

tl_status tl_database_file_renew(tl_database_file *file, const char *why, const tl_database_user *user,
                                 tl_database_renamed *renamed, tl_error *error) {
    close_unflushed(file);
    tl_status status = rename_damaged(file->path, why, renamed, error);
    if (status == TL_OK) {
        status = open_connection(file, 0, user, error);
    }
    if (status != TL_OK) {
        tl_database_file_close(file);
    }
    return status;
}

/* ---- Opening and closing ---- */

tl_status tl_database_file_open(const char *given, tl_time patience, const tl_database_user *user,
                                tl_database_file *file, tl_database_renamed *renamed, tl_error *error) {
    *file = (tl_database_file)TL_DATABASE_FILE_NONE;
    tl_status status = tl_database_resolve(given, file->path, error);
    if (status == TL_OK) {
        status = tl_database_lock_take(file->path, patience, &file->lock, error);
    }
    if (status == TL_OK) {
        tl_error first;
        status = open_connection(file, patience, user, &first);
        if (status != TL_OK && tl_database_get_fault() == TL_DATABASE_DAMAGED && renamed != NULL) {
            return tl_database_file_renew(file, first.text, user, renamed, error);
        }
        if (status != TL_OK && error != NULL) {
            *error = first;
        }
    }
    if (status != TL_OK) {
        tl_database_file_close(file);
    }
    return status;
}

static off_t size_of(const tl_database_file *file) {
    struct stat ours;
    return file->handle >= 0 && fstat(file->handle, &ours) == 0 ? ours.st_size : -1;
}

/* Finds the size that the file has after the log is written back. Returns false if it is unknown
 * now. */
static bool query_bytes(const tl_database_file *file, int64_t *bytes) {
    static const char sql[] = "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size";
    sqlite3_stmt *statement = NULL;
    int code = sqlite3_prepare_v2(file->connection, sql, -1, &statement, NULL);
    if (code == SQLITE_OK) {
        code = sqlite3_step(statement);
        *bytes = code == SQLITE_ROW ? sqlite3_column_int64(statement, 0) : 0;
    }
    (void)sqlite3_finalize(statement);
    if ((code & 0xFF) == SQLITE_CORRUPT) { /* SQLite has found it */
        *bytes = INT64_MAX;
    }
    return code == SQLITE_ROW || *bytes == INT64_MAX;
}

/* Checks only a file that became shorter, because another program may write the log back and so
 * shorten it to its correct size. */
static bool is_cut(const tl_database_file *file) {
    int64_t bytes = 0;
    off_t size = size_of(file);
    return size == 0 || (size >= 0 && size < file->size && query_bytes(file, &bytes) && size < bytes);
}

/* Another program may empty the file at any moment, so the size is read after the content. */
static tl_database_file_state check_content(tl_database_file *file) {
    if (tl_database_recognise(file->connection, file->path, NULL) != TL_OK &&
        tl_database_get_fault() == TL_DATABASE_FOREIGN && size_of(file) != 0) {
        return TL_DATABASE_OVERWRITTEN;
    }
    if (is_cut(file)) {
        return TL_DATABASE_CUT;
    }
    tl_database_file_note(file);
    return TL_DATABASE_IN_PLACE;
}

tl_database_file_state tl_database_file_check(tl_database_file *file) {
    char log[PATH_MAX + 8];
    tl_database_file_state found = compare_file(file->handle, file->path);
    if (found == TL_DATABASE_IN_PLACE) {
        found = check_content(file);
    }
    if (found == TL_DATABASE_IN_PLACE && compare_file(file->log, name_log(file->path, log)) != TL_DATABASE_IN_PLACE) {
        found = TL_DATABASE_WITHOUT_LOG;
    }
    return found;
}

void tl_database_file_note(tl_database_file *file) {
    file->size = size_of(file);
}

bool tl_database_file_write_back(tl_database_file *file) {
    int frames = 0;
    int written = 0;
    return sqlite3_wal_checkpoint_v2(file->connection, "main", SQLITE_CHECKPOINT_TRUNCATE, &frames, &written) ==
           SQLITE_OK;
}

void tl_database_file_abandon(tl_database_file *file) {
    char log[PATH_MAX + 8];
    if (file->log >= 0 && compare_file(file->log, name_log(file->path, log)) == TL_DATABASE_IN_PLACE) {
        remove_log(file->path);
    }
    close_unflushed(file);
    tl_database_file_close(file);
}

void tl_database_file_close(tl_database_file *file) {
    if (file->connection != NULL && compare_file(file->handle, file->path) == TL_DATABASE_MOVED) {
        (void)tl_database_file_write_back(file); /* SQLite would not, because the log still has the old name */
    }
    close_connection(file);
    tl_database_lock_release(&file->lock);
    file->path[0] = '\0';
}

/* ---- Identity ---- */

/* Of an open file (name "") or of a file with this name. Returns false with errno. */
static bool read_inode(int handle, const char *name, tl_database_inode *inode) {
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

static bool is_same_inode(const tl_database_inode *inode, const tl_database_inode *other) {
    return inode->device == other->device && inode->number == other->number && inode->born == other->born;
}

tl_database_identity tl_database_identify(const tl_database_file *file) {
    tl_database_identity identity = {.file = {.number = 0}};
    (void)read_inode(file->handle, "", &identity.file);
    (void)read_inode(file->log, "", &identity.log);
    return identity;
}

bool tl_database_is_missing(const char *path, const tl_database_identity *identity) {
    tl_database_inode now;
    if (identity->file.number == 0) {
        return false;
    }
    return read_inode(AT_FDCWD, path, &now) ? !is_same_inode(&now, &identity->file)
                                            : errno == ENOENT || errno == ENOTDIR;
}

/* Returns whether its log exists, but the database does not. */
static bool is_stray(const char *path, const char *log, const tl_database_identity *identity) {
    tl_database_inode now;
    return identity->log.number != 0 && tl_database_is_missing(path, identity) && read_inode(AT_FDCWD, log, &now) &&
           is_same_inode(&now, &identity->log);
}

/* With the lock, because another twinlock may be writing there and use this log. */
void tl_database_remove_stray_log(const char *path, const tl_database_identity *identity) {
    char log[PATH_MAX + 8];
    tl_database_lock lock = {.file = -1};
    if (!is_stray(path, name_log(path, log), identity) || tl_database_lock_take(path, 0, &lock, NULL) != TL_OK) {
        return;
    }
    if (is_stray(path, log, identity)) {
        remove_log(path);
    }
    tl_database_lock_release(&lock);
}

/* ---- Choice of the file ---- */

enum { DENIALS = 60 }; /* tries before a denial is final */
static const tl_time DENIAL_PAUSE = TL_SECOND / 1000;
static const tl_time DENIAL_PAUSE_LAST = TL_SECOND / 64;

static bool is_refused(tl_database_policy open_policy, tl_database_fault fault) {
    bool is_ours = fault != TL_DATABASE_FOREIGN && fault != TL_DATABASE_OTHER_FORMAT && fault != TL_DATABASE_IN_USE;
    return open_policy == TL_DATABASE_ALL_OR_NOTHING || (open_policy == TL_DATABASE_IF_OURS && !is_ours);
}

static bool is_retried(tl_database_fault fault) {
    return fault == TL_DATABASE_LATER || fault == TL_DATABASE_IN_USE;
}

/* Returns the path with links resolved, beside which replacements are created. */
static const char *resolve_path(const char *given, char resolved[PATH_MAX]) {
    return tl_database_resolve(given, resolved, NULL) == TL_OK ? resolved : given;
}

/* Returns whether the folder is read-only. Then no replacement can be created, unless the folder
 * becomes writable; but then the file itself can be opened. */
static bool is_folder_readonly(const char *path) {
    char copy[PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s", path);
    return faccessat(AT_FDCWD, dirname(copy), W_OK | X_OK, AT_EACCESS) != 0;
}

/* Opens one file; `resolved` is its path without links. *is_readonly: its folder is read-only, so
 * replacements are not tried.
 * A denied file is tried again after the folder was found writable, because it may have become
 * writable meanwhile. It is tried up to DENIALS times while its mode allows writing: a reader that
 * is root creates log and index as root's files, and only then changes their owner to that of the
 * file. */
static tl_status open_file(const char *path, const char *resolved, const tl_database_wanted *wanted,
                           tl_database_file *file, tl_database_renamed *renamed, bool *is_readonly, tl_error *error) {
    tl_status status = tl_database_file_open(path, wanted->patience, wanted->user, file, renamed, error);
    tl_time pause = DENIAL_PAUSE;
    for (int i = 0; i < DENIALS && status != TL_OK && tl_database_get_fault() == TL_DATABASE_DENIED; i++) {
        *is_readonly = is_folder_readonly(resolved);
        if (*is_readonly || (i > 0 && faccessat(AT_FDCWD, resolved, W_OK, AT_EACCESS) != 0)) {
            return status;
        }
        tl_clock_sleep_until(tl_clock_now(NULL) + pause); /* on a busy machine the reader may need time */
        pause = 2 * pause < DENIAL_PAUSE_LAST ? 2 * pause : DENIAL_PAUSE_LAST;
        status = tl_database_file_open(path, wanted->patience, wanted->user, file, renamed, error);
    }
    return status;
}

static tl_status open_beside(const char *path, const char *why, const tl_database_user *user, tl_database_file *file,
                             tl_database_report *report, tl_error *error) {
    char name[PATH_MAX];
    tl_status status = TL_BAD_DATA;
    const tl_database_wanted wanted = {.path = name, .user = user};
    bool ends = false; /* true also if the next name would fail in the same way */
    for (int i = 1; i <= TL_DATABASE_BESIDE_MOST && !ends; i++) {
        int length = i == 1 ? snprintf(name, sizeof name, "%s.beside", path)
                            : snprintf(name, sizeof name, "%s.beside-%d", path, i);
        if (length >= PATH_MAX) {
            return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", path);
        }
        status = open_file(name, name, &wanted, file, &report->renamed, &ends, error);
        ends = ends || status == TL_OK || tl_database_get_fault() == TL_DATABASE_LATER;
    }
    (void)snprintf(report->beside, sizeof report->beside, "%s", status == TL_OK ? why : "");
    return status;
}

tl_status tl_database_replacement_beside(const char *given, const char *why, const tl_database_user *user,
                                         tl_database_file *file, tl_database_report *report, tl_error *error) {
    char resolved[PATH_MAX];
    return open_beside(resolve_path(given, resolved), why, user, file, report, error);
}

tl_status tl_database_replacement_open(const tl_database_wanted *wanted, tl_database_file *file,
                                       tl_database_report *report, bool *waits, tl_error *error) {
    char resolved[PATH_MAX];
    tl_error first = {TL_OK, ""};
    bool is_readonly = false;
    *report = (tl_database_report){.beside = ""};
    *waits = false;
    tl_database_renamed *renamed = wanted->open_policy == TL_DATABASE_ALL_OR_NOTHING ? NULL : &report->renamed;
    const char *path = resolve_path(wanted->path, resolved);
    tl_status status = open_file(wanted->path, path, wanted, file, renamed, &is_readonly, &first);
    tl_database_fault fault = tl_database_get_fault();
    if (status != TL_OK && !is_refused(wanted->open_policy, fault) && !is_retried(fault)) {
        if (!is_readonly && open_beside(path, first.text, wanted->user, file, report, NULL) == TL_OK) {
            return TL_OK;
        }
        *waits = wanted->open_policy == TL_DATABASE_ANYHOW || tl_database_get_fault() == TL_DATABASE_LATER;
        tl_database_set_fault(fault);
    } else if (status != TL_OK) {
        *waits = !is_refused(wanted->open_policy, fault);
    }
    if (status != TL_OK && error != NULL) {
        *error = first;
    }
    return status;
}
