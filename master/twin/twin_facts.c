/* What is known of a twin, and of twins: see twin.h. */
#include "master/solve/optimiser.h"
#include "master/twin/twin_parts.h"

static const char *name_of(const tl_optimiser_class *solver) {
    return solver != NULL ? solver->name : NULL;
}

const char *tl_twin_solver_named(const char *name) {
    return name_of(tl_optimiser_find(name));
}

const char *tl_twin_solver_numbered(int number) {
    return name_of(tl_optimiser_numbered(number));
}

const char *tl_twin_solver_names(void) {
    return tl_optimiser_names();
}

uint32_t tl_twin_prediction(const tl_twin *twin) {
    return twin->event != NULL ? tl_event_horizon_steps(twin->event) : twin->lock.horizon.prediction;
}

/* Those of the caches, and of each component one more, where candidates begin, kept for the proof at the start and for checkpoints; and the verifier's. */
static uint64_t state_memory(const tl_twin *twin) {
    const tl_exchange *exchange = &twin->exchange;
    uint64_t sum = 0;
    for (size_t k = 0; k < exchange->component_count && exchange->rooms != NULL; k++) {
        sum += (1 + (uint64_t)exchange->beside) * exchange->rooms[k].size;
    }
    return exchange->rooms != NULL ? sum + tl_state_room_bytes(exchange->rooms, exchange->component_count) : 0;
}

static const char *astray(const tl_twin *twin) {
    return twin->cannot_return && twin->proof.culprit < twin->graph.component_count
               ? twin->graph.components[twin->proof.culprit].name
               : NULL;
}

tl_twin_facts tl_twin_get_facts(const tl_twin *twin) {
    const tl_lock *lock = &twin->lock;
    uint64_t components = twin->graph.component_count + 1;
    bool searches = lock->horizon.variables != 0;
    uint32_t prediction = tl_twin_prediction(twin);
    tl_twin_facts facts = {
        .components = (size_t)components,
        .prediction = prediction,
        .distance = lock->horizon.distance,
        .lead = twin->lead,
        .first = twin->first,
        .unknowns = lock->horizon.count,
        .algorithm = lock->solver != NULL ? lock->solver->name : "",
        .fallback = lock->fallback != NULL ? lock->fallback->name : "",
        .memory = tl_arena_used(&twin->arena),
        .state_memory = state_memory(twin),
        .executions_per_step = components,
        .executions_per_evaluation = searches ? components * prediction : 0,
        .returns = twin->proof.holds,
        .cannot_return = twin->cannot_return,
        .astray = astray(twin),
        .proved_executions = twin->proof.executions,
        .runs_free = twin->runs_free,
        .verified = twin->verifier.counts.turns,
        .verified_executions = twin->verifier.counts.executions,
        .differed = twin->verifier.counts.found,
        .has_free_twin = twin->free_twin.is_led,
        .free_twin = twin->free_twin.counts,
        .structure = searches && lock->ledger.saving.structure,
        .sequences = searches && lock->ledger.saving.sequences,
    };
    return facts;
}

/* What the graph says of one component, under what is saved. */
static void fill_needs(const tl_twin *twin, size_t component, tl_twin_ledger *entry) {
    const tl_horizon *horizon = &twin->lock.horizon;
    if (horizon->variables == 0) {
        return;
    }
    const tl_plan_saving *saving = &twin->lock.ledger.saving;
    uint32_t full = saving->structure ? horizon->reach[component] : tl_twin_prediction(twin);
    entry->reach = horizon->reach[component];
    entry->on_a_way = horizon->longer[component] != TL_NEVER;
    entry->longer = entry->on_a_way ? horizon->longer[component] : 0;
    entry->first_need = full;
    entry->next_need = saving->sequences ? tl_horizon_next_need(horizon, component, full) : full;
}

tl_twin_ledger tl_twin_get_ledger(const tl_twin *twin, size_t component) {
    const tl_exchange *exchange = &twin->exchange;
    bool plant = component == twin->graph.component_count;
    tl_twin_ledger entry = {
        .name = tl_twin_component_name(twin, component),
        .plain = twin->lock.ledger.plain,
        .predicted = tl_ledger_predicted(&twin->lock.ledger, component),
        .executions = tl_twin_executions(twin, component),
    };
    fill_needs(twin, component, &entry);
    if (!plant) {
        entry.replay = exchange->components[component].fmi->replay;
        entry.cost = exchange->costs.each[component].most;
    }
    if (!plant && exchange->cached != NULL) {
        const tl_cached_component *cached = &exchange->cached[component];
        entry.nodes = cached->tree.capacity;
        entry.nodes_worst = twin->worst[component];
        entry.memory = tl_sequence_cache_memory(&cached->tree);
        entry.state_size = exchange->rooms[component].size;
        entry.states = exchange->rooms[component].kept;
        entry.nodes_peak = cached->tree.peak;
        entry.caught_up = cached->caught_up;
        entry.unstored = cached->unstored;
    }
    entry.difference = (int64_t)(entry.executions - entry.caught_up - entry.predicted);
    return entry;
}

bool tl_twin_ledger_is_complete(const tl_twin *twin) {
    return !twin->lock.ledger.incomplete;
}

uint64_t tl_twin_executions(const tl_twin *twin, size_t component) {
    return component < twin->graph.component_count ? twin->graph.components[component].executions
                                                   : twin->exchange.plant.executions;
}

const char *tl_twin_component_name(const tl_twin *twin, size_t component) {
    return component < twin->graph.component_count ? twin->graph.components[component].name : "plant";
}

tl_twin_adjusted tl_twin_get_adjusted(const tl_twin *twin, size_t adjust) {
    const tl_adjusted *adjusted = &twin->lock.adjusted[adjust];
    const tl_adjusted_input *input = &twin->exchange.adjusted[adjust];
    return (tl_twin_adjusted){
        .is_real = !adjusted->is_boolean,
        .is_fed = input->delivered_real != NULL || input->delivered_boolean != NULL,
        .nominal = input->nominal,
        .step = adjusted->step,
        .lower = adjusted->lower,
        .upper = adjusted->upper,
        .least = twin->adjust_ports[adjust]->variable->minimum,
        .most = twin->adjust_ports[adjust]->variable->maximum,
    };
}

tl_twin_delay tl_twin_get_delay(const tl_twin *twin) {
    return twin->delay;
}

const tl_metrics *tl_twin_readings(const tl_twin *twin, size_t match) {
    return &twin->readings[match];
}

const tl_metrics *tl_twin_metrics(const tl_twin *twin, size_t match) {
    return &twin->metrics[match];
}

double tl_twin_output(const tl_twin *twin, size_t output) {
    return tl_exchange_value(&twin->exchange, twin->outputs[output]);
}

size_t tl_twin_value_count(const tl_twin *twin) {
    return twin->graph.port_count;
}

bool tl_twin_get_value(const tl_twin *twin, size_t i, tl_twin_value *value) {
    const tl_port *port = &twin->graph.ports[i];
    if (port->input || port->variable == NULL) {
        return false;
    }
    *value = (tl_twin_value){.component = twin->graph.components[port->node].name,
                             .variable = port->variable->name,
                             .value = tl_exchange_value(&twin->exchange, port)};
    return true;
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
