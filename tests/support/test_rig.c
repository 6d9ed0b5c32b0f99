/* Co-simulation without a search: see test_rig.h. */
#include "tests/support/test_rig.h"

#include <assert.h>
#include <string.h>

#include "tests/support/random_numbers.h"

void tl_test_rig_plan(tl_test_rig *rig, tl_test_plan *plan) {
    memset(rig, 0, sizeof *rig);
    rig->plan = plan;
    tl_arena_init(&rig->arena);
    tl_report *report = &plan->report;
    tl_graph_build(&rig->graph, &rig->arena, &plan->plan, report);
    for (size_t i = 0; i < plan->plan.match_count; i++) {
        rig->matched[i] = tl_graph_output(&rig->graph, plan->match[i].variable, plan->match[i].where, report);
        assert(rig->matched[i] != NULL);
    }
    for (size_t i = 0; i < plan->plan.adjust_count; i++) {
        rig->adjusted[i] = tl_graph_adjust(&rig->graph, &plan->adjust[i], report);
        assert(rig->adjusted[i] != NULL);
    }
    bool placed = tl_horizon_init(&rig->horizon, &rig->arena, &rig->graph, rig->adjusted, rig->matched, report);
    assert(placed);
    (void)placed;
}

/* Adjusted variables begin with their start values. */
static void place_adjusted(tl_test_rig *rig) {
    for (size_t v = 0; v < rig->horizon.variables; v++) {
        const tl_port *port = rig->adjusted[v];
        const tl_value *start = &port->variable->start;
        tl_exchange_place_adjusted(&rig->exchange, v, port, tl_graph_connection_to(&rig->graph, port),
                                   port->type == TL_REAL ? start->real : (double)start->integer);
    }
}

static void save_executions(tl_test_rig *rig, uint32_t nodes) {
    const tl_plan *plan = &rig->plan->plan;
    tl_keep *keep = tl_arena_take(&rig->arena, plan->component_count, sizeof *keep);
    uint32_t *capacity = tl_arena_take(&rig->arena, plan->component_count, sizeof *capacity);
    for (size_t k = 0; k < plan->component_count; k++) {
        keep[k] = plan->components[k].keep;
        capacity[k] = nodes;
    }
    bool placed = tl_exchange_save_executions(&rig->exchange, &rig->arena, keep,
                                              plan->saving.structure ? rig->horizon.reach : NULL,
                                              plan->saving.sequences ? capacity : NULL, rig->horizon.prediction) &&
                  tl_ledger_init(&rig->ledger, &rig->arena, &rig->horizon, &rig->exchange.plant, plan, 1000);
    rig->track = tl_track_create(&rig->arena, &rig->exchange, &rig->graph, rig->horizon.prediction);
    assert(placed && rig->track != NULL);
    (void)placed;
}

static void instantiate(tl_test_rig *rig) {
    tl_status status = TL_OK;
    for (size_t k = 0; k < rig->graph.component_count; k++) {
        const tl_plan_component *description = &rig->plan->components[k];
        tl_component *component = &rig->graph.components[k];
        status = tl_component_instantiate(component, description->callbacks, description->resources, &rig->error);
        assert(status == TL_OK);
        for (size_t i = 0; i < description->set_count && status == TL_OK; i++) {
            const tl_variable *variable = tl_model_variable(component->model, description->set[i].variable);
            status = tl_component_set_start(component, variable, &description->set[i].value, &rig->error);
            assert(status == TL_OK);
        }
    }
    (void)status;
}

void tl_test_rig_start(tl_test_rig *rig, tl_test_plan *plan, uint32_t nodes) {
    static const double zeros[TL_MAX_SIGNALS];
    tl_test_rig_plan(rig, plan);
    tl_status status = tl_exchange_init(&rig->exchange, &rig->arena, &rig->graph,
                                        2 * (size_t)rig->horizon.prediction + 4, &rig->error);
    assert(status == TL_OK);
    place_adjusted(rig);
    save_executions(rig, nodes);
    instantiate(rig);
    rig->sample.tick = -1;
    tl_test_rig_push(rig, zeros);
    status = tl_exchange_initialize(&rig->exchange, 0, rig->sample.values, &rig->error);
    assert(status == TL_OK);
    status = tl_exchange_start(&rig->exchange, 0, NULL, &rig->error);
    assert(status == TL_OK);
    (void)status;
}

void tl_test_rig_end(tl_test_rig *rig) {
    for (size_t k = 0; k < rig->graph.component_count; k++) {
        if (rig->exchange.component_count != 0) {
            tl_exchange_end_component(&rig->exchange, k);
        }
        tl_component_free(&rig->graph.components[k]);
    }
    tl_arena_release(&rig->arena);
    memset(rig, 0, sizeof *rig);
}

void tl_test_rig_push(tl_test_rig *rig, const double *values) {
    rig->sample.tick++;
    memcpy(rig->sample.values, values, rig->plan->plan.signal_count * sizeof *values);
    tl_plant_push(&rig->exchange.plant, &rig->sample);
}

static uint64_t count(const tl_test_rig *rig, size_t k) {
    if (k == rig->graph.component_count) {
        return rig->exchange.plant.executions;
    }
    uint64_t executions = rig->graph.components[k].executions;
    return rig->exchange.cached == NULL ? executions : executions - rig->exchange.cached[k].repeated;
}

static void set_inputs(tl_test_rig *rig, const double *u, uint32_t depth) {
    for (size_t v = 0; v < rig->horizon.variables; v++) {
        tl_exchange_set_adjusted(&rig->exchange, v, tl_horizon_value(&rig->horizon, u, v, depth));
    }
}

static uint64_t count_all(const tl_test_rig *rig) {
    uint64_t sum = 0;
    for (size_t k = 0; k < rig->graph.component_count; k++) {
        sum += rig->graph.components[k].executions;
    }
    return sum;
}

/* Rolls back to t_i; the first call after a commit delivers the plant's values of t_i instead. Counts
 * executions from here on. */
static void begin(tl_test_rig *rig) {
    rig->all_before = count_all(rig);
    for (size_t k = 0; k <= rig->graph.component_count; k++) {
        rig->before[k] = count(rig, k);
        rig->foretold[k] = tl_ledger_predicted(&rig->ledger, k);
    }
    if (rig->begun) {
        rig->status = tl_track_rewind(rig->track, &rig->error);
    } else {
        tl_plant_deliver(&rig->exchange.plant, rig->step);
        tl_exchange_deliver(&rig->exchange);
        rig->status = tl_track_begin(rig->track, &rig->error);
        rig->begun = true;
    }
}

static uint64_t add_outputs(const tl_test_rig *rig, uint64_t sum) {
    for (size_t i = 0; i < rig->plan->plan.match_count; i++) {
        double y = tl_exchange_value(&rig->exchange, rig->matched[i]);
        uint64_t bits = 0;
        memcpy(&bits, &y, sizeof bits);
        sum = rig->plan->match[i].weight > 0.0 ? tl_test_mix(sum + bits + 1) : sum;
    }
    return sum;
}

uint64_t tl_test_rig_walk(tl_test_rig *rig, const double *u, uint32_t steps) {
    uint64_t sum = 0;
    uint32_t depth = 0;
    begin(rig);
    while (rig->status == TL_OK && depth < steps) {
        set_inputs(rig, u, depth);
        rig->status = tl_track_try(rig->track, rig->step + depth, depth, &rig->error);
        if (rig->status == TL_OK) {
            depth++;
            sum = depth >= rig->horizon.distance ? add_outputs(rig, sum) : sum;
            if (rig->watch != NULL) {
                rig->watch(rig, depth);
            }
        }
    }
    rig->walked = depth;
    tl_ledger_walked(&rig->ledger, u, depth, rig->status == TL_OK ? SIZE_MAX : rig->exchange.failed);
    (void)tl_ledger_evaluate(&rig->ledger);
    return rig->status == TL_OK ? sum : 0;
}

uint64_t tl_test_rig_try(tl_test_rig *rig, const double *u) {
    return tl_test_rig_walk(rig, u, rig->horizon.prediction);
}

uint64_t tl_test_rig_commit(tl_test_rig *rig, const double *u) {
    double values[TL_MAX_ADJUST];
    uint64_t sum = 0;
    begin(rig);
    if (rig->status == TL_OK) {
        set_inputs(rig, u, 0);
        rig->status = tl_exchange_commit(&rig->exchange, rig->step, &rig->error);
    }
    if (rig->status != TL_OK) {
        return 0;
    }
    for (size_t v = 0; v < rig->horizon.variables; v++) {
        values[v] = tl_horizon_value(&rig->horizon, u, v, 0);
    }
    tl_ledger_commit(&rig->ledger, values);
    (void)tl_ledger_evaluate(&rig->ledger);
    rig->step++;
    rig->begun = false;
    for (size_t i = 0; i < rig->exchange.values_size; i++) {
        sum = tl_test_mix(sum + rig->exchange.values[i]);
    }
    return sum;
}

uint64_t tl_test_rig_done(const tl_test_rig *rig, size_t k) {
    return count(rig, k) - rig->before[k];
}

uint64_t tl_test_rig_predicted(const tl_test_rig *rig, size_t k) {
    return tl_ledger_predicted(&rig->ledger, k) - rig->foretold[k];
}

uint64_t tl_test_rig_executions(const tl_test_rig *rig) {
    return count_all(rig) - rig->all_before;
}
