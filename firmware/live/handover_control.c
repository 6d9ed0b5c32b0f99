/* Handover control: see handover_control.h. */
#include "firmware/live/handover_control.h"

#include <inttypes.h>
#include <stdio.h>

static const tl_time TICKS_BEFORE =
    3600 * TL_SECOND; /* a twin's tick further ahead of the clock than this is invalid */

/* ---- state ---- */

static tl_twin_slot *live_slot(const tl_handover_control *self) {
    return &self->slots[self->handover_block->slot_index];
}

static tl_twin_slot *shadow_slot(const tl_handover_control *self) {
    return &self->slots[1 - self->handover_block->slot_index];
}

static bool is_recorder_behind(const tl_handover_control *self) {
    return self->recorder != NULL && self->recorder_handovers != self->handover_block->handovers;
}

static bool has_drained(const tl_handover_control *self) {
    return is_recorder_behind(self) && self->recorder_handovers != self->done &&
           __atomic_load_n(&self->recorder->drained, __ATOMIC_ACQUIRE) == self->recorder_handovers + 1;
}

/* ---- answers ---- */

static void finish_order(tl_handover_control *self, uint32_t number) {
    self->waiting = 0;
    __atomic_store_n(&self->handover_block->order, number, __ATOMIC_RELEASE);
}

static void show_shadow(tl_handover_control *self, tl_live_shadow shadow, const char *why) {
    tl_handover *block = self->handover_block;
    (void)snprintf(block->why, sizeof block->why, "%.*s", TL_HANDOVER_WHY - 1, why);
    __atomic_store_n(&block->shadow, (uint32_t)shadow, __ATOMIC_RELEASE);
}

static void refuse_shadow(tl_handover_control *self, uint32_t number, const char *why) {
    show_shadow(self, TL_LIVE_SHADOW_ENDED, why);
    finish_order(self, number);
}

/* ---- a shadow ---- */

/* Returns why a shadow cannot start yet, or NULL if it can. */
static const char *find_obstacle(const tl_handover_control *self, tl_time now) {
    const tl_twin_slot *run = live_slot(self);
    tl_time start = __atomic_load_n(&run->live_status->start, __ATOMIC_ACQUIRE);
    if (shadow_slot(self)->pid != 0) {
        return "the previous shadow has not ended";
    }
    if (run->pid == 0 || !tl_heartbeats_is_ready(&run->live_status->beats) || start <= 0 || start > now) {
        return "the live twin has not started";
    }
    return is_recorder_behind(self) ? "the recorder has not finished the previous run" : NULL;
}

/* Returns false as long as the order may wait. */
static bool is_overdue(tl_handover_control *self, uint32_t number, tl_time now) {
    self->since = self->waiting == number ? self->since : now;
    self->waiting = number;
    return now - self->since > TL_HANDOVER_CONTROL_PATIENCE;
}

static void load_candidate(tl_handover_control *self, uint32_t number, const tl_live_needs *needs) {
    const tl_twin_slot *run = live_slot(self);
    tl_twin_slot *slot = shadow_slot(self);
    tl_error error = {0};
    tl_status status = tl_twin_slot_load_candidate(slot, self->candidate, needs, self->step, &error);
    if (status != TL_OK) {
        refuse_shadow(self, number, error.text);
        return;
    }
    slot->unconfined = slot->unconfined && self->unconfined;
    slot->start = run->live_status->start;
    slot->started = run->live_status->started;
    self->wants_shadow = true;
    show_shadow(self, TL_LIVE_SHADOW_RUNS, "");
    finish_order(self, number);
}

static void order_shadow(tl_handover_control *self, uint32_t number, const tl_live_needs *needs, tl_time now) {
    self->wants_shadow = false;
    if (self->holds) {
        refuse_shadow(self, number, "safe hold: there is no live twin to compare a shadow with");
        return;
    }
    const char *obstacle = find_obstacle(self, now);
    if (obstacle == NULL) {
        load_candidate(self, number, needs);
    } else if (is_overdue(self, number, now)) {
        refuse_shadow(self, number, obstacle);
    }
}

/* ---- handover ---- */

/* Returns the first tick that is far enough ahead and that the live twin has not reached. Below 0:
 * the status of the twin is invalid. */
static int64_t tick_of_handover(const tl_handover_control *self, tl_time start, tl_time now) {
    const tl_time step = self->step;
    tl_run_status status_now = {.tick = 0};
    if (start <= 0 || start > now) {
        return -1;
    }
    int64_t tick = (now + tl_handover_ahead(step) - start) / step + 1;
    (void)tl_latest_read(&live_slot(self)->live_status->figures, &status_now, sizeof status_now);
    if (status_now.tick < tick) {
        return tick;
    }
    return status_now.tick - tick < TICKS_BEFORE / step ? status_now.tick + 1 : -1;
}

static void announce_handover(tl_handover_control *self, int64_t tick, tl_time now) {
    tl_handover *block = self->handover_block;
    const tl_twin_slot *to = shadow_slot(self);
    const tl_time step = self->step;
    char text[160];
    __atomic_store_n(&block->to, 1 - block->slot_index, __ATOMIC_RELAXED);
    __atomic_store_n(&block->tick, tick, __ATOMIC_RELAXED);
    __atomic_store_n(&block->handovers, block->handovers + 1, __ATOMIC_RELEASE);
    self->until = to->start + tick * step + tl_handover_ahead(step);
    self->until = self->until > now ? self->until : now;
    (void)snprintf(text, sizeof text, "handover: from tick %" PRId64 " on the twin of configuration %.12s is live",
                   tick, to->hash);
    self->report(self->context, text);
}

/* Returns why no handover is possible, or NULL if it is. */
static const char *find_refusal(const tl_handover_control *self) {
    const tl_twin_slot *run = live_slot(self);
    const tl_twin_slot *shadow = shadow_slot(self);
    if (self->holds) {
        return "safe hold: there is no live twin";
    }
    if (shadow->pid == 0 || !self->wants_shadow) {
        return "there is no shadow";
    }
    if (!tl_heartbeats_is_ready(&shadow->live_status->beats)) {
        return "the shadow has not started";
    }
    return run->pid != 0 && run->live_status->start != 0 && run->live_status->start != shadow->start
               ? "the run was restarted: the shadow counts the ticks of the previous one"
               : NULL;
}

static void order_handover(tl_handover_control *self, uint32_t number, tl_time now) {
    const char *refusal = find_refusal(self);
    int64_t tick = refusal == NULL ? tick_of_handover(self, shadow_slot(self)->start, now) : -1;
    if (tick < 0) {
        show_shadow(self, (tl_live_shadow)self->handover_block->shadow, /* unchanged */
                    refusal != NULL ? refusal : "the live twin reports invalid ticks");
    } else {
        announce_handover(self, tick, now);
    }
    finish_order(self, number);
}

/* Live twin and shadow have swapped. */
static void swap_slots(tl_handover_control *self, tl_orders *orders) {
    tl_handover *block = self->handover_block;
    tl_twin_slot *before = live_slot(self);
    bool is_dead = before->pid == 0;
    before->start = shadow_slot(self)->start;
    before->started = shadow_slot(self)->started;
    self->done = block->handovers;
    self->wants_shadow = !is_dead;
    show_shadow(self, is_dead ? TL_LIVE_SHADOW_ENDED : TL_LIVE_SHADOW_RUNS,
                is_dead ? "the former live twin ended before the handover" : "");
    __atomic_store_n(&block->slot_index, 1 - block->slot_index, __ATOMIC_RELEASE);
    orders->swap = true;
}

static void poll_handover(tl_handover_control *self, tl_time now, bool ends, tl_orders *orders) {
    const tl_twin_slot *before = live_slot(self);
    bool handover_result =
        __atomic_load_n(&before->live_status->handed_over, __ATOMIC_ACQUIRE) == self->handover_block->handovers;
    bool is_dead = before->pid == 0 && !ends; /* at the end of all, this is no failure */
    if (handover_result || is_dead) {
        swap_slots(self, orders);
        return;
    }
    orders->soon = true;
    orders->kill_twin = now > self->until && !ends;
}

/* ---- orders ---- */

static void poll_order(tl_handover_control *self, tl_time now) {
    const tl_live_order *order = &self->orders->order;
    uint32_t number = __atomic_load_n(&order->number, __ATOMIC_ACQUIRE);
    tl_live_needs needs = order->needs;
    if (number == self->handover_block->order) {
        return;
    }
    switch (order->verb) {
    case TL_LIVE_SHADOW:
        order_shadow(self, number, &needs, now);
        break;
    case TL_LIVE_HAND_OVER:
        order_handover(self, number, now);
        break;
    default: /* any invalid order ends the shadow */
        self->wants_shadow = false;
        show_shadow(self, TL_LIVE_SHADOW_NONE, "");
        finish_order(self, number);
        break;
    }
}

void tl_handover_control_poll(tl_handover_control *control, tl_time now, bool ends, tl_orders *orders) {
    if (control->handover_block->handovers != control->done) {
        poll_handover(control, now, ends, orders);
    } else if (!ends) {
        poll_order(control, now);
    }
    orders->shadow = control->wants_shadow && !control->holds;
    orders->recorder = has_drained(control);
}

void tl_handover_control_note_end_of_shadow(tl_handover_control *control, const char *reason) {
    if (control->wants_shadow) {
        show_shadow(control, TL_LIVE_SHADOW_ENDED, control->holds ? "safe hold: there is no live twin" : reason);
    }
    control->wants_shadow = false;
}

void tl_handover_control_begin_recorder(tl_handover_control *control) {
    if (has_drained(control)) {
        control->recorder_handovers++;
        control->recorder_slot = 1 - control->recorder_slot;
    }
}
