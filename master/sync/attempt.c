/* Step search: see attempt.h. */
#include "master/sync/attempt.h"

#include <math.h>
#include <string.h>

#include "master/base/estimate.h"

/* A reduction of J by at least this part is progress. */
static const double PROGRESS = 0.01;

/* In first steps of the search. */
static const double LEAST_MOVE = 1e-9;

/* Evaluations without progress after which a solver that asks outside of its bounds is stopped. */
enum { MOST_IDLE = 1000 };

static void read_nominal(const tl_lock *lock, double *nominal) {
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        nominal[v] = tl_exchange_nominal(lock->exchange, v);
    }
}

void tl_attempt_begin(tl_attempt *attempt, tl_lock *lock, int64_t step, const tl_budget *budget, tl_error *error) {
    attempt->lock = lock;
    attempt->step = step;
    attempt->budget = budget;
    attempt->limit = budget == NULL ? 0 : budget->evaluations;
    attempt->evaluations = 0;
    attempt->dirty = false;
    attempt->back = TL_OK;
    attempt->walked = false;
    attempt->closing = false;
    attempt->guessed = false;
    attempt->late = false;
    attempt->nominal_follows = false;
    attempt->stop = TL_STOP_NONE;
    attempt->flags = 0;
    attempt->held = 0;
    attempt->seen = 0;
    attempt->idle = 0;
    attempt->stagnated = false;
    attempt->acquaints = false;
    attempt->start_value = HUGE_VAL;
    attempt->best_value = HUGE_VAL;
    attempt->nominal_value = (double)NAN;
    attempt->fatal = TL_OK;
    attempt->error = error;
    read_nominal(lock, attempt->nominal);
    tl_horizon_hold(&lock->horizon, attempt->nominal, lock->memory.nominal);
    if (lock->solver->rest != NULL) {
        lock->solver->rest(lock->optimiser, lock->memory.nominal);
    }
}

void tl_attempt_set_inputs(const tl_lock *lock, const double *u, uint32_t depth) {
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        tl_exchange_set_adjusted(lock->exchange, v, tl_horizon_value(&lock->horizon, u, v, depth));
    }
}

/* ---- time ---- */

tl_status tl_attempt_go_back(tl_attempt *attempt) {
    if (attempt->dirty) {
        attempt->back = tl_track_rewind(attempt->lock->track, attempt->error);
        attempt->dirty = false;
    }
    return attempt->back;
}

/* Predicted cost of the rest of a candidate from `depth` on. */
static tl_time cost_from(const tl_lock *lock, uint32_t depth) {
    const tl_exchange *exchange = lock->exchange;
    return exchange->whole ? tl_exchange_cost(exchange, lock->horizon.prediction - depth)
                           : tl_ledger_cost(&lock->ledger, exchange->costs.each, depth);
}

/* Largest cost of the evaluation of nominal, if it is still to come, and of the committed step,
 * which is the first one of a candidate. */
static tl_time cost_of_rest(const tl_attempt *attempt) {
    const tl_lock *lock = attempt->lock;
    const tl_exchange *exchange = lock->exchange;
    tl_time horizon = attempt->nominal_follows ? (tl_time)lock->horizon.prediction : 0;
    if (exchange->whole || horizon == 0) {
        return tl_exchange_cost(exchange, horizon + 1);
    }
    tl_time sum = 0;
    for (size_t k = 0; k < exchange->component_count; k++) {
        tl_time reach = exchange->reach != NULL ? (tl_time)exchange->reach[k] : horizon;
        sum += tl_cost_of(&exchange->costs.each[k], exchange->cached != NULL && reach > 0 ? reach : reach + 1);
    }
    return sum;
}

/* What must follow the present candidate: the committed step, and nominal's evaluation if it is to
 * come. */
static tl_time reserve(const tl_attempt *attempt) {
    const tl_lock_times *times = &attempt->lock->times;
    tl_time nominal = attempt->nominal_follows ? times->asking.most + times->within.most : 0;
    return times->committing.most + nominal + cost_of_rest(attempt);
}

/* Whether so much, and what must follow, fits into the time left since the last clock reading. */
static bool has_time(tl_attempt *attempt, tl_time wanted) {
    const tl_budget *budget = attempt->budget;
    tl_time elapsed = tl_duration(budget->started, attempt->lock->exchange->costs.read);
    if (elapsed + wanted + reserve(attempt) <= budget->time) {
        return true;
    }
    attempt->stop = TL_STOP_TIME;
    attempt->lock->times.refused = true;
    return false;
}

/* Whether the rest of the candidate from `depth` on, and what must follow, fit into the time. */
static bool fits(tl_attempt *attempt, uint32_t depth) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_times *times = &lock->times;
    tl_time within = times->within.most > times->beside ? times->within.most - times->beside : 0;
    return has_time(attempt, cost_from(lock, depth) + within + (attempt->closing ? 0 : times->thinking.most));
}

/* Ends the current part of the step; NULL: a part that is not predicted. */
static void end_part(tl_attempt *attempt, tl_estimate *part) {
    tl_lock *lock = attempt->lock;
    tl_time took = lock->times.beside + tl_costs_lap(&lock->exchange->costs);
    if (part != NULL) {
        tl_estimate_took(part, took);
    }
    lock->times.beside = 0;
}

static void find_follower(tl_attempt *attempt, const double *u) {
    const tl_lock *lock = attempt->lock;
    attempt->nominal_follows =
        isnan(attempt->nominal_value) && memcmp(u, lock->memory.nominal, lock->horizon.count * sizeof *u) != 0;
}

/* An evaluation of u starts, under the clock. */
static bool is_in_time(tl_attempt *attempt, const double *u) {
    tl_lock *lock = attempt->lock;
    tl_lock_times *times = &lock->times;
    tl_estimate *before = attempt->walked ? &times->thinking : NULL;
    bool predicts = lock->ledger.saving.sequences;
    if (predicts) {
        end_part(attempt, before);
        if (!has_time(attempt, times->asking.most)) {
            return false;
        }
    }
    tl_ledger_expect(&lock->ledger, u);
    (void)tl_attempt_go_back(attempt);
    end_part(attempt, predicts ? &times->asking : before);
    return fits(attempt, 0);
}

bool tl_attempt_may_guess(tl_attempt *attempt) {
    if (attempt->budget->now != NULL) {
        end_part(attempt, NULL);
        attempt->guessed = has_time(attempt, attempt->lock->times.guessing.most);
    } else {
        attempt->guessed = true;
    }
    return attempt->guessed;
}

void tl_attempt_has_guess(tl_attempt *attempt) {
    if (attempt->budget->now != NULL) {
        end_part(attempt, &attempt->lock->times.guessing);
    }
}

/* Beyond the limit there may be room reserved for nominal, which this is. */
static bool is_awaited(const tl_attempt *attempt, const double *u) {
    const tl_lock *lock = attempt->lock;
    return attempt->evaluations < attempt->budget->evaluations && isnan(attempt->nominal_value) &&
           memcmp(u, lock->memory.nominal, lock->horizon.count * sizeof *u) == 0;
}

bool tl_attempt_may_evaluate(tl_attempt *attempt, const double *u) {
    if (attempt->evaluations >= attempt->limit && !is_awaited(attempt, u)) {
        attempt->stop = attempt->budget->repeated ? TL_STOP_TIME : TL_STOP_EVALUATIONS;
        return false;
    }
    find_follower(attempt, u);
    if (attempt->budget->now != NULL) {
        return is_in_time(attempt, u);
    }
    tl_ledger_expect(&attempt->lock->ledger, u);
    return true;
}

/* ---- one candidate ---- */

/* Whether a candidate should be aborted at `depth`. */
static bool runs_late(tl_attempt *attempt, uint32_t depth) {
    if (depth == 0 || attempt->budget->now == NULL) {
        return false;
    }
    attempt->lock->times.beside += tl_costs_lap(&attempt->lock->exchange->costs);
    attempt->late = !fits(attempt, depth);
    return attempt->late;
}

/* Simulates u over the horizon; its sum of squares so far in *sum. Ends early if an FMU fails or
 * time runs out. */
static tl_status walk(tl_attempt *attempt, const double *u, double *sum) {
    tl_lock *lock = attempt->lock;
    const tl_horizon *horizon = &lock->horizon;
    tl_exchange *exchange = lock->exchange;
    tl_status status = TL_OK;
    uint32_t depth = 0;
    while (depth < horizon->prediction && !runs_late(attempt, depth)) {
        if (depth < horizon->longest || exchange->cached != NULL) {
            tl_attempt_set_inputs(lock, u, depth);
        }
        status = tl_track_try(lock->track, attempt->step + depth, depth, attempt->error);
        if (status != TL_OK) {
            break;
        }
        depth++;
        if (depth >= horizon->distance) {
            *sum += tl_objective_at(&lock->objective, depth, lock->memory.residuals, lock->memory.candidate_course);
        }
    }
    tl_ledger_walked(&lock->ledger, depth, status == TL_OK ? SIZE_MAX : exchange->failed);
    return status;
}

/* J of u, or HUGE_VAL if an FMU fails, a result is not finite, or time runs out. */
static double simulate(tl_attempt *attempt, const double *u) {
    tl_lock *lock = attempt->lock;
    tl_status status = tl_attempt_go_back(attempt);
    attempt->dirty = true;
    double sum =
        tl_objective_penalise(&lock->objective, u, attempt->nominal, lock->memory.before, lock->memory.residuals);
    status = status == TL_OK ? walk(attempt, u, &sum) : status;
    if (status == TL_FMU_FATAL) {
        attempt->fatal = status;
    }
    return status == TL_OK && !attempt->late && isfinite(sum) ? sum : HUGE_VAL;
}

/* The same with a clock: measures the overhead of an evaluation beside its executions. */
static double simulate_measured(tl_attempt *attempt, const double *u) {
    double value = simulate(attempt, u);
    end_part(attempt, &attempt->lock->times.within);
    attempt->walked = true;
    return value;
}

static void keep_best(tl_attempt *attempt, const double *u, double value) {
    tl_lock *lock = attempt->lock;
    attempt->idle = value < attempt->best_value * (1.0 - PROGRESS) ? 0 : attempt->idle + 1;
    if (value < attempt->best_value) {
        attempt->best_value = value;
        memcpy(lock->memory.best, u, lock->horizon.count * sizeof *u);
        memcpy(lock->memory.best_residuals, lock->memory.residuals,
               lock->objective.residual_count * sizeof *lock->memory.residuals);
        memcpy(lock->memory.best_course, lock->memory.candidate_course,
               tl_objective_samples(&lock->objective) * lock->objective.matched * sizeof *lock->memory.best_course);
    }
}

/* J of u, counted. HUGE_VAL also if it is late, which is no evaluation: a repetition without a
 * clock does not make it either. Whoever asks for nominal, it is evaluated once. */
static double evaluate(tl_attempt *attempt, const double *u) {
    bool nominal = isnan(attempt->nominal_value) && !attempt->nominal_follows;
    double value = attempt->budget->now == NULL ? simulate(attempt, u) : simulate_measured(attempt, u);
    if (attempt->late) {
        return HUGE_VAL;
    }
    attempt->evaluations++;
    if (nominal) {
        attempt->nominal_value = value;
        attempt->limit = attempt->budget->evaluations;
    }
    return value;
}

double tl_attempt_evaluate(tl_attempt *attempt, const double *u) {
    double value = evaluate(attempt, u);
    if (!attempt->late) {
        keep_best(attempt, u, value);
    }
    return value;
}

/* ---- identifiability ---- */

/* The one variable in which u differs from another point by a significant move, in steps; else
 * SIZE_MAX. */
static size_t moved_variable(const tl_attempt *attempt, const double *u, const double *from, double *move) {
    const tl_lock *lock = attempt->lock;
    size_t moved = SIZE_MAX;
    *move = 0.0;
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        double largest = 0.0;
        for (size_t i = lock->horizon.offset[v]; i < lock->horizon.offset[v] + lock->horizon.length[v]; i++) {
            largest = fmax(largest, fabs(u[i] - from[i]) / lock->adjusted[v].step);
        }
        if (largest > 0.0 && moved != SIZE_MAX) {
            return SIZE_MAX;
        }
        moved = largest > 0.0 ? v : moved;
        *move = fmax(*move, largest);
    }
    return *move >= TL_TELLING_MOVE ? moved : SIZE_MAX;
}

/* Whether this candidate shows, compared with a point with these residuals, that a variable has an
 * effect or not. */
static void probe_beside(tl_attempt *attempt, const double *u, const double *from, const double *residuals) {
    const tl_lock *lock = attempt->lock;
    double move = 0.0;
    size_t variable = moved_variable(attempt, u, from, &move);
    if (variable == SIZE_MAX) {
        return;
    }
    double change = tl_objective_change(&lock->objective, lock->memory.residuals, residuals);
    uint32_t bit = (uint32_t)1 << variable;
    if (change >= lock->noise_floor * move) {
        attempt->seen |= bit;
    } else if ((attempt->seen & bit) == 0) {
        attempt->held |= bit;
    }
}

/* The same compared with the search's start and with the best so far: solvers vary one unknown
 * after the other from either. */
static void probe(tl_attempt *attempt, const double *u, double value) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_memory *memory = &lock->memory;
    if (!(lock->noise_floor > 0.0) || !isfinite(value) || lock->solver->booleans) {
        return;
    }
    if (isfinite(attempt->start_value)) {
        probe_beside(attempt, u, memory->start, memory->start_residuals);
    }
    if (isfinite(attempt->best_value)) {
        probe_beside(attempt, u, memory->best, memory->best_residuals);
    }
}

/* A candidate that has just shown that a variable has no effect is not better for having moved it.
 */
static void judge(tl_attempt *attempt, const double *u, double value) {
    uint32_t before = attempt->held;
    probe(attempt, u, value);
    keep_best(attempt, u, attempt->held == before ? value : HUGE_VAL);
}

bool tl_attempt_is_blind(const tl_attempt *attempt) {
    return attempt->held != 0 && attempt->held == ((uint32_t)1 << attempt->lock->horizon.variables) - 1;
}

void tl_attempt_hold(const tl_attempt *attempt, double *u) {
    const tl_horizon *horizon = &attempt->lock->horizon;
    for (size_t v = 0; v < horizon->variables; v++) {
        if ((attempt->held >> v & 1U) != 0) {
            for (uint32_t m = 0; m < horizon->length[v]; m++) {
                u[horizon->offset[v] + m] = attempt->nominal[v];
            }
        }
    }
}

/* ---- evaluations ---- */

/* Values that a solver may get at all: finite numbers for points within the bounds. */
static bool is_sane(const tl_lock *lock, const double *u) {
    for (size_t i = 0; i < lock->horizon.count; i++) {
        if (!(u[i] >= lock->space.lower[i] && u[i] <= lock->space.upper[i] && isfinite(u[i]))) {
            return false;
        }
    }
    return true;
}

/* The point that is evaluated for a requested one: variables that are not identifiable are at
 * nominal, and so are insignificant differences from it. (Rounding would hide such a difference in
 * the outputs, but it would cost executions.) */
static const double *settled(const tl_attempt *attempt, const double *u) {
    const tl_lock *lock = attempt->lock;
    double *trial = lock->memory.trial;
    const double *nominal = lock->memory.nominal;
    for (size_t i = 0; i < lock->horizon.count; i++) {
        trial[i] = fabs(u[i] - nominal[i]) <= LEAST_MOVE * lock->space.step[i] ? nominal[i] : u[i];
    }
    tl_attempt_hold(attempt, trial);
    return trial;
}

static bool is_over(const tl_attempt *attempt) {
    bool acquaints = attempt->acquaints && attempt->lock->solver->is_new(attempt->lock->optimiser);
    return attempt->fatal != TL_OK || attempt->late || (attempt->best_value < TL_OBJECTIVE_TOLERANCE && !acquaints) ||
           attempt->stagnated || tl_attempt_is_blind(attempt);
}

/* After an evaluation: whether the solver may continue. */
static bool may_go_on(tl_attempt *attempt) {
    const tl_lock *lock = attempt->lock;
    if (attempt->best_value < TL_OBJECTIVE_TOLERANCE) {
        attempt->stop = TL_STOP_TOLERANCE;
    }
    if (lock->stagnation != 0 && attempt->idle >= lock->stagnation) {
        attempt->stagnated = true;
        attempt->flags |= TL_FLAG_STAGNATED;
    }
    return !is_over(attempt);
}

bool tl_attempt_ask(void *context, const double *u, double *value, const double **residuals) {
    tl_attempt *attempt = context;
    tl_lock *lock = attempt->lock;
    if (residuals != NULL) {
        *residuals = lock->memory.residuals;
    }
    *value = HUGE_VAL;
    if (is_over(attempt)) {
        return false;
    }
    if (!is_sane(lock, u)) {
        attempt->idle++;
        return may_go_on(attempt) && attempt->idle < MOST_IDLE;
    }
    u = settled(attempt, u);
    if (!tl_attempt_may_evaluate(attempt, u)) {
        return false;
    }
    *value = evaluate(attempt, u);
    if (!attempt->late) {
        judge(attempt, u, *value);
    }
    return may_go_on(attempt);
}
