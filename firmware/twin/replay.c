/* Replay of a recording, and its report: see replay.h. */
#include "firmware/twin/replay.h"

#include <inttypes.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/output.h"
#include "firmware/config/config.h"
#include "firmware/process/interrupt.h"
#include "firmware/report/changes.h"
#include "firmware/twin/twin_recorder.h"

/* ---- replay report ---- */

static void add_event(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    const tl_history_event event = {"", tick >= 0, tick, tl_severity_name(severity), source, text};
    tl_html_report_add_event(context, &event);
}

tl_status tl_replay_report_open(tl_replay_report *report, const tl_config *config, const tl_account *account,
                                const char *path, const char *recording, tl_journal *journal, tl_error *error) {
    report->account = account;
    tl_twin_recorder_signals(config, account, report->match, report->adjust);
    for (size_t i = 0; i < config->match_count; i++) {
        report->tolerance[i] = tl_html_tolerance(&config->match[i], config->synchronise);
    }
    tl_utc_text(tl_utc_now(), report->begun);
    const tl_html_settings settings = {
        .name = config->name,
        .source = recording,
        .begun = report->begun,
        .version = TL_VERSION,
        .solver = account->algorithm,
        .fallback = account->fallback,
        .measurements = tl_pairing_names[config->measurements],
        .step = config->step,
        .prediction = account->prediction,
        .match = report->match,
        .adjust = report->adjust,
        .match_count = config->match_count,
        .adjust_count = config->adjust_count,
        .tolerance = report->tolerance,
    };
    tl_status status = tl_new_file_open(path, &report->file, error);
    status = status == TL_OK ? tl_html_report_create(&settings, &report->page, error) : status;
    if (status == TL_OK) {
        tl_journal_listen(journal, add_event, report->page);
    }
    return status;
}

tl_status tl_replay_report_keep(tl_replay_report *report, const tl_summary *summary, const tl_run_changes *changes,
                                const char *ended, tl_error *error) {
    tl_run_figures figures = summary->figures;
    if (tl_changes_are_known(changes)) {
        tl_html_report_set_verdict(report->page, &changes->detection, tl_changes_count(changes, "open"),
                                   tl_changes_count(changes, "gone"));
    }
    for (size_t i = 0; i < changes->count; i++) {
        tl_html_report_add_finding(report->page, &changes->finding[i], 0.0, 0, NULL);
    }
    tl_run_figures_take_account(&figures, report->account);
    tl_html_report_write(report->page, &figures, &summary->lock, ended, report->file.file);
    return tl_new_file_keep(&report->file, error);
}

void tl_replay_report_close(tl_replay_report *report) {
    tl_new_file_discard(&report->file);
    tl_html_report_destroy(report->page);
}

/* ---- replay ---- */

static void keep_record(const tl_replay *replay, int64_t tick, const tl_twin_result *result, tl_summary *summary) {
    const tl_config *config = replay->config;
    const tl_record *record = &result->record;
    tl_summary_add(summary, config, record);
    const tl_lock_change *change = tl_lock_monitor_step(replay->lock_monitor, record);
    tl_watch_record(replay->watch, tick, record, &result->identifiability);
    tl_watch_keep(replay->watch, tick, result->unsaved);
    if (change != NULL) {
        tl_watch_lock(replay->watch, tick, change);
    }
    tl_watch_monitor(replay->watch, tick, replay->lock_monitor);
    if (replay->detector != NULL) {
        tl_change_detector_step(replay->detector, tick, record);
    }
    if (replay->recorder != NULL) {
        tl_recorder_put_step(replay->recorder, record, result->attached.counts);
    }
    if (replay->trajectory != NULL) {
        tl_trajectory_add(replay->trajectory, config, record);
    }
    if (replay->page != NULL) {
        tl_html_report_add_record(replay->page, record);
    }
}

/* In real time: waits for the tick's instant and counts ticks that are late. */
static void pace_tick(const tl_replay *replay, tl_time started, tl_summary *summary) {
    const tl_recording_tick *tick = replay->realtime ? tl_twin_feed_poll(replay->feed) : NULL;
    if (tick != NULL) {
        tl_time period = replay->config->step;
        tl_time instant = tl_time_of_step(started, period, tick->sample.tick);
        tl_clock_sleep_until(instant);
        summary->deadline_misses += tl_clock_now(NULL) - instant > period ? 1 : 0;
    }
}

/* The twin has applied the run's tunings of this tick already; updates configuration, lock monitor,
 * watch and recorder here. */
static void apply_tunings(const tl_replay *replay, int64_t tick, tl_twin_tunings *tunings) {
    tl_run_tuning tuning;
    while (tl_twin_tunings_next(tunings, tick, &tuning)) {
        tl_config_retune(replay->config, &tuning.values);
        tl_lock_monitor_retune(replay->lock_monitor, &tuning.values);
        tl_watch_retune(replay->watch, tick, tuning.hash);
        if (replay->recorder != NULL) {
            tl_recorder_put_tuning(replay->recorder, &tuning);
        }
    }
}

/* Processes the sample and the events before a tick's step, and marks frozen signals as the process
 * with the FMUs has done. `missed` counts the ticks that the run caught up before a regular one, if
 * it has reported them. */
static void take_sample(const tl_replay *replay, const tl_recording_tick *tick, tl_sample *sample, uint64_t *missed) {
    if (tick->caught_up) {
        ++*missed;
    } else {
        tl_time instant = tl_time_of_step(0, replay->config->step, sample->tick);
        tl_watch_skipped(replay->watch, sample->tick, *missed, instant);
        *missed = 0;
    }
    if (!tick->followed) { /* reported by the run that was resumed */
        tl_frozen_mark(tl_frozen_watch_sample(&replay->lock_monitor->frozen, sample, tick->is_decided), sample);
        tl_lock_monitor_sample(replay->lock_monitor, sample);
        tl_watch_sample(replay->watch, sample);
        if (replay->detector != NULL) {
            tl_change_detector_sample(replay->detector, sample);
        }
    }
    if (replay->recorder != NULL) {
        tl_recorder_put_sample(replay->recorder, sample);
    }
}

/* A last tick only completes the record before it. It counts as a sample only if it did so. */
static void keep_tick(const tl_replay *replay, const tl_twin_fed *fed, uint64_t *missed, tl_twin_tunings *tunings,
                      tl_summary *summary) {
    tl_sample sample = fed->tick->sample;
    bool ready = fed->result->ready != 0;
    if (!fed->last) {
        apply_tunings(replay, sample.tick, tunings);
        take_sample(replay, fed->tick, &sample, missed);
        tl_summary_sample(summary, replay->config, &sample);
        summary->figures.skipped += ready && fed->result->record.outcome == TL_CAUGHT_UP ? 1 : 0;
    } else if (ready && replay->recorder != NULL) {
        tl_recorder_put_sample(replay->recorder, &sample);
    }
    if (ready) {
        keep_record(replay, sample.tick, fed->result, summary);
    }
}

/* Steps that were computed before the interruption was noticed are counted: they are in the twin's
 * account. */
static tl_status check_interruption(const tl_replay *replay, const tl_summary *summary, tl_error *error) {
    if (tl_interrupt_requested() == NULL) {
        return TL_OK;
    }
    tl_twin_feed_stop(replay->feed);
    return tl_fail(error, TL_INTERRUPTED, "interrupted by %s after %llu steps", tl_interrupt_requested(),
                   (unsigned long long)summary->figures.steps);
}

static tl_status run_ticks(const tl_replay *replay, tl_progress *progress, tl_summary *summary, tl_error *error) {
    const tl_recording_tunings recorded = tl_recording_get_tunings(replay->recording);
    tl_twin_tunings tunings = {.bytes = (const unsigned char *)recorded.list, .count = recorded.count};
    uint64_t missed = 0;
    bool end = false;
    tl_time started = tl_clock_now(NULL);
    for (;;) {
        tl_twin_fed fed = {0};
        pace_tick(replay, started, summary);
        tl_status status = tl_twin_feed_next(replay->feed, &fed, &end, error);
        if (end || fed.result == NULL) {
            return status == TL_OK ? check_interruption(replay, summary, error) : status;
        }
        keep_tick(replay, &fed, &missed, &tunings, summary);
        if (status != TL_OK) {
            return status;
        }
        (void)check_interruption(replay, summary, error);
        tl_progress_update(progress, fed.tick->sample.tick);
    }
}

tl_status tl_replay_run(const tl_replay *replay, tl_summary *summary, tl_error *error) {
    tl_progress progress;
    int64_t ticks = tl_recording_ticks(replay->recording);
    int64_t last = tl_twin_feed_last_tick(replay->config, replay->account);
    *summary = (tl_summary){0};
    tl_time started = tl_clock_now(NULL);
    tl_progress_begin(&progress, "replay", last < ticks ? last : ticks);
    const tl_recording_beginning *beginning = tl_recording_get_beginning(replay->recording);
    if (beginning != NULL && beginning->follows) {
        summary->resumption = beginning->resumption;
    }
    const tl_recording_tunings tunings = tl_recording_get_tunings(replay->recording);
    summary->tunings = tunings.recorded;
    summary->tunings_left_out = tunings.recorded - tunings.count;
    tl_status status = run_ticks(replay, &progress, summary, error);
    tl_progress_end(&progress);
    if (status == TL_OK && summary->figures.steps + summary->figures.skipped == 0) {
        /* In mode ahead the measurement of a step comes one tick later. */
        unsigned needed = (unsigned)replay->account->lead + (replay->config->measurements == TL_AHEAD ? 1 : 0);
        status = tl_fail(error, TL_BAD_DATA,
                         "the recording is too short: %lld tick%s of %g s (expected at least %u): take a longer one",
                         (long long)ticks, ticks == 1 ? "" : "s", tl_seconds(replay->config->step), needed + 1);
    }
    tl_lock_monitor_get(replay->lock_monitor, &summary->lock);
    summary->wall_s = tl_seconds(tl_clock_now(NULL) - started);
    return status;
}

tl_status tl_replay_check(const tl_config *config, const tl_recording_beginning *beginning, tl_error *error) {
    char text[TL_IDENTITY_TEXT];
    if (!beginning->follows) {
        return TL_OK;
    }
    tl_twin_recorder_identify(config, text);
    if (strcmp(text, beginning->fmus) != 0) {
        return tl_fail(error, TL_BAD_DATA,
                       "run %" PRId64 " resumes run %" PRId64
                       ", but the FMU files have changed since: install the files of these runs",
                       beginning->run, beginning->resumption.run);
    }
    tl_identity_format(text);
    if (beginning->resumption.from == TL_RESUMED_CHECKPOINT && strcmp(text, beginning->checkpoint->format) != 0) {
        return tl_fail(error, TL_BAD_DATA,
                       "run %" PRId64 " starts from a checkpoint that only %s can load (this is %s)", beginning->run,
                       beginning->checkpoint->format, text);
    }
    return TL_OK;
}
