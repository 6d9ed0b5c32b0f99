/* A twinlock database: what it is recognised by, how it is made and opened. The recorder writes one, history reads.
 *
 * Purpose: the one place that decides whether a file is ours, before a single byte of it can change.
 * Format:  SQLite; application_id and user_version in its header say what and which; config/SPEC.md, "Database".
 * Mode:    a new one is 0640 less the umask, and what SQLite puts beside it the same: what a plant does is not everybody's.
 * Trust:   none: every connection is guarded (database_guard.h).
 * Errors:  TL_BAD_DATA for a file that is not ours, has another format, or is damaged; TL_TRY_AGAIN for everything the
 *          system refuses (no room, no permission, locked).
 * Thread:  a connection belongs to one thread at a time.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_H
#define TL_FIRMWARE_STORE_DATABASE_H

#include <limits.h>
#include <sqlite3.h>
#include <stdbool.h>

#include "master/base/status.h"

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
