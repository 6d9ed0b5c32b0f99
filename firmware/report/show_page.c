/* Page of `show`, for the person who maintains the plant. It begins with what has changed, and
 * lists the runs. For the selected run it then shows what was recorded, how well the twin followed,
 * the corrections and their changes, and the events. */
#include <math.h>
#include <stdarg.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/config/config.h"
#include "firmware/report/changes.h"
#include "firmware/report/show.h"
#include "firmware/report/show_summary.h"
#include "firmware/report/trend.h"
#include "firmware/store/history.h"

enum { FINDINGS_SHOWN = 10, RUNS_SHOWN = 10, EVENTS_SHOWN = 10, HASH_SHOWN = 12, TEXTS = 16, TEXT = 512 };

/* State while the page is printed. */
typedef struct show_page {
    const tl_show_request *request;
    FILE *file;
    tl_show_summary summary;
    tl_trend trend;
    const char *until; /* "…" */
    const char *arrow; /* "→" */
} show_page;

/* ---- Texts of one line. Each is valid until TEXTS more have been created; one thread. */

static char *next_text(void) {
    static char texts[TEXTS][TEXT];
    static size_t next;
    return texts[next++ % TEXTS];
}

static const char *clean_line(const show_page *page, const char *text) {
    char *made = next_text();
    tl_show_clean(page->request->style, text, made, TEXT);
    return made;
}

static const char *number_text(double value, bool sign) {
    char *made = next_text();
    tl_show_number(value, sign, made, TEXT);
    return made;
}

static const char *duration_text(double seconds) {
    char *made = next_text();
    tl_show_duration(seconds, made, TEXT);
    return made;
}

/* Returns "2026-11-21 10:02:03" for "2026-11-21T10:02:03.456Z". */
static const char *short_time(const char *utc) {
    char *made = next_text();
    (void)snprintf(made, TEXT, "%.10s %.8s", utc, strlen(utc) > 11 ? utc + 11 : "");
    return made;
}

static void print_heading(const show_page *page, const char *format, ...) TL_PRINTF(2, 3);

static void print_heading(const show_page *page, const char *format, ...) {
    bool colour = page->request->style.colour;
    va_list arguments;
    (void)fputs(colour ? "\n\x1b[1m" : "\n", page->file);
    va_start(arguments, format);
    (void)vfprintf(page->file, format, arguments);
    va_end(arguments);
    (void)fputs(colour ? "\x1b[0m\n" : "\n", page->file);
}

static void begin_table(tl_show_table *table, const show_page *page, const char *alignment, const char *const *names) {
    tl_show_table_begin(table, page->request->style, alignment);
    for (; *names != NULL; names++) {
        tl_show_table_add(table, "%s", *names);
    }
}

/* ---- Runs ------------------------------------------------------------------------------------ */

static double seconds_between(const char *from, const char *until) {
    int64_t first = 0;
    int64_t last = 0;
    return tl_utc_parse(from, &first) && tl_utc_parse(until, &last) ? (double)(last - first) / 1e3 : (double)NAN;
}

/* Returns the start of the run itself, UTC. `started` may be that of the earlier run which this one
 * resumes. */
static const char *own_start(const tl_history_run *run) {
    static char made[TL_UTC_TEXT];
    if (run->resumption.from == TL_RESUMED_NOT) {
        return run->started;
    }
    tl_utc_text(tl_show_instant(run, run->resumption.tick), made);
    return made;
}

static void add_run(tl_show_table *table, const show_page *page, const tl_history_run *run) {
    const char *started = own_start(run);
    tl_show_table_add(table, "%s", run->run == page->request->run->run ? ">" : "");
    tl_show_table_add(table, "%lld", (long long)run->run);
    tl_show_table_add(table, "%s", short_time(started));
    tl_show_table_add(table, "%s", duration_text(seconds_between(started, run->committed)));
    tl_show_table_add(table, "%s", run->verb);
    tl_show_table_add(table, "%s", run->ended == NULL ? "running, or killed" : run->ended_reason);
    if (page->request->verbose) {
        tl_show_table_add(table, "%llu", (unsigned long long)run->steps);
        tl_show_table_add(table, "%.*s", HASH_SHOWN, run->configuration_hash);
        tl_show_table_add(table, "%s", run->name);
    }
}

static tl_status print_runs(const show_page *page, tl_error *error) {
    static const char *const few[] = {"", "run", "started (UTC)", "lasted", "verb", "end", NULL};
    static const char *const all[] = {"",    "run",   "started (UTC)", "lasted", "verb",
                                      "end", "steps", "configuration", "name",   NULL};
    const tl_history_run *runs = NULL;
    size_t count = 0;
    tl_show_table table;
    tl_status status = tl_history_runs(page->request->history, &runs, &count, error);
    if (status != TL_OK) {
        return status;
    }
    size_t first = count > RUNS_SHOWN ? count - RUNS_SHOWN : 0;
    print_heading(page, "Runs");
    if (first > 0) {
        (void)fprintf(page->file, "  (%zu older ones: --json lists them)\n", first);
    }
    begin_table(&table, page, page->request->verbose ? "lrlrllrll" : "lrlrll", page->request->verbose ? all : few);
    for (size_t i = first; i < count; i++) {
        add_run(&table, page, &runs[i]);
    }
    return tl_show_table_end(&table, page->file, error);
}

/* ---- The run --------------------------------------------------------------------------------- */

static void print_when(const show_page *page) {
    const tl_history_run *run = page->request->run;
    const char *started = own_start(run);
    (void)fprintf(page->file, "  when           %s %s %s UTC, %s; %s%s\n", short_time(started), page->until,
                  short_time(run->committed), duration_text(seconds_between(started, run->committed)),
                  run->ended == NULL ? "running, or killed" : "ended: ",
                  run->ended == NULL ? "" : clean_line(page, run->ended_reason));
}

static void print_steps(const show_page *page) {
    const tl_history_run *run = page->request->run;
    const tl_run_figures *figures = &page->summary.figures;
    uint64_t steps = tl_run_figures_committed(figures);
    bool strokes = figures->outcomes[TL_HELD] > 0;
    double step = tl_seconds(run->step);
    (void)fprintf(page->file, "  steps          %llu of %s: %s of the plant\n", (unsigned long long)steps,
                  duration_text(step), duration_text(step * (double)steps));
    if (page->request->verbose) {
        (void)fprintf(page->file, "                 horizon %s%u %s, pairing %s\n", strokes ? "at most " : "",
                      (unsigned)run->prediction, run->prediction == 1 ? "step" : "steps",
                      tl_pairing_names[run->measurements]);
        if (tl_run_figures_print_outcomes(figures, "                 ", page->file)) {
            (void)fputc('\n', page->file);
        }
    }
    if (figures->time_limited > 0) {
        (void)fprintf(page->file, "                 the search was stopped by the time budget in %llu of them\n",
                      (unsigned long long)figures->time_limited);
    }
    if (figures->refused > 0) {
        (void)fprintf(page->file, "                 trials were refused in %llu of them: see the events\n",
                      (unsigned long long)figures->refused);
    }
    if (figures->rested > 0) {
        (void)fprintf(page->file, "                 u rested at nominal in %llu of them\n",
                      (unsigned long long)figures->rested);
    }
}

/* The ledger is always that of the whole run. */
static void print_ledger(const show_page *page) {
    tl_execution_counts total = tl_run_figures_total(&page->summary.figures);
    if (total.plain == 0) {
        return;
    }
    (void)fprintf(page->file, "  executions     %llu, predicted %llu; without saving %llu (%.1f %% saved)\n",
                  (unsigned long long)total.executions, (unsigned long long)total.predicted,
                  (unsigned long long)total.plain, 100.0 * (1.0 - (double)total.executions / (double)total.plain));
    if (total.repeated + total.uncached > 0) {
        (void)fprintf(page->file, "                 %llu repeated, %llu not cached\n",
                      (unsigned long long)total.repeated, (unsigned long long)total.uncached);
    }
}

static void print_recorded(const show_page *page) {
    const tl_history_run *run = page->request->run;
    (void)fprintf(page->file, "  recorded       %llu samples, %llu steps, %llu events",
                  (unsigned long long)run->samples, (unsigned long long)run->steps, (unsigned long long)run->events);
    if (run->lost > 0) {
        (void)fprintf(page->file, "; %llu were lost", (unsigned long long)run->lost);
    }
    if (run->removed_before > 0) {
        (void)fprintf(page->file, "; steps before %lld were removed to make room", (long long)run->removed_before);
    }
    (void)fputc('\n', page->file);
    if (run->resumption.from != TL_RESUMED_NOT) {
        (void)fprintf(page->file, "  resumed        run %lld, from tick %lld on\n", (long long)run->resumption.run,
                      (long long)run->resumption.tick);
    }
    if (page->request->from_step > 0) {
        (void)fprintf(page->file, "  shown          since step %lld%s\n", (long long)page->request->from_step,
                      page->request->is_newest ? " (more: --since)" : "");
    }
}

static void print_standing(const show_page *page) {
    char text[TL_LOCK_CLAUSE];
    tl_lock_standing_write(&page->summary.lock.standing, false, text);
    if (text[0] != '\0') {
        (void)fprintf(page->file, "                 %s\n", clean_line(page, text));
    }
    tl_lock_standing_write_remedy(&page->summary.lock.standing, text);
    if (text[0] != '\0') {
        (void)fprintf(page->file, "                 %s\n", clean_line(page, text));
    }
}

static void print_run(const show_page *page) {
    const tl_history_run *run = page->request->run;
    print_heading(page, "Run %lld: %s", (long long)run->run, clean_line(page, run->name));
    print_when(page);
    (void)fprintf(page->file, "  configuration  %.*s, run by twinlock %s\n", HASH_SHOWN,
                  clean_line(page, run->configuration_hash), clean_line(page, run->version));
    print_steps(page);
    if (tl_lock_tally_total(&page->summary.lock) > 0) {
        char text[TL_LOCK_SENTENCE];
        tl_lock_tally_write(&page->summary.lock, page->summary.figures.outcomes[TL_HELD] > 0 ? "strokes" : "steps",
                            text);
        (void)fprintf(page->file, "  in lock        %s\n", text);
        print_standing(page);
    }
    if (page->request->verbose) {
        print_ledger(page);
    }
    print_recorded(page);
}

/* ---- Errors ---------------------------------------------------------------------------------- */

/* Adds the details of --verbose. */
static void add_details(tl_show_table *table, const tl_run_figures *figures, size_t match) {
    const tl_metrics *readings = &figures->readings[match];
    tl_show_table_add(table, "%llu", (unsigned long long)figures->match[match].pairs);
    tl_show_table_add(table, "%s", number_text(tl_run_figures_mse(figures, match), false));
    tl_show_table_add(table, "%s", number_text(tl_run_figures_mse_readings(figures, match), false));
    tl_show_table_add(table, "%llu", (unsigned long long)readings->pairs);
    tl_show_table_add(table, "%llu", (unsigned long long)readings->left_out);
}

static const char *unit_of(const tl_recorder_signal *signal) {
    return signal->type == TL_BOOLEAN ? "0 off, 1 on" : signal->unit[0] == '\0' ? "-" : signal->unit;
}

static tl_status print_match(const show_page *page, tl_error *error) {
    static const char *const names[] = {"simulated",   "measured", "rms",      "largest",
                                        "uncorrected", "unit",     "left out", NULL};
    static const char *const details[] = {"pairs", "MSE", "MSE at the sensor's instants", "readings", "rejected"};
    tl_show_table table;
    if (page->summary.match_count == 0) {
        return TL_OK;
    }
    print_heading(page, "Error: simulated minus measured");
    begin_table(&table, page, page->request->verbose ? "llrrrlrrrrrr" : "llrrrlr", names);
    for (size_t i = 0; page->request->verbose && i < sizeof details / sizeof details[0]; i++) {
        tl_show_table_add(&table, "%s", details[i]);
    }
    for (size_t i = 0; i < page->summary.match_count; i++) {
        const tl_recorder_signal *signal = &page->summary.match[i];
        const tl_run_figures *figures = &page->summary.figures;
        tl_show_table_add(&table, "%s", signal->name);
        tl_show_table_add(&table, "%s", signal->to == NULL ? "" : signal->to);
        tl_show_table_add(&table, "%s", number_text(sqrt(tl_run_figures_mse(figures, i)), false));
        tl_show_table_add(&table, "%s", number_text(tl_run_figures_maximum(figures, i), false));
        tl_show_table_add(&table, "%s", number_text(sqrt(tl_run_figures_mse_released(figures, i)), false));
        tl_show_table_add(&table, "%s", unit_of(signal));
        tl_show_table_add(&table, "%llu", (unsigned long long)figures->match[i].left_out);
        if (page->request->verbose) {
            add_details(&table, figures, i);
        }
    }
    return tl_show_table_end(&table, page->file, error);
}

/* ---- Corrections ----------------------------------------------------------------------------- */

static void add_numbers(tl_show_table *table, const tl_show_summary *summary, size_t adjust) {
    enum { NUMBERS = 6 };
    const tl_run_adjusted *adjusted = &summary->figures.adjust[adjust];
    const tl_show_adjust *detail = &summary->detail[adjust];
    double correction = tl_run_figures_correction_mean(&summary->figures, adjust);
    double scale = fmax(fabs(detail->least), fabs(detail->largest));
    const double values[NUMBERS] = {fabs(correction) < 1e-12 * scale ? 0.0 : correction, /* only rounding */
                                    adjusted->first,
                                    adjusted->last,
                                    tl_run_figures_mean(&summary->figures, adjust),
                                    detail->least,
                                    detail->largest};
    for (size_t i = 0; i < NUMBERS; i++) {
        tl_show_table_add(table, "%s", number_text(adjusted->count == 0 ? (double)NAN : values[i], i == 0));
    }
}

static tl_status print_adjust(const show_page *page, tl_error *error) {
    static const char *const names[] = {"variable", "correction", "first", "last", "mean",
                                        "least",    "largest",    "unit",  NULL};
    tl_show_table table;
    print_heading(page, "Mean correction, and applied values");
    begin_table(&table, page, "lrrrrrrl", names);
    for (size_t i = 0; i < page->summary.adjust_count; i++) {
        tl_show_table_add(&table, "%s", page->summary.adjust[i].name);
        add_numbers(&table, &page->summary, i);
        tl_show_table_add(&table, "%s", unit_of(&page->summary.adjust[i]));
    }
    return tl_show_table_end(&table, page->file, error);
}

static void print_curve(const show_page *page, size_t adjust) {
    double means[TL_SHOW_POINTS];
    double least = (double)INFINITY;
    double largest = (double)-INFINITY;
    const char *name = clean_line(page, page->summary.adjust[adjust].name);
    char curve[TL_SHOW_CURVE];
    for (size_t i = 0; i < page->summary.points; i++) {
        means[i] = tl_show_part_mean(&page->summary.detail[adjust].points[i]);
        least = means[i] < least ? means[i] : least;
        largest = means[i] > largest ? means[i] : largest;
    }
    tl_show_curve(page->request->style, means, page->summary.points, curve, sizeof curve);
    if (largest > least) {
        (void)fprintf(page->file, "  %s: correction from %s to %s\n    |%s|\n", name, number_text(least, true),
                      number_text(largest, true), curve);
    } else {
        (void)fprintf(page->file, "  %s: correction %s throughout\n", name, number_text(least, true));
    }
}

/* Prints the course of a correction over all live runs. */
static void print_trend(const show_page *page, size_t adjust) {
    enum { COLUMNS = 64 };
    const tl_trend *trend = &page->trend;
    const size_t columns = trend->parts < COLUMNS ? trend->parts : COLUMNS;
    double means[COLUMNS];
    char curve[TL_SHOW_CURVE];
    double least = (double)INFINITY;
    double largest = (double)-INFINITY;
    for (size_t i = 0; i < columns; i++) {
        double sum = 0.0;
        double count = 0.0;
        for (size_t k = i * trend->parts / columns; k < (i + 1) * trend->parts / columns; k++) {
            sum += trend->part[adjust][k].mean * (double)trend->part[adjust][k].count;
            count += (double)trend->part[adjust][k].count;
        }
        means[i] = count > 0.0 ? sum / count : (double)NAN;
        least = means[i] < least ? means[i] : least;
        largest = means[i] > largest ? means[i] : largest;
    }
    if (largest > least) {
        tl_show_curve(page->request->style, means, columns, curve, sizeof curve);
        (void)fprintf(page->file, "  %s: correction from %s to %s\n    |%s|\n",
                      clean_line(page, page->summary.adjust[adjust].name), number_text(least, true),
                      number_text(largest, true), curve);
    }
}

/* Prints the trends if they reach back behind the steps that are shown. */
static tl_status print_trends(show_page *page, tl_error *error) {
    const tl_history_run *run = page->request->run;
    tl_trend *trend = &page->trend;
    char utc[TL_UTC_TEXT];
    tl_status status = tl_trend_read(page->request->history, run, trend, error);
    const int64_t shown = tl_show_is_live(run)
                              ? tl_show_instant(run, page->summary.range[0])
                              : (int64_t)(tl_seconds(run->step) * 1e3 * (double)page->summary.range[0]);
    if (status != TL_OK || trend->parts < 2 || trend->from_ms + trend->width_ms > shown) {
        return status;
    }
    tl_utc_text(trend->from_ms, utc);
    print_heading(page, "Mean corrections since %s, in all runs", tl_show_is_live(run) ? short_time(utc) : "the start");
    for (size_t i = 0; i < page->summary.adjust_count; i++) {
        print_trend(page, i);
    }
    return TL_OK;
}

/* ---- Changes of the corrections -------------------------------------------------------------- */

/* Returns the start of a step: UTC in a live run, else the time since the start of the run. */
static const char *instant_text(const show_page *page, int64_t step) {
    const tl_history_run *run = page->request->run;
    if (tl_show_is_live(run)) {
        char utc[TL_UTC_TEXT];
        tl_utc_text(tl_show_instant(run, step), utc);
        return short_time(utc);
    }
    double window = tl_seconds(run->step) * (double)(page->summary.range[1] - page->summary.range[0] + 1) /
                    (double)page->summary.windows;
    double digits = fmin(fmax(ceil(2.0 - log10(window)), 0.0), 6.0);
    char *made = next_text();
    (void)snprintf(made, TEXT, "%.*f s", (int)digits, tl_seconds(run->step) * (double)step);
    return made;
}

static tl_status print_windows(const show_page *page, tl_error *error) {
    const tl_show_summary *summary = &page->summary;
    tl_show_table table;
    print_heading(page, "Mean correction over time");
    tl_show_table_begin(&table, page->request->style, "rrrrrrrrr");
    table.columns = 1 + summary->adjust_count;
    tl_show_table_add(&table, "from");
    for (size_t i = 0; i < summary->adjust_count; i++) {
        tl_show_table_add(&table, "%s", summary->adjust[i].name);
    }
    for (size_t window = 0; window < summary->windows; window++) {
        tl_show_table_add(&table, "%s", instant_text(page, tl_show_window_start(summary, window)));
        for (size_t i = 0; i < summary->adjust_count; i++) {
            tl_show_table_add(&table, "%s", number_text(tl_show_part_mean(&summary->detail[i].windows[window]), true));
        }
    }
    return tl_show_table_end(&table, page->file, error);
}

static void print_change(const show_page *page, size_t adjust) {
    const tl_recorder_signal *signal = &page->summary.adjust[adjust];
    const tl_show_part *windows = page->summary.detail[adjust].windows;
    size_t window = tl_show_largest_change(&page->summary, adjust);
    const char *name = clean_line(page, signal->name);
    if (window == 0) {
        (void)fprintf(page->file, "  %s: no change larger than the scatter\n", name);
        return;
    }
    (void)fprintf(page->file, "  %s: largest change at %s, %s %s %s%s%s\n", name,
                  instant_text(page, tl_show_window_start(&page->summary, window)),
                  number_text(tl_show_part_mean(&windows[window - 1]), true), page->arrow,
                  number_text(tl_show_part_mean(&windows[window]), true), signal->unit[0] == '\0' ? "" : " ",
                  clean_line(page, signal->unit));
}

static tl_status print_corrections(const show_page *page, tl_error *error) {
    const tl_show_summary *summary = &page->summary;
    if (summary->adjust_count == 0 || !summary->any) {
        return TL_OK;
    }
    tl_status status = print_adjust(page, error);
    for (size_t i = 0; status == TL_OK && i < summary->adjust_count; i++) {
        print_curve(page, i);
    }
    if (status == TL_OK) {
        status = print_windows(page, error);
    }
    for (size_t i = 0; status == TL_OK && i < summary->adjust_count; i++) {
        print_change(page, i);
    }
    return status;
}

/* ---- Tunings --------------------------------------------------------------------------------- */

static void print_tuning(const show_page *page, const tl_history_tuning *tuning) {
    (void)fprintf(page->file, "  %s  tick %-10lld  configuration %.12s  %s%s%s%s%s\n", short_time(tuning->at),
                  (long long)tuning->tick, tuning->hash, clean_line(page, tuning->who),
                  tuning->origin[0] != '\0' ? ", " : "", clean_line(page, tuning->origin),
                  tuning->why[0] != '\0' ? ": " : "", clean_line(page, tuning->why));
}

/* Most runs have no tunings. */
static tl_status print_tunings(show_page *page, tl_error *error) {
    const tl_history_tuning *tunings = NULL;
    size_t count = 0;
    tl_status status = tl_history_tunings(page->request->history, page->request->run, &tunings, &count, error);
    if (status == TL_OK && count != 0) {
        print_heading(page, "Tunings during the run (UTC)");
        for (size_t i = 0; i < count; i++) {
            print_tuning(page, &tunings[i]);
        }
    }
    return status;
}

/* ---- Events ---------------------------------------------------------------------------------- */

typedef struct show_events {
    const show_page *page;
    tl_show_output output;
} show_events;

static void write_events(void *context) {
    show_events *events = context;
    tl_show_output_write(&events->output);
}

static void take_event(void *context, const tl_history_event *event) {
    const show_events *events = context;
    const show_page *page = events->page;
    FILE *file = events->output.file;
    bool colour = page->request->style.colour;
    const char *paint = strcmp(event->severity, "error") == 0     ? "\x1b[31m"
                        : strcmp(event->severity, "warning") == 0 ? "\x1b[33m"
                                                                  : "";
    (void)fprintf(file, "  %s  %s%-7s%s  %-8s  %s", short_time(event->at), colour ? paint : "",
                  clean_line(page, event->severity), colour && paint[0] != '\0' ? "\x1b[0m" : "",
                  clean_line(page, event->source), clean_line(page, event->text));
    if (event->has_tick) {
        (void)fprintf(file, " (tick %lld)", (long long)event->tick);
    }
    (void)fputc('\n', file);
}

static tl_status print_events(show_page *page, tl_error *error) {
    const tl_show_request *request = page->request;
    if (request->run->events == 0) {
        return TL_OK;
    }
    print_heading(page, request->all_events ? "Events (UTC)" : "Last events (UTC)");
    show_events events = {.page = page};
    const tl_history_visitor visitor = {.context = &events, .event = take_event, .pause = write_events};
    tl_status status = tl_show_output_open(&events.output, page->file, error);
    if (status == TL_OK) {
        status = tl_history_events(request->history, request->run, request->from_at,
                                   request->all_events ? -1 : EVENTS_SHOWN, &visitor, error);
        status = tl_show_output_close(&events.output, status, error);
    }
    return status;
}

/* ---- Changes --------------------------------------------------------------------------------- */

static void print_finding(const show_page *page, const tl_history_finding *finding) {
    char text[TL_FINDING_TEXT];
    char cause[TL_FINDING_TEXT];
    tl_changes_write_finding(&finding->row, tl_show_now(page->request->run, finding), finding->started, text, cause);
    (void)fprintf(page->file, "  %-4lld %s\n", (long long)finding->row.number, clean_line(page, text));
    if (cause[0] != '\0') {
        (void)fprintf(page->file, "       cause: %s\n", clean_line(page, cause));
    }
    if (finding->explanation != NULL) {
        char line[TEXT + 16];
        (void)snprintf(line, sizeof line, "explanation: %s", clean_line(page, finding->explanation));
        tl_wrapped_print(page->file, line, 7, 7);
    }
    if (strcmp(finding->row.state, "normal") == 0) {
        (void)fputs("       accepted: learnt as normal since then\n", page->file);
    }
    if (finding->acknowledged_at != NULL) {
        (void)fprintf(page->file, "       acknowledged by %s, %s UTC%s%s\n",
                      clean_line(page, finding->acknowledged_by != NULL ? finding->acknowledged_by : "?"),
                      short_time(finding->acknowledged_at), finding->note != NULL ? ": " : "",
                      clean_line(page, finding->note != NULL ? finding->note : ""));
    }
}

/* The verdict in one sentence, then the findings, the newest last. */
static tl_status print_findings(const show_page *page, tl_error *error) {
    tl_show_changes changes;
    char text[TL_FINDING_TEXT];
    tl_status status = tl_show_read_changes(page->request, &changes, error);
    if (status != TL_OK || (!changes.is_watched && changes.count == 0)) {
        return status;
    }
    print_heading(page, "Changes");
    tl_changes_write_verdict(&changes.detection, changes.open, changes.gone, text);
    (void)fprintf(page->file, "  %s\n", text);
    size_t first = changes.count > FINDINGS_SHOWN ? changes.count - FINDINGS_SHOWN : 0;
    if (first > 0) {
        (void)fprintf(page->file, "  (%zu older ones: --json lists them)\n", first);
    }
    for (size_t i = first; i < changes.count; i++) {
        print_finding(page, &changes.finding[i]);
    }
    return TL_OK;
}

/* ---- The page -------------------------------------------------------------------------------- */

static void print_title(const show_page *page) {
    char log_path[TEXT];
    char *size = next_text();
    struct stat file;
    struct stat log;
    (void)snprintf(log_path, sizeof log_path, "%s-wal", page->request->path);
    double bytes = stat(page->request->path, &file) == 0 ? (double)file.st_size : 0.0;
    bytes += stat(log_path, &log) == 0 ? (double)log.st_size : 0.0;
    tl_show_bytes(bytes, size, TEXT);
    (void)fprintf(page->file, "%s, %s\n", clean_line(page, page->request->path), size);
}

tl_status tl_show_text(const tl_show_request *request, FILE *file, tl_error *error) {
    bool unicode = request->style.unicode;
    static show_page page; /* static because it is too large for a small stack; `show` has one thread */
    page = (show_page){.request = request, .file = file, .until = unicode ? "…" : "to", .arrow = unicode ? "→" : "->"};
    tl_status status = tl_show_summarise(request->history, request->run, request->from_step, &page.summary, error);
    if (status != TL_OK) {
        return status;
    }
    print_title(&page);
    status = print_findings(&page, error);
    status = status == TL_OK ? print_runs(&page, error) : status;
    if (status == TL_OK) {
        print_run(&page);
        status = print_match(&page, error);
    }
    status = status == TL_OK ? print_corrections(&page, error) : status;
    status = status == TL_OK ? print_trends(&page, error) : status;
    status = status == TL_OK ? print_tunings(&page, error) : status;
    return status == TL_OK ? print_events(&page, error) : status;
}
