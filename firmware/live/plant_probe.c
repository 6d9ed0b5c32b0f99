/* Plant probe: see plant_probe.h. It is the reader of the process's samples and events. */
#include "firmware/live/plant_probe.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/relay.h"
#include "firmware/live/live_blocks.h"
#include "firmware/live/live_role.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/role.h"

/* Pause between two looks; longest time in which the process ends, as in a run (supervisor.h). */
static const tl_time PAUSE = TL_SECOND / 20;
static const tl_time ENDING = TL_SECOND;

/* The events name a reader of their queue only if a run is recorded. */
static const char RECORDED[] = "probe";

typedef struct probing {
    const tl_plant_probe_settings *settings;
    tl_plant_probe *probe;
    tl_live_job job;
    tl_block blocks[TL_LIVE_BLOCKS];
    tl_block samples;     /* the sample memory, mapped for reading: its maker does not map a sparse block */
    tl_plant_input input; /* only its limits and buffers */
    uint64_t next[TL_MAX_SIGNALS];
    tl_record_queue_reader events;
    tl_relay log;
    tl_role io;
    bool is_open;  /* the process has opened its sources */
    tl_time began; /* since then; before: since its start */
} probing;

/* ---- readings ---- */

static void note_reading(probing *self, size_t index, tl_reading reading) {
    const tl_plant_probe_settings *settings = self->settings;
    tl_plant_probe_signal *signal = &self->probe->signals[index];
    bool moved = false;
    if (reading.quality == TL_GOOD && settings->convert != NULL) {
        settings->convert(settings->context, index, &reading);
    }
    if (reading.quality == TL_GOOD && !isfinite(reading.value)) {
        reading.quality = TL_NOT_A_NUMBER;
    }
    const bool has_value = reading.quality == TL_GOOD;
    if (has_value && !tl_plant_limits_apply(&self->input.limits[index], &reading.value, &moved)) {
        reading.quality = TL_OUT_OF_RANGE;
    }
    signal->rejected += reading.quality == TL_OUT_OF_RANGE || reading.quality == TL_NOT_A_NUMBER ? 1 : 0;
    if (has_value) {
        signal->has_changed =
            signal->has_changed ||
            (signal->readings > 0 && !(reading.value <= signal->last.value && reading.value >= signal->last.value));
        signal->readings++;
    } else {
        reading.value = signal->last.value; /* for the next comparison */
    }
    signal->last = reading;
}

static void take_readings(probing *self) {
    for (size_t i = 0; i < self->settings->config->own_count; i++) {
        tl_reading reading;
        while (tl_sample_buffer_next(&self->input.buffers[i], INT64_MAX, &self->next[i], &reading)) {
            note_reading(self, i, reading);
        }
    }
}

static void note_ages(probing *self) {
    const tl_time now = tl_clock_now(NULL);
    for (size_t i = 0; i < self->settings->config->own_count; i++) {
        tl_plant_probe_signal *signal = &self->probe->signals[i];
        const tl_time stale = self->input.limits[i].stale;
        const tl_time stamp = signal->last.stamp;
        signal->age = stamp > 0 && stamp < now ? now - stamp : 0;
        if (signal->last.quality == TL_GOOD && stale > 0 && signal->age > stale) {
            signal->last.quality = TL_STALE;
        }
    }
}

/* ---- messages ---- */

/* A first problem may cause the next ones: the rows after a wrong header are no header either. */
static void note_message(tl_plant_probe_signal *signal, tl_severity severity, const char *message) {
    char *text = signal->cause[0] == '\0' ? signal->cause : signal->later;
    if (severity == TL_EVENT_INFO) {
        signal->cause[0] = '\0';
        signal->later[0] = '\0';
    } else if (strcmp(signal->cause, message) != 0) {
        (void)snprintf(text, TL_EVENT_TEXT, "%s", message);
    }
}

/* A message of a source begins with its name. */
static void note_event(probing *self, const tl_recorder_event_entry *event) {
    const tl_plant_probe_settings *settings = self->settings;
    for (size_t i = 0; i < settings->config->own_count; i++) {
        const char *source = settings->config->sources[settings->config->signals[i].source].name;
        const char *message = event->text + strlen(source) + 2;
        if (strncmp(event->text, source, strlen(source)) == 0 && strncmp(message - 2, ": ", 2) == 0 &&
            (settings->concerns == NULL || settings->concerns(settings->context, i, message))) {
            note_message(&self->probe->signals[i], event->severity, message);
        }
    }
}

static void take_events(probing *self) {
    tl_live_recorder_status *status = self->blocks[TL_LIVE_RECORDER_STATUS].bytes;
    uint64_t *taken = &status->state.taken[TL_LIVE_QUEUE_IO].events;
    tl_recorder_event_entry event;
    bool skip = false;
    while (tl_record_queue_reader_event(&self->events, *taken, &event, &skip)) {
        if (!skip) {
            note_event(self, &event);
        }
        __atomic_store_n(taken, *taken + 1, __ATOMIC_RELEASE);
    }
}

/* Events are in the log of the process too; only its failures are passed on. */
static void pass_failure(void *context, const char *line) {
    (void)context;
    const char *text = NULL;
    const int level = tl_log_level_of(line, &text);
    if (level == TL_LOG_ERROR) {
        tl_log(TL_LOG_ERROR, "%s", text);
    } else if (level == TL_LOG_FOREIGN && line[0] != '\0') {
        tl_log_plain(text);
    }
}

static void take_all(probing *self) {
    (void)tl_relay_drain(&self->log);
    take_readings(self);
    take_events(self);
}

/* ---- the process ---- */

static tl_status make_memory(probing *self, tl_error *error) {
    static const struct {
        int number;
        const char *name;
        tl_block_writer writer;
    } blocks[] = {
        {TL_LIVE_SAMPLES, "twinlock samples", TL_BLOCK_SPARSE},
        {TL_LIVE_IO_BEATS, "twinlock io", TL_BLOCK_THEY_WRITE},
        {TL_LIVE_IO_EVENTS, "twinlock events", TL_BLOCK_THEY_WRITE},
        {TL_LIVE_RECORDER_STATUS, "twinlock probe", TL_BLOCK_WE_WRITE},
        {TL_LIVE_TWIN_STATUS, "twinlock twin", TL_BLOCK_WE_WRITE},
        {TL_LIVE_TWIN_STATUS + 1, "twinlock twin", TL_BLOCK_WE_WRITE},
    };
    const tl_config *config = self->settings->config;
    const tl_record_queue_settings events = tl_live_event_queue();
    size_t sizes[TL_LIVE_BLOCKS];
    tl_sample_buffers_shape shape;
    tl_status status = TL_OK;
    tl_live_block_sizes(config, sizes);
    for (size_t i = 0; i < sizeof blocks / sizeof blocks[0] && status == TL_OK; i++) {
        status = tl_block_make(blocks[i].name, sizes[blocks[i].number], blocks[i].writer,
                               &self->blocks[blocks[i].number], error);
    }
    if (status == TL_OK) {
        status = tl_block_take(tl_block_reader(&self->blocks[TL_LIVE_SAMPLES]), sizes[TL_LIVE_SAMPLES],
                               TL_BLOCK_WE_WRITE, &self->samples, error);
    }
    if (status == TL_OK) {
        tl_sample_buffers_shape_of(config, &shape);
        tl_live_plant_set_limits(&self->input, config);
        tl_sample_buffers_open(&shape, self->samples.bytes, self->input.buffers);
        tl_record_queue_reader_open(&events, self->blocks[TL_LIVE_IO_EVENTS].bytes, &self->events);
    }
    return status;
}

/* Starts the process; its log goes to `output`, the write end of a pipe. */
static tl_status start_process(probing *self, int output, tl_error *error) {
    const tl_config *config = self->settings->config;
    const tl_live_role_settings settings = {
        .kind = TL_LIVE_IS_IO,
        .job = &self->job,
        .name = config->name,
        .path = config->path,
        .text = self->settings->text,
        .blocks = self->blocks,
        .output = output,
        .client = -1,
        .run_role = self->settings->run_role,
    };
    return tl_live_role_start(&settings, &self->io, error);
}

static bool are_all_known(const probing *self) {
    bool known = true;
    for (size_t i = 0; i < self->settings->config->own_count; i++) {
        const tl_plant_probe_signal *signal = &self->probe->signals[i];
        known = known && (signal->readings > 0 || signal->rejected > 0 || signal->cause[0] != '\0');
    }
    return known;
}

static bool is_over(probing *self) {
    const tl_time now = tl_clock_now(NULL);
    if (!self->is_open && tl_heartbeats_is_ready(self->blocks[TL_LIVE_IO_BEATS].bytes)) {
        self->is_open = true;
        self->began = now;
    }
    return tl_interrupt_requested() != NULL || tl_role_watch(&self->io) ||
           (self->settings->is_brief && are_all_known(self)) || now - self->began >= self->settings->duration;
}

/* Reads until the end of the probe. Errors: the process has failed. */
static tl_status read_plant(probing *self, tl_error *error) {
    self->began = tl_clock_now(NULL);
    while (!is_over(self)) {
        take_all(self);
        tl_clock_sleep_until(tl_clock_now(NULL) + (self->is_open ? PAUSE : PAUSE / 10));
    }
    take_all(self);
    note_ages(self);
    self->probe->lasted = tl_clock_now(NULL) - self->began;
    return !self->io.has_ended ? TL_OK
                               : tl_fail(error, TL_PLANT_DOWN, "the process that reads the plant ended by %s %d",
                                         self->io.signal != 0 ? "signal" : "exit code",
                                         self->io.signal != 0 ? self->io.signal : self->io.code);
}

static void end_process(probing *self) {
    const tl_time asked = tl_clock_now(NULL);
    if (self->io.pid != 0) {
        (void)kill(self->io.pid, SIGTERM);
    }
    while (self->io.pid != 0 && !tl_role_watch(&self->io) && tl_clock_now(NULL) - asked < ENDING) {
        (void)tl_relay_drain(&self->log); /* a full pipe would block it */
        tl_clock_sleep_until(tl_clock_now(NULL) + PAUSE / 10);
    }
    tl_role_kill(&self->io);
    (void)tl_relay_drain(&self->log);
}

tl_status tl_plant_probe_run(const tl_plant_probe_settings *settings, tl_plant_probe *probe, tl_error *error) {
    static probing self; /* static, because it is too large for the stack */
    int ends[2];
    memset(probe, 0, sizeof *probe);
    memset(&self, 0, sizeof self);
    self.settings = settings;
    self.probe = probe;
    (void)snprintf(self.job.database, sizeof self.job.database, "%s", RECORDED);
    for (size_t i = 0; i < settings->config->own_count; i++) {
        probe->signals[i].last.quality = TL_NO_LINK;
    }
    tl_status status = tl_live_plant_check(settings->config, error);
    if (status != TL_OK) {
        return status;
    }
    if (pipe2(ends, O_CLOEXEC) != 0) {
        return tl_fail(error, TL_TRY_AGAIN, "no pipe for the log of a process: %s", strerror(errno));
    }
    tl_relay_open(&self.log, ends[0], pass_failure, NULL);
    status = make_memory(&self, error);
    status = status == TL_OK ? start_process(&self, ends[1], error) : status;
    (void)close(ends[1]);
    if (status == TL_OK) {
        status = read_plant(&self, error);
        end_process(&self);
    }
    tl_relay_close(&self.log);
    tl_block_close(&self.samples);
    for (size_t i = 0; i < TL_LIVE_BLOCKS; i++) {
        tl_block_close(&self.blocks[i]);
    }
    return status;
}
