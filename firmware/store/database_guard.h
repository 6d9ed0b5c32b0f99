/* A database file as hostile input: what it cannot do to us.
 *
 * Purpose: a file may be damaged, or made by somebody who wants harm. SQLite reads it, so SQLite is held on a short lead: no
 *          code of the file runs (triggers, views, virtual tables), nothing in it is longer than what the recorder writes, and
 *          no statement goes on for ever (pages may point at each other in circles). What the rows say is checked where they
 *          are read (database_row.h).
 * Thread:  a connection belongs to one thread at a time.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_GUARD_H
#define TL_FIRMWARE_STORE_DATABASE_GUARD_H

#include <sqlite3.h>

#include "master/base/status.h"

enum {
    TL_DATABASE_LONGEST = 8 * 1024 * 1024,   /* bytes of one value and of one row; a checkpoint has at most half */
    TL_DATABASE_DIAGNOSED = 64 * 1000 * 1000 /* bytes of a file that tl_database_diagnose() looks through, at most */
};

/* For a new connection, before the first SQL on it. A statement that is ended then fails with SQLITE_INTERRUPT. */
void tl_database_guard(sqlite3 *database);

/* Are the tables what they are called? Tables that are not there yet are no damage; they are missed by who needs them.
 * Errors: TL_BAD_DATA for triggers, virtual tables, and tables of ours that are none or have another key. */
tl_status tl_database_check_schema(sqlite3 *database, tl_error *error);

/* Adds to the words of an error what SQLite itself finds wrong with the pages of a small file, if it does. Reads all of it, so
 * never while a plant waits. */
void tl_database_diagnose(sqlite3 *database, tl_error *error);

#endif
