/* Start values that come from the plant: see start_values.h. */
#include <math.h>
#include <string.h>

#include "master/twin/twin_parts.h"

/* ---- build ---- */

/* Within the declared bounds, because a sensor's noise may lie outside. */
static void place_signal(const tl_copied_start *copied, double value) {
    const tl_variable *variable = copied->start->variable;
    double converted = copied->conversion.factor * value + copied->conversion.offset;
    copied->start->value.real = fmin(fmax(converted, variable->minimum), variable->maximum);
}

static void place_set(tl_twin *twin, const tl_plan *plan, size_t component, const tl_plan_set *set,
                      tl_start_value *start) {
    tl_report report = {0};
    tl_copied_start copied = {.start = start};
    const char *expected;
    start->variable = tl_model_variable(plan->components[component].model, set->variable);
    copied.signal = tl_graph_start_signal(&twin->graph, component, set, &copied.conversion, &report);
    if (copied.signal == SIZE_MAX) {
        (void)tl_graph_fit_value(start->variable, &set->value, &start->value, &expected);
        return;
    }
    start->value = start->variable->start;
    start->value.type = TL_REAL;
    if (plan->signals[copied.signal].has_initial) {
        place_signal(&copied, plan->signals[copied.signal].initial);
    }
    twin->starts.copied[twin->starts.copied_count++] = copied;
}

static tl_start_value *find_start(const tl_component *component, tl_start_value *starts, const tl_variable *variable) {
    size_t i = 0;
    while (i < component->start_count && starts[i].variable != variable) {
        i++;
    }
    return &starts[i];
}

/* The values of `set`, then those to be found that `set` does not have. */
static void place_found(tl_twin *twin, const tl_plan *plan, size_t component, tl_start_value *starts) {
    tl_component *own = &twin->graph.components[component];
    for (size_t i = 0; i < plan->find_count; i++) {
        tl_report report = {0};
        size_t node = 0;
        tl_found_start *found = &twin->starts.found[i];
        const tl_variable *variable = tl_graph_found_start(&twin->graph, &plan->find[i], &node, &report);
        if (node != component) {
            continue;
        }
        found->start = find_start(own, starts, variable);
        found->lower = fmax(plan->find[i].lower, variable->minimum);
        found->upper = fmin(plan->find[i].upper, variable->maximum);
        if (found->start == &starts[own->start_count]) {
            *found->start = (tl_start_value){.variable = variable, .value = variable->start};
            found->start->value.type = TL_REAL;
            own->start_count++;
        }
        if (!variable->has_start) {
            found->start->value.real = (found->lower + found->upper) / 2;
        }
        found->guess = found->start->value.real;
    }
}

bool tl_start_values_place(tl_twin *twin, const tl_plan *plan, size_t component) {
    const tl_plan_component *description = &plan->components[component];
    tl_component *own = &twin->graph.components[component];
    tl_start_value *starts = tl_arena_take(&twin->arena, description->set_count + plan->find_count, sizeof *starts);
    if (starts == NULL) {
        return false;
    }
    for (size_t i = 0; i < description->set_count; i++) {
        place_set(twin, plan, component, &description->set[i], &starts[i]);
    }
    own->starts = starts;
    own->start_count = description->set_count;
    place_found(twin, plan, component, starts);
    return true;
}

static double *take(tl_twin *twin, size_t count, bool *placed) {
    double *values = tl_arena_take(&twin->arena, count, sizeof *values);
    *placed = *placed && values != NULL;
    return values;
}

bool tl_start_values_create(tl_twin *twin, const tl_plan *plan) {
    tl_start_values *starts = &twin->starts;
    size_t sets = 0;
    bool placed = true;
    for (size_t i = 0; i < plan->component_count; i++) {
        sets += plan->components[i].set_count;
    }
    starts->copied = tl_arena_take(&twin->arena, sets, sizeof *starts->copied);
    for (size_t i = 0; i < plan->match_count; i++) {
        starts->terms += plan->match[i].weight > 0.0 ? 1 : 0;
    }
    starts->found_count = plan->find_count;
    starts->steps = plan->find_steps;
    if (plan->find_count != 0) {
        size_t residuals = starts->steps * starts->terms;
        starts->plant = take(twin, (starts->steps + 1) * plan->signal_count, &placed);
        starts->measured = take(twin, residuals, &placed);
        starts->best = take(twin, residuals, &placed);
        starts->tried = take(twin, residuals, &placed);
        starts->slopes = take(twin, residuals * plan->find_count, &placed);
    }
    starts->executions = tl_arena_take(&twin->arena, plan->component_count, sizeof *starts->executions);
    return placed && starts->copied != NULL && starts->executions != NULL;
}

/* ---- ticks ---- */

static bool is_good(const tl_sample *sample, size_t signal) {
    return sample->quality[signal] == TL_GOOD;
}

static void keep_plant(tl_twin *twin, const tl_sample *sample, size_t row) {
    size_t signals = twin->exchange.plant.signal_count;
    memcpy(twin->starts.plant + row * signals, sample->values, signals * sizeof *twin->starts.plant);
}

tl_status tl_start_values_begin(tl_twin *twin, int64_t step, const tl_sample *sample, bool sets, tl_error *error) {
    tl_start_values *starts = &twin->starts;
    tl_status status = TL_OK;
    starts->waits = false;
    for (size_t i = 0; i < starts->found_count; i++) {
        starts->found[i].start->value.real = starts->found[i].guess;
    }
    for (size_t i = 0; i < starts->copied_count; i++) {
        tl_copied_start *copied = &starts->copied[i];
        copied->is_known = copied->is_known || is_good(sample, copied->signal);
        starts->waits = starts->waits || !copied->is_known;
        if (copied->is_known) {
            place_signal(copied, sample->values[copied->signal]);
        }
    }
    starts->searches = starts->found_count != 0;
    starts->first = step;
    starts->kept = 0;
    if (starts->searches) {
        keep_plant(twin, sample, 0);
    }
    for (size_t i = 0; i < twin->graph.component_count && sets && starts->copied_count != 0 && status == TL_OK; i++) {
        status = tl_component_set_starts(&twin->graph.components[i], error);
    }
    return status;
}

void tl_start_values_loaded(tl_twin *twin, bool waits) {
    twin->starts.searches = false;
    twin->starts.waits = waits;
    for (size_t i = 0; i < twin->starts.copied_count; i++) {
        twin->starts.copied[i].is_known = twin->starts.copied[i].is_known || !waits;
    }
}

/* The step that ended at t_step. */
static void keep_step(tl_twin *twin, int64_t step, const tl_sample *sample) {
    tl_start_values *starts = &twin->starts;
    const tl_objective *objective = &twin->synchroniser.objective;
    double *measured = starts->measured + starts->kept * starts->terms;
    for (size_t i = 0; i < objective->term_count; i++) {
        tl_quality quality;
        if (twin->terms[i].weight > 0.0) {
            double value = tl_objective_measured(objective, i, step, &quality);
            *measured++ = quality == TL_GOOD ? value : (double)NAN;
        }
    }
    keep_plant(twin, sample, ++starts->kept);
}

tl_start_due tl_start_values_look(tl_twin *twin, int64_t step) {
    tl_start_values *starts = &twin->starts;
    const tl_plant *plant = &twin->exchange.plant;
    const tl_sample *sample = tl_plant_sample(plant, tl_plant_shown(plant, step, plant->newest));
    bool all = true;
    for (size_t i = 0; i < starts->copied_count; i++) {
        starts->copied[i].is_known = starts->copied[i].is_known || is_good(sample, starts->copied[i].signal);
        all = all && starts->copied[i].is_known;
    }
    if (starts->waits) {
        return all ? TL_START_AGAIN : TL_START_NOTHING;
    }
    if (step > starts->first) {
        keep_step(twin, step, sample);
    }
    return starts->kept == starts->steps ? TL_START_FIND : TL_START_NOTHING;
}

/* ---- search ---- */

/* Evaluates the residuals with these values: the FMUs start again, and execute all steps. *sum:
 * HUGE_VAL if an FMU rejects the values, or if an output is not finite. */
static tl_status evaluate(tl_twin *twin, const double *values, double *residuals, double *sum, tl_error *error) {
    tl_start_values *starts = &twin->starts;
    size_t signals = twin->exchange.plant.signal_count;
    for (size_t i = 0; i < starts->found_count; i++) {
        starts->found[i].start->value.real = values[i];
    }
    *sum = 0.0;
    tl_status status = tl_twin_restart(twin, starts->first, starts->plant, error);
    for (size_t k = 0; k < starts->steps && status == TL_OK; k++) {
        for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
            tl_exchange_set_adjusted(&twin->exchange, v, tl_exchange_nominal(&twin->exchange, v));
        }
        status = tl_exchange_step_with(&twin->exchange, starts->first + (int64_t)k, starts->plant + (k + 1) * signals,
                                       error);
        for (size_t i = 0, term = 0; i < twin->synchroniser.objective.term_count; i++) {
            if (twin->terms[i].weight > 0.0) {
                size_t at = k * starts->terms + term++;
                double difference = tl_objective_y(&twin->synchroniser.objective, i) - starts->measured[at];
                residuals[at] = isnan(starts->measured[at])
                                    ? 0.0
                                    : sqrt(twin->terms[i].weight) * difference / twin->terms[i].tolerance;
                *sum += residuals[at] * residuals[at];
            }
        }
    }
    *sum = status == TL_OK && isfinite(*sum) ? *sum : HUGE_VAL;
    return status == TL_FMU_FATAL ? status : TL_OK;
}

typedef struct value_search {
    double values[TL_MAX_ADJUST];
    double sum;                                    /* of the squares of starts->best */
    double products[TL_MAX_ADJUST][TL_MAX_ADJUST]; /* of the slopes */
    double gradient[TL_MAX_ADJUST];
    double damping;
    uint32_t evaluations;
} value_search;

/* Change of the residuals if one value changes by its range. */
static tl_status find_slope(tl_twin *twin, value_search *search, size_t v, tl_error *error) {
    static const double PART = 1e-3; /* of the range: an FMU's own solver has errors below it */
    tl_start_values *starts = &twin->starts;
    const tl_found_start *found = &starts->found[v];
    size_t count = starts->steps * starts->terms;
    double range = found->upper - found->lower;
    double values[TL_MAX_ADJUST];
    double sum = 0.0;
    double *slope = starts->slopes + v * count;
    memcpy(values, search->values, sizeof values);
    values[v] += values[v] + PART * range <= found->upper ? PART * range : -PART * range;
    double part = (values[v] - search->values[v]) / range;
    tl_status status = evaluate(twin, values, slope, &sum, error);
    search->evaluations++;
    for (size_t i = 0; i < count; i++) {
        slope[i] = sum < HUGE_VAL ? (slope[i] - starts->best[i]) / part : 0.0;
    }
    return status;
}

static tl_status find_slopes(tl_twin *twin, value_search *search, tl_error *error) {
    const tl_start_values *starts = &twin->starts;
    size_t count = starts->steps * starts->terms;
    tl_status status = TL_OK;
    for (size_t v = 0; v < starts->found_count && status == TL_OK; v++) {
        const double *own = starts->slopes + v * count;
        status = find_slope(twin, search, v, error);
        search->gradient[v] = 0.0;
        for (size_t i = 0; i < count; i++) {
            search->gradient[v] += own[i] * starts->best[i];
        }
        for (size_t w = 0; w <= v; w++) {
            const double *other = starts->slopes + w * count;
            double product = 0.0;
            for (size_t i = 0; i < count; i++) {
                product += own[i] * other[i];
            }
            search->products[v][w] = product;
            search->products[w][v] = product;
        }
    }
    return status;
}

/* The damped step in parts of the ranges, by Cholesky's decomposition. A value without any effect
 * stays. */
static void solve(const value_search *search, size_t count, double *step) {
    double root[TL_MAX_ADJUST][TL_MAX_ADJUST] = {{0}};
    for (size_t v = 0; v < count; v++) {
        for (size_t w = 0; w <= v; w++) {
            bool has_effect = search->products[v][v] > 0.0;
            double rest =
                v == w ? (has_effect ? search->products[v][v] * (1.0 + search->damping) : 1.0) : search->products[v][w];
            for (size_t k = 0; k < w; k++) {
                rest -= root[v][k] * root[w][k];
            }
            root[v][w] = v == w ? sqrt(fmax(rest, 1e-300)) : rest / root[w][w];
        }
        step[v] = -search->gradient[v];
        for (size_t k = 0; k < v; k++) {
            step[v] -= root[v][k] * step[k];
        }
        step[v] /= root[v][v];
    }
    for (size_t v = count; v-- > 0;) {
        for (size_t k = v + 1; k < count; k++) {
            step[v] -= root[k][v] * step[k];
        }
        step[v] /= root[v][v];
    }
}

/* Tries one step. *moved: the largest change in parts of the ranges if it is better; else 0. */
static tl_status try_step(tl_twin *twin, value_search *search, double *moved, tl_error *error) {
    tl_start_values *starts = &twin->starts;
    double step[TL_MAX_ADJUST];
    double values[TL_MAX_ADJUST];
    double sum = 0.0;
    *moved = 0.0;
    solve(search, starts->found_count, step);
    double largest = 0.0;
    for (size_t v = 0; v < starts->found_count; v++) {
        const tl_found_start *found = &starts->found[v];
        double range = found->upper - found->lower;
        values[v] = fmin(fmax(search->values[v] + step[v] * range, found->lower), found->upper);
        largest = fmax(largest, fabs(values[v] - search->values[v]) / range);
    }
    tl_status status = evaluate(twin, values, starts->tried, &sum, error);
    search->evaluations++;
    search->damping *= sum < search->sum ? 0.1 : 10.0;
    if (status == TL_OK && sum < search->sum) {
        double *best = starts->best;
        starts->best = starts->tried;
        starts->tried = best;
        memcpy(search->values, values, sizeof values);
        search->sum = sum;
        *moved = largest;
    }
    return status;
}

static tl_status improve(tl_twin *twin, value_search *search, tl_error *error) {
    static const double STILL = 1e-4; /* parts of the range */
    tl_status status = TL_OK;
    for (size_t round = 0; round < TL_FIND_ROUNDS && status == TL_OK; round++) {
        double moved = 0.0;
        status = find_slopes(twin, search, error);
        for (size_t i = 0; i < TL_FIND_TRIES && moved <= 0.0 && status == TL_OK; i++) {
            status = try_step(twin, search, &moved, error);
        }
        if (moved < STILL) {
            break;
        }
    }
    return status;
}

static double rms_of(const tl_start_values *starts, double sum) {
    size_t count = 0;
    for (size_t i = 0; i < starts->steps * starts->terms; i++) {
        count += isnan(starts->measured[i]) ? 0 : 1;
    }
    return sqrt(sum / (double)count); /* NaN: nothing was measured */
}

static tl_status find(tl_twin *twin, int64_t step, tl_record_found *found, tl_error *error) {
    tl_start_values *starts = &twin->starts;
    value_search search = {.damping = 1e-3};
    starts->searches = false;
    for (size_t v = 0; v < starts->found_count; v++) {
        const tl_found_start *one = &starts->found[v];
        search.values[v] = fmin(fmax(one->start->value.real, one->lower), one->upper);
    }
    tl_status status = evaluate(twin, search.values, starts->best, &search.sum, error);
    search.evaluations = 1;
    found->before = rms_of(starts, search.sum);
    status = status == TL_OK && search.sum < HUGE_VAL ? improve(twin, &search, error) : status;
    double sum = 0.0;
    status = status == TL_OK ? evaluate(twin, search.values, starts->best, &sum, error) : status;
    found->evaluations = search.evaluations + 1;
    found->after = rms_of(starts, sum);
    memcpy(found->values, search.values, sizeof found->values);
    if (status == TL_OK && !(sum < HUGE_VAL)) { /* an FMU fails with all of them */
        status = tl_twin_restart(twin, step, starts->plant + starts->steps * twin->exchange.plant.signal_count, error);
    }
    return status;
}

tl_status tl_start_values_find(tl_twin *twin, int64_t step, tl_record_found *found, tl_error *error) {
    tl_component *components = twin->graph.components;
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        twin->starts.executions[i] = components[i].executions;
    }
    tl_status status = find(twin, step, found, error);
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        components[i].executions = twin->starts.executions[i];
    }
    return status;
}
