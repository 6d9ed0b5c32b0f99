/* SQLite: opening, building, verifying and closing a database; hostile content; statements, and what a fault of SQLite means.
 *
 * Thread:  one for each database.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_H
#define TL_FIRMWARE_STORE_DATABASE_H

#include <limits.h>
#include <sqlite3.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"

/* ---- What keeps a database from being opened or written, as a kind: who writes one does something else about each.
 *
 * Use:    as errno: every failure of this room sets it for its thread, and it means something only right after one.
 * Thread: any; each has its own.
 */

typedef enum tl_database_fault {
    TL_DATABASE_LATER,   /* locked, no room, no memory: another time it may work */
    TL_DATABASE_TAKEN,   /* another twinlock writes it */
    TL_DATABASE_DENIED,  /* it, or what it is on, may not be read or not be written */
    TL_DATABASE_DAMAGED, /* it is ours, and its pages are not what they were */
    TL_DATABASE_OTHER,   /* another version of twinlock wrote it, in another format */
    TL_DATABASE_FOREIGN  /* it is not ours, or somebody has worked on it, or somebody's file is in its way */
} tl_database_fault;

tl_database_fault tl_database_get_fault(void);
void tl_database_set_fault(tl_database_fault fault);

/* By SQLite's result code and, if there is one, errno. */
tl_database_fault tl_database_fault_of(int code, int number);

/* The same of errno alone. */
tl_database_fault tl_database_fault_of_errno(int number);

/* Sets the fault, then as tl_fail(). */
tl_status tl_database_refuse(tl_database_fault fault, tl_error *error, tl_status status, const char *format, ...)
    TL_PRINTF(4, 5);

/* ---- SQL of ours on a connection, and what SQLite answers: as a status and in words.
 *
 * Errors:  TL_BAD_DATA where the file is to blame, TL_TRY_AGAIN for everything the system refuses (no room, no permission,
 *          locked). Each says the fault too.
 * Thread:  a connection belongs to one thread at a time.
 */

/* Both fail as tl_database_fail() does. */
tl_status tl_database_execute(sqlite3 *database, const char *sql, tl_error *error);
tl_status tl_database_prepare(sqlite3 *database, const char *sql, sqlite3_stmt **statement, tl_error *error);

/* What went wrong in the last call on this connection: what SQLite says, and what the system says. */
void tl_database_text(sqlite3 *database, int code, char *text, size_t size);

/* The same as an error, with the file in front. */
tl_status tl_database_fail(sqlite3 *database, int code, tl_error *error);

/* Of a file that somebody has worked on. TL_BAD_DATA: "FILE: is damaged: WHAT: …what to do". */
tl_status tl_database_damaged(sqlite3 *database, tl_error *error, const char *format, ...) TL_PRINTF(3, 4);

/* Bytes of its file (SQLITE_FCNTL_FILE_POINTER) or of its log (SQLITE_FCNTL_JOURNAL_POINTER), as SQLite sees it; −1: not known. */
int64_t tl_database_size(sqlite3 *database, int which);

/* What a time in ns, a tick or a count of the recorder stays below. */
#define TL_ROW_LARGEST (INT64_MAX / 4)

/* ---- A database file as hostile input: what it cannot do to us.
 *
 * Purpose: a file may be damaged, or made by somebody who wants harm. SQLite reads it, so SQLite is held on a short lead: no
 *          code of the file runs (triggers, views, virtual tables), nothing in it is longer than what the recorder writes, and
 *          no statement goes on for ever (pages may point at each other in circles). What the rows say is checked where they
 *          are read (history.c).
 * Thread:  a connection belongs to one thread at a time.
 */

enum {
    TL_DATABASE_APPLICATION = 0x74776C6B,    /* "twlk": SQLite's application_id */
    TL_DATABASE_VERSION = 5,                 /* its user_version: the format; no other is read */
    TL_DATABASE_LONGEST = 8 * 1024 * 1024,   /* bytes of one value and of one row; a checkpoint has at most half */
    TL_DATABASE_DIAGNOSED = 64 * 1000 * 1000 /* bytes of a file that tl_database_diagnose() looks through, at most */
};

/* Adds to the words of an error what SQLite itself finds wrong with the pages of a small file, if it does. Reads all of it, so
 * never while a plant waits. */
void tl_database_diagnose(sqlite3 *database, tl_error *error);

/* ---- A twinlock database: what it is recognised by, how it is made and opened. The recorder writes one, history reads.
 *
 * Purpose: the one place that decides whether a file is ours, before a single byte of it can change.
 * Format:  SQLite; application_id and user_version in its header say what and which; config/SPEC.md, "Database".
 * Mode:    a new one is 0640 less the umask, and what SQLite puts beside it the same: what a plant does is not everybody's.
 * Trust:   none: every connection is guarded (database.h).
 * Errors:  TL_BAD_DATA for a file that is not ours, has another format, or is damaged; TL_TRY_AGAIN for everything the
 *          system refuses (no room, no permission, locked).
 * Thread:  a connection belongs to one thread at a time.
 */

/* The file must exist and have the format of this program. Reading does not create, recover or change anything
 * but SQLite's own -wal and -shm files, and works on a read-only medium. */
tl_status tl_database_open(const char *path, bool write, sqlite3 **database, tl_error *error);

/* Is the file of this connection still one of ours, by its header as it is on the disk? */
tl_status tl_database_recognise(sqlite3 *database, const char *path, tl_error *error);

/* Where a database that is to be written is, or will be: links resolved. Refused is what no database can be, or be
 * made of: anything but an ordinary file, a link that leads nowhere (both TL_BAD_DATA), an empty name (TL_BAD_USAGE),
 * a folder that is not there (TL_TRY_AGAIN). */
tl_status tl_database_place(const char *given, char path[PATH_MAX], tl_error *error);

/* Makes an empty database at `path`, where there is nothing. It appears whole or not at all, and replaces nothing but
 * what SQLite left there of a database that was removed; TL_BAD_DATA where others' files have such names. */
tl_status tl_database_create(const char *path, tl_error *error);

#endif
