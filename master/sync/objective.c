/* Objective: see objective.h. */
#include "master/sync/objective.h"

#include <math.h>

static bool has_weight(const tl_objective_term *term) {
    return term->weight > 0.0;
}

size_t tl_objective_samples(const tl_objective *objective) {
    return objective->horizon->prediction - objective->horizon->distance + 1;
}

/* Sets what is constant over steps. */
static void place_target(const tl_objective *objective, const tl_objective_term *term, tl_objective_target *target) {
    if (term->port->type == TL_REAL) {
        target->real = tl_exchange_output(objective->exchange, term->port);
    } else {
        target->integer = tl_exchange_output(objective->exchange, term->port);
    }
    target->root_weight = sqrt(term->weight);
    target->huber = term->huber > 0.0 ? term->huber : HUGE_VAL;
}

static void place_targets(tl_objective *objective) {
    tl_objective_target *target = objective->targets;
    for (size_t sample = 0; sample < tl_objective_samples(objective); sample++) {
        for (size_t i = 0; i < objective->term_count; i++) {
            if (has_weight(&objective->terms[i])) {
                place_target(objective, &objective->terms[i], target++);
            }
        }
    }
}

/* Whether there are penalties, and the number of residuals. */
static void count_residuals(tl_objective *objective) {
    size_t count = tl_objective_samples(objective) * objective->matched + objective->damping_count;
    objective->penalised = false;
    for (size_t v = 0; v < objective->horizon->variables; v++) {
        const tl_objective_penalty *penalty = &objective->penalties[v];
        objective->penalised = objective->penalised || penalty->deviation > 0.0 || penalty->rate > 0.0;
    }
    objective->residual_most = count + 2 * objective->horizon->count;
    objective->residual_count = objective->penalised ? objective->residual_most : count;
}

bool tl_objective_init(tl_objective *objective, tl_arena *arena, const tl_objective_settings *settings) {
    *objective = (tl_objective){.exchange = settings->exchange,
                                .horizon = settings->horizon,
                                .terms = settings->terms,
                                .term_count = settings->term_count};
    for (size_t i = 0; i < objective->term_count; i++) {
        objective->matched += has_weight(&objective->terms[i]);
    }
    for (size_t v = 0; v < objective->horizon->variables; v++) {
        objective->penalties[v] = settings->penalties[v];
    }
    objective->damping_count = settings->damps && objective->horizon->longest > 1 ? objective->horizon->count : 0;
    count_residuals(objective);
    size_t count = tl_objective_samples(objective) * objective->matched;
    objective->targets = tl_arena_take(arena, count, sizeof *objective->targets);
    objective->noise_estimates = tl_arena_take(arena, objective->matched, sizeof *objective->noise_estimates);
    objective->damped = tl_arena_take(arena, objective->damping_count + 1, sizeof *objective->damped);
    if (objective->targets == NULL || objective->noise_estimates == NULL || objective->damped == NULL) {
        return false;
    }
    place_targets(objective);
    return true;
}

/* ---- another tuning ---- */

/* Factor from the old to the new residual; 1 if the old one was absent. Its slope is zero then, so
 * the factor has no effect. */
static double growth(double before, double now) {
    return before > 0.0 ? now / before : 1.0;
}

/* Of the samples; the terms still have their old values. */
static double *compare_terms(const tl_objective *objective, const tl_tuning *tuning, double *factors) {
    for (size_t sample = 0; sample < tl_objective_samples(objective); sample++) {
        for (size_t i = 0; i < objective->term_count; i++) {
            const tl_objective_term *term = &objective->terms[i];
            const tl_tuning_match *match = &tuning->match[i];
            if (has_weight(term)) {
                *factors++ = growth(sqrt(term->weight) / term->tolerance, sqrt(match->weight) / match->tolerance);
            }
        }
    }
    return factors;
}

/* As in tl_objective_penalise(). */
static void take_penalties(tl_objective *objective, const tl_tuning *tuning, double *factors) {
    for (size_t i = 0; i < objective->damping_count; i++) {
        *factors++ = 1.0;
    }
    for (size_t v = 0; v < objective->horizon->variables; v++) {
        tl_objective_penalty *penalty = &objective->penalties[v];
        const tl_tuning_adjust *adjust = &tuning->adjust[v];
        for (uint32_t m = 0; m < objective->horizon->length[v]; m++) {
            *factors++ = growth(sqrt(penalty->deviation), sqrt(adjust->deviation_penalty));
            *factors++ = growth(sqrt(penalty->rate), sqrt(adjust->rate_penalty));
        }
        penalty->deviation = adjust->deviation_penalty;
        penalty->rate = adjust->rate_penalty;
    }
}

void tl_objective_retune(tl_objective *objective, tl_objective_term *terms, const tl_tuning *tuning, double *factors) {
    factors = compare_terms(objective, tuning, factors);
    take_penalties(objective, tuning, factors);
    for (size_t i = 0; i < objective->term_count; i++) {
        terms[i].tolerance = tuning->match[i].tolerance;
        terms[i].weight = tuning->match[i].weight;
        terms[i].huber = tuning->match[i].huber;
    }
    place_targets(objective);
    count_residuals(objective);
}

/* The newest sample of the horizon. */
static void watch_noise(const tl_objective *objective) {
    size_t last = (tl_objective_samples(objective) - 1) * objective->matched;
    for (size_t i = 0; i < objective->matched; i++) {
        const tl_objective_target *target = &objective->targets[last + i];
        if (target->scale > 0.0) {
            tl_noise_estimate_push(&objective->noise_estimates[i], target->value);
        }
    }
}

/* Whether a measurement shows unknown `m` of a variable at its first effect. */
static bool is_seen(const tl_objective *objective, size_t variable, uint32_t m) {
    const tl_horizon *horizon = objective->horizon;
    size_t i = 0;
    for (size_t term = 0; term < objective->term_count; term++) {
        if (!has_weight(&objective->terms[term])) {
            continue;
        }
        uint32_t path_length = horizon->from_adjust[variable * horizon->nodes + objective->terms[term].port->node];
        uint64_t depth = (uint64_t)path_length + 1 + m; /* TL_NEVER is beyond all */
        if (depth <= horizon->prediction &&
            objective->targets[(depth - horizon->distance) * objective->matched + i].scale > 0.0) {
            return true;
        }
        i++;
    }
    return false;
}

static void find_unseen(tl_objective *objective) {
    const tl_horizon *horizon = objective->horizon;
    for (size_t v = 0; v < horizon->variables && objective->damping_count != 0; v++) {
        for (uint32_t m = 0; m < horizon->length[v]; m++) {
            objective->damped[horizon->offset[v] + m] =
                objective->penalties[v].rate < TL_UNSEEN_RATE && !is_seen(objective, v, m);
        }
    }
}

bool tl_objective_prepare(tl_objective *objective, int64_t step) {
    const tl_horizon *horizon = objective->horizon;
    tl_objective_target *target = objective->targets;
    bool measured = false;
    for (uint32_t depth = horizon->distance; depth <= horizon->prediction; depth++) {
        for (size_t i = 0; i < objective->term_count; i++) {
            const tl_objective_term *term = &objective->terms[i];
            if (!has_weight(term)) {
                continue;
            }
            tl_quality quality = TL_GOOD;
            target->value = tl_objective_measured(objective, i, step + (int64_t)depth, &quality);
            target->scale = quality == TL_GOOD && depth >= horizon->match_distance[i] ? 1.0 / term->tolerance : 0.0;
            measured = measured || target->scale > 0.0;
            target++;
        }
    }
    watch_noise(objective);
    find_unseen(objective);
    return measured;
}

static double y_of(const tl_objective_target *target) {
    return target->real != NULL ? *target->real : (double)*target->integer;
}

/* Beyond the limit the square of the residual grows linearly. */
static double bend(double difference, double huber) {
    double size = fabs(difference);
    return size <= huber ? difference : copysign(sqrt(huber * (2.0 * size - huber)), difference);
}

static double residual(const tl_objective_target *target, double y) {
    if (!(target->scale > 0.0) && !isfinite(y)) {
        return 0.0;
    }
    return target->root_weight * bend((y - target->value) * target->scale, target->huber);
}

double tl_objective_at(const tl_objective *objective, uint32_t depth, double *residuals, double *course) {
    size_t first = (depth - objective->horizon->distance) * objective->matched;
    double sum = 0.0;
    for (size_t i = first; i < first + objective->matched; i++) {
        double y = y_of(&objective->targets[i]);
        double r = residual(&objective->targets[i], y);
        course[i] = y;
        residuals[i] = r;
        sum += r * r;
    }
    return sum;
}

static bool is_bad(const tl_objective_target *target, double y) {
    return target->scale > 0.0 && !isfinite(y);
}

size_t tl_objective_find_bad(const tl_objective *objective, const double *course) {
    size_t count = tl_objective_samples(objective) * objective->matched;
    for (size_t i = 0; i < count; i++) {
        size_t match = 0;
        for (size_t before = i % objective->matched; before > 0 || !has_weight(&objective->terms[match]); match++) {
            before -= has_weight(&objective->terms[match]) ? 1 : 0;
        }
        if (is_bad(&objective->targets[i], course[i])) {
            return match;
        }
    }
    return SIZE_MAX;
}

double tl_objective_leave_out(tl_objective *objective, const double *course, double *residuals) {
    size_t count = tl_objective_samples(objective) * objective->matched;
    double sum = 0.0;
    bool any = false;
    for (size_t i = 0; i < count; i++) {
        any = any || (objective->targets[i].scale > 0.0 && isfinite(course[i]));
    }
    for (size_t i = 0; i < count && any; i++) {
        if (is_bad(&objective->targets[i], course[i])) {
            objective->targets[i].scale = 0.0;
            residuals[i] = 0.0;
        }
        sum += residuals[i] * residuals[i];
    }
    return any ? sum : HUGE_VAL;
}

double tl_objective_sample(const tl_objective *objective, int64_t tick, const double *y) {
    double sum = 0.0;
    size_t m = 0;
    for (size_t i = 0; i < objective->term_count; i++) {
        if (has_weight(&objective->terms[i])) {
            tl_quality quality = TL_GOOD;
            tl_objective_target target = objective->targets[m];
            target.value = tl_objective_measured(objective, i, tick, &quality);
            target.scale = quality == TL_GOOD ? 1.0 / objective->terms[i].tolerance : 0.0;
            double r = residual(&target, y[m]);
            sum += r * r;
            m++;
        }
    }
    return sum;
}

/* All of them are filled, so that a solver that stores their changes need not know which belong to
 * J. */
static double damp(const tl_objective *objective, const double *u, const double *before, double *residuals) {
    const tl_horizon *horizon = objective->horizon;
    double sum = 0.0;
    for (size_t v = 0; v < horizon->variables && objective->damping_count != 0; v++) {
        double last = before[v];
        for (size_t i = horizon->offset[v]; i < horizon->offset[v] + horizon->length[v]; i++) {
            residuals[i] = sqrt(TL_UNSEEN_RATE) * (u[i] - last) / objective->penalties[v].step;
            sum += objective->damped[i] ? residuals[i] * residuals[i] : 0.0;
            last = u[i];
        }
    }
    return sum;
}

double tl_objective_penalise(const tl_objective *objective, const double *u, const double *nominal,
                             const double *before, double *residuals) {
    const tl_horizon *horizon = objective->horizon;
    double *rest = residuals + tl_objective_samples(objective) * objective->matched;
    double sum = damp(objective, u, before, rest);
    if (!objective->penalised) {
        return sum;
    }
    rest += objective->damping_count;
    for (size_t v = 0; v < horizon->variables; v++) {
        const tl_objective_penalty *penalty = &objective->penalties[v];
        double last = before[v];
        for (uint32_t m = 0; m < horizon->length[v]; m++) {
            double value = tl_horizon_value(horizon, u, v, m);
            rest[0] = sqrt(penalty->deviation) * (value - nominal[v]) / penalty->step;
            rest[1] = sqrt(penalty->rate) * (value - last) / penalty->step;
            sum += rest[0] * rest[0] + rest[1] * rest[1];
            last = value;
            rest += 2;
        }
    }
    return sum;
}

static double expected(const tl_objective_target *target, double y) {
    return isfinite(y) ? residual(target, y) : 0.0;
}

void tl_objective_forecast(const tl_objective *objective, const double *course, const double *earlier,
                           double *residuals) {
    size_t matched = objective->matched;
    size_t last = (tl_objective_samples(objective) - 1) * matched;
    for (size_t i = 0; i < objective->residual_count; i++) {
        residuals[i] = 0.0;
    }
    for (size_t i = 0; i < last; i++) {
        residuals[i] = expected(&objective->targets[i], course[i + matched]);
    }
    for (size_t i = 0; i < matched; i++) {
        double y = course[last + i];
        residuals[last + i] = expected(&objective->targets[last + i], y + (y - earlier[i]));
    }
}

void tl_objective_noise(const tl_objective *objective, double *squares) {
    size_t count = tl_objective_samples(objective) * objective->matched;
    for (size_t i = 0; i < objective->residual_count; i++) {
        squares[i] = 0.0;
        if (i < count) {
            double scale = objective->targets[i].scale * objective->targets[i].root_weight;
            squares[i] =
                scale * scale * tl_noise_estimate_variance(&objective->noise_estimates[i % objective->matched]);
        }
    }
}

double tl_objective_change(const tl_objective *objective, const double *residuals, const double *others) {
    double largest = 0.0;
    for (size_t i = 0; i < tl_objective_samples(objective) * objective->matched; i++) {
        largest = fmax(largest, fabs(residuals[i] - others[i]));
    }
    return largest;
}

void tl_objective_matched(const tl_objective *objective, double *y) {
    for (size_t i = 0; i < objective->matched; i++) {
        y[i] = y_of(&objective->targets[i]);
    }
}

double tl_objective_y(const tl_objective *objective, size_t term) {
    return tl_exchange_value(objective->exchange, objective->terms[term].port);
}

double tl_objective_measured(const tl_objective *objective, size_t term, int64_t tick, tl_quality *quality) {
    const tl_objective_term *description = &objective->terms[term];
    int64_t seen = tick + description->shift;
    const tl_sample *sample = tl_plant_sample(&objective->exchange->plant, seen);
    *quality = seen < 0 ? TL_NO_LINK : (tl_quality)sample->quality[description->signal];
    return description->conversion.factor * sample->values[description->signal] + description->conversion.offset;
}
