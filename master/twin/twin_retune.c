/* A twin that takes another tuning between two ticks: see twin.h.
 *
 * What changes is what the next search reads: targets, bounds, margin, nominal. What is remembered of steps is kept in units of its own (y, u), or
 * is brought into the new ones: the solver's slope, and how far u is from nominal.
 */
#include <math.h>
#include <string.h>

#include "master/twin/twin_parts.h"

/* The bounds in force: those that are wanted within those that the FMU declares. A Boolean has none. */
static tl_status place_bounds(const tl_twin *twin, size_t v, tl_tuning_adjust *adjust, tl_error *error) {
    const tl_variable *variable = twin->adjust_ports[v]->variable;
    if (twin->lock.adjusted[v].is_boolean) {
        bool known = adjust->has_nominal == 0 || !(adjust->nominal < 0.0 || adjust->nominal > 0.0) ||
                     !(adjust->nominal < 1.0 || adjust->nominal > 1.0);
        return known ? TL_OK
                     : tl_fail(error, TL_BAD_DATA, "%s is Boolean, and its nominal is %g, expected 0 or 1",
                               variable->name, adjust->nominal);
    }
    adjust->lower = fmax(adjust->lower, variable->minimum);
    adjust->upper = fmin(adjust->upper, variable->maximum);
    return adjust->lower < adjust->upper
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA,
                         "nothing is left to adjust of %s between the bounds %g and %g (those configured and those the "
                         "FMU declares)",
                         variable->name, adjust->lower, adjust->upper);
}

static tl_status check(const tl_twin *twin, tl_tuning *tuning, tl_error *error) {
    tl_status status = tl_tuning_check(tuning, error);
    if (status == TL_OK) {
        status = tl_tuning_fits(tuning, &twin->built, error);
    }
    for (size_t v = 0; status == TL_OK && v < tuning->adjusts; v++) {
        status = place_bounds(twin, v, &tuning->adjust[v], error);
    }
    return status;
}

/* Before the FMUs have begun they are to begin with it. */
static void place_nominal(tl_twin *twin, size_t v, const tl_tuning_adjust *adjust, bool begun) {
    if (adjust->has_nominal != 0) {
        tl_exchange_set_nominal(&twin->exchange, v, adjust->nominal);
        if (!begun) {
            tl_exchange_set_adjusted(&twin->exchange, v, adjust->nominal);
        }
    }
}

static void take(tl_twin *twin, const tl_tuning *tuning) {
    bool begun = twin->exchange.plant.newest >= twin->begin;
    tl_lock_retune(&twin->lock, twin->terms, tuning);
    for (size_t v = 0; v < tuning->adjusts; v++) {
        place_nominal(twin, v, &tuning->adjust[v], begun);
    }
    tl_free_twin_retune(&twin->free_twin);
    twin->lock.rests = false;
    if (twin->event != NULL) {
        tl_event_horizon_retune(twin->event, tuning, begun);
    }
}

tl_status tl_twin_retune(tl_twin *twin, const tl_tuning *tuning, tl_error *error) {
    tl_tuning wanted = *tuning;
    tl_status status = check(twin, &wanted, error);
    if (status == TL_OK && memcmp(&twin->tuning, tuning, sizeof *tuning) != 0) {
        take(twin, &wanted);
        twin->tuning = *tuning;
    }
    return status;
}

void tl_twin_get_tuning(const tl_twin *twin, tl_tuning *tuning) {
    *tuning = twin->tuning;
}
