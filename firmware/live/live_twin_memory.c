/* What a live twin shares: see live_twin_memory.h. */
#include "firmware/live/live_twin_memory.h"

#include <string.h>

#include "firmware/plant/live_plant.h"

/* ---- the plant ---- */

static tl_status take_mail(tl_live_twin_memory *self, const tl_config *config, tl_error *error) {
    tl_plant_mail_shape shape;
    tl_plant_mail_shape_of(config, &shape);
    tl_status status = tl_block_take(TL_LIVE_MAIL, tl_live_mail_bytes(&shape), TL_BLOCK_WE_WRITE, &self->mail, error);
    if (status == TL_OK) {
        tl_live_plant_set_limits(&self->input, config);
        tl_plant_mail_open(&shape, self->mail.bytes, self->input.mailboxes);
        self->mail_end = tl_live_mail_end_of(&shape, self->mail.bytes);
        if (!tl_plant_input_open(&self->input)) {
            status = tl_fail(error, TL_TRY_AGAIN, "not enough memory for the plant's readings");
        }
    }
    return status;
}

/* ---- its own ---- */

static tl_status take_own(tl_live_twin_memory *self, const tl_config *config, tl_error *error) {
    const tl_outbox_settings settings = tl_live_twin_outbox(config);
    const tl_outbox_taken *taken = NULL;
    tl_status status =
        tl_block_take(TL_LIVE_OWN_PULSE, sizeof *self->pulse, TL_BLOCK_THEY_WRITE, &self->pulse_block, error);
    if (status == TL_OK) {
        status = tl_block_take(TL_LIVE_TWIN_OUTBOX, tl_outbox_bytes(&settings), TL_BLOCK_THEY_WRITE,
                               &self->outbox_block, error);
    }
    if (status == TL_OK && self->job.database[0] != '\0') {
        self->past.place = self->job.place;
        status = tl_live_memory_take(&self->past, &taken, error);
    }
    if (status == TL_OK) {
        self->pulse = self->pulse_block.bytes;
        self->past.pulse = self->pulse;
        self->past.twin = self->job.number;
        tl_outbox_open(&settings, self->outbox_block.bytes, taken, &self->outbox);
        tl_outbox_hide_unused(&self->outbox);
    }
    return status;
}

/* What it is built with, and where it is told of another tuning. The text is the recorder's affair. */
static tl_status take_tuning(tl_live_twin_memory *self, const tl_config *config, tl_error *error) {
    tl_run_tuning configured = {.number = 0};
    tl_status status =
        tl_block_take(TL_LIVE_TUNING, sizeof(tl_live_tuning), TL_BLOCK_WE_WRITE, &self->tuning_block, error);
    if (status == TL_OK) {
        tl_live_tuning_hide_text(&self->tuning_block);
        memcpy(configured.hash, config->hash, sizeof configured.hash);
        tl_config_tuning(config, &configured.values);
        tl_outbox_name_configuration(&self->outbox, &configured);
    }
    return status;
}

tl_status tl_live_twin_memory_take(tl_live_twin_memory *memory, const tl_twin_job *job, tl_config *config,
                                   tl_error *error) {
    const char *of_run = "";
    tl_status status = tl_live_job_unpack(job->live, job->live_size, &memory->job, &of_run, error);
    if (status == TL_OK) {
        tl_live_job_apply(&memory->job, config);
        status =
            memory->job.is_shadow ? tl_live_job_read(&memory->job, config->path, of_run, &memory->run, error) : TL_OK;
    }
    if (status == TL_OK) {
        status = take_mail(memory, config, error);
    }
    if (status == TL_OK) {
        status = take_own(memory, config, error);
    }
    if (status == TL_OK) {
        status = tl_block_take(TL_LIVE_STAGE, sizeof(tl_live_stage), TL_BLOCK_WE_WRITE, &memory->stage_block, error);
    }
    return status == TL_OK ? take_tuning(memory, config, error) : status;
}
