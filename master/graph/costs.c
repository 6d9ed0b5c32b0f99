/* Cost of executions: see costs.h. */
#include "master/graph/costs.h"

#include "master/base/estimate.h"

/* Steps between two close measurements. */
enum { CLOSELY_EVERY = 16 };

/* Number of executions that a mean is taken over. */
enum { MEMORY = 16 };

tl_time tl_cost_of(const tl_cost *cost, tl_time times) {
    tl_time more = times > TL_COST_FEW ? times - TL_COST_FEW : 0;
    return (times - more) * cost->most + (tl_time)((double)more * cost->mean);
}

static void learn_cost(tl_costs *costs, tl_cost *cost, tl_time took) {
    if (cost->most == 0) {
        cost->mean = (double)took;
    } else if (!costs->is_committed_step) {
        cost->mean += ((double)took - cost->mean) / MEMORY;
    }
    cost->most = tl_duration_expect(cost->most, took);
    costs->walked = costs->walked || !costs->is_committed_step;
}

bool tl_costs_init(tl_costs *costs, tl_arena *arena, size_t count) {
    costs->count = count;
    costs->each = tl_arena_take(arena, count, sizeof *costs->each);
    costs->ran = tl_arena_take(arena, count, sizeof *costs->ran);
    return costs->each != NULL && costs->ran != NULL;
}

static void forget_lap(tl_costs *costs) {
    costs->ran_count = 0;
    costs->ran_all = false;
}

static void end_measurement(tl_costs *costs) {
    costs->measured_components = 0;
    costs->measured_time = 0;
}

void tl_costs_begin(tl_costs *costs, tl_time (*now)(void *clock), void *clock) {
    costs->now = now;
    costs->clock = clock;
    costs->is_close = now != NULL && costs->steps++ % CLOSELY_EVERY == 0;
    costs->walked = false;
    costs->is_committed_step = false;
    forget_lap(costs);
    end_measurement(costs);
    if (now != NULL) {
        costs->read = now(clock);
    }
}

void tl_costs_rest(tl_costs *costs) {
    for (size_t k = 0; k < costs->count && !costs->walked; k++) {
        costs->each[k].mean -= costs->each[k].mean / MEMORY;
    }
    costs->all.mean -= costs->walked ? 0.0 : costs->all.mean / MEMORY;
}

void tl_costs_commit(tl_costs *costs) {
    costs->is_committed_step = true;
}

static tl_time read_clock(tl_costs *costs) {
    tl_time now = costs->now(costs->clock);
    tl_time took = tl_duration(costs->read, now);
    costs->read = now;
    return took;
}

/* Shares a duration by the expected costs; equally if they are not known. If the duration is much
 * longer than expected, the next macro step is measured component by component. */
static void share_cost(tl_costs *costs, tl_time took) {
    tl_time expected = 0;
    for (size_t i = 0; i < costs->ran_count; i++) {
        expected += costs->each[costs->ran[i]].most;
    }
    double part = expected > 0 ? (double)took / (double)expected : 0.0;
    for (size_t i = 0; i < costs->ran_count; i++) {
        tl_cost *each = &costs->each[costs->ran[i]];
        learn_cost(costs, each, expected > 0 ? (tl_time)(part * (double)each->most) : took / (tl_time)costs->ran_count);
    }
    costs->is_close = costs->is_close || (costs->ran_count > 1 && took > expected + expected / 2);
}

void tl_costs_ran(tl_costs *costs, size_t component) {
    if (costs->now == NULL) {
        return;
    }
    if (costs->is_close) {
        tl_time took = read_clock(costs);
        learn_cost(costs, &costs->each[component], took);
        costs->measured_time += took;
        costs->measured_components++;
    } else if (costs->ran_count < costs->count) {
        costs->ran[costs->ran_count++] = component;
    }
}

void tl_costs_ran_all(tl_costs *costs) {
    costs->ran_all = true;
}

tl_time tl_costs_lap(tl_costs *costs) {
    tl_time took = read_clock(costs);
    bool ran = costs->ran_all || costs->ran_count != 0;
    if (costs->ran_all) {
        learn_cost(costs, &costs->all, took);
    } else if (ran) {
        share_cost(costs, took);
    }
    if (costs->measured_components == costs->count) {
        learn_cost(costs, &costs->all, costs->measured_time);
    }
    if (costs->measured_components != 0) {
        costs->is_close = false;
        end_measurement(costs);
    }
    forget_lap(costs);
    costs->is_committed_step = false;
    return ran ? 0 : took;
}
