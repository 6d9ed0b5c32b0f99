/* Reading what the recorder wrote.
 *
 * A walk through the ticks reads TICKS_AT_ONCE of them in one transaction and hands them out one by one. Nothing in a
 * database is believed: indices and codes outside of what the program knows are damage, and said. */
#include "firmware/history.h"

#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/database.h"
#include "firmware/measurements.h"
#include "firmware/sha256.h"
#include "master/base/arena.h"

enum { TICKS_AT_ONCE = 64 };

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

struct sqlite3 *tl_history_database(tl_history *history) {
    return history->database;
}

static tl_status fail_memory(tl_error *error) {
    return tl_fail(error, TL_TRY_AGAIN, "out of memory while reading the database");
}

static const char *file_of(tl_history *history) {
    return sqlite3_db_filename(history->database, "main");
}

/* ---- Runs, signals, configurations ------------------------------------------------------------------------------- */

/* A copy of a column's text; NULL where it is NULL, or memory is out. */
static const char *text_of(tl_history *history, sqlite3_stmt *row, int column) {
    const unsigned char *text = sqlite3_column_text(row, column);
    return text == NULL ? NULL : tl_arena_text(&history->arena, (const char *)text);
}

static uint64_t count_of(sqlite3_stmt *row, int column) {
    sqlite3_int64 value = sqlite3_column_int64(row, column);
    return value < 0 ? 0 : (uint64_t)value;
}

/* False where the row cannot be one that the recorder wrote. Damaged counts must not lead beyond all ticks. */
static bool read_run(tl_history *history, sqlite3_stmt *row, tl_history_run *run) {
    run->run = sqlite3_column_int64(row, 0);
    run->verb = text_of(history, row, 1);
    run->name = text_of(history, row, 2);
    run->version = text_of(history, row, 3);
    run->configuration_hash = text_of(history, row, 4);
    run->started = text_of(history, row, 5);
    run->ended = text_of(history, row, 6);
    run->ended_reason = text_of(history, row, 7);
    run->committed = text_of(history, row, 8);
    run->step = sqlite3_column_int64(row, 9);
    run->prediction = (uint32_t)sqlite3_column_int64(row, 10);
    run->measurements = tl_measurements_named((const char *)sqlite3_column_text(row, 11));
    run->samples = count_of(row, 12);
    run->steps = count_of(row, 13);
    run->events = count_of(row, 14);
    run->lost = count_of(row, 15);
    run->removed_before = (int64_t)count_of(row, 16);
    sqlite3_int64 lead = sqlite3_column_int64(row, 17);
    run->lead = (uint32_t)lead;
    run->fmus = text_of(history, row, 18);
    run->boot = text_of(history, row, 19);
    run->has_start = sqlite3_column_type(row, 20) != SQLITE_NULL;
    run->start = sqlite3_column_int64(row, 20);
    run->fmus = run->fmus == NULL ? "" : run->fmus;
    run->boot = run->boot == NULL ? "" : run->boot;
    run->resumption = (tl_resumption){
        .from = tl_resumed_from_named((const char *)sqlite3_column_text(row, 23)),
        .run = sqlite3_column_int64(row, 21),
        .tick = sqlite3_column_int64(row, 22),
    };
    run->committed = run->committed == NULL ? run->started : run->committed;
    return run->verb != NULL && run->name != NULL && run->version != NULL && run->configuration_hash != NULL &&
           run->started != NULL && run->step > 0 && lead >= 0 && lead <= INT32_MAX;
}

static tl_status count_rows(tl_history *history, sqlite3_stmt *statement, size_t *count, tl_error *error) {
    int code = SQLITE_ROW;
    *count = 0;
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
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
            return tl_fail(error, TL_BAD_DATA, "%s: is damaged: run %lld is incomplete", file_of(history),
                           (long long)read[done].run);
        }
        done++;
    }
    *runs = read;
    *count = done;
    return code == SQLITE_DONE || code == SQLITE_ROW ? TL_OK : tl_database_fail(history->database, code, error);
}

#define RUN_COLUMNS                                                                                                    \
    "SELECT run, verb, name, version, configuration, started, ended, ended_reason, committed, step_ns, prediction,"    \
    " measurements, samples_written, steps_written, events_written, entries_lost, removed_before, lead,"               \
    " fmus, boot, start_ns, resumed_run, resumed_tick, resumed_from FROM runs LEFT JOIN beginnings USING (run) "

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

tl_status tl_history_configuration(tl_history *history, const tl_history_run *run, const char **text, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status =
        tl_database_prepare(history->database, "SELECT text FROM configurations WHERE hash = ?1", &statement, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_text(statement, 1, run->configuration_hash, -1, SQLITE_STATIC);
        int code = sqlite3_step(statement);
        *text = code == SQLITE_ROW ? text_of(history, statement, 0) : NULL;
        if (code == SQLITE_DONE || (code == SQLITE_ROW && *text == NULL)) {
            status = tl_fail(error, TL_BAD_DATA, "%s: is damaged: the configuration of run %lld is missing",
                             file_of(history), (long long)run->run);
        } else if (code != SQLITE_ROW) {
            status = tl_database_fail(history->database, code, error);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

static tl_type type_named(const char *name) {
    int type = TL_REAL;
    while (type < TL_ENUMERATION && (name == NULL || strcmp(name, tl_type_name((tl_type)type)) != 0)) {
        type++;
    }
    return (tl_type)type;
}

/* Rows are in the order of their indices; an index that is missing is damage. */
static tl_status read_signals(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement, size_t most,
                              const tl_recorder_signal **signals, size_t *count, tl_error *error) {
    tl_recorder_signal *read = tl_arena_take(&history->arena, most, sizeof *read);
    int code = SQLITE_ROW;
    *count = 0;
    if (read == NULL) {
        return fail_memory(error);
    }
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        const char *name = text_of(history, statement, 1);
        const char *unit = text_of(history, statement, 2);
        if (sqlite3_column_int64(statement, 0) != (sqlite3_int64)*count || *count >= most || name == NULL ||
            unit == NULL) {
            return tl_fail(error, TL_BAD_DATA, "%s: is damaged: the signals of run %lld are incomplete",
                           file_of(history), (long long)run->run);
        }
        read[*count].name = name;
        read[*count].unit = unit;
        read[*count].type = type_named((const char *)sqlite3_column_text(statement, 3));
        read[*count].to = text_of(history, statement, 4);
        (*count)++;
    }
    *signals = read;
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

static bool read_component(tl_history *history, sqlite3_stmt *row, tl_history_component *component) {
    component->name = text_of(history, row, 0);
    component->counts = (tl_recorder_component){
        .plain = count_of(row, 1),
        .predicted = count_of(row, 2),
        .executions = count_of(row, 3),
        .caught_up = count_of(row, 4),
        .unstored = count_of(row, 5),
    };
    return component->name != NULL;
}

static tl_status read_ledger(tl_history *history, const tl_history_run *run, sqlite3_stmt *statement,
                             const tl_history_component **components, size_t *count, tl_error *error) {
    tl_history_component *read = tl_arena_take(&history->arena, TL_RECORDER_COMPONENTS, sizeof *read);
    int code = SQLITE_DONE;
    *count = 0;
    if (read == NULL) {
        return fail_memory(error);
    }
    while (*count < TL_RECORDER_COMPONENTS && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        if (!read_component(history, statement, &read[(*count)++])) {
            return tl_fail(error, TL_BAD_DATA, "%s: is damaged: a component of run %lld has no name", file_of(history),
                           (long long)run->run);
        }
    }
    *components = read;
    return code == SQLITE_DONE || code == SQLITE_ROW ? TL_OK : tl_database_fail(history->database, code, error);
}

tl_status tl_history_ledger(tl_history *history, const tl_history_run *run, const tl_history_component **components,
                            size_t *count, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(history->database,
                                           "SELECT name, plain, predicted, executions, caught_up, unstored"
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

static tl_status read_checkpoint(tl_history *history, sqlite3_stmt *row, const tl_history_checkpoint **checkpoint,
                                 tl_error *error) {
    char digest[TL_SHA256_TEXT];
    tl_history_checkpoint *read = tl_arena_take(&history->arena, 1, sizeof *read);
    const void *bytes = sqlite3_column_blob(row, 3);
    size_t size = (size_t)sqlite3_column_bytes(row, 3);
    unsigned char *copy = tl_arena_take(&history->arena, size, 1);
    const char *format = text_of(history, row, 1);
    const char *expected = (const char *)sqlite3_column_text(row, 2);
    if (read == NULL || copy == NULL) {
        return fail_memory(error);
    }
    if (size != 0) {
        memcpy(copy, bytes, size);
    }
    tl_sha256(copy, size, digest);
    *read = (tl_history_checkpoint){
        .tick = sqlite3_column_int64(row, 0),
        .format = format == NULL ? "" : format,
        .bytes = copy,
        .size = size,
        .whole = expected != NULL && strcmp(expected, digest) == 0,
    };
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
            status = read_checkpoint(history, statement, checkpoint, error);
        } else if (code != SQLITE_DONE) {
            status = tl_database_fail(history->database, code, error);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* The one number that a question about a run gives; `otherwise` where it is NULL, or cannot be read. */
static int64_t ask_number(tl_history *history, const tl_history_run *run, const char *sql, int64_t otherwise) {
    sqlite3_stmt *statement = NULL;
    int64_t number = otherwise;
    if (sqlite3_prepare_v2(history->database, sql, -1, &statement, NULL) == SQLITE_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        if (sqlite3_step(statement) == SQLITE_ROW && sqlite3_column_type(statement, 0) == SQLITE_INTEGER) {
            number = sqlite3_column_int64(statement, 0);
        }
    }
    (void)sqlite3_finalize(statement);
    return number;
}

tl_time tl_history_execution_cost(tl_history *history, const tl_history_run *run) {
    return ask_number(history, run,
                      "SELECT sum(used_ns) / max(sum(executions), 1) FROM (SELECT used_ns, executions FROM steps"
                      " WHERE run = ?1 AND used_ns > 0 ORDER BY step DESC LIMIT 1000)",
                      0);
}

int64_t tl_history_last_step(tl_history *history, const tl_history_run *run) {
    return ask_number(history, run, "SELECT max(step) FROM steps WHERE run = ?1", -1);
}

/* ---- Ticks ------------------------------------------------------------------------------------------------------- */

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
        status = tl_database_prepare(
            history->database,
            "SELECT step, outcome, stop, evaluations, flags, J_nominal IS NULL, executions FROM steps"
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

/* False where there is none, or where it cannot be read. */
static bool ask_tick(tl_history *history, const tl_history_run *run, const char *sql, int64_t *tick) {
    sqlite3_stmt *statement = NULL;
    bool found = false;
    if (sqlite3_prepare_v2(history->database, sql, -1, &statement, NULL) == SQLITE_OK) {
        (void)sqlite3_bind_int64(statement, 1, run->run);
        found = sqlite3_step(statement) == SQLITE_ROW;
        *tick = found ? sqlite3_column_int64(statement, 0) : 0;
    }
    (void)sqlite3_finalize(statement);
    return found;
}

bool tl_history_ticks_range(const tl_history_ticks *ticks, int64_t *first, int64_t *last) {
    return ask_tick(ticks->history, ticks->run, "SELECT tick FROM samples WHERE run = ?1 ORDER BY tick LIMIT 1",
                    first) &&
           ask_tick(ticks->history, ticks->run, "SELECT tick FROM samples WHERE run = ?1 ORDER BY tick DESC LIMIT 1",
                    last);
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
    return tl_fail(error, TL_BAD_DATA, "%s: is damaged: %s %lld of run %lld is none that the recorder writes",
                   file_of(ticks->history), what, (long long)number, (long long)ticks->run->run);
}

/* One row: one signal of one tick. A value that is missing was no number. */
static bool add_sample(tl_history_ticks *ticks, sqlite3_stmt *row) {
    int64_t number = sqlite3_column_int64(row, 0);
    int64_t signal = sqlite3_column_int64(row, 1);
    int64_t quality = sqlite3_column_int64(row, 3);
    bool missing = sqlite3_column_type(row, 2) == SQLITE_NULL;
    if (signal < 0 || (size_t)signal >= ticks->signals || quality < TL_GOOD || quality > TL_OUTLIER) {
        return false;
    }
    if (ticks->count == 0 || ticks->buffer[ticks->count - 1].sample.tick != number) {
        begin_tick(&ticks->buffer[ticks->count++], number);
    }
    tl_sample *sample = &ticks->buffer[ticks->count - 1].sample;
    sample->values[signal] = sqlite3_column_double(row, 2);
    sample->quality[signal] = (uint8_t)(missing && quality == TL_GOOD ? TL_NOT_A_NUMBER : quality);
    if (sqlite3_column_type(row, 4) != SQLITE_NULL) {
        sample->stamps[signal] = sqlite3_column_int64(row, 4);
    }
    return true;
}

static tl_status read_samples(tl_history_ticks *ticks, int64_t first, tl_error *error) {
    int code = SQLITE_ROW;
    tl_status status = TL_OK;
    bind_range(ticks->samples, ticks->run->run, first, first + TICKS_AT_ONCE);
    while (status == TL_OK && (code = sqlite3_step(ticks->samples)) == SQLITE_ROW) {
        if (!add_sample(ticks, ticks->samples)) {
            status = fail_damaged(ticks, "the sample of tick", sqlite3_column_int64(ticks->samples, 0), error);
        }
    }
    if (status == TL_OK && code != SQLITE_DONE) {
        status = tl_database_fail(ticks->history->database, code, error);
    }
    (void)sqlite3_reset(ticks->samples);
    return status;
}

/* An older program did not say it: there it was so where nothing is known of nominal. */
static uint32_t read_flags(sqlite3_stmt *row, int64_t outcome, int64_t stop) {
    if (sqlite3_column_type(row, 4) != SQLITE_NULL) {
        return (uint32_t)sqlite3_column_int64(row, 4);
    }
    bool unknown = sqlite3_column_int64(row, 5) != 0;
    return stop == TL_STOP_TIME && outcome == TL_NOMINAL && unknown ? TL_FLAG_WITHOUT_NOMINAL : 0;
}

/* One row: one step. Ticks and steps are both in order, so the search goes on from `*from`. */
static bool add_step(tl_history_ticks *ticks, sqlite3_stmt *row, size_t *from) {
    int64_t step = sqlite3_column_int64(row, 0);
    int64_t outcome = sqlite3_column_int64(row, 1);
    int64_t stop = sqlite3_column_int64(row, 2);
    if (outcome < TL_FREE || outcome >= TL_OUTCOMES || stop < TL_STOP_NONE || stop > TL_STOP_TIME) {
        return false;
    }
    int64_t number = step + ticks->run->lead;
    while (*from < ticks->count && ticks->buffer[*from].sample.tick < number) {
        (*from)++;
    }
    if (*from < ticks->count && ticks->buffer[*from].sample.tick == number) {
        tl_history_tick *tick = &ticks->buffer[*from];
        tick->has_step = true;
        tick->step = step;
        tick->outcome = (tl_outcome)outcome;
        tick->stop = (tl_stop)stop;
        tick->evaluations = (uint32_t)sqlite3_column_int64(row, 3);
        tick->executions = (uint64_t)sqlite3_column_int64(row, 6);
        tick->flags = read_flags(row, outcome, stop);
    }
    return true;
}

static tl_status read_steps(tl_history_ticks *ticks, int64_t first, tl_error *error) {
    int code = SQLITE_ROW;
    tl_status status = TL_OK;
    size_t from = 0;
    int64_t first_step = first - ticks->run->lead;
    bind_range(ticks->steps, ticks->run->run, first_step, first_step + TICKS_AT_ONCE);
    while (status == TL_OK && (code = sqlite3_step(ticks->steps)) == SQLITE_ROW) {
        if (!add_step(ticks, ticks->steps, &from)) {
            status = fail_damaged(ticks, "step", sqlite3_column_int64(ticks->steps, 0), error);
        }
    }
    if (status == TL_OK && code != SQLITE_DONE) {
        status = tl_database_fail(ticks->history->database, code, error);
    }
    (void)sqlite3_reset(ticks->steps);
    return status;
}

/* The signals of a step come in their order; what is not a number ends the row. */
static void add_adjustment(tl_history_ticks *ticks, sqlite3_stmt *row, size_t *from) {
    int64_t number = sqlite3_column_int64(row, 0) + ticks->run->lead;
    int64_t signal = sqlite3_column_int64(row, 1);
    while (*from < ticks->count && ticks->buffer[*from].sample.tick < number) {
        (*from)++;
    }
    if (*from == ticks->count || ticks->buffer[*from].sample.tick != number) {
        return;
    }
    tl_history_tick *tick = &ticks->buffer[*from];
    if (tick->adjusted < TL_MAX_ADJUST && signal == (int64_t)tick->adjusted &&
        sqlite3_column_type(row, 2) != SQLITE_NULL) {
        tick->u[tick->adjusted++] = sqlite3_column_double(row, 2);
    }
}

static tl_status read_adjustments(tl_history_ticks *ticks, int64_t first, tl_error *error) {
    int code = SQLITE_ROW;
    size_t from = 0;
    int64_t first_step = first - ticks->run->lead;
    bind_range(ticks->adjustments, ticks->run->run, first_step, first_step + TICKS_AT_ONCE);
    while ((code = sqlite3_step(ticks->adjustments)) == SQLITE_ROW) {
        add_adjustment(ticks, ticks->adjustments, &from);
    }
    (void)sqlite3_reset(ticks->adjustments);
    return code == SQLITE_DONE ? TL_OK : tl_database_fail(ticks->history->database, code, error);
}

/* Fills the buffer, from the first tick that is there, in one transaction. */
static tl_status read_ticks(tl_history_ticks *ticks, tl_error *error) {
    sqlite3 *database = ticks->history->database;
    ticks->count = 0;
    ticks->given = 0;
    tl_status status = tl_database_execute(database, "BEGIN", error);
    if (status != TL_OK) {
        return status;
    }
    bind_range(ticks->first_sample, ticks->run->run, ticks->next, 0);
    int code = sqlite3_step(ticks->first_sample);
    int64_t first = code == SQLITE_ROW ? sqlite3_column_int64(ticks->first_sample, 0) : 0;
    if (code != SQLITE_ROW && code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_reset(ticks->first_sample);
    if (status == TL_OK && first > INT64_MAX / 4) {
        status = fail_damaged(ticks, "the sample of tick", first, error);
    }
    if (status == TL_OK && code == SQLITE_ROW) {
        status = read_samples(ticks, first, error);
    }
    if (status == TL_OK && code == SQLITE_ROW) {
        status = read_steps(ticks, first, error);
    }
    if (status == TL_OK && code == SQLITE_ROW) {
        status = read_adjustments(ticks, first, error);
    }
    if (status == TL_OK && ticks->count > 0) {
        ticks->next = ticks->buffer[ticks->count - 1].sample.tick + 1;
    }
    (void)sqlite3_exec(database, "COMMIT", NULL, NULL, NULL);
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
    ticks->next = tick;
    ticks->count = 0;
    ticks->given = 0;
}
