/* HTML page of a run: see html_report.h. */
#include "firmware/report/html_report.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/monitor/finding.h"
#include "firmware/report/changes.h"
#include "firmware/report/envelope.h"
#include "firmware/report/html_resources.h"
#include "master/base/text.h"

/* ---- the data of a page ---- */

/* Channels of the envelope. They are followed by y, ŷ, Δy and the released y of each match, then u,
 * û and Δu of each adjusted variable. */
enum { TL_HTML_EXECUTIONS, TL_HTML_EVALUATIONS, TL_HTML_USED, TL_HTML_STEP_CHANNELS };
enum { MATCH_CHANNELS = 4, ADJUST_CHANNELS = 3 };

typedef struct tl_html_entry {
    int64_t tick;
    char at[TL_UTC_TEXT];
    char severity[12];
    char source[32];
    char text[224];
} tl_html_entry;

typedef struct tl_html_finding {
    bool is_open;
    double time; /* of its onset, on the axis of the plots */
    long long number;
    char text[TL_FINDING_TEXT];
    char cause[TL_FINDING_TEXT];
    char explanation[2048]; /* "": none */
} tl_html_finding;

struct tl_html_report {
    tl_html_settings settings;
    bool has_released;             /* y of a released twin is known in a step */
    char verdict[TL_FINDING_TEXT]; /* "": unknown */
    size_t finding_count;          /* including those no longer stored */
    tl_html_finding findings[TL_FINDINGS];
    const tl_trend *trend; /* NULL: there is none */
    tl_envelope curves;
    uint64_t recorded;    /* steps */
    uint64_t event_count; /* all events, including those no longer stored */
    tl_html_entry events[TL_HTML_EVENTS];
};

/* Data for writing a page. */
typedef struct page_data {
    const tl_html_report *report;
    const tl_run_figures *figures;
    const tl_lock_tally *lock;
    const char *ended;
    FILE *file;
} page_data;

/* Returns the first of the channels of a match. */
static size_t match_channel(size_t match) {
    return TL_HTML_STEP_CHANNELS + MATCH_CHANNELS * match;
}

static size_t adjust_channel(const tl_html_report *report, size_t adjust) {
    return match_channel(report->settings.match_count) + ADJUST_CHANNELS * adjust;
}

/* ---- html text ---- */

enum { SHOWN = 16, LONGEST = 4 };

/* Copies the next character in the form in which it may be shown (text.h); line ends stay. Returns
 * the text after it. */
static const char *take_character(const char *text, char shown[SHOWN]) {
    uint32_t code = 0;
    size_t length = tl_utf8_read(text, strnlen(text, LONGEST), &code);
    length = length == 0 ? 1 : length;
    if (*text == '\n' || *text == '\r') {
        (void)snprintf(shown, SHOWN, "%c", *text);
    } else {
        (void)tl_clean_text(text, length, shown, SHOWN);
    }
    return text + length;
}

void tl_html_put_text(FILE *file, const char *text) {
    static const char marks[] = "&<>\"'";
    static const char *const entities[] = {"&amp;", "&lt;", "&gt;", "&quot;", "&#39;"};
    while (*text != '\0') {
        char shown[SHOWN];
        text = take_character(text, shown);
        const char *mark = strchr(marks, shown[0]);
        if (mark != NULL) {
            (void)fputs(entities[mark - marks], file);
        } else {
            (void)fputs((unsigned char)shown[0] < ' ' ? " " : shown, file);
        }
    }
}

void tl_html_put_string(FILE *file, const char *text) {
    (void)fputc('"', file);
    while (*text != '\0') {
        char shown[SHOWN];
        text = take_character(text, shown);
        for (const char *c = shown; *c != '\0'; c++) {
            if ((unsigned char)*c < ' ' || strchr("\"\\<>&'", *c) != NULL) {
                (void)fprintf(file, "\\u%04x", (unsigned)(unsigned char)*c);
            } else {
                (void)fputc(*c, file);
            }
        }
    }
    (void)fputc('"', file);
}

void tl_html_put_number(FILE *file, double value) {
    if (isfinite(value)) {
        (void)fprintf(file, "%.9g", value);
    } else {
        (void)fputs("null", file);
    }
}

void tl_html_put_count(FILE *file, uint64_t count) {
    char digits[24];
    int length = snprintf(digits, sizeof digits, "%" PRIu64, count);
    for (int i = 0; i < length; i++) {
        if (i > 0 && (length - i) % 3 == 0) {
            (void)fputs("\342\200\257", file); /* U+202F, narrow no-break space */
        }
        (void)fputc(digits[i], file);
    }
}

void tl_html_digest(const void *data, size_t size, char text[TL_HTML_DIGEST]) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char digits[TL_SHA256_TEXT + 2];
    tl_sha256(data, size, digits);
    digits[64] = '0'; /* 32 bytes are 43 letters; the last letter has two unused bits */
    digits[65] = '0';
    char *end = text + sprintf(text, "sha256-");
    for (size_t i = 0; i < 66; i += 3) { /* three hexadecimal digits make two letters */
        const char three[] = {digits[i], digits[i + 1], digits[i + 2], '\0'};
        unsigned long bits = strtoul(three, NULL, 16);
        *end++ = letters[bits >> 6];
        *end++ = letters[bits & 63];
    }
    end[-1] = '='; /* the 44th letter carries no data */
    *end = '\0';
}

/* ---- The curves of a report as JSON, which page.js draws. */

/* Writes one value per bucket if each bucket is one step, else two. */
static void put_channel(const tl_html_report *report, const char *key, size_t channel, FILE *file) {
    const tl_envelope *curves = &report->curves;
    (void)fprintf(file, "\"%s\":[", key);
    for (size_t i = 0; i < curves->used; i++) {
        double pair[2];
        tl_envelope_get(curves, channel, i, pair);
        (void)fputs(i == 0 ? "" : ",", file);
        tl_html_put_number(file, pair[0]);
        if (curves->width > 1) {
            (void)fputc(',', file);
            tl_html_put_number(file, pair[1]);
        }
    }
    (void)fputc(']', file);
}

/* Writes three consecutive channels, each with a leading comma. */
static void put_channels(const tl_html_report *report, const char *const keys[3], size_t first, FILE *file) {
    for (size_t i = 0; i < 3; i++) {
        (void)fputs(",\n", file);
        put_channel(report, keys[i], first + i, file);
    }
}

/* Writes ranges of buckets in which ŷ was not always good: [first, last, qualities]. */
static void put_bad(const tl_html_report *report, size_t channel, FILE *file) {
    const tl_envelope *curves = &report->curves;
    const char *separator = "";
    (void)fputs("\"bad\":[", file);
    for (size_t i = 0; i < curves->used;) {
        uint8_t marks = tl_envelope_marks(curves, channel, i);
        size_t last = i;
        while (last + 1 < curves->used && tl_envelope_marks(curves, channel, last + 1) == marks) {
            last++;
        }
        if (marks != 0) {
            (void)fprintf(file, "%s[%zu,%zu,%u]", separator, i, last, (unsigned)marks);
            separator = ",";
        }
        i = last + 1;
    }
    (void)fputc(']', file);
}

static void put_signal(const tl_recorder_signal *signal, FILE *file) {
    (void)fputs("\n{\"name\":", file);
    tl_html_put_string(file, signal->name);
    (void)fputs(",\"unit\":", file);
    tl_html_put_string(file, tl_show_unit(signal->unit));
    (void)fputs(",\"type\":", file);
    tl_html_put_string(file, tl_type_name(signal->type));
}

static void put_match(const tl_html_report *report, size_t match, FILE *file) {
    static const char *const keys[] = {"simulated", "measured", "error"};
    const tl_html_settings *settings = &report->settings;
    size_t channel = match_channel(match);
    (void)fputs(match == 0 ? "" : ",", file);
    put_signal(&settings->match[match], file);
    (void)fputs(",\"to\":", file);
    tl_html_put_string(file, settings->match[match].to);
    (void)fputs(",\"tolerance\":", file);
    tl_html_put_number(file, settings->tolerance[match]);
    put_channels(report, keys, channel, file);
    (void)fputs(",\n", file);
    if (report->has_released) {
        put_channel(report, "released", channel + 3, file);
        (void)fputs(",\n", file);
    }
    put_bad(report, channel, file);
    (void)fputc('}', file);
}

/* Writes for each part of the trend the mean Δu, and the mean ± the standard deviation. */
static void put_trend(const tl_trend *trend, size_t adjust, FILE *file) {
    (void)fputs(",\n\"trend\":[", file);
    for (size_t i = 0; i < trend->parts; i++) {
        const tl_trend_part *part = &trend->part[adjust][i];
        const double spread = sqrt(part->squares / (double)part->count);
        const double numbers[] = {part->mean - spread, part->mean, part->mean + spread};
        (void)fputs(i == 0 ? "[" : ",[", file);
        for (int k = 0; k < 3; k++) {
            (void)fputs(k == 0 ? "" : ",", file);
            tl_html_put_number(file, part->count > 0 ? numbers[k] : (double)NAN);
        }
        (void)fputc(']', file);
    }
    (void)fputc(']', file);
}

static void put_data(const page_data *page) {
    static const char *const keys[] = {"applied", "nominal", "correction"};
    const tl_html_report *report = page->report;
    FILE *file = page->file;
    const tl_html_settings *settings = &report->settings;
    const tl_envelope *curves = &report->curves;
    (void)fprintf(file, "{\"step\":%.9f,\"first\":%" PRId64 ",\"steps\":%" PRId64 ",\"width\":%" PRId64, //
                  tl_seconds(settings->step), settings->first, curves->steps, curves->width);
    (void)fputs(",\"origin\":", file);
    if (settings->live) {
        (void)fprintf(file, "%" PRId64, settings->origin);
    } else {
        (void)fputs("null", file);
    }
    (void)fputs(",\n\"match\":[", file);
    for (size_t i = 0; i < settings->match_count; i++) {
        put_match(report, i, file);
    }
    (void)fputs("],\n\"adjust\":[", file);
    for (size_t i = 0; i < settings->adjust_count; i++) {
        (void)fputs(i == 0 ? "" : ",", file);
        put_signal(&settings->adjust[i], file);
        put_channels(report, keys, adjust_channel(report, i), file);
        if (report->trend != NULL) {
            put_trend(report->trend, i, file);
        }
        (void)fputc('}', file);
    }
    (void)fputs("],\n", file);
    if (report->trend != NULL) {
        (void)fprintf(file, "\"trend\":{\"from\":%" PRId64 ",\"width\":%" PRId64 "},\n", report->trend->from_ms,
                      report->trend->width_ms);
    }
    put_channel(report, "executions", TL_HTML_EXECUTIONS, file);
    (void)fputs(",\n", file);
    put_channel(report, "evaluations", TL_HTML_EVALUATIONS, file);
    if (settings->clock) {
        (void)fprintf(file, ",\n\"budget\":%.9g,\n", (double)settings->budget / 1e6);
        put_channel(report, "used", TL_HTML_USED, file);
    }
    (void)fputs("}\n", file);
}

/* ---- Facts, key figures and events of a report, readable without its scripts. A figure has its
 * exact value and a key, for programs: <data data-key="match.0.mse" value="0.028">. */

enum { TEXT = 64 };

/* ---- Cells ----------------------------------------------------------------------------------- */

static void put_value(FILE *file, const char *key, size_t index, const char *part, double value, bool sign) {
    char exact[TEXT];
    char shown[TEXT];
    if (!isfinite(value)) {
        (void)fprintf(file, "<data data-key=\"%s.%zu.%s\" value=\"\">–</data>", key, index, part);
        return;
    }
    tl_show_exact(value, exact, sizeof exact);
    tl_show_number(value, sign, shown, sizeof shown);
    (void)fprintf(file, "<data data-key=\"%s.%zu.%s\" value=\"%s\" title=\"%s\">%s</data>", key, index, part, exact,
                  exact, shown);
}

static void put_value_cell(FILE *file, const char *key, size_t index, const char *part, double value, bool sign) {
    (void)fputs("<td class=\"n\">", file);
    put_value(file, key, index, part, value, sign);
    (void)fputs("</td>", file);
}

static void put_counted(FILE *file, const char *key, uint64_t count) {
    (void)fprintf(file, "<data data-key=\"%s\" value=\"%" PRIu64 "\">", key, count);
    tl_html_put_count(file, count);
    (void)fputs("</data>", file);
}

static void put_count_cell(FILE *file, const char *key, size_t index, const char *part, uint64_t count) {
    char name[TEXT];
    (void)snprintf(name, sizeof name, "%s.%zu.%s", key, index, part);
    (void)fputs("<td class=\"n\">", file);
    put_counted(file, name, count);
    (void)fputs("</td>", file);
}

/* Writes escaped text within trusted markup. */
static void put_within(FILE *file, const char *before, const char *text, const char *after) {
    (void)fputs(before, file);
    tl_html_put_text(file, text);
    (void)fputs(after, file);
}

static void put_name_cell(FILE *file, const char *name) {
    put_within(file, "<td class=\"name\">", name, "</td>");
}

static void put_unit_cell(FILE *file, const char *unit) {
    put_within(file, "<td class=\"unit\">", unit[0] == '\0' ? "–" : unit, "</td>");
}

/* Writes for example "(rad/s)²"; "–" if there is no unit. */
static void put_square(FILE *file, const char *unit) {
    if (unit[0] == '\0') {
        put_unit_cell(file, unit);
    } else {
        put_within(file, "<td class=\"unit\">(", unit, ")²</td>");
    }
}

/* ---- Facts ----------------------------------------------------------------------------------- */

static const char FACT_END[] = "</dd></div>\n";

static void begin_fact(FILE *file, const char *name) {
    (void)fprintf(file, "<div><dt>%s</dt><dd>", name);
}

static void put_fact(FILE *file, const char *name, const char *text) {
    begin_fact(file, name);
    put_within(file, "", text, FACT_END);
}

/* Writes "2026-11-21 10:02:03 UTC" for "2026-11-21T10:02:03.456Z". */
static void put_utc(const char *at, FILE *file) {
    char text[TEXT];
    (void)snprintf(text, sizeof text, "%.10s %.8s UTC", at, strlen(at) > 11 ? at + 11 : "");
    tl_html_put_text(file, text);
}

static void put_solver(const tl_html_settings *settings, FILE *file) {
    begin_fact(file, "Solver");
    tl_html_put_text(file, settings->solver[0] == '\0' ? "none: free-running" : settings->solver);
    if (settings->fallback[0] != '\0') {
        put_within(file, ", fallback ", settings->fallback, "");
    }
    (void)fputs(FACT_END, file);
}

/* Each of these functions writes one part of the page, for which page.html has a placeholder. */
static void put_facts(const page_data *page) {
    const tl_html_report *report = page->report;
    FILE *file = page->file;
    const tl_html_settings *settings = &report->settings;
    char duration[TEXT];
    tl_show_duration((double)report->recorded * tl_seconds(settings->step), duration, sizeof duration);
    put_fact(file, settings->live ? "Source" : "Recording", settings->source);
    begin_fact(file, settings->live ? "Started" : "Created");
    put_utc(settings->begun, file);
    (void)fputs(FACT_END, file);
    begin_fact(file, "Steps");
    tl_html_put_count(file, report->recorded);
    (void)fprintf(file, ", %s", duration);
    (void)fputs(FACT_END, file);
    begin_fact(file, "Step, horizon, pairing");
    (void)fprintf(file, "T<sub>S</sub> = %.10g s, T<sub>P</sub> = %" PRIu32 ", ", tl_seconds(settings->step),
                  settings->prediction);
    tl_html_put_text(file, settings->measurements);
    (void)fputs(FACT_END, file);
    put_solver(settings, file);
    put_fact(file, "twinlock", settings->version);
    put_fact(file, "Ended", page->ended);
}

/* ---- Key figures at a glance ----------------------------------------------------------------- */

static void begin_tile(FILE *file, const char *label) {
    (void)fprintf(file, "<div class=\"tile\"><p class=\"label\">%s</p><p class=\"big\">", label);
}

static void end_tile(FILE *file) {
    (void)fputs("</p></div>\n", file);
}

/* Returns the match with the largest error relative to its tolerance. Without tolerances it is the
 * first one with a pair. */
static size_t worst_match(const tl_html_report *report, const tl_run_figures *figures) {
    size_t worst = 0;
    double most = -1.0;
    for (size_t i = 0; i < report->settings.match_count; i++) {
        double tolerance = report->settings.tolerance[i];
        double share = tolerance > 0.0 ? figures->match[i].maximum / tolerance : 0.0;
        if (figures->match[i].pairs > 0 && share > most) {
            worst = i;
            most = share;
        }
    }
    return worst;
}

static void put_deviation_tile(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    const tl_html_settings *settings = &report->settings;
    if (settings->match_count == 0) {
        return;
    }
    size_t i = worst_match(report, figures);
    begin_tile(file, "Largest error");
    put_value(file, "tile", i, "max", tl_run_figures_maximum(figures, i), false);
    put_within(file, " <small>", tl_show_unit(settings->match[i].unit), "</small>");
    put_within(file, "</p><p class=\"sub\">", settings->match[i].name, "");
    if (settings->tolerance[i] > 0.0) {
        (void)fprintf(file, ", tolerance %.4g ", settings->tolerance[i]);
        tl_html_put_text(file, tl_show_unit(settings->match[i].unit));
    }
    end_tile(file);
}

/* The lock monitor judges strokes if there is an event horizon. */
static void put_lock_tile(const tl_html_report *report, const tl_run_figures *figures, const tl_lock_tally *lock,
                          FILE *file) {
    const uint64_t total = tl_lock_tally_total(lock);
    begin_tile(file, "In lock");
    if (report->settings.adjust_count == 0 || total == 0) {
        (void)fprintf(file, "–</p><p class=\"sub\">%s",
                      report->settings.adjust_count == 0 ? "not synchronised" : "not known");
    } else {
        (void)fprintf(file, "%.1f <small>%%</small></p><p class=\"sub\">of ", tl_lock_tally_percent(lock));
        tl_html_put_count(file, total);
        (void)fprintf(file, " %s, at the end %s", figures->outcomes[TL_HELD] > 0 ? "strokes" : "steps",
                      tl_lock_state_name(lock->state));
    }
    end_tile(file);
}

/* Returns the saved executions in percent of those without saving; negative if catching up cost
 * more than was saved. */
static double saved_share(const tl_execution_counts *entry) {
    return entry->plain == 0 ? 0.0 : 100.0 * tl_run_component_saved(entry) / (double)entry->plain;
}

static void put_executions_tile(const tl_run_figures *figures, FILE *file) {
    tl_execution_counts total = tl_run_figures_total(figures);
    begin_tile(file, "Executions of the models");
    if (figures->ledger_count == 0) {
        (void)fputs("–</p><p class=\"sub\">not recorded", file);
    } else {
        tl_html_put_count(file, total.executions);
        (void)fprintf(file, "</p><p class=\"sub\">%.3g %% of ", saved_share(&total));
        tl_html_put_count(file, total.plain);
        (void)fputs(" saved", file);
    }
    end_tile(file);
}

static void put_time_tile(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    begin_tile(file, "In time");
    if (!report->settings.clock) {
        (void)fputs("–</p><p class=\"sub\">a replay has no clock", file);
    } else {
        bool all = figures->late + figures->skipped == 0;
        (void)fprintf(file, "%s</p><p class=\"sub\">", all ? "all steps" : "not all");
        (void)fprintf(file, "longest %.3g ms of %.4g ms", tl_seconds(figures->longest) * 1e3,
                      tl_seconds(report->settings.step) * 1e3);
    }
    end_tile(file);
}

/* ---- Tables ---------------------------------------------------------------------------------- */

static void begin_table(FILE *file, const char *title, const char *heads) {
    (void)fprintf(file, "<div class=\"table\"><h3>%s</h3><table><thead><tr>%s</tr></thead>\n<tbody>\n", title, heads);
}

static void end_table(FILE *file) {
    (void)fputs("</tbody></table></div>\n", file);
}

static void put_matches(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    const tl_html_settings *settings = &report->settings;
    begin_table(
        file, "Error: simulated minus measured",
        "<th>simulated y</th><th>measured ŷ</th><th class=\"n\">mean square</th>"
        "<th class=\"n\">without corrections</th><th class=\"unit\">unit</th>"
        "<th class=\"n\">largest</th><th class=\"n\">tolerance</th><th class=\"unit\">unit</th><th class=\"n\">pairs</th>"
        "<th class=\"n\">left out</th><th class=\"n\">mean square at the sensor's instants</th>"
        "<th class=\"n\">readings</th><th class=\"n\">rejected</th>");
    for (size_t i = 0; i < settings->match_count; i++) {
        const tl_metrics *metrics = &figures->match[i];
        const tl_recorder_signal *signal = &settings->match[i];
        (void)fputs("<tr>", file);
        put_name_cell(file, signal->name);
        put_name_cell(file, signal->to);
        put_value_cell(file, "match", i, "mse", tl_run_figures_mse(figures, i), false);
        put_value_cell(file, "match", i, "mse_released", tl_run_figures_mse_released(figures, i), false);
        put_square(file, tl_show_unit(signal->unit));
        put_value_cell(file, "match", i, "max", tl_run_figures_maximum(figures, i), false);
        put_value_cell(file, "match", i, "tolerance",
                       settings->tolerance[i] > 0.0 ? settings->tolerance[i] : (double)NAN, false);
        put_unit_cell(file, tl_show_unit(signal->unit));
        put_count_cell(file, "match", i, "pairs", metrics->pairs);
        put_count_cell(file, "match", i, "left_out", metrics->left_out);
        put_value_cell(file, "match", i, "mse_readings", tl_run_figures_mse_readings(figures, i), false);
        put_count_cell(file, "match", i, "readings", figures->readings[i].pairs);
        put_count_cell(file, "match", i, "rejected", figures->readings[i].left_out);
        (void)fputs("</tr>\n", file);
    }
    end_table(file);
}

static void put_adjusted(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    if (report->settings.adjust_count == 0) {
        return;
    }
    begin_table(file, "Corrections",
                "<th>applied u</th><th class=\"n\">first</th><th class=\"n\">last</th><th class=\"n\">mean</th>"
                "<th class=\"n\">mean correction Δu</th><th class=\"unit\">unit</th>");
    for (size_t i = 0; i < report->settings.adjust_count; i++) {
        (void)fputs("<tr>", file);
        put_name_cell(file, report->settings.adjust[i].name);
        const tl_run_adjusted *adjusted = &figures->adjust[i];
        put_value_cell(file, "adjust", i, "first", adjusted->count > 0 ? adjusted->first : (double)NAN, false);
        put_value_cell(file, "adjust", i, "last", adjusted->count > 0 ? adjusted->last : (double)NAN, false);
        put_value_cell(file, "adjust", i, "mean", tl_run_figures_mean(figures, i), false);
        put_value_cell(file, "adjust", i, "correction_mean", tl_run_figures_correction_mean(figures, i), true);
        put_unit_cell(file, tl_show_unit(report->settings.adjust[i].unit));
        (void)fputs("</tr>\n", file);
    }
    end_table(file);
}

static void put_ledger_row(FILE *file, const char *row, const char *name, size_t index,
                           const tl_execution_counts *entry) {
    (void)fputs(row, file);
    put_name_cell(file, name);
    put_count_cell(file, "ledger", index, "executions", entry->executions);
    put_count_cell(file, "ledger", index, "plain", entry->plain);
    (void)fprintf(file, "<td class=\"n\">%.1f %%</td>", saved_share(entry));
    (void)fprintf(file, "<td class=\"n\">%" PRId64 "</td></tr>\n", tl_run_component_difference(entry));
}

static void put_ledger(const tl_run_figures *figures, FILE *file) {
    tl_execution_counts total = tl_run_figures_total(figures);
    if (figures->ledger_count == 0) {
        return;
    }
    begin_table(file, "Executions",
                "<th>component</th><th class=\"n\">executions</th><th class=\"n\">without saving</th>"
                "<th class=\"n\">saved</th><th class=\"n\" title=\"executions − repeated − predicted\">"
                "not predicted</th>");
    for (size_t i = 0; i < figures->ledger_count; i++) {
        put_ledger_row(file, "<tr>", figures->ledger[i].name, i, &figures->ledger[i].counts);
    }
    put_ledger_row(file, "<tr class=\"total\">", "all", figures->ledger_count, &total);
    end_table(file);
}

static void put_row(FILE *file, const char *name, const char *key, uint64_t count) {
    (void)fprintf(file, "<tr><td>%s</td><td class=\"n\">", name);
    put_counted(file, key, count);
    (void)fputs("</td></tr>\n", file);
}

static void put_steps(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    begin_table(file, "Steps", "<th></th><th class=\"n\">number</th>");
    put_row(file, "computed at their own tick", "steps", figures->steps);
    for (int i = 0; i < TL_OUTCOMES; i++) {
        char key[TEXT];
        char name[TEXT];
        (void)snprintf(key, sizeof key, "outcomes.%s", tl_outcome_name((tl_outcome)i));
        (void)snprintf(name, sizeof name, "<span class=\"indent\">%s</span>", tl_outcome_name((tl_outcome)i));
        if (figures->outcomes[i] != 0) {
            put_row(file, name, key, figures->outcomes[i]);
        }
    }
    put_row(file, "evaluations", "evaluations", figures->evaluations);
    put_row(file, "steps with a search", "optimised_steps", figures->optimised_steps);
    if (figures->rested != 0) {
        put_row(file, "at rest: u was nominal", "rested_steps", figures->rested);
    }
    if (report->settings.clock) {
        put_row(file, "searches stopped by the time budget", "time_limited", figures->time_limited);
        put_row(file, "longer than T_S", "late", figures->late);
    }
    if (report->settings.clock || figures->skipped != 0) {
        put_row(file, "ticks missed", "skipped", figures->skipped);
    }
    end_table(file);
}

static void put_figures(const page_data *page) {
    const tl_html_report *report = page->report;
    const tl_run_figures *figures = page->figures;
    FILE *file = page->file;
    (void)fputs("<section id=\"figures\">\n<h2>Key figures</h2>\n<div class=\"tiles\">\n", file);
    put_deviation_tile(report, figures, file);
    put_lock_tile(report, figures, page->lock, file);
    put_executions_tile(figures, file);
    put_time_tile(report, figures, file);
    (void)fputs("</div>\n<div class=\"tables\">\n", file);
    put_matches(report, figures, file);
    put_adjusted(report, figures, file);
    (void)fputs("<details><summary>Details: executions and outcomes of the steps</summary>\n<div class=\"pair\">\n",
                file);
    put_ledger(figures, file);
    put_steps(report, figures, file);
    (void)fputs("</div>\n</details>\n</div>\n</section>\n", file);
}

/* ---- Notes on the plots ---------------------------------------------------------------------- */

static void put_thinning(const page_data *page) {
    const tl_html_report *report = page->report;
    FILE *file = page->file;
    if (report->curves.width > 1) {
        (void)fputs("<p class=\"note\" id=\"thinning\">The plots show the smallest and the largest value of every ",
                    file);
        put_counted(file, "width", (uint64_t)report->curves.width);
        (void)fputs(" steps, in the order of time. No extreme is left out.</p>\n", file);
    }
    if (!report->settings.clock) {
        (void)fputs(
            "<p class=\"note\">A replay has no clock, so there is no time budget and no plot of the computing time.</p>\n",
            file);
    }
}

/* ---- Changes --------------------------------------------------------------------------------- */

static void put_finding(const tl_html_finding *finding, FILE *file) {
    (void)fprintf(file, "<tr class=\"%s\" data-time=\"%.15g\"><td class=\"n\">%lld</td>",
                  finding->is_open ? "open" : "gone", finding->time, finding->number);
    put_within(file, "<td class=\"text\">", finding->text, "</td>");
    put_within(file, "<td class=\"text\">", finding->cause, "");
    put_within(file, finding->explanation[0] != '\0' ? "<p>" : "", finding->explanation, "</td></tr>\n");
}

static void put_changes(const page_data *page) {
    const tl_html_report *report = page->report;
    FILE *file = page->file;
    size_t count = report->finding_count;
    if (report->verdict[0] == '\0') {
        return;
    }
    put_within(file, "<section id=\"changes\">\n<h2>Changes</h2>\n<p class=\"verdict\">", report->verdict, "</p>\n");
    if (count > 0) {
        begin_table(file, "", "<th class=\"n\">no.</th><th>change</th><th>cause</th>");
        for (size_t i = count > TL_FINDINGS ? count - TL_FINDINGS : 0; i < count; i++) {
            put_finding(&report->findings[i % TL_FINDINGS], file);
        }
        end_table(file);
    }
    (void)fputs("</section>\n", file);
}

/* ---- Events ---------------------------------------------------------------------------------- */

/* Returns the position on the time axis of the plots: s, or ms since 1970 (UTC) in a live run; NaN
 * if it is unknown. */
static double axis_time(const tl_html_settings *settings, const tl_html_entry *entry) {
    int64_t at = 0;
    if (entry->tick >= 0) {
        double seconds = (double)entry->tick * tl_seconds(settings->step);
        return settings->live ? (double)settings->origin + seconds * 1e3 : seconds;
    }
    return settings->live && tl_utc_parse(entry->at, &at) ? (double)at : (double)NAN;
}

static void put_event(const tl_html_settings *settings, const tl_html_entry *entry, FILE *file) {
    double time = axis_time(settings, entry);
    put_within(file, "<tr class=\"", entry->severity, "\"");
    if (isfinite(time)) {
        (void)fprintf(file, " data-time=\"%.15g\"", time);
    }
    (void)fputs("><td class=\"n\">", file);
    if (settings->live) {
        put_utc(entry->at, file);
    } else if (isfinite(time)) {
        (void)fprintf(file, "%.10g s", time);
    }
    put_within(file, "</td><td><span class=\"severity\">", entry->severity, "</span></td>");
    put_within(file, "<td>", entry->source, "</td>");
    put_within(file, "<td class=\"text\">", entry->text, "</td></tr>\n");
}

static void put_events(const page_data *page) {
    const tl_html_report *report = page->report;
    FILE *file = page->file;
    uint64_t count = report->event_count;
    uint64_t first = count > TL_HTML_EVENTS ? count - TL_HTML_EVENTS : 0;
    (void)fputs("<section id=\"events\">\n<h2>Events</h2>\n", file);
    if (count == 0) {
        (void)fputs("<p class=\"note\">None.</p>\n</section>\n", file);
        return;
    }
    if (first > 0) {
        (void)fprintf(file, "<p class=\"note\">The newest %d of ", TL_HTML_EVENTS);
        tl_html_put_count(file, count);
        (void)fputs(".</p>\n", file);
    }
    begin_table(file, "", "<th class=\"n\">time</th><th>severity</th><th>source</th><th>event</th>");
    for (uint64_t i = first; i < count; i++) {
        put_event(&report->settings, &report->events[i % TL_HTML_EVENTS], file);
    }
    end_table(file);
    (void)fputs("</section>\n", file);
}

/* ---- The page: page.html with its placeholders replaced. */

static void put_name(const page_data *page) {
    tl_html_put_text(page->file, page->report->settings.name);
}

static void put_version(const page_data *page) {
    tl_html_put_text(page->file, TL_VERSION);
}

/* Permits the two embedded scripts only. */
static void put_policy(const page_data *page) {
    char library[TL_HTML_DIGEST];
    char script[TL_HTML_DIGEST];
    tl_html_digest(tl_html_library.bytes, tl_html_library.size, library);
    tl_html_digest(tl_html_script.bytes, tl_html_script.size, script);
    (void)fprintf(page->file, "default-src 'none'; style-src 'unsafe-inline'; script-src '%s' '%s'", library, script);
}

static const struct {
    const char *name;
    const tl_html_resource *resource; /* the text for the placeholder, or NULL: `put` writes it */
    void (*put)(const page_data *page);
} placeholders[] = {
    {"name", NULL, put_name},          {"version", NULL, put_version},
    {"policy", NULL, put_policy},      {"library-style", &tl_html_library_style, NULL},
    {"style", &tl_html_style, NULL},   {"library", &tl_html_library, NULL},
    {"script", &tl_html_script, NULL}, {"licence", &tl_html_licence, NULL},
    {"facts", NULL, put_facts},        {"figures", NULL, put_figures},
    {"events", NULL, put_events},      {"thinning", NULL, put_thinning},
    {"data", NULL, put_data},          {"changes", NULL, put_changes},
};

/* Replaces the placeholder `name` of `length` characters. An unknown one stays as it is, so that a
 * test finds it. */
static void fill_placeholder(const page_data *page, const char *name, size_t length) {
    for (size_t i = 0; i < sizeof placeholders / sizeof placeholders[0]; i++) {
        if (strlen(placeholders[i].name) != length || memcmp(placeholders[i].name, name, length) != 0) {
            continue;
        }
        if (placeholders[i].resource != NULL) {
            (void)fwrite(placeholders[i].resource->bytes, 1, placeholders[i].resource->size, page->file);
        } else {
            placeholders[i].put(page);
        }
        return;
    }
    (void)fprintf(page->file, "{{%.*s}}", (int)length, name);
}

void tl_html_report_write(const tl_html_report *report, const tl_run_figures *figures, const tl_lock_tally *lock,
                          const char *ended, FILE *file) {
    const page_data page = {report, figures, lock, ended, file};
    const char *at = (const char *)tl_html_frame.bytes;
    const char *end = at + tl_html_frame.size;
    for (const char *open; (open = memmem(at, (size_t)(end - at), "{{", 2)) != NULL;) {
        const char *close = memmem(open, (size_t)(end - open), "}}", 2);
        if (close == NULL) {
            break;
        }
        (void)fwrite(at, 1, (size_t)(open - at), file);
        fill_placeholder(&page, open + 2, (size_t)(close - open) - 2);
        at = close + 2;
    }
    (void)fwrite(at, 1, (size_t)(end - at), file);
}

/* ---- html report ---- */

/* Points of all curves together, for a page of at most about 7 MB. MOST_BUCKETS is twice what a
 * wide screen can show, for zooming. */
enum { POINTS = 1 << 18, MOST_BUCKETS = 1 << 13, LEAST_BUCKETS = 1 << 10 };

double tl_html_tolerance(const tl_plan_match *match, bool synchronise) {
    return synchronise && match->weight > 0.0 ? match->tolerance : 0.0;
}

tl_status tl_html_report_create(const tl_html_settings *settings, tl_html_report **report, tl_error *error) {
    size_t channels =
        TL_HTML_STEP_CHANNELS + MATCH_CHANNELS * settings->match_count + ADJUST_CHANNELS * settings->adjust_count;
    size_t buckets = MOST_BUCKETS;
    while (buckets > LEAST_BUCKETS && buckets * channels > POINTS) {
        buckets /= 2;
    }
    tl_html_report *created = calloc(1, sizeof *created);
    if (created == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a report");
    }
    created->settings = *settings;
    tl_status status = tl_envelope_init(&created->curves, channels, buckets, error);
    if (status != TL_OK) {
        free(created);
        return status;
    }
    *report = created;
    return TL_OK;
}

void tl_html_report_destroy(tl_html_report *report) {
    if (report != NULL) {
        tl_envelope_free(&report->curves);
        free(report);
    }
}

static void add_step(void *context, const tl_history_step *step) {
    tl_html_report *report = context;
    int64_t position = step->step - report->settings.first;
    tl_envelope *curves = &report->curves;
    tl_envelope_put(curves, TL_HTML_EXECUTIONS, position, (double)step->executions);
    tl_envelope_put(curves, TL_HTML_EVALUATIONS, position, (double)step->evaluations);
    tl_envelope_put(curves, TL_HTML_USED, position, (double)step->used / 1e6);
    report->recorded++;
}

/* A quality that only a newer program knows is treated as "not a number". */
static void add_output(void *context, const tl_history_output *output) {
    tl_html_report *report = context;
    int64_t position = output->step - report->settings.first;
    size_t channel = match_channel(output->signal);
    bool good = output->quality == TL_GOOD;
    bool is_known = output->quality >= TL_GOOD && output->quality <= TL_LAST_QUALITY;
    tl_envelope_put(&report->curves, channel, position, output->y);
    tl_envelope_put(&report->curves, channel + 1, position, good ? output->measured : (double)NAN);
    tl_envelope_put(&report->curves, channel + 2, position, good ? output->y - output->measured : (double)NAN);
    tl_envelope_put(&report->curves, channel + 3, position, output->released);
    report->has_released = report->has_released || isfinite(output->released);
    if (!good) {
        unsigned quality = is_known ? (unsigned)output->quality : (unsigned)TL_NOT_A_NUMBER;
        tl_envelope_mark(&report->curves, channel, position, (uint8_t)(1U << quality));
    }
}

static void add_adjustment(void *context, const tl_history_adjustment *adjustment) {
    tl_html_report *report = context;
    int64_t position = adjustment->step - report->settings.first;
    size_t channel = adjust_channel(report, adjustment->signal);
    tl_envelope_put(&report->curves, channel, position, adjustment->u);
    tl_envelope_put(&report->curves, channel + 1, position, adjustment->nominal);
    tl_envelope_put(&report->curves, channel + 2, position, adjustment->u - adjustment->nominal);
}

static void add_event(void *context, const tl_history_event *event) {
    tl_html_report *report = context;
    tl_html_entry *entry = &report->events[report->event_count++ % TL_HTML_EVENTS];
    entry->tick = event->has_tick ? event->tick : -1;
    (void)snprintf(entry->at, sizeof entry->at, "%s", event->at);
    (void)snprintf(entry->severity, sizeof entry->severity, "%s", event->severity);
    (void)snprintf(entry->source, sizeof entry->source, "%s", event->source);
    (void)snprintf(entry->text, sizeof entry->text, "%s", event->text);
}

tl_history_visitor tl_html_report_visitor(tl_html_report *report) {
    return (tl_history_visitor){
        .context = report,
        .signals =
            {[TL_HISTORY_MATCH] = report->settings.match_count, [TL_HISTORY_ADJUST] = report->settings.adjust_count},
        .step = add_step,
        .output = add_output,
        .adjustment = add_adjustment,
        .event = add_event,
    };
}

void tl_html_report_add_record(tl_html_report *report, const tl_record *record) {
    const tl_history_step step = {
        .step = record->step,
        .evaluations = record->evaluations,
        .executions = record->executions,
        .used = record->used,
    };
    add_step(report, &step);
    for (size_t i = 0; i < report->settings.match_count; i++) {
        const tl_history_output output = {record->step,
                                          i,
                                          record->y[i],
                                          record->measured[i],
                                          .quality = record->measured_quality[i],
                                          .released = record->release_age != 0 ? record->released[i] : (double)NAN};
        add_output(report, &output);
    }
    for (size_t i = 0; i < report->settings.adjust_count; i++) {
        const tl_history_adjustment adjustment = {record->step, i, record->u[i], record->nominal[i]};
        add_adjustment(report, &adjustment);
    }
}

void tl_html_report_set_verdict(tl_html_report *report, const tl_run_detection *detection, size_t open, size_t gone) {
    tl_changes_write_verdict(detection, open, gone, report->verdict);
}

void tl_html_report_add_finding(tl_html_report *report, const tl_run_finding *row, double now, int64_t started,
                                const char *explanation) {
    tl_html_finding *finding = &report->findings[report->finding_count++ % TL_FINDINGS];
    tl_changes_write_finding(row, now, started, finding->text, finding->cause);
    (void)snprintf(finding->explanation, sizeof finding->explanation, "%s", explanation != NULL ? explanation : "");
    finding->number = row->number;
    finding->is_open = tl_changes_is_open(row);
    finding->time = report->settings.live ? (double)started + row->onset * 1e3 : row->onset;
}

void tl_html_report_set_trend(tl_html_report *report, const tl_trend *trend) {
    report->trend = trend->parts > 1 ? trend : NULL;
}

void tl_html_report_add_event(tl_html_report *report, const tl_history_event *event) {
    add_event(report, event);
}
