/* Output of `twinlock show` from a database: text for a terminal, one JSON object, a CSV table, or
 * an HTML report. Also the CSV file of a replay.
 *
 * Purpose: prints one request in one of four formats. The caller has validated the request. The
 *          data is read while it is printed.
 * Errors:  those of history.h.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_SHOW_H
#define TL_FIRMWARE_REPORT_SHOW_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/store/history.h"
#include "master/twin/twin.h"

/* What to print. The pointers must be valid during the calls. */
typedef struct tl_show_request {
    const char *path;          /* of the database */
    tl_history *history;       /* the open database; the caller owns it */
    const tl_history_run *run; /* the selected run */
    int64_t from_step;         /* earlier steps and ticks are left out */
    bool is_newest;            /* from_step was not requested: earlier steps are left out to limit their number */
    char from_at[TL_UTC_TEXT]; /* UTC; earlier events are left out; "": all events */
    bool all_events;           /* text and JSON: all events; else only the newest 10 */
    bool verbose;              /* the text has outcomes, executions and MSEs too */
    tl_show_style style;       /* of the text */
} tl_show_request;

typedef enum tl_show_csv_table {
    TL_SHOW_OUTPUTS,
    TL_SHOW_ADJUSTMENTS,
    TL_SHOW_STEPS,
    TL_SHOW_SAMPLES,
    TL_SHOW_EVENTS,
    TL_SHOW_MINUTES, /* as tl_history_periods(): of all live runs, or of this replay */
    TL_SHOW_HOURS    /* as TL_SHOW_MINUTES */
} tl_show_csv_table;

/* Prints the text for a terminal. */
tl_status tl_show_text(const tl_show_request *request, FILE *file, tl_error *error);

/* Prints one JSON object. It has the keys of `replay --json`, and others; see
 * docs/reference/database.md, "show --json". Errors: also TL_TRY_AGAIN if memory is out. */
tl_status tl_show_json(const tl_show_request *request, FILE *file, tl_error *error);

/* Prints one table as CSV with a header row, quoted as RFC 4180 requires. Numbers have enough
 * digits to be read back exactly. */
tl_status tl_show_csv(const tl_show_request *request, tl_show_csv_table table, FILE *file, tl_error *error);

/* Writes an HTML page (html_report.h) to the file `path`. Errors: also TL_BAD_USAGE if `path` is
 * the database, TL_TRY_AGAIN if memory is out, and those of tl_new_file_open() (os.h). */
tl_status tl_show_report(const tl_show_request *request, const char *path, tl_error *error);

/* Buffers what the callbacks of tl_history_visitor print. The caller writes it to `to` between two
 * transactions. Otherwise a pager that does not read would block a callback within a transaction.
 * Then the recorder could not write its log back. */
typedef struct tl_show_output {
    FILE *file; /* for the callbacks */
    FILE *to;
    char *text;
    size_t size;
} tl_show_output;

/* Errors: TL_TRY_AGAIN if memory is out. */
tl_status tl_show_output_open(tl_show_output *output, FILE *to, tl_error *error);

/* Writes everything to `to`; may block. */
void tl_show_output_write(tl_show_output *output);

/* Writes the rest. Returns `status`; if it is TL_OK and memory was out, TL_TRY_AGAIN. */
tl_status tl_show_output_close(tl_show_output *output, tl_status status, tl_error *error);

/* Returns true if the run is no replay. Only then its steps have calendar times. */
bool tl_show_is_live(const tl_history_run *run);

/* Findings and state of the change detector, of the replay or of all live runs (history.h). */
typedef struct tl_show_changes {
    const tl_history_finding *finding; /* array of the history */
    size_t count, open, gone;          /* number of findings, and of those in these states */
    bool is_watched;                   /* `detection` is known */
    tl_run_detection detection;
} tl_show_changes;
tl_status tl_show_read_changes(const tl_show_request *request, tl_show_changes *changes, tl_error *error);

/* Fills `changes` with the findings that run `run` has written last, at most TL_SHOW_FINDINGS; the
 * rows are copied to `rows`. Texts belong to the history. */
enum { TL_SHOW_FINDINGS = 64 };
void tl_show_changes_of_run(const tl_show_changes *all, int64_t run, tl_run_finding rows[TL_SHOW_FINDINGS],
                            tl_run_changes *changes);

/* Returns the time of the run's last commit, s since the t_start from which the finding's times
 * count. Meaningless in a replay. */
double tl_show_now(const tl_history_run *run, const tl_history_finding *finding);

/* Returns the start of step `step` of a live run: ms since 1970, UTC. */
int64_t tl_show_instant(const tl_history_run *run, int64_t step);

/* ---- Trajectory of `replay --csv`: y, ŷ, u and û of every step as CSV, written during the replay.
 *
 * Format:  docs/reference/files.md, "Results", --csv. Numbers except `time` have 17 digits, so that
 *          they are read back to the same bits.
 * Thread:  one thread.
 */

/* Opens the file `path` and writes the header row. `path` "-": uses `output` instead of a file.
 * Errors: TL_TRY_AGAIN. */
tl_status tl_trajectory_open(const char *path, FILE *output, const tl_config *config, FILE **file, tl_error *error);

/* Writes the row of one step. */
void tl_trajectory_add(FILE *file, const tl_config *config, const tl_record *record);

/* Closes the file. If it is `output`, only flushes it. `path`: for the error's text. Errors:
 * TL_TRY_AGAIN if not everything could be written. */
tl_status tl_trajectory_close(FILE *file, FILE *output, const char *path, tl_error *error);

#endif
