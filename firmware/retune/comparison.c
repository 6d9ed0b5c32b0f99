/* Forecast and comparison: see comparison.h. */
#include "firmware/retune/comparison.h"

#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/retune/probation.h"

/* ---- forecast ---- */

static double milliseconds(tl_time time) {
    return tl_seconds(time) * 1e3;
}

static double mebibytes(uint64_t bytes) {
    return (double)bytes / (1024.0 * 1024.0);
}

void tl_forecast_write_time(const tl_trial_answer *answer, char text[TL_FORECAST_TEXT]) {
    double step = milliseconds(answer->step);
    double budget = milliseconds(answer->budget);
    if (answer->least == 0) {
        (void)snprintf(text, TL_FORECAST_TEXT, "the duration of a step is not known in advance; its limit is %.3g ms",
                       step);
    } else if (answer->least > answer->step) {
        (void)snprintf(text, TL_FORECAST_TEXT,
                       "a step without a search takes %.3g ms here, more than the period of %.3g ms: raise step_s",
                       milliseconds(answer->least), step);
    } else if (answer->worst == 0) {
        (void)snprintf(text, TL_FORECAST_TEXT, "a step takes %.3g ms of its %.3g ms", milliseconds(answer->least),
                       step);
    } else if (answer->budget == 0 || answer->worst <= answer->budget) {
        (void)snprintf(text, TL_FORECAST_TEXT,
                       "a step takes %.3g ms of its %.3g ms, and %.3g ms with a complete search",
                       milliseconds(answer->least), step, milliseconds(answer->worst));
    } else {
        (void)snprintf(
            text, TL_FORECAST_TEXT,
            "a step takes %.3g ms of its %.3g ms; a complete search exceeds the budget of %.3g ms and is cut "
            "short",
            milliseconds(answer->least), step, budget);
    }
}

void tl_forecast_write_memory(const tl_trial_answer *answer, uint64_t left, char text[TL_FORECAST_TEXT]) {
    int length =
        snprintf(text, TL_FORECAST_TEXT, "the new twin needs at most %.0f MiB of memory", mebibytes(answer->memory));
    if (left != 0) {
        (void)snprintf(text + length, TL_FORECAST_TEXT - (size_t)length, "; the box has %.0f MiB available%s",
                       mebibytes(left), answer->memory > left ? ", too little for two twins" : "");
    }
}

uint64_t tl_forecast_memory_left(void) {
    enum { MOST = 65536 };
    static const char key[] = "MemAvailable:";
    size_t size = 0;
    char *text = tl_file_text_take(open("/proc/meminfo", O_RDONLY | O_CLOEXEC), MOST, &size);
    const char *line = text == NULL ? NULL : strstr(text, key);
    uint64_t left = line == NULL ? 0 : 1024 * (uint64_t)strtoull(line + strlen(key), NULL, 10);
    free(text);
    return left;
}

/* ---- comparison ---- */

/* ---- differences ---- */

static uint64_t count_since(uint64_t before, uint64_t now) {
    return now >= before ? now - before : now;
}

/* Both states are of the same twin, so the order of its outputs is the same. */
static void subtract_counts(const tl_run_status *before, tl_run_status *now) {
    if (now->ticks < before->ticks) {
        return; /* another twin has started; its counts began at 0 */
    }
    now->ticks = count_since(before->ticks, now->ticks);
    now->steps = count_since(before->steps, now->steps);
    now->skipped = count_since(before->skipped, now->skipped);
    now->gaps = count_since(before->gaps, now->gaps);
    now->deadline_misses = count_since(before->deadline_misses, now->deadline_misses);
    now->evaluations = count_since(before->evaluations, now->evaluations);
    now->executions = count_since(before->executions, now->executions);
    now->timed_out = count_since(before->timed_out, now->timed_out);
    now->used -= before->used;
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        now->lock.steps[i] = count_since(before->lock.steps[i], now->lock.steps[i]);
        now->lock_before.steps[i] = count_since(before->lock_before.steps[i], now->lock_before.steps[i]);
    }
    for (size_t i = 0; i < now->outputs && i < before->outputs; i++) {
        now->output[i].pairs -= before->output[i].pairs;
        now->output[i].sum_of_squares -= before->output[i].sum_of_squares;
    }
}

void tl_comparison_begin(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin) {
    comparison->shadow = *shadow;
    comparison->twin = *twin;
}

void tl_comparison_end(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin) {
    const tl_comparison before = *comparison;
    tl_comparison_begin(comparison, shadow, twin);
    subtract_counts(&before.shadow, &comparison->shadow);
    subtract_counts(&before.twin, &comparison->twin);
}

/* ---- texts ---- */

enum { NUMBER = 64 };

/* Of Δy = y − ŷ. Not a number if there are no pairs. */
static double root_mean_square(const tl_run_output *output) {
    return sqrt(output->sum_of_squares / (double)output->pairs);
}

/* `output` is NULL if that twin does not match it. */
static void write_root_mean_square(const tl_run_output *output, char text[NUMBER]) {
    if (output != NULL && isfinite(root_mean_square(output))) {
        (void)snprintf(text, NUMBER, "%.3g%s%s", root_mean_square(output), output->unit[0] == '\0' ? "" : " ",
                       output->unit);
    } else {
        (void)snprintf(text, NUMBER, "%s", output == NULL ? "not matched" : output->pairs == 0 ? "no good value" : "-");
    }
}

static const tl_run_output *find_output(const tl_run_status *work, const char *name) {
    for (size_t i = 0; i < work->outputs; i++) {
        if (strcmp(work->output[i].name, name) == 0) {
            return &work->output[i];
        }
    }
    return NULL;
}

static double share_of(double part, uint64_t whole) {
    return whole == 0 ? 0.0 : part / (double)whole;
}

void tl_comparison_write_lock(const tl_lock_tally *lock, char text[TL_COMPARISON_LOCK]) {
    if (tl_lock_tally_total(lock) == 0) {
        (void)snprintf(text, TL_COMPARISON_LOCK, "lock not evaluated yet");
    } else {
        (void)snprintf(text, TL_COMPARISON_LOCK, "in lock %.3g %%", tl_lock_tally_percent(lock));
    }
}

static void write_figures(const char *label, const tl_run_status *work, char text[TL_COMPARISON_TEXT]) {
    char lock[TL_COMPARISON_LOCK];
    tl_comparison_write_lock(&work->lock, lock);
    (void)snprintf(text, TL_COMPARISON_TEXT,
                   "%s: per step %.3g evaluations, %.3g executions, %.3g ms; of %" PRIu64 " steps, %" PRIu64
                   " cut short by time, %" PRIu64 " caught up, %" PRIu64 " deadlines missed; %s",
                   label, share_of((double)work->evaluations, work->steps),
                   share_of((double)work->executions, work->steps), 1e3 * share_of(tl_seconds(work->used), work->steps),
                   work->steps, work->timed_out, work->skipped, work->deadline_misses, lock);
}

/* Percent of the steps in which no matched signal was good; 100 if no step was evaluated, because
 * no stroke has ended yet (event horizon). */
static double percent_unseen(const tl_comparison *comparison) {
    const tl_lock_tally *lock = &comparison->shadow.lock;
    uint64_t judged = tl_lock_tally_total(lock);
    return judged == 0 ? 100.0 : 100.0 * share_of((double)lock->steps[TL_LOCK_FREE], judged);
}

/* The lock is evaluated only if a signal was good in at least half of the steps. */
static const double MOST_PERCENT = 50.0;

void tl_comparison_report(const tl_comparison *comparison, void (*report)(void *context, const char *text),
                          void *context) {
    const tl_run_status *twin = &comparison->twin;
    const tl_run_status *shadow = &comparison->shadow;
    char text[TL_COMPARISON_TEXT];
    for (size_t i = 0; i < twin->outputs + shadow->outputs; i++) {
        bool is_new = i >= twin->outputs;
        const char *name = is_new ? shadow->output[i - twin->outputs].name : twin->output[i].name;
        const tl_run_output *now = find_output(twin, name);
        if (is_new && now != NULL) {
            continue; /* it was reported above */
        }
        char of_now[NUMBER];
        char of_then[NUMBER];
        write_root_mean_square(now, of_now);
        write_root_mean_square(find_output(shadow, name), of_then);
        (void)snprintf(text, sizeof text, "%s: rms error: now %s, new twin %s", name, of_now, of_then);
        report(context, text);
    }
    write_figures("now", twin, text);
    report(context, text);
    write_figures("new", shadow, text);
    report(context, text);
    if (tl_lock_tally_total(&shadow->lock) == 0) {
        report(context, "no step could be evaluated for the lock: the probation evaluates it");
    } else if (percent_unseen(comparison) > MOST_PERCENT) {
        (void)snprintf(text, sizeof text,
                       "no matched signal was good in %.3g %% of the steps: the lock is evaluated by the probation",
                       percent_unseen(comparison));
        report(context, text);
    }
}

/* ---- time for two twins ---- */

/* A twin that skipped more than this part of its ticks does not follow the plant, whatever its
 * priority and the cause. */
enum { LEAST_PART = 4 };

static bool skips_too_many(const tl_run_status *figures) {
    return figures->skipped > figures->ticks / LEAST_PART;
}

/* A machine may pause now and then, for several ticks at once. That does not prove a lack of time,
 * so the number of gaps counts too. */
static bool falls_behind(const tl_run_status *figures, const tl_run_status *measure) {
    return figures->gaps >= TL_PROBATION_MISSES &&
           tl_probation_is_too_many(figures->skipped, figures->ticks, measure->skipped, measure->ticks);
}

/* By probation's rule, for deadlines or for skipped ticks. */
static bool is_overloaded(const tl_run_status *figures, const tl_run_status *measure) {
    return skips_too_many(figures) || falls_behind(figures, measure) ||
           tl_probation_is_too_many(figures->deadline_misses, figures->steps, measure->deadline_misses, measure->steps);
}

static tl_comparison_result report_overload(const char *label, const tl_run_status *figures,
                                            char why[TL_COMPARISON_TEXT]) {
    (void)snprintf(why, TL_COMPARISON_TEXT,
                   "%s missed %" PRIu64 " deadlines and %" PRIu64 " of %" PRIu64 " ticks"
                   ": " TL_COMPARISON_TWO_TWINS,
                   label, figures->deadline_misses, figures->skipped, figures->ticks);
    return TL_COMPARISON_TOO_SLOW;
}

/* ---- worse ---- */

/* Both twins match the output, with the same unit and enough pairs. */
static bool is_comparable(const tl_run_output *now, const tl_run_output *then) {
    return now->tolerance > 0.0 && then->tolerance > 0.0 && now->pairs >= TL_COMPARISON_PAIRS &&
           then->pairs >= TL_COMPARISON_PAIRS && strcmp(now->unit, then->unit) == 0;
}

/* A new twin whose error is not finite is worse than a twin with a finite error. */
static bool is_worse(const tl_run_output *now, const tl_run_output *then) {
    double of_now = root_mean_square(now);
    double of_then = root_mean_square(then);
    return isfinite(of_now) && !(of_then <= now->tolerance || of_then <= TL_COMPARISON_TIMES * of_now);
}

/* By the tolerances of the version before, because the candidate may have widened its own. */
static bool is_lost_before(const tl_comparison *comparison, double require_lock, char why[TL_COMPARISON_TEXT]) {
    const tl_lock_tally *lock = &comparison->shadow.lock_before;
    double in_lock_now = tl_lock_tally_percent(&comparison->twin.lock);
    double in_lock = tl_lock_tally_total(lock) == lock->steps[TL_LOCK_FREE] ? 100.0 : tl_lock_tally_percent(lock);
    (void)snprintf(
        why, TL_COMPARISON_TEXT,
        "by the previous version's tolerances, the new twin was in lock in %.4g %% of the steps (required %.4g %%), "
        "the run's twin in %.4g %%",
        in_lock, require_lock, in_lock_now);
    return percent_unseen(comparison) <= MOST_PERCENT && in_lock < require_lock && in_lock < in_lock_now;
}

/* Returns true if an output is worse, or if the lock is worse by the tolerances of the version
 * before. */
static bool is_any_worse(const tl_comparison *comparison, double require_lock, char why[TL_COMPARISON_TEXT]) {
    const tl_run_status *twin = &comparison->twin;
    for (size_t i = 0; i < twin->outputs; i++) {
        const tl_run_output *now = &twin->output[i];
        const tl_run_output *then = find_output(&comparison->shadow, now->name);
        if (then != NULL && is_comparable(now, then) && is_worse(now, then)) {
            char of_now[NUMBER];
            char of_then[NUMBER];
            write_root_mean_square(now, of_now);
            write_root_mean_square(then, of_then);
            (void)snprintf(why, TL_COMPARISON_TEXT,
                           "%s is worse: rms error %s, with the run's twin %s (tolerance %.3g)", now->name, of_then,
                           of_now, now->tolerance);
            return true;
        }
    }
    if (is_lost_before(comparison, require_lock, why)) {
        return true;
    }
    why[0] = '\0';
    return false;
}

/* ---- result ---- */

tl_comparison_result tl_comparison_evaluate(const tl_comparison *comparison, double require_lock,
                                            char why[TL_COMPARISON_TEXT]) {
    const tl_run_status *twin = &comparison->twin;
    const tl_run_status *shadow = &comparison->shadow;
    double in_lock_now = tl_lock_tally_percent(&twin->lock);
    if (twin->twin_failures != comparison->before.twin_failures) {
        (void)snprintf(why, TL_COMPARISON_TEXT, "the run's twin was restarted during the comparison: try again");
        return TL_COMPARISON_BAD;
    }
    if (skips_too_many(shadow)) {
        return report_overload("the new twin", shadow, why);
    }
    if (is_overloaded(twin, &comparison->before)) {
        return report_overload("the run's twin beside it", twin, why);
    }
    if (shadow->steps == 0) {
        (void)snprintf(why, TL_COMPARISON_TEXT, "the new twin has not computed a step");
        return TL_COMPARISON_BAD;
    }
    bool is_seen = percent_unseen(comparison) <= MOST_PERCENT;
    double in_lock = tl_lock_tally_percent(&shadow->lock);
    if (is_seen && in_lock < require_lock && in_lock < in_lock_now) {
        (void)snprintf(why, TL_COMPARISON_TEXT,
                       "the new twin was in lock in %.4g %% of the steps (required %.4g %%), the run's twin in %.4g %%",
                       in_lock, require_lock, in_lock_now);
        return TL_COMPARISON_BAD;
    }
    return is_any_worse(comparison, require_lock, why) ? TL_COMPARISON_WORSE : TL_COMPARISON_GOOD;
}
