/* Nelder-Mead, BOBYQA, L-BFGS and Sbplx by NLopt.
 *
 * NLopt searches in v = (u − start)/unit, with a unit of about the first step. The start is exactly
 * 0, so that it is recognised and not evaluated again. In these units, one tolerance and one first
 * step fit variables of any size.
 *
 * NLopt's own stopping tests are not sufficient: it checks its time limit only between evaluations,
 * and NaN counts as success. So the caller stops the search from inside the objective. Some solvers
 * do not notice at once that they were stopped; they get no more values then.
 */
#include <math.h>
#include <nlopt.h>
#include <string.h>

#include "master/solve/optimiser.h"

/* A search ends if it moves by less than this part of the unit in every variable. */
static const double SMALLEST_STEP = 1e-6;

/* Distance of the points of a difference, in units. Its error is of the order h⁴ + ε/h, with ε the
 * precision of J. It is least at h = ε^(1/5): 7e-4 for the rounding of a double, 4e-3 for a model
 * that iterates to 1e-12. */
static const double DIFFERENCE = 1e-3;

/* The unit is the first step, or less if the bounds are closer than this many steps. BOBYQA needs
 * bounds that are two units apart, and moves a start away from a bound that is closer than one
 * unit. Nelder-Mead misses an optimum between bounds three times as often if its first step reaches
 * from one to the other. */
static const double UNITS_IN_BOUNDS = 4.0;

/* Corrections that L-BFGS stores. By default NLopt allocates and clears 40 MB for each search. */
enum { CORRECTIONS = 10 };

typedef struct nlopt_method {
    nlopt_algorithm algorithm;
    bool differentiates; /* it cannot search from a start that fails */
    double failure;      /* the worst value given to NLopt, also for HUGE_VAL */
} nlopt_method;

struct tl_optimiser {
    const nlopt_method *method;
    const tl_optimiser_space *space;
    nlopt_opt solver;
    double *unit;    /* unit of v, in u */
    double *lowest;  /* bounds of v */
    double *highest; /* the same */
    double *v;       /* NLopt's point */
    double *u;       /* the point to evaluate */
    const tl_search *search;
    double scale; /* unit of J; 0: not known yet */
    bool stopped; /* by the caller */
};

static bool is_start(const tl_optimiser *self) {
    for (size_t i = 0; i < self->space->count; i++) {
        if (self->u[i] != self->search->start[i]) {
            return false;
        }
    }
    return true;
}

/* J at self->u; false: stopped. */
static bool ask(tl_optimiser *self, double *value) {
    if (!self->stopped && is_start(self)) {
        *value = self->search->start_value;
    } else if (!self->stopped && !self->search->evaluate(self->search->context, self->u, value, NULL)) {
        self->stopped = true;
        (void)nlopt_force_stop(self->solver);
    }
    return !self->stopped;
}

/* Converts v to u; exactly on a bound if v is. */
static void set_point(tl_optimiser *self, const double *v) {
    const tl_optimiser_space *space = self->space;
    for (size_t i = 0; i < space->count; i++) {
        double u = self->search->start[i] + v[i] * self->unit[i];
        if (v[i] <= self->lowest[i]) {
            u = space->lower[i];
        } else if (v[i] >= self->highest[i]) {
            u = space->upper[i];
        }
        self->u[i] = fmin(fmax(u, space->lower[i]), space->upper[i]);
    }
}

/* Slope from the values here, at h and at 2h, as far as they exist. */
static double slope_of_rest(double here, double near, double far, double h) {
    if (!isfinite(near)) {
        return 0.0;
    }
    return isfinite(far) ? (4.0 * near - 3.0 * here - far) / (2.0 * h) : (near - here) / h;
}

/* Slope from the values here and at +2h, +h, −h, −2h. */
static double slope_between(double here, const double f[4], double h) {
    if (isfinite(f[0]) && isfinite(f[1]) && isfinite(f[2]) && isfinite(f[3])) {
        return (-f[0] + 8.0 * f[1] - 8.0 * f[2] + f[3]) / (12.0 * h);
    }
    const bool up = isfinite(f[1]) && (isfinite(f[0]) || !isfinite(f[2]));
    return up ? slope_of_rest(here, f[1], f[0], h) : slope_of_rest(here, f[2], f[3], -h);
}

/* Slope from the values here and at h, 2h, 3h, 4h; equally precise. */
static double slope_beside(double here, const double f[4], double h) {
    if (isfinite(f[0]) && isfinite(f[1]) && isfinite(f[2]) && isfinite(f[3])) {
        return (-25.0 * here + 48.0 * f[0] - 36.0 * f[1] + 16.0 * f[2] - 3.0 * f[3]) / (12.0 * h);
    }
    return slope_of_rest(here, f[0], f[1], h);
}

/* dJ/dv of one variable at self->u with J = `here`. Bounds are always some thousand h apart, so
 * there is room on at least one side. false: stopped. */
static bool find_slope(tl_optimiser *self, size_t i, double here, double *slope) {
    static const double around[] = {2.0, 1.0, -1.0, -2.0};
    static const double full_copy[] = {1.0, 2.0, 3.0, 4.0};
    const double u = self->u[i];
    const double lower = self->space->lower[i];
    const double upper = self->space->upper[i];
    double h = DIFFERENCE * self->unit[i];
    bool between = u - 2.0 * h >= lower && u + 2.0 * h <= upper;
    bool up = u + 4.0 * h <= upper;
    h = between || up ? h : -h;
    double f[4];
    bool answered = true;
    for (size_t k = 0; k < 4 && answered; k++) {
        self->u[i] = u + (between ? around[k] : full_copy[k]) * h;
        answered = ask(self, &f[k]);
    }
    self->u[i] = u;
    if (answered) {
        *slope = self->unit[i] * (between ? slope_between(here, f, h) : slope_beside(here, f, h));
    }
    return answered;
}

static void clear(tl_optimiser *self, double *gradient) {
    for (size_t i = 0; gradient != NULL && i < self->space->count; i++) {
        gradient[i] = 0.0;
    }
}

/* Gradient at self->u with J = `here`. The first step of L-BFGS is minus the first gradient; the
 * scale of J makes it one unit long. false: stopped. */
static bool differentiate(tl_optimiser *self, double here, double *gradient) {
    double squares = 0.0;
    for (size_t i = 0; i < self->space->count; i++) {
        if (!find_slope(self, i, here, &gradient[i])) {
            return false;
        }
        squares += gradient[i] * gradient[i];
    }
    if (self->scale == 0.0) {
        self->scale = squares > 0.0 ? sqrt(squares) : 1.0;
    }
    for (size_t i = 0; i < self->space->count; i++) {
        gradient[i] /= self->scale;
    }
    return true;
}

/* Evaluates a point of NLopt. Without a value the point counts as a failure, from which a solver
 * turns back. */
static double objective(unsigned count, const double *v, double *gradient, void *context) {
    (void)count;
    tl_optimiser *self = context;
    double value = HUGE_VAL;
    set_point(self, v);
    if (!ask(self, &value) || !isfinite(value) || (gradient != NULL && !differentiate(self, value, gradient))) {
        clear(self, gradient);
        return self->method->failure;
    }
    return fmin(self->scale > 0.0 ? value / self->scale : value, self->method->failure);
}

/* Sets the options of all searches. */
static bool configure(tl_optimiser *self) {
    return nlopt_set_min_objective(self->solver, objective, self) == NLOPT_SUCCESS &&
           nlopt_set_initial_step1(self->solver, 1.0) == NLOPT_SUCCESS &&
           nlopt_set_xtol_abs1(self->solver, SMALLEST_STEP) == NLOPT_SUCCESS &&
           nlopt_set_vector_storage(self->solver, CORRECTIONS) == NLOPT_SUCCESS;
}

static void destroy(tl_optimiser *self) {
    nlopt_destroy(self->solver);
    self->solver = NULL;
}

static tl_optimiser *create(tl_arena *arena, const tl_optimiser_space *space, const nlopt_method *method) {
    tl_optimiser *self = tl_arena_take(arena, 1, sizeof *self);
    double *numbers = tl_arena_take(arena, space->count, 5 * sizeof *numbers);
    if (self == NULL || numbers == NULL) {
        return NULL;
    }
    self->method = method;
    self->space = space;
    self->unit = numbers;
    self->lowest = self->unit + space->count;
    self->highest = self->lowest + space->count;
    self->v = self->highest + space->count;
    self->u = self->v + space->count;
    self->solver = nlopt_create(method->algorithm, (unsigned)space->count);
    if (self->solver == NULL || !configure(self)) {
        destroy(self);
        return NULL;
    }
    return self;
}

/* Sets the options of this search: its start is 0, and its bounds are relative to it. */
static bool begin(tl_optimiser *self, const tl_search *search) {
    const tl_optimiser_space *space = self->space;
    self->search = search;
    self->scale = 0.0;
    self->stopped = false;
    for (size_t i = 0; i < space->count; i++) {
        const double room = (space->upper[i] - space->lower[i]) / UNITS_IN_BOUNDS;
        self->unit[i] = fmin(space->step[i], room);
        self->v[i] = 0.0;
        self->lowest[i] = (space->lower[i] - search->start[i]) / self->unit[i];
        self->highest[i] = (space->upper[i] - search->start[i]) / self->unit[i];
    }
    return nlopt_set_lower_bounds(self->solver, self->lowest) == NLOPT_SUCCESS &&
           nlopt_set_upper_bounds(self->solver, self->highest) == NLOPT_SUCCESS;
}

static tl_search_end minimise(tl_optimiser *self, const tl_search *search) {
    double best = 0.0; /* the caller has kept the best point */
    nlopt_result result = NLOPT_INVALID_ARGS;
    if (self->method->differentiates && !isfinite(search->start_value)) {
        return TL_SEARCH_FAILED;
    }
    if (begin(self, search)) {
        result = nlopt_optimize(self->solver, self->v, &best);
    }
    self->search = NULL;
    if (self->stopped) {
        return TL_SEARCH_STOPPED; /* whatever a stopped solver returns */
    }
    if (!isfinite(self->scale)) {
        return TL_SEARCH_FAILED; /* the slope at the start was too large, and NLopt took it for none */
    }
    /* A limit by rounding counts as success. */
    return result > 0 || result == NLOPT_ROUNDOFF_LIMITED ? TL_SEARCH_DONE : TL_SEARCH_FAILED;
}

/* Value of a failed point. Nelder-Mead and Sbplx only compare values. BOBYQA computes with them: an
 * infinity in its model ends the search, this number turns it back; a smaller number may be below
 * values worth looking at. L-BFGS halves its step if a value is above 1e20. */
static const nlopt_method NELDER_MEAD = {NLOPT_LN_NELDERMEAD, false, HUGE_VAL};
static const nlopt_method BOBYQA = {NLOPT_LN_BOBYQA, false, 1e30};
static const nlopt_method L_BFGS = {NLOPT_LD_LBFGS, true, 1e30};
static const nlopt_method SBPLX = {NLOPT_LN_SBPLX, false, HUGE_VAL};

static tl_optimiser *create_nelder_mead(tl_arena *arena, const tl_optimiser_space *space) {
    return create(arena, space, &NELDER_MEAD);
}

static tl_optimiser *create_bobyqa(tl_arena *arena, const tl_optimiser_space *space) {
    return create(arena, space, &BOBYQA);
}

static tl_optimiser *create_lbfgs(tl_arena *arena, const tl_optimiser_space *space) {
    return create(arena, space, &L_BFGS);
}

static tl_optimiser *create_sbplx(tl_arena *arena, const tl_optimiser_space *space) {
    return create(arena, space, &SBPLX);
}

const tl_optimiser_class tl_nelder_mead = {
    .name = "nelder-mead",
    .number = 1,
    .create = create_nelder_mead,
    .minimise = minimise,
    .destroy = destroy,
};

const tl_optimiser_class tl_bobyqa = {
    .name = "bobyqa",
    .number = 1000,
    .create = create_bobyqa,
    .minimise = minimise,
    .destroy = destroy,
};

const tl_optimiser_class tl_lbfgs = {
    .name = "l-bfgs",
    .number = 100,
    .create = create_lbfgs,
    .minimise = minimise,
    .destroy = destroy,
};

const tl_optimiser_class tl_sbplx = {
    .name = "sbplx",
    .create = create_sbplx,
    .minimise = minimise,
    .destroy = destroy,
};
