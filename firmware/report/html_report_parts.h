/* What the files of the report share: gathering (html_report.c), the page (html_page.c), its tables (html_tables.c) and
 * its curves (html_curves.c). Private to them.
 *
 * Thread: as html_report.h.
 */
#ifndef TL_FIRMWARE_REPORT_HTML_REPORT_PARTS_H
#define TL_FIRMWARE_REPORT_HTML_REPORT_PARTS_H

#include "firmware/report/envelope.h"
#include "firmware/report/html_report.h"

/* Channels of the envelope; behind them y, ŷ and Δy of each match, then u, û and Δu of each adjusted variable. */
enum { TL_HTML_EXECUTIONS, TL_HTML_EVALUATIONS, TL_HTML_USED, TL_HTML_STEP_CHANNELS };

typedef struct tl_html_entry {
    int64_t tick;
    char at[TL_UTC_TEXT];
    char severity[12];
    char source[32];
    char text[224];
} tl_html_entry;

struct tl_html_report {
    tl_html_settings settings;
    tl_envelope curves;
    uint64_t recorded;    /* steps */
    uint64_t event_count; /* all that there were */
    tl_html_entry events[TL_HTML_EVENTS];
};

/* The first of the three channels. */
size_t tl_html_match_channel(const tl_html_report *report, size_t match);
size_t tl_html_adjust_channel(const tl_html_report *report, size_t adjust);

/* Parts of the page; each writes what page.html has a place for. */
void tl_html_put_facts(const tl_html_report *report, const char *ended, FILE *file);
void tl_html_put_figures(const tl_html_report *report, const tl_run_figures *figures, FILE *file);
void tl_html_put_thinning(const tl_html_report *report, FILE *file);
void tl_html_put_events(const tl_html_report *report, FILE *file);
void tl_html_put_data(const tl_html_report *report, FILE *file);

#endif
