/* The beginning of a resumed twin: found in an earlier run, checked, followed: see past.h. */
#include "firmware/twin/past.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/twin/twin_recorder.h"
#include "firmware/twin/twin_step.h"

/* ---- past rule ---- */

static const tl_time FOLLOW_TIME = TL_SECOND / 2; /* for as many ticks as are led along again */

bool tl_past_refuse(char why[TL_PAST_WHY], const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(why, TL_PAST_WHY, format, arguments);
    va_end(arguments);
    return false;
}

bool tl_past_was_interrupted(int64_t run, const char *reason, char why[TL_PAST_WHY]) {
    char name[TL_PAST_NAME];
    bool interrupted = reason == NULL || strcmp(reason, "not ended cleanly") == 0 || strncmp(reason, "SIG", 3) == 0;
    return interrupted || tl_past_refuse(why, "%s ended: %.100s", tl_past_name(run, name), reason);
}

bool tl_past_is_recent(int64_t run, const tl_config *config, tl_time gap, char why[TL_PAST_WHY]) {
    char name[TL_PAST_NAME];
    if (gap < 0) {
        return tl_past_refuse(why, "by the clock %s has not happened yet", tl_past_name(run, name));
    }
    return gap <= config->record_resume ||
           tl_past_refuse(why, "nobody ran since %s for %.1f s, which is more than record.resume_s",
                          tl_past_name(run, name), tl_seconds(gap));
}

bool tl_past_is_under_way(int64_t run, const tl_config *config, int64_t last, tl_time gap, uint32_t lead,
                          char why[TL_PAST_WHY]) {
    char name[TL_PAST_NAME];
    int64_t now = last + gap / config->step;
    return config->duration == 0 || now < config->duration / config->step + (int64_t)lead ||
           tl_past_refuse(why, "the duration of %s is over", tl_past_name(run, name));
}

int64_t tl_past_most_followed(tl_time execution, size_t components) {
    tl_time each = execution * (tl_time)components;
    tl_time most = each > 0 ? FOLLOW_TIME / each : TL_PAST_TICKS;
    return most < 1 ? 1 : most < TL_PAST_TICKS ? most : TL_PAST_TICKS;
}

/* ---- past ---- */

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

static const char MAGIC[8] = {'t', 'w', 'l', 'k', 'p', 's', 't', '4'};

size_t tl_past_image_bytes(const tl_recorder_shape *shape, size_t ticks, size_t checkpoint, size_t tunings) {
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
        .signals = past->shape.plant,
        .adjusts = past->shape.adjust,
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
    const tl_recorder_shape shape = tl_recorder_shape_of(config);
    if (memcmp(found->magic, MAGIC, sizeof MAGIC) != 0 || found->size != size) {
        return fail_damaged(error, "it does not begin as it should");
    }
    if (found->signals != shape.plant || found->adjusts != shape.adjust || found->step != config->step) {
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
        .shape = {.plant = (size_t)found->signals, .adjust = (size_t)found->adjusts},
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

/* ---- past follow ---- */

static const tl_time PATIENCE = 2 * TL_SECOND;

typedef struct follower {
    const tl_past_follow_settings *settings;
    const tl_past *past;
    tl_time until;           /* CLOCK_MONOTONIC: nobody waits for room for longer */
    char name[TL_PAST_NAME]; /* of its run */
    tl_twin_tunings tunings; /* that are still to be taken; */
    bool has_tuning;         /* one was, and is not recorded yet: */
    tl_run_tuning tuning;    /* this */
} follower;

static void tell(const follower *self, tl_severity severity, const char *format, ...) TL_PRINTF(3, 4);

static void tell(const follower *self, tl_severity severity, const char *format, ...) {
    char text[TL_PAST_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    self->settings->tell(self->settings->context, severity, text);
}

static tl_status build_anew(const follower *self, tl_error *error) {
    tl_status status = tl_assembly_rebuild(self->settings->assembly);
    return status == TL_OK ? TL_OK : tl_fail(error, status, "the twin could not be built a second time");
}

/* ---- where it begins ---- */

/* Into the twin; if that fails, it is a new one again. */
static tl_status load(const follower *self, tl_past_outcome *outcome, tl_error *error) {
    const tl_past *past = self->past;
    tl_status status = tl_twin_load(self->settings->assembly->twin, past->checkpoint_tick, past->checkpoint,
                                    past->checkpoint_size, error);
    if (status == TL_OK || status == TL_FMU_FATAL) {
        return status;
    }
    *outcome = TL_PAST_REFUSED;
    tell(self, TL_EVENT_WARNING, "the checkpoint of tick %" PRId64 " of %s is of no use: %.120s", past->checkpoint_tick,
         self->name, error->text);
    return build_anew(self, error);
}

static tl_status begin(const follower *self, tl_past_outcome *outcome, tl_error *error) {
    if (self->past->from == TL_RESUMED_CHECKPOINT) {
        return load(self, outcome, error);
    }
    tl_twin_begin_at(self->settings->assembly->twin, self->past->first);
    return TL_OK;
}

/* ---- what is recorded ---- */

static void wait_for_room(const follower *self) {
    (void)tl_outbox_wait_for_room(self->settings->outbox, self->until);
}

static void put_start(const follower *self, const tl_resumption *resumption) {
    tl_outbox_start start = {.resumption = *resumption};
    tl_account_take(self->settings->assembly->twin, &start.account);
    if (!tl_outbox_put_start(self->settings->outbox, &start)) {
        wait_for_room(self); /* for its room too: it goes in before the first sample */
    }
}

/* The one that the run begins with. */
static void put_checkpoint(const follower *self) {
    const tl_past *past = self->past;
    tl_outbox *outbox = self->settings->outbox;
    size_t capacity = 0;
    if (tl_outbox_reserve_checkpoint(outbox, past->checkpoint_size)) {
        memcpy(tl_outbox_checkpoint_room(outbox, &capacity), past->checkpoint, past->checkpoint_size);
        tl_outbox_put_checkpoint(outbox, past->checkpoint_tick, past->checkpoint_size);
    }
}

static void begin_run(const follower *self, const tl_resumption *resumption) {
    if (self->settings->outbox != NULL) {
        put_start(self, resumption);
        if (self->past->checkpoint != NULL) {
            put_checkpoint(self);
        }
    }
}

static void put_tuning(follower *self) {
    if (self->has_tuning) {
        wait_for_room(self);
        (void)tl_outbox_put_tuning(self->settings->outbox, &self->tuning);
        self->has_tuning = false;
    }
}

static void put_sample(follower *self, const tl_sample *sample) {
    if (self->settings->outbox != NULL) {
        put_tuning(self);
        wait_for_room(self);
        (void)tl_outbox_put_sample(self->settings->outbox, sample); /* what is lost is counted there */
    }
}

static void put_step(const follower *self, const tl_record *record) {
    if (self->settings->outbox != NULL) {
        tl_twin_recorder_put(self->settings->outbox, record, self->settings->assembly->twin);
    }
}

/* ---- what was in force ---- */

/* Of the new run, at this tick; what it was begun with needs no saying, and has the number that it has now. */
static void note_tuning(follower *self, const tl_run_tuning *tuning, int64_t tick) {
    const tl_outbox *outbox = self->settings->outbox;
    const tl_run_tuning *in_force = outbox != NULL ? tl_outbox_tuning(outbox) : NULL;
    self->has_tuning = in_force != NULL && (self->has_tuning || strcmp(in_force->hash, tuning->hash) != 0);
    self->tuning = *tuning;
    self->tuning.tick = tick;
    if (outbox != NULL && strcmp(outbox->configured.hash, tuning->hash) == 0) {
        self->tuning.number = outbox->configured.number;
    }
}

/* Nothing is searched here, so that more evaluations than there is room for do no harm. */
static void take_tunings(follower *self, int64_t tick) {
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
            tell(self, TL_EVENT_WARNING, "what %s took at tick %" PRId64 " is passed over: %.140s", self->name,
                 tuning.tick, error.text);
        }
    }
}

/* ---- following ---- */

static tl_status follow_tick(follower *self, const tl_past_tick *tick, tl_summary *summary, tl_error *error) {
    const tl_assembly *assembly = self->settings->assembly;
    tl_record record;
    bool ready = false;
    bool ahead = assembly->config.measurements == TL_AHEAD; /* the step before comes before the sample */
    take_tunings(self, tick->sample.tick);
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
        put_step(self, &record);
    }
    if (ahead) {
        put_sample(self, &tick->sample);
    }
    return status;
}

static tl_status follow(follower *self, tl_summary *summary, tl_error *error) {
    tl_past_tick tick;
    tl_status status = TL_OK;
    for (int64_t number = self->past->first; status == TL_OK && tl_past_tick_at(self->past, number, &tick); number++) {
        status = follow_tick(self, &tick, summary, error);
    }
    return status;
}

static void tell_all(const follower *self, tl_time took) {
    const tl_past *past = self->past;
    char from[64];
    if (past->from == TL_RESUMED_CHECKPOINT) {
        (void)snprintf(from, sizeof from, "a checkpoint %.1f s old", tl_seconds(past->age));
    } else {
        (void)snprintf(from, sizeof from, "%s",
                       past->from == TL_RESUMED_START ? "the start of its recorded inputs" : "its newest inputs");
    }
    tell(self, TL_EVENT_INFO,
         "goes on with %s at tick %" PRId64 " from %s, %" PRId64
         " ticks run again in %.0f ms; nobody ran for %.2f s (%" PRId64 " ticks)",
         self->name, past->last + 1, from, past->last - past->first + 1, tl_seconds(took) * 1e3, tl_seconds(past->gap),
         past->gap / past->step);
}

/* From where the twin stands now. A failure leaves a new twin, and a run that is of no use. */
static tl_status go_on(follower *self, tl_summary *summary, tl_past_outcome *outcome, tl_error *error) {
    const tl_past *past = self->past;
    tl_time begun = tl_clock_now(NULL);
    summary->resumption = (tl_resumption){
        .from = past->from, .run = past->run, .tick = past->last + 1, .start = past->start, .started = past->started};
    begin_run(self, &summary->resumption);
    tl_status status = follow(self, summary, error);
    if (status == TL_OK) {
        take_tunings(self, past->last + 1); /* where there was no tick to be followed */
        put_tuning(self);
        tell_all(self, tl_clock_now(NULL) - begun);
        return TL_OK;
    }
    *outcome = TL_PAST_FAILED;
    *summary = (tl_summary){0};
    if (status == TL_FMU_FATAL) {
        return status;
    }
    tell(self, TL_EVENT_WARNING, "begins anew: to go on with %s has failed: %.140s", self->name, error->text);
    return build_anew(self, error);
}

tl_status tl_past_follow(const tl_past_follow_settings *settings, const tl_past *past, tl_summary *summary,
                         tl_past_outcome *outcome, tl_error *error) {
    follower self = {.settings = settings,
                     .past = past,
                     .until = tl_clock_now(NULL) + PATIENCE,
                     .tunings = {.bytes = past->tunings, .count = past->tuning_count}};
    (void)tl_past_name(past->run, self.name);
    *summary = (tl_summary){0};
    *outcome = TL_PAST_FOLLOWED;
    tl_status status = begin(&self, outcome, error);
    return status == TL_OK && *outcome == TL_PAST_FOLLOWED ? go_on(&self, summary, outcome, error) : status;
}
