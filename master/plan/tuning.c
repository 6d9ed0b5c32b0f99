/* Tunings: see tuning.h. */
#include "master/plan/tuning.h"

#include <math.h>

enum { MOST_SECONDS = 1000000000 }; /* of a duration in a configuration */

void tl_tuning_of(const tl_plan *plan, tl_tuning *tuning) {
    *tuning = (tl_tuning){
        .matches = (uint32_t)plan->match_count,
        .adjusts = (uint32_t)plan->adjust_count,
        .margin = plan->margin,
        .noise_floor = plan->noise_floor,
        .evaluations = plan->evaluations != 0 ? plan->evaluations : TL_PLAN_EVALUATIONS,
    };
    for (size_t i = 0; i < plan->match_count; i++) {
        const tl_plan_match *match = &plan->match[i];
        tuning->match[i] = (tl_tuning_match){match->tolerance, match->weight, match->huber};
    }
    for (size_t v = 0; v < plan->adjust_count; v++) {
        const tl_plan_adjust *adjust = &plan->adjust[v];
        tuning->adjust[v] = (tl_tuning_adjust){
            .has_nominal = adjust->has_nominal ? 1 : 0,
            .nominal = adjust->has_nominal ? adjust->nominal : 0.0,
            .lower = adjust->lower,
            .upper = adjust->upper,
            .approved = adjust->approved,
            .deviation_penalty = adjust->deviation_penalty,
            .rate_penalty = adjust->rate_penalty,
        };
    }
}

/* ---- its numbers ---- */

/* NaN is in no range. */
static bool is_from_zero(double value) {
    return value >= 0.0 && isfinite(value);
}

static tl_status check_match(const tl_tuning_match *match, unsigned index, tl_error *error) {
    if (!is_from_zero(match->weight) || !is_from_zero(match->huber)) {
        return tl_fail(error, TL_BAD_DATA, "match %u: weight %g and huber %g, expected numbers from 0", index,
                       match->weight, match->huber);
    }
    bool is_matched = match->weight > 0.0;
    if (!isfinite(match->tolerance) || (is_matched && !(match->tolerance > 0.0))) {
        return tl_fail(error, TL_BAD_DATA, "match %u: tolerance %g, expected a number above 0", index,
                       match->tolerance);
    }
    return TL_OK;
}

static tl_status check_adjust(const tl_tuning_adjust *adjust, unsigned index, tl_error *error) {
    if (adjust->has_nominal > 1 || !isfinite(adjust->nominal)) {
        return tl_fail(error, TL_BAD_DATA, "adjusted variable %u: nominal %g, expected a finite number", index,
                       adjust->nominal);
    }
    if (!isfinite(adjust->approved)) {
        return tl_fail(error, TL_BAD_DATA, "adjusted variable %u: approved %g, expected a finite number", index,
                       adjust->approved);
    }
    if (!(adjust->lower < adjust->upper)) {
        return tl_fail(error, TL_BAD_DATA, "adjusted variable %u: no range is left between the bounds %g and %g", index,
                       adjust->lower, adjust->upper);
    }
    if (!is_from_zero(adjust->deviation_penalty) || !is_from_zero(adjust->rate_penalty)) {
        return tl_fail(error, TL_BAD_DATA, "adjusted variable %u: penalties %g and %g, expected numbers from 0", index,
                       adjust->deviation_penalty, adjust->rate_penalty);
    }
    return TL_OK;
}

static tl_status check_search(const tl_tuning *tuning, tl_error *error) {
    if (!(tuning->margin >= 0.0 && tuning->margin < 1.0) || !is_from_zero(tuning->noise_floor)) {
        return tl_fail(error, TL_BAD_DATA, "margin %g and noise_floor %g, expected 0 to below 1, and a number from 0",
                       tuning->margin, tuning->noise_floor);
    }
    if (tuning->evaluations < 1 || tuning->evaluations > TL_TUNING_EVALUATIONS) {
        return tl_fail(error, TL_BAD_DATA, "found %llu evaluations, expected 1 to %d",
                       (unsigned long long)tuning->evaluations, (int)TL_TUNING_EVALUATIONS);
    }
    if (tuning->time < 0 || tuning->time / TL_SECOND > MOST_SECONDS) {
        return tl_fail(error, TL_BAD_DATA, "found a budget of %g s, expected a time from 0 to %d s",
                       tl_seconds(tuning->time), (int)MOST_SECONDS);
    }
    return TL_OK;
}

tl_status tl_tuning_check(const tl_tuning *tuning, tl_error *error) {
    if (tuning->matches > TL_MAX_MATCH || tuning->adjusts > TL_MAX_ADJUST) {
        return tl_fail(error, TL_BAD_DATA, "found %u matches and %u adjusted variables, expected at most %d and %d",
                       (unsigned)tuning->matches, (unsigned)tuning->adjusts, (int)TL_MAX_MATCH, (int)TL_MAX_ADJUST);
    }
    tl_status status = check_search(tuning, error);
    for (unsigned i = 0; status == TL_OK && i < tuning->matches; i++) {
        status = check_match(&tuning->match[i], i, error);
    }
    for (unsigned v = 0; status == TL_OK && v < tuning->adjusts; v++) {
        status = check_adjust(&tuning->adjust[v], v, error);
    }
    return status;
}

/* ---- what stays ---- */

tl_status tl_tuning_fits(const tl_tuning *tuning, const tl_tuning *built, tl_error *error) {
    if (tuning->matches != built->matches || tuning->adjusts != built->adjusts) {
        return tl_fail(
            error, TL_BAD_DATA, "found %u matches and %u adjusted variables, but the running twin has %u and %u",
            (unsigned)tuning->matches, (unsigned)tuning->adjusts, (unsigned)built->matches, (unsigned)built->adjusts);
    }
    if (tuning->evaluations > tl_tuning_room(built->evaluations)) {
        return tl_fail(error, TL_BAD_DATA,
                       "found %llu evaluations, but the running twin has room for %llu: more need a new twin",
                       (unsigned long long)tuning->evaluations, (unsigned long long)tl_tuning_room(built->evaluations));
    }
    for (unsigned i = 0; i < tuning->matches; i++) {
        if ((tuning->match[i].weight > 0.0) != (built->match[i].weight > 0.0)) {
            return tl_fail(
                error, TL_BAD_DATA,
                "match %u: weight %g, but the running twin was built with %g: a change from or to 0 needs a new twin",
                i, tuning->match[i].weight, built->match[i].weight);
        }
    }
    for (unsigned v = 0; v < tuning->adjusts; v++) {
        if (tuning->adjust[v].has_nominal != built->adjust[v].has_nominal) {
            return tl_fail(
                error, TL_BAD_DATA,
                "adjusted variable %u %s a nominal, but the running twin was built %s: a change needs a new twin", v,
                tuning->adjust[v].has_nominal != 0 ? "has" : "has not",
                built->adjust[v].has_nominal != 0 ? "with one" : "without");
        }
    }
    return TL_OK;
}
