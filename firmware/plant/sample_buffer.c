/* Sample buffers: see sample_buffer.h. */
#include "firmware/plant/sample_buffer.h"

#include <stdlib.h>
#include <string.h>

/* ---- A ring of versioned slots: a seqlock per reading.
 *
 * Sequence: post n is written to slot n mod depth. Its sequence is 2n+1 during the write and 2n+2
 *           afterwards. So a reader that looks for post n detects if the slot contains it, is being
 *           overwritten, or contains a later post.
 *
 * Ordering: without fences, because ThreadSanitizer does not support them. The writer's stores to
 *           the fields are release stores, so they stay after the odd sequence. The reader's loads
 *           are acquire loads, so they stay before its second load of the sequence. A reader that
 *           saw one new field therefore sees the odd sequence, or a later one.
 *
 * Death:    a writer that dies leaves a slot with an odd sequence, or a complete post that is not
 *           counted. Readers look for neither.
 *
 * Trust:    a hostile writer can change anything at any time. So a reader loads each value once and
 *           masks the number of a post to find its slot. It searches between its own limits, which
 *           get closer with each look, whatever it reads.
 */

/* Posts that are checked one by one from the newest, before the search takes longer steps. The
 * cycle mostly needs one of these. */
enum { NEAR = 8 };

/* Most repetitions of a look-up. It is repeated only if the writer has overwritten the whole ring
 * in between. */
enum { ATTEMPTS = 16 };

static tl_sample_buffer_slot *slot_of(const tl_sample_buffer *buffer, uint64_t post) {
    return &buffer->slots[post & (buffer->depth - 1)];
}

static uint64_t complete_sequence(uint64_t post) {
    return 2 * post + 2;
}

void tl_sample_buffer_post(const tl_sample_buffer *buffer, const tl_reading *reading) {
    uint64_t post = __atomic_load_n(buffer->count, __ATOMIC_RELAXED); /* there is only one writer */
    tl_sample_buffer_slot *slot = slot_of(buffer, post);
    uint64_t value = 0;
    memcpy(&value, &reading->value, sizeof value);
    __atomic_store_n(&slot->sequence, complete_sequence(post) - 1, __ATOMIC_RELAXED);
    __atomic_store_n(&slot->value, value, __ATOMIC_RELEASE);
    __atomic_store_n(&slot->stamp, reading->stamp, __ATOMIC_RELEASE);
    __atomic_store_n(&slot->quality, (uint64_t)reading->quality, __ATOMIC_RELEASE);
    __atomic_store_n(&slot->sequence, complete_sequence(post), __ATOMIC_RELEASE);
    __atomic_store_n(buffer->count, post + 1, __ATOMIC_RELEASE);
}

uint64_t tl_sample_buffer_posts(const tl_sample_buffer *buffer) {
    return __atomic_load_n(buffer->count, __ATOMIC_ACQUIRE);
}

void tl_sample_buffer_repair(const tl_sample_buffer *buffer) {
    uint64_t post = __atomic_load_n(buffer->count, __ATOMIC_RELAXED);
    tl_sample_buffer_slot *slot = slot_of(buffer, post);
    uint64_t sequence = __atomic_load_n(&slot->sequence, __ATOMIC_RELAXED);
    if (sequence == complete_sequence(post)) {
        __atomic_store_n(buffer->count, post + 1, __ATOMIC_RELEASE);
    } else if (sequence % 2 != 0) {
        __atomic_store_n(&slot->sequence, 0, __ATOMIC_RELEASE);
    }
}

/* Loads post `post`. Returns false if it is overwritten or incomplete. */
static bool load_post(const tl_sample_buffer *buffer, uint64_t post, tl_reading *reading) {
    const tl_sample_buffer_slot *slot = slot_of(buffer, post);
    uint64_t before = __atomic_load_n(&slot->sequence, __ATOMIC_ACQUIRE);
    uint64_t value = __atomic_load_n(&slot->value, __ATOMIC_ACQUIRE);
    int64_t stamp = __atomic_load_n(&slot->stamp, __ATOMIC_ACQUIRE);
    uint64_t quality = __atomic_load_n(&slot->quality, __ATOMIC_ACQUIRE);
    uint64_t after = __atomic_load_n(&slot->sequence, __ATOMIC_RELAXED);
    if (before != complete_sequence(post) || after != before) {
        return false;
    }
    memcpy(&reading->value, &value, sizeof value);
    reading->stamp = stamp;
    reading->quality = quality <= TL_OUTLIER ? (tl_quality)quality : TL_NO_LINK;
    return true;
}

/* The readings on both sides of an instant. */
typedef struct neighbours {
    bool has_before, has_after;
    tl_reading before; /* the newest with stamp ≤ instant */
    tl_reading after;  /* next post; if there is none before, the oldest one kept */
    uint64_t end;      /* number of the post `after`, or of posts if there is none */
    uint64_t count;    /* number of posts */
} neighbours;

/* Checks NEAR posts before `end` one by one, then doubles the distance until it has gone too far,
 * then bisects. A post that is overwritten counts as too far. */
static void find_neighbours(const tl_sample_buffer *buffer, uint64_t count, tl_time instant, neighbours *found) {
    uint64_t begin = count > buffer->depth ? count - buffer->depth : 0;
    uint64_t step = 1;
    *found = (neighbours){.end = count, .count = count};
    for (unsigned probes = 1; begin < found->end; probes++) {
        tl_reading reading = {.quality = TL_NO_LINK};
        uint64_t left = found->end - begin;
        uint64_t post = step < left ? found->end - step : begin + left / 2;
        bool kept = load_post(buffer, post, &reading);
        if (kept && reading.stamp > instant) {
            found->has_after = true;
            found->after = reading;
            found->end = post;
            step += probes < NEAR ? 0 : step;
        } else {
            found->has_before = kept;
            found->before = reading;
            begin = post + 1;
            step = buffer->depth;
        }
    }
}

/* Of several posts with the stamp of `reading`, returns the last one. */
static void find_last_equal(const tl_sample_buffer *buffer, uint64_t count, uint64_t post, tl_reading *reading) {
    tl_reading next;
    neighbours found;
    if (post + 1 < count && load_post(buffer, post + 1, &next) && next.stamp <= reading->stamp) {
        find_neighbours(buffer, count, reading->stamp, &found);
        *reading = found.has_before ? found.before : *reading;
    }
}

/* Sets `after` to the result of tl_sample_buffer_from(). Returns false if there is none. */
static bool choose_reading(const tl_sample_buffer *buffer, tl_time from, tl_time until, neighbours *found) {
    bool next = found->has_after && found->after.stamp <= until;
    if (next && !(found->has_before && found->before.stamp == from)) {
        find_last_equal(buffer, found->count, found->end, &found->after);
        return true;
    }
    found->after = found->has_before ? found->before : found->after;
    return found->has_before || found->end > 0;
}

/* Returns false if nothing was posted, or if even the newest post was overwritten in all
 * repetitions. */
static bool find_any(const tl_sample_buffer *buffer, tl_time instant, neighbours *found) {
    *found = (neighbours){.has_before = false};
    for (int attempt = 0; attempt < ATTEMPTS && !found->has_before && !found->has_after; attempt++) {
        uint64_t count = __atomic_load_n(buffer->count, __ATOMIC_ACQUIRE);
        if (count == 0) {
            return false;
        }
        find_neighbours(buffer, count, instant, found);
    }
    return found->has_before || found->has_after;
}

bool tl_sample_buffer_from(const tl_sample_buffer *buffer, tl_time from, tl_time until, tl_reading *reading) {
    neighbours found;
    bool any = find_any(buffer, from, &found) && choose_reading(buffer, from, until, &found);
    *reading = any ? found.after : *reading;
    return any;
}

bool tl_sample_buffer_around(const tl_sample_buffer *buffer, tl_time at, tl_time until, tl_reading *before,
                             tl_reading *after) {
    neighbours found;
    if (!find_any(buffer, at, &found) || !found.has_before) {
        return false;
    }
    bool next = found.has_after && found.after.stamp <= until;
    if (next) {
        find_last_equal(buffer, found.count, found.end, &found.after);
    }
    *before = found.before;
    *after = next ? found.after : (tl_reading){.stamp = TL_TIME_NEVER};
    return true;
}

bool tl_sample_buffer_next(const tl_sample_buffer *buffer, tl_time until, uint64_t *next, tl_reading *reading) {
    uint64_t count = __atomic_load_n(buffer->count, __ATOMIC_ACQUIRE);
    uint64_t begin = count > buffer->depth ? count - buffer->depth : 0;
    *next = *next < begin || *next > count ? begin : *next;
    for (uint64_t post = *next; post < count && post - *next < NEAR; post++) {
        tl_reading found;
        if (load_post(buffer, post, &found) && found.stamp <= until) {
            *next = post + 1;
            *reading = found;
            return true;
        }
    }
    return false;
}

bool tl_sample_buffer_at(const tl_sample_buffer *buffer, tl_time instant, tl_reading *reading) {
    return tl_sample_buffer_from(buffer, instant, instant, reading);
}

/* ---- sample memory ---- */

/* Each count has its own cache line, because threads of different sources write them. */
enum { LINE = 64, COUNTS = TL_MAX_SIGNALS * LINE };

/* Time beside hang_s to notice the end of a twin, to terminate it and to start a new one. */
static const tl_time RESTART = 10 * TL_SECOND;

static const tl_time FINEST = TL_SECOND / 1000;

/* Interval between two readings of a signal. Without a live source: the step. */
static tl_time period_of(const tl_config *config, const tl_config_signal *signal) {
    tl_time period = config->step;
    if (signal->source < config->source_count) {
        tl_time configured = tl_time_of_seconds(config->sources[signal->source].period_s);
        period = configured < period ? configured : period;
    }
    return period > FINEST ? period : FINEST;
}

tl_time tl_sample_buffers_kept(const tl_config *config) {
    return config->realtime_hang + RESTART;
}

void tl_sample_buffers_shape_of(const tl_config *config, tl_sample_buffers_shape *shape) {
    *shape = (tl_sample_buffers_shape){.signals = config->signal_count};
    for (size_t i = 0; i < config->signal_count; i++) {
        shape->of[i] = config->signals[i].of;
        tl_time readings = tl_sample_buffers_kept(config) / period_of(config, &config->signals[i]) + 1;
        uint32_t depth = TL_SAMPLE_BUFFERS_LEAST;
        while (depth < readings && depth < TL_SAMPLE_BUFFERS_MOST) {
            depth *= 2;
        }
        shape->depth[i] = depth;
    }
}

size_t tl_sample_buffers_bytes(const tl_sample_buffers_shape *shape) {
    size_t bytes = COUNTS;
    for (size_t i = 0; i < shape->signals; i++) {
        bytes += shape->of[i] == i ? shape->depth[i] * sizeof(tl_sample_buffer_slot) : 0;
    }
    return bytes;
}

void tl_sample_buffers_open(const tl_sample_buffers_shape *shape, void *memory,
                            tl_sample_buffer buffers[TL_MAX_SIGNALS]) {
    unsigned char *counts = memory;
    unsigned char *slots = counts + COUNTS;
    for (size_t i = 0; i < shape->signals; i++) {
        if (shape->of[i] != i) {
            buffers[i] = buffers[shape->of[i]];
            continue;
        }
        buffers[i] = (tl_sample_buffer){
            .slots = (tl_sample_buffer_slot *)(void *)slots,
            .count = (uint64_t *)(void *)(counts + i * LINE),
            .depth = shape->depth[i],
        };
        slots += shape->depth[i] * sizeof(tl_sample_buffer_slot);
    }
}

void *tl_sample_buffers_make_least(size_t signals, tl_sample_buffer buffers[TL_MAX_SIGNALS]) {
    tl_sample_buffers_shape shape = {.signals = signals};
    for (size_t i = 0; i < signals; i++) {
        shape.depth[i] = TL_SAMPLE_BUFFERS_LEAST;
        shape.of[i] = i;
    }
    void *memory = calloc(1, tl_sample_buffers_bytes(&shape));
    if (memory != NULL) {
        tl_sample_buffers_open(&shape, memory, buffers);
    }
    return memory;
}
