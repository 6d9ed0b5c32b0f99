/* Memory that the processes of a live run share: see live_blocks.h. */
#include "firmware/live/live_blocks.h"

#include <stdio.h>
#include <string.h>

#include "firmware/twin/checkpointer.h"
#include "firmware/twin/past_history.h"

/* ---- live blocks ---- */

static size_t outbox_with(const tl_config *config, size_t checkpoint) {
    tl_outbox_settings settings = tl_live_twin_outbox(config);
    settings.checkpoint_bytes = checkpoint;
    return tl_outbox_bytes(&settings);
}

void tl_live_blocks_of(const tl_config *config, size_t checkpoint, tl_live_blocks *blocks) {
    const tl_outbox_settings events = tl_live_event_outbox();
    const tl_recorder_shape ticks = tl_recorder_shape_of(config);
    size_t room = tl_checkpointer_room(checkpoint);
    tl_plant_mail_shape mail;
    tl_plant_mail_shape_of(config, &mail);
    *blocks = (tl_live_blocks){
        .mail = tl_live_mail_bytes(&mail),
        .outbox = outbox_with(config, 0) + tl_live_io_bytes() + tl_outbox_bytes(&events) + sizeof(tl_live_twin_pulse) +
                  sizeof(tl_live_recorder_pulse),
    };
    if (room <= TL_LIVE_CHECKPOINT_BYTES) {
        blocks->checkpoints = outbox_with(config, room) - outbox_with(config, 0);
    }
    if (config->record_resume != 0) {
        blocks->past = tl_past_image_bytes(&ticks, TL_PAST_TICKS, checkpoint, 0);
    }
    blocks->shadow = outbox_with(config, 0) + sizeof(tl_live_twin_pulse) + blocks->checkpoints + blocks->past;
}

/* ---- live samples ---- */

static void answer(tl_live_samples *self, tl_live_wish wish, const char *path) {
    tl_live_past_answer *given = self->answer;
    int64_t from = __atomic_load_n(&self->pulse->past_from, __ATOMIC_RELAXED);
    size_t size = 0;
    tl_error error;
    memset(given->words, 0, sizeof given->words);
    if (tl_past_samples_find(path, self->boot, from, self->past->bytes, self->past->size, &size, &error) != TL_OK) {
        given->words[0].severity = (int32_t)TL_EVENT_WARNING;
        (void)snprintf(given->words[0].text, sizeof given->words[0].text, "%.200s", error.text);
    }
    given->size = size;
    self->answered = wish;
    self->is_filled = self->is_filled || size != 0;
    __atomic_store_n(&given->wish, wish, __ATOMIC_RELEASE);
}

void tl_live_samples_look(tl_live_samples *self, const char *path) {
    tl_live_wish wish = __atomic_load_n(&self->pulse->past, __ATOMIC_ACQUIRE);
    bool begun = __atomic_load_n(&self->pulse->begun, __ATOMIC_RELAXED) != 0;
    if (wish != 0 && wish != self->answered && !begun) {
        answer(self, wish, path);
    } else if (begun && self->is_filled) {
        tl_block_forget(self->past, 0, self->past->size);
        self->is_filled = false;
    }
}

/* ---- live shown ---- */

static void publish(const tl_live_shown *shown, tl_run_status *figures, const tl_metrics *match) {
    figures->outputs = (uint32_t)shown->config->match_count;
    for (size_t i = 0; i < shown->config->match_count; i++) {
        tl_run_output *output = &figures->output[i];
        (void)snprintf(output->name, sizeof output->name, "%s", shown->config->match[i].variable);
        (void)snprintf(output->unit, sizeof output->unit, "%s", shown->account->match[i].unit);
        output->pairs = match[i].pairs;
        output->sum_of_squares = match[i].sum_of_squares;
        output->tolerance = shown->config->match[i].weight > 0.0 ? shown->config->match[i].tolerance : 0.0;
    }
    tl_latest_publish(shown->figures, figures, sizeof *figures);
}

void tl_live_shown_recorded(const tl_live_shown *shown, const tl_run_status *recorded, const tl_metrics *match) {
    tl_run_status figures = *recorded;
    figures.phase = TL_RUN_RECORDED;
    figures.ticks = (uint64_t)recorded->tick;
    publish(shown, &figures, match);
}

void tl_live_shown_live(const tl_live_shown *shown, const tl_cycle_status *status) {
    tl_run_status figures = {
        .phase = status->is_live ? TL_RUN_LIVE : TL_RUN_RECORDED,
        .tick = status->tick,
        .last = status->tick,
        .ticks = status->ticks,
        .steps = status->steps,
        .skipped = status->skipped,
        .gaps = status->gaps,
        .deadline_misses = status->deadline_misses,
        .evaluations = status->evaluations,
        .executions = status->executions,
        .timed_out = status->timed_out,
        .used = status->used,
        .plant_is_shut = __atomic_load_n(&shown->mail->opened, __ATOMIC_ACQUIRE) == 0,
        .lock = status->lock,
        .lock_before = status->lock_before,
    };
    publish(shown, &figures, status->match);
}
