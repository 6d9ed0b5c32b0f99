/* Response of the matched outputs to the adjusted variables: see response.h. */
#include "firmware/cli/response.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "master/twin/twin_candidate.h"

enum { MOST_STEPS = 1000 };

static const double PART_TO_STOP = 0.3; /* of the time to the FMUs' stop time; the dry run takes 0.6 */
static const double STEPS_WITHOUT_BOUNDS = 10.0;

/* Steps that fit into the time for one of `count` variables. */
static size_t find_steps(const tl_assembly *assembly, tl_time step_time, tl_time longest, size_t count) {
    tl_time each = step_time > 0 ? step_time : 1;
    tl_time fitting = longest / each / 2 / (tl_time)count;
    tl_time left = (tl_time)(PART_TO_STOP * (double)tl_assembly_steps_to_stop(assembly));
    tl_time steps = fitting < left ? fitting : left;
    return steps < MOST_STEPS ? (size_t)steps : MOST_STEPS;
}

/* What may be added to nominal, towards the bound that is further away. */
static double find_room(const tl_assembly *assembly, size_t index, const tl_twin_adjusted *adjusted) {
    double nominal = tl_twin_present_nominal(assembly->twin, index);
    double above = adjusted->upper - nominal;
    double below = nominal - adjusted->lower;
    return above >= below ? above : -below;
}

/* Describes the response of one output; `moved` has `count` entries a step. */
static tl_response describe(const tl_assembly *assembly, size_t match, const double *moved, size_t count, size_t steps,
                            double range) {
    const tl_config *config = &assembly->config;
    tl_response response = {.is_known = true, .match = match};
    size_t horizon = tl_twin_get_facts(assembly->twin).prediction;
    double scale = range / config->match[match].tolerance;
    for (size_t i = 0; i < steps; i++) {
        double size = fabs(moved[i * count + match]);
        response.is_known = response.is_known && isfinite(size);
        response.most = fmax(response.most, size);
        response.soon = i < horizon ? response.most : response.soon;
        response.steps = response.steps == 0 && response.most * scale >= 1.0 ? (uint32_t)i + 1 : response.steps;
    }
    for (size_t i = 0; i < steps && response.half == 0 && response.most > 0.0; i++) {
        bool is_half = fabs(moved[i * count + match]) >= response.most / 2.0;
        response.half = is_half ? tl_time_of_step(0, config->step, (int64_t)i + 1) : 0;
    }
    response.tolerances = response.soon * scale;
    response.length = tl_time_of_step(0, config->step, (int64_t)steps);
    return response;
}

static bool is_better(const tl_assembly *assembly, const tl_response *one, const tl_response *other) {
    const tl_plan_match *matches = assembly->config.match;
    double most = one->most / matches[one->match].tolerance;
    bool is_larger = most > other->most / matches[other->match].tolerance;
    bool is_first = one->steps != 0 && (other->steps == 0 || one->steps < other->steps);
    return !other->is_known || is_first || (one->steps == other->steps && is_larger);
}

/* `moved` is by one step of the variable, also if the bounds permit less. */
static tl_status measure(const tl_assembly *assembly, size_t index, double *moved, size_t steps, tl_response *response,
                         tl_error *error) {
    const tl_config *config = &assembly->config;
    const tl_twin_adjusted adjusted = tl_twin_get_adjusted(assembly->twin, index);
    double room = find_room(assembly, index, &adjusted);
    double change = copysign(fmin(adjusted.step, fabs(room)), room);
    bool has_range = isfinite(adjusted.upper) && isfinite(adjusted.lower);
    double range = has_range ? fabs(room) / adjusted.step : STEPS_WITHOUT_BOUNDS;
    tl_error failure = {TL_OK, ""};
    if (fabs(change) <= 0.0) {
        return TL_OK;
    }
    tl_status status = tl_twin_respond(assembly->twin, index, change, steps, moved, &failure, error);
    for (size_t i = 0; i < steps * config->match_count; i++) {
        moved[i] *= adjusted.step / fabs(change);
    }
    for (size_t m = 0; m < config->match_count && status == TL_OK && failure.status == TL_OK; m++) {
        tl_response found = describe(assembly, m, moved, config->match_count, steps, range);
        if (config->match[m].weight > 0.0 && found.is_known && is_better(assembly, &found, response)) {
            *response = found;
            response->has_range = has_range;
        }
    }
    return status;
}

tl_status tl_response_measure(const tl_assembly *assembly, tl_time step_time, tl_time longest,
                              tl_response responses[TL_MAX_ADJUST], tl_error *error) {
    const tl_config *config = &assembly->config;
    tl_status status = TL_OK;
    memset(responses, 0, TL_MAX_ADJUST * sizeof *responses);
    if (tl_twin_get_facts(assembly->twin).unknowns == 0 || config->event.start.signal != NULL) {
        return TL_OK;
    }
    size_t steps = find_steps(assembly, step_time, longest, config->adjust_count);
    bool is_enough = steps > 0 && steps >= tl_twin_get_facts(assembly->twin).prediction;
    double *moved = is_enough ? calloc(steps * config->match_count, sizeof *moved) : NULL;
    for (size_t i = 0; i < config->adjust_count && moved != NULL && status == TL_OK; i++) {
        if (tl_twin_get_adjusted(assembly->twin, i).is_real) {
            status = measure(assembly, i, moved, steps, &responses[i], error);
        }
    }
    free(moved);
    return status;
}
