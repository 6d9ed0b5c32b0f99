/* Activations: see activation.h. */
#include "firmware/retune/activation.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/retune/activation_parts.h"
#include "firmware/retune/control_words.h"

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
    tl_activation_say(activation, TL_CONTROL_AUTHORISE, tl_control_right_name((tl_control_right)request->right));
    if (request->right < TL_CONTROL_MAY_RETUNE) {
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
        tl_activation_look_at_errand(activation, passed);
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
    tl_errand_close(&activation->errand);
    free(activation->text);
    free(activation->before);
    activation->text = NULL;
    activation->before = NULL;
}
