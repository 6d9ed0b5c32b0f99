/* The process that records: SQLite, and nothing else. See live_role.h. */
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_places.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_wire.h"
#include "firmware/process/interrupt.h"
#include "firmware/run/past_history.h"
#include "firmware/twin/twin_recorder.h"

/* Between two looks: while a twin may ask for a past, and later. */
static const tl_time LOOK_SOON = TL_SECOND / 500;
static const tl_time LOOK = TL_SECOND / 20;

/* A worn-out memory card takes its time for one commit; so may the database of years to be opened. */
static const tl_time PATIENCE = 60 * TL_SECOND;

/* For what is left at the end, with a disk that refuses. */
static const tl_time PATIENCE_AT_END = 2 * TL_SECOND;

typedef struct recorder {
    tl_block job_block;
    tl_live_job job;
    tl_config config;
    tl_block pulse;
    tl_block past;
    tl_block twin_pulse;
    tl_block twin_outbox;
    tl_block io_pulse;
    tl_block supervisor;
    tl_live_recorder_pulse *own;
    const tl_live_twin_pulse *twin;
    tl_recorder_writer *writer;
    tl_past_finder *finder; /* NULL: not asked yet, or not any more */
    tl_live_wish answered;
} recorder;

/* ---- shared memory ---- */

static tl_status take_memory(recorder *self, tl_error *error) {
    const tl_outbox_settings events = tl_live_event_outbox();
    tl_status status = tl_live_job_take(TL_LIVE_JOB, &self->job_block, &self->job, &self->config, error);
    if (status != TL_OK) {
        return status;
    }
    const tl_outbox_settings twin = tl_live_twin_outbox(&self->config);
    const struct {
        int descriptor;
        size_t size;
        tl_block_writer writer;
        tl_block *block;
    } wanted[] = {
        {TL_LIVE_OWN_PULSE, sizeof *self->own, TL_BLOCK_THEY_WRITE, &self->pulse},
        {TL_LIVE_PAST, TL_LIVE_PAST_BYTES, TL_BLOCK_THEY_WRITE, &self->past},
        {TL_LIVE_TWIN_PULSE_READ, sizeof *self->twin, TL_BLOCK_WE_WRITE, &self->twin_pulse},
        {TL_LIVE_TWIN_OUTBOX, tl_outbox_bytes(&twin), TL_BLOCK_WE_WRITE, &self->twin_outbox},
        {TL_LIVE_IO_PULSE_READ, tl_live_io_bytes(), TL_BLOCK_WE_WRITE, &self->io_pulse},
        {TL_LIVE_SUPERVISOR_READ, tl_outbox_bytes(&events), TL_BLOCK_WE_WRITE, &self->supervisor},
    };
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0] && status == TL_OK; i++) {
        status = tl_block_take(wanted[i].descriptor, wanted[i].size, wanted[i].writer, wanted[i].block, error);
    }
    self->own = self->pulse.bytes;
    self->twin = self->twin_pulse.bytes;
    return status;
}

static tl_status open_writer(recorder *self, tl_error *error) {
    const tl_outbox_settings events = tl_live_event_outbox();
    const tl_recorder_writer_outbox outboxes[TL_LIVE_OUTBOXES] = {
        [TL_LIVE_OUTBOX_TWIN] = {"the twin", tl_live_twin_outbox(&self->config), self->twin_outbox.bytes},
        [TL_LIVE_OUTBOX_IO] = {"io", events, tl_live_io_outbox_of(self->io_pulse.bytes)},
        [TL_LIVE_OUTBOX_SUPERVISOR] = {"the supervisor", events, self->supervisor.bytes},
    };
    char fmus[TL_SHA256_TEXT];
    char boot[TL_IDENTITY_TEXT];
    char format[TL_IDENTITY_TEXT];
    tl_twin_recorder_identify(&self->config, fmus);
    tl_identity_boot(boot);
    tl_identity_format(format);
    const tl_recorder_writer_settings settings = {
        .config = &self->config,
        .record = {.path = self->job.database,
                   .max_bytes = self->config.record_max_bytes,
                   .commit = self->config.record_commit,
                   .fmus = fmus,
                   .boot = boot,
                   .format = format,
                   .beats = &self->own->beats},
        .outboxes = outboxes,
        .outbox_count = TL_LIVE_OUTBOXES,
        .state = &self->own->state,
        .alone = self->job.alone,
    };
    return tl_recorder_writer_open(&settings, &self->writer, error);
}
