/* Reads recorded runs from a database: see history.h. */
#include "firmware/store/history.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/store/database.h"
#include "master/base/arena.h"
#include "master/base/text.h"

/* Nothing in the database is trusted, not even the order of rows: SQLite returns them as they lie
 * in the pages, which may be damaged. Values that the recorder does not write are reported as
 * damage. */

static const double LONGEST_INSTANT = 1e11;           /* s */
static const tl_time LONGEST_STEP = 3600 * TL_SECOND; /* that a configuration allows */

enum { TABLES = TL_HISTORY_ADJUSTMENTS + 1 };

struct tl_history {
    sqlite3 *database;
    tl_arena arena;
    /* Prepared at their first use: */
    sqlite3_stmt *ranges[TABLES];
    sqlite3_stmt *rows[TABLES];
};

tl_status tl_history_open(const char *path, tl_history **history, tl_error *error) {
    tl_history *opened = calloc(1, sizeof *opened);
    *history = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    tl_arena_init(&opened->arena);
    tl_status status = tl_database_open(path, false, &opened->database, error);
    if (status != TL_OK) {
        tl_history_close(opened);
        return status;
    }
    *history = opened;
    return TL_OK;
}

void tl_history_close(tl_history *history) {
    if (history != NULL) {
        for (size_t i = 0; i < TABLES; i++) {
            (void)sqlite3_finalize(history->ranges[i]);
            (void)sqlite3_finalize(history->rows[i]);
        }
        (void)sqlite3_close(history->database);
        tl_arena_release(&history->arena);
        free(history);
    }
}

void tl_history_diagnose(tl_history *history, tl_error *error) {
    if (history != NULL) {
        tl_database_diagnose(history->database, error);
    }
}

static tl_status fail_memory(tl_error *error) {
    return tl_fail(error, TL_TRY_AGAIN, "out of memory while reading the database");
}

static const char *file_of(tl_history *history) {
    return sqlite3_db_filename(history->database, "main");
}

/* ---- Reading a row: column by column, each value only if it is such as the recorder writes.
 *
 * Purpose: SQLite converts any value to any type; a text instead of a number would be read as 0.
 *          These functions do not convert.
 * Use:     columns are read from the left, in the order of the SELECT; check `right` after the last
 *          one.
 * Errors:  a column of another type or out of range sets `right` to false and returns a harmless
 *          value.
 * Owner:   texts and bytes are valid until the statement's next step.
 */

enum {
    NAME_MOST = 4096,       /* most bytes of a name, a reason or an event */
    TEXT_MOST = 1024 * 1024 /* most bytes of a configuration */
};

typedef struct table_row {
    sqlite3_stmt *statement;
    int column; /* the next one */
    bool right; /* all columns read so far were valid */
} table_row;

static table_row row_of(sqlite3_stmt *statement) {
    return (table_row){.statement = statement, .right = true};
}

static bool is_null(const table_row *row) {
    return sqlite3_column_type(row->statement, row->column) == SQLITE_NULL;
}

/* Reads the next column; returns `least` if it is invalid. */
static int64_t take_integer(table_row *row, int64_t least, int64_t most) {
    int column = row->column++;
    int64_t found = sqlite3_column_int64(row->statement, column);
    if (sqlite3_column_type(row->statement, column) == SQLITE_INTEGER && found >= least && found <= most) {
        return found;
    }
    row->right = false;
    return least;
}

/* Returns `otherwise` if it is NULL. */
static int64_t take_integer_or(table_row *row, int64_t least, int64_t most, int64_t otherwise) {
    if (is_null(row)) {
        row->column++;
        return otherwise;
    }
    return take_integer(row, least, most);
}

/* Returns a finite number, or NaN for NULL, because the recorder writes NULL for values that are
 * not finite. */
static double take_number(table_row *row) {
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

/* Returns a UTF-8 text of at most `most` bytes without NUL; "" if it is invalid. */
static const char *read_text(table_row *row, size_t most) {
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

/* Returns NULL if there are none. */
static const unsigned char *read_bytes(table_row *row, size_t *size) {
    int column = row->column++;
    row->right = row->right && sqlite3_column_type(row->statement, column) == SQLITE_BLOB;
    const unsigned char *bytes = row->right ? sqlite3_column_blob(row->statement, column) : NULL;
    *size = bytes == NULL ? 0 : (size_t)sqlite3_column_bytes(row->statement, column);
    return bytes;
}

/* ---- Runs, signals, configurations ---- */

int64_t tl_history_last_possible(const tl_history_run *run) {
    return TL_ROW_NUMBER_MAX / run->step;
}

/* Returns a copy of the next column's text that outlives the row. If memory is out: "", and the row
 * is invalid. */
static const char *take_text(tl_history *history, table_row *row, size_t most) {
    const char *copy = tl_arena_text(&history->arena, read_text(row, most));
    row->right = row->right && copy != NULL;
    return copy != NULL ? copy : "";
}

static const char *take_text_or_null(tl_history *history, table_row *row, size_t most) {
    if (is_null(row)) {
        row->column++;
        return NULL;
    }
    return take_text(history, row, most);
}

static const char *take_utc_or_null(tl_history *history, table_row *row) {
    const char *utc = take_text_or_null(history, row, TL_UTC_TEXT);
    int64_t time = 0;
    row->right = row->right && (utc == NULL || tl_utc_parse(utc, &time));
    return utc;
}

static uint64_t take_count(table_row *row) {
    return (uint64_t)take_integer(row, 0, TL_ROW_NUMBER_MAX);
}

/* ---- Lists: all rows of a query about a run. ---- */

typedef struct row_list {
    const char *sql;  /* ?1 is the run */
    const char *what; /* for messages; NULL: runs */
    size_t most;      /* more are damage */
    size_t size;      /* of an item */
    /* Reads items[index] from the row. A value that the recorder does not write makes the row
     * invalid. */
    void (*read)(tl_history *history, const tl_history_run *run, table_row *row, size_t index, void *items);
} row_list;

static tl_status fail_list(tl_history *history, const row_list *list, int64_t run, tl_error *error) {
    return list->what == NULL
               ? tl_database_invalid(history->database, error, "the row of run %" PRId64 " is incomplete or invalid",
                                     run)
               : tl_database_invalid(history->database, error, "the %s of run %" PRId64 " are incomplete or invalid",
                                     list->what, run);
}

/* Ensures room for the next item; doubles the array if necessary. */
static bool make_room(tl_history *history, const row_list *list, size_t count, size_t *room, void **items) {
    if (count == *room) {
        *room = *room == 0 ? 16 : 2 * *room;
        void *longer = tl_arena_take(&history->arena, *room, list->size);
        if (longer != NULL && count > 0) {
            memcpy(longer, *items, count * list->size);
        }
        *items = longer;
    }
    return *items != NULL;
}

/* `run` is NULL for a list of runs; `id` is the run to find. */
static tl_status read_list(tl_history *history, const row_list *list, const tl_history_run *run, int64_t id,
                           void **items, size_t *count, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    size_t room = 0;
    int code = SQLITE_ROW;
    *items = NULL;
    *count = 0;
    tl_status status = tl_database_prepare(history->database, list->sql, &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, id);
    }
    while (status == TL_OK && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        table_row row = row_of(statement);
        if (!make_room(history, list, *count, &room, items)) {
            status = fail_memory(error);
        } else if (*count < list->most) {
            list->read(history, run, &row, (*count)++, *items);
        } else {
            row.right = false;
        }
        if (!row.right) {
            status = fail_list(history, list, run != NULL ? id : sqlite3_column_int64(statement, 0), error);
        }
    }
    if (status == TL_OK && code != SQLITE_DONE) {
        status = tl_database_fail(history->database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* ---- Runs ---- */

#define RUN_COLUMNS                                                                                                    \
    "SELECT run, verb, name, version, configuration, started, ended, ended_reason, committed,"                         \
    " step_ns, prediction, measurements, lead, samples_written, steps_written, events_written, entries_lost,"          \
    " removed_before, fmus, boot, start_ns, resumed_run, resumed_tick, resumed_from,"                                  \
    " start_s, stop_s"                                                                                                 \
    " FROM runs LEFT JOIN beginnings USING (run) "

/* A run has either both an end and a reason or neither. */
static void read_run(tl_history *history, const tl_history_run *none, table_row *row, size_t index, void *items) {
    tl_history_run *run = (tl_history_run *)items + index;
    (void)none;
    run->run = take_integer(row, index == 0 ? 1 : run[-1].run + 1, TL_ROW_NUMBER_MAX);
    run->verb = take_text(history, row, NAME_MOST);
    run->name = take_text(history, row, NAME_MOST);
    run->version = take_text(history, row, NAME_MOST);
    run->configuration_hash = take_text(history, row, TL_SHA256_TEXT);
    run->started = take_utc_or_null(history, row);
    run->ended = take_utc_or_null(history, row);
    run->ended_reason = take_text_or_null(history, row, NAME_MOST);
    run->committed = take_utc_or_null(history, row);
    run->committed = run->committed == NULL ? run->started : run->committed;
    run->step = take_integer(row, 1, LONGEST_STEP);
    run->prediction = (uint32_t)take_integer(row, 0, INT32_MAX);
    const char *measurements = read_text(row, NAME_MOST);
    run->measurements = tl_pairing_named(measurements);
    run->lead = (uint32_t)take_integer(row, 0, INT32_MAX);
    run->samples = take_count(row);
    run->steps = take_count(row);
    run->events = take_count(row);
    run->lost = take_count(row);
    run->removed_before = take_integer_or(row, 0, TL_ROW_NUMBER_MAX, 0);
    run->fmus = take_text(history, row, NAME_MOST);
    run->boot = take_text(history, row, NAME_MOST);
    run->has_start = !is_null(row);
    run->start = take_integer_or(row, -TL_ROW_NUMBER_MAX, TL_ROW_NUMBER_MAX, 0);
    run->resumption.run = take_integer_or(row, 0, TL_ROW_NUMBER_MAX, 0);
    run->resumption.tick = take_integer_or(row, 0, tl_history_last_possible(run), 0);
    const char *from = take_text_or_null(history, row, NAME_MOST);
    run->resumption.from = tl_resumed_from_named(from);
    run->experiment.start_s = take_number(row);
    run->experiment.stop_s = take_number(row);
    if (isnan(run->experiment.start_s)) {
        run->experiment = (tl_experiment){0.0, 0.0};
    }
    run->resumption.start_s = run->experiment.start_s;
    row->right = row->right && run->started != NULL && (run->ended == NULL) == (run->ended_reason == NULL) &&
                 strcmp(measurements, tl_pairing_names[run->measurements]) == 0 &&
                 (from == NULL || strcmp(from, tl_resumed_from_name(run->resumption.from)) == 0);
}

static tl_status read_runs(tl_history *history, const char *sql, int64_t id, const tl_history_run **runs, size_t *count,
                           tl_error *error) {
    const row_list list = {sql, NULL, SIZE_MAX - 1, sizeof(tl_history_run), read_run};
    void *items = NULL;
    tl_status status = read_list(history, &list, NULL, id, &items, count, error);
    *runs = items;
    return status;
}

tl_status tl_history_runs(tl_history *history, const tl_history_run **runs, size_t *count, tl_error *error) {
    return read_runs(history, RUN_COLUMNS "ORDER BY run", 0, runs, count, error);
}

tl_status tl_history_find(tl_history *history, int64_t id, const tl_history_run **run, tl_error *error) {
    const char *sql = id == 0 ? RUN_COLUMNS "ORDER BY run DESC LIMIT 1" : RUN_COLUMNS "WHERE run = ?1";
    size_t count = 0;
    tl_status status = read_runs(history, sql, id, run, &count, error);
    if (status == TL_OK && count == 0) {
        return id == 0 ? tl_fail(error, TL_BAD_DATA, "%s: contains no run", file_of(history))
                       : tl_fail(error, TL_BAD_DATA, "%s: contains no run %lld: `twinlock show` lists the runs",
                                 file_of(history), (long long)id);
    }
    return status;
}

/* Executes a query for one row about a run. *statement is NULL if there is none; else it is at that
 * row, and the caller finalises it. */
static tl_status query_row(tl_history *history, const char *sql, int64_t run, int64_t number, const char *text,
                           sqlite3_stmt **statement, tl_error *error) {
    tl_status status = tl_database_prepare(history->database, sql, statement, error);
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_int64(*statement, 1, run);
    (void)sqlite3_bind_int64(*statement, 2, number);
    (void)sqlite3_bind_text(*statement, 3, text, -1, SQLITE_STATIC);
    int code = sqlite3_step(*statement);
    if (code != SQLITE_ROW) {
        status = code == SQLITE_DONE ? TL_OK : tl_database_fail(history->database, code, error);
        (void)sqlite3_finalize(*statement);
        *statement = NULL;
    }
    return status;
}

tl_status tl_history_configuration_text(tl_history *history, const char *hash, const char **text, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    *text = NULL;
    tl_status status =
        query_row(history, "SELECT text FROM configurations WHERE hash = ?3", 0, 0, hash, &statement, error);
    if (status == TL_OK) {
        table_row row = row_of(statement);
        *text = statement != NULL ? take_text(history, &row, TEXT_MOST) : NULL;
        if (*text == NULL || !row.right) {
            status =
                tl_database_invalid(history->database, error, "the configuration %.12s\342\200\246 is missing", hash);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* ---- Tunings, signals, components ---- */

/* Ticks must ascend. */
static void read_tuning(tl_history *history, const tl_history_run *run, table_row *row, size_t index, void *items) {
    tl_history_tuning *tuning = (tl_history_tuning *)items + index;
    int64_t at = 0;
    tuning->tick = take_integer(row, index == 0 ? 0 : tuning[-1].tick + 1, tl_history_last_possible(run));
    tuning->hash = take_text(history, row, TL_SHA256_TEXT);
    tuning->at = take_text(history, row, TL_UTC_TEXT);
    tuning->who = take_text(history, row, NAME_MOST);
    tuning->origin = take_text(history, row, NAME_MOST);
    tuning->why = take_text(history, row, NAME_MOST);
    row->right = row->right && tl_utc_parse(tuning->at, &at) && strlen(tuning->hash) == TL_SHA256_TEXT - 1 &&
                 tl_identity_is_sound(tuning->hash);
}

tl_status tl_history_tunings(tl_history *history, const tl_history_run *run, const tl_history_tuning **tunings,
                             size_t *count, tl_error *error) {
    static const row_list list = {
        "SELECT tick, configuration, at, who, origin, why FROM tunings WHERE run = ?1 ORDER BY tick", "tunings",
        TL_HISTORY_TUNINGS, sizeof(tl_history_tuning), read_tuning};
    void *items = NULL;
    tl_status status = read_list(history, &list, run, run->run, &items, count, error);
    *tunings = items;
    return status;
}

static tl_type take_type(table_row *row) {
    const char *name = read_text(row, NAME_MOST);
    int code = TL_REAL;
    while (code < TL_ENUMERATION && strcmp(name, tl_type_name((tl_type)code)) != 0) {
        code++;
    }
    row->right = row->right && strcmp(name, tl_type_name((tl_type)code)) == 0;
    return (tl_type)code;
}

/* Indices must be 0, 1, 2, …; a missing index is damage. */
static void read_signal(tl_history *history, const tl_history_run *run, table_row *row, size_t index, void *items) {
    tl_recorder_signal *signal = (tl_recorder_signal *)items + index;
    (void)run;
    (void)take_integer(row, (int64_t)index, (int64_t)index);
    signal->name = take_text(history, row, NAME_MOST);
    signal->unit = take_text(history, row, NAME_MOST);
    signal->type = take_type(row);
    signal->to = take_text_or_null(history, row, NAME_MOST);
}

#define SIGNALS_SQL(kind)                                                                                              \
    "SELECT signal, name, unit, type, compared_with FROM signals WHERE run = ?1 AND kind = '" kind "' ORDER BY signal"

tl_status tl_history_signals(tl_history *history, const tl_history_run *run, tl_history_kind kind,
                             const tl_recorder_signal **signals, size_t *count, tl_error *error) {
    static const row_list lists[] = {
        {SIGNALS_SQL("plant"), "signals", TL_MAX_SIGNALS, sizeof(tl_recorder_signal), read_signal},
        {SIGNALS_SQL("match"), "signals", TL_MAX_MATCH, sizeof(tl_recorder_signal), read_signal},
        {SIGNALS_SQL("adjust"), "signals", TL_MAX_ADJUST, sizeof(tl_recorder_signal), read_signal},
    };
    void *items = NULL;
    tl_status status = read_list(history, &lists[kind], run, run->run, &items, count, error);
    *signals = items;
    return status;
}

static void read_component(tl_history *history, const tl_history_run *run, table_row *row, size_t index, void *items) {
    tl_run_component *component = (tl_run_component *)items + index;
    (void)run;
    (void)take_integer(row, (int64_t)index, (int64_t)index);
    component->name = take_text(history, row, NAME_MOST);
    component->counts.plain = take_count(row);
    component->counts.predicted = take_count(row);
    component->counts.executions = take_count(row);
    component->counts.repeated = take_count(row);
    component->counts.uncached = take_count(row);
}

tl_status tl_history_ledger(tl_history *history, const tl_history_run *run, const tl_run_component **components,
                            size_t *count, tl_error *error) {
    static const row_list list = {"SELECT component, name, plain, predicted, executions, repeated, uncached"
                                  " FROM components WHERE run = ?1 ORDER BY component",
                                  "components", TL_RECORDER_COMPONENTS, sizeof(tl_run_component), read_component};
    void *items = NULL;
    tl_status status = read_list(history, &list, run, run->run, &items, count, error);
    *components = items;
    return status;
}

/* ---- Findings ---- */

/* Numbers must ascend. Calendar times count from the same instant. */
static void read_finding(tl_history *history, const tl_history_run *run, table_row *row, size_t index, void *items) {
    tl_history_finding *finding = (tl_history_finding *)items + index;
    int64_t at = 0;
    (void)run;
    finding->row.number = take_integer(row, index == 0 ? 1 : finding[-1].row.number + 1, TL_ROW_NUMBER_MAX);
    finding->run = take_integer(row, 1, TL_ROW_NUMBER_MAX);
    finding->row.kind = take_text(history, row, NAME_MOST);
    finding->row.subject = take_text(history, row, NAME_MOST);
    finding->row.variable = take_text(history, row, NAME_MOST);
    finding->row.says = take_text(history, row, NAME_MOST);
    finding->row.unit = take_text(history, row, NAME_MOST);
    finding->row.onset = take_number(row);
    finding->row.onset_spread = take_number(row);
    finding->row.found = take_number(row);
    finding->row.gone = take_number(row);
    finding->row.size = take_number(row);
    finding->row.size_spread = take_number(row);
    finding->row.percent = take_number(row);
    finding->row.also = take_text(history, row, NAME_MOST);
    finding->row.cause = take_text(history, row, NAME_MOST);
    finding->row.state = take_text(history, row, NAME_MOST);
    const char *onset_at = take_utc_or_null(history, row);
    finding->acknowledged_at = take_utc_or_null(history, row);
    finding->acknowledged_by = take_text_or_null(history, row, NAME_MOST);
    finding->note = take_text_or_null(history, row, NAME_MOST);
    finding->explained_at = take_utc_or_null(history, row);
    finding->explanation = take_text_or_null(history, row, NAME_MOST);
    row->right = row->right && fabs(finding->row.onset) < LONGEST_INSTANT && fabs(finding->row.found) < LONGEST_INSTANT;
    if (row->right && onset_at != NULL && tl_utc_parse(onset_at, &at)) {
        finding->started = at - (int64_t)(finding->row.onset * 1e3);
    }
}

tl_status tl_history_findings(tl_history *history, const tl_history_run *run, const tl_history_finding **findings,
                              size_t *count, tl_error *error) {
    static const row_list list = {
        "SELECT finding, run, kind, subject, variable, says, unit, onset_s, onset_spread_s, found_s, gone_s, size, size_spread,"
        " percent, also, cause, state, onset_at, acknowledged_at, acknowledged_by, note, explained_at, explanation FROM findings WHERE run = ?1 OR (onset_at IS NOT NULL AND"
        " (SELECT verb FROM runs WHERE run = ?1) <> 'replay') ORDER BY finding",
        "findings", TL_HISTORY_FINDINGS, sizeof(tl_history_finding), read_finding};
    void *items = NULL;
    tl_status status = read_list(history, &list, run, run->run, &items, count, error);
    *findings = items;
    return status;
}

tl_status tl_history_detection(tl_history *history, const tl_history_run *run, tl_run_detection *detection, bool *any,
                               tl_error *error) {
    static const char sql[] = "SELECT state, learnt_s, needed_s, watched_s FROM learned WHERE run = ?1 OR"
                              " (SELECT verb FROM runs WHERE run = ?1) <> 'replay'";
    sqlite3_stmt *statement = NULL;
    tl_status status = query_row(history, sql, run->run, 0, NULL, &statement, error);
    *any = status == TL_OK && statement != NULL;
    if (*any) {
        table_row row = row_of(statement);
        detection->is_ready = strcmp(read_text(&row, NAME_MOST), "watching") == 0;
        detection->learnt = take_number(&row);
        detection->needed = take_number(&row);
        detection->watched = take_number(&row);
        if (!row.right) {
            status = tl_database_invalid(history->database, error, "the state of the change detector is invalid");
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* ---- Checkpoints ---- */

static tl_status read_checkpoint(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement,
                                 int64_t before, const tl_history_checkpoint **checkpoint, tl_error *error) {
    char digest[TL_SHA256_TEXT];
    tl_history_checkpoint *read = tl_arena_take(&history->arena, 1, sizeof *read);
    if (read == NULL) {
        return fail_memory(error);
    }
    table_row row = row_of(statement);
    int64_t last = tl_history_last_possible(run);
    read->tick = take_integer(&row, 0, before <= last ? before - 1 : last);
    read->format = take_text(history, &row, NAME_MOST);
    const char *expected = read_text(&row, NAME_MOST);
    const unsigned char *bytes = read_bytes(&row, &read->size);
    if (!row.right) {
        return tl_database_invalid(history->database, error, "a checkpoint of run %" PRId64 " is incomplete or invalid",
                                   run->run);
    }
    unsigned char *copy = tl_arena_take(&history->arena, read->size, 1);
    if (copy == NULL) {
        return fail_memory(error);
    }
    if (read->size != 0) {
        memcpy(copy, bytes, read->size);
    }
    tl_sha256(copy, read->size, digest);
    read->bytes = copy;
    read->whole = strcmp(expected, digest) == 0;
    *checkpoint = read;
    return TL_OK;
}

tl_status tl_history_checkpoint_before(tl_history *history, const tl_history_run *run, int64_t before,
                                       const tl_history_checkpoint **checkpoint, tl_error *error) {
    static const char sql[] = "SELECT tick, format, sha256, bytes FROM checkpoints WHERE run = ?1 AND tick < ?2"
                              " ORDER BY tick DESC LIMIT 1";
    sqlite3_stmt *statement = NULL;
    *checkpoint = NULL;
    tl_status status = query_row(history, sql, run->run, before, NULL, &statement, error);
    if (statement != NULL) {
        status = read_checkpoint(history, run, statement, before, checkpoint, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_time tl_history_execution_cost(tl_history *history, const tl_history_run *run) {
    static const char sql[] = "SELECT min(sum(used_ns) / max(sum(executions), 1), 1000000000) FROM"
                              " (SELECT used_ns, executions FROM steps WHERE run = ?1 AND used_ns > 0"
                              " ORDER BY step DESC LIMIT 1000)";
    sqlite3_stmt *statement = NULL;
    tl_error ignored;
    tl_time cost = 0;
    (void)query_row(history, sql, run->run, 0, NULL, &statement, &ignored);
    if (statement != NULL) {
        table_row row = row_of(statement);
        cost = take_integer_or(&row, 0, TL_SECOND, 0);
    }
    (void)sqlite3_finalize(statement);
    return cost;
}

/* ---- Rows: each statement begins after the last row of the previous one ---- */

enum { ROWS_AT_ONCE = 4096 };

/* State of a walk through rows: the previous row, and the limits for the next one. */
typedef struct row_key {
    tl_history *history;
    const tl_history_run *run;
    const tl_history_visitor *visitor;
    int64_t number;  /* tick or step; the next one is not smaller */
    int64_t last;    /* largest number */
    int64_t signal;  /* with the same number, the next signal is larger */
    int64_t signals; /* number of signals */
} row_key;

static void take_key(row_key *key, table_row *row) {
    int64_t number = take_integer(row, key->number < 0 ? 0 : key->number, key->last);
    int64_t signal = take_integer(row, 0, key->signals - 1);
    row->right = row->right && (number > key->number || signal > key->signal);
    key->number = number;
    key->signal = signal;
}

/* Passes a row, whose key was read, to its callback. Returns false if the row is invalid. */
typedef bool pass_row(table_row *row, const row_key *key);

/* A newer program may have written larger codes than those known here. */
static int64_t take_code(table_row *row, const tl_history_visitor *visitor, int64_t named) {
    return take_integer(row, 0, visitor->strict ? named : TL_ROW_NUMBER_MAX);
}

static uint32_t take_bits(table_row *row) {
    return (uint32_t)take_integer(row, 0, UINT32_MAX);
}

static bool pass_sample(table_row *row, const row_key *key) {
    tl_history_sample sample = {.tick = key->number, .signal = (size_t)key->signal};
    sample.value = take_number(row);
    sample.quality = take_code(row, key->visitor, TL_LAST_QUALITY);
    sample.stamp = take_integer_or(row, -TL_ROW_NUMBER_MAX, TL_ROW_NUMBER_MAX, TL_TIME_NEVER);
    if (row->right) {
        key->visitor->sample(key->visitor->context, &sample);
    }
    return row->right;
}

static bool pass_step(table_row *row, const row_key *key) {
    tl_history_step step = {.step = key->number};
    step.outcome = take_code(row, key->visitor, TL_OUTCOMES - 1);
    step.stop = take_code(row, key->visitor, TL_STOP_TIME);
    step.objective = take_number(row);
    step.objective_nominal = take_number(row);
    step.evaluations = take_bits(row);
    step.executions = (int64_t)take_count(row);
    step.used = (int64_t)take_count(row);
    step.predicted = (int64_t)take_count(row);
    step.flags = take_bits(row);
    step.held = take_bits(row);
    if (row->right) {
        key->visitor->step(key->visitor->context, &step);
    }
    return row->right;
}

static bool pass_output(table_row *row, const row_key *key) {
    tl_history_output output = {.step = key->number, .signal = (size_t)key->signal};
    output.y = take_number(row);
    output.measured = take_number(row);
    output.quality = (int64_t)take_count(row);
    output.readings = (int64_t)take_count(row);
    output.squares = take_number(row);
    output.rejected = (int64_t)take_count(row);
    output.released = take_number(row);
    if (row->right) {
        key->visitor->output(key->visitor->context, &output);
    }
    return row->right;
}

static bool pass_adjustment(table_row *row, const row_key *key) {
    tl_history_adjustment adjustment = {.step = key->number, .signal = (size_t)key->signal};
    adjustment.u = take_number(row);
    adjustment.nominal = take_number(row);
    if (row->right) {
        key->visitor->adjustment(key->visitor->context, &adjustment);
    }
    return row->right;
}

/* ---- Tables ---- */

#define RANGE_SQL(table, key)                                                                                          \
    "SELECT (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " LIMIT 1),"                \
    " (SELECT " key " FROM " table " WHERE run = ?1 AND " key " >= ?2 ORDER BY " key " DESC LIMIT 1)"

#define ROWS_SQL(table, key, columns)                                                                                  \
    "SELECT " key ", signal, " columns " FROM " table " WHERE run = ?1 AND (" key ", signal) > (?2, ?3) AND " key      \
    " <= ?4 ORDER BY " key ", signal LIMIT ?5"

/* Queries for the range and the rows of each table, and the function that reads its rows. */
static const struct {
    const char *what;
    const char *range;
    const char *rows;
    pass_row *pass;
} tables[TABLES] = {
    [TL_HISTORY_SAMPLES] = {"the sample of tick", RANGE_SQL("samples", "tick"),
                            ROWS_SQL("samples", "tick", "value, quality, stamp_ns"), pass_sample},
    [TL_HISTORY_STEPS] = {"step", RANGE_SQL("steps", "step"),
                          "SELECT step, 0, outcome, stop, J, J_nominal, evaluations, executions, used_ns, predicted,"
                          " flags, held FROM steps"
                          " WHERE run = ?1 AND step > ?2 AND ?3 = ?3 AND step <= ?4 ORDER BY step LIMIT ?5",
                          pass_step},
    [TL_HISTORY_OUTPUTS] = {"the output of step", RANGE_SQL("outputs", "step"),
                            ROWS_SQL("outputs", "step",
                                     "simulated, measured, quality, readings, squares, rejected, released"),
                            pass_output},
    [TL_HISTORY_ADJUSTMENTS] = {"the adjustment of step", RANGE_SQL("adjustments", "step"),
                                ROWS_SQL("adjustments", "step", "applied, nominal"), pass_adjustment},
};

static tl_status fail_row(tl_history *history, const tl_history_run *run, tl_history_table table, int64_t number,
                          tl_error *error) {
    return tl_database_invalid(history->database, error, "%s %" PRId64 " of run %" PRId64 " has an invalid value",
                               tables[table].what, number, run->run);
}

/* Prepares a statement once; it is reset after each use. */
static tl_status prepare_once(tl_history *history, const char *sql, sqlite3_stmt **statement, tl_error *error) {
    return *statement != NULL ? TL_OK : tl_database_prepare(history->database, sql, statement, error);
}

tl_status tl_history_range(tl_history *history, const tl_history_run *run, tl_history_table table, int64_t from,
                           int64_t range[2], bool *any, tl_error *error) {
    tl_status status = prepare_once(history, tables[table].range, &history->ranges[table], error);
    sqlite3_stmt *statement = history->ranges[table];
    *any = false;
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_int64(statement, 1, run->run);
    (void)sqlite3_bind_int64(statement, 2, from);
    int code = sqlite3_step(statement);
    table_row row = row_of(statement);
    status = code == SQLITE_ROW ? TL_OK : tl_database_fail(history->database, code, error);
    *any = code == SQLITE_ROW && !is_null(&row);
    if (*any) {
        range[0] = take_integer(&row, 0, tl_history_last_possible(run));
        range[1] = take_integer(&row, range[0], tl_history_last_possible(run));
        status = row.right ? TL_OK : fail_row(history, run, table, range[0], error);
    }
    (void)sqlite3_reset(statement);
    return status;
}

tl_status tl_history_last_step(tl_history *history, const tl_history_run *run, int64_t *step, tl_error *error) {
    int64_t range[2] = {-1, -1};
    bool any = false;
    tl_status status = tl_history_range(history, run, TL_HISTORY_STEPS, INT64_MIN, range, &any, error);
    *step = any ? range[1] : -1;
    return status;
}

/* Ends the transaction of a statement that has returned `code`; then the visitor may write. */
static tl_status end_rows(const tl_history *history, sqlite3_stmt *statement, tl_status status, int code,
                          const tl_history_visitor *visitor, tl_error *error) {
    status = status == TL_OK && code != SQLITE_DONE ? tl_database_fail(history->database, code, error) : status;
    (void)sqlite3_reset(statement);
    if (visitor->pause != NULL) {
        visitor->pause(visitor->context);
    }
    return status;
}

/* Passes the next rows of one statement, after the key. */
static tl_status pass_rows(row_key *key, tl_history_table table, int *count, tl_error *error) {
    sqlite3_stmt *statement = key->history->rows[table];
    int code = SQLITE_ROW;
    tl_status status = TL_OK;
    *count = 0;
    (void)sqlite3_bind_int64(statement, 1, key->run->run);
    (void)sqlite3_bind_int64(statement, 2, key->number);
    (void)sqlite3_bind_int64(statement, 3, key->signal);
    (void)sqlite3_bind_int64(statement, 4, key->last);
    (void)sqlite3_bind_int(statement, 5, ROWS_AT_ONCE);
    while (status == TL_OK && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        table_row row = row_of(statement);
        int64_t number = sqlite3_column_int64(statement, 0);
        (*count)++;
        take_key(key, &row);
        if (!row.right || !tables[table].pass(&row, key)) {
            status = fail_row(key->history, key->run, table, number, error);
        }
    }
    return end_rows(key->history, statement, status, code, key->visitor, error);
}

tl_status tl_history_rows(tl_history *history, const tl_history_run *run, const int64_t range[2],
                          const tl_history_visitor *visitor, tl_error *error) {
    const bool wanted[TABLES] = {visitor->sample != NULL, visitor->step != NULL, visitor->output != NULL,
                                 visitor->adjustment != NULL};
    const size_t signals[TABLES] = {visitor->signals[TL_HISTORY_PLANT], 1, visitor->signals[TL_HISTORY_MATCH],
                                    visitor->signals[TL_HISTORY_ADJUST]};
    tl_status status = TL_OK;
    for (int table = 0; table < TABLES && status == TL_OK; table++) {
        row_key key = {history, run, visitor, range[0] - 1, range[1], INT64_MAX, (int64_t)signals[table]};
        int count = wanted[table] ? ROWS_AT_ONCE : 0;
        status = wanted[table] ? prepare_once(history, tables[table].rows, &history->rows[table], error) : TL_OK;
        while (status == TL_OK && count == ROWS_AT_ONCE) {
            status = pass_rows(&key, (tl_history_table)table, &count, error);
        }
    }
    return status;
}

/* ---- Ticks: the rows of TICKS_AT_ONCE ticks are read in one transaction, and returned one by one
 * ---- */

enum { TICKS_AT_ONCE = 64 };

struct tl_history_ticks {
    tl_history *history;
    const tl_history_run *run;
    tl_history_visitor samples;
    tl_history_visitor steps; /* and adjustments */
    int64_t next;             /* first tick that is not read yet */
    size_t count;             /* of ticks in the buffer */
    size_t returned;          /* ticks returned from the buffer */
    tl_history_tick buffer[TICKS_AT_ONCE];
};

/* A missing value was not finite when it was recorded. */
static void add_sample(void *context, const tl_history_sample *found) {
    tl_history_ticks *ticks = context;
    /* Ticks ascend within TICKS_AT_ONCE numbers, so there is room. */
    if (ticks->count == 0 || ticks->buffer[ticks->count - 1].sample.tick != found->tick) {
        tl_history_tick *tick = &ticks->buffer[ticks->count++];
        memset(tick, 0, sizeof *tick);
        tick->sample.tick = found->tick;
        for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
            tick->sample.stamps[i] = TL_TIME_NEVER;
            tick->sample.quality[i] = TL_NO_LINK;
        }
    }
    bool missing = isnan(found->value);
    tl_sample *sample = &ticks->buffer[ticks->count - 1].sample;
    sample->values[found->signal] = missing ? 0.0 : found->value;
    sample->quality[found->signal] = (uint8_t)(missing && found->quality == TL_GOOD ? TL_NOT_A_NUMBER : found->quality);
    sample->stamps[found->signal] = found->stamp;
}

/* Returns the tick at which a step was computed; NULL: it is not in the buffer. If no tick before
 * it is missing, its index follows from its number. */
static tl_history_tick *find_tick(tl_history_ticks *ticks, int64_t step) {
    int64_t number = step + ticks->run->lead;
    int64_t at = number - ticks->buffer[0].sample.tick;
    at = at < (int64_t)ticks->count ? at : (int64_t)ticks->count - 1;
    while (at > 0 && ticks->buffer[at].sample.tick > number) {
        at--;
    }
    return at >= 0 && ticks->buffer[at].sample.tick == number ? &ticks->buffer[at] : NULL;
}

static void add_step(void *context, const tl_history_step *found) {
    tl_history_tick *tick = find_tick(context, found->step);
    if (tick != NULL) {
        tick->has_step = true;
        tick->step = *found;
    }
}

/* Signals of a step ascend; the first value that is not finite ends the row. */
static void add_adjustment(void *context, const tl_history_adjustment *found) {
    tl_history_tick *tick = find_tick(context, found->step);
    if (tick != NULL && found->signal == tick->adjusted && !isnan(found->u)) {
        tick->u[tick->adjusted++] = found->u;
    }
}

tl_status tl_history_ticks_begin(tl_history *history, const tl_history_run *run, int64_t from, tl_history_ticks **ticks,
                                 tl_error *error) {
    const tl_recorder_signal *signals = NULL;
    size_t count = 0;
    *ticks = NULL;
    tl_status status = tl_history_signals(history, run, TL_HISTORY_PLANT, &signals, &count, error);
    if (status != TL_OK) {
        return status;
    }
    tl_history_ticks *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        return fail_memory(error);
    }
    opened->history = history;
    opened->run = run;
    opened->next = from < 0 ? 0 : from;
    opened->samples = (tl_history_visitor){
        .context = opened, .strict = true, .signals = {[TL_HISTORY_PLANT] = count}, .sample = add_sample};
    opened->steps = (tl_history_visitor){.context = opened,
                                         .strict = true,
                                         .signals = {[TL_HISTORY_ADJUST] = TL_MAX_ADJUST},
                                         .step = add_step,
                                         .adjustment = add_adjustment};
    *ticks = opened;
    return TL_OK;
}

void tl_history_ticks_end(tl_history_ticks *ticks) {
    free(ticks);
}

/* Reads the first recorded tick at or after `next`, and the TICKS_AT_ONCE − 1 after it. */
static tl_status read_block(tl_history_ticks *ticks, tl_error *error) {
    int64_t there[2] = {0};
    bool any = false;
    tl_status status =
        tl_history_range(ticks->history, ticks->run, TL_HISTORY_SAMPLES, ticks->next, there, &any, error);
    if (status != TL_OK || !any) {
        return status;
    }
    const int64_t numbers[2] = {there[0], there[0] + TICKS_AT_ONCE - 1};
    const int64_t steps[2] = {numbers[0] - ticks->run->lead, numbers[1] - ticks->run->lead};
    status = tl_history_rows(ticks->history, ticks->run, numbers, &ticks->samples, error);
    if (status == TL_OK && (ticks->count == 0 || ticks->buffer[0].sample.tick != numbers[0])) {
        return fail_row(ticks->history, ticks->run, TL_HISTORY_SAMPLES, numbers[0],
                        error); /* it was found just before */
    }
    return status == TL_OK ? tl_history_rows(ticks->history, ticks->run, steps, &ticks->steps, error) : status;
}

/* Fills the buffer in one transaction. On a failure the buffer is empty, so that no incomplete tick
 * is returned. */
static tl_status read_ticks(tl_history_ticks *ticks, tl_error *error) {
    sqlite3 *database = ticks->history->database;
    ticks->count = 0;
    ticks->returned = 0;
    tl_status status = tl_database_execute(database, "BEGIN", error);
    if (status != TL_OK) {
        return status;
    }
    status = read_block(ticks, error);
    (void)sqlite3_exec(database, "COMMIT", NULL, NULL, NULL);
    if (status != TL_OK) {
        ticks->count = 0;
    } else if (ticks->count > 0) {
        ticks->next = ticks->buffer[ticks->count - 1].sample.tick + 1;
    }
    return status;
}

tl_status tl_history_ticks_next(tl_history_ticks *ticks, tl_history_tick *tick, bool *end, tl_error *error) {
    tl_status status = ticks->returned == ticks->count ? read_ticks(ticks, error) : TL_OK;
    *end = status == TL_OK && ticks->count == 0;
    if (status == TL_OK && !*end) {
        *tick = ticks->buffer[ticks->returned++];
    }
    return status;
}

/* ---- Events ---- */

/* Ids must ascend. */
static bool pass_event(sqlite3_stmt *statement, int64_t *last, const tl_history_visitor *visitor) {
    table_row row = row_of(statement);
    tl_history_event event = {0};
    int64_t time = 0;
    *last = take_integer(&row, *last + 1, INT64_MAX - 1);
    event.at = read_text(&row, TL_UTC_TEXT);
    event.has_tick = !is_null(&row);
    event.tick = take_integer_or(&row, 0, TL_ROW_NUMBER_MAX, 0);
    event.severity = read_text(&row, NAME_MOST);
    event.source = read_text(&row, NAME_MOST);
    event.text = read_text(&row, NAME_MOST);
    bool right = row.right && tl_utc_parse(event.at, &time);
    if (right) {
        visitor->event(visitor->context, &event);
    }
    return right;
}

/* The query uses the order of the ids, because sorting would load all events into memory. */
tl_status tl_history_events(tl_history *history, const tl_history_run *run, const char *from_at, int64_t most,
                            const tl_history_visitor *visitor, tl_error *error) {
    static const char sql[] = "SELECT event, at, tick, coalesce(name, CAST(severity AS TEXT)), source, text FROM events"
                              " LEFT JOIN severities ON code = severity"
                              " WHERE run = ?1 AND at >= ?3 AND event > ?4 ORDER BY event LIMIT ?5";
    static const char first[] = "SELECT min(event) FROM (SELECT event FROM events WHERE run = ?1 AND at >= ?3"
                                " ORDER BY event DESC LIMIT ?2)";
    sqlite3_stmt *statement = NULL;
    int64_t last = 0;
    int found = ROWS_AT_ONCE;
    tl_status status = most < 0 ? TL_OK : query_row(history, first, run->run, most, from_at, &statement, error);
    if (statement != NULL) {
        const int64_t oldest = sqlite3_column_int64(statement, 0); /* NULL: no event is wanted, or there is none */
        last = sqlite3_column_type(statement, 0) == SQLITE_NULL ? INT64_MAX - 1 : oldest > 0 ? oldest - 1 : 0;
        (void)sqlite3_finalize(statement);
    }
    status = status == TL_OK ? tl_database_prepare(history->database, sql, &statement, error) : status;
    while (status == TL_OK && found == ROWS_AT_ONCE) {
        int code = SQLITE_ROW;
        (void)sqlite3_bind_int64(statement, 1, run->run);
        (void)sqlite3_bind_text(statement, 3, from_at, -1, SQLITE_STATIC);
        (void)sqlite3_bind_int64(statement, 4, last);
        (void)sqlite3_bind_int(statement, 5, ROWS_AT_ONCE);
        for (found = 0; status == TL_OK && (code = sqlite3_step(statement)) == SQLITE_ROW; found++) {
            if (!pass_event(statement, &last, visitor)) {
                status = tl_database_invalid(history->database, error,
                                             "an event of run %" PRId64 " has an invalid value", run->run);
            }
        }
        status = end_rows(history, statement, status, code, visitor, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* ---- Minutes and hours ---- */

static bool pass_period(table_row *row, int length_s, const tl_history_run *runs, size_t count, char kind[16],
                        int64_t key[3], const tl_history_visitor *visitor) {
    static const char *const kinds[] = {"adjust", "match", "outcome", "plant"};
    tl_history_period period = {.run = NULL};
    const int64_t last[] = {key[0], key[1], key[2]};
    bool is_known = false;
    key[0] = take_integer(row, 1, INT64_MAX - 1);
    for (size_t i = 0; i < count && period.run == NULL; i++) {
        period.run = runs[i].run == key[0] ? &runs[i] : NULL;
    }
    key[1] = take_integer(row, 0, TL_ROW_NUMBER_MAX / (TL_SECOND * length_s));
    period.start_s = key[1] * length_s;
    period.kind = read_text(row, 15);
    int order = strcmp(period.kind, kind);
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        is_known = is_known || strcmp(period.kind, kinds[i]) == 0;
    }
    (void)snprintf(kind, 16, "%s", period.kind);
    key[2] = take_integer(row, 0, TL_ROW_NUMBER_MAX);
    period.name = read_text(row, NAME_MOST);
    period.unit = read_text(row, NAME_MOST);
    period.count = take_integer(row, 1, TL_ROW_NUMBER_MAX);
    period.mean = take_number(row);
    period.least = take_number(row);
    period.largest = take_number(row);
    period.spread = take_number(row);
    bool is_next = key[0] != last[0]   ? key[0] > last[0]
                   : key[1] != last[1] ? key[1] > last[1]
                   : order != 0        ? order > 0
                                       : key[2] > last[2];
    bool right = row->right && period.run != NULL && is_known && is_next;
    if (right) {
        visitor->period(visitor->context, &period);
    }
    return right;
}

tl_status tl_history_periods(tl_history *history, const tl_history_run *run, int length_s,
                             const tl_history_visitor *visitor, tl_error *error) {
    static const char sql[] =
        "SELECT p.run, p.period, p.kind, p.signal, coalesce(s.name, o.name, ''), coalesce(s.unit, ''), p.count, p.mean,"
        " p.least, p.largest, p.spread FROM periods p JOIN runs r USING (run)"
        " LEFT JOIN signals s ON s.run = p.run AND s.kind = p.kind AND s.signal = p.signal"
        " LEFT JOIN outcomes o ON p.kind = 'outcome' AND o.code = p.signal"
        " WHERE p.length_s = ?1 AND (p.run, p.period, p.kind, p.signal) > (?2, ?3, ?4, ?5)"
        " AND iif(?6 = 0, r.verb <> 'replay', p.run = ?6) ORDER BY p.run, p.period, p.kind, p.signal LIMIT ?7";
    const tl_history_run *runs = NULL;
    sqlite3_stmt *statement = NULL;
    int64_t key[3] = {0, -1, -1}; /* run, period and signal of the last row */
    char kind[16] = "";
    size_t count = 0;
    int found = ROWS_AT_ONCE;
    int code = SQLITE_DONE;
    tl_status status = tl_history_runs(history, &runs, &count, error);
    status = status == TL_OK ? tl_database_prepare(history->database, sql, &statement, error) : status;
    while (status == TL_OK && found == ROWS_AT_ONCE) {
        const int64_t numbers[] = {
            length_s, key[0], key[1], 0, key[2], strcmp(run->verb, "replay") == 0 ? run->run : 0, ROWS_AT_ONCE};
        for (int i = 0; i < 7; i++) {
            (void)sqlite3_bind_int64(statement, i + 1, numbers[i]);
        }
        (void)sqlite3_bind_text(statement, 4, kind, -1, SQLITE_TRANSIENT);
        for (found = 0; status == TL_OK && (code = sqlite3_step(statement)) == SQLITE_ROW; found++) {
            table_row row = row_of(statement);
            if (!pass_period(&row, length_s, runs, count, kind, key, visitor)) {
                status =
                    tl_database_invalid(history->database, error,
                                        "period %" PRId64 " of run %" PRId64 " has an invalid value", key[1], key[0]);
            }
        }
        status = end_rows(history, statement, status, code, visitor, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}
