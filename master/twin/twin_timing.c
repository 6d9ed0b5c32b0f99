/* Timing of a component: see twin_timing.h. */
#include "master/twin/twin_timing.h"

#include "master/twin/twin_parts.h"

/* Durations of one kind, sorted. */
typedef struct sorted_times {
    uint32_t count;
    tl_time time[TL_TWIN_TIMINGS];
} sorted_times;

typedef struct stopwatch {
    tl_component *component;
    tl_time size; /* of a step */
    int64_t next; /* next step */
    tl_time (*now)(void *clock);
    void *clock;
    fmi2FMUstate state;
    tl_error error;
    sorted_times steps, saves, restores;
} stopwatch;

static void insert_time(sorted_times *times, tl_time time) {
    uint32_t i = times->count++;
    for (; i > 0 && times->time[i - 1] > time; i--) {
        times->time[i] = times->time[i - 1];
    }
    times->time[i] = time;
}

static tl_twin_spread spread_of(const sorted_times *times) {
    if (times->count == 0) {
        return (tl_twin_spread){0};
    }
    return (tl_twin_spread){.median = times->time[times->count / 2],
                            .high = times->time[(times->count * 99 - 1) / 100],
                            .worst = times->time[times->count - 1]};
}

static bool step(stopwatch *self) {
    return tl_component_step(self->component, tl_seconds(tl_time_of_step(0, self->size, self->next)),
                             tl_seconds(self->size), false, &self->error) == TL_OK;
}

static bool take_round(stopwatch *self) {
    tl_time started_at = self->now(self->clock);
    if (tl_component_save(self->component, &self->state, &self->error) != TL_OK) {
        return false;
    }
    tl_time saved = self->now(self->clock);
    if (!step(self)) {
        return false;
    }
    tl_time stepped = self->now(self->clock);
    if (tl_component_restore(self->component, self->state, &self->error) != TL_OK) {
        return false;
    }
    tl_time restored = self->now(self->clock);
    insert_time(&self->saves, saved - started_at);
    insert_time(&self->steps, stepped - saved);
    insert_time(&self->restores, restored - stepped);
    bool is_well = step(self);
    self->next++;
    return is_well;
}

void tl_twin_time_component(tl_twin *twin, size_t component, tl_time (*now)(void *clock), void *clock, tl_time longest,
                            tl_twin_timing *timing) {
    stopwatch self = {.component = &twin->exchange.components[component],
                      .size = twin->exchange.step,
                      .next = twin->exchange.plant.newest + 1 - (int64_t)twin->lead,
                      .now = now,
                      .clock = clock};
    fmi2FMUstate first = NULL;
    tl_time started_at = now(clock);
    bool is_well = tl_component_save(self.component, &first, &self.error) == TL_OK;
    for (uint32_t i = 0; is_well && i < TL_TWIN_TIMINGS && (i == 0 || now(clock) - started_at < longest); i++) {
        is_well = take_round(&self);
    }
    *timing = (tl_twin_timing){0};
    if (is_well && tl_component_restore(self.component, first, &self.error) == TL_OK) {
        timing->rounds = self.saves.count;
        timing->step = spread_of(&self.steps);
        timing->save = spread_of(&self.saves);
        timing->restore = spread_of(&self.restores);
    }
    tl_component_forget(self.component, &self.state);
    tl_component_forget(self.component, &first);
}
