/* Reset of the FMUs: see twin_parts.h.
 *
 * States: a reset keeps saved states valid (FMI 2.0.4, 2.1.8: a handle is the FMU's until it is
 *         freed), so their handles are reused. They end with an instance, so they are freed before
 *         it.
 */
#include "master/twin/twin_parts.h"

void tl_twin_end_other_states(tl_twin *twin, size_t component) {
    tl_verifier_end_component(&twin->verifier, component);
    tl_free_twin_end_component(&twin->free_twin, component);
    tl_released_twin_end_component(&twin->released_twin, component);
    tl_twin_end_mark(twin, component);
}

static tl_status replace_component(tl_twin *twin, size_t component, tl_error *error) {
    tl_exchange_end_component(&twin->exchange, component);
    tl_event_horizon_forget(twin->event, component);
    tl_twin_end_other_states(twin, component);
    return tl_component_renew(&twin->graph.components[component], error);
}

static tl_status reset_component(tl_twin *twin, size_t component, tl_error *error) {
    tl_status status = tl_component_reset(&twin->graph.components[component], error);
    return status == TL_FMU_FAILED ? replace_component(twin, component, error) : status;
}

/* Resets all components by this method; then initialises them. */
static tl_status reset_all(tl_twin *twin, int64_t step, const double *plant,
                           tl_status (*method)(tl_twin *, size_t, tl_error *), tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    tl_status status = TL_OK;
    for (size_t i = 0; i < twin->graph.component_count && status == TL_OK; i++) {
        status = method(twin, i, error);
    }
    tl_exchange_clear(exchange, &twin->graph);
    return status == TL_OK ? tl_exchange_initialize(exchange, step, plant, error) : status;
}

/* An FMU may report a successful reset and then fail to initialise. */
tl_status tl_twin_restart(tl_twin *twin, int64_t step, const double *plant, tl_error *error) {
    tl_status status = reset_all(twin, step, plant, reset_component, error);
    return status == TL_FMU_FAILED ? reset_all(twin, step, plant, replace_component, error) : status;
}
