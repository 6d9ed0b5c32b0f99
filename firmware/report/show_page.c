/* The page of `show`: for somebody who looks after the plant. First the runs, then what was recorded of the chosen one,
 * how well the twin followed, what had to be corrected and since when, and what happened. */
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/config/config.h"
#include "firmware/report/show.h"
#include "firmware/report/show_summary.h"
#include "firmware/store/history.h"

enum { RUNS_SHOWN = 10, EVENTS_SHOWN = 10, TEXT = 64, HASH_SHOWN = 12 };

/* The page while it is printed. */
typedef struct show_page {
    const tl_show_request *request;
    FILE *file;
    tl_show_summary summary;
    const char *delta;  /* "Δ" */
    const char *until;  /* "…" */
    const char *arrow;  /* "→" */
    const char *square; /* "MSE (unit²)" */
} show_page;

bool tl_show_is_live(const tl_history_run *run) {
    return strcmp(run->verb, "replay") != 0;
}

int64_t tl_show_instant(const tl_history_run *run, int64_t step) {
    int64_t started = 0;
    (void)tl_utc_parse(run->started, &started);
    double after = (double)step * ((double)run->step / 1e6);
    return after > 1e14 ? started : started + (int64_t)floor(after + 0.5);
}

static void heading(const show_page *page, const char *text) {
    bool colour = page->request->style.colour;
    (void)fprintf(page->file, "\n%s%s%s\n", colour ? "\x1b[1m" : "", text, colour ? "\x1b[0m" : "");
}

static const char *clean(const show_page *page, const char *text, char *buffer, size_t size) {
    tl_show_clean(page->request->style, text, buffer, size);
    return buffer;
}

static void begin_table(tl_show_table *table, const show_page *page, const char *alignment, const char *const *names) {
    tl_show_table_begin(table, page->request->style, alignment);
    for (; *names != NULL; names++) {
        tl_show_table_add(table, "%s", *names);
    }
}

/* ---- Runs -------------------------------------------------------------------------------------------------------- */

/* "2026-11-21 10:02:03" of "2026-11-21T10:02:03.456Z". */
static void short_time(const char *utc, char *text, size_t size) {
    (void)snprintf(text, size, "%.10s %.8s", utc, strlen(utc) > 11 ? utc + 11 : "");
}

static double seconds_between(const char *from, const char *until) {
    int64_t first = 0;
    int64_t last = 0;
    return tl_utc_parse(from, &first) && tl_utc_parse(until, &last) ? (double)(last - first) / 1e3 : (double)NAN;
}

/* When it began, and how long it was. */
static void find_times(const tl_history_run *run, char started[TEXT], char lasted[TEXT]) {
    char own[TL_UTC_TEXT];
    if (run->resumption.from == TL_RESUMED_NOT) {
        (void)snprintf(own, TL_UTC_TEXT, "%s", run->started);
    } else { /* t_start may be that of a run that it goes on with */
        tl_utc_text(tl_show_instant(run, run->resumption.tick), own);
    }
    short_time(own, started, TEXT);
    tl_show_duration(seconds_between(own, run->committed), lasted, TEXT);
}

static void add_run(tl_show_table *table, const show_page *page, const tl_history_run *run) {
    char started[TEXT];
    char lasted[TEXT];
    find_times(run, started, lasted);
    tl_show_table_add(table, "%s", run->run == page->request->run->run ? ">" : "");
    tl_show_table_add(table, "%lld", (long long)run->run);
    tl_show_table_add(table, "%s", started);
    tl_show_table_add(table, "%s", lasted);
    tl_show_table_add(table, "%s", run->verb);
    tl_show_table_add(table, "%s", run->name);
    tl_show_table_add(table, "%.*s", HASH_SHOWN, run->configuration_hash);
    tl_show_table_add(table, "%llu", (unsigned long long)run->steps);
    tl_show_table_add(table, "%s", run->ended == NULL ? "is being written" : run->ended_reason);
}

static tl_status print_runs(const show_page *page, tl_error *error) {
    static const char *const names[] = {"",     "run",           "started (UTC)", "lasted", "verb",
                                        "name", "configuration", "steps",         "end",    NULL};
    const tl_history_run *runs = NULL;
    size_t count = 0;
    tl_show_table table;
    tl_status status = tl_history_runs(page->request->history, &runs, &count, error);
    if (status != TL_OK) {
        return status;
    }
    size_t first = count > RUNS_SHOWN ? count - RUNS_SHOWN : 0;
    heading(page, "Runs");
    if (first > 0) {
        (void)fprintf(page->file, "  (%zu older ones: --json lists them)\n", first);
    }
    begin_table(&table, page, "lrlrlllrl", names);
    for (size_t i = first; i < count; i++) {
        add_run(&table, page, &runs[i]);
    }
    return tl_show_table_end(&table, page->file, error);
}

/* ---- The run ----------------------------------------------------------------------------------------------------- */

static void print_when(const show_page *page) {
    const tl_history_run *run = page->request->run;
    char started[TEXT];
    char until[TEXT];
    char lasted[TEXT];
    char reason[TEXT * 2];
    find_times(run, started, lasted);
    short_time(run->committed, until, sizeof until);
    (void)fprintf(page->file, "  when           %s %s %s UTC, %s; %s%s\n", started, page->until, until, lasted,
                  run->ended == NULL ? "is being written, or was killed" : "ended: ",
                  run->ended == NULL ? "" : clean(page, run->ended_reason, reason, sizeof reason));
}

static void print_steps(const show_page *page) {
    const tl_history_run *run = page->request->run;
    const tl_run_figures *figures = &page->summary.figures;
    uint64_t steps = tl_run_figures_committed(figures);
    bool strokes = figures->outcomes[TL_HELD] > 0;
    char step[TEXT];
    char model[TEXT];
    tl_show_duration(tl_seconds(run->step), step, sizeof step);
    tl_show_duration(tl_seconds(run->step) * (double)steps, model, sizeof model);
    (void)fprintf(page->file, "  steps          %llu of %s, which is %s of the plant; looks %s%u %s%s (%s)\n",
                  (unsigned long long)steps, step, model, strokes ? "at strokes of at most " : "",
                  (unsigned)run->prediction, run->prediction == 1 ? "step" : "steps", strokes ? "" : " ahead",
                  tl_measurements_names[run->measurements]);
    if (tl_run_figures_print_outcomes(figures, "                 ", page->file)) {
        (void)fputc('\n', page->file);
    }
    if (figures->time_limited > 0) {
        (void)fprintf(page->file, "                 the search ran out of time in %llu of them\n",
                      (unsigned long long)figures->time_limited);
    }
    if (figures->rested > 0) {
        (void)fprintf(page->file,
                      "                 u rested at nominal in %llu of them: the twin left alone was nearer\n",
                      (unsigned long long)figures->rested);
    }
}

/* Of the whole run, whatever part of it is shown. */
static void print_ledger(const show_page *page) {
    tl_recorder_component total = tl_run_figures_total(&page->summary.figures);
    if (total.plain == 0) {
        return;
    }
    (void)fprintf(page->file, "  executions     %llu, predicted %llu; without saving %llu (%.1f %% saved)\n",
                  (unsigned long long)total.executions, (unsigned long long)total.predicted,
                  (unsigned long long)total.plain, 100.0 * (1.0 - (double)total.executions / (double)total.plain));
    if (total.caught_up + total.unstored > 0) {
        (void)fprintf(page->file, "                 %llu caught up, %llu results found no room\n",
                      (unsigned long long)total.caught_up, (unsigned long long)total.unstored);
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
        (void)fprintf(page->file, "  goes on with   run %lld, from tick %lld on\n", (long long)run->resumption.run,
                      (long long)run->resumption.tick);
    }
    if (page->request->from_step > 0) {
        (void)fprintf(page->file, "  shown          since step %lld\n", (long long)page->request->from_step);
    }
}

static void print_run(const show_page *page) {
    const tl_history_run *run = page->request->run;
    char name[TEXT * 4];
    char title[TEXT * 5];
    char version[TEXT];
    (void)snprintf(title, sizeof title, "Run %lld: %s", (long long)run->run, clean(page, run->name, name, sizeof name));
    heading(page, title);
    print_when(page);
    (void)fprintf(page->file, "  configuration  %.*s, run by twinlock %s\n", HASH_SHOWN,
                  clean(page, run->configuration_hash, name, sizeof name),
                  clean(page, run->version, version, sizeof version));
    print_steps(page);
    if (tl_lock_tally_total(&page->summary.lock) > 0) {
        char text[TL_LOCK_SENTENCE];
        tl_lock_tally_write(&page->summary.lock, text);
        (void)fprintf(page->file, "  lock           %s\n", text);
    }
    print_ledger(page);
    print_recorded(page);
}

/* ---- How well it followed ---------------------------------------------------------------------------------------- */

/* MSE at the plant's own readings, and how many these were. */
static void add_readings(tl_show_table *table, const tl_run_figures *figures, size_t match) {
    const tl_metrics *readings = &figures->readings[match];
    char mse[TEXT];
    tl_show_number(tl_run_figures_mse_readings(figures, match), false, mse, sizeof mse);
    tl_show_table_add(table, "%s", mse);
    tl_show_table_add(table, "%llu", (unsigned long long)readings->pairs);
    tl_show_table_add(table, "%llu", (unsigned long long)readings->left_out);
}

static tl_status print_match(const show_page *page, tl_error *error) {
    const char *const names[] = {"output",          "compared with", "pairs",    "left out", page->square, "MAX",
                                 "MSE at readings", "readings",      "rejected", "unit",     NULL};
    tl_show_table table;
    if (page->summary.match_count == 0) {
        return TL_OK;
    }
    heading(page, "How well the twin followed the plant");
    begin_table(&table, page, "llrrrrrrrl", names);
    for (size_t i = 0; i < page->summary.match_count; i++) {
        const tl_recorder_signal *signal = &page->summary.match[i];
        const tl_run_figures *figures = &page->summary.figures;
        char mse[TEXT];
        char largest[TEXT];
        tl_show_number(tl_run_figures_mse(figures, i), false, mse, sizeof mse);
        tl_show_number(tl_run_figures_maximum(figures, i), false, largest, sizeof largest);
        tl_show_table_add(&table, "%s", signal->name);
        tl_show_table_add(&table, "%s", signal->to == NULL ? "" : signal->to);
        tl_show_table_add(&table, "%llu", (unsigned long long)figures->match[i].pairs);
        tl_show_table_add(&table, "%llu", (unsigned long long)figures->match[i].left_out);
        tl_show_table_add(&table, "%s", mse);
        tl_show_table_add(&table, "%s", largest);
        add_readings(&table, figures, i);
        tl_show_table_add(&table, "%s", signal->unit);
    }
    return tl_show_table_end(&table, page->file, error);
}

/* ---- What had to be corrected ------------------------------------------------------------------------------------ */

static void add_numbers(tl_show_table *table, const tl_show_summary *summary, size_t adjust) {
    enum { NUMBERS = 6 };
    const tl_run_adjusted *adjusted = &summary->figures.adjust[adjust];
    const tl_show_adjust *detail = &summary->detail[adjust];
    double delta = tl_run_figures_delta_mean(&summary->figures, adjust);
    double scale = fmax(fabs(detail->least), fabs(detail->largest));
    const double values[NUMBERS] = {
        adjusted->first, adjusted->last,  tl_run_figures_mean(&summary->figures, adjust),
        detail->least,   detail->largest, fabs(delta) < 1e-12 * scale ? 0.0 : delta}; /* not its rounding */
    for (size_t i = 0; i < NUMBERS; i++) {
        char text[TEXT];
        tl_show_number(adjusted->count == 0 ? (double)NAN : values[i], i + 1 == NUMBERS, text, sizeof text);
        tl_show_table_add(table, "%s", text);
    }
}

/* A Boolean has none; its numbers are told instead. */
static const char *unit_of(const tl_recorder_signal *signal) {
    return signal->type == TL_BOOLEAN ? "0 off, 1 on" : signal->unit;
}

static tl_status print_adjust(const show_page *page, tl_error *error) {
    static const char *const names[] = {"variable", "first", "last", "mean", "least", "largest", NULL};
    tl_show_table table;
    heading(page, "What had to be corrected");
    begin_table(&table, page, "lrrrrrrl", names);
    tl_show_table_add(&table, "mean %su", page->delta);
    tl_show_table_add(&table, "unit");
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
    char name[TEXT * 2];
    char curve[TL_SHOW_CURVE];
    char low[TEXT];
    char high[TEXT];
    for (size_t i = 0; i < page->summary.points; i++) {
        means[i] = tl_show_part_mean(&page->summary.detail[adjust].points[i]);
        least = means[i] < least ? means[i] : least;
        largest = means[i] > largest ? means[i] : largest;
    }
    tl_show_curve(page->request->style, means, page->summary.points, curve, sizeof curve);
    tl_show_number(least, true, low, sizeof low);
    tl_show_number(largest, true, high, sizeof high);
    (void)clean(page, page->summary.adjust[adjust].name, name, sizeof name);
    if (largest > least) {
        (void)fprintf(page->file, "  %s: %su from %s to %s\n    |%s|\n", name, page->delta, low, high, curve);
    } else {
        (void)fprintf(page->file, "  %s: %su %s throughout\n", name, page->delta, low);
    }
}

/* ---- What has changed since when --------------------------------------------------------------------------------- */

/* When a step began: in the world where the run was live, else in the run. */
static void say_instant(const show_page *page, int64_t step, char *text, size_t size) {
    const tl_history_run *run = page->request->run;
    if (tl_show_is_live(run)) {
        char utc[TL_UTC_TEXT];
        tl_utc_text(tl_show_instant(run, step), utc);
        short_time(utc, text, size);
    } else {
        double window = tl_seconds(run->step) * (double)(page->summary.range[1] - page->summary.range[0] + 1) /
                        (double)page->summary.windows;
        double digits = fmin(fmax(ceil(2.0 - log10(window)), 0.0), 6.0);
        (void)snprintf(text, size, "%.*f s", (int)digits, tl_seconds(run->step) * (double)step);
    }
}

static tl_status print_windows(const show_page *page, tl_error *error) {
    const tl_show_summary *summary = &page->summary;
    tl_show_table table;
    char title[TEXT];
    (void)snprintf(title, sizeof title, "What has changed since when: mean %su", page->delta);
    heading(page, title);
    tl_show_table_begin(&table, page->request->style, "rrrrrrrrr");
    table.columns = 1 + summary->adjust_count;
    tl_show_table_add(&table, "from");
    for (size_t i = 0; i < summary->adjust_count; i++) {
        tl_show_table_add(&table, "%s", summary->adjust[i].name);
    }
    for (size_t window = 0; window < summary->windows; window++) {
        char text[TEXT];
        say_instant(page, tl_show_window_start(summary, window), text, sizeof text);
        tl_show_table_add(&table, "%s", text);
        for (size_t i = 0; i < summary->adjust_count; i++) {
            tl_show_number(tl_show_part_mean(&summary->detail[i].windows[window]), true, text, sizeof text);
            tl_show_table_add(&table, "%s", text);
        }
    }
    return tl_show_table_end(&table, page->file, error);
}

static void print_change(const show_page *page, size_t adjust) {
    const tl_recorder_signal *signal = &page->summary.adjust[adjust];
    const tl_show_part *windows = page->summary.detail[adjust].windows;
    size_t window = tl_show_largest_change(&page->summary, adjust);
    char name[TEXT * 2];
    char unit[TEXT];
    char when[TEXT];
    char before[TEXT];
    char after[TEXT];
    (void)clean(page, signal->name, name, sizeof name);
    if (window == 0) {
        (void)fprintf(page->file, "  %s: no change stands out\n", name);
        return;
    }
    say_instant(page, tl_show_window_start(&page->summary, window), when, sizeof when);
    tl_show_number(tl_show_part_mean(&windows[window - 1]), true, before, sizeof before);
    tl_show_number(tl_show_part_mean(&windows[window]), true, after, sizeof after);
    (void)fprintf(page->file, "  %s: changed most at %s, %s %s %s%s%s\n", name, when, before, page->arrow, after,
                  signal->unit[0] == '\0' ? "" : " ", clean(page, signal->unit, unit, sizeof unit));
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

/* ---- Tunings ----------------------------------------------------------------------------------------------------- */

static void print_tuning(const show_page *page, const tl_history_tuning *tuning) {
    char when[TEXT];
    char who[TEXT];
    char origin[TEXT];
    char why[TEXT * 8];
    short_time(tuning->at, when, sizeof when);
    (void)fprintf(page->file, "  %s  tick %-10lld  configuration %.12s  %s%s%s%s%s\n", when, (long long)tuning->tick,
                  tuning->hash, clean(page, tuning->who, who, sizeof who), tuning->origin[0] != '\0' ? ", " : "",
                  clean(page, tuning->origin, origin, sizeof origin), tuning->why[0] != '\0' ? ": " : "",
                  clean(page, tuning->why, why, sizeof why));
}

/* None in most runs. */
static tl_status print_tunings(show_page *page, tl_error *error) {
    const tl_history_tuning *tunings = NULL;
    size_t count = 0;
    tl_status status = tl_history_tunings(page->request->history, page->request->run, &tunings, &count, error);
    if (status == TL_OK && count != 0) {
        heading(page, "Retuned while it ran (UTC)");
        for (size_t i = 0; i < count; i++) {
            print_tuning(page, &tunings[i]);
        }
    }
    return status;
}

/* ---- Events ------------------------------------------------------------------------------------------------------ */

static void take_event(void *context, const tl_history_event *event) {
    const show_page *page = context;
    bool colour = page->request->style.colour;
    const char *paint = strcmp(event->severity, "error") == 0     ? "\x1b[31m"
                        : strcmp(event->severity, "warning") == 0 ? "\x1b[33m"
                                                                  : "";
    char when[TEXT];
    char word[TEXT];
    char source[TEXT];
    char text[TEXT * 8];
    char tick[TEXT] = "";
    short_time(event->at, when, sizeof when);
    if (event->has_tick) {
        (void)snprintf(tick, sizeof tick, " (tick %lld)", (long long)event->tick);
    }
    (void)fprintf(page->file, "  %s  %s%-7s%s  %-8s  %s%s\n", when, colour ? paint : "",
                  clean(page, event->severity, word, sizeof word), colour && paint[0] != '\0' ? "\x1b[0m" : "",
                  clean(page, event->source, source, sizeof source), clean(page, event->text, text, sizeof text), tick);
}

static tl_status print_events(show_page *page, tl_error *error) {
    const tl_show_request *request = page->request;
    if (request->run->events == 0) {
        return TL_OK;
    }
    heading(page, request->all_events ? "Events (UTC)" : "Last events (UTC)");
    const tl_history_visitor visitor = {.context = page, .event = take_event};
    return tl_history_events(request->history, request->run, request->from_at, request->all_events ? -1 : EVENTS_SHOWN,
                             &visitor, error);
}

/* ---- All of it --------------------------------------------------------------------------------------------------- */

static void print_title(const show_page *page) {
    char path[TEXT * 8];
    char size[TEXT];
    struct stat file;
    struct stat log;
    char log_path[sizeof path + 8];
    (void)snprintf(log_path, sizeof log_path, "%s-wal", page->request->path);
    double bytes = stat(page->request->path, &file) == 0 ? (double)file.st_size : 0.0;
    bytes += stat(log_path, &log) == 0 ? (double)log.st_size : 0.0;
    tl_show_bytes(bytes, size, sizeof size);
    (void)fprintf(page->file, "%s, %s\n", clean(page, page->request->path, path, sizeof path), size);
}

tl_status tl_show_page(const tl_show_request *request, FILE *file, tl_error *error) {
    bool unicode = request->style.unicode;
    show_page page = {.request = request,
                      .file = file,
                      .delta = unicode ? "Δ" : "d",
                      .until = unicode ? "…" : "to",
                      .arrow = unicode ? "→" : "->",
                      .square = unicode ? "MSE (unit²)" : "MSE (unit^2)"};
    tl_status status = tl_show_summarise(request->history, request->run, request->from_step, &page.summary, error);
    if (status != TL_OK) {
        return status;
    }
    print_title(&page);
    status = print_runs(&page, error);
    if (status == TL_OK) {
        print_run(&page);
        status = print_match(&page, error);
    }
    status = status == TL_OK ? print_corrections(&page, error) : status;
    status = status == TL_OK ? print_tunings(&page, error) : status;
    return status == TL_OK ? print_events(&page, error) : status;
}
