/* Candidates outside of a search: see twin_candidate.h. */
#include "master/twin/twin_candidate.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "master/sync/side_twin.h"
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

double tl_twin_present_nominal(const tl_twin *twin, size_t adjust) {
    return tl_exchange_nominal(&twin->exchange, adjust);
}

/* Adds y of all steps, times `sign`, to `response`. */
static void run_response(tl_twin *twin, size_t adjust, double change, size_t steps, double sign, double *response,
                         tl_error *failure) {
    tl_exchange *exchange = &twin->exchange;
    const tl_objective *objective = &twin->synchroniser.objective;
    int64_t step = exchange->plant.newest + 1 - (int64_t)twin->lead;
    for (size_t i = 0; i < steps && failure->status == TL_OK; i++) {
        for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
            double nominal = tl_exchange_nominal(exchange, v);
            tl_exchange_set_adjusted(exchange, v, v == adjust ? nominal + change : nominal);
        }
        (void)tl_exchange_step(exchange, step + (int64_t)i, failure);
        for (size_t m = 0; m < objective->term_count; m++) {
            response[i * objective->term_count + m] += sign * tl_objective_y(objective, m);
        }
    }
}

tl_status tl_twin_respond(tl_twin *twin, size_t adjust, double change, size_t steps, double *response,
                          tl_error *failure, tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    *failure = (tl_error){TL_OK, ""};
    if (!tl_side_twin_is_possible(exchange)) {
        (void)tl_fail(failure, TL_TRY_AGAIN, "an FMU is rolled back by replay");
        return TL_OK;
    }
    memset(response, 0, steps * twin->synchroniser.objective.term_count * sizeof *response);
    tl_status status = tl_exchange_take(exchange, exchange->plant.newest + 1 - (int64_t)twin->lead, error);
    for (int pass = 0; pass < 2 && status == TL_OK; pass++) {
        run_response(twin, adjust, pass == 0 ? 0.0 : change, steps, pass == 0 ? -1.0 : 1.0, response, failure);
        status = failure->status == TL_FMU_FATAL ? TL_FMU_FATAL : tl_exchange_return(exchange, error);
    }
    if (failure->status == TL_FMU_FATAL) {
        *error = *failure;
    }
    twin->ended = status;
    return status;
}
