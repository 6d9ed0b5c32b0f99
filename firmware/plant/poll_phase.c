/* Poll phase: see poll_phase.h. */
#include "firmware/plant/poll_phase.h"

#include <stdlib.h>

enum { FIRST_WINDOW = 2, LATE_PERIODS = 3 };

/* Covers what differs from one window to the next. */
static const tl_time MARGIN = TL_SECOND / 5000;

void tl_poll_phase_begin(tl_poll_phase *self, tl_time period, tl_time now) {
    *self = (tl_poll_phase){.period = period, .due = now, .window = FIRST_WINDOW};
}

static int compare_times(const void *one, const void *other) {
    const tl_time *a = one;
    const tl_time *b = other;
    return (*a > *b) - (*a < *b);
}

static tl_time best_lead(tl_poll_phase *self) {
    tl_time best = self->period;
    tl_time least = INT64_MAX;
    qsort(self->needed, self->polls, sizeof self->needed[0], compare_times);
    for (uint32_t i = 0; i < self->polls; i++) {
        tl_time cost = self->needed[i] + LATE_PERIODS * self->period / self->polls * (self->polls - 1 - i);
        best = cost < least ? self->needed[i] : best;
        least = cost < least ? cost : least;
    }
    return best + MARGIN < self->period ? best + MARGIN : self->period;
}

static void learn_lead(tl_poll_phase *self, tl_time needed) {
    self->needed[self->polls] = needed;
    self->polls++;
    if (self->polls == self->window) {
        self->lead = best_lead(self);
        self->window = self->window < TL_POLL_PHASE_WINDOW ? 2 * self->window : self->window;
        self->polls = 0;
    }
}

/* Returns the first instant of the grid that is not before `earliest`. */
static tl_time first_of_grid(tl_time origin, tl_time period, tl_time earliest) {
    tl_time past = (earliest - origin % period) % period; /* does not overflow */
    past += past < 0 ? period : 0;
    return past == 0 ? earliest : earliest + period - past;
}

tl_time tl_poll_phase_next(tl_poll_phase *self, tl_time origin, tl_time now) {
    tl_time start = self->due - self->lead;
    tl_time earliest = now > start + self->period ? now : start + self->period;
    /* With the old lead, so that an increase of the lead skips no instant. */
    self->due = first_of_grid(origin > 0 ? origin : self->due, self->period, earliest + self->lead);
    if (origin >= 0 && now - start <= self->period) {
        learn_lead(self, now - start);
    }
    return self->due - self->lead;
}
