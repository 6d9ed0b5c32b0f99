/* SQLite on a short lead: see database_guard.h. */
#include "firmware/store/database_guard.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "firmware/store/database_schema.h"
#include "firmware/store/database_sql.h"

/* A statement of ours takes some thousand turns of SQLite's machine, and one over a long run some million. */
enum { TURNS_AT_ONCE = 1000 * 1000, MOST_TIMES = 50 };

static __thread int times; /* that the turns of the statement under way were counted */

/* ---- What a statement may take ----------------------------------------------------------------------------------- */

static int begin_statement(unsigned event, void *context, void *statement, void *text) {
    (void)event;
    (void)context;
    (void)statement;
    (void)text;
    times = 0;
    return 0;
}

static int count_turns(void *context) {
    (void)context;
    return ++times > MOST_TIMES;
}

void tl_database_guard(sqlite3 *database) {
    static const int off[] = {SQLITE_DBCONFIG_TRUSTED_SCHEMA, SQLITE_DBCONFIG_ENABLE_TRIGGER,
                              SQLITE_DBCONFIG_ENABLE_VIEW, SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION};
    static const struct {
        int what;
        int most;
    } limits[] = {
        {SQLITE_LIMIT_LENGTH, TL_DATABASE_LONGEST},
        {SQLITE_LIMIT_SQL_LENGTH, 64 * 1024},
        {SQLITE_LIMIT_COLUMN, 64},
        {SQLITE_LIMIT_EXPR_DEPTH, 64},
        {SQLITE_LIMIT_COMPOUND_SELECT, 4},
        {SQLITE_LIMIT_FUNCTION_ARG, 16},
        {SQLITE_LIMIT_ATTACHED, 0},
        {SQLITE_LIMIT_TRIGGER_DEPTH, 1},
        {SQLITE_LIMIT_VARIABLE_NUMBER, 64},
    };
    (void)sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    for (size_t i = 0; i < sizeof off / sizeof off[0]; i++) {
        (void)sqlite3_db_config(database, off[i], 0, NULL);
    }
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        (void)sqlite3_limit(database, limits[i].what, limits[i].most);
    }
    (void)sqlite3_trace_v2(database, SQLITE_TRACE_STMT, begin_statement, NULL);
    sqlite3_progress_handler(database, TURNS_AT_ONCE, count_turns, NULL);
}

/* ---- Damage ------------------------------------------------------------------------------------------------------ */

static bool is_small(sqlite3 *database) {
    sqlite3_file *file = NULL;
    sqlite3_int64 size = 0;
    return sqlite3_file_control(database, "main", SQLITE_FCNTL_FILE_POINTER, &file) == SQLITE_OK && file != NULL &&
           file->pMethods != NULL && file->pMethods->xFileSize(file, &size) == SQLITE_OK &&
           size <= TL_DATABASE_DIAGNOSED;
}

void tl_database_diagnose(sqlite3 *database, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    if (!is_small(database) ||
        sqlite3_prepare_v2(database, "PRAGMA quick_check(1)", -1, &statement, NULL) != SQLITE_OK) {
        return;
    }
    const char *found = sqlite3_step(statement) == SQLITE_ROW ? (const char *)sqlite3_column_text(statement, 0) : NULL;
    if (found != NULL && strcmp(found, "ok") != 0) {
        size_t length = strlen(error->text);
        (void)snprintf(error->text + length, sizeof error->text - length, " (SQLite finds: %.*s)",
                       (int)strcspn(found, "\n"), found);
    }
    (void)sqlite3_finalize(statement);
}

/* ---- The schema -------------------------------------------------------------------------------------------------- */

/* What the file would have SQLite run for it. */
static tl_status check_code(sqlite3 *database, tl_error *error) {
    static const char sql[] = "SELECT type, name FROM sqlite_schema"
                              " WHERE type = 'trigger' OR (type = 'table' AND rootpage IS NOT NULL AND rootpage < 1)";
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(database, sql, &statement, error);
    int code = status == TL_OK ? sqlite3_step(statement) : SQLITE_DONE;
    if (code == SQLITE_ROW) {
        status = tl_database_damaged(
            database, error, "it has the %s \"%.60s\", and twinlock makes none",
            strcmp((const char *)sqlite3_column_text(statement, 0), "trigger") == 0 ? "trigger" : "virtual table",
            (const char *)sqlite3_column_text(statement, 1));
    } else if (code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* Rows come in the order of the key without being sorted, so it must be the one we know. */
static tl_status check_key(sqlite3 *database, sqlite3_stmt *statement, const tl_database_key *key, tl_error *error) {
    char found[64] = "";
    int code = SQLITE_ROW;
    (void)sqlite3_bind_text(statement, 1, key->table, -1, SQLITE_STATIC);
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        size_t length = strlen(found);
        (void)snprintf(found + length, sizeof found - length, "%s%s", length == 0 ? "" : ", ",
                       (const char *)sqlite3_column_text(statement, 0));
    }
    (void)sqlite3_reset(statement);
    if (code != SQLITE_DONE) {
        return tl_database_fail(database, code, error);
    }
    return strcmp(found, key->columns) == 0
               ? TL_OK
               : tl_database_damaged(database, error, "its table %s has not the key that twinlock gives it",
                                     key->table);
}

/* Is it there at all? Not what is only called so, such as a view. */
static tl_status find_table(sqlite3 *database, const char *name, bool *found, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status =
        tl_database_prepare(database, "SELECT type = 'table' FROM sqlite_schema WHERE name = ?1", &statement, error);
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_text(statement, 1, name, -1, SQLITE_STATIC);
    int code = sqlite3_step(statement);
    *found = code == SQLITE_ROW;
    if (code == SQLITE_ROW && sqlite3_column_int(statement, 0) != 1) {
        status = tl_database_damaged(database, error, "%s is no table", name);
    } else if (code != SQLITE_ROW && code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_status tl_database_check_schema(sqlite3 *database, tl_error *error) {
    static const char sql[] = "SELECT name FROM pragma_table_xinfo(?1) WHERE pk > 0 ORDER BY pk";
    sqlite3_stmt *statement = NULL;
    tl_status status = check_code(database, error);
    if (status == TL_OK) {
        status = tl_database_prepare(database, sql, &statement, error);
    }
    for (const tl_database_key *key = tl_database_keys; status == TL_OK && key->table != NULL; key++) {
        bool there = false;
        status = find_table(database, key->table, &there, error);
        if (status == TL_OK && there) {
            status = check_key(database, statement, key, error);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}
