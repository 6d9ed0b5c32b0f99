/* HTML page of a run, and functions that write text into it.
 *
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_HTML_REPORT_H
#define TL_FIRMWARE_REPORT_HTML_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/base/text.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/report/run_figures.h"
#include "firmware/report/trend.h"
#include "firmware/store/history.h"
#include "firmware/store/run_types.h"
#include "master/plan/plan.h"
#include "master/twin/twin.h"

/* ---- Text on an HTML page: escapes untrusted names and numbers so that they are always shown as
 * text.
 *
 * Purpose: names of configurations, signals and units, and all texts in a database, may contain any
 *          character.
 * Source:  HTML Living Standard, "Parsing" and "Restrictions for contents of script elements"; RFC
 *          8259 for JSON.
 * Errors:  none; the caller checks the stream.
 */

/* Writes a text as content of an element, or of an attribute in double quotes. A line break becomes
 * a blank. Characters that cannot be shown are replaced as text.h defines. */
void tl_html_put_text(FILE *file, const char *text);

/* Writes a JSON string with its quotes. The string is safe within a script element, because "<",
 * ">" and "&" are escaped. Characters that cannot be shown are replaced as above. */
void tl_html_put_string(FILE *file, const char *text);

/* Writes a JSON number with nine digits, enough for a plot; null if `value` is not finite. */
void tl_html_put_number(FILE *file, double value);

/* Writes a count with its digits in groups of three, for example "1 234 567", separated by narrow
 * no-break spaces. */
void tl_html_put_count(FILE *file, uint64_t count);

/* Writes to `text` the SHA-256 of a script as a Content-Security-Policy needs it: "sha256-" and
 * base64, without quotes. */
enum { TL_HTML_DIGEST = 52 };
void tl_html_digest(const void *data, size_t size, char text[TL_HTML_DIGEST]);

/* ---- Report of a run: one self-contained HTML page with key figures, curves and events.
 *
 * Purpose: a page to read, send and print. A replay and a recorded run have the same page.
 * Bound:   memory and page size do not grow with the run. Curves are thinned to envelopes
 *          (envelope.h), and only the newest TL_HTML_EVENTS events are listed.
 * Safety:  untrusted texts are escaped by the functions above. The policy of the page permits only
 *          the two scripts that the build has embedded, and forbids loading anything.
 * Format:  docs/reference/files.md, "The report".
 * Owner:   texts and arrays of the settings must outlive the report.
 * Thread:  one thread.
 */

enum { TL_HTML_EVENTS = 1000 }; /* most listed events */

typedef struct tl_html_settings {
    const char *name;                         /* of the configuration */
    const char *source;                       /* of the data: the recording's file, or database and run */
    const char *begun;                        /* start of the run, UTC */
    const char *version;                      /* of the program that executed the steps */
    const char *solver;                       /* "": nothing is adjusted */
    const char *fallback;                     /* fallback solver; "": none */
    const char *measurements;                 /* pairing: "lag", "hold" or "ahead" */
    tl_time step;                             /* T_S, ns */
    uint32_t prediction;                      /* T_P, in steps */
    bool live;                                /* a live run: its steps have calendar times */
    int64_t origin;                           /* if live: start of step 0, ms since 1970 UTC */
    bool clock;                               /* a clock limited the searches, so `used` of a step is valid */
    tl_time budget;                           /* time budget of a search, ns; 0: unknown */
    int64_t first;                            /* first step on the page; do not add earlier ones */
    const tl_recorder_signal *match, *adjust; /* matched outputs, adjusted variables */
    size_t match_count, adjust_count;
    const double *tolerance; /* of each match, in its unit; 0: none */
} tl_html_settings;

typedef struct tl_html_report tl_html_report;

/* Returns the tolerance of a match, in its unit; 0 if the match is only compared, because its
 * weight is 0 or nothing is adjusted. `synchronise`: the configuration adjusts inputs. */
double tl_html_tolerance(const tl_plan_match *match, bool synchronise);

/* Creates an empty report; copies the settings but not their texts and arrays. Errors: TL_TRY_AGAIN
 * if memory is out. */
tl_status tl_html_report_create(const tl_html_settings *settings, tl_html_report **report, tl_error *error);

/* Frees the report. NULL is allowed. */
void tl_html_report_destroy(tl_html_report *report);

/* Returns a visitor (history.h) that adds steps, outputs, adjustments and events of a database.
 * Within each kind of rows, steps must ascend. The kinds may come one after another. */
tl_history_visitor tl_html_report_visitor(tl_html_report *report);

/* Adds a step of a run that is not read from a database; steps must ascend. */
void tl_html_report_add_record(tl_html_report *report, const tl_record *record);

/* Adds an event; events must be in order of time. Texts are copied and truncated to the size of an
 * entry. event->at is "" in a replay. */
void tl_html_report_add_event(tl_html_report *report, const tl_history_event *event);

/* Set the verdict of the change detector, and add a finding; the newest TL_FINDINGS are listed.
 * `open`, `gone`: numbers of findings. `now`: present time, s since t_start; decides how times are
 * written. `started`: t_start, ms since 1970 UTC; 0: a replay. `explanation`: answer of `twinlock
 * explain`; NULL: none. Without a verdict the page has no section of changes. */
void tl_html_report_set_verdict(tl_html_report *report, const tl_run_detection *detection, size_t open, size_t gone);
void tl_html_report_add_finding(tl_html_report *report, const tl_run_finding *row, double now, int64_t started,
                                const char *explanation);

/* Sets the trend of the adjusted variables, in the order of the settings; it must outlive the
 * report. A trend of one part is not shown. */
void tl_html_report_set_trend(tl_html_report *report, const tl_trend *trend);

/* Writes the page. Signals in `figures` must be in the order of the settings. `lock`: counts of the
 * lock states; zeroed: unknown. `ended`: why the run ended. The caller checks the stream for write
 * errors. */
void tl_html_report_write(const tl_html_report *report, const tl_run_figures *figures, const tl_lock_tally *lock,
                          const char *ended, FILE *file);

#endif
