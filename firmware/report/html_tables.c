/* The facts, the key figures and the events of a report, readable without its scripts. A figure carries its exact value and
 * a key, for programs: <data data-key="match.0.mse" value="0.028">. */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "firmware/base/show_text.h"
#include "firmware/report/html_report_parts.h"
#include "firmware/report/html_text.h"

enum { TEXT = 64 };

/* ---- Cells ------------------------------------------------------------------------------------------------------- */

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

static void put_name_cell(FILE *file, const char *name) {
    (void)fputs("<td class=\"name\">", file);
    tl_html_put_text(file, name);
    (void)fputs("</td>", file);
}

static void put_unit_between(FILE *file, const char *before, const char *unit, const char *after) {
    (void)fprintf(file, "<td class=\"unit\">%s", before);
    tl_html_put_text(file, unit);
    (void)fprintf(file, "%s</td>", after);
}

static void put_unit_cell(FILE *file, const char *unit) {
    put_unit_between(file, "", unit, "");
}

/* "(rad/s)²"; a dimension of its own is not squared. */
static void put_square(FILE *file, const char *unit) {
    bool squared = unit[0] != '\0';
    put_unit_between(file, squared ? "(" : "", unit, squared ? ")²" : "");
}

/* ---- Facts ------------------------------------------------------------------------------------------------------- */

static void begin_fact(FILE *file, const char *name) {
    (void)fprintf(file, "<div><dt>%s</dt><dd>", name);
}

static void end_fact(FILE *file) {
    (void)fputs("</dd></div>\n", file);
}

static void put_fact(FILE *file, const char *name, const char *text) {
    begin_fact(file, name);
    tl_html_put_text(file, text);
    end_fact(file);
}

/* "2026-11-21 10:02:03 UTC" of "2026-11-21T10:02:03.456Z". */
static void put_utc(const char *at, FILE *file) {
    char text[TEXT];
    (void)snprintf(text, sizeof text, "%.10s %.8s UTC", at, strlen(at) > 11 ? at + 11 : "");
    tl_html_put_text(file, text);
}

static void put_solver(const tl_html_settings *settings, FILE *file) {
    begin_fact(file, "Solver");
    tl_html_put_text(file, settings->solver[0] == '\0' ? "none: the twin runs free" : settings->solver);
    if (settings->fallback[0] != '\0') {
        (void)fputs(", then ", file);
        tl_html_put_text(file, settings->fallback);
    }
    end_fact(file);
}

void tl_html_put_facts(const tl_html_report *report, const char *ended, FILE *file) {
    const tl_html_settings *settings = &report->settings;
    char duration[TEXT];
    tl_show_duration((double)report->recorded * tl_seconds(settings->step), duration, sizeof duration);
    put_fact(file, settings->live ? "Source" : "Recording", settings->source);
    begin_fact(file, settings->live ? "Begun" : "Made");
    put_utc(settings->begun, file);
    end_fact(file);
    begin_fact(file, "Steps");
    tl_html_put_count(file, report->recorded);
    (void)fprintf(file, ", %s", duration);
    end_fact(file);
    begin_fact(file, "Macro step, horizon");
    (void)fprintf(file, "T<sub>S</sub> = %.10g s, T<sub>P</sub> = %" PRIu32 ", ", tl_seconds(settings->step),
                  settings->prediction);
    tl_html_put_text(file, settings->measurements);
    end_fact(file);
    put_solver(settings, file);
    put_fact(file, "Program", settings->version);
    put_fact(file, "End", ended);
}

/* ---- Key figures at a glance ------------------------------------------------------------------------------------- */

static void begin_tile(FILE *file, const char *label) {
    (void)fprintf(file, "<div class=\"tile\"><p class=\"label\">%s</p><p class=\"big\">", label);
}

static void end_tile(FILE *file) {
    (void)fputs("</p></div>\n", file);
}

/* The match that is furthest out of its tolerance, or the first that has a pair. */
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
    begin_tile(file, "Largest deviation");
    put_value(file, "tile", i, "max", tl_run_figures_maximum(figures, i), false);
    (void)fputs(" <small>", file);
    tl_html_put_text(file, tl_show_unit(settings->match[i].unit));
    (void)fputs("</small></p><p class=\"sub\">", file);
    tl_html_put_text(file, settings->match[i].name);
    if (settings->tolerance[i] > 0.0) {
        (void)fprintf(file, ", tolerance %.4g ", settings->tolerance[i]);
        tl_html_put_text(file, tl_show_unit(settings->match[i].unit));
    }
    end_tile(file);
}

/* Of an event horizon, which holds u in between, it is the searches of strokes that count. */
static void put_lock_tile(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    const uint64_t *outcomes = figures->outcomes;
    uint64_t in = outcomes[TL_FIRST_GUESS] + outcomes[TL_OPTIMISED];
    bool strokes = outcomes[TL_HELD] > 0;
    uint64_t all = strokes ? in + outcomes[TL_BEST_SO_FAR] + outcomes[TL_NOMINAL] : report->recorded;
    begin_tile(file, strokes ? "Strokes within tolerance" : "Steps within tolerance");
    if (report->settings.adjust_count == 0) {
        (void)fputs("–</p><p class=\"sub\">not synchronised", file);
    } else {
        double share = all == 0 ? 0.0 : 100.0 * (double)in / (double)all;
        (void)fprintf(file, "%.4g <small>%%</small></p><p class=\"sub\">", share);
        tl_html_put_count(file, in);
        (void)fputs(" of ", file);
        tl_html_put_count(file, all);
    }
    end_tile(file);
}

/* Per cent of the executions without saving; less than 0 where catching up cost more than was saved. */
static double saved_share(const tl_recorder_component *entry) {
    return entry->plain == 0 ? 0.0 : 100.0 * tl_run_component_saved(entry) / (double)entry->plain;
}

static void put_executions_tile(const tl_run_figures *figures, FILE *file) {
    tl_recorder_component total = tl_run_figures_total(figures);
    begin_tile(file, "Executions");
    if (figures->ledger_count == 0) {
        (void)fputs("–</p><p class=\"sub\">no ledger was kept", file);
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

/* ---- Tables ------------------------------------------------------------------------------------------------------ */

static void begin_table(FILE *file, const char *title, const char *heads) {
    (void)fprintf(file, "<div class=\"table\"><h3>%s</h3><table><thead><tr>%s</tr></thead>\n<tbody>\n", title, heads);
}

static void end_table(FILE *file) {
    (void)fputs("</tbody></table></div>\n", file);
}

static void put_matches(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    const tl_html_settings *settings = &report->settings;
    begin_table(file, "Simulated against measured",
                "<th>output y</th><th>measured ŷ</th><th class=\"n\">MSE</th><th></th><th class=\"n\">MAX</th>"
                "<th class=\"n\">tolerance</th><th></th><th class=\"n\">pairs</th><th class=\"n\">left out</th>"
                "<th class=\"n\">MSE at readings</th><th class=\"n\">readings</th><th class=\"n\">rejected</th>");
    for (size_t i = 0; i < settings->match_count; i++) {
        const tl_metrics *metrics = &figures->match[i];
        const tl_recorder_signal *signal = &settings->match[i];
        (void)fputs("<tr>", file);
        put_name_cell(file, signal->name);
        put_name_cell(file, signal->to);
        put_value_cell(file, "match", i, "mse", tl_run_figures_mse(figures, i), false);
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
    begin_table(file, "What had to be corrected",
                "<th>variable u</th><th class=\"n\">first</th><th class=\"n\">last</th><th class=\"n\">mean</th>"
                "<th class=\"n\">mean Δu</th><th></th>");
    for (size_t i = 0; i < report->settings.adjust_count; i++) {
        (void)fputs("<tr>", file);
        put_name_cell(file, report->settings.adjust[i].name);
        const tl_run_adjusted *adjusted = &figures->adjust[i];
        put_value_cell(file, "adjust", i, "first", adjusted->count > 0 ? adjusted->first : (double)NAN, false);
        put_value_cell(file, "adjust", i, "last", adjusted->count > 0 ? adjusted->last : (double)NAN, false);
        put_value_cell(file, "adjust", i, "mean", tl_run_figures_mean(figures, i), false);
        put_value_cell(file, "adjust", i, "delta_mean", tl_run_figures_delta_mean(figures, i), true);
        put_unit_cell(file, tl_show_unit(report->settings.adjust[i].unit));
        (void)fputs("</tr>\n", file);
    }
    end_table(file);
}

static void put_ledger_row(FILE *file, const char *name, size_t index, const tl_recorder_component *entry) {
    put_name_cell(file, name);
    put_count_cell(file, "ledger", index, "executions", entry->executions);
    put_count_cell(file, "ledger", index, "plain", entry->plain);
    (void)fprintf(file, "<td class=\"n\">%.1f %%</td>", saved_share(entry));
    (void)fprintf(file, "<td class=\"n\">%" PRId64 "</td>", tl_run_component_difference(entry));
}

static void put_ledger(const tl_run_figures *figures, FILE *file) {
    tl_recorder_component total = tl_run_figures_total(figures);
    if (figures->ledger_count == 0) {
        return;
    }
    begin_table(file, "Executions",
                "<th>component</th><th class=\"n\">done</th><th class=\"n\">without saving</th>"
                "<th class=\"n\">saved</th><th class=\"n\" title=\"executions done less those predicted\">"
                "off the ledger</th>");
    for (size_t i = 0; i < figures->ledger_count; i++) {
        (void)fputs("<tr>", file);
        put_ledger_row(file, figures->ledger[i].name, i, &figures->ledger[i].counts);
        (void)fputs("</tr>\n", file);
    }
    (void)fputs("<tr class=\"total\">", file);
    put_ledger_row(file, "all", figures->ledger_count, &total);
    (void)fputs("</tr>\n", file);
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
    put_row(file, "steps that searched", "optimised_steps", figures->optimised_steps);
    if (figures->rested != 0) {
        put_row(file, "at rest: the twin left alone was nearer", "rested_steps", figures->rested);
    }
    if (report->settings.clock) {
        put_row(file, "searches ended by time", "time_limited", figures->time_limited);
        put_row(file, "longer than their period", "late", figures->late);
    }
    if (report->settings.clock || figures->skipped != 0) {
        put_row(file, "ticks missed", "skipped", figures->skipped);
    }
    end_table(file);
}

void tl_html_put_figures(const tl_html_report *report, const tl_run_figures *figures, FILE *file) {
    (void)fputs("<section id=\"figures\">\n<h2>Key figures</h2>\n<div class=\"tiles\">\n", file);
    put_deviation_tile(report, figures, file);
    put_lock_tile(report, figures, file);
    put_executions_tile(figures, file);
    put_time_tile(report, figures, file);
    (void)fputs("</div>\n<div class=\"tables\">\n", file);
    put_matches(report, figures, file);
    put_adjusted(report, figures, file);
    (void)fputs("<div class=\"pair\">\n", file);
    put_ledger(figures, file);
    put_steps(report, figures, file);
    (void)fputs("</div>\n</div>\n</section>\n", file);
}

/* ---- Course ------------------------------------------------------------------------------------------------------ */

void tl_html_put_thinning(const tl_html_report *report, FILE *file) {
    if (report->curves.width > 1) {
        (void)fputs(
            "<p class=\"note\" id=\"thinning\">Thinned: the plots show the least and the largest value of every ",
            file);
        put_counted(file, "width", (uint64_t)report->curves.width);
        (void)fputs(" steps, in the order in which they came. No extreme is left out.</p>\n", file);
    }
    if (!report->settings.clock) {
        (void)fputs(
            "<p class=\"note\">A replay has no clock: there is no budget of time, and no plot of its use.</p>\n", file);
    }
}

/* ---- Events ------------------------------------------------------------------------------------------------------ */

/* On the axis of the plots: s, or ms of UTC in a live run; NaN: nowhere. */
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
    (void)fputs("<tr class=\"", file);
    tl_html_put_text(file, entry->severity);
    (void)fputc('"', file);
    if (isfinite(time)) {
        (void)fprintf(file, " data-time=\"%.15g\"", time);
    }
    (void)fputs("><td class=\"n\">", file);
    if (settings->live) {
        put_utc(entry->at, file);
    } else if (isfinite(time)) {
        (void)fprintf(file, "%.10g s", time);
    }
    (void)fputs("</td><td><span class=\"severity\">", file);
    tl_html_put_text(file, entry->severity);
    (void)fputs("</span></td><td>", file);
    tl_html_put_text(file, entry->source);
    (void)fputs("</td><td class=\"text\">", file);
    tl_html_put_text(file, entry->text);
    (void)fputs("</td></tr>\n", file);
}

void tl_html_put_events(const tl_html_report *report, FILE *file) {
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
    begin_table(file, "", "<th class=\"n\">time</th><th></th><th>from</th><th>what</th>");
    for (uint64_t i = first; i < count; i++) {
        put_event(&report->settings, &report->events[i % TL_HTML_EVENTS], file);
    }
    end_table(file);
    (void)fputs("</section>\n", file);
}
