/* The free twin: see free_twin.h. */
#include "master/sync/free_twin.h"

#include <math.h>

/* Of each component: the free twin's, the prediction's, and where the twin is. */
enum { STATES = 3 };

static bool place(tl_snapshot *snapshot, tl_arena *arena, const tl_exchange *exchange) {
    return tl_snapshot_init(snapshot, arena, exchange->components, exchange->component_count, exchange->values,
                            exchange->values_size);
}

bool tl_free_twin_init(tl_free_twin *twin, tl_arena *arena, tl_exchange *exchange, const tl_objective *objective,
                       uint32_t guard) {
    *twin = (tl_free_twin){.exchange = exchange, .objective = objective, .is_led = guard != 0};
    if (guard == 0) {
        return true;
    }
    twin->contest.guard = guard;
    exchange->beside += STATES;
    twin->executions = tl_arena_take(arena, exchange->component_count, sizeof *twin->executions);
    return twin->executions != NULL && place(&twin->free, arena, exchange) && place(&twin->predicted, arena, exchange);
}

static bool has_replay(const tl_exchange *exchange) {
    bool has = false;
    for (size_t i = 0; i < exchange->component_count; i++) {
        has = has || exchange->components[i].fmi->replay.most != 0;
    }
    return has;
}

tl_status tl_free_twin_begin(tl_free_twin *twin, tl_error *error) {
    twin->is_led = twin->is_led && !has_replay(twin->exchange);
    if (!twin->is_led) {
        return TL_OK;
    }
    tl_exchange_keep_always(twin->exchange);
    tl_contest_begin_anew(&twin->contest);
    twin->predicts = true;
    tl_status status = tl_snapshot_take(&twin->free, error);
    return status == TL_OK ? tl_snapshot_take(&twin->predicted, error) : status;
}

bool tl_free_twin_rests(const tl_free_twin *twin) {
    return twin->contest.rests;
}

void tl_free_twin_retune(tl_free_twin *twin) {
    twin->contest = (tl_contest){.guard = twin->contest.guard};
    twin->predicts = false;
}

/* ---- one step beside ---- */

/* These outputs against what was measured; false: nothing was. */
static bool measure(const tl_free_twin *twin, const tl_record *record, const double *y, double *errors) {
    const tl_objective *objective = twin->objective;
    bool measured = false;
    for (size_t i = 0; i < objective->term_count; i++) {
        const tl_objective_term *term = &objective->terms[i];
        bool is_good = term->weight > 0.0 && record->y_hat_quality[i] == TL_GOOD;
        errors[i] = is_good ? sqrt(term->weight) * (y[i] - record->y_hat[i]) / term->tolerance : 0.0;
        measured = measured || is_good;
    }
    return measured;
}

/* The same of the outputs as they stand. */
static void measure_now(const tl_free_twin *twin, const tl_record *record, double *errors) {
    double y[TL_MAX_MATCH] = {0.0};
    for (size_t i = 0; i < twin->objective->term_count; i++) {
        y[i] = tl_objective_y(twin->objective, i);
    }
    (void)measure(twin, record, y, errors);
}

/* All components, with nominal u. Their counts stay as they are. */
static tl_status execute(tl_free_twin *twin, int64_t step, tl_error *error) {
    tl_exchange *exchange = twin->exchange;
    for (size_t i = 0; i < exchange->component_count; i++) {
        twin->executions[i] = exchange->components[i].executions;
    }
    for (size_t v = 0; v < twin->objective->horizon->variables; v++) {
        tl_exchange_set_adjusted(exchange, v, tl_exchange_nominal(exchange, v));
    }
    tl_status status = tl_exchange_step(exchange, step, error);
    for (size_t i = 0; i < exchange->component_count; i++) {
        exchange->components[i].executions = twin->executions[i];
    }
    twin->counts.executions += exchange->component_count + 1;
    return status;
}

static bool are_finite(const double *errors, size_t count) {
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += fabs(errors[i]);
    }
    return isfinite(sum);
}

/* Leads one of the two over the record's step. *failed: its FMUs did, or what they say is no number. */
static tl_status lead(tl_free_twin *twin, tl_snapshot *one, const tl_record *record, double *errors, bool *failed,
                      tl_error *error) {
    tl_status status = tl_snapshot_restore(one, error);
    status = status == TL_OK ? execute(twin, record->step, error) : status;
    measure_now(twin, record, errors);
    status = status == TL_OK ? tl_snapshot_take(one, error) : status;
    *failed = status != TL_OK || !are_finite(errors, twin->objective->term_count);
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* The FMUs stand where the twin is: what shall begin there begins. */
static tl_status settle(tl_free_twin *twin, bool predicts, bool renews, tl_error *error) {
    tl_status status = predicts ? tl_snapshot_take(&twin->predicted, error) : TL_OK;
    twin->predicts = predicts || (twin->predicts && !twin->contest.rests);
    twin->counts.renewed += renews ? 1 : 0;
    return status == TL_OK && renews ? tl_snapshot_take(&twin->free, error) : status;
}

/* Both, from where the twin is and back there. */
static tl_status lead_both(tl_free_twin *twin, const tl_record *record, tl_contest_errors *errors, bool failed[2],
                           tl_error *error) {
    tl_status status = tl_exchange_take(twin->exchange, record->step + 1, error);
    status = status == TL_OK ? lead(twin, &twin->free, record, errors->free, &failed[0], error) : status;
    if (status == TL_OK && twin->predicts) {
        status = lead(twin, &twin->predicted, record, errors->predicted, &failed[1], error);
    }
    return status == TL_OK ? tl_exchange_return(twin->exchange, error) : status;
}

static double sum_of_weights(const tl_objective *objective) {
    double sum = 0.0;
    for (size_t i = 0; i < objective->term_count; i++) {
        sum += objective->terms[i].weight;
    }
    return sum;
}

static void count(tl_free_twin *twin, bool rested, const tl_contest_verdict *verdict) {
    twin->counts.rested += rested ? 1 : 0;
    twin->counts.turns += verdict->turned && !rested ? 1 : 0;
    twin->counts.adopted += verdict->adopt ? 1 : 0;
}

tl_status tl_free_twin_follow(tl_free_twin *twin, const tl_record *record, tl_contest_verdict *verdict,
                              tl_error *error) {
    tl_contest_errors errors = {.weight = sum_of_weights(twin->objective)};
    bool failed[2] = {false, false};
    *verdict = (tl_contest_verdict){0};
    if (!twin->is_led) {
        return TL_OK;
    }
    bool rested = twin->contest.rests;
    bool measured = measure(twin, record, record->y, errors.locked);
    tl_status status = lead_both(twin, record, &errors, failed, error);
    if (status != TL_OK) {
        return status;
    }
    if (!rested && (!twin->predicts || failed[1])) { /* nothing can be said yet, or any more */
        tl_contest_begin_anew(&twin->contest);
        return settle(twin, true, failed[0], error);
    }
    *verdict = tl_contest_step(&twin->contest, &errors, measured);
    count(twin, rested, verdict);
    if (verdict->adopt) {
        twin->predicts = false;
        return tl_snapshot_restore(&twin->free, error);
    }
    return settle(twin, verdict->predict, verdict->renew || failed[0], error);
}

tl_status tl_free_twin_archive(tl_free_twin *twin, tl_archive *archive, tl_error *error) {
    if (!twin->is_led) {
        return TL_OK;
    }
    tl_contest_archive(&twin->contest, archive);
    tl_archive_flag(archive, &twin->predicts);
    tl_status status = tl_snapshot_archive(&twin->free, archive, error);
    return status == TL_OK ? tl_snapshot_archive(&twin->predicted, archive, error) : status;
}

void tl_free_twin_end_component(tl_free_twin *twin, size_t component) {
    tl_snapshot_forget(&twin->free, component);
    tl_snapshot_forget(&twin->predicted, component);
}
