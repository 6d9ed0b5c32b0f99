/* Columns that are believed only when they were looked at: see database_row.h. */
#include "firmware/store/database_row.h"

#include <math.h>
#include <string.h>

#include "master/base/utf8.h"

tl_row tl_row_of(sqlite3_stmt *statement) {
    return (tl_row){.statement = statement, .right = true};
}

bool tl_row_is_null(const tl_row *row) {
    return sqlite3_column_type(row->statement, row->column) == SQLITE_NULL;
}

int64_t tl_row_integer(tl_row *row, int64_t least, int64_t most) {
    int column = row->column++;
    int64_t found = sqlite3_column_int64(row->statement, column);
    if (sqlite3_column_type(row->statement, column) == SQLITE_INTEGER && found >= least && found <= most) {
        return found;
    }
    row->right = false;
    return least;
}

int64_t tl_row_integer_or(tl_row *row, int64_t least, int64_t most, int64_t otherwise) {
    if (tl_row_is_null(row)) {
        row->column++;
        return otherwise;
    }
    return tl_row_integer(row, least, most);
}

double tl_row_number(tl_row *row) {
    int column = row->column++;
    int type = sqlite3_column_type(row->statement, column);
    double found = sqlite3_column_double(row->statement, column);
    if ((type == SQLITE_FLOAT || type == SQLITE_INTEGER) && isfinite(found)) {
        return found;
    }
    row->right = row->right && type == SQLITE_NULL;
    return (double)NAN;
}

static bool is_utf8(const char *text, size_t size) {
    while (size > 0) {
        uint32_t code = 0;
        size_t length = tl_utf8_read(text, size, &code);
        if (length == 0) {
            return false;
        }
        text += length;
        size -= length;
    }
    return true;
}

const char *tl_row_text(tl_row *row, size_t most) {
    int column = row->column++;
    if (sqlite3_column_type(row->statement, column) == SQLITE_TEXT) {
        const char *found = (const char *)sqlite3_column_text(row->statement, column);
        size_t size = (size_t)sqlite3_column_bytes(row->statement, column);
        if (found != NULL && size <= most && memchr(found, '\0', size) == NULL && is_utf8(found, size)) {
            return found;
        }
    }
    row->right = false;
    return "";
}

const char *tl_row_text_or_null(tl_row *row, size_t most) {
    if (tl_row_is_null(row)) {
        row->column++;
        return NULL;
    }
    return tl_row_text(row, most);
}

const unsigned char *tl_row_bytes(tl_row *row, size_t *size) {
    int column = row->column++;
    row->right = row->right && sqlite3_column_type(row->statement, column) == SQLITE_BLOB;
    const unsigned char *bytes = row->right ? sqlite3_column_blob(row->statement, column) : NULL;
    *size = bytes == NULL ? 0 : (size_t)sqlite3_column_bytes(row->statement, column);
    return bytes;
}
