/* Reads what was recorded: see history.h. */
#include "firmware/store/history.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/text.h"
#include "firmware/config/measurements.h"
#include "firmware/store/database.h"
#include "master/base/arena.h"

/* ---- Reading what the recorder wrote.
 *
 * A walk through the ticks reads TICKS_AT_ONCE of them in one transaction and hands them out one by one. Nothing in a
 * database is believed, not even that rows come in the order that was asked for: SQLite takes them as they lie in pages,
 * which may be damaged. What the recorder does not write is damage, and said. */

enum { TICKS_AT_ONCE = 64 };

static const tl_time LONGEST_STEP = 3600 * TL_SECOND; /* of a configuration */

struct tl_history {
    sqlite3 *database;
    tl_arena arena;
};

struct tl_history_ticks {
    tl_history *history;
    const tl_history_run *run;
    size_t signals;
    int64_t next; /* first tick not read yet */
    sqlite3_stmt *first_sample;
    sqlite3_stmt *samples;
    sqlite3_stmt *steps;
    sqlite3_stmt *adjustments;
    size_t count; /* of ticks in the buffer */
    size_t given; /* of them, handed out */
    tl_history_tick buffer[TICKS_AT_ONCE];
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

sqlite3 *tl_history_database(tl_history *history) {
    return history->database;
}

static tl_status fail_memory(tl_error *error) {
    return tl_fail(error, TL_TRY_AGAIN, "out of memory while reading the database");
}

static const char *file_of(tl_history *history) {
    return sqlite3_db_filename(history->database, "main");
}

/* ---- Runs, signals, configurations ------------------------------------------------------------------------------- */

int64_t tl_history_last_possible(const tl_history_run *run) {
    return TL_ROW_LARGEST / run->step;
}

/* A copy of the next column's text, which outlives the row. NULL: memory is out, and the row is not right. */
static const char *copy_text(tl_history *history, tl_row *row, const char *text) {
    const char *copy = tl_arena_text(&history->arena, text);
    row->right = row->right && copy != NULL;
    return copy;
}

static const char *take_text(tl_history *history, tl_row *row, size_t most) {
    return copy_text(history, row, tl_row_text(row, most));
}

static const char *take_text_or_null(tl_history *history, tl_row *row, size_t most) {
    const char *text = tl_row_text_or_null(row, most);
    return text == NULL ? NULL : copy_text(history, row, text);
}

static const char *take_utc_or_null(tl_history *history, tl_row *row) {
    const char *utc = take_text_or_null(history, row, TL_UTC_TEXT);
    int64_t time = 0;
    row->right = row->right && (utc == NULL || tl_utc_parse(utc, &time));
    return utc;
}

static uint64_t take_count(tl_row *row) {
    return (uint64_t)tl_row_integer(row, 0, TL_ROW_LARGEST);
}

static uint32_t take_small(tl_row *row) {
    return (uint32_t)tl_row_integer(row, 0, INT32_MAX);
}

/* ---- One run ---- */

#define RUN_COLUMNS                                                                                                    \
    "SELECT run, verb, name, version, configuration, started, ended, ended_reason, committed,"                         \
    " step_ns, prediction, measurements, lead, samples_written, steps_written, events_written, entries_lost,"          \
    " removed_before, fmus, boot, start_ns, resumed_run, resumed_tick, resumed_from"                                   \
    " FROM runs LEFT JOIN beginnings USING (run) "

static void read_names(tl_history *history, tl_row *row, tl_history_run *run) {
    run->verb = take_text(history, row, TL_ROW_NAME);
    run->name = take_text(history, row, TL_ROW_NAME);
    run->version = take_text(history, row, TL_ROW_NAME);
    run->configuration_hash = take_text(history, row, TL_SHA256_TEXT);
}

/* A run that has an end has a reason for it. */
static void read_times(tl_history *history, tl_row *row, tl_history_run *run) {
    run->started = take_utc_or_null(history, row);
    run->ended = take_utc_or_null(history, row);
    run->ended_reason = take_text_or_null(history, row, TL_ROW_NAME);
    run->committed = take_utc_or_null(history, row);
    run->committed = run->committed == NULL ? run->started : run->committed;
    row->right = row->right && run->started != NULL && (run->ended == NULL) == (run->ended_reason == NULL);
}

static void read_rule(tl_row *row, tl_history_run *run) {
    run->step = tl_row_integer(row, 1, LONGEST_STEP);
    run->prediction = take_small(row);
    const char *measurements = tl_row_text(row, TL_ROW_NAME);
    run->measurements = tl_measurements_named(measurements);
    run->lead = take_small(row);
    row->right = row->right && strcmp(measurements, tl_measurements_name(run->measurements)) == 0;
}

static void read_counts(tl_row *row, tl_history_run *run) {
    run->samples = take_count(row);
    run->steps = take_count(row);
    run->events = take_count(row);
    run->lost = take_count(row);
    run->removed_before = tl_row_integer_or(row, 0, TL_ROW_LARGEST, 0);
}

static void read_resumption(tl_history *history, tl_row *row, tl_history_run *run) {
    run->fmus = take_text(history, row, TL_ROW_NAME);
    run->boot = take_text(history, row, TL_ROW_NAME);
    run->has_start = !tl_row_is_null(row);
    run->start = tl_row_integer_or(row, -TL_ROW_LARGEST, TL_ROW_LARGEST, 0);
    run->resumption.run = tl_row_integer_or(row, 0, TL_ROW_LARGEST, 0);
    run->resumption.tick = tl_row_integer_or(row, 0, tl_history_last_possible(run), 0);
    const char *from = tl_row_text_or_null(row, TL_ROW_NAME);
    run->resumption.from = tl_resumed_from_named(from);
    row->right = row->right && (from == NULL || strcmp(from, tl_resumed_from_name(run->resumption.from)) == 0);
}

/* False if the row cannot be one that the recorder wrote. */
static bool read_run(tl_history *history, sqlite3_stmt *statement, tl_history_run *run) {
    tl_row row = tl_row_of(statement);
    run->run = tl_row_integer(&row, 1, TL_ROW_LARGEST);
    read_names(history, &row, run);
    read_times(history, &row, run);
    read_rule(&row, run);
    read_counts(&row, run);
    read_resumption(history, &row, run);
    return row.right;
}

/* ---- Runs ---- */

static tl_status count_rows(tl_history *history, sqlite3_stmt *statement, size_t *count, tl_error *error) {
    int code = SQLITE_ROW;
    int64_t last = INT64_MIN;
    *count = 0;
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        int64_t run = sqlite3_column_int64(statement, 0);
        if (*count > 0 && run <= last) {
            (void)sqlite3_reset(statement);
            return tl_database_damaged(history->database, error, "its runs are not in their order");
        }
        last = run;
        (*count)++;
    }
    (void)sqlite3_reset(statement);
    return code == SQLITE_DONE ? TL_OK : tl_database_fail(history->database, code, error);
}

static tl_status read_runs(tl_history *history, sqlite3_stmt *statement, const tl_history_run **runs, size_t *count,
                           tl_error *error) {
    tl_status status = count_rows(history, statement, count, error);
    if (status != TL_OK) {
        return status;
    }
    tl_history_run *read = tl_arena_take(&history->arena, *count, sizeof *read);
    if (read == NULL) {
        return fail_memory(error);
    }
    size_t done = 0;
    int code = SQLITE_DONE;
    while (done < *count && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        if (!read_run(history, statement, &read[done])) {
            return tl_database_damaged(history->database, error,
                                       "what it tells of run %" PRId64 " is incomplete or wrong",
                                       (int64_t)sqlite3_column_int64(statement, 0));
        }
        done++;
    }
    *runs = read;
    *count = done;
    return code == SQLITE_DONE || code == SQLITE_ROW ? TL_OK : tl_database_fail(history->database, code, error);
}

tl_status tl_history_runs(tl_history *history, const tl_history_run **runs, size_t *count, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(history->database, RUN_COLUMNS "ORDER BY run", &statement, error);
    if (status == TL_OK) {
        status = read_runs(history, statement, runs, count, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_status tl_history_find(tl_history *history, int64_t id, const tl_history_run **run, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    size_t count = 0;
    const char *sql = id == 0 ? RUN_COLUMNS "ORDER BY run DESC LIMIT 1" : RUN_COLUMNS "WHERE run = ?1";
    tl_status status = tl_database_prepare(history->database, sql, &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, id);
        status = read_runs(history, statement, run, &count, error);
    }
    (void)sqlite3_finalize(statement);
    if (status == TL_OK && count == 0) {
        return id == 0 ? tl_fail(error, TL_BAD_DATA, "%s: holds no run", file_of(history))
                       : tl_fail(error, TL_BAD_DATA, "%s: holds no run %lld", file_of(history), (long long)id);
    }
    return status;
}

tl_status tl_history_text(tl_history *history, const char *hash, const char **text, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    *text = NULL;
    tl_status status =
        tl_database_prepare(history->database, "SELECT text FROM configurations WHERE hash = ?1", &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_text(statement, 1, hash, -1, SQLITE_STATIC);
        int code = sqlite3_step(statement);
        tl_row row = tl_row_of(statement);
        *text = code == SQLITE_ROW ? take_text(history, &row, TL_ROW_TEXT) : NULL;
        if (code == SQLITE_DONE || !row.right) {
            status =
                tl_database_damaged(history->database, error, "the configuration %.12s\342\200\246 is missing", hash);
        } else if (code != SQLITE_ROW) {
            status = tl_database_fail(history->database, code, error);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_status tl_history_configuration(tl_history *history, const tl_history_run *run, const char **text, tl_error *error) {
    return tl_history_text(history, run->configuration_hash, text, error);
}

/* ---- Tunings ---- */

static bool read_tuning(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement, int64_t least,
                        tl_history_tuning *tuning) {
    tl_row row = tl_row_of(statement);
    int64_t at = 0;
    tuning->tick = tl_row_integer(&row, least, tl_history_last_possible(run));
    tuning->hash = take_text(history, &row, TL_SHA256_TEXT);
    tuning->at = take_text(history, &row, TL_UTC_TEXT);
    tuning->who = take_text(history, &row, TL_ROW_NAME);
    tuning->origin = take_text(history, &row, TL_ROW_NAME);
    tuning->why = take_text(history, &row, TL_ROW_NAME);
    return row.right && tl_utc_parse(tuning->at, &at) && strlen(tuning->hash) == TL_SHA256_TEXT - 1 &&
           tl_identity_is_sound(tuning->hash);
}

static tl_status fail_tunings(tl_history *history, const tl_history_run *run, tl_error *error) {
    return tl_database_damaged(history->database, error, "the tunings of run %" PRId64 " are incomplete or wrong",
                               run->run);
}

static tl_status read_tunings(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement,
                              tl_history_tuning *tunings, size_t *count, tl_error *error) {
    int code = SQLITE_ROW;
    int64_t least = 0;
    size_t most = *count;
    *count = 0;
    while (*count < most && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        if (!read_tuning(history, run, statement, least, &tunings[*count])) {
            return fail_tunings(history, run, error);
        }
        least = tunings[*count].tick + 1;
        (*count)++;
    }
    return code == SQLITE_DONE || code == SQLITE_ROW ? TL_OK : tl_database_fail(history->database, code, error);
}

/* How many there are, at most TL_HISTORY_TUNINGS. */
static tl_status count_tunings(tl_history *history, const tl_history_run *run, size_t *count, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status =
        tl_database_prepare(history->database, "SELECT count(*) FROM tunings WHERE run = ?1", &statement, error);
    *count = 0;
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        int code = sqlite3_step(statement);
        int64_t found = code == SQLITE_ROW ? sqlite3_column_int64(statement, 0) : 0;
        status = code != SQLITE_ROW                        ? tl_database_fail(history->database, code, error)
                 : found < 0 || found > TL_HISTORY_TUNINGS ? fail_tunings(history, run, error)
                                                           : TL_OK;
        *count = status == TL_OK ? (size_t)found : 0;
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_status tl_history_tunings(tl_history *history, const tl_history_run *run, const tl_history_tuning **tunings,
                             size_t *count, tl_error *error) {
    static const char sql[] =
        "SELECT tick, configuration, at, who, origin, why FROM tunings WHERE run = ?1 ORDER BY tick";
    sqlite3_stmt *statement = NULL;
    tl_history_tuning *read = NULL;
    *tunings = NULL;
    tl_status status = count_tunings(history, run, count, error);
    if (status == TL_OK) {
        read = tl_arena_take(&history->arena, *count, sizeof *read);
        status = read != NULL ? tl_database_prepare(history->database, sql, &statement, error) : fail_memory(error);
    }
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        status = read_tunings(history, run, statement, read, count, error);
    }
    (void)sqlite3_finalize(statement);
    *tunings = read;
    return status;
}

static tl_type take_type(tl_row *row) {
    const char *name = tl_row_text(row, TL_ROW_NAME);
    int code = TL_REAL;
    while (code < TL_ENUMERATION && strcmp(name, tl_type_name((tl_type)code)) != 0) {
        code++;
    }
    row->right = row->right && strcmp(name, tl_type_name((tl_type)code)) == 0;
    return (tl_type)code;
}

static bool read_signal(tl_history *history, sqlite3_stmt *statement, size_t index, tl_recorder_signal *signal) {
    tl_row row = tl_row_of(statement);
    (void)tl_row_integer(&row, (int64_t)index, (int64_t)index);
    signal->name = take_text(history, &row, TL_ROW_NAME);
    signal->unit = take_text(history, &row, TL_ROW_NAME);
    signal->type = take_type(&row);
    signal->to = take_text_or_null(history, &row, TL_ROW_NAME);
    return row.right;
}

/* Rows are in the order of their indices; an index that is missing is damage. */
static tl_status read_signals(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement, size_t most,
                              const tl_recorder_signal **signals, size_t *count, tl_error *error) {
    tl_recorder_signal *read = tl_arena_take(&history->arena, most, sizeof *read);
    int code = SQLITE_ROW;
    size_t done = 0;
    *count = 0;
    if (read == NULL) {
        return fail_memory(error);
    }
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        if (done >= most || !read_signal(history, statement, done, &read[done])) {
            return tl_database_damaged(history->database, error,
                                       "the signals of run %" PRId64 " are incomplete or wrong", run->run);
        }
        done++;
    }
    *signals = read;
    *count = done;
    return code == SQLITE_DONE ? TL_OK : tl_database_fail(history->database, code, error);
}

tl_status tl_history_signals(tl_history *history, const tl_history_run *run, tl_history_kind kind,
                             const tl_recorder_signal **signals, size_t *count, tl_error *error) {
    static const char *const names[] = {"plant", "match", "adjust"};
    static const size_t most[] = {TL_MAX_SIGNALS, TL_MAX_MATCH, TL_MAX_ADJUST};
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(history->database,
                                           "SELECT signal, name, unit, type, compared_with FROM signals"
                                           " WHERE run = ?1 AND kind = ?2 ORDER BY signal",
                                           &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        (void)sqlite3_bind_text(statement, 2, names[kind], -1, SQLITE_STATIC);
        status = read_signals(history, run, statement, most[kind], signals, count, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

static bool read_component(tl_history *history, sqlite3_stmt *statement, size_t index, tl_run_component *component) {
    tl_row row = tl_row_of(statement);
    (void)tl_row_integer(&row, (int64_t)index, (int64_t)index);
    component->name = take_text(history, &row, TL_ROW_NAME);
    component->counts.plain = take_count(&row);
    component->counts.predicted = take_count(&row);
    component->counts.executions = take_count(&row);
    component->counts.caught_up = take_count(&row);
    component->counts.unstored = take_count(&row);
    return row.right;
}

static tl_status read_ledger(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement,
                             const tl_run_component **components, size_t *count, tl_error *error) {
    tl_run_component *read = tl_arena_take(&history->arena, TL_RECORDER_COMPONENTS, sizeof *read);
    int code = SQLITE_ROW;
    size_t done = 0;
    *count = 0;
    if (read == NULL) {
        return fail_memory(error);
    }
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        if (done >= TL_RECORDER_COMPONENTS || !read_component(history, statement, done, &read[done])) {
            return tl_database_damaged(history->database, error,
                                       "the components of run %" PRId64 " are incomplete or wrong", run->run);
        }
        done++;
    }
    *components = read;
    *count = done;
    return code == SQLITE_DONE ? TL_OK : tl_database_fail(history->database, code, error);
}

tl_status tl_history_ledger(tl_history *history, const tl_history_run *run, const tl_run_component **components,
                            size_t *count, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(history->database,
                                           "SELECT component, name, plain, predicted, executions, caught_up, unstored"
                                           " FROM components WHERE run = ?1 ORDER BY component",
                                           &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        status = read_ledger(history, run, statement, components, count, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* ---- Checkpoints ------------------------------------------------------------------------------------------------- */

static tl_status read_checkpoint(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement,
                                 int64_t before, const tl_history_checkpoint **checkpoint, tl_error *error) {
    char digest[TL_SHA256_TEXT];
    tl_history_checkpoint *read = tl_arena_take(&history->arena, 1, sizeof *read);
    if (read == NULL) {
        return fail_memory(error);
    }
    tl_row row = tl_row_of(statement);
    int64_t last = tl_history_last_possible(run);
    read->tick = tl_row_integer(&row, 0, before <= last ? before - 1 : last);
    read->format = take_text(history, &row, TL_ROW_NAME);
    const char *expected = tl_row_text(&row, TL_ROW_NAME);
    const unsigned char *bytes = tl_row_bytes(&row, &read->size);
    if (!row.right) {
        return tl_database_damaged(history->database, error, "a checkpoint of run %" PRId64 " is incomplete or wrong",
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
    tl_status status = tl_database_prepare(history->database, sql, &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        (void)sqlite3_bind_int64(statement, 2, before);
        int code = sqlite3_step(statement);
        if (code == SQLITE_ROW) {
            status = read_checkpoint(history, run, statement, before, checkpoint, error);
        } else if (code != SQLITE_DONE) {
            status = tl_database_fail(history->database, code, error);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* The one tick, step or time that a question about a run gives. *any: it is one, and not NULL. */
static tl_status ask_number(tl_history *history, const tl_history_run *run, const char *sql, bool *any, int64_t *number,
                            tl_error *error) {
    sqlite3_stmt *statement = NULL;
    *any = false;
    tl_status status = tl_database_prepare(history->database, sql, &statement, error);
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_int64(statement, 1, run->run);
    int code = sqlite3_step(statement);
    tl_row row = tl_row_of(statement);
    if (code == SQLITE_ROW && !tl_row_is_null(&row)) {
        *number = tl_row_integer(&row, 0, tl_history_last_possible(run));
        *any = row.right;
        status = row.right ? TL_OK
                           : tl_database_damaged(history->database, error, "run %" PRId64 " has ticks that cannot be",
                                                 run->run);
    } else if (code != SQLITE_ROW && code != SQLITE_DONE) {
        status = tl_database_fail(history->database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_time tl_history_execution_cost(tl_history *history, const tl_history_run *run) {
    tl_error ignored;
    bool any = false;
    int64_t cost = 0;
    tl_status status = ask_number(
        history, run,
        "SELECT min(sum(used_ns) / max(sum(executions), 1), 1000000000) FROM (SELECT used_ns, executions FROM steps"
        " WHERE run = ?1 AND used_ns > 0 ORDER BY step DESC LIMIT 1000)",
        &any, &cost, &ignored);
    return status == TL_OK && any ? cost : 0;
}

tl_status tl_history_last_step(tl_history *history, const tl_history_run *run, int64_t *step, tl_error *error) {
    bool any = false;
    *step = -1;
    return ask_number(history, run, "SELECT step FROM steps WHERE run = ?1 ORDER BY step DESC LIMIT 1", &any, step,
                      error);
}

/* ---- Ticks ------------------------------------------------------------------------------------------------------- */

static void tl_history_key_take(tl_history_key *key, tl_row *row) {
    int64_t number = tl_row_integer(row, key->number, key->last);
    int64_t signal = tl_row_integer(row, 0, key->signals - 1);
    row->right = row->right && (number > key->number || signal > key->signal);
    key->number = number;
    key->signal = signal;
}

tl_status tl_history_ticks_begin(tl_history *history, const tl_history_run *run, tl_history_ticks **ticks,
                                 tl_error *error) {
    tl_history_ticks *begun = calloc(1, sizeof *begun);
    const tl_recorder_signal *signals = NULL;
    *ticks = NULL;
    if (begun == NULL) {
        return fail_memory(error);
    }
    begun->history = history;
    begun->run = run;
    tl_status status = tl_history_signals(history, run, TL_HISTORY_PLANT, &signals, &begun->signals, error);
    if (status == TL_OK) {
        status = tl_database_prepare(history->database,
                                     "SELECT tick FROM samples WHERE run = ?1 AND tick >= ?2 ORDER BY tick LIMIT 1",
                                     &begun->first_sample, error);
    }
    if (status == TL_OK) {
        status = tl_database_prepare(history->database,
                                     "SELECT tick, signal, value, quality, stamp_ns FROM samples"
                                     " WHERE run = ?1 AND tick >= ?2 AND tick < ?3 ORDER BY tick, signal",
                                     &begun->samples, error);
    }
    if (status == TL_OK) {
        status = tl_database_prepare(history->database,
                                     "SELECT step, 0, outcome, stop, evaluations, executions, flags FROM steps"
                                     " WHERE run = ?1 AND step >= ?2 AND step < ?3 ORDER BY step",
                                     &begun->steps, error);
    }
    if (status == TL_OK) {
        status = tl_database_prepare(history->database,
                                     "SELECT step, signal, u FROM adjustments"
                                     " WHERE run = ?1 AND step >= ?2 AND step < ?3 ORDER BY step, signal",
                                     &begun->adjustments, error);
    }
    if (status != TL_OK) {
        tl_history_ticks_end(begun);
        return status;
    }
    *ticks = begun;
    return TL_OK;
}

void tl_history_ticks_end(tl_history_ticks *ticks) {
    if (ticks != NULL) {
        (void)sqlite3_finalize(ticks->first_sample);
        (void)sqlite3_finalize(ticks->samples);
        (void)sqlite3_finalize(ticks->steps);
        (void)sqlite3_finalize(ticks->adjustments);
        free(ticks);
    }
}

tl_status tl_history_ticks_range(const tl_history_ticks *ticks, bool *any, int64_t *first, int64_t *last,
                                 tl_error *error) {
    tl_status status = ask_number(ticks->history, ticks->run,
                                  "SELECT tick FROM samples WHERE run = ?1 ORDER BY tick LIMIT 1", any, first, error);
    if (status == TL_OK && *any) {
        status = ask_number(ticks->history, ticks->run,
                            "SELECT tick FROM samples WHERE run = ?1 ORDER BY tick DESC LIMIT 1", any, last, error);
    }
    if (status == TL_OK && *any && *last < *first) {
        status = tl_database_damaged(ticks->history->database, error,
                                     "the ticks of run %" PRId64 " are not in their order", ticks->run->run);
    }
    return status;
}

static void bind_range(sqlite3_stmt *statement, int64_t run, int64_t first, int64_t end) {
    (void)sqlite3_bind_int64(statement, 1, run);
    (void)sqlite3_bind_int64(statement, 2, first);
    if (sqlite3_bind_parameter_count(statement) >= 3) {
        (void)sqlite3_bind_int64(statement, 3, end);
    }
}

static void begin_tick(tl_history_tick *tick, int64_t number) {
    memset(tick, 0, sizeof *tick);
    tick->sample.tick = number;
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        tick->sample.stamps[i] = TL_TIME_NEVER;
        tick->sample.quality[i] = TL_NO_LINK;
    }
}

static tl_status fail_damaged(tl_history_ticks *ticks, const char *what, int64_t number, tl_error *error) {
    return tl_database_damaged(ticks->history->database, error,
                               "%s %" PRId64 " of run %" PRId64 " is none that the recorder writes", what, number,
                               ticks->run->run);
}

/* Where a table is read, and in which tick of the buffer: ticks are in their order, so the search goes on from there. */
typedef struct table_walk {
    tl_history_key key;
    size_t slot;
} table_walk;

/* The tick with this number; NULL: it is not in the buffer. */
static tl_history_tick *find_tick(tl_history_ticks *ticks, table_walk *walk, int64_t number) {
    while (walk->slot < ticks->count && ticks->buffer[walk->slot].sample.tick < number) {
        walk->slot++;
    }
    bool found = walk->slot < ticks->count && ticks->buffer[walk->slot].sample.tick == number;
    return found ? &ticks->buffer[walk->slot] : NULL;
}

/* One row: one signal of one tick. A value that is missing was no number. */
static bool add_sample(tl_history_ticks *ticks, tl_row *row, table_walk *walk) {
    tl_history_key_take(&walk->key, row);
    double value = tl_row_number(row);
    int64_t quality = tl_row_integer(row, TL_GOOD, TL_OUTLIER);
    tl_time stamp = tl_row_integer_or(row, -TL_ROW_LARGEST, TL_ROW_LARGEST, TL_TIME_NEVER);
    if (!row->right) {
        return false;
    }
    /* Ascending within TICKS_AT_ONCE numbers: there is room. */
    if (ticks->count == 0 || ticks->buffer[ticks->count - 1].sample.tick != walk->key.number) {
        begin_tick(&ticks->buffer[ticks->count++], walk->key.number);
    }
    bool missing = isnan(value);
    tl_sample *sample = &ticks->buffer[ticks->count - 1].sample;
    sample->values[walk->key.signal] = missing ? 0.0 : value;
    sample->quality[walk->key.signal] = (uint8_t)(missing && quality == TL_GOOD ? TL_NOT_A_NUMBER : quality);
    sample->stamps[walk->key.signal] = stamp;
    return true;
}

/* One row: one step. */
static bool add_step(tl_history_ticks *ticks, tl_row *row, table_walk *walk) {
    tl_history_tick unwanted = {0};
    tl_history_key_take(&walk->key, row);
    tl_history_tick *tick = find_tick(ticks, walk, walk->key.number + ticks->run->lead);
    tick = tick == NULL ? &unwanted : tick;
    tick->has_step = true;
    tick->step = walk->key.number;
    tick->outcome = (tl_outcome)tl_row_integer(row, TL_FREE, TL_OUTCOMES - 1);
    tick->stop = (tl_stop)tl_row_integer(row, TL_STOP_NONE, TL_STOP_TIME);
    tick->evaluations = (uint32_t)tl_row_integer(row, 0, UINT32_MAX);
    tick->executions = (uint64_t)tl_row_integer(row, 0, TL_ROW_LARGEST);
    tick->flags = (uint32_t)tl_row_integer(row, 0, UINT32_MAX);
    return row->right;
}

/* The signals of a step come in their order; what is not a number ends the row. */
static bool add_adjustment(tl_history_ticks *ticks, tl_row *row, table_walk *walk) {
    tl_history_key_take(&walk->key, row);
    double u = tl_row_number(row);
    tl_history_tick *tick = row->right ? find_tick(ticks, walk, walk->key.number + ticks->run->lead) : NULL;
    if (tick != NULL && walk->key.signal == (int64_t)tick->adjusted && !isnan(u)) {
        tick->u[tick->adjusted++] = u;
    }
    return row->right;
}

/* All rows of one table that belong to TICKS_AT_ONCE ticks or steps. */
static tl_status read_rows(tl_history_ticks *ticks, sqlite3_stmt *statement, int64_t first, const char *what,
                           size_t signals, bool (*add)(tl_history_ticks *ticks, tl_row *row, table_walk *walk),
                           tl_error *error) {
    int code = SQLITE_ROW;
    tl_status status = TL_OK;
    table_walk walk = {.key = {.number = first < 0 ? 0 : first,
                               .last = first + TICKS_AT_ONCE - 1,
                               .signal = -1,
                               .signals = (int64_t)signals}};
    bind_range(statement, ticks->run->run, first, first + TICKS_AT_ONCE);
    while (status == TL_OK && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        tl_row row = tl_row_of(statement);
        if (!add(ticks, &row, &walk)) {
            status = fail_damaged(ticks, what, sqlite3_column_int64(statement, 0), error);
        }
    }
    if (status == TL_OK && code != SQLITE_DONE) {
        status = tl_database_fail(ticks->history->database, code, error);
    }
    (void)sqlite3_reset(statement);
    return status;
}

/* The first tick from `next` on that is there, and the TICKS_AT_ONCE − 1 after it. */
static tl_status read_block(tl_history_ticks *ticks, tl_error *error) {
    sqlite3 *database = ticks->history->database;
    tl_status status = TL_OK;
    bind_range(ticks->first_sample, ticks->run->run, ticks->next, 0);
    int code = sqlite3_step(ticks->first_sample);
    tl_row row = tl_row_of(ticks->first_sample);
    int64_t first = code == SQLITE_ROW ? tl_row_integer(&row, ticks->next, tl_history_last_possible(ticks->run)) : 0;
    if (!row.right) {
        status = fail_damaged(ticks, "the sample of tick", sqlite3_column_int64(ticks->first_sample, 0), error);
    } else if (code != SQLITE_ROW && code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_reset(ticks->first_sample);
    if (status != TL_OK || code != SQLITE_ROW) {
        return status;
    }
    int64_t first_step = first - ticks->run->lead;
    status = read_rows(ticks, ticks->samples, first, "the sample of tick", ticks->signals, add_sample, error);
    if (status == TL_OK && (ticks->count == 0 || ticks->buffer[0].sample.tick != first)) {
        status = fail_damaged(ticks, "the sample of tick", first, error); /* it was there a moment ago */
    }
    if (status == TL_OK) {
        status = read_rows(ticks, ticks->steps, first_step, "step", 1, add_step, error);
    }
    return status == TL_OK
               ? read_rows(ticks, ticks->adjustments, first_step, "u of step", TL_MAX_ADJUST, add_adjustment, error)
               : status;
}

/* Fills the buffer, in one transaction. What cannot be read whole is not handed out at all. */
static tl_status read_ticks(tl_history_ticks *ticks, tl_error *error) {
    sqlite3 *database = ticks->history->database;
    ticks->count = 0;
    ticks->given = 0;
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
    *end = false;
    if (ticks->given == ticks->count) {
        tl_status status = read_ticks(ticks, error);
        if (status != TL_OK) {
            return status;
        }
        if (ticks->count == 0) {
            *end = true;
            return TL_OK;
        }
    }
    *tick = ticks->buffer[ticks->given++];
    return TL_OK;
}

void tl_history_ticks_seek(tl_history_ticks *ticks, int64_t tick) {
    ticks->next = tick < 0 ? 0 : tick;
    ticks->count = 0;
    ticks->given = 0;
}

/* ---- Walking along the key: each statement begins behind the last row of the one before. */

enum { ROWS_AT_ONCE = 4096 };

/* ---- One row ----------------------------------------------------------------------------------------------------- */

/* Hands out a row whose key was read. False: it is none that the recorder writes. */
typedef bool give_row(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor);

static int64_t take_count_rows(tl_row *row) {
    return tl_row_integer(row, 0, TL_ROW_LARGEST);
}

static uint32_t take_bits(tl_row *row) {
    return (uint32_t)tl_row_integer(row, 0, UINT32_MAX);
}

static bool give_sample(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor) {
    tl_history_sample sample = {.tick = key->number, .signal = (size_t)key->signal};
    sample.value = tl_row_number(row);
    sample.quality = take_count_rows(row);
    sample.stamp = tl_row_integer_or(row, -TL_ROW_LARGEST, TL_ROW_LARGEST, TL_TIME_NEVER);
    if (row->right) {
        visitor->sample(visitor->context, &sample);
    }
    return row->right;
}

static bool give_step(tl_row *row, const tl_history_key *key, const tl_history_visitor *visitor) {
    tl_history_step step = {.step = key->number};
    step.outcome = take_count_rows(row);
    step.stop = take_count_rows(row);
    step.objective = tl_row_number(row);
    step.objective_nominal = tl_row_number(row);
    step.evaluations = take_count_rows(row);
    step.executions = take_count_rows(row);
    step.used = take_count_rows(row);
    step.predicted = take_count_rows(row);
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
    output.quality = take_count_rows(row);
    output.readings = take_count_rows(row);
    output.squares = tl_row_number(row);
    output.rejected = take_count_rows(row);
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

static tl_status fail_damaged_rows(tl_history *history, const tl_history_run *run, tl_error *error) {
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
            status = row.right ? TL_OK : fail_damaged_rows(history, run, error);
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
            return fail_damaged_rows(walk->history, walk->run, error);
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
