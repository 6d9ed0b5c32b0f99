/* A twin that begins anew in the middle of its run: see twin.h.
 *
 * States: a reset ends none of those that were saved (FMI 2.0.4, 2.1.8: a handle is the FMU's until it is freed), so their handles are used
 *         again. They end with an instance, which must have them back before.
 */
#include "master/twin/twin_parts.h"

void tl_twin_reset(tl_twin *twin) {
    int64_t next = twin->exchange.plant.newest + 1 - (int64_t)twin->lead;
    twin->resets = next >= twin->first;
}

static tl_status renew(tl_twin *twin, size_t component, tl_error *error) {
    tl_exchange_end_component(&twin->exchange, component);
    tl_event_horizon_forget(twin->event, component);
    tl_verifier_end_component(&twin->verifier, component);
    tl_free_twin_end_component(&twin->free_twin, component);
    return tl_component_renew(&twin->graph.components[component], error);
}

static tl_status reset(tl_twin *twin, size_t component, tl_error *error) {
    tl_status status = tl_component_reset(&twin->graph.components[component], error);
    return status == TL_FMU_FAILED ? renew(twin, component, error) : status;
}

/* All of them in that way; then they are initialised. */
static tl_status begin(tl_twin *twin, int64_t step, tl_status (*way)(tl_twin *, size_t, tl_error *), tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    tl_status status = TL_OK;
    for (size_t i = 0; i < twin->graph.component_count && status == TL_OK; i++) {
        status = way(twin, i, error);
    }
    tl_exchange_clear(exchange, &twin->graph);
    int64_t shown = tl_plant_shown(&exchange->plant, step, exchange->plant.newest);
    return status == TL_OK ? tl_exchange_initialize(exchange, step, shown, error) : status;
}

tl_status tl_twin_begin_anew(tl_twin *twin, int64_t step, uint32_t *flags, tl_error *error) {
    twin->resets = false;
    tl_verifier_abandon(&twin->verifier);
    tl_status status = begin(twin, step, reset, error);
    if (status == TL_FMU_FAILED) {
        status = begin(twin, step, renew, error); /* an FMU may say that it was reset, and not be able to begin */
    }
    if (status != TL_OK) {
        return status;
    }
    bool given_up = twin->event != NULL && tl_event_horizon_begin_anew(twin->event);
    *flags = TL_FLAG_RESET | (given_up ? TL_FLAG_ABANDONED : 0U);
    tl_lock_begin_anew(&twin->lock);
    status = tl_exchange_begin_anew(&twin->exchange, step, error);
    twin->lock.rests = false;
    return status == TL_OK ? tl_free_twin_begin(&twin->free_twin, error) : status;
}
