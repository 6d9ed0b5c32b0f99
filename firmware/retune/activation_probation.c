/* Probation, and the way back: see activation_parts.h. */
#include "firmware/retune/activation_parts.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

bool tl_activation_keep(tl_activation *self) {
    tl_error error;
    char text[TL_CONTROL_TEXT];
    bool is_written = tl_versions_keep(tl_activation_versions(self), self->probation.why, &error) == TL_OK;
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

void tl_activation_show_yardstick(const tl_activation *self) {
    static const tl_lock_yardstick none;
    const tl_activation_host *host = self->settings.host;
    bool is_on = tl_activation_versions(self)->probation.version != 0;
    host->judge_by(host->context, is_on ? &self->probation.account.yardstick : &none);
}

/* It also goes on while another candidate is looked at. */
tl_probation_result tl_activation_pass(tl_activation *self, tl_time passed) {
    const tl_activation_view now = tl_activation_view_now(self);
    tl_probation_result result = tl_probation_feed(&self->probation, now.waits ? 0 : passed, &now.figures);
    self->pause = self->pause > passed ? self->pause - passed : 0;
    if (result == TL_PROBATION_GOES_ON) {
        save(self, passed);
    }
    return result;
}

void tl_activation_look_at_probation(tl_activation *self, tl_time passed) {
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

bool tl_activation_is_unfinished(const tl_activation *self) {
    char hash[TL_SHA256_TEXT];
    const tl_version *active = tl_activation_active(self);
    find_in_force(self, hash);
    return active != NULL && strcmp(active->hash, hash) != 0;
}

/* What has to be done follows from what the run is of. */
void tl_activation_settle(tl_activation *self) {
    tl_error error;
    char hash[TL_SHA256_TEXT];
    find_in_force(self, hash);
    if (!tl_activation_is_unfinished(self) || !load(self, tl_activation_versions(self)->active)) {
        return;
    }
    const tl_version *in_force = tl_versions_find(tl_activation_versions(self), hash, &error);
    self->settles = true;
    if (in_force == NULL) {
        tl_activation_bring_back(self, TL_ACTIVATION_BY_RESTART);
    } else {
        tl_activation_validate(self, in_force);
    }
}
