/* Database file of the recorder: locks, opens, checks, replaces and closes it.
 *
 * Terms:   FILE is the path of the database. The log is SQLite's write-ahead log, FILE-wal.
 * Errors:  as in database.h; tl_database_get_fault() then returns the kind of the failure.
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
 * Purpose: two recorders on one database would remove each other's runs. They could not distinguish
 *          a run that is being written from one whose recorder was killed. The kernel releases the
 *          lock when its process ends, also if it was killed.
 * Thread:  take and release from one thread.
 */

typedef struct tl_database_lock {
    int file;            /* descriptor; −1: not locked */
    char path[PATH_MAX]; /* of the lock file */
} tl_database_lock;

/* Takes the lock of a database, given by its path; waits for at most `patience` (ns). Fails with
 * TL_TRY_AGAIN if another recorder, of this or another process, has the lock, or if the lock file
 * cannot be created. Fails with TL_BAD_DATA if a foreign file has its name. */
tl_status tl_database_lock_take(const char *database, tl_time patience, tl_database_lock *lock, tl_error *error);

/* Releases the lock and removes the lock file. A lock that is not taken is allowed. */
void tl_database_lock_release(tl_database_lock *lock);

/* ---- Open database: the lock file and a connection for writing.
 *
 * Purpose: finds or creates the file, takes the lock, opens the file, and later detects changes by
 *          other programs. A damaged twinlock database can be renamed and replaced under the same
 *          lock; a user may still repair its data.
 */

/* Largest n of FILE.damaged-n. If all of these names exist, a damaged file is not renamed. */
enum { TL_DATABASE_DAMAGED_MOST = 9 };

typedef struct tl_database_file {
    char path[PATH_MAX]; /* links resolved; "": closed */
    sqlite3 *connection;
    tl_database_lock lock;
    int handle; /* descriptor (O_PATH) of the file, also if it was renamed; −1: none */
    int log;    /* the same of its log */
    off_t size; /* bytes at the last successful check; −1: unknown */
} tl_database_file;

/* A damaged file that was renamed: its new name and the reason. */
typedef struct tl_database_renamed {
    char name[PATH_MAX]; /* "": no file was renamed */
    char why[TL_ERROR_TEXT];
} tl_database_renamed;

/* State of an open file, as tl_database_file_check() finds it. */
typedef enum tl_database_file_state {
    TL_DATABASE_IN_PLACE,    /* no change by another program */
    TL_DATABASE_MOVED,       /* the path has no file, or another one; the open file still has a name */
    TL_DATABASE_REMOVED,     /* the same, and the open file has no name any more */
    TL_DATABASE_OVERWRITTEN, /* the content is no twinlock database any more */
    TL_DATABASE_CUT,         /* pages are missing at its end */
    TL_DATABASE_WITHOUT_LOG  /* FILE-wal was removed or replaced: recent commits are only in the removed log */
} tl_database_file_state;

/* Callbacks of the connection's user. If `begin` fails, the opening calls `end` and fails. */
typedef struct tl_database_user {
    int (*begin)(void *context, sqlite3 *connection); /* returns SQLite's result code */
    void (*end)(void *context); /* the caller calls it before it renews, closes or abandons the file */
    void *context;
} tl_database_user;

/* Opens the file `given`, or creates it. `patience`: longest wait for the lock file and for locks
 * of other programs, ns. A damaged file is renamed and replaced, and *renamed is set; if `renamed`
 * is NULL, the call fails instead. After a failure the file is closed. */
tl_status tl_database_file_open(const char *given, tl_time patience, const tl_database_user *user,
                                tl_database_file *file, tl_database_renamed *renamed, tl_error *error);

/* From now on writes wait for at most `patience` (ns) for other programs. */
void tl_database_file_set_patience(tl_database_file *file, tl_time patience);

/* Detects changes by other programs; call before each write. If the folder cannot be read any more,
 * only the content of the open file is checked. */
tl_database_file_state tl_database_file_check(tl_database_file *file);

/* Stores the file's size for the next check. Call it after writing the log back, which may shorten
 * the file. */
void tl_database_file_note(tl_database_file *file);

/* Writes the log back into the file. Returns false if a reader or the disk prevents it now. */
bool tl_database_file_write_back(tl_database_file *file);

/* Renames a file that the caller has found damaged, and creates a new one. `why`: the damage, for
 * *renamed. Call the user's end() before. After a failure the file is closed. */
tl_status tl_database_file_renew(tl_database_file *file, const char *why, const tl_database_user *user,
                                 tl_database_renamed *renamed, tl_error *error);

/* Writes the log back if possible, also if the file was renamed, closes the file and releases its
 * lock. Call the user's end() before. A closed file is allowed. */
void tl_database_file_close(tl_database_file *file);

/* Closes a file that was removed or overwritten. Another file may now have the old name: nothing is
 * written into it. The log of the old file is removed, because SQLite would apply it to the new
 * file. Call the user's end() before. */
void tl_database_file_abandon(tl_database_file *file);

/* Initial value: a closed file. */
#define TL_DATABASE_FILE_NONE                                                                                          \
    {                                                                                                                  \
        .handle = -1, .log = -1, .lock = {.file = -1 }                                                                 \
    }

/* ---- Identity of a database: the inodes of file and log, for the successor of a dead writer.
 *
 * Purpose: if a database is removed, moved or replaced, its log stays. SQLite would apply that log
 *          to any file that later gets the name. A process that knows both inodes prevents this.
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

/* Returns true if there is no file at the path, or another file than `identity`. Returns false also
 * if this is unknown, for example without permission to enter the folder. */
bool tl_database_is_missing(const char *path, const tl_database_identity *identity);

/* Removes the log and its index, FILE-shm, if the database is missing but its log is still there.
 * Does nothing while another recorder has the lock. The caller must not have the lock. */
void tl_database_remove_stray_log(const char *path, const tl_database_identity *identity);

/* ---- Choice of the file: the requested file or a replacement.
 *
 * Purpose: a run continues even if it cannot be recorded. So the recorder handles nearly every
 *          fault of a file and only reports it. It never changes a foreign file and deletes no
 *          database.
 * Rules:   by fault (database.h). DAMAGED: renamed to FILE.damaged-1, -2, … and replaced by a new
 *          file. DENIED, OTHER_FORMAT, FOREIGN: a replacement, FILE.beside (or FILE.beside-2, …),
 *          is written instead. LATER, IN_USE: retried later. If the folder is read-only, the
 *          recorder has no replacement.
 * Thread:  one at a time.
 */

/* Largest n of FILE.beside-n; the first file is FILE.beside. */
enum { TL_DATABASE_BESIDE_MOST = 9 };

/* Faults that make the opening fail at once. An unattended run uses ANYHOW and retries later. */
typedef enum tl_database_policy {
    TL_DATABASE_ALL_OR_NOTHING, /* every fault */
    TL_DATABASE_IF_OURS,        /* FOREIGN, OTHER_FORMAT, IN_USE; others if no replacement can be opened */
    TL_DATABASE_ANYHOW          /* no fault */
} tl_database_policy;

/* What the caller has to report. */
typedef struct tl_database_report {
    tl_database_renamed renamed;
    char beside[TL_ERROR_TEXT]; /* why a replacement is written; "": the requested file is written */
} tl_database_report;

/* Request to open a database. */
typedef struct tl_database_wanted {
    const char *path;
    tl_time patience; /* longest wait for locks, ns */
    tl_database_policy open_policy;
    const tl_database_user *user;
} tl_database_wanted;

/* Opens the requested file or a replacement. If the call fails, *waits is true if the caller should
 * retry later; otherwise the fault is final. */
tl_status tl_database_replacement_open(const tl_database_wanted *wanted, tl_database_file *file,
                                       tl_database_report *report, bool *waits, tl_error *error);

/* Opens a replacement without trying the file itself. `why`: its fault, for report->beside. */
tl_status tl_database_replacement_beside(const char *given, const char *why, const tl_database_user *user,
                                         tl_database_file *file, tl_database_report *report, tl_error *error);

#endif
