/* SQL statements, rows, and what a fault of SQLite means: see database_sql.h. */
#include "firmware/store/database_sql.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

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
