/* Nelder-Mead by NLopt.
 *
 * NLopt's own stopping tests see too little (its time limit is looked at between evaluations only, and NaN counts as
 * success), so the asker stops the search from inside the objective.
 */
#include <math.h>
#include <nlopt.h>
#include <string.h>

#include "master/sync/optimiser.h"

/* The simplex is small enough when it is this part of the first step, in every variable. */
static const double SMALLEST_STEP = 1e-6;

struct tl_optimiser {
    nlopt_opt solver;
    size_t count;
    double *point; /* NLopt's working copy of u */
    const tl_search *search;
    bool at_start; /* NLopt's first question is the start point, whose value is known */
};

static double objective(unsigned count, const double *u, double *gradient, void *context) {
    (void)count;
    (void)gradient;
    tl_optimiser *self = context;
    if (self->at_start) {
        self->at_start = false;
        return self->search->start_value;
    }
    double value = HUGE_VAL;
    if (!self->search->evaluate(self->search->context, u, &value)) {
        (void)nlopt_force_stop(self->solver);
        return HUGE_VAL;
    }
    return value;
}

/* `point` is free until the first search: it carries the tolerances to NLopt, which copies them. */
static bool configure(tl_optimiser *self, const tl_optimiser_space *space) {
    for (size_t i = 0; i < space->count; i++) {
        self->point[i] = space->step[i] * SMALLEST_STEP;
    }
    return nlopt_set_min_objective(self->solver, objective, self) == NLOPT_SUCCESS &&
           nlopt_set_lower_bounds(self->solver, space->lower) == NLOPT_SUCCESS &&
           nlopt_set_upper_bounds(self->solver, space->upper) == NLOPT_SUCCESS &&
           nlopt_set_initial_step(self->solver, space->step) == NLOPT_SUCCESS &&
           nlopt_set_xtol_abs(self->solver, self->point) == NLOPT_SUCCESS;
}

static void destroy(tl_optimiser *self) {
    nlopt_destroy(self->solver);
    self->solver = NULL;
}

static tl_optimiser *create(tl_arena *arena, const tl_optimiser_space *space) {
    tl_optimiser *self = tl_arena_take(arena, 1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    self->count = space->count;
    self->point = tl_arena_take(arena, space->count, sizeof *self->point);
    self->solver = nlopt_create(NLOPT_LN_NELDERMEAD, (unsigned)space->count);
    if (self->point == NULL || self->solver == NULL || !configure(self, space)) {
        destroy(self);
        return NULL;
    }
    return self;
}

static void minimise(tl_optimiser *self, const tl_search *search) {
    double best = 0.0;
    self->search = search;
    self->at_start = true;
    memcpy(self->point, search->start, self->count * sizeof *self->point);
    (void)nlopt_set_force_stop(self->solver, 0);
    /* Every way to end is an ordinary one: the asker has kept the best point. */
    (void)nlopt_optimize(self->solver, self->point, &best);
    self->search = NULL;
}

const tl_optimiser_class tl_nelder_mead = {
    .name = "nelder-mead",
    .create = create,
    .minimise = minimise,
    .destroy = destroy,
};
