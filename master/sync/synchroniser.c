/* Synchroniser: see synchroniser.h. */
#include "master/sync/synchroniser.h"

#include <math.h>
#include <string.h>

#include "master/sync/step_search.h"

/* Steps between two tries of nominal. */
enum { TL_NOMINAL_EVERY = 10 };

/* ---- build ---- */

static size_t size_of_course(const tl_synchroniser *synchroniser) {
    return tl_objective_samples(&synchroniser->objective) * synchroniser->objective.matched;
}

static bool take_arrays(tl_arena *arena, double **const *arrays, size_t array_count, size_t count) {
    bool taken = true;
    for (size_t i = 0; i < array_count; i++) {
        *arrays[i] = tl_arena_take(arena, count, sizeof(double));
        taken = taken && *arrays[i] != NULL;
    }
    return taken;
}

static bool take_memory(tl_synchroniser *synchroniser, tl_arena *arena) {
    tl_synchroniser_memory *memory = &synchroniser->memory;
    double **const sequences[] = {&memory->committed, &memory->nominal,     &memory->guess, &memory->start,
                                  &memory->best,      &memory->evaluated_u, &memory->lower, &memory->upper};
    double **const vectors[] = {&memory->residuals, &memory->start_residuals, &memory->best_residuals,
                                &memory->forecast,  &memory->noise,           &memory->factors};
    double **const courses[] = {&memory->candidate_course, &memory->best_course, &memory->course};
    double **const samples[] = {&memory->earlier};
    memory->free = tl_arena_take(arena, synchroniser->horizon.count, sizeof *memory->free);
    synchroniser->rest = tl_arena_take(arena, (size_t)synchroniser->horizon.prediction + 1, sizeof *synchroniser->rest);
    return memory->free != NULL && synchroniser->rest != NULL &&
           take_arrays(arena, sequences, 8, synchroniser->horizon.count) &&
           take_arrays(arena, vectors, 6, synchroniser->objective.residual_most) &&
           take_arrays(arena, courses, 3, size_of_course(synchroniser)) &&
           take_arrays(arena, samples, 1, synchroniser->objective.matched);
}

/* A guess may move the newest unknown of each variable: earlier ones keep results that exist
 * already. */
static void find_free(tl_synchroniser *synchroniser) {
    const tl_horizon *horizon = &synchroniser->horizon;
    for (size_t v = 0; v < horizon->variables; v++) {
        synchroniser->memory.free[horizon->offset[v] + horizon->length[v] - 1] = true;
    }
}

static void place_bounds(tl_synchroniser *synchroniser) {
    const tl_horizon *horizon = &synchroniser->horizon;
    for (size_t v = 0; v < horizon->variables; v++) {
        for (size_t i = horizon->offset[v]; i < horizon->offset[v] + horizon->length[v]; i++) {
            synchroniser->memory.lower[i] = synchroniser->adjusted[v].lower;
            synchroniser->memory.upper[i] = synchroniser->adjusted[v].upper;
        }
    }
}

/* Data of each unknown for the solvers. */
static bool describe_space(tl_synchroniser *synchroniser, tl_arena *arena, const tl_plan *plan) {
    const tl_horizon *horizon = &synchroniser->horizon;
    double *step = tl_arena_take(arena, horizon->count, sizeof *step);
    uint32_t *dwell = tl_arena_take(arena, horizon->count, sizeof *dwell);
    if (step == NULL || dwell == NULL) {
        return false;
    }
    for (size_t v = 0; v < horizon->variables; v++) {
        for (size_t i = horizon->offset[v]; i < horizon->offset[v] + horizon->length[v]; i++) {
            step[i] = synchroniser->adjusted[v].step;
            dwell[i] = synchroniser->adjusted[v].dwell;
        }
    }
    place_bounds(synchroniser);
    synchroniser->space =
        (tl_optimiser_space){.count = horizon->count,
                             .step = step,
                             .lower = synchroniser->memory.lower,
                             .upper = synchroniser->memory.upper,
                             .dwell = dwell,
                             .residual_count = synchroniser->objective.residual_count,
                             .residual_most = synchroniser->objective.residual_most,
                             .sample_count = size_of_course(synchroniser),
                             .damping_count = synchroniser->objective.damping_count,
                             .damped = synchroniser->objective.damped,
                             .held = plan->shape == TL_STATIC && tl_objective_samples(&synchroniser->objective) > 1};
    return true;
}

static void take_settings(tl_synchroniser *synchroniser, const tl_plan *plan,
                          const tl_synchroniser_settings *settings) {
    *synchroniser = (tl_synchroniser){
        .exchange = settings->exchange,
        .track = settings->track,
        .horizon = settings->horizon,
        .solver = settings->solver,
        .fallback = settings->fallback,
        .stagnation = plan->stagnation,
        .margin = plan->margin,
        .noise_floor = plan->noise_floor,
        .uses_newest_sample = plan->measurements == TL_AHEAD,
    };
    memcpy(synchroniser->adjusted, settings->adjusted, sizeof synchroniser->adjusted);
}

bool tl_synchroniser_init(tl_synchroniser *synchroniser, tl_arena *arena, const tl_plan *plan,
                          const tl_synchroniser_settings *settings) {
    uint32_t evaluations = plan->evaluations != 0 ? plan->evaluations : TL_PLAN_EVALUATIONS;
    const tl_objective_settings objective = {
        .exchange = settings->exchange,
        .horizon = &synchroniser->horizon,
        .terms = settings->terms,
        .term_count = plan->match_count,
        .penalties = settings->penalties,
        .damps = !settings->adjusted[0].is_boolean,
    };
    take_settings(synchroniser, plan, settings);
    if (!tl_objective_init(&synchroniser->objective, arena, &objective) ||
        !tl_ledger_init(&synchroniser->ledger, arena, &synchroniser->horizon, &synchroniser->exchange->plant, plan,
                        evaluations)) {
        return false;
    }
    if (synchroniser->horizon.variables == 0) {
        return true;
    }
    if (!take_memory(synchroniser, arena) || !describe_space(synchroniser, arena, plan)) {
        return false;
    }
    find_free(synchroniser);
    if (!synchroniser->solver->booleans &&
        !tl_sensitivity_init(&synchroniser->sensitivity, arena, &synchroniser->horizon, synchroniser->space.step,
                             synchroniser->space.sample_count)) {
        return false;
    }
    synchroniser->optimiser = synchroniser->solver->create(arena, &synchroniser->space);
    if (synchroniser->fallback != NULL) {
        synchroniser->second = synchroniser->fallback->create(arena, &synchroniser->space);
    }
    return synchroniser->optimiser != NULL && (synchroniser->fallback == NULL || synchroniser->second != NULL);
}

void tl_synchroniser_end(tl_synchroniser *synchroniser) {
    if (synchroniser->optimiser != NULL) {
        synchroniser->solver->destroy(synchroniser->optimiser);
        synchroniser->optimiser = NULL;
    }
    if (synchroniser->second != NULL) {
        synchroniser->fallback->destroy(synchroniser->second);
        synchroniser->second = NULL;
    }
}

/* ---- guess ---- */

static size_t size_of_sequence(const tl_synchroniser *synchroniser) {
    return synchroniser->horizon.count * sizeof(double);
}

/* Clamps to the bounds of the search. Nominal itself may be outside: it is the plant's value. */
static void clamp(const tl_synchroniser *synchroniser, double *u) {
    for (size_t i = 0; i < synchroniser->horizon.count; i++) {
        u[i] = fmin(fmax(u[i], synchroniser->space.lower[i]), synchroniser->space.upper[i]);
    }
}

static bool is_nominal(const tl_synchroniser *synchroniser, const double *u) {
    return memcmp(u, synchroniser->memory.nominal, size_of_sequence(synchroniser)) == 0;
}

/* The solver's own guess, from the extrapolated outputs. */
static bool guess_by_solver(tl_step_search *search) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    int needed = tl_objective_samples(&synchroniser->objective) > 1 ? 1 : 2;
    if (synchroniser->solver->guess == NULL || synchroniser->courses < needed || synchroniser->was_blind ||
        !tl_step_search_may_guess(search)) {
        return false;
    }
    memcpy(memory->start, memory->committed, size_of_sequence(synchroniser));
    tl_horizon_shift(&synchroniser->horizon, memory->start);
    clamp(synchroniser, memory->start);
    tl_objective_forecast(&synchroniser->objective, memory->course, memory->earlier, memory->forecast);
    (void)tl_objective_penalise(&synchroniser->objective, memory->start, search->nominal, memory->before,
                                memory->forecast);
    tl_objective_noise(&synchroniser->objective, memory->noise);
    const tl_forecast forecast = {memory->start, memory->forecast, memory->noise, memory->free, memory->nominal};
    bool guessed = synchroniser->solver->guess(synchroniser->optimiser, &forecast, memory->guess);
    tl_step_search_end_guess(search);
    return guessed;
}

/* While u is held within tolerance, no evaluation shows whether the correction is still needed.
 * Over an hour an integrator behind the outputs may run away. So nominal is tried in every tenth
 * step if the solver does not guess. */
static bool is_time_for_nominal(const tl_step_search *search) {
    const tl_optimiser_class *solver = search->synchroniser->solver;
    return solver->guess == NULL && !solver->booleans && search->step % TL_NOMINAL_EVERY == 0;
}

/* Chooses the u of the first evaluation. Returns true if it is the solver's guess. Without a guess,
 * it is nominal if T_P = T_D. If T_P > T_D, and for Booleans, it is the u committed last, so that
 * horizons overlap; in every tenth step it is nominal. A budget of one evaluation is for nominal,
 * except in a repetition, which makes the same guess. */
static bool first_guess(tl_step_search *search) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    double *guess = synchroniser->memory.guess;
    memcpy(guess, synchroniser->memory.nominal, size_of_sequence(synchroniser));
    if ((search->limit < 2 && !search->budget->repeated) || !synchroniser->has_last) {
        return false;
    }
    if (guess_by_solver(search)) {
        return true;
    }
    bool held = synchroniser->horizon.prediction != synchroniser->horizon.distance || synchroniser->solver->booleans;
    if (held && !is_time_for_nominal(search)) {
        tl_horizon_hold(&synchroniser->horizon, synchroniser->memory.before, guess);
        clamp(synchroniser, guess); /* an earlier nominal may have been outside */
    }
    return false;
}

/* True if the guess moved u and changed nothing against the forecast. Then the adjusted variables
 * seem to have no effect now. */
static bool guess_was_blind(const tl_step_search *search, double value) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    double move = 0.0;
    for (size_t i = 0; i < synchroniser->horizon.count; i++) {
        move = fmax(move, fabs(memory->guess[i] - memory->start[i]) / synchroniser->space.step[i]);
    }
    return synchroniser->noise_floor > 0.0 && isfinite(value) && move >= TL_SIGNIFICANT_MOVE &&
           tl_objective_change(&synchroniser->objective, memory->residuals, memory->forecast) <
               synchroniser->noise_floor * move;
}

/* If an FMU fails at the guess, the search starts at the last u, or at nominal if that was the
 * guess. */
static double retry_failed_guess(tl_step_search *search, double value) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    double *guess = synchroniser->memory.guess;
    if (isfinite(value) || !synchroniser->has_last || search->fatal != TL_OK || search->late) {
        return value;
    }
    if (is_nominal(synchroniser, guess)) {
        tl_horizon_hold(&synchroniser->horizon, synchroniser->memory.before, guess);
        clamp(synchroniser, guess);
    } else {
        memcpy(guess, synchroniser->memory.nominal, size_of_sequence(synchroniser));
    }
    return tl_step_search_may_evaluate(search, guess) ? tl_step_search_evaluate(search, guess) : value;
}

/* ---- search ---- */

/* One solver, from `guess` or the nearest point within the bounds. */
static tl_search_end search_from(tl_step_search *search, const tl_optimiser_class *solver, tl_optimiser *optimiser,
                                 const double *from, double value, const double *residuals) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    size_t vector = synchroniser->objective.residual_count * sizeof(double);
    memmove(memory->start, from, size_of_sequence(synchroniser));
    clamp(synchroniser, memory->start);
    search->stop = TL_STOP_SOLVER;
    if (memcmp(memory->start, from, size_of_sequence(synchroniser)) != 0) {
        if (!tl_step_search_ask(search, memory->start, &value, NULL)) {
            return TL_SEARCH_STOPPED;
        }
        residuals = memory->residuals;
    }
    memmove(memory->start_residuals, residuals, vector);
    search->start_value = value;
    const tl_search request = {memory->start, value, memory->start_residuals, tl_step_search_ask, search};
    return solver->minimise(optimiser, &request);
}

/* The configured solver; if it fails, stagnates or finds nothing better, the second one continues
 * from the best point, or from the guess if there is none. */
static void run_search(tl_step_search *search, double value) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    tl_search_end end =
        search_from(search, synchroniser->solver, synchroniser->optimiser, memory->guess, value, memory->residuals);
    bool ended_itself = end != TL_SEARCH_STOPPED || search->stagnated;
    if (synchroniser->fallback == NULL || !ended_itself || search->best_value < TL_OBJECTIVE_TOLERANCE ||
        search->fatal != TL_OK || tl_step_search_is_blind(search)) {
        return;
    }
    search->stagnated = false;
    search->idle = 0;
    search->flags |= TL_FLAG_FALLBACK;
    const double *from = isfinite(search->best_value) ? memory->best : memory->guess;
    (void)search_from(search, synchroniser->fallback, synchroniser->second, from, search->best_value,
                      memory->best_residuals);
}

/* Moves variables without effect to nominal, also if the best candidate is older than that finding.
 * If time has ended the search, this is not done. A cheaper candidate may still fit into the time,
 * but a repetition only counts evaluations: it would use this one for the search. */
static void hold_unidentifiable(tl_step_search *search) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    double *evaluated_u = synchroniser->memory.evaluated_u;
    if (search->held == 0 || tl_step_search_is_blind(search) || !isfinite(search->best_value) ||
        search->stop == TL_STOP_TIME) {
        return;
    }
    memcpy(evaluated_u, synchroniser->memory.best, size_of_sequence(synchroniser));
    tl_step_search_hold(search, evaluated_u);
    if (memcmp(evaluated_u, synchroniser->memory.best, size_of_sequence(synchroniser)) != 0 &&
        tl_step_search_may_evaluate(search, evaluated_u)) {
        double best = search->best_value;
        search->best_value = HUGE_VAL;
        (void)tl_step_search_evaluate(search, evaluated_u);
        search->best_value = search->late ? best : search->best_value; /* it was not kept then */
    }
}

/* Evaluates nominal if that is not done and there is time; room in the budget is reserved. */
static void evaluate_nominal(tl_step_search *search) {
    if (isnan(search->nominal_value) && search->fatal == TL_OK && !search->late && !search->budget->without_nominal) {
        if (tl_step_search_may_evaluate(search, search->synchroniser->memory.nominal)) {
            (void)tl_step_search_evaluate(search, search->synchroniser->memory.nominal);
        }
    }
}

/* Whether the best candidate outside the tolerance is worth committing. It must be better than
 * nominal; without that comparison it is not committed. */
static tl_outcome compare_with_nominal(tl_step_search *search) {
    tl_stop stop = search->stop;
    search->closing = true;
    evaluate_nominal(search);
    search->stop = stop;
    bool better = search->best_value <= (1.0 - search->synchroniser->margin) * search->nominal_value &&
                  search->best_value < search->nominal_value;
    return better && !tl_step_search_is_blind(search) ? TL_BEST_SO_FAR : TL_NOMINAL;
}

/* The guess is out of tolerance. If there is no time for the next evaluation, there is none for a
 * search. */
static tl_outcome improve(tl_step_search *search, double value) {
    tl_synchroniser *synchroniser = search->synchroniser;
    value = retry_failed_guess(search, value);
    if (search->stop == TL_STOP_NONE) {
        run_search(search, value);
    }
    hold_unidentifiable(search);
    synchroniser->was_blind = tl_step_search_is_blind(search);
    if (search->best_value < TL_OBJECTIVE_TOLERANCE && !synchroniser->was_blind) {
        search->stop = search->stop == TL_STOP_TIME ? TL_STOP_TIME : TL_STOP_TOLERANCE;
        return TL_OPTIMISED;
    }
    return compare_with_nominal(search);
}

/* True if the solver can guess but has no data of this twin yet. All outputs are within tolerance.
 * Without data, the twin would move freely within the tolerance until the first large error. */
static bool needs_teaching(const tl_synchroniser *synchroniser) {
    return !synchroniser->has_taught_solver && synchroniser->solver->is_new != NULL &&
           synchroniser->solver->is_new(synchroniser->optimiser);
}

/* Searches once per run to give the solver data. All outputs are within tolerance, so a variable
 * without effect is not recorded. */
static tl_outcome teach_solver(tl_step_search *search, double value) {
    tl_synchroniser *synchroniser = search->synchroniser;
    synchroniser->has_taught_solver = true;
    search->acquaints = true;
    run_search(search, value);
    bool searched = search->evaluations > 1;
    search->held = 0;
    if (search->stop != TL_STOP_TIME) {
        search->stop = searched ? TL_STOP_TOLERANCE : TL_STOP_NONE;
    }
    return searched ? TL_OPTIMISED : TL_FIRST_GUESS;
}

/* True if nominal gives the same outputs as the guess. A forecast may agree by chance, so nominal
 * is simulated. Returns false if there is no budget for nominal. */
static bool nominal_agrees(tl_step_search *search) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    double move = 0.0;
    for (size_t i = 0; i < synchroniser->horizon.count; i++) {
        move = fmax(move, fabs(memory->guess[i] - memory->nominal[i]) / synchroniser->space.step[i]);
    }
    evaluate_nominal(search);
    if (move < TL_SIGNIFICANT_MOVE || !isfinite(search->nominal_value) || search->stop != TL_STOP_NONE) {
        return false;
    }
    double change = tl_objective_change(&synchroniser->objective, memory->residuals, memory->start_residuals);
    return change < synchroniser->noise_floor * move;
}

/* True if the adjusted variables have no effect now. The better one of guess and nominal becomes
 * the guess. */
static bool is_blind_guess(tl_step_search *search, double value) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    if (!guess_was_blind(search, value)) {
        return false;
    }
    size_t vector = synchroniser->objective.residual_count * sizeof(double);
    memcpy(memory->start_residuals, memory->residuals, vector);
    bool blind = nominal_agrees(search);
    memcpy(memory->guess, memory->best, size_of_sequence(synchroniser));
    memcpy(memory->residuals, memory->best_residuals, vector);
    return blind;
}

/* Guess, then search. The result is in memory.best, unless the outcome is nominal. If time runs out
 * during the guess, it counts as not started, so that a repetition gives the same result. */
static tl_outcome find_correction(tl_step_search *search) {
    tl_synchroniser *synchroniser = search->synchroniser;
    double *guess = synchroniser->memory.guess;
    bool by_solver = first_guess(search);
    if (search->stop == TL_STOP_TIME) {
        return TL_NOMINAL; /* no time for a guess */
    }
    if (!is_nominal(synchroniser, guess) && !search->budget->without_nominal && search->limit > 0) {
        search->limit--; /* reserved for nominal */
    }
    if (!tl_step_search_may_evaluate(search, guess)) {
        return TL_NOMINAL;
    }
    double value = tl_step_search_evaluate(search, guess);
    if (search->late) {
        return TL_NOMINAL;
    }
    synchroniser->was_blind = by_solver && is_blind_guess(search, value);
    if (synchroniser->was_blind) {
        search->held = ((uint32_t)1 << synchroniser->horizon.variables) - 1;
        return compare_with_nominal(search);
    }
    value = search->best_value;
    if (value < TL_OBJECTIVE_TOLERANCE) {
        return needs_teaching(synchroniser) ? teach_solver(search, value) : TL_FIRST_GUESS;
    }
    return improve(search, value);
}

/* The free-running twin is nearer: nothing is searched, but nominal is evaluated. */
static tl_outcome rest_at_nominal(tl_step_search *search) {
    search->flags |= TL_FLAG_RESTS;
    evaluate_nominal(search);
    return TL_NOMINAL;
}

/* ---- commit ---- */

static void record_outputs(const tl_synchroniser *synchroniser, tl_record *record) {
    for (size_t i = 0; i < synchroniser->objective.term_count; i++) {
        record->y[i] = tl_objective_y(&synchroniser->objective, i);
    }
}

/* With a clock: the time since the last reading belongs to the commit, unless executions took it.
 */
static void take_time(tl_synchroniser *synchroniser) {
    if (synchroniser->exchange->costs.now != NULL) {
        synchroniser->times.beside += tl_costs_lap(&synchroniser->exchange->costs);
    }
}

/* Executes step i with u and records it. */
static tl_status commit_step(tl_step_search *search, const double *u, tl_record *record) {
    tl_synchroniser *synchroniser = search->synchroniser;
    const tl_horizon *horizon = &synchroniser->horizon;
    tl_status status = tl_step_search_go_back(search);
    if (status != TL_OK) {
        return status;
    }
    search->dirty = true;
    tl_step_search_set_inputs(synchroniser, u, 0);
    take_time(synchroniser);
    tl_costs_commit(&synchroniser->exchange->costs);
    status = tl_exchange_commit(synchroniser->exchange, search->step, search->error);
    take_time(synchroniser);
    if (status != TL_OK) {
        return status;
    }
    record_outputs(synchroniser, record);
    for (size_t v = 0; v < horizon->variables; v++) {
        record->u[v] = tl_horizon_value(horizon, u, v, 0);
    }
    tl_ledger_commit(&synchroniser->ledger, record->u);
    return TL_OK;
}

/* Outputs along the horizon of the committed candidate. One step on, they can be read in any case.
 */
static void remember_course(tl_synchroniser *synchroniser, const double *u) {
    tl_synchroniser_memory *memory = &synchroniser->memory;
    size_t samples = tl_objective_samples(&synchroniser->objective);
    size_t last = (samples - 1) * synchroniser->objective.matched;
    bool is_readable = synchroniser->horizon.prediction == 1;
    if (samples == 1) {
        memcpy(memory->earlier, memory->course, synchroniser->objective.matched * sizeof *memory->earlier);
    }
    if (is_readable) {
        tl_objective_matched(&synchroniser->objective, memory->course);
    } else {
        memcpy(memory->course, memory->best_course, size_of_course(synchroniser) * sizeof *memory->course);
    }
    if (samples > 1) {
        memcpy(memory->earlier, &memory->course[last - synchroniser->objective.matched],
               synchroniser->objective.matched * sizeof *memory->earlier);
    }
    synchroniser->courses = is_readable || u == memory->best ? synchroniser->courses + (synchroniser->courses < 2) : 0;
}

/* Start of the next step. */
static void remember_step(tl_synchroniser *synchroniser, const double *u, const tl_record *record) {
    tl_synchroniser_memory *memory = &synchroniser->memory;
    memmove(memory->committed, u, size_of_sequence(synchroniser));
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        memory->before[v] = record->u[v];
        synchroniser->last_delta[v] = record->u[v] - record->nominal[v];
    }
    synchroniser->has_last = true;
    remember_course(synchroniser, u);
    if (synchroniser->solver->committed != NULL) {
        synchroniser->solver->committed(synchroniser->optimiser, u);
    }
    if (synchroniser->fallback != NULL && synchroniser->fallback->committed != NULL) {
        synchroniser->fallback->committed(synchroniser->second, u);
    }
}

/* Commits u. If that fails although it did not as a candidate, or if nothing was tried, commits
 * nominal. */
static tl_status commit_found(tl_step_search *search, const double *u, tl_record *record) {
    tl_synchroniser *synchroniser = search->synchroniser;
    const double *nominal = synchroniser->memory.nominal;
    tl_status status = commit_step(search, u, record);
    if (status == TL_FMU_FAILED && !is_nominal(synchroniser, u)) {
        bool unsearched = record->outcome == TL_CAUGHT_UP || record->outcome == TL_RESUMED;
        record->outcome = unsearched ? record->outcome : TL_NOMINAL;
        record->objective = record->objective_nominal;
        u = nominal;
        status = commit_step(search, u, record);
    }
    if (status == TL_OK) {
        remember_step(synchroniser, u, record);
    }
    return status;
}

void tl_synchroniser_refresh(tl_synchroniser *synchroniser, int64_t step) {
    if (synchroniser->uses_newest_sample) {
        tl_plant *plant = &synchroniser->exchange->plant;
        tl_plant_deliver(plant, tl_plant_shown(plant, step, plant->newest));
        tl_exchange_deliver(synchroniser->exchange);
    }
}

/* A step of a twin that adjusts nothing. */
static tl_status step_free(tl_synchroniser *synchroniser, int64_t step, tl_outcome outcome, tl_record *record,
                           tl_error *error) {
    tl_synchroniser_refresh(synchroniser, step);
    tl_record_begin(record, step);
    record->outcome = outcome;
    tl_status status = tl_exchange_commit(synchroniser->exchange, step, error);
    if (status == TL_OK) {
        record_outputs(synchroniser, record);
        tl_ledger_commit(&synchroniser->ledger, NULL);
    }
    return status;
}

static void begin_time(tl_synchroniser *synchroniser, const tl_budget *budget) {
    tl_synchroniser_times *times = &synchroniser->times;
    tl_estimate *const parts[] = {&times->guessing, &times->within, &times->thinking, &times->committing};
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        if (times->refused) {
            tl_estimate_rest(parts[i]);
        }
        parts[i]->tried = false;
    }
    if (times->refused) {
        tl_costs_rest(&synchroniser->exchange->costs);
    }
    times->refused = false;
    times->beside = 0;
    tl_costs_begin(&synchroniser->exchange->costs, budget == NULL ? NULL : budget->now,
                   budget == NULL ? NULL : budget->context);
}

tl_time tl_synchroniser_end_step(tl_synchroniser *synchroniser, const tl_budget *budget) {
    tl_costs *costs = &synchroniser->exchange->costs;
    if (costs->now == NULL) {
        return budget->now(budget->context) - budget->started; /* nothing is searched */
    }
    take_time(synchroniser);
    tl_estimate_took(&synchroniser->times.committing, synchroniser->times.beside);
    return costs->read - budget->started;
}

/* Starts the step; then û is known. */
static tl_status begin_step(tl_step_search *search, tl_synchroniser *synchroniser, int64_t step,
                            const tl_budget *budget, tl_record *record, tl_error *error) {
    tl_synchroniser_refresh(synchroniser, step);
    tl_step_search_begin(search, synchroniser, step, budget, error);
    tl_record_begin(record, step);
    memcpy(record->nominal, search->nominal, synchroniser->horizon.variables * sizeof *record->nominal);
    if (!synchroniser->has_last) {
        memcpy(synchroniser->memory.before, search->nominal, synchroniser->horizon.variables * sizeof *record->nominal);
    }
    begin_time(synchroniser, budget);
    return tl_track_begin(synchroniser->track, error);
}

/* Whether time has prevented the evaluation of nominal: a repetition must know. The repetition has
 * no clock: its last candidate may end it by the tolerance. */
static bool is_without_nominal(const tl_step_search *search, tl_outcome outcome) {
    return isnan(search->nominal_value) &&
           (search->stop == TL_STOP_TIME || outcome == TL_NOMINAL || search->budget->without_nominal);
}

static double finite_or_nan(double value) {
    return isfinite(value) ? value : (double)NAN;
}

/* Clears the bit of a variable that is not committed at nominal: there was no budget to evaluate it
 * at nominal. */
static void forget_unheld(const tl_synchroniser *synchroniser, tl_record *record) {
    for (size_t v = 0; v < synchroniser->horizon.variables && record->held != 0; v++) {
        if (memcmp(&record->u[v], &record->nominal[v], sizeof record->u[v]) != 0) {
            record->held &= ~((uint32_t)1 << v);
        }
    }
}

/* After a search: which variables are identifiable. */
static void test_sensitivity(tl_synchroniser *synchroniser, int64_t step) {
    const tl_optimiser_class *solver = synchroniser->solver;
    const double *slope = solver->slope != NULL ? solver->slope(synchroniser->optimiser) : NULL;
    if (!solver->booleans) {
        tl_sensitivity_test(&synchroniser->sensitivity, step, slope, synchroniser->noise_floor);
    }
}

/* Not inlined: a step of a free twin needs no search on its stack. */
static tl_status __attribute__((noinline)) step_searched(tl_synchroniser *synchroniser, int64_t step,
                                                         const tl_budget *budget, tl_record *record, tl_error *error) {
    tl_step_search search;
    tl_status status = begin_step(&search, synchroniser, step, budget, record, error);
    if (status != TL_OK) {
        return status;
    }
    if (!tl_objective_prepare(&synchroniser->objective, step) || synchroniser->runs_free) {
        record->outcome = TL_FREE_RUN;
        return commit_found(&search, synchroniser->memory.nominal, record);
    }
    record->outcome = synchroniser->rests ? rest_at_nominal(&search) : find_correction(&search);
    test_sensitivity(synchroniser, step);
    if (search.guessed && search.evaluations == 0) {
        synchroniser->solver->retract(synchroniser->optimiser);
    }
    if (search.fatal != TL_OK) {
        return search.fatal;
    }
    record->stop = search.stop;
    record->flags = search.flags | (is_without_nominal(&search, record->outcome) ? TL_FLAG_WITHOUT_NOMINAL : 0U);
    record->held = search.held;
    if (search.has_finite || search.refused.by_output == 0) { /* else the output is not finite whatever u is */
        record->refused = search.refused;
    }
    record->flags |= record->refused.count != 0 ? (uint32_t)TL_FLAG_REFUSED : 0U;
    record->evaluations = search.evaluations;
    record->objective_nominal = finite_or_nan(search.nominal_value);
    record->objective = record->outcome == TL_NOMINAL ? record->objective_nominal : finite_or_nan(search.best_value);
    status = commit_found(
        &search, record->outcome == TL_NOMINAL ? synchroniser->memory.nominal : synchroniser->memory.best, record);
    forget_unheld(synchroniser, record);
    return status;
}

tl_status tl_synchroniser_step(tl_synchroniser *synchroniser, int64_t step, const tl_budget *budget, tl_record *record,
                               tl_error *error) {
    return synchroniser->horizon.variables == 0 ? step_free(synchroniser, step, TL_FREE, record, error)
                                                : step_searched(synchroniser, step, budget, record, error);
}

/* Nominal with the last Δu; of a Boolean, the last u. */
static void extrapolate(const tl_synchroniser *synchroniser, const double *nominal, double *values) {
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        const tl_adjusted *adjusted = &synchroniser->adjusted[v];
        values[v] = nominal[v];
        if (synchroniser->has_last && adjusted->is_boolean) {
            values[v] = synchroniser->memory.before[v];
        } else if (synchroniser->has_last && fabs(synchroniser->last_delta[v]) > 0.0) {
            values[v] = fmin(fmax(nominal[v] + synchroniser->last_delta[v], adjusted->lower), adjusted->upper);
        }
    }
}

/* One step without a search; u NULL: with the last Δu. */
static tl_status step_unsearched(tl_synchroniser *synchroniser, int64_t step, tl_outcome outcome, const double *u,
                                 tl_record *record, tl_error *error) {
    if (synchroniser->horizon.variables == 0) {
        return step_free(synchroniser, step, outcome, record, error);
    }
    tl_step_search search;
    tl_status status = begin_step(&search, synchroniser, step, NULL, record, error);
    if (status != TL_OK) {
        return status;
    }
    record->outcome = outcome;
    double values[TL_MAX_ADJUST];
    if (u == NULL) {
        extrapolate(synchroniser, search.nominal, values);
    }
    tl_horizon_hold(&synchroniser->horizon, u != NULL ? u : values, synchroniser->memory.guess);
    return commit_found(&search, synchroniser->memory.guess, record);
}

tl_status tl_synchroniser_catch_up(tl_synchroniser *synchroniser, int64_t step, tl_record *record, tl_error *error) {
    return step_unsearched(synchroniser, step, TL_CAUGHT_UP, NULL, record, error);
}

tl_status tl_synchroniser_follow(tl_synchroniser *synchroniser, int64_t step, const double *u, tl_record *record,
                                 tl_error *error) {
    return step_unsearched(synchroniser, step, TL_RESUMED, u, record, error);
}

static void forget_solver(const tl_optimiser_class *solver, tl_optimiser *optimiser) {
    if (optimiser != NULL && solver->forget != NULL) {
        solver->forget(optimiser);
    }
}

static void forget_courses(tl_synchroniser *synchroniser) {
    synchroniser->courses = 0;
    synchroniser->was_blind = false;
    synchroniser->has_taught_solver = false;
    if (synchroniser->optimiser != NULL && !synchroniser->solver->booleans) {
        tl_sensitivity_forget(&synchroniser->sensitivity);
    }
    forget_solver(synchroniser->solver, synchroniser->optimiser);
    forget_solver(synchroniser->fallback, synchroniser->second);
}

void tl_synchroniser_reset(tl_synchroniser *synchroniser) {
    synchroniser->has_last = false;
    forget_courses(synchroniser);
    tl_ledger_reset(&synchroniser->ledger);
}

void tl_synchroniser_forget_course(tl_synchroniser *synchroniser) {
    synchroniser->courses = 0;
    tl_ledger_reset(&synchroniser->ledger);
}

void tl_synchroniser_forget(tl_synchroniser *synchroniser) {
    forget_courses(synchroniser);
    tl_ledger_forget(&synchroniser->ledger);
}

/* u stays, so its distance from another nominal changes. */
static void move_nominal(tl_synchroniser *synchroniser, size_t variable, const tl_tuning_adjust *adjust) {
    double before = tl_exchange_nominal(synchroniser->exchange, variable);
    bool moves = adjust->has_nominal != 0 && (adjust->nominal < before || adjust->nominal > before);
    if (moves && synchroniser->has_last) {
        synchroniser->last_delta[variable] = synchroniser->memory.before[variable] - adjust->nominal;
    }
}

static void retune_solver(const tl_synchroniser *synchroniser, const tl_optimiser_class *solver,
                          tl_optimiser *optimiser) {
    if (solver != NULL && solver->retune != NULL) {
        solver->retune(optimiser, synchroniser->memory.factors);
    }
}

void tl_synchroniser_retune(tl_synchroniser *synchroniser, tl_objective_term *terms, const tl_tuning *tuning) {
    if (synchroniser->horizon.variables == 0) {
        return; /* nothing is searched */
    }
    tl_objective_retune(&synchroniser->objective, terms, tuning, synchroniser->memory.factors);
    synchroniser->space.residual_count = synchroniser->objective.residual_count;
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        if (!synchroniser->adjusted[v].is_boolean) {
            synchroniser->adjusted[v].lower = tuning->adjust[v].lower;
            synchroniser->adjusted[v].upper = tuning->adjust[v].upper;
        }
        move_nominal(synchroniser, v, &tuning->adjust[v]);
    }
    place_bounds(synchroniser);
    synchroniser->margin = tuning->margin;
    synchroniser->noise_floor = tuning->noise_floor;
    retune_solver(synchroniser, synchroniser->solver, synchroniser->optimiser);
    retune_solver(synchroniser, synchroniser->fallback, synchroniser->second);
}

void tl_synchroniser_archive(tl_synchroniser *synchroniser, tl_archive *archive) {
    const tl_objective *objective = &synchroniser->objective;
    tl_archive_flag(archive, &synchroniser->has_last);
    tl_archive_part(archive, synchroniser->memory.before, sizeof synchroniser->memory.before);
    tl_archive_part(archive, synchroniser->last_delta, sizeof synchroniser->last_delta);
    tl_archive_require_finite(archive, synchroniser->memory.before, TL_MAX_ADJUST);
    tl_archive_require_finite(archive, synchroniser->last_delta, TL_MAX_ADJUST);
    for (size_t i = 0; i < objective->matched; i++) {
        tl_noise_estimate_archive(&objective->noise_estimates[i], archive);
    }
}
