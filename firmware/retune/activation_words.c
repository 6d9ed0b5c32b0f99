/* What is said of an activation: see activation_parts.h. */
#include "firmware/retune/activation_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/retune/control_words.h"

static tl_control_reply new_reply(tl_control_kind kind) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = (uint32_t)kind;
    return reply;
}

static void say(const tl_activation *self, const tl_control_reply *reply) {
    self->settings.say(self->settings.listener, reply);
}

void tl_activation_say(const tl_activation *self, tl_control_step step, const char *text) {
    tl_control_reply reply = new_reply(TL_CONTROL_STEP);
    reply.as.progress.step = (uint32_t)step;
    reply.as.progress.left_s = tl_activation_left_s(self);
    (void)snprintf(reply.as.progress.text, sizeof reply.as.progress.text, "%s", text);
    say(self, &reply);
}

void tl_activation_say_end(const tl_activation *self, tl_control_result result, const char *text) {
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

void tl_activation_tell(const tl_activation *self, tl_severity severity, const char *text) {
    self->settings.host->tell(self->settings.host->context, severity, text);
}

void tl_activation_say_problem(const tl_activation *self, const tl_control_problem *problem, uint32_t more) {
    tl_control_reply reply = new_reply(TL_CONTROL_PROBLEM);
    reply.more = more;
    reply.as.problem = *problem;
    say(self, &reply);
}

void tl_activation_say_problems(const tl_activation *self) {
    const tl_verdict *verdict = &self->verdict;
    uint32_t listed = verdict->problems < TL_VERDICT_PROBLEMS ? verdict->problems : TL_VERDICT_PROBLEMS;
    for (uint32_t i = 0; i < listed; i++) {
        tl_activation_say_problem(self, &verdict->problem[i], i + 1 == listed ? verdict->problems - listed : 0);
    }
}

void tl_activation_say_changes(const tl_activation *self) {
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
void tl_activation_write_changes(const tl_activation *self, char *text, size_t size) {
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
    const char *restart = tl_change_kind_name(TL_CHANGE_RESTART);
    size_t found = 0;
    for (uint32_t i = 0; i < verdict->changes && i < TL_VERDICT_CHANGES; i++) {
        size_t length = strlen(text);
        if (strcmp(verdict->change[i].kind, restart) == 0 && found++ < 3) {
            (void)snprintf(text + length, size - length, "%s%s", length == 0 ? "" : ", ", verdict->change[i].path);
        }
    }
    return found;
}

void tl_activation_write_restart(const tl_activation *self, char *text, size_t size) {
    char keys[512] = "";
    if (tl_activation_view_now(self).holds) {
        (void)snprintf(text, size, "the run is in safe hold: with --restart it ends and begins anew");
        return;
    }
    size_t found = write_keys(&self->verdict, keys, sizeof keys);
    (void)snprintf(text, size, "%s%s: with --restart the run ends and begins anew, with a gap",
                   found == 0 ? "it changes what only a new run can take" : "only a new run can take ", keys);
}

void tl_activation_say_window(const tl_activation *self, tl_control_step step, tl_time time, tl_time lead_in,
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

void tl_activation_forget(tl_activation *self) {
    if (self->rehearsal.is_begun) {
        tl_activation_end_shadow(self);
    }
    tl_errand_close(&self->errand);
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
    (void)snprintf(news.origin, sizeof news.origin, "%s", tl_control_origin_name((tl_control_origin)request->origin));
    (void)snprintf(news.result, sizeof news.result, "%s", result == TL_CONTROL_CANCELLED ? "cancelled" : "refused");
    (void)snprintf(news.who, sizeof news.who, "%s", request->who);
    (void)snprintf(news.why, sizeof news.why, "%s", request->why);
    (void)snprintf(news.reason, sizeof news.reason, "%.*s", (int)sizeof news.reason - 1, text);
    (void)tl_refusals_add(self->settings.refusals, &news, &error);
}

/* Nothing came of it. */
void tl_activation_turn_down(tl_activation *self, tl_control_result result, const char *text) {
    char line[TL_CONTROL_TEXT + 128];
    (void)snprintf(line, sizeof line, "a configuration of %s was %s%s", self->request.who,
                   result == TL_CONTROL_CANCELLED ? "cancelled " : "refused: ", text);
    tl_activation_tell(self, TL_EVENT_WARNING, line);
    keep_refusal(self, result, text);
    tl_activation_say_end(self, result, text);
    tl_activation_forget(self);
}

/* What is known and cannot be brought about: tried again by whoever asks next, or begins next. */
void tl_activation_fail(tl_activation *self, const char *text) {
    char line[TL_CONTROL_TEXT + 128];
    (void)snprintf(line, sizeof line, "the configuration could not be changed: %s", text);
    tl_activation_tell(self, TL_EVENT_ERROR, line);
    tl_activation_say_end(self, TL_CONTROL_FAILED, text);
    tl_activation_forget(self);
}
