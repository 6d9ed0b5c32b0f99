/* Removing the oldest, and keeping the write-ahead log short.
 *
 * All tables of ticks begin their key with (run, tick), so the oldest are one range at the front of each: removing them
 * frees whole pages, which the next batch takes. The file shrinks (incremental vacuum) only when it is larger
 * than the bound permits, which happens when the bound was lowered. */
#include "firmware/store/recorder_retention.h"

#include <assert.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum {
    LEAST_LOG = 64 * 1024,
    MOST_LOG = 4 * 1024 * 1024,
    FRAME_HEADER = 24,
    ROWS_AT_ONCE = 4096,  /* removed in one transaction */
    STEPS_PER_BATCH = 16, /* such transactions between two batches; together more than a batch can add */
    PAGES_AT_ONCE = 256,  /* given back to the file system in one transaction */
    OVERHEAD_PAGES = 24   /* that a batch may add beside its rows */
};

/* But that which is in force in the first tick that stays. */
static const char OLD_TUNINGS[] = "DELETE FROM tunings WHERE run = ?1 AND tick <"
                                  " (SELECT max(tick) FROM tunings WHERE run = ?1 AND tick <= ?2)";

static const char UNUSED_CONFIGURATIONS[] =
    "DELETE FROM configurations WHERE hash NOT IN (SELECT configuration FROM runs)"
    " AND hash NOT IN (SELECT configuration FROM tunings)";

size_t tl_recorder_retention_log(int64_t max_bytes) {
    int64_t part = max_bytes / 16;
    return (size_t)(max_bytes == 0 || part > MOST_LOG ? MOST_LOG : part < LEAST_LOG ? LEAST_LOG : part);
}

static int count_frames(void *context, sqlite3 *database, const char *name, int frames) {
    (void)database;
    (void)name;
    ((tl_recorder_retention *)context)->log_frames = frames;
    return SQLITE_OK;
}

/* The one number a statement gives, `otherwise` where it is NULL or there is no row. */
static int ask(sqlite3_stmt *statement, int64_t otherwise, int64_t *value) {
    *value = otherwise;
    int code = sqlite3_step(statement);
    if (code == SQLITE_ROW && sqlite3_column_type(statement, 0) == SQLITE_INTEGER) {
        *value = sqlite3_column_int64(statement, 0);
    }
    int reset = sqlite3_reset(statement);
    return code == SQLITE_ROW || code == SQLITE_DONE ? SQLITE_OK : reset;
}

/* Retention is not in a hurry: its statements are prepared when they are needed. */
static int prepare_with(tl_recorder_retention *retention, const char *sql, int64_t first, int64_t second,
                        sqlite3_stmt **statement) {
    int code = sqlite3_prepare_v2(retention->database, sql, -1, statement, NULL);
    if (code == SQLITE_OK && sqlite3_bind_parameter_count(*statement) >= 1) {
        code = sqlite3_bind_int64(*statement, 1, first);
    }
    if (code == SQLITE_OK && sqlite3_bind_parameter_count(*statement) >= 2) {
        code = sqlite3_bind_int64(*statement, 2, second);
    }
    return code;
}

static int ask_once(tl_recorder_retention *retention, const char *sql, int64_t parameter, int64_t otherwise,
                    int64_t *value) {
    sqlite3_stmt *statement = NULL;
    *value = otherwise;
    int code = prepare_with(retention, sql, parameter, 0, &statement);
    if (code == SQLITE_OK) {
        code = ask(statement, otherwise, value);
    }
    (void)sqlite3_finalize(statement);
    return code;
}

static int change(tl_recorder_retention *retention, const char *sql, int64_t first, int64_t second) {
    sqlite3_stmt *statement = NULL;
    int code = prepare_with(retention, sql, first, second, &statement);
    if (code == SQLITE_OK) {
        code = sqlite3_step(statement);
    }
    (void)sqlite3_finalize(statement);
    return code == SQLITE_DONE || code == SQLITE_ROW ? SQLITE_OK : code;
}

int tl_recorder_retention_open(tl_recorder_retention *retention, sqlite3 *database, int64_t max_bytes) {
    assert(max_bytes == 0 || max_bytes >= TL_RETENTION_LEAST_BYTES);
    char sql[128];
    memset(retention, 0, sizeof *retention);
    retention->database = database;
    retention->max_bytes = max_bytes;
    retention->log_limit = (int64_t)tl_recorder_retention_log(max_bytes);
    (void)sqlite3_wal_hook(database, count_frames, retention);
    (void)snprintf(sql, sizeof sql, "PRAGMA journal_size_limit = %lld", (long long)(2 * retention->log_limit));
    int code = sqlite3_exec(database, sql, NULL, NULL, NULL);
    if (code == SQLITE_OK) {
        code = ask_once(retention, "PRAGMA page_size", 0, 4096, &retention->page_size);
    }
    if (code == SQLITE_OK) {
        code = sqlite3_prepare_v2(database, "PRAGMA page_count", -1, &retention->page_count, NULL);
    }
    if (code == SQLITE_OK) {
        code = sqlite3_prepare_v2(database, "PRAGMA freelist_count", -1, &retention->free_count, NULL);
    }
    return code;
}

void tl_recorder_retention_close(tl_recorder_retention *retention) {
    (void)sqlite3_finalize(retention->page_count);
    (void)sqlite3_finalize(retention->free_count);
    memset(retention, 0, sizeof *retention);
}

size_t tl_recorder_retention_batch(const tl_recorder_retention *retention) {
    return (size_t)retention->log_limit / 4;
}

/* ---- Removing ---------------------------------------------------------------------------------------------------- */

/* The first tick or step that a run still has; INT64_MAX where there is none. */
static int oldest_tick(tl_recorder_retention *retention, int64_t run, int64_t *tick) {
    static const char *const questions[] = {
        "SELECT tick FROM samples WHERE run = ?1 ORDER BY tick LIMIT 1",
        "SELECT step FROM steps WHERE run = ?1 ORDER BY step LIMIT 1",
    };
    *tick = INT64_MAX;
    for (size_t i = 0; i < sizeof questions / sizeof questions[0]; i++) {
        int64_t first = 0;
        int code = ask_once(retention, questions[i], run, INT64_MAX, &first);
        if (code != SQLITE_OK) {
            return code;
        }
        *tick = first < *tick ? first : *tick;
    }
    return SQLITE_OK;
}

static int newest_tick(tl_recorder_retention *retention, int64_t run, int64_t *tick) {
    return ask_once(retention, "SELECT tick FROM samples WHERE run = ?1 ORDER BY tick DESC LIMIT 1", run, -1, tick);
}

static int remove_ticks_before(tl_recorder_retention *retention, int64_t run, int64_t tick) {
    static const char *const statements[] = {
        "DELETE FROM samples WHERE run = ?1 AND tick < ?2",
        "DELETE FROM outputs WHERE run = ?1 AND step < ?2",
        "DELETE FROM adjustments WHERE run = ?1 AND step < ?2",
        "DELETE FROM steps WHERE run = ?1 AND step < ?2",
        "DELETE FROM checkpoints WHERE run = ?1 AND tick + 1 < ?2", /* what came after it is gone */
        OLD_TUNINGS,
        "UPDATE runs SET removed_before = ?2 WHERE run = ?1",
    };
    int code = SQLITE_OK;
    for (size_t i = 0; i < sizeof statements / sizeof statements[0] && code == SQLITE_OK; i++) {
        code = change(retention, statements[i], run, tick);
    }
    return code;
}

/* What is left of a run without ticks. */
static int remove_rest(tl_recorder_retention *retention, int64_t run) {
    static const char *const statements[] = {
        "DELETE FROM events WHERE event IN (SELECT event FROM events WHERE run = ?1 ORDER BY event LIMIT 4096)",
        "DELETE FROM signals WHERE run = ?1 AND NOT EXISTS (SELECT 1 FROM events WHERE run = ?1)",
        "DELETE FROM components WHERE run = ?1 AND NOT EXISTS (SELECT 1 FROM events WHERE run = ?1)",
        "DELETE FROM checkpoints WHERE run = ?1 AND NOT EXISTS (SELECT 1 FROM events WHERE run = ?1)",
        "DELETE FROM tunings WHERE run = ?1 AND NOT EXISTS (SELECT 1 FROM events WHERE run = ?1)",
        "DELETE FROM beginnings WHERE run = ?1 AND NOT EXISTS (SELECT 1 FROM events WHERE run = ?1)",
        "DELETE FROM runs WHERE run = ?1 AND NOT EXISTS (SELECT 1 FROM events WHERE run = ?1)",
        UNUSED_CONFIGURATIONS,
    };
    int code = SQLITE_OK;
    for (size_t i = 0; i < sizeof statements / sizeof statements[0] && code == SQLITE_OK; i++) {
        code = change(retention, statements[i], run, 0);
    }
    return code;
}

/* Ticks that make about ROWS_AT_ONCE rows: each has a row per signal, and one of its own. */
static int ticks_at_once(tl_recorder_retention *retention, int64_t run, int64_t *ticks) {
    int64_t signals = 0;
    int code = ask_once(retention, "SELECT count(*) FROM signals WHERE run = ?1", run, 0, &signals);
    *ticks = ROWS_AT_ONCE / (signals + 1) + 1;
    return code;
}

/* Ticks of a run that is damaged may be anywhere. */
static int64_t tick_after(int64_t first, int64_t ticks) {
    return first < INT64_MAX - ticks ? first + ticks : INT64_MAX;
}

static int remove_of_old_run(tl_recorder_retention *retention, int64_t run) {
    int64_t first = 0;
    int64_t ticks = 0;
    int code = oldest_tick(retention, run, &first);
    if (code != SQLITE_OK || first == INT64_MAX) {
        return code != SQLITE_OK ? code : remove_rest(retention, run);
    }
    code = ticks_at_once(retention, run, &ticks);
    return code != SQLITE_OK ? code : remove_ticks_before(retention, run, tick_after(first, ticks));
}

static int remove_of_this_run(tl_recorder_retention *retention, bool *removed) {
    int64_t first = 0;
    int64_t last = 0;
    int64_t ticks = 0;
    int code = oldest_tick(retention, retention->run, &first);
    code = code != SQLITE_OK ? code : newest_tick(retention, retention->run, &last);
    code = code != SQLITE_OK ? code : ticks_at_once(retention, retention->run, &ticks);
    if (code != SQLITE_OK) {
        return code;
    }
    if (first != INT64_MAX && first < last) {
        int64_t until = tick_after(first, ticks);
        return remove_ticks_before(retention, retention->run, until < last ? until : last);
    }
    int64_t events = 0;
    code = ask_once(retention, "SELECT count(*) FROM events WHERE run = ?1", retention->run, 0, &events);
    if (code != SQLITE_OK || events <= TL_RETENTION_EVENTS) {
        *removed = false;
        return code;
    }
    int64_t surplus = events - TL_RETENTION_EVENTS;
    return change(retention,
                  "DELETE FROM events WHERE event IN (SELECT event FROM events WHERE run = ?1 ORDER BY event LIMIT ?2)",
                  retention->run, surplus < ROWS_AT_ONCE ? surplus : ROWS_AT_ONCE);
}

/* One small step of removal, in a transaction. *removed is false where nothing is left that may go. */
static int remove_some(tl_recorder_retention *retention, bool *removed) {
    int64_t run = 0;
    *removed = true;
    int code = change(retention, "BEGIN IMMEDIATE", 0, 0);
    if (code != SQLITE_OK) {
        return code;
    }
    code = ask_once(retention, "SELECT run FROM runs WHERE run <> ?1 ORDER BY run LIMIT 1", retention->run, 0, &run);
    if (code == SQLITE_OK && run != 0) {
        code = remove_of_old_run(retention, run);
    } else if (code == SQLITE_OK && retention->run != 0) {
        code = remove_of_this_run(retention, removed);
    } else {
        *removed = false;
    }
    if (code == SQLITE_OK) {
        code = change(retention, "COMMIT", 0, 0);
    }
    if (sqlite3_get_autocommit(retention->database) == 0) {
        (void)change(retention, "ROLLBACK", 0, 0);
    }
    return code;
}

/* ---- Sizes ------------------------------------------------------------------------------------------------------- */

static int64_t file_size(const tl_recorder_retention *retention, int which) {
    sqlite3_file *file = NULL;
    sqlite3_int64 size = 0;
    if (sqlite3_file_control(retention->database, "main", which, &file) != SQLITE_OK || file == NULL ||
        file->pMethods == NULL || file->pMethods->xFileSize(file, &size) != SQLITE_OK) {
        return 0;
    }
    return size;
}

static int64_t size_on_disk(const tl_recorder_retention *retention) {
    return file_size(retention, SQLITE_FCNTL_FILE_POINTER) + file_size(retention, SQLITE_FCNTL_JOURNAL_POINTER);
}

static int64_t log_bytes(const tl_recorder_retention *retention) {
    return retention->log_frames * (retention->page_size + FRAME_HEADER);
}

static int checkpoint(tl_recorder_retention *retention, int mode) {
    int left = 0;
    int done = 0;
    int code = sqlite3_wal_checkpoint_v2(retention->database, "main", mode, &left, &done);
    retention->writings_back++;
    if (code == SQLITE_OK && left == done) {
        retention->log_frames = 0; /* the next transaction starts the log anew, unless a reader still needs it */
    }
    return code;
}

int tl_recorder_retention_tidy(tl_recorder_retention *retention) {
    if (log_bytes(retention) < retention->log_limit) {
        return SQLITE_OK;
    }
    int code = checkpoint(retention, SQLITE_CHECKPOINT_PASSIVE);
    if ((code == SQLITE_OK || code == SQLITE_BUSY) && log_bytes(retention) >= 2 * retention->log_limit) {
        code = checkpoint(retention, SQLITE_CHECKPOINT_TRUNCATE);
    }
    return code == SQLITE_BUSY ? SQLITE_OK : code; /* a reader; make_room() says when that is too much */
}

/* Gives at most `pages` free pages back to the file system. */
static int shrink(tl_recorder_retention *retention, int64_t pages) {
    char sql[64];
    (void)snprintf(sql, sizeof sql, "PRAGMA incremental_vacuum(%lld)",
                   (long long)(pages < PAGES_AT_ONCE ? pages : PAGES_AT_ONCE));
    int code = sqlite3_exec(retention->database, sql, NULL, NULL, NULL);
    return code == SQLITE_OK ? tl_recorder_retention_tidy(retention) : code;
}

static int read_pages(tl_recorder_retention *retention, int64_t *all, int64_t *unused) {
    int code = ask(retention->page_count, 0, all);
    return code == SQLITE_OK ? ask(retention->free_count, 0, unused) : code;
}

/* A log that a reader keeps from being written back may grow as long as the bound holds. */
static int check_log(tl_recorder_retention *retention, int64_t needed) {
    if (log_bytes(retention) < 2 * retention->log_limit ||
        size_on_disk(retention) + needed * retention->page_size <= retention->max_bytes) {
        return SQLITE_OK;
    }
    return checkpoint(retention, SQLITE_CHECKPOINT_TRUNCATE);
}

int tl_recorder_retention_make_room(tl_recorder_retention *retention, size_t bytes) {
    if (retention->max_bytes == 0) {
        return SQLITE_OK;
    }
    int64_t most = (retention->max_bytes - 4 * retention->log_limit) / retention->page_size;
    int64_t needed = (int64_t)(bytes * 3) / retention->page_size + OVERHEAD_PAGES;
    int64_t all = 0;
    int64_t unused = 0;
    bool removed = true;
    int code = check_log(retention, needed);
    for (int i = 0; i < STEPS_PER_BATCH && code == SQLITE_OK && removed; i++) {
        code = read_pages(retention, &all, &unused);
        if (code == SQLITE_OK && all > most && unused > 0) {
            code = shrink(retention, all - most);
        } else if (code == SQLITE_OK && all - unused + needed > most) {
            code = remove_some(retention, &removed);
            code = code == SQLITE_OK ? tl_recorder_retention_tidy(retention) : code;
        } else {
            break;
        }
        code = code == SQLITE_OK ? check_log(retention, needed) : code;
    }
    return code;
}
