/* twinlock replay: runs a recording through the twin. */
#include <limits.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/cli/verb_job.h"
#include "firmware/monitor/change_storage.h"
#include "firmware/plant/recording.h"
#include "firmware/process/interrupt.h"
#include "firmware/report/journal.h"
#include "firmware/report/show.h"
#include "firmware/report/watch.h"
#include "firmware/store/recorder.h"
#include "firmware/twin/replay.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_step.h"

/* A replay and its outputs. */
typedef struct replayer {
    tl_verb_job *job;
    tl_replay replay;
    tl_account account; /* from the start of the run; replaced at its end */
    tl_recording *recording;
    tl_journal journal; /* passes events to the database and the report */
    tl_watch watch;
    tl_lock_monitor lock_monitor;
    tl_twin_record record;
    tl_summary summary;
    tl_change_storage changes; /* after the run */
    tl_replay_report report;
    char path[PATH_MAX]; /* of the recording */
} replayer;

static tl_status print_summary(const replayer *self, tl_error *error) {
    const tl_verb_job *job = self->job;
    if (job->options->json) {
        return tl_summary_print_json(&self->summary, &job->config, &self->account, &self->changes.changes, job->output,
                                     error);
    }
    if (job->options->trajectory == NULL || strcmp(job->options->trajectory, "-") != 0) {
        tl_summary_print_table(&self->summary, &job->config, &self->account, &self->changes.changes,
                               job->options->verbose, job->output);
    }
    return TL_OK;
}

/* Findings are warnings; what follows needs no attention. */
static void report_finding(void *context, int64_t tick, const tl_finding *finding, tl_finding_turn turn) {
    replayer *self = context;
    char text[TL_FINDING_TEXT];
    char cause[TL_FINDING_TEXT];
    tl_finding_write(finding, finding->found, 0, text);
    tl_finding_write_cause(finding, cause);
    tl_journal_event(&self->journal, tick, turn == TL_FINDING_FOUND ? TL_EVENT_WARNING : TL_EVENT_INFO, "finding",
                     "%s%s%s", text, cause[0] == '\0' ? "" : "; cause: ", cause);
}

/* Opens the recorder, the report and the watch that reports events to them. These events are not
 * logged, because the table shows the result of a replay. */
static tl_status open_outputs(replayer *self, tl_error *error) {
    const tl_options *options = self->job->options;
    const tl_config *config = &self->job->config;
    const tl_recording_tunings tunings = tl_recording_get_tunings(self->recording);
    tl_replay *replay = &self->replay;
    tl_status status = TL_OK;
    if (options->database != NULL) {
        tl_recorder_settings *record = &self->record.settings;
        tl_twin_recorder_describe(config, options->database, &self->record);
        record->verb = "replay";
        record->known = tunings.known;
        record->known_count = tunings.count;
        status = tl_twin_recorder_open(config, &self->account, &self->record, &replay->recorder, error);
    }
    tl_journal_init(&self->journal, replay->recorder);
    if (status == TL_OK && options->report != NULL) {
        status = tl_replay_report_open(&self->report, config, &self->account, options->report, self->path,
                                       &self->journal, error);
        replay->page = self->report.page;
    }
    if (status == TL_OK && options->trajectory != NULL) {
        status = tl_trajectory_open(options->trajectory, self->job->output, config, &replay->trajectory, error);
    }
    tl_watch_init(&self->watch, config, &self->journal);
    tl_lock_monitor_init(&self->lock_monitor, config, &self->account);
    replay->lock_monitor = &self->lock_monitor;
    replay->detector = tl_change_detector_create(config, &self->account, report_finding, self);
    if (status == TL_OK && replay->detector == NULL) {
        status = tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", config->name);
    }
    if (status == TL_OK && replay->recorder != NULL) {
        tl_change_detector_number_from(replay->detector, tl_recorder_last_finding(replay->recorder), true);
    }
    replay->watch = &self->watch;
    return status;
}

/* Returns the first failure, with its error. */
static tl_status first_of(tl_status status, tl_status later_status, const tl_error *later, tl_error *error) {
    if (status == TL_OK && later_status != TL_OK) {
        *error = *later;
        return later_status;
    }
    return status;
}

static tl_status close_outputs(replayer *self, tl_status status, tl_error *error) {
    const tl_verb_job *job = self->job;
    const tl_replay *replay = &self->replay;
    tl_error later;
    if (replay->trajectory != NULL) {
        tl_status closed = tl_trajectory_close(replay->trajectory, job->output, job->options->trajectory, &later);
        status = first_of(status, closed, &later, error);
    }
    const char *reason = status == TL_OK            ? "end of recording"
                         : status == TL_INTERRUPTED ? tl_interrupt_requested()
                                                    : error->text;
    if (replay->recorder != NULL) {
        tl_status closed = tl_recorder_close(replay->recorder, reason, NULL, &later);
        status = first_of(status, closed, &later, error);
    }
    tl_replay_report_close(&self->report);
    tl_change_storage_release(&self->changes);
    tl_change_detector_destroy(replay->detector);
    return status;
}

static void warn(void *context, const char *text) {
    tl_recorder *recorder = context;
    tl_log(TL_LOG_WARNING, "%s", text);
    if (recorder != NULL) {
        tl_recorder_event(recorder, -1, TL_EVENT_WARNING, "twin", text);
    }
}

/* Prints and records the result of a run that was completed or interrupted. */
static tl_status report_result(replayer *self, tl_status status, tl_error *error) {
    tl_recorder *recorder = self->replay.recorder;
    tl_twin_verify_report outcome;
    tl_error later;
    if (!tl_change_storage_fill(&self->changes, &self->job->config, self->replay.detector)) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", self->job->config.name);
    }
    tl_status printed = print_summary(self, &later);
    status = first_of(status, printed, &later, error);
    tl_twin_recorder_check(&self->account, warn, recorder);
    if (tl_twin_last_finding(&self->account, &outcome) && recorder != NULL) { /* already logged */
        tl_recorder_event(recorder, -1, outcome.mended ? TL_EVENT_WARNING : TL_EVENT_ERROR, "twin", outcome.text);
    }
    if (self->report.page != NULL) {
        const char *ended = status == TL_OK ? "end of recording" : error->text;
        tl_status kept = tl_replay_report_keep(&self->report, &self->summary, &self->changes.changes, ended, &later);
        status = first_of(status, kept, &later, error);
    }
    if (recorder != NULL) {
        tl_recorder_put_changes(recorder, &self->changes.changes);
    }
    return status;
}

/* ---- the process with the FMUs ---- */

static void log_refusal(void *context, const char *text) {
    replayer *self = context;
    tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "twin", "%s", text);
}

/* Records rejected calls, and the failure of an FMU process that has ended. The process may also
 * have ended without an error, after the run. */
static void note_child(replayer *self, tl_status status, const tl_error *error) {
    tl_twin_child_report(self->job->child, log_refusal, self);
    bool failed = status != TL_OK && status != TL_INTERRUPTED && tl_twin_child_is_gone(self->job->child);
    if (failed && self->replay.recorder != NULL) {
        tl_recorder_event(self->replay.recorder, -1, TL_EVENT_ERROR, "twin", error->text);
    }
}

/* Runs the replay, then closes its outputs. */
static tl_status run(replayer *self, tl_error *error) {
    const tl_verb_job *job = self->job;
    tl_error later;
    tl_status status = open_outputs(self, error);
    if (status == TL_OK) {
        status = tl_replay_run(&self->replay, &self->summary, error);
        bool has_ended = status == TL_OK || status == TL_INTERRUPTED;
        tl_status ended = has_ended ? tl_twin_child_end(job->child, &self->account, &later) : TL_OK;
        if (ended != TL_OK) {
            *error = later;
            status = ended;
        }
        note_child(self, status, error);
        if (status == TL_OK || status == TL_INTERRUPTED) {
            status = report_result(self, status, error);
        }
    }
    bool is_whole = status == TL_OK;
    status = close_outputs(self, status, error);
    return is_whole && status == TL_OK
               ? tl_summary_require_lock(&self->summary, &job->config, job->options->require_lock, error)
               : status;
}

static tl_status open_recording(replayer *self) {
    tl_verb_job *job = self->job;
    tl_error *error = &job->error;
    tl_status status = tl_options_find_recording(job->options, &job->config, self->path, error);
    if (status == TL_OK) {
        status = tl_verb_job_check_output(job, "--csv", job->options->trajectory, self->path, error);
    }
    if (status == TL_OK) {
        status = tl_verb_job_check_output(job, "--report", job->options->report, self->path, error);
    }
    status = status == TL_OK ? tl_recording_open(self->path, &job->config, &self->recording, error) : status;
    if (status != TL_OK) {
        return status;
    }
    tl_recording_log_form(self->recording);
    return tl_verb_job_use_recording(job, self->recording);
}

/* Starts the FMU process even if the recording cannot be opened, so that an error of the FMUs is
 * reported first. */
static tl_status replay(replayer *self) {
    tl_verb_job *job = self->job;
    tl_status opened = open_recording(self);
    const tl_error why = job->error;
    job->error = (tl_error){TL_OK, ""};
    tl_status status = tl_verb_job_start(job, NULL);
    status = status == TL_OK ? tl_twin_child_build(job->child, &self->account, &job->error) : status;
    if (status == TL_OK && opened != TL_OK) {
        job->error = why;
        status = opened;
    }
    if (status != TL_OK) {
        return status;
    }
    tl_config_use_bounds(&job->config, &self->account);
    tl_recording_use_limits(self->recording);
    const tl_twin_feed_settings settings = {
        .config = &job->config,
        .account = &self->account,
        .recording = self->recording,
        .child = job->child,
        .paced = job->options->realtime,
    };
    self->replay = (tl_replay){.config = &job->config,
                               .account = &self->account,
                               .recording = self->recording,
                               .realtime = job->options->realtime};
    status = tl_twin_feed_open(&settings, &self->replay.feed, &job->error);
    status = status == TL_OK ? run(self, &job->error) : status;
    tl_twin_feed_close(self->replay.feed);
    return status;
}

int tl_verb_replay(const tl_options *options) {
    tl_verb_job job = {.options = options,
                       .output = tl_output_claim(),
                       .order = {.task = TL_TASK_STEP,
                                 .attached = options->database != NULL ? TL_ATTACHED_COUNTS : TL_ATTACHED_NONE,
                                 .plain = options->plain}};
    replayer self = {.job = &job};
    tl_status status = tl_verb_job_read(&job, options->subject, NULL);
    if (status == TL_OK) {
        job.config.recording_run = (int64_t)options->run;
        status = replay(&self);
        tl_recording_close(self.recording);
    }
    return tl_verb_job_end(&job, status);
}
