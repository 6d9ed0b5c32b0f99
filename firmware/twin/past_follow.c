/* Going on with a past: see past_follow.h. */
#include "firmware/twin/past_follow.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_step.h"

static const tl_time PATIENCE = 2 * TL_SECOND;

typedef struct follower {
    const tl_past_follow_settings *settings;
    const tl_past *past;
    tl_time until;           /* CLOCK_MONOTONIC: nobody waits for room for longer */
    char name[TL_PAST_NAME]; /* of its run */
    tl_twin_tunings tunings; /* that are still to be taken; */
    bool has_tuning;         /* one was, and is not recorded yet: */
    tl_run_tuning tuning;    /* this */
} follower;

static void tell(const follower *self, tl_severity severity, const char *format, ...) TL_PRINTF(3, 4);

static void tell(const follower *self, tl_severity severity, const char *format, ...) {
    char text[TL_PAST_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    self->settings->tell(self->settings->context, severity, text);
}

static tl_status build_anew(const follower *self, tl_error *error) {
    tl_status status = tl_assembly_rebuild(self->settings->assembly);
    return status == TL_OK ? TL_OK : tl_fail(error, status, "the twin could not be built a second time");
}

/* ---- where it begins ---- */

/* Into the twin; if that fails, it is a new one again. */
static tl_status load(const follower *self, tl_past_outcome *outcome, tl_error *error) {
    const tl_past *past = self->past;
    tl_status status = tl_twin_load(self->settings->assembly->twin, past->checkpoint_tick, past->checkpoint,
                                    past->checkpoint_size, error);
    if (status == TL_OK || status == TL_FMU_FATAL) {
        return status;
    }
    *outcome = TL_PAST_REFUSED;
    tell(self, TL_EVENT_WARNING, "the checkpoint of tick %" PRId64 " of %s is of no use: %.120s", past->checkpoint_tick,
         self->name, error->text);
    return build_anew(self, error);
}

static tl_status begin(const follower *self, tl_past_outcome *outcome, tl_error *error) {
    if (self->past->from == TL_RESUMED_CHECKPOINT) {
        return load(self, outcome, error);
    }
    tl_twin_begin_at(self->settings->assembly->twin, self->past->first);
    return TL_OK;
}

/* ---- what is recorded ---- */

static void wait_for_room(const follower *self) {
    (void)tl_outbox_wait_for_room(self->settings->outbox, self->until);
}

static void put_start(const follower *self, const tl_resumption *resumption) {
    tl_outbox_start start = {.resumption = *resumption};
    tl_account_take(self->settings->assembly->twin, &start.account);
    if (!tl_outbox_put_start(self->settings->outbox, &start)) {
        wait_for_room(self); /* for its room too: it goes in before the first sample */
    }
}

/* The one that the run begins with. */
static void put_checkpoint(const follower *self) {
    const tl_past *past = self->past;
    tl_outbox *outbox = self->settings->outbox;
    size_t capacity = 0;
    if (tl_outbox_reserve_checkpoint(outbox, past->checkpoint_size)) {
        memcpy(tl_outbox_checkpoint_room(outbox, &capacity), past->checkpoint, past->checkpoint_size);
        tl_outbox_put_checkpoint(outbox, past->checkpoint_tick, past->checkpoint_size);
    }
}

static void begin_run(const follower *self, const tl_resumption *resumption) {
    if (self->settings->outbox != NULL) {
        put_start(self, resumption);
        if (self->past->checkpoint != NULL) {
            put_checkpoint(self);
        }
    }
}

static void put_tuning(follower *self) {
    if (self->has_tuning) {
        wait_for_room(self);
        (void)tl_outbox_put_tuning(self->settings->outbox, &self->tuning);
        self->has_tuning = false;
    }
}

static void put_sample(follower *self, const tl_sample *sample) {
    if (self->settings->outbox != NULL) {
        put_tuning(self);
        wait_for_room(self);
        (void)tl_outbox_put_sample(self->settings->outbox, sample); /* what is lost is counted there */
    }
}

static void put_step(const follower *self, const tl_record *record) {
    if (self->settings->outbox != NULL) {
        tl_twin_recorder_put(self->settings->outbox, record, self->settings->assembly->twin);
    }
}

/* ---- what was in force ---- */

/* Of the new run, at this tick; what it was begun with needs no saying, and has the number that it has now. */
static void note_tuning(follower *self, const tl_run_tuning *tuning, int64_t tick) {
    const tl_outbox *outbox = self->settings->outbox;
    const tl_run_tuning *in_force = outbox != NULL ? tl_outbox_tuning(outbox) : NULL;
    self->has_tuning = in_force != NULL && (self->has_tuning || strcmp(in_force->hash, tuning->hash) != 0);
    self->tuning = *tuning;
    self->tuning.tick = tick;
    if (outbox != NULL && strcmp(outbox->configured.hash, tuning->hash) == 0) {
        self->tuning.number = outbox->configured.number;
    }
}

/* Nothing is searched here, so that more evaluations than there is room for do no harm. */
static void take_tunings(follower *self, int64_t tick) {
    tl_assembly *assembly = self->settings->assembly;
    tl_run_tuning tuning;
    tl_error error;
    while (tl_twin_tunings_next(&self->tunings, tick, &tuning)) {
        if (tuning.values.evaluations > tl_tuning_room(assembly->tuning.evaluations)) {
            tuning.values.evaluations = tl_tuning_room(assembly->tuning.evaluations);
        }
        if (tl_assembly_retune(assembly, &tuning.values, &error) == TL_OK) {
            note_tuning(self, &tuning, tick);
        } else {
            tell(self, TL_EVENT_WARNING, "what %s took at tick %" PRId64 " is passed over: %.140s", self->name,
                 tuning.tick, error.text);
        }
    }
}

/* ---- following ---- */

static tl_status follow_tick(follower *self, const tl_past_tick *tick, tl_summary *summary, tl_error *error) {
    const tl_assembly *assembly = self->settings->assembly;
    tl_record record;
    bool ready = false;
    bool ahead = assembly->config.measurements == TL_AHEAD; /* the step before comes before the sample */
    take_tunings(self, tick->sample.tick);
    tl_summary_sample(summary, &assembly->config, &tick->sample);
    if (!ahead) {
        put_sample(self, &tick->sample);
    }
    if (tick->resets) {
        tl_twin_reset(assembly->twin);
    }
    tl_status status = tl_twin_follow(assembly->twin, &tick->sample, tick->u, &record, &ready, error);
    if (ready) {
        tl_summary_add(summary, &assembly->config, &record);
        put_step(self, &record);
    }
    if (ahead) {
        put_sample(self, &tick->sample);
    }
    return status;
}

static tl_status follow(follower *self, tl_summary *summary, tl_error *error) {
    tl_past_tick tick;
    tl_status status = TL_OK;
    for (int64_t number = self->past->first; status == TL_OK && tl_past_tick_at(self->past, number, &tick); number++) {
        status = follow_tick(self, &tick, summary, error);
    }
    return status;
}

static void tell_all(const follower *self, tl_time took) {
    const tl_past *past = self->past;
    char from[64];
    if (past->from == TL_RESUMED_CHECKPOINT) {
        (void)snprintf(from, sizeof from, "a checkpoint %.1f s old", tl_seconds(past->age));
    } else {
        (void)snprintf(from, sizeof from, "%s",
                       past->from == TL_RESUMED_START ? "the start of its recorded inputs" : "its newest inputs");
    }
    tell(self, TL_EVENT_INFO,
         "goes on with %s at tick %" PRId64 " from %s, %" PRId64
         " ticks run again in %.0f ms; nobody ran for %.2f s (%" PRId64 " ticks)",
         self->name, past->last + 1, from, past->last - past->first + 1, tl_seconds(took) * 1e3, tl_seconds(past->gap),
         past->gap / past->step);
}

/* From where the twin stands now. A failure leaves a new twin, and a run that is of no use. */
static tl_status go_on(follower *self, tl_summary *summary, tl_past_outcome *outcome, tl_error *error) {
    const tl_past *past = self->past;
    tl_time begun = tl_clock_now(NULL);
    summary->resumption = (tl_resumption){
        .from = past->from, .run = past->run, .tick = past->last + 1, .start = past->start, .started = past->started};
    begin_run(self, &summary->resumption);
    tl_status status = follow(self, summary, error);
    if (status == TL_OK) {
        take_tunings(self, past->last + 1); /* where there was no tick to be followed */
        put_tuning(self);
        tell_all(self, tl_clock_now(NULL) - begun);
        return TL_OK;
    }
    *outcome = TL_PAST_FAILED;
    *summary = (tl_summary){0};
    if (status == TL_FMU_FATAL) {
        return status;
    }
    tell(self, TL_EVENT_WARNING, "begins anew: to go on with %s has failed: %.140s", self->name, error->text);
    return build_anew(self, error);
}

tl_status tl_past_follow(const tl_past_follow_settings *settings, const tl_past *past, tl_summary *summary,
                         tl_past_outcome *outcome, tl_error *error) {
    follower self = {.settings = settings,
                     .past = past,
                     .until = tl_clock_now(NULL) + PATIENCE,
                     .tunings = {.bytes = past->tunings, .count = past->tuning_count}};
    (void)tl_past_name(past->run, self.name);
    *summary = (tl_summary){0};
    *outcome = TL_PAST_FOLLOWED;
    tl_status status = begin(&self, outcome, error);
    return status == TL_OK && *outcome == TL_PAST_FOLLOWED ? go_on(&self, summary, outcome, error) : status;
}
