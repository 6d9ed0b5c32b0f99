/* Emulated plant: see emulation.h. */
#include "firmware/cli/emulation.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "board/csv/csv.h"
#include "firmware/plant/recording.h"

/* ---- noise ---- */

static uint64_t next(tl_random *noise) {
    noise->state += UINT64_C(0x9e3779b97f4a7c15);
    uint64_t mixed = noise->state;
    mixed = (mixed ^ (mixed >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    mixed = (mixed ^ (mixed >> 27)) * UINT64_C(0x94d049bb133111eb);
    return mixed ^ (mixed >> 31);
}

double tl_random_uniform(tl_random *noise) {
    return (double)(next(noise) >> 11) * 0x1p-53;
}

double tl_random_normal(tl_random *noise) {
    for (;;) {
        double a = 2.0 * tl_random_uniform(noise) - 1.0;
        double b = 2.0 * tl_random_uniform(noise) - 1.0;
        double square = a * a + b * b;
        if (square > 0.0 && square < 1.0) {
            return a * sqrt(-2.0 * log(square) / square);
        }
    }
}

/* ---- emulation ---- */

struct tl_emulation {
    size_t column_count;
    const char *columns[TL_MAX_SIGNALS];
    /* from a recording */
    tl_csv_reader *reader;
    tl_time first; /* time of its first row */
    bool has_begun;
    /* from FMUs */
    const tl_config *config;
    tl_recording *driving;
    tl_twin_feed *feed;
    tl_recording_tick tick;         /* newest tick that was stepped */
    double outputs[TL_MAX_SIGNALS]; /* and its outputs */
    tl_random noise;
    tl_time next_message;
};

/* ---- from a recording ---- */

tl_status tl_emulation_open_recording(const char *path, const tl_config *config, tl_emulation **emulation,
                                      tl_error *error) {
    tl_emulation *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    tl_csv_column columns[TL_MAX_SIGNALS];
    opened->column_count = config->signal_count;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        opened->columns[i] = signal->column;
        columns[i] = (tl_csv_column){.name = signal->column, .scale = signal->scale, .offset = signal->offset};
    }
    const tl_csv_settings settings = {
        .path = path,
        .time_column = config->recording_time_column,
        .columns = columns,
        .column_count = opened->column_count,
    };
    tl_status status = tl_csv_open(&settings, &opened->reader, error);
    if (status != TL_OK) {
        free(opened);
        return status;
    }
    *emulation = opened;
    return TL_OK;
}

static tl_status next_recorded(tl_emulation *emulation, tl_emulation_row *row, bool *end, tl_error *error) {
    tl_csv_row read;
    tl_status status = tl_csv_next(emulation->reader, &read, end, error);
    if (status != TL_OK || *end) {
        return status;
    }
    if (!emulation->has_begun) {
        emulation->has_begun = true;
        emulation->first = read.time;
    }
    row->time = read.time - emulation->first;
    for (size_t i = 0; i < emulation->column_count; i++) {
        row->values[i] = read.values[i];
        row->present[i] = read.present[i] && read.quality[i] == TL_GOOD;
    }
    return TL_OK;
}

/* ---- from FMUs ---- */

tl_status tl_emulation_open_model(const tl_twin_feed_settings *model, const char *driving, uint64_t seed,
                                  tl_emulation **emulation, tl_error *error) {
    const tl_config *config = model->config;
    tl_emulation *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "emulated plant: out of memory");
    }
    tl_status status = tl_recording_open(driving, config, &opened->driving, error);
    if (status == TL_OK) {
        tl_twin_feed_settings settings = *model;
        settings.recording = opened->driving;
        settings.plant = true;
        status = tl_twin_feed_open(&settings, &opened->feed, error);
    }
    if (status != TL_OK) {
        tl_emulation_close(opened);
        return status;
    }
    opened->config = config;
    opened->noise.state = seed;
    opened->tick.sample.tick = -1;
    opened->column_count = config->emulated_count;
    for (size_t i = 0; i < config->emulated_count; i++) {
        opened->columns[i] = config->emulated[i].column;
    }
    *emulation = opened;
    return TL_OK;
}

/* Steps the plant up to the newest tick at or before `time`. */
static tl_status advance(tl_emulation *emulation, tl_time time, bool *end, tl_error *error) {
    const tl_config *config = emulation->config;
    int64_t wanted = time / config->step;
    *end = config->duration != 0 && time > config->duration;
    while (!*end && emulation->tick.sample.tick < wanted) {
        tl_twin_fed fed = {0};
        tl_status status = tl_twin_feed_next(emulation->feed, &fed, end, error);
        if (status != TL_OK) {
            return status;
        }
        if (fed.result != NULL) {
            emulation->tick = *fed.tick;
            memcpy(emulation->outputs, fed.result->attached.outputs, config->emulated_count * sizeof(double));
        }
    }
    return TL_OK;
}

/* The plan's outputs are the emulated variables in their order, without those that are signals of
 * the plant. */
static double read_column(const tl_emulation *emulation, size_t column, size_t *output) {
    const tl_config *config = emulation->config;
    const char *from = config->emulated[column].from;
    size_t signal = tl_config_signal_of(config, from);
    return signal != SIZE_MAX ? emulation->tick.sample.values[signal] : emulation->outputs[(*output)++];
}

static tl_status next_modelled(tl_emulation *emulation, tl_emulation_row *row, bool *end, tl_error *error) {
    const tl_config *config = emulation->config;
    tl_status status = advance(emulation, emulation->next_message, end, error);
    if (status != TL_OK || *end) {
        return status;
    }
    size_t output = 0;
    row->time = emulation->next_message;
    for (size_t i = 0; i < emulation->column_count; i++) {
        row->values[i] = read_column(emulation, i, &output);
        if (config->emulated[i].noise > 0.0) {
            row->values[i] += config->emulated[i].noise * tl_random_normal(&emulation->noise);
        }
        row->present[i] = true;
    }
    double interval = tl_seconds(config->step);
    if (config->message_max_s > 0.0) {
        double spread = config->message_max_s - config->message_min_s;
        /* Whole microseconds, so that a recording stores the time exactly. */
        interval = floor((config->message_min_s + spread * tl_random_uniform(&emulation->noise)) * 1e6) / 1e6;
    }
    emulation->next_message += tl_time_of_seconds(interval);
    return TL_OK;
}

/* ---- both ---- */

size_t tl_emulation_column_count(const tl_emulation *emulation) {
    return emulation->column_count;
}

const char *tl_emulation_column(const tl_emulation *emulation, size_t column) {
    return emulation->columns[column];
}

tl_status tl_emulation_next(tl_emulation *emulation, tl_emulation_row *row, bool *end, tl_error *error) {
    return emulation->reader != NULL ? next_recorded(emulation, row, end, error)
                                     : next_modelled(emulation, row, end, error);
}

void tl_emulation_close(tl_emulation *emulation) {
    if (emulation == NULL) {
        return;
    }
    tl_csv_close(emulation->reader);
    tl_twin_feed_close(emulation->feed);
    tl_recording_close(emulation->driving);
    free(emulation);
}
