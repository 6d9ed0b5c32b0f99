/* Recorded samples for a shadow: see past_samples.h. */
#include "firmware/twin/past_samples.h"

#include <stdio.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/store/history.h"

/* The ticks are behind it. */
typedef struct samples_head {
    char magic[8];                /* its last character changes with the layout */
    uint64_t size;                /* of the image */
    char signals[TL_SHA256_TEXT]; /* which they are */
    char unused[7];
    uint64_t count; /* of signals */
    int64_t first;
    uint64_t ticks;
    tl_time step, start;
} samples_head;

static const char MAGIC[8] = {'t', 'w', 'l', 'k', 's', 'm', 'p', '1'};

/* ---- which signals ---- */

/* Name by name. */
static void add_name(char digest[TL_SHA256_TEXT], const char *name) {
    char text[TL_SHA256_TEXT + 512];
    int length = snprintf(text, sizeof text, "%s %s", digest, name);
    tl_sha256(text, (size_t)length < sizeof text ? (size_t)length : sizeof text - 1, digest);
}

static void identify_recorded(const tl_recorder_signal *signals, size_t count, char digest[TL_SHA256_TEXT]) {
    digest[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        add_name(digest, signals[i].name);
    }
}

/* As they are recorded. */
static void identify_configured(const tl_config *config, char digest[TL_SHA256_TEXT]) {
    char name[512];
    digest[0] = '\0';
    for (size_t i = 0; i < config->signal_count; i++) {
        (void)snprintf(name, sizeof name, "plant.%s", config->signals[i].plan.name);
        add_name(digest, name);
    }
}

/* ---- out of a database ---- */

/* What is being looked through. */
typedef struct sample_search {
    tl_history *history;
    const tl_history_run *runs;
    size_t count;
    const tl_history_run *run; /* whose ticks are taken */
    tl_past_ticks found;
} sample_search;

static bool is_of_boot(const tl_history_run *run, const char *boot) {
    return strcmp(run->verb, "run") == 0 && run->has_start && strcmp(run->boot, boot) == 0;
}

/* By name, one after the other: another plant is another course. */
static tl_status have_same_signals(const sample_search *self, const tl_history_run *other, bool *are_same,
                                   tl_error *error) {
    char digest[2][TL_SHA256_TEXT];
    const tl_history_run *const runs[2] = {self->run, other};
    const tl_recorder_signal *signals = NULL;
    size_t count = 0;
    tl_status status = TL_OK;
    for (size_t i = 0; status == TL_OK && i < 2; i++) {
        status = tl_history_signals(self->history, runs[i], TL_HISTORY_PLANT, &signals, &count, error);
        if (status == TL_OK) {
            identify_recorded(signals, count, digest[i]);
        }
    }
    *are_same = status == TL_OK && strcmp(digest[0], digest[1]) == 0;
    return status;
}

/* The run before it, of which it has t_start. */
static const tl_history_run *parent_of(const sample_search *self, const char *boot) {
    const tl_history_run *run = self->run;
    for (size_t i = 0; run->resumption.from != TL_RESUMED_NOT && i < self->count; i++) {
        const tl_history_run *parent = &self->runs[i];
        if (parent->run == run->resumption.run) {
            bool fits = is_of_boot(parent, boot) && parent->start == run->start && parent->step == run->step;
            return fits ? parent : NULL;
        }
    }
    return NULL;
}

/* 0 and -1 if there are none. */
static tl_status range_of(const sample_search *self, int64_t range[2], tl_error *error) {
    bool any = false;
    range[0] = 0;
    range[1] = -1;
    return tl_history_range(self->history, self->run, TL_HISTORY_SAMPLES, INT64_MIN, range, &any, error);
}

/* The newest that is being written. */
static tl_status find_run(sample_search *self, const char *boot, tl_error *error) {
    tl_status status = tl_history_runs(self->history, &self->runs, &self->count, error);
    if (status == TL_OK && self->count != 0) {
        const tl_history_run *newest = &self->runs[self->count - 1];
        self->run = newest->ended == NULL && is_of_boot(newest, boot) ? newest : NULL;
    }
    return status;
}

/* From which tick on, and of which run. */
static tl_status choose(sample_search *self, const char *boot, int64_t *from, tl_error *error) {
    int64_t range[2];
    tl_status status = range_of(self, range, error);
    if (status == TL_OK && *from < 0) {
        *from = range[1] + 1 - TL_PAST_SAMPLES_BEFORE / self->run->step;
        *from = *from > 0 ? *from : 0;
    }
    const tl_history_run *parent = status == TL_OK && *from < range[0] ? parent_of(self, boot) : NULL;
    bool follows = false;
    if (parent != NULL) {
        status = have_same_signals(self, parent, &follows, error);
    }
    if (follows) {
        self->run = parent;
        status = range_of(self, range, error);
    }
    *from = *from > range[0] ? *from : range[0];
    return status;
}

static size_t write_image(const sample_search *self, const tl_recorder_signal *signals, void *image) {
    const tl_past_ticks *found = &self->found;
    size_t bytes = found->count * tl_past_tick_bytes(&found->shape);
    samples_head own = {.size = sizeof own + bytes,
                        .count = found->shape.plant,
                        .first = found->first,
                        .ticks = found->count,
                        .step = self->run->step,
                        .start = self->run->start};
    if (found->count == 0) {
        return 0;
    }
    memcpy(own.magic, MAGIC, sizeof MAGIC);
    identify_recorded(signals, found->shape.plant, own.signals);
    memcpy(image, &own, sizeof own);
    memcpy((unsigned char *)image + sizeof own, found->bytes, bytes);
    return (size_t)own.size;
}

/* As many as there is room for. */
static tl_status fill(sample_search *self, const char *boot, int64_t from, void *image, size_t room, size_t *size,
                      tl_error *error) {
    const tl_recorder_signal *signals = NULL;
    size_t count = 0;
    tl_status status = find_run(self, boot, error);
    if (status != TL_OK || self->run == NULL) {
        return status;
    }
    status = choose(self, boot, &from, error);
    if (status == TL_OK) {
        status = tl_history_signals(self->history, self->run, TL_HISTORY_PLANT, &signals, &count, error);
    }
    if (status == TL_OK && count <= TL_MAX_SIGNALS && room > sizeof(samples_head)) {
        self->found.shape = (tl_recorder_shape){.plant = count};
        size_t most = (room - sizeof(samples_head)) / tl_past_tick_bytes(&self->found.shape);
        most = most < TL_PAST_SAMPLES ? most : TL_PAST_SAMPLES;
        status = tl_past_ticks_read(&self->found, self->history, self->run, from, (int64_t)most, error);
        *size = status == TL_OK ? write_image(self, signals, image) : 0;
    }
    return status;
}

tl_status tl_past_samples_find(const char *path, const char *boot, int64_t from, void *image, size_t room, size_t *size,
                               tl_error *error) {
    sample_search self = {.history = NULL};
    *size = 0;
    tl_status status = tl_history_open(path, &self.history, error);
    if (status == TL_OK) {
        status = fill(&self, boot, from, image, room, size, error);
    }
    tl_history_close(self.history);
    tl_past_ticks_free(&self.found);
    return status;
}

/* ---- reading ---- */

static tl_status fail(tl_error *error, const char *what) {
    return tl_fail(error, TL_BAD_DATA, "the recorded samples are of no use: %s", what);
}

static tl_status check_head(const samples_head *found, size_t size, const tl_config *config, tl_time start,
                            tl_error *error) {
    char digest[TL_SHA256_TEXT];
    const tl_recorder_shape shape = {.plant = config->signal_count};
    if (memcmp(found->magic, MAGIC, sizeof MAGIC) != 0 || found->size != size) {
        return fail(error, "they do not begin as they should");
    }
    identify_configured(config, digest);
    if (found->count != shape.plant || memcmp(found->signals, digest, sizeof digest) != 0 ||
        found->step != config->step) {
        return fail(error, "they are not of the signals of this configuration");
    }
    if (found->start != start) {
        return fail(error, "they are not of the run that is under way");
    }
    if (found->ticks == 0 || found->ticks > TL_PAST_SAMPLES ||
        sizeof *found + found->ticks * tl_past_tick_bytes(&shape) != size || found->first < 0 ||
        found->first > TL_PAST_FAR / config->step - TL_PAST_SAMPLES) {
        return fail(error, "their ticks cannot be");
    }
    return TL_OK;
}

tl_status tl_past_samples_read(const void *image, size_t size, const tl_config *config, tl_time start,
                               tl_past_samples *samples, tl_error *error) {
    samples_head found;
    *samples = (tl_past_samples){.first = 0};
    if (size < sizeof found) {
        return fail(error, "they do not begin as they should");
    }
    memcpy(&found, image, sizeof found);
    tl_status status = check_head(&found, size, config, start, error);
    const tl_past_samples read = {.first = found.first,
                                  .count = (size_t)found.ticks,
                                  .start = start,
                                  .shape = {.plant = config->signal_count},
                                  .ticks = (const unsigned char *)image + sizeof found};
    for (size_t i = 0; status == TL_OK && i < read.count; i++) {
        bool sound = tl_past_tick_is_sound(&read.shape, read.ticks + i * tl_past_tick_bytes(&read.shape));
        status = sound ? TL_OK : fail(error, "one of them is damaged");
    }
    *samples = status == TL_OK ? read : *samples;
    return status;
}

bool tl_past_samples_at(const tl_past_samples *samples, int64_t tick, tl_time step, tl_sample *sample) {
    tl_past_tick unpacked;
    if (tick < samples->first || tick - samples->first >= (int64_t)samples->count) {
        return false;
    }
    size_t index = (size_t)(tick - samples->first);
    tl_past_tick_unpack(&samples->shape, samples->ticks + index * tl_past_tick_bytes(&samples->shape), samples->start,
                        &unpacked);
    *sample = unpacked.sample;
    sample->tick = tick;
    sample->instant = tl_time_of_step(samples->start, step, tick);
    return true;
}
