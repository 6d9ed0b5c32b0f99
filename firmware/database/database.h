/* A twinlock database: what it is recognised by, how it is made and opened. The recorder writes one, history reads.
 *
 * Purpose: the one place that decides whether a file is ours, before a single byte of it can change.
 * Format:  SQLite; application_id and user_version in its header say what and which; config/SPEC.md, "Database".
 * Mode:    a new one is 0640 less the umask, and what SQLite puts beside it the same: what a plant does is not everybody's.
 * Trust:   none: every connection is guarded (database_guard.h).
 * Errors:  TL_BAD_DATA for a file that is not ours, newer than us, or damaged; TL_TRY_AGAIN for everything the
 *          system refuses (no room, no permission, locked).
 * Thread:  a connection belongs to one thread at a time.
 */
#ifndef TL_FIRMWARE_DATABASE_DATABASE_H
#define TL_FIRMWARE_DATABASE_DATABASE_H

#include <limits.h>
#include <sqlite3.h>
#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

enum {
    TL_DATABASE_APPLICATION = 0x74776C6B, /* "twlk" */
    TL_DATABASE_VERSION = 3
};

/* The schema: one statement each for tables, indices and views, then NULL; database_schema.c. */
extern const char *const tl_database_schema[];

/* The columns of the primary key of each table that is read in its order, ", " between them; then NULL. */
typedef struct tl_database_key {
    const char *table;
    const char *columns;
} tl_database_key;
extern const tl_database_key tl_database_keys[];

/* By format (there is none of format 0): it made the next one, and it read as if it were the newest (by views in the connection's own memory); the
 * same file. */
extern const char *const *const tl_database_upgrades[];
extern const char *const *const tl_database_bridges[];

/* The file must exist. An older format is brought up to date where it is to be written, and only then: read, it looks as
 * if it were. Reading does not create, recover or change anything but SQLite's own -wal and -shm files, and
 * works on a read-only medium. */
tl_status tl_database_open(const char *path, bool write, sqlite3 **database, tl_error *error);

/* Where a database that is to be written is, or will be: links resolved. Refused is what no database can be, or be
 * made of: anything but an ordinary file, a link that leads nowhere (both TL_BAD_DATA), an empty name (TL_BAD_USAGE),
 * a folder that is not there (TL_TRY_AGAIN). */
tl_status tl_database_place(const char *given, char path[PATH_MAX], tl_error *error);

/* Makes an empty database at `path`, where there is nothing. It appears whole or not at all, and replaces nothing but
 * what SQLite left there of a database that was removed; TL_BAD_DATA where others' files have such names. */
tl_status tl_database_create(const char *path, tl_error *error);

/* Both fail as tl_database_fail() does. */
tl_status tl_database_execute(sqlite3 *database, const char *sql, tl_error *error);
tl_status tl_database_prepare(sqlite3 *database, const char *sql, sqlite3_stmt **statement, tl_error *error);

/* What kind of failure a result code is; TL_OK for SQLITE_OK, SQLITE_ROW and SQLITE_DONE. */
tl_status tl_database_status(int code);

/* What went wrong in the last call on this connection: what SQLite says, and what the system says. */
void tl_database_text(sqlite3 *database, int code, char *text, size_t size);

/* The same as an error, with the file in front. */
tl_status tl_database_fail(sqlite3 *database, int code, tl_error *error);

#endif
