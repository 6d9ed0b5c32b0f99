/* The proof of the rollback: see proof.h. */
#include "master/sync/proof.h"

#include <math.h>
#include <stdint.h>
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

#define NOBODY SIZE_MAX

/* Compares the outputs of all FMUs with those noted, to the bit. What one does with another's wrong output comes a step later: the first is the culprit. */
static tl_status compare_outputs(const tl_exchange *exchange, const tl_graph *graph, const double *outputs, int step,
                                 size_t *culprit, tl_error *error) {
    for (size_t i = 0; i < graph->port_count; i++) {
        const tl_port *port = &graph->ports[i];
        if (!is_output(port)) {
            continue;
        }
        double value = tl_exchange_value(exchange, port);
        if (memcmp(&value, &outputs[i], sizeof value) != 0) {
            *culprit = port->node;
            return tl_fail(
                error, TL_FMU_FAILED,
                "%s.%s is not the same after restoring a saved state and repeating %d step%s: the FMU does not "
                "come back to where it was, and cannot be synchronised this way; \"rollback\" of the component "
                "names another",
                graph->components[port->node].name, port->variable->name, step + 1, step == 0 ? "" : "s");
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

/* Steps as they are, their outputs noted. Of the first one a failure is one, of a later one the end, unless it is fatal. */
static tl_status take_steps(tl_exchange *exchange, const tl_graph *graph, int64_t first, double *outputs, int *steps,
                            tl_error *error) {
    tl_status status = TL_OK;
    *steps = 0;
    while (*steps < TL_PROOF_STEPS && status == TL_OK) {
        status = tl_exchange_step(exchange, first + *steps, error);
        if (status == TL_OK) {
            note_outputs(exchange, graph, &outputs[(size_t)*steps * graph->port_count]);
            (*steps)++;
        }
    }
    return *steps > 0 && status != TL_FMU_FATAL ? TL_OK : status;
}

/* The one whose state could not be saved or restored. */
static size_t find_failed(const tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        if (exchange->components[i].mode == TL_MODE_FAILED) {
            return i;
        }
    }
    return NOBODY;
}

static tl_status repeat_steps(tl_exchange *exchange, const tl_graph *graph, int64_t first, const double *outputs,
                              int steps, size_t *culprit, tl_error *error) {
    tl_status status = TL_OK;
    for (int i = 0; i < steps && status == TL_OK; i++) {
        status = tl_exchange_step(exchange, first + i, error);
        *culprit = status == TL_FMU_FAILED ? find_failed(exchange) : *culprit;
        if (status == TL_OK) {
            status = compare_outputs(exchange, graph, &outputs[(size_t)i * graph->port_count], i, culprit, error);
        }
    }
    return status;
}

/* To where it began. Who cannot even be led there is to blame. */
static tl_status go_back(tl_exchange *exchange, size_t *culprit, tl_error *error) {
    tl_status status = tl_exchange_restore(exchange, error);
    *culprit = status == TL_FMU_FAILED ? find_failed(exchange) : *culprit;
    return status;
}

static tl_status save(tl_exchange *exchange, size_t *culprit, tl_error *error) {
    tl_status status = tl_exchange_save(exchange, error);
    *culprit = status == TL_FMU_FAILED ? find_failed(exchange) : *culprit;
    return status;
}

static tl_status prove(tl_lock *lock, const tl_graph *graph, int64_t first, const tl_proof_place *place,
                       size_t *culprit, tl_error *error) {
    tl_exchange *exchange = lock->exchange;
    int steps = 0;
    tl_status status = save(exchange, culprit, error);
    if (status != TL_OK) {
        return status;
    }
    status = take_steps(exchange, graph, first, place->outputs, &steps, error);
    *place->stepped = status == TL_OK;
    status = status == TL_OK ? go_back(exchange, culprit, error) : status;
    status = status == TL_OK ? lead_astray(lock, first, error) : status;
    status = status == TL_OK ? go_back(exchange, culprit, error) : status;
    status = status == TL_OK ? repeat_steps(exchange, graph, first, place->outputs, steps, culprit, error) : status;
    status = status == TL_OK ? go_back(exchange, culprit, error) : status;
    return status == TL_OK ? save(exchange, culprit, error) : status; /* it may have done what no copy takes back */
}

tl_status tl_proof_of_rollback(tl_lock *lock, const tl_graph *graph, int64_t first, const tl_proof_place *place,
                               tl_error *error) {
    tl_exchange *exchange = lock->exchange;
    size_t culprit = NOBODY;
    tl_status status = TL_OK;
    tl_exchange_keep(exchange);
    do {
        *place->stepped = true;
        culprit = NOBODY;
        status = prove(lock, graph, first, place, &culprit, error);
    } while (status == TL_FMU_FAILED && culprit != NOBODY && tl_exchange_come_back(exchange, culprit));
    tl_exchange_let_go(exchange);
    for (size_t i = 0; i < exchange->component_count; i++) {
        exchange->components[i].executions = 0;
    }
    return status;
}
