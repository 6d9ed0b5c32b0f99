/* Verb that needs FMUs: see verb_job.h. */
#include "firmware/cli/verb_job.h"

#include <limits.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/cli/check_page.h"
#include "firmware/process/interrupt.h"
#include "firmware/twin/replay.h"

tl_status tl_verb_job_read(tl_verb_job *job, const char *path, const char *text) {
    const tl_options *options = job->options;
    tl_problems problems;
    tl_interrupt_install();
    tl_problems_init(&problems, path);
    tl_status status = text != NULL ? tl_config_read_text(path, text, strlen(text), &job->config, &problems.report)
                                    : tl_config_read(path, &job->config, &problems.report);
    if (job->counts_problems && problems.report.count > 1) {
        tl_log(TL_LOG_ERROR, "%zu problems", problems.report.count);
    }
    if (status == TL_OK) {
        if (job->order.attached == TL_ATTACHED_OUTPUTS) { /* an emulated plant has no delays */
            tl_config_forget_delays(&job->config);
        }
        tl_config_use_lookups(&job->config);
        job->order.path = path;
        job->order.text = job->config.text;
        job->order.unconfined = options->unconfined || tl_config_is_unconfined(&job->config);
    }
    return status;
}

/* The FMU process begins as the recorded run: at its tick, and with its checkpoint. */
static tl_status set_beginning(tl_verb_job *job, const tl_recording *recording) {
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
    return tl_replay_check(&job->config, beginning, &job->error);
}

tl_status tl_verb_job_use_recording(tl_verb_job *job, const tl_recording *recording) {
    job->order.time = tl_recording_get_time(recording);
    if (job->config.duration != 0) {
        job->order.time.length = job->config.duration;
    }
    job->order.keep = tl_recording_get_keep(recording);
    const tl_recording_tunings tunings = tl_recording_get_tunings(recording);
    job->order.tunings = (const unsigned char *)tunings.list;
    job->order.tunings_size = tunings.count * sizeof *tunings.list;
    return set_beginning(job, recording);
}

static tl_status check_one(const char *option, const char *path, const char *used, tl_error *error) {
    return path == NULL || used == NULL || path == used || !tl_new_file_would_replace(path, used)
               ? TL_OK
               : tl_fail(error, TL_BAD_USAGE, "%s %s would overwrite %s: give another name", option, path, used);
}

tl_status tl_verb_job_check_output(const tl_verb_job *job, const char *option, const char *path, const char *recording,
                                   tl_error *error) {
    const char *const used[] = {job->options->subject, recording, job->options->database, job->options->trajectory};
    tl_status status = TL_OK;
    for (size_t i = 0; i < sizeof used / sizeof used[0] && status == TL_OK; i++) {
        status = check_one(option, path, used[i], error);
    }
    for (size_t i = 0; i < job->config.component_count && status == TL_OK; i++) {
        char fmu[PATH_MAX];
        bool is_found = tl_config_fmu_path(&job->config, job->config.components[i].fmu, fmu, sizeof fmu);
        status = is_found ? check_one(option, path, fmu, error) : TL_OK;
    }
    return status;
}

tl_twin_child_settings tl_verb_job_settings(const tl_verb_job *job, FILE *results) {
    return (tl_twin_child_settings){
        .job = &job->order,
        .config = &job->config,
        .page = results,
        .print_page = tl_check_page_print,
        .call_limit = tl_time_of_seconds(job->options->call_limit_s),
        .memory_limit = (uint64_t)job->options->memory_limit_mib * 1024 * 1024,
    };
}

tl_status tl_verb_job_start(tl_verb_job *job, FILE *results) {
    const tl_twin_child_settings settings = tl_verb_job_settings(job, results);
    return tl_twin_child_start(&settings, &job->child, &job->error);
}

/* Returns true if the FMUs, or a restriction on them, can have caused the failure. */
static bool is_of_fmus(tl_status status) {
    return status == TL_FMU_FAILED || status == TL_FMU_FATAL || status == TL_BAD_DATA;
}

int tl_verb_job_end(tl_verb_job *job, tl_status status) {
    tl_error error;
    if (job->child != NULL && (job->order.task == TL_TASK_STEP || job->order.task == TL_TASK_EXPLAIN)) {
        tl_status ended = tl_twin_child_end(job->child, NULL, &error);
        if (status == TL_OK && ended != TL_OK) {
            job->error = error;
            status = ended;
        }
    }
    if (status != TL_OK && job->error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", job->error.text);
    }
    if (job->child != NULL && tl_twin_child_wait(job->child, &error) != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        status = status == TL_OK || status == TL_NOT_LOCKED ? error.status : status;
    }
    if (job->child != NULL && is_of_fmus(status) && !job->counts_problems && !tl_log_has_error()) {
        tl_log(TL_LOG_ERROR, "the FMU process failed without a message: run `twinlock check` on the configuration");
    }
    if (job->child != NULL && is_of_fmus(status) && tl_twin_child_refusal_may_be_cause(job->child)) {
        tl_log(TL_LOG_WARNING,
               "a denied system call may be the cause: if you trust the FMU, permit it with --unconfined, or with "
               "\"unconfined\": true in its component");
    }
    tl_twin_child_close(job->child);
    tl_config_free(&job->config);
    return tl_exit_code(job->output != NULL ? tl_output_finish(job->output, status) : status);
}
