/* Graph of components and connections.
 *
 * Thread:  one thread at a time uses a graph.
 */
#ifndef TL_MASTER_GRAPH_GRAPH_H
#define TL_MASTER_GRAPH_GRAPH_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/fmi/component.h"
#include "master/fmi/model.h"
#include "master/fmi/units.h"
#include "master/plan/plan.h"

/* ---- Structure of the co-simulation: components, exchanged ports, connections, distances.
 *
 * Purpose: resolves the names of a plan in the FMUs, checks types and units, and answers questions
 *          about paths. It holds no values; exchange.h does.
 * Source:  thesis, section 4.2; c̃(a, b) is the number of edges of the shortest path (eq. 4.1).
 * Nodes:   components 0 … component_count − 1 are FMUs; node component_count is the plant.
 * Owner:   everything is in the arena.
 */

/* No path. */
#define TL_UNREACHABLE SIZE_MAX

/* One exchanged variable of one component, or one signal of the plant. */
typedef struct tl_port {
    size_t node;
    const tl_variable *variable; /* NULL for a signal of the plant */
    size_t signal;               /* index of the plant's signal, if `variable` is NULL */
    bool adjusted;               /* candidates set its value */
    bool input;                  /* set before each step (input, adjusted parameter); else read after each step */
    tl_type type;                /* TL_REAL, TL_INTEGER (enumerations too) or TL_BOOLEAN */
    size_t index;                /* among the component's ports of this direction and type */
} tl_port;

typedef struct tl_connection {
    const tl_port *from;
    const tl_port *to;
    tl_conversion conversion;
    bool cut;            /* `to` is adjusted: this connection delivers û and does not set the input */
    const void *nominal; /* address of û if cut, in the port's type; placed by exchange.h */
} tl_connection;

typedef struct tl_graph {
    const tl_plan *plan; /* during the build only */
    tl_component *components;
    size_t component_count;
    tl_port *ports;
    size_t port_count;
    size_t port_capacity;
    tl_connection *connections;
    size_t connection_count;
} tl_graph;

/* Builds components (not yet instantiated) and connections of the plan. Problems go to the
 * report. */
void tl_graph_build(tl_graph *graph, tl_arena *arena, const tl_plan *plan, tl_report *report);

/* The port of an output (or local variable) to match or read. NULL if a problem was reported. */
const tl_port *tl_graph_output(tl_graph *graph, const char *name, const char *where, tl_report *report);

/* Index of the signal that a match is compared with, and the conversion from its unit to the
 * port's. SIZE_MAX if a problem was reported. */
size_t tl_graph_match_signal(tl_graph *graph, const tl_plan_match *match, const tl_port *port,
                             tl_conversion *conversion, tl_report *report);

/* Returns the port of an adjusted variable and cuts the connection to it, if there is one. NULL if
 * a problem was reported. */
const tl_port *tl_graph_adjust(tl_graph *graph, const tl_plan_adjust *adjust, tl_report *report);

/* The connection to a port; NULL if there is none. */
const tl_connection *tl_graph_connection_to(const tl_graph *graph, const tl_port *port);

/* Reports each input that has no source. Call after all tl_graph_adjust(). */
void tl_graph_check_inputs(const tl_graph *graph, tl_report *report);

/* Permitted values of a plant signal, in the signal's unit. The inputs that read the signal declare
 * them. */
typedef struct tl_signal_bounds {
    double least, most;   /* bounds that inputs or their types declare; ∓infinity: none */
    double scale;         /* > 0: largest nominal value of the inputs that declare a bound; 0: no input does */
    uint64_t items;       /* Enumeration: bit k: `least` + k is permitted; 0: all values within the bounds */
    const tl_port *input; /* the first input that declares a bound; NULL: none */
} tl_signal_bounds;

/* The bounds are the intersection over all connections of the signal, also those that only deliver
 * û. If there is no common value, least > most. */
tl_signal_bounds tl_graph_signal_bounds(const tl_graph *graph, size_t signal);

/* c̃(from, to): macro steps of the shortest path over connections that are not cut; TL_UNREACHABLE
 * if there is no path. `from`, `to`: nodes. `scratch`: component_count + 1 entries. */
size_t tl_graph_distance(const tl_graph *graph, size_t from, size_t to, size_t *scratch);

/* The signal of the plant that an entry of `set` names ("plant.level") in place of a value, and the
 * conversion to the variable's unit. SIZE_MAX: it has a value, or a problem was reported. The
 * variable must exist. */
size_t tl_graph_start_signal(const tl_graph *graph, size_t component, const tl_plan_set *set, tl_conversion *conversion,
                             tl_report *report);

/* The variable whose start value is to be found, and its component. NULL if a problem was
 * reported. */
const tl_variable *tl_graph_found_start(const tl_graph *graph, const tl_plan_find *find, size_t *node,
                                        tl_report *report);

/* Converts the value of a `set` entry to the variable's type. Returns false if the value does not
 * fit. *expected: the expected type in words, for a message. */
bool tl_graph_fit_value(const tl_variable *variable, const tl_value *value, tl_value *fitted, const char **expected);

#endif
