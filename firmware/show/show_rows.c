/* Walking along the key: each statement begins behind the last row of the one before. */
#include "firmware/show/show_rows.h"

#include <inttypes.h>
#include <sqlite3.h>

#include "firmware/database/database_row.h"
#include "firmware/database/database_sql.h"
#include "firmware/text/utc.h"

enum { ROWS_AT_ONCE = 4096 };

#define ASK_RANGE(table, key)                                                                                          \
    "SELECT (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " LIMIT 1),"                \
    " (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " DESC LIMIT 1)"

#define ASK_ROWS(table, key, columns)                                                                                  \
    "SELECT " key ", signal, " columns " FROM " table " WHERE run = ?1 AND (" key ", signal) > (?2, ?3) AND " key      \
    " <= ?4 ORDER BY " key ", signal LIMIT ?5"

/* What is in the columns after the key, each perhaps NULL: a value "v", a code or a count "c", bits "b", a time "t". */
static const struct {
    const char *range;
    const char *rows;
    const char *columns;
} questions[] = {
    [TL_SHOW_FROM_SAMPLES] = {ASK_RANGE("samples", "tick"), ASK_ROWS("samples", "tick", "value, quality, stamp_ns"),
                              "vct"},
    [TL_SHOW_FROM_STEPS] = {ASK_RANGE("steps", "step"),
                            "SELECT step, 0, outcome, stop, J, J_nominal, evaluations, executions, used_ns, predicted,"
                            " flags, held FROM steps"
                            " WHERE run = ?1 AND step > ?2 AND ?3 = ?3 AND step <= ?4 ORDER BY step LIMIT ?5",
                            "ccvvccccbb"},
    [TL_SHOW_FROM_OUTPUTS] = {ASK_RANGE("outputs", "step"), ASK_ROWS("outputs", "step", "y, y_hat, quality"), "vvc"},
    [TL_SHOW_FROM_ADJUSTMENTS] = {ASK_RANGE("adjustments", "step"), ASK_ROWS("adjustments", "step", "u, u_hat"), "vv"},
};

static tl_status fail_damaged(tl_history *history, const tl_history_run *run, tl_error *error) {
    return tl_database_damaged(tl_history_database(history), error,
                               "run %" PRId64 " has rows that the recorder does not write", run->run);
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
        *any = code == SQLITE_ROW && !tl_row_is_null(statement, 0);
        bool right = !*any || (tl_row_integer(statement, 0, 0, tl_history_last_possible(run), &range[0]) &&
                               tl_row_integer(statement, 1, range[0], tl_history_last_possible(run), &range[1]));
        status = code != SQLITE_ROW ? tl_database_fail(database, code, error)
                 : right            ? TL_OK
                                    : fail_damaged(history, run, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* What one statement has handed out. */
typedef struct row_walk {
    int64_t step; /* of the last row */
    int64_t signal;
    int rows;
} row_walk;

/* The key of the next row, behind that of the one before. */
static bool take_key(sqlite3_stmt *row, int64_t last, size_t signals, row_walk *walked) {
    int64_t step = 0;
    int64_t signal = 0;
    if (!tl_row_integer(row, 0, walked->step, last, &step) ||
        !tl_row_integer(row, 1, 0, (int64_t)signals - 1, &signal) ||
        (step == walked->step && signal <= walked->signal)) {
        return false;
    }
    walked->step = step;
    walked->signal = signal;
    return true;
}

static bool are_right(sqlite3_stmt *row, const char *columns) {
    bool right = true;
    for (int i = 0; columns[i] != '\0' && right; i++) {
        double value = 0.0;
        int64_t number = 0;
        switch (columns[i]) {
        case 'v':
            right = tl_row_number(row, i + 2, &value);
            break;
        case 'c':
            right = tl_row_integer_or_null(row, i + 2, 0, TL_ROW_LARGEST, &number);
            break;
        case 'b':
            right = tl_row_integer_or_null(row, i + 2, 0, UINT32_MAX, &number);
            break;
        default:
            right = tl_row_integer_or_null(row, i + 2, -TL_ROW_LARGEST, TL_ROW_LARGEST, &number);
            break;
        }
    }
    return right;
}

/* Of one table: what its columns hold, its last tick or step, how many signals. */
typedef struct table_shape {
    const char *columns;
    int64_t last;
    size_t signals;
} table_shape;

static tl_status walk_on(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement,
                         const table_shape *shape, row_walk *walked, tl_show_taker taker, tl_error *error) {
    int code = SQLITE_ROW;
    (void)sqlite3_bind_int64(statement, 2, walked->step);
    (void)sqlite3_bind_int64(statement, 3, walked->signal);
    walked->rows = 0;
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        walked->rows++;
        if (!take_key(statement, shape->last, shape->signals, walked) || !are_right(statement, shape->columns)) {
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
    row_walk walked = {.step = range[0] - 1, .signal = INT64_MAX, .rows = ROWS_AT_ONCE};
    const table_shape shape = {questions[source].columns, range[1], signals};
    tl_status status = tl_database_prepare(tl_history_database(history), questions[source].rows, &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        (void)sqlite3_bind_int64(statement, 4, range[1]);
        (void)sqlite3_bind_int(statement, 5, ROWS_AT_ONCE);
    }
    while (status == TL_OK && walked.rows == ROWS_AT_ONCE) {
        status = walk_on(history, run, statement, &shape, &walked, taker, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

static bool read_event(sqlite3_stmt *row, int64_t *last, tl_show_event *event) {
    int64_t time = 0;
    *event = (tl_show_event){.has_tick = !tl_row_is_null(row, 2)};
    return tl_row_integer(row, 0, *last + 1, INT64_MAX - 1, last) && tl_row_text(row, 1, TL_UTC_TEXT, &event->at) &&
           tl_utc_parse(event->at, &time) && tl_row_integer_or_null(row, 2, 0, TL_ROW_LARGEST, &event->tick) &&
           tl_row_text(row, 3, TL_ROW_NAME, &event->severity) && tl_row_text(row, 4, TL_ROW_NAME, &event->source) &&
           tl_row_text(row, 5, TL_ROW_NAME, &event->text);
}

/* The id of the first of the last `most` events; without one, what no event has. */
static tl_status find_first_event(sqlite3 *database, const tl_history_run *run, const char *from_at, int64_t most,
                                  int64_t *first, tl_error *error) {
    static const char sql[] = "SELECT min(event) FROM"
                              " (SELECT event FROM events WHERE run = ?1 AND at >= ?2 ORDER BY event DESC LIMIT ?3)";
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(database, sql, &statement, error);
    *first = INT64_MAX;
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_int64(statement, 1, run->run);
    (void)sqlite3_bind_text(statement, 2, from_at, -1, SQLITE_STATIC);
    (void)sqlite3_bind_int64(statement, 3, most);
    int code = sqlite3_step(statement);
    if (code != SQLITE_ROW) {
        status = tl_database_fail(database, code, error);
    } else if (!tl_row_is_null(statement, 0)) {
        *first = sqlite3_column_int64(statement, 0);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* Read in their order without being sorted, which would take all of them into memory. */
tl_status tl_show_event_rows(tl_history *history, const tl_history_run *run, const char *from_at, int64_t most,
                             tl_show_event_taker taker, tl_error *error) {
    static const char sql[] = "SELECT event, at, tick, coalesce(name, CAST(severity AS TEXT)), source, text FROM events"
                              " LEFT JOIN severities ON code = severity"
                              " WHERE run = ?1 AND at >= ?2 AND event >= ?3 ORDER BY event";
    sqlite3 *database = tl_history_database(history);
    sqlite3_stmt *statement = NULL;
    tl_show_event event;
    int64_t first = 0;
    int code = SQLITE_ROW;
    tl_status status = find_first_event(database, run, from_at, most, &first, error);
    if (status == TL_OK) {
        status = tl_database_prepare(database, sql, &statement, error);
    }
    if (status != TL_OK) {
        return status;
    }
    int64_t last = first < 1 ? 0 : first - 1;
    (void)sqlite3_bind_int64(statement, 1, run->run);
    (void)sqlite3_bind_text(statement, 2, from_at, -1, SQLITE_STATIC);
    (void)sqlite3_bind_int64(statement, 3, first);
    while (status == TL_OK && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        if (read_event(statement, &last, &event)) {
            taker.take(taker.context, &event);
        } else {
            status = tl_database_damaged(database, error,
                                         "an event of run %" PRId64 " is none that the recorder writes", run->run);
        }
    }
    if (status == TL_OK && code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}
