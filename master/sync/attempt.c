/* The evaluations of one step: see attempt.h. */
#include "master/sync/attempt.h"

#include <math.h>
#include <string.h>

#include "master/base/duration.h"

/* Progress is a J that is smaller by at least this part. */
static const double PROGRESS = 0.01;

/* In first steps of the search. */
static const double LEAST_MOVE = 1e-9;

/* Questions without progress after which a solver that asks outside its bounds is told to stop. */
enum { MOST_IDLE = 1000 };

static void read_nominal(const tl_lock *lock, double *nominal) {
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        const tl_adjusted *adjusted = &lock->adjusted[v];
        nominal[v] = adjusted->delivered_real != NULL      ? *adjusted->delivered_real
                     : adjusted->delivered_boolean != NULL ? (double)*adjusted->delivered_boolean
                                                           : adjusted->nominal;
    }
}

void tl_attempt_begin(tl_attempt *attempt, tl_lock *lock, int64_t step, const tl_budget *budget, tl_error *error) {
    attempt->lock = lock;
    attempt->step = step;
    attempt->budget = budget;
    attempt->limit = budget == NULL ? 0 : budget->evaluations;
    attempt->evaluations = 0;
    attempt->dirty = false;
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
    lock->overhead = tl_duration_fade(lock->overhead); /* also where it lets nothing be evaluated */
    read_nominal(lock, attempt->nominal);
    tl_horizon_hold(&lock->horizon, attempt->nominal, lock->memory.nominal);
    if (lock->solver->rest != NULL) {
        lock->solver->rest(lock->optimiser, lock->memory.nominal);
    }
}

void tl_attempt_set_inputs(const tl_lock *lock, const double *u, uint32_t depth) {
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        double value = tl_horizon_value(&lock->horizon, u, v, depth);
        if (lock->adjusted[v].real != NULL) {
            *lock->adjusted[v].real = value;
        } else {
            *lock->adjusted[v].boolean = value != 0.0 ? fmi2True : fmi2False;
        }
    }
}

/* ---- time ---- */

static tl_time elapsed(const tl_budget *budget) {
    return tl_duration(budget->started, budget->now(budget->context));
}

/* What must follow the present candidate: the committing step, and nominal's evaluation where it is to come. */
static tl_time reserve(const tl_attempt *attempt) {
    const tl_lock *lock = attempt->lock;
    const tl_exchange *exchange = lock->exchange;
    bool known = exchange->cached != NULL && attempt->nominal_follows; /* the first step of what is committed then */
    tl_time sum = lock->overhead + (attempt->nominal_follows ? lock->overhead : 0);
    for (size_t k = 0; k < exchange->component_count; k++) {
        tl_time reach = (tl_time)(exchange->reach != NULL ? exchange->reach[k] : lock->horizon.prediction);
        tl_time horizon = attempt->nominal_follows ? reach : 0;
        sum += exchange->cost[k] * (known && horizon > 0 ? horizon : horizon + 1);
    }
    return sum;
}

/* Whether the candidate, from `depth` on, and what must follow fit into the time. Without a clock everything does. */
static bool fits(tl_attempt *attempt, uint32_t depth) {
    const tl_lock *lock = attempt->lock;
    const tl_budget *budget = attempt->budget;
    if (budget->now == NULL) {
        return true;
    }
    tl_time cost = tl_ledger_cost(&lock->ledger, lock->exchange->cost, depth) + lock->overhead;
    if (elapsed(budget) + cost + reserve(attempt) <= budget->time) {
        return true;
    }
    attempt->stop = TL_STOP_TIME;
    return false;
}

/* u is about to be evaluated: what is known of it, and whether nominal is still to come after it. */
static void expect(tl_attempt *attempt, const double *u) {
    const tl_lock *lock = attempt->lock;
    tl_ledger_expect(&attempt->lock->ledger, u);
    attempt->nominal_follows =
        isnan(attempt->nominal_value) && memcmp(u, lock->memory.nominal, lock->horizon.count * sizeof *u) != 0;
}

/* Beyond the limit there may be room that was kept for nominal, which this is. */
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
    if (attempt->budget->now == NULL) {
        return true;
    }
    expect(attempt, u);
    return fits(attempt, 0);
}

/* ---- one candidate ---- */

/* Whether a candidate that has been walked to `depth` had better be left. */
static bool runs_late(tl_attempt *attempt, uint32_t depth) {
    attempt->late = depth > 0 && !fits(attempt, depth);
    return attempt->late;
}

/* Walks u over the horizon; its sum of squares so far in *sum. Ends early where an FMU fails or time runs out. */
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

/* J of u, or HUGE_VAL where an FMU fails, a result is not finite, or time runs out. */
static double simulate(tl_attempt *attempt, const double *u) {
    tl_lock *lock = attempt->lock;
    tl_status status = attempt->dirty ? tl_track_rewind(lock->track, attempt->error) : TL_OK;
    attempt->dirty = true;
    double sum =
        tl_objective_penalise(&lock->objective, u, attempt->nominal, lock->memory.before, lock->memory.residuals);
    status = status == TL_OK ? walk(attempt, u, &sum) : status;
    if (status == TL_FMU_FATAL) {
        attempt->fatal = status;
    }
    return status == TL_OK && !attempt->late && isfinite(sum) ? sum : HUGE_VAL;
}

/* The same under the clock: learns what an evaluation costs beside its executions. */
static double simulate_measured(tl_attempt *attempt, const double *u) {
    tl_lock *lock = attempt->lock;
    const tl_budget *budget = attempt->budget;
    tl_time before = budget->now(budget->context);
    tl_time executing = lock->exchange->spent;
    double value = simulate(attempt, u);
    tl_time beside = tl_duration(before, budget->now(budget->context)) - (lock->exchange->spent - executing);
    lock->overhead = tl_duration_expect(lock->overhead, beside);
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

/* J of u, counted; HUGE_VAL also where it is late, which is not an evaluation: a repetition without a clock will not make
 * it either. Whoever asks about nominal, it is evaluated once. */
static double evaluate(tl_attempt *attempt, const double *u) {
    expect(attempt, u);
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

/* The one variable in which u differs from another point by a telling move, in steps; else SIZE_MAX. */
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

/* Has this candidate shown, beside a point with these residuals, that a variable does or does not matter? */
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

/* The same beside the search's start and beside the best so far: solvers vary one unknown after the other from either. */
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

/* A candidate that has just shown that a variable does not matter is no better for having moved it. */
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

/* ---- questions ---- */

/* What a solver may be told at all: numbers within the bounds. */
static bool is_sane(const tl_lock *lock, const double *u) {
    for (size_t i = 0; i < lock->horizon.count; i++) {
        if (!(u[i] >= lock->space.lower[i] && u[i] <= lock->space.upper[i] && isfinite(u[i]))) {
            return false;
        }
    }
    return true;
}

/* The point that is evaluated for one that is asked about: what is held is at nominal, and so is what differs from it by less
 * than can matter. (Outputs would lose such a difference in rounding, and it be executed for nothing.) */
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

/* After an evaluation: may the solver go on? */
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
