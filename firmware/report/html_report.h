/* The HTML page of a run.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_REPORT_HTML_REPORT_H
#define TL_FIRMWARE_REPORT_HTML_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/base/text.h"
#include "firmware/report/run_figures.h"
#include "firmware/store/history.h"
#include "master/plan/plan.h"
#include "master/twin/twin.h"

/* ---- Text on an HTML page: names and numbers that came from outside, written so that they can be nothing but text.
 *
 * Purpose: names of configurations, signals and units, and whatever a database holds, may have any character.
 * Source:  HTML Living Standard, "Parsing" and "Restrictions for contents of script elements"; RFC 8259 for JSON.
 * Thread:  the stream belongs to one thread.
 */

/* As content of an element, or of an attribute in double quotes. White space becomes blanks, and what cannot be shown what text.h says; so it
 * does in a string. */
void tl_html_put_text(FILE *file, const char *text);

/* As a JSON string, quotes included, that may stand in a script element: no "<", ">" or "&" is left in it. */
void tl_html_put_string(FILE *file, const char *text);

/* As a JSON number with nine digits, enough for a plot; null where it is not finite. */
void tl_html_put_number(FILE *file, double value);

/* A count with its digits in groups of three: "1 234 567", by narrow spaces that do not break. */
void tl_html_put_count(FILE *file, uint64_t count);

/* The digest of a script as a Content-Security-Policy names it: "sha256-" and base64. */
enum { TL_HTML_DIGEST = 52 };
void tl_html_digest(const void *data, size_t size, char text[TL_HTML_DIGEST]);

/* ---- The report of a run: one HTML page with its key figures, its curves and its events, which needs nothing else.
 *
 * Purpose: what a person looks at, mails and prints; the same for a replay and for a recorded run.
 * Bound:   memory and page do not grow with the run: curves are thinned to envelopes (envelope.h), of the events the
 *          newest TL_HTML_EVENTS are listed.
 * Safety:  what comes from outside is written by html_report.h; the page's policy runs only the two scripts that the build
 *          put into it, and lets nothing be loaded.
 * Format:  config/SPEC.md, "The report".
 * Owner:   texts and arrays of the settings must outlive the report.
 * Thread:  one thread.
 */

enum { TL_HTML_EVENTS = 1000 };

typedef struct tl_html_settings {
    const char *name;    /* of the configuration */
    const char *source;  /* what was run: the recording's file, or database and run */
    const char *begun;   /* UTC */
    const char *version; /* of the program that stepped */
    const char *solver;  /* "": nothing is adjusted */
    const char *fallback;
    const char *measurements;
    tl_time step;        /* T_S */
    uint32_t prediction; /* T_P */
    bool live;           /* steps were at a time of the world: step 0 began at `origin` */
    int64_t origin;      /* UTC, ms */
    bool clock;          /* a clock limited the searches, and `used` means something */
    tl_time budget;      /* ns for a search; 0: not known */
    int64_t first;       /* the first step that there may be */
    const tl_recorder_signal *match, *adjust;
    size_t match_count, adjust_count;
    const double *tolerance; /* of each match; 0: none */
} tl_html_settings;

typedef struct tl_html_report tl_html_report;

/* The tolerance of a match; 0 where it is only compared, and so has none. */
double tl_html_tolerance(const tl_plan_match *match, bool synchronise);

tl_status tl_html_report_create(const tl_html_settings *settings, tl_html_report **report, tl_error *error);

/* NULL is allowed. */
void tl_html_report_destroy(tl_html_report *report);

/* Adds rows of a database: each kind in the order of the steps; the kinds may follow each other. */
tl_history_visitor tl_html_report_visitor(tl_html_report *report);

/* Adds a step of a run that is not read from a database. */
void tl_html_report_add_record(tl_html_report *report, const tl_record *record);

/* In the order in which they were. Texts are copied, and cut to what an entry holds; `at` is "" in a replay. */
void tl_html_report_add_event(tl_html_report *report, const tl_history_event *event);

/* The page. Of the figures, those of the signals are in the order of the settings. `ended` says why the run ended, in words. What could not
 * be written is seen on the stream. */
void tl_html_report_write(const tl_html_report *report, const tl_run_figures *figures, const char *ended, FILE *file);

#endif
