/* The twin: see twin.h. */
#include "master/twin.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "master/base/arena.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/sync/attempt.h"
#include "master/sync/delay.h"
#include "master/sync/delay_meter.h"
#include "master/sync/lock.h"
#include "master/sync/proof.h"

struct tl_twin {
    tl_arena arena;
    tl_graph graph;
    tl_exchange exchange;
    tl_lock lock;
    tl_objective_term terms[TL_MAX_MATCH];
    const tl_port *match_ports[TL_MAX_MATCH];
    const tl_port *adjust_ports[TL_MAX_ADJUST];
    uint32_t *capacity; /* nodes of each component's cache; NULL: sequences are not saved */
    uint64_t *worst;    /* and how many it can need at once */
    const tl_port *outputs[TL_MAX_SIGNALS];
    tl_metrics metrics[TL_MAX_MATCH];
    tl_measurements measurements;
    tl_plan_measure measure;
    tl_delay_meter *meters[TL_MAX_MATCH]; /* where Δo is measured */
    tl_twin_delay delay;
    tl_time step;
    uint32_t lead;    /* step i is computed at tick i + lead */
    int64_t begin;    /* tick at which the FMUs are initialised */
    double *proof;    /* for the proof at start: one value per port */
    tl_status ended;  /* not TL_OK: a step has failed, nothing may follow */
    bool has_pending; /* mode ahead: computed, its measurement not there yet */
    tl_record pending;
};

/* ---- build ---- */

static void build_matches(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->match_count; i++) {
        const tl_plan_match *match = &plan->match[i];
        tl_objective_term *term = &twin->terms[i];
        const tl_port *port = tl_graph_output(&twin->graph, match->variable, match->where, report);
        twin->match_ports[i] = port;
        term->port = port;
        if (port != NULL) {
            term->signal = tl_graph_match_signal(&twin->graph, match, port, &term->conversion, report);
        }
        term->tolerance = match->tolerance;
        term->weight = match->weight;
        term->huber = match->huber;
        term->shift = plan->output_ticks;
    }
    twin->lock.objective.terms = twin->terms;
    twin->lock.objective.term_count = plan->match_count;
    twin->lock.objective.exchange = &twin->exchange;
    twin->lock.objective.horizon = &twin->lock.horizon;
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

/* Bounds and first step of a Real: those configured within those the FMU declares. */
static void build_real(tl_adjusted *adjusted, const tl_plan_adjust *adjust, const tl_variable *variable,
                       tl_report *report) {
    adjusted->step = adjust->step;
    adjusted->lower = fmax(adjust->lower, variable->minimum);
    adjusted->upper = fmin(adjust->upper, variable->maximum);
    if (!(adjust->step > 0.0)) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "\"step\" is missing: %s is Real, and its search needs a first step above 0", adjust->variable);
    }
    if (adjust->dwell != 0) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "\"dwell_s\" is for a Boolean, and %s is Real: remove it, or have a look at penalty.rate",
                      adjust->variable);
    }
    if (!(adjusted->lower < adjusted->upper)) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "nothing is left to adjust between the bounds %g and %g "
                      "(those configured and those the FMU declares)",
                      adjusted->lower, adjusted->upper);
    }
}

/* Whole steps that last at least so long; what is longer than can be counted rests that long. */
static uint32_t steps_for(tl_time time, tl_time step) {
    tl_time steps = time / step + (time % step != 0);
    return steps < UINT32_MAX ? (uint32_t)steps : UINT32_MAX;
}

static void build_boolean(tl_adjusted *adjusted, const tl_plan *plan, const tl_plan_adjust *adjust) {
    adjusted->step = 1.0;
    adjusted->lower = 0.0;
    adjusted->upper = 1.0;
    adjusted->dwell = steps_for(adjust->dwell, plan->step);
}

static void build_adjusted(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->adjust_count; i++) {
        const tl_plan_adjust *adjust = &plan->adjust[i];
        tl_adjusted *adjusted = &twin->lock.adjusted[i];
        const tl_port *port = tl_graph_adjust(&twin->graph, adjust, report);
        twin->adjust_ports[i] = port;
        if (port == NULL) {
            continue;
        }
        if (port->type == TL_REAL) {
            build_real(adjusted, adjust, port->variable, report);
        } else {
            build_boolean(adjusted, plan, adjust);
        }
        twin->lock.objective.penalties[i] =
            (tl_objective_penalty){adjust->deviation_penalty, adjust->rate_penalty, adjusted->step};
    }
}

/* A solver by name; NULL where it is unknown, or not for what is adjusted. */
static const tl_optimiser_class *find_solver(const tl_twin *twin, const tl_plan *plan, const char *name,
                                             const char *where, tl_report *report) {
    const tl_optimiser_class *solver = tl_optimiser_find(name);
    if (solver == NULL) {
        tl_report_add(report, TL_BAD_DATA, where, "found \"%s\", expected one of %s", name, tl_optimiser_names());
        return NULL;
    }
    for (size_t i = 0; i < plan->adjust_count; i++) {
        const tl_port *port = twin->adjust_ports[i];
        if (port != NULL && (port->type == TL_BOOLEAN) != solver->booleans) {
            tl_report_add(report, TL_BAD_DATA, where, "\"%s\" is for %s variables, but %s is %s", name,
                          solver->booleans ? "Boolean" : "Real", plan->adjust[i].variable, tl_type_name(port->type));
        }
    }
    return solver;
}

static void build_solvers(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    tl_lock *lock = &twin->lock;
    lock->margin = plan->margin;
    lock->stagnation = plan->stagnation;
    lock->noise_floor = plan->noise_floor;
    if (plan->adjust_count == 0) {
        return;
    }
    const tl_port *first = twin->adjust_ports[0];
    const char *fitting = first != NULL && first->type == TL_BOOLEAN ? "boolean" : "secant";
    lock->solver =
        find_solver(twin, plan, plan->algorithm != NULL ? plan->algorithm : fitting, "synchronise.algorithm", report);
    if (plan->fallback != NULL) {
        lock->fallback = find_solver(twin, plan, plan->fallback, "synchronise.fallback", report);
    }
}

static bool has_all_ports(const tl_twin *twin, const tl_plan *plan) {
    bool all = true;
    for (size_t i = 0; i < plan->adjust_count; i++) {
        all = all && twin->adjust_ports[i] != NULL;
    }
    for (size_t i = 0; i < plan->match_count; i++) {
        all = all && twin->match_ports[i] != NULL;
    }
    return all;
}

/* Of all that may come out of measuring, where that is done. */
static int32_t most_output_ticks(const tl_plan *plan) {
    const tl_plan_measure *measure = &plan->measure;
    int32_t most = tl_delay_ticks(measure->look_back, -measure->range, plan->step);
    return measure->lags != 0 && most > plan->output_ticks ? most : plan->output_ticks;
}

static int32_t least_output_ticks(const tl_plan *plan) {
    const tl_plan_measure *measure = &plan->measure;
    int32_t least = tl_delay_ticks(measure->look_back, measure->range, plan->step);
    return measure->lags != 0 && least < plan->output_ticks ? least : plan->output_ticks;
}

/* Ticks until all that belongs to an instant is there: inputs, and conditioned measurements. */
static uint32_t find_wait(const tl_plan *plan) {
    int64_t longest = plan->input_ticks > 0 ? plan->input_ticks : 0;
    for (size_t i = 0; i < plan->match_count; i++) {
        int64_t own = (int64_t)tl_conditioner_delay(&plan->match[i].condition, plan->step) + most_output_ticks(plan);
        longest = own > longest ? own : longest;
    }
    return (uint32_t)longest;
}

/* Ticks by which what is looked up may be older than the instant it is for. */
static size_t find_age(const tl_plan *plan) {
    int32_t outputs = least_output_ticks(plan);
    int32_t oldest = plan->input_ticks < outputs ? plan->input_ticks : outputs;
    return oldest < 0 ? (size_t)-oldest : 0;
}

/* Paths, T_D, T_P; and at which tick a step is computed. */
static void build_horizon(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    tl_horizon *horizon = &twin->lock.horizon;
    if (!has_all_ports(twin, plan)) {
        return;
    }
    if (!tl_horizon_init(horizon, &twin->arena, &twin->graph, twin->adjust_ports, twin->match_ports, report)) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the horizon");
    }
    twin->lock.held_inputs = plan->measurements == TL_AHEAD;
    if (plan->measurements != TL_AHEAD) {
        twin->lead = find_wait(plan) + (plan->measurements == TL_LAG ? horizon->prediction : 1);
        twin->begin = plan->input_ticks > 0 ? plan->input_ticks : 0;
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

static double number_of(const tl_value *value, tl_type type) {
    return type == TL_REAL ? value->real : (double)(value->integer != 0);
}

/* û of an adjusted variable that nothing delivers: configured, else set, else its start value. */
static bool find_nominal(const tl_plan *plan, const tl_plan_adjust *adjust, const tl_port *port, double *nominal) {
    const tl_plan_component *component = &plan->components[port->node];
    *nominal = number_of(&port->variable->start, port->type);
    bool found = port->variable->has_start;
    for (size_t i = 0; i < component->set_count; i++) {
        tl_value value;
        const char *expected;
        if (strcmp(component->set[i].variable, port->variable->name) == 0 &&
            tl_graph_fit_value(port->variable, &component->set[i].value, &value, &expected)) {
            *nominal = number_of(&value, port->type);
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
        if (connection == NULL && !find_nominal(plan, &plan->adjust[i], port, &adjusted->nominal)) {
            tl_report_add(report, TL_BAD_DATA, plan->adjust[i].where, "%s has no start value: give it \"nominal\"",
                          plan->adjust[i].variable);
        }
        if (port->type == TL_REAL) {
            adjusted->real = tl_exchange_input(&twin->exchange, port);
            adjusted->delivered_real = connection != NULL ? connection->nominal : NULL;
            *adjusted->real = adjusted->nominal;
        } else {
            adjusted->boolean = tl_exchange_input(&twin->exchange, port);
            adjusted->delivered_boolean = connection != NULL ? connection->nominal : NULL;
            *adjusted->boolean = adjusted->nominal != 0.0 ? fmi2True : fmi2False;
        }
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
    build_solvers(twin, plan, report);
    tl_graph_check_inputs(&twin->graph, report);
    build_horizon(twin, plan, report);
    if (plan->adjust_count != 0) {
        check_state(plan, report);
    }
}

static bool condition_matches(tl_twin *twin, const tl_plan *plan) {
    bool placed = true;
    for (size_t i = 0; i < plan->match_count; i++) {
        const tl_plan_condition *condition = &plan->match[i].condition;
        if (tl_conditioner_is_needed(condition)) {
            tl_objective_term *term = &twin->terms[i];
            term->conditioner =
                tl_conditioner_create(&twin->arena, condition, plan->step, twin->lead + find_age(plan) + 2);
            term->delay = tl_conditioner_delay(condition, plan->step);
            placed = placed && term->conditioner != NULL;
        }
    }
    return placed;
}

/* One for each match; they wait for what a step waits for, and the other way round. */
static bool create_meters(tl_twin *twin, const tl_plan *plan) {
    bool placed = true;
    size_t late = twin->lead + find_age(plan) + (size_t)(plan->measure.look_back / plan->step) + 2;
    twin->measure = plan->measure;
    twin->step = plan->step;
    for (size_t i = 0; plan->measure.lags != 0 && i < plan->match_count; i++) {
        twin->meters[i] = tl_delay_meter_create(&twin->arena, plan->measure.lags, plan->step, late);
        placed = placed && twin->meters[i] != NULL;
    }
    return placed;
}

/* Fewer would not hold a horizon's way and the next one's. */
static uint64_t nodes_least(const tl_horizon *horizon) {
    return 3 * (uint64_t)horizon->prediction + 3;
}

/* Nodes that a component can need at once: the root and the horizon, what each candidate adds, and what is left of earlier
 * ones when the root moves on; with outputs only, the way back to the last state as well. Candidates differ in a component
 * only from `nearest` steps on: all of them stay for as many ticks, and then one node less of each from tick to tick. The
 * same goes for courses that began with values which stood for later ones: T_P²/4 at most. */
static uint64_t nodes_worst(const tl_twin *twin, const tl_plan *plan, size_t node) {
    const tl_horizon *horizon = &twin->lock.horizon;
    uint64_t evaluations = plan->evaluations != 0 ? plan->evaluations : 60;
    uint32_t reach = plan->saving.structure ? horizon->reach[node] : horizon->prediction;
    uint64_t span = tl_horizon_next_need(horizon, node, reach);
    uint64_t longest = horizon->prediction;
    uint64_t worst = nodes_least(horizon) + longest * longest / 4;
    return worst + (span == 0 ? 0 : evaluations * (span * horizon->nearest[node] + span * (span + 1) / 2));
}

/* Of those, what there is to be room for. */
static uint32_t nodes_kept(const tl_twin *twin, const tl_plan *plan, uint64_t worst) {
    static const uint64_t most = 4096;
    uint64_t limit = plan->saving.nodes != 0 ? plan->saving.nodes : most;
    uint64_t least = nodes_least(&twin->lock.horizon);
    uint64_t wanted = worst < limit ? worst : limit;
    return (uint32_t)(wanted > least ? wanted : least);
}

/* What is saved where something is adjusted; a free run executes everything once anyway. */
static bool save_executions(tl_twin *twin, const tl_plan *plan) {
    if (plan->adjust_count == 0) {
        return true;
    }
    tl_keep *keep = tl_arena_take(&twin->arena, plan->component_count, sizeof *keep);
    uint32_t *capacity = tl_arena_take(&twin->arena, plan->component_count, sizeof *capacity);
    twin->worst = tl_arena_take(&twin->arena, plan->component_count, sizeof *twin->worst);
    if (keep == NULL || capacity == NULL || twin->worst == NULL) {
        return false;
    }
    for (size_t i = 0; i < plan->component_count; i++) {
        keep[i] = plan->components[i].keep;
        twin->worst[i] = nodes_worst(twin, plan, i);
        capacity[i] = nodes_kept(twin, plan, twin->worst[i]);
    }
    twin->capacity = plan->saving.sequences ? capacity : NULL;
    uint32_t *reach = plan->saving.structure ? twin->lock.horizon.reach : NULL;
    if (!tl_exchange_save_executions(&twin->exchange, &twin->arena, keep, reach, twin->capacity,
                                     twin->lock.horizon.prediction)) {
        return false;
    }
    twin->lock.track = tl_track_create(&twin->arena, &twin->exchange, &twin->graph, twin->lock.horizon.prediction);
    return twin->lock.track != NULL;
}

static void build_values(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    tl_error error;
    /* As far back as a candidate that is remembered may have been fed. */
    size_t window = (size_t)twin->lock.horizon.prediction + twin->lead + find_age(plan) + 3;
    tl_status status = tl_exchange_init(&twin->exchange, &twin->arena, &twin->graph, window, &error);
    if (status != TL_OK) {
        tl_report_add(report, status, "", "%s", error.text);
        return;
    }
    twin->exchange.plant.shift = plan->input_ticks;
    build_initial_values(twin, plan);
    twin->lock.exchange = &twin->exchange;
    twin->proof = tl_arena_take(&twin->arena, twin->graph.port_count, sizeof *twin->proof);
    place_adjusted(twin, plan, report);
    if (twin->proof == NULL || !condition_matches(twin, plan) || !create_meters(twin, plan) ||
        !save_executions(twin, plan) || !tl_lock_init(&twin->lock, &twin->arena, plan)) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the search");
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
            tl_exchange_end_component(&twin->exchange, i);
        }
        if (!is_lost(twin, &twin->graph.components[i])) {
            tl_component_free(&twin->graph.components[i]);
        }
    }
    tl_lock_end(&twin->lock);
    tl_arena arena = twin->arena;
    tl_arena_release(&arena);
}

/* ---- ticks ---- */

static tl_status start(tl_twin *twin, tl_error *error) {
    tl_status status = tl_exchange_initialize(&twin->exchange, error);
    if (status == TL_OK && twin->lock.horizon.variables != 0) {
        status = tl_proof_of_rollback(&twin->lock, &twin->graph, twin->proof, error);
    }
    return status == TL_OK ? tl_exchange_start(&twin->exchange, error) : status;
}

/* ---- a measured delay ---- */

/* A hundredth of a first step of the search, or less, is no correction. */
static bool is_free(const tl_twin *twin, const tl_record *record) {
    static const double least = 0.01;
    bool free = true;
    for (size_t v = 0; v < twin->lock.horizon.variables; v++) {
        free = free && fabs(record->u[v] - record->u_hat[v]) <= least * twin->lock.adjusted[v].step;
    }
    return free;
}

/* From the next step on. What is in the sample at a tick was seen at a fixed time before it, so only whole steps can change. */
static void use_delay(tl_twin *twin) {
    tl_time delay = twin->delay.delay;
    tl_time range = twin->measure.range;
    tl_time used = delay > range ? range : delay < -range ? -range : delay;
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        twin->terms[i].shift = tl_delay_ticks(twin->measure.look_back, used, twin->step);
    }
}

/* The first matched output that knows it; one that has lost it only where none does. */
static void judge_delay(tl_twin *twin) {
    tl_twin_delay best = {.state = TL_DELAY_UNKNOWN, .confidence = 0.0};
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        tl_delay_measured found = tl_delay_meter_get(twin->meters[i]);
        tl_delay_state state = !found.known ? TL_DELAY_UNKNOWN : found.lost ? TL_DELAY_LOST : TL_DELAY_KNOWN;
        bool better = state == TL_DELAY_KNOWN ? best.state != TL_DELAY_KNOWN : best.state == TL_DELAY_UNKNOWN;
        if (better && (state != TL_DELAY_UNKNOWN || found.confidence >= best.confidence)) {
            best = (tl_twin_delay){.state = state, .delay = found.delay, .confidence = found.confidence};
        }
    }
    if (best.state == TL_DELAY_LOST) {
        best.delay = twin->delay.delay;
    }
    bool changed = best.state != TL_DELAY_UNKNOWN && best.delay != twin->delay.delay;
    bool first = best.state != TL_DELAY_UNKNOWN && twin->delay.state == TL_DELAY_UNKNOWN;
    twin->delay = best;
    if (changed || first) {
        use_delay(twin);
    }
}

static void measure_delay(tl_twin *twin, tl_record *record) {
    if (twin->measure.lags != 0) {
        bool free = is_free(twin, record);
        for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
            tl_delay_meter_step(twin->meters[i], record->step + 1, record->y[i], free);
        }
        judge_delay(twin);
    }
    record->delay_state = twin->delay.state;
    record->delay = twin->delay.delay;
}

/* ---- records ---- */

/* Completes a record with the measurement of its instant. */
static void complete(tl_twin *twin, tl_record *record) {
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        tl_quality quality;
        record->y_hat[i] = tl_objective_y_hat(&twin->lock.objective, i, record->step + 1, &quality);
        record->y_hat_quality[i] = (uint8_t)quality;
        tl_metrics_add(&twin->metrics[i], record->y[i], record->y_hat[i], quality);
    }
    measure_delay(twin, record);
}

static uint64_t count_executions(const tl_twin *twin) {
    return twin->exchange.executions + twin->exchange.plant.executions;
}

/* Computes one step: searched within the budget, or made up where there is none. */
static tl_status compute(tl_twin *twin, int64_t step, const tl_budget *budget, tl_record *record, tl_error *error) {
    uint64_t before = count_executions(twin);
    uint64_t predicted = tl_ledger_total(&twin->lock.ledger);
    tl_status status = budget == NULL ? tl_lock_make_up(&twin->lock, step, record, error)
                                      : tl_lock_step(&twin->lock, step, budget, record, error);
    record->executions = (uint32_t)(count_executions(twin) - before);
    record->predicted = (uint32_t)(tl_ledger_total(&twin->lock.ledger) - predicted);
    record->used = 0;
    if (budget != NULL && budget->now != NULL) {
        record->used = budget->now(budget->context) - budget->started;
    }
    return status;
}

/* The sample, and what the conditioners make of it. */
static void push(tl_twin *twin, const tl_sample *sample) {
    tl_plant *plant = &twin->exchange.plant;
    tl_plant_push(plant, sample);
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        const tl_objective_term *term = &twin->terms[i];
        if (term->conditioner != NULL) {
            const tl_sample *kept = tl_plant_sample(plant, sample->tick);
            tl_conditioner_push(term->conditioner, sample->tick, kept->values[term->signal],
                                (tl_quality)kept->quality[term->signal]);
        }
        if (twin->meters[i] != NULL && sample->stamps[term->signal] != TL_TIME_NEVER) {
            tl_time start = sample->instant - tl_time_of_step(0, twin->step, sample->tick);
            tl_delay_meter_see(twin->meters[i], sample->stamps[term->signal] - start, sample->values[term->signal],
                               sample->quality[term->signal] == TL_GOOD);
        }
    }
}

/* In mode ahead: what was computed a tick ago is complete now. */
static void hand_over_pending(tl_twin *twin, tl_record *record, bool *ready) {
    *record = twin->pending;
    complete(twin, record);
    *ready = true;
    twin->has_pending = false;
}

static tl_status advance(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record,
                         bool *ready, tl_error *error) {
    push(twin, sample);
    if (sample->tick == twin->begin) {
        tl_status status = start(twin, error);
        if (status != TL_OK) {
            return status;
        }
    }
    bool ahead = twin->measurements == TL_AHEAD;
    if (twin->has_pending) {
        hand_over_pending(twin, record, ready);
    }
    int64_t step = sample->tick - (int64_t)twin->lead;
    if (step < 0) {
        return TL_OK;
    }
    tl_status status = compute(twin, step, budget, ahead ? &twin->pending : record, error);
    if (status != TL_OK) {
        return status;
    }
    twin->has_pending = ahead;
    if (!ahead) {
        complete(twin, record);
        *ready = true;
    }
    return TL_OK;
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
    *ready = false;
    if (twin->has_pending) {
        push(twin, sample);
        hand_over_pending(twin, record, ready);
    }
}

/* ---- facts ---- */

tl_twin_facts tl_twin_get_facts(const tl_twin *twin) {
    const tl_lock *lock = &twin->lock;
    uint64_t components = twin->graph.component_count + 1;
    bool searches = lock->horizon.variables != 0;
    tl_twin_facts facts = {
        .components = (size_t)components,
        .prediction = lock->horizon.prediction,
        .distance = lock->horizon.distance,
        .lead = twin->lead,
        .unknowns = lock->horizon.count,
        .algorithm = lock->solver != NULL ? lock->solver->name : "",
        .fallback = lock->fallback != NULL ? lock->fallback->name : "",
        .memory = tl_arena_used(&twin->arena),
        .executions_per_step = components,
        .executions_per_evaluation = searches ? components * lock->horizon.prediction : 0,
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
    uint32_t full = saving->structure ? horizon->reach[component] : horizon->prediction;
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
    entry.cost = plant ? 0 : exchange->cost[component];
    if (!plant && exchange->cached != NULL) {
        const tl_cached_component *cached = &exchange->cached[component];
        entry.nodes = cached->tree.capacity;
        entry.nodes_worst = twin->worst[component];
        entry.memory = tl_sequence_cache_memory(&cached->tree);
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
    return (tl_twin_adjusted){
        .is_real = adjusted->real != NULL,
        .is_fed = adjusted->delivered_real != NULL || adjusted->delivered_boolean != NULL,
        .nominal = adjusted->nominal,
        .step = adjusted->step,
        .lower = adjusted->lower,
        .upper = adjusted->upper,
    };
}

tl_twin_delay tl_twin_get_delay(const tl_twin *twin) {
    return twin->delay;
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
