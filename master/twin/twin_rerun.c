/* Re-runs: see twin_rerun.h. */
#include "master/twin/twin_rerun.h"

#include <string.h>

#include "master/sync/side_twin.h"
#include "master/twin/twin_parts.h"

/* ---- targets ---- */

static const char *name_of(const tl_unit *unit) {
    return unit != NULL ? unit->name : "";
}

static bool is_fed_by_plant(const tl_twin *twin, const tl_port *port) {
    const tl_connection *connection = tl_graph_connection_to(&twin->graph, port);
    return connection != NULL && connection->from->variable == NULL;
}

static bool is_adjusted(const tl_twin *twin, size_t component, const tl_variable *variable) {
    bool is = false;
    for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
        is = is || (twin->adjust_ports[v]->node == component && twin->adjust_ports[v]->variable == variable);
    }
    return is;
}

static bool can_change(const tl_twin *twin, size_t component, const tl_variable *variable) {
    return variable->type == TL_REAL && variable->causality == TL_PARAMETER && variable->variability == TL_TUNABLE &&
           !is_adjusted(twin, component, variable);
}

/* Fills in what the kinds have in common. */
static void describe(const tl_twin *twin, size_t component, const tl_variable *variable, tl_rerun_target *target) {
    target->component = component;
    target->component_name = twin->graph.components[component].name;
    target->variable = variable;
    target->unit = name_of(variable->unit);
}

static bool find_adjusted(const tl_twin *twin, size_t *left, tl_rerun_target *target) {
    for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
        if (!twin->synchroniser.adjusted[v].is_boolean && (*left)-- == 0) {
            *target = (tl_rerun_target){
                .kind = TL_RERUN_ADJUSTED, .index = v, .value = tl_exchange_nominal(&twin->exchange, v)};
            describe(twin, twin->adjust_ports[v]->node, twin->adjust_ports[v]->variable, target);
            return true;
        }
    }
    return false;
}

static bool find_input(const tl_twin *twin, size_t *left, tl_rerun_target *target) {
    for (size_t i = 0; i < twin->graph.port_count; i++) {
        const tl_port *port = &twin->graph.ports[i];
        bool is_target = port->variable != NULL && port->input && port->type == TL_REAL && !port->adjusted &&
                         is_fed_by_plant(twin, port);
        if (is_target && (*left)-- == 0) {
            *target = (tl_rerun_target){.kind = TL_RERUN_INPUT,
                                        .index = port->index,
                                        .value = twin->graph.components[port->node].inputs.reals[port->index]};
            describe(twin, port->node, port->variable, target);
            return true;
        }
    }
    return false;
}

/* A parameter that the FMU rejects to give is left out. */
static bool find_parameter(tl_twin *twin, size_t *left, tl_rerun_target *target) {
    for (size_t k = 0; k < twin->graph.component_count; k++) {
        tl_component *component = &twin->graph.components[k];
        for (size_t i = 0; i < component->model->variable_count; i++) {
            const tl_variable *variable = &component->model->variables[i];
            tl_error error;
            double value = 0.0;
            if (can_change(twin, k, variable) &&
                tl_component_get_parameter(component, variable, &value, &error) == TL_OK && (*left)-- == 0) {
                *target = (tl_rerun_target){.kind = TL_RERUN_PARAMETER, .value = value};
                describe(twin, k, variable, target);
                return true;
            }
        }
    }
    return false;
}

bool tl_rerun_target_get(tl_twin *twin, size_t number, tl_rerun_target *target) {
    size_t left = number;
    return find_adjusted(twin, &left, target) || find_input(twin, &left, target) || find_parameter(twin, &left, target);
}

/* ---- mark ---- */

void tl_twin_end_mark(tl_twin *twin, size_t component) {
    twin->is_marked = false;
    if (twin->mark.components != NULL) {
        tl_snapshot_forget(&twin->mark, component);
    }
}

tl_status tl_twin_mark(tl_twin *twin, tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    twin->mark_step = exchange->plant.newest + 1 - (int64_t)twin->lead;
    if (twin->event != NULL || !tl_side_twin_is_possible(exchange) || !tl_exchange_can_take(exchange)) {
        return tl_fail(error, TL_BAD_DATA,
                       "its steps cannot be repeated: it has an event horizon, \"keep\": \"outputs\", or an FMU that "
                       "is rolled back by replay");
    }
    tl_exchange_keep_always(exchange);
    tl_status status = tl_exchange_take(exchange, twin->mark_step, error);
    status = status == TL_OK ? tl_snapshot_take(&twin->mark, error) : status;
    twin->is_marked = status == TL_OK;
    return status;
}

int64_t tl_twin_marked_step(const tl_twin *twin) {
    return twin->mark_step;
}

void tl_twin_get_plant(const tl_twin *twin, double *values) {
    const tl_plant *plant = &twin->exchange.plant;
    memcpy(values, plant->held, plant->signal_count * sizeof *values);
}

/* ---- re-run ---- */

static double changed(const tl_rerun *rerun, double value) {
    return value * rerun->factor + rerun->offset;
}

/* As a side twin, but with the change. */
static void set_adjusted(tl_twin *twin, const tl_rerun *rerun, bool is_due) {
    for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
        const tl_adjusted *adjusted = &twin->synchroniser.adjusted[v];
        double nominal = tl_exchange_nominal(&twin->exchange, v);
        bool is_target = is_due && rerun->target->kind == TL_RERUN_ADJUSTED && rerun->target->index == v;
        tl_exchange_set_adjusted(&twin->exchange, v,
                                 tl_approved_u(is_target ? changed(rerun, nominal) : nominal, adjusted->approved,
                                               adjusted->lower, adjusted->upper));
    }
}

static const double *plant_at(const tl_twin *twin, const tl_rerun *rerun, int64_t step) {
    int64_t row = step + 1 + twin->exchange.plant.shift - rerun->first_tick;
    int64_t last = (int64_t)rerun->ticks - 1;
    row = row < 0 ? 0 : row > last ? last : row;
    return rerun->plant + (size_t)row * twin->exchange.plant.signal_count;
}

static tl_status step_once(tl_twin *twin, const tl_rerun *rerun, int64_t step, tl_error *error) {
    const tl_rerun_target *target = rerun->target;
    bool is_due = target != NULL && step >= rerun->from;
    tl_status status = TL_OK;
    set_adjusted(twin, rerun, is_due);
    if (is_due && target->kind == TL_RERUN_INPUT) {
        double *input = &twin->graph.components[target->component].inputs.reals[target->index];
        *input = changed(rerun, *input); /* each step delivers it again */
    } else if (is_due && target->kind == TL_RERUN_PARAMETER && step == rerun->from) {
        status = tl_component_set_parameter(&twin->graph.components[target->component], target->variable,
                                            changed(rerun, target->value), error);
    }
    return status == TL_OK ? tl_exchange_step_with(&twin->exchange, step, plant_at(twin, rerun, step), error) : status;
}

/* Not every FMU's state contains its parameters. */
static tl_status restore_parameter(tl_twin *twin, const tl_rerun *rerun, tl_error *error) {
    const tl_rerun_target *target = rerun->target;
    return target != NULL && target->kind == TL_RERUN_PARAMETER
               ? tl_component_set_parameter(&twin->graph.components[target->component], target->variable, target->value,
                                            error)
               : TL_OK;
}

tl_status tl_twin_rerun(tl_twin *twin, const tl_rerun *rerun, double *y, tl_error *error) {
    const tl_objective *objective = &twin->synchroniser.objective;
    if (!twin->is_marked) {
        return tl_fail(error, TL_BAD_DATA, "its FMUs were instantiated again within the window");
    }
    tl_status status = tl_snapshot_restore(&twin->mark, error);
    for (size_t i = 0; i < rerun->steps && status == TL_OK; i++) {
        status = step_once(twin, rerun, twin->mark_step + (int64_t)i, error);
        for (size_t k = 0; k < objective->term_count; k++) {
            y[i * objective->term_count + k] = tl_objective_y(objective, k);
        }
    }
    if (status == TL_FMU_FATAL) {
        return status;
    }
    tl_error later;
    tl_status restored = tl_snapshot_restore(&twin->mark, &later);
    restored = restored == TL_OK ? restore_parameter(twin, rerun, &later) : restored;
    if (restored != TL_OK) {
        *error = later;
        return TL_FMU_FATAL; /* no further one can succeed */
    }
    return status;
}
