/* Of two exact ways the faster one: see faster_way.h. */
#include "master/sync/faster_way.h"

#include <string.h>

/* ns: less is not worth a change, and on a slow machine chance decides on it. */
static const tl_time WORTH = 10000;

/* ns: of one way, once there are rounds enough to have a middle. */
static const tl_time LONGEST = 20000000;
enum { FEWEST = 3 };

/* One component's. */
typedef struct race {
    tl_exchange *exchange;
    size_t index;
    tl_component *component;
    int64_t first;
    tl_time (*now)(void *clock);
    void *clock;
    bool by_copy;
    fmi2FMUstate state; /* its own */
    tl_error *error;
} race;

static tl_status save(race *self) {
    if (!self->by_copy) {
        return tl_component_save(self->component, &self->state, self->error);
    }
    return tl_component_keep(self->component)
               ? TL_OK
               : tl_fail(self->error, TL_FMU_FAILED, "%s: its memory cannot be copied any more", self->component->name);
}

static tl_status go_back(race *self) {
    if (!self->by_copy) {
        return tl_component_restore(self->component, self->state, self->error);
    }
    if (tl_component_come_back(self->component, NULL)) {
        return TL_OK;
    }
    return tl_fail(self->error, self->component->mode == TL_MODE_DEAD ? TL_FMU_FATAL : TL_FMU_FAILED,
                   "%s: does not come back to where its proof began", self->component->name);
}

static tl_status step(const race *self) {
    const tl_exchange *exchange = self->exchange;
    return tl_component_step(self->component, tl_seconds(tl_time_of_step(0, exchange->step, self->first)),
                             tl_seconds(exchange->step), false, self->error);
}

static tl_status take_round(race *self, tl_time *took) {
    tl_time begun = self->now(self->clock);
    tl_status status = save(self);
    status = status == TL_OK ? step(self) : status;
    status = status == TL_OK ? go_back(self) : status;
    *took = self->now(self->clock) - begun;
    return status;
}

static void put(tl_time *times, int count, tl_time time) {
    int i = count;
    for (; i > 0 && times[i - 1] > time; i--) {
        times[i] = times[i - 1];
    }
    times[i] = time;
}

/* The middle one of some rounds; not the first, which may have to allocate. 0: a step fails, which the proof has seen or need not see. */
static tl_time take_time(race *self) {
    tl_time times[TL_FASTER_WAY_ROUNDS];
    tl_time took;
    int count = 0;
    tl_status status = take_round(self, &took);
    tl_time begun = self->now(self->clock);
    while (status == TL_OK && count < TL_FASTER_WAY_ROUNDS &&
           (count < FEWEST || self->now(self->clock) - begun < LONGEST)) {
        status = take_round(self, &took);
        put(times, count++, took);
    }
    return status == TL_OK ? times[count / 2] : 0;
}

/* To the copy, which knows of no state of its own: none is left. */
static tl_status begin_anew(race *self) {
    tl_component_forget(self->component, &self->state);
    self->by_copy = true;
    return go_back(self);
}

static tl_status run(race *self, tl_fmi2_times *times) {
    tl_status status = begin_anew(self);
    if (status == TL_OK) {
        self->by_copy = false;
        times->by_states = take_time(self);
        status = begin_anew(self);
    }
    if (status == TL_OK) {
        times->by_copy = take_time(self);
        status = begin_anew(self);
    }
    return status;
}

static bool is_faster(const tl_fmi2_times *times) {
    return times->by_copy > 0 && times->by_states - times->by_copy >= WORTH &&
           (double)times->by_states >= TL_FASTER_WAY_MARGIN * (double)times->by_copy;
}

static tl_status choose(race *self, bool *taken) {
    tl_fmi2_times times = {0};
    tl_snapshot_forget(&self->exchange->home, self->index);
    tl_status status = run(self, &times);
    if (status == TL_OK && is_faster(&times)) {
        *taken = tl_component_prefer_copy(self->component, &times) || *taken;
    }
    return status;
}

tl_status tl_faster_way_choose(tl_exchange *exchange, int64_t first, tl_time (*now)(void *clock), void *clock,
                               bool *taken, tl_error *error) {
    bool any = false;
    tl_status status = TL_OK;
    *taken = false;
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        race one = {.exchange = exchange,
                    .index = i,
                    .component = &exchange->components[i],
                    .first = first,
                    .now = now,
                    .clock = clock,
                    .error = error};
        if (exchange->is_kept[i] && tl_component_has_choice(one.component)) {
            any = true;
            exchange->failed = i;
            status = choose(&one, taken);
        }
    }
    if (status != TL_OK || !any) {
        return status;
    }
    memcpy(exchange->home.live, exchange->home.values, exchange->home.values_size);
    return tl_exchange_save(exchange, error);
}
