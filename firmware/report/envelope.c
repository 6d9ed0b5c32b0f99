/* The envelope of long curves: see envelope.h. */
#include "firmware/report/envelope.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

tl_status tl_envelope_init(tl_envelope *envelope, size_t channels, size_t room, tl_error *error) {
    size_t count = channels * room;
    *envelope = (tl_envelope){.channels = channels, .room = room, .width = 1};
    envelope->values = malloc((count + 1) * 2 * sizeof *envelope->values);
    envelope->falls = calloc(count + 1, 1);
    envelope->marks = calloc(count + 1, 1);
    if (envelope->values == NULL || envelope->falls == NULL || envelope->marks == NULL) {
        tl_envelope_free(envelope);
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for %zu curves of %zu points", channels, room);
    }
    for (size_t i = 0; i < count * 2; i++) {
        envelope->values[i] = (double)NAN;
    }
    return TL_OK;
}

void tl_envelope_free(tl_envelope *envelope) {
    free(envelope->values);
    free(envelope->falls);
    free(envelope->marks);
    *envelope = (tl_envelope){0};
}

/* Bucket `to` becomes what `first` and `second` were together. */
static void merge(tl_envelope *envelope, size_t to, size_t first, size_t second) {
    const double *one = &envelope->values[2 * first];
    const double *other = &envelope->values[2 * second];
    bool lower = !(one[0] <= other[0]); /* the second has the least; also where the first has none */
    bool higher = !(one[1] >= other[1]);
    if (isnan(other[0])) {
        lower = false;
        higher = false;
    }
    uint8_t falls = lower == higher ? envelope->falls[lower ? second : first] : lower;
    double least = lower ? other[0] : one[0];
    double largest = higher ? other[1] : one[1];
    uint8_t marks = envelope->marks[first] | envelope->marks[second];
    envelope->values[2 * to] = least;
    envelope->values[2 * to + 1] = largest;
    envelope->falls[to] = falls;
    envelope->marks[to] = marks;
}

static void clear(tl_envelope *envelope, size_t from, size_t count) {
    for (size_t i = from; i < from + count; i++) {
        envelope->values[2 * i] = (double)NAN;
        envelope->values[2 * i + 1] = (double)NAN;
    }
    memset(&envelope->falls[from], 0, count);
    memset(&envelope->marks[from], 0, count);
}

static void widen(tl_envelope *envelope) {
    size_t half = envelope->room / 2;
    for (size_t channel = 0; channel < envelope->channels; channel++) {
        size_t start = channel * envelope->room;
        for (size_t i = 0; i < half; i++) {
            merge(envelope, start + i, start + 2 * i, start + 2 * i + 1);
        }
        clear(envelope, start + half, half);
    }
    envelope->used = (envelope->used + 1) / 2;
    envelope->width *= 2;
}

/* The index of the bucket of a channel's step. */
static size_t bucket_of(tl_envelope *envelope, size_t channel, int64_t position) {
    while (position / envelope->width >= (int64_t)envelope->room) {
        widen(envelope);
    }
    size_t bucket = (size_t)(position / envelope->width);
    envelope->used = bucket >= envelope->used ? bucket + 1 : envelope->used;
    envelope->steps = position >= envelope->steps ? position + 1 : envelope->steps;
    return channel * envelope->room + bucket;
}

void tl_envelope_put(tl_envelope *envelope, size_t channel, int64_t position, double value) {
    size_t bucket = bucket_of(envelope, channel, position);
    double *pair = &envelope->values[2 * bucket];
    if (!isfinite(value)) {
        return;
    }
    if (isnan(pair[0])) {
        pair[0] = value;
        pair[1] = value;
    } else if (value < pair[0]) {
        pair[0] = value;
        envelope->falls[bucket] = 1;
    } else if (value > pair[1]) {
        pair[1] = value;
        envelope->falls[bucket] = 0;
    }
}

void tl_envelope_mark(tl_envelope *envelope, size_t channel, int64_t position, uint8_t bits) {
    envelope->marks[bucket_of(envelope, channel, position)] |= bits;
}

void tl_envelope_get(const tl_envelope *envelope, size_t channel, size_t bucket, double pair[2]) {
    size_t index = channel * envelope->room + bucket;
    uint8_t falls = envelope->falls[index];
    pair[0] = envelope->values[2 * index + falls];
    pair[1] = envelope->values[2 * index + (1 - falls)];
}

uint8_t tl_envelope_marks(const tl_envelope *envelope, size_t channel, size_t bucket) {
    return envelope->marks[channel * envelope->room + bucket];
}
