/* Watch: see watch.h. */
#include "firmware/report/watch.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* Effect of a record on an ongoing condition. */
typedef enum turn { NOTHING_NEW, BEGUN, ENDED } turn;

void tl_watch_init(tl_watch *watch, const tl_config *config, tl_journal *journal) {
    memset(watch, 0, sizeof *watch);
    watch->config = config;
    watch->journal = journal;
    watch->skipped_since = TL_TIME_NEVER;
    tl_noise_watch_init(&watch->noise, config);
    watch->fallback.cause = TL_WATCH_FALLBACK;
    watch->stagnation.cause = TL_WATCH_STAGNATION;
    for (unsigned v = 0; v < TL_MAX_ADJUST; v++) {
        watch->held[v].cause = TL_WATCH_HELD + v;
    }
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        watch->rejected[i] = (tl_watch_rejected){.stamp = TL_TIME_NEVER, .accepted = (double)NAN};
    }
}

/* ---- repeated warnings ---- */

static const tl_time HOUR = 3600 * TL_SECOND;
enum { HOURS = 24, COUNT = 96 };

/* Returns true if the cause was reported within its pause. Else writes the count of the notices
 * since then. The pause of an error stays an hour. */
static bool is_repeat(tl_watch *watch, int64_t tick, unsigned cause, tl_severity severity, char text[COUNT]) {
    tl_watch_repeats *repeats = &watch->repeats[cause];
    const int64_t hour = HOUR / watch->config->step;
    const double step_s = tl_seconds(watch->config->step);
    if (repeats->pause != 0 && tick - repeats->since < repeats->pause) {
        repeats->count++;
        return true;
    }
    if (repeats->count != 0) {
        char since[TL_LOCK_INSTANT];
        tl_lock_instant_write((double)repeats->since * step_s, (double)tick * step_s, watch->started, false, since);
        (void)snprintf(text, COUNT, " (%llu more since %s)", (unsigned long long)repeats->count, since);
    }
    int64_t longer = 2 * repeats->pause < HOURS * hour ? 2 * repeats->pause : HOURS * hour;
    bool is_lasting = tick - repeats->since < 2 * repeats->pause && severity == TL_EVENT_WARNING;
    repeats->pause = is_lasting ? longer : hour;
    repeats->since = tick;
    repeats->count = 0;
    return false;
}

/* Reports a warning or an error; a repeat of its cause is a notice. */
static void warn(tl_watch *watch, int64_t tick, unsigned cause, tl_severity severity, const char *source,
                 const char *format, ...) TL_PRINTF(6, 7);

static void warn(tl_watch *watch, int64_t tick, unsigned cause, tl_severity severity, const char *source,
                 const char *format, ...) {
    char text[TL_JOURNAL_TEXT];
    char repeats[COUNT] = "";
    va_list arguments;
    bool is_notice = severity != TL_EVENT_INFO && is_repeat(watch, tick, cause, severity, repeats);
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    tl_journal_event(watch->journal, tick, is_notice ? TL_EVENT_INFO : severity, source, "%.*s%s",
                     (int)(sizeof text - 1 - strlen(repeats)), text, repeats);
}

/* ---- rejected readings ---- */

static const tl_condition *condition_of(const tl_watch *watch, size_t signal) {
    return &watch->config->signals[watch->config->signals[signal].shows].condition;
}

static void report_rejected(tl_watch *watch, int64_t tick, size_t signal, double value) {
    static const char *const by_gate =
        "plant.%s: a reading of %.6g is rejected: it is %.6g from the last accepted one, more "
        "than its gate of %.6g";
    static const char *const by_leap =
        "plant.%s: a reading of %.6g is rejected as an outlier: expected about %.6g, as before and after; %llu so far (if "
        "the plant can do this: \"condition\": { \"outliers\": \"keep\" } in its match)";
    tl_watch_rejected *rejected = &watch->rejected[signal];
    const tl_config_signal *own = &watch->config->signals[signal];
    const char *name = watch->config->signals[own->of].plan.name;
    bool is_later = rejected->count != 0 && (tick - rejected->since) > TL_WATCH_MINUTE / watch->config->step;
    if (is_later && rejected->count > TL_WATCH_REJECTED) {
        tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "plant",
                         "plant.%s: %llu more readings were rejected within a minute", name,
                         (unsigned long long)(rejected->count - TL_WATCH_REJECTED));
    }
    if (is_later || rejected->count == 0) {
        rejected->count = 0;
        rejected->since = tick;
    }
    rejected->total++;
    if (++rejected->count > TL_WATCH_REJECTED) {
        return;
    }
    if (condition_of(watch, signal)->gate > 0.0) {
        tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "plant", by_gate, name, value,
                         fabs(value - rejected->accepted), condition_of(watch, signal)->gate);
    } else {
        tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "plant", by_leap, name, value, rejected->accepted,
                         (unsigned long long)rejected->total);
    }
}

static void await_next(tl_watch_rejected *rejected, double value) {
    if (rejected->waiting_count == TL_WATCH_WAITING) {
        rejected->waiting[0] = rejected->waiting[1];
        rejected->waiting_count--;
    }
    rejected->waiting[rejected->waiting_count++] = value;
}

/* `value` is good. After a step it is nearer to the waiting reading than to the accepted one. If
 * the run begins with a waiting reading, it is unknown whether that was a step or an outlier, so
 * nothing is reported. */
static void report_waiting(tl_watch *watch, int64_t tick, size_t signal, double value) {
    tl_watch_rejected *rejected = &watch->rejected[signal];
    size_t count = rejected->waiting_count;
    bool is_outlier = count > 0 && fabs(value - rejected->waiting[count - 1]) >= fabs(value - rejected->accepted);
    for (size_t i = 0; i < count && is_outlier; i++) {
        report_rejected(watch, tick, signal, rejected->waiting[i]);
    }
    rejected->waiting_count = 0;
}

static void watch_reading(tl_watch *watch, const tl_sample *sample, size_t signal) {
    tl_watch_rejected *rejected = &watch->rejected[signal];
    bool is_new = sample->stamps[signal] != rejected->stamp;
    rejected->stamp = sample->stamps[signal];
    double value = sample->values[signal];
    if (is_new && sample->quality[signal] == TL_OUTLIER && condition_of(watch, signal)->gate > 0.0) {
        report_rejected(watch, sample->tick, signal, value);
    } else if (is_new && sample->quality[signal] == TL_OUTLIER) {
        await_next(rejected, value);
    } else if (is_new && sample->quality[signal] == TL_GOOD) {
        report_waiting(watch, sample->tick, signal, value);
        rejected->accepted = value;
    }
}

/* ---- noise ---- */

static void watch_noise(tl_watch *watch, const tl_sample *sample, size_t index) {
    const tl_plan_match *match = &watch->config->match[index];
    double sigma = 0.0;
    switch (tl_noise_watch_sample(&watch->noise, sample, index, &sigma)) {
    case TL_NOISE_IS_LARGE:
        warn(
            watch, sample->tick, TL_WATCH_NOISE + (unsigned)index, TL_EVENT_WARNING, "twin",
            "%s: tolerance %.6g is below three times the noise of the readings (%.3g): the twin follows the noise; raise it to "
            "%.3g",
            match->variable, match->tolerance, sigma, 3.0 * sigma);
        break;
    case TL_NOISE_IS_SMALL:
        tl_journal_event(watch->journal, sample->tick, TL_EVENT_INFO, "twin",
                         "%s: tolerance %.6g is at least three times the noise of the readings again (%.3g)",
                         match->variable, match->tolerance, sigma);
        break;
    case TL_NOISE_AS_BEFORE:
        break;
    }
}

/* ---- samples ---- */

static void report_quality(tl_watch *watch, const tl_sample *sample, size_t signal) {
    char text[TL_CONFIG_DESCRIPTION];
    const tl_plan_signal *plan = &watch->config->signals[signal].plan;
    tl_quality quality = (tl_quality)sample->quality[signal];
    if (quality == TL_FROZEN) { /* report_frozen() */
        return;
    }
    if (quality == TL_GOOD) {
        tl_journal_event(watch->journal, sample->tick, TL_EVENT_INFO, "plant", "plant.%s: good again", plan->name);
        return;
    }
    tl_config_describe_quality(watch->config, signal, sample->values[signal], quality, tl_sample_age(sample, signal),
                               text);
    const char *instead = !watch->config->signals[signal].feeds ? ""
                          : watch->had_value[signal]            ? "; the model gets the last good value"
                                                                : "; the model gets the initial value";
    tl_journal_event(watch->journal, sample->tick, TL_EVENT_WARNING, "plant", "plant.%s: %s: not used (%s)%s",
                     plan->name, text, tl_config_quality_remedy(watch->config, signal, quality), instead);
}

/* Once for each signal; the summary has their number. */
static void report_moved(tl_watch *watch, const tl_sample *sample, size_t signal) {
    const tl_config_signal *described = &watch->config->signals[signal];
    if (((sample->moved & ~watch->moved) >> signal & 1U) != 0) {
        watch->moved |= UINT64_C(1) << signal;
        tl_journal_event(
            watch->journal, sample->tick, TL_EVENT_INFO, "plant",
            "plant.%s: a value slightly outside %.6g \342\200\246 %.6g (declared by the FMU) is moved to the limit; "
            "later ones are only counted",
            described->plan.name, described->minimum, described->maximum);
    }
}

void tl_watch_sample(tl_watch *watch, const tl_sample *sample) {
    for (size_t i = 0; i < watch->config->match_count; i++) {
        watch_noise(watch, sample, i);
    }
    for (size_t i = 0; i < watch->config->signal_count; i++) {
        if (watch->config->signals[i].is_reading) {
            watch_reading(watch, sample, i);
            continue;
        }
        watch->had_value[i] = watch->had_value[i] || sample->quality[i] == TL_GOOD;
        report_moved(watch, sample, i);
        if (sample->quality[i] == watch->quality[i]) {
            continue;
        }
        watch->quality[i] = sample->quality[i];
        report_quality(watch, sample, i);
    }
}

/* Reported once per run: further ones are counted in the summary. */
static void watch_refused(tl_watch *watch, int64_t tick, const tl_record *record) {
    const tl_record_refused *refused = &record->refused;
    const tl_config *config = watch->config;
    bool by_output = refused->by_output != 0;
    if (refused->count == 0 || watch->refused || refused->variable >= config->adjust_count ||
        refused->index >= (by_output ? config->match_count : config->component_count)) {
        return;
    }
    watch->refused = true;
    const char *adjusted = config->adjust[refused->variable].variable;
    tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "twin",
                     "%s: %s with %s = %.6g, in a trial of step %lld: the search leaves such values out; set \"%s\" of "
                     "%s to save these trials",
                     by_output ? config->match[refused->index].variable : config->components[refused->index].name,
                     by_output ? "not finite" : "the FMU failed", adjusted, refused->u, (long long)record->step,
                     refused->u < record->nominal[refused->variable] ? "min" : "max", adjusted);
}

/* ---- outputs that are not finite ---- */

static void watch_output(tl_watch *watch, int64_t tick, const tl_record *record, size_t bit) {
    tl_watch_trouble *bad = &watch->bad[bit];
    const char *name = tl_config_output_name(watch->config, bit);
    tl_time step = watch->config->step;
    if ((record->bad_outputs >> bit & 1U) == 0) {
        if (bad->was_reported && name != NULL && record->step - bad->last >= TL_WATCH_REST / step) {
            bad->was_reported = false;
            tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                             "%s: finite again for a minute; steps in which it was not: %llu", name,
                             (unsigned long long)bad->count);
        }
        return;
    }
    bad->count = bad->was_reported ? bad->count + 1 : 1;
    bad->last = record->step;
    if (!bad->was_reported && name != NULL) {
        bad->was_reported = true;
        tl_journal_event(
            watch->journal, tick, TL_EVENT_WARNING, "twin",
            "%s: not finite (NaN or infinity) between t = %.9g s and %.9g s: it is left out of the matching, and "
            "inputs that it drives keep their last value; check the model, for example for 0/0",
            name, tl_seconds(tl_time_of_step(0, step, record->step)),
            tl_seconds(tl_time_of_step(0, step, record->step + 1)));
    }
}

static void watch_starts(tl_watch *watch, int64_t tick, const tl_record *record) {
    const tl_record_found *found = &record->found;
    if (found->evaluations == 0) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                         "the FMUs start again before step %lld, with the first good values of the plant",
                         (long long)record->step);
    }
    if (found->evaluations != 0 && !isfinite(found->after)) {
        tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "twin",
                         "start values not found in the first %u steps: %s", (unsigned)watch->config->find_steps,
                         isnan(found->after) ? "no matched signal was good" : "an FMU failed with all values tried");
        return;
    }
    for (size_t i = 0; i < watch->config->find_count && found->evaluations != 0; i++) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                         "start value found: %s = %.6g (%u runs of the first %u steps: error %.3g -> %.3g tolerances)",
                         watch->config->find[i].variable, found->values[i], (unsigned)found->evaluations,
                         (unsigned)watch->config->find_steps, found->before, found->after);
    }
}

/* With an event horizon, a reset without this cause is reported with the stroke. */
static void watch_reset(tl_watch *watch, int64_t tick, const tl_record *record) {
    char why[96] = "";
    if (watch->bad_steps >= TL_NOT_FINITE_STEPS) {
        (void)snprintf(why, sizeof why, " because an output was not finite in %u steps in a row",
                       (unsigned)watch->bad_steps);
    }
    if ((record->flags & TL_FLAG_STARTS) != 0) {
        watch_starts(watch, tick, record);
    } else if ((record->flags & TL_FLAG_RESET) != 0 && (why[0] != '\0' || watch->config->event.start.signal == NULL)) {
        warn(watch, tick, TL_WATCH_RESET, TL_EVENT_WARNING, "lock",
             "FMUs were reset to their start values before step %lld%s; u is nominal", (long long)record->step, why);
    }
}

static void watch_outputs(tl_watch *watch, int64_t tick, const tl_record *record) {
    watch->bad_steps = record->bad_outputs != 0 ? watch->bad_steps + 1 : 0;
    for (size_t bit = 0; bit < TL_CONFIG_OUTPUTS; bit++) {
        if (watch->bad[bit].was_reported || tl_config_is_bad_output(watch->config, record->bad_outputs, bit)) {
            watch_output(watch, tick, record, bit);
        }
    }
}

/* Permanent until the FMUs are reset. */
static void watch_rollback(tl_watch *watch, int64_t tick, const tl_record *record) {
    bool has_none = (record->flags & TL_FLAG_NO_ROLLBACK) != 0;
    if (has_none && !watch->no_way_back) {
        tl_journal_event(
            watch->journal, tick, TL_EVENT_WARNING, "twin",
            "the twin runs free from step %lld on: an FMU that is rolled back by replay has passed its limit (replay_steps), "
            "or gave other results when steps were repeated",
            (long long)record->step);
    } else if (!has_none && watch->no_way_back) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                         "all FMUs can be rolled back: synchronising again");
    }
    watch->no_way_back = has_none;
}

/* A step that was caught up gives no information. Without a free twin report_harm() reports it. */
static void watch_rest(tl_watch *watch, int64_t tick, const tl_record *record) {
    bool rests = (record->flags & TL_FLAG_RESTS) != 0;
    if (!watch->config->free_twin || rests == watch->rests || record->outcome == TL_CAUGHT_UP ||
        record->outcome == TL_FREE_RUN) {
        return;
    }
    watch->rests = rests;
    tl_journal_event(
        watch->journal, tick, TL_EVENT_INFO, "twin",
        rests ? "u stays at nominal from step %lld on: the twin without correction is nearer to the plant"
              : "u is searched again from step %lld on: the twin without correction was too far from the plant",
        (long long)record->step);
}

static void watch_released(tl_watch *watch, int64_t tick, const tl_record *record) {
    if ((record->flags & TL_FLAG_RELEASED_SLOW) != 0) {
        tl_journal_event(
            watch->journal, tick, TL_EVENT_WARNING, "twin",
            "the released twins end, because they take more than a tenth of step_s: wrong models that "
            "corrections hide and frozen sensors are no longer found; increase step_s, or set release_s to 0");
    }
}

static void watch_free_run(tl_watch *watch, int64_t tick, const tl_record *record) {
    bool free_run = record->outcome == TL_FREE_RUN && (record->flags & TL_FLAG_NO_ROLLBACK) == 0;
    if (free_run == watch->free_run || record->outcome == TL_CAUGHT_UP) {
        return;
    }
    watch->free_run = free_run;
    warn(watch, tick, TL_WATCH_FREE_RUN, free_run ? TL_EVENT_WARNING : TL_EVENT_INFO, "twin", "%s",
         free_run ? "no matched signal is good: u is nominal" : "matched signals are good: synchronising again");
}

/* Writes J of a step out of tolerance. J is missing if there was no time, or if it overflowed. */
static void write_objective(const tl_record *record, char *text, size_t size) {
    if (isfinite(record->objective)) {
        (void)snprintf(text, size, "J = %.3g", record->objective);
    } else if (record->stop == TL_STOP_TIME || (record->flags & TL_FLAG_WITHOUT_NOMINAL) != 0) {
        (void)snprintf(text, size, "no time to evaluate");
    } else {
        (void)snprintf(text, size, "J is not finite");
    }
}

/* Only a search that was not cut short can show that a condition is over. Many searches and some
 * time are required, so that an intermittent condition is reported once. */
static turn follow_trouble(const tl_watch *watch, tl_watch_trouble *trouble, const tl_record *record, bool has) {
    if (has) {
        bool reported = trouble->was_reported;
        trouble->was_reported = true;
        trouble->last = record->step;
        trouble->without = 0;
        trouble->count = reported ? trouble->count + 1 : 1;
        return reported ? NOTHING_NEW : BEGUN;
    }
    trouble->without += trouble->was_reported && record->stop != TL_STOP_NONE ? 1 : 0;
    if (trouble->without < TL_WATCH_STEPS || record->step - trouble->last < TL_WATCH_REST / watch->config->step) {
        return NOTHING_NEW;
    }
    trouble->was_reported = false;
    trouble->without = 0;
    return ENDED;
}

/* Texts around a name, at the beginning of a condition and at its end (with the number of steps).
 */
typedef struct trouble_texts {
    const char *begun[2];
    const char *over[2];
} trouble_texts;

static const trouble_texts HELD = {
    {"",
     ": the matched outputs do not react to it, so it gets no correction: match an output that it moves, or lengthen "
     "horizon.prediction"},
    {"", ": the matched outputs react to it again; steps without a correction"},
};
static const trouble_texts FALLBACK = {
    {"the solver makes no more progress: the fallback solver, ", ", is used"},
    {"the fallback solver, ", ", is not needed any more; searches that used it"},
};
static const trouble_texts STAGNATION = {
    {"a search made no progress and was ended", ""},
    {"searches make progress again; searches that were ended", ""},
};

static void watch_trouble(tl_watch *watch, int64_t tick, const tl_record *record, tl_watch_trouble *trouble, bool has,
                          const char *name, const trouble_texts *texts) {
    const turn now = follow_trouble(watch, trouble, record, has);
    if (now == BEGUN) {
        warn(watch, tick, trouble->cause, TL_EVENT_WARNING, "twin", "%s%s%s", texts->begun[0], name, texts->begun[1]);
    } else if (now == ENDED) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin", "%s%s%s: %llu", texts->over[0], name,
                         texts->over[1], (unsigned long long)trouble->count);
    }
}

/* Writes "a, b and c". */
static void write_alike(const tl_config *config, uint32_t alike, char *text, size_t size) {
    size_t used = 0;
    text[0] = '\0';
    for (size_t v = 0; v < config->adjust_count && used < size; v++) {
        if ((alike >> v & 1U) != 0) {
            alike &= ~((uint32_t)1 << v);
            const char *before = used == 0 ? "" : alike >> v != 0 ? ", " : " and ";
            used += (size_t)snprintf(text + used, size - used, "%s%.60s", before, config->adjust[v].variable);
        }
    }
}

static void watch_alike(tl_watch *watch, int64_t tick, const tl_record *record, const tl_twin_identifiability *found) {
    uint32_t alike = found->alike & (((uint32_t)1 << watch->config->adjust_count) - 1);
    const turn now = follow_trouble(watch, &watch->alike, record, alike != 0);
    char names[TL_EVENT_TEXT / 2];
    write_alike(watch->config, alike, names, sizeof names);
    if (now == BEGUN) {
        warn(watch, tick, TL_WATCH_ALIKE, TL_EVENT_WARNING, "lock",
             "since t = %.9g s %s act alike and share one correction: match another output, adjust only one, or "
             "lengthen horizon.prediction",
             tl_seconds(tl_time_of_step(0, watch->config->step, found->since)), names);
    } else if (now == ENDED) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "lock",
                         "no adjusted variables act alike any more; steps in which they did: %llu",
                         (unsigned long long)watch->alike.count);
    }
}

static bool has_moved(const tl_watch *watch, const tl_record *record) {
    return record->u[0] < watch->stroke_u || record->u[0] > watch->stroke_u;
}

/* The search of a stroke is complete. Reports nothing while strokes agree with the present u. */
static void report_stroke(tl_watch *watch, int64_t tick, const tl_record *record) {
    const char *name = watch->config->adjust[0].variable;
    bool out = record->outcome == TL_BEST_SO_FAR || record->outcome == TL_NOMINAL;
    tl_severity severity = out ? TL_EVENT_WARNING : TL_EVENT_INFO;
    char objective[32];
    write_objective(record, objective, sizeof objective);
    if (has_moved(watch, record)) {
        warn(watch, tick, TL_WATCH_STROKE, severity, "twin", "stroke: %s from %.6g to %.6g (%s, %s, %llu evaluations)",
             name, watch->stroke_u, record->u[0], tl_outcome_name(record->outcome), objective,
             (unsigned long long)watch->stroke_evaluations);
    } else if (out != watch->out_of_tolerance) {
        warn(watch, tick, TL_WATCH_STROKE, severity, "twin", "stroke: %s with %s at %.6g (%s)",
             out ? "out of tolerance" : "within tolerance again", name, record->u[0], objective);
    }
    watch->out_of_tolerance = out;
}

/* Reports the first one of a row, and their number after the next complete search. */
static void report_abandoned(tl_watch *watch, int64_t tick, const tl_record *record) {
    bool reset = (record->flags & TL_FLAG_RESET) != 0;
    if (watch->abandoned++ == 0) {
        warn(watch, tick, TL_WATCH_ABANDONED, TL_EVENT_WARNING, "twin", "stroke: its search was not completed: %s",
             reset ? "the FMUs were reset"
                   : "it lasted too long, an edge fell into a gap of the measurements, the next stroke came "
                     "too soon, or its result failed");
    }
    if (has_moved(watch, record) && !reset) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin", "stroke: %s from %.6g to %.6g, the best so far",
                         watch->config->adjust[0].variable, watch->stroke_u, record->u[0]);
    }
}

/* Event horizon: reports the result of a stroke. */
static void watch_stroke(tl_watch *watch, int64_t tick, const tl_record *record) {
    bool ended = record->outcome != TL_HELD && record->outcome != TL_SEARCHING && record->outcome != TL_CAUGHT_UP;
    bool abandoned = (record->flags & TL_FLAG_ABANDONED) != 0;
    watch->stroke_evaluations += record->evaluations;
    if (record->step == 0) {
        watch->stroke_u = record->nominal[0];
    }
    if (abandoned) {
        report_abandoned(watch, tick, record);
    }
    if (ended && watch->abandoned > 1) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                         "stroke: its search was completed; strokes before without: %llu",
                         (unsigned long long)watch->abandoned);
    }
    if (ended) {
        watch->abandoned = 0;
        report_stroke(watch, tick, record);
    }
    if (ended || abandoned || (record->flags & TL_FLAG_RESET) != 0) {
        watch->stroke_u = record->u[0];
        watch->stroke_evaluations = 0;
    }
}

/* A delay that is measured but not used: reports only a large change, because a change of the
 * plant's motion can change the lag of a model by some steps. */
static void watch_unused_delay(tl_watch *watch, int64_t tick, const tl_record *record) {
    static const tl_time large = 3; /* steps */
    tl_time moved = record->delay - watch->delay;
    bool is_known = record->delay_state == TL_DELAY_KNOWN;
    bool is_first = is_known && watch->delay_state == TL_DELAY_UNKNOWN;
    bool has_moved = moved > large * watch->config->step || moved < -large * watch->config->step;
    if (is_known && !is_first && has_moved) {
        tl_journal_event(
            watch->journal, tick, TL_EVENT_WARNING, "twin",
            "delay: the readings come %.3g ms %s than before, compared with the model without corrections: check the "
            "clock of the sensor and its connection, or follow it with \"delays\": \"output\" and \"measure\"",
            fabs(tl_seconds(moved)) * 1e3, moved < 0 ? "later" : "earlier");
    }
    if (is_first || (is_known && has_moved)) {
        watch->delay_state = record->delay_state;
        watch->delay = record->delay;
    }
}

/* Reports a first measured delay, a change of more than one step, and a loss of confidence. */
static void watch_delay(tl_watch *watch, int64_t tick, const tl_record *record) {
    if (tl_config_measures_delay(watch->config) != TL_DELAY_USED) {
        watch_unused_delay(watch, tick, record);
        return;
    }
    tl_time input =
        watch->config->delays != NULL && watch->config->delays->has_input ? watch->config->delays->input.delay : 0;
    tl_time delay = record->delay + input;
    tl_time moved = delay > watch->delay ? delay - watch->delay : watch->delay - delay;
    const double now_ms = tl_seconds(delay) * 1e3;
    bool is_known = record->delay_state == TL_DELAY_KNOWN;
    if (record->delay_state == TL_DELAY_LOST && watch->delay_state != TL_DELAY_LOST) {
        tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "twin",
                         "delay: the measurement is uncertain; \316\224o = %.3f ms stays in use", now_ms);
    } else if (is_known && watch->delay_state == TL_DELAY_UNKNOWN) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                         "delay: measured \316\224o = %.3f ms is used from now on", now_ms);
    } else if (is_known && moved > watch->config->step) {
        tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "twin",
                         "delay: \316\224o has drifted from %.3f ms to %.3f ms", tl_seconds(watch->delay) * 1e3,
                         now_ms);
    } else if (is_known && watch->delay_state == TL_DELAY_LOST) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                         "delay: the measurement is certain again; \316\224o = %.3f ms", now_ms);
    } else {
        return;
    }
    watch->delay_state = record->delay_state;
    watch->delay = delay;
}

/* Reports an inexact rollback. The finding itself is a separate event
 * without a tick, because a replay may find it at another tick. */
static void watch_fmus(tl_watch *watch, int64_t tick, const tl_record *record) {
    bool differed = (record->flags & TL_FLAG_DIFFERED) != 0;
    if (differed && !watch->differed) {
        tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "twin", "the rollback of an FMU is not exact");
    }
    watch->differed = differed;
}

void tl_watch_record(tl_watch *watch, int64_t tick, const tl_record *record,
                     const tl_twin_identifiability *identifiability) {
    if (record->outcome == TL_RESUMED) {
        return; /* reported by the run that was resumed */
    }
    watch_rollback(watch, tick, record);
    watch_refused(watch, tick, record);
    watch_reset(watch, tick, record);
    watch_outputs(watch, tick, record);
    if (watch->config->event.start.signal != NULL) {
        watch_stroke(watch, tick, record);
        return;
    }
    watch_fmus(watch, tick, record);
    watch_free_run(watch, tick, record);
    watch_rest(watch, tick, record);
    watch_released(watch, tick, record);
    for (size_t i = 0; i < watch->config->adjust_count; i++) {
        watch_trouble(watch, tick, record, &watch->held[i], ((record->held | identifiability->unseen) >> i & 1U) != 0,
                      watch->config->adjust[i].variable, &HELD);
    }
    watch_alike(watch, tick, record, identifiability);
    watch_trouble(watch, tick, record, &watch->fallback, (record->flags & TL_FLAG_FALLBACK) != 0,
                  watch->config->fallback != NULL ? watch->config->fallback : "", &FALLBACK);
    watch_trouble(watch, tick, record, &watch->stagnation, (record->flags & TL_FLAG_STAGNATED) != 0, "", &STAGNATION);
    watch_delay(watch, tick, record);
}

void tl_watch_keep(tl_watch *watch, int64_t tick, uint64_t unsaved) {
    size_t next = watch->has_keep ? watch->config->component_count : 0;
    watch->has_keep = true;
    while (next < watch->config->component_count) {
        char text[TL_CONFIG_KEEP_TEXT];
        next = tl_config_write_keep(watch->config, unsaved, next, text);
        if (text[0] != '\0') {
            tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin", "%s", text);
        }
    }
}

void tl_watch_lock(tl_watch *watch, int64_t tick, const tl_lock_change *change) {
    static const tl_severity severities[TL_LOCK_STATES] = {[TL_LOCK_FREE] = TL_EVENT_WARNING,
                                                           [TL_LOCK_LOCKED] = TL_EVENT_INFO,
                                                           [TL_LOCK_CORRECTED] = TL_EVENT_WARNING,
                                                           [TL_LOCK_DEGRADED] = TL_EVENT_WARNING,
                                                           [TL_LOCK_LOST] = TL_EVENT_ERROR};
    bool has_name = change->to == TL_LOCK_CORRECTED; /* its cause begins with the state */
    warn(watch, tick, TL_WATCH_STATE + (unsigned)change->to, change->is_update ? TL_EVENT_INFO : severities[change->to],
         "lock", "%s%s%s", has_name ? "" : tl_lock_state_name(change->to), has_name ? "" : ": ", change->cause);
}

static void report_harm(tl_watch *watch, int64_t tick, const tl_release_check *release) {
    if (release->turn == TL_RELEASE_WORSE) {
        warn(
            watch, tick, TL_WATCH_HARM, TL_EVENT_WARNING, "twin",
            "the corrections do harm: the twin is off by %.3g tolerances rms, and by %.3g without corrections%s; lengthen "
            "horizon.prediction, or widen the tolerances (check --recording proposes both)",
            release->error[0], release->error[1], release->rests ? ": u rests at nominal" : "");
    } else if (release->turn == TL_RELEASE_ENDS) {
        warn(watch, tick, TL_WATCH_HARM, TL_EVENT_INFO, "twin",
             "u is searched again: at nominal the twin is off by %.3g tolerances rms, %.3g before", release->error[0],
             release->before);
    } else if (release->turn == TL_RELEASE_BETTER) {
        tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                         "the corrections do no harm any more: off by %.3g tolerances rms, and by %.3g without them",
                         release->error[0], release->error[1]);
    }
}

static void report_frozen(const tl_watch *watch, int64_t tick, const tl_frozen_match *match) {
    const tl_config_signal *own = &watch->config->signals[match->signal];
    if (match->turn == TL_FROZEN_BEGUN) {
        tl_journal_event(
            watch->journal, tick, TL_EVENT_WARNING, "plant",
            "plant.%s: frozen: all readings since t = %.6g s are %.6g, for %.3g s (before: at most %.3g s), but the model "
            "moves: not used (check the sensor, or whether the plant is blocked)",
            watch->config->signals[own->of].plan.name, tl_seconds(tl_time_of_step(0, watch->config->step, match->tick)),
            match->value, tl_seconds(match->newest - match->begin), tl_seconds(match->longest));
    }
}

void tl_watch_monitor(tl_watch *watch, int64_t tick, const tl_lock_monitor *monitor) {
    report_harm(watch, tick, &monitor->release);
    for (size_t i = 0; i < watch->config->match_count; i++) {
        report_frozen(watch, tick, &monitor->frozen.match[i]);
    }
    for (size_t v = 0; v < watch->config->adjust_count; v++) {
        const tl_bound_stay *stay = &monitor->stay[v];
        const char *name = watch->config->adjust[v].variable;
        if (stay->turn == TL_BOUND_REACHED) {
            warn(
                watch, tick, TL_WATCH_BOUND + (unsigned)v, TL_EVENT_WARNING, "twin",
                "%s was at a bound in %.0f %% of the last minute: it cannot correct more; check the plant, or widen the "
                "bound",
                name, 100.0 * stay->share);
        } else if (stay->turn == TL_BOUND_LEFT) {
            tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "twin",
                             "%s was at a bound in only %.0f %% of the last minute", name, 100.0 * stay->share);
        }
    }
}

void tl_watch_retune(const tl_watch *watch, int64_t tick, const char *hash) {
    tl_journal_event(watch->journal, tick, TL_EVENT_INFO, "retune", "configuration %.12s is active", hash);
}

void tl_watch_skipped(tl_watch *watch, int64_t tick, uint64_t count, tl_time now) {
    watch->skipped += count;
    if (watch->skipped == 0 || (watch->skipped_since != TL_TIME_NEVER && now - watch->skipped_since < TL_SECOND)) {
        return;
    }
    watch->skipped_since = now;
    tl_journal_event(watch->journal, tick, TL_EVENT_WARNING, "cycle",
                     "%llu ticks missed, then caught up without a search", (unsigned long long)watch->skipped);
    watch->skipped = 0;
}
