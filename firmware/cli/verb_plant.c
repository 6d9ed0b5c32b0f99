/* twinlock plant: serves a recording or a plant model as an emulated plant. */
#include <inttypes.h>
#include <limits.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/cli/emulation.h"
#include "firmware/cli/plant_bus.h"
#include "firmware/cli/plant_server.h"
#include "firmware/cli/plant_stream.h"
#include "firmware/cli/verb_job.h"
#include "firmware/config/drivers.h"
#include "firmware/process/interrupt.h"

/* One Modbus server or CAN bus, and the columns of a row that supply its channels. */
typedef struct served_source {
    tl_plant_server *server; /* NULL: it is a CAN bus */
    tl_plant_bus *bus;
    size_t columns[TL_MAX_SIGNALS];
    size_t channel_count;
} served_source;

typedef struct player {
    tl_verb_job *job;
    tl_config listener; /* with --for: the configuration whose signals are served */
    tl_account account;
    tl_emulation *emulation;
    tl_plant_stream *stream;
    double scales[TL_MAX_SIGNALS], offsets[TL_MAX_SIGNALS]; /* of the stream's columns, as its reader applies them */
    served_source served[TL_MAX_SIGNALS];
    size_t served_count;
} player;

/* Opens the rows: from FMUs if the configuration has `emulate`, else from its recording. */
static tl_status open_emulation(player *self, const tl_config *config, tl_error *error) {
    char path[PATH_MAX];
    tl_verb_job *job = self->job;
    tl_status status = tl_options_find_recording(self->job->options, config, path, error);
    if (status != TL_OK) {
        return status;
    }
    if (config->emulated_count == 0) {
        return tl_emulation_open_recording(path, config, &self->emulation, error);
    }
    status = tl_verb_job_start(job, NULL);
    status = status == TL_OK ? tl_twin_child_build(job->child, &self->account, error) : status;
    if (status == TL_OK) {
        tl_config_use_bounds(&job->config, &self->account);
    }
    if (status != TL_OK) {
        return status;
    }
    const tl_twin_feed_settings model = {.config = config, .account = &self->account, .child = job->child};
    return tl_emulation_open_model(&model, path, self->job->options->seed, &self->emulation, error);
}

static size_t find_column(const tl_emulation *emulation, const char *name) {
    for (size_t i = 0; i < tl_emulation_column_count(emulation); i++) {
        if (strcmp(tl_emulation_column(emulation, i), name) == 0) {
            return i;
        }
    }
    return SIZE_MAX;
}

/* Finds the signals of one source and the columns that supply them. */
static tl_status find_signals(const player *self, const tl_config *listener, size_t index, served_source *served,
                              size_t *signals, tl_error *error) {
    served->channel_count = 0;
    for (size_t i = 0; i < listener->signal_count; i++) {
        const tl_config_signal *signal = &listener->signals[i];
        if (signal->source != index) {
            continue;
        }
        /* a recording has a column per signal; two signals may scale one column */
        const bool is_own = listener == &self->job->config && listener->emulated_count == 0;
        size_t column = is_own ? i : find_column(self->emulation, signal->column);
        if (column == SIZE_MAX) {
            return tl_fail(error, TL_BAD_DATA,
                           "plant.%s: this plant has no column \"%s\": correct the column, or give another --recording",
                           signal->plan.name, signal->column);
        }
        served->columns[served->channel_count] = column;
        signals[served->channel_count++] = i;
    }
    return TL_OK;
}

static bool is_modbus(const tl_config_source *source) {
    return strcmp(source->driver->name, "modbus_tcp") == 0;
}

static tl_status open_source(const player *self, const tl_config_source *source, const void *channels,
                             served_source *served, tl_error *error) {
    size_t count = served->channel_count;
    const char *plural = count == 1 ? "" : "s";
    if (is_modbus(source)) {
        const tl_modbus_settings *modbus = source->settings;
        const tl_plant_server_settings settings = {modbus->host, modbus->port, channels, count};
        tl_status status = tl_plant_server_start(&settings, &served->server, error);
        if (status == TL_OK) {
            tl_log(TL_LOG_NOTICE, "%s: %zu signal%s by Modbus TCP at %s:%u; playing starts with the first request",
                   source->name, count, plural, modbus->host, (unsigned)tl_plant_server_port(served->server));
        }
        return status;
    }
    const tl_can_settings *can = source->settings;
    const tl_plant_bus_settings settings = {can->interface, self->job->options->real_bus, channels, count};
    tl_status status = tl_plant_bus_open(&settings, &served->bus, error);
    if (status == TL_OK) {
        tl_log(TL_LOG_NOTICE, "%s: %zu signal%s by CAN at %s; playing starts at once", source->name, count, plural,
               can->interface);
    }
    return status;
}

/* --fifo writes the signals of a CSV source. */
static bool is_served(const tl_config_source *source) {
    const tl_modbus_settings *modbus = is_modbus(source) ? source->settings : NULL;
    const bool is_framed = modbus != NULL && modbus->rtu_framing;
    const char *not_played = is_framed ? "with framing rtu" : source->driver->not_played;
    if (not_played != NULL) {
        tl_log(TL_LOG_NOTICE, "%s: signals %s are not played", source->name, not_played);
    }
    return (modbus != NULL && !is_framed) || strcmp(source->driver->name, "can") == 0;
}

/* Serves one source of the listener. A source without signals is skipped. */
static tl_status serve_source(player *self, const tl_config *listener, size_t index, tl_error *error) {
    const tl_config_source *source = &listener->sources[index];
    served_source *served = &self->served[self->served_count];
    size_t signals[TL_MAX_SIGNALS];
    if (!is_served(source)) {
        return TL_OK;
    }
    tl_status status = find_signals(self, listener, index, served, signals, error);
    if (status != TL_OK || served->channel_count == 0) {
        return status;
    }
    void *channels = tl_driver_gather(source->driver, listener, signals, served->channel_count);
    status = channels != NULL ? open_source(self, source, channels, served, error)
                              : tl_fail(error, TL_TRY_AGAIN, "signals of %s: out of memory", source->name);
    free(channels);
    self->served_count += status == TL_OK ? 1 : 0;
    return status;
}

static tl_status open_servers(player *self, const tl_config *listener, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < listener->source_count && status == TL_OK; i++) {
        status = serve_source(self, listener, i, error);
    }
    if (status == TL_OK && self->served_count == 0) {
        return tl_fail(error, TL_BAD_USAGE,
                       "%s reads nothing by Modbus TCP or CAN: use --for CONFIG2, --fifo or --record", listener->path);
    }
    return status;
}

/* Finds the scale by which the listener reads a column. */
static void find_scale(const tl_config *listener, const char *column, double *scale, double *offset) {
    *scale = 1;
    *offset = 0;
    for (size_t i = 0; i < listener->signal_count; i++) {
        if (strcmp(listener->signals[i].column, column) == 0) {
            *scale = listener->signals[i].scale;
            *offset = listener->signals[i].offset;
            return;
        }
    }
}

static tl_status open_stream(player *self, const tl_config *listener, tl_error *error) {
    const char *columns[TL_MAX_SIGNALS];
    size_t count = tl_emulation_column_count(self->emulation);
    for (size_t i = 0; i < count; i++) {
        columns[i] = tl_emulation_column(self->emulation, i);
        find_scale(listener, columns[i], &self->scales[i], &self->offsets[i]);
    }
    const tl_plant_stream_settings settings = {
        .path = self->job->options->fifo != NULL ? self->job->options->fifo : self->job->options->record,
        .make_fifo = self->job->options->fifo != NULL,
        .time_column = listener->recording_time_column,
        .columns = columns,
        .column_count = count,
    };
    return tl_plant_stream_open(&settings, &self->stream, error);
}

static tl_status show_row(player *self, const tl_emulation_row *row, tl_error *error) {
    for (size_t i = 0; i < self->served_count; i++) {
        served_source *served = &self->served[i];
        double values[TL_MAX_SIGNALS];
        bool present[TL_MAX_SIGNALS];
        for (size_t k = 0; k < served->channel_count; k++) {
            values[k] = row->values[served->columns[k]];
            present[k] = row->present[served->columns[k]];
        }
        if (served->bus != NULL) {
            tl_plant_bus_row(served->bus, values, present);
        } else {
            tl_plant_server_set_all(served->server, values, present);
        }
    }
    if (self->stream == NULL) {
        return TL_OK;
    }
    double cells[TL_MAX_SIGNALS];
    for (size_t i = 0; i < tl_emulation_column_count(self->emulation); i++) {
        cells[i] = (row->values[i] - self->offsets[i]) / self->scales[i];
    }
    (void)tl_plant_stream_row(self->stream, row->time, cells, row->present);
    return tl_plant_stream_check(self->stream, error);
}

/* The first row stays until a client sends a request. On a CAN bus a listener cannot be detected,
 * so there is no wait. */
static void wait_for_listener(player *self) {
    while (self->served_count != 0 && tl_interrupt_requested() == NULL) {
        for (size_t i = 0; i < self->served_count; i++) {
            const served_source *served = &self->served[i];
            if (served->bus != NULL || tl_plant_server_count(served->server).requests != 0) {
                return;
            }
        }
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 1000);
    }
}

static tl_status play(player *self, tl_error *error) {
    bool end = false;
    uint64_t rows = 0;
    tl_emulation_row row;
    tl_progress progress;
    tl_status status = tl_emulation_next(self->emulation, &row, &end, error);
    tl_time started = tl_clock_now(NULL);
    tl_progress_begin(&progress, "row", 0);
    while (status == TL_OK && !end && tl_interrupt_requested() == NULL) {
        if (self->job->options->record == NULL && rows != 0) { /* --record writes the file at full speed */
            tl_clock_sleep_until(started + row.time);
        }
        if (tl_interrupt_requested() != NULL) {
            break;
        }
        status = show_row(self, &row, error);
        if (rows++ == 0) {
            wait_for_listener(self);
            started = tl_clock_now(NULL);
        }
        tl_progress_update(&progress, (int64_t)rows);
        if (status == TL_OK) {
            status = tl_emulation_next(self->emulation, &row, &end, error);
        }
    }
    tl_progress_end(&progress);
    if (status == TL_OK) {
        tl_log(TL_LOG_NOTICE, "%s after %" PRIu64 " rows",
               end && tl_interrupt_requested() == NULL ? "played to the end" : "stopped", rows);
    }
    return status;
}

static void close_all(player *self) {
    for (size_t i = 0; i < self->served_count; i++) {
        served_source *served = &self->served[i];
        if (served->bus != NULL) {
            tl_plant_bus_counts counts = tl_plant_bus_count(served->bus);
            tl_log(TL_LOG_NOTICE, "%" PRIu64 " frames sent, %" PRIu64 " that the interface did not take", counts.sent,
                   counts.dropped);
            tl_plant_bus_close(served->bus);
        } else {
            tl_plant_server_counts counts = tl_plant_server_count(served->server);
            tl_log(TL_LOG_NOTICE, "%" PRIu64 " requests answered, %" PRIu64 " attempts to write refused",
                   counts.requests, counts.refused_writes);
            tl_plant_server_stop(served->server);
        }
    }
    if (self->stream != NULL) {
        tl_plant_stream_counts counts = tl_plant_stream_count(self->stream);
        if (self->job->options->fifo != NULL) {
            tl_log(TL_LOG_NOTICE, "%" PRIu64 " rows written, %" PRIu64 " dropped without a reader", counts.written,
                   counts.dropped);
        } else {
            tl_log(TL_LOG_NOTICE, "%" PRIu64 " rows written", counts.written);
        }
        tl_plant_stream_close(self->stream);
    }
    tl_emulation_close(self->emulation);
}

static tl_status run(player *self, const tl_config *config, const tl_config *listener, tl_error *error) {
    bool writes = self->job->options->fifo != NULL || self->job->options->record != NULL;
    tl_status status = open_emulation(self, config, error);
    if (status == TL_OK) {
        status = writes ? open_stream(self, listener, error) : open_servers(self, listener, error);
    }
    return status == TL_OK ? play(self, error) : status;
}

/* Reads the configuration of the listener if --for names another one, then plays. */
static tl_status run_for_listener(player *self, const tl_config *config, tl_error *error) {
    if (self->job->options->listener == NULL) {
        return run(self, config, config, error);
    }
    tl_problems problems;
    tl_problems_init(&problems, self->job->options->listener);
    tl_status status = tl_config_read(self->job->options->listener, &self->listener, &problems.report);
    if (status != TL_OK) {
        return tl_fail(error, status, "--for %s: invalid configuration, see the errors above",
                       self->job->options->listener);
    }
    status = run(self, config, &self->listener, error);
    tl_config_free(&self->listener);
    return status;
}

int tl_verb_plant(const tl_options *options) {
    tl_verb_job job = {.options = options, .order = {.task = TL_TASK_STEP, .attached = TL_ATTACHED_OUTPUTS}};
    player self = {.job = &job};
    tl_status status = tl_verb_job_read(&job, options->subject, NULL);
    if (status == TL_OK) {
        status = run_for_listener(&self, &job.config, &job.error);
        close_all(&self);
    }
    return tl_verb_job_end(&job, status);
}
