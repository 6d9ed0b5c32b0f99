/* The life of a twin: see twin.h. */
#include <assert.h>
#include <math.h>

#include "master/twin/twin_parts.h"

tl_status tl_twin_start(tl_twin *twin, int64_t shown, tl_error *error) {
    tl_status status = tl_exchange_initialize(&twin->exchange, twin->first, shown, error);
    if (status == TL_OK && twin->lock.horizon.variables != 0) {
        status = tl_proof_of_rollback(&twin->proof, &twin->lock, &twin->graph, twin->first, twin->now, error);
        twin->cannot_return = status != TL_OK && twin->proof.stepped;
    }
    return status;
}

static tl_status start(tl_twin *twin, const tl_budget *budget, tl_error *error) {
    const tl_plant *plant = &twin->exchange.plant;
    tl_status status = tl_twin_start(twin, tl_plant_shown(plant, twin->first, plant->newest), error);
    status = status == TL_OK ? tl_exchange_start(&twin->exchange, twin->state_bytes, twin->heap, error) : status;
    tl_proof_end(&twin->proof);
    status = status == TL_OK ? tl_verifier_start(&twin->verifier, budget, error) : status;
    return status == TL_OK ? tl_free_twin_begin(&twin->free_twin, error) : status;
}

/* ---- a measured delay ---- */

/* A hundredth of a first step of the search, or less, is no correction. */
static bool is_free(const tl_twin *twin, const tl_record *record) {
    static const double least = 0.01;
    bool free = true;
    for (size_t v = 0; v < twin->lock.horizon.variables; v++) {
        free = free && fabs(record->u[v] - record->u_hat[v]) <= least * twin->lock.adjusted[v].step;
    }
    return free;
}

/* From the next step on. What is in the sample at a tick was seen at a fixed time before it, so only whole steps can change. */
static void use_delay(tl_twin *twin) {
    tl_time delay = twin->delay.delay;
    tl_time range = twin->measure.range;
    tl_time used = delay > range ? range : delay < -range ? -range : delay;
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        twin->terms[i].shift = tl_delay_ticks(twin->measure.look_back, used, twin->step);
    }
}

/* The first matched output that knows it; one that has lost it only where none does. */
static void judge_delay(tl_twin *twin) {
    tl_twin_delay best = {.state = TL_DELAY_UNKNOWN, .confidence = 0.0};
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        tl_delay_measured found = tl_delay_meter_get(twin->meters[i]);
        tl_delay_state state = !found.known ? TL_DELAY_UNKNOWN : found.lost ? TL_DELAY_LOST : TL_DELAY_KNOWN;
        bool better = state == TL_DELAY_KNOWN ? best.state != TL_DELAY_KNOWN : best.state == TL_DELAY_UNKNOWN;
        if (better && (state != TL_DELAY_UNKNOWN || found.confidence >= best.confidence)) {
            best = (tl_twin_delay){.state = state, .delay = found.delay, .confidence = found.confidence};
        }
    }
    if (best.state == TL_DELAY_LOST) {
        best.delay = twin->delay.delay;
    }
    bool changed = best.state != TL_DELAY_UNKNOWN && best.delay != twin->delay.delay;
    bool first = best.state != TL_DELAY_UNKNOWN && twin->delay.state == TL_DELAY_UNKNOWN;
    twin->delay = best;
    if (changed || first) {
        use_delay(twin);
    }
}

static void measure_delay(tl_twin *twin, tl_record *record) {
    if (twin->measure.lags != 0) {
        bool free = is_free(twin, record) && (record->flags & TL_FLAG_RESET) == 0;
        for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
            tl_delay_meter_step(twin->meters[i], record->step + 1, record->y[i], free);
        }
        judge_delay(twin);
    }
    record->delay_state = twin->delay.state;
    record->delay = twin->delay.delay;
}

/* ---- records ---- */

/* The readings that fell into a step. */
static void record_readings(tl_twin *twin, size_t match, tl_record *record) {
    tl_metrics *due = &twin->due[match];
    if (twin->readers[match] != NULL) {
        tl_time end = tl_time_of_step(0, twin->step, record->step + 1);
        bool goes_on = (record->flags & TL_FLAG_RESET) == 0;
        tl_reading_meter_step(twin->readers[match], end, record->y[match], goes_on, due);
    }
    record->readings[match] = (tl_record_readings){
        .count = (uint32_t)due->pairs, .rejected = (uint32_t)due->left_out, .squares = due->sum_of_squares};
    tl_metrics_join(&twin->readings[match], due);
    *due = (tl_metrics){0};
}

/* Completes a record with the measurement of its instant. */
static void complete(tl_twin *twin, tl_record *record) {
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        tl_quality quality;
        record->y_hat[i] = tl_objective_y_hat(&twin->lock.objective, i, record->step + 1, &quality);
        record->y_hat_quality[i] = (uint8_t)quality;
        tl_metrics_add(&twin->metrics[i], record->y[i], record->y_hat[i], quality);
        record_readings(twin, i, record);
    }
    measure_delay(twin, record);
}

static uint64_t count_executions(const tl_twin *twin) {
    return twin->exchange.executions + twin->exchange.plant.executions;
}

/* How a tick's step comes about. */
typedef struct tick_way {
    const tl_budget *budget; /* it is searched within; NULL: it is not searched */
    bool follows;            /* an earlier run, */
    const double *u;         /* which has committed this; NULL where nothing is adjusted. Else it is made up */
} tick_way;

/* As of a step that is followed, with nominal u: what goes back to a stroke's beginning is given up. */
static tl_status step_free_by_event(tl_twin *twin, int64_t step, tl_record *record, tl_error *error) {
    bool given_up = tl_event_horizon_begin_anew(twin->event);
    tl_status status =
        tl_event_horizon_follow(twin->event, step, tl_exchange_nominal(&twin->exchange, 0), record, error);
    record->outcome = TL_FREE_RUN;
    record->flags |= given_up ? (uint32_t)TL_FLAG_ABANDONED : 0U;
    return status;
}

static tl_status step_by_event(tl_twin *twin, int64_t step, const tick_way *way, tl_record *record, tl_error *error) {
    if (twin->lock.runs_free && !way->follows) {
        return step_free_by_event(twin, step, record, error);
    }
    return way->follows ? tl_event_horizon_follow(twin->event, step, way->u[0], record, error)
                        : tl_event_horizon_step(twin->event, step, way->budget, record, error);
}

static tl_status step_by(tl_twin *twin, int64_t step, const tick_way *way, tl_record *record, tl_error *error) {
    if (twin->event != NULL) {
        return step_by_event(twin, step, way, record, error);
    }
    if (way->follows) {
        return tl_lock_follow(&twin->lock, step, way->u, record, error);
    }
    return way->budget == NULL ? tl_lock_make_up(&twin->lock, step, record, error)
                               : tl_lock_step(&twin->lock, step, way->budget, record, error);
}

/* Whether there is a way back from as far as a search may go. If not, nothing is tried and nothing looked at. */
static void look_for_way_back(tl_twin *twin, int64_t step, uint32_t *flags) {
    bool searches = twin->lock.horizon.variables != 0;
    const tl_component *free = searches ? tl_exchange_find_free(&twin->exchange, step, tl_twin_prediction(twin)) : NULL;
    if (free != NULL && !twin->lock.runs_free) {
        tl_verifier_abandon(&twin->verifier);
    }
    twin->lock.runs_free = free != NULL;
    twin->runs_free = free != NULL ? free->name : NULL;
    *flags |= free != NULL ? (uint32_t)TL_FLAG_NO_WAY_BACK : 0U;
}

/* Computes one step. */
static tl_status compute(tl_twin *twin, int64_t step, const tick_way *way, tl_record *record, tl_error *error) {
    uint64_t before = count_executions(twin);
    uint64_t predicted = tl_ledger_total(&twin->lock.ledger);
    uint32_t flags = 0;
    tl_status status = twin->resets ? tl_twin_begin_anew(twin, step, &flags, error) : TL_OK;
    if (status == TL_OK) {
        look_for_way_back(twin, step, &flags);
        status = step_by(twin, step, way, record, error);
        record->flags |= flags | twin->marks | twin->lasting;
        twin->marks = 0;
    }
    if (status == TL_OK && !twin->lock.runs_free) {
        tl_verifier_committed(&twin->verifier, step);
    }
    record->executions = (uint32_t)(count_executions(twin) - before);
    record->predicted = (uint32_t)(tl_ledger_total(&twin->lock.ledger) - predicted);
    record->used = 0;
    return status;
}

/* The free twin goes on beside; from the next step on u may rest, or the twin go on from there. */
static tl_status follow_free_twin(tl_twin *twin, const tl_record *record, tl_error *error) {
    tl_contest_verdict verdict;
    tl_status status = tl_free_twin_follow(&twin->free_twin, record, &verdict, error);
    twin->lock.rests = tl_free_twin_rests(&twin->free_twin);
    if (status != TL_OK || !verdict.adopt) {
        return status;
    }
    tl_verifier_abandon(&twin->verifier);
    tl_lock_go_on_elsewhere(&twin->lock);
    return tl_exchange_begin_anew(&twin->exchange, record->step + 1, error);
}

/* A reading that the sample shows, at the twin's own time. */
static void see_reading(tl_twin *twin, const tl_sample *sample, size_t match) {
    const tl_objective_term *term = &twin->terms[match];
    size_t signal = twin->reading_signals[match];
    tl_time start = sample->instant - tl_time_of_step(0, twin->step, sample->tick);
    if (sample->stamps[signal] != TL_TIME_NEVER) {
        tl_time late = tl_time_of_step(0, twin->step, term->shift) - twin->look_back;
        double value = term->conversion.factor * sample->values[signal] + term->conversion.offset;
        tl_reading_meter_see(twin->readers[match], sample->stamps[signal] - start - late, value,
                             (tl_quality)sample->quality[signal], &twin->due[match]);
    }
}

/* The sample, for all that look at it. */
static void push(tl_twin *twin, const tl_sample *sample) {
    tl_plant *plant = &twin->exchange.plant;
    tl_plant_push(plant, sample);
    for (size_t i = 0; i < twin->lock.objective.term_count; i++) {
        const tl_objective_term *term = &twin->terms[i];
        if (twin->readers[i] != NULL) {
            see_reading(twin, sample, i);
        }
        if (twin->meters[i] != NULL && sample->stamps[term->signal] != TL_TIME_NEVER) {
            tl_time start = sample->instant - tl_time_of_step(0, twin->step, sample->tick);
            tl_delay_meter_see(twin->meters[i], sample->stamps[term->signal] - start, sample->values[term->signal],
                               sample->quality[term->signal] == TL_GOOD);
        }
    }
}

/* In mode ahead: what was computed a tick ago is complete now. */
static void hand_over_pending(tl_twin *twin, tl_record *record, bool *ready) {
    *record = twin->pending;
    complete(twin, record);
    *ready = true;
    twin->has_pending = false;
}

static tl_status advance(tl_twin *twin, const tl_sample *sample, const tick_way *way, tl_record *record, bool *ready,
                         tl_error *error) {
    push(twin, sample);
    if (sample->tick == twin->begin) {
        tl_status status = start(twin, way->budget, error);
        if (status != TL_OK) {
            return status;
        }
    }
    bool ahead = twin->measurements == TL_AHEAD;
    if (twin->has_pending) {
        hand_over_pending(twin, record, ready);
        tl_lock_refresh(&twin->lock, record->step + 1);
        tl_status status = follow_free_twin(twin, record, error);
        if (status != TL_OK) {
            return status;
        }
    }
    int64_t step = sample->tick - (int64_t)twin->lead;
    if (step < twin->first) {
        return TL_OK;
    }
    tl_status status = compute(twin, step, way, ahead ? &twin->pending : record, error);
    if (status != TL_OK) {
        return status;
    }
    twin->has_pending = ahead;
    if (!ahead) {
        complete(twin, record);
        *ready = true;
        status = follow_free_twin(twin, record, error);
    }
    if (status == TL_OK && way->budget != NULL && way->budget->now != NULL) {
        (ahead ? &twin->pending : record)->used = tl_lock_end_step(&twin->lock, way->budget);
    }
    return status;
}

static tl_status tick(tl_twin *twin, const tl_sample *sample, const tick_way *way, tl_record *record, bool *ready,
                      tl_error *error) {
    *ready = false;
    if (twin->ended != TL_OK) {
        return tl_fail(error, twin->ended, "the twin has ended with an earlier failure of an FMU: build a new one");
    }
    assert(sample->tick == twin->exchange.plant.newest + 1);
    twin->ended = advance(twin, sample, way, record, ready, error);
    return twin->ended;
}

tl_status tl_twin_step(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record, bool *ready,
                       tl_error *error) {
    const tick_way searched = {.budget = budget};
    return tick(twin, sample, &searched, record, ready, error);
}

tl_status tl_twin_make_up(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready, tl_error *error) {
    const tick_way made_up = {0};
    return tick(twin, sample, &made_up, record, ready, error);
}

tl_status tl_twin_follow(tl_twin *twin, const tl_sample *sample, const double *u, tl_record *record, bool *ready,
                         tl_error *error) {
    const tick_way followed = {.follows = true, .u = u};
    return tick(twin, sample, &followed, record, ready, error);
}

void tl_twin_finish(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready) {
    *ready = false;
    if (twin->has_pending) {
        push(twin, sample);
        hand_over_pending(twin, record, ready);
    }
}

/* ---- the end ---- */

bool tl_twin_is_lost(const tl_twin *twin, const tl_component *component) {
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        const tl_component *other = &twin->graph.components[i];
        if (other->fmi == component->fmi && other->mode == TL_MODE_DEAD) {
            return true;
        }
    }
    return false;
}

void tl_twin_destroy(tl_twin *twin) {
    if (twin == NULL) {
        return;
    }
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        if (!tl_twin_is_lost(twin, &twin->graph.components[i])) {
            tl_exchange_end_component(&twin->exchange, i);
            tl_event_horizon_forget(twin->event, i);
            tl_verifier_end_component(&twin->verifier, i);
            tl_free_twin_end_component(&twin->free_twin, i);
        }
        if (!tl_twin_is_lost(twin, &twin->graph.components[i])) {
            tl_component_free(&twin->graph.components[i]);
        }
    }
    tl_event_horizon_end(twin->event);
    tl_lock_end(&twin->lock);
    tl_arena arena = twin->arena;
    tl_arena_release(&arena);
}
