/* Step search: see step_search.h. */
#include "master/sync/step_search.h"

#include <math.h>
#include <string.h>

#include "master/base/estimate.h"

/* A reduction of J by at least this part is progress. */
static const double PROGRESS = 0.01;

/* In first steps of the search. */
static const double LEAST_MOVE = 1e-9;

/* Evaluations without progress after which a solver that asks outside of its bounds is stopped. */
enum { MOST_IDLE = 1000 };

static void read_nominal(const tl_synchroniser *synchroniser, double *nominal) {
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        nominal[v] = tl_exchange_nominal(synchroniser->exchange, v);
    }
}

void tl_step_search_begin(tl_step_search *search, tl_synchroniser *synchroniser, int64_t step, const tl_budget *budget,
                          tl_error *error) {
    search->synchroniser = synchroniser;
    search->step = step;
    search->budget = budget;
    search->limit = budget == NULL ? 0 : budget->evaluations;
    search->evaluations = 0;
    search->dirty = false;
    search->back = TL_OK;
    search->walked = false;
    search->closing = false;
    search->guessed = false;
    search->late = false;
    search->nominal_follows = false;
    search->stop = TL_STOP_NONE;
    search->flags = 0;
    search->held = 0;
    search->moved_output = 0;
    search->refused = (tl_record_refused){0};
    search->has_finite = false;
    search->idle = 0;
    search->stagnated = false;
    search->acquaints = false;
    search->start_value = HUGE_VAL;
    search->best_value = HUGE_VAL;
    search->nominal_value = (double)NAN;
    search->fatal = TL_OK;
    search->error = error;
    read_nominal(synchroniser, search->nominal);
    tl_horizon_hold(&synchroniser->horizon, search->nominal, synchroniser->memory.nominal);
    if (synchroniser->solver->rest != NULL) {
        synchroniser->solver->rest(synchroniser->optimiser, synchroniser->memory.nominal);
    }
}

void tl_step_search_set_inputs(const tl_synchroniser *synchroniser, const double *u, uint32_t depth) {
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        tl_exchange_set_adjusted(synchroniser->exchange, v, tl_horizon_value(&synchroniser->horizon, u, v, depth));
    }
}

/* ---- time ---- */

tl_status tl_step_search_go_back(tl_step_search *search) {
    if (search->dirty) {
        search->back = tl_track_rewind(search->synchroniser->track, search->error);
        search->dirty = false;
    }
    return search->back;
}

/* Adds what a candidate executes from macro step `from` to `until`: a component, or all of them.
 * TL_COST_FEW executions count with the longest recent duration, as in tl_cost_of(): the last ones.
 * Until the sums are taken, `rest` has the differences from one macro step to the next. */
static void add_executions(tl_step_search *search, const tl_cost *cost, uint32_t from, uint32_t until) {
    tl_time *rest = search->synchroniser->rest;
    tl_time mean = (tl_time)cost->mean;
    tl_time nominal = search->nominal_follows ? (tl_time)until : 0;
    bool shares = nominal > 0 && search->synchroniser->exchange->cached != NULL;
    uint32_t last = until > TL_COST_FEW ? until - TL_COST_FEW : 0;
    search->reserved += tl_cost_of(cost, shares ? nominal : nominal + 1);
    if (from < until) {
        rest[from] += mean;
        rest[last > from ? last : from] += cost->most - mean;
        rest[until] -= cost->most;
    }
}

/* Predicts the cost of all macro steps of a candidate from the graph. After the first candidate of
 * a step, a component executes only steps that a variable can have reached. Also predicts the cost
 * to reserve: of the committed step, and of nominal if it is still to be evaluated. The committed
 * step is the first step of a candidate. */
static void predict_costs(tl_step_search *search) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_exchange *exchange = synchroniser->exchange;
    tl_time *rest = synchroniser->rest;
    uint32_t steps = synchroniser->horizon.prediction;
    memset(rest, 0, (steps + 1) * sizeof *rest);
    search->reserved = 0;
    if (exchange->whole) {
        add_executions(search, &exchange->costs.all, 0, steps);
    }
    for (size_t k = 0; k < exchange->component_count && !exchange->whole; k++) {
        uint32_t until = exchange->reach != NULL ? exchange->reach[k] : steps;
        bool reuses = search->walked && exchange->cached != NULL && exchange->cached[k].keep != TL_KEEP_NONE;
        add_executions(search, &exchange->costs.each[k], reuses ? synchroniser->horizon.nearest[k] : 0, until);
    }
    for (uint32_t depth = 1; depth < steps; depth++) {
        rest[depth] += rest[depth - 1];
    }
    rest[steps] = 0;
    for (uint32_t depth = steps; depth-- > 0;) {
        rest[depth] += rest[depth + 1];
    }
}

/* Time to reserve after the present candidate. */
static tl_time reserved_time(const tl_step_search *search) {
    const tl_synchroniser_times *times = &search->synchroniser->times;
    return times->committing.most + (search->nominal_follows ? times->within.most : 0) + search->reserved;
}

/* True if `wanted` and the reserved time fit into the budget, by the last clock reading. */
static bool has_time(tl_step_search *search, tl_time wanted) {
    const tl_budget *budget = search->budget;
    tl_time elapsed = tl_duration(budget->started, search->synchroniser->exchange->costs.read);
    if (elapsed + wanted + reserved_time(search) <= budget->time) {
        return true;
    }
    search->stop = TL_STOP_TIME;
    search->synchroniser->times.refused = true;
    return false;
}

/* True if the rest of the candidate from `depth` on, and the reserved time, fit into the budget. */
static bool has_time_for_rest(tl_step_search *search, uint32_t depth) {
    const tl_synchroniser_times *times = &search->synchroniser->times;
    tl_time within = times->within.most > times->beside ? times->within.most - times->beside : 0;
    return has_time(search, search->synchroniser->rest[depth] + within + (search->closing ? 0 : times->thinking.most));
}

/* Ends the current part of the step; NULL: a part that is not predicted. */
static void end_part(tl_step_search *search, tl_estimate *part) {
    tl_synchroniser *synchroniser = search->synchroniser;
    tl_time took = synchroniser->times.beside + tl_costs_lap(&synchroniser->exchange->costs);
    if (part != NULL) {
        tl_estimate_took(part, took);
    }
    synchroniser->times.beside = 0;
}

static void check_nominal_follows(tl_step_search *search, const double *u) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    search->nominal_follows = isnan(search->nominal_value) &&
                              memcmp(u, synchroniser->memory.nominal, synchroniser->horizon.count * sizeof *u) != 0;
}

/* An evaluation starts, under the clock. */
static bool is_in_time(tl_step_search *search) {
    (void)tl_step_search_go_back(search);
    end_part(search, search->walked ? &search->synchroniser->times.thinking : NULL);
    predict_costs(search);
    return has_time_for_rest(search, 0);
}

bool tl_step_search_may_guess(tl_step_search *search) {
    if (search->budget->now != NULL) {
        end_part(search, NULL);
        predict_costs(search);
        search->guessed = has_time(search, search->synchroniser->times.guessing.most);
    } else {
        search->guessed = true;
    }
    return search->guessed;
}

void tl_step_search_end_guess(tl_step_search *search) {
    if (search->budget->now != NULL) {
        end_part(search, &search->synchroniser->times.guessing);
    }
}

/* True if u is nominal, and an evaluation beyond the limit is reserved for nominal. */
static bool is_nominal_due(const tl_step_search *search, const double *u) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    return search->evaluations < search->budget->evaluations && isnan(search->nominal_value) &&
           memcmp(u, synchroniser->memory.nominal, synchroniser->horizon.count * sizeof *u) == 0;
}

bool tl_step_search_may_evaluate(tl_step_search *search, const double *u) {
    if (search->evaluations >= search->limit && !is_nominal_due(search, u)) {
        search->stop = search->budget->repeated ? TL_STOP_TIME : TL_STOP_EVALUATIONS;
        return false;
    }
    check_nominal_follows(search, u);
    return search->budget->now == NULL || is_in_time(search);
}

/* ---- one candidate ---- */

/* Ends a macro step under the clock. If it took 1.5 times as long as predicted, predicts the costs
 * again. */
static void end_macro_step(tl_step_search *search, uint32_t depth) {
    const tl_time *rest = search->synchroniser->rest;
    tl_costs *costs = &search->synchroniser->exchange->costs;
    tl_time before = costs->read - costs->measured_time;
    tl_time beside = tl_costs_lap(costs);
    search->synchroniser->times.beside += beside;
    if (2 * (costs->read - before - beside) > 3 * (rest[depth - 1] - rest[depth])) {
        predict_costs(search);
    }
}

/* Whether a candidate should be aborted at `depth`. */
static bool is_late(tl_step_search *search, uint32_t depth) {
    if (depth == 0 || search->budget->now == NULL) {
        return false;
    }
    end_macro_step(search, depth);
    search->late = !has_time_for_rest(search, depth);
    return search->late;
}

/* Simulates u over the horizon; its sum of squares so far in *sum. Ends early if an FMU fails or
 * time runs out. */
static tl_status simulate_horizon(tl_step_search *search, const double *u, double *sum) {
    tl_synchroniser *synchroniser = search->synchroniser;
    const tl_horizon *horizon = &synchroniser->horizon;
    tl_exchange *exchange = synchroniser->exchange;
    tl_status status = TL_OK;
    uint32_t depth = 0;
    while (depth < horizon->prediction && !is_late(search, depth)) {
        if (depth < horizon->longest || exchange->cached != NULL) {
            tl_step_search_set_inputs(synchroniser, u, depth);
        }
        status = tl_track_try(synchroniser->track, search->step + depth, depth, search->error);
        if (status != TL_OK) {
            break;
        }
        depth++;
        if (depth >= horizon->distance) {
            *sum += tl_objective_at(&synchroniser->objective, depth, synchroniser->memory.residuals,
                                    synchroniser->memory.candidate_course);
        }
    }
    tl_ledger_walked(&synchroniser->ledger, u, depth, status == TL_OK ? SIZE_MAX : exchange->failed);
    return status;
}

/* Counts a candidate that could not be evaluated. The first one is described by the unknown that is
 * furthest from nominal. */
static void note_refused(tl_step_search *search, const double *u, bool by_output, size_t index) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_horizon *horizon = &synchroniser->horizon;
    tl_record_refused *refused = &search->refused;
    double furthest = -1.0;
    if (refused->count++ != 0) {
        return;
    }
    refused->by_output = by_output ? 1 : 0;
    refused->index = (uint32_t)index;
    for (size_t v = 0; v < horizon->variables; v++) {
        for (size_t i = horizon->offset[v]; i < horizon->offset[v] + horizon->length[v]; i++) {
            double distance = fabs(u[i] - search->nominal[v]) / synchroniser->adjusted[v].step;
            if (distance > furthest) {
                furthest = distance;
                refused->variable = (uint32_t)v;
                refused->u = u[i];
            }
        }
    }
}

/* Returns J of a candidate whose J was not finite. If an output is not finite at nominal and at
 * every candidate before it, u is not the cause. Then J leaves the output out in this step, if
 * there are others. Otherwise this u is refused: HUGE_VAL. */
static double use_finite(tl_step_search *search, const double *u, bool nominal, double penalties) {
    tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    size_t bad = tl_objective_find_bad(&synchroniser->objective, memory->candidate_course);
    if (bad == SIZE_MAX) {
        return HUGE_VAL;
    }
    double value = HUGE_VAL;
    if (nominal && !search->has_finite) {
        value =
            penalties + tl_objective_leave_out(&synchroniser->objective, memory->candidate_course, memory->residuals);
    }
    if (!isfinite(value)) {
        note_refused(search, u, true, bad);
    } else if (search->refused.by_output != 0) {
        search->refused = (tl_record_refused){0};
    }
    return value;
}

/* J of u, or HUGE_VAL if an FMU fails, a result is not finite, or time runs out. */
static double simulate(tl_step_search *search, const double *u, bool nominal) {
    tl_synchroniser *synchroniser = search->synchroniser;
    tl_status status = tl_step_search_go_back(search);
    search->dirty = true;
    double penalties = tl_objective_penalise(&synchroniser->objective, u, search->nominal, synchroniser->memory.before,
                                             synchroniser->memory.residuals);
    double sum = penalties;
    status = status == TL_OK ? simulate_horizon(search, u, &sum) : status;
    if (status == TL_FMU_FATAL) {
        search->fatal = status;
    }
    if (status == TL_FMU_FAILED) {
        note_refused(search, u, false, synchroniser->exchange->failed);
    }
    if (status != TL_OK || search->late) {
        return HUGE_VAL;
    }
    sum = isfinite(sum) ? sum : use_finite(search, u, nominal, penalties);
    search->has_finite = search->has_finite || isfinite(sum);
    return sum;
}

/* The same with a clock: measures the overhead of an evaluation beside its executions. */
static double simulate_measured(tl_step_search *search, const double *u, bool nominal) {
    double value = simulate(search, u, nominal);
    end_part(search, &search->synchroniser->times.within);
    search->walked = true;
    return value;
}

static void keep_best(tl_step_search *search, const double *u, double value) {
    tl_synchroniser *synchroniser = search->synchroniser;
    search->idle = value < search->best_value * (1.0 - PROGRESS) ? 0 : search->idle + 1;
    if (value < search->best_value) {
        search->best_value = value;
        memcpy(synchroniser->memory.best, u, synchroniser->horizon.count * sizeof *u);
        memcpy(synchroniser->memory.best_residuals, synchroniser->memory.residuals,
               synchroniser->objective.residual_count * sizeof *synchroniser->memory.residuals);
        memcpy(synchroniser->memory.best_course, synchroniser->memory.candidate_course,
               tl_objective_samples(&synchroniser->objective) * synchroniser->objective.matched *
                   sizeof *synchroniser->memory.best_course);
    }
}

/* Evaluates J of u and counts the evaluation. A late candidate gives HUGE_VAL and is not counted,
 * because a repetition without a clock does not evaluate it either. The first evaluation of nominal
 * is noted, also if a solver asked for it. */
static double evaluate(tl_step_search *search, const double *u) {
    bool nominal = isnan(search->nominal_value) && !search->nominal_follows;
    double value = search->budget->now == NULL ? simulate(search, u, nominal) : simulate_measured(search, u, nominal);
    if (search->late) {
        return HUGE_VAL;
    }
    search->evaluations++;
    if (nominal) {
        search->nominal_value = value;
        search->limit = search->budget->evaluations;
    }
    return value;
}

double tl_step_search_evaluate(tl_step_search *search, const double *u) {
    double value = evaluate(search, u);
    if (!search->late) {
        keep_best(search, u, value);
    }
    return value;
}

/* ---- identifiability ---- */

/* The one variable in which u differs from another point by a significant move, in steps; else
 * SIZE_MAX. */
static size_t moved_variable(const tl_step_search *search, const double *u, const double *from, double *move) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    size_t moved = SIZE_MAX;
    *move = 0.0;
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        double largest = 0.0;
        for (size_t i = synchroniser->horizon.offset[v];
             i < synchroniser->horizon.offset[v] + synchroniser->horizon.length[v]; i++) {
            largest = fmax(largest, fabs(u[i] - from[i]) / synchroniser->adjusted[v].step);
        }
        if (largest > 0.0 && moved != SIZE_MAX) {
            return SIZE_MAX;
        }
        moved = largest > 0.0 ? v : moved;
        *move = fmax(*move, largest);
    }
    return *move >= TL_SIGNIFICANT_MOVE ? moved : SIZE_MAX;
}

/* Whether this candidate shows, compared with a point with these residuals, that a variable has an
 * effect or not. */
static void probe_beside(tl_step_search *search, const double *u, const double *from, const double *residuals) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    double move = 0.0;
    size_t variable = moved_variable(search, u, from, &move);
    if (synchroniser->solver->slope == NULL) {
        tl_sensitivity_probe(&search->synchroniser->sensitivity, search->step, u, from, synchroniser->memory.residuals,
                             residuals);
    }
    if (variable == SIZE_MAX) {
        return;
    }
    double change = tl_objective_change(&synchroniser->objective, synchroniser->memory.residuals, residuals);
    uint32_t bit = (uint32_t)1 << variable;
    if (change >= synchroniser->noise_floor * move) {
        search->moved_output |= bit;
    } else if ((search->moved_output & bit) == 0) {
        search->held |= bit;
    }
}

/* The same compared with the search's start and with the best so far: solvers vary one unknown
 * after the other from either. */
static void probe_effect(tl_step_search *search, const double *u, double value) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    const tl_synchroniser_memory *memory = &synchroniser->memory;
    if (!(synchroniser->noise_floor > 0.0) || !isfinite(value) || synchroniser->solver->booleans) {
        return;
    }
    if (isfinite(search->start_value)) {
        probe_beside(search, u, memory->start, memory->start_residuals);
    }
    if (isfinite(search->best_value)) {
        probe_beside(search, u, memory->best, memory->best_residuals);
    }
}

/* Keeps the candidate if it is the best one. A candidate that has just shown that a variable has no
 * effect is not kept, because it moved that variable. */
static void keep_evaluated(tl_step_search *search, const double *u, double value) {
    uint32_t before = search->held;
    probe_effect(search, u, value);
    keep_best(search, u, search->held == before ? value : HUGE_VAL);
}

bool tl_step_search_is_blind(const tl_step_search *search) {
    return search->held != 0 && search->held == ((uint32_t)1 << search->synchroniser->horizon.variables) - 1;
}

void tl_step_search_hold(const tl_step_search *search, double *u) {
    const tl_horizon *horizon = &search->synchroniser->horizon;
    for (size_t v = 0; v < horizon->variables; v++) {
        if ((search->held >> v & 1U) != 0) {
            for (uint32_t m = 0; m < horizon->length[v]; m++) {
                u[horizon->offset[v] + m] = search->nominal[v];
            }
        }
    }
}

/* ---- evaluations ---- */

/* Values that a solver may get at all: finite numbers for points within the bounds. */
static bool is_valid_point(const tl_synchroniser *synchroniser, const double *u) {
    for (size_t i = 0; i < synchroniser->horizon.count; i++) {
        if (!(u[i] >= synchroniser->space.lower[i] && u[i] <= synchroniser->space.upper[i] && isfinite(u[i]))) {
            return false;
        }
    }
    return true;
}

/* The point that is evaluated for a requested one: variables that are not identifiable are at
 * nominal, and so are insignificant differences from it. (Rounding would hide such a difference in
 * the outputs, but it would cost executions.) */
static const double *evaluated_point(const tl_step_search *search, const double *u) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    double *evaluated_u = synchroniser->memory.evaluated_u;
    const double *nominal = synchroniser->memory.nominal;
    for (size_t i = 0; i < synchroniser->horizon.count; i++) {
        evaluated_u[i] = fabs(u[i] - nominal[i]) <= LEAST_MOVE * synchroniser->space.step[i] ? nominal[i] : u[i];
    }
    tl_step_search_hold(search, evaluated_u);
    return evaluated_u;
}

static bool is_finished(const tl_step_search *search) {
    bool acquaints = search->acquaints && search->synchroniser->solver->is_new(search->synchroniser->optimiser);
    return search->fatal != TL_OK || search->late || (search->best_value < TL_OBJECTIVE_TOLERANCE && !acquaints) ||
           search->stagnated || tl_step_search_is_blind(search);
}

/* After an evaluation: whether the solver may continue. */
static bool may_continue(tl_step_search *search) {
    const tl_synchroniser *synchroniser = search->synchroniser;
    if (search->best_value < TL_OBJECTIVE_TOLERANCE) {
        search->stop = TL_STOP_TOLERANCE;
    }
    if (synchroniser->stagnation != 0 && search->idle >= synchroniser->stagnation) {
        search->stagnated = true;
        search->flags |= TL_FLAG_STAGNATED;
    }
    return !is_finished(search);
}

bool tl_step_search_ask(void *context, const double *u, double *value, const double **residuals) {
    tl_step_search *search = context;
    tl_synchroniser *synchroniser = search->synchroniser;
    if (residuals != NULL) {
        *residuals = synchroniser->memory.residuals;
    }
    *value = HUGE_VAL;
    if (is_finished(search)) {
        return false;
    }
    if (!is_valid_point(synchroniser, u)) {
        search->idle++;
        return may_continue(search) && search->idle < MOST_IDLE;
    }
    u = evaluated_point(search, u);
    if (!tl_step_search_may_evaluate(search, u)) {
        return false;
    }
    *value = evaluate(search, u);
    if (!search->late) {
        keep_evaluated(search, u, *value);
    }
    return may_continue(search);
}
