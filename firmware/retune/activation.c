/* A change of the configuration, from the candidate to the end of its probation: see activation.h. */
#include "firmware/retune/activation.h"

#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/retune/box_texts.h"

/* ---- In this order: what all sections use, messages, the change, the candidate, its twin beside the run's, the probation. ---- */

static inline tl_versions *tl_activation_versions(const tl_activation *self) {
    return self->settings.versions;
}

static inline const tl_version *tl_activation_active(const tl_activation *self) {
    const tl_versions *versions = self->settings.versions;
    return tl_versions_get(versions, versions->active);
}

static inline tl_activation_view tl_activation_view_now(const tl_activation *self) {
    tl_activation_view view = {.step_s = 0.0};
    self->settings.host->look(self->settings.host->context, &view);
    return view;
}

/* For so long a step may wait before somebody is told why. */
#define TL_ACTIVATION_SILENCE (2 * TL_SECOND)
#define TL_ACTIVATION_WAITING                                                                                          \
    "it waits until what the last change has left is recorded: a full or slow disk, or database, holds that up"

/* ---- words: to who has asked, or for the log and the events ---- */

/* ---- the ends of a change ---- */

/* ---- the candidate ---- */

/* ---- its twin beside the run's ---- */

static void tl_activation_begin_shadow(tl_activation *self);

static void tl_activation_make_no_room(tl_activation *self, const char *why);

static void tl_activation_end_shadow(tl_activation *self);

/* ---- the change ---- */

static bool tl_activation_is_unfinished(const tl_activation *self);

/* ---- probation, and the way back ---- */

static void tl_activation_show_yardstick(const tl_activation *self);

static tl_probation_result tl_activation_pass(tl_activation *self, tl_time passed);

static bool tl_activation_keep(tl_activation *self);

static void tl_activation_settle(tl_activation *self);

/* ---- activation words ---- */

static tl_control_reply new_reply(tl_control_kind kind) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = (uint32_t)kind;
    return reply;
}

static void say(const tl_activation *self, const tl_control_reply *reply) {
    self->settings.say(self->settings.listener, reply);
}

static void tl_activation_say(const tl_activation *self, tl_control_step step, const char *text) {
    tl_control_reply reply = new_reply(TL_CONTROL_STEP);
    reply.as.progress.step = (uint32_t)step;
    reply.as.progress.left_s = tl_activation_left_s(self);
    (void)snprintf(reply.as.progress.text, sizeof reply.as.progress.text, "%s", text);
    say(self, &reply);
}

static void tl_activation_say_end(const tl_activation *self, tl_control_result result, const char *text) {
    tl_control_reply reply = new_reply(TL_CONTROL_END);
    const tl_version *active = tl_activation_active(self);
    reply.as.end.result = (uint32_t)result;
    if (active != NULL) {
        reply.as.end.version = active->number;
        memcpy(reply.as.end.hash, active->hash, sizeof reply.as.end.hash);
    }
    (void)snprintf(reply.as.end.text, sizeof reply.as.end.text, "%s", text);
    say(self, &reply);
}

static void tl_activation_tell(const tl_activation *self, tl_severity severity, const char *text) {
    self->settings.host->tell(self->settings.host->context, severity, text);
}

static void tl_activation_say_problem(const tl_activation *self, const tl_control_problem *problem, uint32_t more) {
    tl_control_reply reply = new_reply(TL_CONTROL_PROBLEM);
    reply.more = more;
    reply.as.problem = *problem;
    say(self, &reply);
}

static void tl_activation_say_problems(const tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    uint32_t listed = verdict->problems < TL_VERDICT_PROBLEMS ? verdict->problems : TL_VERDICT_PROBLEMS;
    for (uint32_t i = 0; i < listed; i++) {
        tl_activation_say_problem(self, &verdict->problem[i], i + 1 == listed ? verdict->problems - listed : 0);
    }
}

static void tl_activation_say_changes(const tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    uint32_t listed = verdict->changes < TL_VERDICT_CHANGES ? verdict->changes : TL_VERDICT_CHANGES;
    for (uint32_t i = 0; i < listed; i++) {
        tl_control_reply reply = new_reply(TL_CONTROL_CHANGE);
        reply.more = i + 1 == listed ? verdict->changes - listed : 0;
        reply.as.change = verdict->change[i];
        say(self, &reply);
    }
}

/* What is different now, as far as it fits. */
static void tl_activation_write_changes(const tl_activation *self, char *text, size_t size) {
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

/* Keys that only a new run can take, as far as they are listed. */
static size_t write_keys(const tl_verdict *verdict, char *text, size_t size) {
    const char *restart = tl_change_kinds[TL_CHANGE_RESTART];
    size_t found = 0;
    for (uint32_t i = 0; i < verdict->changes && i < TL_VERDICT_CHANGES; i++) {
        size_t length = strlen(text);
        if (strcmp(verdict->change[i].kind, restart) == 0 && found++ < 3) {
            (void)snprintf(text + length, size - length, "%s%s", length == 0 ? "" : ", ", verdict->change[i].path);
        }
    }
    return found;
}

/* Why it takes a restart, which was not allowed. */
static void tl_activation_write_restart(const tl_activation *self, char *text, size_t size) {
    char keys[512] = "";
    if (tl_activation_view_now(self).holds) {
        (void)snprintf(text, size, "the run is in safe hold: with --restart it ends and begins anew");
        return;
    }
    size_t found = write_keys(&self->verdict, keys, sizeof keys);
    (void)snprintf(text, size, "%s%s: with --restart the run ends and begins anew, with a gap",
                   found == 0 ? "it changes what only a new run can take" : "only a new run can take ", keys);
}

/* Says at this step what its lock can be judged by, unless `time` of live samples is surely enough for that; `option` gives more, of which `lead_in` does
 * not count. */
static void tl_activation_say_window(const tl_activation *self, tl_control_step step, tl_time time, tl_time lead_in,
                                     const char *option) {
    const tl_verdict *verdict = &self->verdict;
    char text[TL_CONTROL_TEXT];
    if (verdict->strokes != 0) {
        (void)snprintf(text, sizeof text,
                       "its lock is judged by strokes that have ended, and by %u of them at first: if they do not come "
                       "within %.3g s, it is not judged here; %s S gives it more",
                       verdict->strokes, tl_seconds(time), option);
    } else if (verdict->window > time) {
        (void)snprintf(text, sizeof text, "its lock is judged over %.3g s, and this gives it %.3g s: use %s %.0f",
                       tl_seconds(verdict->window), tl_seconds(time), option,
                       ceil(tl_seconds(verdict->window + lead_in)));
    } else {
        return;
    }
    tl_activation_say(self, step, text);
}

/* ---- the ends of a change ---- */

static void tl_activation_forget(tl_activation *self) {
    if (self->rehearsal.is_begun) {
        tl_activation_end_shadow(self);
    }
    tl_worker_close(&self->worker);
    free(self->text);
    free(self->before);
    self->text = NULL;
    self->before = NULL;
    self->is_return = false;
    self->is_wanted = false;
    self->settles = false;
    self->is_handed = false;
    self->step = tl_activation_versions(self)->probation.version != 0 ? TL_CONTROL_PROBATION : TL_CONTROL_IDLE;
}

/* Not of what was only to be looked at. The log and the events have it too, so a disk that refuses it is told no second time. */
static void keep_refusal(const tl_activation *self, tl_control_result result, const char *text) {
    const tl_control_request *request = &self->request;
    tl_refused news;
    tl_error error;
    if ((request->flags & TL_CONTROL_ONLY_CHECK) != 0) {
        return;
    }
    memset(&news, 0, sizeof news);
    memcpy(news.hash, request->hash, sizeof news.hash);
    (void)snprintf(news.origin, sizeof news.origin, "%s", tl_change_origins[request->origin]);
    (void)snprintf(news.result, sizeof news.result, "%s", result == TL_CONTROL_CANCELLED ? "cancelled" : "refused");
    (void)snprintf(news.who, sizeof news.who, "%s", request->who);
    (void)snprintf(news.why, sizeof news.why, "%s", request->why);
    (void)snprintf(news.reason, sizeof news.reason, "%.*s", (int)sizeof news.reason - 1, text);
    (void)tl_refusals_add(self->settings.refusals, &news, &error);
}

/* Nothing came of it. */
static void tl_activation_turn_down(tl_activation *self, tl_control_result result, const char *text) {
    char line[TL_CONTROL_TEXT + 128];
    (void)snprintf(line, sizeof line, "a configuration of %s was %s%s", self->request.who,
                   result == TL_CONTROL_CANCELLED ? "cancelled " : "refused: ", text);
    tl_activation_tell(self, TL_EVENT_WARNING, line);
    keep_refusal(self, result, text);
    tl_activation_say_end(self, result, text);
    tl_activation_forget(self);
}

/* What is known and cannot be brought about: tried again by whoever asks next, or begins next. */
static void tl_activation_fail(tl_activation *self, const char *text) {
    char line[TL_CONTROL_TEXT + 128];
    (void)snprintf(line, sizeof line, "the configuration could not be changed: %s", text);
    tl_activation_tell(self, TL_EVENT_ERROR, line);
    tl_activation_say_end(self, TL_CONTROL_FAILED, text);
    tl_activation_forget(self);
}

/* ---- activation change ---- */

/* A twin takes a tuning at its next tick; a new one begins meanwhile, perhaps. */
static const tl_time TAKING = 60 * TL_SECOND;

/* Percent of the steps, in a shadow's comparison and on probation. */
static double tl_activation_required_lock(const tl_control_request *request) {
    return request->require_lock < 0.0 ? TL_ACTIVATION_LOCK_PERCENT : request->require_lock;
}

/* Seconds. With the right to retune it is at least as long as the lock takes to be judged twice. */
static uint32_t length_of(const tl_activation *self) {
    const tl_control_request *request = &self->request;
    tl_time given = request->probation_s == 0 ? TL_ACTIVATION_PROBATION_S : (tl_time)request->probation_s;
    tl_time least = request->right < TL_RIGHT_COMMISSION ? 2 * self->verdict.window / TL_SECOND + 1 : 1;
    given = given > least ? given : least;
    return (uint32_t)(given < TL_PROBATION_LONGEST_S ? given : TL_PROBATION_LONGEST_S);
}

static tl_probation_terms terms_of(const tl_activation *self) {
    const tl_control_request *request = &self->request;
    return (tl_probation_terms){
        .given_s = length_of(self),
        .require_lock = tl_activation_required_lock(request),
        .must_confirm = (request->flags & TL_CONTROL_BY_PERSON) != 0,
    };
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

static tl_change_origin origin_of(const tl_activation *self) {
    tl_change_origin origin = (tl_change_origin)self->request.origin;
    return origin == TL_ORIGIN_RELOAD && !is_own_file(self) ? TL_ORIGIN_HAND : origin;
}

static tl_status put_version(tl_activation *self, tl_error *error) {
    const tl_probation_terms terms = terms_of(self);
    const tl_run_status now = tl_activation_view_now(self).figures;
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
    tl_status status = tl_versions_add(tl_activation_versions(self), &news, &number, error);
    if (status == TL_OK) {
        tl_probation_begin(&self->probation, &terms, &now,
                           self->way == TL_ACTIVATION_IN_PLACE ? &now : NULL); /* another run counts from 0 */
        self->probation.account.yardstick = self->verdict.yardstick;
        (void)snprintf(self->probation.account.widened, TL_PROBATION_WIDENED, "%s", self->verdict.widened);
        status = tl_versions_activate(tl_activation_versions(self), number, &self->probation.account, error);
    }
    return status;
}

/* On disk first. */
static tl_status write_down(tl_activation *self, tl_error *error) {
    if (self->settles) {
        return TL_OK;
    }
    return self->is_return ? tl_versions_settle(tl_activation_versions(self), TL_VERSION_RETURNED, self->reason, error)
                           : put_version(self, error);
}

static void begin_probation(tl_activation *self) {
    const tl_probation_terms *terms = &self->probation.account.terms;
    char text[TL_CONTROL_TEXT];
    self->unsaved = 0;
    self->pause = 0;
    self->looked = tl_clock_now(NULL);
    (void)snprintf(text, sizeof text, "%u s; %s", terms->given_s,
                   terms->must_confirm ? "it is returned from unless somebody confirms it"
                                       : "it is kept if the lock holds");
    tl_activation_say(self, TL_CONTROL_PROBATION, text);
    if (terms->require_lock > 0.0 && !terms->must_confirm) {
        tl_activation_say_window(self, TL_CONTROL_PROBATION, (tl_time)terms->given_s * TL_SECOND, 0, "--probation");
    }
}

/* The twin before is in the other place now: of use only if it is what would be returned to. */
static void end_flip(tl_activation *self) {
    const tl_versions *versions = tl_activation_versions(self);
    const tl_version *before = tl_versions_get(versions, versions->probation.return_to);
    self->rehearsal.is_begun = false; /* its twin is the run's */
    if (self->is_return || before == NULL || strcmp(before->hash, self->leaving) != 0) {
        tl_activation_end_shadow(self);
    }
}

static void say_returned(const tl_activation *self, bool is_flip, bool is_wanted) {
    char text[TL_CONTROL_TEXT];
    (void)snprintf(text, sizeof text, "%s%s", is_flip ? "by a flip: " : "", self->reason);
    tl_activation_say(self, TL_CONTROL_RETURNED, text);
    const tl_version *active = tl_versions_get(tl_activation_versions(self), tl_activation_versions(self)->active);
    (void)snprintf(text, sizeof text, "version %llu is in force: %s",
                   active == NULL ? 0ULL : (unsigned long long)active->number, self->reason);
    tl_activation_say_end(self, is_wanted ? TL_CONTROL_DONE : TL_CONTROL_UNDONE, text);
}

/* For the database, in which a tuning has who brought it, by which way and why, and a run has not. */
static void tell_origin(const tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    const tl_version *active = tl_activation_active(self);
    if (active != NULL) {
        (void)snprintf(text, sizeof text, "version %llu is of %s, by %s%s%s", (unsigned long long)active->number,
                       active->who, tl_change_origins[active->origin], active->why[0] == '\0' ? "" : ": ", active->why);
        tl_activation_tell(self, TL_EVENT_INFO, text);
    }
}

/* The run is of the version that is active on disk. */
static void note_active(tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    char changes[384];
    const tl_version *active = tl_activation_active(self);
    bool is_return = self->is_return;
    bool settles = self->settles;
    bool is_wanted = self->is_wanted;
    bool is_flip = self->way == TL_ACTIVATION_BY_FLIP;
    tl_activation_write_changes(self, changes, sizeof changes);
    (void)snprintf(text, sizeof text, "version %llu (%.12s) is in force%s%s",
                   active == NULL ? 0ULL : (unsigned long long)active->number, active == NULL ? "?" : active->hash,
                   is_return ? is_flip ? ": returned, by a flip: " : ": returned, " : changes,
                   is_return ? self->reason : "");
    tl_activation_tell(self, is_return ? TL_EVENT_WARNING : TL_EVENT_INFO, text);
    if (is_flip) {
        tell_origin(self);
        end_flip(self);
    }
    tl_activation_forget(self);
    if (settles) {
        return;
    }
    if (is_return) {
        say_returned(self, is_flip, is_wanted);
        return;
    }
    begin_probation(self);
    if (!self->is_awaited) {
        tl_activation_say_end(self, TL_CONTROL_DONE, text);
    }
}

static void restart(tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    (void)snprintf(text, sizeof text, "the run ends, and begins anew with another configuration: version %llu",
                   (unsigned long long)tl_activation_versions(self)->active);
    tl_activation_tell(self, TL_EVENT_WARNING, text);
    tell_origin(self);
    tl_activation_say_end(self, self->is_return && !self->is_wanted ? TL_CONTROL_UNDONE : TL_CONTROL_DONE,
                          self->is_return ? self->reason
                                          : "the run ends, and begins anew with it; then its probation begins");
    tl_activation_forget(self);
    self->settings.host->restart(self->settings.host->context);
}

static void tl_activation_activate(tl_activation *self) {
    static const char *const words[] = {[TL_ACTIVATION_IN_PLACE] = "in place, at the beginning of a tick",
                                        [TL_ACTIVATION_BY_FLIP] = "between two ticks, by the other twin",
                                        [TL_ACTIVATION_BY_RESTART] = "by a restart"};
    tl_error error;
    self->step = TL_CONTROL_ACTIVATE;
    tl_activation_say(self, TL_CONTROL_ACTIVATE, words[self->way]);
    self->settings.host->in_force(self->settings.host->context, self->leaving);
    if (write_down(self, &error) != TL_OK) {
        tl_activation_fail(self, error.text);
    } else if (self->way == TL_ACTIVATION_BY_RESTART) {
        restart(self);
    } else {
        tl_activation_show_yardstick(self); /* before the twin takes the change */
        self->waited = 0;
        self->is_handed = false;
        self->looked = tl_clock_now(NULL);
    }
}

/* The plant does not wait for another twin to be tried beside: what takes one is by a restart. */
static void tl_activation_bring_back(tl_activation *self, tl_activation_way way) {
    if (self->settles && !tl_activation_is_unfinished(self)) {
        tl_activation_forget(self); /* a flip that was ordered before has come meanwhile */
        return;
    }
    self->way = way;
    tl_activation_activate(self);
}

static void hand_over(tl_activation *self) {
    const tl_version *active = tl_activation_active(self);
    const tl_activation_tuning tuning = {
        .tuning = &self->verdict.tuning,
        .text = self->text,
        .size = self->size,
        .hash = active->hash,
        .who = active->who,
        .origin = tl_change_origins[active->origin],
        .why = self->is_return ? self->reason : active->why,
    };
    self->is_handed = self->settings.host->tune(self->settings.host->context, &tuning);
}

/* Back to what was active before: the disk first, and the run was never of it. A run that cannot be brought to what the disk says begins anew. */
static void give_up(tl_activation *self, const char *why) {
    tl_error error;
    char text[TL_CONTROL_TEXT];
    (void)snprintf(
        text, sizeof text, "%s: %s",
        self->way == TL_ACTIVATION_BY_FLIP ? "the other twin could not take over" : "the twin does not take it", why);
    if (self->is_return || self->settles) {
        tl_activation_tell(self, TL_EVENT_ERROR, text);
        restart(self);
        return;
    }
    if (tl_versions_settle(tl_activation_versions(self), TL_VERSION_RETURNED, text, &error) != TL_OK) {
        tl_activation_tell(self, TL_EVENT_ERROR, error.text);
    }
    tl_activation_fail(self, text);
    tl_activation_settle(self); /* a twin that was only slow must not take it after all */
}

/* To the twin that runs, or to the one beside it. */
static tl_activation_news look_at_host(tl_activation *self, char why[TL_ACTIVATION_WHY]) {
    const tl_activation_host *host = self->settings.host;
    bool is_flip = self->way == TL_ACTIVATION_BY_FLIP;
    if (!self->is_handed && is_flip) {
        self->is_handed = host->flip(host->context);
    } else if (!self->is_handed) {
        hand_over(self);
    }
    if (!self->is_handed) {
        return TL_ACTIVATION_WAITS;
    }
    return is_flip ? host->has_flipped(host->context, why) : host->was_taken(host->context, why);
}

/* Once. */
static void say_waiting(const tl_activation *self, tl_time passed) {
    bool is_time = self->waited > TL_ACTIVATION_SILENCE && self->waited - passed <= TL_ACTIVATION_SILENCE;
    if (is_time) {
        tl_activation_say(self, TL_CONTROL_ACTIVATE,
                          self->is_handed ? "the twin has not answered yet; it has 60 s" : TL_ACTIVATION_WAITING);
    }
}

static void tl_activation_look_at_change(tl_activation *self, tl_time passed) {
    char why[TL_ACTIVATION_WHY] = "";
    self->waited += passed;
    tl_activation_news news = look_at_host(self, why);
    if (news == TL_ACTIVATION_WAITS) {
        say_waiting(self, passed);
    }
    if (news == TL_ACTIVATION_TAKEN) {
        note_active(self);
    } else if (news == TL_ACTIVATION_REFUSED) {
        give_up(self, why);
    } else if (self->waited > TAKING) {
        give_up(self, "it has not answered for 60 s");
    }
}

/* ---- activation candidate ---- */

/* Reading a text of 256 KiB takes milliseconds; a loaded box has other things to do. Loading FMUs takes what it takes. */
static const tl_time VALIDATION = 20 * TL_SECOND;
static const tl_time TRIAL = 180 * TL_SECOND;
static const tl_time SAYING = 10 * TL_SECOND;

/* ---- validate ---- */

/* What the candidate is compared with, beside what is in force; NULL: not known, or the same. */
typedef struct beside {
    char *list, *file;         /* what the box says of names */
    char *kept, *commissioned; /* texts of versions: that a probation would return to, that was commissioned last */
} beside;

static void start_worker(tl_activation *self, tl_worker_kind kind, const beside *others, tl_time limit,
                         tl_relay_line *hear) {
    tl_error error;
    const tl_worker_settings settings = {
        .plant = self->settings.plant,
        .job = {.kind = kind,
                .text = {[TL_WORKER_PATH] = self->settings.path,
                         [TL_WORKER_CANDIDATE] = self->text,
                         [TL_WORKER_IN_FORCE] = self->before,
                         [TL_WORKER_KEPT] = others->kept,
                         [TL_WORKER_COMMISSIONED] = others->commissioned,
                         [TL_WORKER_ON_THE_BOX] = others->file,
                         [TL_WORKER_LIST] = others->list,
                         [TL_WORKER_LIST_PATH] = self->settings.allowed},
                .memory_limit = self->settings.memory_limit,
                .unconfined = self->settings.unconfined},
        .limit = limit,
        .be = self->settings.be,
        .hear = hear,
        .context = self,
    };
    if (tl_worker_start(&self->worker, &settings, &error) != TL_OK) {
        tl_activation_fail(self, error.text);
    }
}

/* NULL: there is no such version, or it cannot be read. */
static char *read_text_of(const tl_activation *self, const tl_version *version) {
    tl_error ignored;
    char *text = NULL;
    if (version != NULL) {
        (void)tl_versions_read(tl_activation_versions(self), version->number, &text, &ignored);
    }
    return text;
}

static void send_validator(tl_activation *self) {
    char fault[TL_BOX_FAULT] = "";
    const char *list_path = self->settings.allowed;
    const tl_versions *versions = tl_activation_versions(self);
    const beside found = {
        .list = list_path == NULL ? NULL : tl_box_read_list(list_path, fault),
        .file = tl_box_read_file(self->settings.path),
        .kept = read_text_of(self, tl_versions_get(versions, versions->probation.return_to)),
        .commissioned = read_text_of(self, tl_versions_commissioned(versions)),
    };
    if (fault[0] != '\0') {
        tl_activation_say(self, TL_CONTROL_VALIDATE, fault);
    }
    start_worker(self, TL_WORKER_VALIDATOR, &found, VALIDATION, NULL); /* the verdict says all */
    free(found.list);
    free(found.file);
    free(found.kept);
    free(found.commissioned);
}

/* What runs is in memory too. */
static char *read_running(const tl_activation *self, const tl_version *version) {
    const tl_activation_host *host = self->settings.host;
    tl_error error;
    size_t size = 0;
    char line[TL_CONTROL_TEXT];
    char *text = host->text == NULL ? NULL : malloc(TL_CONTROL_MOST + 1);
    if (text == NULL || !host->text(host->context, version->hash, text, &size)) {
        free(text);
        return NULL;
    }
    bool is_mended = tl_versions_mend(tl_activation_versions(self), version->number, text, size, &error) == TL_OK;
    (void)snprintf(
        line, sizeof line, "the text of version %llu was damaged on disk, and %s%s",
        (unsigned long long)version->number,
        is_mended ? "is written anew from the run's memory" : "cannot be written anew: ", is_mended ? "" : error.text);
    tl_activation_tell(self, is_mended ? TL_EVENT_WARNING : TL_EVENT_ERROR, line);
    return text;
}

/* The text of a version, the caller's to free(). If it is damaged on disk it is taken from the run's memory, and written anew: that is told. */
static tl_status tl_activation_read(const tl_activation *activation, const tl_version *version, char **text,
                                    tl_error *error) {
    tl_error cause;
    tl_status status = tl_versions_read(tl_activation_versions(activation), version->number, text, &cause);
    if (status == TL_OK) {
        return TL_OK;
    }
    *text = read_running(activation, version);
    return *text != NULL
               ? TL_OK
               : tl_fail(error, status,
                         "%.700s; start the run anew: it begins with the newest version that can be read", cause.text);
}

/* Against what the run is of. */
static void tl_activation_validate(tl_activation *self, const tl_version *in_force) {
    tl_error error;
    self->step = TL_CONTROL_VALIDATE;
    tl_activation_say(self, TL_CONTROL_VALIDATE, "the text is read, and held against the active one");
    free(self->before);
    self->before = NULL;
    if (in_force == NULL) {
        tl_activation_fail(self, "no version is active");
        return;
    }
    if (tl_activation_read(self, in_force, &self->before, &error) != TL_OK) {
        tl_activation_fail(self, error.text);
        return;
    }
    send_validator(self);
}

/* In safe hold there is no twin that could take anything, or be compared with. */
static tl_activation_way way_of(const tl_activation *self) {
    if (self->verdict.kind == TL_CHANGE_RESTART || tl_activation_view_now(self).holds) {
        return TL_ACTIVATION_BY_RESTART;
    }
    return self->verdict.kind >= TL_CHANGE_NEW_TWIN ? TL_ACTIVATION_BY_FLIP : TL_ACTIVATION_IN_PLACE;
}

/* That a request must have. What only the box may change is told by its origin. */
static uint32_t right_of(const tl_verdict *verdict) {
    return verdict->right < TL_RIGHT_BOX ? verdict->right : TL_RIGHT_COMMISSION;
}

static void try_fmus(tl_activation *self);

/* It is known to be good: it is activated, unless it was to be checked only. */
static void tl_activation_conclude(tl_activation *self) {
    static const char *const words[] = {[TL_ACTIVATION_IN_PLACE] = "it can be activated in place",
                                        [TL_ACTIVATION_BY_FLIP] = "it can be activated without a gap",
                                        [TL_ACTIVATION_BY_RESTART] = "it can be activated, with a restart of the run"};
    if ((self->request.flags & TL_CONTROL_ONLY_CHECK) != 0) {
        tl_activation_say_end(self, TL_CONTROL_DONE, words[self->way]);
        tl_activation_forget(self);
    } else {
        tl_activation_activate(self);
    }
}

/* Whoever has compared the texts could not see it. */
static void take_other_fmus(tl_activation *self) {
    self->verdict.kind = TL_CHANGE_NEW_TWIN;
    self->verdict.right = TL_RIGHT_COMMISSION;
    tl_activation_say(
        self, TL_CONTROL_VALIDATE,
        "it is the active one, but an FMU's file is another than the one that the twin has loaded (new twin); "
        "the old file is gone, so a way back is by the twin before only");
}

/* It can be read; may it be done, and how? */
static void weigh(tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    char text[TL_CONTROL_TEXT];
    tl_activation_say_changes(self);
    if (self->has_other_fmus) {
        take_other_fmus(self);
    }
    self->way = way_of(self);
    bool is_allowed = (self->request.flags & (TL_CONTROL_MAY_RESTART | TL_CONTROL_ONLY_CHECK)) != 0;
    if (verdict->right == TL_RIGHT_BOX && self->request.origin != TL_ORIGIN_RELOAD) {
        tl_activation_say_problems(self);
        tl_activation_turn_down(
            self, TL_CONTROL_FORBIDDEN,
            "it names a library, a file or an FMU that nobody on the box has named, or lets an FMU out: that is changed "
            "on the box, by twinlock reload without --right");
    } else if (right_of(verdict) > self->request.right) {
        tl_activation_say_problems(self);
        tl_activation_turn_down(self, TL_CONTROL_FORBIDDEN,
                                "it changes what takes the right to commission, and was sent with less");
    } else if (self->way == TL_ACTIVATION_BY_RESTART && !is_allowed) {
        tl_activation_write_restart(self, text, sizeof text);
        tl_activation_turn_down(self, TL_CONTROL_RESTART, text);
    } else if (self->way == TL_ACTIVATION_IN_PLACE) {
        tl_activation_conclude(self);
    } else {
        try_fmus(self);
    }
}

static void end_validation(tl_activation *self, tl_worker_state state) {
    char why[TL_WORKER_REASON];
    char text[TL_CONTROL_TEXT];
    tl_worker_reason(&self->worker, why);
    bool is_sound = state == TL_WORKER_DONE && tl_verdict_take(self->worker.result.bytes, &self->verdict);
    tl_worker_close(&self->worker);
    if (!is_sound) {
        (void)snprintf(text, sizeof text, "nobody can read it: %s", state == TL_WORKER_DONE ? "no verdict" : why);
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
    } else if (self->verdict.is_valid == 0) {
        tl_activation_say_problems(self);
        (void)snprintf(text, sizeof text, "%u %s", self->verdict.problems,
                       self->verdict.problems == 1 ? "problem" : "problems");
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
    } else if (self->is_return || self->settles) {
        tl_activation_way way = way_of(self);
        tl_activation_bring_back(self, way == TL_ACTIVATION_BY_FLIP ? TL_ACTIVATION_BY_RESTART : way);
    } else {
        weigh(self);
    }
}

/* ---- try ---- */

/* The name of the run's file is none that the sender knows. */
static const char *without_file(const tl_activation *self, const char *text) {
    size_t length = strlen(self->settings.path);
    bool is_named = strncmp(text, self->settings.path, length) == 0 && strncmp(text + length, ": ", 2) == 0;
    return is_named ? text + length + 2 : text;
}

/* "PATH: line 7: synchronise.margin: …": the file was never that of the run, which its processes know by name. False: it is something else. */
static bool say_problem(const tl_activation *self, const char *text) {
    tl_control_problem problem;
    char *end = NULL;
    const char *rest = without_file(self, text);
    if (rest == text) {
        return false;
    }
    memset(&problem, 0, sizeof problem);
    if (strncmp(rest, "line ", strlen("line ")) == 0) {
        unsigned long number = strtoul(rest + strlen("line "), &end, 10);
        bool is_number = end != rest + strlen("line ") && strncmp(end, ": ", 2) == 0;
        problem.line = is_number ? (uint32_t)number : 0;
        rest = is_number ? end + 2 : rest;
    }
    const char *colon = strstr(rest, ": ");
    size_t key = colon == NULL ? 0 : (size_t)(colon - rest);
    if (key > 0 && key < sizeof problem.path && strcspn(rest, " ") > key) {
        memcpy(problem.path, rest, key);
        rest = colon + 2;
    }
    (void)snprintf(problem.text, sizeof problem.text, "%s", rest);
    tl_activation_say_problem(self, &problem, 0);
    return true;
}

static void hear_trial(void *context, const char *line) {
    tl_activation *self = context;
    const char *text = line;
    int level = tl_log_level_of(line, &text);
    self->told = self->waited;
    if (say_problem(self, text)) {
        self->problems++;
    } else if (level == TL_LOG_ERROR && self->heard[0] == '\0') {
        (void)snprintf(self->heard, sizeof self->heard, "%s", text); /* said at the end, and once */
    } else {
        tl_activation_say(self, TL_CONTROL_TRY, text);
    }
}

static void try_fmus(tl_activation *self) {
    self->step = TL_CONTROL_TRY;
    self->waited = 0;
    self->told = 0;
    self->heard[0] = '\0';
    self->problems = 0;
    tl_activation_say(self, TL_CONTROL_TRY, "its FMUs are loaded, started and set back, beside the plant's");
    start_worker(self, TL_WORKER_TRIAL, &(const beside){NULL, NULL, NULL, NULL}, TRIAL, hear_trial);
}

static void say_time(tl_activation *self) {
    char text[TL_FORECAST_TEXT];
    self->step = TL_CONTROL_PREDICT;
    tl_forecast_write_time(&self->answer, text);
    tl_activation_say(self, TL_CONTROL_PREDICT, text);
}

/* What it will take of the box, and whether that is there. */
static void predict(tl_activation *self) {
    char text[TL_FORECAST_TEXT];
    char line[TL_CONTROL_TEXT];
    uint64_t left = tl_forecast_memory_left();
    say_time(self);
    tl_forecast_write_memory(&self->answer, left, text);
    tl_activation_say(self, TL_CONTROL_PREDICT, text);
    switch (tl_forecast_of(&self->answer, left, text)) {
    case TL_FORECAST_POSSIBLE:
        tl_activation_begin_shadow(self);
        break;
    case TL_FORECAST_TOO_SLOW:
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
        break;
    case TL_FORECAST_NO_MEMORY:
        (void)snprintf(line, sizeof line, "%s: " TL_ACTIVATION_NO_ROOM, text);
        tl_activation_make_no_room(self, line);
        break;
    }
}

/* What is told already is not told again. */
static void write_fault(const tl_activation *self, const char *otherwise, char *text, size_t size) {
    if (self->heard[0] == '\0' && self->problems != 0) {
        (void)snprintf(text, size, "it cannot run: %u %s", self->problems,
                       self->problems == 1 ? "problem" : "problems");
    } else {
        (void)snprintf(text, size, "it cannot run: %s", self->heard[0] != '\0' ? self->heard : otherwise);
    }
}

static void end_trial(tl_activation *self, tl_worker_state state) {
    char why[TL_WORKER_REASON];
    char text[TL_CONTROL_TEXT + 32];
    tl_worker_reason(&self->worker, why);
    bool is_done = state == TL_WORKER_DONE;
    bool is_sound = is_done && tl_trial_answer_take(self->worker.result.bytes, &self->answer);
    tl_worker_close(&self->worker);
    if (!is_done || (!is_sound && self->way == TL_ACTIVATION_BY_FLIP)) {
        write_fault(self, is_done ? "its trial has not said what it takes" : why, text, sizeof text);
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
    } else if (self->way == TL_ACTIVATION_BY_FLIP) {
        predict(self);
    } else {
        if (is_sound) {
            say_time(self);
        }
        tl_activation_conclude(self);
    }
}

/* FMUs may load for minutes, or for ever. */
static void say_patience(tl_activation *self, tl_time passed) {
    char text[TL_CONTROL_TEXT];
    self->waited += passed;
    if (self->step == TL_CONTROL_TRY && self->waited - self->told >= SAYING) {
        self->told = self->waited;
        (void)snprintf(text, sizeof text, "for %d s; it is ended after %d s", (int)(self->waited / TL_SECOND),
                       (int)(TRIAL / TL_SECOND));
        tl_activation_say(self, TL_CONTROL_TRY, text);
    }
}

/* Of the validator or the trial that is under way. */
static void tl_activation_look_at_worker(tl_activation *self, tl_time passed) {
    tl_worker_state state = tl_worker_poll(&self->worker);
    if (state == TL_WORKER_RUNNING) {
        say_patience(self, passed);
        return;
    }
    if (self->step == TL_CONTROL_VALIDATE) {
        end_validation(self, state);
    } else {
        end_trial(self, state);
    }
}

/* ---- activation shadow ---- */

/* An order is obeyed at once; FMUs take what they take to load, and a recorded past to be gone through. */
static const tl_time ORDERING = 60 * TL_SECOND;
static const tl_time BEGINNING = 900 * TL_SECOND;

/* Live time that is not compared: what was learnt from a recording has to find the plant. */
static const tl_time LEAD_IN = 10 * TL_SECOND;

/* Something is said after so long if a tenth more is done, and after so much longer in any case: who listens has not for ever. */
static const tl_time SAYING_SHADOW = 5 * TL_SECOND;
static const tl_time SAYING_AT_LEAST = 60 * TL_SECOND;
static const double PART = 0.1;

static tl_time length_of_shadow(const tl_activation *self) {
    uint32_t given = self->request.shadow_s;
    given = given == 0 ? TL_ACTIVATION_SHADOW_S : given;
    return (tl_time)(given < TL_ACTIVATION_SHADOW_LONGEST_S ? given : TL_ACTIVATION_SHADOW_LONGEST_S) * TL_SECOND;
}

static tl_time lead_in_of(const tl_activation *self) {
    tl_time quarter = length_of_shadow(self) / 4;
    return quarter < LEAD_IN ? quarter : LEAD_IN;
}

/* Seconds of live samples that it still has to run. */
static uint32_t tl_activation_shadow_left_s(const tl_activation *self) {
    return (uint32_t)((length_of_shadow(self) - self->rehearsal.live) / TL_SECOND);
}

/* ---- its ends ---- */

static void tl_activation_end_shadow(tl_activation *self) {
    const tl_activation_host *host = self->settings.host;
    self->rehearsal.is_begun = false;
    host->end_shadow(host->context);
}

/* The box does not carry two twins: by a restart, if that is allowed. */
static void tl_activation_make_no_room(tl_activation *self, const char *why) {
    char text[TL_CONTROL_TEXT];
    if ((self->request.flags & TL_CONTROL_MAY_RESTART) == 0) {
        bool says_so = strstr(why, "--restart") != NULL;
        (void)snprintf(text, sizeof text, "%s%s", why, says_so ? "" : ": use --restart");
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
        return;
    }
    if (self->rehearsal.is_begun) {
        tl_activation_end_shadow(self);
    }
    (void)snprintf(text, sizeof text, "%s: by a restart, then", why);
    tl_activation_say(self, TL_CONTROL_SHADOW, text);
    self->way = TL_ACTIVATION_BY_RESTART;
    tl_activation_conclude(self);
}

/* It was tried by itself before: one that cannot be begun beside the run's finds no room. */
static void note_failure(tl_activation *self, const tl_activation_shadow *shadow) {
    char why[TL_ACTIVATION_WHY];
    char text[TL_CONTROL_TEXT];
    (void)tl_clean_text(shadow->why, strnlen(shadow->why, sizeof shadow->why), why, sizeof why);
    (void)snprintf(text, sizeof text, "its twin did not stay beside the run's: %s", why[0] == '\0' ? "it died" : why);
    if (!self->rehearsal.has_run || strstr(why, TL_ACTIVATION_NO_ROOM) != NULL) {
        tl_activation_make_no_room(self, text);
    } else {
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
    }
}

/* ---- progress ---- */

static bool is_time_to_say(tl_activation *self, double part) {
    tl_rehearsal *rehearsal = &self->rehearsal;
    bool is =
        (rehearsal->unsaid >= SAYING_SHADOW && part - rehearsal->said >= PART) || rehearsal->unsaid >= SAYING_AT_LEAST;
    if (is) {
        rehearsal->unsaid = 0;
        rehearsal->said = part;
    }
    return is;
}

static void say_recorded(const tl_activation *self, const tl_activation_shadow *shadow) {
    char text[TL_CONTROL_TEXT];
    (void)snprintf(text, sizeof text, "recorded samples: %" PRId64 " of %" PRId64, shadow->work.tick,
                   shadow->work.last);
    tl_activation_say(self, TL_CONTROL_SHADOW, text);
}

static void say_live(const tl_activation *self, const tl_activation_shadow *shadow) {
    char lock[TL_COMPARISON_LOCK];
    char text[TL_CONTROL_TEXT];
    tl_comparison_write_lock(&shadow->work.lock, lock);
    (void)snprintf(text, sizeof text, "live: %.0f of %.0f s, %s", tl_seconds(self->rehearsal.live),
                   tl_seconds(length_of_shadow(self)), lock);
    tl_activation_say(self, TL_CONTROL_SHADOW, text);
}

/* ---- comparing ---- */

static void say_comparison(void *context, const char *text) {
    tl_activation_say(context, TL_CONTROL_COMPARE, text);
}

/* What the comparison could not see. */
static void say_sight(const tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    double gone = 0.0;
    double compared = tl_seconds(length_of_shadow(self) - lead_in_of(self));
    switch (tl_comparison_sight_of(&self->rehearsal.comparison, &gone)) {
    case TL_COMPARISON_SEEN:
        return;
    case TL_COMPARISON_UNJUDGED:
        (void)snprintf(text, sizeof text, "nothing came that its lock is judged by: that is left to its probation");
        break;
    case TL_COMPARISON_PLANT_GONE:
        (void)snprintf(text, sizeof text,
                       "the plant was not there for %.3g of %.3g s: its lock is not judged by the rest, but by its "
                       "probation",
                       gone * compared, compared);
        break;
    }
    tl_activation_say(self, TL_CONTROL_COMPARE, text);
}

/* In lock, or as much as the run's twin: by tolerances of its own. */
static void conclude_good(tl_activation *self) {
    char why[TL_COMPARISON_TEXT];
    char text[TL_CONTROL_TEXT];
    bool insists = (self->request.flags & TL_CONTROL_EVEN_WORSE) != 0;
    bool is_worse =
        tl_comparison_is_worse(&self->rehearsal.comparison, tl_activation_required_lock(&self->request), why);
    if (is_worse) {
        (void)snprintf(text, sizeof text, "%s: %s", why,
                       insists ? "taken all the same, as asked" : "--accept-worse takes it all the same");
    }
    if (is_worse && !insists) {
        tl_activation_turn_down(self, TL_CONTROL_INVALID, text);
        return;
    }
    if (is_worse) {
        tl_activation_say(self, TL_CONTROL_COMPARE, text);
    }
    tl_activation_conclude(self);
}

static void compare(tl_activation *self, const tl_activation_shadow *shadow) {
    char why[TL_COMPARISON_TEXT];
    self->step = TL_CONTROL_COMPARE;
    tl_comparison_end(&self->rehearsal.comparison, shadow);
    tl_comparison_tell(&self->rehearsal.comparison, say_comparison, self);
    say_sight(self);
    switch (tl_comparison_judge(&self->rehearsal.comparison, tl_activation_required_lock(&self->request), why)) {
    case TL_COMPARISON_GOOD:
        conclude_good(self);
        break;
    case TL_COMPARISON_NO_ROOM:
        tl_activation_make_no_room(self, why);
        break;
    case TL_COMPARISON_BAD:
        tl_activation_turn_down(self, TL_CONTROL_INVALID, why);
        break;
    }
}

/* ---- the step ---- */

static void go_on_live(tl_activation *self, const tl_activation_shadow *shadow, tl_time passed) {
    tl_rehearsal *rehearsal = &self->rehearsal;
    if (!rehearsal->is_live) {
        rehearsal->is_live = true;
        rehearsal->unsaid = 0;
        rehearsal->said = 0.0;
        rehearsal->has_run = true;
        if (rehearsal->recorded.work.last > 0) {
            say_recorded(self, &rehearsal->recorded);
        }
        return;
    }
    rehearsal->live += passed;
    if (!rehearsal->is_compared && rehearsal->live >= lead_in_of(self)) {
        rehearsal->is_compared = true;
        tl_comparison_begin(&rehearsal->comparison, &rehearsal->before, shadow);
    } else if (rehearsal->live >= length_of_shadow(self)) {
        rehearsal->live = length_of_shadow(self);
        say_live(self, shadow);
        compare(self, shadow);
    } else if (is_time_to_say(self, tl_seconds(rehearsal->live) / tl_seconds(length_of_shadow(self)))) {
        say_live(self, shadow);
    }
}

static void go_on_recorded(tl_activation *self, const tl_activation_shadow *shadow) {
    self->rehearsal.has_run = true;
    self->rehearsal.recorded = *shadow;
    if (shadow->work.last > 0 && is_time_to_say(self, (double)shadow->work.tick / (double)shadow->work.last)) {
        say_recorded(self, shadow);
    }
}

static void look_at_twin(tl_activation *self, tl_time passed) {
    const tl_activation_host *host = self->settings.host;
    tl_activation_shadow shadow;
    memset(&shadow, 0, sizeof shadow);
    host->look_at_shadow(host->context, &shadow);
    switch (shadow.phase) {
    case TL_ACTIVATION_SHADOW_LIVE:
        go_on_live(self, &shadow, passed);
        break;
    case TL_ACTIVATION_SHADOW_RECORDED:
        go_on_recorded(self, &shadow);
        break;
    case TL_ACTIVATION_SHADOW_FAILED:
        note_failure(self, &shadow);
        break;
    case TL_ACTIVATION_NO_SHADOW: /* the order is not seen yet; or somebody has ended it */
    case TL_ACTIVATION_SHADOW_BEGINS:
        if (self->rehearsal.has_run) {
            note_failure(self, &shadow);
        } else if (is_time_to_say(self, 0.0)) {
            tl_activation_say(self, TL_CONTROL_SHADOW, "its FMUs are loaded");
        }
        break;
    }
}

/* False: there is no going on. */
static bool go_on_with_probation(tl_activation *self, tl_time passed) {
    char text[TL_CONTROL_TEXT];
    if (tl_activation_versions(self)->probation.version == 0) {
        return true;
    }
    tl_probation_result result = tl_activation_pass(self, passed);
    if (result == TL_PROBATION_RETURN) {
        (void)snprintf(text, sizeof text, "the version on probation is returned from first: %s", self->probation.why);
        tl_activation_turn_down(self, TL_CONTROL_FAILED, text);
    } else if (result == TL_PROBATION_KEPT) {
        (void)tl_activation_keep(self);
    }
    return result != TL_PROBATION_RETURN;
}

static void tl_activation_begin_shadow(tl_activation *self) {
    self->step = TL_CONTROL_SHADOW;
    self->rehearsal = (tl_rehearsal){.before = tl_activation_view_now(self).figures};
    tl_activation_say(self, TL_CONTROL_SHADOW, "its twin is begun beside the run's");
    if (tl_activation_required_lock(&self->request) > 0.0) {
        tl_time third = self->verdict.window / 3; /* of what is compared, as a quarter is of all */
        tl_activation_say_window(self, TL_CONTROL_SHADOW, length_of_shadow(self) - lead_in_of(self),
                                 third < LEAD_IN ? third : LEAD_IN, "--shadow");
    }
    self->looked = tl_clock_now(NULL);
}

/* ---- the twin before, as a shadow ---- */

static bool tl_activation_has_former(const tl_activation *self, bool *runs) {
    const tl_activation_host *host = self->settings.host;
    const tl_version_probation *probation = &tl_activation_versions(self)->probation;
    const tl_version *before =
        probation->version == 0 ? NULL : tl_versions_get(tl_activation_versions(self), probation->return_to);
    tl_activation_shadow shadow;
    memset(&shadow, 0, sizeof shadow);
    if (before != NULL) {
        host->look_at_shadow(host->context, &shadow);
    }
    *runs = shadow.phase == TL_ACTIVATION_SHADOW_LIVE;
    return before != NULL && shadow.phase != TL_ACTIVATION_NO_SHADOW && strcmp(shadow.hash, before->hash) == 0;
}

/* ---- the order ---- */

static void order(tl_activation *self) {
    const tl_activation_host *host = self->settings.host;
    bool runs = false;
    bool takes_place = tl_activation_has_former(self, &runs);
    const tl_activation_candidate candidate = {
        .text = self->text,
        .size = self->size,
        .hash = self->request.hash,
        .yardstick = &self->verdict.yardstick,
        .needs = self->answer.needs,
    };
    self->rehearsal.is_begun = host->begin_shadow(host->context, &candidate);
    if (self->rehearsal.is_begun && takes_place) {
        static const char text[] =
            "the twin before makes room for it: a way back from the version on probation is by a restart now";
        tl_activation_tell(self, TL_EVENT_INFO, text);
        tl_activation_say(self, TL_CONTROL_SHADOW, text);
    }
}

/* A change before is not done before all of its run is recorded, which a full disk holds up. */
static void say_waiting_shadow(tl_activation *self) {
    tl_rehearsal *rehearsal = &self->rehearsal;
    if (!rehearsal->is_begun && !rehearsal->is_told && rehearsal->waited > TL_ACTIVATION_SILENCE) {
        rehearsal->is_told = true;
        tl_activation_say(self, TL_CONTROL_SHADOW, TL_ACTIVATION_WAITING);
    }
}

static void tl_activation_look_at_shadow(tl_activation *self, tl_time passed) {
    tl_rehearsal *rehearsal = &self->rehearsal;
    if (!go_on_with_probation(self, passed)) {
        return;
    }
    rehearsal->waited += passed;
    rehearsal->unsaid += passed;
    if (tl_activation_view_now(self).holds) {
        tl_activation_make_no_room(self, "the run is in safe hold now");
    } else if (!rehearsal->is_begun && rehearsal->waited > ORDERING) {
        tl_activation_make_no_room(self, "its twin could not be ordered for 60 s");
    } else if (!rehearsal->is_begun) {
        order(self);
        say_waiting_shadow(self);
    } else if (!rehearsal->is_live && rehearsal->waited > BEGINNING) {
        tl_activation_make_no_room(self, "its twin was not at the plant's ticks after 15 minutes");
    } else {
        look_at_twin(self, passed);
    }
}

/* ---- activation probation ---- */

/* What is left of a probation is written this often; and so long nothing is tried again that the disk has refused. */
static const tl_time SAVING = 10 * TL_SECOND;
static const tl_time PAUSE = 10 * TL_SECOND;

/* The text of a version is the candidate now. */
static bool load(tl_activation *self, uint64_t number) {
    tl_error error;
    const tl_version *version = tl_versions_get(tl_activation_versions(self), number);
    free(self->text);
    self->text = NULL;
    if (version == NULL || tl_activation_read(self, version, &self->text, &error) != TL_OK) {
        tl_activation_tell(self, TL_EVENT_ERROR,
                           version == NULL ? "the version to return to is not there" : error.text);
        return false;
    }
    self->size = (size_t)version->size;
    return true;
}

/* By the twin that was the run's before, if it is there; else as any change. */
static void go_back(tl_activation *self, const char *reason) {
    bool runs = false;
    bool is_there = tl_activation_has_former(self, &runs);
    self->pause = PAUSE;
    (void)snprintf(self->reason, sizeof self->reason, "%s", reason);
    if (is_there && runs) {
        self->is_return = true;
        tl_activation_bring_back(self, TL_ACTIVATION_BY_FLIP);
        return;
    }
    if (is_there) {
        tl_activation_tell(self, TL_EVENT_WARNING, "the twin before does not run any more: it cannot take over again");
        tl_activation_end_shadow(self);
    }
    if (load(self, tl_activation_versions(self)->probation.return_to)) {
        self->is_return = true;
        tl_activation_validate(self, tl_activation_active(self));
    } else {
        tl_activation_forget(self);
    }
}

/* Once, and once more when it works again: it is tried every 10 s for as long as the disk is full. */
static void note_disk(tl_activation *self, bool is_written, const char *why) {
    char text[TL_CONTROL_TEXT];
    if (!is_written && !self->is_unwritten) {
        (void)snprintf(text, sizeof text, "the probation goes on until the disk takes what comes of it: %.700s", why);
        tl_activation_tell(self, TL_EVENT_ERROR, text);
        tl_activation_say(self, TL_CONTROL_PROBATION, text);
    } else if (is_written && self->is_unwritten) {
        tl_activation_tell(self, TL_EVENT_INFO, "the disk takes what comes of the probation again");
    }
    self->is_unwritten = !is_written;
}

/* The version on probation is kept; who has asked for another one hears nothing of it. False: that cannot be written down. */
static bool tl_activation_keep(tl_activation *self) {
    tl_error error;
    char text[TL_CONTROL_TEXT];
    bool is_written =
        tl_versions_settle(tl_activation_versions(self), TL_VERSION_KEPT, self->probation.why, &error) == TL_OK;
    note_disk(self, is_written, error.text);
    if (!is_written) {
        self->pause = PAUSE;
        self->probation.result = TL_PROBATION_GOES_ON; /* whatever is said of it meanwhile counts */
        return false;
    }
    (void)snprintf(text, sizeof text, "the configuration in force is kept: %s", self->probation.why);
    tl_activation_tell(self, TL_EVENT_INFO, text);
    if (!self->rehearsal.is_begun) { /* else it is of a candidate */
        tl_activation_end_shadow(self);
    }
    return true;
}

static void end_kept(tl_activation *self) {
    char text[TL_CONTROL_TEXT];
    if (!tl_activation_keep(self)) {
        return;
    }
    self->step = TL_CONTROL_IDLE;
    tl_activation_say(self, TL_CONTROL_KEPT, self->probation.why);
    (void)snprintf(text, sizeof text, "version %llu is kept", (unsigned long long)tl_activation_versions(self)->active);
    tl_activation_say_end(self, TL_CONTROL_DONE, text);
}

static void save(tl_activation *self, tl_time passed) {
    tl_error error;
    self->unsaved += passed;
    if (self->unsaved >= SAVING) {
        self->unsaved = 0;
        bool is_written = tl_versions_pass(tl_activation_versions(self), &self->probation.account, &error) == TL_OK;
        note_disk(self, is_written, error.text);
    }
}

/* Gives the run's twin the yardstick of the version that the probation would return to; none if there is no probation. */
static void tl_activation_show_yardstick(const tl_activation *self) {
    static const tl_lock_yardstick none;
    const tl_activation_host *host = self->settings.host;
    bool is_on = tl_activation_versions(self)->probation.version != 0;
    host->judge_by(host->context, is_on ? &self->probation.account.yardstick : &none);
}

/* It also goes on while another candidate is looked at. */
static tl_probation_result tl_activation_pass(tl_activation *self, tl_time passed) {
    const tl_activation_view now = tl_activation_view_now(self);
    tl_probation_result result = tl_probation_feed(&self->probation, now.waits ? 0 : passed, &now.figures);
    self->pause = self->pause > passed ? self->pause - passed : 0;
    if (result == TL_PROBATION_GOES_ON) {
        save(self, passed);
    }
    return result;
}

static void tl_activation_look_at_probation(tl_activation *self, tl_time passed) {
    tl_probation_result result = tl_activation_pass(self, passed);
    if (self->pause == 0 && result == TL_PROBATION_KEPT) {
        end_kept(self);
    } else if (self->pause == 0 && result == TL_PROBATION_RETURN) {
        go_back(self, self->probation.why);
    }
}

static void find_in_force(const tl_activation *self, char hash[TL_SHA256_TEXT]) {
    hash[0] = '\0';
    self->settings.host->in_force(self->settings.host->context, hash);
}

/* The run is of something else than the disk says: a change was not finished. */
static bool tl_activation_is_unfinished(const tl_activation *self) {
    char hash[TL_SHA256_TEXT];
    const tl_version *active = tl_activation_active(self);
    find_in_force(self, hash);
    return active != NULL && strcmp(active->hash, hash) != 0;
}

/* What has to be done follows from what the run is of. */
static void tl_activation_settle(tl_activation *self) {
    char hash[TL_SHA256_TEXT];
    find_in_force(self, hash);
    if (!tl_activation_is_unfinished(self) || !load(self, tl_activation_versions(self)->active)) {
        return;
    }
    const tl_version *in_force = tl_versions_of_hash(tl_activation_versions(self), hash);
    self->settles = true;
    if (in_force == NULL) {
        tl_activation_bring_back(self, TL_ACTIVATION_BY_RESTART);
    } else {
        tl_activation_validate(self, in_force);
    }
}

/* ---- activation ---- */

void tl_activation_begin(tl_activation *activation, const tl_activation_settings *settings) {
    bool runs = false;
    *activation = (tl_activation){.settings = *settings, .step = TL_CONTROL_IDLE, .looked = tl_clock_now(NULL)};
    if (settings->versions->probation.version != 0) {
        tl_probation_resume(&activation->probation, &settings->versions->probation.account);
        activation->step = TL_CONTROL_PROBATION;
    }
    if (!tl_activation_has_former(activation, &runs)) {
        tl_activation_end_shadow(activation); /* of a candidate that was given up */
    }
    tl_activation_settle(activation);
}

bool tl_activation_is_idle(const tl_activation *activation) {
    return activation->step == TL_CONTROL_IDLE;
}

bool tl_activation_is_busy(const tl_activation *activation) {
    return activation->step != TL_CONTROL_IDLE && activation->step != TL_CONTROL_PROBATION;
}

uint32_t tl_activation_left_s(const tl_activation *activation) {
    bool is_on = tl_activation_versions(activation)->probation.version != 0;
    return is_on ? (uint32_t)((activation->probation.account.left_ms + 999) / 1000) : 0;
}

static bool is_of_active(const tl_activation *self) {
    const tl_version *active = tl_activation_active(self);
    return active != NULL && strcmp(active->hash, self->request.hash) == 0;
}

static bool is_as_expected(const tl_activation *self) {
    const tl_version *active = tl_activation_active(self);
    return self->request.if_match[0] == '\0' || (active != NULL && strcmp(active->hash, self->request.if_match) == 0);
}

/* The same text means other FMUs if one of their files was replaced. */
static bool has_other_fmus(tl_activation *self, const char *text, size_t size) {
    const tl_activation_host *host = self->settings.host;
    char *copy = host->has_other_fmus == NULL ? NULL : malloc(size + 1);
    if (copy == NULL) {
        return false;
    }
    memcpy(copy, text, size);
    copy[size] = '\0';
    self->has_other_fmus = host->has_other_fmus(host->context, copy, size);
    free(copy);
    return self->has_other_fmus;
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
    tl_error error;
    activation->request = *request;
    if (request->why[strspn(request->why, " \t\r\n")] == '\0') {
        activation->request.why[0] = '\0'; /* it says nothing */
    }
    activation->has_other_fmus = false;
    activation->is_awaited = (request->flags & TL_CONTROL_WAIT) != 0;
    activation->step = TL_CONTROL_AUTHORISE;
    tl_activation_say(activation, TL_CONTROL_AUTHORISE, tl_change_rights[request->right]);
    if (request->right < TL_RIGHT_RETUNE) {
        tl_activation_turn_down(activation, TL_CONTROL_FORBIDDEN, "it was sent with the right to read only");
    } else if (!is_as_expected(activation)) {
        tl_activation_turn_down(activation, TL_CONTROL_CHANGED,
                                "somebody has changed the configuration meanwhile: look at it first");
    } else if (is_of_active(activation) && !has_other_fmus(activation, text, size)) {
        tl_activation_say_end(activation, TL_CONTROL_SAME, "that is what is active");
        tl_activation_forget(activation);
    } else if (memchr(text, '\0', size) != NULL) {
        tl_activation_turn_down(activation, TL_CONTROL_INVALID, "it holds a byte 0: it is no text");
    } else if ((request->flags & TL_CONTROL_ONLY_CHECK) == 0 &&
               tl_versions_check_room(tl_activation_versions(activation), size, &error) != TL_OK) {
        tl_activation_fail(activation, error.text); /* before anybody has waited for a shadow */
    } else if (!copy_text(activation, text, size)) {
        tl_activation_fail(activation, "not enough memory");
    } else {
        tl_activation_validate(activation, tl_activation_active(activation));
    }
}

/* A candidate is on its way, and nothing of it is on disk. */
static bool is_considering(const tl_activation *self) {
    return tl_activation_is_busy(self) && self->step != TL_CONTROL_ACTIVATE && !self->is_return && !self->settles;
}

void tl_activation_describe(const tl_activation *activation, char text[TL_CONTROL_TEXT]) {
    if (activation->step == TL_CONTROL_SHADOW) {
        (void)snprintf(text, TL_CONTROL_TEXT,
                       "another twin runs beside the run's, and for some %u s still: --rollback cancels that",
                       tl_activation_shadow_left_s(activation));
    } else {
        (void)snprintf(text, TL_CONTROL_TEXT, "another change is under way: try again when it is done");
    }
}

bool tl_activation_cancel(tl_activation *activation, const char *who) {
    char text[TL_CONTROL_TEXT];
    if (!is_considering(activation)) {
        return false;
    }
    (void)snprintf(text, sizeof text, "by %s; nothing was changed", who);
    tl_activation_turn_down(activation, TL_CONTROL_CANCELLED, text);
    return true;
}

bool tl_activation_is_lost_before(const tl_activation *activation) {
    return tl_activation_versions(activation)->probation.version != 0 &&
           tl_probation_is_lost_before(&activation->probation);
}

bool tl_activation_confirm(tl_activation *activation, const char *who, bool *is_done) {
    bool considers = is_considering(activation);
    if (tl_activation_versions(activation)->probation.version == 0 ||
        (activation->step != TL_CONTROL_PROBATION && !considers)) {
        return false;
    }
    activation->pause = 0;
    tl_probation_result result = tl_probation_confirm(&activation->probation, who);
    if (!considers) {
        tl_activation_look_at_probation(activation, 0);
    } else if (result == TL_PROBATION_KEPT) {
        (void)tl_activation_keep(activation);
    }
    *is_done = tl_activation_versions(activation)->probation.version == 0;
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
    tl_activation_look_at_probation(activation, 0);
    return true;
}

void tl_activation_look(tl_activation *activation) {
    tl_time now = tl_clock_now(NULL);
    tl_time passed = now - activation->looked;
    activation->looked = now;
    tl_activation_show_yardstick(activation);
    if (activation->step == TL_CONTROL_VALIDATE || activation->step == TL_CONTROL_TRY) {
        if (tl_activation_versions(activation)->probation.version != 0) {
            (void)tl_activation_pass(activation, passed);
        }
        tl_activation_look_at_worker(activation, passed);
    } else if (activation->step == TL_CONTROL_SHADOW) {
        tl_activation_look_at_shadow(activation, passed);
    } else if (activation->step == TL_CONTROL_ACTIVATE) {
        tl_activation_look_at_change(activation, passed);
    } else if (activation->step == TL_CONTROL_PROBATION) {
        tl_activation_look_at_probation(activation, passed);
    }
}

void tl_activation_end(tl_activation *activation) {
    if (activation->step == TL_CONTROL_PROBATION) {
        tl_error error;
        (void)tl_versions_pass(tl_activation_versions(activation), &activation->probation.account, &error);
    }
    if (activation->rehearsal.is_begun) {
        tl_activation_end_shadow(activation);
    }
    tl_worker_close(&activation->worker);
    free(activation->text);
    free(activation->before);
    activation->text = NULL;
    activation->before = NULL;
}
