/* SQL of ours, and SQLite's answers: see database_sql.h. */
#include "firmware/store/database_sql.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "firmware/store/database_fault.h"

/* What kind of failure a result code is; TL_OK for SQLITE_OK, SQLITE_ROW and SQLITE_DONE. */
static tl_status status_of(int code) {
    switch (code & 0xFF) {
    case SQLITE_OK:
    case SQLITE_ROW:
    case SQLITE_DONE:
        return TL_OK;
    case SQLITE_ERROR:
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
    case SQLITE_MISMATCH:
    case SQLITE_CONSTRAINT:
    case SQLITE_SCHEMA:
    case SQLITE_TOOBIG:
    case SQLITE_INTERRUPT:
        return TL_BAD_DATA;
    default:
        return TL_TRY_AGAIN;
    }
}

static bool is_system_failure(int code) {
    int primary = code & 0xFF;
    return primary == SQLITE_CANTOPEN || primary == SQLITE_IOERR || primary == SQLITE_FULL ||
           primary == SQLITE_READONLY;
}

void tl_database_text(sqlite3 *database, int code, char *text, size_t size) {
    char buffer[128];
    bool known = database != NULL && sqlite3_extended_errcode(database) == code; /* else something came after it */
    int number = known ? sqlite3_system_errno(database) : 0;
    const char *message = known ? sqlite3_errmsg(database) : sqlite3_errstr(code);
    if (code == SQLITE_READONLY_DBMOVED) {
        (void)snprintf(text, size, "its file was moved or removed while it is written");
    } else if ((code & 0xFF) == SQLITE_INTERRUPT) {
        (void)snprintf(text, size, "a question about it does not come to an end");
    } else if ((code & 0xFF) == SQLITE_BUSY) {
        (void)snprintf(text, size, "another program has locked the database, or has been reading it for too long");
    } else if (number != 0 && is_system_failure(code)) {
        (void)snprintf(text, size, "%s (%s)", message, strerror_r(number, buffer, sizeof buffer));
    } else {
        (void)snprintf(text, size, "%s", message);
    }
}

tl_status tl_database_fail(sqlite3 *database, int code, tl_error *error) {
    char text[TL_ERROR_TEXT];
    const char *path = database == NULL ? NULL : sqlite3_db_filename(database, "main");
    tl_database_text(database, code, text, sizeof text);
    if (database != NULL && status_of(code) == TL_BAD_DATA) {
        (void)tl_database_damaged(database, error, "%s", text);
        tl_database_set_fault(tl_database_fault_of(code, 0));
        return TL_BAD_DATA;
    }
    tl_database_set_fault(tl_database_fault_of(code, database == NULL ? 0 : sqlite3_system_errno(database)));
    return tl_fail(error, status_of(code), "%s: %s", path == NULL ? "database" : path, text);
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
