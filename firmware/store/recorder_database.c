/* Recorder's settings and its database statements, with the limit of the file's size: see
 * recorder_database.h. */
#include "firmware/store/recorder_database.h"

#include <assert.h>
#include <math.h>
#include <sqlite3.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/store/database.h"
#include "firmware/store/periods.h"
#include "master/base/text.h"

#ifndef TL_VERSION
#define TL_VERSION "unknown"
#endif

void tl_recorder_settings_of(const tl_config *config, tl_recorder_names *names, tl_recorder_settings *settings) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_plan_signal *signal = &config->signals[i].plan;
        (void)snprintf(names->plant_texts[i], TL_RECORDER_NAME, "plant.%s", signal->name);
        names->plant[i] = (tl_recorder_signal){names->plant_texts[i], signal->unit, NULL, signal->type};
    }
    for (size_t i = 0; i < config->match_count; i++) {
        names->match[i] = (tl_recorder_signal){config->match[i].variable, "", config->match[i].to, TL_REAL};
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        names->adjust[i] = (tl_recorder_signal){config->adjust[i].variable, "", NULL, TL_REAL};
    }
    settings->max_bytes = config->record_max_bytes;
    settings->commit = config->record_commit;
    settings->name = config->name;
    settings->configuration = config->text;
    settings->step = config->step;
    settings->measurements = config->measurements;
    settings->plant = names->plant;
    settings->match = names->match;
    settings->adjust = names->adjust;
    settings->plant_count = config->signal_count;
    settings->match_count = config->match_count;
    settings->adjust_count = config->adjust_count;
}

/* ---- Statements: ?1 is always a run, usually that of the batch. ---- */

typedef enum statement {
    BEGIN,
    COMMIT,
    ROLLBACK,
    HAS_TOTALS,
    RESUME_RUN,
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
    LEARNED,
    READ_LEARNED,
    FINDING,
    OPEN_FINDINGS,
    LAST_FINDING,
    NEXT_NORMAL,
    IS_REMOVED,
    MOVE_EVENTS,
    MOVE_TUNINGS,
    MOVE_FINDINGS,
    MOVE_RUNS,
    LEDGER,
    TOTALS,
    END,
    /* a new run */
    KILLED_RUN,
    END_KILLED,
    OUTCOME_NAME,
    STOP_NAME,
    FLAG_NAME,
    QUALITY_NAME,
    SEVERITY_NAME,
    NEW_RUN,
    NEW_BEGINNING,
    SIGNAL,
    COMPONENT,
    /* retention: queries */
    PAGE_SIZE,
    PAGE_COUNT,
    FREE_COUNT,
    UNUSED_RUN,
    OLDEST_WITH_TICKS,
    FIRST_TICK,
    LAST_SAMPLE,
    TICKS_AT_ONCE,
    COUNT_EVENTS,
    /* removal of a run's data before tick ?2 */
    OLD_SAMPLES,
    OLD_OUTPUTS,
    OLD_ADJUSTMENTS,
    OLD_STEPS,
    OLD_OWN_CHECKPOINTS,
    OLD_TUNINGS,
    REMOVED_BEFORE,
    OLD_EVENTS,
    /* removal of a run without ticks, periods and events */
    ALL_SIGNALS,
    ALL_COMPONENTS,
    ALL_CHECKPOINTS,
    ALL_TUNINGS,
    ALL_BEGINNINGS,
    ALL_OF_RUN,
    UNUSED_CONFIGURATIONS,
    OLD_TEXTS,
    STATEMENTS
} statement;

/* Runs of this boot, and the present one, with the seconds that their instants are to be moved: ?2
 * is UTC − CLOCK_MONOTONIC in ms, ?3 what was added to it, in s, and ?4 the boot ID. */
#define MOVED_RUNS                                                                                                     \
    "WITH moved AS (SELECT run, CASE WHEN start_ns IS NULL THEN ?3"                                                    \
    " ELSE (julianday(?2 / 1e3 + start_ns / 1e9, 'unixepoch') - julianday(started)) * 86400 END AS seconds"            \
    " FROM runs LEFT JOIN beginnings USING (run) WHERE run = ?1 OR (boot = ?4 AND start_ns IS NOT NULL)) "
#define MOVED(column, run)                                                                                             \
    column " = strftime('%Y-%m-%dT%H:%M:%fZ', " column                                                                 \
           ", printf('%+.3f seconds', (SELECT seconds FROM moved WHERE moved.run = " run ")))"
#define IS_MOVED " WHERE run IN (SELECT run FROM moved WHERE abs(seconds) > 0.4)"

/* UTC of an instant of a live run, which is s since t_start. */
#define UTC_OF(seconds)                                                                                                \
    "iif(verb = 'run', strftime('%Y-%m-%dT%H:%M:%fZ', started, printf('%+.3f seconds', " seconds ")), NULL)"

/* OR REPLACE: a tick that comes twice is an error of the caller, but must not block the recording
 *             for ever. */
static const char *const sql_of[STATEMENTS] = {
    [BEGIN] = "BEGIN IMMEDIATE",
    [COMMIT] = "COMMIT",
    [ROLLBACK] = "ROLLBACK",
    [HAS_TOTALS] = "SELECT 1 FROM runs WHERE run = ?1 AND (samples_written, steps_written, events_written,"
                   " entries_lost, committed) = (?2, ?3, ?4, ?5, ?6)",
    [RESUME_RUN] = "UPDATE runs SET ended = NULL, ended_reason = NULL"
                   " WHERE run = ?1 AND ended_reason = 'not ended cleanly'",
    /* Adds the text if it was unknown when a run began with this configuration. */
    [CONFIGURATION] = "INSERT INTO configurations (hash, text) VALUES (?2, ?3)"
                      " ON CONFLICT (hash) DO UPDATE SET text = excluded.text WHERE text = ''",
    [TUNING] = "INSERT OR REPLACE INTO tunings (run, tick, configuration, at, who, origin, why)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    /* Copies the details from an earlier activation, by this run or an earlier one; otherwise only
     * the time of recording. */
    [TUNING_AGAIN] = "INSERT OR REPLACE INTO tunings (run, tick, configuration, at, who, origin, why)"
                     " SELECT ?1, ?2, ?3, at, who, origin, why FROM (SELECT * FROM tunings WHERE configuration = ?3"
                     " UNION ALL SELECT -1, -1, ?3, ?4, '', '', '') ORDER BY run DESC, tick DESC LIMIT 1",
    [IS_CONFIGURATION] = "SELECT 1 FROM configurations WHERE hash = ?2",
    [CHECKPOINT] = "INSERT OR REPLACE INTO checkpoints (run, tick, format, sha256, bytes) VALUES (?1, ?2, ?3, ?4, ?5)",
    /* Keeps the two newest, the first of every 65,536 ticks if it is small (twinlock explain begins
     * there), and those from which the run was resumed. */
    [OLD_CHECKPOINTS] = "DELETE FROM checkpoints AS c WHERE run = ?1"
                        " AND tick NOT IN (SELECT tick FROM checkpoints WHERE run = ?1 ORDER BY tick DESC LIMIT 2)"
                        " AND (length(bytes) > 1000000 OR EXISTS (SELECT 1 FROM checkpoints AS e WHERE e.run = ?1"
                        " AND e.tick >= (c.tick >> 16 << 16) AND e.tick < c.tick))"
                        " AND tick >= (SELECT coalesce(resumed_tick, 0) FROM beginnings WHERE run = ?1)",
    [SAMPLE] = "INSERT OR REPLACE INTO samples (run, tick, signal, value, quality, stamp_ns)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    [STEP] = "INSERT OR REPLACE INTO steps (run, step, t_ns, outcome, stop, J, J_nominal, evaluations, executions,"
             " used_ns, predicted, flags, held, release_age)"
             " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14)",
    [OUTPUT] =
        "INSERT OR REPLACE INTO outputs (run, step, signal, simulated, measured, quality, readings, squares, rejected,"
        " released) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)",
    [ADJUSTMENT] =
        "INSERT OR REPLACE INTO adjustments (run, step, signal, applied, nominal) VALUES (?1, ?2, ?3, ?4, ?5)",
    [EVENT] = "INSERT INTO events (run, at, tick, severity, source, text) VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    /* What was learnt in a replay never replaces anything. */
    [LEARNED] =
        "INSERT OR REPLACE INTO learned (id, run, at, state, learnt_s, needed_s, watched_s, sha256, bytes)"
        " SELECT 1, ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8 FROM runs"
        " WHERE runs.run = ?1 AND (verb = 'run' OR NOT EXISTS (SELECT 1 FROM learned WHERE state <> 'removed'))",
    [READ_LEARNED] = "SELECT bytes, sha256 FROM learned",
    [FINDING] =
        "INSERT INTO findings (finding, run, kind, subject, variable, says, unit, onset_s, onset_spread_s,"
        " found_s, gone_s, size, size_spread, percent, also, cause, state, onset_at, found_at, gone_at)"
        " SELECT ?2, ?1, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, " UTC_OF("?8") ", " UTC_OF(
            "?10") ", " UTC_OF("?11") " FROM runs WHERE run = ?1"
                                      " ON CONFLICT (finding) DO UPDATE SET run = excluded.run, kind = excluded.kind,"
                                      " subject = excluded.subject, variable = excluded.variable, says = excluded.says, unit = excluded.unit,"
                                      " onset_s = excluded.onset_s, onset_spread_s = excluded.onset_spread_s, found_s = excluded.found_s,"
                                      " gone_s = excluded.gone_s, size = excluded.size, size_spread = excluded.size_spread,"
                                      " percent = excluded.percent, also = excluded.also, cause = excluded.cause,"
                                      " state = CASE state WHEN 'normal' THEN state ELSE excluded.state END,"
                                      " onset_at = excluded.onset_at, found_at = excluded.found_at, gone_at = excluded.gone_at",
    [OPEN_FINDINGS] = "UPDATE findings SET state = 'normal' WHERE state = 'open' AND onset_at IS NOT NULL",
    [IS_REMOVED] = "SELECT 1 FROM learned WHERE state = 'removed'",
    [LAST_FINDING] = "SELECT max(finding) FROM findings",
    [NEXT_NORMAL] = "SELECT min(finding) FROM findings WHERE finding > ?1 AND state = 'normal'",
    [MOVE_EVENTS] = MOVED_RUNS "UPDATE events SET " MOVED("at", "events.run") IS_MOVED,
    [MOVE_TUNINGS] = MOVED_RUNS "UPDATE tunings SET " MOVED("at", "tunings.run") IS_MOVED,
    [MOVE_FINDINGS] = MOVED_RUNS "UPDATE findings SET " MOVED("onset_at", "findings.run") ", " MOVED(
        "found_at", "findings.run") ", " MOVED("gone_at", "findings.run") IS_MOVED,
    [MOVE_RUNS] = MOVED_RUNS "UPDATE runs SET " MOVED("committed", "runs.run") ", " MOVED(
        "ended", "runs.run") ", " MOVED("started", "runs.run") IS_MOVED,
    [LEDGER] = "UPDATE components SET plain = ?3, predicted = ?4, executions = ?5, repeated = ?6, uncached = ?7"
               " WHERE run = ?1 AND component = ?2",
    [TOTALS] = "UPDATE runs SET samples_written = ?2, steps_written = ?3, events_written = ?4, entries_lost = ?5,"
               " committed = ?6 WHERE run = ?1",
    [END] = "UPDATE runs SET ended = committed, ended_reason = ?2 WHERE run = ?1",

    [KILLED_RUN] = "SELECT max(run) FROM runs WHERE ended IS NULL",
    [END_KILLED] = "UPDATE runs SET ended = coalesce(committed, started), ended_reason = 'not ended cleanly'"
                   " WHERE ended IS NULL",
    [OUTCOME_NAME] = "INSERT OR REPLACE INTO outcomes VALUES (?2, ?3)",
    [STOP_NAME] = "INSERT OR REPLACE INTO stops VALUES (?2, ?3)",
    [FLAG_NAME] = "INSERT OR REPLACE INTO flags VALUES (?2, ?3)",
    [QUALITY_NAME] = "INSERT OR REPLACE INTO qualities VALUES (?2, ?3)",
    [SEVERITY_NAME] = "INSERT OR REPLACE INTO severities VALUES (?2, ?3)",
    [NEW_RUN] = "INSERT INTO runs (verb, name, version, configuration, started, committed, step_ns, prediction,"
                " measurements, lead, start_s, stop_s)"
                " VALUES (?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13)",
    [NEW_BEGINNING] = "INSERT INTO beginnings (run, fmus, boot, start_ns, resumed_run, resumed_tick, resumed_from)"
                      " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    [SIGNAL] = "INSERT INTO signals (run, kind, signal, name, unit, type, compared_with)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
    [COMPONENT] = "INSERT INTO components (run, component, name) VALUES (?1, ?2, ?3)",

    [PAGE_SIZE] = "PRAGMA page_size",
    [PAGE_COUNT] = "PRAGMA page_count",
    [FREE_COUNT] = "PRAGMA freelist_count",
    [UNUSED_RUN] = "SELECT run FROM runs r WHERE run <> ?1"
                   " AND NOT EXISTS (SELECT 1 FROM samples s WHERE s.run = r.run)"
                   " AND NOT EXISTS (SELECT 1 FROM steps s WHERE s.run = r.run)"
                   " AND NOT EXISTS (SELECT 1 FROM events s WHERE s.run = r.run)"
                   " AND NOT EXISTS (SELECT 1 FROM periods s WHERE s.run = r.run AND length_s IN (60, 3600)) LIMIT 1",
    [OLDEST_WITH_TICKS] = "SELECT min(run) FROM (SELECT * FROM (SELECT run FROM samples ORDER BY run LIMIT 1)"
                          " UNION ALL SELECT * FROM (SELECT run FROM steps ORDER BY run LIMIT 1))",
    [FIRST_TICK] =
        "SELECT min(tick) FROM (SELECT * FROM (SELECT tick FROM samples WHERE run = ?1 ORDER BY tick LIMIT 1)"
        " UNION ALL SELECT * FROM (SELECT step FROM steps WHERE run = ?1 ORDER BY step LIMIT 1))",
    [LAST_SAMPLE] = "SELECT tick FROM samples WHERE run = ?1 ORDER BY tick DESC LIMIT 1",
    /* Number of ticks with about 4096 rows: a tick has a row per signal and one of its own. */
    [TICKS_AT_ONCE] = "SELECT 4096 / (count(*) + 1) + 1 FROM signals WHERE run = ?1",
    [COUNT_EVENTS] = "SELECT (SELECT max(event) FROM events) - (SELECT min(event) FROM events) + 1",
    [OLD_SAMPLES] = "DELETE FROM samples WHERE run = ?1 AND tick < ?2",
    [OLD_OUTPUTS] = "DELETE FROM outputs WHERE run = ?1 AND step < ?2",
    [OLD_ADJUSTMENTS] = "DELETE FROM adjustments WHERE run = ?1 AND step < ?2",
    [OLD_STEPS] = "DELETE FROM steps WHERE run = ?1 AND step < ?2",
    [OLD_OWN_CHECKPOINTS] = "DELETE FROM checkpoints WHERE run = ?1 AND tick + 1 < ?2", /* its next tick is removed */
    /* Keeps the tuning that applies to the first remaining tick. */
    [OLD_TUNINGS] = "DELETE FROM tunings WHERE run = ?1 AND tick <"
                    " (SELECT max(tick) FROM tunings WHERE run = ?1 AND tick <= ?2)",
    [REMOVED_BEFORE] = "UPDATE runs SET removed_before = ?2 WHERE run = ?1",
    [OLD_EVENTS] = "DELETE FROM events WHERE event < ?2 + (SELECT min(event) FROM events)",
    [ALL_SIGNALS] = "DELETE FROM signals WHERE run = ?1",
    [ALL_COMPONENTS] = "DELETE FROM components WHERE run = ?1",
    [ALL_CHECKPOINTS] = "DELETE FROM checkpoints WHERE run = ?1",
    [ALL_TUNINGS] = "DELETE FROM tunings WHERE run = ?1",
    [ALL_BEGINNINGS] = "DELETE FROM beginnings WHERE run = ?1",
    [ALL_OF_RUN] = "DELETE FROM runs WHERE run = ?1",
    [UNUSED_CONFIGURATIONS] = "DELETE FROM configurations WHERE hash NOT IN (SELECT configuration FROM runs)"
                              " AND hash NOT IN (SELECT configuration FROM tunings)",
    /* Of configurations of runs before ?1 only. */
    [OLD_TEXTS] = "UPDATE configurations SET text = '' WHERE text <> ''"
                  " AND hash NOT IN (SELECT configuration FROM runs WHERE run >= ?1)"
                  " AND hash NOT IN (SELECT configuration FROM tunings WHERE run >= ?1)",
};

struct tl_recorder_database {
    sqlite3 *connection;
    const tl_recorder_settings *settings;
    sqlite3_stmt *statements[STATEMENTS];
    int64_t run;     /* of the batch; 0: none yet */
    bool has_ledger; /* a step of this batch has set it */
    int64_t utc;     /* UTC − CLOCK_MONOTONIC, ms, of all instants in this file; INT64_MIN: not known yet */
    int64_t moved;   /* ms, by the last batch */
    tl_execution_counts ledger[TL_RECORDER_COMPONENTS];
    tl_periods *periods;
    int64_t newest_step, newest_sample; /* of the run, since this recorder writes it; -1: none */
    /* retention: */
    int64_t page_size;
    int64_t log_limit;      /* bytes of the log above which it is written back */
    int log_frames;         /* pages in the log after the last commit */
    unsigned writings_back; /* how often the log was written back */
};

typedef struct cell {
    enum { NONE, WHOLE, NUMBER, TEXT } type;
    int64_t whole;
    double number;
    const char *text;
} cell;

static const cell no_cell = {.type = NONE};

static cell cell_whole(int64_t value) {
    return (cell){.type = WHOLE, .whole = value};
}

/* Limits the value to what the history accepts. */
static cell cell_within(int64_t least, int64_t value) {
    return cell_whole(value < least ? least : value > TL_ROW_NUMBER_MAX ? TL_ROW_NUMBER_MAX : value);
}

static cell cell_count(uint64_t count) {
    return cell_whole(count > TL_ROW_NUMBER_MAX ? TL_ROW_NUMBER_MAX : (int64_t)count);
}

static cell cell_number(double value) {
    return (cell){.type = isfinite(value) ? NUMBER : NONE, .number = value};
}

static cell cell_text(const char *value) {
    return (cell){.type = value == NULL ? NONE : TEXT, .text = value};
}

static void repair_text(char *text) {
    for (size_t frames = strlen(text); frames > 0;) {
        uint32_t code = 0;
        size_t length = tl_utf8_read(text, frames, &code);
        if (length == 0) {
            *text = '?';
            length = 1;
        }
        text += length;
        frames -= length;
    }
}

/* Texts come from other processes and were truncated. One invalid text would make the history
 * report the whole database as damaged. */
static void bind_text(sqlite3_stmt *prepared, int index, const char *text) {
    char *repaired = sqlite3_mprintf("%s", text);
    if (repaired != NULL) {
        repair_text(repaired);
    }
    (void)sqlite3_bind_text(prepared, index, repaired, -1, sqlite3_free);
}

static int run_statement(sqlite3_stmt *prepared) {
    int code = sqlite3_step(prepared);
    (void)sqlite3_reset(prepared);
    return code == SQLITE_DONE || code == SQLITE_ROW ? SQLITE_OK : code;
}

/* Binds the run, then one cell for each further parameter. */
static void bind_row(tl_recorder_database *database, statement which, const cell *cells) {
    sqlite3_stmt *prepared = database->statements[which];
    int count = sqlite3_bind_parameter_count(prepared);
    (void)sqlite3_bind_int64(prepared, 1, database->run);
    for (int index = 2; index <= count; index++, cells++) {
        switch (cells->type) {
        case NONE:
            (void)sqlite3_bind_null(prepared, index);
            break;
        case WHOLE:
            (void)sqlite3_bind_int64(prepared, index, cells->whole);
            break;
        case NUMBER:
            (void)sqlite3_bind_double(prepared, index, cells->number);
            break;
        case TEXT:
            bind_text(prepared, index, cells->text);
            break;
        }
    }
}

static int write_row(tl_recorder_database *database, statement which, const cell *cells) {
    bind_row(database, which, cells);
    return run_statement(database->statements[which]);
}

/* Executes a statement for a run with one number, which the statement may ignore. */
static int execute_change(tl_recorder_database *database, statement which, int64_t run, int64_t value) {
    sqlite3_stmt *prepared = database->statements[which];
    (void)sqlite3_bind_int64(prepared, 1, run);
    (void)sqlite3_bind_int64(prepared, 2, value);
    return run_statement(prepared);
}

/* Executes a query for one number of a run; `fallback` if it is NULL or there is no row. */
static int query_number(tl_recorder_database *database, statement which, int64_t run, int64_t fallback,
                        int64_t *value) {
    sqlite3_stmt *prepared = database->statements[which];
    (void)sqlite3_bind_int64(prepared, 1, run);
    int code = sqlite3_step(prepared);
    bool any = code == SQLITE_ROW && sqlite3_column_type(prepared, 0) == SQLITE_INTEGER;
    *value = any ? sqlite3_column_int64(prepared, 0) : fallback;
    (void)sqlite3_reset(prepared);
    return code == SQLITE_ROW || code == SQLITE_DONE ? SQLITE_OK : code;
}

/* ---- Retention: removes the oldest data and keeps the write-ahead log short.
 *
 * The keys of all tables with ticks begin with (run, tick). So the oldest rows are one range at the
 * front of each table, and removing them frees whole pages for the next batch.
 * The file shrinks (incremental vacuum) only if it exceeds the bound, for example after the bound
 * was lowered.
 * Order of removal: minutes, hours and events above their shares; then the oldest ticks of all
 * runs, in small transactions, so that the writer keeps up. A run without ticks, periods and events
 * is removed. Of the present run the row, configuration, signals and last tick remain.
 * The file may use the bound less four times the log's limit: for the log, a batch in it, one
 * retention step in it, and a reserve.
 */

enum {
    LEAST_LOG = 64 * 1024,
    MOST_LOG = 4 * 1024 * 1024,
    FRAME_HEADER = 24,
    LEAST_BYTES = 1000000, /* smallest bound */
    NEWEST_EVENTS = 1000,
    ROWS_AT_ONCE = 4096,  /* removed in one transaction */
    STEPS_PER_BATCH = 16, /* such transactions between two batches; they remove more than a batch adds */
    PAGES_AT_ONCE = 256,  /* released in one transaction */
    EVENTS_SHARE = 2048,  /* one event for so many bytes of the bound: a sixteenth of the file */
    OVERHEAD_PAGES = 24   /* that a batch may add beside its rows */
};

static int64_t log_limit(int64_t max_bytes) {
    int64_t part = max_bytes / 16;
    return max_bytes == 0 || part > MOST_LOG ? MOST_LOG : part < LEAST_LOG ? LEAST_LOG : part;
}

/* Bytes of rows, measured in recorded databases. */
tl_recorder_span tl_recorder_settings_span(const tl_config *config) {
    double tick = 53.0 + 31.0 * (double)config->signal_count + 56.0 * (double)config->match_count +
                  33.0 * (double)config->adjust_count;
    const int64_t max_bytes = config->record_max_bytes;
    const int64_t series = (int64_t)(config->signal_count + config->match_count + config->adjust_count);
    const double room = (double)tl_periods_room(max_bytes, series);
    double most = (double)(max_bytes - 4 * log_limit(max_bytes)) - 2.0 * (double)max_bytes / TL_PERIODS_SHARE;
    return (tl_recorder_span){
        .ticks_s = fmax(most, 0.0) / tick * tl_seconds(config->step),
        .minutes_s = room * TL_MINUTE,
        .hours_s = room * TL_HOUR,
    };
}

static int count_frames(void *context, sqlite3 *connection, const char *name, int frames) {
    (void)connection;
    (void)name;
    ((tl_recorder_database *)context)->log_frames = frames;
    return SQLITE_OK;
}

/* Finds a run's first tick or step (INT64_MAX if it has none), and the tick up to which one
 * transaction removes. The ticks of a damaged run may have any value. */
static int find_oldest(tl_recorder_database *database, int64_t run, int64_t *first, int64_t *until) {
    int64_t ticks = 0;
    int code = query_number(database, FIRST_TICK, run, INT64_MAX, first);
    code = code != SQLITE_OK ? code : query_number(database, TICKS_AT_ONCE, run, 1, &ticks);
    *until = *first < INT64_MAX - ticks ? *first + ticks : INT64_MAX;
    return code;
}

static int change_all(tl_recorder_database *database, statement first, statement last, int64_t run, int64_t value) {
    int code = SQLITE_OK;
    for (statement which = first; which <= last && code == SQLITE_OK; which++) {
        code = execute_change(database, which, run, value);
    }
    return code;
}

static int remove_unused_run(tl_recorder_database *database, bool *removed) {
    int64_t run = 0;
    int code = query_number(database, UNUSED_RUN, database->run, 0, &run);
    *removed = code == SQLITE_OK && run != 0;
    return *removed ? change_all(database, ALL_SIGNALS, UNUSED_CONFIGURATIONS, run, 0) : code;
}

static int remove_events(tl_recorder_database *database, bool *removed) {
    const int64_t share = database->settings->max_bytes / EVENTS_SHARE;
    int64_t events = 0;
    int code = query_number(database, COUNT_EVENTS, 0, 0, &events);
    const int64_t surplus = events - (share > NEWEST_EVENTS ? share : NEWEST_EVENTS);
    *removed = code == SQLITE_OK && surplus > 0;
    return *removed ? execute_change(database, OLD_EVENTS, 0, surplus < ROWS_AT_ONCE ? surplus : ROWS_AT_ONCE) : code;
}

/* Removes the oldest ticks of all runs, and then the configuration of their run. */
static int remove_ticks(tl_recorder_database *database, bool *removed) {
    int64_t run = 0;
    int64_t first = 0;
    int64_t until = 0;
    int64_t last = INT64_MAX;
    int code = query_number(database, OLDEST_WITH_TICKS, 0, 0, &run);
    code = code == SQLITE_OK && run != 0 ? find_oldest(database, run, &first, &until) : code;
    if (code == SQLITE_OK && run != 0 && run == database->run) {
        code = query_number(database, LAST_SAMPLE, run, -1, &last);
    }
    *removed = code == SQLITE_OK && run != 0 && first < last;
    if (*removed) {
        code = change_all(database, OLD_SAMPLES, REMOVED_BEFORE, run, until < last ? until : last);
        code = code == SQLITE_OK ? find_oldest(database, run, &first, &until) : code;
    }
    const bool is_last = *removed && code == SQLITE_OK && first == INT64_MAX;
    return is_last ? execute_change(database, OLD_TEXTS, run + 1, 0) : code;
}

/* Removes a little in one transaction. *removed is false if nothing remains that may be removed. */
static int remove_some(tl_recorder_database *database, bool looks_for_runs, bool *removed) {
    const tl_recorder_settings *settings = database->settings;
    const int64_t series = (int64_t)(settings->plant_count + settings->match_count + settings->adjust_count);
    int code = run_statement(database->statements[BEGIN]);
    *removed = false;
    if (code != SQLITE_OK) {
        return code;
    }
    code = looks_for_runs ? remove_unused_run(database, removed) : code;
    if (code == SQLITE_OK && !*removed) {
        code = tl_periods_remove(database->periods, settings->max_bytes, series, ROWS_AT_ONCE, removed);
    }
    if (code == SQLITE_OK && !*removed) {
        code = remove_events(database, removed);
    }
    if (code == SQLITE_OK && !*removed) {
        code = remove_ticks(database, removed);
    }
    if (code == SQLITE_OK) {
        code = run_statement(database->statements[COMMIT]);
    }
    tl_recorder_database_rollback(database);
    return code;
}

static int64_t log_bytes(const tl_recorder_database *database) {
    return database->log_frames * (database->page_size + FRAME_HEADER);
}

static int write_back(tl_recorder_database *database, int mode) {
    int frames = 0;
    int written = 0;
    int code = sqlite3_wal_checkpoint_v2(database->connection, "main", mode, &frames, &written);
    database->writings_back++;
    if (code == SQLITE_OK && frames == written) {
        database->log_frames = 0; /* the next transaction restarts the log unless a reader needs it */
    }
    return code;
}

int tl_recorder_database_tidy(tl_recorder_database *database) {
    if (log_bytes(database) < database->log_limit) {
        return SQLITE_OK;
    }
    int code = write_back(database, SQLITE_CHECKPOINT_PASSIVE);
    if ((code == SQLITE_OK || code == SQLITE_BUSY) && log_bytes(database) >= 2 * database->log_limit) {
        code = write_back(database, SQLITE_CHECKPOINT_TRUNCATE);
    }
    return code == SQLITE_BUSY ? SQLITE_OK : code; /* a reader; make_room() reports it if the log is too long */
}

/* Returns at most `pages` free pages to the file system. */
static int shrink_file(tl_recorder_database *database, int64_t pages) {
    char sql[64];
    (void)snprintf(sql, sizeof sql, "PRAGMA incremental_vacuum(%lld)",
                   (long long)(pages < PAGES_AT_ONCE ? pages : PAGES_AT_ONCE));
    return sqlite3_exec(database->connection, sql, NULL, NULL, NULL);
}

/* While a reader prevents writing the log back, the log may grow up to the bound. */
static int check_log(tl_recorder_database *database, int64_t needed) {
    int64_t file = tl_database_size(database->connection, SQLITE_FCNTL_FILE_POINTER);
    int64_t log = tl_database_size(database->connection, SQLITE_FCNTL_JOURNAL_POINTER);
    int64_t on_disk = (file < 0 ? 0 : file) + (log < 0 ? 0 : log);
    if (log_bytes(database) < 2 * database->log_limit ||
        on_disk + needed * database->page_size <= database->settings->max_bytes) {
        return SQLITE_OK;
    }
    return write_back(database, SQLITE_CHECKPOINT_TRUNCATE);
}

/* Call between transactions: makes room for a batch of `bytes`. Returns SQLITE_BUSY if a reader
 * prevents writing the log back and another batch would exceed the bound. */
static int make_room(tl_recorder_database *database, size_t bytes) {
    if (database->settings->max_bytes == 0) {
        return SQLITE_OK;
    }
    int64_t most = (database->settings->max_bytes - 4 * database->log_limit) / database->page_size;
    int64_t needed = (int64_t)(bytes * 3) / database->page_size + OVERHEAD_PAGES;
    int64_t all = 0;
    int64_t unused = 0;
    bool removed = true;
    int code = check_log(database, needed);
    for (int i = 0; i < STEPS_PER_BATCH && code == SQLITE_OK && removed; i++) {
        code = query_number(database, PAGE_COUNT, 0, 0, &all);
        code = code == SQLITE_OK ? query_number(database, FREE_COUNT, 0, 0, &unused) : code;
        if (code == SQLITE_OK && all > most && unused > 0) {
            code = shrink_file(database, all - most);
        } else if (code == SQLITE_OK && all - unused + needed > most) {
            code = remove_some(database, i == 0, &removed); /* once: there may be many runs */
        } else {
            break;
        }
        code = code == SQLITE_OK ? tl_recorder_database_tidy(database) : code;
        code = code == SQLITE_OK ? check_log(database, needed) : code;
    }
    return code;
}

/* ---- Beginning of a run.
 *
 * The account may be that of a hostile twin: its texts are repaired, and its counts are limited by
 * the settings.
 */

/* Returns the configuration if its text is known, or NULL. */
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

/* So a database of an older program also gets the names of newer codes. */
static int write_names(tl_recorder_database *database) {
    int code = SQLITE_OK;
    for (int i = TL_FREE; i < TL_OUTCOMES && code == SQLITE_OK; i++) {
        code = write_row(database, OUTCOME_NAME, (cell[]){cell_whole(i), cell_text(tl_outcome_name((tl_outcome)i))});
    }
    for (int i = TL_STOP_NONE; i <= TL_STOP_TIME && code == SQLITE_OK; i++) {
        code = write_row(database, STOP_NAME, (cell[]){cell_whole(i), cell_text(tl_stop_name((tl_stop)i))});
    }
    for (unsigned bit = TL_FLAG_FALLBACK; bit <= TL_LAST_FLAG && code == SQLITE_OK; bit <<= 1) {
        code = write_row(database, FLAG_NAME, (cell[]){cell_whole(bit), cell_text(tl_flag_name((tl_flag)bit))});
    }
    for (int i = TL_GOOD; i <= TL_LAST_QUALITY && code == SQLITE_OK; i++) {
        code = write_row(database, QUALITY_NAME, (cell[]){cell_whole(i), cell_text(tl_quality_name((tl_quality)i))});
    }
    for (int i = TL_EVENT_INFO; i <= TL_EVENT_ERROR && code == SQLITE_OK; i++) {
        code = write_row(database, SEVERITY_NAME, (cell[]){cell_whole(i), cell_text(tl_severity_name((tl_severity)i))});
    }
    return code;
}

static int64_t last_tick(const tl_recorder_database *database) {
    return TL_ROW_NUMBER_MAX / database->settings->step;
}

/* ---- Time: instants are recorded by CLOCK_MONOTONIC plus one offset. If the system clock is set,
 * the instants of all runs of this boot are moved. So each difference of instants is a duration,
 * and the instants are right after the last setting. Smaller changes are left to add up.
 */

static const int64_t CLOCK_IS_SET = 500; /* ms */

static int64_t monotonic_ms(void) {
    return tl_clock_now(NULL) / (TL_SECOND / 1000);
}

/* UTC − CLOCK_MONOTONIC, ms. Another process may run between both readings. */
static int64_t read_offset(void) {
    int64_t best = 0;
    int64_t least = INT64_MAX;
    for (int i = 0; i < 4 && least > 1; i++) {
        const int64_t before = monotonic_ms();
        const int64_t utc = tl_utc_now();
        const int64_t took = monotonic_ms() - before;
        best = took < least ? utc - before : best;
        least = took < least ? took : least;
    }
    return best;
}

static int follow_clock(tl_recorder_database *database) {
    const int64_t offset = read_offset();
    const bool is_first = database->utc == INT64_MIN;
    database->moved = is_first ? 0 : offset - database->utc;
    if (!is_first && database->moved > -CLOCK_IS_SET && database->moved < CLOCK_IS_SET) {
        database->moved = 0;
        return SQLITE_OK;
    }
    int code = SQLITE_OK;
    database->utc = offset;
    for (statement which = MOVE_EVENTS; which <= MOVE_RUNS && code == SQLITE_OK; which++) {
        code = write_row(database, which,
                         (cell[]){cell_whole(offset), cell_number((double)database->moved / 1e3),
                                  cell_text(database->settings->boot)});
    }
    return code;
}

int64_t tl_recorder_database_moved(const tl_recorder_database *database) {
    return database->moved;
}

void tl_recorder_database_now(const tl_recorder_database *database, char text[TL_UTC_TEXT]) {
    tl_utc_text(monotonic_ms() + database->utc, text);
}

/* Writes the configuration that the run began with; its text may be unknown. */
static int write_run(tl_recorder_database *database, const tl_record_queue_start *start, bool timed) {
    const tl_recorder_settings *settings = database->settings;
    char own[TL_SHA256_TEXT];
    char now[TL_UTC_TEXT];
    char started[TL_UTC_TEXT];
    tl_sha256(settings->configuration, strlen(settings->configuration), own);
    const char *hash = start->holds || start->configured.hash[0] == '\0' ? own : start->configured.hash;
    int code = write_row(database, CONFIGURATION,
                         (cell[]){cell_text(hash), cell_text(strcmp(hash, own) == 0 ? settings->configuration : "")});
    if (code == SQLITE_OK) {
        const int64_t known = start->resumption.started;
        const int64_t start_ms = start->resumption.start / (TL_SECOND / 1000) + database->utc;
        const bool is_right = known > start_ms - CLOCK_IS_SET && known < start_ms + CLOCK_IS_SET;
        tl_recorder_database_now(database, now);
        tl_utc_text(is_right ? known : start_ms, started);
        const cell row[] = {cell_text(start->holds ? "hold" : settings->verb),
                            cell_text(settings->name),
                            cell_text(TL_VERSION),
                            cell_text(hash),
                            cell_text(timed ? started : now),
                            cell_text(now),
                            cell_whole(settings->step),
                            cell_whole(start->account.prediction > INT32_MAX ? INT32_MAX : start->account.prediction),
                            cell_text(tl_pairing_names[settings->measurements]),
                            cell_whole(start->account.lead > INT32_MAX ? INT32_MAX : start->account.lead),
                            start->holds ? no_cell : cell_number(start->account.experiment.start_s),
                            start->holds ? no_cell : cell_number(start->account.experiment.stop_s)};
        code = write_row(database, NEW_RUN, row);
        database->run = sqlite3_last_insert_rowid(database->connection);
    }
    return code;
}

/* The identity of the FMUs comes from the process that has loaded them, or else from the settings.
 * In safe hold it is the identity of an empty list. `timed`: also writes when the run began and
 * which run it resumes. */
static int write_beginning(tl_recorder_database *database, const tl_record_queue_start *start, bool timed) {
    char none[TL_SHA256_TEXT];
    const tl_recorder_settings *settings = database->settings;
    const tl_resumption *resumption = &start->resumption;
    const char *known = settings->fmus != NULL ? settings->fmus : "";
    const char *fmus = start->fmus[0] != '\0' ? start->fmus : known;
    if (start->holds) {
        tl_identity_files(NULL, 0, none);
        fmus = none;
    }
    cell row[6] = {cell_text(fmus), cell_text(settings->boot != NULL ? settings->boot : "")};
    if (timed) {
        row[2] = cell_within(-TL_ROW_NUMBER_MAX, resumption->start);
    }
    if (timed && resumption->from != TL_RESUMED_NOT) {
        int64_t last = last_tick(database);
        row[3] = cell_within(0, resumption->run);
        row[4] = cell_within(0, resumption->tick < last ? resumption->tick : last);
        row[5] = cell_text(tl_resumed_from_name(resumption->from));
    }
    return write_row(database, NEW_BEGINNING, row);
}

static int write_signal(tl_recorder_database *database, const char *kind, size_t index,
                        const tl_recorder_signal *signal, const char *unit, tl_type type) {
    return write_row(database, SIGNAL,
                     (cell[]){cell_text(kind), cell_whole((int64_t)index), cell_text(signal->name), cell_text(unit),
                              cell_text(tl_type_name(type)), cell_text(signal->to)});
}

/* Units and types of matched and adjusted signals come from the account. The counts of components
 * come later, with the steps. */
static int write_signals(tl_recorder_database *database, const tl_record_queue_start *start) {
    const tl_recorder_settings *settings = database->settings;
    const tl_account *account = &start->account;
    int code = SQLITE_OK;
    for (size_t i = 0; i < settings->plant_count && code == SQLITE_OK; i++) {
        const tl_recorder_signal *signal = &settings->plant[i];
        code = write_signal(database, "plant", i, signal, signal->unit, signal->type);
    }
    for (size_t i = 0; !start->holds && i < settings->match_count && code == SQLITE_OK; i++) {
        bool is_known = i < account->matches;
        code = write_signal(database, "match", i, &settings->match[i], is_known ? account->match[i].unit : "",
                            is_known ? account->match[i].type : TL_REAL);
    }
    for (size_t i = 0; !start->holds && i < settings->adjust_count && code == SQLITE_OK; i++) {
        bool is_known = i < account->adjusts;
        code = write_signal(database, "adjust", i, &settings->adjust[i], is_known ? account->adjust[i].unit : "",
                            is_known ? account->adjust[i].type : TL_REAL);
    }
    size_t components =
        account->components < settings->component_count ? account->components : settings->component_count;
    for (size_t i = 0; !start->holds && i < components && code == SQLITE_OK; i++) {
        code = write_row(database, COMPONENT, (cell[]){cell_whole((int64_t)i), cell_text(account->component[i].name)});
    }
    return code;
}

int tl_recorder_database_begin_run(tl_recorder_database *database, const tl_record_queue_start *start, bool timed,
                                   int64_t *run) {
    const tl_recorder_known *known = find_known(database, &start->configured);
    int code = tl_recorder_database_end_killed(database);
    code = code == SQLITE_OK ? write_names(database) : code;
    code = code == SQLITE_OK ? write_run(database, start, timed) : code;
    code = code == SQLITE_OK ? write_beginning(database, start, timed) : code;
    code = code == SQLITE_OK ? write_signals(database, start) : code;
    if (code == SQLITE_OK && known != NULL) {
        code = write_row(database, CONFIGURATION, (cell[]){cell_text(known->hash), cell_text(known->text)});
    }
    *run = database->run;
    return code;
}

/* ---- Batch ---- */

size_t tl_recorder_database_batch(const tl_recorder_database *database) {
    return (size_t)database->log_limit / 4;
}

int tl_recorder_database_begin(tl_recorder_database *database, int64_t run, size_t bytes) {
    database->newest_step = run == database->run ? database->newest_step : -1;
    database->newest_sample = run == database->run ? database->newest_sample : -1;
    database->run = run;
    database->has_ledger = false;
    int code = make_room(database, bytes);
    code = code == SQLITE_OK ? run_statement(database->statements[BEGIN]) : code;
    return code == SQLITE_OK ? follow_clock(database) : code;
}

int tl_recorder_database_resume_run(tl_recorder_database *database) {
    return execute_change(database, RESUME_RUN, database->run, 0);
}

/* This process has the writer's lock, so the recorder of a run without an end was killed. The last
 * commit was at most one commit interval after the run's last step. */
int tl_recorder_database_end_killed(tl_recorder_database *database) {
    const bool is_alone = sqlite3_get_autocommit(database->connection) != 0;
    int64_t killed = 0;
    int code = is_alone ? run_statement(database->statements[BEGIN]) : SQLITE_OK;
    code = code == SQLITE_OK ? query_number(database, KILLED_RUN, 0, 0, &killed) : code;
    code = code == SQLITE_OK && killed != 0 ? tl_periods_end(database->periods, killed) : code;
    code = code == SQLITE_OK ? run_statement(database->statements[END_KILLED]) : code;
    code = code == SQLITE_OK && is_alone ? run_statement(database->statements[COMMIT]) : code;
    if (is_alone) {
        tl_recorder_database_rollback(database);
    }
    return code;
}

int tl_recorder_database_begin_at(tl_recorder_database *database, int64_t tick) {
    return write_row(database, REMOVED_BEFORE, (cell[]){cell_within(0, tick)});
}

int tl_recorder_database_checkpoint(tl_recorder_database *database, int64_t tick, const unsigned char *bytes,
                                    size_t size) {
    char digest[TL_SHA256_TEXT];
    const char *format = database->settings->format != NULL ? database->settings->format : "";
    sqlite3_stmt *prepared = database->statements[CHECKPOINT];
    if (tick < 0 || tick > last_tick(database) || size > (size_t)database->log_limit) {
        return SQLITE_OK;
    }
    tl_sha256(bytes, size, digest);
    bind_row(database, CHECKPOINT, (cell[]){cell_whole(tick), cell_text(format), cell_text(digest), no_cell});
    (void)sqlite3_bind_blob64(prepared, 5, bytes, size, SQLITE_STATIC);
    int code = run_statement(prepared);
    (void)sqlite3_clear_bindings(prepared);
    return code == SQLITE_OK ? execute_change(database, OLD_CHECKPOINTS, database->run, 0) : code;
}

static int write_sample(tl_recorder_database *database, const tl_sample *sample) {
    int code = SQLITE_OK;
    for (size_t i = 0; i < database->settings->plant_count && code == SQLITE_OK; i++) {
        const tl_time stamp = sample->stamps[i];
        const cell row[] = {cell_whole(sample->tick), cell_whole((int64_t)i), cell_number(sample->values[i]),
                            cell_whole(sample->quality[i]),
                            stamp == TL_TIME_NEVER ? no_cell : cell_within(-TL_ROW_NUMBER_MAX, stamp)};
        code = write_row(database, SAMPLE, row);
    }
    return code;
}

static int write_step(tl_recorder_database *database, const tl_record *record) {
    const cell step = cell_whole(record->step);
    const cell head[] = {step,
                         cell_whole(tl_time_of_step(0, database->settings->step, record->step + 1)),
                         cell_whole(record->outcome),
                         cell_whole(record->stop),
                         cell_number(record->objective),
                         cell_number(record->objective_nominal),
                         cell_whole(record->evaluations),
                         cell_whole(record->executions),
                         cell_within(0, record->used),
                         cell_whole(record->predicted),
                         cell_whole(record->flags),
                         cell_whole(record->held),
                         cell_whole(record->release_age)};
    int code = write_row(database, STEP, head);
    for (size_t i = 0; i < database->settings->match_count && code == SQLITE_OK; i++) {
        const tl_record_readings *readings = &record->readings[i];
        const cell row[] = {step,
                            cell_whole((int64_t)i),
                            cell_number(record->y[i]),
                            cell_number(record->measured[i]),
                            cell_whole(record->measured_quality[i]),
                            cell_whole(readings->count),
                            cell_number(readings->squares),
                            cell_whole(readings->rejected),
                            record->release_age != 0 ? cell_number(record->released[i]) : no_cell};
        code = write_row(database, OUTPUT, row);
    }
    for (size_t i = 0; i < database->settings->adjust_count && code == SQLITE_OK; i++) {
        const cell row[] = {step, cell_whole((int64_t)i), cell_number(record->u[i]), cell_number(record->nominal[i])};
        code = write_row(database, ADJUSTMENT, row);
    }
    return code;
}

/* A tuning whose text is unknown is not written, because a replay could not reproduce it. */
int tl_recorder_database_tuning(tl_recorder_database *database, const tl_run_tuning *tuning, bool *impossible) {
    const tl_recorder_known *known = find_known(database, tuning);
    const cell tick = cell_whole(tuning->tick);
    const cell hash = cell_text(tuning->hash);
    char now[TL_UTC_TEXT];
    int64_t is = 1;
    int code = SQLITE_OK;
    tl_recorder_database_now(database, now);
    if (known != NULL) {
        code = write_row(database, CONFIGURATION, (cell[]){hash, cell_text(known->text)});
    } else {
        bind_row(database, IS_CONFIGURATION, &hash);
        code = query_number(database, IS_CONFIGURATION, database->run, 0, &is);
    }
    *impossible = is == 0;
    if (code != SQLITE_OK || is == 0) {
        return code;
    }
    if (known == NULL || (known->number != 0 && known->number != tuning->number)) {
        return write_row(database, TUNING_AGAIN, (cell[]){tick, hash, cell_text(now)});
    }
    return write_row(database, TUNING,
                     (cell[]){tick, hash, cell_text(known->at != NULL ? known->at : now), cell_text(known->who),
                              cell_text(known->origin), cell_text(known->why)});
}

int tl_recorder_database_entry(tl_recorder_database *database, const tl_recorder_entry *entry, bool *impossible) {
    int64_t tick = entry->kind == TL_ENTRY_SAMPLE   ? entry->sample.tick
                   : entry->kind == TL_ENTRY_TUNING ? entry->tuning.tick
                                                    : entry->record.step;
    *impossible = tick < 0 || tick >= last_tick(database);
    if (*impossible) {
        return SQLITE_OK;
    }
    if (entry->kind == TL_ENTRY_SAMPLE) {
        database->newest_sample = tick;
        return write_sample(database, &entry->sample);
    }
    if (entry->kind == TL_ENTRY_TUNING) {
        return tl_recorder_database_tuning(database, &entry->tuning, impossible);
    }
    database->newest_step = tick;
    /* The counts of the last step are written at the commit. */
    database->has_ledger = true;
    memcpy(database->ledger, entry->ledger, database->settings->component_count * sizeof *entry->ledger);
    return write_step(database, &entry->record);
}

int tl_recorder_database_event(tl_recorder_database *database, const tl_recorder_event_entry *event) {
    char at[TL_UTC_TEXT];
    const int64_t most = INT64_MAX / 4; /* a hostile process may have written any time */
    const int64_t time = event->at < -most ? -most : event->at > most ? most : event->at;
    tl_utc_text(time + database->utc, at);
    return write_row(database, EVENT,
                     (cell[]){cell_text(at), event->tick >= 0 ? cell_within(0, event->tick) : no_cell,
                              cell_whole(event->severity), cell_text(event->source), cell_text(event->text)});
}

/* ---- Changes ---- */

int tl_recorder_database_is_removed(tl_recorder_database *database, bool *is_removed) {
    int64_t found = 0;
    int code = query_number(database, IS_REMOVED, 0, 0, &found);
    *is_removed = found != 0;
    return code;
}

int tl_recorder_database_next_normal(tl_recorder_database *database, uint32_t number, uint32_t *next) {
    int64_t found = 0;
    int code = query_number(database, NEXT_NORMAL, number, 0, &found);
    *next = found > 0 && found < UINT32_MAX / 2 ? (uint32_t)found : 0;
    return code;
}

static int write_finding(tl_recorder_database *database, const tl_run_finding *finding) {
    return write_row(database, FINDING,
                     (cell[]){cell_whole(finding->number), cell_text(finding->kind), cell_text(finding->subject),
                              cell_text(finding->variable), cell_text(finding->says), cell_text(finding->unit),
                              cell_number(finding->onset), cell_number(finding->onset_spread),
                              cell_number(finding->found), cell_number(finding->gone), cell_number(finding->size),
                              cell_number(finding->size_spread), cell_number(finding->percent),
                              cell_text(finding->also), cell_text(finding->cause), cell_text(finding->state)});
}

int tl_recorder_database_changes(tl_recorder_database *database, const tl_run_changes *changes) {
    const tl_run_detection *detection = &changes->detection;
    sqlite3_stmt *prepared = database->statements[LEARNED];
    char digest[TL_SHA256_TEXT];
    char now[TL_UTC_TEXT];
    bool is_removed = false;
    int code = tl_recorder_database_is_removed(database, &is_removed);
    if (code != SQLITE_OK || (is_removed && !changes->is_new && strcmp(database->settings->verb, "run") == 0)) {
        return code; /* the caller does not know it yet */
    }
    code = changes->is_new ? run_statement(database->statements[OPEN_FINDINGS]) : SQLITE_OK;
    for (size_t i = 0; i < changes->count && code == SQLITE_OK; i++) {
        code = write_finding(database, &changes->finding[i]);
    }
    if (code != SQLITE_OK) {
        return code;
    }
    size_t size = changes->size <= (size_t)database->log_limit ? changes->size : 0;
    tl_sha256(changes->learned, size, digest);
    tl_recorder_database_now(database, now);
    bind_row(database, LEARNED,
             (cell[]){cell_text(now), cell_text(detection->is_ready ? "watching" : "learning"),
                      cell_number(detection->learnt), cell_number(detection->needed), cell_number(detection->watched),
                      cell_text(digest), no_cell});
    (void)sqlite3_bind_blob64(prepared, 8, changes->learned, size, SQLITE_STATIC);
    code = run_statement(prepared);
    (void)sqlite3_clear_bindings(prepared);
    return code;
}

int tl_recorder_database_learned(tl_recorder_database *database, unsigned char **bytes, size_t *size,
                                 uint32_t *last_finding) {
    sqlite3_stmt *prepared = database->statements[READ_LEARNED];
    char digest[TL_SHA256_TEXT];
    int64_t last = 0;
    *bytes = NULL;
    *size = 0;
    int code = query_number(database, LAST_FINDING, 0, 0, &last);
    *last_finding = last > 0 && last < UINT32_MAX / 2 ? (uint32_t)last : 0;
    code = code == SQLITE_OK ? sqlite3_step(prepared) : code;
    if (code == SQLITE_ROW) {
        const void *found = sqlite3_column_blob(prepared, 0);
        const char *expected = (const char *)sqlite3_column_text(prepared, 1);
        *size = (size_t)sqlite3_column_bytes(prepared, 0);
        *bytes = found != NULL && expected != NULL && *size != 0 ? malloc(*size) : NULL;
        if (*bytes != NULL) {
            memcpy(*bytes, found, *size);
            tl_sha256(*bytes, *size, digest);
        }
        if (*bytes == NULL || strcmp(digest, expected) != 0) {
            free(*bytes);
            *bytes = NULL;
        }
    }
    (void)sqlite3_reset(prepared);
    return code == SQLITE_ROW || code == SQLITE_DONE ? SQLITE_OK : code;
}

static void bind_totals(tl_recorder_database *database, statement which, const tl_recorder_totals *totals) {
    bind_row(database, which,
             (cell[]){cell_count(totals->samples), cell_count(totals->steps), cell_count(totals->events),
                      cell_count(totals->lost), cell_text(totals->committed)});
}

int tl_recorder_database_has(tl_recorder_database *database, int64_t run, const tl_recorder_totals *totals, bool *has) {
    int64_t found = 0;
    bind_totals(database, HAS_TOTALS, totals);
    int code = query_number(database, HAS_TOTALS, run, 0, &found);
    *has = found != 0;
    return code;
}

int tl_recorder_database_commit(tl_recorder_database *database, const tl_recorder_totals *totals, const char *reason) {
    int code = SQLITE_OK;
    for (size_t i = 0; database->has_ledger && i < database->settings->component_count && code == SQLITE_OK; i++) {
        const tl_execution_counts *component = &database->ledger[i];
        const cell row[] = {cell_whole((int64_t)i),           cell_count(component->plain),
                            cell_count(component->predicted), cell_count(component->executions),
                            cell_count(component->repeated),  cell_count(component->uncached)};
        code = write_row(database, LEDGER, row);
    }
    if (code == SQLITE_OK) {
        bind_totals(database, TOTALS, totals);
        code = run_statement(database->statements[TOTALS]);
    }
    if (code == SQLITE_OK) {
        code = reason != NULL
                   ? tl_periods_end(database->periods, database->run)
                   : tl_periods_until(database->periods, database->run, database->newest_step, database->newest_sample);
    }
    if (code == SQLITE_OK && reason != NULL) {
        code = write_row(database, END, (cell[]){cell_text(reason)});
    }
    return code == SQLITE_OK ? run_statement(database->statements[COMMIT]) : code;
}

void tl_recorder_database_rollback(tl_recorder_database *database) {
    if (sqlite3_get_autocommit(database->connection) == 0) {
        (void)run_statement(database->statements[ROLLBACK]);
        database->utc = INT64_MIN; /* what was moved is not moved any more */
        database->newest_step = database->newest_sample = -1;
        tl_periods_forget(database->periods);
    }
}

unsigned tl_recorder_database_writings_back(const tl_recorder_database *database) {
    return database->writings_back;
}

/* ---- Opening ---- */

int tl_recorder_database_open(sqlite3 *connection, const tl_recorder_settings *settings,
                              tl_recorder_database **database) {
    char sql[64];
    assert(settings->plant_count <= TL_MAX_SIGNALS && settings->match_count <= TL_MAX_MATCH &&
           settings->adjust_count <= TL_MAX_ADJUST && settings->component_count <= TL_RECORDER_COMPONENTS &&
           settings->step > 0 && (settings->max_bytes == 0 || settings->max_bytes >= LEAST_BYTES));
    tl_recorder_database *opened = calloc(1, sizeof *opened);
    *database = opened;
    if (opened == NULL) {
        return SQLITE_NOMEM;
    }
    opened->connection = connection;
    opened->settings = settings;
    opened->utc = INT64_MIN;
    opened->newest_step = opened->newest_sample = -1;
    opened->log_limit = log_limit(settings->max_bytes);
    (void)sqlite3_wal_hook(connection, count_frames, opened);
    (void)snprintf(sql, sizeof sql, "PRAGMA journal_size_limit = %lld", (long long)(2 * opened->log_limit));
    int code = sqlite3_exec(connection, sql, NULL, NULL, NULL);
    for (int i = 0; i < STATEMENTS && code == SQLITE_OK; i++) {
        code = sqlite3_prepare_v3(connection, sql_of[i], -1, SQLITE_PREPARE_PERSISTENT, &opened->statements[i], NULL);
    }
    code = code == SQLITE_OK ? tl_periods_open(connection, &opened->periods) : code;
    return code == SQLITE_OK ? query_number(opened, PAGE_SIZE, 0, 4096, &opened->page_size) : code;
}

void tl_recorder_database_close(tl_recorder_database *database) {
    if (database != NULL) {
        for (int i = 0; i < STATEMENTS; i++) {
            (void)sqlite3_finalize(database->statements[i]);
        }
        tl_periods_close(database->periods);
        free(database);
    }
}
