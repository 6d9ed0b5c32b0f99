/* The twin: see twin.h. */
#include "master/twin.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "master/base/arena.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/sync/lock.h"

struct tl_twin {
    tl_arena arena;
    tl_graph graph;
    tl_exchange exchange;
    tl_lock lock;
    tl_objective_term terms[TL_MAX_MATCH];
    const tl_port *adjust_ports[TL_MAX_ADJUST];
    const tl_port *outputs[TL_MAX_SIGNALS];
    tl_metrics metrics[TL_MAX_MATCH];
    tl_measurements measurements;
    double *proof;    /* for prove_rollback(): one value per port */
    tl_status ended;  /* not TL_OK: a step has failed, nothing may follow */
    bool has_pending; /* mode ahead: computed, its measurement not there yet */
    tl_record pending;
};

/* ---- build ---- */

static void build_matches(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->match_count; i++) {
        const tl_plan_match *match = &plan->match[i];
        tl_objective_term *term = &twin->terms[i];
        term->port = tl_graph_output(&twin->graph, match->variable, match->where, report);
        if (term->port != NULL) {
            term->signal = tl_graph_match_signal(&twin->graph, match, term->port, &term->conversion, report);
        }
        term->tolerance = match->tolerance;
        term->weight = match->weight;
    }
    twin->lock.objective.terms = twin->terms;
    twin->lock.objective.term_count = plan->match_count;
    twin->lock.objective.exchange = &twin->exchange;
}

static void check_state(const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->component_count; i++) {
        const tl_plan_component *component = &plan->components[i];
        const tl_fmi2 *fmi = component->functions;
        if (!component->model->capabilities.can_get_and_set_state || fmi->get_fmu_state == NULL ||
            fmi->set_fmu_state == NULL || fmi->free_fmu_state == NULL) {
            tl_report_add(
                report, TL_BAD_DATA, component->where,
                "the FMU of %s cannot save and restore its state "
                "(canGetAndSetFMUstate), which synchronising needs; have it exported with that capability, or "
                "remove \"synchronise\"",
                component->name);
        }
    }
}

static void build_adjusted(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    tl_lock *lock = &twin->lock;
    lock->count = plan->adjust_count;
    for (size_t i = 0; i < plan->adjust_count; i++) {
        const tl_plan_adjust *adjust = &plan->adjust[i];
        const tl_port *port = tl_graph_adjust(&twin->graph, adjust, report);
        twin->adjust_ports[i] = port;
        if (port != NULL) {
            lock->step[i] = adjust->step;
            lock->lower[i] = fmax(adjust->lower, port->variable->minimum);
            lock->upper[i] = fmin(adjust->upper, port->variable->maximum);
            if (!(lock->lower[i] < lock->upper[i])) {
                tl_report_add(report, TL_BAD_DATA, adjust->where,
                              "nothing is left to adjust between the bounds %g and %g "
                              "(those configured and those the FMU declares)",
                              lock->lower[i], lock->upper[i]);
            }
        }
    }
    lock->margin = plan->margin;
    lock->solver = tl_optimiser_find(plan->algorithm);
    if (plan->adjust_count != 0 && lock->solver == NULL) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.algorithm", "found \"%s\", expected one of %s", plan->algorithm,
                      tl_optimiser_names());
    }
}

/* The shortest distance from one adjusted variable to any matched output; TL_UNREACHABLE where there is none. */
static size_t shortest_from(const tl_twin *twin, const tl_plan *plan, size_t adjust, size_t *scratch) {
    size_t shortest = TL_UNREACHABLE;
    for (size_t i = 0; i < plan->match_count; i++) {
        if (twin->terms[i].port != NULL && plan->match[i].weight > 0.0) {
            size_t distance =
                tl_graph_distance(&twin->graph, twin->adjust_ports[adjust]->node, twin->terms[i].port->node, scratch);
            if (distance != TL_UNREACHABLE && distance + 1 < shortest) {
                shortest = distance + 1;
            }
        }
    }
    return shortest;
}

static void check_matches_reached(const tl_twin *twin, const tl_plan *plan, size_t *scratch, tl_report *report) {
    for (size_t i = 0; i < plan->match_count; i++) {
        bool reached = plan->match[i].weight <= 0.0 || twin->terms[i].port == NULL;
        for (size_t k = 0; k < plan->adjust_count && !reached; k++) {
            reached = twin->adjust_ports[k] == NULL ||
                      tl_graph_distance(&twin->graph, twin->adjust_ports[k]->node, twin->terms[i].port->node,
                                        scratch) != TL_UNREACHABLE;
        }
        if (!reached) {
            tl_report_add(report, TL_BAD_DATA, plan->match[i].where,
                          "no path leads from any adjusted variable to %s: give "
                          "it \"weight\": 0, or adjust something that reaches it",
                          plan->match[i].variable);
        }
    }
}

/* T_D = min over pairs (eq. 4.2), and every adjusted variable must matter within T_P. */
static void build_horizon(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    tl_lock *lock = &twin->lock;
    size_t *scratch = tl_arena_take(&twin->arena, plan->component_count + 1, sizeof *scratch);
    size_t shortest[TL_MAX_ADJUST];
    size_t smallest = TL_UNREACHABLE;
    size_t largest = 0;
    for (size_t i = 0; i < plan->adjust_count && scratch != NULL; i++) {
        shortest[i] = twin->adjust_ports[i] == NULL ? 1 : shortest_from(twin, plan, i, scratch);
        if (shortest[i] == TL_UNREACHABLE) {
            tl_report_add(report, TL_BAD_DATA, plan->adjust[i].where,
                          "no path leads from %s to any matched output: it can "
                          "correct nothing",
                          plan->adjust[i].variable);
        } else {
            smallest = shortest[i] < smallest ? shortest[i] : smallest;
            largest = shortest[i] > largest ? shortest[i] : largest;
        }
    }
    if (plan->adjust_count == 0 || smallest == TL_UNREACHABLE) {
        lock->distance = 0;
        lock->prediction = 1;
        return;
    }
    check_matches_reached(twin, plan, scratch, report);
    lock->distance = (uint32_t)smallest;
    lock->prediction = plan->prediction != 0 ? plan->prediction : (uint32_t)largest;
    if (lock->prediction < largest) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.horizon.prediction",
                      "found %u, expected at least %u: that many "
                      "steps pass until every adjusted variable can reach a matched output",
                      (unsigned)lock->prediction, (unsigned)largest);
    }
}

/* What the plant delivers before there is a good reading: configured, or the start value of what it drives. */
static void build_initial_values(tl_twin *twin, const tl_plan *plan) {
    for (size_t i = 0; i < plan->signal_count; i++) {
        double *held = &twin->exchange.plant.held[i];
        *held = plan->signals[i].has_initial ? plan->signals[i].initial : 0.0;
        for (size_t k = 0; k < twin->graph.connection_count && !plan->signals[i].has_initial; k++) {
            const tl_connection *connection = &twin->graph.connections[k];
            if (connection->from->variable == NULL && connection->from->signal == i &&
                connection->to->variable->has_start) {
                const tl_value *start = &connection->to->variable->start;
                *held = start->type == TL_REAL
                            ? (start->real - connection->conversion.offset) / connection->conversion.factor
                            : (double)start->integer;
                break;
            }
        }
    }
}

/* û of an adjusted variable that nothing delivers: configured, else set, else its start value. */
static bool find_nominal(const tl_plan *plan, const tl_plan_adjust *adjust, const tl_port *port, double *nominal) {
    const tl_plan_component *component = &plan->components[port->node];
    *nominal = port->variable->start.real;
    bool found = port->variable->has_start;
    for (size_t i = 0; i < component->set_count; i++) {
        tl_value value;
        const char *expected;
        if (strcmp(component->set[i].variable, port->variable->name) == 0 &&
            tl_graph_fit_value(port->variable, &component->set[i].value, &value, &expected)) {
            *nominal = value.real;
            found = true;
        }
    }
    if (adjust->has_nominal) {
        *nominal = adjust->nominal;
        found = true;
    }
    return found;
}

static void place_adjusted(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->adjust_count; i++) {
        tl_adjusted *adjusted = &twin->lock.adjusted[i];
        const tl_port *port = twin->adjust_ports[i];
        const tl_connection *connection = tl_graph_connection_to(&twin->graph, port);
        adjusted->input = tl_exchange_input(&twin->exchange, port);
        adjusted->delivered = connection != NULL ? connection->nominal : NULL;
        if (connection == NULL && !find_nominal(plan, &plan->adjust[i], port, &adjusted->nominal)) {
            tl_report_add(report, TL_BAD_DATA, plan->adjust[i].where, "%s has no start value: give it \"nominal\"",
                          plan->adjust[i].variable);
        }
        *adjusted->input = adjusted->nominal;
    }
}

/* fmi2Fatal is for all instances of an FMU: none of them may be called any more. */
static bool is_lost(const tl_twin *twin, const tl_component *component) {
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        const tl_component *other = &twin->graph.components[i];
        if (other->fmi == component->fmi && other->mode == TL_MODE_DEAD) {
            return true;
        }
    }
    return false;
}

static void instantiate(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->component_count; i++) {
        const tl_plan_component *description = &plan->components[i];
        tl_component *component = &twin->graph.components[i];
        tl_error error;
        if (is_lost(twin, component)) {
            continue;
        }
        tl_status status = tl_component_instantiate(component, description->callbacks, description->resources, &error);
        for (size_t k = 0; k < description->set_count && status == TL_OK; k++) {
            const tl_variable *variable = tl_model_variable(description->model, description->set[k].variable);
            tl_value value;
            const char *expected;
            (void)tl_graph_fit_value(variable, &description->set[k].value, &value, &expected);
            status = tl_component_set_start(component, variable, &value, &error);
        }
        if (status != TL_OK) {
            tl_report_add(report, status, description->where, "%s", error.text);
        }
    }
}

/* Everything that needs no FMU call, problems to the report. */
static void build_structure(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    tl_graph_build(&twin->graph, &twin->arena, plan, report);
    if (twin->graph.connections == NULL) {
        return;
    }
    build_matches(twin, plan, report);
    for (size_t i = 0; i < plan->output_count; i++) {
        twin->outputs[i] = tl_graph_output(&twin->graph, plan->outputs[i].variable, plan->outputs[i].where, report);
    }
    build_adjusted(twin, plan, report);
    tl_graph_check_inputs(&twin->graph, report);
    build_horizon(twin, plan, report);
    if (plan->adjust_count != 0) {
        check_state(plan, report);
    }
}

static void build_values(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    tl_error error;
    size_t window = (size_t)twin->lock.prediction + 2;
    tl_status status = tl_exchange_init(&twin->exchange, &twin->arena, &twin->graph, window, &error);
    if (status != TL_OK) {
        tl_report_add(report, status, "", "%s", error.text);
        return;
    }
    build_initial_values(twin, plan);
    twin->lock.exchange = &twin->exchange;
    twin->proof = tl_arena_take(&twin->arena, twin->graph.port_count, sizeof *twin->proof);
    place_adjusted(twin, plan, report);
    if (twin->proof == NULL || !tl_lock_init(&twin->lock, &twin->arena)) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the solver");
    }
}

tl_twin *tl_twin_build(const tl_plan *plan, tl_report *report) {
    tl_arena arena;
    tl_arena_init(&arena);
    tl_twin *twin = tl_arena_take(&arena, 1, sizeof *twin);
    if (twin == NULL) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the twin");
        return NULL;
    }
    size_t before = report->count;
    twin->arena = arena;
    twin->measurements = plan->measurements;
    if (tl_plan_check(plan, report)) {
        build_structure(twin, plan, report);
    }
    if (report->count == before) {
        build_values(twin, plan, report);
    }
    if (report->count == before) {
        instantiate(twin, plan, report);
    }
    if (report->count != before) {
        tl_twin_destroy(twin);
        return NULL;
    }
    twin->graph.plan = NULL;
    tl_arena_seal(&twin->arena);
    return twin;
}

void tl_twin_destroy(tl_twin *twin) {
    if (twin == NULL) {
        return;
    }
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        if (!is_lost(twin, &twin->graph.components[i])) {
            tl_component_free(&twin->graph.components[i]);
        }
    }
    tl_lock_end(&twin->lock);
    tl_arena arena = twin->arena;
    tl_arena_release(&arena);
}

/* ---- ticks ---- */

static bool is_output(const tl_port *port) {
    return port->variable != NULL && !port->input;
}

static void take_proof(tl_twin *twin) {
    for (size_t i = 0; i < twin->graph.port_count; i++) {
        if (is_output(&twin->graph.ports[i])) {
            twin->proof[i] = tl_exchange_value(&twin->exchange, &twin->graph.ports[i]);
        }
    }
}

/* Compares the outputs of all FMUs with the proof to the bit. */
static tl_status check_proof(const tl_twin *twin, tl_error *error) {
    for (size_t i = 0; i < twin->graph.port_count; i++) {
        const tl_port *port = &twin->graph.ports[i];
        if (!is_output(port)) {
            continue;
        }
        double value = tl_exchange_value(&twin->exchange, port);
        if (memcmp(&value, &twin->proof[i], sizeof value) != 0) {
            return tl_fail(error, TL_FMU_FAILED,
                           "%s.%s is not the same after restoring a saved state and repeating the "
                           "step: the FMU's state handling is broken, it cannot be synchronised",
                           twin->graph.components[port->node].name, port->variable->name);
        }
    }
    return TL_OK;
}

/* Leads all states away from where they were: a horizon with other inputs. It may fail, as any candidate may. */
static tl_status lead_astray(tl_twin *twin, tl_error *error) {
    tl_lock *lock = &twin->lock;
    tl_status status = TL_OK;
    for (size_t i = 0; i < lock->count; i++) {
        double *input = lock->adjusted[i].input;
        *input = fmin(fmax(*input + lock->step[i], lock->lower[i]), lock->upper[i]);
    }
    for (int64_t step = 0; step < lock->prediction && status == TL_OK; step++) {
        status = tl_exchange_step(&twin->exchange, step, false, error);
    }
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* A rollback is tested, not believed: one step, back, other steps, back, the first step again must give the same bits
 * at every output that is exchanged. */
static tl_status prove_rollback(tl_twin *twin, tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    tl_status status = tl_exchange_save(exchange, error);
    status = status == TL_OK ? tl_exchange_step(exchange, 0, false, error) : status;
    take_proof(twin);
    status = status == TL_OK ? tl_exchange_restore(exchange, error) : status;
    status = status == TL_OK ? lead_astray(twin, error) : status;
    status = status == TL_OK ? tl_exchange_restore(exchange, error) : status;
    status = status == TL_OK ? tl_exchange_step(exchange, 0, false, error) : status;
    status = status == TL_OK ? check_proof(twin, error) : status;
    status = status == TL_OK ? tl_exchange_restore(exchange, error) : status;
    for (size_t i = 0; i < exchange->component_count; i++) {
        exchange->components[i].executions = 0;
    }
    exchange->plant.executions = 0;
    return status;
}

static tl_status start(tl_twin *twin, tl_error *error) {
    tl_status status = tl_exchange_initialize(&twin->exchange, error);
    if (status == TL_OK && twin->lock.count != 0) {
        status = prove_rollback(twin, error);
    }
    return status;
}

/* Completes a record with the measurement of its instant. */
static void complete(tl_twin *twin, tl_record *record) {
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        tl_quality quality;
        record->y_hat[i] = tl_objective_y_hat(&twin->lock.objective, i, record->step + 1, &quality);
        record->y_hat_quality[i] = (uint8_t)quality;
        tl_metrics_add(&twin->metrics[i], record->y[i], record->y_hat[i], quality);
    }
}

static uint64_t count_executions(const tl_twin *twin) {
    uint64_t sum = twin->exchange.plant.executions;
    for (size_t i = 0; i < twin->exchange.component_count; i++) {
        sum += twin->exchange.components[i].executions;
    }
    return sum;
}

/* Computes one step: searched within the budget, or made up where there is none. */
static tl_status compute(tl_twin *twin, int64_t step, const tl_budget *budget, tl_record *record, tl_error *error) {
    uint64_t before = count_executions(twin);
    tl_status status = budget == NULL ? tl_lock_make_up(&twin->lock, step, record, error)
                                      : tl_lock_step(&twin->lock, step, budget, record, error);
    record->executions = (uint32_t)(count_executions(twin) - before);
    if (budget != NULL && budget->now != NULL) {
        record->used = budget->now(budget->context) - budget->started;
    }
    return status;
}

static tl_status advance(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record,
                         bool *ready, tl_error *error) {
    tl_plant_push(&twin->exchange.plant, sample);
    if (sample->tick == 0) {
        tl_status status = start(twin, error);
        if (status != TL_OK) {
            return status;
        }
    }
    if (twin->measurements == TL_AHEAD) {
        if (twin->has_pending) {
            *record = twin->pending;
            complete(twin, record);
            *ready = true;
        }
        tl_status status = compute(twin, sample->tick, budget, &twin->pending, error);
        twin->has_pending = status == TL_OK;
        return status;
    }
    int64_t step = sample->tick - (int64_t)twin->lock.prediction;
    if (step < 0) {
        return TL_OK;
    }
    tl_status status = compute(twin, step, budget, record, error);
    if (status == TL_OK) {
        complete(twin, record);
        *ready = true;
    }
    return status;
}

static tl_status tick(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record, bool *ready,
                      tl_error *error) {
    *ready = false;
    if (twin->ended != TL_OK) {
        return tl_fail(error, twin->ended, "the twin has ended with an earlier failure of an FMU: build a new one");
    }
    assert(sample->tick == twin->exchange.plant.newest + 1);
    twin->ended = advance(twin, sample, budget, record, ready, error);
    return twin->ended;
}

tl_status tl_twin_step(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record, bool *ready,
                       tl_error *error) {
    return tick(twin, sample, budget, record, ready, error);
}

tl_status tl_twin_make_up(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready, tl_error *error) {
    return tick(twin, sample, NULL, record, ready, error);
}

void tl_twin_finish(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready) {
    *ready = twin->has_pending;
    if (twin->has_pending) {
        tl_plant_push(&twin->exchange.plant, sample);
        *record = twin->pending;
        complete(twin, record);
        twin->has_pending = false;
    }
}

/* ---- facts ---- */

tl_twin_facts tl_twin_get_facts(const tl_twin *twin) {
    uint64_t components = twin->graph.component_count + 1;
    tl_twin_facts facts = {
        .components = (size_t)components,
        .prediction = twin->lock.prediction,
        .distance = twin->lock.distance,
        .memory = tl_arena_used(&twin->arena),
        .executions_per_step = components,
        .executions_per_evaluation = twin->lock.count == 0 ? 0 : components * twin->lock.prediction,
    };
    return facts;
}

uint64_t tl_twin_executions(const tl_twin *twin, size_t component) {
    return component < twin->graph.component_count ? twin->graph.components[component].executions
                                                   : twin->exchange.plant.executions;
}

const char *tl_twin_component_name(const tl_twin *twin, size_t component) {
    return component < twin->graph.component_count ? twin->graph.components[component].name : "plant";
}

const tl_metrics *tl_twin_metrics(const tl_twin *twin, size_t match) {
    return &twin->metrics[match];
}

double tl_twin_output(const tl_twin *twin, size_t output) {
    return tl_exchange_value(&twin->exchange, twin->outputs[output]);
}

static const char *unit_name(const tl_port *port) {
    return port->variable->unit == NULL ? "" : port->variable->unit->name;
}

const char *tl_twin_match_unit(const tl_twin *twin, size_t match) {
    return unit_name(twin->terms[match].port);
}

const char *tl_twin_adjust_unit(const tl_twin *twin, size_t adjust) {
    return unit_name(twin->adjust_ports[adjust]);
}
