/* See sql.h. */
#include "tests/support/sql.h"

#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/message.h"

static char answer[4096];

static sqlite3 *connect_to(const char *path) {
    sqlite3 *database = NULL;
    if (sqlite3_open_v2(path, &database, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, NULL) != SQLITE_OK) {
        (void)fprintf(stderr, "%s: %s\n", path, sqlite3_errmsg(database));
        abort();
    }
    (void)sqlite3_busy_timeout(database, 10000);
    return database;
}

static void give_up(sqlite3 *database, const char *sql) {
    (void)fprintf(stderr, "%s: %s\n", sql, sqlite3_errmsg(database));
    abort();
}

/* The caller releases the statement with end(). */
static sqlite3_stmt *first_row(const char *path, const char *sql, int *has_row) {
    sqlite3 *database = connect_to(path);
    sqlite3_stmt *statement = NULL;
    if (sqlite3_prepare_v2(database, sql, -1, &statement, NULL) != SQLITE_OK) {
        give_up(database, sql);
    }
    int code = sqlite3_step(statement);
    if (code != SQLITE_ROW && code != SQLITE_DONE) {
        give_up(database, sql);
    }
    *has_row = code == SQLITE_ROW;
    return statement;
}

static void end(sqlite3_stmt *statement) {
    sqlite3 *database = sqlite3_db_handle(statement);
    (void)sqlite3_finalize(statement);
    (void)sqlite3_close(database);
}

int64_t tl_sql_integer(const char *path, const char *sql) {
    int has_row = 0;
    sqlite3_stmt *row = first_row(path, sql, &has_row);
    int64_t value = has_row ? sqlite3_column_int64(row, 0) : 0;
    end(row);
    return value;
}

double tl_sql_number(const char *path, const char *sql) {
    int has_row = 0;
    sqlite3_stmt *row = first_row(path, sql, &has_row);
    double value = has_row ? sqlite3_column_double(row, 0) : 0;
    end(row);
    return value;
}

const char *tl_sql_text(const char *path, const char *sql) {
    int has_row = 0;
    sqlite3_stmt *row = first_row(path, sql, &has_row);
    const unsigned char *text = has_row ? sqlite3_column_text(row, 0) : NULL;
    (void)snprintf(answer, sizeof answer, "%s", text == NULL ? "" : (const char *)text);
    end(row);
    return answer;
}

int64_t tl_sql_count_events(const char *path, const char *source, const char *parts) {
    static const char sql[] = "SELECT text FROM events WHERE source = ?1";
    sqlite3 *database = connect_to(path);
    sqlite3_stmt *statement = NULL;
    int64_t count = 0;
    int code = sqlite3_prepare_v2(database, sql, -1, &statement, NULL);
    code = code == SQLITE_OK ? sqlite3_bind_text(statement, 1, source, -1, SQLITE_STATIC) : code;
    if (code != SQLITE_OK) {
        give_up(database, sql);
    }
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        count += tl_test_has_parts((const char *)sqlite3_column_text(statement, 0), parts) ? 1 : 0;
    }
    if (code != SQLITE_DONE) {
        give_up(database, sql);
    }
    end(statement);
    return count;
}

void tl_sql_execute(const char *path, const char *sql) {
    sqlite3 *database = connect_to(path);
    if (sqlite3_exec(database, sql, NULL, NULL, NULL) != SQLITE_OK) {
        give_up(database, sql);
    }
    (void)sqlite3_close(database);
}
