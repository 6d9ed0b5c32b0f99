/* Resume of an earlier run: see resume.h. */
#include "firmware/twin/resume.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_step.h"

void tl_resume_report(tl_resume_listener *report, void *context, tl_severity severity, const char *format, ...) {
    char text[TL_RESUME_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    report(context, severity, text);
}

/* ---- rule ---- */

enum { NAME = 32 };

/* Writes "run 7" or "the previous run". */
static const char *name_run(int64_t run, char text[NAME]) {
    if (run < 0) {
        (void)snprintf(text, NAME, "the previous run");
    } else {
        (void)snprintf(text, NAME, "run %" PRId64, run);
    }
    return text;
}

static const tl_time FOLLOW_TIME = TL_SECOND / 2; /* time allowed to follow ticks again */

bool tl_resume_refuse(char why[TL_RESUME_WHY], const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(why, TL_RESUME_WHY, format, arguments);
    va_end(arguments);
    return false;
}

bool tl_resume_was_interrupted(int64_t run, const char *reason, char why[TL_RESUME_WHY]) {
    char name[NAME];
    bool interrupted = reason == NULL || strcmp(reason, "not ended cleanly") == 0 || strncmp(reason, "SIG", 3) == 0;
    return interrupted || tl_resume_refuse(why, "%s ended: %.100s", name_run(run, name), reason);
}

bool tl_resume_is_in_time(int64_t run, const tl_config *config, int64_t last, tl_time gap, uint32_t lead,
                          char why[TL_RESUME_WHY]) {
    char name[NAME];
    if (gap < 0) {
        return tl_resume_refuse(why, "the clock is earlier than the last tick of %s: check the system time",
                                name_run(run, name));
    }
    if (gap > config->record_resume) {
        return tl_resume_refuse(why, "%s ended %.1f s ago (record.resume_s allows %g s)", name_run(run, name),
                                tl_seconds(gap), tl_seconds(config->record_resume));
    }
    int64_t now = last + gap / config->step;
    return config->duration == 0 || now < config->duration / config->step + (int64_t)lead ||
           tl_resume_refuse(why, "the duration of %s is over", name_run(run, name));
}

int64_t tl_resume_most_followed(tl_time execution, size_t components) {
    tl_time each = execution * (tl_time)components;
    tl_time most = each > 0 ? FOLLOW_TIME / each : TL_RESUME_TICKS;
    return most < 1 ? 1 : most < TL_RESUME_TICKS ? most : TL_RESUME_TICKS;
}

/* ---- packed ticks ---- */

enum { FIRST_CAPACITY = 64 };

/* Values of the first byte. A tick without u has no step. */
enum { NO_STEP, HAS_STEP, HAS_RESET };

/* ---- one tick ---- */

static size_t u_at(const tl_recorder_shape *shape) {
    return 1 + tl_packed_size(tl_packed_signals, shape);
}

size_t tl_resume_tick_bytes(const tl_recorder_shape *shape) {
    return u_at(shape) + shape->adjust * sizeof(double);
}

/* Devices can send any time stamp; out-of-range stamps are clamped. */
static tl_time clamp_stamp(tl_time stamp) {
    tl_time most = stamp > TL_RESUME_FAR ? TL_RESUME_FAR : stamp;
    return stamp == TL_TIME_NEVER || most >= -TL_RESUME_FAR ? most : -TL_RESUME_FAR;
}

static void pack_tick(const tl_recorder_shape *shape, const tl_sample *sample, unsigned char *bytes) {
    tl_sample near = *sample;
    for (size_t i = 0; i < shape->plant; i++) {
        near.stamps[i] = clamp_stamp(sample->stamps[i]);
    }
    bytes[0] = NO_STEP;
    unsigned char *u = tl_pack(tl_packed_signals, shape, &near, bytes + 1);
    memset(u, 0, shape->adjust * sizeof(double));
}

/* Unpacks without conversion. */
static void unpack_tick(const tl_recorder_shape *shape, const unsigned char *bytes, tl_resume_tick *tick) {
    tick->has_u = bytes[0] != NO_STEP;
    tick->resets = bytes[0] == HAS_RESET;
    const unsigned char *u = tl_unpack(tl_packed_signals, shape, bytes + 1, &tick->sample);
    memcpy(tick->u, u, shape->adjust * sizeof(double));
}

/* Checks that numbers are finite, times below TL_RESUME_FAR, and qualities valid. */
static bool is_sound_tick(const tl_recorder_shape *shape, const unsigned char *bytes) {
    tl_resume_tick tick;
    bool sound = bytes[0] <= HAS_RESET;
    unpack_tick(shape, bytes, &tick);
    for (size_t i = 0; sound && i < shape->plant; i++) {
        tl_time stamp = tick.sample.stamps[i];
        bool in_time = stamp == TL_TIME_NEVER || (stamp >= -TL_RESUME_FAR && stamp <= TL_RESUME_FAR);
        sound = isfinite(tick.sample.values[i]) && in_time && tick.sample.quality[i] <= TL_LAST_QUALITY;
    }
    for (size_t i = 0; sound && i < shape->adjust; i++) {
        sound = isfinite(tick.u[i]);
    }
    return sound;
}

/* ---- list of ticks ---- */

static unsigned char *bytes_at(const tl_resume_ticks *ticks, size_t index) {
    return ticks->bytes + index * tl_resume_tick_bytes(&ticks->shape);
}

void tl_resume_ticks_begin(tl_resume_ticks *ticks, int64_t first) {
    ticks->first = first;
    ticks->count = 0;
}

void tl_resume_ticks_free(tl_resume_ticks *ticks) {
    free(ticks->bytes);
    *ticks = (tl_resume_ticks){.shape = ticks->shape};
}

static bool make_room(tl_resume_ticks *ticks) {
    if (ticks->count < ticks->capacity) {
        return true;
    }
    size_t capacity = ticks->capacity == 0 ? FIRST_CAPACITY : 2 * ticks->capacity;
    unsigned char *bytes = realloc(ticks->bytes, capacity * tl_resume_tick_bytes(&ticks->shape));
    if (bytes != NULL) {
        ticks->bytes = bytes;
        ticks->capacity = capacity;
    }
    return bytes != NULL;
}

bool tl_resume_ticks_add(tl_resume_ticks *ticks, const tl_sample *sample) {
    if (!make_room(ticks)) {
        return false;
    }
    pack_tick(&ticks->shape, sample, bytes_at(ticks, ticks->count++));
    return true;
}

void tl_resume_ticks_set_step(tl_resume_ticks *ticks, int64_t tick, const double *u, bool resets) {
    if (tick >= ticks->first && tick - ticks->first < (int64_t)ticks->count) {
        unsigned char *bytes = bytes_at(ticks, (size_t)(tick - ticks->first));
        bytes[0] = resets ? HAS_RESET : HAS_STEP;
        memcpy(bytes + u_at(&ticks->shape), u, ticks->shape.adjust * sizeof *u);
    }
}

static tl_status add_recorded(tl_resume_ticks *ticks, const tl_history_tick *tick, tl_error *error) {
    if (!tl_resume_ticks_add(ticks, &tick->sample)) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the samples of an earlier run");
    }
    if (tick->has_step && tick->adjusted == ticks->shape.adjust) {
        tl_resume_ticks_set_step(ticks, tick->sample.tick, tick->u, tl_record_was_reset(tick->step.flags));
    }
    return TL_OK;
}

tl_status tl_resume_ticks_read(tl_resume_ticks *ticks, tl_history *history, const tl_history_run *run, int64_t from,
                               int64_t most, tl_error *error) {
    tl_history_ticks *walk = NULL;
    tl_history_tick tick;
    bool end = false;
    tl_resume_ticks_begin(ticks, from);
    tl_status status = tl_history_ticks_begin(history, run, from, &walk, error);
    for (int64_t next = from; status == TL_OK && !end && next - from < most; next++) {
        status = tl_history_ticks_next(walk, &tick, &end, error);
        end = end || (status == TL_OK && tick.sample.tick != next);
        status = status == TL_OK && !end ? add_recorded(ticks, &tick, error) : status;
    }
    tl_history_ticks_end(walk);
    return status;
}

int64_t tl_resume_ticks_last(const tl_resume_ticks *ticks, int64_t first) {
    bool stepped = false;
    size_t at = (size_t)(first - ticks->first);
    while (at < ticks->count && (bytes_at(ticks, at)[0] != NO_STEP || !stepped)) {
        stepped = bytes_at(ticks, at++)[0] != NO_STEP;
    }
    return stepped ? ticks->first + (int64_t)at - 1 : first - 1;
}

/* ---- identity of the signals ---- */

/* Adds one name to the hash. */
static void add_name(char digest[TL_SHA256_TEXT], const char *prefix, const char *name) {
    char text[TL_SHA256_TEXT + 512];
    int length = snprintf(text, sizeof text, "%s %s%s", digest, prefix, name);
    tl_sha256(text, (size_t)length < sizeof text ? (size_t)length : sizeof text - 1, digest);
}

void tl_resume_identify_recorded(const tl_recorder_signal *signals, size_t count, char digest[TL_SHA256_TEXT]) {
    memset(digest, 0, TL_SHA256_TEXT);
    for (size_t i = 0; i < count; i++) {
        add_name(digest, "", signals[i].name);
    }
}

void tl_resume_identify(const tl_config *config, char digest[TL_SHA256_TEXT]) {
    memset(digest, 0, TL_SHA256_TEXT);
    for (size_t i = 0; i < config->signal_count; i++) {
        add_name(digest, "plant.", config->signals[i].plan.name);
    }
}

/* ---- image ---- */

/* Longest time between finding and reading a resume point: FMUs may be loaded in between. */
static const tl_time READING = 300 * TL_SECOND;

/* UTC, ms: the years 0 to 9999. */
#define FIRST_YEAR (INT64_C(-62167219200000))
#define LAST_YEAR (INT64_C(253402300799999))

/* Layout: magic, size of the image, plain fields, checkpoint, tunings, ticks. The last character of
 *         the magic changes with the layout. */
static const char MAGIC[8] = {'t', 'w', 'l', 'k', 'p', 's', 't', '8'};

/* Aligns the checkpoint as malloc() does, because an FMU may read it in place. */
enum { PLAIN_AT = sizeof MAGIC + sizeof(uint64_t), HEAD = (PLAIN_AT + TL_RESUME_PLAIN + 15) / 16 * 16 };

size_t tl_resume_image_bytes(const tl_recorder_shape *shape, size_t ticks, size_t checkpoint, size_t tunings) {
    return HEAD + checkpoint + tunings * sizeof(tl_run_tuning) + ticks * tl_resume_tick_bytes(shape);
}

size_t tl_resume_size(const tl_resume *resume) {
    return tl_resume_image_bytes(&resume->shape, (size_t)(resume->last - resume->first + 1), resume->checkpoint_size,
                                 resume->tuning_count);
}

size_t tl_resume_choose_tunings(tl_run_tuning *tunings, size_t count, int64_t first, int64_t last) {
    size_t from = 0;
    size_t to = 0;
    for (size_t i = 0; i < count; i++) {
        from = tunings[i].tick <= first ? i : from; /* applies at `first` */
        to = tunings[i].tick <= last || i == from ? i + 1 : to;
    }
    memmove(tunings, tunings + from, (to - from) * sizeof *tunings);
    return to - from;
}

/* Copies one piece; returns the address of the next one. */
static unsigned char *put_bytes(unsigned char *target, const void *piece, size_t size) {
    if (size != 0) {
        memcpy(target, piece, size);
    }
    return target + size;
}

void tl_resume_write(const tl_resume *resume, void *image) {
    const uint64_t size = tl_resume_size(resume);
    unsigned char *target = image;
    memset(image, 0, HEAD);
    (void)put_bytes(put_bytes(put_bytes(target, MAGIC, sizeof MAGIC), &size, sizeof size), resume, TL_RESUME_PLAIN);
    target = put_bytes(target + HEAD, resume->checkpoint, resume->checkpoint_size);
    target = put_bytes(target, resume->tunings, resume->tuning_count * sizeof(tl_run_tuning));
    (void)put_bytes(target, resume->ticks,
                    (size_t)(resume->last - resume->first + 1) * tl_resume_tick_bytes(&resume->shape));
}

/* ---- reading ---- */

static tl_status fail_damaged(tl_error *error, const char *what) {
    return tl_fail(error, TL_BAD_DATA, "the resume data of an earlier run are damaged: %s", what);
}

static bool is_within(int64_t value, int64_t least, int64_t most) {
    return value >= least && value <= most;
}

/* Validates the start of the twin: source, checkpoint and tunings must fit together. */
static bool is_origin(const tl_resume *found) {
    bool is_of_samples = found->from == TL_RESUMED_NOT && found->tuning_count == 0 && found->last >= found->first;
    bool is_known =
        found->from == TL_RESUMED_CHECKPOINT || found->from == TL_RESUMED_START || found->from == TL_RESUMED_INPUTS;
    return (is_of_samples || (is_known && (found->from == TL_RESUMED_START) == (found->first == 0))) &&
           (found->from == TL_RESUMED_CHECKPOINT) == (found->checkpoint_size > 0);
}

static tl_status check_head(const unsigned char *image, size_t size, const tl_resume *found, const tl_config *config,
                            tl_error *error) {
    char digest[TL_SHA256_TEXT];
    uint64_t size_field = 0;
    const tl_recorder_shape samples = {.plant = config->signal_count};
    const tl_recorder_shape shape = found->from == TL_RESUMED_NOT ? samples : tl_recorder_shape_of(config);
    const int64_t last_possible = TL_RESUME_FAR / config->step;
    memcpy(&size_field, image + sizeof MAGIC, sizeof size_field);
    tl_resume_identify(config, digest);
    if (memcmp(&found->shape, &shape, sizeof shape) != 0 || found->step != config->step ||
        memcmp(found->signals, digest, sizeof digest) != 0) {
        return fail_damaged(error, "its signals are not those of this configuration");
    }
    bool is_sound =
        memcmp(image, MAGIC, sizeof MAGIC) == 0 && size_field == size && is_within(found->first, 0, last_possible) &&
        is_within(found->last, found->first - 1, last_possible) && found->last - found->first < TL_RESUME_TICKS &&
        found->checkpoint_size <= size && found->tuning_count <= TL_RESUME_TUNINGS && is_origin(found) &&
        is_within(found->run, TL_RESUME_UNNUMBERED, TL_RESUME_FAR) && isfinite(found->start_s) &&
        is_within(found->start, -TL_RESUME_FAR, TL_RESUME_FAR) && is_within(found->started, FIRST_YEAR, LAST_YEAR) &&
        tl_resume_size(found) == size;
    return is_sound ? TL_OK : fail_damaged(error, "its head");
}

static tl_status check_ticks(const tl_resume *resume, tl_error *error) {
    size_t count = (size_t)(resume->last - resume->first + 1);
    for (size_t i = 0; i < count; i++) {
        if (!is_sound_tick(&resume->shape, resume->ticks + i * tl_resume_tick_bytes(&resume->shape))) {
            return tl_fail(error, TL_BAD_DATA, "the resume data of an earlier run are damaged: its tick %" PRId64,
                           resume->first + (int64_t)i);
        }
    }
    return TL_OK;
}

static tl_status check_tunings(const tl_resume *resume, tl_error *error) {
    int64_t least = 0;
    for (size_t i = 0; i < resume->tuning_count; i++) {
        tl_run_tuning tuning;
        tl_error why;
        memcpy(&tuning, resume->tunings + i * sizeof tuning, sizeof tuning);
        if (!is_within(tuning.tick, least, TL_RESUME_FAR) || !tl_identity_is_sound(tuning.hash) ||
            tuning.hash[0] == '\0' || tl_tuning_check(&tuning.values, &why) != TL_OK) {
            return fail_damaged(error, "its tunings");
        }
        least = tuning.tick;
    }
    return TL_OK;
}

/* Sets the fields that are not in the image or are stored after its head. */
static void complete_resume(tl_resume *resume, const unsigned char *behind, tl_time now) {
    tl_time gap = now - tl_time_of_step(resume->start, resume->step, resume->last);
    resume->gap = gap < 0 ? 0 : gap;
    resume->checkpoint_tick = resume->first - 1;
    if (resume->checkpoint_size != 0) {
        resume->checkpoint = behind;
        resume->age = tl_time_of_step(0, resume->step, resume->last - resume->checkpoint_tick);
    }
    resume->tunings = behind + resume->checkpoint_size;
    resume->ticks = resume->tunings + resume->tuning_count * sizeof(tl_run_tuning);
}

/* On failure `resume` is zeroed. */
static tl_status read_image(const void *image, size_t size, const tl_config *config, tl_time now, tl_resume *resume,
                            tl_error *error) {
    const unsigned char *bytes = image;
    tl_resume found = {.from = TL_RESUMED_NOT};
    *resume = found;
    if (size < HEAD || size > TL_RESUME_MOST) {
        return fail_damaged(error, "its size");
    }
    memcpy(&found, bytes + PLAIN_AT, TL_RESUME_PLAIN);
    tl_status status = check_head(bytes, size, &found, config, error);
    if (status == TL_OK) {
        complete_resume(&found, bytes + HEAD, now);
        status = check_tunings(&found, error);
        status = status == TL_OK ? check_ticks(&found, error) : status;
        *resume = status == TL_OK ? found : *resume;
    }
    return status;
}

/* In mode ahead the last tick may be one later than the one from which the gap was computed. */
tl_status tl_resume_read(const void *image, size_t size, const tl_config *config, tl_time now, tl_resume *resume,
                         tl_error *error) {
    tl_status status = read_image(image, size, config, now, resume, error);
    tl_time gap = now - tl_time_of_step(resume->start, resume->step, resume->last);
    if (status == TL_OK &&
        (resume->from == TL_RESUMED_NOT || !is_within(gap, -resume->step, config->record_resume + READING))) {
        *resume = (tl_resume){.from = TL_RESUMED_NOT};
        return fail_damaged(error, "its time is wrong");
    }
    return status;
}

tl_status tl_resume_read_samples(const void *image, size_t size, const tl_config *config, tl_time start,
                                 tl_resume *resume, tl_error *error) {
    tl_status status = read_image(image, size, config, 0, resume, error);
    if (status == TL_OK && (resume->from != TL_RESUMED_NOT || resume->start != start)) {
        *resume = (tl_resume){.from = TL_RESUMED_NOT};
        return fail_damaged(error, "it does not belong to the present run");
    }
    return status;
}

bool tl_resume_tick_at(const tl_resume *resume, int64_t tick, tl_resume_tick *out) {
    if (!is_within(tick, resume->first, resume->last)) {
        return false;
    }
    size_t index = (size_t)(tick - resume->first);
    memset(out, 0, sizeof *out);
    memset(out->sample.quality, TL_NO_LINK, sizeof out->sample.quality);
    unpack_tick(&resume->shape, resume->ticks + index * tl_resume_tick_bytes(&resume->shape), out);
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        bool never = i >= resume->shape.plant || out->sample.stamps[i] == TL_TIME_NEVER;
        out->sample.stamps[i] = never ? TL_TIME_NEVER : out->sample.stamps[i] + resume->start;
    }
    out->sample.tick = tick;
    out->sample.instant = tl_time_of_step(resume->start, resume->step, tick);
    return true;
}

/* ---- follow ---- */

static const tl_time PATIENCE = 2 * TL_SECOND;

typedef struct follower {
    const tl_resume_follow_settings *settings;
    const tl_resume *resume;
    tl_time until;           /* CLOCK_MONOTONIC: end of waiting for room in the record queue */
    char name[NAME];         /* of the earlier run */
    tl_twin_tunings tunings; /* not applied yet */
    bool has_tuning;         /* one was applied and is not recorded yet: */
    tl_run_tuning tuning;    /* the newest one */
} follower;

static tl_status rebuild_twin(const follower *self, tl_error *error) {
    tl_status status = tl_assembly_rebuild(self->settings->assembly);
    return status == TL_OK ? TL_OK : tl_fail(error, status, "the twin could not be built again");
}

/* ---- start ---- */

/* If a checkpoint cannot be loaded, the twin is built again. */
static tl_status begin_twin(const follower *self, tl_resume_outcome *outcome, tl_error *error) {
    const tl_resume *resume = self->resume;
    tl_twin *twin = self->settings->assembly->twin;
    tl_twin_set_start(twin, resume->start_s);
    if (resume->from != TL_RESUMED_CHECKPOINT) {
        tl_twin_begin_at(twin, resume->first);
        return TL_OK;
    }
    tl_status status = tl_twin_load(twin, resume->checkpoint_tick, resume->checkpoint, resume->checkpoint_size, error);
    if (status == TL_OK || status == TL_FMU_FATAL) {
        return status;
    }
    *outcome = TL_RESUME_REFUSED;
    tl_resume_report(self->settings->report, self->settings->context, TL_EVENT_WARNING,
                     "the checkpoint of tick %" PRId64 " of %s cannot be loaded: %.120s", resume->checkpoint_tick,
                     self->name, error->text);
    return rebuild_twin(self, error);
}

/* ---- recording ---- */

/* Begins the run, with its checkpoint. */
static void begin_run(const follower *self, const tl_resumption *resumption) {
    const tl_resume *resume = self->resume;
    tl_record_queue *queue = self->settings->queue;
    tl_record_queue_start start = {.resumption = *resumption};
    size_t capacity = 0;
    tl_account_take(self->settings->assembly->twin, &start.account);
    if (!tl_record_queue_put_start(queue, &start)) {
        (void)tl_record_queue_wait_for_room(
            queue, self->until); /* the checkpoint needs room too, because it is enqueued before the first sample */
    }
    if (resume->checkpoint != NULL && tl_record_queue_reserve_checkpoint(queue, resume->checkpoint_size)) {
        memcpy(tl_record_queue_checkpoint_room(queue, &capacity), resume->checkpoint, resume->checkpoint_size);
        tl_record_queue_put_checkpoint(queue, resume->checkpoint_tick, resume->checkpoint_size);
    }
}

static void put_tuning(follower *self) {
    if (self->has_tuning) {
        (void)tl_record_queue_wait_for_room(self->settings->queue, self->until);
        (void)tl_record_queue_put_tuning(self->settings->queue, &self->tuning);
        self->has_tuning = false;
    }
}

static void put_sample(follower *self, const tl_sample *sample) {
    put_tuning(self);
    (void)tl_record_queue_wait_for_room(self->settings->queue, self->until);
    (void)tl_record_queue_put_sample(self->settings->queue, sample); /* the queue counts lost samples */
}

/* ---- tunings ---- */

/* Marks the tuning to be recorded in the new run at this tick, unless the run began with it. */
static void note_tuning(follower *self, const tl_run_tuning *tuning, int64_t tick) {
    const tl_record_queue *queue = self->settings->queue;
    self->has_tuning = self->has_tuning || strcmp(tl_record_queue_tuning(queue)->hash, tuning->hash) != 0;
    self->tuning = *tuning;
    self->tuning.tick = tick;
    if (strcmp(queue->configured.hash, tuning->hash) == 0) {
        self->tuning.number = queue->configured.number;
    }
}

/* Limits a tuning with more evaluations than the twin has memory for. That has no effect, because
 * nothing is searched here. */
static void apply_tunings(follower *self, int64_t tick) {
    tl_assembly *assembly = self->settings->assembly;
    tl_run_tuning tuning;
    tl_error error;
    while (tl_twin_tunings_next(&self->tunings, tick, &tuning)) {
        if (tuning.values.evaluations > tl_tuning_room(assembly->tuning.evaluations)) {
            tuning.values.evaluations = tl_tuning_room(assembly->tuning.evaluations);
        }
        if (tl_assembly_retune(assembly, &tuning.values, &error) == TL_OK) {
            note_tuning(self, &tuning, tick);
        } else {
            tl_resume_report(self->settings->report, self->settings->context, TL_EVENT_WARNING,
                             "the tuning of %s at tick %" PRId64 " is skipped: %.140s", self->name, tuning.tick,
                             error.text);
        }
    }
}

/* ---- following ---- */

static tl_status follow_tick(follower *self, const tl_resume_tick *tick, tl_summary *summary, tl_error *error) {
    const tl_assembly *assembly = self->settings->assembly;
    tl_record record;
    bool ready = false;
    bool ahead =
        assembly->config.measurements == TL_AHEAD; /* in mode ahead the step before is enqueued before the sample */
    apply_tunings(self, tick->sample.tick);
    tl_summary_sample(summary, &assembly->config, &tick->sample);
    if (!ahead) {
        put_sample(self, &tick->sample);
    }
    if (tick->resets) {
        tl_twin_reset(assembly->twin);
    }
    tl_status status = tl_twin_follow(assembly->twin, &tick->sample, tick->u, &record, &ready, error);
    if (ready) {
        tl_summary_add(summary, &assembly->config, &record);
        tl_twin_recorder_put(self->settings->queue, &record, assembly->twin);
    }
    if (ahead) {
        put_sample(self, &tick->sample);
    }
    return status;
}

static void report_resume(const follower *self, tl_time took) {
    const tl_resume *resume = self->resume;
    char from[64];
    if (resume->from == TL_RESUMED_CHECKPOINT) {
        (void)snprintf(from, sizeof from, "a checkpoint %.1f s old", tl_seconds(resume->age));
    } else {
        (void)snprintf(from, sizeof from, "%s",
                       resume->from == TL_RESUMED_START ? "its first recorded input" : "its newest inputs");
    }
    tl_resume_report(self->settings->report, self->settings->context, TL_EVENT_INFO,
                     "resumes %s at tick %" PRId64 " from %s: %" PRId64
                     " ticks repeated in %.0f ms; no twin ran for %.2f s (%" PRId64 " ticks)",
                     self->name, resume->last + 1, from, resume->last - resume->first + 1, tl_seconds(took) * 1e3,
                     tl_seconds(resume->gap), resume->gap / resume->step);
}

/* Follows the ticks from the present one on. After a failure the twin is built again, and the begun
 * run must be ended. */
static tl_status follow_ticks(follower *self, tl_summary *summary, tl_resume_outcome *outcome, tl_error *error) {
    const tl_resume *resume = self->resume;
    tl_resume_tick tick;
    tl_status status = TL_OK;
    tl_time begun = tl_clock_now(NULL);
    summary->resumption = (tl_resumption){.from = resume->from,
                                          .run = resume->run,
                                          .tick = resume->last + 1,
                                          .start_s = resume->start_s,
                                          .start = resume->start,
                                          .started = resume->started};
    begin_run(self, &summary->resumption);
    for (int64_t number = resume->first; status == TL_OK && tl_resume_tick_at(resume, number, &tick); number++) {
        status = follow_tick(self, &tick, summary, error);
    }
    if (status == TL_OK) {
        apply_tunings(self, resume->last + 1); /* if there was no tick to follow */
        put_tuning(self);
        report_resume(self, tl_clock_now(NULL) - begun);
        return TL_OK;
    }
    *outcome = TL_RESUME_FAILED;
    *summary = (tl_summary){0};
    if (status == TL_FMU_FATAL) {
        return status;
    }
    tl_resume_report(self->settings->report, self->settings->context, TL_EVENT_WARNING,
                     "starts a new run: %s could not be resumed: %.140s", self->name, error->text);
    return rebuild_twin(self, error);
}

tl_status tl_resume_follow(const tl_resume_follow_settings *settings, const tl_resume *resume, tl_summary *summary,
                           tl_resume_outcome *outcome, tl_error *error) {
    follower self = {.settings = settings,
                     .resume = resume,
                     .until = tl_clock_now(NULL) + PATIENCE,
                     .tunings = {.bytes = resume->tunings, .count = resume->tuning_count}};
    (void)name_run(resume->run, self.name);
    *summary = (tl_summary){0};
    *outcome = TL_RESUME_FOLLOWED;
    tl_status status = begin_twin(&self, outcome, error);
    return status == TL_OK && *outcome == TL_RESUME_FOLLOWED ? follow_ticks(&self, summary, outcome, error) : status;
}
