/* Database file of the recorder: its lock file, its identity; opens, replaces and closes it.
 *
 * Terms:   the log is SQLite's write-ahead log, FILE-wal.
 * Errors:  as in database.h; each failure also sets the fault (database.h).
 * Thread:  one for each database.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_FILE_H
#define TL_FIRMWARE_STORE_DATABASE_FILE_H

#include <limits.h>
#include <sqlite3.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Lock file: one writer per database. The lock file lies beside the database: "FILE-writer".
 *
 * Purpose: two recorders on one database would remove each other's runs, and could not distinguish
 *          a run that is being written from one whose recorder was killed. The lock ends with its
 *          process, however the process ends.
 * Thread:  take and release from one thread.
 */

typedef struct tl_database_lock {
    int file;
    char path[PATH_MAX];
} tl_database_lock;

/* Takes the lock; waits for at most `patience` (ns). Fails with TL_TRY_AGAIN if another recorder,
 * of this or another process, has the lock, or if the lock file cannot be created; with TL_BAD_DATA
 * if a foreign file has its name. Sets the fault (database.h). */
tl_status tl_database_lock_take(const char *database, tl_time patience, tl_database_lock *lock, tl_error *error);

void tl_database_lock_release(tl_database_lock *lock);

/* ---- Open database: the lock file and a connection for writing.
 *
 * Purpose: finds or creates the file, takes the lock, opens it, and later detects what other
 *          programs did to it. A damaged twinlock database can be renamed and replaced under the
 *          same lock; its data can still be repaired.
 * Errors:  TL_TRY_AGAIN, TL_BAD_DATA, TL_BAD_USAGE as in database.h; each failure also sets the
 *          fault (database.h).
 * Thread:  one at a time.
 */

/* Largest n of FILE.damaged-n. If all of these names exist, a damaged file is not renamed. */
enum { TL_DATABASE_DAMAGED_MOST = 9 };

typedef struct tl_database_file {
    char path[PATH_MAX]; /* links resolved; "": closed */
    sqlite3 *connection;
    tl_database_lock lock;
    int handle; /* descriptor of the file, also if it was renamed; −1: none */
    int log;    /* the same of its log */
    off_t size; /* bytes at the last successful check */
} tl_database_file;

/* A damaged file that was renamed: its new name and the reason. */
typedef struct tl_database_renamed {
    char name[PATH_MAX]; /* "": no file was renamed */
    char why[TL_ERROR_TEXT];
} tl_database_renamed;

/* State of an open file, as tl_database_file_check() finds it. */
typedef enum tl_database_file_state {
    TL_DATABASE_IN_PLACE,
    TL_DATABASE_MOVED,
    TL_DATABASE_REMOVED,
    TL_DATABASE_OVERWRITTEN, /* the content is no twinlock database any more */
    TL_DATABASE_CUT,         /* pages are missing at its end */
    TL_DATABASE_WITHOUT_LOG  /* FILE-wal was removed or replaced: recent commits are only in the removed log */
} tl_database_file_state;

/* User of a connection. The file counts as opened only if `begin` succeeds. */
typedef struct tl_database_user {
    int (*begin)(void *context, sqlite3 *connection); /* returns SQLite's result code */
    void (*end)(void *context);                       /* called also after a failed `begin` */
    void *context;
} tl_database_user;

/* Opens the file, or creates it. `patience`: longest wait for the lock file and for locks of other
 * programs, ns. A damaged file is renamed and replaced; if `renamed` is NULL, the call fails
 * instead. */
tl_status tl_database_file_open(const char *given, tl_time patience, const tl_database_user *user,
                                tl_database_file *file, tl_database_renamed *renamed, tl_error *error);

/* From now on writes wait for at most `patience` (ns) for other programs. */
void tl_database_file_set_patience(tl_database_file *file, tl_time patience);

/* Detects changes by other programs; call before each write. Returns TL_DATABASE_IN_PLACE also if
 * the folder cannot be read any more. */
tl_database_file_state tl_database_file_check(tl_database_file *file);

/* Notes the file's present size. Call it after you have written the log back, because this may
 * shorten the file. */
void tl_database_file_note(tl_database_file *file);

/* Writes the log back into the file. Returns false if a reader or the disk prevents it now. */
bool tl_database_file_write_back(tl_database_file *file);

/* Renames a file that the caller has found damaged, and creates a new one. After a failure the file
 * is closed. The caller must have called end() of the user before. */
tl_status tl_database_file_renew(tl_database_file *file, const char *why, const tl_database_user *user,
                                 tl_database_renamed *renamed, tl_error *error);

/* Closes the file and writes its log back if possible, also if the file was renamed. The caller
 * must have called end() of the user before. A closed file is allowed. */
void tl_database_file_close(tl_database_file *file);

/* Closes a file that was removed or overwritten. Another file may now have the old name: nothing is
 * written into it. The log of the old file is removed, because SQLite would apply it to the new
 * file. The caller must have called end() of the user before. */
void tl_database_file_abandon(tl_database_file *file);

/* A closed file. */
#define TL_DATABASE_FILE_NONE                                                                                          \
    {                                                                                                                  \
        .handle = -1, .log = -1, .lock = {.file = -1 }                                                                 \
    }

/* ---- Identity: the two files of a database, file and log. A process that takes over from a dead
 * writer needs it.
 *
 * Purpose: if a database is removed, moved or replaced, its log, FILE-wal, stays. SQLite would
 *          apply that log to any file that has the name later. A process that knows both files can
 *          prevent this.
 * Memory:  plain data. Zeroed: unknown, and the functions do nothing.
 * Thread:  any.
 */

/* Identifies a file independently of its name. */
typedef struct tl_database_inode {
    uint64_t device;
    uint64_t number; /* 0: none */
    int64_t born;    /* time of creation, ns since 1970; distinguishes files if a number is reused; 0: unknown */
} tl_database_inode;

typedef struct tl_database_identity {
    tl_database_inode file;
    tl_database_inode log;
} tl_database_identity;

/* Returns the identity of an open database. */
tl_database_identity tl_database_identify(const tl_database_file *file);

/* Returns true if there is no file at the path, or another file. Returns false also if this is
 * unknown, for example without permission to enter the folder. */
bool tl_database_is_missing(const char *path, const tl_database_identity *identity);

/* Removes the log and its index, FILE-shm, if the database is gone but its log is still there. Does
 * nothing while another recorder has the lock. The caller must not have the lock. */
void tl_database_remove_stray_log(const char *path, const tl_database_identity *identity);

/* ---- Choice of the file: the requested file or a replacement.
 *
 * Purpose: a run continues even if it cannot be recorded. So the recorder handles nearly every
 *          fault of a file and only reports it. It never changes a foreign file and deletes no
 *          database.
 * Rules:   by fault (database.h). DAMAGED: renamed to FILE.damaged-1, -2, … and replaced by a new
 *          file. DENIED, OTHER, FOREIGN: FILE.beside (or FILE.beside-2, …), an ordinary database,
 *          is written instead. LATER, IN_USE, and a folder that denies everything: retried later.
 * Thread:  one at a time.
 */

/* Largest n of FILE.beside-n; the first file is FILE.beside. */
enum { TL_DATABASE_BESIDE_MOST = 9 };

/* Faults that make the opening fail at once. If a user waits for the result, more faults do so. An
 * unattended run fails for none and retries later. */
typedef enum tl_database_policy {
    TL_DATABASE_ALL_OR_NOTHING, /* every fault */
    TL_DATABASE_IF_OURS,        /* FOREIGN, OTHER, IN_USE; and if there is no replacement */
    TL_DATABASE_ANYHOW          /* no fault */
} tl_database_policy;

/* What the caller has to report. */
typedef struct tl_database_report {
    tl_database_renamed renamed;
    char beside[TL_ERROR_TEXT]; /* why a replacement is written; "": the requested file is written */
} tl_database_report;

typedef struct tl_database_wanted {
    const char *path;
    tl_time patience; /* ns, for locks */
    tl_database_policy open_policy;
    const tl_database_user *user;
} tl_database_wanted;

/* Opens the requested file or a replacement. If no file is open afterwards: *waits is true if a
 * retry may succeed; otherwise the fault is an error. */
tl_status tl_database_replacement_open(const tl_database_wanted *wanted, tl_database_file *file,
                                       tl_database_report *report, bool *waits, tl_error *error);

/* Opens a replacement beside the file, without trying the file itself. `why` is copied to
 * report->beside. */
tl_status tl_database_replacement_beside(const char *given, const char *why, const tl_database_user *user,
                                         tl_database_file *file, tl_database_report *report, tl_error *error);

#endif
