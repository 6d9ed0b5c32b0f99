/* The change itself, on disk and then in the run: see activation_parts.h. */
#include "firmware/retune/activation_parts.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/file_bytes.h"

/* A twin takes a tuning at its next tick; a new one begins meanwhile, perhaps. */
static const tl_time TAKING = 60 * TL_SECOND;

double tl_activation_required_lock(const tl_control_request *request) {
    return request->require_lock < 0.0 ? TL_ACTIVATION_LOCK_PERCENT : request->require_lock;
}

/* Seconds. With the right to retune it is at least as long as the lock takes to be judged twice. */
static uint32_t length_of(const tl_activation *self) {
    const tl_control_request *request = &self->request;
    tl_time given = request->probation_s == 0 ? TL_ACTIVATION_PROBATION_S : (tl_time)request->probation_s;
    tl_time least = request->right < TL_CONTROL_MAY_COMMISSION ? 2 * self->verdict.window / TL_SECOND + 1 : 1;
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

static tl_version_origin origin_of(const tl_activation *self) {
    if (self->request.origin == TL_CONTROL_BY_NETWORK) {
        return TL_VERSION_BY_NETWORK;
    }
    if (self->request.origin == TL_CONTROL_BY_LIMITED) {
        return TL_VERSION_BY_LIMITED;
    }
    return is_own_file(self) ? TL_VERSION_BY_RELOAD : TL_VERSION_BY_HAND;
}

static tl_status put_version(tl_activation *self, tl_error *error) {
    const tl_probation_terms terms = terms_of(self);
    const tl_probation_snapshot now = tl_activation_view_now(self).figures;
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
    return self->is_return ? tl_versions_return(tl_activation_versions(self), self->reason, error)
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
                       active->who, tl_version_origin_name(active->origin), active->why[0] == '\0' ? "" : ": ",
                       active->why);
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

void tl_activation_activate(tl_activation *self) {
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
void tl_activation_bring_back(tl_activation *self, tl_activation_way way) {
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
        .origin = tl_version_origin_name(active->origin),
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
    if (tl_versions_return(tl_activation_versions(self), text, &error) != TL_OK) {
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

void tl_activation_look_at_change(tl_activation *self, tl_time passed) {
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
