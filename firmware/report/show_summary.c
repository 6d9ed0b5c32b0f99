/* Summary of a recorded run: see show_summary.h. */
#include "firmware/report/show_summary.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "firmware/monitor/lock_tally.h"
#include "firmware/report/changes.h"
#include "firmware/report/show.h"
#include "firmware/store/history.h"

/* ---- calendar times ---- */

bool tl_show_is_live(const tl_history_run *run) {
    return strcmp(run->verb, "replay") != 0;
}

int64_t tl_show_instant(const tl_history_run *run, int64_t step) {
    int64_t started = 0;
    (void)tl_utc_parse(run->started, &started);
    double after = (double)step * ((double)run->step / 1e6);
    return after > 1e14 ? started : started + (int64_t)floor(after + 0.5);
}

/* ---- Number of steps in each lock state, computed from the events of its changes.
 *
 * Purpose: the database has no state for each step, but an event with its tick for each change.
 *          Steps before the first event count in that event's state, as in the lock monitor
 *          (lock_monitor.h). This does not apply if the first steps of the run were removed.
 * Strokes: with an event horizon the lock monitor counts strokes; here the steps of these strokes
 *          are counted.
 * Thread:  one thread.
 */

/* ---- States between events. */

typedef struct lock_course {
    const int64_t *range;
    int64_t lead;  /* ticks before the first step */
    int64_t since; /* first step with this state */
    bool is_known;
    tl_lock_tally *tally;
} lock_course;

/* Parses for example "locked: …", or "locked, corrected: …". Other events of this source contain no
 * state. */
static bool find_state(const char *text, tl_lock_state *state) {
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        const char *name = tl_lock_state_name((tl_lock_state)i);
        size_t length = strlen(name);
        if (strncmp(text, name, length) == 0 && text[length] == ':') {
            *state = (tl_lock_state)i;
            return true;
        }
    }
    *state = TL_LOCK_CORRECTED;
    return strncmp(text, "locked, ", strlen("locked, ")) == 0; /* its name in earlier programs */
}

/* Counts the steps since the last change and before `until` that are within the range. */
static void count_until(const lock_course *course, int64_t until) {
    int64_t first = course->since > course->range[0] ? course->since : course->range[0];
    int64_t end = until <= course->range[1] ? until : course->range[1] + 1;
    if (end > first) {
        course->tally->steps[course->tally->state] += (uint64_t)(end - first);
    }
}

static void take_event(void *context, const tl_history_event *event) {
    lock_course *course = context;
    tl_lock_state state = TL_LOCK_FREE;
    if (strcmp(event->source, "lock") != 0 || !event->has_tick || !find_state(event->text, &state)) {
        return;
    }
    int64_t step = event->tick - course->lead;
    bool is_within = step >= course->range[0] && step <= course->range[1];
    if (course->is_known) {
        count_until(course, step);
        course->tally->changes += is_within && state != course->tally->state ? 1 : 0; /* else an update */
        course->tally->losses += is_within && state == TL_LOCK_LOST ? 1 : 0;
        course->since = step;
    }
    if (step <= course->range[1] || !course->is_known) {
        course->tally->state = state;
        (void)tl_lock_standing_parse(event->text, &course->tally->standing);
    }
    course->is_known = true;
}

/* Counts the steps range[0] … range[1] from `own` on: earlier ones follow another run. The tally
 * stays empty if no event reports a state. Errors: those of tl_history_events(). */
static tl_status tl_show_lock(tl_history *history, const tl_history_run *run, const int64_t range[2], int64_t own,
                              tl_lock_tally *tally, tl_error *error) {
    lock_course course = {.range = range, .lead = run->lead, .since = own, .tally = tally};
    const tl_history_visitor visitor = {.context = &course, .event = take_event};
    memset(tally, 0, sizeof *tally);
    tl_status status = tl_history_events(history, run, "", -1, &visitor, error);
    if (status == TL_OK && course.is_known) {
        count_until(&course, range[1] + 1);
        tally->standing.now_s = tl_seconds(tl_time_of_step(0, run->step, range[1]));
        tally->standing.started = tl_show_is_live(run) ? tl_show_instant(run, 0) : 0;
    }
    return status;
}

/* ---- Sums: one pass over each table. */

static int64_t steps_between(const tl_show_summary *summary) {
    return summary->range[1] - summary->range[0] + 1;
}

/* Returns the index of the part that contains a step, of `parts` equal parts. */
static size_t part_of(const tl_show_summary *summary, int64_t step, size_t parts) {
    double position = (double)(step - summary->range[0]) / (double)steps_between(summary);
    size_t part = (size_t)(position * (double)parts);
    return part < parts ? part : parts - 1;
}

int64_t tl_show_window_start(const tl_show_summary *summary, size_t window) {
    return summary->range[0] +
           (int64_t)ceil((double)window * (double)steps_between(summary) / (double)summary->windows);
}

double tl_show_part_mean(const tl_show_part *part) {
    return part->count == 0 ? (double)NAN : part->correction_sum / (double)part->count;
}

/* Returns the variance of Δu within the windows. */
static double variance_within(const tl_show_summary *summary, size_t adjust) {
    const tl_show_adjust *detail = &summary->detail[adjust];
    double squares = detail->correction_squares;
    double freedom = (double)summary->figures.adjust[adjust].count;
    for (size_t i = 0; i < summary->windows; i++) {
        if (detail->windows[i].count > 0) {
            squares -= detail->windows[i].correction_sum * detail->windows[i].correction_sum /
                       (double)detail->windows[i].count;
            freedom -= 1.0;
        }
    }
    /* The difference of the squares may be rounding only. */
    return freedom < 1.0 || squares < 1e-12 * detail->correction_squares ? 0.0 : squares / freedom;
}

size_t tl_show_largest_change(const tl_show_summary *summary, size_t adjust) {
    const tl_show_adjust *detail = &summary->detail[adjust];
    size_t found = 0;
    double most = 0.0;
    double variance = variance_within(summary, adjust);
    for (size_t i = 1; i < summary->windows; i++) {
        const tl_show_part *before = &detail->windows[i - 1];
        const tl_show_part *after = &detail->windows[i];
        if (before->count > 0 && after->count > 0) {
            double change = fabs(tl_show_part_mean(after) - tl_show_part_mean(before));
            double chance = sqrt(variance * (1.0 / (double)before->count + 1.0 / (double)after->count));
            bool stands_out = change > 4.0 * chance && change > 1e-12 * sqrt(detail->correction_squares);
            found = stands_out && change > most ? i : found;
            most = stands_out && change > most ? change : most;
        }
    }
    return found;
}

static void take_step(void *context, const tl_history_step *step) {
    tl_show_summary *summary = context;
    tl_run_figures_add_step(&summary->figures, step, summary->period);
    summary->own = step->outcome == TL_RESUMED ? step->step + 1 : summary->own;
}

static void take_output(void *context, const tl_history_output *output) {
    tl_show_summary *summary = context;
    bool good = output->quality == TL_GOOD && isfinite(output->y) && isfinite(output->measured);
    tl_metrics_add(&summary->figures.match[output->signal], output->y, output->measured,
                   good ? TL_GOOD : TL_NOT_A_NUMBER);
    const tl_metrics readings = {
        .pairs = (uint64_t)output->readings, .left_out = (uint64_t)output->rejected, .sum_of_squares = output->squares};
    tl_metrics_join(&summary->figures.readings[output->signal], &readings);
    tl_metrics_add(&summary->figures.released[output->signal], output->released, output->measured,
                   good ? TL_GOOD : TL_NOT_A_NUMBER);
}

static void add_part(tl_show_part *part, double delta) {
    part->count++;
    part->correction_sum += delta;
}

static void take_adjustment(void *context, const tl_history_adjustment *adjustment) {
    tl_show_summary *summary = context;
    size_t index = adjustment->signal;
    tl_show_adjust *adjust = &summary->detail[index];
    int64_t step = adjustment->step;
    double u = adjustment->u;
    double nominal = adjustment->nominal;
    double delta = u - nominal;
    if (isnan(u) || isnan(nominal)) {
        return;
    }
    bool first = summary->figures.adjust[index].count == 0;
    adjust->least = first || u < adjust->least ? u : adjust->least;
    adjust->largest = first || u > adjust->largest ? u : adjust->largest;
    adjust->correction_squares += delta * delta;
    tl_run_figures_add_adjusted(&summary->figures, index, u, nominal);
    add_part(&adjust->windows[part_of(summary, step, summary->windows)], delta);
    add_part(&adjust->points[part_of(summary, step, summary->points)], delta);
}

/* An event may be older than the present correction: takes the mean of the last window, or of the
 * last point if the correction began within that window. */
static void renew_standing(tl_show_summary *summary) {
    tl_lock_standing *standing = &summary->lock.standing;
    double window_s = (double)tl_show_window_start(summary, summary->windows - 1) * tl_seconds(summary->period);
    for (size_t v = 0; v < summary->adjust_count && standing->reason == TL_LOCK_REASON_CORRECTION; v++) {
        const tl_show_adjust *detail = &summary->detail[v];
        double mean = tl_show_part_mean(window_s >= standing->since_s ? &detail->windows[summary->windows - 1]
                                                                      : &detail->points[summary->points - 1]);
        bool is_own = strncmp(summary->adjust[v].name, standing->variable, TL_LOCK_VARIABLE - 1) == 0;
        standing->value = is_own && isfinite(mean) ? mean : standing->value;
    }
}

tl_status tl_show_summarise(tl_history *history, const tl_history_run *run, int64_t from_step, tl_show_summary *summary,
                            tl_error *error) {
    memset(summary, 0, sizeof *summary);
    summary->period = run->step;
    const tl_run_component *components = NULL;
    size_t *count = &summary->figures.ledger_count;
    tl_status status =
        tl_history_signals(history, run, TL_HISTORY_MATCH, &summary->match, &summary->match_count, error);
    if (status == TL_OK) {
        status = tl_history_signals(history, run, TL_HISTORY_ADJUST, &summary->adjust, &summary->adjust_count, error);
    }
    if (status == TL_OK) {
        status = tl_history_ledger(history, run, &components, count, error);
    }
    if (status == TL_OK && *count != 0) {
        memcpy(summary->figures.ledger, components, *count * sizeof components[0]);
    }
    if (status == TL_OK) {
        status = tl_history_range(history, run, TL_HISTORY_STEPS, from_step, summary->range, &summary->any, error);
    }
    if (status != TL_OK || !summary->any) {
        return status;
    }
    int64_t steps = steps_between(summary);
    summary->windows = steps < TL_SHOW_WINDOWS ? (size_t)steps : TL_SHOW_WINDOWS;
    summary->points = steps < TL_SHOW_POINTS ? (size_t)steps : TL_SHOW_POINTS;
    const tl_history_visitor visitor = {
        .context = summary,
        .signals = {[TL_HISTORY_MATCH] = summary->match_count, [TL_HISTORY_ADJUST] = summary->adjust_count},
        .step = take_step,
        .output = take_output,
        .adjustment = take_adjustment,
    };
    status = tl_history_rows(history, run, summary->range, &visitor, error);
    summary->figures.skipped = summary->figures.outcomes[TL_CAUGHT_UP];
    status = status == TL_OK ? tl_show_lock(history, run, summary->range, summary->own, &summary->lock, error) : status;
    renew_standing(summary);
    return status;
}

tl_status tl_show_read_changes(const tl_show_request *request, tl_show_changes *changes, tl_error *error) {
    *changes = (tl_show_changes){.finding = NULL};
    tl_status status = tl_history_findings(request->history, request->run, &changes->finding, &changes->count, error);
    if (status == TL_OK) {
        status = tl_history_detection(request->history, request->run, &changes->detection, &changes->is_watched, error);
    }
    for (size_t i = 0; status == TL_OK && i < changes->count; i++) {
        const tl_run_finding *row = &changes->finding[i].row;
        changes->open += tl_changes_is_open(row) ? 1 : 0;
        changes->gone += strcmp(row->state, "gone") == 0 ? 1 : 0;
    }
    return status;
}

double tl_show_now(const tl_history_run *run, const tl_history_finding *finding) {
    int64_t now = 0;
    (void)tl_utc_parse(run->committed, &now);
    return (double)(now - finding->started) / 1e3;
}

void tl_show_changes_of_run(const tl_show_changes *all, int64_t run, tl_run_finding rows[TL_SHOW_FINDINGS],
                            tl_run_changes *changes) {
    *changes = (tl_run_changes){.detection = all->detection, .finding = rows};
    size_t first = all->count; /* of the newest TL_SHOW_FINDINGS */
    for (size_t own = 0; first > 0 && own < TL_SHOW_FINDINGS; first--) {
        own += all->finding[first - 1].run == run ? 1 : 0;
    }
    for (size_t i = first; i < all->count; i++) {
        if (all->finding[i].run == run) {
            changes->started = all->finding[i].started;
            rows[changes->count++] = all->finding[i].row;
        }
    }
}
