/* Checkpointer: see checkpointer.h. */
#include "firmware/twin/checkpointer.h"

#include <stdio.h>

#include "firmware/base/os.h"

static const tl_time INTERVAL = 10 * TL_SECOND;
enum { INTERVAL_MOST = 2000, LATE = 3 /* intervals without a checkpoint before it is reported */ };

size_t tl_checkpointer_room(size_t size) {
    return 2 * size;
}

void tl_checkpointer_init(tl_checkpointer *self, const tl_assembly *assembly, tl_record_queue *queue,
                          tl_journal *journal, bool readable) {
    int64_t ticks = INTERVAL / assembly->config.step;
    *self = (tl_checkpointer){
        .twin = assembly->twin,
        .queue = queue,
        .journal = journal,
        .interval = ticks < 1               ? 1
                    : ticks < INTERVAL_MOST ? ticks
                                            : INTERVAL_MOST,
        .is_off = assembly->config.record_resume == 0,
    };
    bool can_save = tl_twin_can_save(self->twin);
    self->only_marks = !self->is_off && (!can_save || !readable);
    if (self->only_marks) {
        tl_journal_event(
            journal, -1, can_save ? TL_EVENT_WARNING : TL_EVENT_INFO, "checkpoint", "%s",
            can_save ? "none are saved: a saved state of these FMUs ended the process that loaded it, or gave other "
                       "results there; a restarted twin repeats the newest inputs"
                     : "none are saved: not all FMUs are rolled back by states that they can serialise "
                       "(canSerializeFMUstate); a restarted twin repeats the newest inputs");
    }
}

static void stop_saving(tl_checkpointer *self, const char *why) {
    self->only_marks = true;
    tl_journal_event(self->journal, -1, TL_EVENT_WARNING, "checkpoint",
                     "none are saved from now on: %s; a restarted twin repeats recorded inputs", why);
}

/* Saves to the record queue and measures the cost. Returns false if nothing was saved. */
static bool save_twin(tl_checkpointer *self, size_t *size) {
    size_t capacity = 0;
    unsigned char *room = tl_record_queue_checkpoint_room(self->queue, &capacity);
    tl_error error;
    if (room == NULL) {
        return false;
    }
    tl_time begun = tl_clock_now(NULL);
    if (tl_twin_save(self->twin, room, capacity, size, &error) != TL_OK) {
        stop_saving(self, error.text);
        return false;
    }
    self->cost = tl_clock_now(NULL) - begun;
    self->least = self->least == 0 || self->cost < self->least ? self->cost : self->least;
    if (*size > capacity) {
        stop_saving(self, "the state has grown to more than twice its size");
        return false;
    }
    return *size != 0;
}

void tl_checkpointer_put(tl_checkpointer *self, int64_t tick, size_t size) {
    tl_record_queue_put_checkpoint(self->queue, tick, size);
    self->next = tick + self->interval;
}

/* First save: allocates twice the present size, and saves twice, because the first save is the
 *             slowest. Returns false if nothing was saved. */
static bool save_first(tl_checkpointer *self, const tl_budget *budget, size_t *size) {
    tl_error error;
    if (tl_twin_save(self->twin, NULL, 0, size, &error) != TL_OK) {
        stop_saving(self, error.text);
        return false;
    }
    if (*size == 0) {
        return false;
    }
    if (!tl_record_queue_reserve_checkpoint(self->queue, tl_checkpointer_room(*size))) {
        stop_saving(self, "a state is too large, or there is not enough memory");
        return false;
    }
    self->is_ready = save_twin(self, size);
    self->is_ready = self->is_ready && save_twin(self, size);
    if (self->cost > budget->time) {
        char why[80];
        (void)snprintf(why, sizeof why, "saving takes %.3g ms, more than the budget of a step (%.3g ms)",
                       tl_seconds(self->cost) * 1e3, tl_seconds(budget->time) * 1e3);
        stop_saving(self, why);
    }
    return self->is_ready;
}

static bool is_late(const tl_checkpointer *self, int64_t tick) {
    return tick > self->next + LATE * self->interval;
}

/* Returns true if the remaining budget is expected to be enough. */
static bool has_time(const tl_checkpointer *self, int64_t tick, const tl_budget *budget) {
    tl_time expected = is_late(self, tick) ? self->least : self->cost;
    return tl_clock_now(NULL) - budget->started + expected <= budget->time;
}

static void report_late(tl_checkpointer *self, int64_t tick) {
    if (!self->has_reported && is_late(self, tick)) {
        self->has_reported = true;
        tl_journal_event(self->journal, tick, TL_EVENT_WARNING, "checkpoint",
                         "none was saved for %lld ticks, because no step had %.3g ms left for it",
                         (long long)(tick - self->next), tl_seconds(self->cost) * 1e3);
    }
}

void tl_checkpointer_request(tl_checkpointer *self, int64_t tick) {
    self->next = tick < self->next ? tick : self->next;
}

void tl_checkpointer_after(tl_checkpointer *self, int64_t tick, const tl_budget *budget) {
    size_t size = 0;
    if (self->is_off || budget == NULL || tick < self->next) {
        return;
    }
    if (self->only_marks) {
        tl_checkpointer_put(self, tick, 0);
    } else if (self->is_ready && !has_time(self, tick, budget)) {
        report_late(self, tick);
    } else if (self->is_ready ? save_twin(self, &size) : save_first(self, budget, &size)) {
        tl_checkpointer_put(self, tick, size);
    }
}

void tl_checkpointer_rehearse(tl_checkpointer *self, const tl_budget *budget) {
    size_t size = 0;
    if (budget != NULL && !self->is_ready && !self->only_marks && tl_twin_can_save(self->twin)) {
        (void)save_first(self, budget, &size);
    }
}

bool tl_checkpointer_save(tl_checkpointer *self, tl_time left, size_t *size) {
    *size = 0;
    return self->is_ready && self->cost < left && save_twin(self, size);
}
