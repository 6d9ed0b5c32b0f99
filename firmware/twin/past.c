/* A past and its image: see past.h. */
#include "firmware/twin/past.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/identity.h"

/* Between who finds a past and who reads it FMUs may be loaded. */
static const tl_time READING = 300 * TL_SECOND;

/* UTC, ms: the years 0 to 9999. */
#define FIRST_YEAR (INT64_C(-62167219200000))
#define LAST_YEAR (INT64_C(253402300799999))

/* Everything of an image that has one size; the checkpoint is behind it, then the tunings, then the ticks. */
typedef struct past_head {
    char magic[8]; /* its last character changes with the layout */
    uint64_t size; /* of the image */
    int64_t run, first, last;
    tl_time step, start;
    int64_t started;
    uint64_t checkpoint_size;
    uint64_t tunings;
    uint64_t signals, adjusts;
    uint64_t from;
} past_head;

static const char MAGIC[8] = {'t', 'w', 'l', 'k', 'p', 's', 't', '3'};

tl_past_shape tl_past_shape_of(const tl_config *config) {
    return (tl_past_shape){.signals = config->signal_count, .adjusts = config->adjust_count};
}

size_t tl_past_image_bytes(const tl_past_shape *shape, size_t ticks, size_t checkpoint, size_t tunings) {
    return sizeof(past_head) + checkpoint + tunings * sizeof(tl_run_tuning) + ticks * tl_past_tick_bytes(shape);
}

size_t tl_past_choose_tunings(tl_run_tuning *tunings, size_t count, int64_t first, int64_t last) {
    size_t from = 0;
    size_t to = 0;
    for (size_t i = 0; i < count; i++) {
        from = tunings[i].tick <= first ? i : from; /* in force then */
        to = tunings[i].tick <= last || i == from ? i + 1 : to;
    }
    memmove(tunings, tunings + from, (to - from) * sizeof *tunings);
    return to - from;
}

const char *tl_past_name(int64_t run, char text[TL_PAST_NAME]) {
    if (run < 0) {
        (void)snprintf(text, TL_PAST_NAME, "the run before");
    } else {
        (void)snprintf(text, TL_PAST_NAME, "run %" PRId64, run);
    }
    return text;
}

void tl_past_write(const tl_past *past, void *image) {
    unsigned char *place = image;
    size_t ticks = (size_t)(past->last - past->first + 1);
    past_head own = {
        .size = tl_past_image_bytes(&past->shape, ticks, past->checkpoint_size, past->tuning_count),
        .run = past->run,
        .first = past->first,
        .last = past->last,
        .step = past->step,
        .start = past->start,
        .started = past->started,
        .checkpoint_size = past->checkpoint_size,
        .tunings = past->tuning_count,
        .signals = past->shape.signals,
        .adjusts = past->shape.adjusts,
        .from = (uint64_t)past->from,
    };
    memcpy(own.magic, MAGIC, sizeof MAGIC);
    memcpy(place, &own, sizeof own);
    place += sizeof own;
    if (past->checkpoint_size != 0) {
        memcpy(place, past->checkpoint, past->checkpoint_size);
        place += past->checkpoint_size;
    }
    if (past->tuning_count != 0) {
        memcpy(place, past->tunings, past->tuning_count * sizeof(tl_run_tuning));
        place += past->tuning_count * sizeof(tl_run_tuning);
    }
    if (ticks != 0) {
        memcpy(place, past->ticks, ticks * tl_past_tick_bytes(&past->shape));
    }
}

/* ---- reading ---- */

static tl_status fail_damaged(tl_error *error, const char *what) {
    return tl_fail(error, TL_BAD_DATA, "what is left of an earlier run is damaged: %s", what);
}

static bool is_within(int64_t value, int64_t least, int64_t most) {
    return value >= least && value <= most;
}

/* Where the twin begins, and with what. */
static bool is_origin(const past_head *found) {
    switch (found->from) {
    case TL_RESUMED_CHECKPOINT:
        return found->checkpoint_size > 0 && found->first > 0;
    case TL_RESUMED_START:
        return found->checkpoint_size == 0 && found->first == 0;
    case TL_RESUMED_INPUTS:
        return found->checkpoint_size == 0 && found->first > 0;
    default:
        return false;
    }
}

static tl_status check_head(const past_head *found, size_t size, const tl_config *config, tl_error *error) {
    const tl_past_shape shape = tl_past_shape_of(config);
    if (memcmp(found->magic, MAGIC, sizeof MAGIC) != 0 || found->size != size) {
        return fail_damaged(error, "it does not begin as it should");
    }
    if (found->signals != shape.signals || found->adjusts != shape.adjusts || found->step != config->step) {
        return fail_damaged(error, "it has not the signals of this configuration");
    }
    int64_t last_possible = TL_PAST_FAR / config->step;
    if (!is_within(found->first, 0, last_possible) || !is_within(found->last, found->first - 1, last_possible) ||
        found->last - found->first >= TL_PAST_TICKS) {
        return fail_damaged(error, "its ticks cannot be");
    }
    size_t ticks = (size_t)(found->last - found->first + 1);
    if (found->checkpoint_size > size || found->tunings > TL_PAST_TUNINGS ||
        tl_past_image_bytes(&shape, ticks, (size_t)found->checkpoint_size, (size_t)found->tunings) != size) {
        return fail_damaged(error, "it has not its size");
    }
    if (!is_origin(found) || !is_within(found->run, TL_PAST_UNNUMBERED, TL_PAST_FAR)) {
        return fail_damaged(error, "it does not begin where a run can");
    }
    return TL_OK;
}

/* In mode ahead the last tick may be one later than what the gap was found by. */
static tl_status check_time(const past_head *found, const tl_config *config, tl_time now, tl_error *error) {
    if (!is_within(found->start, -TL_PAST_FAR, TL_PAST_FAR) || !is_within(found->started, FIRST_YEAR, LAST_YEAR)) {
        return fail_damaged(error, "its times cannot be");
    }
    tl_time gap = now - tl_time_of_step(found->start, found->step, found->last);
    return is_within(gap, -found->step, config->record_resume + READING) ? TL_OK
                                                                         : fail_damaged(error, "it is not of just now");
}

static tl_status check_ticks(const tl_past *past, tl_error *error) {
    size_t count = (size_t)(past->last - past->first + 1);
    for (size_t i = 0; i < count; i++) {
        if (!tl_past_tick_is_sound(&past->shape, past->ticks + i * tl_past_tick_bytes(&past->shape))) {
            return tl_fail(error, TL_BAD_DATA, "what is left of an earlier run is damaged: its tick %" PRId64,
                           past->first + (int64_t)i);
        }
    }
    return TL_OK;
}

static tl_status check_tunings(const tl_past *past, tl_error *error) {
    int64_t least = 0;
    for (size_t i = 0; i < past->tuning_count; i++) {
        tl_run_tuning tuning;
        tl_error why;
        memcpy(&tuning, past->tunings + i * sizeof tuning, sizeof tuning);
        if (!is_within(tuning.tick, least, TL_PAST_FAR) || !tl_identity_is_sound(tuning.hash) ||
            tuning.hash[0] == '\0' || tl_tuning_check(&tuning.values, &why) != TL_OK) {
            return fail_damaged(error, "what was in force");
        }
        least = tuning.tick;
    }
    return TL_OK;
}

static tl_past past_of(const past_head *found, const unsigned char *behind, tl_time now) {
    tl_past past = {
        .from = (tl_resumed_from)found->from,
        .run = found->run,
        .first = found->first,
        .last = found->last,
        .step = found->step,
        .start = found->start,
        .started = found->started,
        .gap = now - tl_time_of_step(found->start, found->step, found->last),
        .checkpoint_tick = found->first - 1,
        .checkpoint_size = (size_t)found->checkpoint_size,
        .shape = {.signals = (size_t)found->signals, .adjusts = (size_t)found->adjusts},
        .tunings = behind + found->checkpoint_size,
        .tuning_count = (size_t)found->tunings,
        .ticks = behind + found->checkpoint_size + found->tunings * sizeof(tl_run_tuning),
    };
    past.gap = past.gap < 0 ? 0 : past.gap;
    if (past.checkpoint_size != 0) {
        past.checkpoint = behind;
        past.age = tl_time_of_step(0, past.step, past.last - past.checkpoint_tick);
    }
    return past;
}

tl_status tl_past_read(const void *image, size_t size, const tl_config *config, tl_time now, tl_past *past,
                       tl_error *error) {
    past_head found;
    *past = (tl_past){.from = TL_RESUMED_NOT};
    if (size < sizeof found || size > TL_PAST_MOST) {
        return fail_damaged(error, "it has not its size");
    }
    memcpy(&found, image, sizeof found);
    tl_status status = check_head(&found, size, config, error);
    if (status == TL_OK) {
        status = check_time(&found, config, now, error);
    }
    if (status == TL_OK) {
        tl_past read = past_of(&found, (const unsigned char *)image + sizeof found, now);
        status = check_tunings(&read, error);
        status = status == TL_OK ? check_ticks(&read, error) : status;
        *past = status == TL_OK ? read : *past;
    }
    return status;
}

bool tl_past_tick_at(const tl_past *past, int64_t tick, tl_past_tick *out) {
    if (!is_within(tick, past->first, past->last)) {
        return false;
    }
    size_t index = (size_t)(tick - past->first);
    tl_past_tick_unpack(&past->shape, past->ticks + index * tl_past_tick_bytes(&past->shape), past->start, out);
    out->sample.tick = tick;
    out->sample.instant = tl_time_of_step(past->start, past->step, tick);
    return true;
}
