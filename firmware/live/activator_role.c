/* The process that changes the configuration of the run. No plant, no FMU, no network, no database. See live_role.h. */
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/live/live_host.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_wire.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/role.h"
#include "firmware/retune/activator.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/live_tuning.h"

/* A worn-out memory card takes its time for one version. */
static const tl_time PATIENCE = 60 * TL_SECOND;

typedef struct activator_process {
    tl_block job_block;
    tl_live_job job;
    tl_config config;
    tl_block pulse_block;
    tl_block twin_blocks[TL_LIVE_PLACES];
    tl_block recorder_block;
    tl_block tuning_blocks[TL_LIVE_PLACES];
    tl_block stage_block;
    tl_block candidate_block;
    tl_outbox outbox;
    tl_journal journal;
    tl_heart *heart;
    tl_live_host host;
    tl_activation_host functions;
    tl_activator *activator;
} activator_process;

/* ---- its life ---- */

static tl_status take_blocks(activator_process *self, tl_error *error) {
    const uint32_t own = self->job.place % TL_LIVE_PLACES;
    const struct {
        int descriptor;
        size_t size;
        tl_block_writer writer;
        tl_block *block;
    } wanted[] = {
        {TL_LIVE_OWN_PULSE, tl_live_activator_bytes(), TL_BLOCK_THEY_WRITE, &self->pulse_block},
        {TL_LIVE_ACTIVATOR_TWIN, sizeof(tl_live_twin_pulse), TL_BLOCK_WE_WRITE, &self->twin_blocks[own]},
        {TL_LIVE_OTHER_PULSE, sizeof(tl_live_twin_pulse), TL_BLOCK_WE_WRITE, &self->twin_blocks[1 - own]},
        {TL_LIVE_TUNING, sizeof(tl_live_tuning), TL_BLOCK_THEY_WRITE, &self->tuning_blocks[own]},
        {TL_LIVE_OTHER_TUNING, sizeof(tl_live_tuning), TL_BLOCK_THEY_WRITE, &self->tuning_blocks[1 - own]},
        {TL_LIVE_STAGE, sizeof(tl_live_stage), TL_BLOCK_WE_WRITE, &self->stage_block},
        {TL_LIVE_CANDIDATE, sizeof(tl_live_candidate), TL_BLOCK_THEY_WRITE, &self->candidate_block},
    };
    tl_status status = TL_OK;
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0] && status == TL_OK; i++) {
        status = tl_block_take(wanted[i].descriptor, wanted[i].size, wanted[i].writer, wanted[i].block, error);
    }
    if (status == TL_OK && self->job.database[0] != '\0') {
        status = tl_block_take(TL_LIVE_RECORDER_PULSE, sizeof(tl_live_recorder_pulse), TL_BLOCK_WE_WRITE,
                               &self->recorder_block, error);
    }
    return status;
}

static tl_status take_memory(activator_process *self, tl_error *error) {
    const tl_outbox_settings events = tl_live_event_outbox();
    tl_status status = tl_live_job_take(TL_LIVE_JOB, &self->job_block, &self->job, &self->config, error);
    if (status == TL_OK) {
        status = take_blocks(self, error);
    }
    if (status == TL_OK) {
        tl_live_host *host = &self->host;
        *host = (tl_live_host){.pulse = self->pulse_block.bytes,
                               .recorder = self->recorder_block.bytes,
                               .stage = self->stage_block.bytes,
                               .candidate = self->candidate_block.bytes,
                               .path = self->config.path,
                               .text = self->config.text,
                               .text_hash = self->config.hash,
                               .step = self->config.step,
                               .journal = &self->journal};
        for (size_t i = 0; i < TL_LIVE_PLACES; i++) {
            host->twins[i] = self->twin_blocks[i].bytes;
            host->tunings[i] = self->tuning_blocks[i].bytes;
            memcpy(host->hash[i], self->job.hash[i], sizeof host->hash[i]);
        }
        tl_outbox_open(&events, tl_live_activator_outbox_of(host->pulse),
                       host->recorder != NULL ? &host->recorder->state.taken[TL_LIVE_OUTBOX_ACTIVATOR] : NULL,
                       &self->outbox);
    }
    return status;
}

static tl_status open_activator(activator_process *self, tl_error *error) {
    self->functions = tl_live_host_functions(&self->host);
    const tl_activator_settings settings = {
        .listener = TL_LIVE_KNOCKER,
        .state = self->job.state,
        .activation = {.plant = self->config.name,
                       .path = self->config.path,
                       .allowed = self->job.allowed,
                       .memory_limit = self->job.memory_limit,
                       .unconfined = self->job.unconfined,
                       .host = &self->functions},
    };
    return tl_activator_open(&settings, &self->activator, error);
}

static void work(activator_process *self) {
    bool goes_on = true;
    while (goes_on && tl_interrupt_requested() == NULL) {
        goes_on = tl_activator_work(self->activator);
        tl_live_host_look(&self->host);
        tl_heart_beat(self->heart);
        tl_journal_drain(&self->journal);
    }
}

int tl_activator_role_run(void) {
    static activator_process self; /* one for the process */
    tl_error error;
    tl_live_role_begin();
    tl_role_open_program();
    tl_status status = take_memory(&self, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    self.heart = tl_heart_begin(&self.host.pulse->beats, "activator", PATIENCE);
    tl_live_role_open_journal(&self.journal, &self.outbox);
    status = open_activator(&self, &error);
    bool was_ready = status == TL_OK;
    if (was_ready) {
        tl_heartbeats_set_ready(&self.host.pulse->beats);
        work(&self);
        tl_activator_close(self.activator);
    } else {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    tl_journal_drain(&self.journal);
    return tl_live_role_end(&self.host.pulse->beats, was_ready, tl_exit_code(status));
}
