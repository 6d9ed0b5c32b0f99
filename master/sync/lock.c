/* Synchroniser: see lock.h. */
#include "master/sync/lock.h"

#include <math.h>
#include <string.h>

#include "master/sync/attempt.h"

/* Steps between two tries of nominal. */
enum { TL_NOMINAL_EVERY = 10 };

/* ---- build ---- */

static size_t size_of_course(const tl_lock *lock) {
    return tl_objective_samples(&lock->objective) * lock->objective.matched;
}

static bool take_all(tl_arena *arena, double **const *arrays, size_t array_count, size_t count) {
    bool taken = true;
    for (size_t i = 0; i < array_count; i++) {
        *arrays[i] = tl_arena_take(arena, count, sizeof(double));
        taken = taken && *arrays[i] != NULL;
    }
    return taken;
}

static bool take_memory(tl_lock *lock, tl_arena *arena) {
    tl_lock_memory *memory = &lock->memory;
    double **const sequences[] = {&memory->committed, &memory->nominal, &memory->guess, &memory->start,
                                  &memory->best,      &memory->trial,   &memory->lower, &memory->upper};
    double **const vectors[] = {&memory->residuals, &memory->start_residuals, &memory->best_residuals,
                                &memory->forecast,  &memory->noise,           &memory->factors};
    double **const courses[] = {&memory->candidate_course, &memory->best_course, &memory->course};
    double **const samples[] = {&memory->earlier};
    memory->free = tl_arena_take(arena, lock->horizon.count, sizeof *memory->free);
    return memory->free != NULL && take_all(arena, sequences, 8, lock->horizon.count) &&
           take_all(arena, vectors, 6, lock->objective.residual_most) &&
           take_all(arena, courses, 3, size_of_course(lock)) && take_all(arena, samples, 1, lock->objective.matched);
}

/* A guess may move the newest unknown of each variable: earlier ones keep results that exist
 * already. */
static void find_free(tl_lock *lock) {
    const tl_horizon *horizon = &lock->horizon;
    for (size_t v = 0; v < horizon->variables; v++) {
        lock->memory.free[horizon->offset[v] + horizon->length[v] - 1] = true;
    }
}

static void place_bounds(tl_lock *lock) {
    const tl_horizon *horizon = &lock->horizon;
    for (size_t v = 0; v < horizon->variables; v++) {
        for (size_t i = horizon->offset[v]; i < horizon->offset[v] + horizon->length[v]; i++) {
            lock->memory.lower[i] = lock->adjusted[v].lower;
            lock->memory.upper[i] = lock->adjusted[v].upper;
        }
    }
}

/* Data of each unknown for the solvers. */
static bool describe_space(tl_lock *lock, tl_arena *arena, const tl_plan *plan) {
    const tl_horizon *horizon = &lock->horizon;
    double *step = tl_arena_take(arena, horizon->count, sizeof *step);
    uint32_t *dwell = tl_arena_take(arena, horizon->count, sizeof *dwell);
    if (step == NULL || dwell == NULL) {
        return false;
    }
    for (size_t v = 0; v < horizon->variables; v++) {
        for (size_t i = horizon->offset[v]; i < horizon->offset[v] + horizon->length[v]; i++) {
            step[i] = lock->adjusted[v].step;
            dwell[i] = lock->adjusted[v].dwell;
        }
    }
    place_bounds(lock);
    lock->space = (tl_optimiser_space){.count = horizon->count,
                                       .step = step,
                                       .lower = lock->memory.lower,
                                       .upper = lock->memory.upper,
                                       .dwell = dwell,
                                       .residual_count = lock->objective.residual_count,
                                       .residual_most = lock->objective.residual_most,
                                       .sample_count = size_of_course(lock),
                                       .damping_count = lock->objective.damping_count,
                                       .damped = lock->objective.damped,
                                       .held = plan->shape == TL_STATIC && tl_objective_samples(&lock->objective) > 1};
    return true;
}

static void take_settings(tl_lock *lock, const tl_plan *plan, const tl_lock_settings *settings) {
    *lock = (tl_lock){
        .exchange = settings->exchange,
        .track = settings->track,
        .horizon = settings->horizon,
        .solver = settings->solver,
        .fallback = settings->fallback,
        .stagnation = plan->stagnation,
        .margin = plan->margin,
        .noise_floor = plan->noise_floor,
        .held_inputs = plan->measurements == TL_AHEAD,
    };
    memcpy(lock->adjusted, settings->adjusted, sizeof lock->adjusted);
}

bool tl_lock_init(tl_lock *lock, tl_arena *arena, const tl_plan *plan, const tl_lock_settings *settings) {
    uint32_t evaluations = plan->evaluations != 0 ? plan->evaluations : TL_PLAN_EVALUATIONS;
    const tl_objective_settings objective = {
        .exchange = settings->exchange,
        .horizon = &lock->horizon,
        .terms = settings->terms,
        .term_count = plan->match_count,
        .penalties = settings->penalties,
        .damps = !settings->adjusted[0].is_boolean,
    };
    take_settings(lock, plan, settings);
    if (!tl_objective_init(&lock->objective, arena, &objective) ||
        !tl_ledger_init(&lock->ledger, arena, &lock->horizon, &lock->exchange->plant, plan, evaluations)) {
        return false;
    }
    if (lock->horizon.variables == 0) {
        return true;
    }
    if (!take_memory(lock, arena) || !describe_space(lock, arena, plan)) {
        return false;
    }
    find_free(lock);
    lock->optimiser = lock->solver->create(arena, &lock->space);
    if (lock->fallback != NULL) {
        lock->second = lock->fallback->create(arena, &lock->space);
    }
    return lock->optimiser != NULL && (lock->fallback == NULL || lock->second != NULL);
}

void tl_lock_end(tl_lock *lock) {
    if (lock->optimiser != NULL) {
        lock->solver->destroy(lock->optimiser);
        lock->optimiser = NULL;
    }
    if (lock->second != NULL) {
        lock->fallback->destroy(lock->second);
        lock->second = NULL;
    }
}

/* ---- guess ---- */

static size_t size_of_sequence(const tl_lock *lock) {
    return lock->horizon.count * sizeof(double);
}

/* Clamps to the bounds of the search. Nominal itself may be outside: it is the plant's value. */
static void clamp(const tl_lock *lock, double *u) {
    for (size_t i = 0; i < lock->horizon.count; i++) {
        u[i] = fmin(fmax(u[i], lock->space.lower[i]), lock->space.upper[i]);
    }
}

static bool is_nominal(const tl_lock *lock, const double *u) {
    return memcmp(u, lock->memory.nominal, size_of_sequence(lock)) == 0;
}

/* The solver's own guess, from the extrapolated outputs. */
static bool guess_by_solver(tl_attempt *attempt) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_memory *memory = &lock->memory;
    int needed = tl_objective_samples(&lock->objective) > 1 ? 1 : 2;
    if (lock->solver->guess == NULL || lock->courses < needed || lock->was_blind || !tl_attempt_may_guess(attempt)) {
        return false;
    }
    memcpy(memory->start, memory->committed, size_of_sequence(lock));
    tl_horizon_shift(&lock->horizon, memory->start);
    clamp(lock, memory->start);
    tl_objective_forecast(&lock->objective, memory->course, memory->earlier, memory->forecast);
    (void)tl_objective_penalise(&lock->objective, memory->start, attempt->nominal, memory->before, memory->forecast);
    tl_objective_noise(&lock->objective, memory->noise);
    const tl_forecast forecast = {memory->start, memory->forecast, memory->noise, memory->free, memory->nominal};
    bool guessed = lock->solver->guess(lock->optimiser, &forecast, memory->guess);
    tl_attempt_has_guess(attempt);
    return guessed;
}

/* A u that is held while it is within tolerance is never checked for being needed; over an hour an
 * integrator behind the outputs may run away. So a solver that does not know nominal tries it in
 * every tenth step. */
static bool is_time_for_nominal(const tl_attempt *attempt) {
    const tl_optimiser_class *solver = attempt->lock->solver;
    return solver->guess == NULL && !solver->booleans && attempt->step % TL_NOMINAL_EVERY == 0;
}

/* The first evaluation: the solver's guess, or nominal if T_P = T_D; else, and for Booleans, the u
 * committed last, so that horizons overlap, except in every tenth step. A budget of one evaluation
 * is for nominal, except in a repetition, which makes the same guess. Returns whether the solver
 * made it. */
static bool first_guess(tl_attempt *attempt) {
    const tl_lock *lock = attempt->lock;
    double *guess = lock->memory.guess;
    memcpy(guess, lock->memory.nominal, size_of_sequence(lock));
    if ((attempt->limit < 2 && !attempt->budget->repeated) || !lock->has_last) {
        return false;
    }
    if (guess_by_solver(attempt)) {
        return true;
    }
    bool held = lock->horizon.prediction != lock->horizon.distance || lock->solver->booleans;
    if (held && !is_time_for_nominal(attempt)) {
        tl_horizon_hold(&lock->horizon, lock->memory.before, guess);
        clamp(lock, guess); /* an earlier nominal may have been outside */
    }
    return false;
}

/* A guess that moved u and changed nothing against the forecast: the adjusted variables have no
 * effect now. */
static bool guess_was_blind(const tl_attempt *attempt, double value) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_memory *memory = &lock->memory;
    double move = 0.0;
    for (size_t i = 0; i < lock->horizon.count; i++) {
        move = fmax(move, fabs(memory->guess[i] - memory->start[i]) / lock->space.step[i]);
    }
    return lock->noise_floor > 0.0 && isfinite(value) && move >= TL_TELLING_MOVE &&
           tl_objective_change(&lock->objective, memory->residuals, memory->forecast) < lock->noise_floor * move;
}

/* If an FMU fails at the guess, the search starts at the last u, or at nominal if that was the
 * guess. */
static double retreat(tl_attempt *attempt, double value) {
    const tl_lock *lock = attempt->lock;
    double *guess = lock->memory.guess;
    if (isfinite(value) || !lock->has_last || attempt->fatal != TL_OK || attempt->late) {
        return value;
    }
    if (is_nominal(lock, guess)) {
        tl_horizon_hold(&lock->horizon, lock->memory.before, guess);
        clamp(lock, guess);
    } else {
        memcpy(guess, lock->memory.nominal, size_of_sequence(lock));
    }
    return tl_attempt_may_evaluate(attempt, guess) ? tl_attempt_evaluate(attempt, guess) : value;
}

/* ---- search ---- */

/* One solver, from `guess` or the nearest point within the bounds. */
static tl_search_end search_from(tl_attempt *attempt, const tl_optimiser_class *solver, tl_optimiser *optimiser,
                                 const double *from, double value, const double *residuals) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_memory *memory = &lock->memory;
    size_t vector = lock->objective.residual_count * sizeof(double);
    memmove(memory->start, from, size_of_sequence(lock));
    clamp(lock, memory->start);
    attempt->stop = TL_STOP_SOLVER;
    if (memcmp(memory->start, from, size_of_sequence(lock)) != 0) {
        if (!tl_attempt_ask(attempt, memory->start, &value, NULL)) {
            return TL_SEARCH_STOPPED;
        }
        residuals = memory->residuals;
    }
    memmove(memory->start_residuals, residuals, vector);
    attempt->start_value = value;
    const tl_search search = {memory->start, value, memory->start_residuals, tl_attempt_ask, attempt};
    return solver->minimise(optimiser, &search);
}

/* The configured solver; if it fails, stagnates or finds nothing better, the second one continues
 * from the best point, or from the guess if there is none. */
static void search(tl_attempt *attempt, double value) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_memory *memory = &lock->memory;
    tl_search_end end = search_from(attempt, lock->solver, lock->optimiser, memory->guess, value, memory->residuals);
    bool ended_itself = end != TL_SEARCH_STOPPED || attempt->stagnated;
    if (lock->fallback == NULL || !ended_itself || attempt->best_value < TL_OBJECTIVE_TOLERANCE ||
        attempt->fatal != TL_OK || tl_attempt_is_blind(attempt)) {
        return;
    }
    attempt->stagnated = false;
    attempt->idle = 0;
    attempt->flags |= TL_FLAG_FALLBACK;
    const double *from = isfinite(attempt->best_value) ? memory->best : memory->guess;
    (void)search_from(attempt, lock->fallback, lock->second, from, attempt->best_value, memory->best_residuals);
}

/* A variable without effect is committed at nominal, also if the best candidate is older than that
 * finding. Not if time has ended the search: a cheaper candidate may still fit, but a repetition,
 * which only counts, would have used it for the search. */
static void settle_held(tl_attempt *attempt) {
    const tl_lock *lock = attempt->lock;
    double *trial = lock->memory.trial;
    if (attempt->held == 0 || tl_attempt_is_blind(attempt) || !isfinite(attempt->best_value) ||
        attempt->stop == TL_STOP_TIME) {
        return;
    }
    memcpy(trial, lock->memory.best, size_of_sequence(lock));
    tl_attempt_hold(attempt, trial);
    if (memcmp(trial, lock->memory.best, size_of_sequence(lock)) != 0 && tl_attempt_may_evaluate(attempt, trial)) {
        double best = attempt->best_value;
        attempt->best_value = HUGE_VAL;
        (void)tl_attempt_evaluate(attempt, trial);
        attempt->best_value = attempt->late ? best : attempt->best_value; /* it was not kept then */
    }
}

/* Evaluates nominal if that is not done and there is time; room in the budget is reserved. */
static void evaluate_nominal(tl_attempt *attempt) {
    if (isnan(attempt->nominal_value) && attempt->fatal == TL_OK && !attempt->late &&
        !attempt->budget->without_nominal) {
        if (tl_attempt_may_evaluate(attempt, attempt->lock->memory.nominal)) {
            (void)tl_attempt_evaluate(attempt, attempt->lock->memory.nominal);
        }
    }
}

/* Whether the best candidate outside the tolerance is worth committing. It must be better than
 * nominal; without that comparison it is not committed. */
static tl_outcome defend_nominal(tl_attempt *attempt) {
    tl_stop stop = attempt->stop;
    attempt->closing = true;
    evaluate_nominal(attempt);
    attempt->stop = stop;
    bool better = attempt->best_value <= (1.0 - attempt->lock->margin) * attempt->nominal_value &&
                  attempt->best_value < attempt->nominal_value;
    return better && !tl_attempt_is_blind(attempt) ? TL_BEST_SO_FAR : TL_NOMINAL;
}

/* The guess is out of tolerance. If there is no time for the next evaluation, there is none for a
 * search. */
static tl_outcome improve(tl_attempt *attempt, double value) {
    tl_lock *lock = attempt->lock;
    value = retreat(attempt, value);
    if (attempt->stop == TL_STOP_NONE) {
        search(attempt, value);
    }
    settle_held(attempt);
    lock->was_blind = tl_attempt_is_blind(attempt);
    if (attempt->best_value < TL_OBJECTIVE_TOLERANCE && !lock->was_blind) {
        attempt->stop = attempt->stop == TL_STOP_TIME ? TL_STOP_TIME : TL_STOP_TOLERANCE;
        return TL_OPTIMISED;
    }
    return defend_nominal(attempt);
}

/* All is within tolerance, but a solver that can guess has no data of this twin yet. Without them
 * the twin would move freely within the tolerance until the first large error. */
static bool is_stranger(const tl_lock *lock) {
    return !lock->met && lock->solver->is_new != NULL && lock->solver->is_new(lock->optimiser);
}

/* Once per run. While all is well, a variable without effect is not news. */
static tl_outcome acquaint(tl_attempt *attempt, double value) {
    tl_lock *lock = attempt->lock;
    lock->met = true;
    attempt->acquaints = true;
    search(attempt, value);
    bool searched = attempt->evaluations > 1;
    attempt->held = 0;
    if (attempt->stop != TL_STOP_TIME) {
        attempt->stop = searched ? TL_STOP_TOLERANCE : TL_STOP_NONE;
    }
    return searched ? TL_OPTIMISED : TL_FIRST_GUESS;
}

/* A forecast may agree by chance; two simulated candidates do not. Without room for the second one
 * nothing is concluded. The better of them is the next start. */
static bool nominal_agrees(tl_attempt *attempt) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_memory *memory = &lock->memory;
    double move = 0.0;
    for (size_t i = 0; i < lock->horizon.count; i++) {
        move = fmax(move, fabs(memory->guess[i] - memory->nominal[i]) / lock->space.step[i]);
    }
    evaluate_nominal(attempt);
    if (move < TL_TELLING_MOVE || !isfinite(attempt->nominal_value) || attempt->stop != TL_STOP_NONE) {
        return false;
    }
    double change = tl_objective_change(&lock->objective, memory->residuals, memory->start_residuals);
    return change < lock->noise_floor * move;
}

/* Whether the adjusted variables have no effect now. */
static bool is_blind_guess(tl_attempt *attempt, double value) {
    const tl_lock *lock = attempt->lock;
    const tl_lock_memory *memory = &lock->memory;
    if (!guess_was_blind(attempt, value)) {
        return false;
    }
    size_t vector = lock->objective.residual_count * sizeof(double);
    memcpy(memory->start_residuals, memory->residuals, vector);
    bool blind = nominal_agrees(attempt);
    memcpy(memory->guess, memory->best, size_of_sequence(lock));
    memcpy(memory->residuals, memory->best_residuals, vector);
    return blind;
}

/* Guess, then search. The result is in memory.best, unless the outcome is nominal. A guess that
 * time has cut short counts as not started: a repetition sees no difference. */
static tl_outcome find(tl_attempt *attempt) {
    tl_lock *lock = attempt->lock;
    double *guess = lock->memory.guess;
    bool by_solver = first_guess(attempt);
    if (attempt->stop == TL_STOP_TIME) {
        return TL_NOMINAL; /* no time for a guess */
    }
    if (!is_nominal(lock, guess) && !attempt->budget->without_nominal && attempt->limit > 0) {
        attempt->limit--; /* reserved for nominal */
    }
    if (!tl_attempt_may_evaluate(attempt, guess)) {
        return TL_NOMINAL;
    }
    double value = tl_attempt_evaluate(attempt, guess);
    if (attempt->late) {
        return TL_NOMINAL;
    }
    lock->was_blind = by_solver && is_blind_guess(attempt, value);
    if (lock->was_blind) {
        attempt->held = ((uint32_t)1 << lock->horizon.variables) - 1;
        return defend_nominal(attempt);
    }
    value = attempt->best_value;
    if (value < TL_OBJECTIVE_TOLERANCE) {
        return is_stranger(lock) ? acquaint(attempt, value) : TL_FIRST_GUESS;
    }
    return improve(attempt, value);
}

/* The free-running twin is nearer: nothing is searched, but nominal is evaluated. */
static tl_outcome rest(tl_attempt *attempt) {
    attempt->flags |= TL_FLAG_RESTS;
    evaluate_nominal(attempt);
    return TL_NOMINAL;
}

/* ---- commit ---- */

static void record_outputs(const tl_lock *lock, tl_record *record) {
    for (size_t i = 0; i < lock->objective.term_count; i++) {
        record->y[i] = tl_objective_y(&lock->objective, i);
    }
}

/* With a clock: the time since the last reading belongs to the commit, unless executions took it.
 */
static void take_time(tl_lock *lock) {
    if (lock->exchange->costs.now != NULL) {
        lock->times.beside += tl_costs_lap(&lock->exchange->costs);
    }
}

/* Executes step i with u and records it. */
static tl_status commit(tl_attempt *attempt, const double *u, tl_record *record) {
    tl_lock *lock = attempt->lock;
    const tl_horizon *horizon = &lock->horizon;
    tl_status status = tl_attempt_go_back(attempt);
    if (status != TL_OK) {
        return status;
    }
    attempt->dirty = true;
    tl_attempt_set_inputs(lock, u, 0);
    take_time(lock);
    tl_costs_commit(&lock->exchange->costs);
    status = tl_exchange_commit(lock->exchange, attempt->step, attempt->error);
    take_time(lock);
    if (status != TL_OK) {
        return status;
    }
    record_outputs(lock, record);
    for (size_t v = 0; v < horizon->variables; v++) {
        record->u[v] = tl_horizon_value(horizon, u, v, 0);
    }
    tl_ledger_commit(&lock->ledger, record->u);
    return TL_OK;
}

/* Outputs along the horizon of the committed candidate. One step on, they can be read in any case.
 */
static void remember_course(tl_lock *lock, const double *u) {
    tl_lock_memory *memory = &lock->memory;
    size_t samples = tl_objective_samples(&lock->objective);
    size_t last = (samples - 1) * lock->objective.matched;
    bool at_hand = lock->horizon.prediction == 1;
    if (samples == 1) {
        memcpy(memory->earlier, memory->course, lock->objective.matched * sizeof *memory->earlier);
    }
    if (at_hand) {
        tl_objective_matched(&lock->objective, memory->course);
    } else {
        memcpy(memory->course, memory->best_course, size_of_course(lock) * sizeof *memory->course);
    }
    if (samples > 1) {
        memcpy(memory->earlier, &memory->course[last - lock->objective.matched],
               lock->objective.matched * sizeof *memory->earlier);
    }
    lock->courses = at_hand || u == memory->best ? lock->courses + (lock->courses < 2) : 0;
}

/* Start of the next step. */
static void remember(tl_lock *lock, const double *u, const tl_record *record) {
    tl_lock_memory *memory = &lock->memory;
    memmove(memory->committed, u, size_of_sequence(lock));
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        memory->before[v] = record->u[v];
        lock->last_delta[v] = record->u[v] - record->u_hat[v];
    }
    lock->has_last = true;
    remember_course(lock, u);
    if (lock->solver->committed != NULL) {
        lock->solver->committed(lock->optimiser, u);
    }
    if (lock->fallback != NULL && lock->fallback->committed != NULL) {
        lock->fallback->committed(lock->second, u);
    }
}

/* Commits u. If that fails although it did not as a candidate, or if nothing was tried, commits
 * nominal. */
static tl_status commit_found(tl_attempt *attempt, const double *u, tl_record *record) {
    tl_lock *lock = attempt->lock;
    const double *nominal = lock->memory.nominal;
    tl_status status = commit(attempt, u, record);
    if (status == TL_FMU_FAILED && !is_nominal(lock, u)) {
        bool unsearched = record->outcome == TL_MADE_UP || record->outcome == TL_FOLLOWED;
        record->outcome = unsearched ? record->outcome : TL_NOMINAL;
        record->objective = record->objective_nominal;
        u = nominal;
        status = commit(attempt, u, record);
    }
    if (status == TL_OK) {
        remember(lock, u, record);
    }
    return status;
}

void tl_lock_refresh(tl_lock *lock, int64_t step) {
    if (lock->held_inputs) {
        tl_plant *plant = &lock->exchange->plant;
        tl_plant_deliver(plant, tl_plant_shown(plant, step, plant->newest));
        tl_exchange_deliver(lock->exchange);
    }
}

/* A step of a twin that adjusts nothing. */
static tl_status step_free(tl_lock *lock, int64_t step, tl_outcome outcome, tl_record *record, tl_error *error) {
    tl_lock_refresh(lock, step);
    tl_record_begin(record, step);
    record->outcome = outcome;
    tl_status status = tl_exchange_commit(lock->exchange, step, error);
    if (status == TL_OK) {
        record_outputs(lock, record);
        tl_ledger_commit(&lock->ledger, NULL);
    }
    return status;
}

static void begin_time(tl_lock *lock, const tl_budget *budget) {
    tl_lock_times *times = &lock->times;
    tl_estimate *const parts[] = {&times->guessing, &times->asking, &times->within, &times->thinking,
                                  &times->committing};
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        if (times->refused) {
            tl_estimate_rest(parts[i]);
        }
        parts[i]->tried = false;
    }
    if (times->refused) {
        tl_costs_rest(&lock->exchange->costs);
    }
    times->refused = false;
    times->beside = 0;
    tl_costs_begin(&lock->exchange->costs, budget == NULL ? NULL : budget->now,
                   budget == NULL ? NULL : budget->context);
}

tl_time tl_lock_end_step(tl_lock *lock, const tl_budget *budget) {
    tl_costs *costs = &lock->exchange->costs;
    if (costs->now == NULL) {
        return budget->now(budget->context) - budget->started; /* nothing is searched */
    }
    take_time(lock);
    tl_estimate_took(&lock->times.committing, lock->times.beside);
    return costs->read - budget->started;
}

/* Starts the step; then û is known. */
static tl_status begin(tl_attempt *attempt, tl_lock *lock, int64_t step, const tl_budget *budget, tl_record *record,
                       tl_error *error) {
    tl_lock_refresh(lock, step);
    tl_attempt_begin(attempt, lock, step, budget, error);
    tl_record_begin(record, step);
    memcpy(record->u_hat, attempt->nominal, lock->horizon.variables * sizeof *record->u_hat);
    if (!lock->has_last) {
        memcpy(lock->memory.before, attempt->nominal, lock->horizon.variables * sizeof *record->u_hat);
    }
    begin_time(lock, budget);
    return tl_track_begin(lock->track, error);
}

/* Whether time has prevented the evaluation of nominal: a repetition must know. */
static bool is_without_nominal(const tl_attempt *attempt, tl_outcome outcome) {
    return isnan(attempt->nominal_value) && (attempt->stop == TL_STOP_TIME || outcome == TL_NOMINAL);
}

static double finite_or_nan(double value) {
    return isfinite(value) ? value : (double)NAN;
}

/* A variable without effect that is not committed at nominal was not held: there was no room to try
 * that. */
static void forget_unheld(const tl_lock *lock, tl_record *record) {
    for (size_t v = 0; v < lock->horizon.variables && record->held != 0; v++) {
        if (memcmp(&record->u[v], &record->u_hat[v], sizeof record->u[v]) != 0) {
            record->held &= ~((uint32_t)1 << v);
        }
    }
}

tl_status tl_lock_step(tl_lock *lock, int64_t step, const tl_budget *budget, tl_record *record, tl_error *error) {
    if (lock->horizon.variables == 0) {
        return step_free(lock, step, TL_FREE, record, error);
    }
    tl_attempt attempt;
    tl_status status = begin(&attempt, lock, step, budget, record, error);
    if (status != TL_OK) {
        return status;
    }
    if (!tl_objective_prepare(&lock->objective, step) || lock->runs_free) {
        record->outcome = TL_FREE_RUN;
        return commit_found(&attempt, lock->memory.nominal, record);
    }
    record->outcome = lock->rests ? rest(&attempt) : find(&attempt);
    if (attempt.guessed && attempt.evaluations == 0) {
        lock->solver->retract(lock->optimiser);
    }
    if (attempt.fatal != TL_OK) {
        return attempt.fatal;
    }
    record->stop = attempt.stop;
    record->flags = attempt.flags | (is_without_nominal(&attempt, record->outcome) ? TL_FLAG_WITHOUT_NOMINAL : 0U);
    record->held = attempt.held;
    record->evaluations = attempt.evaluations;
    record->objective_nominal = finite_or_nan(attempt.nominal_value);
    record->objective = record->outcome == TL_NOMINAL ? record->objective_nominal : finite_or_nan(attempt.best_value);
    status = commit_found(&attempt, record->outcome == TL_NOMINAL ? lock->memory.nominal : lock->memory.best, record);
    forget_unheld(lock, record);
    return status;
}

/* Nominal with the last Δu; of a Boolean, the last u. */
static void extrapolate(const tl_lock *lock, const double *nominal, double *values) {
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        const tl_adjusted *adjusted = &lock->adjusted[v];
        values[v] = nominal[v];
        if (lock->has_last && adjusted->is_boolean) {
            values[v] = lock->memory.before[v];
        } else if (lock->has_last && fabs(lock->last_delta[v]) > 0.0) {
            values[v] = fmin(fmax(nominal[v] + lock->last_delta[v], adjusted->lower), adjusted->upper);
        }
    }
}

/* One step without a search; u NULL: with the last Δu. */
static tl_status step_unsearched(tl_lock *lock, int64_t step, tl_outcome outcome, const double *u, tl_record *record,
                                 tl_error *error) {
    if (lock->horizon.variables == 0) {
        return step_free(lock, step, outcome, record, error);
    }
    tl_attempt attempt;
    tl_status status = begin(&attempt, lock, step, NULL, record, error);
    if (status != TL_OK) {
        return status;
    }
    record->outcome = outcome;
    double values[TL_MAX_ADJUST];
    if (u == NULL) {
        extrapolate(lock, attempt.nominal, values);
    }
    tl_horizon_hold(&lock->horizon, u != NULL ? u : values, lock->memory.guess);
    return commit_found(&attempt, lock->memory.guess, record);
}

tl_status tl_lock_make_up(tl_lock *lock, int64_t step, tl_record *record, tl_error *error) {
    return step_unsearched(lock, step, TL_MADE_UP, NULL, record, error);
}

tl_status tl_lock_follow(tl_lock *lock, int64_t step, const double *u, tl_record *record, tl_error *error) {
    return step_unsearched(lock, step, TL_FOLLOWED, u, record, error);
}

static void forget(const tl_optimiser_class *solver, tl_optimiser *optimiser) {
    if (optimiser != NULL && solver->forget != NULL) {
        solver->forget(optimiser);
    }
}

static void forget_courses(tl_lock *lock) {
    lock->courses = 0;
    lock->was_blind = false;
    lock->met = false;
    forget(lock->solver, lock->optimiser);
    forget(lock->fallback, lock->second);
}

void tl_lock_begin_anew(tl_lock *lock) {
    lock->has_last = false;
    forget_courses(lock);
    tl_ledger_begin_anew(&lock->ledger);
}

void tl_lock_go_on_elsewhere(tl_lock *lock) {
    lock->courses = 0;
    tl_ledger_begin_anew(&lock->ledger);
}

void tl_lock_forget(tl_lock *lock) {
    forget_courses(lock);
    tl_ledger_forget(&lock->ledger);
}

/* u stays, so its distance from another nominal changes. */
static void move_nominal(tl_lock *lock, size_t variable, const tl_tuning_adjust *adjust) {
    double before = tl_exchange_nominal(lock->exchange, variable);
    bool moves = adjust->has_nominal != 0 && (adjust->nominal < before || adjust->nominal > before);
    if (moves && lock->has_last) {
        lock->last_delta[variable] = lock->memory.before[variable] - adjust->nominal;
    }
}

static void retune(const tl_lock *lock, const tl_optimiser_class *solver, tl_optimiser *optimiser) {
    if (solver != NULL && solver->retune != NULL) {
        solver->retune(optimiser, lock->memory.factors);
    }
}

void tl_lock_retune(tl_lock *lock, tl_objective_term *terms, const tl_tuning *tuning) {
    if (lock->horizon.variables == 0) {
        return; /* nothing is searched */
    }
    tl_objective_retune(&lock->objective, terms, tuning, lock->memory.factors);
    lock->space.residual_count = lock->objective.residual_count;
    for (size_t v = 0; v < lock->horizon.variables; v++) {
        if (!lock->adjusted[v].is_boolean) {
            lock->adjusted[v].lower = tuning->adjust[v].lower;
            lock->adjusted[v].upper = tuning->adjust[v].upper;
        }
        move_nominal(lock, v, &tuning->adjust[v]);
    }
    place_bounds(lock);
    lock->margin = tuning->margin;
    lock->noise_floor = tuning->noise_floor;
    retune(lock, lock->solver, lock->optimiser);
    retune(lock, lock->fallback, lock->second);
}

void tl_lock_archive(tl_lock *lock, tl_archive *archive) {
    const tl_objective *objective = &lock->objective;
    tl_archive_flag(archive, &lock->has_last);
    tl_archive_part(archive, lock->memory.before, sizeof lock->memory.before);
    tl_archive_part(archive, lock->last_delta, sizeof lock->last_delta);
    tl_archive_require_finite(archive, lock->memory.before, TL_MAX_ADJUST);
    tl_archive_require_finite(archive, lock->last_delta, TL_MAX_ADJUST);
    for (size_t i = 0; i < objective->matched; i++) {
        tl_jitter_archive(&objective->jitters[i], archive);
    }
}
