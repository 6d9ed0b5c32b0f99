/* Going on with a past: see past_follow.h. */
#include "firmware/past/past_follow.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

#include "firmware/base/clock.h"
#include "firmware/twin/twin_recorder.h"

typedef struct follower {
    const tl_past_follow_settings *settings;
    const tl_past *past;
    char name[TL_PAST_NAME]; /* of its run */
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

/* ---- following ---- */

static void put_sample(const tl_past_sink *sink, const tl_sample *sample) {
    if (sink != NULL) {
        sink->wait(sink);
        sink->put_sample(sink, sample);
    }
}

static void put_step(const tl_past_sink *sink, const tl_record *record, const tl_twin *twin) {
    if (sink != NULL) {
        tl_recorder_component counts[TL_RECORDER_COMPONENTS];
        (void)tl_twin_recorder_count(twin, counts);
        sink->put_step(sink, record, counts);
    }
}

static tl_status follow_tick(const follower *self, const tl_past_tick *tick, tl_summary *summary, tl_error *error) {
    const tl_assembly *assembly = self->settings->assembly;
    tl_record record;
    bool ready = false;
    bool ahead = assembly->config.measurements == TL_AHEAD; /* the step before comes before the sample */
    tl_summary_sample(summary, &assembly->config, &tick->sample);
    if (!ahead) {
        put_sample(self->settings->sink, &tick->sample);
    }
    tl_status status = tl_twin_follow(assembly->twin, &tick->sample, tick->u, &record, &ready, error);
    if (ready) {
        tl_summary_add(summary, &assembly->config, &record);
        put_step(self->settings->sink, &record, assembly->twin);
    }
    if (ahead) {
        put_sample(self->settings->sink, &tick->sample);
    }
    return status;
}

static tl_status follow(const follower *self, tl_summary *summary, tl_error *error) {
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

/* The sink's run begins. */
static void begin_run(const follower *self, const tl_resumption *resumption) {
    const tl_past_sink *sink = self->settings->sink;
    if (sink != NULL) {
        sink->begin(sink, resumption);
    }
    if (sink != NULL && self->past->checkpoint != NULL) {
        sink->keep(sink, self->past->checkpoint_tick, self->past->checkpoint, self->past->checkpoint_size);
    }
}

/* From where the twin stands now. A failure leaves a new twin, and a run that is of no use. */
static tl_status go_on(const follower *self, tl_summary *summary, tl_past_outcome *outcome, tl_error *error) {
    const tl_past *past = self->past;
    tl_time begun = tl_clock_now(NULL);
    summary->resumption = (tl_resumption){
        .from = past->from, .run = past->run, .tick = past->last + 1, .start = past->start, .started = past->started};
    begin_run(self, &summary->resumption);
    tl_status status = follow(self, summary, error);
    if (status == TL_OK) {
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
    follower self = {.settings = settings, .past = past};
    (void)tl_past_name(past->run, self.name);
    *summary = (tl_summary){0};
    *outcome = TL_PAST_FOLLOWED;
    tl_status status = begin(&self, outcome, error);
    return status == TL_OK && *outcome == TL_PAST_FOLLOWED ? go_on(&self, summary, outcome, error) : status;
}
