/* Activation: see activation.h. */
#include "firmware/retune/activation.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/retune/box_texts.h"

/* ---- steps ---- */

typedef enum outcome {
    RUNNING, /* the step is polled again; or no change is in progress */
    DONE,    /* the next step begins */
    ENDED, /* the change has ended: it failed, was only checked, or restarts the run. The client has its TL_CONTROL_END */
    AGAIN /* the step in self->row begins now */
} outcome;

/* A row of the table at the end of this file. */
typedef struct step_row {
    tl_control_step step; /* as clients see it */
    unsigned
        methods; /* bits of tl_activation_method: only candidates with one of these execute the step; 0: every change */
    outcome (*begin)(tl_activation *self);       /* NULL: nothing to do */
    outcome (*poll)(tl_activation *self);        /* NULL: nothing to wait for */
    tl_time limit;                               /* 0: none, or that of the worker process */
    const char *late;                            /* reason of the failure when the limit expires */
    const char *slow;                            /* message after SILENCE, once */
    void (*progress)(const tl_activation *self); /* reports the progress, after each PROGRESS without a message */
} step_row;

static const tl_time SILENCE = 2 * TL_SECOND;
static const tl_time PROGRESS = 10 * TL_SECOND;
static const tl_time VALIDATION_LIMIT = 20 * TL_SECOND; /* a text of 256 KiB takes milliseconds, more on a loaded box */
static const tl_time TRIAL_LIMIT = 180 * TL_SECOND;

/* ---- the run and its versions ---- */

void tl_activation_view_write(const tl_activation_view *view, tl_control_state *state) {
    const tl_run_status *figures = &view->figures;
    const char *lock = view->holds ? "hold" : !figures->twin_alive ? "" : tl_lock_state_name(figures->lock.state);
    (void)snprintf(state->lock, sizeof state->lock, "%s", lock);
    state->step_s = view->step_s;
    state->ticks = figures->ticks;
    state->steps = figures->steps;
    state->skipped = figures->skipped;
    state->deadline_misses = figures->deadline_misses;
    state->in_lock = tl_lock_tally_percent(&figures->lock);
    (void)snprintf(state->line, sizeof state->line, "%s", view->line);
}

static const tl_version *active_of(const tl_activation *self) {
    return tl_versions_active(self->settings.versions);
}

static bool is_on_probation(const tl_activation *self) {
    return self->settings.versions->probation.version != 0;
}

static tl_activation_view view_now(const tl_activation *self) {
    tl_activation_view view;
    self->settings.host->read_view(self->settings.host->context, &view);
    return view;
}

static void find_running_hash(const tl_activation *self, char hash[TL_SHA256_TEXT]) {
    self->settings.host->active_hash(self->settings.host->context, hash);
}

/* True if the run does not use the version that is active on disk, because a change was
 * interrupted. */
static bool is_unfinished(const tl_activation *self) {
    char hash[TL_SHA256_TEXT];
    find_running_hash(self, hash);
    return active_of(self)->number != 0 && strcmp(active_of(self)->hash, hash) != 0;
}

/* Passes the tolerances of the version that the probation would return to; zeroed without a
 * probation. */
static void pass_tolerances(const tl_activation *self) {
    static const tl_lock_tolerances none;
    const tl_activation_host *host = self->settings.host;
    host->use_tolerances(host->context, is_on_probation(self) ? &self->probation.account.tolerances : &none);
}

static void end_shadow(tl_activation *self) {
    self->rehearsal.is_begun = false;
    self->settings.host->end_shadow(self->settings.host->context);
}

static tl_activation_shadow poll_shadow(const tl_activation *self) {
    tl_activation_shadow shadow;
    self->settings.host->read_shadow(self->settings.host->context, &shadow);
    return shadow;
}

/* Returns the phase of the shadow if it uses the version that the probation would return to. */
static tl_activation_phase previous_phase(const tl_activation *self) {
    const tl_versions *versions = self->settings.versions;
    const tl_version *before = is_on_probation(self) ? tl_versions_get(versions, versions->probation.return_to) : NULL;
    if (before == NULL) {
        return TL_ACTIVATION_NO_SHADOW;
    }
    const tl_activation_shadow shadow = poll_shadow(self);
    return strcmp(shadow.hash, before->hash) == 0 ? shadow.phase : TL_ACTIVATION_NO_SHADOW;
}

/* ---- messages ---- */

static void send_reply(const tl_activation *self, const tl_control_reply *reply) {
    self->settings.reply(self->settings.listener, reply);
}

static void TL_PRINTF(3, 4) report_step(const tl_activation *self, tl_control_step step, const char *format, ...) {
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_STEP);
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(reply.as.progress.text, sizeof reply.as.progress.text, format, arguments);
    va_end(arguments);
    reply.as.progress.step = (uint32_t)step;
    reply.as.progress.left_s = tl_activation_remaining_s(self);
    send_reply(self, &reply);
}

static void report_end(const tl_activation *self, tl_control_result result, const char *text) {
    const tl_version *active = active_of(self);
    const tl_control_reply reply = tl_control_new_end(result, active->number, active->hash, text);
    send_reply(self, &reply);
}

/* Records an event, which is also logged. */
static void TL_PRINTF(3, 4) record_event(const tl_activation *self, tl_severity severity, const char *format, ...) {
    char text[TL_CONTROL_TEXT + 128];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    self->settings.host->report(self->settings.host->context, severity, text);
}

/* The verdict lists only the first of `count` problems or changes. */
static void report_list(const tl_activation *self, tl_control_kind kind, uint32_t count, uint32_t most) {
    uint32_t listed = count < most ? count : most;
    for (uint32_t i = 0; i < listed; i++) {
        tl_control_reply reply = tl_control_new_reply(kind);
        reply.more = i + 1 == listed ? count - listed : 0;
        if (kind == TL_CONTROL_PROBLEM) {
            reply.as.problem = self->verdict.problem[i];
        } else {
            reply.as.change = self->verdict.change[i];
        }
        send_reply(self, &reply);
    }
}

static void report_problems(const tl_activation *self) {
    report_list(self, TL_CONTROL_PROBLEM, self->verdict.problems, TL_VERDICT_PROBLEMS);
}

/* Reports how long the lock must be evaluated, unless `time` of live samples is certainly enough.
 * `option` gives more time, of which `lead_in` does not count. */
static void report_window(const tl_activation *self, tl_control_step step, tl_time time, tl_time lead_in,
                          const char *option) {
    const tl_verdict *verdict = &self->verdict;
    if (verdict->strokes != 0) {
        report_step(
            self, step,
            "the lock needs %u completed strokes: without them in %.3g s it is not evaluated here; %s S gives more time",
            verdict->strokes, tl_seconds(time), option);
    } else if (verdict->window > time) {
        report_step(self, step, "the lock is evaluated over %.3g s, but only %.3g s are given: use %s %.0f",
                    tl_seconds(verdict->window), tl_seconds(time), option, ceil(tl_seconds(verdict->window + lead_in)));
    }
}

/* ---- ends of a change ---- */

static void clear_change(tl_activation *self) {
    if (self->rehearsal.is_begun) {
        end_shadow(self);
    }
    tl_worker_close(&self->worker);
    free(self->text);
    self->text = NULL;
    self->cause = TL_ACTIVATION_CANDIDATE;
    self->is_wanted = false;
    self->row = is_on_probation(self) ? TL_ACTIVATION_ROW_PROBATION : TL_ACTIVATION_ROW_IDLE;
    self->step = is_on_probation(self) ? TL_CONTROL_PROBATION : TL_CONTROL_IDLE;
}

/* A technical failure: the client, or the next config manager, may retry. */
static outcome fail_change(const tl_activation *self, const char *text) {
    record_event(self, TL_EVENT_ERROR, "configuration not changed: %s", text);
    report_end(self, TL_CONTROL_FAILED, text);
    return ENDED;
}

/* The candidate is refused or cancelled. This is saved, unless it was only checked. */
static outcome TL_PRINTF(3, 4)
    refuse_candidate(const tl_activation *self, tl_control_result result, const char *format, ...) {
    bool is_cancelled = result == TL_CONTROL_CANCELLED;
    char text[TL_CONTROL_TEXT];
    tl_error error;
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    record_event(self, is_cancelled ? TL_EVENT_INFO : TL_EVENT_WARNING, "configuration from %s %s%s", self->request.who,
                 is_cancelled ? "cancelled " : "refused: ", text);
    if ((self->request.flags & TL_CONTROL_ONLY_CHECK) == 0) { /* if the disk rejects it, it is in the log */
        (void)tl_refused_changes_add(self->settings.refusals, &self->request, is_cancelled ? "cancelled" : "refused",
                                     text, &error);
    }
    report_end(self, result, text);
    return ENDED;
}

/* ---- authorise ---- */

static outcome begin_authorisation(tl_activation *self) {
    const tl_activation_host *host = self->settings.host;
    const tl_control_request *request = &self->request;
    bool is_active = strcmp(active_of(self)->hash, request->hash) == 0;
    tl_error error;
    report_step(self, TL_CONTROL_AUTHORISE, "%s", tl_change_rights[request->right]);
    if (request->right < TL_RIGHT_RETUNE) {
        return refuse_candidate(self, TL_CONTROL_FORBIDDEN,
                                "the request has the right read only (expected retune or commission)");
    }
    if (request->if_match[0] != '\0' && strcmp(active_of(self)->hash, request->if_match) != 0) {
        return refuse_candidate(
            self, TL_CONTROL_CHANGED,
            "the active configuration is %.12s now (expected %.12s): read it, then send the change again",
            active_of(self)->hash, request->if_match);
    }
    if (self->text == NULL) {
        return fail_change(self, "not enough memory for the configuration");
    }
    /* The same text names other FMUs if one of their files was replaced. */
    self->has_other_fmus = is_active && host->has_other_fmus(host->context, self->text, self->size);
    if (is_active && !self->has_other_fmus) {
        report_end(self, TL_CONTROL_SAME, "this configuration is already active");
        return ENDED;
    }
    if (memchr(self->text, '\0', self->size) != NULL) {
        return refuse_candidate(self, TL_CONTROL_INVALID,
                                "the configuration contains a NUL byte (expected a JSON text)");
    }
    if ((request->flags & TL_CONTROL_ONLY_CHECK) == 0 &&
        tl_versions_check_room(self->settings.versions, self->size, &error) != TL_OK) {
        return fail_change(self, error.text); /* before the client waits for the other steps */
    }
    return DONE;
}

/* ---- validate ---- */

/* Adds the settings that all jobs share. */
static outcome start_worker(tl_activation *self, const tl_worker_job *job, tl_time limit, tl_relay_line *on_event) {
    tl_error error;
    tl_worker_settings settings = {.plant = self->settings.plant,
                                   .job = *job,
                                   .limit = limit,
                                   .run_role = self->settings.run_role,
                                   .on_event = on_event,
                                   .context = self};
    settings.job.text[TL_WORKER_PATH] = self->settings.path;
    settings.job.text[TL_WORKER_CANDIDATE] = self->text;
    settings.job.memory_limit = self->settings.memory_limit;
    settings.job.unconfined = self->settings.unconfined;
    return tl_worker_start(&self->worker, &settings, &error) == TL_OK ? RUNNING : fail_change(self, error.text);
}

/* Returns the text of a version; the caller calls free(). A text that is damaged on disk is copied
 * from the run's memory and rewritten, with an event. */
static char *read_text(const tl_activation *self, uint64_t number, tl_error *error) {
    const tl_activation_host *host = self->settings.host;
    const tl_version *version = tl_versions_get(self->settings.versions, number);
    tl_error cause;
    size_t size = 0;
    char *text = NULL;
    tl_status status = tl_versions_read(self->settings.versions, number, &text, &cause);
    if (status == TL_OK) {
        return text;
    }
    text = version == NULL ? NULL : malloc(TL_CONTROL_MOST + 1);
    if (text == NULL || !host->text(host->context, version->hash, text, &size)) {
        free(text);
        (void)tl_fail(error, status, "%.700s; restart the run: it starts with the newest readable version", cause.text);
        return NULL;
    }
    bool is_mended = tl_versions_repair(self->settings.versions, number, text, size, error) == TL_OK;
    record_event(self, is_mended ? TL_EVENT_WARNING : TL_EVENT_ERROR, "version %" PRIu64 ": its file was damaged%s%s",
                 number,
                 is_mended ? ", and is restored from the run's memory; check the disk" : " and cannot be rewritten: ",
                 is_mended ? "" : error->text);
    return text;
}

/* The candidate is compared with the configuration of the run. */
static outcome begin_validation(tl_activation *self) {
    char fault[TL_BOX_FAULT] = "";
    char hash[TL_SHA256_TEXT];
    tl_error error;
    const tl_versions *versions = self->settings.versions;
    const char *list_path = self->settings.allowed;
    find_running_hash(self, hash);
    const tl_version *running =
        self->cause == TL_ACTIVATION_SETTLES ? tl_versions_of_hash(versions, hash) : active_of(self);
    report_step(self, TL_CONTROL_VALIDATE, "parsing the text, and comparing it with the active version");
    if (running == NULL || running->number == 0) {
        return fail_change(self, "no version is active");
    }
    if (self->cause != TL_ACTIVATION_CANDIDATE) {
        bool is_return = self->cause == TL_ACTIVATION_RETURN;
        self->text = read_text(self, is_return ? versions->probation.return_to : versions->active, &error);
        self->size = self->text == NULL ? 0 : strlen(self->text);
    }
    char *before = self->text == NULL ? NULL : read_text(self, running->number, &error);
    if (before == NULL) {
        return fail_change(self, error.text);
    }
    const tl_version *last = tl_versions_commissioned(versions);
    char *commissioned = last == NULL ? NULL : read_text(self, last->number, &error);
    char *kept = is_on_probation(self) ? read_text(self, versions->probation.return_to, &error) : NULL;
    char *list = list_path == NULL ? NULL : tl_box_read_list(list_path, fault);
    char *file = tl_box_read_file(self->settings.path);
    if (fault[0] != '\0') {
        report_step(self, TL_CONTROL_VALIDATE, "%s", fault);
    }
    const tl_worker_job job = {.kind = TL_WORKER_VALIDATOR,
                               .text = {[TL_WORKER_ACTIVE] = before,
                                        [TL_WORKER_KEPT] = kept,
                                        [TL_WORKER_COMMISSIONED] = commissioned,
                                        [TL_WORKER_BOX_FILE] = file,
                                        [TL_WORKER_LIST] = list,
                                        [TL_WORKER_LIST_PATH] = list_path}};
    outcome started = start_worker(self, &job, VALIDATION_LIMIT, NULL);
    free(before);
    free(kept);
    free(commissioned);
    free(list);
    free(file);
    return started;
}

/* In safe hold there is no twin that could change its tuning, or be compared with a shadow. */
static tl_activation_method choose_method(const tl_activation *self) {
    if (self->verdict.kind == TL_CHANGE_RESTART || view_now(self).holds) {
        return TL_ACTIVATION_BY_RESTART;
    }
    return self->verdict.kind >= TL_CHANGE_NEW_TWIN ? TL_ACTIVATION_BY_HANDOVER : TL_ACTIVATION_IN_PLACE;
}

/* The client has already received all changes; the reason names the first key that needs a restart.
 */
static outcome refuse_restart(const tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    const char *key = "the configuration";
    if (view_now(self).holds) {
        return refuse_candidate(self, TL_CONTROL_RESTART,
                                "the run is in safe hold, so only a restart can change it: use --restart");
    }
    for (uint32_t i = TL_VERDICT_CHANGES; i > 0; i--) {
        bool is_one = strcmp(verdict->change[i - 1].kind, tl_change_kinds[TL_CHANGE_RESTART]) == 0;
        key = is_one ? verdict->change[i - 1].path : key;
    }
    return refuse_candidate(self, TL_CONTROL_RESTART,
                            "%s cannot change during a run: use --restart (restarts the run, with a gap)", key);
}

/* The candidate is valid. Checks the client's right, and selects how it is activated. */
static outcome check_right(tl_activation *self) {
    tl_verdict *verdict = &self->verdict;
    report_list(self, TL_CONTROL_CHANGE, verdict->changes, TL_VERDICT_CHANGES);
    for (size_t i = 0; i < verdict->changes && i < TL_VERDICT_CHANGES; i++) {
        if (strcmp(verdict->change[i].path, "name") == 0) {
            report_step(
                self, TL_CONTROL_VALIDATE,
                "the run is called %s, the configuration %s: the names differ; for another twin, give its --control",
                verdict->change[i].before, verdict->change[i].after);
        }
    }
    if (self->has_other_fmus) { /* the texts do not show this change */
        verdict->kind = TL_CHANGE_NEW_TWIN;
        verdict->right = TL_RIGHT_COMMISSION;
        report_step(
            self, TL_CONTROL_VALIDATE,
            "the text is the active one, but an FMU file has changed since it was loaded (new twin); the old file "
            "is gone, so only a handover to the previous twin can roll back");
    }
    self->way = choose_method(self);
    bool is_boxed = verdict->right == TL_RIGHT_BOX && self->request.origin != TL_ORIGIN_RELOAD;
    uint32_t right = verdict->right < TL_RIGHT_BOX ? verdict->right : TL_RIGHT_COMMISSION;
    if (is_boxed || right > self->request.right) {
        report_problems(self);
        return is_boxed
                   ? refuse_candidate(
                         self, TL_CONTROL_FORBIDDEN,
                         "a library, file or FMU is not allowed, or an FMU would be unconfined: change this on the "
                         "box, with `twinlock reload` without --right")
                   : refuse_candidate(self, TL_CONTROL_FORBIDDEN, "the change needs the right %s (the request has %s)",
                                      tl_change_rights[right], tl_change_rights[self->request.right]);
    }
    bool is_allowed = (self->request.flags & (TL_CONTROL_MAY_RESTART | TL_CONTROL_ONLY_CHECK)) != 0;
    return self->way == TL_ACTIVATION_BY_RESTART && !is_allowed ? refuse_restart(self) : DONE;
}

static outcome poll_validation(tl_activation *self) {
    tl_worker_state state = tl_worker_poll(&self->worker);
    if (state == TL_WORKER_RUNNING) {
        return RUNNING;
    }
    bool is_sound = state == TL_WORKER_DONE && tl_verdict_take(self->worker.result.bytes, &self->verdict);
    tl_worker_close(&self->worker);
    if (!is_sound) {
        return refuse_candidate(self, TL_CONTROL_INVALID, "the validation failed: %s",
                                state == TL_WORKER_DONE ? "no valid result" : self->worker.reason);
    }
    if (self->verdict.is_valid == 0) {
        report_problems(self);
        return refuse_candidate(self, TL_CONTROL_INVALID, "%u problem%s", self->verdict.problems,
                                self->verdict.problems == 1 ? "" : "s");
    }
    if (self->cause == TL_ACTIVATION_CANDIDATE) {
        return check_right(self);
    }
    /* A rollback or an interrupted change must not wait for a test of another twin, so a handover
     * becomes a restart. */
    tl_activation_method way = choose_method(self);
    self->way = way == TL_ACTIVATION_BY_HANDOVER ? TL_ACTIVATION_BY_RESTART : way;
    return DONE;
}

/* ---- try ---- */

/* Sends "PATH: line 7: synchronise.margin: …" as a problem without PATH, because the client does
 * not know the run's file. Returns false for other texts. */
static bool report_problem(const tl_activation *self, const char *text) {
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_PROBLEM);
    tl_control_problem *problem = &reply.as.problem;
    size_t length = strlen(self->settings.path);
    if (strncmp(text, self->settings.path, length) != 0 || strncmp(text + length, ": ", 2) != 0) {
        return false;
    }
    const char *rest = text + length + 2;
    problem->line = (uint32_t)tl_problems_take_line(&rest);
    const char *colon = strstr(rest, ": ");
    size_t key = colon == NULL ? 0 : (size_t)(colon - rest);
    if (key > 0 && key < sizeof problem->path && strcspn(rest, " ") > key) {
        memcpy(problem->path, rest, key);
        rest = colon + 2;
    }
    (void)snprintf(problem->text, sizeof problem->text, "%s", rest);
    send_reply(self, &reply);
    return true;
}

static void take_trial_line(void *context, const char *line) {
    tl_activation *self = context;
    const char *text = line;
    int level = tl_log_level_of(line, &text);
    self->reported_at = self->waited;
    if (report_problem(self, text)) {
        self->problems++;
    } else if (level == TL_LOG_ERROR && self->first_error[0] == '\0') {
        (void)snprintf(self->first_error, sizeof self->first_error, "%s",
                       text); /* part of the refusal, so it is sent only once */
    } else {
        report_step(self, TL_CONTROL_TRY, "%s", text);
    }
}

static outcome begin_trial(tl_activation *self) {
    self->first_error[0] = '\0';
    self->problems = 0;
    report_step(self, TL_CONTROL_TRY, "loading, starting and rolling back the FMUs, beside the running twin");
    return start_worker(self, &(const tl_worker_job){.kind = TL_WORKER_TRIAL}, TRIAL_LIMIT, take_trial_line);
}

static void report_trial(const tl_activation *self) {
    report_step(self, TL_CONTROL_TRY, "%d s so far (limit %d s)", (int)(self->waited / TL_SECOND),
                (int)(TRIAL_LIMIT / TL_SECOND));
}

static outcome poll_trial(tl_activation *self) {
    tl_worker_state state = tl_worker_poll(&self->worker);
    if (state == TL_WORKER_RUNNING) {
        return RUNNING;
    }
    bool is_done = state == TL_WORKER_DONE;
    self->is_measured = is_done && tl_trial_answer_take(self->worker.result.bytes, &self->answer);
    tl_worker_close(&self->worker);
    if (is_done && (self->is_measured || self->way == TL_ACTIVATION_BY_RESTART)) {
        return DONE;
    }
    if (self->first_error[0] == '\0' && self->problems != 0) { /* the client has received them */
        return refuse_candidate(self, TL_CONTROL_INVALID, "the trial failed: %u problem%s", self->problems,
                                self->problems == 1 ? "" : "s");
    }
    return refuse_candidate(self, TL_CONTROL_INVALID, "the trial failed: %s",
                            self->first_error[0] != '\0' ? self->first_error
                            : is_done                    ? "no valid result"
                                                         : self->worker.reason);
}

/* ---- predict ---- */

/* The box is too slow or too small for two twins: the change restarts the run if the client allows
 * that. */
static outcome use_restart(tl_activation *self, const char *why) {
    if ((self->request.flags & TL_CONTROL_MAY_RESTART) == 0) {
        return refuse_candidate(self, TL_CONTROL_INVALID, "%s%s", why,
                                strstr(why, "--restart") != NULL ? "" : ": use --restart");
    }
    if (self->rehearsal.is_begun) {
        end_shadow(self);
    }
    report_step(self, TL_CONTROL_SHADOW, "%s: the run will restart instead", why);
    self->way = TL_ACTIVATION_BY_RESTART;
    return DONE;
}

/* Checks whether the box has the time and memory that the twin needs. */
static outcome begin_forecast(tl_activation *self) {
    char text[TL_FORECAST_TEXT];
    if (!self->is_measured) {
        return DONE;
    }
    tl_forecast_write_time(&self->answer, text);
    report_step(self, TL_CONTROL_PREDICT, "%s", text);
    if (self->way == TL_ACTIVATION_BY_RESTART) {
        return DONE;
    }
    if (self->answer.least > self->answer.step) {
        return refuse_candidate(self, TL_CONTROL_INVALID, "%s", text);
    }
    uint64_t available = tl_forecast_memory_left();
    tl_forecast_write_memory(&self->answer, available, text);
    report_step(self, TL_CONTROL_PREDICT, "%s", text);
    return available == 0 || self->answer.memory <= available ? DONE : use_restart(self, text);
}

/* ---- shadow ---- */

/* Live time that is not compared, because what the twin learned from the recording must first adapt
 * to the plant. */
static const tl_time LEAD_IN = 10 * TL_SECOND;

static tl_time length_of_shadow(const tl_activation *self) {
    uint32_t requested = self->request.shadow_s == 0 ? TL_ACTIVATION_SHADOW_S : self->request.shadow_s;
    return (tl_time)(requested < TL_ACTIVATION_SHADOW_LONGEST_S ? requested : TL_ACTIVATION_SHADOW_LONGEST_S) *
           TL_SECOND;
}

static tl_time lead_in_of(const tl_activation *self) {
    tl_time quarter = length_of_shadow(self) / 4;
    return quarter < LEAD_IN ? quarter : LEAD_IN;
}

/* Percent of the steps, in the comparison and on probation. */
static double required_lock(const tl_activation *self) {
    return self->request.require_lock < 0.0 ? TL_ACTIVATION_LOCK_PERCENT : self->request.require_lock;
}

static outcome begin_shadow(tl_activation *self) {
    self->rehearsal = (tl_rehearsal){.comparison.before = view_now(self).figures};
    report_step(self, TL_CONTROL_SHADOW, "starting the new twin as a shadow, beside the running twin");
    if (required_lock(self) > 0.0) {
        tl_time third = self->verdict.window /
                        3; /* lead_in_of() is a quarter of the shadow's time, so a third of the time that is compared */
        report_window(self, TL_CONTROL_SHADOW, length_of_shadow(self) - lead_in_of(self),
                      third < LEAD_IN ? third : LEAD_IN, "--shadow");
    }
    return RUNNING;
}

static outcome poll_order(tl_activation *self) {
    const tl_activation_host *host = self->settings.host;
    bool replaces_previous = previous_phase(self) != TL_ACTIVATION_NO_SHADOW;
    const tl_activation_candidate candidate = {.text = self->text,
                                               .size = self->size,
                                               .hash = self->request.hash,
                                               .needs = self->answer.needs,
                                               .tolerances = &self->verdict.tolerances};
    self->rehearsal.is_begun = host->begin_shadow(host->context, &candidate);
    if (!self->rehearsal.is_begun) {
        return RUNNING;
    }
    if (replaces_previous) {
        static const char text[] =
            "the previous twin ends to make room: a rollback of the version on probation now restarts the run";
        record_event(self, TL_EVENT_INFO, "%s", text);
        report_step(self, TL_CONTROL_SHADOW, "%s", text);
    }
    return DONE;
}

/* The trial ran the FMUs alone without a fault. So a shadow that cannot even start lacks time or
 * memory. */
static outcome fail_shadow(tl_activation *self, const tl_activation_shadow *shadow, bool has_run) {
    char why[TL_ACTIVATION_WHY];
    char text[TL_CONTROL_TEXT];
    (void)tl_clean_text(shadow->why, strnlen(shadow->why, sizeof shadow->why), why, sizeof why);
    (void)snprintf(text, sizeof text, "the shadow failed: %s", why[0] == '\0' ? "its process ended" : why);
    return !has_run || strstr(why, TL_COMPARISON_TWO_TWINS) != NULL
               ? use_restart(self, text)
               : refuse_candidate(self, TL_CONTROL_INVALID, "%s", text);
}

static void report_loading(const tl_activation *self) {
    const tl_run_status *work = &self->rehearsal.recorded;
    if (work->last > 0) {
        report_step(self, TL_CONTROL_SHADOW, "recorded samples: %" PRId64 " of %" PRId64, work->tick, work->last);
    } else if (!self->rehearsal.has_run) {
        report_step(self, TL_CONTROL_SHADOW, "loading the FMUs");
    }
}

/* Waits until the shadow has loaded its FMUs and stepped over the recorded samples. */
static outcome poll_loading(tl_activation *self) {
    tl_rehearsal *rehearsal = &self->rehearsal;
    const tl_activation_shadow shadow = poll_shadow(self);
    if (shadow.phase == TL_ACTIVATION_SHADOW_LIVE) {
        rehearsal->has_run = true;
        report_loading(self);
        return DONE;
    }
    if (shadow.phase == TL_ACTIVATION_SHADOW_RECORDED) {
        rehearsal->has_run = true;
        rehearsal->recorded = shadow.work;
        return RUNNING;
    }
    /* There is no shadow if the order is still pending, or if the shadow was ended. */
    bool is_over = rehearsal->has_run || shadow.phase == TL_ACTIVATION_SHADOW_FAILED;
    return is_over ? fail_shadow(self, &shadow, rehearsal->has_run) : RUNNING;
}

static void report_live(const tl_activation *self) {
    char lock[TL_COMPARISON_LOCK];
    const tl_activation_shadow shadow = poll_shadow(self);
    tl_comparison_write_lock(&shadow.work.lock, lock);
    report_step(self, TL_CONTROL_SHADOW, "live: %.0f of %.0f s, %s", tl_seconds(self->rehearsal.live),
                tl_seconds(length_of_shadow(self)), lock);
}

static outcome poll_live(tl_activation *self) {
    tl_rehearsal *rehearsal = &self->rehearsal;
    const tl_activation_shadow shadow = poll_shadow(self);
    if (shadow.phase != TL_ACTIVATION_SHADOW_LIVE) {
        return fail_shadow(self, &shadow, true);
    }
    rehearsal->live += self->passed;
    if (!rehearsal->is_compared && rehearsal->live >= lead_in_of(self)) {
        rehearsal->is_compared = true;
        tl_comparison_begin(&rehearsal->comparison, &shadow.work, &shadow.beside);
    } else if (rehearsal->live >= length_of_shadow(self)) {
        rehearsal->live = length_of_shadow(self);
        report_live(self);
        tl_comparison_end(&rehearsal->comparison, &shadow.work, &shadow.beside);
        return DONE;
    }
    return RUNNING;
}

/* ---- compare ---- */

static void report_comparison(void *context, const char *text) {
    report_step(context, TL_CONTROL_COMPARE, "%s", text);
}

static outcome begin_comparison(tl_activation *self) {
    const tl_comparison *comparison = &self->rehearsal.comparison;
    bool insists = (self->request.flags & TL_CONTROL_ACCEPT_WORSE) != 0;
    char why[TL_COMPARISON_TEXT];
    tl_comparison_report(comparison, report_comparison, self);
    switch (tl_comparison_evaluate(comparison, required_lock(self), why)) {
    case TL_COMPARISON_GOOD:
        break;
    case TL_COMPARISON_TOO_SLOW:
        return use_restart(self, why);
    case TL_COMPARISON_BAD:
        return refuse_candidate(self, TL_CONTROL_INVALID, "%s", why);
    case TL_COMPARISON_WORSE:
        if (!insists) {
            return refuse_candidate(self, TL_CONTROL_INVALID, "%s: use --accept-worse to activate it anyway", why);
        }
        report_step(self, TL_CONTROL_COMPARE, "%s: accepted, because of --accept-worse", why);
        break;
    }
    return DONE;
}

/* ---- activate: on disk first ---- */

/* Seconds. With the right to retune, at least twice the time that the lock needs to be evaluated.
 */
static uint32_t length_of_probation(const tl_activation *self) {
    const tl_control_request *request = &self->request;
    tl_time requested = request->probation_s == 0 ? TL_ACTIVATION_PROBATION_S : (tl_time)request->probation_s;
    tl_time least = request->right < TL_RIGHT_COMMISSION ? 2 * self->verdict.window / TL_SECOND + 1 : 1;
    requested = requested > least ? requested : least;
    return (uint32_t)(requested < TL_PROBATION_LONGEST_S ? requested : TL_PROBATION_LONGEST_S);
}

static tl_status activate_version(tl_activation *self, tl_error *error) {
    const tl_control_request *request = &self->request;
    const tl_probation_terms terms = {.given_s = length_of_probation(self),
                                      .require_lock = required_lock(self),
                                      .must_confirm = (request->flags & TL_CONTROL_MUST_CONFIRM) != 0};
    const tl_run_status now = view_now(self).figures;
    char *file = tl_box_read_file(self->settings.path); /* the current configuration file */
    bool is_by_hand = request->origin == TL_ORIGIN_RELOAD && (file == NULL || strcmp(file, self->text) != 0);
    free(file);
    const tl_version_candidate answer_code = {.text = self->text,
                                              .size = self->size,
                                              .who = request->who,
                                              .why = request->why,
                                              .origin = is_by_hand ? TL_ORIGIN_HAND : (tl_change_origin)request->origin,
                                              .right = (tl_change_right)self->verdict.right,
                                              .kind = (tl_change_kind)self->verdict.kind};
    uint64_t number = 0;
    tl_status status = tl_versions_add(self->settings.versions, &answer_code, &number, error);
    if (status == TL_OK) {
        tl_probation_begin(&self->probation, &terms, &now,
                           self->way == TL_ACTIVATION_IN_PLACE ? &now : NULL); /* another run counts from 0 */
        self->probation.account.tolerances = self->verdict.tolerances;
        (void)snprintf(self->probation.account.widened, TL_PROBATION_WIDENED, "%s", self->verdict.widened);
        status = tl_versions_activate(self->settings.versions, number, &self->probation.account, error);
    }
    return status;
}

/* For the database: a tuning is recorded with user, origin and reason, but a run is not. */
static void record_origin(const tl_activation *self) {
    const tl_version *active = active_of(self);
    record_event(self, TL_EVENT_INFO, "version %" PRIu64 ": from %s (%s)%s%s", active->number, active->who,
                 tl_change_origins[active->origin], active->why[0] == '\0' ? "" : ": ", active->why);
}

static outcome restart_run(tl_activation *self) {
    bool is_return = self->cause == TL_ACTIVATION_RETURN;
    record_event(self, is_return ? TL_EVENT_WARNING : TL_EVENT_INFO, "the run restarts with version %" PRIu64,
                 self->settings.versions->active);
    record_origin(self);
    report_end(self, is_return && !self->is_wanted ? TL_CONTROL_UNDONE : TL_CONTROL_DONE,
               is_return ? self->reason : "the run restarts with it, then its probation begins");
    self->settings.host->restart(self->settings.host->context);
    return ENDED; /* this run does nothing more for it */
}

static outcome begin_activation(tl_activation *self) {
    static const struct {
        const char *step, *checked;
    } texts[] = {
        [TL_ACTIVATION_IN_PLACE] = {"in place, at the beginning of a tick", "it can be activated in place"},
        [TL_ACTIVATION_BY_HANDOVER] = {"between two ticks, by a handover to the new twin",
                                       "it can be activated without a gap"},
        [TL_ACTIVATION_BY_RESTART] = {"by a restart of the run", "it can be activated, with a restart of the run"}};
    tl_error error;
    tl_status status = TL_OK;
    if (self->cause == TL_ACTIVATION_CANDIDATE && (self->request.flags & TL_CONTROL_ONLY_CHECK) != 0) {
        report_end(self, TL_CONTROL_DONE, texts[self->way].checked);
        return ENDED;
    }
    if (self->cause == TL_ACTIVATION_SETTLES && !is_unfinished(self)) {
        return ENDED; /* a handover that was ordered before has finished meanwhile */
    }
    report_step(self, TL_CONTROL_ACTIVATE, "%s", texts[self->way].step);
    find_running_hash(self, self->leaving);
    if (self->cause == TL_ACTIVATION_CANDIDATE) {
        status = activate_version(self, &error);
    } else if (self->cause == TL_ACTIVATION_RETURN) {
        status = tl_versions_end_probation(self->settings.versions, TL_VERSION_ROLLED_BACK, self->reason, &error);
    }
    if (status != TL_OK) {
        return fail_change(self, error.text);
    }
    if (self->way == TL_ACTIVATION_BY_RESTART) {
        return restart_run(self);
    }
    pass_tolerances(self); /* before the twin applies the change */
    return DONE;
}

/* Sends the tuning to the running twin, or orders the handover. */
static outcome poll_handover(tl_activation *self) {
    const tl_activation_host *host = self->settings.host;
    const tl_version *active = active_of(self);
    const char *why = self->cause == TL_ACTIVATION_RETURN ? self->reason : active->why;
    bool is_accepted = self->way == TL_ACTIVATION_BY_HANDOVER
                           ? host->handover(host->context)
                           : host->tune(host->context, active, why, self->text, &self->verdict.tuning);
    return is_accepted ? DONE : RUNNING;
}

static outcome follow_disk(tl_activation *self);

/* Rolls back on disk; the run never used the version. If the run cannot follow the disk, it
 * restarts. */
static outcome undo_activation(tl_activation *self, const char *why) {
    tl_error error;
    char text[TL_CONTROL_TEXT];
    (void)snprintf(text, sizeof text, "%s: %s",
                   self->way == TL_ACTIVATION_BY_HANDOVER ? "the handover to the other twin failed"
                                                          : "the twin did not apply the change",
                   why);
    if (self->cause != TL_ACTIVATION_CANDIDATE) {
        record_event(self, TL_EVENT_ERROR, "%s", text);
        return restart_run(self);
    }
    if (tl_versions_end_probation(self->settings.versions, TL_VERSION_ROLLED_BACK, text, &error) != TL_OK) {
        record_event(self, TL_EVENT_ERROR, "%s", error.text);
    }
    (void)fail_change(self, text);
    return follow_disk(self); /* because a twin that was only slow must not apply it later */
}

static outcome poll_answer(tl_activation *self) {
    const tl_activation_host *host = self->settings.host;
    char why[TL_ACTIVATION_WHY] = "";
    switch (self->way == TL_ACTIVATION_BY_HANDOVER ? host->handover_result(host->context, why)
                                                   : host->tuning_result(host->context, why)) {
    case TL_ACTIVATION_STARTED:
        return DONE;
    case TL_ACTIVATION_REFUSED:
        return undo_activation(self, why);
    case TL_ACTIVATION_WAITS:
        break;
    }
    return RUNNING;
}

/* ---- probation and rollback ---- */

/* Interval of saving the probation, and pause before a write is retried that the disk rejected. */
static const tl_time SAVING = 10 * TL_SECOND;
static const tl_time PAUSE = 10 * TL_SECOND;

/* Writes the first change, and how many others there are. */
static void write_changes(const tl_activation *self, char *text, size_t size) {
    const tl_control_change *first = &self->verdict.change[0];
    text[0] = '\0';
    if (self->verdict.changes > 0) {
        int length =
            snprintf(text, size, ": %.100s %s → %s", first->path, first->before[0] == '\0' ? "-" : first->before,
                     first->after[0] == '\0' ? "-" : first->after);
        if (self->verdict.changes > 1 && length > 0 && (size_t)length < size) {
            (void)snprintf(text + length, size - (size_t)length, " and %u more", self->verdict.changes - 1);
        }
    }
}

/* The shadow is now the twin that was live before. It is kept only if it is the target of a
 * rollback. */
static void end_handover(tl_activation *self) {
    const tl_versions *versions = self->settings.versions;
    const tl_version *before = tl_versions_get(versions, versions->probation.return_to);
    self->rehearsal.is_begun = false; /* its twin is the live one */
    record_origin(self);
    if (self->cause == TL_ACTIVATION_RETURN || before == NULL || strcmp(before->hash, self->leaving) != 0) {
        end_shadow(self);
    }
}

static void report_probation(const tl_activation *self, const char *running) {
    const tl_probation_terms *terms = &self->probation.account.terms;
    report_step(self, TL_CONTROL_PROBATION, "%u s; %s", terms->given_s,
                terms->must_confirm ? "it will be rolled back unless it is confirmed"
                                    : "it will be kept if it stays in lock");
    if (terms->require_lock > 0.0 && !terms->must_confirm) {
        report_window(self, TL_CONTROL_PROBATION, (tl_time)terms->given_s * TL_SECOND, 0, "--probation");
    }
    if ((self->request.flags & TL_CONTROL_WAIT) == 0) {
        report_end(self, TL_CONTROL_DONE, running);
    }
}

/* The run uses the version that is active on disk. */
static outcome begin_probation(tl_activation *self) {
    const tl_version *active = active_of(self);
    char text[TL_CONTROL_TEXT];
    char changes[384];
    bool is_return = self->cause == TL_ACTIVATION_RETURN;
    bool is_handover = self->way == TL_ACTIVATION_BY_HANDOVER;
    write_changes(self, changes, sizeof changes);
    (void)snprintf(text, sizeof text, "version %" PRIu64 " (%.12s) is active%s%s", active->number, active->hash,
                   is_return ? is_handover ? ": rolled back by a handover: " : ": rolled back: " : changes,
                   is_return ? self->reason : "");
    record_event(self, is_return ? TL_EVENT_WARNING : TL_EVENT_INFO, "%s", text);
    if (is_handover) {
        end_handover(self);
    }
    if (is_return) {
        report_step(self, TL_CONTROL_RETURNED, "%s%s", is_handover ? "by a handover: " : "", self->reason);
        report_end(self, self->is_wanted ? TL_CONTROL_DONE : TL_CONTROL_UNDONE, text);
    } else if (self->cause == TL_ACTIVATION_CANDIDATE) {
        self->unsaved = 0;
        self->pause = 0;
        report_probation(self, text);
    }
    clear_change(self);
    return RUNNING;
}

/* Rolls back by a handover if the shadow runs the version before; else like any other change. */
static outcome begin_rollback(tl_activation *self) {
    tl_activation_phase phase = previous_phase(self);
    self->pause = PAUSE;
    self->cause = TL_ACTIVATION_RETURN;
    self->row = TL_ACTIVATION_ROW_VALIDATE;
    (void)snprintf(self->reason, sizeof self->reason, "%s", self->probation.why);
    if (phase == TL_ACTIVATION_SHADOW_LIVE) {
        self->way = TL_ACTIVATION_BY_HANDOVER;
        self->row = TL_ACTIVATION_ROW_ACTIVATE;
    } else if (phase != TL_ACTIVATION_NO_SHADOW) {
        record_event(self, TL_EVENT_WARNING, "the previous twin has ended: the rollback cannot use a handover");
        end_shadow(self);
    }
    return AGAIN;
}

/* Makes the run follow the disk, after a change that was interrupted. */
static outcome follow_disk(tl_activation *self) {
    char hash[TL_SHA256_TEXT];
    clear_change(self);
    if (!is_unfinished(self)) {
        return RUNNING;
    }
    find_running_hash(self, hash);
    bool is_known = tl_versions_of_hash(self->settings.versions, hash) != NULL;
    self->cause = TL_ACTIVATION_SETTLES;
    self->way = TL_ACTIVATION_BY_RESTART;
    self->row = is_known ? TL_ACTIVATION_ROW_VALIDATE : TL_ACTIVATION_ROW_ACTIVATE;
    return AGAIN;
}

/* Reports a full disk once, and once when it works again, although the write is retried every 10 s.
 */
static void report_disk(tl_activation *self, bool is_written, const char *why) {
    char text[TL_CONTROL_TEXT];
    if (!is_written && !self->is_unwritten) {
        (void)snprintf(text, sizeof text, "probation: cannot be saved, so it continues; retrying every 10 s: %.700s",
                       why);
        record_event(self, TL_EVENT_ERROR, "%s", text);
        report_step(self, TL_CONTROL_PROBATION, "%s", text);
    } else if (is_written && self->is_unwritten) {
        record_event(self, TL_EVENT_INFO, "probation: saved again");
    }
    self->is_unwritten = !is_written;
}

/* Keeps the version on probation. A client that waits for another candidate gets no reply. Returns
 * false if the disk rejects the change. */
static bool keep_version(tl_activation *self) {
    tl_error error;
    bool is_written =
        tl_versions_end_probation(self->settings.versions, TL_VERSION_KEPT, self->probation.why, &error) == TL_OK;
    report_disk(self, is_written, error.text);
    if (!is_written) {
        self->pause = PAUSE;
        self->probation.result = TL_PROBATION_CONTINUES; /* so that later failures still count */
        return false;
    }
    record_event(self, TL_EVENT_INFO, "version %" PRIu64 " is kept: %s", self->settings.versions->active,
                 self->probation.why);
    if (!self->rehearsal.is_begun) { /* else the shadow belongs to a candidate */
        end_shadow(self);
    }
    return true;
}

/* A probation also continues during a change to another candidate. */
static tl_probation_result pass_probation(tl_activation *self) {
    tl_error error;
    const tl_activation_view now = view_now(self);
    tl_probation_result result = tl_probation_feed(&self->probation, now.waits ? 0 : self->passed, &now.figures);
    self->pause = self->pause > self->passed ? self->pause - self->passed : 0;
    if (result == TL_PROBATION_CONTINUES) {
        self->unsaved += self->passed;
        if (self->unsaved >= SAVING) {
            self->unsaved = 0;
            bool is_written =
                tl_versions_save_probation(self->settings.versions, &self->probation.account, &error) == TL_OK;
            report_disk(self, is_written, error.text);
        }
    }
    return result;
}

static outcome poll_probation(tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    tl_probation_result result = pass_probation(self);
    if (self->pause == 0 && result == TL_PROBATION_ROLLED_BACK) {
        return begin_rollback(self);
    }
    if (self->pause == 0 && result == TL_PROBATION_KEPT && keep_version(self)) {
        report_step(self, TL_CONTROL_KEPT, "%s", self->probation.why);
        (void)snprintf(text, sizeof text, "version %" PRIu64 " is kept", self->settings.versions->active);
        report_end(self, TL_CONTROL_DONE, text);
        clear_change(self);
    }
    return RUNNING;
}

/* ---- table and driver ---- */

#define WAITING "waiting until the database has recorded the previous change: is the disk full or slow?"

#define LATE "no answer within 60 s"

enum {
    NEW_TWIN = 1U << TL_ACTIVATION_BY_HANDOVER | 1U << TL_ACTIVATION_BY_RESTART,
    HANDOVER = 1U << TL_ACTIVATION_BY_HANDOVER
};

/* The steps in their order. A candidate skips a step if its `methods` do not contain the
 * candidate's.
 */
static const step_row rows[TL_ACTIVATION_ROWS] = {
    [TL_ACTIVATION_ROW_IDLE] = {.step = TL_CONTROL_IDLE},
    [TL_ACTIVATION_ROW_AUTHORISE] = {.step = TL_CONTROL_AUTHORISE, .begin = begin_authorisation},
    [TL_ACTIVATION_ROW_VALIDATE] = {.step = TL_CONTROL_VALIDATE, .begin = begin_validation, .poll = poll_validation},
    [TL_ACTIVATION_ROW_TRY] = {.step = TL_CONTROL_TRY,
                               .methods = NEW_TWIN,
                               .begin = begin_trial,
                               .poll = poll_trial,
                               .progress = report_trial},
    [TL_ACTIVATION_ROW_PREDICT] = {.step = TL_CONTROL_PREDICT, .methods = NEW_TWIN, .begin = begin_forecast},
    [TL_ACTIVATION_ROW_ORDER] = {.step = TL_CONTROL_SHADOW,
                                 .methods = HANDOVER,
                                 .begin = begin_shadow,
                                 .poll = poll_order,
                                 .limit = 60 * TL_SECOND,
                                 .late = "the shadow could not be started within 60 s",
                                 .slow = WAITING},
    [TL_ACTIVATION_ROW_LOAD] = {.step = TL_CONTROL_SHADOW,
                                .methods = HANDOVER,
                                .poll = poll_loading,
                                .limit = 900 * TL_SECOND,
                                .late = "the shadow did not catch up with the plant within 15 minutes",
                                .progress = report_loading},
    [TL_ACTIVATION_ROW_LIVE] = {.step = TL_CONTROL_SHADOW,
                                .methods = HANDOVER,
                                .poll = poll_live,
                                .progress = report_live},
    [TL_ACTIVATION_ROW_COMPARE] = {.step = TL_CONTROL_COMPARE, .methods = HANDOVER, .begin = begin_comparison},
    [TL_ACTIVATION_ROW_ACTIVATE] = {.step = TL_CONTROL_ACTIVATE, .begin = begin_activation},
    [TL_ACTIVATION_ROW_HAND_OVER] =
        {.step = TL_CONTROL_ACTIVATE, .poll = poll_handover, .limit = 60 * TL_SECOND, .late = LATE, .slow = WAITING},
    [TL_ACTIVATION_ROW_ANSWER] = {.step = TL_CONTROL_ACTIVATE,
                                  .poll = poll_answer,
                                  .limit = 60 * TL_SECOND,
                                  .late = LATE,
                                  .slow = "waiting for the twin to apply it (limit 60 s)"},
    [TL_ACTIVATION_ROW_PROBATION] = {.step = TL_CONTROL_PROBATION, .begin = begin_probation, .poll = poll_probation},
};

static bool is_skipped(const tl_activation *self) {
    unsigned methods = rows[self->row].methods;
    return methods != 0 && (self->cause != TL_ACTIVATION_CANDIDATE || (methods & 1U << self->way) == 0);
}

/* Begins the next steps until one must wait or the change ends. */
static void run_steps(tl_activation *self, outcome result) {
    while (result == DONE || result == AGAIN) {
        if (result == DONE) {
            do {
                self->row++;
            } while (is_skipped(self));
        }
        const step_row *row = &rows[self->row];
        self->step = row->step;
        self->waited = 0;
        self->reported_at = 0;
        result = row->begin == NULL ? RUNNING : row->begin(self);
        self->polled_at = tl_clock_now(NULL);
    }
    if (result == ENDED) {
        clear_change(self);
    }
}

/* During a change, the probation of the active version may end, and the run may enter safe hold. */
static outcome poll_run(tl_activation *self) {
    tl_probation_result result = is_on_probation(self) ? pass_probation(self) : TL_PROBATION_CONTINUES;
    if (self->step != TL_CONTROL_SHADOW) {
        return RUNNING; /* other steps are short */
    }
    if (result == TL_PROBATION_ROLLED_BACK) {
        return refuse_candidate(self, TL_CONTROL_FAILED, "the version on probation is rolled back first: %s",
                                self->probation.why);
    }
    if (result == TL_PROBATION_KEPT) {
        (void)keep_version(self);
    }
    return view_now(self).holds ? use_restart(self, "the run is in safe hold") : RUNNING;
}

void tl_activation_poll(tl_activation *activation) {
    const step_row *row = &rows[activation->row];
    tl_time now = tl_clock_now(NULL);
    tl_time before = activation->waited;
    outcome result = RUNNING;
    activation->passed = now - activation->polled_at;
    activation->polled_at = now;
    activation->waited += activation->passed;
    pass_tolerances(activation);
    if (row->poll == NULL) {
        return;
    }
    if (row->step < TL_CONTROL_ACTIVATE) {
        result = poll_run(activation);
    }
    if (result == RUNNING) {
        result = row->poll(activation);
    }
    if (result != RUNNING) {
        run_steps(activation, result);
    } else if (row != &rows[activation->row]) {
        return; /* the poll has selected another step */
    } else if (row->late != NULL && activation->waited > row->limit) {
        run_steps(activation, row->step == TL_CONTROL_SHADOW ? use_restart(activation, row->late)
                                                             : undo_activation(activation, row->late));
    } else if (row->slow != NULL && activation->waited > SILENCE && before <= SILENCE) {
        report_step(activation, row->step, "%s", row->slow);
    } else if (row->progress != NULL && activation->waited - activation->reported_at >= PROGRESS) {
        activation->reported_at = activation->waited;
        row->progress(activation);
    }
}

/* ---- activation ---- */

void tl_activation_begin(tl_activation *activation, const tl_activation_settings *settings) {
    *activation = (tl_activation){.settings = *settings, .polled_at = tl_clock_now(NULL)};
    if (is_on_probation(activation)) {
        tl_probation_resume(&activation->probation, &settings->versions->probation.account);
    }
    if (previous_phase(activation) == TL_ACTIVATION_NO_SHADOW) {
        end_shadow(activation); /* left by a candidate that an earlier config manager did not finish */
    }
    run_steps(activation, follow_disk(activation));
}

bool tl_activation_is_idle(const tl_activation *activation) {
    return activation->step == TL_CONTROL_IDLE;
}

bool tl_activation_is_busy(const tl_activation *activation) {
    return activation->step != TL_CONTROL_IDLE && activation->step != TL_CONTROL_PROBATION;
}

uint32_t tl_activation_remaining_s(const tl_activation *activation) {
    return is_on_probation(activation) ? (uint32_t)((activation->probation.account.left_ms + 999) / 1000) : 0;
}

void tl_activation_start(tl_activation *activation, const tl_control_request *request, const char *text, size_t size) {
    activation->request = *request;
    if (request->why[strspn(request->why, " \t\r\n")] == '\0') {
        activation->request.why[0] = '\0'; /* only blanks */
    }
    activation->size = size;
    activation->text = malloc(size + 1);
    if (activation->text != NULL) {
        memcpy(activation->text, text, size);
        activation->text[size] = '\0';
    }
    activation->row = TL_ACTIVATION_ROW_AUTHORISE;
    run_steps(activation, AGAIN);
}

/* True if a candidate is in progress and is not on disk yet. */
static bool has_candidate(const tl_activation *self) {
    return tl_activation_is_busy(self) && self->step != TL_CONTROL_ACTIVATE && self->cause == TL_ACTIVATION_CANDIDATE;
}

bool tl_activation_cancel(tl_activation *activation, const char *who) {
    if (!has_candidate(activation)) {
        return false;
    }
    run_steps(activation, refuse_candidate(activation, TL_CONTROL_CANCELLED, "by %s; nothing was changed", who));
    return true;
}

bool tl_activation_was_lost_before(const tl_activation *activation) {
    return is_on_probation(activation) && tl_probation_is_lost_by_previous(&activation->probation);
}

static tl_probation_result end_by_user(tl_activation *self, tl_probation_result result, const char *action,
                                       const char *who) {
    char why[TL_PROBATION_WHY];
    (void)snprintf(why, sizeof why, "%s by %s", action, who);
    self->pause = 0;
    self->passed = 0;
    return tl_probation_decide(&self->probation, result, why);
}

bool tl_activation_confirm(tl_activation *activation, const char *who, bool *is_done) {
    bool is_pending = has_candidate(activation);
    if (!is_on_probation(activation) || (activation->step != TL_CONTROL_PROBATION && !is_pending)) {
        return false;
    }
    tl_probation_result result = end_by_user(activation, TL_PROBATION_KEPT, "confirmed", who);
    if (!is_pending) {
        run_steps(activation, poll_probation(activation));
    } else if (result == TL_PROBATION_KEPT) {
        (void)keep_version(activation);
    }
    *is_done = !is_on_probation(activation);
    return true;
}

void tl_activation_roll_back(tl_activation *activation, const char *who) {
    activation->is_wanted = true;
    (void)end_by_user(activation, TL_PROBATION_ROLLED_BACK, "rollback requested", who);
    run_steps(activation, poll_probation(activation));
}

void tl_activation_end(tl_activation *activation) {
    tl_error error;
    if (activation->step == TL_CONTROL_PROBATION) {
        (void)tl_versions_save_probation(activation->settings.versions, &activation->probation.account, &error);
    }
    clear_change(activation);
}
