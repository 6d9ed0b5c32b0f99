/* One synchronised step: see lock.h. */
#include "master/sync/lock.h"

#include <math.h>
#include <string.h>

/* J of a u that was not evaluated. */
#define NOT_EVALUATED ((double)NAN)

/* The search of one step: what is known of it so far. */
typedef struct tl_attempt {
    tl_lock *lock;
    int64_t step;
    const tl_budget *budget;
    uint32_t limit;       /* evaluations the search may use */
    uint32_t evaluations; /* used so far */
    tl_time longest;      /* of one evaluation of this step, ns */
    bool dirty;           /* components are not in the state of t_i */
    tl_stop stop;
    double best_value;
    double best[TL_MAX_ADJUST];
    double nominal[TL_MAX_ADJUST];
    double nominal_value; /* NaN: not evaluated */
    tl_status fatal;      /* TL_FMU_FATAL: give up */
    tl_error *error;
} tl_attempt;

bool tl_lock_init(tl_lock *lock, tl_arena *arena) {
    lock->has_last = false;
    if (lock->count == 0) {
        return true;
    }
    lock->space.count = lock->count;
    lock->space.step = lock->step;
    lock->space.lower = lock->lower;
    lock->space.upper = lock->upper;
    lock->optimiser = lock->solver->create(arena, &lock->space);
    return lock->optimiser != NULL;
}

void tl_lock_end(tl_lock *lock) {
    if (lock->optimiser != NULL) {
        lock->solver->destroy(lock->optimiser);
        lock->optimiser = NULL;
    }
}

static void set_inputs(tl_lock *lock, const double *u) {
    for (size_t i = 0; i < lock->count; i++) {
        *lock->adjusted[i].input = u[i];
    }
}

static void read_nominal(const tl_lock *lock, double *nominal) {
    for (size_t i = 0; i < lock->count; i++) {
        const tl_adjusted *adjusted = &lock->adjusted[i];
        nominal[i] = adjusted->delivered != NULL ? *adjusted->delivered : adjusted->nominal;
    }
}

/* Into the bounds of the search. The nominal itself may lie outside: it is what the plant was told. */
static void clamp(const tl_lock *lock, double *u) {
    for (size_t i = 0; i < lock->count; i++) {
        u[i] = fmin(fmax(u[i], lock->lower[i]), lock->upper[i]);
    }
}

/* J of one candidate over the horizon; HUGE_VAL where an FMU fails on it. */
static double simulate(tl_attempt *attempt, const double *u) {
    tl_lock *lock = attempt->lock;
    double sum = 0.0;
    tl_status status = TL_OK;
    if (attempt->dirty) {
        status = tl_exchange_restore(lock->exchange, attempt->error);
    }
    attempt->dirty = true;
    set_inputs(lock, u);
    for (int64_t j = attempt->step; status == TL_OK && j < attempt->step + lock->prediction; j++) {
        status = tl_exchange_step(lock->exchange, j, false, attempt->error);
        if (status == TL_OK && j + 1 >= attempt->step + lock->distance) {
            sum += tl_objective_at(&lock->objective, j + 1);
        }
    }
    if (status == TL_FMU_FATAL) {
        attempt->fatal = status;
    }
    return status == TL_OK && isfinite(sum) ? sum : HUGE_VAL;
}

static tl_time elapsed(const tl_budget *budget) {
    return budget->now == NULL ? 0 : budget->now(budget->context) - budget->started;
}

/* Whether one more evaluation, and the nominal's where that is still to come, fits the budget. */
static bool may_evaluate(tl_attempt *attempt) {
    if (attempt->evaluations >= attempt->limit) {
        attempt->stop = TL_STOP_EVALUATIONS;
        return false;
    }
    if (attempt->budget->now != NULL) {
        tl_time left = attempt->budget->time - elapsed(attempt->budget);
        if (left <= 0 || attempt->longest >= (isnan(attempt->nominal_value) ? left / 2 : left)) {
            attempt->stop = TL_STOP_TIME;
            return false;
        }
    }
    return true;
}

/* Evaluates u, keeps it if it is the best so far. */
static double evaluate(tl_attempt *attempt, const double *u) {
    tl_time before = elapsed(attempt->budget);
    double value = simulate(attempt, u);
    tl_time took = elapsed(attempt->budget) - before;
    attempt->longest = took > attempt->longest ? took : attempt->longest;
    attempt->evaluations++;
    if (value < attempt->best_value) {
        attempt->best_value = value;
        memcpy(attempt->best, u, attempt->lock->count * sizeof *u);
    }
    return value;
}

/* The solver's question. */
static bool ask(void *context, const double *u, double *value) {
    tl_attempt *attempt = context;
    if (attempt->fatal != TL_OK || attempt->best_value < TL_OBJECTIVE_TOLERANCE || !may_evaluate(attempt)) {
        return false;
    }
    *value = evaluate(attempt, u);
    if (attempt->best_value < TL_OBJECTIVE_TOLERANCE) {
        attempt->stop = TL_STOP_TOLERANCE;
        return false;
    }
    return attempt->fatal == TL_OK;
}

/* The first guess: nominal at T_P = T_D, else the last committed u, so that horizons overlap. A budget of one evaluation
 * is the nominal's. */
static void first_guess(tl_attempt *attempt, double *guess) {
    tl_lock *lock = attempt->lock;
    if (lock->prediction == lock->distance || !lock->has_last || attempt->limit < 2) {
        memcpy(guess, attempt->nominal, lock->count * sizeof *guess);
    } else {
        memcpy(guess, lock->last, lock->count * sizeof *guess);
        clamp(lock, guess); /* an earlier nominal may have been outside */
    }
}

/* Where an FMU fails on the guess, the search had better begin at the last u, or at the nominal where that was it. */
static void retreat(tl_attempt *attempt, double *guess, double *value) {
    tl_lock *lock = attempt->lock;
    size_t size = lock->count * sizeof *guess;
    if (isfinite(*value) || !lock->has_last || attempt->fatal != TL_OK || !may_evaluate(attempt)) {
        return;
    }
    bool to_last = !isnan(attempt->nominal_value);
    memcpy(guess, to_last ? lock->last : attempt->nominal, size);
    if (to_last) {
        clamp(lock, guess);
    }
    *value = evaluate(attempt, guess);
    if (!to_last) {
        attempt->nominal_value = *value;
        attempt->limit = attempt->budget->evaluations; /* nothing more is kept for it */
    }
}

/* Out of tolerance: is the best so far worth committing? Never worse than not synchronising. */
static tl_outcome defend_nominal(tl_attempt *attempt, double *u) {
    if (isnan(attempt->nominal_value) && attempt->fatal == TL_OK) {
        attempt->nominal_value = evaluate(attempt, attempt->nominal);
    }
    if (attempt->best_value <= (1.0 - attempt->lock->margin) * attempt->nominal_value &&
        attempt->best_value < attempt->nominal_value) {
        memcpy(u, attempt->best, attempt->lock->count * sizeof *u);
        return TL_BEST_SO_FAR;
    }
    memcpy(u, attempt->nominal, attempt->lock->count * sizeof *u);
    return TL_NOMINAL;
}

/* Lets the solver search from the guess, or from the point within the bounds that is nearest to it. */
static void search_from(tl_attempt *attempt, const double *guess, double value) {
    tl_lock *lock = attempt->lock;
    double start[TL_MAX_ADJUST];
    size_t size = lock->count * sizeof *start;
    memcpy(start, guess, size);
    clamp(lock, start);
    attempt->stop = TL_STOP_SOLVER;
    if (memcmp(start, guess, size) != 0 && !ask(attempt, start, &value)) {
        return;
    }
    const tl_search search = {start, value, ask, attempt};
    lock->solver->minimise(lock->optimiser, &search);
}

/* Guess, then search; u and the outcome. */
static tl_outcome find(tl_attempt *attempt, double *u) {
    tl_lock *lock = attempt->lock;
    double guess[TL_MAX_ADJUST];
    size_t size = lock->count * sizeof *u;
    first_guess(attempt, guess);
    if (!may_evaluate(attempt)) {
        memcpy(u, attempt->nominal, size);
        return TL_NOMINAL;
    }
    double value = evaluate(attempt, guess);
    if (memcmp(guess, attempt->nominal, size) == 0) {
        attempt->nominal_value = value;
    } else {
        attempt->limit--; /* kept for the nominal */
    }
    if (value < TL_OBJECTIVE_TOLERANCE) {
        memcpy(u, guess, size);
        return TL_FIRST_GUESS;
    }
    retreat(attempt, guess, &value);
    search_from(attempt, guess, value);
    if (attempt->best_value < TL_OBJECTIVE_TOLERANCE) {
        attempt->stop = TL_STOP_TOLERANCE;
        memcpy(u, attempt->best, size);
        return TL_OPTIMISED;
    }
    return defend_nominal(attempt, u);
}

/* Executes step i with u and records it. */
static tl_status commit(tl_lock *lock, int64_t step, const double *u, bool restore, tl_record *record,
                        tl_error *error) {
    tl_status status = restore ? tl_exchange_restore(lock->exchange, error) : TL_OK;
    if (status != TL_OK) {
        return status;
    }
    set_inputs(lock, u);
    status = tl_exchange_step(lock->exchange, step, true, error);
    if (status != TL_OK) {
        return status;
    }
    for (size_t i = 0; i < lock->objective.term_count; i++) {
        record->y[i] = tl_objective_y(&lock->objective, i);
    }
    memcpy(record->u, u, lock->count * sizeof *u);
    memcpy(lock->last, u, lock->count * sizeof *u);
    lock->has_last = true;
    return TL_OK;
}

static void begin_record(tl_record *record, int64_t step) {
    memset(record, 0, sizeof *record);
    record->step = step;
    record->objective = NOT_EVALUATED;
    record->objective_nominal = NOT_EVALUATED;
}

/* Input values that the plant feeds are those of t_i, also where they were stood for when step i − 1 was computed. */
static void refresh(tl_lock *lock, int64_t step) {
    tl_plant_deliver(&lock->exchange->plant, step);
    tl_exchange_deliver(lock->exchange);
}

/* Commits the found u; where even that fails though it did not as a candidate, or nothing was tried, nominal. */
static tl_status commit_found(tl_attempt *attempt, const double *u, tl_record *record, tl_error *error) {
    tl_lock *lock = attempt->lock;
    tl_status status = commit(lock, attempt->step, u, attempt->dirty, record, error);
    if (status == TL_FMU_FAILED && memcmp(u, attempt->nominal, lock->count * sizeof *u) != 0) {
        record->outcome = TL_NOMINAL;
        record->objective = record->objective_nominal;
        status = commit(lock, attempt->step, attempt->nominal, true, record, error);
    }
    return status;
}

tl_status tl_lock_step(tl_lock *lock, int64_t step, const tl_budget *budget, tl_record *record, tl_error *error) {
    tl_attempt attempt = {.lock = lock,
                          .step = step,
                          .budget = budget,
                          .limit = budget->evaluations,
                          .best_value = HUGE_VAL,
                          .nominal_value = NOT_EVALUATED,
                          .error = error};
    double u[TL_MAX_ADJUST];
    begin_record(record, step);
    refresh(lock, step);
    read_nominal(lock, attempt.nominal);
    memcpy(record->u_hat, attempt.nominal, lock->count * sizeof *u);
    if (lock->count == 0) {
        record->outcome = TL_FREE;
        return commit(lock, step, attempt.nominal, false, record, error);
    }
    if (!tl_objective_is_measured(&lock->objective, step + lock->distance, step + lock->prediction)) {
        record->outcome = TL_FREE_RUN;
        return commit(lock, step, attempt.nominal, false, record, error);
    }
    tl_status status = tl_exchange_save(lock->exchange, error);
    if (status != TL_OK) {
        return status;
    }
    record->outcome = find(&attempt, u);
    if (attempt.fatal != TL_OK) {
        return attempt.fatal;
    }
    record->stop = attempt.stop;
    record->evaluations = attempt.evaluations;
    record->objective_nominal = isfinite(attempt.nominal_value) ? attempt.nominal_value : NOT_EVALUATED;
    double value = record->outcome == TL_NOMINAL ? attempt.nominal_value : attempt.best_value;
    record->objective = isfinite(value) ? value : NOT_EVALUATED;
    return commit_found(&attempt, u, record, error);
}

tl_status tl_lock_make_up(tl_lock *lock, int64_t step, tl_record *record, tl_error *error) {
    double u[TL_MAX_ADJUST];
    begin_record(record, step);
    refresh(lock, step);
    read_nominal(lock, u);
    memcpy(record->u_hat, u, lock->count * sizeof *u);
    if (lock->has_last) {
        memcpy(u, lock->last, lock->count * sizeof *u);
    }
    record->outcome = TL_MADE_UP;
    return commit(lock, step, u, false, record, error);
}
