/* Timing of a component: see twin_timing.h. */
#include "master/twin/twin_timing.h"

#include <math.h>
#include <string.h>

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

/* ---- choice of what is kept ---- */

/* Caches and ledger take about this time for each step of a candidate, and in addition for each
 * component in it, ns (tests/bench/keep.py). */
static const double BOOKKEEPING = 100.0;
static const double BOOKKEEPING_EACH = 60.0;

/* Of secant: the first guess, and one move by the slope that it already knows. */
static double expected_evaluations(const tl_twin *twin) {
    const tl_optimiser_class *solver = twin->synchroniser.solver;
    return solver != NULL && strcmp(solver->name, "secant") == 0 ? 2.0 : (double)twin->tuning.evaluations;
}

/* Evaluations that are saved because others begin alike: with one unknown for each step, those that
 * move one unknown share on average half of their steps. The first guess and one more do not. */
static double alike(const tl_horizon *horizon, double evaluations) {
    double unknowns = (double)horizon->count;
    double moves = unknowns < evaluations - 2.0 ? unknowns : evaluations - 2.0;
    return horizon->count > horizon->variables ? 0.5 * moves : 0.0;
}

/* Expected times of a component in a search, ns. */
typedef struct search_times {
    double with_states;
    double without_states;
    double bookkeeping; /* of the whole twin, if a component keeps results */
} search_times;

/* With all states kept, the first evaluation mostly needs no restore and one new step, because it
 * continues the committed ones, and the commit needs none. */
static search_times expect_times(const tl_twin *twin, size_t component, const tl_twin_timing *timing) {
    const tl_horizon *horizon = &twin->synchroniser.horizon;
    double evaluations = expected_evaluations(twin);
    uint32_t reach = twin->exchange.reach != NULL ? horizon->reach[component] : horizon->prediction;
    double all = 1.0 + evaluations * reach;
    double later = (double)tl_horizon_next_need(horizon, component, reach);
    double needed = 1.0 + (evaluations - 1.0 - alike(horizon, evaluations)) * later;
    double step = (double)timing->step.median;
    double save = (double)timing->save.median;
    double restore = (double)timing->restore.median;
    double bookkeeping = BOOKKEEPING + BOOKKEEPING_EACH * (double)twin->exchange.component_count;
    return (search_times){.with_states = needed * (step + save) + (evaluations - 1.0) * restore,
                          .without_states = all * step + save + evaluations * restore,
                          .bookkeeping = evaluations * (double)horizon->prediction * bookkeeping};
}

double tl_twin_part_without_states(const tl_twin *twin, size_t component, const tl_twin_timing *timing) {
    search_times times = expect_times(twin, component, timing);
    return times.without_states / (times.with_states + times.bookkeeping / (double)twin->exchange.component_count);
}

static tl_time lasted(tl_time from, tl_time to, tl_time reading) {
    return to - from > reading ? to - from - reading : 0;
}

/* From the saved start, and back to it. */
static bool repeat_step(stopwatch *self, fmi2FMUstate start) {
    tl_time started_at = self->now(self->clock);
    if (!step(self)) {
        return false;
    }
    tl_time stepped = self->now(self->clock);
    if (tl_component_save(self->component, &self->state, &self->error) != TL_OK) {
        return false;
    }
    tl_time saved = self->now(self->clock);
    if (tl_component_restore(self->component, start, &self->error) != TL_OK) {
        return false;
    }
    tl_time restored = self->now(self->clock);
    tl_time reading =
        self->now(self->clock) - restored; /* each duration includes one, which may be longer than a step */
    insert_time(&self->steps, lasted(started_at, stepped, reading));
    insert_time(&self->saves, lasted(stepped, saved, reading));
    insert_time(&self->restores, lasted(saved, restored, reading));
    return true;
}

/* The first round does not count, because it may allocate memory. */
static tl_status measure_repeated(tl_twin *twin, size_t component, tl_twin_timing *timing, tl_error *error) {
    enum { ROUNDS = 15 };
    static const tl_time longest = 5000000;
    tl_exchange *exchange = &twin->exchange;
    fmi2FMUstate start = exchange->home.states[component];
    stopwatch self = {
        .component = &exchange->components[component], .size = exchange->step, .next = twin->first, .now = twin->now};
    tl_time started_at = twin->now(NULL);
    bool is_well = repeat_step(&self, start);
    self.steps.count = 0;
    self.saves.count = 0;
    self.restores.count = 0;
    while (is_well && self.steps.count < ROUNDS && (self.steps.count == 0 || twin->now(NULL) - started_at < longest)) {
        is_well = repeat_step(&self, start);
    }
    *timing = (tl_twin_timing){.rounds = is_well ? self.steps.count : 0,
                               .step = spread_of(&self.steps),
                               .save = spread_of(&self.saves),
                               .restore = spread_of(&self.restores)};
    tl_component_forget(self.component, &self.state);
    twin->proof.executions += self.component->executions;
    self.component->executions = 0;
    memcpy(exchange->home.live, exchange->home.values, exchange->home.values_size);
    return is_well ? TL_OK : tl_component_restore(self.component, start, error);
}

/* If no component keeps results, neither caches nor remembered candidates can save executions. */
static void drop_unused(tl_twin *twin) {
    const tl_cached_component *cached = twin->exchange.cached;
    bool is_used = false;
    twin->unsaved = 0;
    for (size_t k = 0; k < twin->exchange.component_count; k++) {
        bool is_kept = cached != NULL && cached[k].keep != TL_KEEP_NONE;
        is_used = is_used || is_kept;
        twin->synchroniser.ledger.executes[k] = cached != NULL && !is_kept;
        twin->unsaved |= k < TL_TWIN_UNSAVED && !is_kept ? UINT64_C(1) << k : 0;
    }
    if (!is_used) {
        tl_exchange_drop_caches(&twin->exchange, twin->synchroniser.horizon.prediction);
        tl_ledger_drop_candidates(&twin->synchroniser.ledger);
    }
}

/* Chooses for one component; returns the time that its states save in a search, ns. Infinity: it
 * keeps them in any case. */
static tl_status choose_keep(tl_twin *twin, size_t k, double *gain, tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    tl_keep *keep = &exchange->cached[k].keep;
    tl_twin_timing timing = {.rounds = 0};
    bool is_timed = *keep == TL_KEEP_AUTO && k < TL_TWIN_UNSAVED && twin->now != NULL && twin->proof.has_midst &&
                    exchange->components[k].fmi->replay.most == 0;
    tl_status status = is_timed ? measure_repeated(twin, k, &timing, error) : TL_OK;
    search_times times = expect_times(twin, k, &timing);
    *gain = *keep == TL_KEEP_NONE ? 0.0 : timing.rounds == 0 ? HUGE_VAL : times.without_states - times.with_states;
    if (*keep == TL_KEEP_AUTO) {
        *keep = *gain >= 0.0 ? TL_KEEP_STATES : TL_KEEP_NONE;
    }
    return status;
}

tl_status tl_twin_choose_keep(tl_twin *twin, tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    tl_status status = TL_OK;
    double gains = 0.0;
    for (size_t k = 0; exchange->cached != NULL && k < exchange->component_count && status == TL_OK; k++) {
        double gain = 0.0;
        status = choose_keep(twin, k, &gain, error);
        gains += fmax(gain, 0.0);
    }
    const tl_twin_timing nothing = {.rounds = 0};
    bool is_worth = gains >= expect_times(twin, 0, &nothing).bookkeeping;
    for (size_t k = 0; exchange->cached != NULL && k < exchange->component_count && !is_worth; k++) {
        exchange->cached[k].keep = TL_KEEP_NONE;
    }
    drop_unused(twin);
    return status;
}
