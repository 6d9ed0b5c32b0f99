/* The SQL of writing: one prepared statement per table, one transaction per batch. */
#include "firmware/record/recorder_database.h"

#include <assert.h>
#include <limits.h>
#include <math.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/base/sha256.h"
#include "firmware/config/measurements.h"
#include "firmware/database/database.h"
#include "firmware/database/database_sql.h"
#include "firmware/record/recorder_lock.h"
#include "firmware/record/recorder_retention.h"
#include "firmware/text/json_text.h"
#include "firmware/text/utc.h"

#ifndef TL_VERSION
#define TL_VERSION "unknown"
#endif

enum { BUSY_OPEN_MS = 2000, BUSY_RUNNING_MS = 100, CACHE_KIB = 1024 };

typedef enum statement {
    BEGIN,
    COMMIT,
    ROLLBACK,
    START,
    BEGINNING,
    CHECKPOINT,
    OLD_CHECKPOINTS,
    SAMPLE,
    STEP,
    OUTPUT,
    ADJUSTMENT,
    EVENT,
    COMPONENT,
    TOTALS,
    END,
    STATEMENTS
} statement;

/* OR REPLACE: a tick that comes twice is a bug of the caller, but must not stop the record for ever. */
static const char *const sql_of[STATEMENTS] = {
    [BEGIN] = "BEGIN IMMEDIATE",
    [COMMIT] = "COMMIT",
    [ROLLBACK] = "ROLLBACK",
    [START] = "UPDATE runs SET started = ?2 WHERE run = ?1",
    [BEGINNING] = "UPDATE beginnings SET start_ns = ?2, resumed_run = ?3, resumed_tick = ?4, resumed_from = ?5"
                  " WHERE run = ?1",
    [CHECKPOINT] = "INSERT OR REPLACE INTO checkpoints (run, tick, format, sha256, bytes) VALUES (?1, ?2, ?3, ?4, ?5)",
    /* But the two newest, and what the run began with. */
    [OLD_CHECKPOINTS] = "DELETE FROM checkpoints WHERE run = ?1"
                        " AND tick NOT IN (SELECT tick FROM checkpoints WHERE run = ?1 ORDER BY tick DESC LIMIT 2)"
                        " AND tick >= (SELECT coalesce(resumed_tick, 0) FROM beginnings WHERE run = ?1)",
    [SAMPLE] = "INSERT OR REPLACE INTO samples (run, tick, signal, value, quality, stamp_ns)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [STEP] = "INSERT OR REPLACE INTO steps (run, step, t_ns, outcome, stop, J, J_nominal, evaluations, executions,"
             " used_ns, predicted, flags, held) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13)",
    [OUTPUT] = "INSERT OR REPLACE INTO outputs (run, step, signal, y, y_hat, quality) VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [ADJUSTMENT] = "INSERT OR REPLACE INTO adjustments (run, step, signal, u, u_hat) VALUES (?1, ?2, ?3, ?4, ?5)",
    [EVENT] = "INSERT INTO events (run, at, tick, severity, source, text) VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [COMPONENT] = "UPDATE components SET plain = ?3, predicted = ?4, executions = ?5, caught_up = ?6, unstored = ?7"
                  " WHERE run = ?1 AND component = ?2",
    [TOTALS] = "UPDATE runs SET samples_written = ?2, steps_written = ?3, events_written = ?4, entries_lost = ?5,"
               " committed = ?6 WHERE run = ?1",
    [END] = "UPDATE runs SET ended = committed, ended_reason = ?2 WHERE run = ?1",
};

struct tl_recorder_database {
    char path[PATH_MAX];
    tl_recorder_lock lock;
    sqlite3 *connection;
    sqlite3_stmt *statements[STATEMENTS];
    tl_recorder_retention retention;
    tl_recorder_shape shape;
    tl_time step;
    int64_t run;
    char format[128]; /* of checkpoints */
    bool has_ledger;  /* a step of this batch has brought one */
    tl_recorder_component ledger[TL_RECORDER_COMPONENTS];
};

/* ---- Statements -------------------------------------------------------------------------------------------------- */

static int run_statement(sqlite3_stmt *prepared) {
    int code = sqlite3_step(prepared);
    (void)sqlite3_reset(prepared);
    return code == SQLITE_DONE || code == SQLITE_ROW ? SQLITE_OK : code;
}

/* Infinite and NaN values never enter a database. */
static void bind_number(sqlite3_stmt *prepared, int index, double value) {
    if (isfinite(value)) {
        (void)sqlite3_bind_double(prepared, index, value);
    } else {
        (void)sqlite3_bind_null(prepared, index);
    }
}

/* Bytes at the beginning that are UTF-8. */
static size_t whole_text(const char *text, size_t size) {
    size_t good = 0;
    size_t length = 1;
    while (good < size && length > 0) {
        length = tl_utf8_length(text + good, size - good);
        good += length;
    }
    return good;
}

/* What is no character becomes "?". */
static void repair(char *text) {
    const size_t size = strlen(text);
    for (size_t good = whole_text(text, size); good < size; good += whole_text(text + good, size - good)) {
        text[good] = '?';
    }
}

/* Valid until the statement has run. One text that is none makes the whole database one that is damaged: texts come from anywhere, and were cut. */
static void bind_text(sqlite3_stmt *prepared, int index, const char *text) {
    if (text == NULL || whole_text(text, strlen(text)) == strlen(text)) {
        (void)sqlite3_bind_text(prepared, index, text, -1, SQLITE_STATIC);
        return;
    }
    char *repaired = sqlite3_mprintf("%s", text);
    if (repaired != NULL) {
        repair(repaired);
    }
    (void)sqlite3_bind_text(prepared, index, repaired, -1, sqlite3_free);
}

/* ---- A batch ----------------------------------------------------------------------------------------------------- */

int64_t tl_recorder_database_run(const tl_recorder_database *database) {
    return database->run;
}

size_t tl_recorder_database_batch(const tl_recorder_database *database) {
    return tl_recorder_retention_batch(&database->retention);
}

/* SQLite would go on writing into a file that no longer has a name. */
static int check_place(const tl_recorder_database *database) {
    int moved = 0;
    (void)sqlite3_file_control(database->connection, "main", SQLITE_FCNTL_HAS_MOVED, &moved);
    return moved != 0 ? SQLITE_READONLY_DBMOVED : SQLITE_OK;
}

int tl_recorder_database_begin(tl_recorder_database *database, size_t bytes) {
    int code = check_place(database);
    database->has_ledger = false;
    if (code == SQLITE_OK) {
        code = tl_recorder_retention_make_room(&database->retention, bytes);
    }
    return code == SQLITE_OK ? run_statement(database->statements[BEGIN]) : code;
}

static int write_resumption(tl_recorder_database *database, const tl_resumption *beginning) {
    sqlite3_stmt *prepared = database->statements[BEGINNING];
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, beginning->start);
    if (beginning->from != TL_RESUMED_NOT) {
        (void)sqlite3_bind_int64(prepared, 3, beginning->run);
        (void)sqlite3_bind_int64(prepared, 4, beginning->tick);
        bind_text(prepared, 5, tl_resumed_from_name(beginning->from));
    }
    return run_statement(prepared);
}

static int write_start(tl_recorder_database *database, const tl_resumption *beginning) {
    char text[TL_UTC_TEXT];
    sqlite3_stmt *prepared = database->statements[START];
    tl_utc_text(beginning->started, text);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    bind_text(prepared, 2, text);
    int code = run_statement(prepared);
    return code == SQLITE_OK ? write_resumption(database, beginning) : code;
}

int tl_recorder_database_checkpoint(tl_recorder_database *database, const tl_recorder_checkpoint *checkpoint) {
    char digest[TL_SHA256_TEXT];
    sqlite3_stmt *prepared = database->statements[CHECKPOINT];
    tl_sha256(checkpoint->bytes, checkpoint->size, digest);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, checkpoint->tick);
    bind_text(prepared, 3, database->format);
    bind_text(prepared, 4, digest);
    (void)sqlite3_bind_blob64(prepared, 5, checkpoint->bytes, checkpoint->size, SQLITE_STATIC);
    int code = run_statement(prepared);
    (void)sqlite3_clear_bindings(prepared);
    if (code == SQLITE_OK) {
        prepared = database->statements[OLD_CHECKPOINTS];
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        code = run_statement(prepared);
    }
    return code;
}

size_t tl_recorder_database_most(const tl_recorder_database *database) {
    return (size_t)database->retention.log_limit;
}

static int write_sample(tl_recorder_database *database, const tl_sample *sample) {
    sqlite3_stmt *prepared = database->statements[SAMPLE];
    int code = SQLITE_OK;
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, sample->tick);
    for (size_t i = 0; i < database->shape.plant && code == SQLITE_OK; i++) {
        (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)i);
        bind_number(prepared, 4, sample->values[i]);
        (void)sqlite3_bind_int(prepared, 5, sample->quality[i]);
        if (sample->stamps[i] == TL_TIME_NEVER) {
            (void)sqlite3_bind_null(prepared, 6);
        } else {
            (void)sqlite3_bind_int64(prepared, 6, sample->stamps[i]);
        }
        code = run_statement(prepared);
    }
    return code;
}

static int write_head(tl_recorder_database *database, const tl_record *record) {
    sqlite3_stmt *prepared = database->statements[STEP];
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, record->step);
    (void)sqlite3_bind_int64(prepared, 3, tl_time_of_step(0, database->step, record->step + 1));
    (void)sqlite3_bind_int(prepared, 4, (int)record->outcome);
    (void)sqlite3_bind_int(prepared, 5, (int)record->stop);
    bind_number(prepared, 6, record->objective);
    bind_number(prepared, 7, record->objective_nominal);
    (void)sqlite3_bind_int64(prepared, 8, record->evaluations);
    (void)sqlite3_bind_int64(prepared, 9, record->executions);
    (void)sqlite3_bind_int64(prepared, 10, record->used);
    (void)sqlite3_bind_int64(prepared, 11, record->predicted);
    (void)sqlite3_bind_int64(prepared, 12, record->flags);
    (void)sqlite3_bind_int64(prepared, 13, record->held);
    return run_statement(prepared);
}

static int write_step(tl_recorder_database *database, const tl_record *record) {
    int code = write_head(database, record);
    sqlite3_stmt *prepared = database->statements[OUTPUT];
    for (size_t i = 0; i < database->shape.match && code == SQLITE_OK; i++) {
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        (void)sqlite3_bind_int64(prepared, 2, record->step);
        (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)i);
        bind_number(prepared, 4, record->y[i]);
        bind_number(prepared, 5, record->y_hat[i]);
        (void)sqlite3_bind_int(prepared, 6, record->y_hat_quality[i]);
        code = run_statement(prepared);
    }
    prepared = database->statements[ADJUSTMENT];
    for (size_t i = 0; i < database->shape.adjust && code == SQLITE_OK; i++) {
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        (void)sqlite3_bind_int64(prepared, 2, record->step);
        (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)i);
        bind_number(prepared, 4, record->u[i]);
        bind_number(prepared, 5, record->u_hat[i]);
        code = run_statement(prepared);
    }
    return code;
}

/* Written with the batch: the ledger of its last step. */
static void keep_ledger(tl_recorder_database *database, const tl_recorder_component *ledger) {
    database->has_ledger = true;
    memcpy(database->ledger, ledger, database->shape.components * sizeof *ledger);
}

static int write_ledger(tl_recorder_database *database) {
    sqlite3_stmt *prepared = database->statements[COMPONENT];
    int code = SQLITE_OK;
    for (size_t i = 0; database->has_ledger && i < database->shape.components && code == SQLITE_OK; i++) {
        const tl_recorder_component *component = &database->ledger[i];
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        (void)sqlite3_bind_int64(prepared, 2, (sqlite3_int64)i);
        (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)component->plain);
        (void)sqlite3_bind_int64(prepared, 4, (sqlite3_int64)component->predicted);
        (void)sqlite3_bind_int64(prepared, 5, (sqlite3_int64)component->executions);
        (void)sqlite3_bind_int64(prepared, 6, (sqlite3_int64)component->caught_up);
        (void)sqlite3_bind_int64(prepared, 7, (sqlite3_int64)component->unstored);
        code = run_statement(prepared);
    }
    return code;
}

int tl_recorder_database_entry(tl_recorder_database *database, const tl_recorder_entry *entry) {
    switch (entry->kind) {
    case TL_ENTRY_START:
        return write_start(database, &entry->beginning);
    case TL_ENTRY_SAMPLE:
        return write_sample(database, &entry->sample);
    case TL_ENTRY_STEP:
        keep_ledger(database, entry->ledger);
        return write_step(database, &entry->record);
    }
    return SQLITE_INTERNAL;
}

int tl_recorder_database_event(tl_recorder_database *database, const tl_recorder_event_entry *event) {
    sqlite3_stmt *prepared = database->statements[EVENT];
    char at[TL_UTC_TEXT];
    tl_utc_text(event->at, at);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    bind_text(prepared, 2, at);
    if (event->tick >= 0) {
        (void)sqlite3_bind_int64(prepared, 3, event->tick);
    } else {
        (void)sqlite3_bind_null(prepared, 3);
    }
    (void)sqlite3_bind_int(prepared, 4, (int)event->severity);
    bind_text(prepared, 5, event->source);
    bind_text(prepared, 6, event->text);
    return run_statement(prepared);
}

static int write_totals(tl_recorder_database *database, const tl_recorder_totals *totals) {
    sqlite3_stmt *prepared = database->statements[TOTALS];
    char now[TL_UTC_TEXT];
    tl_utc_text(tl_utc_now(), now);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, (sqlite3_int64)totals->samples);
    (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)totals->steps);
    (void)sqlite3_bind_int64(prepared, 4, (sqlite3_int64)totals->events);
    (void)sqlite3_bind_int64(prepared, 5, (sqlite3_int64)totals->lost);
    bind_text(prepared, 6, now);
    return run_statement(prepared);
}

int tl_recorder_database_commit(tl_recorder_database *database, const tl_recorder_totals *totals) {
    int code = write_ledger(database);
    if (code == SQLITE_OK) {
        code = write_totals(database, totals);
    }
    return code == SQLITE_OK ? run_statement(database->statements[COMMIT]) : code;
}

void tl_recorder_database_rollback(tl_recorder_database *database) {
    if (sqlite3_get_autocommit(database->connection) == 0) {
        (void)run_statement(database->statements[ROLLBACK]);
    }
}

int tl_recorder_database_tidy(tl_recorder_database *database) {
    return tl_recorder_retention_tidy(&database->retention);
}

int tl_recorder_database_end(tl_recorder_database *database, const char *reason, const tl_recorder_totals *totals) {
    sqlite3_stmt *prepared = database->statements[END];
    int code = run_statement(database->statements[BEGIN]);
    if (code == SQLITE_OK) {
        code = write_totals(database, totals);
    }
    if (code == SQLITE_OK) {
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        bind_text(prepared, 2, reason);
        code = run_statement(prepared);
    }
    if (code == SQLITE_OK) {
        code = run_statement(database->statements[COMMIT]);
    }
    if (code != SQLITE_OK) {
        tl_recorder_database_rollback(database);
    }
    return code;
}

void tl_recorder_database_text(const tl_recorder_database *database, int code, char *text, size_t size) {
    tl_database_text(database->connection, code, text, size);
}

/* ---- Opening ----------------------------------------------------------------------------------------------------- */

/* One change with up to three parameters: integers are bound where the text is NULL. */
static tl_status change(sqlite3 *connection, const char *sql, int64_t first, const char *second, const char *third,
                        tl_error *error) {
    sqlite3_stmt *prepared = NULL;
    tl_status status = tl_database_prepare(connection, sql, &prepared, error);
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(prepared, 1, first);
        (void)sqlite3_bind_text(prepared, 2, second, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 3, third, -1, SQLITE_STATIC);
        int code = sqlite3_step(prepared);
        status = code == SQLITE_DONE ? TL_OK : tl_database_fail(connection, code, error);
    }
    (void)sqlite3_finalize(prepared);
    return status;
}

/* A database of an older program learns the names that came since. */
static tl_status write_names(sqlite3 *connection, tl_error *error) {
    tl_status status = TL_OK;
    for (int i = TL_FREE; i < TL_OUTCOMES && status == TL_OK; i++) {
        status = change(connection, "INSERT OR REPLACE INTO outcomes VALUES (?1, ?2)", i,
                        tl_outcome_name((tl_outcome)i), NULL, error);
    }
    for (int i = TL_STOP_NONE; i <= TL_STOP_TIME && status == TL_OK; i++) {
        status = change(connection, "INSERT OR REPLACE INTO stops VALUES (?1, ?2)", i, tl_stop_name((tl_stop)i), NULL,
                        error);
    }
    for (unsigned bit = TL_FLAG_FALLBACK; bit <= TL_LAST_FLAG && status == TL_OK; bit <<= 1) {
        status = change(connection, "INSERT OR REPLACE INTO flags VALUES (?1, ?2)", bit, tl_flag_name((tl_flag)bit),
                        NULL, error);
    }
    for (int i = TL_GOOD; i <= TL_OUTLIER && status == TL_OK; i++) {
        status = change(connection, "INSERT OR REPLACE INTO qualities VALUES (?1, ?2)", i,
                        tl_quality_name((tl_quality)i), NULL, error);
    }
    for (int i = TL_EVENT_INFO; i <= TL_EVENT_ERROR && status == TL_OK; i++) {
        status = change(connection, "INSERT OR REPLACE INTO severities VALUES (?1, ?2)", i,
                        tl_severity_name((tl_severity)i), NULL, error);
    }
    return status;
}

/* We have the writer's lock: a run without an end was killed. Its last commit was at most one interval after its last
 * step. */
static tl_status end_killed_runs(sqlite3 *connection, tl_error *error) {
    return tl_database_execute(connection,
                               "UPDATE runs SET ended = coalesce(committed, started),"
                               " ended_reason = 'not ended cleanly' WHERE ended IS NULL",
                               error);
}

static tl_status write_run(tl_recorder_database *database, const tl_recorder_settings *settings, const char *hash,
                           tl_error *error) {
    static const char sql[] = "INSERT INTO runs (verb, name, version, configuration, started, committed, step_ns,"
                              " prediction, measurements, lead) VALUES (?1, ?2, ?3, ?4, ?5, ?5, ?6, ?7, ?8, ?9)";
    sqlite3_stmt *prepared = NULL;
    char now[TL_UTC_TEXT];
    tl_status status = tl_database_prepare(database->connection, sql, &prepared, error);
    if (status != TL_OK) {
        return status;
    }
    tl_utc_text(tl_utc_now(), now);
    bind_text(prepared, 1, settings->verb);
    bind_text(prepared, 2, settings->name);
    bind_text(prepared, 3, TL_VERSION);
    bind_text(prepared, 4, hash);
    bind_text(prepared, 5, now);
    (void)sqlite3_bind_int64(prepared, 6, settings->step);
    (void)sqlite3_bind_int64(prepared, 7, settings->prediction);
    bind_text(prepared, 8, tl_measurements_name(settings->measurements));
    (void)sqlite3_bind_int64(prepared, 9, settings->lead);
    int code = sqlite3_step(prepared);
    if (code != SQLITE_DONE) {
        status = tl_database_fail(database->connection, code, error);
    }
    (void)sqlite3_finalize(prepared);
    database->run = sqlite3_last_insert_rowid(database->connection);
    return status;
}

static tl_status write_signals(const tl_recorder_database *database, const char *kind,
                               const tl_recorder_signal *signals, size_t count, tl_error *error) {
    static const char sql[] = "INSERT INTO signals (run, kind, signal, name, unit, type, compared_with)"
                              " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
    sqlite3_stmt *prepared = NULL;
    tl_status status = tl_database_prepare(database->connection, sql, &prepared, error);
    for (size_t i = 0; i < count && status == TL_OK; i++) {
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        bind_text(prepared, 2, kind);
        (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)i);
        bind_text(prepared, 4, signals[i].name);
        bind_text(prepared, 5, signals[i].unit);
        bind_text(prepared, 6, tl_type_name(signals[i].type));
        bind_text(prepared, 7, signals[i].to);
        int code = run_statement(prepared);
        status = code == SQLITE_OK ? TL_OK : tl_database_fail(database->connection, code, error);
    }
    (void)sqlite3_finalize(prepared);
    return status;
}

static tl_status write_components(const tl_recorder_database *database, const tl_recorder_settings *settings,
                                  tl_error *error) {
    static const char sql[] = "INSERT INTO components (run, component, name) VALUES (?1, ?2, ?3)";
    sqlite3_stmt *prepared = NULL;
    tl_status status = tl_database_prepare(database->connection, sql, &prepared, error);
    for (size_t i = 0; i < settings->component_count && status == TL_OK; i++) {
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        (void)sqlite3_bind_int64(prepared, 2, (sqlite3_int64)i);
        bind_text(prepared, 3, settings->components[i]);
        int code = run_statement(prepared);
        status = code == SQLITE_OK ? TL_OK : tl_database_fail(database->connection, code, error);
    }
    (void)sqlite3_finalize(prepared);
    return status;
}

static tl_status write_all_signals(const tl_recorder_database *database, const tl_recorder_settings *settings,
                                   tl_error *error) {
    tl_status status = write_signals(database, "plant", settings->plant, settings->plant_count, error);
    if (status == TL_OK) {
        status = write_signals(database, "match", settings->match, settings->match_count, error);
    }
    if (status == TL_OK) {
        status = write_signals(database, "adjust", settings->adjust, settings->adjust_count, error);
    }
    return status;
}

/* All rows that say what this run is, in one transaction. */
static tl_status begin_run(tl_recorder_database *database, const tl_recorder_settings *settings, tl_error *error) {
    char hash[TL_SHA256_TEXT];
    sqlite3 *connection = database->connection;
    tl_sha256(settings->configuration, strlen(settings->configuration), hash);
    tl_status status = tl_database_execute(connection, "BEGIN IMMEDIATE", error);
    if (status == TL_OK) {
        status = end_killed_runs(connection, error);
    }
    if (status == TL_OK) {
        status = write_names(connection, error);
    }
    if (status == TL_OK) {
        status = change(connection, "INSERT OR IGNORE INTO configurations (hash, text) VALUES (?2, ?3)", 0, hash,
                        settings->configuration, error);
    }
    if (status == TL_OK) {
        status = write_run(database, settings, hash, error);
    }
    if (status == TL_OK) {
        status =
            change(connection, "INSERT INTO beginnings (run, fmus, boot) VALUES (?1, ?2, ?3)", database->run,
                   settings->fmus != NULL ? settings->fmus : "", settings->boot != NULL ? settings->boot : "", error);
    }
    if (status == TL_OK) {
        status = write_all_signals(database, settings, error);
    }
    if (status == TL_OK) {
        status = write_components(database, settings, error);
    }
    return status == TL_OK ? tl_database_execute(connection, "COMMIT", error) : status;
}

/* WAL so that people can read while we write; FULL so that what is committed survives a power cut (with NORMAL the log
 * is only synced when it is written back). We write the log back ourselves, between batches. */
static tl_status configure(sqlite3 *connection, tl_error *error) {
    char sql[256];
    (void)snprintf(sql, sizeof sql,
                   "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA wal_autocheckpoint = 0;"
                   "PRAGMA cache_size = -%d;",
                   CACHE_KIB);
    return tl_database_execute(connection, sql, error);
}

static tl_status prepare_all(tl_recorder_database *database, tl_error *error) {
    tl_status status = TL_OK;
    for (int i = 0; i < STATEMENTS && status == TL_OK; i++) {
        status = tl_database_prepare(database->connection, sql_of[i], &database->statements[i], error);
    }
    return status;
}

static tl_status make_file(const char *path, tl_error *error) {
    struct stat file;
    return lstat(path, &file) == 0 ? TL_OK : tl_database_create(path, error);
}

static tl_status open_all(tl_recorder_database *database, const tl_recorder_settings *settings, tl_error *error) {
    tl_status status = make_file(database->path, error);
    if (status == TL_OK) {
        status = tl_database_open(database->path, true, &database->connection, error);
    }
    if (status == TL_OK) {
        (void)sqlite3_busy_timeout(database->connection, BUSY_OPEN_MS);
        status = configure(database->connection, error);
    }
    if (status == TL_OK) {
        int code = tl_recorder_retention_open(&database->retention, database->connection, settings->max_bytes);
        if (code == SQLITE_OK) {
            code = tl_recorder_retention_make_room(&database->retention, strlen(settings->configuration));
        }
        status = code == SQLITE_OK ? TL_OK : tl_database_fail(database->connection, code, error);
    }
    if (status == TL_OK) {
        status = begin_run(database, settings, error);
    }
    if (status == TL_OK) {
        database->retention.run = database->run;
        status = prepare_all(database, error);
        (void)sqlite3_busy_timeout(database->connection, BUSY_RUNNING_MS);
    }
    return status;
}

tl_status tl_recorder_database_open(const tl_recorder_settings *settings, tl_recorder_database **database,
                                    tl_error *error) {
    assert(settings->plant_count <= TL_MAX_SIGNALS && settings->match_count <= TL_MAX_MATCH &&
           settings->adjust_count <= TL_MAX_ADJUST && settings->component_count <= TL_RECORDER_COMPONENTS &&
           settings->step > 0);
    tl_recorder_database *opened = calloc(1, sizeof *opened);
    *database = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    opened->lock.file = -1;
    opened->step = settings->step;
    (void)snprintf(opened->format, sizeof opened->format, "%s", settings->format != NULL ? settings->format : "");
    opened->shape.plant = settings->plant_count;
    opened->shape.match = settings->match_count;
    opened->shape.adjust = settings->adjust_count;
    opened->shape.components = settings->component_count;
    tl_status status = tl_database_place(settings->path, opened->path, error);
    if (status == TL_OK) {
        status = tl_recorder_lock_take(opened->path, &opened->lock, error);
    }
    if (status == TL_OK) {
        status = open_all(opened, settings, error);
    }
    if (status != TL_OK) {
        tl_recorder_database_close(opened);
        return status;
    }
    *database = opened;
    return TL_OK;
}

void tl_recorder_database_close(tl_recorder_database *database) {
    if (database == NULL) {
        return;
    }
    for (int i = 0; i < STATEMENTS; i++) {
        (void)sqlite3_finalize(database->statements[i]);
    }
    tl_recorder_retention_close(&database->retention);
    (void)sqlite3_close(database->connection); /* writes the log back and removes it where nobody reads */
    tl_recorder_lock_release(&database->lock);
    free(database);
}
