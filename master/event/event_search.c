/* Search of an event horizon: see event_search.h. */
#include "master/event/event_search.h"

#include <math.h>

#include "master/sync/objective.h"

/* Doubles the distance each time: enough for any step and bound within the useful range of a
 * double. */
enum { WIDENINGS = 60 };

/* Bisection ends at an interval of this size, relative to the interval's ends or to the step. */
static const double NARROWEST = 1e-6;

/* Bisection towards a failed candidate ends at this part of the step. */
static const double NARROWEST_WALL = 1.0 / 64.0;

static const double BOUNDLESS = HUGE_VAL;

bool tl_event_search_init(tl_event_search *search, tl_arena *arena, const tl_event_search_settings *settings) {
    *search = (tl_event_search){
        .solver = settings->solver,
        .z_step = 1.0,
        .z_lower = -BOUNDLESS,
        .z_upper = BOUNDLESS,
        .step = settings->step,
        .lower = settings->lower,
        .upper = settings->upper,
        .stagnation = settings->stagnation != 0 ? settings->stagnation : TL_EVENT_STAGNATION,
        .candidates = tl_arena_take(arena, settings->evaluations, sizeof *search->candidates),
        .most = settings->evaluations,
    };
    search->space = (tl_optimiser_space){.count = 1,
                                         .step = &search->z_step,
                                         .lower = &search->z_lower,
                                         .upper = &search->z_upper,
                                         .residual_count = 0,
                                         .held = true};
    search->optimiser = search->solver->create(arena, &search->space);
    tl_event_search_begin(search);
    return search->candidates != NULL && search->optimiser != NULL;
}

void tl_event_search_end(tl_event_search *search) {
    if (search->optimiser != NULL) {
        search->solver->destroy(search->optimiser);
        search->optimiser = NULL;
    }
}

void tl_event_search_retune(tl_event_search *search, double lower, double upper, size_t evaluations) {
    search->lower = lower;
    search->upper = upper;
    search->most = evaluations;
}

void tl_event_search_begin(tl_event_search *search) {
    search->count = 0;
}

void tl_event_search_report(tl_event_search *search, double u, double value, tl_event_side side) {
    search->candidates[search->count++] = (tl_event_candidate){u, value, side};
}

bool tl_event_search_is_full(const tl_event_search *search) {
    return search->count >= search->most;
}

const tl_event_candidate *tl_event_search_best(const tl_event_search *search) {
    const tl_event_candidate *best = &search->candidates[0];
    for (size_t i = 1; i < search->count; i++) {
        best = search->candidates[i].value < best->value ? &search->candidates[i] : best;
    }
    return best;
}

const tl_event_candidate *tl_event_search_find(const tl_event_search *search, double u) {
    for (size_t i = 0; i < search->count; i++) {
        if (!(search->candidates[i].u < u) && !(search->candidates[i].u > u)) {
            return &search->candidates[i];
        }
    }
    return NULL;
}

static bool is_plateau(tl_event_side side) {
    return side == TL_EVENT_BEFORE || side == TL_EVENT_AFTER;
}

bool tl_event_search_met_plateau(const tl_event_search *search) {
    return search->count > 0 && is_plateau(search->candidates[0].side);
}

/* ---- leaving the plateau ---- */

static bool comes_first(tl_event_side side) {
    return side == TL_EVENT_BEFORE || side == TL_EVENT_EARLY;
}

static bool comes_last(tl_event_side side) {
    return side == TL_EVENT_AFTER || side == TL_EVENT_LATE;
}

/* The nearest pair of candidates of which one is early and the other late. */
static bool find_bracket(const tl_event_search *search, double *early, double *late) {
    double nearest = HUGE_VAL;
    for (size_t i = 0; i < search->count; i++) {
        for (size_t k = 0; k < search->count && comes_first(search->candidates[i].side); k++) {
            double distance = fabs(search->candidates[i].u - search->candidates[k].u);
            if (comes_last(search->candidates[k].side) && distance < nearest) {
                nearest = distance;
                *early = search->candidates[i].u;
                *late = search->candidates[k].u;
            }
        }
    }
    return isfinite(nearest);
}

static bool halve(const tl_event_search *search, double early, double late, double *u) {
    double size = fmax(fmax(fabs(early), fabs(late)), search->step);
    *u = early + (late - early) / 2.0;
    return fabs(early - late) > NARROWEST * size && tl_event_search_find(search, *u) == NULL;
}

/* On one side of the guess: the nearest failed candidate (HUGE_VAL: none), and the furthest one
 * below `limit` that did not fail. Both as distances from the guess. */
static double nearest_failure(const tl_event_search *search, double sign) {
    double nearest = HUGE_VAL;
    for (size_t i = 1; i < search->count; i++) {
        double distance = sign * (search->candidates[i].u - search->candidates[0].u);
        if (search->candidates[i].side == TL_EVENT_UNKNOWN && distance > 0.0) {
            nearest = fmin(nearest, distance);
        }
    }
    return nearest;
}

static double furthest_success(const tl_event_search *search, double sign, double limit) {
    double furthest = 0.0;
    for (size_t i = 1; i < search->count; i++) {
        double distance = sign * (search->candidates[i].u - search->candidates[0].u);
        if (search->candidates[i].side != TL_EVENT_UNKNOWN && distance < limit) {
            furthest = fmax(furthest, distance);
        }
    }
    return furthest;
}

/* Distance of the next candidate on one side: `width`, but not beyond a failed candidate; near it
 * by bisection. 0: no candidate is possible. */
static double reach_out(const tl_event_search *search, double sign, double width) {
    double wall = nearest_failure(search, sign);
    if (width < wall) {
        return width;
    }
    double from = furthest_success(search, sign, wall);
    return wall - from > NARROWEST_WALL * search->step ? from + (wall - from) / 2.0 : 0.0;
}

/* Tries a step to either side of the guess in turn, doubled each time; a u beyond a bound becomes
 * the bound. */
static bool widen(const tl_event_search *search, double *u) {
    double width = search->step;
    for (int i = 0; i < WIDENINGS; i++) {
        for (int sign = 1; sign >= -1; sign -= 2) {
            double out = search->candidates[0].u + sign * reach_out(search, sign, width);
            *u = fmin(fmax(out, search->lower), search->upper);
            if (isfinite(*u) && tl_event_search_find(search, *u) == NULL) {
                return true;
            }
        }
        width *= 2.0;
    }
    return false;
}

static bool leave_plateau(const tl_event_search *search, double *u) {
    double early = 0.0;
    double late = 0.0;
    return find_bracket(search, &early, &late) ? halve(search, early, late, u) : widen(search, u);
}

/* ---- the solver ---- */

typedef struct replayed {
    tl_event_search *search;
    double best;
    uint32_t idle;
} replayed;

/* Answers the solver from the stored candidates, or notes the u to be tried next. */
static bool replay_answer(void *context, const double *z, double *value, const double **residuals) {
    replayed *replay = context;
    tl_event_search *search = replay->search;
    double u = fmin(fmax(search->origin + search->scale * z[0], search->lower), search->upper);
    const tl_event_candidate *known = tl_event_search_find(search, u);
    if (residuals != NULL) {
        *residuals = NULL;
    }
    if (replay->idle >= search->stagnation) {
        return false;
    }
    if (known == NULL) {
        search->asked = u;
        search->asks = true;
        return false;
    }
    *value = known->value;
    replay->idle = known->value < replay->best ? 0 : replay->idle + 1;
    replay->best = fmin(replay->best, known->value);
    return true;
}

/* Distance of the solver's first step: a step, or half of the distance to the nearest candidate. */
static double first_move(const tl_event_search *search, size_t start) {
    double nearest = 2.0 * search->step;
    for (size_t i = 0; i < start; i++) {
        double distance = fabs(search->candidates[i].u - search->candidates[start].u);
        nearest = i == 0 || distance < nearest ? distance : nearest;
    }
    return nearest / 2.0;
}

/* Runs the solver through the stored candidates, from the first one within the window. */
static bool ask_solver(tl_event_search *search, size_t start, double *u) {
    static const double zero = 0.0;
    replayed replay = {search, search->candidates[start].value, 0};
    search->origin = search->candidates[start].u;
    search->scale = first_move(search, start);
    search->z_lower = (search->lower - search->origin) / search->scale;
    search->z_upper = (search->upper - search->origin) / search->scale;
    search->asks = false;
    const tl_search request = {
        .start = &zero,
        .start_value = search->candidates[start].value,
        .evaluate = replay_answer,
        .context = &replay,
    };
    (void)search->solver->minimise(search->optimiser, &request);
    *u = search->asked;
    return search->asks;
}

bool tl_event_search_next(tl_event_search *search, double *u) {
    if (tl_event_search_is_full(search) || tl_event_search_best(search)->value < TL_OBJECTIVE_TOLERANCE) {
        return false;
    }
    for (size_t i = 0; i < search->count; i++) {
        if (!is_plateau(search->candidates[i].side) && search->candidates[i].side != TL_EVENT_UNKNOWN) {
            return ask_solver(search, i, u) || leave_plateau(search, u);
        }
    }
    return leave_plateau(search, u);
}
