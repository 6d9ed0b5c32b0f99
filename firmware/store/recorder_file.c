/* Writer's database file: see recorder_file.h. */
#include "firmware/store/recorder_file.h"

#include <inttypes.h>
#include <sqlite3.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/store/database.h"

static const tl_time PATIENCE = 2 * TL_SECOND;          /* for locks at the opening, if a fault is an error */
static const tl_time PATIENCE_RUNNING = TL_SECOND / 10; /* for other programs, while entries wait */
static const tl_time OPEN_PAUSE = TL_SECOND / 10;       /* between two tries to open a file */
static const tl_time CUT_PAUSE = TL_SECOND / 4;         /* before a truncated file is checked again */

/* ---- Reports ---- */

const char *tl_recorder_file_path(const tl_recorder_file *file) {
    return file->file.path[0] != '\0' ? file->file.path : file->record->path;
}

void tl_recorder_file_report_event(tl_recorder_file *file, tl_severity severity, const char *text) {
    tl_log_level level = severity == TL_EVENT_ERROR     ? TL_LOG_ERROR
                         : severity == TL_EVENT_WARNING ? TL_LOG_WARNING
                                                        : TL_LOG_NOTICE;
    tl_log_limited(&file->limiter, level, "recorder: %s: %s", tl_recorder_file_path(file), text);
    tl_recorder_state_add_event(file->state, -1, severity, "recorder", text);
}

void tl_recorder_file_keep_reason(tl_recorder_file *file, int code) {
    tl_database_text(file->file.connection, code, file->reason, sizeof file->reason);
    (void)tl_database_fail(file->file.connection, code, &file->failure);
}

/* Notes what happened to the file with the run; it is reported later. */
static void note_fate(tl_recorder_file *file, const char *fate) {
    (void)snprintf(file->fate, sizeof file->fate, "%s with %" PRIu64 " samples, steps and events of this run", fate,
                   tl_recorder_mark_entries(tl_recorder_state_mark(file->state)));
}

static void report_fate(tl_recorder_file *file, const char *text) {
    tl_recorder_file_report_event(file, TL_EVENT_ERROR, text);
    file->fate[0] = '\0';
}

void tl_recorder_file_report_fate(tl_recorder_file *file, const tl_database_report *report) {
    char text[TL_EVENT_TEXT + 2 * TL_RECORDER_FATE];
    if (report != NULL && report->renamed.name[0] != '\0') {
        const char *name = strrchr(report->renamed.name, '/');
        (void)snprintf(text, sizeof text, "%s%s%sis damaged: renamed to %.60s, recording into a new file: %.100s",
                       file->fate[0] != '\0' ? "was " : "", file->fate,
                       file->fate[0] != '\0' ? "; its replacement " : "",
                       name == NULL ? report->renamed.name : name + 1, report->renamed.why);
        report_fate(file, text);
    }
    if (report != NULL && report->beside[0] != '\0') {
        (void)snprintf(text, sizeof text, "is used instead%s%s: %.180s",
                       file->fate[0] != '\0' ? " of a file that was " : "", file->fate, report->beside);
        report_fate(file, text);
    }
    if (file->fate[0] != '\0') {
        (void)snprintf(text, sizeof text, "was %s%s", file->fate, report == NULL ? "" : "; recording into a new file");
        report_fate(file, text);
    }
}

/* ---- The run in the file ---- */

static bool is_same_totals(const tl_recorder_totals *totals, const tl_recorder_totals *other) {
    return totals->samples == other->samples && totals->steps == other->steps && totals->events == other->events &&
           totals->lost == other->lost && strcmp(totals->committed, other->committed) == 0;
}

/* Finds out whether the file has the run with the totals of the mark. */
static int find_totals(tl_recorder_file *file, const tl_recorder_mark *mark, bool *there) {
    *there = false;
    if (mark->run == 0 || strcmp(mark->path, file->file.path) != 0) {
        return SQLITE_OK;
    }
    return tl_recorder_database_has(file->database, mark->run, &mark->totals, there);
}

/* Entries in a file that is gone are lost. The report of the file's fate has their number, so they
 * are not reported twice. */
static void leave_run(tl_recorder_file *file, bool gone) {
    file->lost_said += gone ? tl_recorder_mark_entries(tl_recorder_state_mark(file->state)) : 0;
    tl_recorder_state_leave_file(file->state, gone);
}

/* The previous writer wrote another file. Its entries are lost, unless that file still exists and
 * only cannot be written, or was renamed as damaged. */
static void leave_previous(tl_recorder_file *file, const tl_database_report *report) {
    bool is_aside = report->renamed.name[0] != '\0';
    bool is_here = strcmp(tl_recorder_state_mark(file->state)->path, file->file.path) == 0 && !is_aside;
    bool gone = !file->is_kept || is_here;
    if (gone) {
        note_fate(file, "gone");
    }
    leave_run(file, gone);
}

int tl_recorder_file_find_run(tl_recorder_file *file, const tl_database_report *report) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(file->state);
    const tl_recorder_mark *tried = tl_recorder_state_tried(file->state);
    bool there = false;
    int code = SQLITE_OK;
    if (tried != NULL && (tried->run != mark->run || !is_same_totals(&tried->totals, &mark->totals))) {
        code = find_totals(file, tried, &there);
        if (there) {
            tl_recorder_state_commit(file->state);
        }
    }
    mark = tl_recorder_state_mark(file->state);
    if (code == SQLITE_OK && !there && mark->run != 0) {
        code = find_totals(file, mark, &there);
        if (code == SQLITE_OK && !there) {
            leave_previous(file, report);
        }
    }
    file->continues = there;
    return code;
}

/* ---- Opening and closing ---- */

static int open_statements(void *context, sqlite3 *connection) {
    tl_recorder_file *file = context;
    return tl_recorder_database_open(connection, file->record, &file->database);
}

static void close_statements(void *context) {
    tl_recorder_file *file = context;
    tl_recorder_database_close(file->database);
    file->database = NULL;
}

void tl_recorder_file_close(tl_recorder_file *file) {
    close_statements(file);
    tl_database_file_close(&file->file);
}

/* Removes logs of our databases beside foreign files, because SQLite would apply them to those. */
static void remove_stray_logs(const tl_recorder_file *file) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(file->state);
    const tl_recorder_mark *tried = tl_recorder_state_tried(file->state);
    tl_database_remove_stray_log(mark->path, &mark->identity);
    if (tried != NULL) {
        tl_database_remove_stray_log(tried->path, &tried->identity);
    }
}

/* Opens the file of the previous writer, even if another one is requested. */
static tl_status open_previous(tl_recorder_file *file) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(file->state);
    file->is_kept = !tl_database_is_missing(mark->path, &mark->identity);
    if (mark->run == 0 || access(mark->path, F_OK) != 0) {
        return TL_BAD_DATA;
    }
    tl_status status = tl_database_file_open(mark->path, 0, &file->user, &file->file, NULL, NULL);
    if (status != TL_OK && tl_database_get_fault() == TL_DATABASE_FOREIGN) { /* another program has written into it */
        file->is_kept = false;
    }
    return status;
}

tl_status tl_recorder_file_open(tl_recorder_file *file, tl_database_policy open_policy, tl_database_report *report,
                                bool *waits) {
    const tl_database_wanted wanted = {.path = file->record->path,
                                       .patience = open_policy == TL_DATABASE_ANYHOW ? 0 : PATIENCE,
                                       .open_policy = open_policy,
                                       .user = &file->user};
    *report = (tl_database_report){.beside = ""};
    *waits = false;
    remove_stray_logs(file);
    tl_status status = open_previous(file);
    return status == TL_OK ? TL_OK : tl_database_replacement_open(&wanted, &file->file, report, waits, &file->failure);
}

bool tl_recorder_file_is_due(tl_recorder_file *file) {
    tl_time now = tl_clock_now(NULL);
    bool is_due = now - file->opened_at >= OPEN_PAUSE;
    file->opened_at = is_due ? now : file->opened_at;
    return is_due;
}

void tl_recorder_file_set_short_wait(tl_recorder_file *file) {
    tl_database_file_set_patience(&file->file, PATIENCE_RUNNING);
}

void tl_recorder_file_begin(tl_recorder_file *file, const tl_recorder_settings *record,
                            tl_recorder_writer_state *state) {
    *file = (tl_recorder_file){.record = record,
                               .state = state,
                               .file = TL_DATABASE_FILE_NONE,
                               .user = {open_statements, close_statements, file},
                               .limiter = TL_LOG_LIMITER(5)};
}

void tl_recorder_file_end(tl_recorder_file *file) {
    tl_recorder_file_close(file);
    tl_log_limiter_end(&file->limiter);
}

/* ---- Replacing the file ---- */

/* Like tl_database_replacement_beside(); the caller reports `report`. */
static tl_status open_beside(tl_recorder_file *file, const tl_error *why, tl_database_report *report) {
    return tl_database_replacement_beside(file->record->path, why->text, &file->user, &file->file, report,
                                          &file->failure);
}

static bool replace_damaged(tl_recorder_file *file) {
    tl_database_report report = {.beside = ""};
    tl_error why = file->failure;
    close_statements(file);
    tl_recorder_state_leave_file(file->state, false);
    tl_status status = tl_database_file_renew(&file->file, why.text, &file->user, &report.renamed, &file->failure);
    if (status != TL_OK && tl_database_get_fault() == TL_DATABASE_FOREIGN) { /* the damaged file keeps its name */
        status = open_beside(file, &why, &report);
    }
    tl_recorder_file_report_fate(file, &report);
    return status == TL_OK;
}

/* The denied file is not opened again, because opening it might succeed although writing fails. */
static bool replace_denied(tl_recorder_file *file) {
    tl_database_report report = {.beside = ""};
    tl_error why = file->failure;
    tl_recorder_file_close(file);
    if (open_beside(file, &why, &report) != TL_OK) {
        return false;
    }
    tl_recorder_state_leave_file(file->state, false);
    tl_recorder_file_report_fate(file, &report);
    return true;
}

bool tl_recorder_file_repair(tl_recorder_file *file, int code) {
    switch (tl_database_fault_of(code, 0)) {
    case TL_DATABASE_DAMAGED:
        return replace_damaged(file);
    case TL_DATABASE_DENIED:
        return replace_denied(file);
    default:
        return false;
    }
}

/* ---- Changes by other programs ---- */

/* The file was removed, overwritten or moved. This is reported together with the file that replaces
 * it. */
static void leave_file(tl_recorder_file *file, tl_database_file_state found) {
    bool gone = found != TL_DATABASE_MOVED;
    note_fate(file, found == TL_DATABASE_MOVED     ? "moved away"
                    : found == TL_DATABASE_REMOVED ? "removed"
                                                   : "overwritten");
    leave_run(file, gone);
    if (gone) {
        close_statements(file);
        tl_database_file_abandon(&file->file);
    } else {
        tl_recorder_file_close(file);
    }
    file->opened_at = 0;
}

/* SQLite still knows the content of the removed log. It is written back into the file; then the
 * file is opened again, with a new log. */
static bool restore_log(tl_recorder_file *file) {
    if (!tl_database_file_write_back(&file->file)) {
        return false;
    }
    tl_recorder_file_report_event(file, TL_EVENT_WARNING,
                                  "its log (-wal) was removed: its data was written back, and a new log is created");
    tl_recorder_file_close(file);
    file->opened_at = 0;
    return true;
}

/* A program that overwrites a file truncates it first. Without the pause, the other program's file
 * would be renamed as damaged. */
static tl_database_file_state check_file(tl_recorder_file *file) {
    tl_database_file_state found = tl_database_file_check(&file->file);
    if (found == TL_DATABASE_CUT) {
        tl_clock_sleep_until(tl_clock_now(NULL) + CUT_PAUSE);
        found = tl_database_file_check(&file->file);
    }
    return found;
}

bool tl_recorder_file_check(tl_recorder_file *file) {
    tl_database_file_state found = check_file(file);
    switch (found) {
    case TL_DATABASE_IN_PLACE:
        return false;
    case TL_DATABASE_WITHOUT_LOG:
        return restore_log(file);
    case TL_DATABASE_CUT:
        (void)tl_fail(&file->failure, TL_BAD_DATA, "%s: was cut: bytes are missing at its end", file->file.path);
        (void)replace_damaged(file);
        return true;
    default:
        leave_file(file, found);
        return true;
    }
}
