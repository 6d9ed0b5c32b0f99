/* How a twin shows what it does: see live_shown.h. */
#include "firmware/live/live_shown.h"

#include <stdio.h>

static void publish(const tl_live_shown *shown, tl_live_figures *figures, const tl_metrics *match) {
    figures->outputs = (uint32_t)shown->config->match_count;
    for (size_t i = 0; i < shown->config->match_count; i++) {
        tl_live_output *output = &figures->output[i];
        (void)snprintf(output->name, sizeof output->name, "%s", shown->config->match[i].variable);
        (void)snprintf(output->unit, sizeof output->unit, "%s", shown->account->match[i].unit);
        output->pairs = match[i].pairs;
        output->sum_of_squares = match[i].sum_of_squares;
        output->tolerance = shown->config->match[i].weight > 0.0 ? shown->config->match[i].tolerance : 0.0;
    }
    tl_latest_publish(shown->figures, figures, sizeof *figures);
}

void tl_live_shown_recorded(const tl_live_shown *shown, const tl_recorded_figures *recorded) {
    tl_live_figures figures = {
        .phase = TL_LIVE_RECORDED,
        .tick = recorded->ticks,
        .last = recorded->known,
        .ticks = (uint64_t)recorded->ticks,
        .steps = recorded->steps,
        .evaluations = recorded->evaluations,
        .executions = recorded->executions,
        .timed_out = recorded->timed_out,
        .used = recorded->used,
    };
    publish(shown, &figures, recorded->match);
}

void tl_live_shown_live(const tl_live_shown *shown, const tl_cycle_status *status) {
    tl_live_figures figures = {
        .phase = status->is_live ? TL_LIVE_LIVE : TL_LIVE_RECORDED,
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
        .shut = __atomic_load_n(&shown->mail->opened, __ATOMIC_ACQUIRE) == 0 ? 1 : 0,
        .lock = status->lock,
        .lock_before = status->lock_before,
    };
    publish(shown, &figures, status->match);
}
