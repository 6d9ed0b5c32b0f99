/* Conditioner: see conditioner.h. */
#include "firmware/plant/conditioner.h"

#include <math.h>

enum { PENDING = TL_CONDITIONER_LEVEL - 1 };

static const double GROWTH = 1.25; /* of the largest move, per reading */

void tl_conditioner_init(tl_conditioner *conditioner, const tl_condition *condition, tl_time stale) {
    *conditioner = (tl_conditioner){
        .condition = *condition, .stale = stale, .is_empty = true, .smallest_move = HUGE_VAL, .newest = TL_TIME_NEVER};
}

/* ---- outputs ---- */

/* Collects the outputs of one reading. */
typedef struct outputs {
    tl_conditioner *conditioner;
    tl_conditioned *out;
    size_t count;
} outputs;

/* Look-ups need increasing stamps, so an output that is not newer is dropped. */
static void add_output(outputs *to, const tl_conditioned *conditioned) {
    tl_time newest = to->conditioner->newest;
    if (newest == TL_TIME_NEVER || conditioned->reading.stamp > newest) {
        to->conditioner->newest = conditioned->reading.stamp;
        to->out[to->count++] = *conditioned;
    }
}

/* ---- the median ---- */

/* Removes the slot that is written next from the order, which contains it because the window is
 * full. */
static void remove_oldest(tl_conditioner *self, size_t slot) {
    size_t rank = 0;
    while (self->order[rank] != slot) {
        rank++;
    }
    for (; rank + 1 < self->condition.median; rank++) {
        self->order[rank] = self->order[rank + 1];
    }
}

static void insert_in_order(tl_conditioner *self, size_t slot, size_t others) {
    size_t rank = others;
    for (; rank > 0 && self->window[self->order[rank - 1]].value > self->window[slot].value; rank--) {
        self->order[rank] = self->order[rank - 1];
    }
    self->order[rank] = slot;
}

/* Returns false if the number of readings is even, because there is no middle one. */
static bool find_median(tl_conditioner *self, const tl_reading *reading, tl_reading *middle) {
    size_t size = self->condition.median;
    if (size <= 1) {
        *middle = *reading;
        return true;
    }
    size_t slot = self->count % size;
    size_t kept = self->count < size ? self->count : size - 1;
    if (self->count >= size) {
        remove_oldest(self, slot);
    }
    self->window[slot] = *reading;
    insert_in_order(self, slot, kept);
    self->count++;
    middle->value = self->window[self->order[kept / 2]].value;
    middle->stamp = self->window[(self->count - 1 - kept / 2) % size].stamp;
    middle->quality = TL_GOOD;
    return kept % 2 == 0;
}

/* ---- the low-pass ---- */

/* For x linear from x0 to x1: y = x1 − r·a + (y0 − x0)·(1 − a), with a = 1 − exp(−Δt/τ), r = (x1 −
 * x0)·τ/Δt. */
static double filter_line(tl_time low_pass, const tl_conditioned *before, const tl_reading *after) {
    double stretch = (double)(after->stamp - before->reading.stamp) / (double)low_pass;
    double share = -expm1(-stretch);
    double from = before->reading.value;
    return after->value - (after->value - from) / stretch * share + (before->smooth - from) * (1.0 - share);
}

double tl_conditioner_between(tl_time low_pass, const tl_conditioned *before, const tl_reading *after, tl_time at) {
    const tl_reading *from = &before->reading;
    double share = (double)(at - from->stamp) / (double)(after->stamp - from->stamp);
    const tl_reading there = {.value = from->value + share * (after->value - from->value), .stamp = at};
    return filter_line(low_pass, before, &there);
}

static tl_conditioned apply_low_pass(tl_conditioner *self, const tl_reading *reading) {
    tl_conditioned filtered = {.reading = *reading, .smooth = reading->value};
    if (self->condition.low_pass > 0 && !self->is_empty) {
        double smooth = filter_line(self->condition.low_pass, &self->last_smoothed, reading);
        filtered.smooth = isfinite(smooth) ? smooth : reading->value;
    }
    self->is_empty = false;
    self->last_smoothed = filtered;
    return filtered;
}

static void restart_filters(tl_conditioner *self) {
    self->count = 0;
    self->is_empty = true;
}

static void filter_reading(outputs *to, const tl_reading *reading) {
    tl_reading middle;
    if (find_median(to->conditioner, reading, &middle)) {
        const tl_conditioned filtered = apply_low_pass(to->conditioner, &middle);
        add_output(to, &filtered);
    }
}

/* ---- gate and leap ---- */

static double move_between(const tl_reading *one, const tl_reading *other) {
    return fabs(one->value - other->value);
}

static double usual_move(const tl_conditioner *self) {
    return fmax(self->largest_move, self->smallest_move);
}

static bool is_near(const tl_conditioner *self, const tl_reading *one, const tl_reading *other) {
    const tl_condition *condition = &self->condition;
    double limit = HUGE_VAL;
    if (condition->gate > 0.0) {
        limit = condition->gate;
    } else if (condition->leap > 0.0) {
        limit = fmax(condition->leap, 2.0 * usual_move(self));
    }
    return move_between(one, other) <= limit;
}

/* Returns true if the reading shows that the pending ones are the plant's. With a gate, all three
 * agree. With a leap, it is a usual move from the last one, or not clearly nearer to the accepted
 * one, or the third that leaps. */
static bool confirms_pending(const tl_conditioner *self, const tl_reading *reading) {
    const tl_reading *pending = self->pending;
    size_t count = self->pending_count;
    bool is_out = !is_near(self, &self->accepted, reading);
    if (self->condition.gate > 0.0) {
        return is_out && count == PENDING && is_near(self, &pending[0], &pending[1]) &&
               is_near(self, &pending[0], reading) && is_near(self, &pending[1], reading);
    }
    if (count == 0) {
        return false;
    }
    double move = move_between(&pending[count - 1], reading);
    return move <= usual_move(self) ||
           (is_out ? count == PENDING : move < 2.0 * move_between(&self->accepted, reading));
}

/* The first growth is to half of the leap. */
static void note_move(tl_conditioner *self, double move) {
    double most = fmax(self->condition.leap / 2.0, GROWTH * self->largest_move);
    self->largest_move = fmax(fmin(move, most), self->largest_move * (1.0 - 1.0 / TL_CONDITIONER_MOVES));
    self->smallest_move = move > 0.0 ? fmin(move, self->smallest_move) : self->smallest_move;
}

static void accept_reading(outputs *to, const tl_reading *reading) {
    tl_conditioner *self = to->conditioner;
    if (self->has_accepted) {
        note_move(self, move_between(reading, &self->accepted));
    }
    filter_reading(to, reading);
    self->accepted = *reading;
    self->has_accepted = true;
    self->since = 0;
}

/* Three moves in a row that leap are the plant's speed. */
static double slowest_move(const tl_conditioner *self, const tl_reading *reading) {
    const tl_reading *pending = self->pending;
    return self->pending_count < PENDING
               ? 0.0
               : fmin(move_between(&self->accepted, &pending[0]),
                      fmin(move_between(&pending[0], &pending[1]), move_between(&pending[1], reading)));
}

static void accept_pending(outputs *to) {
    tl_conditioner *self = to->conditioner;
    if (self->condition.gate > 0.0) {
        restart_filters(self);
    }
    for (size_t i = 0; i < self->pending_count; i++) {
        accept_reading(to, &self->pending[i]);
    }
    self->pending_count = 0;
}

static void accept_overdue(outputs *to, tl_time now) {
    tl_conditioner *self = to->conditioner;
    if (self->condition.leap > 0.0 && self->pending_count > 0) {
        tl_time interval = self->pending[0].stamp - self->accepted.stamp;
        if ((now - self->pending[self->pending_count - 1].stamp) / TL_CONDITIONER_PATIENCE > interval) {
            accept_pending(to);
        }
    }
}

size_t tl_conditioner_wait(tl_conditioner *conditioner, tl_time now, tl_conditioned out[TL_CONDITIONER_LEVEL]) {
    outputs to = {.conditioner = conditioner, .out = out};
    accept_overdue(&to, now);
    return to.count;
}

/* Keeps the last PENDING readings. */
static void keep_pending(tl_conditioner *self, const tl_reading *reading) {
    if (self->pending_count == PENDING) {
        self->pending[0] = self->pending[1];
        self->pending_count--;
    }
    self->pending[self->pending_count++] = *reading;
}

static bool is_lost(const tl_conditioner *self, const tl_reading *reading) {
    return !self->has_accepted || self->since > TL_CONDITIONER_GAP ||
           (self->stale > 0 && reading->stamp - self->accepted.stamp > self->stale);
}

size_t tl_conditioner_take(tl_conditioner *conditioner, const tl_reading *reading, bool *is_rejected,
                           tl_conditioned out[TL_CONDITIONER_LEVEL]) {
    outputs to = {.conditioner = conditioner, .out = out};
    bool is_good = reading->quality == TL_GOOD;
    *is_rejected = false;
    accept_overdue(&to, reading->stamp);
    if (is_good && is_lost(conditioner, reading)) {
        restart_filters(conditioner);
    } else if (is_good && confirms_pending(conditioner, reading)) {
        double slowest = slowest_move(conditioner, reading);
        accept_pending(&to);
        conditioner->largest_move = fmax(conditioner->largest_move, slowest);
    } else if (is_good) {
        *is_rejected = !is_near(conditioner, &conditioner->accepted, reading);
    }
    if (*is_rejected) {
        keep_pending(conditioner, reading);
    } else if (is_good) {
        accept_reading(&to, reading);
        conditioner->pending_count = 0;
    } else {
        add_output(&to, &(tl_conditioned){.reading = *reading, .smooth = reading->value});
    }
    conditioner->since += is_good && !*is_rejected ? 0 : 1;
    return to.count;
}
