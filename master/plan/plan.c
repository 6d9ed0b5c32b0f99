/* The plan of a twin: components, connections, delays, matches: see plan.h. */
#include "master/plan/plan.h"

#include <math.h>

/* ---- delay ---- */

enum { MOST_STATES = 2187 }; /* 3^TL_DELAY_LINKS */

bool tl_delay_of_chain(const tl_delay_participant *participants, const size_t *chain, size_t length,
                       tl_delay_density *density) {
    *density = (tl_delay_density){0};
    for (size_t i = 0; i < length; i++) {
        const tl_delay_participant *part = &participants[chain[i]];
        bool joins = i > 0 && participants[chain[i - 1]].base == part->base;
        bool continues = i + 1 < length && participants[chain[i + 1]].base == part->base;
        if (joins || continues) {
            density->dead += part->dead;
        }
        if (i > 0 && !joins) {
            if (density->count == TL_DELAY_LINKS) {
                return false;
            }
            density->cycles[density->count++] = part->cycle;
        }
    }
    return true;
}

static tl_time sum_of_cycles(const tl_delay_density *density) {
    tl_time sum = 0;
    for (size_t i = 0; i < density->count; i++) {
        sum += density->cycles[i];
    }
    return sum;
}

tl_time tl_delay_mode(const tl_delay_density *density) {
    tl_time sum = sum_of_cycles(density);
    tl_time largest = 0;
    for (size_t i = 0; i < density->count; i++) {
        largest = density->cycles[i] > largest ? density->cycles[i] : largest;
    }
    return density->dead + (largest > sum - largest ? largest : sum / 2);
}

tl_time tl_delay_longest(const tl_delay_density *density) {
    return density->dead + sum_of_cycles(density);
}

/* Recurrence: the density of n uniforms at x, from those of n − 1 of them,
 *     (n − 1)·M(x) = Σ over i of τ·M_without_i(x) + (1 − τ)·M_without_i(x − a_i),  τ = x/Σa.
 * A state encodes each uniform as present (2), or removed with a_i subtracted (1) or not (0): a
 * number in base 3. A state depends only on smaller numbers. */
static double density_of_state(const tl_delay_density *density, size_t state, tl_time at, const double *smaller) {
    size_t place = 1;
    size_t there = 0;
    tl_time sum = 0;
    for (size_t i = 0, rest = state; i < density->count; i++, rest /= 3) {
        there += rest % 3 == 2;
        sum += rest % 3 == 2 ? density->cycles[i] : 0;
        at -= rest % 3 == 1 ? density->cycles[i] : 0;
    }
    if (there == 0 || at < 0 || at >= sum) {
        return 0.0;
    }
    if (there == 1) {
        return 1.0 / tl_seconds(sum);
    }
    double share = (double)at / (double)sum;
    double rest_of_it = (double)(sum - at) / (double)sum; /* 1 − share would lose digits near 1 */
    double total = 0.0;
    for (size_t i = 0, rest = state; i < density->count; i++, rest /= 3, place *= 3) {
        if (rest % 3 == 2) {
            total += share * smaller[state - 2 * place] + rest_of_it * smaller[state - place];
        }
    }
    return total / (double)(there - 1);
}

double tl_delay_density_at(const tl_delay_density *density, tl_time delay) {
    double values[MOST_STATES] = {0.0};
    size_t states = 1;
    for (size_t i = 0; i < density->count; i++) {
        states *= 3;
    }
    for (size_t state = 0; state < states; state++) {
        values[state] = density_of_state(density, state, delay - density->dead, values);
    }
    return values[states - 1];
}

tl_delay_lookup tl_delay_look_up(tl_time shift, tl_time wait, tl_time step) {
    tl_time until = shift + wait;
    tl_time ticks = until / step + (until % step > 0);
    return (tl_delay_lookup){.ticks = (int32_t)ticks, .look_back = ticks * step - shift};
}

int32_t tl_delay_ticks(tl_time look_back, tl_time delay, tl_time step) {
    tl_time until = look_back - delay;
    tl_time half = until < 0 ? -(step / 2) : step / 2;
    return (int32_t)((until + half) / step);
}

/* ---- Numbers of a plan. The graph checks names. */

tl_plan tl_plan_defaults(tl_time step) {
    return (tl_plan){
        .step = step,
        .margin = 0.01,
        .noise_floor = 1e-3,
        .evaluations = TL_PLAN_EVALUATIONS,
        .saving = {.structure = true, .sequences = true},
        .verify_every = 400,
        .state_bytes = UINT64_C(128) << 20,
    };
}

tl_plan_adjust tl_plan_adjust_defaults(const char *variable, double step) {
    return (tl_plan_adjust){.variable = variable, .step = step, .lower = -HUGE_VAL, .upper = HUGE_VAL};
}

tl_plan_match tl_plan_match_defaults(const char *variable, const char *to, double tolerance) {
    return (tl_plan_match){.variable = variable, .to = to, .tolerance = tolerance, .weight = 1.0};
}

/* NaN is in no range. */
static bool is_positive(double value) {
    return value > 0.0 && isfinite(value);
}

static bool is_from_zero(double value) {
    return value >= 0.0 && isfinite(value);
}

static bool check_count(size_t count, size_t most, const char *where, tl_report *report) {
    if (count > most) {
        tl_report_add(report, TL_BAD_DATA, where, "found %u, expected at most %u", (unsigned)count, (unsigned)most);
    }
    return count <= most;
}

static void check_signal(const tl_plan_signal *signal, tl_report *report) {
    if (signal->has_initial && !(fabs(signal->initial) <= (signal->type == TL_INTEGER ? 2147483647.0 : HUGE_VAL) &&
                                 isfinite(signal->initial))) {
        tl_report_add(report, TL_BAD_DATA, signal->where, "\"initial\": found %g, expected a finite number%s",
                      signal->initial, signal->type == TL_INTEGER ? " of at most 2147483647 in size" : "");
    }
}

static void check_penalty(const char *kind, double penalty, const tl_plan_adjust *adjust, tl_report *report) {
    if (!is_from_zero(penalty)) {
        tl_report_add(report, TL_BAD_DATA, adjust->where,
                      "\"penalty\": found a penalty on the %s of %g, expected a number from 0", kind, penalty);
    }
}

static void check_adjust(const tl_plan_adjust *adjust, tl_report *report) {
    if (!(adjust->step >= 0.0 && isfinite(adjust->step))) {
        tl_report_add(report, TL_BAD_DATA, adjust->where, "\"step\": found %g, expected a number above 0",
                      adjust->step);
    }
    if (adjust->has_nominal && !isfinite(adjust->nominal)) {
        tl_report_add(report, TL_BAD_DATA, adjust->where, "\"nominal\": found %g, expected a finite number",
                      adjust->nominal);
    }
    if (!isfinite(adjust->approved)) {
        tl_report_add(report, TL_BAD_DATA, adjust->where, "\"approved\": found %g, expected a finite number",
                      adjust->approved);
    }
    if (isnan(adjust->lower) || isnan(adjust->upper)) {
        tl_report_add(report, TL_BAD_DATA, adjust->where, "a bound is not a number");
    }
    check_penalty("deviation", adjust->deviation_penalty, adjust, report);
    check_penalty("rate", adjust->rate_penalty, adjust, report);
    if (adjust->dwell < 0) {
        tl_report_add(report, TL_BAD_DATA, adjust->where, "\"dwell_s\": found %g s, expected a time from 0",
                      tl_seconds(adjust->dwell));
    }
}

static void check_match(const tl_plan_match *match, tl_report *report) {
    if (!is_from_zero(match->weight)) {
        tl_report_add(report, TL_BAD_DATA, match->where, "\"weight\": found %g, expected a number from 0",
                      match->weight);
    }
    if (!is_positive(match->tolerance) && !(match->weight >= 0.0 && match->weight <= 0.0)) {
        tl_report_add(report, TL_BAD_DATA, match->where, "\"tolerance\": found %g, expected a number above 0",
                      match->tolerance);
    }
    if (!is_from_zero(match->huber)) {
        tl_report_add(report, TL_BAD_DATA, match->where, "\"huber\": found %g, expected a number from 0", match->huber);
    }
}

static void check_choice(unsigned choice, unsigned last, const char *where, tl_report *report) {
    if (choice > last) {
        tl_report_add(report, TL_BAD_DATA, where, "found the choice number %u, expected one from 0 to %u", choice,
                      last);
    }
}

static void check_search(const tl_plan *plan, tl_report *report) {
    if (!(plan->margin >= 0.0 && plan->margin < 1.0)) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.margin", "found a margin of %g, expected one from 0 to below 1",
                      plan->margin);
    }
    if (!is_from_zero(plan->noise_floor)) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.noise_floor",
                      "found a noise floor of %g, expected a number from 0", plan->noise_floor);
    }
    check_choice((unsigned)plan->shape, TL_DYNAMIC, "synchronise.horizon.shape", report);
    check_choice((unsigned)plan->measurements, TL_HOLD, "synchronise.horizon.measurements", report);
}

bool tl_plan_check(const tl_plan *plan, tl_report *report) {
    bool fits = check_count(plan->signal_count, TL_MAX_SIGNALS, "plant", report);
    fits = check_count(plan->adjust_count, TL_MAX_ADJUST, "synchronise.adjust", report) && fits;
    fits = check_count(plan->find_count, TL_MAX_ADJUST, "synchronise.start.find", report) && fits;
    fits = check_count(plan->match_count, TL_MAX_MATCH, "synchronise.match", report) && fits;
    fits = check_count(plan->output_count, TL_MAX_SIGNALS, "outputs", report) && fits;
    if (plan->step <= 0) {
        tl_report_add(report, TL_BAD_DATA, "step_s", "found %g s, expected a macro step above 0",
                      tl_seconds(plan->step));
    }
    check_search(plan, report);
    for (size_t i = 0; i < plan->signal_count; i++) {
        check_signal(&plan->signals[i], report);
    }
    for (size_t i = 0; i < plan->adjust_count; i++) {
        check_adjust(&plan->adjust[i], report);
    }
    for (size_t i = 0; i < plan->match_count; i++) {
        check_match(&plan->match[i], report);
    }
    return fits;
}
