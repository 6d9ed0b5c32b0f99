/* Walking along the key: each statement begins behind the last row of the one before. */
#include "firmware/store/history_rows.h"

#include <inttypes.h>
#include <sqlite3.h>

#include "firmware/base/utc.h"
#include "firmware/store/database_row.h"
#include "firmware/store/database_sql.h"
#include "firmware/store/history_parts.h"

enum { ROWS_AT_ONCE = 4096 };

/* ---- One row ----------------------------------------------------------------------------------------------------- */

/* Hands out a row whose key was read. False: it is none that the recorder writes. */
typedef bool give_row(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor);

static int64_t take_count(tl_row *row) {
    return tl_row_integer(row, 0, TL_ROW_LARGEST);
}

static uint32_t take_bits(tl_row *row) {
    return (uint32_t)tl_row_integer(row, 0, UINT32_MAX);
}

static bool give_sample(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor) {
    tl_history_sample sample = {.tick = key->number, .signal = (size_t)key->signal};
    sample.value = tl_row_number(row);
    sample.quality = take_count(row);
    sample.stamp = tl_row_integer_or(row, -TL_ROW_LARGEST, TL_ROW_LARGEST, TL_TIME_NEVER);
    if (row->right) {
        visitor->sample(visitor->context, &sample);
    }
    return row->right;
}

static bool give_step(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor) {
    tl_history_step step = {.step = key->number};
    step.outcome = take_count(row);
    step.stop = take_count(row);
    step.objective = tl_row_number(row);
    step.objective_nominal = tl_row_number(row);
    step.evaluations = take_count(row);
    step.executions = take_count(row);
    step.used = take_count(row);
    step.predicted = take_count(row);
    step.flags = take_bits(row);
    step.held = take_bits(row);
    if (row->right) {
        visitor->step(visitor->context, &step);
    }
    return row->right;
}

static bool give_output(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor) {
    tl_history_output output = {.step = key->number, .signal = (size_t)key->signal};
    output.y = tl_row_number(row);
    output.y_hat = tl_row_number(row);
    output.quality = take_count(row);
    output.readings = take_count(row);
    output.squares = tl_row_number(row);
    output.rejected = take_count(row);
    if (row->right) {
        visitor->output(visitor->context, &output);
    }
    return row->right;
}

static bool give_adjustment(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor) {
    tl_history_adjustment adjustment = {.step = key->number, .signal = (size_t)key->signal};
    adjustment.u = tl_row_number(row);
    adjustment.u_hat = tl_row_number(row);
    if (row->right) {
        visitor->adjustment(visitor->context, &adjustment);
    }
    return row->right;
}

/* ---- Tables ------------------------------------------------------------------------------------------------------ */

#define ASK_RANGE(table, key)                                                                                          \
    "SELECT (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " LIMIT 1),"                \
    " (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " DESC LIMIT 1)"

#define ASK_ROWS(table, key, columns)                                                                                  \
    "SELECT " key ", signal, " columns " FROM " table " WHERE run = ?1 AND (" key ", signal) > (?2, ?3) AND " key      \
    " <= ?4 ORDER BY " key ", signal LIMIT ?5"

/* How to ask for the ends of a table and for its rows, and who understands these. */
static const struct {
    const char *range;
    const char *rows;
    give_row *give;
} tables[] = {
    [TL_HISTORY_SAMPLES] = {ASK_RANGE("samples", "tick"), ASK_ROWS("samples", "tick", "value, quality, stamp_ns"),
                            give_sample},
    [TL_HISTORY_STEPS] = {ASK_RANGE("steps", "step"),
                          "SELECT step, 0, outcome, stop, J, J_nominal, evaluations, executions, used_ns, predicted,"
                          " flags, held FROM steps"
                          " WHERE run = ?1 AND step > ?2 AND ?3 = ?3 AND step <= ?4 ORDER BY step LIMIT ?5",
                          give_step},
    [TL_HISTORY_OUTPUTS] = {ASK_RANGE("outputs", "step"),
                            ASK_ROWS("outputs", "step", "y, y_hat, quality, readings, squares, rejected"), give_output},
    [TL_HISTORY_ADJUSTMENTS] = {ASK_RANGE("adjustments", "step"), ASK_ROWS("adjustments", "step", "u, u_hat"),
                                give_adjustment},
};

static tl_status fail_damaged(tl_history *history, const tl_history_run *run, tl_error *error) {
    return tl_database_damaged(tl_history_database(history), error,
                               "run %" PRId64 " has rows that the recorder does not write", run->run);
}

tl_status tl_history_range(tl_history *history, const tl_history_run *run, tl_history_table table, int64_t from,
                           int64_t range[2], bool *any, tl_error *error) {
    sqlite3 *database = tl_history_database(history);
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(database, tables[table].range, &statement, error);
    *any = false;
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        (void)sqlite3_bind_int64(statement, 2, from);
        int code = sqlite3_step(statement);
        tl_row row = tl_row_of(statement);
        status = code == SQLITE_ROW ? TL_OK : tl_database_fail(database, code, error);
        *any = code == SQLITE_ROW && !tl_row_is_null(&row);
        if (*any) {
            range[0] = tl_row_integer(&row, 0, tl_history_last_possible(run));
            range[1] = tl_row_integer(&row, range[0], tl_history_last_possible(run));
            status = row.right ? TL_OK : fail_damaged(history, run, error);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* Whose rows are handed out to whom. */
typedef struct row_walk {
    tl_history *history;
    const tl_history_run *run;
    const int64_t *range;
    const tl_history_visitor *visitor;
} row_walk;

/* The rows of one statement, which begins behind the key. */
static tl_status give_some(const row_walk *walk, sqlite3_stmt *statement, give_row *give, tl_history_key *key,
                           int *count, tl_error *error) {
    int code = SQLITE_ROW;
    *count = 0;
    (void)sqlite3_bind_int64(statement, 2, key->number);
    (void)sqlite3_bind_int64(statement, 3, key->signal);
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        tl_row row = tl_row_of(statement);
        (*count)++;
        tl_history_key_take(key, &row);
        if (!row.right || !give(&row, key, walk->visitor)) {
            (void)sqlite3_reset(statement);
            return fail_damaged(walk->history, walk->run, error);
        }
    }
    (void)sqlite3_reset(statement);
    return code == SQLITE_DONE ? TL_OK : tl_database_fail(tl_history_database(walk->history), code, error);
}

static tl_status give_table(const row_walk *walk, tl_history_table table, size_t signals, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_history_key key = {
        .number = walk->range[0] - 1, .last = walk->range[1], .signal = INT64_MAX, .signals = (int64_t)signals};
    int count = ROWS_AT_ONCE;
    tl_status status = tl_database_prepare(tl_history_database(walk->history), tables[table].rows, &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, walk->run->run);
        (void)sqlite3_bind_int64(statement, 4, key.last);
        (void)sqlite3_bind_int(statement, 5, ROWS_AT_ONCE);
    }
    while (status == TL_OK && count == ROWS_AT_ONCE) {
        status = give_some(walk, statement, tables[table].give, &key, &count, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_status tl_history_rows(tl_history *history, const tl_history_run *run, const int64_t range[2],
                          const tl_history_visitor *visitor, tl_error *error) {
    const row_walk walk = {history, run, range, visitor};
    tl_status status = TL_OK;
    if (visitor->sample != NULL) {
        status = give_table(&walk, TL_HISTORY_SAMPLES, visitor->signals[TL_HISTORY_PLANT], error);
    }
    if (status == TL_OK && visitor->step != NULL) {
        status = give_table(&walk, TL_HISTORY_STEPS, 1, error);
    }
    if (status == TL_OK && visitor->output != NULL) {
        status = give_table(&walk, TL_HISTORY_OUTPUTS, visitor->signals[TL_HISTORY_MATCH], error);
    }
    if (status == TL_OK && visitor->adjustment != NULL) {
        status = give_table(&walk, TL_HISTORY_ADJUSTMENTS, visitor->signals[TL_HISTORY_ADJUST], error);
    }
    return status;
}

/* ---- Events ------------------------------------------------------------------------------------------------------ */

/* Events come in the order of their ids. */
static bool give_event(sqlite3_stmt *statement, int64_t *last, const tl_history_visitor *visitor) {
    tl_row row = tl_row_of(statement);
    tl_history_event event = {0};
    int64_t time = 0;
    *last = tl_row_integer(&row, *last + 1, INT64_MAX - 1);
    event.at = tl_row_text(&row, TL_UTC_TEXT);
    event.has_tick = !tl_row_is_null(&row);
    event.tick = tl_row_integer_or(&row, 0, TL_ROW_LARGEST, 0);
    event.severity = tl_row_text(&row, TL_ROW_NAME);
    event.source = tl_row_text(&row, TL_ROW_NAME);
    event.text = tl_row_text(&row, TL_ROW_NAME);
    bool right = row.right && tl_utc_parse(event.at, &time);
    if (right) {
        visitor->event(visitor->context, &event);
    }
    return right;
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
    if (code == SQLITE_ROW) {
        tl_row row = tl_row_of(statement);
        *first = tl_row_integer_or(&row, INT64_MIN, INT64_MAX, INT64_MAX);
    } else {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* Read in their order without being sorted, which would take all of them into memory. */
tl_status tl_history_events(tl_history *history, const tl_history_run *run, const char *from_at, int64_t most,
                            const tl_history_visitor *visitor, tl_error *error) {
    static const char sql[] = "SELECT event, at, tick, coalesce(name, CAST(severity AS TEXT)), source, text FROM events"
                              " LEFT JOIN severities ON code = severity"
                              " WHERE run = ?1 AND at >= ?2 AND event >= ?3 ORDER BY event";
    sqlite3 *database = tl_history_database(history);
    sqlite3_stmt *statement = NULL;
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
        if (!give_event(statement, &last, visitor)) {
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
