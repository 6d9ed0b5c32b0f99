/* The validator: see validator.h. */
#include "firmware/retune/validator.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/config/config.h"
#include "firmware/config/config_change.h"
#include "firmware/config/problems.h"
#include "firmware/monitor/lock_judge.h"
#include "firmware/process/confine.h"
#include "firmware/retune/errand.h"
#include "firmware/retune/trial.h"

/* ---- what is wrong ---- */

static void add_problem(void *context, tl_status status, const char *where, const char *text) {
    (void)status;
    tl_verdict *verdict = context;
    uint32_t number = verdict->problems++;
    if (number < TL_VERDICT_PROBLEMS) {
        tl_control_problem *problem = &verdict->problem[number];
        problem->line = (uint32_t)tl_problems_take_line(&text);
        (void)snprintf(problem->path, sizeof problem->path, "%s", where);
        (void)snprintf(problem->text, sizeof problem->text, "%s", text);
    }
}

/* ---- what changes ---- */

static void add_change(tl_verdict *verdict, const tl_config_edit *edit) {
    tl_control_change *change = &verdict->change[verdict->changes++];
    (void)snprintf(change->path, sizeof change->path, "%s", edit->path);
    (void)snprintf(change->before, sizeof change->before, "%.*s", (int)sizeof change->before - 1, edit->before);
    (void)snprintf(change->after, sizeof change->after, "%.*s", (int)sizeof change->after - 1, edit->after);
    (void)snprintf(change->kind, sizeof change->kind, "%s", tl_change_kinds[edit->needs.kind]);
    (void)snprintf(change->right, sizeof change->right, "%s", tl_change_rights[edit->needs.right]);
}

/* ---- what only somebody on the box may give ---- */

static void add_barred(tl_verdict *verdict, const tl_config_barred *barred, const char *list) {
    char text[TL_CONTROL_TEXT];
    if (barred->is_installed) {
        (void)snprintf(text, sizeof text,
                       "found %s without its hash, expected \"sha256\" beside it, as sha256sum prints it on the box",
                       barred->found);
    } else if (barred->names == TL_NAMES_FMU) {
        (void)snprintf(text, sizeof text,
                       "found %s, expected the name of an FMU that is installed, without a folder, and its \"sha256\"",
                       barred->found);
    } else if (barred->names != TL_NAMES_NOTHING && list[0] != '\0') {
        (void)snprintf(
            text, sizeof text,
            "found %s, expected a name that the active configuration, its file on the box or %.300s has: let "
            "root add there the line: %s NAME",
            barred->found, list, barred->names == TL_NAMES_FILE ? "file" : "library");
    } else {
        (void)snprintf(text, sizeof text,
                       "found %s, expected nothing: it is changed on the box, by twinlock reload without --right",
                       barred->found);
    }
    add_problem(verdict, TL_BAD_DATA, barred->path, text);
}

static void add_all_barred(tl_verdict *verdict, const tl_config_change *change, const char *list) {
    for (size_t i = 0; i < change->barred && i < TL_CONFIG_BARRED; i++) {
        add_barred(verdict, &change->bar[i], list);
    }
    verdict->problems = (uint32_t)change->barred;
}

/* What the active one names is no news; that of a broken file on the box is not known. */
static tl_status find_allowed(const tl_errand_job *job, tl_allowed_names *allowed, tl_error *error) {
    tl_error ignored = {.status = TL_OK};
    tl_status status = tl_allowed_names_add_list(allowed, job->list, error);
    if (status == TL_OK) {
        status = tl_allowed_names_add_configuration(allowed, job->in_force, error);
    }
    (void)tl_allowed_names_add_configuration(allowed, job->on_the_box, &ignored);
    return status;
}

static tl_status find_change(const tl_errand_job *job, tl_verdict *verdict, tl_error *error) {
    static tl_config_change change;
    tl_allowed_names allowed = {.count = 0};
    if (job->in_force[0] == '\0') {
        verdict->kind = TL_CHANGE_RESTART;
        verdict->right = TL_RIGHT_COMMISSION;
        return TL_OK;
    }
    tl_status status = find_allowed(job, &allowed, error);
    if (status == TL_OK) {
        status = tl_config_change_find(job->in_force, strlen(job->in_force), job->candidate, strlen(job->candidate),
                                       &allowed, &change, error);
    }
    tl_allowed_names_free(&allowed);
    if (status != TL_OK) {
        return status;
    }
    verdict->kind = change.needs.kind;
    verdict->right = change.needs.right;
    for (size_t i = 0; i < change.listed && i < TL_VERDICT_CHANGES; i++) {
        add_change(verdict, &change.edits[i]);
    }
    verdict->changes = (uint32_t)change.count;
    add_all_barred(verdict, &change, job->list_path);
    return TL_OK;
}

/* ---- what its lock is judged by ---- */

static void pass_over(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    (void)where;
    (void)text;
}

/* Another configuration of this plant. False: it cannot be read. */
static bool read_other(const tl_errand_job *job, const char *text, tl_config *config) {
    tl_report report = {.add = pass_over};
    const char *found = text[0] == '\0' ? job->in_force : text;
    return found[0] != '\0' && tl_config_read_text(job->path, found, strlen(found), config, &report) == TL_OK;
}

/* The same output, compared with the same signal; SIZE_MAX: there is none. */
static size_t find_match(const tl_config *config, const tl_plan_match *match) {
    for (size_t i = 0; i < config->match_count; i++) {
        if (strcmp(config->match[i].variable, match->variable) == 0 && strcmp(config->match[i].to, match->to) == 0) {
            return i;
        }
    }
    return SIZE_MAX;
}

/* The largest error of this output alone that is called in lock (lock_judge.h): its tolerance, if nothing else has a weight. */
static double largest_error(const tl_config *config, size_t match) {
    double weights = 0.0;
    for (size_t i = 0; i < config->match_count; i++) {
        weights += config->match[i].weight;
    }
    bool counts = match != SIZE_MAX && config->match[match].weight > 0.0;
    return counts ? config->match[match].tolerance * sqrt(fmax(weights, 1.0) / config->match[match].weight) : HUGE_VAL;
}

static bool is_wider(double now, double before, double times) {
    const double rounding = 1e-9;
    return !(now <= times * before * (1.0 + rounding));
}

static void write_widened(const tl_plan_match *before, const tl_plan_match *now, char text[TL_VERDICT_WIDENED]) {
    bool by_tolerance = now->tolerance > before->tolerance;
    (void)snprintf(text, TL_VERDICT_WIDENED, "%.60s: %s %.6g → %.6g", now->variable,
                   by_tolerance ? "tolerance" : "weight", by_tolerance ? before->tolerance : before->weight,
                   by_tolerance ? now->tolerance : now->weight);
}

/* That of the version before, in the candidate's order. */
static void find_yardstick(const tl_config *before, const tl_config *now, tl_verdict *verdict) {
    for (size_t i = 0; i < now->match_count; i++) {
        size_t at = find_match(before, &now->match[i]);
        if (at == SIZE_MAX) {
            continue;
        }
        const tl_plan_match *match = &before->match[at];
        verdict->yardstick.match[i].tolerance = match->tolerance;
        verdict->yardstick.match[i].weight = match->weight;
        bool is_first = match->weight > 0.0 && verdict->widened[0] == '\0';
        if (is_first && is_wider(largest_error(now, i), largest_error(before, at), 1.0)) {
            write_widened(match, &now->match[i], verdict->widened);
        }
    }
}

/* An output for which the right to commission is needed. */
static void add_wide(tl_verdict *verdict, const tl_plan_match *match, double found, double most) {
    char path[TL_JSON_PATH];
    char text[TL_CONTROL_TEXT];
    (void)snprintf(path, sizeof path, "synchronise.match.%.100s", match->variable);
    if (isfinite(found)) {
        (void)snprintf(text, sizeof text,
                       "found an error of %.6g that is in lock, expected at most %.6g, which is %d times what was "
                       "commissioned last: more takes the right to commission",
                       found, most, (int)TL_VALIDATOR_WIDEST);
    } else {
        (void)snprintf(text, sizeof text,
                       "found no match with %.100s that has an effect, expected that of the version that was "
                       "commissioned last: to leave it out takes the right to commission",
                       match->to);
    }
    add_problem(verdict, TL_BAD_DATA, path, text);
    verdict->right = TL_RIGHT_COMMISSION;
}

/* Whatever the version matches that was commissioned last stays matched, and is not judged much less strictly; else it takes the right to commission. */
static void limit_widening(const tl_config *commissioned, const tl_config *now, tl_verdict *verdict) {
    for (size_t i = 0; i < commissioned->match_count && verdict->right != TL_RIGHT_BOX; i++) {
        const tl_plan_match *match = &commissioned->match[i];
        double limit = largest_error(commissioned, i);
        double found = largest_error(now, find_match(now, match));
        if (match->weight > 0.0 && is_wider(found, limit, TL_VALIDATOR_WIDEST)) {
            add_wide(verdict, match, found, TL_VALIDATOR_WIDEST * limit);
        }
    }
}

static void judge_yardstick(const tl_errand_job *job, const tl_config *candidate, tl_verdict *verdict) {
    static tl_config other;
    if (read_other(job, job->kept, &other)) {
        find_yardstick(&other, candidate, verdict);
        tl_config_free(&other);
    }
    if (read_other(job, job->commissioned, &other)) {
        limit_widening(&other, candidate, verdict);
        tl_config_free(&other);
    }
}

/* ---- the process ---- */

static tl_status confine(tl_error *error) {
    tl_confine_facts facts;
    const tl_confine_settings settings = {.start_socket = -1, .whole_process = true, .lives_on = true};
    return tl_confine(&settings, &facts, NULL, error);
}

static tl_status judge(const tl_errand_job *job, tl_verdict *verdict, tl_error *error) {
    tl_config config;
    tl_report report = {.add = add_problem, .context = verdict};
    tl_status status = tl_config_read_text(job->path, job->candidate, strlen(job->candidate), &config, &report);
    if (status != TL_OK) {
        return status == TL_BAD_DATA ? TL_OK : tl_fail(error, status, "the configuration could not be read");
    }
    (void)snprintf(verdict->name, sizeof verdict->name, "%s", config.name);
    tl_config_tuning(&config, &verdict->tuning);
    const tl_lock_window window = tl_lock_judge_window(&config);
    verdict->strokes = window.strokes;
    verdict->window = window.time;
    status = find_change(job, verdict, error);
    if (status == TL_OK) {
        judge_yardstick(job, &config, verdict);
    }
    tl_config_free(&config);
    verdict->is_valid = status == TL_OK ? 1 : 0;
    return status;
}

int tl_validator_role_run(void) {
    tl_errand_job job;
    tl_error error;
    void *answer = NULL;
    tl_status status = tl_errand_begin(&job, &error);
    if (status == TL_OK) {
        status = tl_errand_take_answer(sizeof(tl_verdict), &answer, &error);
    }
    if (status == TL_OK) {
        status = confine(&error);
    }
    if (status == TL_OK) {
        status = judge(&job, answer, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    __atomic_store_n(&((tl_verdict *)answer)->is_there, 1, __ATOMIC_RELEASE);
    return 0;
}
