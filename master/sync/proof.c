/* The proof of the rollback: see proof.h. */
#include "master/sync/proof.h"

#include <math.h>
#include <string.h>

#include "master/sync/attempt.h"

static bool is_output(const tl_port *port) {
    return port->variable != NULL && !port->input;
}

static void note_outputs(const tl_exchange *exchange, const tl_graph *graph, double *outputs) {
    for (size_t i = 0; i < graph->port_count; i++) {
        if (is_output(&graph->ports[i])) {
            outputs[i] = tl_exchange_value(exchange, &graph->ports[i]);
        }
    }
}

/* Compares the outputs of all FMUs with those noted, to the bit. */
static tl_status compare_outputs(const tl_exchange *exchange, const tl_graph *graph, const double *outputs,
                                 tl_error *error) {
    for (size_t i = 0; i < graph->port_count; i++) {
        const tl_port *port = &graph->ports[i];
        if (!is_output(port)) {
            continue;
        }
        double value = tl_exchange_value(exchange, port);
        if (memcmp(&value, &outputs[i], sizeof value) != 0) {
            return tl_fail(error, TL_FMU_FAILED,
                           "%s.%s is not the same after restoring a saved state and repeating the "
                           "step: the FMU's state handling is broken, it cannot be synchronised",
                           graph->components[port->node].name, port->variable->name);
        }
    }
    return TL_OK;
}

/* Leads all states away from where they were: a horizon with other inputs. It may fail, as any candidate may. */
static tl_status lead_astray(const tl_lock *lock, int64_t first, tl_error *error) {
    double *u = lock->memory.trial;
    tl_status status = TL_OK;
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        const tl_adjusted *adjusted = &lock->adjusted[v];
        double now = tl_exchange_adjusted(lock->exchange, v);
        double value = adjusted->is_boolean ? 1.0 - now : now + adjusted->step;
        for (uint32_t m = 0; m < lock->horizon.length[v]; m++) {
            u[lock->horizon.offset[v] + m] = fmin(fmax(value, adjusted->lower), adjusted->upper);
        }
    }
    tl_attempt_set_inputs(lock, u, 0);
    for (uint32_t depth = 0; depth < lock->horizon.prediction && status == TL_OK; depth++) {
        status = tl_exchange_step(lock->exchange, first + depth, error);
    }
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* One step as it is. */
static tl_status step(tl_exchange *exchange, int64_t first, bool *stepped, tl_error *error) {
    tl_status status = tl_exchange_step(exchange, first, error);
    *stepped = status == TL_OK;
    return status;
}

tl_status tl_proof_of_rollback(tl_lock *lock, const tl_graph *graph, int64_t first, const tl_proof_place *place,
                               tl_error *error) {
    tl_exchange *exchange = lock->exchange;
    *place->stepped = true;
    tl_status status = tl_exchange_save(exchange, error);
    status = status == TL_OK ? step(exchange, first, place->stepped, error) : status;
    note_outputs(exchange, graph, place->outputs);
    status = status == TL_OK ? tl_exchange_restore(exchange, error) : status;
    status = status == TL_OK ? lead_astray(lock, first, error) : status;
    status = status == TL_OK ? tl_exchange_restore(exchange, error) : status;
    status = status == TL_OK ? step(exchange, first, place->stepped, error) : status;
    status = status == TL_OK ? compare_outputs(exchange, graph, place->outputs, error) : status;
    status = status == TL_OK ? tl_exchange_restore(exchange, error) : status;
    for (size_t i = 0; i < exchange->component_count; i++) {
        exchange->components[i].executions = 0;
    }
    return status;
}
