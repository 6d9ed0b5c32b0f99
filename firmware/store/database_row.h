/* One row of a database, which may hold anything: read column by column, each taken only if it is what the recorder writes there.
 *
 * Purpose: SQLite turns any value into any type; a number that is a text in the file would be 0. These do not.
 * Use:     columns are read from the left, in the order of the SELECT; `right` is looked at once all are read.
 * Errors:  a column that is of another type or out of range makes `right` false, and reads as something harmless.
 * Owner:   texts and bytes are valid until the statement's next step.
 * Thread:  the statement's.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_ROW_H
#define TL_FIRMWARE_STORE_DATABASE_ROW_H

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

typedef struct tl_row {
    sqlite3_stmt *statement;
    int column; /* the next one */
    bool right; /* all that was read so far is as it was asked for */
} tl_row;

/* The row at which the statement stands. */
tl_row tl_row_of(sqlite3_stmt *statement);

/* Looks at the next column, without reading it. */
bool tl_row_is_null(const tl_row *row);

/* The next column. `least` if it is wrong. */
int64_t tl_row_integer(tl_row *row, int64_t least, int64_t most);

/* `otherwise` if it is NULL. */
int64_t tl_row_integer_or(tl_row *row, int64_t least, int64_t most, int64_t otherwise);

/* Finite; NaN if it is NULL, which stands for what was not. */
double tl_row_number(tl_row *row);

/* UTF-8, at most `most` bytes, no NUL among them; "" if it is wrong. */
const char *tl_row_text(tl_row *row, size_t most);

/* NULL if it is NULL. */
const char *tl_row_text_or_null(tl_row *row, size_t most);

/* NULL if there are none. */
const unsigned char *tl_row_bytes(tl_row *row, size_t *size);

#endif
