/* The running co-simulation: values, initialisation, one Jacobi macro step, snapshots.
 *
 * Purpose: algorithms 1 and 2 of the thesis. In step i every component steps once with the inputs it holds, all
 *          outputs are read, then all inputs are assigned through the connections. Later the sequence cache
 *          (master/cache/) will stand between step() and the components; nothing else changes then.
 * Memory:  all port values lie in one block, so that a snapshot of them is one copy.
 * Thread:  the twin's.
 */
#ifndef TL_MASTER_GRAPH_EXCHANGE_H
#define TL_MASTER_GRAPH_EXCHANGE_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/graph/graph.h"
#include "master/graph/plant.h"

typedef struct tl_real_copy {
    fmi2Real *to;
    const fmi2Real *from;
    tl_conversion conversion;
    fmi2Real *adjusted; /* the input that a cut connection no longer drives, but while initialising; else NULL */
} tl_real_copy;

typedef struct tl_integer_copy {
    fmi2Integer *to; /* fmi2Boolean is the same C type */
    const fmi2Integer *from;
} tl_integer_copy;

typedef struct tl_exchange {
    tl_component *components;
    size_t component_count;
    tl_plant plant;
    tl_time step;          /* T_S */
    unsigned char *values; /* reals, then integers, then booleans, of all ports; then û of cut connections */
    unsigned char *saved_values;
    size_t values_size;
    tl_real_copy *copies; /* unit conversion is the identity */
    size_t copy_count;
    tl_real_copy *conversions;
    size_t conversion_count;
    tl_integer_copy *integer_copies;
    size_t integer_copy_count;
} tl_exchange;

/* Places all values and copies; the graph must be complete. `window` is the plant's, in samples. */
tl_status tl_exchange_init(tl_exchange *exchange, tl_arena *arena, tl_graph *graph, size_t window, tl_error *error);

/* Where the value of a Real input port is; for any port, its value as double. */
double *tl_exchange_input(tl_exchange *exchange, const tl_port *port);
double tl_exchange_value(const tl_exchange *exchange, const tl_port *port);

/* fmi2SetupExperiment … fmi2ExitInitializationMode of all components, outputs and inputs exchanged in between until
 * they agree. The plant must have a sample; it is delivered first. */
tl_status tl_exchange_initialize(tl_exchange *exchange, tl_error *error);

/* Inputs from outputs. */
void tl_exchange_deliver(tl_exchange *exchange);

/* Macro step i, from t_i to t_(i+1): K executions. final: no state before t_i will be restored any more. */
tl_status tl_exchange_step(tl_exchange *exchange, int64_t step, bool final, tl_error *error);

/* Snapshot of all components and values; one at a time. */
tl_status tl_exchange_save(tl_exchange *exchange, tl_error *error);
tl_status tl_exchange_restore(tl_exchange *exchange, tl_error *error);

#endif
