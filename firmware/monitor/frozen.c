/* Frozen sensors: see frozen.h. */
#include "firmware/monitor/frozen.h"

#include <math.h>
#include <string.h>

#include "firmware/monitor/noise.h"

/* The witness must move by this many tolerances, and this many of the smallest changes. */
static const double CLEARLY = 3.0;

void tl_frozen_watch_init(tl_frozen_watch *watch, const tl_config *config) {
    *watch = (tl_frozen_watch){.config = config};
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        tl_frozen_match *match = &watch->match[i];
        bool is_watched = i < config->match_count && config->adjust_count != 0 && config->released_steps != 0;
        match->reading = is_watched ? tl_noise_watch_readings(config, i) : SIZE_MAX;
        match->signal = match->reading != SIZE_MAX ? tl_config_signal_of(config, config->matched_as[i]) : SIZE_MAX;
        match->newest = TL_TIME_NEVER;
        match->until = TL_TIME_NEVER;
        memset(match->released_at, -1, sizeof match->released_at); /* before any run */
    }
}

/* ---- samples ---- */

static bool is_same(double a, double b) {
    return !(a < b) && !(a > b);
}

static void begin_run(tl_frozen_match *match, int64_t tick, tl_time stamp, double value) {
    if (match->newest != TL_TIME_NEVER) {
        tl_time lasted = match->newest - match->begin;
        bool is_rest = match->is_compared && !match->has_moved;
        double change = fabs(value - match->value);
        match->longest = !match->is_frozen && !is_rest && lasted > match->longest ? lasted : match->longest;
        match->finest = match->changes == 0 || change < match->finest ? change : match->finest;
        match->changes += match->changes < TL_FROZEN_LEAST ? 1 : 0;
        match->until = match->is_frozen ? stamp : match->until;
    }
    match->value = value;
    match->begin = stamp;
    match->tick = tick;
    match->readings = 0;
    match->is_compared = false;
    match->has_moved = false;
    match->is_frozen = false;
}

static bool is_suspicious(const tl_frozen_match *match) {
    return match->has_moved && match->readings >= TL_FROZEN_LEAST && match->changes >= TL_FROZEN_LEAST &&
           (match->newest - match->begin) / TL_FROZEN_LONGER > match->longest;
}

static void add_reading(tl_frozen_match *match, const tl_sample *sample, bool is_decided) {
    tl_quality quality = (tl_quality)sample->quality[match->reading];
    tl_time stamp = sample->stamps[match->reading];
    double value = sample->values[match->reading];
    bool was_frozen = match->is_frozen;
    if (stamp > match->newest && (quality == TL_GOOD || quality == TL_FROZEN)) {
        if (match->newest == TL_TIME_NEVER || !is_same(value, match->value)) {
            begin_run(match, sample->tick, stamp, value);
        }
        match->newest = stamp;
        match->readings += match->readings < TL_FROZEN_LEAST ? 1 : 0;
    }
    match->is_frozen = is_decided ? quality == TL_FROZEN : match->is_frozen || is_suspicious(match);
    match->turn = match->is_frozen == was_frozen ? TL_FROZEN_AS_BEFORE
                  : match->is_frozen             ? TL_FROZEN_BEGUN
                                                 : TL_FROZEN_ENDED;
}

uint64_t tl_frozen_watch_sample(tl_frozen_watch *watch, const tl_sample *sample, bool is_decided) {
    uint64_t frozen = 0;
    for (size_t i = 0; i < watch->config->match_count; i++) {
        tl_frozen_match *match = &watch->match[i];
        if (match->reading == SIZE_MAX) {
            continue;
        }
        add_reading(match, sample, is_decided);
        bool is_of_run = match->is_frozen || sample->stamps[match->signal] < match->until;
        frozen |= is_of_run ? UINT64_C(1) << match->signal : 0;
        frozen |= match->is_frozen ? UINT64_C(1) << match->reading : 0;
    }
    return is_decided ? 0 : frozen;
}

void tl_frozen_mark(uint64_t frozen, tl_sample *sample) {
    for (size_t i = 0; frozen >> i != 0; i++) {
        bool is_marked = (frozen >> i & 1U) != 0 && sample->quality[i] == TL_GOOD;
        sample->quality[i] = is_marked ? (uint8_t)TL_FROZEN : sample->quality[i];
    }
}

/* ---- steps ---- */

/* Compares a release with the two before it at the same age. */
static void compare_releases(tl_frozen_match *match, size_t age, int64_t release, int64_t from, double y,
                             double limit) {
    double *before = match->released[age];
    int64_t *at = match->released_at[age];
    if (at[1] >= from) {
        match->is_compared = true;
        match->has_moved = match->has_moved || fabs(y - 2.0 * before[0] + before[1]) > limit;
    }
    before[1] = before[0];
    before[0] = y;
    at[1] = at[0];
    at[0] = release;
}

static void step_match(tl_frozen_match *match, const tl_record *record, size_t i, int64_t length, double tolerance) {
    int64_t half = length / 2;
    int64_t stride = half > TL_FROZEN_AGES ? half / TL_FROZEN_AGES : 1;
    int64_t older = (int64_t)record->release_age - half - 1; /* records show ages from R/2 + 1 on */
    int64_t release = record->step - (int64_t)record->release_age;
    bool is_held = record->measured_quality[i] == TL_GOOD && fabs(record->y[i] - record->measured[i]) < tolerance;
    match->held_from = is_held ? match->held_from : record->step + 1;
    int64_t from = (match->tick > match->held_from ? match->tick : match->held_from) + length / 4;
    if (older >= 0 && older % stride == 0 && older / stride < TL_FROZEN_AGES && release >= from) {
        double limit = CLEARLY * fmax(tolerance, match->finest);
        compare_releases(match, (size_t)(older / stride), release, from, record->released[i], limit);
    }
}

void tl_frozen_watch_step(tl_frozen_watch *watch, const tl_record *record) {
    for (size_t i = 0; i < watch->config->match_count && record->release_age != 0; i++) {
        if (watch->match[i].reading != SIZE_MAX) {
            step_match(&watch->match[i], record, i, (int64_t)watch->config->released_steps,
                       watch->config->match[i].tolerance);
        }
    }
}
