/* Side twin: see side_twin.h. */
#include "master/sync/side_twin.h"

#include "master/plan/tuning.h"

bool tl_side_twin_init(tl_side_twin *twin, tl_arena *arena, tl_exchange *exchange, size_t variables,
                       const tl_adjusted *adjusted) {
    *twin = (tl_side_twin){.exchange = exchange, .variables = variables, .adjusted = adjusted};
    twin->executions = tl_arena_take(arena, exchange->component_count, sizeof *twin->executions);
    return twin->executions != NULL;
}

bool tl_side_twin_init_state(tl_snapshot *state, tl_arena *arena, const tl_exchange *exchange) {
    return tl_snapshot_init(state, arena, exchange->components, exchange->component_count, exchange->values,
                            exchange->values_size);
}

bool tl_side_twin_is_possible(const tl_exchange *exchange) {
    bool has_replay = false;
    for (size_t i = 0; i < exchange->component_count; i++) {
        has_replay = has_replay || exchange->components[i].fmi->replay.most != 0;
    }
    return !has_replay;
}

static double find_u(const tl_side_twin *twin, size_t v) {
    double nominal = tl_exchange_nominal(twin->exchange, v);
    const tl_adjusted *adjusted = twin->adjusted != NULL ? &twin->adjusted[v] : NULL;
    return adjusted == NULL ? nominal : tl_approved_u(nominal, adjusted->approved, adjusted->lower, adjusted->upper);
}

/* Executes all components; their counts stay. */
static tl_status execute(tl_side_twin *twin, int64_t step, tl_error *error) {
    tl_exchange *exchange = twin->exchange;
    for (size_t i = 0; i < exchange->component_count; i++) {
        twin->executions[i] = exchange->components[i].executions;
    }
    for (size_t v = 0; v < twin->variables; v++) {
        tl_exchange_set_adjusted(exchange, v, find_u(twin, v));
    }
    tl_status status = tl_exchange_step(exchange, step, error);
    for (size_t i = 0; i < exchange->component_count; i++) {
        exchange->components[i].executions = twin->executions[i];
    }
    twin->count += exchange->component_count + 1;
    return status;
}

tl_status tl_side_twin_step(tl_side_twin *twin, const tl_snapshot *state, int64_t step, tl_error *error) {
    tl_status status = tl_snapshot_restore(state, error);
    return status == TL_OK ? execute(twin, step, error) : status;
}
