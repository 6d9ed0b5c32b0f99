/* Opens, creates and validates twinlock databases, and classifies SQLite's faults.
 *
 * Purpose: only this module decides whether a file is a twinlock database, and protects against
 *          untrusted content.
 * Trust:   a database file is untrusted; every connection is restricted before its first SQL.
 * Errors:  TL_BAD_DATA, TL_TRY_AGAIN, TL_BAD_USAGE; each failure also sets the fault (see below).
 * Thread:  one at a time for each database.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_H
#define TL_FIRMWARE_STORE_DATABASE_H

#include <limits.h>
#include <sqlite3.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/run_types.h"
#include "master/base/status.h"

/* ---- Database fault: why a database cannot be opened or written. The recorder reacts differently
 * to each kind.
 *
 * Use:    like errno: each failure of this module sets it; the value is valid only directly after a
 *         failure.
 * Thread: any; each thread has its own value.
 */

typedef enum tl_database_fault {
    TL_DATABASE_LATER,        /* locked, disk full, out of memory: a retry may succeed */
    TL_DATABASE_IN_USE,       /* another twinlock writes it */
    TL_DATABASE_DENIED,       /* no permission to read or write the file or its medium */
    TL_DATABASE_DAMAGED,      /* a twinlock database whose pages are corrupted */
    TL_DATABASE_OTHER_FORMAT, /* another version of twinlock wrote it, in another format */
    TL_DATABASE_FOREIGN       /* no twinlock database, modified by another program, or with a foreign file beside it */
} tl_database_fault;

tl_database_fault tl_database_get_fault(void);
void tl_database_set_fault(tl_database_fault fault);

/* Returns the fault for `code`, SQLite's result code. `number`: the errno, needed only for
 * SQLITE_CANTOPEN. */
tl_database_fault tl_database_fault_of(int code, int number);

/* Returns the fault for an errno. */
tl_database_fault tl_database_fault_of_errno(int number);

/* Sets the fault and the error's text, and returns `status` (as tl_fail() in status.h). */
tl_status tl_database_refuse(tl_database_fault fault, tl_error *error, tl_status status, const char *format, ...)
    TL_PRINTF(4, 5);

/* ---- SQL statements: executes them on a connection and converts SQLite's result into a status and
 * a text.
 *
 * Errors: TL_BAD_DATA if the file is the cause, TL_TRY_AGAIN if the system refuses (disk full, no
 *         permission, locked).
 * Thread: one at a time for each connection.
 */

/* Execute or prepare SQL; a failure is reported as by tl_database_fail(). */
tl_status tl_database_execute(sqlite3 *database, const char *sql, tl_error *error);
tl_status tl_database_prepare(sqlite3 *database, const char *sql, sqlite3_stmt **statement, tl_error *error);

/* Writes to `text` why the last call on this connection failed: SQLite's message and, if known,
 * that of the system. `code`: the result of the call. */
void tl_database_text(sqlite3 *database, int code, char *text, size_t size);

/* Reports the text of tl_database_text() with the file's path; sets the fault, returns a status. */
tl_status tl_database_fail(sqlite3 *database, int code, tl_error *error);

/* Reports wrong content in intact pages, so another program wrote it. Returns TL_BAD_DATA with the
 * text "FILE: is damaged: WHAT; what to do"; the fault is TL_DATABASE_FOREIGN. */
tl_status tl_database_invalid(sqlite3 *database, tl_error *error, const char *format, ...) TL_PRINTF(3, 4);

/* Returns the size in bytes of the database file (SQLITE_FCNTL_FILE_POINTER) or of its
 * write-ahead log (SQLITE_FCNTL_JOURNAL_POINTER) as SQLite sees it; −1 if unknown. */
int64_t tl_database_size(sqlite3 *database, int which);

/* ---- Protection against untrusted database files.
 *
 * Purpose: a file may be corrupted, or made by an attacker. So SQLite executes no code of the file
 *          (triggers, views, virtual tables) and accepts no row above TL_DATABASE_LONGEST. It
 *          terminates statements that run too long, because corrupted pages can form a cycle.
 *          history.c validates the rows when it reads them.
 */

enum {
    TL_DATABASE_APPLICATION = 0x74776C6B,    /* "twlk": SQLite's application_id */
    TL_DATABASE_VERSION = 8,                 /* SQLite's user_version: number of the format */
    TL_DATABASE_LONGEST = 8 * 1024 * 1024,   /* most bytes of a value or a row */
    TL_DATABASE_DIAGNOSED = 64 * 1000 * 1000 /* bytes of the largest file that is diagnosed */
};

/* Runs SQLite's quick check on a file of at most TL_DATABASE_DIAGNOSED bytes, and appends the first
 * problem found to the error's text. Reads the whole file: do not call during a live run. */
void tl_database_diagnose(sqlite3 *database, tl_error *error);

/* ---- Twinlock database: recognises, creates and opens it. The recorder writes databases, the
 * history reads them.
 *
 * Purpose: decides whether a file is a twinlock database before any of its bytes can change.
 * Format:  SQLite; application_id and user_version in the header identify it; see
 *          docs/reference/database.md.
 * Mode:    a new database, and SQLite's files beside it, have mode 0640 less the umask, because
 *          plant data is not public.
 * Trust:   the file is untrusted; every connection is restricted as described above.
 * Errors:  TL_BAD_DATA if the file is not a twinlock database, has another format or is damaged;
 *          TL_TRY_AGAIN if the system refuses (disk full, no permission, locked).
 */

/* Opens an existing file; the caller closes it with sqlite3_close(). `write` false: SQL cannot
 * change the content. The last reader to close still writes SQLite's log back and removes -wal and
 * -shm. A read-only medium is allowed. `write` true: a read-only file fails with TL_TRY_AGAIN. */
tl_status tl_database_open(const char *path, bool write, sqlite3 **database, tl_error *error);

/* Checks the header on the disk: returns TL_OK if the open file is a twinlock database of this
 * format. `path` is used for the error's text only. */
tl_status tl_database_recognise(sqlite3 *database, const char *path, tl_error *error);

/* Resolves the links in `given`, and writes the result to `path`. The database need not exist yet.
 * Fails with TL_BAD_DATA if it is not an ordinary file, or is a link to a missing file. Fails with
 * TL_BAD_USAGE for an empty name, and with TL_TRY_AGAIN if the folder does not exist. */
tl_status tl_database_resolve(const char *given, char path[PATH_MAX], tl_error *error);

/* Creates an empty database at `path`, where no file may exist. The database appears complete or
 * not at all. If SQLite's own files of a removed database are still there (-wal, -shm, -journal),
 * they are removed first. Fails with TL_BAD_DATA if foreign files have these names. */
tl_status tl_database_create(const char *path, tl_error *error);

#endif
