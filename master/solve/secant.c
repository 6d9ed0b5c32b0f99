/* Our own solver: damped least squares on the residual vector, with a secant slope that is kept
 * between steps.
 *
 * Purpose: from one step to the next, plant and slope change little. So the first guess is mostly
 *          committed, and the executions per step and FMU approach one. NLopt's solvers start each
 *          step without memory.
 * Method:  the slope G = ∂residuals/∂u is measured once, with one evaluation per unknown. Then
 *          Broyden's rank-one update follows each evaluation. A move Δ minimises |r + GΔ|² +
 *          damping·|Δ/step|² within the bounds; for one unknown and one residual that is the secant
 *          method. If G leads nowhere it is measured again.
 * Guess:   the same move from the forecast: the outputs if u stays, corrected by the slope.
 * Return:  a guess uses only the necessary part of the move: it returns to nominal as far as the
 *          residuals stay good enough. A zero residual would follow the noise with an input that
 *          the plant never had. States behind the matched outputs (a controller's integrator) would
 *          be pushed away, and the output's own return would be corrected away; over hours that
 *          grows without bound. So the limit is wider the noisier the measurement is, and the
 *          longer u has been on one side of nominal.
 * Hold:    with a u that is held over a long horizon, the move is only as long as J needs. The
 *          whole move would be the best line through the horizon, which soon leaves the tolerance
 *          on the other side. Each new u costs the executions of a whole horizon; a held one costs
 *          only its newest step.
 * Refused: a probe that cannot be evaluated is repeated to the other side, and with smaller steps.
 *          A column that could not be measured stays as it was and is tried again in the next
 *          search.
 *          If the start itself cannot be evaluated, the nearest point that can is looked for.
 * Rows:    a sample's residual of exactly 0 was not measured and does not count. A penalty of 0 is
 *          one at nominal and counts. A damping residual counts if it is damped in this search.
 * Source:  Broyden 1965 (update), Levenberg 1944 (damping).
 */
#include <math.h>
#include <string.h>

#include "master/solve/optimiser.h"

/* Largest move, in steps: a slope is local, and models return infinities for extreme values. */
static const double LONGEST_MOVE = 25.0;

/* In steps: a smaller move is not evaluated. */
static const double SHORTEST_MOVE = 1e-6;

/* Relative to the mean diagonal of GᵀG: keeps it solvable, and is the first damping after a
 * failure. */
static const double LEAST_DAMPING = 1e-12;
static const double FIRST_DAMPING = 1e-3;

/* Sum of squared residuals up to which a guess returns to nominal: GOOD_ENOUGH, or OF_NOISE times
 * the noise in the squares if that is more. */
static const double GOOD_ENOUGH = 0.03;
static const double OF_NOISE = 0.45;
static const double MOST_ENOUGH = 0.5; /* the tolerance must hold, whatever the noise is */

/* A lasting correction can raise this limit: by OF_LEAN times the change that the mean correction
 * over MEMORY steps causes in a residual, at most MOST_OF_LEAN per residual. */
static const double OF_LEAN = 0.8;
static const double MOST_OF_LEAN = 0.5;
static const double MEMORY = 256.0;

/* Target of J for a move to a held u. */
static const double HELD_GOAL = 0.3;

/* The last move confirmed the slope if its gain was within this part of the prediction. Then a
 * further move is not evaluated if it promises to reduce J by less than WORTHWHILE and not to reach
 * the tolerance. */
static const double CONFIRMED = 0.2;
static const double WORTHWHILE = 0.01;

/* An improvement of J by less than this part, so often in a row, is not progress. */
static const double PROGRESS = 1e-3;
enum { MOST_IDLE = 3, MOST_FAILURES = 8, FAILURES_TO_MEASURE = 2 };

/* Attempts to measure a column: to both sides, each pair with a quarter of the step before. */
enum { PROBES = 8, LOG2_SMALLER = -2 };

/* Distances at which a start is looked for: 1, 2, 4 … steps. */
enum { STARTS = 6 };

/* Iterations per unknown to find which ones are at a bound. */
enum { PASSES = 4 };

struct tl_optimiser {
    const tl_optimiser_space *space;
    size_t unknowns;
    size_t residuals;
    bool has_slope;
    double damping;
    double longest; /* of a move, in steps */
    double *slope;  /* [residual · unknowns + unknown], per step of the unknown */
    double *normal; /* GᵀG, then its Cholesky factor */
    double *move;   /* in steps */
    bool *fixed;    /* at a bound */
    bool *known;    /* its column was measured */
    double *point;
    double *r; /* at point */
    double *trial;
    double *expected; /* residuals after the moves that are fixed; then what the move changes */
    double *further;  /* change by continuing from the move to nominal */
    double *lean;     /* slow mean of u − nominal, in steps */
    double *leaned;   /* its value before the last guess */
    double value;     /* J at point */
    double promised;  /* J at the guess if trial is one; else NaN */
    const tl_search *search;
};

static tl_optimiser *create(tl_arena *arena, const tl_optimiser_space *space) {
    tl_optimiser *self = tl_arena_take(arena, 1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    self->space = space;
    self->promised = (double)NAN;
    self->unknowns = space->count;
    self->residuals = space->residual_count;
    self->slope = tl_arena_take(arena, space->residual_most * self->unknowns, sizeof *self->slope);
    self->normal = tl_arena_take(arena, self->unknowns * self->unknowns, sizeof *self->normal);
    self->move = tl_arena_take(arena, self->unknowns, sizeof *self->move);
    self->fixed = tl_arena_take(arena, self->unknowns, sizeof *self->fixed);
    self->known = tl_arena_take(arena, self->unknowns, sizeof *self->known);
    self->point = tl_arena_take(arena, self->unknowns, sizeof *self->point);
    self->trial = tl_arena_take(arena, self->unknowns, sizeof *self->trial);
    self->r = tl_arena_take(arena, space->residual_most, sizeof *self->r);
    self->expected = tl_arena_take(arena, space->residual_most, sizeof *self->expected);
    self->further = tl_arena_take(arena, space->residual_most, sizeof *self->further);
    self->lean = tl_arena_take(arena, self->unknowns, sizeof *self->lean);
    self->leaned = tl_arena_take(arena, self->unknowns, sizeof *self->leaned);
    bool taken = self->slope != NULL && self->normal != NULL && self->move != NULL && self->fixed != NULL &&
                 self->known != NULL && self->point != NULL && self->trial != NULL && self->r != NULL &&
                 self->expected != NULL && self->further != NULL && self->lean != NULL && self->leaned != NULL;
    return taken ? self : NULL;
}

static void destroy(tl_optimiser *self) {
    (void)self;
}

static double within(const tl_optimiser *self, size_t k, double value) {
    return fmin(fmax(value, self->space->lower[k]), self->space->upper[k]);
}

/* Whether a residual at `point` counts. */
static bool counts(const tl_optimiser *self, size_t i) {
    size_t samples = self->space->sample_count;
    if (i < samples) {
        return fabs(self->r[i]) > 0.0;
    }
    return i - samples >= self->space->damping_count || self->space->damped[i - samples];
}

/* ---- the move ---- */

/* GᵀG over the measured rows and the free unknowns into `normal`, −Gᵀr into `move`; the mean of its
 * diagonal. */
static double form_normal(tl_optimiser *self, const double *r) {
    size_t n = self->unknowns;
    memset(self->normal, 0, n * n * sizeof *self->normal);
    memset(self->move, 0, n * sizeof *self->move);
    for (size_t i = 0; i < self->residuals; i++) {
        const double *row = &self->slope[i * n];
        for (size_t k = 0; k < n && counts(self, i); k++) {
            self->move[k] -= row[k] * r[i];
            for (size_t l = 0; l <= k; l++) {
                self->normal[k * n + l] += row[k] * row[l];
            }
        }
    }
    double trace = 0.0;
    for (size_t k = 0; k < n; k++) {
        trace += self->normal[k * n + k];
    }
    return trace / (double)n;
}

/* Removes an unknown that is at a bound from the system. */
static void take_out_fixed(tl_optimiser *self) {
    size_t n = self->unknowns;
    for (size_t k = 0; k < n; k++) {
        for (size_t l = 0; l <= k; l++) {
            if (self->fixed[k] || self->fixed[l]) {
                self->normal[k * n + l] = k == l ? 1.0 : 0.0;
            }
        }
        self->move[k] = self->fixed[k] ? 0.0 : self->move[k];
    }
}

/* Cholesky factorisation; false if the matrix is not positive definite. */
static bool factor(double *a, size_t n) {
    for (size_t k = 0; k < n; k++) {
        for (size_t l = 0; l <= k; l++) {
            double sum = a[k * n + l];
            for (size_t i = 0; i < l; i++) {
                sum -= a[k * n + i] * a[l * n + i];
            }
            if (k != l) {
                a[k * n + l] = sum / a[l * n + l];
            } else if (sum > 0.0 && isfinite(sum)) {
                a[k * n + k] = sqrt(sum);
            } else {
                return false;
            }
        }
    }
    return true;
}

static void substitute(const double *a, size_t n, double *x) {
    for (size_t k = 0; k < n; k++) {
        for (size_t l = 0; l < k; l++) {
            x[k] -= a[k * n + l] * x[l];
        }
        x[k] /= a[k * n + k];
    }
    for (size_t k = n; k-- > 0;) {
        for (size_t l = k + 1; l < n; l++) {
            x[k] -= a[l * n + k] * x[l];
        }
        x[k] /= a[k * n + k];
    }
}

/* The same for one unknown, the usual case: a quotient. */
static bool solve_one(tl_optimiser *self, const double *r) {
    double square = 0.0;
    double slope = 0.0;
    for (size_t i = 0; i < self->residuals; i++) {
        if (counts(self, i)) {
            square += self->slope[i] * self->slope[i];
            slope -= self->slope[i] * r[i];
        }
    }
    if (!(square > 0.0) || !isfinite(square)) {
        return false;
    }
    self->move[0] = self->fixed[0] ? 0.0 : slope / (square * (1.0 + self->damping + LEAST_DAMPING));
    return true;
}

/* The damped move of the free unknowns from residuals r; false if there is none. */
static bool solve(tl_optimiser *self, const double *r) {
    size_t n = self->unknowns;
    if (n == 1) {
        return solve_one(self, r);
    }
    double mean = form_normal(self, r);
    if (!(mean > 0.0) || !isfinite(mean)) {
        return false;
    }
    for (size_t k = 0; k < n; k++) {
        self->normal[k * n + k] += mean * (self->damping + LEAST_DAMPING);
    }
    take_out_fixed(self);
    if (!factor(self->normal, n)) {
        return false;
    }
    substitute(self->normal, n, self->move);
    return true;
}

/* Predicted change from point to trial, into `expected`. */
static void expect_changes(tl_optimiser *self) {
    size_t n = self->unknowns;
    for (size_t i = 0; i < self->residuals; i++) {
        self->expected[i] = 0.0;
        for (size_t k = 0; k < n; k++) {
            double move = (self->trial[k] - self->point[k]) / self->space->step[k];
            self->expected[i] += self->slope[i * n + k] * move;
        }
    }
}

/* r after the fixed moves, into `expected`. */
static void expect_fixed(tl_optimiser *self) {
    memcpy(self->expected, self->r, self->residuals * sizeof *self->r);
    for (size_t k = 0; k < self->unknowns; k++) {
        double made = (self->trial[k] - self->point[k]) / self->space->step[k];
        for (size_t i = 0; i < self->residuals && self->fixed[k]; i++) {
            self->expected[i] += self->slope[i * self->unknowns + k] * made;
        }
    }
}

/* Result of the move, into `trial`. An unknown that would leave its bounds is fixed there; returns
 * whether that happened. */
static bool fix_at_bounds(tl_optimiser *self) {
    const tl_optimiser_space *space = self->space;
    bool any = false;
    double largest = self->longest;
    for (size_t k = 0; k < self->unknowns; k++) {
        largest = fmax(largest, self->fixed[k] ? 0.0 : fabs(self->move[k]));
    }
    for (size_t k = 0; k < self->unknowns; k++) {
        if (self->fixed[k]) {
            continue;
        }
        double move = self->move[k] * (self->longest / largest); /* shorter, in the same direction */
        double wanted = self->point[k] + move * space->step[k];
        self->trial[k] = within(self, k, wanted);
        self->fixed[k] = wanted < space->lower[k] || wanted > space->upper[k];
        any = any || self->fixed[k];
    }
    return any;
}

/* Slope of J by unknown k at `trial`, whose changes are in `expected`. */
static double derivative(const tl_optimiser *self, size_t k) {
    double sum = 0.0;
    for (size_t i = 0; i < self->residuals; i++) {
        if (counts(self, i)) {
            sum += self->slope[i * self->unknowns + k] * (self->r[i] + self->expected[i]);
        }
    }
    return sum;
}

/* Frees an unknown that was fixed at a bound together with others but should move inside; returns
 * whether there was one. */
static bool release_unknowns(tl_optimiser *self, const bool *free) {
    const tl_optimiser_space *space = self->space;
    for (size_t k = 0; k < self->unknowns && self->unknowns > 1; k++) {
        if (!self->fixed[k] || (free != NULL && !free[k])) {
            continue;
        }
        expect_changes(self);
        double slope = derivative(self, k);
        if (self->trial[k] >= space->upper[k] ? slope > 0.0 : slope < 0.0) {
            self->fixed[k] = false;
            return true;
        }
    }
    return false;
}

/* The best point within the bounds by the slope, into `trial`. `free`: the unknowns that may move;
 * NULL: all. */
static bool propose(tl_optimiser *self, const bool *free) {
    for (size_t k = 0; k < self->unknowns; k++) {
        self->fixed[k] = free != NULL && !free[k];
    }
    memcpy(self->trial, self->point, self->unknowns * sizeof *self->point);
    bool again = true;
    for (size_t pass = 0; again && pass < PASSES * self->unknowns; pass++) {
        expect_fixed(self);
        if (!solve(self, self->expected)) {
            return false;
        }
        again = fix_at_bounds(self) || release_unknowns(self, free);
    }
    return true;
}

/* ---- prediction ---- */

/* Squares of the residuals after the part `share` of the move whose changes are in `expected`; rows
 * as in propose(). */
static double promise(const tl_optimiser *self, double share) {
    double sum = 0.0;
    for (size_t i = 0; i < self->residuals; i++) {
        double r = counts(self, i) ? self->r[i] + share * self->expected[i] : 0.0;
        sum += r * r;
    }
    return sum;
}

/* Part of the move at which the predicted parabola reaches the goal; 1 if it does not. */
static double share_for(const tl_optimiser *self, double goal) {
    double here = promise(self, 0.0);
    double bend = 0.5 * (promise(self, 1.0) + promise(self, -1.0)) - here;
    double fall = 0.5 * (promise(self, -1.0) - promise(self, 1.0));
    double root = fall * fall - 4.0 * bend * (here - goal);
    if (!(here > goal) || !(bend > 0.0) || !(root > 0.0)) {
        return 1.0;
    }
    double share = (fall - sqrt(root)) / (2.0 * bend);
    return share > 0.0 && share < 1.0 ? share : 1.0;
}

/* Shortens a move of a held u as far as possible. Returns its predicted J. */
static double shorten(tl_optimiser *self) {
    expect_changes(self);
    double share = self->space->held ? share_for(self, HELD_GOAL) : 1.0;
    if (share < 1.0) {
        for (size_t k = 0; k < self->unknowns; k++) {
            self->trial[k] = self->point[k] + share * (self->trial[k] - self->point[k]);
        }
    }
    return promise(self, share);
}

/* ---- smallest sufficient correction ---- */

/* Predicted change from trial to nominal with the free unknowns, into `further`. */
static void expect_return(tl_optimiser *self, const tl_forecast *forecast) {
    size_t n = self->unknowns;
    for (size_t i = 0; i < self->residuals; i++) {
        self->further[i] = 0.0;
        for (size_t k = 0; k < n && counts(self, i); k++) {
            double distance = forecast->free[k] ? within(self, k, forecast->nominal[k]) - self->trial[k] : 0.0;
            self->further[i] += self->slope[i * n + k] * distance / self->space->step[k];
        }
    }
}

/* Updates the mean distance of u from nominal. */
static void watch_lean(tl_optimiser *self, const tl_forecast *forecast) {
    for (size_t k = 0; k < self->unknowns; k++) {
        double away = (forecast->u[k] - forecast->nominal[k]) / self->space->step[k];
        self->lean[k] += (away - self->lean[k]) / MEMORY;
    }
}

/* Allowed square of a residual because of a lasting correction to one side. */
static double leaning(const tl_optimiser *self, const tl_forecast *forecast, size_t i) {
    double effect = 0.0;
    for (size_t k = 0; k < self->unknowns; k++) {
        effect += forecast->free[k] ? self->slope[i * self->unknowns + k] * self->lean[k] : 0.0;
    }
    double allowed = fmin(OF_LEAN * fabs(effect), MOST_OF_LEAN);
    return allowed * allowed;
}

/* How far trial can return to nominal while the predicted residuals stay good enough; their squares
 * are a parabola. */
static double share_of_return(const tl_optimiser *self, const tl_forecast *forecast) {
    double here = 0.0;
    double rise = 0.0;
    double bend = 0.0;
    double noise = 0.0;
    double lean = 0.0;
    for (size_t i = 0; i < self->residuals; i++) {
        if (fabs(self->further[i]) > 0.0) {
            double r = self->r[i] + self->expected[i];
            here += r * r;
            rise += 2.0 * r * self->further[i];
            bend += self->further[i] * self->further[i];
            noise += forecast->noise[i];
            lean += leaning(self, forecast, i);
        }
    }
    double goal = fmin(fmax(fmax(GOOD_ENOUGH, OF_NOISE * noise), lean), MOST_ENOUGH);
    if (here >= goal) {
        return 0.0;
    }
    if (here + rise + bend <= goal) {
        return 1.0;
    }
    return (sqrt(rise * rise - 4.0 * bend * (here - goal)) - rise) / (2.0 * bend);
}

/* Removes the unnecessary part of the move to trial. Returns the predicted J of the rest. */
static double relax(tl_optimiser *self, const tl_forecast *forecast) {
    expect_return(self, forecast);
    double share = share_of_return(self, forecast);
    for (size_t k = 0; k < self->unknowns; k++) {
        double nominal = within(self, k, forecast->nominal[k]);
        if (forecast->free[k]) {
            self->trial[k] = share < 1.0 ? self->trial[k] + share * (nominal - self->trial[k]) : nominal;
        }
    }
    for (size_t i = 0; i < self->residuals; i++) {
        self->expected[i] += share * self->further[i];
    }
    return promise(self, 1.0);
}

/* ---- the slope ---- */

/* Broyden: the smallest change of G that explains the change from point to `u`. */
static void learn(tl_optimiser *self, const double *u, const double *r) {
    size_t n = self->unknowns;
    double length = 0.0;
    for (size_t k = 0; k < n; k++) {
        self->move[k] = (u[k] - self->point[k]) / self->space->step[k];
        length += self->move[k] * self->move[k];
    }
    for (size_t i = 0; i < self->residuals && length > 0.0; i++) {
        double error = r[i] - self->r[i];
        if (!(fabs(r[i]) > 0.0) && !(fabs(self->r[i]) > 0.0)) {
            continue;
        }
        for (size_t k = 0; k < n; k++) {
            error -= self->slope[i * n + k] * self->move[k];
        }
        for (size_t k = 0; k < n; k++) {
            self->slope[i * n + k] += error / length * self->move[k];
        }
    }
}

static void move_to(tl_optimiser *self, const double *u, const double *r, double value) {
    memmove(self->point, u, self->unknowns * sizeof *u);
    memmove(self->r, r, self->residuals * sizeof *r);
    self->value = value;
}

/* First attempt: a step up, or down if there is more room. Then to the other side, then smaller. */
static double probe_point(const tl_optimiser *self, size_t k, int attempt) {
    double at = self->point[k];
    double step = ldexp(self->space->step[k], LOG2_SMALLER * (attempt / 2));
    double up = self->space->upper[k] - at;
    double down = at - self->space->lower[k];
    bool is_up = (up >= step || up >= down) == (attempt % 2 == 0);
    return is_up ? fmin(at + step, self->space->upper[k]) : fmax(at - step, self->space->lower[k]);
}

/* Evaluates the point with one unknown moved, and continues from there if it is better. False:
 * stopped. */
static bool probe(tl_optimiser *self, size_t k, double value_of_k, double *value, const double **r) {
    memcpy(self->trial, self->point, self->unknowns * sizeof *self->trial);
    self->trial[k] = value_of_k;
    *value = HUGE_VAL;
    return self->search->evaluate(self->search->context, self->trial, value, r);
}

/* Measures one column. False: stopped. */
static bool measure_column(tl_optimiser *self, size_t k) {
    size_t n = self->unknowns;
    double value = HUGE_VAL;
    const double *r = NULL;
    bool may_continue = true;
    for (int attempt = 0; attempt < PROBES && !isfinite(value) && may_continue; attempt++) {
        double at = probe_point(self, k, attempt);
        double made = (at - self->point[k]) / self->space->step[k];
        if (attempt > 0 && !(fabs(made) > SHORTEST_MOVE)) {
            continue;
        }
        may_continue = probe(self, k, at, &value, &r);
        for (size_t i = 0; i < self->residuals && isfinite(value); i++) {
            self->slope[i * n + k] = (r[i] - self->r[i]) / made;
        }
    }
    self->known[k] = self->known[k] || isfinite(value);
    if (r != NULL && isfinite(value) && value < self->value) {
        move_to(self, self->trial, r, value);
    }
    return may_continue;
}

/* Measures the columns, or only those that are not known. Continues from the best point. False:
 * stopped. */
static bool measure(tl_optimiser *self, bool only_unknown) {
    bool may_continue = true;
    size_t k = 0;
    for (; k < self->unknowns && may_continue; k++) {
        may_continue = (only_unknown && self->known[k]) || measure_column(self, k);
    }
    bool any = may_continue ? false : self->known[self->unknowns - 1];
    for (size_t i = 0; i < self->unknowns && may_continue; i++) {
        any = any || self->known[i];
    }
    self->has_slope = self->has_slope || (any && k == self->unknowns);
    return may_continue;
}

/* ---- the search ---- */

static double largest_move(const tl_optimiser *self) {
    double largest = 0.0;
    for (size_t k = 0; k < self->unknowns; k++) {
        largest = fmax(largest, fabs(self->trial[k] - self->point[k]) / self->space->step[k]);
    }
    return largest;
}

/* State of a search. */
typedef struct tl_course {
    int failures;   /* in a row */
    int idle;       /* moves with little progress in a row */
    bool fresh;     /* the slope was measured at this point */
    bool completed; /* columns that were not known were tried again */
    bool confirmed; /* by the last move */
} tl_course;

/* Whether the move from point had the predicted gain. */
static bool is_confirmed(const tl_optimiser *self, double promised, double value) {
    return fabs(value - promised) < CONFIRMED * (self->value - promised);
}

/* Processes a candidate: accepts a better one, else increases the damping. */
static void use_result(tl_optimiser *self, tl_course *course, double promised, double value, const double *r) {
    course->confirmed = is_confirmed(self, promised, value);
    if (isfinite(value)) {
        learn(self, self->trial, r);
    }
    if (value < self->value) {
        course->idle = value > self->value * (1.0 - PROGRESS) ? course->idle + 1 : 0;
        course->failures = 0;
        course->fresh = false;
        self->damping = self->damping > FIRST_DAMPING ? self->damping / 8.0 : 0.0;
        move_to(self, self->trial, r, value);
    } else {
        self->longest = isfinite(value) ? self->longest : 0.5 * largest_move(self);
        course->failures++;
        self->damping = fmax(8.0 * self->damping, FIRST_DAMPING);
    }
}

/* Whether a move with this predicted J is not worth an evaluation. */
static bool is_at_end(const tl_optimiser *self, const tl_course *course, double promised) {
    return course->confirmed && promised >= TL_OBJECTIVE_TOLERANCE && promised > (1.0 - WORTHWHILE) * self->value;
}

static void begin(tl_optimiser *self, tl_course *course, const tl_search *search) {
    self->search = search;
    self->damping = 0.0;
    self->longest = LONGEST_MOVE;
    bool guessed = memcmp(self->trial, search->start, self->unknowns * sizeof *self->trial) == 0;
    course->confirmed = guessed && is_confirmed(self, self->promised, search->start_value);
    self->promised = (double)NAN;
    move_to(self, search->start, search->start_residuals, search->start_value);
}

static bool is_complete(const tl_optimiser *self) {
    size_t k = 0;
    while (k < self->unknowns && self->known[k]) {
        k++;
    }
    return k == self->unknowns;
}

/* Measures the slope if there is none, if a column is missing, or if it leads nowhere. False:
 * stopped. */
static bool renew_slope(tl_optimiser *self, tl_course *course) {
    bool completes = self->has_slope && !course->completed && !is_complete(self);
    course->completed = true;
    if (completes) {
        return measure(self, true);
    }
    if (self->has_slope && (course->failures < FAILURES_TO_MEASURE || course->fresh)) {
        return true;
    }
    course->fresh = measure(self, false);
    return course->fresh;
}

/* The nearest point that can be evaluated, on either side of each unknown in turn. *stopped: the
 * caller has stopped the search. Returns false if there is none. */
static bool find_start(tl_optimiser *self, bool *stopped) {
    for (int i = 0; i < STARTS; i++) {
        for (size_t k = 0; k < 2 * self->unknowns && !*stopped; k++) {
            double value = HUGE_VAL;
            const double *r = NULL;
            double move = ldexp(k % 2 == 0 ? 1.0 : -1.0, i) * self->space->step[k / 2];
            *stopped = !probe(self, k / 2, within(self, k / 2, self->point[k / 2] + move), &value, &r);
            if (r != NULL && isfinite(value)) {
                move_to(self, self->trial, r, value);
                return true;
            }
        }
    }
    return false;
}

/* Evaluates the move to trial. False: stopped. */
static bool ask(tl_optimiser *self, tl_course *course, double promised) {
    double value = HUGE_VAL;
    const double *r = NULL;
    bool may_continue = self->search->evaluate(self->search->context, self->trial, &value, &r);
    use_result(self, course, promised, value, r);
    return may_continue;
}

static tl_search_end minimise(tl_optimiser *self, const tl_search *search) {
    tl_course course = {0};
    bool stopped = false;
    begin(self, &course, search);
    if (!isfinite(self->value) && !find_start(self, &stopped)) {
        return stopped ? TL_SEARCH_STOPPED : TL_SEARCH_FAILED;
    }
    if (stopped) {
        return TL_SEARCH_STOPPED;
    }
    while (course.failures < MOST_FAILURES && course.idle < MOST_IDLE) {
        if (!renew_slope(self, &course)) {
            return TL_SEARCH_STOPPED;
        }
        bool found = propose(self, NULL) && largest_move(self) > SHORTEST_MOVE;
        if (!found && (course.fresh || course.confirmed)) {
            return TL_SEARCH_DONE;
        }
        if (!found) {
            course.failures = FAILURES_TO_MEASURE;
            continue;
        }
        double promised = shorten(self);
        if (is_at_end(self, &course, promised)) {
            return TL_SEARCH_DONE;
        }
        if (!ask(self, &course, promised)) {
            return TL_SEARCH_STOPPED;
        }
    }
    return TL_SEARCH_DONE;
}

/* At the point. */
static double squares(const tl_optimiser *self) {
    double sum = 0.0;
    for (size_t i = 0; i < self->residuals; i++) {
        sum += counts(self, i) ? self->r[i] * self->r[i] : 0.0;
    }
    return sum;
}

/* Guesses u from the forecast. With a held u (tl_optimiser_space.held), u stays while J is within
 * tolerance. */
static bool guess(tl_optimiser *self, const tl_forecast *forecast, double *u) {
    memcpy(self->leaned, self->lean, self->unknowns * sizeof *self->lean);
    if (!self->has_slope) {
        return false;
    }
    self->damping = 0.0;
    self->longest = LONGEST_MOVE;
    move_to(self, forecast->u, forecast->residuals, 0.0);
    self->value = squares(self);
    watch_lean(self, forecast);
    bool stays = self->space->held && self->value < TL_OBJECTIVE_TOLERANCE;
    if (!stays && !propose(self, forecast->free)) {
        return false;
    }
    self->promised = stays ? (double)NAN : shorten(self);
    if (!stays && !self->space->held) {
        self->promised = relax(self, forecast);
    }
    memcpy(u, stays ? self->point : self->trial, self->unknowns * sizeof *u);
    return true;
}

static void retract(tl_optimiser *self) {
    memcpy(self->lean, self->leaned, self->unknowns * sizeof *self->lean);
    memcpy(self->trial, self->point, self->unknowns * sizeof *self->point);
    self->promised = (double)NAN;
}

/* The slope stays valid. A prediction was in the old units. */
static void retune(tl_optimiser *self, const double *factors) {
    size_t n = self->unknowns;
    bool same = true;
    for (size_t i = 0; i < self->space->residual_most; i++) {
        same = same && !(factors[i] < 1.0) && !(factors[i] > 1.0);
        for (size_t k = 0; k < n; k++) {
            self->slope[i * n + k] *= factors[i];
        }
    }
    self->residuals = self->space->residual_count;
    self->promised = same ? self->promised : (double)NAN;
}

static bool is_new(const tl_optimiser *self) {
    return !self->has_slope;
}

static const double *stored_slope(const tl_optimiser *self) {
    return self->has_slope && is_complete(self) ? self->slope : NULL;
}

static void forget(tl_optimiser *self) {
    self->has_slope = false;
    self->promised = (double)NAN;
    memset(self->known, 0, self->unknowns * sizeof *self->known);
    memset(self->slope, 0, self->residuals * self->unknowns * sizeof *self->slope);
    memset(self->lean, 0, self->unknowns * sizeof *self->lean);
}

const tl_optimiser_class tl_secant = {
    .name = "secant",
    .create = create,
    .guess = guess,
    .retract = retract,
    .minimise = minimise,
    .is_new = is_new,
    .slope = stored_slope,
    .retune = retune,
    .forget = forget,
    .destroy = destroy,
};
