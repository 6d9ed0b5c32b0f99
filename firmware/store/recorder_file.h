/* Writer's database file: opens it, monitors it, and replaces it if necessary.
 *
 * Purpose: at the opening, `open_policy` (database_file.h) defines which faults of the file are
 *          handled, and which make the call fail. Later, each fault is handled. A damaged file is
 *          renamed. A file without permission to write is replaced by one beside it. A file that
 *          was removed, moved or overwritten is created again. Then the run begins again in the new
 *          file (tl_recorder_state_leave_file()).
 * Reports: each fault once, in the log and as an event of the writer
 *          (tl_recorder_state_add_event()).
 * Changes: the file and the files beside it. If a run leaves a file, also the marks in the writer's
 *          state. Record queues are not changed.
 * Memory:  the caller's.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_FILE_H
#define TL_FIRMWARE_STORE_RECORDER_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/log.h"
#include "firmware/store/database_file.h"
#include "firmware/store/recorder_database.h"
#include "firmware/store/recorder_state.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

enum { TL_RECORDER_FATE = 80 };

/* The caller may read all fields. It writes only `continues`, `lost_said` and `reason`. */
typedef struct tl_recorder_file {
    const tl_recorder_settings *record;
    tl_recorder_writer_state *state;
    tl_database_file file;
    tl_database_user user;
    tl_recorder_database *database; /* NULL: no file is open */
    bool continues;                 /* an earlier writer began the run, and this one wrote nothing yet */
    bool is_kept;                   /* as far as known, the previous writer's file still has its data */
    char fate[TL_RECORDER_FATE];    /* what happened to the previous file, until it is reported; "": none */
    uint64_t lost_said;             /* part of the mark's totals.lost that was reported */
    tl_time opened_at;              /* time of the last try to open a file, CLOCK_MONOTONIC, ns */
    tl_error failure;               /* the last failure, with the file's name */
    char reason[192];               /* the last failure, usually without the name */
    tl_log_limiter limiter;
} tl_recorder_file;

/* Initialises `file` without opening one. Settings and state must outlive it. end() closes it. */
void tl_recorder_file_begin(tl_recorder_file *file, const tl_recorder_settings *record,
                            tl_recorder_writer_state *state);
void tl_recorder_file_end(tl_recorder_file *file);

/* Returns the path of the open file; if no file is open, the requested path. */
const char *tl_recorder_file_path(const tl_recorder_file *file);

/* Logs the text with the file's path, at a limited rate, and stores it as an own event. */
void tl_recorder_file_report_event(tl_recorder_file *file, tl_severity severity, const char *text);

/* Stores why a call has failed in `failure` and `reason`. Call it before a rollback, which
 * overwrites SQLite's message. */
void tl_recorder_file_keep_reason(tl_recorder_file *file, int code);

/* Opens the file of the previous writer, or the requested file, or a replacement. *report: which
 * file, and why, for tl_recorder_file_report_fate(). A failure sets file->failure, and *waits to
 * true if a retry may succeed. */
tl_status tl_recorder_file_open(tl_recorder_file *file, tl_database_policy open_policy, tl_database_report *report,
                                bool *waits);

/* Reports why the file differs from the previous one. `report`: from the opening; NULL: no file is
 * open. */
void tl_recorder_file_report_fate(tl_recorder_file *file, const tl_database_report *report);

/* Returns whether to try again to open a file (every 0.1 s), and notes the time of the try. */
bool tl_recorder_file_is_due(tl_recorder_file *file);

/* From now on commits wait for other programs for only 0.1 s, because entries are waiting. */
void tl_recorder_file_set_short_wait(tl_recorder_file *file);

/* Finds out whether the previous writer's last commit happened, and whether its run is in this
 * file. If the run is not, it begins again in this file. `report`: from the opening. Returns
 * SQLite's result code. */
int tl_recorder_file_find_run(tl_recorder_file *file, const tl_database_report *report);

/* Detects whether another program has moved, removed, overwritten or truncated the file. SQLite
 * would not notice and would continue to write. Returns true if there was a change and it was
 * handled; then possibly no file is open. */
bool tl_recorder_file_check(tl_recorder_file *file);

/* Handles a failed call with SQLite's result `code`: replaces a damaged or denied file by another
 * one. Returns true if the caller can write again at once; false if it must retry later. */
bool tl_recorder_file_repair(tl_recorder_file *file, int code);

void tl_recorder_file_close(tl_recorder_file *file);

#endif
