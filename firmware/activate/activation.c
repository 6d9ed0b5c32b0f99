/* Activations: see activation.h. */
#include "firmware/activate/activation.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/activate/trial.h"
#include "firmware/activate/validator.h"
#include "firmware/base/clock.h"
#include "firmware/base/file_bytes.h"
#include "firmware/base/log.h"
#include "firmware/control/control_words.h"

/* Reading a text of 256 KiB takes milliseconds; a loaded box has other things to do. Loading FMUs takes what it takes. */
static const tl_time VALIDATION = 20 * TL_SECOND;
static const tl_time TRIAL = 180 * TL_SECOND;

/* A twin takes a tuning at its next tick; a new one begins meanwhile, perhaps. */
static const tl_time TAKING = 60 * TL_SECOND;

/* What is left of a probation is written this often; and so long nothing is tried again that the disk has refused. */
static const tl_time SAVING = 10 * TL_SECOND;
static const tl_time PAUSE = 10 * TL_SECOND;

static tl_versions *versions_of(const tl_activation *self) {
    return self->settings.versions;
}

/* ---- saying ---- */

static tl_control_reply new_reply(tl_control_kind kind) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = (uint32_t)kind;
    return reply;
}

static void say(const tl_activation *self, const tl_control_reply *reply) {
    self->settings.say(self->settings.listener, reply);
}

static void say_step(const tl_activation *self, tl_control_step step, const char *text) {
    tl_control_reply reply = new_reply(TL_CONTROL_STEP);
    reply.as.progress.step = (uint32_t)step;
    reply.as.progress.left_s = tl_activation_left_s(self);
    (void)snprintf(reply.as.progress.text, sizeof reply.as.progress.text, "%s", text);
    say(self, &reply);
}

static void say_end(const tl_activation *self, tl_control_result result, const char *text) {
    tl_control_reply reply = new_reply(TL_CONTROL_END);
    const tl_version *active = tl_versions_get(versions_of(self), versions_of(self)->active);
    reply.as.end.result = (uint32_t)result;
    if (active != NULL) {
        reply.as.end.version = active->number;
        memcpy(reply.as.end.hash, active->hash, sizeof reply.as.end.hash);
    }
    (void)snprintf(reply.as.end.text, sizeof reply.as.end.text, "%s", text);
    say(self, &reply);
}

static void tell(const tl_activation *self, tl_severity severity, const char *text) {
    self->settings.host->tell(self->settings.host->context, severity, text);
}

/* ---- the ends of a change ---- */

static void forget(tl_activation *self) {
    tl_errand_close(&self->errand);
    free(self->text);
    free(self->before);
    self->text = NULL;
    self->before = NULL;
    self->is_return = false;
    self->is_wanted = false;
    self->settles = false;
    self->is_handed = false;
    self->step = versions_of(self)->probation.version != 0 ? TL_CONTROL_PROBATION : TL_CONTROL_IDLE;
}

/* Nothing came of it. */
static void refuse(tl_activation *self, tl_control_result result, const char *text) {
    char line[TL_CONTROL_TEXT + 128];
    (void)snprintf(line, sizeof line, "a configuration of %s was refused: %s", self->request.who, text);
    tell(self, TL_EVENT_WARNING, line);
    say_end(self, result, text);
    forget(self);
}

/* What is known and cannot be brought about: tried again by whoever asks next, or begins next. */
static void fail(tl_activation *self, const char *text) {
    char line[TL_CONTROL_TEXT + 128];
    (void)snprintf(line, sizeof line, "the configuration could not be changed: %s", text);
    tell(self, TL_EVENT_ERROR, line);
    say_end(self, TL_CONTROL_FAILED, text);
    forget(self);
}

/* ---- validate ---- */

static bool send_errand(tl_activation *self, const char *kind, size_t answer, tl_time limit, tl_relay_line *hear) {
    char title[TL_ROLE_TITLE];
    tl_error error;
    (void)snprintf(title, sizeof title, "%s [%s]", kind, self->settings.plant);
    const tl_errand_settings settings = {
        .title = title,
        .job = {.path = self->settings.path,
                .in_force = self->before,
                .candidate = self->text,
                .memory_limit = self->settings.memory_limit,
                .unconfined = self->settings.unconfined},
        .answer = answer,
        .limit = limit,
        .be = self->settings.be,
        .hear = hear,
        .context = self,
    };
    if (tl_errand_send(&self->errand, &settings, &error) != TL_OK) {
        fail(self, error.text);
        return false;
    }
    return true;
}

static void validate(tl_activation *self) {
    tl_error error;
    self->step = TL_CONTROL_VALIDATE;
    say_step(self, TL_CONTROL_VALIDATE, "the text is read, and held against the active one");
    free(self->before);
    self->before = NULL;
    if (tl_versions_read(versions_of(self), versions_of(self)->active, &self->before, &error) != TL_OK) {
        fail(self, error.text);
        return;
    }
    (void)send_errand(self, TL_VALIDATOR, sizeof(tl_verdict), VALIDATION, NULL); /* the verdict says all */
}

static void say_problems(const tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    uint32_t listed = verdict->problems < TL_VERDICT_PROBLEMS ? verdict->problems : TL_VERDICT_PROBLEMS;
    for (uint32_t i = 0; i < listed; i++) {
        tl_control_reply reply = new_reply(TL_CONTROL_PROBLEM);
        reply.more = i + 1 == listed ? verdict->problems - listed : 0;
        reply.as.problem = verdict->problem[i];
        say(self, &reply);
    }
}

static void say_changes(const tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    uint32_t listed = verdict->changes < TL_VERDICT_CHANGES ? verdict->changes : TL_VERDICT_CHANGES;
    for (uint32_t i = 0; i < listed; i++) {
        tl_control_reply reply = new_reply(TL_CONTROL_CHANGE);
        reply.more = i + 1 == listed ? verdict->changes - listed : 0;
        reply.as.change = verdict->change[i];
        say(self, &reply);
    }
}

/* In safe hold there is no twin that could take it. */
static bool is_in_place(const tl_activation *self) {
    tl_activation_view view = {.step_s = 0.0};
    self->settings.host->look(self->settings.host->context, &view);
    return self->verdict.kind <= TL_CHANGE_IN_PLACE && !view.holds;
}

static tl_control_right right_of(const tl_verdict *verdict) {
    return verdict->right == TL_CHANGE_BY_RETUNE ? TL_CONTROL_MAY_RETUNE : TL_CONTROL_MAY_COMMISSION;
}

static void activate(tl_activation *self);

static void try_fmus(tl_activation *self);

static void settle(tl_activation *self);

/* It can be read; may it be done, and how? */
static void weigh(tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    say_changes(self);
    if (right_of(verdict) > self->request.right) {
        refuse(self, TL_CONTROL_FORBIDDEN, "it changes what takes the right to commission, and was sent with less");
    } else if (verdict->right == TL_CHANGE_ON_THE_BOX && self->request.origin == TL_CONTROL_BY_NETWORK) {
        refuse(self, TL_CONTROL_FORBIDDEN,
               "it names a library or a file, or lets an FMU out: that is changed on the box, by twinlock reload");
    } else if (!is_in_place(self) && (self->request.flags & (TL_CONTROL_MAY_RESTART | TL_CONTROL_ONLY_CHECK)) == 0) {
        refuse(self, TL_CONTROL_RESTART,
               "it changes what no running twin can take: with --restart the run ends and begins anew, with a gap");
    } else if (!is_in_place(self)) {
        try_fmus(self);
    } else if ((self->request.flags & TL_CONTROL_ONLY_CHECK) != 0) {
        say_end(self, TL_CONTROL_DONE, "it can be activated in place");
        forget(self);
    } else {
        activate(self);
    }
}

static void end_validation(tl_activation *self, tl_errand_state state) {
    char why[TL_ERRAND_WHY];
    char text[TL_CONTROL_TEXT];
    tl_errand_why(&self->errand, why);
    bool is_sound = state == TL_ERRAND_DONE && tl_verdict_take(tl_errand_answer(&self->errand), &self->verdict);
    tl_errand_close(&self->errand);
    if (!is_sound) {
        (void)snprintf(text, sizeof text, "nobody can read it: %s", state == TL_ERRAND_DONE ? "no verdict" : why);
        refuse(self, TL_CONTROL_INVALID, text);
    } else if (self->verdict.is_valid == 0) {
        say_problems(self);
        (void)snprintf(text, sizeof text, "%u %s", self->verdict.problems,
                       self->verdict.problems == 1 ? "problem" : "problems");
        refuse(self, TL_CONTROL_INVALID, text);
    } else if (self->is_return || self->settles) {
        activate(self);
    } else {
        weigh(self);
    }
}

/* ---- try ---- */

static void hear_trial(void *context, const char *line) {
    tl_activation *self = context;
    const char *text = line;
    bool is_cost = tl_log_level_of(line, &text) == TL_LOG_INFO;
    say_step(self, is_cost ? TL_CONTROL_PREDICT : TL_CONTROL_TRY, text);
}

static void try_fmus(tl_activation *self) {
    self->step = TL_CONTROL_TRY;
    say_step(self, TL_CONTROL_TRY, "its FMUs are loaded, started and set back, beside the plant's");
    (void)send_errand(self, TL_TRIAL, 0, TRIAL, hear_trial);
}

static void end_trial(tl_activation *self, tl_errand_state state) {
    char why[TL_ERRAND_WHY];
    char text[TL_CONTROL_TEXT];
    tl_errand_why(&self->errand, why);
    tl_errand_close(&self->errand);
    if (state != TL_ERRAND_DONE) {
        (void)snprintf(text, sizeof text, "it cannot run: %s", why);
        refuse(self, TL_CONTROL_INVALID, text);
    } else if ((self->request.flags & TL_CONTROL_ONLY_CHECK) != 0) {
        say_end(self, TL_CONTROL_DONE, "it can be activated, with a restart of the run");
        forget(self);
    } else {
        activate(self);
    }
}

/* ---- activate ---- */

static tl_probation_terms terms_of(const tl_control_request *request) {
    return (tl_probation_terms){
        .given_s = request->probation_s == 0                       ? TL_ACTIVATION_PROBATION_S
                   : request->probation_s > TL_PROBATION_LONGEST_S ? (uint32_t)TL_PROBATION_LONGEST_S
                                                                   : request->probation_s,
        .require_lock = request->require_lock < 0.0 ? TL_ACTIVATION_LOCK_PERCENT : request->require_lock,
        .must_confirm = (request->flags & TL_CONTROL_BY_PERSON) != 0,
    };
}

static tl_probation_snapshot figures_now(const tl_activation *self) {
    tl_activation_view view = {.step_s = 0.0};
    self->settings.host->look(self->settings.host->context, &view);
    return view.figures;
}

/* Of what begins with a new run. */
static const tl_probation_snapshot *figures_from(const tl_activation *self, const tl_probation_snapshot *now) {
    return is_in_place(self) ? now : NULL;
}

/* Whether the candidate is what stands in the run's own file by now. */
static bool is_own_file(const tl_activation *self) {
    char *bytes = malloc(self->size + 1);
    int file = open(self->settings.path, O_RDONLY | O_CLOEXEC | O_NOCTTY);
    bool is = bytes != NULL && file >= 0 && tl_file_bytes_read(file, bytes, self->size + 1) == (ssize_t)self->size &&
              memcmp(bytes, self->text, self->size) == 0;
    if (file >= 0) {
        (void)close(file);
    }
    free(bytes);
    return is;
}

static tl_version_origin origin_of(const tl_activation *self) {
    if (self->request.origin == TL_CONTROL_BY_NETWORK) {
        return TL_VERSION_BY_NETWORK;
    }
    return is_own_file(self) ? TL_VERSION_BY_RELOAD : TL_VERSION_BY_HAND;
}

static tl_status put_version(tl_activation *self, tl_error *error) {
    const tl_probation_terms terms = terms_of(&self->request);
    const tl_probation_snapshot now = figures_now(self);
    const tl_version_news news = {
        .text = self->text,
        .size = self->size,
        .who = self->request.who,
        .why = self->request.why,
        .origin = origin_of(self),
        .right = (tl_change_right)self->verdict.right,
        .kind = (tl_change_kind)self->verdict.kind,
    };
    uint64_t number = 0;
    tl_status status = tl_versions_add(versions_of(self), &news, &number, error);
    if (status == TL_OK) {
        tl_probation_begin(&self->probation, &terms, &now, figures_from(self, &now));
        status = tl_versions_activate(versions_of(self), number, &self->probation.account, error);
    }
    return status;
}

/* On disk first. */
static tl_status write_down(tl_activation *self, tl_error *error) {
    if (self->settles) {
        return TL_OK;
    }
    return self->is_return ? tl_versions_return(versions_of(self), self->reason, error) : put_version(self, error);
}

static void begin_probation(tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    self->unsaved = 0;
    self->pause = 0;
    self->looked = tl_clock_now(NULL);
    (void)snprintf(text, sizeof text, "%u s; %s", self->probation.account.terms.given_s,
                   self->probation.account.terms.must_confirm ? "it is returned from unless somebody confirms it"
                                                              : "it is kept if the lock holds");
    say_step(self, TL_CONTROL_PROBATION, text);
}

/* What is different now, as far as it fits. */
static void describe_changes(const tl_activation *self, char *text, size_t size) {
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

/* The run is of the version that is active on disk. */
static void note_active(tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    char changes[384];
    const tl_version *active = tl_versions_get(versions_of(self), versions_of(self)->active);
    bool is_return = self->is_return;
    bool settles = self->settles;
    bool is_awaited = self->is_awaited;
    bool is_wanted = self->is_wanted;
    describe_changes(self, changes, sizeof changes);
    (void)snprintf(text, sizeof text, "version %llu (%.12s) is in force%s%s",
                   active == NULL ? 0ULL : (unsigned long long)active->number, active == NULL ? "?" : active->hash,
                   is_return ? ": returned, " : changes, is_return ? self->reason : "");
    tell(self, is_return ? TL_EVENT_WARNING : TL_EVENT_INFO, text);
    forget(self);
    if (settles) {
        return;
    }
    if (is_return) {
        say_step(self, TL_CONTROL_RETURNED, self->reason);
        say_end(self, is_wanted ? TL_CONTROL_DONE : TL_CONTROL_UNDONE, self->reason);
        return;
    }
    begin_probation(self);
    if (!is_awaited) {
        say_end(self, TL_CONTROL_DONE, text);
    }
}

static void restart(tl_activation *self) {
    tell(self, TL_EVENT_WARNING, "the run ends, and begins anew with another configuration");
    say_end(self, self->is_return && !self->is_wanted ? TL_CONTROL_UNDONE : TL_CONTROL_DONE,
            self->is_return ? self->reason : "the run ends, and begins anew with it; then its probation begins");
    forget(self);
    self->settings.host->restart(self->settings.host->context);
}

static void activate(tl_activation *self) {
    tl_error error;
    self->step = TL_CONTROL_ACTIVATE;
    say_step(self, TL_CONTROL_ACTIVATE, is_in_place(self) ? "in place, at the beginning of a tick" : "by a restart");
    if (write_down(self, &error) != TL_OK) {
        fail(self, error.text);
    } else if (!is_in_place(self)) {
        restart(self);
    } else {
        self->waited = 0;
        self->is_handed = false;
        self->looked = tl_clock_now(NULL);
    }
}

static void hand_over(tl_activation *self) {
    const tl_version *active = tl_versions_get(versions_of(self), versions_of(self)->active);
    const tl_activation_tuning tuning = {
        .tuning = &self->verdict.tuning,
        .text = self->text,
        .size = self->size,
        .hash = active->hash,
        .who = active->who,
        .origin = tl_version_origin_name(active->origin),
        .why = self->is_return ? self->reason : active->why,
    };
    self->is_handed = self->settings.host->tune(self->settings.host->context, &tuning);
}

/* Back to what was active before: the disk first, and the run was never of it. A run that cannot be brought to what the disk says begins anew. */
static void give_up(tl_activation *self, const char *why) {
    tl_error error;
    char text[TL_CONTROL_TEXT];
    (void)snprintf(text, sizeof text, "the twin does not take it: %s", why);
    if (self->is_return || self->settles) {
        tell(self, TL_EVENT_ERROR, text);
        restart(self);
        return;
    }
    if (tl_versions_return(versions_of(self), text, &error) != TL_OK) {
        tell(self, TL_EVENT_ERROR, error.text);
    }
    fail(self, text);
    settle(self); /* a twin that was only slow must not take it after all */
}

static void look_at_activation(tl_activation *self, tl_time passed) {
    char why[TL_ACTIVATION_WHY] = "";
    self->waited += passed;
    if (!self->is_handed) {
        hand_over(self);
    }
    tl_activation_news news =
        self->is_handed ? self->settings.host->was_taken(self->settings.host->context, why) : TL_ACTIVATION_WAITS;
    if (news == TL_ACTIVATION_TAKEN) {
        note_active(self);
    } else if (news == TL_ACTIVATION_REFUSED) {
        give_up(self, why);
    } else if (self->waited > TAKING) {
        give_up(self, "it has not answered for 60 s");
    }
}

/* ---- probation, and the way back ---- */

/* The text of a version is the candidate now. */
static bool load(tl_activation *self, uint64_t number) {
    tl_error error;
    const tl_version *version = tl_versions_get(versions_of(self), number);
    free(self->text);
    self->text = NULL;
    if (version == NULL || tl_versions_read(versions_of(self), number, &self->text, &error) != TL_OK) {
        tell(self, TL_EVENT_ERROR, version == NULL ? "the version to return to is not there" : error.text);
        return false;
    }
    self->size = (size_t)version->size;
    return true;
}

static void go_back(tl_activation *self, const char *reason) {
    uint64_t target = versions_of(self)->probation.return_to;
    self->pause = PAUSE;
    (void)snprintf(self->reason, sizeof self->reason, "%s", reason);
    if (load(self, target)) {
        self->is_return = true;
        validate(self);
    } else {
        forget(self);
    }
}

static void keep(tl_activation *self) {
    tl_error error;
    char text[TL_CONTROL_TEXT];
    if (tl_versions_keep(versions_of(self), self->probation.why, &error) != TL_OK) {
        tell(self, TL_EVENT_ERROR, error.text);
        self->pause = PAUSE;
        self->probation.result = TL_PROBATION_GOES_ON; /* whatever is said of it meanwhile counts */
        return;
    }
    (void)snprintf(text, sizeof text, "the configuration in force is kept: %s", self->probation.why);
    tell(self, TL_EVENT_INFO, text);
    self->step = TL_CONTROL_IDLE;
    say_step(self, TL_CONTROL_KEPT, self->probation.why);
    (void)snprintf(text, sizeof text, "version %llu is kept", (unsigned long long)versions_of(self)->active);
    say_end(self, TL_CONTROL_DONE, text);
}

static void save(tl_activation *self, tl_time passed) {
    tl_error error;
    self->unsaved += passed;
    if (self->unsaved >= SAVING) {
        self->unsaved = 0;
        if (tl_versions_pass(versions_of(self), &self->probation.account, &error) != TL_OK) {
            tell(self, TL_EVENT_WARNING, error.text);
        }
    }
}

/* It also goes on while another candidate is looked at. */
static tl_probation_result pass(tl_activation *self, tl_time passed) {
    const tl_probation_snapshot now = figures_now(self);
    tl_probation_result result = tl_probation_feed(&self->probation, passed, &now);
    self->pause = self->pause > passed ? self->pause - passed : 0;
    if (result == TL_PROBATION_GOES_ON) {
        save(self, passed);
    }
    return result;
}

static void look_at_probation(tl_activation *self, tl_time passed) {
    tl_probation_result result = pass(self, passed);
    if (self->pause == 0 && result == TL_PROBATION_KEPT) {
        keep(self);
    } else if (self->pause == 0 && result == TL_PROBATION_RETURN) {
        go_back(self, self->probation.why);
    }
}

/* ---- from outside ---- */

/* The run is of something else than the disk says: a change was not finished. */
static bool is_unfinished(const tl_activation *self) {
    char hash[TL_SHA256_TEXT] = "";
    const tl_version *active = tl_versions_get(versions_of(self), versions_of(self)->active);
    self->settings.host->in_force(self->settings.host->context, hash);
    return active != NULL && strcmp(active->hash, hash) != 0;
}

static void settle(tl_activation *self) {
    if (is_unfinished(self) && load(self, versions_of(self)->active)) {
        self->settles = true;
        validate(self);
    }
}

void tl_activation_begin(tl_activation *activation, const tl_activation_settings *settings) {
    *activation = (tl_activation){.settings = *settings, .step = TL_CONTROL_IDLE, .looked = tl_clock_now(NULL)};
    if (settings->versions->probation.version != 0) {
        tl_probation_resume(&activation->probation, &settings->versions->probation.account);
        activation->step = TL_CONTROL_PROBATION;
    }
    settle(activation);
}

bool tl_activation_is_idle(const tl_activation *activation) {
    return activation->step == TL_CONTROL_IDLE;
}

bool tl_activation_is_busy(const tl_activation *activation) {
    return activation->step != TL_CONTROL_IDLE && activation->step != TL_CONTROL_PROBATION;
}

uint32_t tl_activation_left_s(const tl_activation *activation) {
    bool is_on = versions_of(activation)->probation.version != 0;
    return is_on ? (uint32_t)((activation->probation.account.left_ms + 999) / 1000) : 0;
}

static bool is_of_active(const tl_activation *self) {
    const tl_version *active = tl_versions_get(versions_of(self), versions_of(self)->active);
    return active != NULL && strcmp(active->hash, self->request.hash) == 0;
}

static bool is_as_expected(const tl_activation *self) {
    const tl_version *active = tl_versions_get(versions_of(self), versions_of(self)->active);
    return self->request.if_match[0] == '\0' || (active != NULL && strcmp(active->hash, self->request.if_match) == 0);
}

static bool copy_text(tl_activation *self, const char *text, size_t size) {
    self->text = malloc(size + 1);
    if (self->text == NULL) {
        return false;
    }
    memcpy(self->text, text, size);
    self->text[size] = '\0';
    self->size = size;
    return true;
}

void tl_activation_take(tl_activation *activation, const tl_control_request *request, const char *text, size_t size) {
    activation->request = *request;
    activation->is_awaited = (request->flags & TL_CONTROL_WAIT) != 0;
    activation->step = TL_CONTROL_AUTHORISE;
    say_step(activation, TL_CONTROL_AUTHORISE, tl_control_right_name((tl_control_right)request->right));
    if (request->right < TL_CONTROL_MAY_RETUNE) {
        refuse(activation, TL_CONTROL_FORBIDDEN, "it was sent with the right to read only");
    } else if (!is_as_expected(activation)) {
        refuse(activation, TL_CONTROL_CHANGED, "somebody has changed the configuration meanwhile: look at it first");
    } else if (is_of_active(activation)) {
        say_end(activation, TL_CONTROL_SAME, "that is what is active");
        forget(activation);
    } else if (memchr(text, '\0', size) != NULL) {
        refuse(activation, TL_CONTROL_INVALID, "it holds a byte 0: it is no text");
    } else if (!copy_text(activation, text, size)) {
        fail(activation, "not enough memory");
    } else {
        validate(activation);
    }
}

bool tl_activation_confirm(tl_activation *activation, const char *who, bool *is_done) {
    if (activation->step != TL_CONTROL_PROBATION) {
        return false;
    }
    activation->pause = 0;
    (void)tl_probation_confirm(&activation->probation, who);
    look_at_probation(activation, 0);
    *is_done = versions_of(activation)->probation.version == 0;
    return true;
}

bool tl_activation_refuse(tl_activation *activation, const char *who) {
    char why[TL_PROBATION_WHY];
    if (activation->step != TL_CONTROL_PROBATION) {
        return false;
    }
    (void)snprintf(why, sizeof why, "%s has returned from it", who);
    activation->pause = 0;
    activation->is_wanted = true;
    (void)tl_probation_refuse(&activation->probation, why);
    look_at_probation(activation, 0);
    return true;
}

void tl_activation_look(tl_activation *activation) {
    tl_time now = tl_clock_now(NULL);
    tl_time passed = now - activation->looked;
    activation->looked = now;
    if (activation->step == TL_CONTROL_VALIDATE || activation->step == TL_CONTROL_TRY) {
        tl_errand_state state = tl_errand_look(&activation->errand);
        if (versions_of(activation)->probation.version != 0) {
            (void)pass(activation, passed);
        }
        if (state != TL_ERRAND_GOES_ON && activation->step == TL_CONTROL_VALIDATE) {
            end_validation(activation, state);
        } else if (state != TL_ERRAND_GOES_ON) {
            end_trial(activation, state);
        }
    } else if (activation->step == TL_CONTROL_ACTIVATE) {
        look_at_activation(activation, passed);
    } else if (activation->step == TL_CONTROL_PROBATION) {
        look_at_probation(activation, passed);
    }
}

void tl_activation_end(tl_activation *activation) {
    if (activation->step == TL_CONTROL_PROBATION) {
        tl_error error;
        (void)tl_versions_pass(versions_of(activation), &activation->probation.account, &error);
    }
    tl_errand_close(&activation->errand);
    free(activation->text);
    free(activation->before);
    activation->text = NULL;
    activation->before = NULL;
}
