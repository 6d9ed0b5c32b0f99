/* The live plant: see live_plant.h. */
#include "firmware/plant/live_plant.h"

#include <arpa/inet.h>
#include <limits.h>
#include <stdint.h>
#include <stdlib.h>

#include "board/can/can.h"
#include "board/csv/csv.h"
#include "board/gpio/gpio.h"
#include "board/modbus/modbus.h"
#include "firmware/plant/plant_reader.h"

/* Resolving a host name cannot be interrupted and has time limits of its own. */
static const tl_time RESOLVE = 60 * TL_SECOND;

/* Time-outs of a Modbus poll between two readings: to connect, and for a request that the device refuses in three shapes. */
enum { MODBUS_WAITS = 4 };

/* Bits of the longest request and its response on a serial line. */
enum { LINE_BITS = 264 * 12 };

struct tl_live_plant {
    tl_plant_source *sources;
    size_t source_count;
    size_t (*signals)[TL_MAX_SIGNALS];  /* per source: channel → signal, */
    tl_time (*repeats)[TL_MAX_SIGNALS]; /* and for how long an equal value is the same reading */
    tl_plant_readers *readers;
    tl_mailbox mailboxes[TL_MAX_SIGNALS];
};

void tl_live_plant_set_limits(tl_plant_input *input, const tl_config *config) {
    input->count = config->signal_count;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        input->limits[i] = (tl_plant_limits){
            .minimum = signal->minimum,
            .maximum = signal->maximum,
            .stale = tl_time_of_seconds(signal->stale_s),
            .type = signal->plan.type,
        };
        input->looks[i] = (tl_plant_look){
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

static tl_status open_modbus(const tl_config *config, const tl_config_source *configured, tl_plant_source *source,
                             tl_error *error) {
    tl_modbus_channel channels[TL_MAX_SIGNALS];
    char path[PATH_MAX];
    for (size_t i = 0; i < source->signal_count; i++) {
        channels[i] = config->signals[source->signals[i]].modbus;
    }
    tl_modbus_line line = configured->line;
    line.device = NULL;
    if (configured->kind == TL_SOURCE_MODBUS_RTU) {
        tl_config_file_path(config, configured->line.device, path, sizeof path);
        line.device = path;
    }
    const tl_modbus_settings settings = {
        .host = configured->host,
        .port = configured->port,
        .any_unit_id = configured->any_unit_id,
        .line = line,
        .timeout_s = configured->timeout_s,
        .channels = channels,
        .channel_count = source->signal_count,
    };
    source->driver = &tl_modbus_driver;
    return tl_modbus_open(&settings, &source->io, error);
}

static tl_status open_csv(const tl_config *config, const tl_config_source *configured, tl_plant_source *source,
                          tl_error *error) {
    const char *columns[TL_MAX_SIGNALS];
    char path[PATH_MAX];
    for (size_t i = 0; i < source->signal_count; i++) {
        columns[i] = config->signals[source->signals[i]].column;
    }
    tl_config_file_path(config, configured->file, path, sizeof path);
    const tl_csv_settings settings = {
        .path = path,
        .time_column = configured->time_column,
        .columns = columns,
        .column_count = source->signal_count,
    };
    source->driver = &tl_csv_driver;
    return tl_csv_open_live(&settings, &source->io, error);
}

static tl_status open_can(const tl_config *config, const tl_config_source *configured, tl_plant_source *source,
                          tl_error *error) {
    tl_can_channel channels[TL_MAX_SIGNALS];
    for (size_t i = 0; i < source->signal_count; i++) {
        channels[i] = config->signals[source->signals[i]].can;
    }
    const tl_can_settings settings = {
        .interface = configured->interface, .channels = channels, .channel_count = source->signal_count};
    source->driver = &tl_can_driver;
    return tl_can_open(&settings, &source->io, error);
}

static tl_status open_gpio(const tl_config *config, const tl_config_source *configured, tl_plant_source *source,
                           tl_error *error) {
    tl_gpio_channel channels[TL_MAX_SIGNALS];
    for (size_t i = 0; i < source->signal_count; i++) {
        channels[i] = config->signals[source->signals[i]].gpio;
    }
    const tl_gpio_settings settings = {
        .chip = configured->chip,
        .period_s = configured->period_s,
        .channels = channels,
        .channel_count = source->signal_count,
    };
    source->driver = &tl_gpio_driver;
    return tl_gpio_open(&settings, &source->io, error);
}

static tl_status open_driver(const tl_config *config, const tl_config_source *configured, tl_plant_source *source,
                             tl_error *error) {
    switch (configured->kind) {
    case TL_SOURCE_MODBUS_TCP:
    case TL_SOURCE_MODBUS_RTU:
        return open_modbus(config, configured, source, error);
    case TL_SOURCE_CAN:
        return open_can(config, configured, source, error);
    case TL_SOURCE_GPIO:
        return open_gpio(config, configured, source, error);
    case TL_SOURCE_CSV:
        break;
    }
    return open_csv(config, configured, source, error);
}

static bool is_address(const char *host) {
    unsigned char address[sizeof(struct in6_addr)];
    return inet_pton(AF_INET, host, address) == 1 || inet_pton(AF_INET6, host, address) == 1;
}

/* How long a poll may wait for its device without a reading; other drivers wait at most for their period. */
static tl_time longest_wait(const tl_config_source *configured) {
    tl_time timeout = tl_time_of_seconds(configured->timeout_s);
    switch (configured->kind) {
    case TL_SOURCE_MODBUS_TCP:
        return MODBUS_WAITS * timeout + (is_address(configured->host) ? 0 : RESOLVE);
    case TL_SOURCE_MODBUS_RTU:
        return MODBUS_WAITS * (timeout + LINE_BITS * TL_SECOND / configured->line.baud);
    default:
        return 0;
    }
}

static tl_time patience_with(const tl_config *config, const tl_config_source *configured) {
    tl_time wait = longest_wait(configured);
    return (wait > config->realtime_hang ? wait : config->realtime_hang) + 2 * tl_time_of_seconds(configured->period_s);
}

/* Opens one configured source; one that no signal uses is left out. */
static tl_status open_source(tl_live_plant *plant, const tl_config *config, size_t index, tl_heartbeats *beats,
                             tl_error *error) {
    const tl_config_source *configured = &config->sources[index];
    tl_plant_source *source = &plant->sources[plant->source_count];
    size_t *signals = plant->signals[plant->source_count];
    tl_time *repeats = plant->repeats[plant->source_count];
    source->name = configured->name;
    source->signals = signals;
    source->signal_count = 0;
    source->period = tl_time_of_seconds(configured->period_s);
    source->repeats = repeats;
    for (size_t i = 0; i < config->signal_count; i++) {
        if (config->signals[i].source == index && config->signals[i].of == i) {
            repeats[source->signal_count] = tl_config_repeats(config, &config->signals[i]);
            signals[source->signal_count++] = i;
        }
    }
    if (source->signal_count == 0) {
        return TL_OK;
    }
    tl_status status = open_driver(config, configured, source, error);
    if (status == TL_OK) {
        source->heart = tl_heart_begin(beats, source->name, patience_with(config, configured));
        plant->source_count++;
    }
    return status;
}

/* Until the readers own them. */
static void close_sources(tl_live_plant *plant) {
    for (size_t i = 0; i < plant->source_count; i++) {
        plant->sources[i].driver->close(plant->sources[i].io);
    }
}

tl_status tl_live_plant_check(const tl_config *config, tl_error *error) {
    for (size_t i = 0; i < config->signal_count; i++) {
        if (config->signals[i].source == SIZE_MAX) {
            return tl_fail(
                error, TL_BAD_DATA,
                "%s: plant.%s has no live source: give it \"modbus\", \"can\", \"gpio\", or \"csv\" with a \"source\"; to "
                "run a recording use `twinlock replay`",
                config->path, config->signals[i].plan.name);
        }
    }
    return TL_OK;
}

static bool is_of(const tl_config *config, size_t source, unsigned kinds) {
    return (kinds & 1U << config->sources[source].kind) != 0;
}

static void take_mailboxes(tl_live_plant *plant, const tl_live_plant_settings *settings) {
    const tl_config *config = settings->config;
    for (size_t i = 0; i < config->signal_count; i++) {
        plant->mailboxes[i] = settings->mailboxes[i];
        if (is_of(config, config->signals[i].source, settings->kinds)) {
            tl_mailbox_mend(&settings->mailboxes[i]);
        }
    }
}

static tl_status open_all(tl_live_plant *plant, const tl_live_plant_settings *settings, tl_error *error) {
    const tl_config *config = settings->config;
    plant->sources = calloc(config->source_count, sizeof *plant->sources);
    plant->signals = calloc(config->source_count, sizeof *plant->signals);
    plant->repeats = calloc(config->source_count, sizeof *plant->repeats);
    if (plant->sources == NULL || plant->signals == NULL || plant->repeats == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the plant's sources");
    }
    for (size_t i = 0; i < config->source_count; i++) {
        tl_status status =
            is_of(config, i, settings->kinds) ? open_source(plant, config, i, settings->beats, error) : TL_OK;
        if (status != TL_OK) {
            close_sources(plant);
            return status;
        }
    }
    return tl_plant_readers_start(plant->sources, plant->source_count, plant->mailboxes, settings->on_link,
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
    take_mailboxes(opened, settings);
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
    free(plant->signals);
    free(plant->repeats);
    free(plant);
}
