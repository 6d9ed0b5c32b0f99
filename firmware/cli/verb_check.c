/* twinlock check: validates a configuration and its FMUs without a run. */
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/output.h"
#include "firmware/base/text.h"
#include "firmware/cli/horizon_trials.h"
#include "firmware/cli/verb_job.h"
#include "firmware/monitor/proposal.h"
#include "firmware/monitor/survey.h"
#include "firmware/plant/recording.h"
#include "firmware/twin/check_trials.h"

/* ---- two instances ---- */

/* A finding counts as one more warning. */
static void print_pair(const tl_pair_verdict *pair, uint32_t *warnings, FILE *output) {
    enum { INDENT = 2, LONGEST = sizeof pair->text + 400 };
    char text[LONGEST];
    const char *dot = pair->component[0] != '\0' ? "." : "";
    bool is_one = pair->kind == TL_PAIR_ONE_PER_PROCESS;
    if (pair->kind == TL_PAIR_UNKNOWN && pair->text[0] == '\0') {
        return;
    }
    switch (pair->kind) {
    case TL_PAIR_UNKNOWN:
        (void)snprintf(text, sizeof text, "not tested: no second instance could be started: %s", pair->text);
        break;
    case TL_PAIR_SAME:
        (void)snprintf(text, sizeof text, "two instances have the same values in %" PRIu32 " step%s", pair->steps,
                       pair->steps == 1 ? "" : "s");
        break;
    case TL_PAIR_NOT_DETERMINISTIC:
    case TL_PAIR_ONE_PER_PROCESS:
        (void)snprintf(
            text, sizeof text, "components%s%s: %s: %s; %s", dot, pair->component,
            is_one ? "one per process" : "not deterministic", pair->text,
            is_one ? "this happens only beside another instance of it: use it in one component only"
                   : "the same inputs give other values the next time, so neither replaying a run nor rollback by "
                     "replay can be exact");
        (*warnings)++;
        break;
    }
    (void)fputs("determinism\n", output);
    tl_wrapped_print(output, text, INDENT, 2 * INDENT);
}

/* ---- other rollback methods ---- */

/* If a check failed because a component cannot be rolled back exactly: logs which other rollback
 * method is exact. Errors: TL_INTERRUPTED. */
static tl_status log_other_methods(const tl_verb_job *job, const tl_component_methods *checked, tl_error *error) {
    tl_other_method found[TL_RECORDER_COMPONENTS];
    char text[TL_OTHER_METHOD_TEXT];
    const tl_twin_child_settings settings = tl_verb_job_settings(job, NULL);
    tl_status status = tl_other_method_find(&settings, checked, found, error);
    for (size_t i = 0; i < job->config.component_count && status == TL_OK; i++) {
        if (found[i].kind != TL_OTHER_METHOD_NOT_SOUGHT) {
            tl_other_method_describe(&found[i], text);
            tl_log(TL_LOG_NOTICE, "components.%.60s: %s", job->config.components[i].name, text);
        }
    }
    return status;
}

static tl_status check(tl_verb_job *job, FILE *page, tl_twin_check *found, tl_pair_verdict *pair) {
    job->order.task = TL_TASK_CHECK;
    job->order.reads_back = true;
    job->order.json = job->options->json;
    job->order.variables = job->options->variables && !job->options->json;
    tl_component_methods methods = {.rollback_inexact = 0};
    tl_status status = tl_verb_job_start(job, page);
    if (status == TL_OK) {
        status = tl_twin_child_check(job->child, found, &job->error);
        tl_twin_child_get_methods(job->child, &methods);
    }
    if (status != TL_OK && status != TL_INTERRUPTED && methods.rollback_inexact != 0) {
        tl_error interrupted; /* only used if interrupted; otherwise the error of the check stays */
        if (log_other_methods(job, &methods, &interrupted) != TL_OK) {
            status = TL_INTERRUPTED;
            job->error = interrupted;
        }
    }
    if (status == TL_OK) {
        status = tl_twin_child_wait(job->child, &job->error);
    }
    if (status == TL_OK) {
        tl_twin_child_close(job->child);
        job->child = NULL;
        const tl_twin_child_settings settings = tl_verb_job_settings(job, NULL);
        status = tl_pair_verdict_find(&settings, pair, &job->error);
    }
    return status;
}

static tl_status check_as_page(tl_verb_job *job) {
    tl_twin_check found = {.warnings = 0};
    tl_pair_verdict pair;
    tl_status status = check(job, job->output, &found, &pair);
    if (status == TL_OK) {
        print_pair(&pair, &found.warnings, job->output);
        (void)fputs(job->config.match_count != 0 ? "to compare with a recording: `replay`, `check --recording`\n" : "",
                    job->output);
        (void)fputs("no problem found", job->output);
        if (found.warnings > 0) {
            (void)fprintf(job->output, ", %" PRIu32 " warning%s", found.warnings, found.warnings == 1 ? "" : "s");
        }
        (void)fprintf(job->output, "; the plant was not asked%s\n",
                      job->config.source_count != 0 ? ": `probe` asks it" : "");
    }
    return status;
}

/* ---- as JSON ---- */

/* Prints the problems so far, also those of reading the configuration; `page`: of the FMU process.
 * `pair`: NULL if there was a problem. */
static tl_status print_json(const tl_verb_job *job, const char *page, const tl_pair_verdict *pair, tl_error *error) {
    static const char *const verdicts[] = {"unknown", "same", "not deterministic", "one per process"};
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "configuration", job->options->subject);
    tl_json_open_array(&json, "problems");
    const char *text = tl_log_kept_error(0);
    for (size_t i = 1; text != NULL; i++) {
        tl_problems_add_logged(&json, job->options->subject, text);
        text = tl_log_kept_error(i);
    }
    if (job->error.text[0] != '\0') { /* is logged at the end */
        tl_problems_add_logged(&json, job->options->subject, job->error.text);
    }
    tl_json_close(&json);
    if (pair != NULL) {
        tl_json_add_members(&json, page);
        tl_json_add_text(&json, "determinism", verdicts[pair->kind]);
        tl_json_add_text(&json, "determinism_text", pair->text);
    }
    const tl_status status = tl_json_writer_print(&json, job->output, error);
    tl_json_writer_free(&json);
    return status;
}

/* `status`: of reading the configuration. */
static tl_status check_as_json(tl_verb_job *job, tl_status status) {
    char *page = NULL;
    size_t size = 0;
    tl_twin_check found = {.warnings = 0};
    tl_pair_verdict pair;
    tl_error error;
    FILE *file = open_memstream(&page, &size);
    if (file == NULL) {
        return tl_fail(&job->error, TL_TRY_AGAIN, "not enough memory for the result");
    }
    status = status == TL_OK ? check(job, file, &found, &pair) : status;
    tl_twin_child_close(job->child); /* no more of its lines come */
    job->child = NULL;
    tl_status printed = fclose(file) == 0 ? TL_OK : tl_fail(&error, TL_TRY_AGAIN, "not enough memory for the result");
    if (printed == TL_OK) {
        printed = print_json(job, page, status == TL_OK ? &pair : NULL, &error);
    }
    free(page);
    if (printed != TL_OK) {
        job->error = error;
    }
    return printed == TL_OK ? status : printed;
}

/* ---- a recording ---- */

/* The proposal needs the noise of each matched signal. */
static tl_status check_readings(const tl_config *config, const char *path, const tl_survey *survey,
                                const tl_proposal *proposal, tl_error *error) {
    for (size_t i = 0; i < proposal->match_count; i++) {
        const tl_survey_signal *signal = &survey->signals[proposal->match[i].signal];
        if (signal->good < TL_SURVEY_LEAST) {
            return tl_fail(error, TL_BAD_DATA,
                           "%s: %s has %" PRIu64
                           " good readings (expected at least %d, to estimate its noise): take a longer recording",
                           path, config->match[i].to, signal->good, (int)TL_SURVEY_LEAST);
        }
    }
    return TL_OK;
}

static tl_status try_horizons(tl_verb_job *job, const tl_proposal_page *page, tl_horizon_choice *choice,
                              tl_error *error) {
    char *patch = NULL;
    tl_status status = tl_proposal_write_patch(page, &patch, error);
    if (status == TL_OK) {
        const tl_twin_child_settings child = tl_verb_job_settings(job, NULL);
        const tl_horizon_trials_settings settings = {
            .child = &child, .recording = page->recording, .run = (int64_t)job->options->run, .patch = patch};
        status = tl_horizon_trials_run(&settings, choice, error);
    }
    free(patch);
    return status;
}

static tl_status check_recording(tl_verb_job *job) {
    const tl_config *config = &job->config;
    tl_error *error = &job->error;
    char path[PATH_MAX];
    tl_survey survey = {.count = 0};
    tl_proposal proposal;
    tl_horizon_choice choice;
    tl_proposal_page page = {.config = config, .recording = path, .survey = &survey, .proposal = &proposal};
    tl_recording *recording = NULL;
    job->config.recording_run = (int64_t)job->options->run;
    tl_status status = tl_options_find_recording(job->options, config, path, error);
    status = status == TL_OK ? tl_recording_open(path, config, &recording, error) : status;
    if (status == TL_OK) {
        tl_recording_log_form(recording);
        status = tl_survey_take(recording, config, &survey, error);
    }
    tl_recording_close(recording);
    if (status == TL_OK) {
        tl_proposal_make(config, &survey, &proposal);
        status = check_readings(config, path, &survey, &proposal, error);
    }
    status = status == TL_OK ? try_horizons(job, &page, &choice, error) : status;
    if (status == TL_OK) {
        page.choice = &choice;
        status = job->options->json ? tl_proposal_print_json(&page, job->output, error)
                                    : tl_proposal_print_page(&page, job->output, error);
    }
    tl_survey_free(&survey);
    return status;
}

int tl_verb_check(const tl_options *options) {
    const bool is_json = options->json && options->recording == NULL;
    tl_verb_job job = {.options = options, .output = tl_output_claim(), .counts_problems = !is_json};
    if (is_json) {
        tl_log_keep_errors();
    }
    tl_status status = tl_verb_job_read(&job, options->subject, NULL);
    if (is_json) {
        status = check_as_json(&job, status);
    } else if (status == TL_OK) {
        status = options->recording != NULL ? check_recording(&job) : check_as_page(&job);
    }
    return tl_verb_job_end(&job, status);
}
