/* The file of a database: its lock, its identity, opening and replacing it.
 *
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

/* ---- One writer per database: a lock file beside it, "FILE-writer".
 *
 * Purpose: two programs that record into one database would remove each other's runs, and neither could tell a run that
 *          is being written from one that was killed. The lock ends with the process, however that ends.
 * Thread:  take and release from one thread.
 */

typedef struct tl_database_lock {
    int file;
    char path[PATH_MAX];
} tl_database_lock;

/* Waits for at most `patience`. TL_TRY_AGAIN if another recorder has it, of this process or another, or if the
 * file cannot be made; TL_BAD_DATA if its name is that of a file which is no lock. Says the fault (database.h). */
tl_status tl_database_lock_take(const char *database, tl_time patience, tl_database_lock *lock, tl_error *error);

void tl_database_lock_release(tl_database_lock *lock);

/* ---- A database that a recorder has for itself: the lock beside it, and a connection that writes.
 *
 * Purpose: finds or makes the file, takes the lock, opens it, and says what has become of it since. A damaged file of ours can be put
 *          aside, for whoever may still get something out of it, and another be made at its place, all under the same lock.
 * Errors:  TL_TRY_AGAIN, TL_BAD_DATA, TL_BAD_USAGE as in database.h; each says the fault (database.h).
 * Thread:  one at a time.
 */

/* Files FILE.damaged-1, -2, … that may be; with all of them there, a damaged one stays where it is. */
enum { TL_DATABASE_DAMAGED_MOST = 9 };

typedef struct tl_database_file {
    char path[PATH_MAX]; /* links resolved; "": it is closed */
    sqlite3 *connection;
    tl_database_lock lock;
    int handle; /* of the file itself, whatever it is called by now; −1: none */
    int log;    /* the same of its log, FILE-wal */
    off_t size; /* when it was found to be in order */
} tl_database_file;

/* What was put aside: where it is now, and why. */
typedef struct tl_database_aside {
    char name[PATH_MAX]; /* "": nothing was */
    char why[TL_ERROR_TEXT];
} tl_database_aside;

/* What has become of a file that is open. */
typedef enum tl_database_whereabouts {
    TL_DATABASE_IN_PLACE,
    TL_DATABASE_MOVED,
    TL_DATABASE_REMOVED,
    TL_DATABASE_OVERWRITTEN, /* what is in it now is not ours */
    TL_DATABASE_CUT,         /* pages of it are missing */
    TL_DATABASE_WITHOUT_LOG  /* FILE-wal is not that any more: what was committed lately is in no file with a name */
} tl_database_whereabouts;

/* Who is going to use a connection: whether it can is part of whether the file can be opened. */
typedef struct tl_database_user {
    int (*begin)(void *context, sqlite3 *connection); /* prepares what is needed; SQLite's result code */
    void (*end)(void *context);                       /* and gives it back, after a failure too */
    void *context;
} tl_database_user;

/* Finds the file or makes it. `patience` is for the lock and for other programs'. A damaged one is put aside, and another one made; if
 * `aside` is NULL, that is refused. */
tl_status tl_database_file_open(const char *given, tl_time patience, const tl_database_user *user,
                                tl_database_file *file, tl_database_aside *aside, tl_error *error);

/* What is written in it from now on waits so long for other programs. */
void tl_database_file_set_patience(tl_database_file *file, tl_time patience);

/* Before something is written: whoever may not look into the folder any more is told that it is in place. */
tl_database_whereabouts tl_database_file_look(tl_database_file *file);

/* We have written the log back ourselves: it may be shorter by that. */
void tl_database_file_note(tl_database_file *file);

/* Brings what is in the log into the file. False: not now, since a reader or the disk is in the way. */
bool tl_database_file_write_back(tl_database_file *file);

/* It shows damage, as the caller has seen: puts it aside and makes another one. A failure leaves it closed. The user has ended. */
tl_status tl_database_file_renew(tl_database_file *file, const char *why, const tl_database_user *user,
                                 tl_database_aside *aside, tl_error *error);

/* Closes it, written back as far as can be: also where it has another name by now. The user has ended. A closed one is allowed. */
void tl_database_file_close(tl_database_file *file);

/* Closes one that was removed or overwritten: nothing is written into what has its name now, and its log goes, which would be
 * played into that. The user has ended. */
void tl_database_file_abandon(tl_database_file *file);

/* What is closed. */
#define TL_DATABASE_FILE_NONE                                                                                          \
    {                                                                                                                  \
        .handle = -1, .log = -1, .lock = {.file = -1 }                                                                 \
    }

/* ---- Which files a database was in, for whoever is told of it later: another process, after the one that wrote has died.
 *
 * Purpose: a file that was removed, moved away or replaced meanwhile leaves its log, FILE-wal, behind, and SQLite would play that into whatever
 *          has the file's name by then. Who knows which two files belonged together can prevent that.
 * Memory:  plain data, zeroed: nothing is known, and then nothing is done.
 * Thread:  any.
 */

/* One file, whatever it is called. */
typedef struct tl_database_inode {
    uint64_t device;
    uint64_t number; /* 0: none */
    int64_t born;    /* ns since 1970, since numbers are given again; 0: the file system does not say */
} tl_database_inode;

typedef struct tl_database_identity {
    tl_database_inode file;
    tl_database_inode log;
} tl_database_identity;

/* Of a database that is open. */
tl_database_identity tl_database_identify(const tl_database_file *file);

/* At this path there is another file now, or none. False also if that cannot be told, as in a folder that may not be entered. */
bool tl_database_is_gone(const char *path, const tl_database_identity *identity);

/* If it is gone and its log is still there: removes that, and the log's index, FILE-shm. Not while another recorder has the lock. The caller must
 * have none. */
void tl_database_remove_stray_log(const char *path, const tl_database_identity *identity);

/* ---- Which file is written: the one that was asked for, or what there is instead of it.
 *
 * Purpose: a plant is kept in step whether it can be recorded or not; so who records copes with nearly everything that can be wrong
 *          with a file, and only says so. What was never ours is never touched, and nothing is ever deleted.
 * Rules:   by fault (database.h). Damaged: put aside as FILE.damaged-1, -2, … and made anew. Denied, other, foreign: FILE.beside
 *          is written (if need be FILE.beside-2, …), which is a database like any other. Later, taken: it is waited for; and so is a folder
 *          that denies everything.
 * Thread:  one at a time.
 */

/* FILE.beside, FILE.beside-2, … up to this one. */
enum { TL_DATABASE_BESIDE_MOST = 9 };

/* What is an error all the same: who asked for this file is there to be told. */
typedef enum tl_database_insistence {
    TL_DATABASE_ALL_OR_NOTHING, /* every fault is */
    TL_DATABASE_IF_OURS,        /* foreign, other, taken; and if there is nothing instead */
    TL_DATABASE_ANYHOW          /* none is */
} tl_database_insistence;

/* What to say about it. */
typedef struct tl_database_news {
    tl_database_aside aside;
    char beside[TL_ERROR_TEXT]; /* why the file is another one than was asked for; "": it is not */
} tl_database_news;

typedef struct tl_database_wanted {
    const char *path;
    tl_time patience; /* with locks */
    tl_database_insistence insistence;
    const tl_database_user *user;
} tl_database_wanted;

/* Opens one. If none is open then: *waits, trying again may help; else it is an error. */
tl_status tl_database_instead_open(const tl_database_wanted *wanted, tl_database_file *file, tl_database_news *news,
                                   bool *waits, tl_error *error);

/* Opens one beside it at once; `why` goes into the news. */
tl_status tl_database_instead_beside(const char *given, const char *why, const tl_database_user *user,
                                     tl_database_file *file, tl_database_news *news, tl_error *error);

#endif
