/* Candidates outside of a search: see twin_candidate.h. */
#include "master/twin/twin_candidate.h"

#include <math.h>
#include <stdint.h>

#include "master/twin/twin_parts.h"

static tl_status check_outputs(const tl_twin *twin, tl_error *failure) {
    for (size_t i = 0; i < tl_twin_value_count(twin) && !tl_exchange_is_finite(&twin->exchange); i++) {
        tl_twin_value found;
        if (tl_twin_get_value(twin, i, &found) && !isfinite(found.value)) {
            return tl_fail(failure, TL_FMU_FAILED, "%s: its output %s becomes NaN or infinite", found.component,
                           found.variable);
        }
    }
    return TL_OK;
}

tl_status tl_twin_try_value(tl_twin *twin, size_t adjust, double value, double *values, tl_error *failure,
                            tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    int64_t step = exchange->plant.newest + 1 - (int64_t)twin->lead;
    bool was_finite = tl_exchange_is_finite(exchange);
    *failure = (tl_error){TL_OK, ""};
    tl_status status = tl_exchange_begin(exchange, error);
    for (uint32_t i = 0; i < twin->synchroniser.horizon.prediction && status == TL_OK && failure->status == TL_OK;
         i++) {
        tl_exchange_set_adjusted(exchange, adjust, value);
        (void)tl_exchange_try(exchange, step + i, i, failure);
        if (failure->status == TL_OK && was_finite) {
            (void)check_outputs(twin, failure);
        }
    }
    for (size_t i = 0; i < tl_twin_value_count(twin); i++) {
        tl_twin_value found = {.value = 0.0};
        (void)tl_twin_get_value(twin, i, &found);
        values[i] = found.value;
    }
    if (failure->status == TL_FMU_FATAL) {
        *error = *failure;
        status = TL_FMU_FATAL;
    } else if (status == TL_OK) {
        status = tl_exchange_rewind(exchange, error);
    }
    twin->ended = status;
    return status;
}
