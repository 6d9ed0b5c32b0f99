/* Whether the FMUs of a twin still come back to where they were, and what becomes of it: see twin.h. */
#include <math.h>

#include "master/twin/twin_parts.h"

/* Of a tolerance: what is less says that the FMU is not exact, and does no harm to what is matched. */
static const double HARMLESS = 0.01;

/* Of the first match of that output. */
static double tolerances_apart(const tl_twin *twin, const tl_verifier_finding *found) {
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        if (twin->terms[i].port == found->port) {
            return fabs(found->again - found->committed) / twin->terms[i].tolerance;
        }
    }
    return (double)NAN;
}

static void describe(const tl_twin *twin, const tl_verifier_finding *found, tl_twin_finding *finding) {
    const tl_variable *variable = found->port != NULL ? found->port->variable : NULL;
    *finding = (tl_twin_finding){
        .component = twin->graph.components[found->component].name,
        .variable = variable != NULL ? variable->name : NULL,
        .unit = variable != NULL && variable->unit != NULL ? variable->unit->name : "",
        .step = found->step,
        .after = found->after,
        .committed = found->committed,
        .again = found->again,
        .cause = found->cause,
        .tolerances = found->port != NULL ? tolerances_apart(twin, found) : (double)NAN,
    };
}

/* It goes over to the other way, if it has one that it does not go already; else it is not asked again. */
static tl_status mend(tl_twin *twin, size_t component, tl_twin_mended *mended, tl_error *error) {
    int64_t next = twin->exchange.plant.newest + 1 - (int64_t)twin->lead;
    bool prefers_copy = twin->graph.components[component].prefers_copy;
    bool done = false;
    tl_verifier_end_component(&twin->verifier, component);
    tl_free_twin_end_component(&twin->free_twin, component);
    tl_status status = tl_exchange_give_up_states(&twin->exchange, component, next, &done, error);
    if (status != TL_OK) {
        return status;
    }
    status = tl_free_twin_begin(&twin->free_twin, error);
    twin->lock.rests = false;
    if (status != TL_OK) {
        return status;
    }
    *mended = !done ? TL_MENDED_NOT : prefers_copy ? TL_MENDED_BY_STATES : TL_MENDED_BY_MEMORY;
    if (done) {
        tl_ledger_begin_anew(&twin->lock.ledger);
    } else {
        tl_verifier_leave_out(&twin->verifier, component);
    }
    return TL_OK;
}

tl_status tl_twin_verify(tl_twin *twin, const tl_budget *budget, tl_twin_finding *finding, bool *found,
                         tl_error *error) {
    tl_verifier_finding seen;
    *found = false;
    if (twin->ended != TL_OK || twin->lock.runs_free) {
        return TL_OK;
    }
    twin->ended = tl_verifier_go_on(&twin->verifier, budget, &seen, found, error);
    if (twin->ended == TL_OK && *found) {
        describe(twin, &seen, finding);
        twin->ended = mend(twin, seen.component, &finding->mended, error);
        twin->finding = *finding;
        bool harmless = finding->tolerances < HARMLESS;
        twin->marks |= TL_FLAG_DIFFERED;
        twin->lasting |= finding->mended != TL_MENDED_NOT || harmless ? 0U : (uint32_t)TL_FLAG_DIFFERED;
    }
    return twin->ended;
}

const char *tl_twin_cause_text(tl_restore_cause cause) {
    return tl_restore_cause_text(cause);
}
