/* Released twins: see released_twin.h. */
#include "master/sync/released_twin.h"

#include <math.h>
#include <string.h>

/* Of each component: those of the two released twins, and the twin's own. */
enum { STATES = 3 };

/* Part of T_S that the released twins may take. */
static const tl_time PARTS_OF_STEP = 10;

bool tl_released_twin_init(tl_released_twin *twin, tl_arena *arena, tl_exchange *exchange,
                           const tl_objective *objective, const tl_adjusted *adjusted, uint32_t steps,
                           tl_released_state state) {
    *twin = (tl_released_twin){.objective = objective, .steps = steps + steps % 2, .state = state, .last_step = -1};
    if (steps == 0 || state != TL_RELEASED_ON) {
        twin->state = steps == 0 ? TL_RELEASED_OFF : state;
        return true;
    }
    exchange->optional_states = STATES;
    return tl_side_twin_init(&twin->side, arena, exchange, objective->horizon->variables, adjusted) &&
           tl_side_twin_init_state(&twin->release[0].state, arena, exchange) &&
           tl_side_twin_init_state(&twin->release[1].state, arena, exchange);
}

static tl_status release(tl_released_twin *twin, tl_release *one, tl_error *error) {
    tl_status status = tl_snapshot_take(&one->state, error);
    one->age = 0;
    one->runs = status == TL_OK;
    twin->counts.releases++;
    return status;
}

static tl_released_state find_state(const tl_exchange *exchange) {
    return !tl_side_twin_is_possible(exchange) ? TL_RELEASED_REPLAY
           : exchange->optional_states == 0    ? TL_RELEASED_MEMORY
                                               : TL_RELEASED_ON;
}

tl_status tl_released_twin_begin(tl_released_twin *twin, tl_error *error) {
    twin->state = twin->state == TL_RELEASED_ON ? find_state(twin->side.exchange) : twin->state;
    if (twin->state != TL_RELEASED_ON) {
        return TL_OK;
    }
    tl_exchange_keep_always(twin->side.exchange);
    twin->phase = 0;
    twin->release[1].runs = false;
    return release(twin, &twin->release[0], error);
}

/* A y that is not finite counts as the largest error. */
static double square_error(const tl_objective_term *term, double y, double measured) {
    double error = (y - measured) / term->tolerance;
    return error * error < TL_RELEASED_MOST ? error * error : TL_RELEASED_MOST;
}

static size_t find_age(uint32_t age) {
    size_t index = 0;
    for (; age > 1 && index < TL_RELEASED_AGES - 1; age /= 2) {
        index++;
    }
    return index;
}

/* Reads the outputs. Returns their error as in tl_released_counts; a negative one if there is no
 * good measurement. */
static double read_outputs(const tl_objective *objective, const tl_record *record, double *y) {
    double sum = -1.0;
    for (size_t i = 0; i < objective->term_count; i++) {
        const tl_objective_term *term = &objective->terms[i];
        y[i] = tl_objective_y(objective, i);
        if (term->weight > 0.0 && record->measured_quality[i] == TL_GOOD) {
            sum = fmax(sum, 0.0) + term->weight * square_error(term, y[i], record->measured[i]);
        }
    }
    return sum;
}

static void add_error(tl_released_counts *counts, uint32_t age, double error) {
    if (error >= 0.0) {
        size_t index = find_age(age);
        counts->squares[index] += error;
        counts->steps[index]++;
    }
}

/* Executes the record's step of one of the two. */
static tl_status execute(tl_released_twin *twin, tl_release *one, const tl_record *record, double *y, tl_error *error) {
    if (!one->runs) {
        return TL_OK;
    }
    tl_status status = tl_side_twin_step(&twin->side, &one->state, record->step, error);
    double squares = read_outputs(twin->objective, record, y);
    status = status == TL_OK ? tl_snapshot_take(&one->state, error) : status;
    one->runs = status == TL_OK;
    one->age++;
    if (one->runs) {
        add_error(&twin->counts, one->age, squares);
    }
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* Executes both from the twin's state and restores it. */
static tl_status execute_both(tl_released_twin *twin, const tl_record *record, double y[2][TL_MAX_MATCH],
                              tl_error *error) {
    tl_exchange *exchange = twin->side.exchange;
    uint64_t before = twin->side.count;
    tl_status status = tl_exchange_take(exchange, record->step + 1, error);
    for (int i = 0; i < 2 && status == TL_OK; i++) {
        status = execute(twin, &twin->release[i], record, y[i], error);
    }
    twin->counts.executions += twin->side.count - before;
    return status == TL_OK ? tl_exchange_return(exchange, error) : status;
}

/* The older one; if none runs, the record has none. */
static void fill_record(const tl_released_twin *twin, double y[2][TL_MAX_MATCH], tl_record *record) {
    const tl_release *both = twin->release;
    int older = both[1].runs && (!both[0].runs || both[1].age > both[0].age) ? 1 : 0;
    record->release_age = both[older].runs ? both[older].age : 0;
    if (both[older].runs) {
        memcpy(record->released, y[older], twin->objective->term_count * sizeof record->released[0]);
    }
}

static tl_status release_next(tl_released_twin *twin, tl_error *error) {
    twin->phase = (twin->phase + 1) % twin->steps;
    bool is_turn = twin->phase == 0 || twin->phase == twin->steps / 2;
    return is_turn ? release(twin, &twin->release[twin->phase == 0 ? 0 : 1], error) : TL_OK;
}

/* Returns true if the fastest of TL_RELEASED_TIMED follows was too slow, so that a pause of the
 * process does not decide. */
static bool add_time(tl_released_twin *twin, tl_time time) {
    if (twin->timed == TL_RELEASED_TIMED) {
        return false;
    }
    tl_time both = twin->release[0].runs && twin->release[1].runs ? time : 2 * time;
    twin->fastest = twin->timed == 0 || both < twin->fastest ? both : twin->fastest;
    twin->timed++;
    return twin->timed == TL_RELEASED_TIMED && twin->fastest > twin->side.exchange->step / PARTS_OF_STEP;
}

tl_status tl_released_twin_follow(tl_released_twin *twin, tl_record *record, tl_time (*now)(void *context),
                                  void *context, tl_error *error) {
    double y[2][TL_MAX_MATCH];
    if (twin->state != TL_RELEASED_ON) {
        return TL_OK;
    }
    tl_time started_at = now != NULL ? now(context) : 0;
    tl_status status = execute_both(twin, record, y, error);
    if (status != TL_OK) {
        return status;
    }
    fill_record(twin, y, record);
    status = release_next(twin, error);
    bool is_slow = now != NULL && add_time(twin, now(context) - started_at);
    if (is_slow || record->step == twin->last_step) {
        twin->state = TL_RELEASED_SLOW;
        record->flags |= TL_FLAG_RELEASED_SLOW;
    }
    return status;
}

void tl_released_twin_end_after(tl_released_twin *twin, int64_t step) {
    twin->last_step = step;
}

void tl_released_twin_end(tl_released_twin *twin) {
    twin->release[0].runs = false;
    twin->release[1].runs = false;
}

void tl_released_twin_end_component(tl_released_twin *twin, size_t component) {
    tl_released_twin_end(twin);
    for (int i = 0; i < 2; i++) {
        tl_snapshot_forget(&twin->release[i].state, component);
    }
}
