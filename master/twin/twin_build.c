/* Building a twin from a plan: see twin.h. */
#include <math.h>
#include <string.h>

#include "master/event/event_horizon.h"
#include "master/twin/twin_parts.h"

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
}

static void check_state(const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->component_count; i++) {
        const tl_plan_component *component = &plan->components[i];
        const tl_fmi2 *fmi = component->functions;
        if (fmi->get_fmu_state == NULL || fmi->set_fmu_state == NULL || fmi->free_fmu_state == NULL) {
            tl_report_add(
                report, TL_BAD_DATA, component->where,
                "the FMU of %s cannot save and restore its state (canGetAndSetFMUstate), which \"synchronise\" needs: "
                "export it with that capability, or remove \"rollback\": \"state\" of the component",
                component->name);
        }
    }
}

/* Bounds and first step of a Real: the configured ones within the declared ones of the FMU. */
static void build_real(tl_adjusted *adjusted, const tl_plan_adjust *adjust, const tl_variable *variable,
                       tl_report *report) {
    adjusted->step = adjust->step;
    adjusted->lower = fmax(adjust->lower, variable->minimum);
    adjusted->upper = fmin(adjust->upper, variable->maximum);
    adjusted->approved = adjust->approved;
    if (!(adjust->step > 0.0)) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "\"step\" is missing: %s is Real, and its search needs a first step above 0", adjust->variable);
    }
    if (adjust->dwell != 0) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "\"dwell_s\" is for a Boolean, but %s is Real: remove it, or use penalty.rate", adjust->variable);
    }
    if (!(adjusted->lower < adjusted->upper)) {
        tl_report_add(
            report, TL_BAD_DATA, adjust->where,
            "no range is left between the bounds %g and %g (configured, and declared by the FMU): widen \"min\" and "
            "\"max\"",
            adjusted->lower, adjusted->upper);
    }
}

/* Whole steps that last at least so long, at most as many as can be counted. */
static uint32_t steps_for(tl_time time, tl_time step) {
    tl_time steps = time / step + (time % step != 0);
    return steps < UINT32_MAX ? (uint32_t)steps : UINT32_MAX;
}

static void build_boolean(tl_adjusted *adjusted, const tl_plan *plan, const tl_plan_adjust *adjust) {
    adjusted->step = 1.0;
    adjusted->lower = 0.0;
    adjusted->upper = 1.0;
    adjusted->dwell = steps_for(adjust->dwell, plan->step);
    adjusted->is_boolean = true;
}

static void build_adjusted(tl_twin *twin, const tl_plan *plan, tl_synchroniser_settings *synchroniser,
                           tl_report *report) {
    for (size_t i = 0; i < plan->adjust_count; i++) {
        const tl_plan_adjust *adjust = &plan->adjust[i];
        tl_adjusted *adjusted = &synchroniser->adjusted[i];
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
        synchroniser->penalties[i] =
            (tl_objective_penalty){adjust->deviation_penalty, adjust->rate_penalty, adjusted->step};
    }
}

/* A solver by name; NULL if it is unknown, or not for these variables. */
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

static void build_solvers(const tl_twin *twin, const tl_plan *plan, tl_synchroniser_settings *synchroniser,
                          tl_report *report) {
    if (plan->adjust_count == 0) {
        return;
    }
    const tl_port *first = twin->adjust_ports[0];
    const char *fitting = plan->event.start.signal != NULL             ? "nelder-mead"
                          : first != NULL && first->type == TL_BOOLEAN ? "boolean"
                                                                       : "secant";
    synchroniser->solver =
        find_solver(twin, plan, plan->algorithm != NULL ? plan->algorithm : fitting, "synchronise.algorithm", report);
    if (plan->fallback != NULL) {
        synchroniser->fallback = find_solver(twin, plan, plan->fallback, "synchronise.fallback", report);
    }
}

/* An event horizon is searched by solvers without memory, in one Real variable. */
static void check_event_solver(const tl_plan *plan, const tl_optimiser_class *solver, tl_report *report) {
    if (solver != NULL && solver != &tl_nelder_mead && solver != &tl_bobyqa && solver != &tl_sbplx) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.algorithm",
                      "found \"%s\", expected \"nelder-mead\", \"bobyqa\" or \"sbplx\" with horizon.event",
                      solver->name);
    }
    if (plan->fallback != NULL) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.fallback",
                      "cannot be used with horizon.event, where the search continues by halving: remove it");
    }
}

/* The variables of an event horizon. */
static void check_event_ports(const tl_twin *twin, const tl_plan *plan, tl_report *report) {
    const tl_port *adjusted = twin->adjust_ports[0];
    if (adjusted != NULL && (adjusted->type != TL_REAL || tl_graph_connection_to(&twin->graph, adjusted) != NULL)) {
        tl_report_add(report, TL_BAD_DATA, plan->adjust[0].where,
                      "an event horizon adjusts a Real variable that nothing is connected to, and %s is not one",
                      plan->adjust[0].variable);
    }
    for (size_t i = 0; i < plan->match_count; i++) {
        const tl_plan_match *match = &plan->match[i];
        const tl_port *port = twin->match_ports[i];
        if (match->weight > 0.0 && port != NULL && port->type != TL_BOOLEAN &&
            strcmp(match->to, plan->event.end.signal) == 0) {
            tl_report_add(report, TL_BAD_DATA, match->where,
                          "the end of the stroke is to be matched by a Boolean output, and %s is %s", match->variable,
                          tl_type_name(port->type));
        }
    }
}

static void check_event(const tl_twin *twin, const tl_plan *plan, const tl_optimiser_class *solver, tl_report *report) {
    if (plan->event.start.signal != NULL) {
        tl_event_plan_check(plan, report);
        check_event_solver(plan, solver, report);
        if (plan->adjust_count == 1) {
            check_event_ports(twin, plan, report);
        }
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

/* Largest output_ticks that a measured delay can give; if none is measured, the configured one. */
static int32_t most_output_ticks(const tl_plan *plan) {
    const tl_plan_measure *measure = &plan->measure;
    if (measure->lags == 0 || measure->is_unused || plan->step <= 0) {
        return plan->output_ticks;
    }
    int32_t most = tl_delay_ticks(measure->look_back, -measure->range, plan->step);
    return most > plan->output_ticks ? most : plan->output_ticks;
}

static int32_t least_output_ticks(const tl_plan *plan) {
    const tl_plan_measure *measure = &plan->measure;
    if (measure->lags == 0 || measure->is_unused || plan->step <= 0) {
        return plan->output_ticks;
    }
    int32_t least = tl_delay_ticks(measure->look_back, measure->range, plan->step);
    return least < plan->output_ticks ? least : plan->output_ticks;
}

/* Ticks until all data of an instant is there: inputs and conditioned measurements. */
static uint32_t find_wait(const tl_plan *plan) {
    int64_t longest = plan->input_ticks > 0 ? plan->input_ticks : 0;
    for (size_t i = 0; i < plan->match_count; i++) {
        longest = most_output_ticks(plan) > longest ? most_output_ticks(plan) : longest;
    }
    return (uint32_t)longest;
}

/* Ticks by which a look-up may be older than its instant. */
static size_t find_age(const tl_plan *plan) {
    int32_t outputs = least_output_ticks(plan);
    int32_t oldest = plan->input_ticks < outputs ? plan->input_ticks : outputs;
    return oldest < 0 ? (size_t)-oldest : 0;
}

/* Paths, T_D, T_P; and the tick at which a step is computed. */
static void build_horizon(tl_twin *twin, const tl_plan *plan, tl_horizon *horizon, tl_report *report) {
    if (!has_all_ports(twin, plan)) {
        return;
    }
    if (!tl_horizon_init(horizon, &twin->arena, &twin->graph, twin->adjust_ports, twin->match_ports, report)) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the horizon");
    }
    if (plan->measurements != TL_AHEAD) {
        bool whole = plan->measurements == TL_LAG && plan->event.start.signal == NULL;
        twin->lead = find_wait(plan) + (whole ? horizon->prediction : 1);
        twin->begin = plan->input_ticks > 0 ? plan->input_ticks : 0;
    }
}

/* Value of the plant before a good reading: configured, or the start value of what it drives. */
static void build_initial_values(tl_twin *twin, const tl_plan *plan) {
    for (size_t i = 0; i < plan->signal_count; i++) {
        double initial = plan->signals[i].has_initial ? plan->signals[i].initial : 0.0;
        for (size_t k = 0; k < twin->graph.connection_count && !plan->signals[i].has_initial; k++) {
            const tl_connection *connection = &twin->graph.connections[k];
            if (connection->from->variable == NULL && connection->from->signal == i &&
                connection->to->variable->has_start) {
                const tl_value *start = &connection->to->variable->start;
                initial = start->type == TL_REAL
                              ? (start->real - connection->conversion.offset) / connection->conversion.factor
                              : (double)start->integer;
                break;
            }
        }
        tl_plant_set_initial(&twin->exchange.plant, i, initial);
    }
}

static double number_of(const tl_value *value, tl_type type) {
    return type == TL_REAL ? value->real : (double)(value->integer != 0);
}

/* û of an adjusted variable without a connection: configured, else set, else its start value. */
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
        double nominal = 0.0;
        const tl_port *port = twin->adjust_ports[i];
        const tl_connection *connection = tl_graph_connection_to(&twin->graph, port);
        if (connection == NULL && !find_nominal(plan, &plan->adjust[i], port, &nominal)) {
            tl_report_add(report, TL_BAD_DATA, plan->adjust[i].where, "%s has no start value: give it \"nominal\"",
                          plan->adjust[i].variable);
        }
        tl_exchange_place_adjusted(&twin->exchange, i, port, connection, nominal);
    }
}

static void instantiate(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    for (size_t i = 0; i < plan->component_count; i++) {
        const tl_plan_component *description = &plan->components[i];
        tl_component *component = &twin->graph.components[i];
        tl_error error;
        if (tl_twin_has_dead_fmu(twin, component)) {
            continue;
        }
        if (!tl_start_values_place(twin, plan, i)) {
            tl_report_add(report, TL_TRY_AGAIN, description->where, "not enough memory for its start values");
            continue;
        }
        tl_status status = tl_component_instantiate(component, description->callbacks, description->resources, &error);
        status = status == TL_OK ? tl_component_set_starts(component, &error) : status;
        if (status != TL_OK) {
            tl_report_add(report, status, description->where, "%s", error.text);
        }
    }
}

/* Each step sets an adjusted variable, so its start value has no effect. `variable` may be NULL. */
static void report_adjusted(const tl_twin *twin, const tl_plan *plan, const tl_variable *variable, size_t node,
                            const char *where, tl_report *report) {
    for (size_t i = 0; i < plan->adjust_count && variable != NULL; i++) {
        const tl_port *port = twin->adjust_ports[i];
        if (port != NULL && port->node == node && port->variable == variable) {
            tl_report_add(report, TL_BAD_DATA, where,
                          "%s is adjusted, so it has no start value: remove it here, or in \"adjust\"",
                          plan->adjust[i].variable);
        }
    }
}

/* Start values that are found or copied. */
static void check_starts(const tl_twin *twin, const tl_plan *plan, tl_report *report) {
    size_t weighted = 0;
    for (size_t i = 0; i < plan->match_count; i++) {
        weighted += plan->match[i].weight > 0.0 ? 1 : 0;
    }
    if (plan->find_count != 0 && (weighted == 0 || plan->event.start.signal != NULL)) {
        tl_report_add(report, TL_BAD_DATA, plan->find[0].where, "start values can be found only with %s",
                      weighted == 0 ? "a matched output: add one to \"match\"" : "a horizon of steps, not of events");
    }
    for (size_t i = 0; i < plan->find_count; i++) {
        size_t node = 0;
        const tl_variable *variable = tl_graph_found_start(&twin->graph, &plan->find[i], &node, report);
        report_adjusted(twin, plan, variable, node, plan->find[i].where, report);
    }
    for (size_t k = 0; k < plan->component_count; k++) {
        const tl_plan_component *component = &plan->components[k];
        for (size_t i = 0; i < component->set_count; i++) {
            const tl_variable *variable = tl_model_variable(component->model, component->set[i].variable);
            bool is_copied = component->set[i].value.type == TL_STRING && variable != NULL && variable->type == TL_REAL;
            report_adjusted(twin, plan, is_copied ? variable : NULL, k, component->set[i].where, report);
        }
    }
}

/* Everything that needs no FMU call; reports problems. Returns false if there was one. */
static bool build_structure(tl_twin *twin, const tl_plan *plan, tl_synchroniser_settings *synchroniser,
                            tl_report *report) {
    size_t before = report->count;
    tl_graph_build(&twin->graph, &twin->arena, plan, report);
    if (twin->graph.connections == NULL) {
        return false;
    }
    build_matches(twin, plan, report);
    for (size_t i = 0; i < plan->output_count; i++) {
        twin->outputs[i] = tl_graph_output(&twin->graph, plan->outputs[i].variable, plan->outputs[i].where, report);
    }
    build_adjusted(twin, plan, synchroniser, report);
    build_solvers(twin, plan, synchroniser, report);
    tl_graph_check_inputs(&twin->graph, report);
    build_horizon(twin, plan, &synchroniser->horizon, report);
    check_starts(twin, plan, report);
    check_event(twin, plan, synchroniser->solver, report);
    if (plan->adjust_count != 0) {
        check_state(plan, report);
    }
    return report->count == before && synchroniser->horizon.reach != NULL;
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

static size_t find_signal(const tl_plan *plan, const char *reference) {
    size_t i = 0;
    while (i < plan->signal_count && strcmp(plan->signals[i].name, reference + strlen("plant.")) != 0) {
        i++;
    }
    return i;
}

/* With an event horizon the past of a step may change. Room is for one reading per tick. */
static bool create_readers(tl_twin *twin, const tl_plan *plan) {
    bool placed = true;
    twin->look_back = plan->output_look_back;
    for (size_t i = 0; i < plan->match_count && plan->event.start.signal == NULL; i++) {
        const char *reading = plan->match[i].reading != NULL ? plan->match[i].reading : plan->match[i].to;
        if (twin->match_ports[i]->type == TL_REAL && reading[0] != '\0') {
            twin->reading_signals[i] = find_signal(plan, reading);
            twin->readers[i] = tl_reading_meter_create(&twin->arena, plan->step, twin->lead + find_age(plan) + 2);
            placed = placed && twin->readers[i] != NULL && twin->reading_signals[i] < plan->signal_count;
        }
    }
    return placed;
}

/* Fewest nodes: those of the path of one horizon and of the next. */
static uint64_t nodes_least(const tl_horizon *horizon) {
    return 3 * (uint64_t)horizon->prediction + 3;
}

/* Nodes that a component can need at once: the root and the horizon, the nodes of each candidate,
 * and the rest of earlier candidates when the root advances; with outputs only, also the path to
 * the last state. Candidates differ in a component only from `nearest` steps on: all of them stay
 * for as many ticks, then one node less of each per tick. The same holds for paths with samples
 * that were used in place of later ones: T_P²/4 nodes at most. TL_KEEP_NONE: the root and the
 * committed step. */
static uint64_t nodes_worst(const tl_horizon *horizon, const tl_plan *plan, size_t node) {
    uint64_t evaluations = tl_tuning_room(plan->evaluations);
    if (plan->components[node].keep == TL_KEEP_NONE) {
        return TL_NODES_OF_NONE;
    }
    uint32_t reach = plan->saving.structure ? horizon->reach[node] : horizon->prediction;
    uint64_t span = tl_horizon_next_need(horizon, node, reach);
    uint64_t longest = horizon->prediction;
    uint64_t worst = nodes_least(horizon) + longest * longest / 4;
    return worst + (span == 0 ? 0 : evaluations * (span * horizon->nearest[node] + span * (span + 1) / 2));
}

/* Of these, the number with room. */
static uint32_t nodes_kept(const tl_horizon *horizon, const tl_plan *plan, uint64_t worst) {
    static const uint64_t most = 4096;
    uint64_t limit = plan->saving.nodes != 0 ? plan->saving.nodes : most;
    uint64_t least = nodes_least(horizon);
    uint64_t wanted = worst < limit ? worst : limit;
    return (uint32_t)(wanted > least ? wanted : least);
}

/* Saving, if something is adjusted; a free run executes everything once anyway. */
static bool save_executions(tl_twin *twin, const tl_plan *plan, tl_synchroniser_settings *synchroniser) {
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
        twin->worst[i] = nodes_worst(&synchroniser->horizon, plan, i);
        capacity[i] =
            keep[i] == TL_KEEP_NONE ? TL_NODES_OF_NONE : nodes_kept(&synchroniser->horizon, plan, twin->worst[i]);
    }
    twin->capacity = plan->saving.sequences ? capacity : NULL;
    uint32_t *reach = plan->saving.structure ? synchroniser->horizon.reach : NULL;
    if (!tl_exchange_save_executions(&twin->exchange, &twin->arena, keep, reach, twin->capacity,
                                     synchroniser->horizon.prediction)) {
        return false;
    }
    synchroniser->track =
        tl_track_create(&twin->arena, &twin->exchange, &twin->graph, synchroniser->horizon.prediction);
    return synchroniser->track != NULL;
}

static bool create_verifier(tl_twin *twin, const tl_plan *plan) {
    bool goes_back = plan->adjust_count != 0 && plan->event.start.signal == NULL;
    return tl_verifier_init(&twin->verifier, &twin->arena, &twin->exchange, &twin->graph,
                            goes_back ? plan->verify_every : 0);
}

static bool create_free_twin(tl_twin *twin, const tl_plan *plan) {
    bool can = plan->adjust_count != 0 && plan->event.start.signal == NULL;
    return tl_free_twin_init(&twin->free_twin, &twin->arena, &twin->exchange, &twin->synchroniser.objective,
                             can ? plan->free_twin : 0);
}

static bool create_released_twin(tl_twin *twin, const tl_plan *plan) {
    tl_released_state state = plan->event.start.signal != NULL ? TL_RELEASED_EVENT : TL_RELEASED_ON;
    for (size_t i = 0; i < plan->component_count; i++) {
        state = plan->components[i].keep == TL_KEEP_OUTPUTS ? TL_RELEASED_OUTPUTS : state;
    }
    return tl_released_twin_init(&twin->released_twin, &twin->arena, &twin->exchange, &twin->synchroniser.objective,
                                 twin->synchroniser.adjusted, plan->adjust_count != 0 ? plan->released_steps : 0,
                                 state);
}

static bool create_mark(tl_twin *twin, const tl_plan *plan) {
    twin->exchange.extra_states += plan->may_rerun ? 1 : 0;
    return !plan->may_rerun || tl_side_twin_init_state(&twin->mark, &twin->arena, &twin->exchange);
}

static void build_values(tl_twin *twin, const tl_plan *plan, tl_synchroniser_settings *synchroniser,
                         tl_report *report) {
    tl_error error;
    /* The window reaches back to the oldest sample of a remembered candidate. */
    bool by_event = plan->event.start.signal != NULL;
    size_t back = by_event ? tl_event_plan_window(plan) : synchroniser->horizon.prediction;
    twin->age = (uint32_t)find_age(plan);
    size_t window = back + twin->lead + twin->age + 3;
    tl_status status = tl_exchange_init(&twin->exchange, &twin->arena, &twin->graph, window, &error);
    if (status != TL_OK) {
        tl_report_add(report, status, "", "%s", error.text);
        return;
    }
    build_initial_values(twin, plan);
    synchroniser->exchange = &twin->exchange;
    synchroniser->terms = twin->terms;
    place_adjusted(twin, plan, report);
    if (!tl_proof_init(&twin->proof, &twin->arena, &twin->exchange, &twin->graph) || !create_meters(twin, plan) ||
        !create_readers(twin, plan) || !save_executions(twin, plan, synchroniser) || !create_verifier(twin, plan) ||
        !tl_synchroniser_init(&twin->synchroniser, &twin->arena, plan, synchroniser) || !create_free_twin(twin, plan) ||
        !create_released_twin(twin, plan) || !create_mark(twin, plan) || !tl_start_values_create(twin, plan)) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the search");
        return;
    }
    if (by_event) {
        twin->event = tl_event_horizon_create(&twin->arena, &twin->synchroniser, plan);
        if (twin->event == NULL) {
            tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the strokes of the event horizon");
        }
    }
}

static void place_experiment(tl_twin *twin, const tl_experiment *experiment) {
    twin->experiment = *experiment;
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        twin->graph.components[i].start_s = experiment->start_s;
        twin->graph.components[i].stop_s = experiment->stop_s;
    }
}

/* The last step begins at the end, and a candidate reaches T_P steps from there. */
static tl_experiment experiment_of(const tl_twin *twin, const tl_plan *plan) {
    tl_experiment experiment = plan->experiment;
    uint32_t prediction = tl_twin_get_facts(twin).prediction;
    double length = tl_seconds(tl_time_of_step(plan->length, plan->step, prediction > 1 ? prediction : 1));
    if (!(experiment.stop_s > experiment.start_s)) {
        experiment.stop_s = experiment.start_s + (plan->length != 0 ? length : TL_EXPERIMENT_FAR);
    }
    return experiment;
}

void tl_twin_set_start(tl_twin *twin, double start_s) {
    tl_experiment experiment = {start_s, twin->experiment.stop_s + (start_s - twin->experiment.start_s)};
    place_experiment(twin, &experiment);
}

/* Everything except the twin's own memory. */
static void build(tl_twin *twin, const tl_plan *plan, tl_report *report) {
    size_t before = report->count;
    tl_synchroniser_settings synchroniser = {0};
    bool complete =
        tl_plan_check(plan, report) && build_structure(twin, plan, &synchroniser, report) && report->count == before;
    if (complete) {
        build_values(twin, plan, &synchroniser, report);
    }
    if (complete && report->count == before) {
        tl_experiment experiment = experiment_of(twin, plan);
        place_experiment(twin, &experiment);
        instantiate(twin, plan, report);
    }
    twin->graph.plan = NULL;
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
    twin->state_bytes = plan->state_bytes;
    twin->heap = plan->heap;
    twin->now = plan->now;
    if (plan->match_count <= TL_MAX_MATCH && plan->adjust_count <= TL_MAX_ADJUST) { /* otherwise nothing is built */
        tl_tuning_of(plan, &twin->built);
        twin->tuning = twin->built;
    }
    tl_plan own = *plan;
    if (own.event.start.signal != NULL) {
        own.saving = (tl_plan_saving){0}; /* candidates differ from the first step on: there is nothing to save */
    }
    build(twin, &own, report);
    if (report->count != before) {
        tl_twin_destroy(twin);
        return NULL;
    }
    tl_arena_seal(&twin->arena);
    return twin;
}
