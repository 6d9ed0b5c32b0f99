/* The parts of an activation: for the sources behind activation.h.
 *
 * Purpose: one noun each: what is said of it (activation_words.c), the candidate on its way to be good (activation_candidate.c), its twin beside the
 *          run's (activation_shadow.c), the change itself (activation_change.c), the probation and the way back (activation_probation.c).
 * Thread:  as in activation.h.
 */
#ifndef TL_FIRMWARE_RETUNE_ACTIVATION_PARTS_H
#define TL_FIRMWARE_RETUNE_ACTIVATION_PARTS_H

#include "firmware/retune/activation.h"

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

void tl_activation_say(const tl_activation *self, tl_control_step step, const char *text);
void tl_activation_say_end(const tl_activation *self, tl_control_result result, const char *text);
void tl_activation_say_problem(const tl_activation *self, const tl_control_problem *problem, uint32_t more);
void tl_activation_say_problems(const tl_activation *self);
void tl_activation_say_changes(const tl_activation *self);
void tl_activation_tell(const tl_activation *self, tl_severity severity, const char *text);

/* What is different now, as far as it fits: ": KEY 1 → 2 and 3 more". */
void tl_activation_write_changes(const tl_activation *self, char *text, size_t size);

/* Why it takes a restart, which was not allowed. */
void tl_activation_write_restart(const tl_activation *self, char *text, size_t size);

/* Says at this step what its lock can be judged by, unless `time` of live samples is surely enough for that; `option` gives more, of which `lead_in` does
 * not count. */
void tl_activation_say_window(const tl_activation *self, tl_control_step step, tl_time time, tl_time lead_in,
                              const char *option);

/* ---- the ends of a change ---- */

/* It is over; a probation goes on. */
void tl_activation_forget(tl_activation *self);

/* Nothing came of the candidate. */
void tl_activation_turn_down(tl_activation *self, tl_control_result result, const char *text);

/* What is known and cannot be brought about: tried again by whoever asks next, or begins next. */
void tl_activation_fail(tl_activation *self, const char *text);

/* ---- the candidate ---- */

/* The text of a version, the caller's to free(). If it is damaged on disk it is taken from the run's memory, and written anew: that is told. */
tl_status tl_activation_read(const tl_activation *activation, const tl_version *version, char **text, tl_error *error);

/* Against what the run is of. */
void tl_activation_validate(tl_activation *self, const tl_version *in_force);

/* Of the validator or the trial that is under way. */
void tl_activation_look_at_errand(tl_activation *self, tl_time passed);

/* It is known to be good: it is activated, unless it was to be checked only. */
void tl_activation_conclude(tl_activation *self);

/* ---- its twin beside the run's ---- */

void tl_activation_begin_shadow(tl_activation *self);
void tl_activation_look_at_shadow(tl_activation *self, tl_time passed);

/* The box does not carry two twins: by a restart, if that is allowed. */
void tl_activation_make_no_room(tl_activation *self, const char *why);

/* Whatever twin is in the other place. */
void tl_activation_end_shadow(tl_activation *self);

/* Seconds of live samples that it still has to run. */
uint32_t tl_activation_shadow_left_s(const tl_activation *self);

/* The twin in the other place is of the version that is returned to. *runs: and can take over again. */
bool tl_activation_has_former(const tl_activation *self, bool *runs);

/* ---- the change ---- */

void tl_activation_activate(tl_activation *self);

/* The same with what is known to be good: the version that is returned to, or the one that is active on disk. */
void tl_activation_bring_back(tl_activation *self, tl_activation_way way);

/* The run is of something else than the disk says: a change was not finished. */
bool tl_activation_is_unfinished(const tl_activation *self);

void tl_activation_look_at_change(tl_activation *self, tl_time passed);

/* ---- probation, and the way back ---- */

/* Percent of the steps, in a shadow's comparison and on probation. */
double tl_activation_required_lock(const tl_control_request *request);

/* Gives the run's twin the yardstick of the version that the probation would return to; none if there is no probation. */
void tl_activation_show_yardstick(const tl_activation *self);

/* What it comes to. It also goes on while another candidate is looked at. */
tl_probation_result tl_activation_pass(tl_activation *self, tl_time passed);

/* The version on probation is kept; who has asked for another one hears nothing of it. False: that cannot be written down. */
bool tl_activation_keep(tl_activation *self);

void tl_activation_look_at_probation(tl_activation *self, tl_time passed);

/* A run that is of something else than the disk says is brought to that. */
void tl_activation_settle(tl_activation *self);

#endif
