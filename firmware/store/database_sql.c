/* SQL statements, rows, and what a fault of SQLite means: see database_sql.h. */
#include "firmware/store/database_sql.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "master/base/text.h"

/* ---- database fault ---- */

static __thread tl_database_fault last;

tl_database_fault tl_database_get_fault(void) {
    return last;
}

void tl_database_set_fault(tl_database_fault fault) {
    last = fault;
}

tl_database_fault tl_database_fault_of_errno(int number) {
    switch (number) {
    case EACCES:
    case EPERM:
    case EROFS:
    case ELOOP:
        return TL_DATABASE_DENIED;
    default:
        return TL_DATABASE_LATER;
    }
}

tl_database_fault tl_database_fault_of(int code, int number) {
    switch (code & 0xFF) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
        return TL_DATABASE_DAMAGED;
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_AUTH:
        return TL_DATABASE_DENIED;
    case SQLITE_CANTOPEN:
        return tl_database_fault_of_errno(number);
    case SQLITE_IOERR: /* of a medium that cannot be read any more */
        return code == SQLITE_IOERR_READ || code == SQLITE_IOERR_CORRUPTFS ? TL_DATABASE_DENIED : TL_DATABASE_LATER;
    case SQLITE_ERROR: /* not the tables that our statements are about */
    case SQLITE_MISMATCH:
    case SQLITE_CONSTRAINT:
    case SQLITE_SCHEMA:
    case SQLITE_TOOBIG:
    case SQLITE_INTERRUPT:
        return TL_DATABASE_FOREIGN;
    default:
        return TL_DATABASE_LATER;
    }
}

tl_status tl_database_refuse(tl_database_fault fault, tl_error *error, tl_status status, const char *format, ...) {
    char text[TL_ERROR_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    last = fault;
    return tl_fail(error, status, "%s", text);
}

/* ---- database sql ---- */

void tl_database_text(sqlite3 *database, int code, char *text, size_t size) {
    char buffer[128];
    bool known = database != NULL && sqlite3_extended_errcode(database) == code; /* else something came after it */
    int number = known ? sqlite3_system_errno(database) : 0;
    int primary = code & 0xFF;
    bool is_of_system =
        primary == SQLITE_CANTOPEN || primary == SQLITE_IOERR || primary == SQLITE_FULL || primary == SQLITE_READONLY;
    const char *message = known ? sqlite3_errmsg(database) : sqlite3_errstr(code);
    if (code == SQLITE_READONLY_DBMOVED) {
        (void)snprintf(text, size, "its file was moved or removed while it is written");
    } else if (primary == SQLITE_INTERRUPT) {
        (void)snprintf(text, size, "a question about it does not come to an end");
    } else if (primary == SQLITE_BUSY) {
        (void)snprintf(text, size, "another program has locked the database, or has been reading it for too long");
    } else if (number != 0 && is_of_system) {
        (void)snprintf(text, size, "%s (%s)", message, strerror_r(number, buffer, sizeof buffer));
    } else {
        (void)snprintf(text, size, "%s", message);
    }
}

tl_status tl_database_fail(sqlite3 *database, int code, tl_error *error) {
    char text[TL_ERROR_TEXT];
    const char *path = database == NULL ? NULL : sqlite3_db_filename(database, "main");
    tl_database_text(database, code, text, sizeof text);
    tl_database_fault fault = tl_database_fault_of(code, database == NULL ? 0 : sqlite3_system_errno(database));
    bool is_bad = fault == TL_DATABASE_DAMAGED || fault == TL_DATABASE_FOREIGN;
    tl_status status = is_bad ? TL_BAD_DATA : TL_TRY_AGAIN;
    if (database != NULL && is_bad) {
        (void)tl_database_damaged(database, error, "%s", text);
    } else {
        (void)tl_fail(error, status, "%s: %s", path == NULL ? "database" : path, text);
    }
    last = fault;
    return status;
}

tl_status tl_database_execute(sqlite3 *database, const char *sql, tl_error *error) {
    int code = sqlite3_exec(database, sql, NULL, NULL, NULL);
    return code == SQLITE_OK ? TL_OK : tl_database_fail(database, code, error);
}

tl_status tl_database_prepare(sqlite3 *database, const char *sql, sqlite3_stmt **statement, tl_error *error) {
    int code = sqlite3_prepare_v3(database, sql, -1, SQLITE_PREPARE_PERSISTENT, statement, NULL);
    return code == SQLITE_OK ? TL_OK : tl_database_fail(database, code, error);
}

tl_status tl_database_damaged(sqlite3 *database, tl_error *error, const char *format, ...) {
    char what[256];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                              "%s: is damaged: %s: take an earlier copy of it, or record into a new file",
                              sqlite3_db_filename(database, "main"), what);
}

/* ---- database row ---- */

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
