/* Live plant: see live_plant.h. */
#include "firmware/plant/live_plant.h"

#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/config/drivers.h"
#include "firmware/plant/plant_reader.h"

struct tl_live_plant {
    tl_plant_source *sources;
    size_t source_count;
    tl_plant_readers *readers;
    tl_sample_buffer buffers[TL_MAX_SIGNALS]; /* handles of the readers */
};

static tl_plant_limits limits_of(const tl_config_signal *signal) {
    return (tl_plant_limits){
        .minimum = signal->minimum,
        .maximum = signal->maximum,
        .below = signal->below,
        .above = signal->above,
        .items = signal->items,
        .stale = tl_time_of_seconds(signal->stale_s),
        .type = signal->plan.type,
    };
}

void tl_live_plant_apply_bounds(const tl_config *config, tl_sample *sample) {
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_plant_limits limits = limits_of(&config->signals[i]);
        bool moved = false;
        if (!config->signals[i].is_declared || sample->quality[i] != TL_GOOD) {
            continue;
        }
        if (!tl_plant_limits_apply(&limits, &sample->values[i], &moved)) {
            sample->quality[i] = TL_OUT_OF_RANGE;
        }
        sample->moved |= moved ? UINT64_C(1) << i : 0;
    }
}

void tl_live_plant_set_limits(tl_plant_input *input, const tl_config *config) {
    input->count = config->signal_count;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        input->limits[i] = limits_of(signal);
        input->looks[i] = (tl_plant_lookup){
            .back = signal->look_back,
            .next = signal->next,
            .between = signal->between,
            .span = config->step,
            .shows = signal->is_reading,
            .shown = signal->shows,
        };
        input->conditions[i] = signal->condition;
    }
}

static tl_status open_driver(const tl_config *config, const tl_config_source *configured, const tl_source_reach *reach,
                             tl_plant_source *source, tl_error *error) {
    const tl_driver *row = configured->driver;
    const char *file = reach->read != NULL ? reach->read : reach->write;
    char path[PATH_MAX] = "";
    void *channels = tl_driver_gather(row, config, source->signals, source->signal_count);
    if (channels == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the plant's sources");
    }
    if (file != NULL) {
        (void)tl_config_file_path(config, file, path, sizeof path);
    }
    source->driver = row->io;
    tl_status status =
        row->open(configured, file != NULL ? path : NULL, channels, source->signal_count, &source->io, error);
    free(channels);
    return status;
}

/* True if a poll can end before each tick, or before every n-th tick. */
static bool is_phased(const tl_config_source *source, tl_time step) {
    tl_time period = tl_time_of_seconds(source->period_s);
    return source->driver->is_polled && (period % step == 0 || step % period == 0);
}

/* Opens one configured source; skips it if no signal uses it. */
static tl_status open_source(tl_live_plant *plant, const tl_live_plant_settings *settings, size_t index,
                             tl_error *error) {
    const tl_config *config = settings->config;
    const tl_config_source *configured = &config->sources[index];
    tl_plant_source *source = &plant->sources[plant->source_count];
    *source = (tl_plant_source){.name = configured->name,
                                .period = tl_time_of_seconds(configured->period_s),
                                .run_start = is_phased(configured, config->step) ? settings->run_start : NULL};
    for (size_t i = 0; i < config->signal_count; i++) {
        if (config->signals[i].source == index && config->signals[i].of == i) {
            source->repeats[source->signal_count] = tl_config_repeats(config, &config->signals[i]);
            source->signals[source->signal_count++] = i;
        }
    }
    if (source->signal_count == 0) {
        return TL_OK;
    }
    tl_source_reach reach = {.wait = 0};
    if (configured->driver->reach != NULL) {
        configured->driver->reach(configured, &reach);
    }
    tl_status status = open_driver(config, configured, &reach, source, error);
    if (status == TL_OK) {
        tl_time hang = reach.wait > config->realtime_hang ? reach.wait : config->realtime_hang;
        source->heartbeat = tl_thread_heartbeat_start(settings->beats, source->name, hang + 2 * source->period);
        plant->source_count++;
    }
    return status;
}

/* Lists the keys that give a signal a live source: "csv" with a "source", "modbus", … */
static void list_signal_keys(char *text, size_t size) {
    size_t used = 0;
    for (const tl_driver *const *row = tl_drivers; *row != NULL && used < size; row++) {
        if ((*row)->read_signal != NULL) {
            used += (size_t)snprintf(text + used, size - used, "%s\"%s\"%s", used == 0 ? "" : ", ", (*row)->signal_key,
                                     (*row)->source_is_optional ? " with a \"source\"" : "");
        }
    }
}

tl_status tl_live_plant_check(const tl_config *config, tl_error *error) {
    for (size_t i = 0; i < config->signal_count; i++) {
        if (config->signals[i].source == SIZE_MAX) {
            char keys[128];
            list_signal_keys(keys, sizeof keys);
            return tl_fail(error, TL_BAD_DATA,
                           "%s: plant.%s has no live source: add one of %s; to run a recording use `twinlock replay`",
                           config->path, config->signals[i].plan.name, keys);
        }
    }
    return TL_OK;
}

static bool is_of(const tl_config *config, size_t source, unsigned kinds) {
    return (kinds & tl_driver_bit(config->sources[source].driver)) != 0;
}

static void take_buffers(tl_live_plant *plant, const tl_live_plant_settings *settings) {
    const tl_config *config = settings->config;
    for (size_t i = 0; i < config->signal_count; i++) {
        plant->buffers[i] = settings->buffers[i];
        if (is_of(config, config->signals[i].source, settings->kinds)) {
            tl_sample_buffer_repair(&settings->buffers[i]);
        }
    }
}

static tl_status open_all(tl_live_plant *plant, const tl_live_plant_settings *settings, tl_error *error) {
    const tl_config *config = settings->config;
    plant->sources = calloc(config->source_count, sizeof *plant->sources);
    if (plant->sources == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the plant's sources");
    }
    for (size_t i = 0; i < config->source_count; i++) {
        tl_status status = is_of(config, i, settings->kinds) ? open_source(plant, settings, i, error) : TL_OK;
        if (status != TL_OK) { /* the readers do not own the sources yet */
            for (size_t k = 0; k < plant->source_count; k++) {
                plant->sources[k].driver->close(plant->sources[k].io);
            }
            return status;
        }
    }
    return tl_plant_readers_start(plant->sources, plant->source_count, plant->buffers, settings->on_link,
                                  settings->context, &plant->readers, error);
}

tl_status tl_live_plant_open(const tl_live_plant_settings *settings, tl_live_plant **plant, tl_error *error) {
    tl_status status = tl_live_plant_check(settings->config, error);
    if (status != TL_OK) {
        return status;
    }
    tl_live_plant *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the plant");
    }
    take_buffers(opened, settings);
    status = open_all(opened, settings, error);
    if (status != TL_OK) {
        opened->readers = NULL;
        tl_live_plant_close(opened);
        return status;
    }
    *plant = opened;
    return TL_OK;
}

void tl_live_plant_close(tl_live_plant *plant) {
    if (plant == NULL) {
        return;
    }
    if (plant->readers != NULL) {
        tl_plant_readers_stop(plant->readers);
    }
    free(plant->sources);
    free(plant);
}
