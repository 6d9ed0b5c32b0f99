/* Columns that are believed only when they were looked at: see database_row.h. */
#include "firmware/database/database_row.h"

#include <math.h>
#include <string.h>

#include "firmware/text/json_text.h"

bool tl_row_is_null(sqlite3_stmt *row, int column) {
    return sqlite3_column_type(row, column) == SQLITE_NULL;
}

bool tl_row_integer(sqlite3_stmt *row, int column, int64_t least, int64_t most, int64_t *value) {
    if (sqlite3_column_type(row, column) != SQLITE_INTEGER) {
        return false;
    }
    int64_t found = sqlite3_column_int64(row, column);
    bool fits = found >= least && found <= most;
    *value = fits ? found : *value;
    return fits;
}

bool tl_row_integer_or_null(sqlite3_stmt *row, int column, int64_t least, int64_t most, int64_t *value) {
    return tl_row_is_null(row, column) || tl_row_integer(row, column, least, most, value);
}

bool tl_row_number(sqlite3_stmt *row, int column, double *value) {
    int type = sqlite3_column_type(row, column);
    if (type == SQLITE_NULL) {
        *value = (double)NAN;
        return true;
    }
    double found = sqlite3_column_double(row, column);
    bool fits = (type == SQLITE_FLOAT || type == SQLITE_INTEGER) && isfinite(found);
    *value = fits ? found : *value;
    return fits;
}

static bool is_utf8(const char *text, size_t size) {
    while (size > 0) {
        size_t length = tl_utf8_length(text, size);
        if (length == 0) {
            return false;
        }
        text += length;
        size -= length;
    }
    return true;
}

bool tl_row_text(sqlite3_stmt *row, int column, size_t most, const char **text) {
    if (sqlite3_column_type(row, column) != SQLITE_TEXT) {
        return false;
    }
    const char *found = (const char *)sqlite3_column_text(row, column);
    size_t size = (size_t)sqlite3_column_bytes(row, column);
    bool fits = found != NULL && size <= most && memchr(found, '\0', size) == NULL && is_utf8(found, size);
    *text = fits ? found : *text;
    return fits;
}

bool tl_row_text_or_null(sqlite3_stmt *row, int column, size_t most, const char **text) {
    if (tl_row_is_null(row, column)) {
        *text = NULL;
        return true;
    }
    return tl_row_text(row, column, most, text);
}
