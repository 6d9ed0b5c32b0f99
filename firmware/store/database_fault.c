/* What keeps a database from being opened or written: see database_fault.h. */
#include "firmware/store/database_fault.h"

#include <errno.h>
#include <sqlite3.h>
#include <stdarg.h>
#include <stdio.h>

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
