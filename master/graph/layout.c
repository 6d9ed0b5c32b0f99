/* Layout of the values of the exchange, and their initialisation: see exchange.h. */
#include "master/graph/exchange.h"

#include <string.h>

/* ---- layout ---- */

/* Divides the value block into typed arrays at start-up. Reals come first, so alignment holds. */
typedef struct tl_layout {
    size_t reals;
    size_t integers; /* Integer and Boolean: the same C type */
    size_t next_real;
    size_t next_integer;
    unsigned char *block;
} tl_layout;

static double *next_reals(tl_layout *layout, size_t count) {
    double *reals = (double *)(void *)layout->block + layout->next_real;
    layout->next_real += count;
    return reals;
}

static fmi2Integer *next_integers(tl_layout *layout, size_t count) {
    unsigned char *start = layout->block + layout->reals * sizeof(double);
    fmi2Integer *integers = (fmi2Integer *)(void *)start + layout->next_integer;
    layout->next_integer += count;
    return integers;
}

static void count_values(const tl_graph *graph, tl_layout *layout) {
    for (size_t i = 0; i < graph->port_count; i++) {
        if (graph->ports[i].type == TL_REAL) {
            layout->reals++;
        } else {
            layout->integers++;
        }
    }
    layout->reals += graph->connection_count; /* room for û of each cut connection of either type */
    layout->integers += graph->connection_count;
}

static bool place_ports(tl_ports *ports, tl_arena *arena, tl_layout *layout) {
    ports->real_references = tl_arena_take(arena, ports->real_count, sizeof *ports->real_references);
    ports->integer_references = tl_arena_take(arena, ports->integer_count, sizeof *ports->integer_references);
    ports->boolean_references = tl_arena_take(arena, ports->boolean_count, sizeof *ports->boolean_references);
    ports->reals = next_reals(layout, ports->real_count);
    ports->integers = next_integers(layout, ports->integer_count);
    ports->booleans = next_integers(layout, ports->boolean_count);
    return ports->real_references != NULL && ports->integer_references != NULL && ports->boolean_references != NULL;
}

static bool has_reals_only(const tl_ports *ports) {
    return ports->real_count != 0 && ports->integer_count == 0 && ports->boolean_count == 0;
}

/* From the last component to the first, because each run continues the next component's. */
static void find_runs(tl_component *components, size_t count) {
    tl_fmi2_step_reals *next = NULL;
    for (size_t i = count; i-- > 0;) {
        tl_component *component = &components[i];
        tl_fmi2_step_reals *own = has_reals_only(&component->inputs) && has_reals_only(&component->outputs)
                                      ? component->fmi->step_reals
                                      : NULL;
        component->reals_run = own == NULL ? 0 : own == next ? component[1].reals_run + 1 : 1;
        next = own;
    }
}

static void place_signal(tl_exchange *exchange, const tl_port *port, tl_layout *layout) {
    tl_plant_output *output = &exchange->plant.outputs[port->signal];
    output->type = port->type;
    if (port->type == TL_REAL) {
        output->real = next_reals(layout, 1);
    } else if (port->type == TL_INTEGER) {
        output->integer = next_integers(layout, 1);
    } else {
        output->boolean = next_integers(layout, 1);
    }
}

static tl_ports *ports_of(const tl_exchange *exchange, const tl_port *port) {
    tl_component *component = &exchange->components[port->node];
    return port->input ? &component->inputs : &component->outputs;
}

/* Gives a port its value reference. */
static void place_reference(const tl_exchange *exchange, const tl_port *port) {
    const tl_ports *ports = ports_of(exchange, port);
    fmi2ValueReference *references = port->type == TL_REAL      ? ports->real_references
                                     : port->type == TL_INTEGER ? ports->integer_references
                                                                : ports->boolean_references;
    references[port->index] = port->variable->reference;
}

/* Sets its start value. */
static void fill_port(const tl_exchange *exchange, const tl_port *port) {
    const tl_ports *ports = ports_of(exchange, port);
    const tl_variable *variable = port->variable;
    if (port->type == TL_REAL) {
        ports->reals[port->index] = variable->has_start ? variable->start.real : 0.0;
    } else if (port->type == TL_INTEGER) {
        ports->integers[port->index] = variable->has_start ? variable->start.integer : 0;
    } else {
        ports->booleans[port->index] = variable->has_start && variable->start.integer != 0 ? fmi2True : fmi2False;
    }
}

static const void *location(const tl_exchange *exchange, const tl_port *port) {
    if (port->variable == NULL) {
        const tl_plant_output *output = &exchange->plant.outputs[port->signal];
        return port->type == TL_REAL      ? (const void *)output->real
               : port->type == TL_INTEGER ? (const void *)output->integer
                                          : (const void *)output->boolean;
    }
    const tl_ports *ports = ports_of(exchange, port);
    return port->type == TL_REAL      ? (const void *)&ports->reals[port->index]
           : port->type == TL_INTEGER ? (const void *)&ports->integers[port->index]
                                      : (const void *)&ports->booleans[port->index];
}

static void *target(tl_exchange *exchange, const tl_port *port) {
    tl_ports *ports = ports_of(exchange, port);
    return port->type == TL_REAL      ? (void *)&ports->reals[port->index]
           : port->type == TL_INTEGER ? (void *)&ports->integers[port->index]
                                      : (void *)&ports->booleans[port->index];
}

static void add_copy(tl_exchange *exchange, tl_connection *connection, tl_layout *layout) {
    if (connection->to->type != TL_REAL) {
        tl_integer_copy *copy = &exchange->integer_copies[exchange->integer_copy_count++];
        copy->to = target(exchange, connection->to);
        copy->from = location(exchange, connection->from);
        if (connection->cut) {
            copy->adjusted = copy->to;
            copy->to = next_integers(layout, 1);
            connection->nominal = copy->to;
        }
        return;
    }
    tl_real_copy *copy = tl_conversion_is_identity(&connection->conversion)
                             ? &exchange->copies[exchange->copy_count++]
                             : &exchange->conversions[exchange->conversion_count++];
    copy->to = target(exchange, connection->to);
    if (connection->cut) {
        copy->adjusted = copy->to;
        copy->to = next_reals(layout, 1);
        connection->nominal = copy->to;
    }
    copy->from = location(exchange, connection->from);
    copy->conversion = connection->conversion;
}

static bool take_tables(tl_exchange *exchange, tl_arena *arena, const tl_graph *graph, tl_layout *layout) {
    size_t connections = graph->connection_count;
    count_values(graph, layout);
    exchange->values_size = layout->reals * sizeof(double) + layout->integers * sizeof(fmi2Integer);
    exchange->real_count = layout->reals;
    exchange->values = tl_arena_take(arena, exchange->values_size, 1);
    exchange->copies = tl_arena_take(arena, connections, sizeof *exchange->copies);
    exchange->conversions = tl_arena_take(arena, connections, sizeof *exchange->conversions);
    exchange->integer_copies = tl_arena_take(arena, connections, sizeof *exchange->integer_copies);
    exchange->is_kept = tl_arena_take(arena, graph->component_count, sizeof *exchange->is_kept);
    layout->block = exchange->values;
    return exchange->values != NULL && exchange->is_kept != NULL &&
           tl_snapshot_init(&exchange->home, arena, graph->components, graph->component_count, exchange->values,
                            exchange->values_size) &&
           exchange->copies != NULL && exchange->conversions != NULL && exchange->integer_copies != NULL &&
           tl_costs_init(&exchange->costs, arena, graph->component_count);
}

tl_status tl_exchange_init(tl_exchange *exchange, tl_arena *arena, tl_graph *graph, size_t window, tl_error *error) {
    tl_layout layout = {0};
    exchange->components = graph->components;
    exchange->component_count = graph->component_count;
    exchange->step = graph->plan->step;
    exchange->step_s = tl_seconds(exchange->step);
    exchange->whole = true;
    bool placed = take_tables(exchange, arena, graph, &layout) &&
                  tl_plant_init(&exchange->plant, arena, graph->plan->signal_count, window, graph->plan->input_ticks);
    for (size_t i = 0; placed && i < graph->component_count; i++) {
        placed = place_ports(&graph->components[i].inputs, arena, &layout);
    }
    exchange->outputs = next_reals(&layout, 0);
    for (size_t i = 0; placed && i < graph->component_count; i++) {
        placed = place_ports(&graph->components[i].outputs, arena, &layout);
        exchange->output_count += graph->components[i].outputs.real_count;
    }
    if (!placed) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the values of the co-simulation");
    }
    find_runs(graph->components, graph->component_count);
    for (size_t i = 0; i < graph->port_count; i++) {
        if (graph->ports[i].variable == NULL) {
            place_signal(exchange, &graph->ports[i], &layout);
        } else {
            place_reference(exchange, &graph->ports[i]);
            fill_port(exchange, &graph->ports[i]);
        }
    }
    tl_plant_placed(&exchange->plant);
    for (size_t i = 0; i < graph->connection_count; i++) {
        add_copy(exchange, &graph->connections[i], &layout);
    }
    return TL_OK;
}

const void *tl_exchange_output(const tl_exchange *exchange, const tl_port *port) {
    return location(exchange, port);
}

double tl_exchange_value(const tl_exchange *exchange, const tl_port *port) {
    const void *value = location(exchange, port);
    return port->type == TL_REAL ? *(const double *)value : (double)*(const fmi2Integer *)value;
}

void tl_exchange_place_adjusted(tl_exchange *exchange, size_t variable, const tl_port *port,
                                const tl_connection *connection, double nominal) {
    tl_adjusted_input *input = &exchange->adjusted[variable];
    const void *delivered = connection != NULL ? connection->nominal : NULL;
    input->nominal = nominal;
    if (port->type == TL_REAL) {
        input->real = target(exchange, port);
        input->delivered_real = delivered;
    } else {
        input->boolean = target(exchange, port);
        input->delivered_boolean = delivered;
    }
    tl_exchange_set_adjusted(exchange, variable, nominal);
}

void tl_exchange_clear(tl_exchange *exchange, const tl_graph *graph) {
    memset(exchange->values, 0, exchange->values_size);
    for (size_t i = 0; i < graph->port_count; i++) {
        if (graph->ports[i].variable != NULL) {
            fill_port(exchange, &graph->ports[i]);
        }
    }
    for (size_t v = 0; v < TL_MAX_ADJUST; v++) {
        const tl_adjusted_input *input = &exchange->adjusted[v];
        if (input->real != NULL || input->boolean != NULL) {
            tl_exchange_set_adjusted(exchange, v, input->nominal);
        }
    }
}

/* ---- initialisation ---- */

/* Adjusted inputs have their nominal values until the first search. */
static void pass_nominal(tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->copy_count; i++) {
        if (exchange->copies[i].adjusted != NULL) {
            *exchange->copies[i].adjusted = *exchange->copies[i].to;
        }
    }
    for (size_t i = 0; i < exchange->conversion_count; i++) {
        if (exchange->conversions[i].adjusted != NULL) {
            *exchange->conversions[i].adjusted = *exchange->conversions[i].to;
        }
    }
    for (size_t i = 0; i < exchange->integer_copy_count; i++) {
        if (exchange->integer_copies[i].adjusted != NULL) {
            *exchange->integer_copies[i].adjusted = *exchange->integer_copies[i].to;
        }
    }
}

/* One round of outputs → inputs in initialisation mode. */
static tl_status settle(tl_exchange *exchange, tl_error *error) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_status status = tl_component_get_outputs(&exchange->components[i], error);
        if (status != TL_OK) {
            return status;
        }
    }
    tl_exchange_deliver(exchange);
    pass_nominal(exchange);
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_status status = tl_component_set_inputs(&exchange->components[i], error);
        if (status != TL_OK) {
            return status;
        }
    }
    return TL_OK;
}

static tl_status initialize_all(tl_exchange *exchange, double start, const double *plant, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        status = tl_component_enter_initialization(&exchange->components[i], start, error);
    }
    tl_plant_deliver_values(&exchange->plant, plant);
    /* A chain of direct feed-through converges after as many rounds as it has components. */
    for (size_t round = 0; round < exchange->component_count + 1 && status == TL_OK; round++) {
        memcpy(exchange->home.values, exchange->values, exchange->values_size);
        status = settle(exchange, error);
        if (memcmp(exchange->home.values, exchange->values, exchange->values_size) == 0) {
            break;
        }
    }
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        status = tl_component_exit_initialization(&exchange->components[i], error);
        if (status == TL_OK) {
            status = tl_component_get_outputs(&exchange->components[i], error);
        }
    }
    return status;
}

static size_t count_late(const tl_exchange *exchange) {
    size_t count = 0;
    for (size_t i = 0; i < exchange->component_count; i++) {
        count += exchange->components[i].reads_late ? 1 : 0;
    }
    return count;
}

tl_status tl_exchange_initialize(tl_exchange *exchange, int64_t first, const double *plant, tl_error *error) {
    double start = tl_seconds(tl_time_of_step(0, exchange->step, first));
    size_t late = count_late(exchange);
    exchange->begun = first;
    exchange->was_finite = false;
    tl_status status = initialize_all(exchange, start, plant, error);
    if (status == TL_FMU_FAILED && count_late(exchange) != late) { /* some FMUs are unusable after a rejected call */
        status = TL_OK;
        for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
            status = tl_component_renew(&exchange->components[i], error);
        }
        status = status == TL_OK ? initialize_all(exchange, start, plant, error) : status;
    }
    tl_exchange_deliver(exchange);
    return status;
}
