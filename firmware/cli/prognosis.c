/* The prognosis: see prognosis.h. */
#include "firmware/cli/prognosis.h"

#include <assert.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "master/base/duration.h"

/* Steps of the dry run; less where they take more time than that. In a twin that saves nothing only every sixteenth one is looked at
 * component by component, and what the first ones took is to be forgotten. */
enum { DRY_STEPS = 1600, WARMING_STEPS = 10 };
static const tl_time LONGEST = TL_SECOND;

/* ---- executions ---- */

static void count_executions(const tl_assembly *assembly, tl_prognosis *prognosis) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    uint64_t evaluations = assembly->config.budget_evaluations;
    prognosis->step = facts.executions_per_step;
    prognosis->plain = facts.executions_per_evaluation;
    for (size_t k = 0; k < facts.components; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, k);
        prognosis->first += entry.first_need;
        prognosis->next += entry.next_need;
    }
    prognosis->worst = prognosis->step;
    if (facts.unknowns != 0) {
        prognosis->worst += prognosis->first + (evaluations - 1) * prognosis->next;
    }
}

/* ---- time ---- */

static tl_status take_step(const tl_assembly *assembly, tl_sample *sample, tl_error *error) {
    const tl_budget budget = {
        .evaluations = 1, .time = INT64_MAX / 4, .started = tl_clock_now(NULL), .now = tl_clock_now};
    tl_record record;
    bool ready = false;
    tl_status status = tl_twin_step(assembly->twin, sample, &budget, &record, &ready, error);
    sample->tick++;
    return status;
}

/* The twin keeps the longest time of late; the least of that is free of what the machine did besides. */
static void note_costs(const tl_assembly *assembly, tl_prognosis *prognosis) {
    size_t count = tl_twin_get_facts(assembly->twin).components;
    assert(count <= TL_RECORDER_COMPONENTS);
    for (size_t k = 0; k < count; k++) {
        tl_time cost = tl_twin_get_ledger(assembly->twin, k).cost;
        prognosis->cost[k] = prognosis->steps == 0 || cost < prognosis->cost[k] ? cost : prognosis->cost[k];
    }
}

tl_status tl_prognosis_run_dry(const tl_assembly *assembly, int64_t ticks, tl_error *error) {
    tl_sample sample = {0};
    tl_status status = TL_OK;
    memset(sample.quality, TL_NO_LINK, assembly->config.signal_count);
    while (status == TL_OK && sample.tick < ticks) {
        status = take_step(assembly, &sample, error);
    }
    return status;
}

/* No signal has a reading: nothing is matched, and every step is a free one. */
static void run_dry(const tl_assembly *assembly, tl_prognosis *prognosis) {
    tl_sample sample = {0};
    int64_t before = (int64_t)tl_twin_get_facts(assembly->twin).lead + WARMING_STEPS;
    tl_status status = TL_OK;
    memset(sample.quality, TL_NO_LINK, assembly->config.signal_count);
    while (status == TL_OK && sample.tick < before) {
        status = take_step(assembly, &sample, &prognosis->error);
    }
    tl_time begun = tl_clock_now(NULL);
    while (status == TL_OK && prognosis->steps < DRY_STEPS && tl_clock_now(NULL) - begun < LONGEST) {
        status = take_step(assembly, &sample, &prognosis->error);
        note_costs(assembly, prognosis);
        prognosis->steps++;
    }
    prognosis->next_tick = sample.tick;
    if (status != TL_OK || prognosis->steps == 0) {
        prognosis->steps = 0;
        memset(prognosis->cost, 0, sizeof prognosis->cost);
        return;
    }
    prognosis->step_time = (tl_clock_now(NULL) - begun) / (tl_time)prognosis->steps;
}

static void predict_time(const tl_assembly *assembly, tl_prognosis *prognosis) {
    size_t count = tl_twin_get_facts(assembly->twin).components;
    uint32_t evaluations = assembly->config.budget_evaluations;
    tl_time once = 0;
    tl_time next = 0;
    for (size_t k = 0; k < count; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(assembly->twin, k);
        once = tl_duration_sum(once, prognosis->cost[k], 1 + (uint64_t)entry.first_need);
        next = tl_duration_sum(next, prognosis->cost[k], entry.next_need);
    }
    tl_time left = assembly->config.budget_time - once;
    prognosis->worst_time = tl_duration_sum(once, next, evaluations - 1);
    prognosis->fitting = left < 0 ? 0 : evaluations;
    if (left >= 0 && next > 0 && left / next + 1 < (tl_time)evaluations) {
        prognosis->fitting = (uint32_t)(left / next + 1);
    }
}

void tl_prognosis_make(const tl_assembly *assembly, tl_prognosis *prognosis) {
    *prognosis = (tl_prognosis){0};
    count_executions(assembly, prognosis);
    run_dry(assembly, prognosis);
    if (prognosis->steps != 0 && tl_twin_get_facts(assembly->twin).unknowns != 0) {
        predict_time(assembly, prognosis);
    }
}
