/* Writer's database file: opens it, monitors it, and replaces it if necessary.
 *
 * Purpose: at the opening, a fault of the file is handled or is an error (insistence): see
 *          database_file.h. Later, each fault is handled. A damaged file is renamed. A file that
 *          may not be written any more is replaced by one beside it. A file that was removed, moved
 *          or overwritten is created again. Then the run begins again in the new file
 *          (tl_recorder_state_restart_run()).
 * Reports: each fault once, in the log and as an event of the writer
 *          (tl_recorder_state_add_event()).
 * Changes: the file and the files beside it; in the writer's state its marks, if a run leaves a
 *          file. No record queue.
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

/* The caller provides the memory and may read all fields; it writes only `goes_on` and `lost_said`.
 */
typedef struct tl_recorder_file {
    const tl_recorder_settings *record;
    tl_recorder_writer_state *state;
    tl_database_file file;
    tl_database_user user;
    tl_recorder_database *database; /* NULL: no file is open */
    bool goes_on;                   /* the run was begun by another writer, and this one wrote nothing yet */
    bool is_kept;                   /* the previous writer's data is still in its file, as far as known */
    char fate[TL_RECORDER_FATE];    /* of the previous file, until it is reported; "": none */
    uint64_t lost_said;             /* how much of totals.lost was reported */
    tl_time opened_at;              /* time of the last try */
    tl_error failure;               /* the last one, with the file's name */
    char reason[192];               /* the same without the name */
    tl_log_limiter limiter;
} tl_recorder_file;

/* Initialises it without an open file. Settings and state must outlive it. */
void tl_recorder_file_begin(tl_recorder_file *file, const tl_recorder_settings *record,
                            tl_recorder_writer_state *state);
void tl_recorder_file_end(tl_recorder_file *file);

/* Returns the path of the open file; if no file is open, the requested path. */
const char *tl_recorder_file_path(const tl_recorder_file *file);

void tl_recorder_file_report_event(tl_recorder_file *file, tl_severity severity, const char *text);

/* Stores why a call has failed in `failure` and `reason`. Call it before a rollback, which
 * overwrites SQLite's message. */
void tl_recorder_file_keep_reason(tl_recorder_file *file, int code);

/* Opens the file of the previous writer, or the requested file, or a replacement. *news holds the
 * reasons, for tl_recorder_file_report_fate(). On failure sets `failure`; *waits: a retry may
 * succeed. */
tl_status tl_recorder_file_open(tl_recorder_file *file, tl_database_policy open_policy, tl_database_report *report,
                                bool *waits);

/* Reports why the file differs from the previous one; NULL: no file is open. */
void tl_recorder_file_report_fate(tl_recorder_file *file, const tl_database_report *report);

/* Returns whether to try again to open a file (every 0.1 s), and notes the time of the try. */
bool tl_recorder_file_is_due(tl_recorder_file *file);

/* From now on commits wait for other programs for only 0.1 s, because entries are waiting. */
void tl_recorder_file_set_short_wait(tl_recorder_file *file);

/* Finds out how far the previous writer came, and whether its run is in this file; if not, leaves
 * that run. `report`: from the opening. Returns SQLite's result code. */
int tl_recorder_file_find_run(tl_recorder_file *file, const tl_database_report *report);

/* Checks what other programs did to the file; SQLite would continue to write into it. Returns true
 * if it has reacted; then possibly no file is open. */
bool tl_recorder_file_check(tl_recorder_file *file);

/* Handles a failure by another file instead of a retry. Returns true if the caller can write again
 * at once. */
bool tl_recorder_file_repair(tl_recorder_file *file, int code);

void tl_recorder_file_close(tl_recorder_file *file);

#endif
