/* SQL statements, rows, and what a fault of SQLite means.
 *
 * Thread:  one for each database.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_SQL_H
#define TL_FIRMWARE_STORE_DATABASE_SQL_H

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
 *          locked). Each says the fault too (database_sql.h).
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

/* What a time in ns, a tick or a count of the recorder stays below. */
#define TL_ROW_LARGEST (INT64_MAX / 4)

#endif
