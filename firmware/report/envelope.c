/* Envelope of long curves: see envelope.h. */
#include "firmware/report/envelope.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void clear_buckets(tl_envelope *envelope, size_t from, size_t count) {
    for (size_t i = from; i < from + count; i++) {
        envelope->values[2 * i] = (double)NAN;
        envelope->values[2 * i + 1] = (double)NAN;
    }
    memset(&envelope->marks[from], 0, count);
}

tl_status tl_envelope_init(tl_envelope *envelope, size_t channels, size_t room, tl_error *error) {
    size_t count = channels * room;
    *envelope = (tl_envelope){.channels = channels, .room = room, .width = 1};
    envelope->values = malloc((count + 1) * 2 * sizeof *envelope->values);
    envelope->marks = malloc(count + 1);
    if (envelope->values == NULL || envelope->marks == NULL) {
        tl_envelope_free(envelope);
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for %zu curves of %zu points", channels, room);
    }
    clear_buckets(envelope, 0, count);
    return TL_OK;
}

void tl_envelope_free(tl_envelope *envelope) {
    free(envelope->values);
    free(envelope->marks);
    *envelope = (tl_envelope){0};
}

/* Adds a value to a bucket; it is later than all values in it. */
static void widen_pair(double pair[2], double value) {
    double least = fmin(pair[0], pair[1]);
    double largest = fmax(pair[0], pair[1]);
    if (!isfinite(value)) {
        return;
    }
    if (isnan(pair[0])) {
        pair[0] = value;
        pair[1] = value;
    } else if (value < least || value > largest) {
        pair[0] = value < least ? largest : least;
        pair[1] = value;
    }
}

/* Stores the union of buckets `first` and `second` in bucket `to`. */
static void merge_buckets(tl_envelope *envelope, size_t to, size_t first, size_t second) {
    const double *later = &envelope->values[2 * second];
    double pair[2] = {envelope->values[2 * first], envelope->values[2 * first + 1]};
    widen_pair(pair, later[0]);
    widen_pair(pair, later[1]);
    memcpy(&envelope->values[2 * to], pair, sizeof pair);
    envelope->marks[to] = envelope->marks[first] | envelope->marks[second];
}

static void widen_buckets(tl_envelope *envelope) {
    size_t half = envelope->room / 2;
    for (size_t channel = 0; channel < envelope->channels; channel++) {
        size_t start = channel * envelope->room;
        for (size_t i = 0; i < half; i++) {
            merge_buckets(envelope, start + i, start + 2 * i, start + 2 * i + 1);
        }
        clear_buckets(envelope, start + half, half);
    }
    envelope->used = (envelope->used + 1) / 2;
    envelope->width *= 2;
}

/* Returns the index of the bucket for a step of a channel; widens the buckets if necessary. */
static size_t bucket_of(tl_envelope *envelope, size_t channel, int64_t position) {
    while (position / envelope->width >= (int64_t)envelope->room) {
        widen_buckets(envelope);
    }
    size_t bucket = (size_t)(position / envelope->width);
    envelope->used = bucket >= envelope->used ? bucket + 1 : envelope->used;
    envelope->steps = position >= envelope->steps ? position + 1 : envelope->steps;
    return channel * envelope->room + bucket;
}

void tl_envelope_put(tl_envelope *envelope, size_t channel, int64_t position, double value) {
    size_t bucket = bucket_of(envelope, channel, position);
    widen_pair(&envelope->values[2 * bucket], value);
}

void tl_envelope_mark(tl_envelope *envelope, size_t channel, int64_t position, uint8_t bits) {
    envelope->marks[bucket_of(envelope, channel, position)] |= bits;
}

void tl_envelope_get(const tl_envelope *envelope, size_t channel, size_t bucket, double pair[2]) {
    memcpy(pair, &envelope->values[2 * (channel * envelope->room + bucket)], 2 * sizeof *pair);
}

uint8_t tl_envelope_marks(const tl_envelope *envelope, size_t channel, size_t bucket) {
    return envelope->marks[channel * envelope->room + bucket];
}
