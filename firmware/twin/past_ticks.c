/* Packed ticks: see past_ticks.h. */
#include "firmware/twin/past_ticks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FIRST_CAPACITY = 64 };

/* What the first byte may be: a tick without u has no step. */
enum { NO_STEP, HAS_STEP, HAS_RESET };

/* ---- one ---- */

static size_t u_at(const tl_recorder_shape *shape) {
    return 1 + tl_packed_size(tl_packed_signals, shape);
}

size_t tl_past_tick_bytes(const tl_recorder_shape *shape) {
    return u_at(shape) + shape->adjust * sizeof(double);
}

static void pack_u(const tl_recorder_shape *shape, const double *u, unsigned char *bytes) {
    bytes[0] = HAS_STEP;
    memcpy(bytes + u_at(shape), u, shape->adjust * sizeof *u);
}

/* A device may say any time: one that is too far away to count with stays at the border. */
static tl_time nearer(tl_time stamp) {
    tl_time most = stamp > TL_PAST_FAR ? TL_PAST_FAR : stamp;
    return stamp == TL_TIME_NEVER || most >= -TL_PAST_FAR ? most : -TL_PAST_FAR;
}

static void pack(const tl_recorder_shape *shape, const tl_sample *sample, unsigned char *bytes) {
    tl_sample near = *sample;
    for (size_t i = 0; i < shape->plant; i++) {
        near.stamps[i] = nearer(sample->stamps[i]);
    }
    bytes[0] = NO_STEP;
    unsigned char *u = tl_pack(tl_packed_signals, shape, &near, bytes + 1);
    memset(u, 0, shape->adjust * sizeof(double));
}

/* As it is packed, and no further. */
static void take(const tl_recorder_shape *shape, const unsigned char *bytes, tl_past_tick *tick) {
    tick->has_u = bytes[0] != NO_STEP;
    tick->resets = bytes[0] == HAS_RESET;
    const unsigned char *u = tl_unpack(tl_packed_signals, shape, bytes + 1, &tick->sample);
    memcpy(tick->u, u, shape->adjust * sizeof(double));
}

bool tl_past_tick_is_sound(const tl_recorder_shape *shape, const unsigned char *bytes) {
    tl_past_tick tick;
    bool sound = bytes[0] <= HAS_RESET;
    take(shape, bytes, &tick);
    for (size_t i = 0; sound && i < shape->plant; i++) {
        tl_time stamp = tick.sample.stamps[i];
        bool in_time = stamp == TL_TIME_NEVER || (stamp >= -TL_PAST_FAR && stamp <= TL_PAST_FAR);
        sound = isfinite(tick.sample.values[i]) && in_time && tick.sample.quality[i] <= TL_OUTLIER;
    }
    for (size_t i = 0; sound && i < shape->adjust; i++) {
        sound = isfinite(tick.u[i]);
    }
    return sound;
}

void tl_past_tick_unpack(const tl_recorder_shape *shape, const unsigned char *bytes, tl_time start,
                         tl_past_tick *tick) {
    memset(tick, 0, sizeof *tick);
    memset(tick->sample.quality, TL_NO_LINK, sizeof tick->sample.quality);
    take(shape, bytes, tick);
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        bool never = i >= shape->plant || tick->sample.stamps[i] == TL_TIME_NEVER;
        tick->sample.stamps[i] = never ? TL_TIME_NEVER : tick->sample.stamps[i] + start;
    }
}

/* ---- a row ---- */

static unsigned char *place_of(const tl_past_ticks *ticks, size_t index) {
    return ticks->bytes + index * tl_past_tick_bytes(&ticks->shape);
}

void tl_past_ticks_begin(tl_past_ticks *ticks, int64_t first) {
    ticks->first = first;
    ticks->count = 0;
}

void tl_past_ticks_free(tl_past_ticks *ticks) {
    free(ticks->bytes);
    *ticks = (tl_past_ticks){.shape = ticks->shape};
}

static bool make_room(tl_past_ticks *ticks) {
    if (ticks->count < ticks->capacity) {
        return true;
    }
    size_t capacity = ticks->capacity == 0 ? FIRST_CAPACITY : 2 * ticks->capacity;
    unsigned char *bytes = realloc(ticks->bytes, capacity * tl_past_tick_bytes(&ticks->shape));
    if (bytes != NULL) {
        ticks->bytes = bytes;
        ticks->capacity = capacity;
    }
    return bytes != NULL;
}

bool tl_past_ticks_add(tl_past_ticks *ticks, const tl_sample *sample, const double *u) {
    if (!make_room(ticks)) {
        return false;
    }
    pack(&ticks->shape, sample, place_of(ticks, ticks->count));
    if (u != NULL) {
        pack_u(&ticks->shape, u, place_of(ticks, ticks->count));
    }
    ticks->count++;
    return true;
}

/* Its bytes; NULL: it was not added. */
static unsigned char *find(const tl_past_ticks *ticks, int64_t tick) {
    bool added = tick >= ticks->first && tick - ticks->first < (int64_t)ticks->count;
    return added ? place_of(ticks, (size_t)(tick - ticks->first)) : NULL;
}

void tl_past_ticks_set_u(tl_past_ticks *ticks, int64_t tick, const double *u) {
    unsigned char *bytes = find(ticks, tick);
    if (bytes != NULL) {
        pack_u(&ticks->shape, u, bytes);
    }
}

void tl_past_ticks_set_reset(tl_past_ticks *ticks, int64_t tick) {
    unsigned char *bytes = find(ticks, tick);
    if (bytes != NULL && bytes[0] != NO_STEP) {
        bytes[0] = HAS_RESET;
    }
}

static tl_status add_recorded(tl_past_ticks *ticks, const tl_history_tick *tick, tl_error *error) {
    bool has_u = tick->has_step && tick->adjusted == ticks->shape.adjust;
    if (!tl_past_ticks_add(ticks, &tick->sample, has_u ? tick->u : NULL)) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for what an earlier run has recorded");
    }
    if (tick->has_step && (tick->flags & TL_FLAG_RESET) != 0) {
        tl_past_ticks_set_reset(ticks, tick->sample.tick);
    }
    return TL_OK;
}

tl_status tl_past_ticks_read(tl_past_ticks *ticks, tl_history *history, const tl_history_run *run, int64_t from,
                             int64_t most, tl_error *error) {
    tl_history_ticks *walk = NULL;
    tl_history_tick tick;
    bool end = false;
    tl_past_ticks_begin(ticks, from);
    tl_status status = tl_history_ticks_begin(history, run, from, &walk, error);
    for (int64_t next = from; status == TL_OK && !end && next - from < most; next++) {
        status = tl_history_ticks_next(walk, &tick, &end, error);
        end = end || (status == TL_OK && tick.sample.tick != next);
        status = status == TL_OK && !end ? add_recorded(ticks, &tick, error) : status;
    }
    tl_history_ticks_end(walk);
    return status;
}

void tl_past_ticks_cut(tl_past_ticks *ticks, int64_t first) {
    size_t out = (size_t)(first - ticks->first);
    if (out != 0) {
        ticks->count -= out;
        ticks->first = first;
        memmove(ticks->bytes, place_of(ticks, out), ticks->count * tl_past_tick_bytes(&ticks->shape));
    }
}

int64_t tl_past_ticks_last(const tl_past_ticks *ticks) {
    bool stepped = false;
    size_t count = 0;
    while (count < ticks->count && (place_of(ticks, count)[0] != NO_STEP || !stepped)) {
        stepped = place_of(ticks, count)[0] != NO_STEP;
        count++;
    }
    return stepped ? ticks->first + (int64_t)count - 1 : ticks->first - 1;
}
