/* Workers: see worker.h. */
#include "firmware/retune/worker.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/config/config_change.h"
#include "firmware/monitor/lock_monitor.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/confine.h"
#include "firmware/process/interrupt.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_process.h"
#include "master/base/signal.h"

/* Descriptors of the process after 0 to 2. */
enum { JOB = 3, RESULT = 4 };

/* ---- start ---- */

/* The block contains the job, and then its texts with a NUL each. */
static tl_status pack_job(const tl_worker_job *job, tl_block *block, tl_error *error) {
    char *bytes = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&bytes, &size);
    if (file == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration");
    }
    tl_worker_job plain = *job;
    memset(plain.text, 0, sizeof plain.text); /* addresses of this process must not leak */
    (void)fwrite(&plain, sizeof plain, 1, file);
    for (size_t i = 0; i < TL_WORKER_TEXTS; i++) {
        const char *text = job->text[i] == NULL ? "" : job->text[i];
        (void)fwrite(text, 1, strlen(text) + 1, file);
    }
    bool is_written = ferror(file) == 0;
    is_written = fclose(file) == 0 && is_written;
    tl_status status = is_written ? tl_block_make_of("twinlock job", bytes, size, block, error)
                                  : tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration");
    free(bytes);
    return status;
}

/* Its output is a pipe, which ends when the process ends. */
static tl_status start_process(tl_worker *worker, const tl_worker_settings *settings, const tl_block *job,
                               tl_error *error) {
    static const char *const kinds[TL_WORKERS] = {"validator", "trial", "states"};
    char title[TL_ROLE_TITLE];
    int output[2] = {-1, -1};
    (void)snprintf(title, sizeof title, TL_WORKER ": %s [%s]", kinds[settings->job.kind], settings->plant);
    int nothing = open("/dev/null", O_RDWR | O_CLOEXEC);
    if (nothing < 0 || pipe2(output, O_CLOEXEC) != 0) {
        tl_status status = tl_fail(error, TL_TRY_AGAIN, "cannot create a pipe for \"%s\": %s", title, strerror(errno));
        if (nothing >= 0) {
            (void)close(nothing);
        }
        return status;
    }
    tl_role_settings role = {.title = title, .fallback = settings->run_role, .context = settings->context};
    memset(role.descriptors, -1, sizeof role.descriptors);
    role.descriptors[0] = nothing;
    role.descriptors[1] = output[1];
    role.descriptors[2] = output[1];
    role.descriptors[JOB] = job->descriptor;
    role.descriptors[RESULT] = worker->result.descriptor;
    tl_status status = tl_role_start(&role, &worker->role, error);
    (void)close(nothing);
    (void)close(output[1]);
    if (status == TL_OK) {
        tl_relay_open(&worker->relay, output[0], settings->on_event, settings->context);
    } else {
        (void)close(output[0]);
    }
    return status;
}

tl_status tl_worker_start(tl_worker *worker, const tl_worker_settings *settings, tl_error *error) {
    tl_block job = {.descriptor = -1};
    *worker = (tl_worker){.result = {.descriptor = -1}, .until = tl_clock_now(NULL) + settings->limit};
    tl_status status = pack_job(&settings->job, &job, error);
    if (status == TL_OK) {
        status =
            tl_block_make("twinlock result", sizeof(tl_worker_result), TL_BLOCK_THEY_WRITE, &worker->result, error);
    }
    if (status == TL_OK) {
        status = start_process(worker, settings, &job, error);
    }
    tl_block_close(&job);
    worker->is_started = status == TL_OK;
    if (status != TL_OK) {
        tl_block_close(&worker->result);
    }
    return status;
}

/* ---- end ---- */

tl_worker_state tl_worker_poll(tl_worker *worker) {
    bool has_ended = tl_role_watch(&worker->role);
    (void)tl_relay_drain(&worker->relay);
    if (!has_ended && tl_clock_now(NULL) <= worker->until) {
        return TL_WORKER_RUNNING;
    }
    if (!has_ended) {
        worker->is_late = true;
        tl_role_kill(&worker->role);
        (void)snprintf(worker->reason, TL_WORKER_REASON, "it exceeded its time limit and was ended");
    } else if (worker->role.signal != 0) {
        (void)snprintf(worker->reason, TL_WORKER_REASON, "its process was ended by signal %d (%s)", worker->role.signal,
                       strsignal(worker->role.signal));
    } else if (worker->role.code != 0) {
        (void)snprintf(worker->reason, TL_WORKER_REASON, "its process ended with exit code %d", worker->role.code);
    }
    return worker->reason[0] == '\0' ? TL_WORKER_DONE : TL_WORKER_FAILED;
}

void tl_worker_close(tl_worker *worker) {
    if (worker->is_started) {
        tl_role_kill(&worker->role);
        (void)tl_relay_drain(&worker->relay);
        tl_relay_close(&worker->relay);
        tl_block_close(&worker->result);
        worker->is_started = false;
    }
}

/* ---- reading a result ---- */

static bool is_complete(const tl_worker_result *result) {
    return __atomic_load_n(&result->is_complete, __ATOMIC_ACQUIRE) == 1;
}

bool tl_verdict_take(const tl_worker_result *from, tl_verdict *verdict) {
    bool is_sound = is_complete(from);
    memcpy(verdict, &from->verdict, sizeof *verdict);
    is_sound = is_sound && verdict->is_valid <= 1 && verdict->kind < TL_CHANGE_KINDS && verdict->right < TL_RIGHTS &&
               tl_lock_tolerances_is_sound(&verdict->tolerances) && verdict->window >= 0 &&
               verdict->window <= TL_VERDICT_LONGEST;
    tl_clean_field(verdict->widened, sizeof verdict->widened);
    for (size_t i = 0; i < TL_VERDICT_PROBLEMS; i++) {
        tl_clean_field(verdict->problem[i].path, sizeof verdict->problem[i].path);
        tl_clean_field(verdict->problem[i].text, sizeof verdict->problem[i].text);
    }
    for (size_t i = 0; i < TL_VERDICT_CHANGES; i++) {
        tl_control_change *change = &verdict->change[i];
        tl_clean_field(change->path, sizeof change->path);
        tl_clean_field(change->before, sizeof change->before);
        tl_clean_field(change->after, sizeof change->after);
        tl_clean_field(change->kind, sizeof change->kind);
        tl_clean_field(change->right, sizeof change->right);
    }
    is_sound = is_sound && (verdict->is_valid == 0 ||
                            (verdict->right >= TL_RIGHT_RETUNE && tl_tuning_check(&verdict->tuning, NULL) == TL_OK));
    if (!is_sound) {
        memset(verdict, 0, sizeof *verdict);
    }
    return is_sound;
}

bool tl_trial_answer_take(const tl_worker_result *from, tl_trial_answer *answer) {
    static const uint64_t most = (uint64_t)1 << 50; /* bytes: more than any box has */
    bool is_there = is_complete(from);
    memcpy(answer, &from->trial, sizeof *answer);
    const tl_live_needs *needs = &answer->needs;
    return is_there && needs->match <= TL_MAX_MATCH && needs->adjust <= TL_MAX_ADJUST &&
           needs->components < TL_RECORDER_COMPONENTS && needs->unconfined <= 1 && needs->signals >= 1 &&
           needs->signals <= TL_MAX_SIGNALS && needs->unpacked_bytes <= most && answer->memory <= most &&
           answer->step > 0 && answer->budget >= 0 && answer->least >= 0 && answer->worst >= 0;
}

bool tl_worker_read_reason(const tl_worker_result *from, char why[TL_TWIN_CHECK_WHY]) {
    bool is_there = is_complete(from);
    memcpy(why, from->why, TL_TWIN_CHECK_WHY);
    tl_clean_field(why, TL_TWIN_CHECK_WHY);
    return is_there;
}

/* ---- in the process ---- */

tl_status tl_worker_begin(tl_worker_job *job, tl_error *error) {
    static tl_block block; /* as long as the process */
    tl_log_use_levels();
    tl_role_enter();
    tl_locale_use();
    tl_interrupt_install();
    tl_status status = tl_block_take(JOB, 0, TL_BLOCK_IS_WRITTEN, &block, error);
    if (status != TL_OK) {
        return status;
    }
    const char *at = block.bytes;
    const char *const end = at + block.size;
    bool fits = block.size > sizeof *job;
    if (fits) {
        memcpy(job, at, sizeof *job);
        at += sizeof *job;
    }
    for (size_t i = 0; i < TL_WORKER_TEXTS && fits; i++) {
        size_t length = strnlen(at, (size_t)(end - at));
        job->text[i] = at;
        fits = length < (size_t)(end - at);
        at += length + 1;
    }
    if (!fits || at != end) {
        (void)tl_fail(error, TL_BAD_DATA, "the worker has received an invalid job");
        return TL_BAD_DATA;
    }
    return TL_OK;
}

tl_status tl_worker_open_result(tl_worker_result **result, tl_error *error) {
    static tl_block block;
    tl_status status = tl_block_take(RESULT, sizeof **result, TL_BLOCK_THEY_WRITE, &block, error);
    *result = block.bytes;
    return status;
}

static void set_complete(tl_worker_result *result) {
    __atomic_store_n(&result->is_complete, 1, __ATOMIC_RELEASE);
}

/* ---- problems ---- */

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

/* ---- changes ---- */

static void write_change(const tl_config_edit *edit, tl_control_change *change) {
    (void)snprintf(change->path, sizeof change->path, "%s", edit->path);
    (void)snprintf(change->before, sizeof change->before, "%.*s", (int)sizeof change->before - 1, edit->before);
    (void)snprintf(change->after, sizeof change->after, "%.*s", (int)sizeof change->after - 1, edit->after);
    (void)snprintf(change->kind, sizeof change->kind, "%s", tl_change_kinds[edit->needs.kind]);
    (void)snprintf(change->right, sizeof change->right, "%s", tl_change_rights[edit->needs.right]);
}

/* ---- names that only an administrator of the box may allow ---- */

static void report_privileged(tl_verdict *verdict, const tl_config_privileged *privileged, const char *list) {
    char text[TL_CONTROL_TEXT];
    if (privileged->lacks_hash) {
        (void)snprintf(text, sizeof text,
                       "found %s without its hash, expected \"sha256\" beside it (on the box: sha256sum FILE)",
                       privileged->found);
    } else if (privileged->names == TL_NAMES_FMU) {
        (void)snprintf(text, sizeof text,
                       "found %s, expected the name of an installed FMU, without a folder, and its \"sha256\"",
                       privileged->found);
    } else if (privileged->names != TL_NAMES_NOTHING && list[0] != '\0') {
        (void)snprintf(
            text, sizeof text,
            "found %s, expected a name in the active configuration, in its file on the box or in %.300s: root can "
            "add the line there: %s NAME",
            privileged->found, list, privileged->names == TL_NAMES_FILE ? "file" : "library");
    } else {
        (void)snprintf(text, sizeof text,
                       "found %s, expected no such key: change it on the box, with `twinlock reload` without --right",
                       privileged->found);
    }
    add_problem(verdict, TL_BAD_DATA, privileged->path, text);
}

/* The active configuration's names are allowed. If the file on the box is invalid, its names are
 * not. */
static tl_status find_allowed(const tl_worker_job *job, tl_allowed_names *allowed, tl_error *error) {
    tl_error ignored = {.status = TL_OK};
    tl_status status = tl_allowed_names_add_list(allowed, job->text[TL_WORKER_LIST], error);
    if (status == TL_OK) {
        status = tl_allowed_names_add_configuration(allowed, job->text[TL_WORKER_ACTIVE], error);
    }
    (void)tl_allowed_names_add_configuration(allowed, job->text[TL_WORKER_BOX_FILE], &ignored);
    return status;
}

static tl_status find_change(const tl_worker_job *job, tl_verdict *verdict, tl_error *error) {
    static tl_config_change change;
    const char *active_text = job->text[TL_WORKER_ACTIVE];
    const char *candidate = job->text[TL_WORKER_CANDIDATE];
    tl_allowed_names allowed = {.count = 0};
    if (active_text[0] == '\0') {
        verdict->kind = TL_CHANGE_RESTART;
        verdict->right = TL_RIGHT_COMMISSION;
        return TL_OK;
    }
    tl_status status = find_allowed(job, &allowed, error);
    if (status == TL_OK) {
        status = tl_config_change_find(active_text, strlen(active_text), candidate, strlen(candidate), &allowed,
                                       &change, error);
    }
    tl_allowed_names_free(&allowed);
    if (status != TL_OK) {
        return status;
    }
    verdict->kind = change.needs.kind;
    verdict->right = change.needs.right;
    for (size_t i = 0; i < change.listed && i < TL_VERDICT_CHANGES; i++) {
        write_change(&change.edits[i], &verdict->change[i]);
    }
    verdict->changes = (uint32_t)change.count;
    for (size_t i = 0; i < change.privileged_count && i < TL_CONFIG_PRIVILEGED; i++) {
        report_privileged(verdict, &change.privileged[i], job->text[TL_WORKER_LIST_PATH]);
    }
    verdict->problems = (uint32_t)change.privileged_count;
    return TL_OK;
}

/* ---- tolerances of the lock ---- */

/* Reads another configuration of this plant. Returns false if that fails. */
static bool read_other(const tl_worker_job *job, tl_worker_text which, tl_config *config) {
    tl_report report = {.add = NULL};
    const char *text = job->text[job->text[which][0] == '\0' ? TL_WORKER_ACTIVE : which];
    return text[0] != '\0' &&
           tl_config_read_text(job->text[TL_WORKER_PATH], text, strlen(text), config, &report) == TL_OK;
}

/* Returns the match of the same output with the same signal, or NULL. */
static const tl_plan_match *find_match(const tl_config *config, const tl_plan_match *match) {
    for (size_t i = 0; i < config->match_count; i++) {
        if (strcmp(config->match[i].variable, match->variable) == 0 && strcmp(config->match[i].to, match->to) == 0) {
            return &config->match[i];
        }
    }
    return NULL;
}

/* Returns the largest error of this output that is still in lock, if all other errors are 0
 * (lock_monitor.h). If no other output has a weight, that is its tolerance. */
static double largest_error(const tl_config *config, const tl_plan_match *match) {
    double weights = 0.0;
    for (size_t i = 0; i < config->match_count; i++) {
        weights += config->match[i].weight;
    }
    return match != NULL && match->weight > 0.0 ? match->tolerance * sqrt(fmax(weights, 1.0) / match->weight)
                                                : HUGE_VAL;
}

static bool is_wider(double now, double before, double times) {
    const double rounding = 1e-9;
    return !(now <= times * before * (1.0 + rounding));
}

/* Copies the tolerances of the version before, in the order of the candidate's outputs. */
static void find_tolerances(const tl_config *before, const tl_config *now, tl_verdict *verdict) {
    for (size_t i = 0; i < now->match_count; i++) {
        const tl_plan_match *new = &now->match[i];
        const tl_plan_match *old = find_match(before, new);
        if (old == NULL) {
            continue;
        }
        verdict->tolerances.match[i].tolerance = old->tolerance;
        verdict->tolerances.match[i].weight = old->weight;
        bool is_first = old->weight > 0.0 && verdict->widened[0] == '\0';
        if (is_first && is_wider(largest_error(now, new), largest_error(before, old), 1.0)) {
            bool by_tolerance = new->tolerance > old->tolerance;
            (void)snprintf(verdict->widened, sizeof verdict->widened, "%.60s: %s %.6g → %.6g", new->variable,
                           by_tolerance ? "tolerance" : "weight", by_tolerance ? old->tolerance : old->weight,
                           by_tolerance ? new->tolerance : new->weight);
        }
    }
}

/* Reports an output for which the right to commission is needed. */
static void report_widening(tl_verdict *verdict, const tl_plan_match *match, double found, double most) {
    char path[TL_JSON_PATH];
    char text[TL_CONTROL_TEXT];
    (void)snprintf(path, sizeof path, "synchronise.match.%.100s", match->variable);
    if (isfinite(found)) {
        (void)snprintf(text, sizeof text,
                       "found a tolerated error of %.6g, expected at most %.6g, %d times the commissioned one: more "
                       "needs the right commission",
                       found, most, (int)TL_VERDICT_WIDEST);
    } else {
        (void)snprintf(text, sizeof text,
                       "found no match with %.100s with an effect, expected the commissioned one: removing it needs "
                       "the right commission",
                       match->to);
    }
    add_problem(verdict, TL_BAD_DATA, path, text);
    verdict->right = TL_RIGHT_COMMISSION;
}

/* Each output of the version commissioned last must stay matched, and its largest error must not
 * grow by more than TL_VERDICT_WIDEST. Else the right to commission is needed. */
static void limit_widening(const tl_config *commissioned, const tl_config *now, tl_verdict *verdict) {
    for (size_t i = 0; i < commissioned->match_count && verdict->right != TL_RIGHT_BOX; i++) {
        const tl_plan_match *match = &commissioned->match[i];
        double limit = largest_error(commissioned, match);
        double found = largest_error(now, find_match(now, match));
        if (match->weight > 0.0 && is_wider(found, limit, TL_VERDICT_WIDEST)) {
            report_widening(verdict, match, found, TL_VERDICT_WIDEST * limit);
        }
    }
}

static void check_tolerances(const tl_worker_job *job, const tl_config *candidate, tl_verdict *verdict) {
    static tl_config other;
    if (read_other(job, TL_WORKER_KEPT, &other)) {
        find_tolerances(&other, candidate, verdict);
        tl_config_free(&other);
    }
    if (read_other(job, TL_WORKER_COMMISSIONED, &other)) {
        limit_widening(&other, candidate, verdict);
        tl_config_free(&other);
    }
}

/* ---- validator ---- */

static tl_status check_candidate(const tl_worker_job *job, tl_verdict *verdict, tl_error *error) {
    tl_config config;
    tl_report report = {.add = add_problem, .context = verdict};
    const char *text = job->text[TL_WORKER_CANDIDATE];
    tl_status status = tl_config_read_text(job->text[TL_WORKER_PATH], text, strlen(text), &config, &report);
    if (status != TL_OK) {
        return status == TL_BAD_DATA ? TL_OK : tl_fail(error, status, "the configuration could not be read");
    }
    tl_config_tuning(&config, &verdict->tuning);
    const tl_lock_window window = tl_lock_monitor_window(&config);
    verdict->strokes = window.strokes;
    verdict->window = window.time;
    status = find_change(job, verdict, error);
    if (status == TL_OK) {
        check_tolerances(job, &config, verdict);
    }
    tl_config_free(&config);
    verdict->is_valid = status == TL_OK ? 1 : 0;
    return status;
}

static tl_status run_validation(const tl_worker_job *job, tl_error *error) {
    const tl_confine_settings settings = {.start_socket = -1, .whole_process = true, .only_denies = true};
    tl_confine_facts facts;
    tl_worker_result *result = NULL;
    tl_status status = tl_worker_open_result(&result, error);
    if (status == TL_OK) {
        status = tl_confine(&settings, &facts, NULL, error);
    }
    if (status == TL_OK) {
        status = check_candidate(job, &result->verdict, error);
    }
    if (status == TL_OK) {
        set_complete(result);
    }
    return status;
}

/* ---- trial ---- */

/* A trial has a lower priority than the plant's twin. A test of the states has normal priority,
 * because the twin waits for the result. */
enum { NICE = 10 };

static const tl_time CALL_LIMIT = 60 * TL_SECOND;

/* Errors: those of the check. *crashed: the FMU process crashed, or was killed because it hung;
 *         false if another process killed it. */
static tl_status check_fmus(const tl_worker_job *job, const tl_config *config, const tl_twin_role_tasks *tasks,
                            tl_twin_check *found, bool *crashed, tl_error *error) {
    const bool of_states = job->kind == TL_WORKER_STATES;
    const tl_twin_job check_job = {
        .task = TL_TASK_CHECK,
        .path = config->path,
        .text = config->text,
        .brief = !of_states,
        .states_only = of_states,
        .reads_back = of_states,
        .unconfined = job->unconfined || tl_config_is_unconfined(config),
    };
    const tl_twin_child_settings settings = {
        .job = &check_job,
        .config = config,
        .print_page = tasks->print_page,
        .call_limit = CALL_LIMIT,
        .memory_limit = job->memory_limit,
    };
    tl_twin_child *child = NULL;
    tl_status status = tl_twin_child_start(&settings, &child, error);
    if (status == TL_OK) {
        status = tl_twin_child_check(child, found, error);
    }
    if (child != NULL && status == TL_OK && !of_states) {
        status = tl_twin_child_wait(child, error);
    }
    *crashed = child != NULL && status == TL_FMU_FAILED && tl_twin_child_is_gone(child) &&
               !tl_twin_child_was_killed_by_others(child);
    tl_twin_child_close(child);
    return status;
}

/* Peak memory of the FMU process, which has ended. */
static uint64_t resident_bytes(void) {
    struct rusage usage = {.ru_maxrss = 0};
    (void)getrusage(RUSAGE_CHILDREN, &usage);
    return 1024 * (uint64_t)usage.ru_maxrss;
}

static tl_status try_fmus(const tl_worker_job *job, const tl_config *config, const tl_twin_role_tasks *tasks,
                          tl_error *error) {
    tl_twin_check found = {.warnings = 0};
    tl_worker_result *result = NULL;
    bool crashed = false;
    tl_status status = check_fmus(job, config, tasks, &found, &crashed, error);
    if (crashed &&
        job->kind == TL_WORKER_STATES) { /* the text after the semicolon is for a user who can change the limit */
        (void)snprintf(found.why, sizeof found.why, "the saved states could not be tested: %.*s",
                       (int)strcspn(error->text, ";"), error->text);
        status = TL_OK;
    }
    if (status == TL_OK) {
        status = tl_worker_open_result(&result, error);
    }
    if (status == TL_OK) {
        memcpy(result->why, found.why, sizeof result->why);
        result->trial = (tl_trial_answer){
            .needs = {.match = (uint32_t)config->match_count,
                      .adjust = (uint32_t)config->adjust_count,
                      .components = (uint32_t)config->component_count,
                      .unconfined = job->unconfined || tl_config_is_unconfined(config) ? 1 : 0,
                      .unpacked_bytes = tl_twin_fmus_of(config).unpacked_bytes,
                      .signals = (uint32_t)config->signal_count},
            .memory = resident_bytes() + found.memory,
            .step = config->step,
            .budget = config->budget_time,
            .least = found.least,
            .worst = found.worst,
        };
        set_complete(result);
    }
    return status;
}

static tl_status try_candidate(const tl_worker_job *job, const tl_twin_role_tasks *tasks, tl_error *error) {
    tl_config config;
    tl_problems problems;
    const char *text = job->text[TL_WORKER_CANDIDATE];
    (void)setpriority(PRIO_PROCESS, 0, job->kind == TL_WORKER_STATES ? 0 : NICE);
    tl_problems_init(&problems, "the candidate");
    tl_status status = tl_config_read_text(job->text[TL_WORKER_PATH], text, strlen(text), &config, &problems.report);
    if (status == TL_OK) {
        status = tl_config_check_filled_in(&config, error);
        status = status == TL_OK ? tl_live_plant_check(&config, error) : status;
        tl_config_use_lookups(&config);
        status = status == TL_OK ? try_fmus(job, &config, tasks, error) : status;
        tl_config_free(&config);
    }
    return status;
}

int tl_worker_role_run(const tl_twin_role_tasks *tasks) {
    tl_worker_job job = {.kind = TL_WORKER_VALIDATOR};
    tl_error error = {.text = ""};
    tl_status status = tl_worker_begin(&job, &error);
    if (status == TL_OK) {
        status = job.kind == TL_WORKER_VALIDATOR ? run_validation(&job, &error) : try_candidate(&job, tasks, &error);
    }
    if (status != TL_OK && error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}
