/* From one place to the other: what a cycle does at a flip. See cycle.h. */
#include <inttypes.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/twin/cycle_parts.h"

static bool is_due(const tl_cycle *cycle) {
    return cycle->flip.is_ahead && cycle->next_tick >= cycle->flip.tick;
}

/* At the tick of the flip each is what it will be. */
tl_time tl_cycle_delay(const tl_cycle *cycle) {
    bool is_shadow_then = cycle->is_shadow != is_due(cycle);
    return is_shadow_then ? cycle->settings.assembly->config.step / 4 : 0;
}

/* It has done its part. */
static void say(tl_cycle *cycle) {
    cycle->flip.is_ahead = false;
    __atomic_store_n(cycle->settings.place.flipped, cycle->flip.number, __ATOMIC_RELEASE);
}

void tl_cycle_look_for_flip(tl_cycle *cycle) {
    const tl_cycle_place *place = &cycle->settings.place;
    tl_cycle_flip *flip = &cycle->flip;
    uint32_t to = 0;
    if (place->stage == NULL || flip->is_ahead ||
        !tl_live_stage_look(place->stage, flip->number, &flip->number, &to, &flip->tick)) {
        return;
    }
    flip->is_ahead = (to == place->place) == cycle->is_shadow;
    if (!flip->is_ahead) {
        say(cycle); /* it is that already */
    }
}

/* What it does from the next tick on is counted from 0. */
static void count_anew(tl_cycle *cycle) {
    tl_twin_facts facts = tl_twin_get_facts(cycle->settings.assembly->twin);
    cycle->summary = (tl_summary){.resumption = cycle->resumption};
    cycle->warm_up = facts.first + facts.lead;
    cycle->warm_up = cycle->warm_up > cycle->next_tick ? cycle->warm_up : cycle->next_tick;
    cycle->first_step = cycle->next_tick - (int64_t)facts.lead;
    cycle->shown.executions = 0;
    cycle->shown.used = 0;
    memset(cycle->shown.match, 0, sizeof cycle->shown.match);
}

void tl_cycle_be_live(tl_cycle *cycle) {
    if (cycle->is_behind) {
        cycle->is_behind = false;
        count_anew(cycle);
    }
}

/* ---- the shadow ---- */

/* The twin forgets what is not saved, and so does who judges it: what follows is what a replay of the run does. `size` 0: nothing is saved. */
static tl_status begin_run(tl_cycle *cycle, size_t size) {
    const tl_cycle_settings *settings = &cycle->settings;
    bool done = false;
    tl_outbox_start start = {.holds = false};
    tl_status status = tl_twin_forget(settings->assembly->twin, &done, &cycle->error);
    if (status != TL_OK) {
        return status;
    }
    tl_account_take(settings->assembly->twin, &start.account);
    tl_cycle_begin_judges(cycle, &start.account);
    cycle->resumption = (tl_resumption){
        .from = size != 0 ? TL_RESUMED_CHECKPOINT : TL_RESUMED_INPUTS,
        .run = -1, /* the one before */
        .tick = cycle->flip.tick > cycle->next_tick ? cycle->flip.tick : cycle->next_tick,
        .start = settings->place.start,
        .started = settings->place.started,
    };
    start.resumption = cycle->resumption;
    (void)tl_outbox_put_start(settings->outbox, &start);
    if (size != 0) {
        tl_checkpointer_put(&cycle->checkpointer, cycle->next_tick - 1, size);
    }
    tl_cycle_put_in_force(cycle);
    cycle->has_run = true;
    return TL_OK;
}

/* At a tick with time to spare, or after the last one before the flip. */
static tl_status try_to_begin_run(tl_cycle *cycle, const tl_budget *budget) {
    tl_time step = cycle->settings.assembly->config.step;
    bool is_last = cycle->next_tick >= cycle->flip.tick;
    tl_time left = budget != NULL ? budget->time - (tl_clock_now(NULL) - budget->started) : 0;
    size_t size = 0;
    bool saved = tl_checkpointer_save(&cycle->checkpointer, is_last ? step : left, &size);
    return saved || is_last ? begin_run(cycle, saved ? size : 0) : TL_OK;
}

static void tell_taken_over(const tl_cycle *cycle) {
    const tl_resumption *resumption = &cycle->resumption;
    bool is_saved = resumption->from == TL_RESUMED_CHECKPOINT;
    tl_journal_event(cycle->settings.journal, -1, is_saved ? TL_EVENT_INFO : TL_EVENT_WARNING, "flip",
                     "has taken over from tick %" PRId64 " on%s", resumption->tick,
                     is_saved ? "" : "; the twin could not be saved: a replay of this run begins with start values");
}

/* What is bad now is told again: whoever reads the run's events has not seen it. */
static void take_over(tl_cycle *cycle) {
    cycle->is_shadow = false;
    cycle->is_behind = false;
    tl_journal_set_apart(cycle->settings.journal, false);
    tl_watch_init(&cycle->watch, &cycle->settings.assembly->config, cycle->settings.journal);
    count_anew(cycle);
    tell_taken_over(cycle);
    say(cycle);
}

/* ---- the run's ---- */

static void hand_over(tl_cycle *cycle) {
    tl_cycle_keep_in_force(cycle);
    (void)tl_outbox_put_end(cycle->settings.outbox, TL_LIVE_TAKEN_OVER);
    cycle->settings.place.start = cycle->start;
    cycle->settings.place.started = tl_outbox_beginning(cycle->settings.outbox)->started;
    cycle->resumption = (tl_resumption){.from = TL_RESUMED_NOT};
    cycle->has_run = false;
    cycle->is_shadow = true;
    tl_journal_set_apart(cycle->settings.journal, true);
    count_anew(cycle);
    say(cycle);
}

void tl_cycle_hand_over_with(tl_cycle *cycle) {
    if (is_due(cycle) && !cycle->is_shadow) {
        hand_over(cycle);
    }
}

/* ---- ticks ---- */

tl_status tl_cycle_before_tick(tl_cycle *cycle) {
    if (!is_due(cycle)) {
        return TL_OK;
    }
    if (!cycle->is_shadow) {
        if (cycle->settings.assembly->config.measurements != TL_AHEAD) { /* there its last record is not complete */
            hand_over(cycle);
        }
        return TL_OK;
    }
    tl_status status = cycle->has_run ? TL_OK : try_to_begin_run(cycle, NULL);
    if (status == TL_OK) {
        take_over(cycle);
    }
    return status;
}

tl_status tl_cycle_after_tick(tl_cycle *cycle, int64_t tick, const tl_budget *budget) {
    if (cycle->has_run) {
        tl_checkpointer_after(&cycle->checkpointer, tick, budget);
    } else if (cycle->flip.is_ahead) {
        return try_to_begin_run(cycle, budget);
    } else {
        tl_checkpointer_rehearse(&cycle->checkpointer, budget);
    }
    return TL_OK;
}
