/* A candidate's twin beside the run's, and what comes of it: see activation_parts.h. */
#include "firmware/retune/activation_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/clean_text.h"
#include "firmware/base/clock.h"

/* An order is obeyed at once; FMUs take what they take to load, and a recorded past to be gone through. */
static const tl_time ORDERING = 60 * TL_SECOND;
static const tl_time BEGINNING = 900 * TL_SECOND;

/* Live time that is not compared: what was learnt from a recording has to find the plant. */
static const tl_time LEAD_IN = 10 * TL_SECOND;

/* Something is said after so long if a tenth more is done, and after so much longer in any case: who listens has not for ever. */
static const tl_time SAYING = 5 * TL_SECOND;
static const tl_time SAYING_AT_LEAST = 60 * TL_SECOND;
static const double PART = 0.1;

static tl_time length_of(const tl_activation *self) {
    uint32_t given = self->request.shadow_s;
    given = given == 0 ? TL_ACTIVATION_SHADOW_S : given;
    return (tl_time)(given < TL_ACTIVATION_SHADOW_LONGEST_S ? given : TL_ACTIVATION_SHADOW_LONGEST_S) * TL_SECOND;
}

static tl_time lead_in_of(const tl_activation *self) {
    tl_time quarter = length_of(self) / 4;
    return quarter < LEAD_IN ? quarter : LEAD_IN;
}

uint32_t tl_activation_shadow_left_s(const tl_activation *self) {
    return (uint32_t)((length_of(self) - self->rehearsal.live) / TL_SECOND);
}

/* ---- its ends ---- */

void tl_activation_end_shadow(tl_activation *self) {
    const tl_activation_host *host = self->settings.host;
    self->rehearsal.is_begun = false;
    host->end_shadow(host->context);
}

void tl_activation_make_no_room(tl_activation *self, const char *why) {
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
    bool is = (rehearsal->unsaid >= SAYING && part - rehearsal->said >= PART) || rehearsal->unsaid >= SAYING_AT_LEAST;
    if (is) {
        rehearsal->unsaid = 0;
        rehearsal->said = part;
    }
    return is;
}

static void say_recorded(const tl_activation *self, const tl_activation_shadow *shadow) {
    char text[TL_CONTROL_TEXT];
    (void)snprintf(text, sizeof text, "recorded samples: %" PRId64 " of %" PRId64, shadow->done, shadow->known);
    tl_activation_say(self, TL_CONTROL_SHADOW, text);
}

static void say_live(const tl_activation *self, const tl_activation_shadow *shadow) {
    char lock[TL_COMPARISON_LOCK];
    char text[TL_CONTROL_TEXT];
    tl_comparison_write_lock(&shadow->work.figures.lock, lock);
    (void)snprintf(text, sizeof text, "live: %.0f of %.0f s, %s", tl_seconds(self->rehearsal.live),
                   tl_seconds(length_of(self)), lock);
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
    double compared = tl_seconds(length_of(self) - lead_in_of(self));
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
        if (rehearsal->recorded.known > 0) {
            say_recorded(self, &rehearsal->recorded);
        }
        return;
    }
    rehearsal->live += passed;
    if (!rehearsal->is_compared && rehearsal->live >= lead_in_of(self)) {
        rehearsal->is_compared = true;
        tl_comparison_begin(&rehearsal->comparison, &rehearsal->before, shadow);
    } else if (rehearsal->live >= length_of(self)) {
        rehearsal->live = length_of(self);
        say_live(self, shadow);
        compare(self, shadow);
    } else if (is_time_to_say(self, tl_seconds(rehearsal->live) / tl_seconds(length_of(self)))) {
        say_live(self, shadow);
    }
}

static void go_on_recorded(tl_activation *self, const tl_activation_shadow *shadow) {
    self->rehearsal.has_run = true;
    self->rehearsal.recorded = *shadow;
    if (shadow->known > 0 && is_time_to_say(self, (double)shadow->done / (double)shadow->known)) {
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

void tl_activation_begin_shadow(tl_activation *self) {
    self->step = TL_CONTROL_SHADOW;
    self->rehearsal = (tl_rehearsal){.before = tl_activation_view_now(self).figures};
    tl_activation_say(self, TL_CONTROL_SHADOW, "its twin is begun beside the run's");
    if (tl_activation_required_lock(&self->request) > 0.0) {
        tl_time third = self->verdict.window / 3; /* of what is compared, as a quarter is of all */
        tl_activation_say_window(self, TL_CONTROL_SHADOW, length_of(self) - lead_in_of(self),
                                 third < LEAD_IN ? third : LEAD_IN, "--shadow");
    }
    self->looked = tl_clock_now(NULL);
}

/* ---- the twin before, as a shadow ---- */

bool tl_activation_has_former(const tl_activation *self, bool *runs) {
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
    const tl_trial_answer *answer = &self->answer;
    bool runs = false;
    bool takes_place = tl_activation_has_former(self, &runs);
    const tl_activation_candidate candidate = {
        .text = self->text,
        .size = self->size,
        .hash = self->request.hash,
        .yardstick = &self->verdict.yardstick,
        .needs = {.match = answer->match,
                  .adjust = answer->adjust,
                  .components = answer->components,
                  .unconfined = answer->unconfined != 0,
                  .fmu_bytes = answer->fmu_bytes,
                  .signals = answer->signals},
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
static void say_waiting(tl_activation *self) {
    tl_rehearsal *rehearsal = &self->rehearsal;
    if (!rehearsal->is_begun && !rehearsal->is_told && rehearsal->waited > TL_ACTIVATION_SILENCE) {
        rehearsal->is_told = true;
        tl_activation_say(self, TL_CONTROL_SHADOW, TL_ACTIVATION_WAITING);
    }
}

void tl_activation_look_at_shadow(tl_activation *self, tl_time passed) {
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
        say_waiting(self);
    } else if (!rehearsal->is_live && rehearsal->waited > BEGINNING) {
        tl_activation_make_no_room(self, "its twin was not at the plant's ticks after 15 minutes");
    } else {
        look_at_twin(self, passed);
    }
}
