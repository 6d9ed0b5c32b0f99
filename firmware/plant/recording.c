/* Recordings of a plant: see recording.h. */
#include "firmware/plant/recording.h"

#include <inttypes.h>
#include <limits.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "board/csv/csv.h"
#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/plant/live_plant.h"
#include "firmware/plant/plant_input.h"
#include "firmware/plant/sample_buffer.h"
#include "master/base/status.h"

struct tl_recording {
    char path[PATH_MAX]; /* for messages */
    const tl_config *config;
    int64_t ticks;                       /* number of ticks */
    int64_t next;                        /* next tick */
    tl_recording_on_reading *on_reading; /* NULL: no listener */
    void *listener;
    tl_plant_input input;
    void *sample_memory; /* memory of its sample buffers */
    /* from CSV */
    tl_csv_reader *reader;
    tl_csv_form form;
    tl_time start;  /* time of the first row; of a database: 0, unless by_recording */
    tl_csv_row row; /* read, but not posted yet */
    bool row_waits;
    /* from a database */
    tl_history *history; /* NULL: from CSV */
    tl_history_ticks *walk;
    bool same_configuration;    /* repeat the run's missed ticks and time-outs */
    size_t recorded;            /* signals of the run that the configuration has, including further look-ups */
    size_t raw[TL_MAX_SIGNALS]; /* by signal: index of the run's signal with its readings as they came */
    bool by_recording;          /* stamps, and t_start, are those of the recording that the run replayed */
    tl_recording_beginning beginning;
    tl_recording_tunings tunings;
    tl_recording_keep keep;
    tl_recording_time time;         /* without its length */
    bool looks_up_again;            /* signals are looked up as the configuration requires: */
    tl_time posted[TL_MAX_SIGNALS]; /* stamp of the newest posted reading */
};

static tl_status open_input(tl_recording *recording, tl_error *error) {
    tl_live_plant_set_limits(&recording->input, recording->config);
    recording->sample_memory = tl_sample_buffers_make_least(recording->config->signal_count, recording->input.buffers);
    return recording->sample_memory != NULL && tl_plant_input_open(&recording->input)
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", recording->path);
}

/* The listener receives only signals of the configuration's own, not further look-ups. */
static void post_reading(tl_recording *recording, size_t signal, const tl_reading *reading) {
    tl_sample_buffer_post(&recording->input.buffers[signal], reading);
    if (recording->on_reading != NULL && recording->config->signals[signal].of == signal) {
        recording->on_reading(recording->listener, signal, reading);
    }
}

/* ---- Ticks of a run that was recorded in a database
 *
 * Purpose: delivers a run as it was. If the configuration is that of the run, a replay computes the
 *          same u. It repeats the missed ticks, the time-outs of searches, and the tunings at their
 *          ticks.
 * Delays:  if another configuration looks signals up differently, they are looked up again, by the
 *          stamps of the readings that the run saw: at most one per tick and signal. So a run that
 *          was recorded without delays can be replayed with delays.
 * Errors:  TL_BAD_DATA in three cases: the signals or the step are not those of the configuration;
 *          the start of the run was removed; or a tuning of the run cannot be followed.
 */

/* Returns true if the recorded signal is "plant.NAME" with this suffix. */
static bool is_same_signal(const char *recorded, const char *name, const char *suffix) {
    char own[TL_RECORDER_NAME + sizeof TL_CONFIG_READING];
    (void)snprintf(own, sizeof own, "plant.%s%s", name, suffix);
    return strcmp(recorded, own) == 0;
}

/* For a signal that was conditioned or on a line, the run also recorded its readings as they came.
 */
static void find_readings(tl_recording *recording, const tl_recorder_signal *signals, size_t count) {
    const tl_config *config = recording->config;
    for (size_t i = 0; i < config->signal_count; i++) {
        size_t first = config->signals[i].of;
        recording->raw[i] = i < recording->recorded ? i : first;
        for (size_t k = 0; k < count && k < TL_MAX_SIGNALS; k++) {
            bool matches = is_same_signal(signals[k].name, config->signals[first].plan.name, TL_CONFIG_READING);
            recording->raw[i] = matches ? k : recording->raw[i];
        }
    }
}

/* The run must have all further look-ups, or none is used and they are computed from the own
 * signals. */
static tl_status check_signals(tl_recording *recording, const tl_history_run *run, const tl_config *config,
                               tl_error *error) {
    const char *path = recording->path;
    const tl_recorder_signal *signals = NULL;
    size_t count = 0;
    const size_t own = config->own_count;
    tl_status status = tl_history_signals(recording->history, run, TL_HISTORY_PLANT, &signals, &count, error);
    if (status != TL_OK) {
        return status;
    }
    bool all = true;
    for (size_t i = own; i < config->signal_count; i++) {
        all = all && i < count && is_same_signal(signals[i].name, config->signals[i].plan.name, "");
    }
    recording->recorded = all ? config->signal_count : own;
    find_readings(recording, signals, count);
    while (count > 0 && strchr(signals[count - 1].name, '@') != NULL) { /* a further look-up, of a run with delays */
        count--;
    }
    for (size_t i = 0; i < own; i++) {
        const char *name = config->signals[i].plan.name;
        if (i >= count || !is_same_signal(signals[i].name, name, "")) {
            return tl_fail(error, TL_BAD_DATA,
                           "%s: run %" PRId64 " has %s as signal %zu, the configuration has plant.%s: the plant's "
                           "signals must be the same, in the same order",
                           path, run->run, i < count ? signals[i].name : "nothing", i + 1, name);
        }
    }
    if (count != own || run->step != config->step) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: run %" PRId64
                       " has %zu signals every %g s, the configuration has %zu every %g s: use the run's configuration",
                       path, run->run, count, tl_seconds(run->step), own, tl_seconds(config->step));
    }
    return TL_OK;
}

static tl_status fail_without_start(const tl_recording *recording, const tl_history_run *run, tl_error *error) {
    return tl_fail(error, TL_BAD_DATA,
                   "%s: run %" PRId64 " has no start, because it was removed or not recorded: replay another one "
                   "(--run)",
                   recording->path, run->run);
}

/* Finds the checkpoint that the run started with. It must belong to the tick before the first one,
 * and be undamaged. */
static tl_status find_checkpoint(tl_recording *recording, const tl_history_run *run, tl_error *error) {
    tl_recording_beginning *beginning = &recording->beginning;
    const tl_history_checkpoint *checkpoint = NULL;
    tl_status status = tl_history_checkpoint_before(recording->history, run, beginning->tick, &checkpoint, error);
    if (status != TL_OK) {
        return status;
    }
    if (checkpoint == NULL || checkpoint->tick != beginning->tick - 1) {
        return fail_without_start(recording, run, error);
    }
    beginning->checkpoint = checkpoint;
    return checkpoint->whole && checkpoint->size != 0
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA,
                         "%s: run %" PRId64 " started with a checkpoint that is damaged: replay another one (--run)",
                         recording->path, run->run);
}

/* After the checkpoint the twin needs the committed u of all steps that it has not computed yet. */
static bool has_steps_after(const tl_history_run *run, const tl_history_checkpoint *checkpoint) {
    return run->removed_before <= 0 || checkpoint->tick + 1 - (int64_t)run->lead >= run->removed_before;
}

/* Skips the ticks up to the newest checkpoint before the tick `before`. *found: there is one. */
static tl_status skip_to_checkpoint(tl_recording *recording, const tl_history_run *run, int64_t before, bool *found,
                                    tl_error *error) {
    const tl_history_checkpoint *checkpoint = NULL;
    char format[TL_IDENTITY_TEXT];
    tl_identity_format(format);
    tl_status status = tl_history_checkpoint_before(recording->history, run, before, &checkpoint, error);
    *found = status == TL_OK && checkpoint != NULL && checkpoint->whole && checkpoint->size != 0 &&
             has_steps_after(run, checkpoint) && strcmp(checkpoint->format, format) == 0;
    if (!*found) {
        return status;
    }
    tl_history_ticks_end(recording->walk);
    recording->walk = NULL;
    recording->beginning = (tl_recording_beginning){
        .run = run->run,
        .tick = checkpoint->tick + 1,
        .follows = true,
        .resumption = {.from = TL_RESUMED_CHECKPOINT, .run = run->run, .tick = checkpoint->tick + 1},
        .fmus = run->fmus,
        .checkpoint = checkpoint,
    };
    return tl_history_ticks_begin(recording->history, run, checkpoint->tick + 1, &recording->walk, error);
}

/* Determines the state of the twin before the first tick. */
static tl_status find_beginning(tl_recording *recording, const tl_history_run *run, int64_t first, tl_error *error) {
    bool resumed = run->resumption.from != TL_RESUMED_NOT;
    bool found = false;
    if (recording->config->recording_follow != 0 && recording->same_configuration) {
        tl_status status = skip_to_checkpoint(recording, run, recording->config->recording_follow, &found, error);
        if (status != TL_OK || found) {
            return status;
        }
    }
    if (run->removed_before > 0 || (first != 0 && !resumed)) {
        return fail_without_start(recording, run, error);
    }
    recording->beginning = (tl_recording_beginning){
        .run = run->run,
        .tick = first,
        .follows = recording->same_configuration && resumed,
        .resumption = run->resumption,
        .fmus = run->fmus,
    };
    bool loads = recording->beginning.follows && run->resumption.from == TL_RESUMED_CHECKPOINT;
    return loads ? find_checkpoint(recording, run, error) : TL_OK;
}

/* ---- tunings ---- */

/* Parses a tuning for a twin built with `own`. It may contain more evaluations than this twin has
 * memory for. That was only in use in steps followed from an earlier run, without a search, so the
 * number is reduced. */
static tl_status parse_tuning(const char *text, const tl_config *own, tl_tuning *tuning, tl_error *error) {
    tl_tuning built;
    tl_config_tuning(own, &built);
    tl_status status = tl_config_tuning_of(own, text, tuning, error);
    if (status == TL_OK && tuning->evaluations > tl_tuning_room(built.evaluations)) {
        tuning->evaluations = tl_tuning_room(built.evaluations);
    }
    return status == TL_OK ? tl_tuning_fits(tuning, &built, error) : status;
}

/* Copies a tuning that was parsed before. */
static bool copy_earlier(tl_recording *recording, size_t index) {
    tl_run_tuning *list = recording->tunings.list;
    for (size_t i = 0; i < index; i++) {
        if (strcmp(list[i].hash, list[index].hash) == 0) {
            list[index].values = list[i].values;
            recording->tunings.known[index].text = recording->tunings.known[i].text;
            return true;
        }
    }
    return false;
}

static tl_status load_tuning(tl_recording *recording, const tl_history_run *run, const tl_history_tuning *found,
                             size_t index, tl_error *error) {
    tl_run_tuning *tuning = &recording->tunings.list[index];
    tl_recorder_known *known = &recording->tunings.known[index];
    tl_error why;
    tuning->tick = found->tick;
    (void)snprintf(tuning->hash, sizeof tuning->hash, "%s", found->hash);
    *known = (tl_recorder_known){
        .hash = found->hash, .at = found->at, .who = found->who, .origin = found->origin, .why = found->why};
    if (copy_earlier(recording, index)) {
        return TL_OK;
    }
    tl_status status = tl_history_configuration_text(recording->history, found->hash, &known->text, error);
    if (status == TL_OK) {
        status = parse_tuning(known->text, recording->config, &tuning->values, &why);
        return status == TL_OK ? TL_OK
                               : tl_fail(error, TL_BAD_DATA,
                                         "%s: run %" PRId64 " changed to the configuration %.12s at tick %" PRId64
                                         ", which cannot be replayed: %.200s",
                                         recording->path, run->run, found->hash, found->tick, why.text);
    }
    return status;
}

/* Reads all tunings if they are to be followed; otherwise only counts them. */
static tl_status find_tunings(tl_recording *recording, const tl_history_run *run, tl_error *error) {
    const tl_history_tuning *found = NULL;
    size_t count = 0;
    tl_status status = tl_history_tunings(recording->history, run, &found, &count, error);
    recording->tunings.recorded = status == TL_OK ? count : 0;
    if (status != TL_OK || count == 0 || !recording->same_configuration) {
        return status;
    }
    if (count > TL_RECORDING_TUNINGS) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: run %" PRId64 " changed its configuration %zu times: at most %d can be replayed",
                       recording->path, run->run, count, (int)TL_RECORDING_TUNINGS);
    }
    recording->tunings.list = calloc(count, sizeof *recording->tunings.list);
    recording->tunings.known = calloc(count, sizeof *recording->tunings.known);
    if (recording->tunings.list == NULL || recording->tunings.known == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", recording->path);
    }
    for (size_t i = 0; status == TL_OK && i < count; i++) {
        status = load_tuning(recording, run, &found[i], i, error);
    }
    recording->tunings.count = count;
    return status;
}

/* ---- what the run has kept ---- */

static void take_keep(void *context, const tl_history_event *event) {
    tl_recording *recording = context;
    if (strcmp(event->source, "twin") == 0 &&
        tl_config_read_keep(recording->config, event->text, &recording->keep.unsaved)) {
        recording->keep.is_known = true;
    }
}

static tl_status find_keep(tl_recording *recording, const tl_history_run *run, tl_error *error) {
    const tl_history_visitor visitor = {.context = recording, .event = take_keep};
    return recording->same_configuration ? tl_history_events(recording->history, run, "", -1, &visitor, error) : TL_OK;
}

/* ---- look-ups ---- */

static bool has_same_lookups(const tl_config *config, const tl_config *run) {
    bool same = config->signal_count == run->signal_count;
    for (size_t i = 0; same && i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        const tl_config_signal *other = &run->signals[i];
        const tl_condition *own = &signal->condition;
        const tl_condition *its = &other->condition;
        same = signal->look_back == other->look_back && signal->next == other->next &&
               signal->between == other->between && own->median == its->median && own->low_pass == its->low_pass &&
               (own->leap > 0.0) == (its->leap > 0.0) && /* the tolerance may differ */
               !(own->gate < its->gate) && !(own->gate > its->gate);
    }
    return same;
}

static bool has_delays(const tl_config *config) {
    bool any = config->delays != NULL;
    for (size_t i = 0; i < config->signal_count; i++) {
        any = any || config->signals[i].look_back != 0;
    }
    return any;
}

/* Returns true if the run may have looked up signals at other instants than the configuration. The
 * run's own configuration text decides, if it is available and still valid. */
static bool differs_in_lookups(tl_recording *recording, const tl_history_run *run) {
    const char *text = NULL;
    tl_config own;
    tl_error error;
    tl_report silent = {.add = NULL};
    if (tl_history_configuration_text(recording->history, run->configuration_hash, &text, &error) != TL_OK ||
        tl_config_read_text(recording->config->path, text, strlen(text), &own, &silent) != TL_OK) {
        return has_delays(recording->config);
    }
    tl_config_use_lookups(&own);
    bool otherwise = !has_same_lookups(recording->config, &own);
    tl_config_free(&own);
    return otherwise;
}

static tl_status open_run(tl_recording *recording, tl_error *error) {
    const tl_config *config = recording->config;
    const tl_history_run *run = NULL;
    int64_t range[2] = {0};
    bool any = false;
    tl_status status = tl_history_find(recording->history, config->recording_run, &run, error);
    if (status == TL_OK) {
        status = check_signals(recording, run, config, error);
    }
    if (status == TL_OK) {
        status = tl_history_ticks_begin(recording->history, run, 0, &recording->walk, error);
    }
    if (status == TL_OK) {
        status = tl_history_range(recording->history, run, TL_HISTORY_SAMPLES, INT64_MIN, range, &any, error);
    }
    if (status != TL_OK) {
        return status;
    }
    recording->same_configuration = strcmp(run->configuration_hash, config->hash) == 0;
    if (!any) {
        return fail_without_start(recording, run, error);
    }
    recording->looks_up_again = !recording->same_configuration && differs_in_lookups(recording, run);
    recording->by_recording = strcmp(run->verb, "replay") == 0;
    recording->ticks = range[1] + 1;
    recording->time = (tl_recording_time){.has_start = strcmp(run->verb, "hold") != 0, .experiment = run->experiment};
    status = find_tunings(recording, run, error);
    status = status == TL_OK ? find_keep(recording, run, error) : status;
    return status == TL_OK ? find_beginning(recording, run, range[0], error) : status;
}

static tl_status open_database(tl_recording *recording, const char *path, tl_error *error) {
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        recording->posted[i] = TL_TIME_NEVER;
    }
    tl_status status = tl_history_open(path, &recording->history, error);
    if (status == TL_OK) {
        status = open_run(recording, error);
    }
    if (status == TL_BAD_DATA) {
        tl_history_diagnose(recording->history, error);
    }
    return status;
}

/* A replayed recording starts at its first row. All values at tick 0 are of that row, or older. */
static void find_start(tl_recording *recording, const tl_sample *sample) {
    tl_time newest = TL_TIME_NEVER;
    for (size_t i = 0; i < recording->recorded; i++) {
        newest = sample->stamps[i] > newest ? sample->stamps[i] : newest;
    }
    recording->start = recording->by_recording && newest != TL_TIME_NEVER ? newest : 0;
}

/* Posts the readings that are new since the last tick, with their own stamps. */
static void post_new_readings(tl_recording *recording, const tl_sample *sample) {
    for (size_t i = 0; i < recording->config->signal_count; i++) {
        size_t from = recording->raw[i];
        bool is_rejected = sample->quality[from] >= TL_OUTLIER; /* outliers and frozen readings are found again */
        const tl_reading reading = {.value = sample->values[from],
                                    .stamp = sample->stamps[from],
                                    .quality = is_rejected ? TL_GOOD : (tl_quality)sample->quality[from]};
        if (reading.stamp == recording->posted[i]) {
            continue;
        }
        recording->posted[i] = reading.stamp;
        post_reading(recording, i, &reading);
    }
}

/* Copies what the run did at this tick, so that the replay repeats it. */
static void repeat_step(const tl_recording *recording, const tl_history_tick *read, tl_recording_tick *tick) {
    const bool repeat = recording->same_configuration && read->has_step;
    /* After a handover, a run contains steps that it searched itself as a shadow of the run before.
     * Only the other ones are followed. */
    tick->followed = recording->beginning.follows && read->sample.tick < recording->beginning.resumption.tick &&
                     (!read->has_step || read->step.outcome == TL_RESUMED);
    tick->followed = tick->followed || (recording->config->recording_follow != 0 && repeat);
    memcpy(tick->u, read->u, sizeof tick->u);
    tick->caught_up = repeat && read->step.outcome == TL_CAUGHT_UP;
    tick->resets = repeat && tl_record_was_reset(read->step.flags);
    tick->rests = repeat && (read->step.flags & TL_FLAG_RESTS) != 0;
    tick->ends_released = repeat && (read->step.flags & TL_FLAG_RELEASED_SLOW) != 0;
    bool without_nominal = (read->step.flags & TL_FLAG_WITHOUT_NOMINAL) != 0;
    tick->cut_short = repeat && (read->step.stop == TL_STOP_TIME || without_nominal);
    tick->evaluations = tick->cut_short ? (uint32_t)read->step.evaluations : 0;
    tick->executions = tick->cut_short ? (uint64_t)read->step.executions : 0;
    tick->without_nominal = tick->cut_short && (without_nominal || read->step.evaluations == 0);
}

static tl_status next_from_database(tl_recording *recording, tl_recording_tick *tick, bool *end, tl_error *error) {
    tl_history_tick read = {
        .has_step = false}; /* initialise all, because the whole tick is copied to the process with the FMUs */
    tl_status status = tl_history_ticks_next(recording->walk, &read, end, error);
    if (status == TL_BAD_DATA) {
        tl_history_diagnose(recording->history, error);
    }
    if (status != TL_OK || *end) {
        return status;
    }
    if (read.sample.tick != recording->next) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: tick %" PRId64 " is missing in the database: the replay cannot continue", recording->path,
                       recording->next);
    }
    if (read.sample.tick == 0) {
        find_start(recording, &read.sample);
    }
    read.sample.instant = tl_time_of_step(recording->start, recording->config->step, read.sample.tick);
    for (size_t i = 0; i < recording->config->signal_count && !recording->same_configuration; i++) {
        bool is_frozen = read.sample.quality[i] == TL_FROZEN; /* found again */
        read.sample.quality[i] = is_frozen ? (uint8_t)TL_GOOD : read.sample.quality[i];
    }
    tl_live_plant_apply_bounds(recording->config, &read.sample);
    tick->is_decided = recording->same_configuration;
    tick->sample = read.sample;
    if (recording->looks_up_again || recording->on_reading != NULL) {
        post_new_readings(recording, &read.sample);
    }
    if (recording->looks_up_again) { /* look up as the configuration requires */
        tl_plant_input_take(&recording->input, read.sample.tick, read.sample.instant, &tick->sample);
    }
    repeat_step(recording, &read, tick);
    return TL_OK;
}

/* ---- CSV ---- */

/* Opens the file for the first `count` signals. */
static tl_status open_reader(const char *path, const tl_config *config, size_t count, tl_csv_reader **reader,
                             tl_error *error) {
    tl_csv_column columns[TL_MAX_SIGNALS];
    for (size_t i = 0; i < count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        columns[i] = (tl_csv_column){.name = signal->column, .scale = signal->scale, .offset = signal->offset};
    }
    const tl_csv_settings settings = {
        .path = path,
        .time_column = config->recording_time_column,
        .columns = columns,
        .column_count = count,
    };
    return tl_csv_open(&settings, reader, error);
}

/* Checks that a row is not too far from the one before and from the first one. */
static tl_status check_gap(const char *path, tl_time step, tl_time first, tl_time before, tl_time now,
                           tl_error *error) {
    if ((now - before) / step > TL_RECORDING_GAP) {
        return tl_fail(
            error, TL_BAD_DATA,
            "%s: between the rows at %.9f s and %.9f s there are %lld steps of %.9g s (at most %lld): correct "
            "the time, or cut the recording there",
            path, tl_seconds(before), tl_seconds(now), (long long)((now - before) / step), tl_seconds(step),
            (long long)TL_RECORDING_GAP);
    }
    if ((now - first) / step >= TL_RECORDING_TICKS) {
        return tl_fail(
            error, TL_BAD_DATA,
            "%s: up to the row at %.9f s there are more than %lld steps of %.9g s: cut the recording, or raise "
            "step_s",
            path, tl_seconds(now), (long long)TL_RECORDING_TICKS, tl_seconds(step));
    }
    return TL_OK;
}

/* ---- Unit of the time column: a wrong one would be replayed as a plant that hardly changes.
 *
 * Method: the median distance of the first rows is compared with the longest time that the
 *         configuration expects between readings, at least one step. Slow recordings are usual: a
 *         row per minute for steps of 1 s. So SLOWEST times that time is permitted, and minutes up
 *         to an hour and hours up to a day. Fast recordings are usual too. So minutes, hours and
 *         days are recognised only if the rows are just one expected time apart, and the recording
 *         has at most FEWEST_TICKS. Rows of events, as commands are, have irregular distances, and
 *         are not checked; nor is a recording without measurements, or with dates or a stated unit.
 *         Large numbers taken for Unix times in a smaller unit may also count from a start, so
 *         SLOWEST_GUESSED holds for them.
 */

enum { GAPS_SEEN = 1000, GAPS_LEAST = 4, SLOWEST = 400, SLOWEST_GUESSED = 60, FEWEST_TICKS = 60 };

static const tl_time MINUTE = 60 * TL_SECOND;
static const tl_time HOUR = 3600 * TL_SECOND;

typedef struct time_unit {
    const char *name, *remedy;
    double least, most; /* distance of rows, in expected times */
} time_unit;

static const time_unit time_units[] = {
    {"milliseconds", "divide it by 1000", SLOWEST, 1e5},
    {"microseconds", "divide it by 1000000", 1e5, 1e8},
    {"nanoseconds", "divide it by 1e9", 1e8, 1e12},
    {"minutes", "multiply it by 60", 0.99 / 60, 1.01 / 60},
    {"hours", "multiply it by 3600", 0.99 / 3600, 1.01 / 3600},
    {"days", "multiply it by 86400", 0.99 / 86400, 1.01 / 86400},
};

static int compare_times(const void *one, const void *other) {
    const tl_time *a = one;
    const tl_time *b = other;
    return (*a > *b) - (*a < *b);
}

static tl_time expected_gap(const tl_config *config) {
    tl_time longest = config->step;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_time interval = tl_config_interval(config, &config->signals[i]);
        longest = interval > longest ? interval : longest;
        longest = config->signals[i].every > longest ? config->signals[i].every : longest;
    }
    return longest;
}

/* Sorts the gaps. `ticks`: of the whole recording. */
static tl_status check_unit(const char *path, const tl_config *config, const tl_csv_clock *clock, tl_time *gaps,
                            size_t count, int64_t ticks, tl_error *error) {
    const bool is_stated = clock->form != TL_CSV_TIME_NUMBER || (clock->per_second != 1 && !clock->is_guessed);
    if (count < GAPS_LEAST || config->match_count == 0 || is_stated) {
        return TL_OK;
    }
    qsort(gaps, count, sizeof gaps[0], compare_times);
    if (gaps[count * 9 / 10] > 2 * gaps[count / 10]) {
        return TL_OK;
    }
    const tl_time gap = gaps[count / 2];
    const tl_time expected = expected_gap(config);
    const double ratio = (double)gap / (double)expected;
    if (clock->is_guessed && ratio > SLOWEST_GUESSED) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s: as Unix times, with %lld in a second, its rows are %.6g s apart, and %.6g s are expected: "
                       "add a row with the unit of the time (s, ms, us or ns) below the header",
                       path, (long long)clock->per_second, tl_seconds(gap), tl_seconds(expected));
    }
    const bool is_of_clock = (gap % MINUTE == 0 && gap <= HOUR) || (gap % HOUR == 0 && gap <= 24 * HOUR);
    for (size_t i = 0; i < sizeof time_units / sizeof time_units[0]; i++) {
        const time_unit *unit = &time_units[i];
        const bool may_be = unit->most > 1 ? !is_of_clock : ticks <= FEWEST_TICKS;
        if (may_be && ratio >= unit->least && ratio < unit->most) {
            return tl_fail(error, TL_BAD_DATA,
                           "%s: its rows are %.6g s apart, and %.6g s are expected: the time seems to be in %s "
                           "(expected seconds): %s, or set every_s of a signal to the real distance",
                           path, tl_seconds(gap), tl_seconds(expected), unit->name, unit->remedy);
        }
    }
    return TL_OK;
}

/* Reads the whole file to validate every row before the first one is used, and to count the ticks.
 * It converts only the times, because a value that is no number makes no row invalid. */
static tl_status check_rows(tl_recording *recording, const char *path, tl_error *error) {
    const tl_config *config = recording->config;
    tl_csv_reader *reader = NULL;
    tl_status status = open_reader(path, config, 0, &reader, error);
    tl_time gaps[GAPS_SEEN];
    tl_time last = 0;
    size_t rows = 0;
    bool end = false;
    while (status == TL_OK && !end) {
        status = tl_csv_next(reader, &recording->row, &end, error);
        if (status == TL_OK && !end) {
            recording->start = rows == 0 ? recording->row.time : recording->start;
            last = rows++ == 0 ? recording->start : last;
            status = check_gap(path, config->step, recording->start, last, recording->row.time, error);
            if (rows > 1 && rows <= GAPS_SEEN + 1) {
                gaps[rows - 2] = recording->row.time - last;
            }
            last = recording->row.time;
        }
    }
    if (status == TL_OK) {
        recording->form = tl_csv_get_form(reader);
    }
    tl_csv_close(reader);
    if (status == TL_OK && rows == 0) {
        return tl_fail(error, TL_BAD_DATA, "%s: the file has a header, but no row: give one with values", path);
    }
    recording->ticks = status == TL_OK ? (last - recording->start + TL_PLANT_ALIKE) / config->step + 1 : 0;
    rows = rows <= GAPS_SEEN ? rows : GAPS_SEEN + 1;
    return status == TL_OK ? check_unit(path, config, &recording->form.clock, gaps, rows - 1, recording->ticks, error)
                           : status;
}

static void post_row(tl_recording *recording) {
    for (size_t i = 0; i < recording->input.count; i++) {
        if (recording->row.present[i]) {
            const tl_reading reading = {
                .value = recording->row.values[i],
                .stamp = recording->row.time,
                .quality = recording->row.quality[i],
            };
            post_reading(recording, i, &reading);
        }
    }
}

static tl_status next_from_csv(tl_recording *recording, tl_recording_tick *tick, tl_error *error) {
    tl_time instant = tl_time_of_step(recording->start, recording->config->step, recording->next);
    tl_time alike = recording->next > 0 ? TL_PLANT_ALIKE : 0; /* as in plant_input.c */
    for (;;) {
        if (!recording->row_waits) {
            bool end = false;
            tl_status status = tl_csv_next(recording->reader, &recording->row, &end, error);
            if (status != TL_OK) {
                return status;
            }
            if (end) {
                break;
            }
            recording->row_waits = true;
        }
        if (recording->row.time > instant + alike) {
            break;
        }
        post_row(recording);
        recording->row_waits = false;
    }
    memset(tick, 0, sizeof *tick);
    tl_plant_input_take(&recording->input, recording->next, instant, &tick->sample);
    return TL_OK;
}

/* ---- CSV and database ---- */

static bool is_database(const char *path) {
    static const char magic[16] = "SQLite format 3";
    char head[sizeof magic] = {0};
    FILE *file = fopen(path, "rb");
    if (file != NULL) {
        (void)!fread(head, 1, sizeof head, file);
        (void)fclose(file);
    }
    return memcmp(head, magic, sizeof magic) == 0;
}

tl_status tl_recording_open(const char *path, const tl_config *config, tl_recording **recording, tl_error *error) {
    struct stat about;
    if (stat(path, &about) == 0 && !S_ISREG(about.st_mode) && !S_ISDIR(about.st_mode)) {
        return tl_fail(
            error, TL_BAD_DATA,
            "%s: this is not a regular file (expected a recording: CSV or database); a FIFO is a live source "
            "for `twinlock run`",
            path);
    }
    bool from_database = is_database(path);
    if (config->recording_run != 0 && !from_database) {
        return tl_fail(error, TL_BAD_USAGE, "%s: this is not a database, so it has no run %lld: remove --run", path,
                       (long long)config->recording_run);
    }
    tl_recording *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", path);
    }
    (void)snprintf(opened->path, sizeof opened->path, "%s", path);
    opened->config = config;
    tl_status status = open_input(opened, error);
    if (status == TL_OK && from_database) {
        status = open_database(opened, path, error);
    } else if (status == TL_OK) {
        status = open_reader(path, config, config->signal_count, &opened->reader, error);
        status = status == TL_OK ? check_rows(opened, path, error) : status;
    }
    if (status != TL_OK) {
        tl_recording_close(opened);
        return status;
    }
    opened->next = opened->beginning.tick;
    *recording = opened;
    return TL_OK;
}

void tl_recording_log_form(const tl_recording *recording) {
    const tl_csv_form *form = &recording->form;
    char begin[TL_UTC_TEXT] = "";
    if (form->clock.is_guessed || form->clock.form == TL_CSV_TIME_ZONELESS) {
        tl_utc_text(recording->start / 1000000, begin);
    }
    if (form->files > 1) {
        tl_log(TL_LOG_NOTICE, "%s: %zu files, read in the order of their names", recording->path, form->files);
    }
    if (form->text[0] != '\0') {
        tl_log(TL_LOG_NOTICE, "%s: read with %s%s%s", recording->path, form->text, begin[0] != '\0' ? " from " : "",
               begin);
    }
    if (form->merged != 0) {
        tl_log(TL_LOG_NOTICE, "%s: %lld rows have the time of the row before; the later row counts", recording->path,
               (long long)form->merged);
    }
}

tl_recording_tunings tl_recording_get_tunings(const tl_recording *recording) {
    return recording->tunings;
}

void tl_recording_use_limits(tl_recording *recording) {
    tl_live_plant_set_limits(&recording->input, recording->config);
}

tl_recording_time tl_recording_get_time(const tl_recording *recording) {
    tl_recording_time time = recording->time;
    time.length = tl_time_of_step(0, recording->config->step, recording->ticks - 1);
    return time;
}

tl_recording_keep tl_recording_get_keep(const tl_recording *recording) {
    return recording->keep;
}

const tl_recording_beginning *tl_recording_get_beginning(const tl_recording *recording) {
    bool begins_at_0 = recording->beginning.tick == 0 && !recording->beginning.follows;
    return begins_at_0 ? NULL : &recording->beginning;
}

tl_status tl_recording_next(tl_recording *recording, tl_recording_tick *tick, bool *end, tl_error *error) {
    *end = recording->next >= recording->ticks;
    if (*end) {
        return TL_OK;
    }
    tl_status status = recording->history != NULL ? next_from_database(recording, tick, end, error)
                                                  : next_from_csv(recording, tick, error);
    recording->next++;
    return status;
}

void tl_recording_listen(tl_recording *recording, tl_recording_on_reading *on_event, void *context) {
    recording->on_reading = on_event;
    recording->listener = context;
}

int64_t tl_recording_ticks(const tl_recording *recording) {
    return recording->ticks;
}

void tl_recording_close(tl_recording *recording) {
    if (recording == NULL) {
        return;
    }
    tl_csv_close(recording->reader);
    tl_history_ticks_end(recording->walk);
    tl_history_close(recording->history);
    free(recording->tunings.list);
    free(recording->tunings.known);
    tl_plant_input_close(&recording->input);
    free(recording->sample_memory);
    free(recording);
}
