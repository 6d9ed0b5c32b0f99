/* SQL of ours on a connection, and what SQLite answers: as a status and in words.
 *
 * Errors:  TL_BAD_DATA where the file is to blame, TL_TRY_AGAIN for everything the system refuses (no room, no permission,
 *          locked). Each says the fault too (database_fault.h).
 * Thread:  a connection belongs to one thread at a time.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_SQL_H
#define TL_FIRMWARE_STORE_DATABASE_SQL_H

#include <sqlite3.h>
#include <stddef.h>

#include "master/base/status.h"

/* Both fail as tl_database_fail() does. */
tl_status tl_database_execute(sqlite3 *database, const char *sql, tl_error *error);
tl_status tl_database_prepare(sqlite3 *database, const char *sql, sqlite3_stmt **statement, tl_error *error);

/* What went wrong in the last call on this connection: what SQLite says, and what the system says. */
void tl_database_text(sqlite3 *database, int code, char *text, size_t size);

/* The same as an error, with the file in front. */
tl_status tl_database_fail(sqlite3 *database, int code, tl_error *error);

/* Of a file that somebody has worked on. TL_BAD_DATA: "FILE: is damaged: WHAT: …what to do". */
tl_status tl_database_damaged(sqlite3 *database, tl_error *error, const char *format, ...) TL_PRINTF(3, 4);

#endif
