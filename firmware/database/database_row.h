/* One column of one row of a database, which may hold anything: taken only if it is what the recorder writes there.
 *
 * Purpose: SQLite turns any value into any type; a number that is a text in the file would be 0. These do not.
 * Errors:  false: it is of another type, or out of range. What is out stays as it was then.
 * Owner:   texts are valid until the statement's next step.
 * Thread:  the statement's.
 */
#ifndef TL_FIRMWARE_DATABASE_DATABASE_ROW_H
#define TL_FIRMWARE_DATABASE_DATABASE_ROW_H

#include <sqlite3.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    TL_ROW_NAME = 4096,       /* bytes that a name, a reason or an event has at most */
    TL_ROW_TEXT = 1024 * 1024 /* and a configuration */
};

/* What a time in ns, a tick or a count of the recorder stays below. */
#define TL_ROW_LARGEST (INT64_MAX / 4)

bool tl_row_is_null(sqlite3_stmt *row, int column);

bool tl_row_integer(sqlite3_stmt *row, int column, int64_t least, int64_t most, int64_t *value);

/* Where it is NULL, `value` stays as it was. */
bool tl_row_integer_or_null(sqlite3_stmt *row, int column, int64_t least, int64_t most, int64_t *value);

/* Finite; NaN where it is NULL, which stands for what was not. */
bool tl_row_number(sqlite3_stmt *row, int column, double *value);

/* UTF-8, at most `most` bytes, no NUL among them. */
bool tl_row_text(sqlite3_stmt *row, int column, size_t most, const char **text);

/* NULL where it is NULL. */
bool tl_row_text_or_null(sqlite3_stmt *row, int column, size_t most, const char **text);

#endif
