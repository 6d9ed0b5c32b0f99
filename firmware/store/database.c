/* Opens, creates and validates twinlock databases: see database.h. */
#include "firmware/store/database.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/store/periods.h"

/* ---- Schema: one statement for each table, index and view. config/SPEC.md, "Database", defines
 * their meaning; keep both consistent.
 *
 * Columns for values of signals and variables have no type, because a REAL column stores 5.0 as the
 * integer 5. That would change −0.0 to 0.0, but a replay must use the same bits.
 */

/* What the change detector has learnt: one row, and bytes for the next process. */
#define LEARNED_TABLE                                                                                                  \
    "CREATE TABLE learned ("                                                                                           \
    "  id INTEGER PRIMARY KEY CHECK (id = 1),"                                                                         \
    "  run INTEGER NOT NULL,"                                                                                          \
    "  at TEXT NOT NULL,"                                                                                              \
    "  state TEXT NOT NULL,"                                                                                           \
    "  learnt_s,"                                                                                                      \
    "  needed_s,"                                                                                                      \
    "  watched_s,"                                                                                                     \
    "  sha256 TEXT NOT NULL,"                                                                                          \
    "  bytes BLOB NOT NULL)"

/* Findings outlive the data of their run. Times count from t_start of `run`, which has written the
 * row last; `…_at` is UTC, in live runs. */
#define FINDINGS_TABLE                                                                                                 \
    "CREATE TABLE findings ("                                                                                          \
    "  finding INTEGER PRIMARY KEY,"                                                                                   \
    "  run INTEGER NOT NULL,"                                                                                          \
    "  kind TEXT NOT NULL,"                                                                                            \
    "  subject TEXT NOT NULL,"                                                                                         \
    "  variable TEXT NOT NULL,"                                                                                        \
    "  says TEXT NOT NULL,"                                                                                            \
    "  unit TEXT NOT NULL,"                                                                                            \
    "  onset_s,"                                                                                                       \
    "  onset_spread_s,"                                                                                                \
    "  found_s,"                                                                                                       \
    "  gone_s,"                                                                                                        \
    "  onset_at TEXT,"                                                                                                 \
    "  found_at TEXT,"                                                                                                 \
    "  gone_at TEXT,"                                                                                                  \
    "  size,"                                                                                                          \
    "  size_spread,"                                                                                                   \
    "  percent,"                                                                                                       \
    "  also TEXT NOT NULL,"                                                                                            \
    "  cause TEXT NOT NULL,"                                                                                           \
    "  state TEXT NOT NULL,"                                                                                           \
    "  acknowledged_at TEXT,"                                                                                          \
    "  acknowledged_by TEXT,"                                                                                          \
    "  note TEXT,"                                                                                                     \
    "  explained_at TEXT,"                                                                                             \
    "  explanation TEXT)"

/* clang-format off: it cannot break literals around a macro */
/* Instant of a live run, `seconds` since t_start: UTC, and seconds since 1970; NULL in a replay. */
#define INSTANT_OF(seconds)                                                                                            \
    "  CASE r.verb WHEN 'replay' THEN NULL ELSE"                                                                       \
    "    strftime('%Y-%m-%dT%H:%M:%fZ', r.started, printf('%.3f seconds', " seconds ")) END AS at,"                    \
    "  CASE r.verb WHEN 'replay' THEN NULL ELSE"                                                                       \
    "    round((julianday(r.started) - 2440587.5) * 86400 + " seconds ", 3) END AS epoch,"

#define PERIODS_VIEW(name, length_s)                                                                                                \
    "CREATE VIEW " name " AS SELECT p.run, p.period * " length_s " AS time_s," INSTANT_OF(                                          \
        "p.period * " length_s) "  p.kind, coalesce(n.name, o.name) AS name, p.count, p.mean, p.least, p.largest, p.spread, n.unit" \
                                "  FROM periods p JOIN runs r USING (run)"                                                          \
                                "  LEFT JOIN signals n ON n.run = p.run AND n.kind = p.kind AND n.signal = p.signal"                \
                                "  LEFT JOIN outcomes o ON p.kind = 'outcome' AND o.code = p.signal"                                \
                                "  WHERE p.length_s = " length_s

static const char *const schema[] = {
    /* Codes and their names; the recorder writes the program's names when a run begins. */
    "CREATE TABLE outcomes (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE stops (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE qualities (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE severities (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE flags (bit INTEGER PRIMARY KEY, name TEXT NOT NULL)",

    "CREATE TABLE configurations ("
    "  hash TEXT PRIMARY KEY NOT NULL," /* SHA-256 of the text */
    "  text TEXT NOT NULL)",

    "CREATE TABLE runs ("
    "  run INTEGER PRIMARY KEY,"
    "  verb TEXT NOT NULL,"
    "  name TEXT NOT NULL,"
    "  version TEXT NOT NULL,"
    "  configuration TEXT NOT NULL REFERENCES configurations (hash),"
    "  started TEXT NOT NULL,"
    "  ended TEXT,"
    "  ended_reason TEXT,"
    "  committed TEXT,"
    "  step_ns INTEGER NOT NULL,"
    "  prediction INTEGER NOT NULL,"
    "  measurements TEXT NOT NULL,"
    "  samples_written INTEGER NOT NULL DEFAULT 0,"
    "  steps_written INTEGER NOT NULL DEFAULT 0,"
    "  events_written INTEGER NOT NULL DEFAULT 0,"
    "  entries_lost INTEGER NOT NULL DEFAULT 0,"
    "  removed_before INTEGER,"
    "  lead INTEGER NOT NULL DEFAULT 0,"
    "  start_s," /* NULL in a run without a twin */
    "  stop_s)",

    "CREATE TABLE signals ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  kind TEXT NOT NULL CHECK (kind IN ('plant', 'match', 'adjust')),"
    "  signal INTEGER NOT NULL,"
    "  name TEXT NOT NULL,"
    "  unit TEXT NOT NULL,"
    "  type TEXT NOT NULL,"
    "  compared_with TEXT,"
    "  PRIMARY KEY (run, kind, signal)) WITHOUT ROWID",

    "CREATE TABLE samples ("
    "  run INTEGER NOT NULL,"
    "  tick INTEGER NOT NULL,"
    "  signal INTEGER NOT NULL,"
    "  value,"
    "  quality INTEGER NOT NULL,"
    "  stamp_ns INTEGER,"
    "  PRIMARY KEY (run, tick, signal)) WITHOUT ROWID",

    "CREATE TABLE steps ("
    "  run INTEGER NOT NULL,"
    "  step INTEGER NOT NULL,"
    "  t_ns INTEGER NOT NULL,"
    "  outcome INTEGER NOT NULL,"
    "  stop INTEGER NOT NULL,"
    "  J,"
    "  J_nominal,"
    "  evaluations INTEGER NOT NULL,"
    "  executions INTEGER NOT NULL,"
    "  used_ns INTEGER NOT NULL,"
    "  predicted INTEGER," /* the recorder always writes these three */
    "  flags INTEGER,"
    "  held INTEGER,"
    "  release_age INTEGER,"
    "  PRIMARY KEY (run, step)) WITHOUT ROWID",

    "CREATE TABLE outputs ("
    "  run INTEGER NOT NULL,"
    "  step INTEGER NOT NULL,"
    "  signal INTEGER NOT NULL,"
    "  simulated,"
    "  measured,"
    "  quality INTEGER NOT NULL,"
    "  error AS (simulated - measured),"
    "  readings INTEGER," /* always written, except that squares is NULL if not finite */
    "  squares,"
    "  rejected INTEGER,"
    "  released,"
    "  PRIMARY KEY (run, step, signal)) WITHOUT ROWID",

    "CREATE TABLE adjustments ("
    "  run INTEGER NOT NULL,"
    "  step INTEGER NOT NULL,"
    "  signal INTEGER NOT NULL,"
    "  applied,"
    "  nominal,"
    "  correction AS (applied - nominal),"
    "  PRIMARY KEY (run, step, signal)) WITHOUT ROWID",

    "CREATE TABLE components ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  component INTEGER NOT NULL,"
    "  name TEXT NOT NULL,"
    "  plain INTEGER NOT NULL DEFAULT 0,"
    "  predicted INTEGER NOT NULL DEFAULT 0,"
    "  executions INTEGER NOT NULL DEFAULT 0,"
    "  repeated INTEGER NOT NULL DEFAULT 0,"
    "  uncached INTEGER NOT NULL DEFAULT 0,"
    "  PRIMARY KEY (run, component)) WITHOUT ROWID",

    /* Data that a restart needs to resume a run. */
    "CREATE TABLE beginnings ("
    "  run INTEGER PRIMARY KEY REFERENCES runs (run),"
    "  fmus TEXT NOT NULL," /* SHA-256 over the SHA-256 of the files */
    "  boot TEXT NOT NULL," /* of the system; start_ns is on its clock */
    "  start_ns INTEGER,"
    "  resumed_run INTEGER,"
    "  resumed_tick INTEGER,"
    "  resumed_from TEXT)",

    "CREATE TABLE checkpoints ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  tick INTEGER NOT NULL,"
    "  format TEXT NOT NULL,"
    "  sha256 TEXT NOT NULL,"
    "  bytes BLOB NOT NULL,"
    "  PRIMARY KEY (run, tick))",

    /* Configurations that a run switched to. */
    "CREATE TABLE tunings ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  tick INTEGER NOT NULL," /* first tick with it */
    "  configuration TEXT NOT NULL REFERENCES configurations (hash),"
    "  at TEXT NOT NULL,"
    "  who TEXT NOT NULL,"
    "  origin TEXT NOT NULL,"
    "  why TEXT NOT NULL,"
    "  PRIMARY KEY (run, tick)) WITHOUT ROWID",

    "CREATE TABLE events ("
    "  event INTEGER PRIMARY KEY,"
    "  run INTEGER NOT NULL,"
    "  at TEXT NOT NULL,"
    "  tick INTEGER,"
    "  severity INTEGER NOT NULL,"
    "  source TEXT NOT NULL,"
    "  text TEXT NOT NULL)",
    "CREATE INDEX events_of_run ON events (run, event)",

    LEARNED_TABLE,
    FINDINGS_TABLE,
    TL_PERIODS_TABLE,

    PERIODS_VIEW("v_minutes", "60"),
    PERIODS_VIEW("v_hours", "3600"),

    "CREATE VIEW v_runs AS SELECT run, verb, name, started,"
    "  coalesce(ended, 'running') AS ended, ended_reason,"
    "  step_ns / 1e9 AS step_s, samples_written, steps_written, events_written, entries_lost, removed_before,"
    "  version, substr(configuration, 1, 12) AS configuration FROM runs",

    /* UTC of the instant t_ns of a run; only a live run has one. */
    "CREATE VIEW v_samples AS SELECT s.run, s.tick, s.tick * r.step_ns / 1e9 AS time_s," INSTANT_OF(
        "s.tick * r.step_ns / 1e9") "  n.name, s.value, n.unit, coalesce(q.name, s.quality) AS quality,"
                                    "  s.tick * r.step_ns / 1e9 - s.stamp_ns / 1e9 AS age_s"
                                    "  FROM samples s JOIN runs r USING (run)"
                                    "  LEFT JOIN signals n ON n.run = s.run AND n.kind = 'plant' AND n.signal = s.signal"
                                    "  LEFT JOIN qualities q ON q.code = s.quality",

    /* Names of set bits; NULL if no bit is set. */
    "CREATE VIEW v_steps AS SELECT s.run, s.step, s.t_ns / 1e9 AS time_s," INSTANT_OF(
        "s.t_ns / 1e9") "  coalesce(o.name, s.outcome) AS outcome, coalesce(t.name, s.stop) AS stop, s.J, s.J_nominal,"
                        "  s.evaluations, s.executions, s.used_ns / 1e6 AS used_ms, s.predicted,"
                        "  (SELECT group_concat(f.name, ', ') FROM flags f WHERE s.flags & f.bit) AS flags,"
                        "  (SELECT group_concat(n.name, ', ') FROM signals n"
                        "    WHERE n.run = s.run AND n.kind = 'adjust' AND (s.held >> n.signal) & 1) AS held"
                        "  FROM steps s JOIN runs r USING (run)"
                        "  LEFT JOIN outcomes o ON o.code = s.outcome LEFT JOIN stops t ON t.code = s.stop",

    "CREATE VIEW v_outputs AS SELECT s.run, s.step, (s.step + 1) * r.step_ns / 1e9 AS time_s," INSTANT_OF(
        "(s.step + 1) * r.step_ns / 1e9") "  n.name, s.simulated, n.compared_with, s.measured, s.error, s.released, n.unit,"
                                          "  coalesce(q.name, s.quality) AS quality"
                                          "  FROM outputs s JOIN runs r USING (run)"
                                          "  LEFT JOIN signals n ON n.run = s.run AND n.kind = 'match' AND n.signal = s.signal"
                                          "  LEFT JOIN qualities q ON q.code = s.quality",

    "CREATE VIEW v_corrections AS SELECT s.run, s.step, s.step * r.step_ns / 1e9 AS time_s," INSTANT_OF(
        "s.step * r.step_ns / 1e9") "  n.name, s.applied, s.nominal, s.correction, n.unit"
                                    "  FROM adjustments s JOIN runs r USING (run)"
                                    "  LEFT JOIN signals n ON n.run = s.run AND n.kind = 'adjust' AND n.signal = s.signal",

    "CREATE VIEW v_events AS SELECT e.run, e.at, e.tick, coalesce(v.name, e.severity) AS severity, e.source, e.text"
    "  FROM events e LEFT JOIN severities v ON v.code = e.severity ORDER BY e.event",

    "CREATE VIEW v_ledger AS SELECT c.run, c.name AS component, c.plain, c.predicted, c.executions,"
    "  c.plain - c.executions AS saved, c.repeated, c.uncached,"
    "  c.executions - c.repeated - c.predicted AS difference"
    "  FROM components c ORDER BY c.run, c.component",

    "CREATE VIEW v_tunings AS SELECT t.run, t.tick, t.tick * r.step_ns / 1e9 AS time_s, t.at,"
    "  substr(t.configuration, 1, 12) AS configuration, t.who, t.origin, t.why"
    "  FROM tunings t JOIN runs r USING (run) ORDER BY t.run, t.tick",
};
/* clang-format on */

/* ---- Database fault ---- */

static __thread tl_database_fault last_fault;

tl_database_fault tl_database_get_fault(void) {
    return last_fault;
}

void tl_database_set_fault(tl_database_fault fault) {
    last_fault = fault;
}

tl_database_fault tl_database_fault_of_errno(int number) {
    switch (number) {
    case EACCES:
    case EPERM:
    case EROFS:
    case ELOOP:
        return TL_DATABASE_DENIED;
    default:
        return TL_DATABASE_LATER;
    }
}

tl_database_fault tl_database_fault_of(int code, int number) {
    switch (code & 0xFF) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
        return TL_DATABASE_DAMAGED;
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_AUTH:
        return TL_DATABASE_DENIED;
    case SQLITE_CANTOPEN:
        return tl_database_fault_of_errno(number);
    case SQLITE_IOERR: /* of a medium that cannot be read any more */
        return code == SQLITE_IOERR_READ || code == SQLITE_IOERR_CORRUPTFS ? TL_DATABASE_DENIED : TL_DATABASE_LATER;
    case SQLITE_ERROR: /* the tables do not match our statements */
    case SQLITE_MISMATCH:
    case SQLITE_CONSTRAINT:
    case SQLITE_SCHEMA:
    case SQLITE_TOOBIG:
    case SQLITE_INTERRUPT:
        return TL_DATABASE_FOREIGN;
    default:
        return TL_DATABASE_LATER;
    }
}

tl_status tl_database_refuse(tl_database_fault fault, tl_error *error, tl_status status, const char *format, ...) {
    char text[TL_ERROR_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    last_fault = fault;
    return tl_fail(error, status, "%s", text);
}

/* ---- SQL statements ---- */

void tl_database_text(sqlite3 *database, int code, char *text, size_t size) {
    char buffer[128];
    bool known = database != NULL && sqlite3_extended_errcode(database) == code; /* else another call has followed */
    int number = known ? sqlite3_system_errno(database) : 0;
    int primary = code & 0xFF;
    bool is_of_system =
        primary == SQLITE_CANTOPEN || primary == SQLITE_IOERR || primary == SQLITE_FULL || primary == SQLITE_READONLY;
    const char *message = known ? sqlite3_errmsg(database) : sqlite3_errstr(code);
    if (code == SQLITE_READONLY_DBMOVED) {
        (void)snprintf(text, size, "the file was moved or removed while it was being written");
    } else if (primary == SQLITE_INTERRUPT) {
        (void)snprintf(text, size, "a query exceeded its limit: the file is probably damaged");
    } else if (primary == SQLITE_BUSY) {
        (void)snprintf(text, size,
                       "another program has locked the database, or reads it for too long: end that program");
    } else if (number != 0 && is_of_system) {
        (void)snprintf(text, size, "%s (%s)", message, strerror_r(number, buffer, sizeof buffer));
    } else {
        (void)snprintf(text, size, "%s", message);
    }
}

tl_status tl_database_fail(sqlite3 *database, int code, tl_error *error) {
    char text[TL_ERROR_TEXT];
    const char *path = database == NULL ? NULL : sqlite3_db_filename(database, "main");
    tl_database_text(database, code, text, sizeof text);
    tl_database_fault fault = tl_database_fault_of(code, database == NULL ? 0 : sqlite3_system_errno(database));
    bool is_bad = fault == TL_DATABASE_DAMAGED || fault == TL_DATABASE_FOREIGN;
    tl_status status = is_bad ? TL_BAD_DATA : TL_TRY_AGAIN;
    if (database != NULL && is_bad) {
        (void)tl_database_invalid(database, error, "%s", text);
    } else {
        (void)tl_fail(error, status, "%s: %s", path == NULL ? "database" : path, text);
    }
    last_fault = fault;
    return status;
}

tl_status tl_database_execute(sqlite3 *database, const char *sql, tl_error *error) {
    int code = sqlite3_exec(database, sql, NULL, NULL, NULL);
    return code == SQLITE_OK ? TL_OK : tl_database_fail(database, code, error);
}

tl_status tl_database_prepare(sqlite3 *database, const char *sql, sqlite3_stmt **statement, tl_error *error) {
    int code = sqlite3_prepare_v3(database, sql, -1, SQLITE_PREPARE_PERSISTENT, statement, NULL);
    return code == SQLITE_OK ? TL_OK : tl_database_fail(database, code, error);
}

tl_status tl_database_invalid(sqlite3 *database, tl_error *error, const char *format, ...) {
    char what[256];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                              "%s: is damaged: %s; restore a copy, or record into another file",
                              sqlite3_db_filename(database, "main"), what);
}

/* ---- Protection against untrusted files ---- */

/* Our statements need some thousand instructions of SQLite's virtual machine; one over a long run
 * needs some million. */
enum { INSTRUCTIONS_PER_CALL = 1000 * 1000, MOST_CALLS = 50 };

static __thread int limit_calls; /* how often the instructions of the present statement were counted */

/* ---- Limits of a statement ---- */

static int begin_statement(unsigned event, void *context, void *statement, void *text) {
    (void)event;
    (void)context;
    (void)statement;
    (void)text;
    limit_calls = 0;
    return 0;
}

static int check_limit(void *context) {
    (void)context;
    return ++limit_calls > MOST_CALLS;
}

/* Restricts a new connection; call it before the first SQL. A statement that exceeds its time limit
 * then fails with SQLITE_INTERRUPT. */
static void guard_connection(sqlite3 *database) {
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
    sqlite3_progress_handler(database, INSTRUCTIONS_PER_CALL, check_limit, NULL);
}

/* ---- Damage ---- */

int64_t tl_database_size(sqlite3 *database, int which) {
    sqlite3_file *file = NULL;
    sqlite3_int64 size = 0;
    bool is_known = sqlite3_file_control(database, "main", which, &file) == SQLITE_OK && file != NULL &&
                    file->pMethods != NULL && file->pMethods->xFileSize(file, &size) == SQLITE_OK;
    return is_known ? size : -1;
}

void tl_database_diagnose(sqlite3 *database, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    int64_t size = tl_database_size(database, SQLITE_FCNTL_FILE_POINTER);
    if (size < 0 || size > TL_DATABASE_DIAGNOSED ||
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

/* ---- Validation of the schema ---- */

/* Returns the text of a query; "" if there is no row. */
static tl_status query_text(sqlite3 *database, const char *sql, char *text, size_t size, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(database, sql, &statement, error);
    text[0] = '\0';
    if (status != TL_OK) {
        return status;
    }
    int code = sqlite3_step(statement);
    if (code == SQLITE_ROW) {
        const char *found = (const char *)sqlite3_column_text(statement, 0);
        (void)snprintf(text, size, "%s", found == NULL ? "nothing" : found);
    } else if (code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* Returns TL_BAD_DATA if the file contains code that SQLite would run, or if one of our tables is
 * not a table or has another key. Keys matter because rows are read in key order without sorting. A
 * missing table is no damage here; the statement that needs it fails. */
static tl_status check_schema(sqlite3 *database, tl_error *error) {
    static const char sql[] =
        "WITH keys (name, columns) AS (VALUES ('configurations', 'hash'), ('runs', 'run'),"
        "  ('signals', 'run, kind, signal'), ('samples', 'run, tick, signal'), ('steps', 'run, step'),"
        "  ('outputs', 'run, step, signal'), ('adjustments', 'run, step, signal'), ('components', 'run, component'),"
        "  ('beginnings', 'run'), ('checkpoints', 'run, tick'), ('tunings', 'run, tick'), ('events', 'event'),"
        "  ('severities', 'code'), ('learned', 'id'), ('findings', 'finding'),"
        "  ('periods', 'length_s, run, period, kind, signal'))"
        " SELECT 'it has the ' || iif(type = 'trigger', type, 'virtual table') || ' \"' || substr(name, 1, 60) ||"
        "  '\", which twinlock never creates' FROM sqlite_schema WHERE type = 'trigger' OR"
        "  (type = 'table' AND rootpage IS NOT NULL AND rootpage < 1)"
        " UNION ALL SELECT iif(type = 'table', 'its table ' || name || ' has another key than twinlock creates',"
        "  name || ' is not a table') FROM keys JOIN sqlite_schema USING (name) WHERE type <> 'table' OR columns IS NOT"
        "  (SELECT group_concat(name, ', ') FROM"
        "    (SELECT name FROM pragma_table_xinfo(keys.name) WHERE pk > 0 ORDER BY pk))";
    char found[300];
    tl_status status = query_text(database, sql, found, sizeof found, error);
    return status == TL_OK && found[0] != '\0' ? tl_database_invalid(database, error, "%s", found) : status;
}

/* ---- Recognising, opening and creating a twinlock database.
 *
 * Recognising: SQLite's header is the first 100 bytes of the file: the magic text, at byte 60
 *              user_version and at byte 68 application_id, both big-endian. They are read through
 *              SQLite's own file handle before any SQL runs. So no lock is taken, no journal is
 *              rolled back, and no -wal file appears beside a foreign file. (Closing a file
 *              descriptor of our own would release SQLite's POSIX locks.)
 * Creating:    under an unused name, then renamed. So a power cut leaves a complete database or
 *              none, and the header is always in the file itself, not in its write-ahead log.
 *              Renaming replaces no file.
 * Formats:     SQL reads user_version again, because that of another program may still be in the
 *              write-ahead log.
 */

enum { HEADER = 100, VERSION_AT = 60, APPLICATION_AT = 68, JOURNAL = sizeof "-journal" };

static uint32_t big_endian(const unsigned char *bytes) {
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | (uint32_t)bytes[3];
}

static tl_status check_version(const char *path, int64_t version, tl_error *error) {
    if (version == TL_DATABASE_VERSION) {
        return TL_OK;
    }
    return tl_database_refuse(TL_DATABASE_OTHER_FORMAT, error, TL_BAD_DATA,
                              "%s: the database has format %lld, and this program reads format %d: use the "
                              "version of twinlock that wrote it, or move the file away",
                              path, (long long)version, TL_DATABASE_VERSION);
}

static tl_status check_header(const unsigned char header[HEADER], int64_t size, const char *path, tl_error *error) {
    bool is_sqlite = memcmp(header, "SQLite format 3", 16) == 0;
    bool is_ours = is_sqlite && big_endian(header + APPLICATION_AT) == TL_DATABASE_APPLICATION;
    if (size < HEADER && is_ours) {
        return tl_database_refuse(TL_DATABASE_DAMAGED, error, TL_BAD_DATA,
                                  "%s: is damaged: its header has only %lld bytes", path, (long long)size);
    }
    if (size < HEADER) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: is not a twinlock database: it has only %lld bytes", path, (long long)size);
    }
    if (!is_sqlite) {
        return tl_database_refuse(
            TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
            "%s: is not a twinlock database, not SQLite (expected the .db of a run, or a new name)", path);
    }
    if (!is_ours) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: is not a twinlock database: another program created this SQLite file", path);
    }
    return check_version(path, big_endian(header + VERSION_AT), error);
}

tl_status tl_database_recognise(sqlite3 *database, const char *path, tl_error *error) {
    sqlite3_file *file = NULL;
    unsigned char header[HEADER] = {0};
    int64_t size = tl_database_size(database, SQLITE_FCNTL_FILE_POINTER);
    if (size < 0) {
        return tl_database_refuse(TL_DATABASE_LATER, error, TL_TRY_AGAIN, "%s: cannot be read", path);
    }
    (void)sqlite3_file_control(database, "main", SQLITE_FCNTL_FILE_POINTER, &file);
    int code = size == 0 ? SQLITE_OK : file->pMethods->xRead(file, header, HEADER, 0);
    if (code != SQLITE_OK && code != SQLITE_IOERR_SHORT_READ) { /* bytes beyond the end read as zeros */
        return tl_database_refuse(TL_DATABASE_DENIED, error, TL_TRY_AGAIN, "%s: cannot be read (%s)", path,
                                  sqlite3_errstr(code));
    }
    return check_header(header, size, path, error);
}

/* SQLite does not know the name of a file that it could not open. */
static tl_status open_connection(const char *name, int flags, sqlite3 **database, tl_error *error) {
    char why[TL_ERROR_TEXT];
    int code = sqlite3_open_v2(name, database, flags | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE, NULL);
    if (code == SQLITE_OK) {
        guard_connection(*database);
        return TL_OK;
    }
    tl_database_text(*database, code, why, sizeof why);
    tl_status status = tl_fail(error, tl_database_fail(*database, code, NULL), "%s: %s", name, why);
    (void)sqlite3_close(*database);
    *database = NULL;
    return status;
}

/* The databases of a service can be read by members of its group only. */
static tl_status name_group(tl_status status, tl_error *error) {
    static const char hint[] = "; for the database of a service: sudo adduser $USER twinlock, then log in again";
    if (error != NULL && tl_database_get_fault() == TL_DATABASE_DENIED) {
        size_t length = strlen(error->text);
        (void)snprintf(error->text + length, sizeof error->text - length, "%s", hint);
    }
    return status;
}

/* "file:PATH?immutable=1", with special bytes of a URI as %XX. */
static char *immutable_uri(const char *path) {
    static const char plain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~/";
    char *uri = malloc(strlen(path) * 3 + sizeof "file:?immutable=1");
    if (uri == NULL) {
        return NULL;
    }
    char *end = uri + sprintf(uri, "file:");
    for (const char *c = path; *c != '\0'; c++) {
        end += sprintf(end, strchr(plain, *c) != NULL ? "%c" : "%%%02X", (unsigned)(unsigned char)*c);
    }
    (void)sprintf(end, "?immutable=1");
    return uri;
}

/* For a database on a read-only medium without a -wal file: no data can be missing and nothing can
 * change. */
static tl_status open_immutable(const char *path, sqlite3 **database, tl_error *error) {
    char *uri = immutable_uri(path);
    if (uri == NULL) {
        return tl_database_refuse(TL_DATABASE_LATER, error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    tl_status status = open_connection(uri, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, database, error);
    free(uri);
    return status;
}

static bool has_wal(const char *path) {
    char name[PATH_MAX];
    struct stat status;
    int length = snprintf(name, sizeof name, "%s-wal", path);
    return length > 0 && length < PATH_MAX && stat(name, &status) == 0 && status.st_size > 0;
}

/* Executes the first SQL. This creates -wal and -shm files; for reading without permission to
 * create them, opens the file as immutable if it has no -wal file. */
static tl_status first_read(const char *path, bool write, sqlite3 **database, tl_error *error) {
    static const char sql[] = "SELECT 1 FROM sqlite_schema LIMIT 1";
    int code = sqlite3_exec(*database, sql, NULL, NULL, NULL);
    if (!write && ((code & 0xFF) == SQLITE_CANTOPEN || (code & 0xFF) == SQLITE_READONLY) && !has_wal(path)) {
        (void)sqlite3_close(*database);
        *database = NULL;
        tl_status status = open_immutable(path, database, error);
        if (status != TL_OK) {
            return status;
        }
        code = sqlite3_exec(*database, sql, NULL, NULL, NULL);
    }
    return code == SQLITE_OK ? TL_OK : tl_database_fail(*database, code, error);
}

tl_status tl_database_open(const char *path, bool write, sqlite3 **database, tl_error *error) {
    static const char pragmas[] = "PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0; PRAGMA temp_store = MEMORY;";
    char version[32];
    struct stat file;
    *database = NULL;
    if (stat(path, &file) != 0) {
        int number = errno;
        tl_status status = number == ENOENT || number == ENOTDIR ? TL_BAD_DATA : TL_TRY_AGAIN;
        char other[TL_OTHER_CASE_TEXT];
        status = tl_database_refuse(tl_database_fault_of_errno(number), error, status, "%s: %s%s%s", path,
                                    strerror(number), tl_other_case(path, other),
                                    write || number != ENOENT ? "" : ": `run` and `replay` write one with --db");
        return write || number != EACCES ? status : name_group(status, error);
    }
    if (!S_ISREG(file.st_mode)) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA, "%s: is not a regular file", path);
    }
    /* Readers open for writing too, so that the last one to close removes -wal and -shm. SQLite
     * falls back to reading if the file or the medium is read-only. */
    tl_status status = open_connection(path, SQLITE_OPEN_READWRITE, database, error);
    if (status != TL_OK) {
        return write ? status : name_group(status, error);
    }
    (void)sqlite3_busy_timeout(*database, 2000);
    status = tl_database_recognise(*database, path, error); /* before any SQL */
    if (status == TL_OK && write && sqlite3_db_readonly(*database, "main") == 1) {
        status =
            tl_database_refuse(TL_DATABASE_DENIED, error, TL_TRY_AGAIN,
                               "%s: is not writable: check its permissions, and whether the disk is read-only", path);
    }
    if (status == TL_OK) {
        status = first_read(path, write, database, error);
    }
    if (status == TL_OK) {
        status = tl_database_execute(*database, pragmas, error);
    }
    if (status == TL_OK) {
        status = query_text(*database, "PRAGMA user_version", version, sizeof version, error);
    }
    if (status == TL_OK) { /* user_version as SQL reads it */
        status = check_version(path, strtoll(version, NULL, 10), error);
    }
    if (status == TL_OK) {
        status = check_schema(*database, error);
    }
    if (status == TL_OK && !write) {
        status = tl_database_execute(*database, "PRAGMA query_only = ON", error);
    }
    if (status != TL_OK) {
        (void)sqlite3_close(*database);
        *database = NULL;
    }
    return status;
}

static tl_status build_file(const char *name, tl_error *error) {
    char header[256];
    sqlite3 *database = NULL;
    (void)snprintf(header, sizeof header,
                   "PRAGMA auto_vacuum = INCREMENTAL; PRAGMA synchronous = FULL; PRAGMA temp_store = MEMORY; BEGIN;"
                   "PRAGMA application_id = %d; PRAGMA user_version = %d;",
                   TL_DATABASE_APPLICATION, TL_DATABASE_VERSION);
    tl_status status = open_connection(name, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, &database, error);
    if (status != TL_OK) {
        return status;
    }
    status = tl_database_execute(database, header, error);
    for (size_t i = 0; i < sizeof schema / sizeof schema[0] && status == TL_OK; i++) {
        status = tl_database_execute(database, schema[i], error);
    }
    if (status == TL_OK) {
        status = tl_database_execute(database, "COMMIT; PRAGMA journal_mode = WAL", error);
    }
    (void)sqlite3_close(database);
    if (status == TL_BAD_DATA) { /* a new file cannot be damaged */
        tl_database_set_fault(TL_DATABASE_LATER);
        status = TL_TRY_AGAIN;
    }
    return status;
}

/* A file that SQLite leaves beside a database, and the first bytes that identify it: a log, its
 * index, or a journal (unfinished or finished). */
typedef struct leftover {
    const char *end;
    size_t length;
    const char *starts[2];
} leftover;

static const leftover leftovers[] = {
    {"-wal", 4, {"\x37\x7f\x06\x82", "\x37\x7f\x06\x83"}},
    {"-shm", 4, {"\x18\xe2\x2d\x00", "\x00\x2d\xe2\x18"}},
    {"-journal", 8, {"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", "\0\0\0\0\0\0\0\0"}},
};

/* Returns true if the file is SQLite's, empty or absent. Empty files have no content to lose, and
 * SQLite leaves such files too. */
static bool may_be_removed(const char *name, const leftover *kind) {
    char start[8] = {0};
    struct stat file;
    if (lstat(name, &file) != 0) {
        return true;
    }
    int opened = S_ISREG(file.st_mode) ? open(name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK) : -1;
    if (opened < 0) {
        return false;
    }
    ssize_t length = read(opened, start, kind->length);
    (void)close(opened);
    return length == 0 || ((size_t)length == kind->length && (memcmp(start, kind->starts[0], kind->length) == 0 ||
                                                              memcmp(start, kind->starts[1], kind->length) == 0));
}

static void remove_beside(const char *path) {
    char name[PATH_MAX];
    for (size_t i = 0; i < sizeof leftovers / sizeof leftovers[0]; i++) {
        (void)snprintf(name, sizeof name, "%s%s", path, leftovers[i].end);
        (void)unlink(name);
    }
}

/* SQLite would apply the log of a removed database to the new one. */
static tl_status remove_leftovers(const char *path, tl_error *error) {
    char name[PATH_MAX];
    for (size_t i = 0; i < sizeof leftovers / sizeof leftovers[0]; i++) {
        if (snprintf(name, sizeof name, "%s%s", path, leftovers[i].end) >= PATH_MAX) {
            return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", path);
        }
        if (!may_be_removed(name, &leftovers[i])) {
            return tl_database_refuse(
                TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                "%s: cannot be created: SQLite needs the name %s, which another file has: move that file away", path,
                name);
        }
    }
    remove_beside(path);
    return TL_OK;
}

/* Creates an empty file with an unused name beside `path`; returns it in `name`. */
static tl_status reserve_name(const char *path, char name[PATH_MAX], tl_error *error) {
    for (int i = 0;; i++) {
        if (snprintf(name, PATH_MAX, "%s.new-%ld-%d", path, (long)getpid(), i) + JOURNAL >= PATH_MAX) {
            return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", path);
        }
        int file = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0640);
        if (file >= 0) {
            (void)close(file);
            return TL_OK;
        }
        if (errno != EEXIST) {
            return tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN,
                                      "%s: cannot be created: %s", path, strerror(errno));
        }
    }
}

/* Renames the new file unless the name exists by now. A file system that cannot do both in one
 * operation (NFS) can create a second link. */
static bool rename_into_place(const char *built, const char *path) {
    if (renameat2(AT_FDCWD, built, AT_FDCWD, path, RENAME_NOREPLACE) == 0) {
        return true;
    }
    return (errno == EINVAL || errno == ENOSYS) && link(built, path) == 0 && unlink(built) == 0;
}

tl_status tl_database_create(const char *path, tl_error *error) {
    char name[PATH_MAX];
    tl_status status = remove_leftovers(path, error);
    if (status == TL_OK) {
        status = reserve_name(path, name, error);
    }
    if (status != TL_OK) {
        return status;
    }
    status = build_file(name, error);
    if (status == TL_OK && !rename_into_place(name, path)) {
        status = tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN, "%s: cannot be created: %s",
                                    path, strerror(errno));
    }
    if (status != TL_OK) {
        remove_beside(name);
        (void)unlink(name);
        return status;
    }
    tl_folder_sync(path);
    return TL_OK;
}

/* ---- Path ---- */

/* Returns the resolved path of a file that does not exist yet, so that it is the same when the file
 * exists. */
static tl_status resolve_new(const char *given, char path[PATH_MAX], tl_error *error) {
    char copy[PATH_MAX];
    char folder[PATH_MAX];
    const char *slash = strrchr(given, '/');
    bool fits = snprintf(copy, sizeof copy, "%s", given) < PATH_MAX;
    if (fits && realpath(dirname(copy), folder) == NULL) {
        return tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN,
                                  "%s: cannot be created: its folder: %s", given, strerror(errno));
    }
    fits = fits && snprintf(path, PATH_MAX, "%s/%s", strcmp(folder, "/") == 0 ? "" : folder,
                            slash == NULL ? given : slash + 1) < PATH_MAX;
    return fits ? TL_OK
                : tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", given);
}

tl_status tl_database_resolve(const char *given, char path[PATH_MAX], tl_error *error) {
    struct stat file;
    if (given[0] == '\0') {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_USAGE,
                                  "the name of the database is empty: give a file, for example run.db");
    }
    if (realpath(given, path) != NULL) {
        bool regular = stat(path, &file) == 0 && S_ISREG(file.st_mode);
        return regular ? TL_OK
                       : tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                            "%s: is not a regular file, so it is not changed", given);
    }
    if (errno != ENOENT) {
        return tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN,
                                  "%.200s: cannot be opened: %s", given, strerror(errno));
    }
    if (lstat(given, &file) == 0) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: is a symbolic link to a missing file, so it is not changed", given);
    }
    path[0] = '\0';
    return resolve_new(given, path, error);
}
