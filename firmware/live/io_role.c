/* The process that reads the plant: drivers, sockets, devices; no FMU, no database. See live_role.h. */
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_places.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_wire.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/run/journal.h"

static const tl_time LOOK = TL_SECOND / 20;

/* How long the main thread may be silent while it opens or closes the sources. */
static const tl_time PATIENCE = 30 * TL_SECOND;

typedef struct io {
    tl_block job_block;
    tl_live_job job;
    tl_config config;
    tl_block mail;
    tl_block pulse;
    tl_block recorder;
    tl_plant_mail_shape shape;
    tl_heartbeats *beats;
    tl_outbox outbox;
    tl_journal journal;
    tl_live_plant *plant;
} io;

static void on_link(void *context, const char *source, bool up, const char *text) {
    io *self = context;
    tl_journal_event(&self->journal, -1, up ? TL_EVENT_INFO : TL_EVENT_WARNING, "plant", "%s: %s", source, text);
}

/* Without a recorder nobody takes the events; they are logged all the same. */
static tl_status take_memory(io *self, tl_error *error) {
    const tl_outbox_settings events = tl_live_event_outbox();
    const tl_live_recorder_pulse *recorder = NULL;
    tl_status status = tl_live_job_take(TL_LIVE_JOB, &self->job_block, &self->job, &self->config, error);
    if (status != TL_OK) {
        return status;
    }
    tl_plant_mail_shape_of(&self->config, &self->shape);
    status = tl_block_take(TL_LIVE_MAIL, tl_live_mail_bytes(&self->shape), TL_BLOCK_THEY_WRITE, &self->mail, error);
    if (status == TL_OK) {
        status = tl_block_take(TL_LIVE_OWN_PULSE, tl_live_io_bytes(), TL_BLOCK_THEY_WRITE, &self->pulse, error);
    }
    if (status == TL_OK && self->job.database[0] != '\0') {
        status = tl_block_take(TL_LIVE_RECORDER_PULSE, sizeof *recorder, TL_BLOCK_WE_WRITE, &self->recorder, error);
        recorder = self->recorder.bytes;
    }
    if (status == TL_OK) {
        self->beats = &((tl_live_io_pulse *)self->pulse.bytes)->beats;
        tl_outbox_open(&events, tl_live_io_outbox_of(self->pulse.bytes),
                       recorder != NULL ? &recorder->state.taken[TL_LIVE_OUTBOX_IO] : NULL, &self->outbox);
    }
    return status;
}

static tl_status open_plant(io *self, tl_error *error) {
    tl_mailbox mailboxes[TL_MAX_SIGNALS];
    tl_plant_mail_open(&self->shape, self->mail.bytes, mailboxes);
    tl_status status = tl_live_plant_open(&self->config, mailboxes, self->beats, on_link, self, &self->plant, error);
    if (status == TL_OK) {
        tl_live_mail_end *end = tl_live_mail_end_of(&self->shape, self->mail.bytes);
        __atomic_store_n(&end->opened, 1, __ATOMIC_RELEASE);
    }
    return status;
}

static void read_until_told(io *self, tl_heart *heart) {
    while (tl_interrupt_requested() == NULL) {
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK);
        tl_heart_beat(heart);
        tl_journal_drain(&self->journal);
    }
}

int tl_io_role_run(void) {
    static io self; /* one for the process */
    tl_error error;
    tl_live_role_begin();
    tl_status status = take_memory(&self, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    tl_heart *heart = tl_heart_begin(self.beats, "io", PATIENCE);
    tl_live_role_open_journal(&self.journal, &self.outbox);
    status = tl_live_places_confine_io(&self.config, &error);
    if (status == TL_OK) {
        status = open_plant(&self, &error);
    }
    if (status == TL_OK) {
        tl_heartbeats_set_ready(self.beats);
        tl_heart_be_patient(heart, self.config.realtime_hang + 2 * LOOK);
        read_until_told(&self, heart);
        tl_heart_be_patient(heart, PATIENCE);
        tl_live_plant_close(self.plant);
    } else {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    tl_journal_drain(&self.journal);
    return tl_live_role_end(self.beats, status == TL_OK, tl_exit_code(status));
}
