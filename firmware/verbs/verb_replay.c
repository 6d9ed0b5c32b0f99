/* twinlock replay: a recording through the twin. */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/base/new_file.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/plant/recording.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/record/recorder.h"
#include "firmware/report/trajectory.h"
#include "firmware/run/journal.h"
#include "firmware/run/replay.h"
#include "firmware/run/watch.h"
#include "firmware/text/output.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/verbs/verb_job.h"
#include "firmware/verbs/verbs.h"

/* Events on their way to the database and the report. */
typedef struct event_way {
    tl_journal journal;
    tl_watch watch;
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

static tl_status open_recording(const tl_assembly *assembly, const tl_options *options, char path[PATH_MAX],
                                tl_recording **recording, tl_error *error) {
    tl_status status = tl_options_find_recording(options, &assembly->config, path, error);
    if (status == TL_OK) {
        status = check_outputs(options, path, error);
    }
    return status == TL_OK ? tl_recording_open(path, &assembly->config, recording, error) : status;
}

static tl_status print_summary(const tl_replay *replay, const tl_verb_job *job, const tl_summary *summary,
                               tl_error *error) {
    const tl_config *config = &replay->assembly->config;
    if (job->options->json) {
        return tl_summary_print_json(summary, config, &replay->account, job->output, error);
    }
    if (job->options->trajectory == NULL || strcmp(job->options->trajectory, "-") != 0) {
        tl_summary_print_table(summary, config, &replay->account, job->output);
    }
    return TL_OK;
}

/* The process ends while an FMU has not returned. What was recorded is on the disk after a commit or two. */
static void keep(void *context, const char *why) {
    const tl_replay *replay = context;
    if (replay->recorder != NULL) {
        tl_recorder_event(replay->recorder, -1, TL_EVENT_ERROR, "twin", why);
        tl_clock_sleep_until(tl_clock_now(NULL) + 2 * replay->assembly->config.record_commit);
    }
    tl_replay_report_close(replay->report);
}

/* The recorder and the report, and the watch whose events they get. These are not logged: who replays has the table. */
static tl_status open_outputs(const tl_assembly *assembly, const tl_verb_job *job, const char *recording,
                              event_way *way, tl_replay *replay, tl_error *error) {
    tl_status status = TL_OK;
    if (job->options->database != NULL) {
        const tl_twin_recorder_settings settings = {.config = &assembly->config,
                                                    .account = &replay->account,
                                                    .verb = "replay",
                                                    .path = job->options->database,
                                                    .wait_when_full = true};
        status = tl_twin_recorder_open(&settings, &replay->recorder, error);
    }
    if (status == TL_OK && job->options->report != NULL) {
        status = tl_replay_report_open(&assembly->config, &replay->account, job->options->report, recording,
                                       &replay->report, error);
    }
    if (status == TL_OK && job->options->trajectory != NULL) {
        status =
            tl_trajectory_open(job->options->trajectory, job->output, &assembly->config, &replay->trajectory, error);
    }
    tl_journal_init(&way->journal, replay->recorder);
    tl_watch_init(&way->watch, &assembly->config, &way->journal);
    if (replay->report != NULL) {
        tl_replay_report_listen(replay->report, &way->journal);
    }
    replay->watch = replay->recorder != NULL || replay->report != NULL ? &way->watch : NULL;
    tl_process_keep(keep, replay);
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
    tl_process_keep(NULL, NULL);
    if (replay->trajectory != NULL) {
        tl_status closed = tl_trajectory_close(replay->trajectory, job->output, job->options->trajectory, &later);
        status = first_of(status, closed, &later, error);
    }
    const char *reason = status == TL_OK            ? "end of recording"
                         : status == TL_INTERRUPTED ? tl_interrupt_requested()
                                                    : error->text;
    if (replay->recorder != NULL) {
        tl_recorder_counts counts;
        tl_status closed = tl_recorder_close(replay->recorder, reason, &counts, &later);
        status = first_of(status, closed, &later, error);
    }
    tl_replay_report_close(replay->report);
    return status;
}

/* Of a run that came to its end, or was interrupted. */
static tl_status tell(const tl_verb_job *job, const tl_replay *replay, const tl_summary *summary, tl_status status,
                      tl_error *error) {
    tl_error later;
    tl_status printed = print_summary(replay, job, summary, &later);
    status = first_of(status, printed, &later, error);
    tl_twin_recorder_check(&replay->account, replay->recorder);
    if (replay->report != NULL) {
        const char *ended = status == TL_OK ? "end of recording" : error->text;
        tl_status kept = tl_replay_report_keep(replay->report, summary, ended, &later);
        status = first_of(status, kept, &later, error);
    }
    return status;
}

/* Runs, then closes what the run wrote. */
static tl_status replay_into(const tl_assembly *assembly, const tl_verb_job *job, const char *recording, event_way *way,
                             tl_replay *replay, tl_error *error) {
    tl_summary summary;
    tl_account_take(assembly->twin, &replay->account);
    tl_status status = open_outputs(assembly, job, recording, way, replay, error);
    if (status == TL_OK) {
        status = tl_replay_run(replay, &summary, error);
        if (status == TL_OK || status == TL_INTERRUPTED) {
            tl_account_take(assembly->twin, &replay->account);
            status = tell(job, replay, &summary, status, error);
        }
    }
    return close_outputs(job, replay, status, error);
}

/* With what is too large for a small stack. */
static tl_status replay_and_tell(const tl_assembly *assembly, const tl_verb_job *job, const char *recording,
                                 tl_replay *replay, tl_error *error) {
    event_way *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    tl_status status = replay_into(assembly, job, recording, made, replay, error);
    free(made);
    return status;
}

static tl_status load(const tl_options *options, tl_assembly *assembly) {
    tl_status status = tl_assembly_read(options->subject, assembly);
    if (status != TL_OK) {
        return status;
    }
    assembly->config.recording_run = (int64_t)options->run;
    if (options->plain) {
        assembly->config.saving.structure = false;
        assembly->config.saving.sequences = false;
    }
    return tl_assembly_build(assembly);
}

static void replay(void *context) {
    tl_verb_job *job = context;
    tl_assembly assembly;
    tl_error error;
    job->status = load(job->options, &assembly);
    if (job->status == TL_OK) {
        tl_replay replay = {.assembly = &assembly, .realtime = job->options->realtime};
        char recording[PATH_MAX];
        job->status = open_recording(&assembly, job->options, recording, &replay.recording, &error);
        if (job->status == TL_OK) {
            job->status = replay_and_tell(&assembly, job, recording, &replay, &error);
        }
        tl_recording_close(replay.recording);
        if (job->status != TL_OK) {
            tl_log(TL_LOG_ERROR, "%s", error.text);
        }
    }
    tl_verb_job_end(job, &assembly);
}

int tl_verb_replay(const tl_options *options) {
    tl_verb_job job = {.options = options, .output = tl_output_claim()};
    return tl_verb_job_run(&job, replay);
}
