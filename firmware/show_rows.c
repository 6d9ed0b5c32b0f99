/* Walking along the key: each statement begins behind the last row of the one before. */
#include "firmware/show_rows.h"

#include <sqlite3.h>

#include "firmware/database.h"

enum { ROWS_AT_ONCE = 4096 };

#define ASK_RANGE(table, key)                                                                                          \
    "SELECT (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " LIMIT 1),"                \
    " (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " DESC LIMIT 1)"

#define ASK_ROWS(table, key, columns)                                                                                  \
    "SELECT " key ", signal, " columns " FROM " table " WHERE run = ?1 AND (" key ", signal) > (?2, ?3) AND " key      \
    " <= ?4 ORDER BY " key ", signal LIMIT ?5"

static const struct {
    const char *range;
    const char *rows;
} questions[] = {
    [TL_SHOW_FROM_SAMPLES] = {ASK_RANGE("samples", "tick"), ASK_ROWS("samples", "tick", "value, quality, stamp_ns")},
    [TL_SHOW_FROM_STEPS] = {ASK_RANGE("steps", "step"),
                            "SELECT step, 0, outcome, stop, J, J_nominal, evaluations, executions, used_ns, predicted,"
                            " flags, held FROM steps"
                            " WHERE run = ?1 AND step > ?2 AND ?3 = ?3 AND step <= ?4 ORDER BY step LIMIT ?5"},
    [TL_SHOW_FROM_OUTPUTS] = {ASK_RANGE("outputs", "step"), ASK_ROWS("outputs", "step", "y, y_hat, quality")},
    [TL_SHOW_FROM_ADJUSTMENTS] = {ASK_RANGE("adjustments", "step"), ASK_ROWS("adjustments", "step", "u, u_hat")},
};

static tl_status fail_damaged(tl_history *history, const tl_history_run *run, tl_error *error) {
    return tl_fail(error, TL_BAD_DATA, "%s: is damaged: run %lld has rows that the recorder does not write",
                   sqlite3_db_filename(tl_history_database(history), "main"), (long long)run->run);
}

tl_status tl_show_range(tl_history *history, const tl_history_run *run, tl_show_source source, int64_t from,
                        int64_t range[2], bool *any, tl_error *error) {
    sqlite3 *database = tl_history_database(history);
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(database, questions[source].range, &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        (void)sqlite3_bind_int64(statement, 2, from);
        int code = sqlite3_step(statement);
        *any = code == SQLITE_ROW && sqlite3_column_type(statement, 0) != SQLITE_NULL;
        range[0] = sqlite3_column_int64(statement, 0);
        range[1] = sqlite3_column_int64(statement, 1);
        status = code == SQLITE_ROW ? TL_OK : tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    if (status == TL_OK && *any && (range[0] < 0 || range[1] > INT64_MAX / 4)) {
        status = fail_damaged(history, run, error);
    }
    return status;
}

/* What one statement has handed out. */
typedef struct walk {
    int64_t step; /* of the last row */
    int64_t signal;
    int rows;
} walk;

static tl_status walk_on(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement, size_t signals,
                         walk *walked, tl_show_taker taker, tl_error *error) {
    int code = SQLITE_ROW;
    (void)sqlite3_bind_int64(statement, 2, walked->step);
    (void)sqlite3_bind_int64(statement, 3, walked->signal);
    walked->rows = 0;
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        walked->step = sqlite3_column_int64(statement, 0);
        walked->signal = sqlite3_column_int64(statement, 1);
        walked->rows++;
        if (walked->signal < 0 || (size_t)walked->signal >= signals) {
            (void)sqlite3_reset(statement);
            return fail_damaged(history, run, error);
        }
        taker.take(taker.context, statement);
    }
    (void)sqlite3_reset(statement);
    return code == SQLITE_DONE ? TL_OK : tl_database_fail(tl_history_database(history), code, error);
}

tl_status tl_show_rows(tl_history *history, const tl_history_run *run, tl_show_source source, const int64_t range[2],
                       size_t signals, tl_show_taker taker, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    walk walked = {.step = range[0] - 1, .signal = INT64_MAX, .rows = ROWS_AT_ONCE};
    tl_status status = tl_database_prepare(tl_history_database(history), questions[source].rows, &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        (void)sqlite3_bind_int64(statement, 4, range[1]);
        (void)sqlite3_bind_int(statement, 5, ROWS_AT_ONCE);
    }
    while (status == TL_OK && walked.rows == ROWS_AT_ONCE) {
        status = walk_on(history, run, statement, signals, &walked, taker, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_status tl_show_event_rows(tl_history *history, const tl_history_run *run, const char *from_at, int64_t most,
                             tl_show_taker taker, tl_error *error) {
    static const char sql[] = "SELECT at, tick, coalesce(name, severity), source, text FROM"
                              " (SELECT * FROM events WHERE run = ?1 AND at >= ?2 ORDER BY event DESC LIMIT ?3)"
                              " LEFT JOIN severities ON code = severity ORDER BY event";
    sqlite3 *database = tl_history_database(history);
    sqlite3_stmt *statement = NULL;
    int code = SQLITE_ROW;
    tl_status status = tl_database_prepare(database, sql, &statement, error);
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_int64(statement, 1, run->run);
    (void)sqlite3_bind_text(statement, 2, from_at, -1, SQLITE_STATIC);
    (void)sqlite3_bind_int64(statement, 3, most);
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        taker.take(taker.context, statement);
    }
    if (code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}
