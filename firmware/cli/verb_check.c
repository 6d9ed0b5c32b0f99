/* twinlock check: validates everything without running. */
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/base/log.h"
#include "firmware/base/output.h"
#include "firmware/base/text.h"
#include "firmware/cli/verb_job.h"
#include "firmware/monitor/proposal.h"
#include "firmware/monitor/survey.h"
#include "firmware/plant/recording.h"
#include "firmware/twin/check_trials.h"

/* ---- two instances ---- */

/* What was found counts as one warning more. */
static void print_pair(const tl_pair_verdict *pair, uint32_t *warnings, FILE *output) {
    enum { INDENT = 2, LONGEST = sizeof pair->text + 400 };
    char text[LONGEST];
    const char *where = pair->component[0] != '\0' ? "." : "";
    if (pair->kind == TL_PAIR_UNKNOWN && pair->text[0] == '\0') {
        return;
    }
    switch (pair->kind) {
    case TL_PAIR_UNKNOWN:
        (void)snprintf(text, sizeof text, "not looked at, since there is no second instance here: %s", pair->text);
        break;
    case TL_PAIR_SAME:
        (void)snprintf(text, sizeof text, "two instances have the same values in %" PRIu32 " step%s", pair->steps,
                       pair->steps == 1 ? "" : "s");
        break;
    case TL_PAIR_NOT_DETERMINISTIC:
        (void)snprintf(
            text, sizeof text,
            "components%s%s: not deterministic: %s; what it was given leads it elsewhere the next time, so that "
            "neither replaying a run nor rolling back by replay can be exact",
            where, pair->component, pair->text);
        (*warnings)++;
        break;
    case TL_PAIR_ONE_PER_PROCESS:
        (void)snprintf(
            text, sizeof text,
            "components%s%s: one per process: %s; alone it does not do so, but beside another instance of it: use it "
            "in one component only",
            where, pair->component, pair->text);
        (*warnings)++;
        break;
    }
    (void)fputs("determinism\n", output);
    tl_wrapped_print(output, text, INDENT, 2 * INDENT);
}

static tl_status compare_pair(tl_verb_job *job, uint32_t *warnings, tl_error *error) {
    tl_pair_verdict pair;
    const tl_twin_child_settings settings = tl_verb_job_settings(job, &job->config, NULL);
    tl_status status = tl_pair_verdict_find(&settings, &pair, error);
    if (status == TL_OK) {
        print_pair(&pair, warnings, job->output);
    }
    return status;
}

/* ---- other rollback methods ---- */

/* For a check that has failed because a component does not come back: logs which other method is exact. Errors: TL_INTERRUPTED. */
static tl_status log_other_ways(const tl_verb_job *job, const tl_twin_ways *checked, tl_error *error) {
    tl_other_way found[TL_RECORDER_COMPONENTS];
    char text[TL_OTHER_WAY_TEXT];
    const tl_twin_child_settings settings = tl_verb_job_settings(job, &job->config, NULL);
    tl_status status = tl_other_way_find(&settings, checked, found, error);
    for (size_t i = 0; i < job->config.component_count && status == TL_OK; i++) {
        if (found[i].kind != TL_OTHER_WAY_NOT_SOUGHT) {
            tl_other_way_tell(&found[i], text);
            tl_log(TL_LOG_NOTICE, "components.%.60s: %s", job->config.components[i].name, text);
        }
    }
    return status;
}

static tl_status check(tl_verb_job *job) {
    tl_error error = {TL_OK, ""};
    job->order.task = TL_TASK_CHECK;
    job->order.reads_back = true;
    job->order.variables = job->options->variables;
    tl_twin_check found = {.warnings = 0};
    tl_twin_ways ways = {.cannot_return = 0};
    tl_status status = tl_verb_job_start(job, &job->config, job->output, &error);
    if (status == TL_OK) {
        status = tl_twin_child_check(job->child, &found, &error);
        tl_twin_child_ways(job->child, &ways);
    }
    if (status != TL_OK && status != TL_INTERRUPTED && ways.cannot_return != 0) {
        tl_error interrupted; /* else the error of the check stays */
        if (log_other_ways(job, &ways, &interrupted) != TL_OK) {
            status = TL_INTERRUPTED;
            error = interrupted;
        }
    }
    if (status == TL_OK) {
        status = tl_twin_child_wait(job->child, &error);
    }
    if (status == TL_OK) {
        tl_twin_child_close(job->child);
        job->child = NULL;
        status = compare_pair(job, &found.warnings, &error);
    }
    if (status == TL_OK) {
        (void)fputs("no problem found", job->output);
        if (found.warnings > 0) {
            (void)fprintf(job->output, ", %" PRIu32 " warning%s", found.warnings, found.warnings == 1 ? "" : "s");
        }
        (void)fputc('\n', job->output);
    }
    if (error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return status;
}

/* ---- a recording ---- */

/* Of what is matched the noise has to be known, or nothing can be said. */
static tl_status check_readings(const tl_config *config, const char *path, const tl_survey *survey,
                                const tl_proposal *proposal, tl_error *error) {
    for (size_t i = 0; i < proposal->match_count; i++) {
        const tl_survey_signal *signal = &survey->signals[proposal->match[i].signal];
        if (signal->good < TL_SURVEY_LEAST) {
            return tl_fail(error, TL_BAD_DATA,
                           "%s: %s has %" PRIu64 " good readings, at least %d are needed to tell its noise", path,
                           config->match[i].to, signal->good, (int)TL_SURVEY_LEAST);
        }
    }
    return TL_OK;
}

static tl_status propose(const tl_verb_job *job, const char *path, tl_survey *survey, tl_proposal *proposal,
                         tl_error *error) {
    tl_recording *recording = NULL;
    tl_status status = tl_recording_open(path, &job->config, &recording, error);
    if (status == TL_OK) {
        status = tl_survey_take(recording, &job->config, survey, error);
    }
    tl_recording_close(recording);
    if (status == TL_OK) {
        tl_proposal_make(&job->config, survey, proposal);
        status = check_readings(&job->config, path, survey, proposal, error);
    }
    if (status == TL_OK) {
        status = job->options->json ? tl_proposal_print_json(&job->config, path, survey, proposal, job->output, error)
                                    : tl_proposal_print_page(&job->config, path, survey, proposal, job->output, error);
    }
    return status;
}

static tl_status check_recording(tl_verb_job *job) {
    char path[PATH_MAX];
    tl_error error = {TL_OK, ""};
    tl_survey *survey = calloc(1, sizeof *survey);
    tl_proposal *proposal = calloc(1, sizeof *proposal);
    job->config.recording_run = (int64_t)job->options->run;
    tl_status status = survey == NULL || proposal == NULL
                           ? tl_fail(&error, TL_TRY_AGAIN, "not enough memory")
                           : tl_options_find_recording(job->options, &job->config, path, &error);
    if (status == TL_OK) {
        status = propose(job, path, survey, proposal, &error);
    }
    if (error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    if (survey != NULL) {
        tl_survey_free(survey);
    }
    free(survey);
    free(proposal);
    return status;
}

int tl_verb_check(const tl_options *options) {
    tl_verb_job job = {.options = options, .output = tl_output_claim(), .counts_problems = true};
    tl_status status = tl_verb_job_read(&job);
    if (status == TL_OK) {
        status = options->recording != NULL ? check_recording(&job) : check(&job);
    }
    return tl_verb_job_end(&job, status);
}
