/* Graph of components and connections: see graph.h. */
#include "master/graph/graph.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

static const char PLANT[] = "plant.";

/* The component of "component.variable" and the start of the variable's name; NULL if there is
 * none. */
static tl_component *find_component(const tl_graph *graph, const char *name, const char **variable) {
    for (size_t i = 0; i < graph->component_count; i++) {
        size_t length = strlen(graph->components[i].name);
        if (strncmp(name, graph->components[i].name, length) == 0 && name[length] == '.') {
            *variable = name + length + 1;
            return &graph->components[i];
        }
    }
    return NULL;
}

/* The signal of "plant.signal"; SIZE_MAX if it does not exist or is not a signal's name. */
static size_t find_signal(const tl_graph *graph, const char *name) {
    if (strncmp(name, PLANT, sizeof PLANT - 1) != 0) {
        return SIZE_MAX;
    }
    for (size_t i = 0; i < graph->plan->signal_count; i++) {
        if (strcmp(graph->plan->signals[i].name, name + sizeof PLANT - 1) == 0) {
            return i;
        }
    }
    return SIZE_MAX;
}

static void report_no_signal(tl_report *report, const char *where, const char *name) {
    tl_report_add(report, TL_BAD_DATA, where, "found \"%s\", but the plant has no such signal; add it under \"plant\"",
                  name);
}

static void report_no_variable(const tl_component *component, const char *name, const char *where, tl_report *report) {
    const char *nearest = tl_model_nearest(component->model, name);
    tl_report_add(
        report, TL_BAD_DATA, where,
        "found \"%s.%s\", but the FMU of %s has no variable \"%s\"%s%s%s; `twinlock check --variables` lists them",
        component->name, name, component->name, name, nearest != NULL ? " (did you mean \"" : "",
        nearest != NULL ? nearest : "", nearest != NULL ? "\"?)" : "");
}

static bool is_unique(const tl_component *component, const tl_variable *variable, const char *where,
                      tl_report *report) {
    if (variable->is_ambiguous) {
        tl_report_add(report, TL_BAD_DATA, where,
                      "%s.%s: modelDescription.xml declares several variables of this name; rename them in the model "
                      "and export it again",
                      component->name, variable->name);
    }
    return !variable->is_ambiguous;
}

/* Looks up "component.variable" and reports what is missing. */
static const tl_variable *resolve(const tl_graph *graph, const char *name, const char *where, size_t *node,
                                  tl_report *report) {
    const char *variable_name = NULL;
    const tl_component *component = find_component(graph, name, &variable_name);
    if (component == NULL) {
        tl_report_add(report, TL_BAD_DATA, where,
                      "found \"%s\", expected component.variable of a configured component, for example \"%s.…\"", name,
                      graph->component_count == 0 ? "motor" : graph->components[0].name);
        return NULL;
    }
    const tl_variable *variable = tl_model_variable(component->model, variable_name);
    if (variable == NULL) {
        report_no_variable(component, variable_name, where, report);
        return NULL;
    }
    *node = (size_t)(component - graph->components);
    return is_unique(component, variable, where, report) ? variable : NULL;
}

static tl_type port_type(tl_type type) {
    return type == TL_ENUMERATION ? TL_INTEGER : type;
}

static size_t *port_counter(tl_ports *ports, tl_type type) {
    return type == TL_REAL ? &ports->real_count : type == TL_INTEGER ? &ports->integer_count : &ports->boolean_count;
}

/* Finds or adds the port of a variable. */
static const tl_port *use_variable(tl_graph *graph, size_t node, const tl_variable *variable, bool input) {
    for (size_t i = 0; i < graph->port_count; i++) {
        tl_port *port = &graph->ports[i];
        if (port->node == node && port->variable == variable && port->input == input) {
            return port;
        }
    }
    tl_port *port = &graph->ports[graph->port_count++];
    tl_ports *ports = input ? &graph->components[node].inputs : &graph->components[node].outputs;
    port->node = node;
    port->variable = variable;
    port->input = input;
    port->type = port_type(variable->type);
    port->index = (*port_counter(ports, port->type))++;
    return port;
}

static const tl_port *use_signal(tl_graph *graph, size_t signal) {
    for (size_t i = 0; i < graph->port_count; i++) {
        tl_port *port = &graph->ports[i];
        if (port->variable == NULL && port->signal == signal) {
            return port;
        }
    }
    tl_port *port = &graph->ports[graph->port_count++];
    port->node = graph->component_count;
    port->signal = signal;
    port->type = graph->plan->signals[signal].type;
    return port;
}

/* The unit of a port; that of a plant signal is looked up in the FMU on the other side. */
static tl_unit signal_unit(const tl_plan_signal *signal, const tl_model *peer) {
    const char *name = signal->unit != NULL ? signal->unit : "";
    const tl_unit *known = tl_model_unit(peer, name);
    return known != NULL ? *known : (tl_unit){.name = name};
}

/* By FMI's definitions, else as the caller of the master knows them. */
static bool convert_units(const tl_graph *graph, const tl_unit *from, const tl_unit *to, tl_conversion *conversion) {
    return tl_units_convert(from, to, conversion) ||
           (graph->plan->convert_units != NULL && graph->plan->convert_units(from, to, conversion));
}

static void report_units(tl_report *report, const char *where, const char *from, const char *from_unit, const char *to,
                         const char *to_unit) {
    tl_report_add(
        report, TL_BAD_DATA, where,
        "units do not fit: %s is in \"%s\", %s in \"%s\"; correct the unit, or convert with \"scale\" and \"offset\" "
        "of the signal",
        from, from_unit, to, to_unit);
}

/* `signal`: the name of the one that is a signal of the plant, whose type the configuration sets;
 * NULL: none. */
static void report_types(tl_report *report, const char *where, const char *from, tl_type from_type, const char *to,
                         tl_type to_type, const char *signal) {
    tl_type type = signal == to ? to_type : from_type;
    tl_type wanted = port_type(signal == to ? from_type : to_type);
    const char *remedy = wanted == TL_REAL      ? "; leave out \"type\" of "
                         : wanted == TL_BOOLEAN ? "; set \"type\": \"boolean\" of "
                                                : "; set \"type\": \"integer\" of ";
    tl_report_add(report, TL_BAD_DATA, where, "types do not fit: %s is %s, %s is %s%s%s%s", from,
                  tl_type_name(from_type), to, tl_type_name(to_type),
                  signal != NULL ? remedy : "; connect variables of the same type", signal != NULL ? signal : "",
                  signal != NULL && wanted == TL_REAL && type == TL_BOOLEAN ? ": a coil is then 0 or 1" : "");
}

/* Conversion from a source port to a variable of `model`. */
static bool convert(const tl_graph *graph, const tl_port *from, const tl_variable *to, const tl_model *model,
                    tl_conversion *conversion, const char **from_unit) {
    if (from->variable == NULL) {
        const tl_plan_signal *signal = &graph->plan->signals[from->signal];
        tl_unit unit = signal_unit(signal, model);
        *from_unit = signal->unit;
        return convert_units(graph, &unit, to->unit, conversion);
    }
    *from_unit = from->variable->unit == NULL ? "" : from->variable->unit->name;
    return convert_units(graph, from->variable->unit, to->unit, conversion);
}

static bool is_settable(const tl_variable *variable) {
    return variable->causality == TL_INPUT;
}

/* The source port of a connection; NULL if a problem was reported. */
static const tl_port *resolve_source(tl_graph *graph, const tl_plan_connection *plan, tl_report *report) {
    if (strncmp(plan->from, PLANT, sizeof PLANT - 1) == 0) {
        size_t signal = find_signal(graph, plan->from);
        if (signal == SIZE_MAX) {
            report_no_signal(report, plan->where, plan->from);
            return NULL;
        }
        return use_signal(graph, signal);
    }
    size_t node = 0;
    const tl_variable *variable = resolve(graph, plan->from, plan->where, &node, report);
    if (variable == NULL) {
        return NULL;
    }
    if (variable->causality != TL_OUTPUT || variable->type == TL_STRING) {
        tl_report_add(report, TL_BAD_DATA, plan->where,
                      "%s is a %s %s, expected a Real, Integer, Boolean or Enumeration "
                      "output as the source of a connection",
                      plan->from, tl_type_name(variable->type), tl_causality_name(variable->causality));
        return NULL;
    }
    return use_variable(graph, node, variable, false);
}

static bool is_connected(const tl_graph *graph, size_t node, const tl_variable *variable) {
    for (size_t i = 0; i < graph->connection_count; i++) {
        const tl_port *to = graph->connections[i].to;
        if (to->node == node && to->variable == variable) {
            return true;
        }
    }
    return false;
}

static void connect(tl_graph *graph, const tl_plan_connection *plan, tl_report *report) {
    const tl_port *from = resolve_source(graph, plan, report);
    size_t node = 0;
    const tl_variable *to = resolve(graph, plan->to, plan->where, &node, report);
    if (from == NULL || to == NULL) {
        return;
    }
    if (!is_settable(to)) {
        tl_report_add(report, TL_BAD_DATA, plan->where,
                      "%s is a %s %s, expected an input as the target of a connection", plan->to,
                      tl_variability_name(to->variability), tl_causality_name(to->causality));
        return;
    }
    if (port_type(to->type) != from->type) {
        report_types(report, plan->where, plan->from, from->variable == NULL ? from->type : from->variable->type,
                     plan->to, to->type, from->variable == NULL ? plan->from : NULL);
        return;
    }
    if (is_connected(graph, node, to)) {
        tl_report_add(report, TL_BAD_DATA, plan->where, "input %s is connected twice; remove one of the two", plan->to);
        return;
    }
    const char *from_unit = "";
    tl_conversion conversion;
    if (!convert(graph, from, to, graph->components[node].model, &conversion, &from_unit)) {
        report_units(report, plan->where, plan->from, from_unit, plan->to, to->unit->name);
        return;
    }
    tl_connection *connection = &graph->connections[graph->connection_count++];
    connection->from = from;
    connection->to = use_variable(graph, node, to, true);
    connection->conversion = conversion;
}

/* The value of the signal at which its input reaches this bound. Rounding must not move the input
 * beyond the bound. */
static double bound_of_signal(const tl_connection *connection, double bound, bool upper) {
    const tl_conversion *conversion = &connection->conversion;
    double found = tl_conversion_is_identity(conversion) ? bound : (bound - conversion->offset) / conversion->factor;
    double inside = upper == (conversion->factor > 0.0) ? -HUGE_VAL : HUGE_VAL;
    for (int i = 0; i < 8 && isfinite(found) && !tl_conversion_is_identity(conversion); i++) {
        double input = conversion->factor * found + conversion->offset;
        if (upper ? input <= bound : input >= bound) {
            break;
        }
        found = nextafter(found, inside);
    }
    return found;
}

static void intersect_items(tl_signal_bounds *bounds, const tl_variable *variable) {
    double shift = bounds->least - variable->minimum;
    uint64_t items = shift >= 0.0 && shift < 64.0 ? variable->items >> (unsigned)shift : 0;
    bounds->items = bounds->items == 0 ? items : bounds->items & items;
    if (bounds->items == 0) {
        bounds->most = bounds->least - 1.0; /* no common item */
    }
}

static void intersect(tl_signal_bounds *bounds, const tl_connection *connection) {
    const tl_variable *variable = connection->to->variable;
    double ends[2] = {bound_of_signal(connection, variable->minimum, false),
                      bound_of_signal(connection, variable->maximum, true)};
    bool turns = connection->conversion.factor < 0.0;
    double least = ends[turns ? 1 : 0];
    double most = ends[turns ? 0 : 1];
    if ((!isfinite(least) && !isfinite(most)) || connection->to->type == TL_BOOLEAN) {
        return;
    }
    if (bounds->items != 0 && least > bounds->least) {
        bounds->items = least - bounds->least < 64.0 ? bounds->items >> (unsigned)ceil(least - bounds->least) : 0;
    }
    bounds->least = fmax(bounds->least, least);
    bounds->most = fmin(bounds->most, most);
    bounds->scale = fmax(bounds->scale, fabs(variable->nominal / connection->conversion.factor));
    bounds->input = bounds->input == NULL ? connection->to : bounds->input;
    if (variable->items != 0) {
        intersect_items(bounds, variable);
    }
}

tl_signal_bounds tl_graph_signal_bounds(const tl_graph *graph, size_t signal) {
    tl_signal_bounds bounds = {.least = -HUGE_VAL, .most = HUGE_VAL};
    for (size_t i = 0; i < graph->connection_count; i++) {
        const tl_connection *connection = &graph->connections[i];
        if (connection->from->node == graph->component_count && connection->from->signal == signal) {
            intersect(&bounds, connection);
        }
    }
    return bounds;
}

/* A number of any type as double. */
static double number_of(const tl_value *value) {
    return value->type == TL_REAL ? value->real : (double)value->integer;
}

static bool is_number(const tl_value *value) {
    return (value->type == TL_REAL && isfinite(value->real)) || value->type == TL_INTEGER ||
           value->type == TL_ENUMERATION;
}

static bool is_whole(double number) {
    return fabs(number) <= 2147483647.0 && number >= floor(number) && number <= floor(number);
}

bool tl_graph_fit_value(const tl_variable *variable, const tl_value *value, tl_value *fitted, const char **expected) {
    *fitted = *value;
    fitted->type = variable->type;
    switch (variable->type) {
    case TL_REAL:
        *expected = "a number";
        fitted->real = number_of(value);
        return is_number(value);
    case TL_INTEGER:
    case TL_ENUMERATION:
        *expected = "a whole number";
        if (!is_number(value) || !is_whole(number_of(value))) {
            return false;
        }
        fitted->integer = (int32_t)number_of(value);
        return true;
    case TL_BOOLEAN:
        *expected = "true or false";
        return value->type == TL_BOOLEAN;
    case TL_STRING:
        *expected = "text";
        return value->type == TL_STRING;
    }
    return false;
}

/* Before the FMU is initialised. */
static bool has_set_start(const tl_variable *variable) {
    return (variable->causality == TL_PARAMETER || variable->causality == TL_INPUT || variable->has_start) &&
           variable->variability != TL_CONSTANT;
}

static bool names_signal(const tl_variable *variable, const tl_value *value) {
    return variable->type != TL_STRING && value->type == TL_STRING &&
           strncmp(value->text, PLANT, sizeof PLANT - 1) == 0;
}

size_t tl_graph_start_signal(const tl_graph *graph, size_t component, const tl_plan_set *set, tl_conversion *conversion,
                             tl_report *report) {
    const tl_model *model = graph->components[component].model;
    const tl_variable *variable = tl_model_variable(model, set->variable);
    if (!names_signal(variable, &set->value)) {
        return SIZE_MAX;
    }
    size_t signal = find_signal(graph, set->value.text);
    if (signal == SIZE_MAX) {
        report_no_signal(report, set->where, set->value.text);
        return SIZE_MAX;
    }
    const tl_plan_signal *plan = &graph->plan->signals[signal];
    tl_unit unit = signal_unit(plan, model);
    if (variable->causality == TL_INPUT) {
        tl_report_add(report, TL_BAD_DATA, set->where,
                      "%s is an input, which \"set\" holds constant: connect %s to it, or set a number", set->variable,
                      set->value.text);
    } else if (variable->type != TL_REAL || plan->type != TL_REAL) {
        tl_report_add(report, TL_BAD_DATA, set->where, "%s is %s and %s is %s, expected two Reals", set->variable,
                      tl_type_name(variable->type), set->value.text, tl_type_name(plan->type));
    } else if (!variable->has_start && !plan->has_initial) {
        tl_report_add(report, TL_BAD_DATA, set->where,
                      "%s has no start value for the time until %s is good: give this signal \"initial\"",
                      set->variable, set->value.text);
    } else if (!convert_units(graph, &unit, variable->unit, conversion)) {
        report_units(report, set->where, set->value.text, plan->unit, set->variable, variable->unit->name);
    } else {
        return signal;
    }
    return SIZE_MAX;
}

const tl_variable *tl_graph_found_start(const tl_graph *graph, const tl_plan_find *find, size_t *node,
                                        tl_report *report) {
    const tl_variable *variable = resolve(graph, find->variable, find->where, node, report);
    if (variable == NULL) {
        return NULL;
    }
    double lower = fmax(find->lower, variable->minimum);
    double upper = fmin(find->upper, variable->maximum);
    if (variable->type != TL_REAL || variable->causality == TL_INPUT || !has_set_start(variable)) {
        tl_report_add(report, TL_BAD_DATA, find->where,
                      "%s is a %s %s %s, expected a Real parameter or a Real with a start value", find->variable,
                      tl_variability_name(variable->variability), tl_type_name(variable->type),
                      tl_causality_name(variable->causality));
        return NULL;
    }
    if (!(lower < upper)) {
        tl_report_add(report, TL_BAD_DATA, find->where,
                      "no range is left between the bounds %g and %g (configured, and declared by the FMU): widen "
                      "\"min\" and \"max\"",
                      lower, upper);
        return NULL;
    }
    return variable;
}

static void check_set(const tl_graph *graph, size_t index, const tl_plan_set *set, tl_report *report) {
    const tl_component *component = &graph->components[index];
    const tl_variable *variable = tl_model_variable(component->model, set->variable);
    const char *expected = "";
    tl_conversion conversion;
    tl_value fitted;
    if (variable == NULL) {
        report_no_variable(component, set->variable, set->where, report);
    } else if (variable->is_ambiguous) {
        (void)is_unique(component, variable, set->where, report);
    } else if (!has_set_start(variable)) {
        tl_report_add(report, TL_BAD_DATA, set->where,
                      "%s.%s is a %s %s and cannot be set; expected a parameter or an "
                      "input",
                      component->name, set->variable, tl_variability_name(variable->variability),
                      tl_causality_name(variable->causality));
    } else if (names_signal(variable, &set->value)) {
        (void)tl_graph_start_signal(graph, index, set, &conversion, report);
    } else if (!tl_graph_fit_value(variable, &set->value, &fitted, &expected)) {
        bool is_text = set->value.type == TL_STRING;
        tl_report_add(report, TL_BAD_DATA, set->where, "%s.%s is %s: found %s%.40s%s, expected %s", component->name,
                      set->variable, tl_type_name(variable->type), is_text ? "\"" : "",
                      is_text ? set->value.text : "another value", is_text ? "\"" : "", expected);
    }
}

static void add_component(tl_graph *graph, size_t index, tl_report *report) {
    const tl_plan_component *plan = &graph->plan->components[index];
    tl_component *component = &graph->components[index];
    component->name = plan->name;
    component->model = plan->model;
    component->fmi = plan->functions;
    component->logging = plan->logging;
    for (size_t i = 0; i < plan->set_count; i++) {
        check_set(graph, index, &plan->set[i], report);
    }
    for (size_t i = 0; i < index; i++) {
        if (graph->components[i].fmi == plan->functions && plan->model->capabilities.can_be_instantiated_only_once) {
            tl_report_add(report, TL_BAD_DATA, plan->where,
                          "%s and %s use the same FMU, which can be instantiated only once per process "
                          "(canBeInstantiatedOnlyOncePerProcess)",
                          graph->components[i].name, plan->name);
        }
    }
}

void tl_graph_build(tl_graph *graph, tl_arena *arena, const tl_plan *plan, tl_report *report) {
    graph->plan = plan;
    graph->port_capacity = 2 * plan->connection_count + plan->match_count + plan->adjust_count + plan->output_count;
    graph->components = tl_arena_take(arena, plan->component_count, sizeof *graph->components);
    graph->ports = tl_arena_take(arena, graph->port_capacity, sizeof *graph->ports);
    graph->connections = tl_arena_take(arena, plan->connection_count, sizeof *graph->connections);
    if (graph->components == NULL || graph->ports == NULL || graph->connections == NULL) {
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the graph");
        return;
    }
    graph->component_count = plan->component_count;
    for (size_t i = 0; i < plan->component_count; i++) {
        add_component(graph, i, report);
    }
    for (size_t i = 0; i < plan->connection_count; i++) {
        connect(graph, &plan->connections[i], report);
    }
}

const tl_port *tl_graph_output(tl_graph *graph, const char *name, const char *where, tl_report *report) {
    size_t node = 0;
    const tl_variable *variable = resolve(graph, name, where, &node, report);
    if (variable == NULL) {
        return NULL;
    }
    if ((variable->causality != TL_OUTPUT && variable->causality != TL_LOCAL) || variable->type == TL_STRING) {
        tl_report_add(report, TL_BAD_DATA, where, "%s is a %s %s, expected an output that is a number or a boolean",
                      name, tl_type_name(variable->type), tl_causality_name(variable->causality));
        return NULL;
    }
    return use_variable(graph, node, variable, false);
}

size_t tl_graph_match_signal(tl_graph *graph, const tl_plan_match *match, const tl_port *port,
                             tl_conversion *conversion, tl_report *report) {
    size_t signal = find_signal(graph, match->to);
    if (signal == SIZE_MAX) {
        tl_report_add(report, TL_BAD_DATA, match->where,
                      "found \"%s\", expected a signal of the plant, for example "
                      "\"plant.%s\"",
                      match->to, graph->plan->signal_count == 0 ? "omega" : graph->plan->signals[0].name);
        return SIZE_MAX;
    }
    const tl_plan_signal *plan = &graph->plan->signals[signal];
    if (plan->type != port->type) {
        report_types(report, match->where, match->variable, port->type, match->to, plan->type, match->to);
        return SIZE_MAX;
    }
    tl_unit unit = signal_unit(plan, graph->components[port->node].model);
    if (!convert_units(graph, &unit, port->variable->unit, conversion)) {
        report_units(report, match->where, match->to, plan->unit, match->variable, port->variable->unit->name);
        return SIZE_MAX;
    }
    return signal;
}

/* An adjusted variable is an input or a tunable parameter, Real or Boolean. */
static bool is_adjustable(const tl_plan_adjust *adjust, const tl_variable *variable, tl_report *report) {
    if (variable->type != TL_REAL && variable->type != TL_BOOLEAN) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "%s is %s, expected an input or a tunable parameter that is Real or Boolean", adjust->variable,
                      tl_type_name(variable->type));
        return false;
    }
    if (variable->causality == TL_PARAMETER && variable->variability != TL_TUNABLE) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "%s is a fixed parameter: it cannot change while the simulation "
                      "runs; adjust an input or a tunable parameter, or have the FMU exported with it tunable",
                      adjust->variable);
        return false;
    }
    if (variable->causality != TL_PARAMETER && variable->causality != TL_INPUT) {
        tl_report_add(report, TL_BAD_DATA, adjust->where, "%s is a %s %s, expected an input or a tunable parameter",
                      adjust->variable, tl_variability_name(variable->variability),
                      tl_causality_name(variable->causality));
        return false;
    }
    return true;
}

const tl_port *tl_graph_adjust(tl_graph *graph, const tl_plan_adjust *adjust, tl_report *report) {
    size_t node = 0;
    const tl_variable *variable = resolve(graph, adjust->variable, adjust->where, &node, report);
    if (variable == NULL || !is_adjustable(adjust, variable, report)) {
        return NULL;
    }
    const tl_port *port = use_variable(graph, node, variable, true);
    graph->ports[port - graph->ports].adjusted = true;
    for (size_t i = 0; i < graph->connection_count; i++) {
        if (graph->connections[i].to == port) {
            graph->connections[i].cut = true;
            if (adjust->has_nominal) {
                tl_report_add(report, TL_BAD_DATA, adjust->where,
                              "%s is connected, so its nominal value comes from the "
                              "connection; remove \"nominal\" or the connection",
                              adjust->variable);
            }
        }
    }
    return port;
}

const tl_connection *tl_graph_connection_to(const tl_graph *graph, const tl_port *port) {
    for (size_t i = 0; i < graph->connection_count; i++) {
        if (graph->connections[i].to == port) {
            return &graph->connections[i];
        }
    }
    return NULL;
}

static bool is_set(const tl_plan_component *plan, const char *variable) {
    for (size_t i = 0; i < plan->set_count; i++) {
        if (strcmp(plan->set[i].variable, variable) == 0) {
            return true;
        }
    }
    return false;
}

static bool has_input_port(const tl_graph *graph, size_t node, const tl_variable *variable) {
    for (size_t i = 0; i < graph->port_count; i++) {
        const tl_port *port = &graph->ports[i];
        if (port->input && port->node == node && port->variable == variable) {
            return true;
        }
    }
    return false;
}

/* Whether the plan has a connection to an input; if it is wrong, that was reported already. */
static bool is_target(const tl_graph *graph, size_t node, const tl_variable *variable) {
    for (size_t i = 0; i < graph->plan->connection_count; i++) {
        const char *name = "";
        const tl_component *component = find_component(graph, graph->plan->connections[i].to, &name);
        if (component == &graph->components[node] && strcmp(name, variable->name) == 0) {
            return true;
        }
    }
    return false;
}

void tl_graph_check_inputs(const tl_graph *graph, tl_report *report) {
    for (size_t node = 0; node < graph->component_count; node++) {
        const tl_plan_component *plan = &graph->plan->components[node];
        for (size_t i = 0; i < plan->model->variable_count; i++) {
            const tl_variable *variable = &plan->model->variables[i];
            if (variable->causality == TL_INPUT && variable->is_ambiguous) {
                (void)is_unique(&graph->components[node], variable, plan->where, report);
            } else if (variable->causality == TL_INPUT && !has_input_port(graph, node, variable) &&
                       !is_set(plan, variable->name) && !is_target(graph, node, variable)) {
                tl_report_add(report, TL_BAD_DATA, plan->where,
                              "input %s.%s is not connected; connect it, or give it a "
                              "constant value in components.%s.set",
                              plan->name, variable->name, plan->name);
            }
        }
    }
}

size_t tl_graph_distance(const tl_graph *graph, size_t from, size_t to, size_t *scratch) {
    size_t nodes = graph->component_count + 1;
    for (size_t i = 0; i < nodes; i++) {
        scratch[i] = TL_UNREACHABLE;
    }
    scratch[from] = 0;
    for (size_t distance = 0; distance < nodes && scratch[to] == TL_UNREACHABLE; distance++) {
        for (size_t i = 0; i < graph->connection_count; i++) {
            const tl_connection *connection = &graph->connections[i];
            if (!connection->cut && scratch[connection->from->node] == distance &&
                scratch[connection->to->node] == TL_UNREACHABLE) {
                scratch[connection->to->node] = distance + 1;
            }
        }
    }
    return scratch[to];
}
