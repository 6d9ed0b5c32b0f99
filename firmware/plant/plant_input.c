/* Plant input: looks up the signals at an instant and determines their qualities.
 *
 * Alike:       a reading within TL_PLANT_ALIKE of an instant belongs to it. If the plant is sampled
 *              in step with the twin, a stamp may be a few nanoseconds late. Without this rule,
 *              that would delay its value by a whole sample. For a fast signal, this delay was half
 *              of the error. The rule does not apply at tick 0, which starts at a reading.
 * Between:     the plant moves between two messages, and the last one is half an interval old on
 *              average. So a signal can be looked up on the line between the readings before and
 *              after the instant, by their own stamps. To have the reading after it, the sample of
 *              t looks back by `back`, which is at least the longest message interval. The twin
 *              computes its steps later by the same number of ticks (config_lookups.c). The
 *              interpolated value is recorded, so a replay uses the same one.
 * Last:        the last reading is used instead, with its own age, in three cases: the next one has
 *              not come by t; one of both is not good; or they are further apart than the stale
 *              time.
 * Conditioned: for a signal with a stream, only its outputs are looked up, by their own stamps. The
 *              line ignores rejected readings.
 * Mean:        an input is constant during a macro step. Its value is the mean of the line over
 *              that step, from t − back, by trapezoids between the readings. The value of an
 *              instant would be late by half a step; a mean is not, and averages the noise of all
 *              readings in the step.
 */
#include "firmware/plant/plant_input.h"

#include <math.h>
#include <stdlib.h>

#include "firmware/plant/conditioner.h"

/* 2^31: integers of FMI 2.0 are below it. */
#define INTEGER_LIMIT 2147483648.0

/* ---- Stream: the conditioned readings of one signal, kept for look-ups.
 *
 * Purpose: between the sample buffer of a source and the look-up of a sample. What is available at
 *          an instant does not depend on the time of the call, so a run that missed ticks sees the
 *          same values.
 * Again:   a reading with a stamp not later than the newest one taken is a repetition and skipped.
 *          A reading with a stamp later than the instant stays in the buffer.
 * Trust:   the sample buffer is untrusted; at most its depth of readings are taken in one call.
 */

struct tl_reading_stream {
    tl_conditioner conditioner;
    const tl_sample_buffer_slot *from; /* sample buffer that is read; NULL: none yet */
    uint64_t next;                     /* its next post */
    tl_reading last;                   /* last reading taken, as it came; stamp TL_TIME_NEVER: none */
    tl_reading shown;  /* as `last`; if a reading was rejected at this instant, the last rejected one, as TL_OUTLIER */
    bool has_rejected; /* at this instant */
    uint64_t count, smooth_count; /* of the two buffers below */
    tl_sample_buffer out;         /* outputs, for look-ups */
    tl_sample_buffer smooth;      /* same stamps, with the value of the low-pass; equal to `out` without one */
    tl_sample_buffer_slot slots[];
};

/* `depth`: that of the sample buffer, a power of two. Returns NULL if memory is out. */
static tl_reading_stream *make_stream(const tl_condition *condition_signal, tl_time stale, uint32_t depth) {
    tl_reading_stream *stream = calloc(1, sizeof *stream + 2 * (size_t)depth * sizeof stream->slots[0]);
    if (stream != NULL) {
        tl_conditioner_init(&stream->conditioner, condition_signal, stale);
        stream->last.stamp = TL_TIME_NEVER;
        stream->out = (tl_sample_buffer){.slots = stream->slots, .count = &stream->count, .depth = depth};
        stream->smooth =
            (tl_sample_buffer){.slots = stream->slots + depth, .count = &stream->smooth_count, .depth = depth};
    }
    return stream;
}

/* Reads the next new reading of the buffer with a stamp ≤ until. Returns false if there is none. */
static bool next_of_stream(tl_reading_stream *stream, const tl_sample_buffer *buffer, tl_time until,
                           tl_reading *reading) {
    if (stream->from != buffer->slots) {
        stream->from = buffer->slots;
        stream->next = 0;
    }
    bool any = tl_sample_buffer_next(buffer, until, &stream->next, reading);
    for (uint32_t i = 0; any && reading->stamp <= stream->last.stamp; i++) {
        any = i < buffer->depth && tl_sample_buffer_next(buffer, until, &stream->next, reading);
    }
    return any;
}

static void post_outputs(tl_reading_stream *stream, const tl_conditioned *out, size_t count) {
    for (size_t i = 0; i < count; i++) {
        tl_reading smooth = out[i].reading;
        smooth.value = out[i].smooth;
        tl_sample_buffer_post(&stream->out, &out[i].reading);
        tl_sample_buffer_post(&stream->smooth, &smooth);
    }
}

/* Adds a reading with its quality. */
static void put_into_stream(tl_reading_stream *stream, const tl_reading *reading) {
    tl_conditioned out[TL_CONDITIONER_LEVEL] = {{.smooth = 0.0}};
    bool is_rejected = false;
    size_t count = tl_conditioner_take(&stream->conditioner, reading, &is_rejected, out);
    post_outputs(stream, out, count);
    stream->last = *reading;
    if (is_rejected || !stream->has_rejected) {
        stream->shown = *reading;
        stream->shown.quality = is_rejected ? TL_OUTLIER : reading->quality;
    }
    stream->has_rejected = stream->has_rejected || is_rejected;
}

bool tl_plant_input_open(tl_plant_input *input) {
    bool all = true;
    for (size_t i = 0; i < input->count; i++) {
        if (tl_condition_is_needed(&input->conditions[i]) && !input->looks[i].shows) {
            input->streams[i] = make_stream(&input->conditions[i], input->limits[i].stale, input->buffers[i].depth);
            all = all && input->streams[i] != NULL;
        }
    }
    return all;
}

void tl_plant_input_close(tl_plant_input *input) {
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        free(input->streams[i]);
        input->streams[i] = NULL;
    }
}

bool tl_plant_input_is_complete(const tl_plant_input *input) {
    for (size_t i = 0; i < input->count; i++) {
        tl_reading reading;
        bool is_one = !input->looks[i].shows;
        if (is_one && (!tl_sample_buffer_at(&input->buffers[i], INT64_MAX, &reading) || reading.quality != TL_GOOD)) {
            return false;
        }
    }
    return true;
}

static bool fits_type(double value, tl_type type) {
    switch (type) {
    case TL_BOOLEAN:
        return value == 0 || value == 1;
    case TL_INTEGER:
    case TL_ENUMERATION:
        return fabs(value) < INTEGER_LIMIT && value == trunc(value);
    case TL_REAL:
    case TL_STRING:
        break;
    }
    return true;
}

static bool is_permitted(const tl_plant_limits *limits, double value) {
    double place = value - limits->minimum;
    bool is_item = limits->items == 0 || (place >= 0.0 && place < 64.0 && (limits->items >> (unsigned)place & 1U) != 0);
    return !(value < limits->minimum - limits->below) && !(value > limits->maximum + limits->above) &&
           fits_type(value, limits->type) && is_item;
}

bool tl_plant_limits_apply(const tl_plant_limits *limits, double *value, bool *moved) {
    bool is_below = *value < limits->minimum;
    if (!is_permitted(limits, *value)) {
        return false;
    }
    *moved = is_below || *value > limits->maximum;
    *value = !*moved ? *value : is_below ? limits->minimum : limits->maximum;
    return true;
}

/* Returns true if a stamp is plausible. Unsigned, because the difference of any two stamps may not
 * fit into tl_time. */
static bool is_near(tl_time stamp, tl_time instant) {
    uint64_t apart = stamp < instant ? (uint64_t)instant - (uint64_t)stamp : (uint64_t)stamp - (uint64_t)instant;
    return apart <= TL_PLANT_FARTHEST;
}

static tl_quality worse(tl_quality a, tl_quality b) {
    return a > b ? a : b;
}

/* Determines the quality of a reading at an instant. Sets a value that is not finite to 0. */
static tl_quality rate_reading(const tl_plant_limits *limits, tl_time instant, tl_reading *reading) {
    tl_quality quality = reading->quality;
    if (!isfinite(reading->value) || quality >= TL_NOT_A_NUMBER) {
        reading->value = isfinite(reading->value) ? reading->value : 0;
        return worse(quality, TL_NOT_A_NUMBER);
    }
    if (!is_permitted(limits, reading->value)) {
        quality = worse(quality, TL_OUT_OF_RANGE);
    }
    if (limits->stale > 0 && instant > reading->stamp && instant - reading->stamp > limits->stale) {
        quality = worse(quality, TL_STALE);
    }
    return quality;
}

/* ---- between two readings ---- */

/* How one signal is looked up. */
typedef struct lookup {
    const tl_sample_buffer *buffer; /* buffer for a look-up of readings; or with a low-pass, of its values */
    const tl_sample_buffer *lines;  /* buffer for lines between readings */
    tl_time low_pass;               /* τ of the low-pass along the line, ns; 0: none */
    const tl_plant_limits *limits;
    tl_time until; /* later readings are not available yet */
} lookup;

static bool is_good(const lookup *self, const tl_reading *reading) {
    tl_reading own = *reading;
    return rate_reading(self->limits, own.stamp, &own) == TL_GOOD;
}

/* Returns true if there is a valid line between two readings. */
static bool are_joined(const lookup *self, const tl_reading *before, const tl_reading *after) {
    if (after->stamp == TL_TIME_NEVER || !is_near(after->stamp, before->stamp) || after->stamp <= before->stamp) {
        return false;
    }
    bool is_close = self->limits->stale <= 0 || after->stamp - before->stamp <= self->limits->stale;
    return is_close && is_good(self, before) && is_good(self, after) && isfinite(after->value - before->value);
}

/* Looks up an instant: a reading at it, a value on the line, or the last reading. Returns false if
 * there was none yet. */
static bool interpolate_line(const lookup *self, tl_time at, tl_time alike, tl_reading *reading) {
    tl_reading after;
    if (!tl_sample_buffer_around(self->lines, at + alike, self->until, reading, &after) ||
        !is_near(reading->stamp, at)) {
        return false;
    }
    if (reading->stamp < at - alike && are_joined(self, reading, &after)) {
        double share = (double)(at - reading->stamp) / (double)(after.stamp - reading->stamp);
        double value = reading->value + share * (after.value - reading->value);
        *reading = (tl_reading){.value = value, .stamp = at, .quality = TL_GOOD};
    }
    return true;
}

/* As interpolate_line(), with a low-pass along the line. Its value τ later belongs to the instant.
 */
static bool interpolate_smooth(const lookup *self, tl_time at, tl_time alike, tl_reading *reading) {
    tl_time later = at + self->low_pass;
    tl_conditioned before;
    tl_reading smooth;
    tl_reading after;
    if (!tl_sample_buffer_around(self->lines, later + alike, self->until, &before.reading, &after) ||
        !tl_sample_buffer_around(self->buffer, later + alike, self->until, reading, &smooth) ||
        !is_near(reading->stamp, at)) {
        return false;
    }
    if (reading->stamp < later - alike && are_joined(self, &before.reading, &after)) {
        before.smooth = reading->value;
        *reading = (tl_reading){.value = tl_conditioner_between(self->low_pass, &before, &after, later),
                                .stamp = later,
                                .quality = TL_GOOD};
    }
    reading->stamp -= self->low_pass;
    return true;
}

/* Limits the time if a source floods the buffer; the remaining span counts as one line. */
enum { SPAN_LINES = 256 };

/* Integral from the good reading `from` to `end`. */
static double integrate(const lookup *self, tl_reading from, tl_time end) {
    double sum = 0;
    tl_reading before;
    tl_reading after;
    for (int i = 0; i < SPAN_LINES; i++) {
        bool continues = tl_sample_buffer_around(self->lines, from.stamp, self->until, &before, &after) &&
                         are_joined(self, &before, &after) && after.stamp > from.stamp && after.stamp < end;
        if (!continues) {
            break;
        }
        sum += (double)(after.stamp - from.stamp) * 0.5 * (from.value + after.value);
        from = after;
    }
    tl_reading last = from;
    bool any = interpolate_line(self, end, 0, &last) && is_good(self, &last);
    return sum + (double)(end - from.stamp) * 0.5 * (from.value + (any ? last.value : from.value));
}

/* Mean over the span that starts at `at`. If the value at its start is not good, that value is the
 * result. */
static bool take_mean(const lookup *self, const tl_plant_lookup *look, tl_time at, tl_reading *reading) {
    if (!interpolate_line(self, at, 0, reading)) {
        return false;
    }
    tl_reading from = *reading;
    if (rate_reading(self->limits, at, &from) == TL_GOOD) {
        from.stamp = at;
        double mean = integrate(self, from, at + look->span) / (double)look->span;
        *reading = (tl_reading){.value = mean, .stamp = at + look->span / 2, .quality = TL_GOOD};
    }
    return true;
}

/* ---- samples ---- */

/* Looks up a reading at the instant, or the last one before, or the next one. */
static bool take_last(const lookup *self, const tl_plant_lookup *look, tl_time at, tl_time alike, tl_reading *reading) {
    bool any = tl_sample_buffer_at(self->buffer, at + alike, reading);
    bool is_of_it = any && is_near(reading->stamp, at) && reading->stamp >= at - alike && reading->stamp <= at + alike;
    return is_of_it || (!look->next && any) || tl_sample_buffer_from(self->buffer, at, self->until, reading);
}

/* Looks up a signal for the sample of `instant`. */
static bool look_up(const tl_plant_input *input, size_t signal, tl_time instant, tl_time alike, tl_reading *reading) {
    const tl_plant_lookup *look = &input->looks[signal];
    const tl_reading_stream *stream = input->streams[signal];
    const lookup self = {
        .buffer = stream != NULL ? &stream->smooth : &input->buffers[signal],
        .lines = stream != NULL ? &stream->out : &input->buffers[signal],
        .low_pass = stream != NULL ? stream->conditioner.condition.low_pass : 0,
        .limits = &input->limits[signal],
        .until = instant + alike,
    };
    tl_time at = instant - look->back;
    switch (look->between) {
    case TL_BETWEEN_LINE:
        return (self.low_pass > 0 ? interpolate_smooth(&self, at, alike, reading)
                                  : interpolate_line(&self, at, alike, reading)) ||
               take_last(&self, look, at, alike, reading);
    case TL_BETWEEN_MEAN:
        return take_mean(&self, look, at, reading) || take_last(&self, look, at, alike, reading);
    case TL_BETWEEN_LAST:
        break;
    }
    return take_last(&self, look, at, alike, reading);
}

/* Conditions all new readings of a signal up to `until`; skips implausible stamps. */
static void condition_signal(const tl_plant_input *input, size_t signal, tl_time until) {
    tl_reading_stream *stream = input->streams[signal];
    const tl_sample_buffer *buffer = &input->buffers[signal];
    tl_reading reading;
    stream->has_rejected = false;
    for (uint32_t i = 0; i < buffer->depth && next_of_stream(stream, buffer, until, &reading); i++) {
        if (is_near(reading.stamp, until)) {
            reading.quality = rate_reading(&input->limits[signal], reading.stamp, &reading);
            put_into_stream(stream, &reading);
        }
    }
    tl_conditioned out[TL_CONDITIONER_LEVEL] = {{.smooth = 0.0}};
    post_outputs(stream, out, tl_conditioner_wait(&stream->conditioner, until, out));
}

/* Returns the newest reading of a signal as it came, with its quality. */
static bool take_newest(const tl_plant_input *input, size_t signal, tl_time until, tl_reading *reading) {
    const tl_reading_stream *stream = input->streams[signal];
    if (stream != NULL) {
        *reading = stream->shown;
        return stream->last.stamp != TL_TIME_NEVER;
    }
    bool any = tl_sample_buffer_at(&input->buffers[signal], until, reading);
    if (any && is_near(reading->stamp, until)) {
        reading->quality = rate_reading(&input->limits[signal], reading->stamp, reading);
    }
    return any;
}

/* Takes one signal of a sample with its quality. Returns false if there is no reading. */
static bool take_signal(const tl_plant_input *input, size_t signal, tl_time instant, tl_time alike,
                        tl_reading *reading) {
    const tl_plant_lookup *look = &input->looks[signal];
    if (look->shows) {
        return take_newest(input, look->shown, instant + alike, reading) && is_near(reading->stamp, instant);
    }
    tl_time at = instant - look->back;
    if (!look_up(input, signal, instant, alike, reading) || !is_near(reading->stamp, at)) {
        return false;
    }
    reading->quality = rate_reading(&input->limits[signal], at, reading);
    return true;
}

void tl_plant_input_take(const tl_plant_input *input, int64_t tick, tl_time instant, tl_sample *sample) {
    tl_time alike = tick > 0 ? TL_PLANT_ALIKE : 0;
    sample->tick = tick;
    sample->instant = instant;
    sample->moved = 0;
    for (size_t i = 0; i < input->count; i++) {
        if (input->streams[i] != NULL) {
            condition_signal(input, i, instant + alike);
        }
    }
    for (size_t i = 0; i < input->count; i++) {
        tl_reading reading;
        if (!take_signal(input, i, instant, alike, &reading)) {
            reading = (tl_reading){.value = 0, .stamp = TL_TIME_NEVER, .quality = TL_NO_LINK};
        }
        bool moved = false;
        if (reading.quality == TL_GOOD && tl_plant_limits_apply(&input->limits[i], &reading.value, &moved) && moved) {
            sample->moved |= UINT64_C(1) << i;
        }
        sample->values[i] = reading.value;
        sample->stamps[i] = reading.stamp;
        sample->quality[i] = (uint8_t)reading.quality;
    }
}
