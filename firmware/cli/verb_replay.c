/* twinlock replay: a recording through the twin. */
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/cli/verb_job.h"
#include "firmware/cli/verbs.h"
#include "firmware/plant/recording.h"
#include "firmware/process/interrupt.h"
#include "firmware/report/trajectory.h"
#include "firmware/store/recorder.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/replay.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_step.h"
#include "firmware/twin/watch.h"

/* Events on their way to the database and the report. */
typedef struct event_way {
    tl_journal journal;
    tl_watch watch;
    tl_lock_judge judge;
} event_way;

/* What begins its file anew must not be given one that this run reads or writes. */
static tl_status check_output(const char *option, const char *path, const char *const *taken, size_t count,
                              tl_error *error) {
    for (size_t i = 0; path != NULL && i < count; i++) {
        if (taken[i] != NULL && tl_new_file_is(path, taken[i])) {
            return tl_fail(error, TL_BAD_USAGE, "%s %s would overwrite %s: give it another name", option, path,
                           taken[i]);
        }
    }
    return TL_OK;
}

static tl_status check_outputs(const tl_options *options, const char *recording, tl_error *error) {
    const char *const taken[] = {options->subject, recording, options->database, options->trajectory};
    tl_status status = check_output("--csv", options->trajectory, taken, 3, error);
    return status == TL_OK ? check_output("--report", options->report, taken, 4, error) : status;
}

static tl_status open_recording(const tl_config *config, const tl_options *options, char path[PATH_MAX],
                                tl_recording **recording, tl_error *error) {
    tl_status status = tl_options_find_recording(options, config, path, error);
    if (status == TL_OK) {
        status = check_outputs(options, path, error);
    }
    return status == TL_OK ? tl_recording_open(path, config, recording, error) : status;
}

static tl_status print_summary(const tl_replay *replay, const tl_verb_job *job, const tl_summary *summary,
                               tl_error *error) {
    const tl_config *config = replay->config;
    if (job->options->json) {
        return tl_summary_print_json(summary, config, replay->account, job->output, error);
    }
    if (job->options->trajectory == NULL || strcmp(job->options->trajectory, "-") != 0) {
        tl_summary_print_table(summary, config, replay->account, job->output);
    }
    return TL_OK;
}

/* The recorder and the report, and the watch whose events they get. These are not logged: who replays has the table. */
static tl_status open_outputs(const tl_verb_job *job, const char *recording, event_way *way, tl_replay *replay,
                              tl_error *error) {
    const tl_config *config = replay->config;
    const tl_recording_tunings tunings = tl_recording_get_tunings(replay->recording);
    tl_status status = TL_OK;
    if (job->options->database != NULL) {
        tl_twin_record record;
        tl_twin_recorder_describe(config, job->options->database, &record);
        record.settings.verb = "replay";
        record.settings.known = tunings.known;
        record.settings.known_count = tunings.count;
        record.settings.wait_when_full = true;
        status = tl_twin_recorder_open(config, replay->account, &record, &replay->recorder, error);
    }
    if (status == TL_OK && job->options->report != NULL) {
        status =
            tl_replay_report_open(config, replay->account, job->options->report, recording, &replay->report, error);
    }
    if (status == TL_OK && job->options->trajectory != NULL) {
        status = tl_trajectory_open(job->options->trajectory, job->output, config, &replay->trajectory, error);
    }
    tl_journal_init(&way->journal, replay->recorder);
    tl_watch_init(&way->watch, config, &way->journal);
    tl_lock_judge_init(&way->judge, config, replay->account);
    replay->judge = &way->judge;
    if (replay->report != NULL) {
        tl_replay_report_listen(replay->report, &way->journal);
    }
    replay->watch = replay->recorder != NULL || replay->report != NULL ? &way->watch : NULL;
    return status;
}

/* The first failure counts. */
static tl_status first_of(tl_status status, tl_status later_status, const tl_error *later, tl_error *error) {
    if (status == TL_OK && later_status != TL_OK) {
        *error = *later;
        return later_status;
    }
    return status;
}

static tl_status close_outputs(const tl_verb_job *job, tl_replay *replay, tl_status status, tl_error *error) {
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
    tl_replay_report_close(replay->report);
    return status;
}

static void warn(void *context, const char *text) {
    tl_recorder *recorder = context;
    tl_log(TL_LOG_WARNING, "%s", text);
    if (recorder != NULL) {
        tl_recorder_event(recorder, -1, TL_EVENT_WARNING, "twin", text);
    }
}

/* On the log it is already. */
static void note_finding(const tl_replay *replay) {
    tl_twin_look_news news;
    if (tl_twin_look_at_account(replay->account, &news) && replay->recorder != NULL) {
        tl_recorder_event(replay->recorder, -1, news.mended ? TL_EVENT_WARNING : TL_EVENT_ERROR, "twin", news.text);
    }
}

/* Of a run that came to its end, or was interrupted. */
static tl_status tell(const tl_verb_job *job, const tl_replay *replay, const tl_summary *summary, tl_status status,
                      tl_error *error) {
    tl_error later;
    tl_status printed = print_summary(replay, job, summary, &later);
    status = first_of(status, printed, &later, error);
    tl_twin_recorder_check(replay->account, warn, replay->recorder);
    note_finding(replay);
    if (replay->report != NULL) {
        const char *ended = status == TL_OK ? "end of recording" : error->text;
        tl_status kept = tl_replay_report_keep(replay->report, summary, ended, &later);
        status = first_of(status, kept, &later, error);
    }
    return status;
}

/* ---- the process with the FMUs ---- */

static void hear_refusal(void *context, const char *text) {
    event_way *way = context;
    tl_journal_event(&way->journal, -1, TL_EVENT_WARNING, "twin", "%s", text);
}

/* Records refused calls, and the failure of a process that has ended. A process may also have ended after a run without one. */
static void note_child(const tl_verb_job *job, const tl_replay *replay, event_way *way, tl_status status,
                       const tl_error *error) {
    tl_twin_child_tell(job->child, hear_refusal, way);
    bool failed = status != TL_OK && status != TL_INTERRUPTED && tl_twin_child_is_gone(job->child);
    if (failed && replay->recorder != NULL) {
        tl_recorder_event(replay->recorder, -1, TL_EVENT_ERROR, "twin", error->text);
    }
}

/* The account as it is at the end is in place of that at the beginning. */
static tl_status run(const tl_verb_job *job, const tl_replay *replay, tl_account *account, tl_summary *summary,
                     tl_error *error) {
    tl_status status = tl_replay_run(replay, summary, error);
    if (status == TL_OK || status == TL_INTERRUPTED) {
        tl_error later;
        tl_status ended = tl_twin_child_end(job->child, account, &later);
        if (ended != TL_OK) {
            *error = later;
            status = ended;
        }
    }
    return status;
}

/* Runs, then closes what the run wrote. */
static tl_status replay_into(const tl_verb_job *job, const char *recording, event_way *way, tl_account *account,
                             tl_replay *replay, tl_error *error) {
    tl_summary summary = {.wall_s = 0.0};
    tl_status status = open_outputs(job, recording, way, replay, error);
    if (status == TL_OK) {
        status = run(job, replay, account, &summary, error);
        note_child(job, replay, way, status, error);
        if (status == TL_OK || status == TL_INTERRUPTED) {
            status = tell(job, replay, &summary, status, error);
        }
    }
    bool is_whole = status == TL_OK;
    status = close_outputs(job, replay, status, error);
    return is_whole && status == TL_OK
               ? tl_summary_require_lock(&summary, replay->config, job->options->require_lock, error)
               : status;
}

static tl_status replay_fed(tl_verb_job *job, const char *path, tl_account *account, tl_recording *recording,
                            tl_error *error) {
    const tl_twin_feed_settings settings = {
        .config = &job->config,
        .account = account,
        .recording = recording,
        .child = job->child,
        .paced = job->options->realtime,
    };
    tl_replay replay = {
        .config = &job->config, .account = account, .recording = recording, .realtime = job->options->realtime};
    event_way *way = calloc(1, sizeof *way);
    tl_status status = way == NULL ? tl_fail(error, TL_TRY_AGAIN, "not enough memory")
                                   : tl_twin_feed_open(&settings, &replay.feed, error);
    if (status == TL_OK) {
        status = replay_into(job, path, way, account, &replay, error);
    }
    tl_twin_feed_close(replay.feed);
    free(way);
    return status;
}

/* What the process is told of where the recorded run began. */
static tl_status order_beginning(tl_verb_job *job, tl_recording *recording, tl_error *error) {
    const tl_recording_beginning *beginning = tl_recording_get_beginning(recording);
    if (beginning == NULL) {
        return TL_OK;
    }
    job->order.tick = beginning->tick;
    if (beginning->follows && beginning->resumption.from == TL_RESUMED_CHECKPOINT) {
        job->order.tick = beginning->checkpoint->tick;
        job->order.checkpoint = beginning->checkpoint->bytes;
        job->order.checkpoint_size = beginning->checkpoint->size;
    }
    return tl_replay_check(&job->config, beginning, error);
}

/* With a recording that could be opened, or could not: what is wrong with the FMUs is told before that. */
static tl_status replay_with(tl_verb_job *job, const char *path, tl_recording *recording, tl_status opened,
                             tl_error *error) {
    tl_error later = {TL_OK, ""};
    tl_account *account = calloc(1, sizeof *account);
    tl_status status = account == NULL ? tl_fail(&later, TL_TRY_AGAIN, "not enough memory")
                                       : tl_verb_job_start(job, &job->config, NULL, &later);
    if (status == TL_OK) {
        status = tl_twin_child_build(job->child, account, &later);
    }
    if (status != TL_OK) {
        *error = later;
    } else if (opened != TL_OK) {
        status = opened;
    } else {
        status = replay_fed(job, path, account, recording, error);
    }
    free(account);
    return status;
}

static tl_status replay(tl_verb_job *job) {
    const tl_options *options = job->options;
    tl_recording *recording = NULL;
    char path[PATH_MAX];
    tl_error error = {TL_OK, ""};
    job->config.recording_run = (int64_t)options->run;
    job->order.task = TL_TASK_STEP;
    job->order.tells = options->database != NULL ? TL_TELLS_COUNTS : TL_TELLS_RECORDS;
    job->order.plain = options->plain;
    tl_status opened = open_recording(&job->config, options, path, &recording, &error);
    if (opened == TL_OK) {
        const tl_recording_tunings tunings = tl_recording_get_tunings(recording);
        job->order.tunings = (const unsigned char *)tunings.list;
        job->order.tunings_size = tunings.count * sizeof *tunings.list;
        opened = order_beginning(job, recording, &error);
    }
    tl_status status = replay_with(job, path, recording, opened, &error);
    tl_recording_close(recording);
    if (status != TL_OK && error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    if (job->child != NULL && !tl_twin_child_is_gone(job->child)) {
        tl_error unsaid;
        (void)tl_twin_child_end(job->child, NULL, &unsaid);
    }
    return status;
}

int tl_verb_replay(const tl_options *options) {
    tl_verb_job job = {.options = options, .output = tl_output_claim()};
    tl_status status = tl_verb_job_read(&job);
    return tl_verb_job_end(&job, status == TL_OK ? replay(&job) : status);
}
