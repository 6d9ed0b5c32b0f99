/* Another tuning while a cycle runs: see cycle.h. */
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/twin/cycle_parts.h"

static void answer(const tl_cycle *cycle, uint32_t number, const char *why) {
    if (cycle->settings.answer != NULL) {
        tl_live_tuning_answer_with(cycle->settings.answer, number, cycle->next_tick, why);
    }
}

static void refuse_tuning(tl_cycle *cycle, const tl_live_tuning_head *head, const char *why) {
    tl_journal_event(cycle->settings.journal, cycle->next_tick, TL_EVENT_WARNING, "retune",
                     "configuration %.12s refused: %.150s", tl_identity_is_sound(head->hash) ? head->hash : "?", why);
    answer(cycle, head->number, why);
}

static void take_tuning(tl_cycle *cycle, const tl_live_tuning_head *head) {
    cycle->tuning = (tl_run_tuning){.tick = cycle->next_tick, .number = head->number, .values = head->tuning};
    memcpy(cycle->tuning.hash, head->hash, sizeof cycle->tuning.hash);
    cycle->was_tuned = true;
    cycle->has_tuning = cycle->has_run;
    cycle->summary.tunings++;
    tl_lock_judge_retune(&cycle->rescue.judge, &head->tuning);
    tl_lock_judge_retune(&cycle->second, &head->tuning);
    tl_watch_retune(&cycle->watch, cycle->next_tick, head->hash);
    answer(cycle, head->number, NULL);
}

/* There is another number than that which was looked at last. */
static void look_at_tuning(tl_cycle *cycle) {
    tl_live_tuning_head head = {.number = 0};
    tl_error error = {TL_OK, ""};
    tl_status status = tl_live_tuning_read(cycle->settings.tuning, &head, &error);
    if (status == TL_TRY_AGAIN) {
        return; /* at the next tick */
    }
    cycle->tuned = head.number;
    status = status == TL_OK ? tl_assembly_retune(cycle->settings.assembly, &head.tuning, &error) : status;
    if (status == TL_OK) {
        take_tuning(cycle, &head);
    } else {
        refuse_tuning(cycle, &head, error.text);
    }
}

void tl_cycle_look_for_tuning(tl_cycle *cycle) {
    const tl_live_tuning *block = cycle->settings.tuning;
    uint32_t number = block != NULL ? tl_live_tuning_number(block) : cycle->tuned;
    bool has_room = !cycle->has_run || tl_outbox_has_room_for_tuning(cycle->settings.outbox);
    if (number != cycle->tuned && number % 2 == 0 && !cycle->has_tuning && has_room) {
        look_at_tuning(cycle);
    }
}

void tl_cycle_look_for_yardstick(tl_cycle *cycle) {
    tl_lock_yardstick found;
    if (cycle->settings.tuning == NULL || !tl_latest_read(&cycle->settings.tuning->yardstick, &found, sizeof found)) {
        return;
    }
    cycle->yardstick = found;
    tl_lock_judge_measure_by(&cycle->second, tl_lock_yardstick_is_there(&found) ? &cycle->yardstick : NULL);
}

void tl_cycle_begin_judges(tl_cycle *cycle, const tl_account *account) {
    tl_lock_rescue_init(&cycle->rescue, &cycle->settings.assembly->config, account);
    tl_lock_judge_init(&cycle->second, &cycle->settings.assembly->config, account);
    tl_cycle_look_for_yardstick(cycle);
}

void tl_cycle_keep_in_force(tl_cycle *cycle) {
    const tl_outbox *outbox = cycle->settings.outbox;
    if (!cycle->has_tuning) {
        cycle->tuning = *tl_outbox_tuning(outbox);
        cycle->was_tuned = strcmp(cycle->tuning.hash, outbox->configured.hash) != 0;
    }
    cycle->has_tuning = false;
}

void tl_cycle_put_in_force(tl_cycle *cycle) {
    cycle->has_tuning = cycle->was_tuned;
    cycle->tuning.tick = cycle->next_tick;
}
