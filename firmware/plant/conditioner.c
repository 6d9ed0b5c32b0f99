/* Conditioner: see conditioner.h. */
#include "firmware/plant/conditioner.h"

#include <math.h>

enum { PENDING = TL_CONDITIONER_LEVEL - 1 };

void tl_conditioner_init(tl_conditioner *conditioner, const tl_condition *condition, tl_time stale) {
    *conditioner = (tl_conditioner){.condition = *condition, .stale = stale, .is_empty = true, .newest = TL_TIME_NEVER};
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

/* ---- the gate ---- */

static bool is_near(const tl_conditioner *self, const tl_reading *one, const tl_reading *other) {
    return self->condition.gate <= 0.0 || fabs(one->value - other->value) <= self->condition.gate;
}

/* Returns true if this is the third rejected reading in a row that agrees with the other two. */
static bool is_new_level(const tl_conditioner *self, const tl_reading *reading) {
    const tl_reading *pending = self->pending;
    return self->pending_count == PENDING && is_near(self, &pending[0], &pending[1]) &&
           is_near(self, &pending[0], reading) && is_near(self, &pending[1], reading);
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
    if (is_good && is_lost(conditioner, reading)) {
        restart_filters(conditioner);
    } else if (is_good && !is_near(conditioner, &conditioner->accepted, reading)) {
        *is_rejected = !is_new_level(conditioner, reading);
        if (!*is_rejected) {
            restart_filters(conditioner);
            filter_reading(&to, &conditioner->pending[0]);
            filter_reading(&to, &conditioner->pending[1]);
        }
    }
    if (*is_rejected) {
        keep_pending(conditioner, reading);
    } else if (is_good) {
        filter_reading(&to, reading);
        conditioner->accepted = *reading;
        conditioner->has_accepted = true;
        conditioner->pending_count = 0;
    } else {
        add_output(&to, &(tl_conditioned){.reading = *reading, .smooth = reading->value});
    }
    bool is_accepted = is_good && !*is_rejected;
    conditioner->since = is_accepted ? 0 : conditioner->since + 1;
    return to.count;
}
