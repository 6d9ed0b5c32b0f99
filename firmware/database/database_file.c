/* A database that a recorder has for itself: see database_file.h.
 *
 * Aside: the log and its index go first, the file itself last, so that a power cut in between leaves a damaged file at its place, which is
 *        put aside the next time, to the same name. */
#include "firmware/database/database_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/database/database.h"
#include "firmware/database/database_fault.h"
#include "firmware/database/database_sql.h"

enum { CACHE_KIB = 1024 };

void tl_database_file_set_patience(tl_database_file *file, tl_time patience) {
    (void)sqlite3_busy_timeout(file->connection, (int)(patience / (TL_SECOND / 1000)));
}

/* WAL so that people can read while we write; FULL so that what is committed survives a power cut (with NORMAL the log
 * is only synced when it is written back). We write the log back ourselves, between batches. */
static tl_status configure(sqlite3 *connection, tl_error *error) {
    char sql[256];
    (void)snprintf(sql, sizeof sql,
                   "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA wal_autocheckpoint = 0;"
                   "PRAGMA cache_size = -%d;",
                   CACHE_KIB);
    return tl_database_execute(connection, sql, error);
}

static tl_status make_file(const char *path, tl_error *error) {
    struct stat file;
    return lstat(path, &file) == 0 ? TL_OK : tl_database_create(path, error);
}

static void close_connection(tl_database_file *file) {
    (void)sqlite3_close(file->connection); /* writes the log back and removes it where nobody reads */
    file->connection = NULL;
    if (file->handle >= 0) {
        (void)close(file->handle);
        file->handle = -1;
    }
}

/* SQLite's locks end when a descriptor of the file is closed, but not one that can neither be read nor written. */
static tl_status open_connection(tl_database_file *file, tl_time patience, const tl_database_user *user,
                                 tl_error *error) {
    tl_status status = make_file(file->path, error);
    if (status == TL_OK) {
        file->handle = open(file->path, O_PATH | O_CLOEXEC);
        status = tl_database_open(file->path, true, &file->connection, error);
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
    if (status != TL_OK) {
        tl_database_fault fault = tl_database_get_fault();
        close_connection(file);
        tl_database_set_fault(fault);
    }
    return status;
}

/* ---- Aside ------------------------------------------------------------------------------------------------------- */

static bool is_there(const char *name) {
    struct stat file;
    return lstat(name, &file) == 0;
}

/* False where the new name is somebody's, or too long. */
static bool put_one_aside(const char *path, const char *name, const char *end) {
    char from[PATH_MAX];
    char to[PATH_MAX];
    int first = snprintf(from, sizeof from, "%s%s", path, end);
    int second = snprintf(to, sizeof to, "%s%s", name, end);
    if (first >= PATH_MAX || second >= PATH_MAX) {
        return false;
    }
    return !is_there(from) || (!is_there(to) && rename(from, to) == 0);
}

static tl_status put_aside(const char *path, const char *why, tl_database_aside *aside, tl_error *error) {
    char name[PATH_MAX];
    for (int i = 1; i <= TL_DATABASE_DAMAGED_MOST; i++) {
        int length = snprintf(name, sizeof name, "%s.damaged-%d", path, i);
        if (length < PATH_MAX && !is_there(name) && put_one_aside(path, name, "-wal") &&
            put_one_aside(path, name, "-shm") && put_one_aside(path, name, "")) {
            (void)snprintf(aside->name, sizeof aside->name, "%s", name);
            (void)snprintf(aside->why, sizeof aside->why, "%s", why);
            return TL_OK;
        }
    }
    return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA, "%.400s, and it cannot be put aside", why);
}

tl_status tl_database_file_renew(tl_database_file *file, const char *why, const tl_database_user *user,
                                 tl_database_aside *aside, tl_error *error) {
    if (file->connection != NULL) { /* it stays as it is */
        (void)sqlite3_db_config(file->connection, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, NULL);
    }
    close_connection(file);
    tl_status status = put_aside(file->path, why, aside, error);
    if (status == TL_OK) {
        status = open_connection(file, 0, user, error);
    }
    if (status != TL_OK) {
        tl_database_fault fault = tl_database_get_fault();
        tl_database_file_close(file);
        tl_database_set_fault(fault);
    }
    return status;
}

/* ---- Opening and closing ----------------------------------------------------------------------------------------- */

tl_status tl_database_file_open(const char *given, tl_time patience, const tl_database_user *user,
                                tl_database_file *file, tl_database_aside *aside, tl_error *error) {
    *file = (tl_database_file)TL_DATABASE_FILE_NONE;
    tl_status status = tl_database_place(given, file->path, error);
    if (status == TL_OK) {
        status = tl_database_lock_take(file->path, patience, &file->lock, error);
    }
    if (status == TL_OK) {
        tl_error first;
        status = open_connection(file, patience, user, &first);
        if (status != TL_OK && tl_database_get_fault() == TL_DATABASE_DAMAGED && aside != NULL) {
            return tl_database_file_renew(file, first.text, user, aside, error);
        }
        if (status != TL_OK && error != NULL) {
            *error = first;
        }
    }
    if (status != TL_OK) {
        tl_database_fault fault = tl_database_get_fault();
        tl_database_file_close(file);
        tl_database_set_fault(fault);
    }
    return status;
}

tl_database_whereabouts tl_database_file_look(const tl_database_file *file) {
    struct stat ours;
    struct stat named;
    if (file->handle < 0 || fstat(file->handle, &ours) != 0) {
        return TL_DATABASE_IN_PLACE;
    }
    if (stat(file->path, &named) == 0 && named.st_ino == ours.st_ino && named.st_dev == ours.st_dev) {
        return TL_DATABASE_IN_PLACE;
    }
    return ours.st_nlink == 0 ? TL_DATABASE_REMOVED : TL_DATABASE_MOVED;
}

void tl_database_file_close(tl_database_file *file) {
    if (file->connection != NULL && tl_database_file_look(file) == TL_DATABASE_MOVED) {
        /* SQLite does not when it closes: its log stays under the old name. */
        (void)sqlite3_wal_checkpoint_v2(file->connection, "main", SQLITE_CHECKPOINT_TRUNCATE, NULL, NULL);
    }
    close_connection(file);
    tl_database_lock_release(&file->lock);
    file->path[0] = '\0';
}
