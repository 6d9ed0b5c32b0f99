/* Judges what the plant says: what it showed at an instant, and how far that can be trusted.
 *
 * Alike:   a reading whose stamp is within TL_PLANT_ALIKE of an instant is one of that instant. A plant that is sampled in step with the twin would else
 *          lose a whole sample to a stamp that is some nanoseconds late, now and then: half of the error of a fast signal. Not at tick 0, which begins at a reading.
 * Between: the plant goes on between two messages, and whoever holds the last one matches what was true some messages' time ago on average half of that. So
 *          a signal may be looked up on the line between the reading before the instant and the one after it, by their own stamps. The one after is
 *          waited for: the sample of t looks back by `back`, which is at least as long as the next message may take, and the twin is led by as many ticks
 *          less (config_lookups.c). What comes out of it is the sample, and is recorded as that; so a replay takes what the run took.
 *          The last reading stands, as it does where nothing is asked for, and is judged by its own age: where the next one is not there by t; where one of
 *          the two is not good; and where they are further apart than what makes one stale, since nobody knows what was in between.
 * Conditioned: of a signal with a stream only what has come out of it is looked up, and that under its own stamps: a reading that was rejected is, for
 *          the line, as if it had never come.
 * Mean:    the same line, but what an input is held at for a macro step is its mean over that step: from t − back on, by trapezoids from reading to reading.
 *          An instant's value, held, would be half a step late; a mean is late by nothing, and takes the noise of all readings in the step along.
 */
#include "firmware/plant/plant_input.h"

#include <math.h>
#include <stdlib.h>

#include "firmware/plant/conditioner.h"

/* 2^31: integers of FMI 2.0 are below it. */
#define INTEGER_LIMIT 2147483648.0

/* ---- The readings of one signal, conditioned each once as it comes, and kept to be looked up.
 *
 * Purpose: between the mailbox that a source posts into and the look-up of a sample. What has come by an instant is the same whenever that is asked,
 *          so a run that has missed ticks sees what it would have seen.
 * Again:   a reading with a stamp no later than the newest that was taken is that one again, and is passed over; one whose stamp is later than the
 *          instant waits for its time.
 * Trust:   none in the mailbox; so many readings are taken at once as it is deep. */

struct tl_reading_stream {
    tl_conditioner conditioner;
    const tl_sample_buffer_slot *from; /* the mailbox that is read; NULL: none yet */
    uint64_t next;                     /* its post */
    tl_reading last;                   /* that was taken, as it came; its stamp is TL_TIME_NEVER if none was */
    tl_reading
        shown; /* the same; if any was rejected at this instant, the last of these, with the quality TL_OUTLIER */
    bool has_rejected;            /* at this instant */
    uint64_t count, smooth_count; /* of these: */
    tl_sample_buffer out;         /* what has come out, to be looked up; */
    tl_sample_buffer smooth;      /* and, under the same stamps, where the low-pass was: the same where there is none */
    tl_sample_buffer_slot slots[];
};

/* For as many readings as a mailbox of that depth has, a power of two. NULL: there is not enough memory. */
static tl_reading_stream *make_stream(const tl_condition *condition, tl_time stale, uint32_t depth) {
    tl_reading_stream *stream = calloc(1, sizeof *stream + 2 * (size_t)depth * sizeof stream->slots[0]);
    if (stream != NULL) {
        tl_conditioner_init(&stream->conditioner, condition, stale);
        stream->last.stamp = TL_TIME_NEVER;
        stream->out = (tl_sample_buffer){.slots = stream->slots, .count = &stream->count, .depth = depth};
        stream->smooth =
            (tl_sample_buffer){.slots = stream->slots + depth, .count = &stream->smooth_count, .depth = depth};
    }
    return stream;
}

/* The next reading of the mailbox with a stamp ≤ until; false: there is none yet. */
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

/* It, judged. */
static void put_into_stream(tl_reading_stream *stream, const tl_reading *reading) {
    tl_conditioned out[TL_CONDITIONER_LEVEL];
    bool is_rejected = false;
    size_t count = tl_conditioner_take(&stream->conditioner, reading, &is_rejected, out);
    for (size_t i = 0; i < count; i++) {
        tl_sample_buffer_post(&stream->out, &out[i].reading);
        out[i].reading.value = out[i].smooth;
        tl_sample_buffer_post(&stream->smooth, &out[i].reading);
    }
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

/* Whether a stamp can be one of this plant's. What is between them may be more than a tl_time holds. */
static bool is_near(tl_time stamp, tl_time instant) {
    uint64_t apart = stamp < instant ? (uint64_t)instant - (uint64_t)stamp : (uint64_t)stamp - (uint64_t)instant;
    return apart <= TL_PLANT_FARTHEST;
}

static tl_quality worse(tl_quality a, tl_quality b) {
    return a > b ? a : b;
}

/* The quality of a reading at an instant; corrects the value of one that is no number. */
static tl_quality judge(const tl_plant_limits *limits, tl_time instant, tl_reading *reading) {
    tl_quality quality = reading->quality;
    if (!isfinite(reading->value) || quality >= TL_NOT_A_NUMBER) {
        reading->value = isfinite(reading->value) ? reading->value : 0;
        return worse(quality, TL_NOT_A_NUMBER);
    }
    if (reading->value < limits->minimum || reading->value > limits->maximum ||
        !fits_type(reading->value, limits->type)) {
        quality = worse(quality, TL_OUT_OF_RANGE);
    }
    if (limits->stale > 0 && instant > reading->stamp && instant - reading->stamp > limits->stale) {
        quality = worse(quality, TL_STALE);
    }
    return quality;
}

/* ---- between two readings ---- */

/* A signal as it is looked up. */
typedef struct view {
    const tl_sample_buffer *buffer; /* what is looked up, but for a line: */
    const tl_sample_buffer *lines;  /* its readings, */
    tl_time low_pass;               /* and τ of what follows it; 0: nothing does */
    const tl_plant_limits *limits;
    tl_time until; /* what is later is not there yet */
} view;

static bool is_good(const view *self, const tl_reading *reading) {
    tl_reading own = *reading;
    return judge(self->limits, own.stamp, &own) == TL_GOOD;
}

/* Whether there is a line from one to the other. */
static bool are_joined(const view *self, const tl_reading *before, const tl_reading *after) {
    if (after->stamp == TL_TIME_NEVER || !is_near(after->stamp, before->stamp) || after->stamp <= before->stamp) {
        return false;
    }
    bool is_close = self->limits->stale <= 0 || after->stamp - before->stamp <= self->limits->stale;
    return is_close && is_good(self, before) && is_good(self, after) && isfinite(after->value - before->value);
}

/* What there is at an instant: a reading of it, a value between two, or the last one. False where there was none yet. */
static bool look_between(const view *self, tl_time at, tl_time alike, tl_reading *reading) {
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

/* The same where a low-pass follows the line: what it is τ later belongs to the instant. */
static bool look_smooth(const view *self, tl_time at, tl_time alike, tl_reading *reading) {
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

/* A bound for who floods the mail; what is behind so many readings is one line. */
enum { MOST_OF_A_SPAN = 256 };

/* The integral from one instant to another, of what begins with `from`, which is good. */
static double integrate(const view *self, tl_reading from, tl_time end) {
    double sum = 0;
    tl_reading before;
    tl_reading after;
    for (int i = 0; i < MOST_OF_A_SPAN; i++) {
        bool goes_on = tl_sample_buffer_around(self->lines, from.stamp, self->until, &before, &after) &&
                       are_joined(self, &before, &after) && after.stamp > from.stamp && after.stamp < end;
        if (!goes_on) {
            break;
        }
        sum += (double)(after.stamp - from.stamp) * 0.5 * (from.value + after.value);
        from = after;
    }
    tl_reading last = from;
    bool any = look_between(self, end, 0, &last) && is_good(self, &last);
    return sum + (double)(end - from.stamp) * 0.5 * (from.value + (any ? last.value : from.value));
}

/* Over the span that begins at an instant; where that begins with nothing good, what is there stands. */
static bool look_mean(const view *self, const tl_plant_look *look, tl_time at, tl_reading *reading) {
    if (!look_between(self, at, 0, reading)) {
        return false;
    }
    tl_reading from = *reading;
    if (judge(self->limits, at, &from) == TL_GOOD) {
        from.stamp = at;
        double mean = integrate(self, from, at + look->span) / (double)look->span;
        *reading = (tl_reading){.value = mean, .stamp = at + look->span / 2, .quality = TL_GOOD};
    }
    return true;
}

/* ---- a sample ---- */

/* Of an instant, or the last one before it, or the next one. */
static bool look_last(const view *self, const tl_plant_look *look, tl_time at, tl_time alike, tl_reading *reading) {
    bool any = tl_sample_buffer_at(self->buffer, at + alike, reading);
    bool is_of_it = any && is_near(reading->stamp, at) && reading->stamp >= at - alike && reading->stamp <= at + alike;
    return is_of_it || (!look->next && any) || tl_sample_buffer_from(self->buffer, at, self->until, reading);
}

/* By `instant`, as the signal's look says. */
static bool look_up(const tl_plant_input *input, size_t signal, tl_time instant, tl_time alike, tl_reading *reading) {
    const tl_plant_look *look = &input->looks[signal];
    const tl_reading_stream *stream = input->streams[signal];
    const view self = {
        .buffer = stream != NULL ? &stream->smooth : &input->buffers[signal],
        .lines = stream != NULL ? &stream->out : &input->buffers[signal],
        .low_pass = stream != NULL ? stream->conditioner.condition.low_pass : 0,
        .limits = &input->limits[signal],
        .until = instant + alike,
    };
    tl_time at = instant - look->back;
    switch (look->between) {
    case TL_BETWEEN_LINE:
        return (self.low_pass > 0 ? look_smooth(&self, at, alike, reading) : look_between(&self, at, alike, reading)) ||
               look_last(&self, look, at, alike, reading);
    case TL_BETWEEN_MEAN:
        return look_mean(&self, look, at, reading) || look_last(&self, look, at, alike, reading);
    case TL_BETWEEN_LAST:
        break;
    }
    return look_last(&self, look, at, alike, reading);
}

/* What has come of a signal by `until`; a stamp that is nobody's is passed over. */
static void condition(const tl_plant_input *input, size_t signal, tl_time until) {
    tl_reading_stream *stream = input->streams[signal];
    const tl_sample_buffer *buffer = &input->buffers[signal];
    tl_reading reading;
    stream->has_rejected = false;
    for (uint32_t i = 0; i < buffer->depth && next_of_stream(stream, buffer, until, &reading); i++) {
        if (is_near(reading.stamp, until)) {
            reading.quality = judge(&input->limits[signal], reading.stamp, &reading);
            put_into_stream(stream, &reading);
        }
    }
}

/* The newest reading of a signal as it came, and as it was judged. */
static bool show(const tl_plant_input *input, size_t signal, tl_time until, tl_reading *reading) {
    const tl_reading_stream *stream = input->streams[signal];
    if (stream != NULL) {
        *reading = stream->shown;
        return stream->last.stamp != TL_TIME_NEVER;
    }
    bool any = tl_sample_buffer_at(&input->buffers[signal], until, reading);
    if (any && is_near(reading->stamp, until)) {
        reading->quality = judge(&input->limits[signal], reading->stamp, reading);
    }
    return any;
}

/* One signal of a sample, judged. False: there is no reading of it. */
static bool take(const tl_plant_input *input, size_t signal, tl_time instant, tl_time alike, tl_reading *reading) {
    const tl_plant_look *look = &input->looks[signal];
    if (look->shows) {
        return show(input, look->shown, instant + alike, reading) && is_near(reading->stamp, instant);
    }
    tl_time at = instant - look->back;
    if (!look_up(input, signal, instant, alike, reading) || !is_near(reading->stamp, at)) {
        return false;
    }
    reading->quality = judge(&input->limits[signal], at, reading);
    return true;
}

void tl_plant_input_take(const tl_plant_input *input, int64_t tick, tl_time instant, tl_sample *sample) {
    tl_time alike = tick > 0 ? TL_PLANT_ALIKE : 0;
    sample->tick = tick;
    sample->instant = instant;
    for (size_t i = 0; i < input->count; i++) {
        if (input->streams[i] != NULL) {
            condition(input, i, instant + alike);
        }
    }
    for (size_t i = 0; i < input->count; i++) {
        tl_reading reading;
        if (!take(input, i, instant, alike, &reading)) {
            reading = (tl_reading){.value = 0, .stamp = TL_TIME_NEVER, .quality = TL_NO_LINK};
        }
        sample->values[i] = reading.value;
        sample->stamps[i] = reading.stamp;
        sample->quality[i] = (uint8_t)reading.quality;
    }
}
