/* What `twinlock show` shows of a database: a page for people, one JSON object, a table as CSV, or a report. Also the CSV of a replay.
 *
 * Purpose: one request, four ways to answer it. The request is checked; what it asks for is read while it is printed.
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

typedef struct tl_show_request {
    const char *path;
    tl_history *history;
    const tl_history_run *run; /* the chosen one */
    int64_t from_step;         /* steps before are left out; ticks too */
    char from_at[TL_UTC_TEXT]; /* events before are left out; "": none */
    bool all_events;           /* not only the last ones */
    tl_show_style style;       /* of the page */
} tl_show_request;

typedef enum tl_show_csv_table {
    TL_SHOW_OUTPUTS,
    TL_SHOW_ADJUSTMENTS,
    TL_SHOW_STEPS,
    TL_SHOW_SAMPLES,
    TL_SHOW_EVENTS
} tl_show_csv_table;

tl_status tl_show_page(const tl_show_request *request, FILE *file, tl_error *error);

/* Keys as `replay --json` has them, where both have the same; config/SPEC.md, "show --json". */
tl_status tl_show_json(const tl_show_request *request, FILE *file, tl_error *error);

/* With a header, quoted as RFC 4180 says; numbers so that they read back as they were. */
tl_status tl_show_csv(const tl_show_request *request, tl_show_csv_table table, FILE *file, tl_error *error);

/* An HTML page (html_report.h) as a file of its own, which may not be the database. Errors: those of os.h too. */
tl_status tl_show_report(const tl_show_request *request, const char *path, tl_error *error);

/* Steps of a live run were at a time of the world, those of a replay were not. */
bool tl_show_is_live(const tl_history_run *run);

/* UTC of the instant at which step `step` of a live run began, ms. */
int64_t tl_show_instant(const tl_history_run *run, int64_t step);

/* ---- The trajectory of `replay --csv`: y, ŷ, u and û of every step as CSV, while it runs.
 *
 * Format: config/SPEC.md, "Results", --csv. Numbers carry 17 digits, so that they read back to the same bits.
 * Thread: one thread.
 */

/* Opens the file ("-": `output`) and writes the header row. */
tl_status tl_trajectory_open(const char *path, FILE *output, const tl_config *config, FILE **file, tl_error *error);

void tl_trajectory_add(FILE *file, const tl_config *config, const tl_record *record);

/* Closes what was opened; `output` is only flushed. Errors: TL_TRY_AGAIN if not everything could be written. */
tl_status tl_trajectory_close(FILE *file, FILE *output, const char *path, tl_error *error);

#endif
