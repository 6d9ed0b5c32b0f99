/* The recorder's database: tables, statements, the beginning of a run: see recorder_database.h. */
#include "firmware/store/recorder_database.h"

#include <assert.h>
#include <math.h>
#include <sqlite3.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/config/measurements.h"
#include "firmware/store/database_sql.h"
#include "firmware/store/outbox.h"
#include "firmware/store/recorder_retention.h"
#include "firmware/store/recorder_settings.h"
#include "master/base/text.h"

/* ---- The rows that say what a run is: its own, its configuration, signals and components.
 *
 * Purpose: what is written once, when a run begins, within a transaction of the caller's.
 * Trust:   the account may be that of a hostile twin: its texts are repaired, its counts bounded by the settings.
 * Errors:  SQLite's result codes; the connection has the words.
 * Thread:  the connection's.
 */

static int tl_recorder_beginning_write(sqlite3 *connection, const tl_recorder_settings *settings,
                                       const tl_outbox_start *start, int64_t began, int64_t *run);

static int tl_recorder_beginning_end_killed(sqlite3 *connection);

static void tl_recorder_beginning_repair(char *text);

/* ---- The SQL of writing: one prepared statement per table, one transaction per batch. */

typedef enum statement {
    BEGIN,
    COMMIT,
    ROLLBACK,
    FIND,
    START,
    BEGINNING,
    GO_ON,
    BEGIN_AT,
    CONFIGURATION,
    TUNING,
    TUNING_AGAIN,
    IS_CONFIGURATION,
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
    [FIND] = "SELECT samples_written, steps_written, events_written, entries_lost, committed FROM runs WHERE run = ?1",
    [START] = "UPDATE runs SET started = ?2 WHERE run = ?1",
    [BEGINNING] = "UPDATE beginnings SET start_ns = ?2, resumed_run = ?3, resumed_tick = ?4, resumed_from = ?5"
                  " WHERE run = ?1",
    [GO_ON] = "UPDATE runs SET ended = NULL, ended_reason = NULL"
              " WHERE run = ?1 AND ended_reason = 'not ended cleanly'",
    [BEGIN_AT] = "UPDATE runs SET removed_before = ?2 WHERE run = ?1",
    /* One that was not known when a run was begun with it is now. */
    [CONFIGURATION] = "INSERT INTO configurations (hash, text) VALUES (?1, ?2)"
                      " ON CONFLICT (hash) DO UPDATE SET text = excluded.text WHERE text = ''",
    [TUNING] = "INSERT OR REPLACE INTO tunings (run, tick, configuration, at, who, origin, why)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    /* As it was said before, by this run or one before it. */
    [TUNING_AGAIN] = "INSERT OR REPLACE INTO tunings (run, tick, configuration, at, who, origin, why)"
                     " SELECT ?1, ?2, ?3, at, who, origin, why FROM tunings WHERE configuration = ?3"
                     " ORDER BY run DESC, tick DESC LIMIT 1",
    [IS_CONFIGURATION] = "SELECT 1 FROM configurations WHERE hash = ?1",
    [CHECKPOINT] = "INSERT OR REPLACE INTO checkpoints (run, tick, format, sha256, bytes) VALUES (?1, ?2, ?3, ?4, ?5)",
    /* But the two newest, and what the run began with. */
    [OLD_CHECKPOINTS] = "DELETE FROM checkpoints WHERE run = ?1"
                        " AND tick NOT IN (SELECT tick FROM checkpoints WHERE run = ?1 ORDER BY tick DESC LIMIT 2)"
                        " AND tick >= (SELECT coalesce(resumed_tick, 0) FROM beginnings WHERE run = ?1)",
    [SAMPLE] = "INSERT OR REPLACE INTO samples (run, tick, signal, value, quality, stamp_ns)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [STEP] = "INSERT OR REPLACE INTO steps (run, step, t_ns, outcome, stop, J, J_nominal, evaluations, executions,"
             " used_ns, predicted, flags, held) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13)",
    [OUTPUT] = "INSERT OR REPLACE INTO outputs (run, step, signal, y, y_hat, quality, readings, squares, rejected)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)",
    [ADJUSTMENT] = "INSERT OR REPLACE INTO adjustments (run, step, signal, u, u_hat) VALUES (?1, ?2, ?3, ?4, ?5)",
    [EVENT] = "INSERT INTO events (run, at, tick, severity, source, text) VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [COMPONENT] = "UPDATE components SET plain = ?3, predicted = ?4, executions = ?5, caught_up = ?6, unstored = ?7"
                  " WHERE run = ?1 AND component = ?2",
    [TOTALS] = "UPDATE runs SET samples_written = ?2, steps_written = ?3, events_written = ?4, entries_lost = ?5,"
               " committed = ?6 WHERE run = ?1",
    [END] = "UPDATE runs SET ended = committed, ended_reason = ?2 WHERE run = ?1",
};

struct tl_recorder_database {
    sqlite3 *connection;
    const tl_recorder_settings *settings;
    sqlite3_stmt *statements[STATEMENTS];
    tl_recorder_retention retention;
    int64_t run;     /* of the batch */
    bool has_ledger; /* a step of this batch has brought one */
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

/* Nor what no history would take. */
static void bind_within(sqlite3_stmt *prepared, int index, int64_t least, int64_t value) {
    int64_t bound = value < least ? least : value;
    (void)sqlite3_bind_int64(prepared, index, bound > TL_ROW_LARGEST ? TL_ROW_LARGEST : bound);
}

static void bind_count(sqlite3_stmt *prepared, int index, uint64_t count) {
    (void)sqlite3_bind_int64(prepared, index, count > TL_ROW_LARGEST ? TL_ROW_LARGEST : (sqlite3_int64)count);
}

/* One text that is none would make the whole database one that is damaged: texts come from anywhere, and were cut. */
static void bind_text(sqlite3_stmt *prepared, int index, const char *text) {
    char *repaired = text == NULL ? NULL : sqlite3_mprintf("%s", text);
    if (repaired != NULL) {
        tl_recorder_beginning_repair(repaired);
    }
    (void)sqlite3_bind_text(prepared, index, repaired, -1, sqlite3_free);
}

/* ---- Configurations ---------------------------------------------------------------------------------------------- */

/* Whose text is known; NULL: it is not. */
static const tl_recorder_known *find_known(const tl_recorder_database *database, const tl_run_tuning *tuning) {
    const tl_recorder_settings *settings = database->settings;
    for (size_t i = 0; i < settings->known_count; i++) {
        const tl_recorder_known *known = &settings->known[i];
        if (tuning->hash[0] != '\0' && strcmp(known->hash, tuning->hash) == 0) {
            return known;
        }
    }
    return NULL;
}

static int write_configuration(tl_recorder_database *database, const char *hash, const char *text) {
    sqlite3_stmt *prepared = database->statements[CONFIGURATION];
    bind_text(prepared, 1, hash);
    bind_text(prepared, 2, text);
    return run_statement(prepared);
}

/* ---- A batch ----------------------------------------------------------------------------------------------------- */

size_t tl_recorder_database_batch(const tl_recorder_database *database) {
    return tl_recorder_retention_batch(&database->retention);
}

/* The last tick that a run of this step can have. */
static int64_t last_tick(const tl_recorder_database *database) {
    return TL_ROW_LARGEST / database->settings->step;
}

int tl_recorder_database_begin(tl_recorder_database *database, int64_t run, size_t bytes) {
    database->run = run;
    database->retention.run = run;
    database->has_ledger = false;
    int code = tl_recorder_retention_make_room(&database->retention, bytes);
    return code == SQLITE_OK ? run_statement(database->statements[BEGIN]) : code;
}

static int write_resumption(tl_recorder_database *database, const tl_resumption *beginning) {
    sqlite3_stmt *prepared = database->statements[BEGINNING];
    (void)sqlite3_clear_bindings(prepared);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    bind_within(prepared, 2, -TL_ROW_LARGEST, beginning->start);
    if (beginning->from != TL_RESUMED_NOT) {
        int64_t last = last_tick(database);
        bind_within(prepared, 3, 0, beginning->run);
        bind_within(prepared, 4, 0, beginning->tick < last ? beginning->tick : last);
        bind_text(prepared, 5, tl_resumed_from_name(beginning->from));
    }
    return run_statement(prepared);
}

/* When it began, and what it goes on with. */
static int write_start(tl_recorder_database *database, const tl_resumption *beginning) {
    char text[TL_UTC_TEXT];
    sqlite3_stmt *prepared = database->statements[START];
    tl_utc_text(beginning->started, text);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    bind_text(prepared, 2, text);
    int code = run_statement(prepared);
    return code == SQLITE_OK ? write_resumption(database, beginning) : code;
}

int tl_recorder_database_begin_run(tl_recorder_database *database, const tl_outbox_start *start, bool timed,
                                   int64_t *run) {
    const tl_recorder_known *known = find_known(database, &start->configured);
    int code =
        tl_recorder_beginning_write(database->connection, database->settings, start, tl_utc_now(), &database->run);
    if (code == SQLITE_OK && known != NULL) {
        code = write_configuration(database, known->hash, known->text);
    }
    *run = database->run;
    return code == SQLITE_OK && timed ? write_start(database, &start->resumption) : code;
}

int tl_recorder_database_go_on(tl_recorder_database *database) {
    (void)sqlite3_bind_int64(database->statements[GO_ON], 1, database->run);
    return run_statement(database->statements[GO_ON]);
}

int tl_recorder_database_give_up(tl_recorder_database *database) {
    return tl_recorder_beginning_end_killed(database->connection);
}

int tl_recorder_database_begin_at(tl_recorder_database *database, int64_t tick) {
    (void)sqlite3_bind_int64(database->statements[BEGIN_AT], 1, database->run);
    bind_within(database->statements[BEGIN_AT], 2, 0, tick);
    return run_statement(database->statements[BEGIN_AT]);
}

int tl_recorder_database_checkpoint(tl_recorder_database *database, int64_t tick, const unsigned char *bytes,
                                    size_t size) {
    char digest[TL_SHA256_TEXT];
    sqlite3_stmt *prepared = database->statements[CHECKPOINT];
    if (tick < 0 || tick > last_tick(database) || size > tl_recorder_retention_log(database->settings->max_bytes)) {
        return SQLITE_OK;
    }
    tl_sha256(bytes, size, digest);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, tick);
    bind_text(prepared, 3, database->settings->format != NULL ? database->settings->format : "");
    bind_text(prepared, 4, digest);
    (void)sqlite3_bind_blob64(prepared, 5, bytes, size, SQLITE_STATIC);
    int code = run_statement(prepared);
    (void)sqlite3_clear_bindings(prepared);
    if (code == SQLITE_OK) {
        prepared = database->statements[OLD_CHECKPOINTS];
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        code = run_statement(prepared);
    }
    return code;
}

static int write_sample(tl_recorder_database *database, const tl_sample *sample) {
    sqlite3_stmt *prepared = database->statements[SAMPLE];
    int code = SQLITE_OK;
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, sample->tick);
    for (size_t i = 0; i < database->settings->plant_count && code == SQLITE_OK; i++) {
        (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)i);
        bind_number(prepared, 4, sample->values[i]);
        (void)sqlite3_bind_int(prepared, 5, sample->quality[i]);
        if (sample->stamps[i] == TL_TIME_NEVER) {
            (void)sqlite3_bind_null(prepared, 6);
        } else {
            bind_within(prepared, 6, -TL_ROW_LARGEST, sample->stamps[i]);
        }
        code = run_statement(prepared);
    }
    return code;
}

static int write_head(tl_recorder_database *database, const tl_record *record) {
    sqlite3_stmt *prepared = database->statements[STEP];
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    (void)sqlite3_bind_int64(prepared, 2, record->step);
    (void)sqlite3_bind_int64(prepared, 3, tl_time_of_step(0, database->settings->step, record->step + 1));
    (void)sqlite3_bind_int(prepared, 4, (int)record->outcome);
    (void)sqlite3_bind_int(prepared, 5, (int)record->stop);
    bind_number(prepared, 6, record->objective);
    bind_number(prepared, 7, record->objective_nominal);
    (void)sqlite3_bind_int64(prepared, 8, record->evaluations);
    (void)sqlite3_bind_int64(prepared, 9, record->executions);
    bind_within(prepared, 10, 0, record->used);
    (void)sqlite3_bind_int64(prepared, 11, record->predicted);
    (void)sqlite3_bind_int64(prepared, 12, record->flags);
    (void)sqlite3_bind_int64(prepared, 13, record->held);
    return run_statement(prepared);
}

static int write_step(tl_recorder_database *database, const tl_record *record) {
    int code = write_head(database, record);
    sqlite3_stmt *prepared = database->statements[OUTPUT];
    for (size_t i = 0; i < database->settings->match_count && code == SQLITE_OK; i++) {
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        (void)sqlite3_bind_int64(prepared, 2, record->step);
        (void)sqlite3_bind_int64(prepared, 3, (sqlite3_int64)i);
        bind_number(prepared, 4, record->y[i]);
        bind_number(prepared, 5, record->y_hat[i]);
        (void)sqlite3_bind_int(prepared, 6, record->y_hat_quality[i]);
        (void)sqlite3_bind_int64(prepared, 7, record->readings[i].count);
        bind_number(prepared, 8, record->readings[i].squares);
        (void)sqlite3_bind_int64(prepared, 9, record->readings[i].rejected);
        code = run_statement(prepared);
    }
    prepared = database->statements[ADJUSTMENT];
    for (size_t i = 0; i < database->settings->adjust_count && code == SQLITE_OK; i++) {
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
    memcpy(database->ledger, ledger, database->settings->component_count * sizeof *ledger);
}

static int write_ledger(tl_recorder_database *database) {
    sqlite3_stmt *prepared = database->statements[COMPONENT];
    int code = SQLITE_OK;
    for (size_t i = 0; database->has_ledger && i < database->settings->component_count && code == SQLITE_OK; i++) {
        const tl_recorder_component *component = &database->ledger[i];
        (void)sqlite3_bind_int64(prepared, 1, database->run);
        (void)sqlite3_bind_int64(prepared, 2, (sqlite3_int64)i);
        bind_count(prepared, 3, component->plain);
        bind_count(prepared, 4, component->predicted);
        bind_count(prepared, 5, component->executions);
        bind_count(prepared, 6, component->caught_up);
        bind_count(prepared, 7, component->unstored);
        code = run_statement(prepared);
    }
    return code;
}

/* ---- Tunings ---- */

static void bind_tuning(sqlite3_stmt *prepared, int64_t run, const tl_run_tuning *tuning) {
    (void)sqlite3_bind_int64(prepared, 1, run);
    (void)sqlite3_bind_int64(prepared, 2, tuning->tick);
    bind_text(prepared, 3, tuning->hash);
}

/* With what is known of it; NULL: nothing but that it was taken. */
static int write_tuning_of(tl_recorder_database *database, const tl_run_tuning *tuning,
                           const tl_recorder_known *known) {
    char now[TL_UTC_TEXT];
    sqlite3_stmt *prepared = database->statements[TUNING];
    tl_utc_text(tl_utc_now(), now);
    bind_tuning(prepared, database->run, tuning);
    bind_text(prepared, 4, known != NULL && known->at != NULL ? known->at : now);
    bind_text(prepared, 5, known != NULL ? known->who : "");
    bind_text(prepared, 6, known != NULL ? known->origin : "");
    bind_text(prepared, 7, known != NULL ? known->why : "");
    return run_statement(prepared);
}

static int is_configuration(tl_recorder_database *database, const char *hash, bool *is) {
    sqlite3_stmt *prepared = database->statements[IS_CONFIGURATION];
    bind_text(prepared, 1, hash);
    int code = sqlite3_step(prepared);
    *is = code == SQLITE_ROW;
    (void)sqlite3_reset(prepared);
    return code == SQLITE_ROW || code == SQLITE_DONE ? SQLITE_OK : code;
}

/* As it was said before; else with nothing but that it was taken. */
static int write_tuning_again(tl_recorder_database *database, const tl_run_tuning *tuning) {
    bind_tuning(database->statements[TUNING_AGAIN], database->run, tuning);
    int code = run_statement(database->statements[TUNING_AGAIN]);
    bool done = sqlite3_changes(database->connection) > 0;
    return code != SQLITE_OK || done ? code : write_tuning_of(database, tuning, NULL);
}

/* A text that nobody has told us is none that a replay could follow. */
int tl_recorder_database_tuning(tl_recorder_database *database, const tl_run_tuning *tuning, bool *impossible) {
    const tl_recorder_known *known = find_known(database, tuning);
    bool is = known != NULL;
    int code =
        is ? write_configuration(database, known->hash, known->text) : is_configuration(database, tuning->hash, &is);
    *impossible = !is;
    if (code != SQLITE_OK || !is) {
        return code;
    }
    bool is_told = known != NULL && (known->number == 0 || known->number == tuning->number);
    return is_told ? write_tuning_of(database, tuning, known) : write_tuning_again(database, tuning);
}

static int64_t tick_of(const tl_recorder_entry *entry) {
    return entry->kind == TL_ENTRY_SAMPLE   ? entry->sample.tick
           : entry->kind == TL_ENTRY_TUNING ? entry->tuning.tick
                                            : entry->record.step;
}

int tl_recorder_database_entry(tl_recorder_database *database, const tl_recorder_entry *entry, bool *impossible) {
    int64_t tick = tick_of(entry);
    *impossible = tick < 0 || tick >= last_tick(database);
    if (*impossible) {
        return SQLITE_OK;
    }
    if (entry->kind == TL_ENTRY_SAMPLE) {
        return write_sample(database, &entry->sample);
    }
    if (entry->kind == TL_ENTRY_TUNING) {
        return tl_recorder_database_tuning(database, &entry->tuning, impossible);
    }
    keep_ledger(database, entry->ledger);
    return write_step(database, &entry->record);
}

int tl_recorder_database_event(tl_recorder_database *database, const tl_recorder_event_entry *event) {
    sqlite3_stmt *prepared = database->statements[EVENT];
    char at[TL_UTC_TEXT];
    tl_utc_text(event->at, at);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    bind_text(prepared, 2, at);
    if (event->tick >= 0) {
        bind_within(prepared, 3, 0, event->tick);
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
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    bind_count(prepared, 2, totals->samples);
    bind_count(prepared, 3, totals->steps);
    bind_count(prepared, 4, totals->events);
    bind_count(prepared, 5, totals->lost);
    bind_text(prepared, 6, totals->committed);
    return run_statement(prepared);
}

static int write_end(tl_recorder_database *database, const char *reason) {
    char text[TL_RECORDER_REASON];
    sqlite3_stmt *prepared = database->statements[END];
    (void)snprintf(text, sizeof text, "%s", reason);
    tl_recorder_beginning_repair(text);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    bind_text(prepared, 2, text);
    return run_statement(prepared);
}

int tl_recorder_database_commit(tl_recorder_database *database, const tl_recorder_totals *totals, const char *reason) {
    int code = write_ledger(database);
    if (code == SQLITE_OK) {
        code = write_totals(database, totals);
    }
    if (code == SQLITE_OK && reason != NULL) {
        code = write_end(database, reason);
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

unsigned tl_recorder_database_writings_back(const tl_recorder_database *database) {
    return database->retention.writings_back;
}

/* ---- Opening ----------------------------------------------------------------------------------------------------- */

static uint64_t count_of(sqlite3_stmt *row, int column) {
    int64_t count = sqlite3_column_int64(row, column);
    return count < 0 ? 0 : (uint64_t)count;
}

int tl_recorder_database_find(tl_recorder_database *database, int64_t run, bool *found, tl_recorder_totals *totals) {
    sqlite3_stmt *row = database->statements[FIND];
    (void)sqlite3_bind_int64(row, 1, run);
    int code = sqlite3_step(row);
    *found = code == SQLITE_ROW;
    if (code == SQLITE_ROW) {
        const char *committed = (const char *)sqlite3_column_text(row, 4);
        *totals = (tl_recorder_totals){count_of(row, 0), count_of(row, 1), count_of(row, 2), count_of(row, 3), ""};
        (void)snprintf(totals->committed, sizeof totals->committed, "%s", committed == NULL ? "" : committed);
    }
    (void)sqlite3_reset(row);
    return code == SQLITE_ROW || code == SQLITE_DONE ? SQLITE_OK : code;
}

static int prepare_all(tl_recorder_database *database) {
    int code = SQLITE_OK;
    for (int i = 0; i < STATEMENTS && code == SQLITE_OK; i++) {
        code = sqlite3_prepare_v3(database->connection, sql_of[i], -1, SQLITE_PREPARE_PERSISTENT,
                                  &database->statements[i], NULL);
    }
    return code;
}

int tl_recorder_database_open(sqlite3 *connection, const tl_recorder_settings *settings,
                              tl_recorder_database **database) {
    assert(settings->plant_count <= TL_MAX_SIGNALS && settings->match_count <= TL_MAX_MATCH &&
           settings->adjust_count <= TL_MAX_ADJUST && settings->component_count <= TL_RECORDER_COMPONENTS &&
           settings->step > 0);
    tl_recorder_database *opened = calloc(1, sizeof *opened);
    *database = opened;
    if (opened == NULL) {
        return SQLITE_NOMEM;
    }
    opened->connection = connection;
    opened->settings = settings;
    int code = tl_recorder_retention_open(&opened->retention, connection, settings->max_bytes);
    return code == SQLITE_OK ? prepare_all(opened) : code;
}

void tl_recorder_database_close(tl_recorder_database *database) {
    if (database == NULL) {
        return;
    }
    for (int i = 0; i < STATEMENTS; i++) {
        (void)sqlite3_finalize(database->statements[i]);
    }
    tl_recorder_retention_close(&database->retention);
    free(database);
}

/* ---- recorder beginning ---- */

#ifndef TL_VERSION
#define TL_VERSION "unknown"
#endif

/* What a run is begun with. */
typedef struct beginning {
    sqlite3 *connection;
    const tl_recorder_settings *settings;
    const tl_outbox_start *start;
    int64_t run;
    char own[TL_SHA256_TEXT]; /* of the configuration of the settings, */
    const char *hash;         /* and of that of the run */
} beginning;

/* What is no character becomes "?". */
static void tl_recorder_beginning_repair(char *text) {
    for (size_t left = strlen(text); left > 0;) {
        uint32_t code = 0;
        size_t length = tl_utf8_read(text, left, &code);
        if (length == 0) {
            *text = '?';
            length = 1;
        }
        text += length;
        left -= length;
    }
}

/* One change with up to three parameters: the others are NULL. */
static int change(sqlite3 *connection, const char *sql, int64_t first, const char *second, const char *third) {
    sqlite3_stmt *prepared = NULL;
    int code = sqlite3_prepare_v2(connection, sql, -1, &prepared, NULL);
    if (code == SQLITE_OK) {
        (void)sqlite3_bind_int64(prepared, 1, first);
        (void)sqlite3_bind_text(prepared, 2, second, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 3, third, -1, SQLITE_STATIC);
        code = sqlite3_step(prepared);
    }
    (void)sqlite3_finalize(prepared);
    return code == SQLITE_DONE ? SQLITE_OK : code;
}

/* A database of an older program learns the names that came since. */
static int write_names(sqlite3 *connection) {
    int code = SQLITE_OK;
    for (int i = TL_FREE; i < TL_OUTCOMES && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO outcomes VALUES (?1, ?2)", i, tl_outcome_name((tl_outcome)i),
                      NULL);
    }
    for (int i = TL_STOP_NONE; i <= TL_STOP_TIME && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO stops VALUES (?1, ?2)", i, tl_stop_name((tl_stop)i), NULL);
    }
    for (unsigned bit = TL_FLAG_FALLBACK; bit <= TL_LAST_FLAG && code == SQLITE_OK; bit <<= 1) {
        code =
            change(connection, "INSERT OR REPLACE INTO flags VALUES (?1, ?2)", bit, tl_flag_name((tl_flag)bit), NULL);
    }
    for (int i = TL_GOOD; i <= TL_OUTLIER && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO qualities VALUES (?1, ?2)", i, tl_quality_name((tl_quality)i),
                      NULL);
    }
    for (int i = TL_EVENT_INFO; i <= TL_EVENT_ERROR && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO severities VALUES (?1, ?2)", i,
                      tl_severity_name((tl_severity)i), NULL);
    }
    return code;
}

/* We have the writer's lock: a run without an end was killed. Its last commit was at most one interval after its last
 * step. */
static int tl_recorder_beginning_end_killed(sqlite3 *connection) {
    return change(connection,
                  "UPDATE runs SET ended = coalesce(committed, started), ended_reason = 'not ended cleanly'"
                  " WHERE ended IS NULL",
                  0, NULL, NULL);
}

/* What no history would take is none that a twin of ours tells. */
static int64_t small(uint32_t number) {
    return number > INT32_MAX ? INT32_MAX : number;
}

static int write_run(beginning *self, int64_t began) {
    static const char sql[] = "INSERT INTO runs (verb, name, version, configuration, started, committed, step_ns,"
                              " prediction, measurements, lead) VALUES (?1, ?2, ?3, ?4, ?5, ?5, ?6, ?7, ?8, ?9)";
    const tl_recorder_settings *settings = self->settings;
    sqlite3_stmt *prepared = NULL;
    char text[TL_UTC_TEXT];
    int code = sqlite3_prepare_v2(self->connection, sql, -1, &prepared, NULL);
    if (code == SQLITE_OK) {
        tl_utc_text(began, text);
        (void)sqlite3_bind_text(prepared, 1, self->start->holds ? "hold" : settings->verb, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 2, settings->name, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 3, TL_VERSION, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 4, self->hash, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 5, text, -1, SQLITE_STATIC);
        (void)sqlite3_bind_int64(prepared, 6, settings->step);
        (void)sqlite3_bind_int64(prepared, 7, small(self->start->account.prediction));
        (void)sqlite3_bind_text(prepared, 8, tl_measurements_name(settings->measurements), -1, SQLITE_STATIC);
        (void)sqlite3_bind_int64(prepared, 9, small(self->start->account.lead));
        code = sqlite3_step(prepared);
    }
    (void)sqlite3_finalize(prepared);
    self->run = sqlite3_last_insert_rowid(self->connection);
    return code == SQLITE_DONE ? SQLITE_OK : code;
}

/* Which FMUs there are, by who has loaded them or else by the settings; none if nothing but the plant is recorded. */
static int write_beginning(const beginning *self) {
    char none[TL_SHA256_TEXT];
    const tl_recorder_settings *settings = self->settings;
    const char *known = settings->fmus != NULL ? settings->fmus : "";
    const char *fmus = self->start->fmus[0] != '\0' ? self->start->fmus : known;
    if (self->start->holds) {
        tl_identity_files(NULL, 0, none);
        fmus = none;
    }
    return change(self->connection, "INSERT INTO beginnings (run, fmus, boot) VALUES (?1, ?2, ?3)", self->run, fmus,
                  settings->boot != NULL ? settings->boot : "");
}

/* ---- Signals and components -------------------------------------------------------------------------------------- */

static int write_signal(const beginning *self, sqlite3_stmt *prepared, int64_t index,
                        const tl_recorder_signal *signal) {
    char unit[TL_ACCOUNT_TEXT];
    (void)snprintf(unit, sizeof unit, "%s", signal->unit);
    tl_recorder_beginning_repair(unit);
    (void)sqlite3_bind_int64(prepared, 1, self->run);
    (void)sqlite3_bind_int64(prepared, 3, index);
    (void)sqlite3_bind_text(prepared, 4, signal->name, -1, SQLITE_STATIC);
    (void)sqlite3_bind_text(prepared, 5, unit, -1, SQLITE_STATIC);
    (void)sqlite3_bind_text(prepared, 6, tl_type_name(signal->type), -1, SQLITE_STATIC);
    (void)sqlite3_bind_text(prepared, 7, signal->to, -1, SQLITE_STATIC);
    int code = sqlite3_step(prepared);
    (void)sqlite3_reset(prepared);
    return code == SQLITE_DONE ? SQLITE_OK : code;
}

static int prepare_signals(const beginning *self, const char *kind, sqlite3_stmt **prepared) {
    static const char sql[] = "INSERT INTO signals (run, kind, signal, name, unit, type, compared_with)"
                              " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
    int code = sqlite3_prepare_v2(self->connection, sql, -1, prepared, NULL);
    (void)sqlite3_bind_text(*prepared, 2, kind, -1, SQLITE_STATIC);
    return code;
}

static int write_plant(const beginning *self) {
    sqlite3_stmt *prepared = NULL;
    int code = prepare_signals(self, "plant", &prepared);
    for (size_t i = 0; i < self->settings->plant_count && code == SQLITE_OK; i++) {
        code = write_signal(self, prepared, (int64_t)i, &self->settings->plant[i]);
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

/* Their units and types are what the account says. */
static int write_matches(const beginning *self) {
    const tl_account *account = &self->start->account;
    sqlite3_stmt *prepared = NULL;
    int code = prepare_signals(self, "match", &prepared);
    for (size_t i = 0; i < self->settings->match_count && code == SQLITE_OK; i++) {
        tl_recorder_signal signal = self->settings->match[i];
        signal.unit = i < account->matches ? account->match[i].unit : "";
        signal.type = i < account->matches ? account->match[i].type : TL_REAL;
        code = write_signal(self, prepared, (int64_t)i, &signal);
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

static int write_adjusts(const beginning *self) {
    const tl_account *account = &self->start->account;
    sqlite3_stmt *prepared = NULL;
    int code = prepare_signals(self, "adjust", &prepared);
    for (size_t i = 0; i < self->settings->adjust_count && code == SQLITE_OK; i++) {
        tl_recorder_signal signal = self->settings->adjust[i];
        signal.unit = i < account->adjusts ? account->adjust[i].unit : "";
        signal.type = i < account->adjusts ? account->adjust[i].type : TL_REAL;
        code = write_signal(self, prepared, (int64_t)i, &signal);
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

/* Their counts come with the steps. */
static int write_components(const beginning *self) {
    static const char sql[] = "INSERT INTO components (run, component, name) VALUES (?1, ?2, ?3)";
    const tl_account *account = &self->start->account;
    sqlite3_stmt *prepared = NULL;
    int code = sqlite3_prepare_v2(self->connection, sql, -1, &prepared, NULL);
    for (size_t i = 0; i < self->settings->component_count && i < account->components && code == SQLITE_OK; i++) {
        char name[TL_ACCOUNT_TEXT];
        (void)snprintf(name, sizeof name, "%s", account->component[i].name);
        tl_recorder_beginning_repair(name);
        (void)sqlite3_bind_int64(prepared, 1, self->run);
        (void)sqlite3_bind_int64(prepared, 2, (sqlite3_int64)i);
        (void)sqlite3_bind_text(prepared, 3, name, -1, SQLITE_STATIC);
        code = sqlite3_step(prepared);
        (void)sqlite3_reset(prepared);
        code = code == SQLITE_DONE ? SQLITE_OK : code;
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

/* ---- All of it --------------------------------------------------------------------------------------------------- */

static int tl_recorder_beginning_write(sqlite3 *connection, const tl_recorder_settings *settings,
                                       const tl_outbox_start *start, int64_t began, int64_t *run) {
    beginning self = {.connection = connection, .settings = settings, .start = start};
    tl_sha256(settings->configuration, strlen(settings->configuration), self.own);
    self.hash = start->holds || start->configured.hash[0] == '\0' ? self.own : start->configured.hash;
    int code = tl_recorder_beginning_end_killed(connection);
    if (code == SQLITE_OK) {
        code = write_names(connection);
    }
    if (code == SQLITE_OK) {
        code = change(connection, "INSERT OR IGNORE INTO configurations (hash, text) VALUES (?2, ?3)", 0, self.hash,
                      strcmp(self.hash, self.own) == 0 ? settings->configuration : "");
    }
    if (code == SQLITE_OK) {
        code = write_run(&self, began);
    }
    if (code == SQLITE_OK) {
        code = write_beginning(&self);
    }
    if (code == SQLITE_OK) {
        code = write_plant(&self);
    }
    if (code == SQLITE_OK && !start->holds) {
        code = write_matches(&self);
    }
    if (code == SQLITE_OK && !start->holds) {
        code = write_adjusts(&self);
    }
    if (code == SQLITE_OK && !start->holds) {
        code = write_components(&self);
    }
    *run = self.run;
    return code;
}
