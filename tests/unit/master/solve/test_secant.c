/* The secant solver alone: its evaluations of functions with known residuals, and its memory. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "master/solve/optimiser.h"

enum { MOST = 3, ROWS = 4, ASKED = 400 };

/* Computes the residuals of u; false if the point fails. */
typedef bool function(const double *u, double *residuals);

static tl_arena arena;
static tl_optimiser *solver;
static double step[MOST];
static double lower[MOST];
static double upper[MOST];
static tl_optimiser_space space;

static function *asked_function;
static size_t questions;
static size_t limit; /* the search is stopped at this evaluation; 0: never */
static double good_enough;
static const double quiet[ROWS];
static double asked[ASKED][MOST];
static double answered[ROWS];
static double best[MOST];
static double best_value;

void setUp(void) {
    tl_arena_init(&arena);
    solver = NULL;
    limit = 0;
    good_enough = 1e-12;
    for (size_t i = 0; i < MOST; i++) {
        step[i] = 1.0;
        lower[i] = -HUGE_VAL;
        upper[i] = HUGE_VAL;
    }
}

void tearDown(void) {
    if (solver != NULL) {
        tl_secant.destroy(solver);
    }
    tl_arena_release(&arena);
}

static void create(size_t unknowns, size_t residual_count) {
    space = (tl_optimiser_space){.count = unknowns,
                                 .step = step,
                                 .lower = lower,
                                 .upper = upper,
                                 .residual_count = residual_count,
                                 .residual_most = residual_count,
                                 .sample_count = residual_count};
    solver = tl_secant.create(&arena, &space);
    TEST_ASSERT_NOT_NULL(solver);
    tl_arena_seal(&arena); /* later allocations would fail */
}

/* Returns J and sets the residuals at u. */
static double evaluate(const double *u, double *residuals) {
    double sum = 0.0;
    if (!asked_function(u, residuals)) {
        return HUGE_VAL;
    }
    for (size_t i = 0; i < space.residual_count; i++) {
        sum += residuals[i] * residuals[i];
    }
    return sum;
}

static bool answer(void *context, const double *u, double *value, const double **residuals) {
    (void)context;
    TEST_ASSERT_TRUE(questions < ASKED && (limit == 0 || questions < limit));
    for (size_t i = 0; i < space.count; i++) {
        TEST_ASSERT_TRUE(isfinite(u[i]));
        TEST_ASSERT_TRUE(u[i] >= lower[i] && u[i] <= upper[i]);
    }
    memcpy(asked[questions], u, space.count * sizeof *u);
    questions++;
    *value = evaluate(u, answered);
    *residuals = answered;
    if (*value < best_value) {
        best_value = *value;
        memcpy(best, u, space.count * sizeof *u);
    }
    return best_value >= good_enough && (limit == 0 || questions < limit);
}

static tl_search_end search(function *of, const double *start) {
    static double residuals[ROWS];
    asked_function = of;
    questions = 0;
    best_value = evaluate(start, residuals);
    memcpy(best, start, space.count * sizeof *start);
    const tl_search the_search = {start, best_value, residuals, answer, NULL};
    return tl_secant.minimise(solver, &the_search);
}

/* ---- lines ---- */

static double slope = 2.0;
static double target = 3.0;

static bool line(const double *u, double *r) {
    r[0] = slope * (u[0] - target);
    return true;
}

static void a_line_needs_the_slope_and_one_question(void) {
    const double start[] = {0.0};
    slope = 2.0;
    target = 3.0;
    create(1, 1);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
    TEST_ASSERT_EQUAL_UINT64(2, questions);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, asked[0][0]); /* a step from the start */
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 3.0, best[0]);
}

static void a_slope_that_is_remembered_is_not_measured_again(void) {
    const double starts[] = {0.0, 7.0, -4.5, 3.5, 1e-3};
    slope = 2.0;
    create(1, 1);
    for (size_t i = 0; i < 5; i++) {
        target = 3.0 + 0.5 * (double)i;
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, &starts[i]));
        TEST_ASSERT_EQUAL_UINT64(i == 0 ? 2 : 1, questions);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, target, best[0]);
    }
}

/* After a change of the tolerance, residuals have other units. The known slope is converted. */
static void a_slope_goes_along_into_other_units(void) {
    const double factors[ROWS] = {20.0, 20.0, 20.0, 20.0};
    const double start[] = {0.0};
    const double later[] = {5.0};
    slope = 2.0;
    target = 3.0;
    create(1, 1);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
    slope *= 20.0;
    tl_secant.retune(solver, factors);
    target = -4.0;
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, later));
    TEST_ASSERT_EQUAL_UINT64(1, questions);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, -4.0, best[0]);
}

/* New residuals are learned from the first evaluation; removed ones are forgotten. */
static bool line_and_penalty(const double *u, double *r) {
    r[0] = 2.0 * (u[0] - target);
    r[1] = 0.5 * u[0];
    return true;
}

static void residuals_may_come_and_go(void) {
    const double same[ROWS] = {1.0, 1.0, 1.0, 1.0};
    const double gone[ROWS] = {1.0, 0.0, 1.0, 1.0};
    const double start[] = {0.0};
    slope = 2.0;
    target = 3.0;
    good_enough = 1e-12;
    create(1, 2);
    space.residual_count = 1;
    tl_secant.retune(solver, gone);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0, best[0]);
    space.residual_count = 2;
    space.sample_count = 1;
    tl_secant.retune(solver, same);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(line_and_penalty, start));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 12.0 / 4.25, best[0]);
    TEST_ASSERT_TRUE(questions <= 4);
    space.residual_count = 1;
    tl_secant.retune(solver, gone);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
    TEST_ASSERT_EQUAL_UINT64(1, questions);
}

static void a_slope_whose_last_question_was_good_enough_is_remembered(void) {
    const double start[] = {0.0};
    slope = 2.0;
    target = 1.0;
    create(1, 1);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
    TEST_ASSERT_EQUAL_UINT64(1, questions);
    target = 7.0;
    (void)search(line, start);
    TEST_ASSERT_EQUAL_UINT64(1, questions);
}

static void a_wrong_slope_is_recovered_from(void) {
    static const double others[] = {-2.0, 20.0, 0.1, -0.02, 2000.0};
    const double start[] = {0.0};
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        tearDown();
        setUp();
        slope = 2.0;
        target = 3.0;
        create(1, 1);
        (void)search(line, start);
        slope = others[i];
        good_enough = 1e-9;
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
        TEST_ASSERT_TRUE(questions <= 12);
        TEST_ASSERT_DOUBLE_WITHIN(1e-2, 3.0, best[0]);
        (void)search(line, start); /* learns the new slope */
        TEST_ASSERT_TRUE(questions <= 2);
    }
}

static void steps_of_any_size_do(void) {
    static const double sizes[] = {1e-9, 1e-3, 1.0, 1e6};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        const double start[] = {0.0};
        tearDown();
        setUp();
        step[0] = sizes[i];
        slope = 1.0 / sizes[i];
        target = 5.0 * sizes[i];
        create(1, 1);
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
        TEST_ASSERT_EQUAL_UINT64(2, questions);
    }
}

static void a_move_is_no_longer_than_25_steps(void) {
    const double start[] = {0.0};
    slope = 1.0;
    target = 1000.0;
    limit = 2;
    create(1, 1);
    (void)search(line, start);
    TEST_ASSERT_EQUAL_DOUBLE(25.0 + asked[0][0], asked[1][0]); /* moves on from the better point of the slope */
}

/* ---- curves ---- */

static bool curve(const double *u, double *r) {
    r[0] = 10.0 * (exp(0.2 * u[0]) - 2.0);
    return true;
}

static void a_curve_is_followed(void) {
    const double starts[] = {0.0, -6.0, 12.0};
    for (size_t i = 0; i < 3; i++) {
        tearDown();
        setUp();
        good_enough = 1e-8;
        create(1, 1);
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(curve, &starts[i]));
        TEST_ASSERT_TRUE(questions <= 16);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, log(2.0) / 0.2, best[0]);
    }
}

static double fails_above;

static bool cliff(const double *u, double *r) {
    r[0] = u[0] - 1.9;
    return u[0] <= fails_above;
}

static void points_that_fail_are_turned_back_from(void) {
    const double start[] = {0.0};
    fails_above = 2.0;
    step[0] = 3.0; /* the evaluation for the slope fails */
    good_enough = 1e-6;
    create(1, 1);
    (void)search(cliff, start);
    TEST_ASSERT_TRUE(best[0] <= 2.0);
    TEST_ASSERT_TRUE(questions < 100);
}

static bool always_fails(const double *u, double *r) {
    (void)u;
    r[0] = 1.0;
    return false;
}

/* A start is searched 1, 2, 4 … 32 steps away on both sides. */
static void a_start_is_looked_for_up_to_32_steps_away(void) {
    const double start[] = {0.0};
    create(1, 1);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_FAILED, search(always_fails, start));
    TEST_ASSERT_EQUAL_UINT64(12, questions);
    TEST_ASSERT_TRUE(asked[10][0] == 32.0 && asked[11][0] == -32.0);
    fails_above = -3.0;
    (void)search(cliff, start);
    TEST_ASSERT_TRUE(asked[5][0] == -4.0); /* the first point that does not fail */
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -3.0, best[0]);
    limit = 3;
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(always_fails, start));
}

static double lowest;
static double highest;

/* The point must lie between two walls. If they are equal, the second unknown cannot move. */
static bool walls(const double *u, double *r) {
    r[0] = u[0] - 1.9;
    r[1] = u[1];
    return u[0] <= fails_above && u[1] >= lowest && u[1] <= highest;
}

/* If an evaluation for the slope fails, the other side is tried, then quarters of the step. */
static void a_slope_is_measured_where_it_can_be(void) {
    const double start[] = {0.0, 0.0};
    const double expected[] = {6.0, -6.0, 1.5};
    fails_above = 2.0;
    lowest = -1.0;
    highest = 1.0;
    step[0] = 6.0;
    good_enough = 1e-6;
    create(2, 2);
    (void)search(walls, start);
    TEST_ASSERT_TRUE(asked[0][0] == expected[0] && asked[1][0] == expected[1]);
    TEST_ASSERT_TRUE(asked[2][1] == 1.0); /* the first unknown was measured at -6 */
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 1.9, best[0]);
    lower[0] = 0.0; /* no room on the other side */
    tl_secant.forget(solver);
    (void)search(walls, start);
    TEST_ASSERT_TRUE(asked[0][0] == expected[0] && asked[1][0] == expected[2]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 1.9, best[0]);
}

/* If the column of an unknown cannot be measured, the other one still moves. The column is
 * measured later. */
static void a_missing_column_is_measured_later(void) {
    const double start[] = {0.0, 0.0};
    fails_above = 100.0;
    lowest = 0.0;
    highest = 0.0;
    good_enough = 1e-6;
    create(2, 2);
    (void)search(walls, start);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 1.9, best[0]);
    TEST_ASSERT_EQUAL_UINT64(1 + 8 + 1, questions);
    highest = 10.0;
    (void)search(walls, start);
    TEST_ASSERT_TRUE(asked[0][1] == 1.0);
    TEST_ASSERT_EQUAL_UINT64(2, questions);
    (void)search(walls, start);
    TEST_ASSERT_EQUAL_UINT64(1, questions);
}

/* A solver that could measure nothing also starts as new in the next search. */
static void nothing_measured_is_no_slope(void) {
    const double start[] = {0.0};
    fails_above = 0.0;
    lower[0] = 0.0;
    create(1, 1);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(cliff, start));
    TEST_ASSERT_TRUE(tl_secant.is_new(solver));
    fails_above = 2.0;
    good_enough = 1e-6;
    (void)search(cliff, start);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 1.9, best[0]);
}

/* ---- several ---- */

/* Least squares: u0 = 1.5 and u1 = −1 give residuals (0.5, −0.5, 0). */
static bool overdetermined(const double *u, double *r) {
    r[0] = u[0] - 1.0;
    r[1] = u[0] - 2.0;
    r[2] = 3.0 * (u[1] + 1.0) + 1e-300;
    return true;
}

static void three_residuals_of_two_unknowns_are_fitted(void) {
    const double start[] = {0.0, 0.0};
    create(2, 3);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(overdetermined, start));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 1.5, best[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, -1.0, best[1]);
    TEST_ASSERT_TRUE(questions <= 24);
}

static bool dependent(const double *u, double *r) {
    r[0] = u[0] + u[1] - 3.0;
    r[1] = 2.0 * (u[0] + u[1] - 3.0);
    return true;
}

static void a_slope_without_full_rank_still_leads_somewhere(void) {
    const double start[] = {0.0, 0.5};
    good_enough = 1e-8;
    create(2, 2);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(dependent, start));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 3.0, best[0] + best[1]);
    TEST_ASSERT_TRUE(questions <= 8);
}

static bool first_only(const double *u, double *r) {
    r[0] = u[0] - 3.0;
    r[1] = 0.5 * (u[0] - 3.0);
    return true;
}

static void an_unknown_without_effect_stays(void) {
    const double start[] = {0.0, 0.25};
    good_enough = 1e-8;
    create(2, 2);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(first_only, start));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 3.0, best[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, best[1]);
    TEST_ASSERT_EQUAL_UINT64(3, questions);
}

static bool level(const double *u, double *r) {
    (void)u;
    r[0] = 2.0;
    return true;
}

static void where_nothing_has_an_effect_it_is_done_at_once(void) {
    const double start[] = {0.0};
    create(1, 1);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(level, start));
    TEST_ASSERT_EQUAL_UINT64(1, questions);
}

/* ---- bounds ---- */

static bool coupled(const double *u, double *r) {
    r[0] = u[0] - 3.0;
    r[1] = u[0] + u[1] - 2.0;
    return true;
}

static void an_optimum_on_a_bound_is_found(void) {
    const double start[] = {0.0, 0.0};
    upper[0] = 1.0;
    create(2, 2);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(coupled, start));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, best[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 1.0, best[1]); /* the other unknown is at its optimum */
    TEST_ASSERT_TRUE(questions <= 30);
}

static void a_start_on_a_bound_is_left(void) {
    const double start[] = {1.0, 1.0};
    upper[0] = 1.0;
    upper[1] = 1.0;
    lower[0] = 0.7; /* less than a step away */
    create(2, 2);
    (void)search(coupled, start);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, best[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, best[1]);
    TEST_ASSERT_EQUAL_DOUBLE(0.7, asked[0][0]);
}

static uint32_t seed;

/* A random number in −1 … 1. */
static double any(void) {
    seed = seed * 1664525U + 1013904223U;
    return (double)(seed >> 8) / 8388608.0 - 1.0;
}

static double weights[ROWS][MOST + 2];

static bool random_function(const double *u, double *r) {
    for (size_t i = 0; i < ROWS; i++) {
        r[i] = weights[i][MOST];
        for (size_t k = 0; k < space.count; k++) {
            r[i] += weights[i][k] * u[k] + weights[i][MOST + 1] * sin(u[k]);
        }
    }
    return r[0] < 6.0; /* fails sometimes */
}

/* The caller asserts that evaluations are within the bounds. */
static void it_never_asks_outside_the_bounds_and_always_ends(void) {
    size_t most = 0;
    for (seed = 1; seed < 2000000000U; seed += 9000000U) {
        uint32_t kept = seed;
        double start[MOST];
        tearDown();
        setUp();
        for (size_t k = 0; k < MOST; k++) {
            lower[k] = any() - 1.0;
            upper[k] = lower[k] + 0.01 + 2.0 * fabs(any());
            start[k] = lower[k] + 0.5 * (any() + 1.0) * (upper[k] - lower[k]);
        }
        create(1 + kept % MOST, ROWS);
        for (int again = 0; again < 3; again++) {
            for (size_t i = 0; i < ROWS * (MOST + 2); i++) {
                weights[i / (MOST + 2)][i % (MOST + 2)] = 3.0 * any();
            }
            (void)search(random_function, start);
            most = questions > most ? questions : most;
        }
        seed = kept;
    }
    TEST_ASSERT_TRUE(most > 3 && most < 150);
}

/* ---- least squares in closed form ---- */

static size_t rows; /* rows in use */

/* r = weights·u + the last weight of the row. */
static bool linear(const double *u, double *r) {
    for (size_t i = 0; i < rows; i++) {
        r[i] = weights[i][MOST];
        for (size_t k = 0; k < space.count && k < MOST; k++) {
            r[i] += weights[i][k] * u[k];
        }
    }
    return true;
}

static double determinant(double a[MOST][MOST], size_t n) {
    if (n == 1) {
        return a[0][0];
    }
    if (n == 2) {
        return a[0][0] * a[1][1] - a[0][1] * a[1][0];
    }
    double sum = 0.0;
    for (size_t k = 0; k < 3; k++) {
        size_t l = (k + 1) % 3;
        size_t m = (k + 2) % 3;
        sum += a[0][k] * (a[1][l] * a[2][m] - a[1][m] * a[2][l]);
    }
    return sum;
}

/* The u with the smallest J, by Cramer's rule on the normal equations. */
static void solve_normal(size_t n, double *u) {
    double matrix[MOST][MOST] = {{0}};
    double right[MOST] = {0};
    for (size_t i = 0; i < rows; i++) {
        for (size_t k = 0; k < n; k++) {
            right[k] -= weights[i][k] * weights[i][MOST];
            for (size_t l = 0; l < n; l++) {
                matrix[k][l] += weights[i][k] * weights[i][l];
            }
        }
    }
    for (size_t k = 0; k < n; k++) {
        double replaced[MOST][MOST];
        memcpy(replaced, matrix, sizeof replaced);
        for (size_t l = 0; l < n; l++) {
            replaced[l][k] = right[l];
        }
        u[k] = determinant(replaced, n) / determinant(matrix, n);
    }
}

/* Rows with different directions, so that the normal equations are accurate enough. */
static void draw_problem(size_t n) {
    for (size_t i = 0; i < rows; i++) {
        for (size_t k = 0; k <= MOST; k++) {
            weights[i][k] = any() + (i == k && k < n ? 3.0 : 0.0);
        }
        weights[i][MOST] *= 10.0;
    }
}

static void move_problem(size_t n, double *start) {
    for (size_t i = 0; i < rows; i++) {
        weights[i][MOST] += 4.0 * any();
    }
    for (size_t k = 0; k < n; k++) {
        start[k] = 5.0 * any();
    }
}

/* With n unknowns, the search finds the solution of Cramer's rule, in at most `most`
 * evaluations. */
static void expect_solution(size_t n, size_t most) {
    double start[MOST] = {0};
    double solution[MOST];
    move_problem(n, start);
    solve_normal(n, solution);
    (void)search(linear, start);
    for (size_t k = 0; k < n; k++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-5, solution[k], best[k]);
    }
    TEST_ASSERT_TRUE(questions <= most);
}

/* A slope needs one evaluation per unknown, once. The move needs another, which confirms it. */
static void a_linear_problem_ends_at_its_least_squares(void) {
    for (uint32_t number = 0; number < 200; number++) {
        tearDown();
        setUp();
        size_t n = 1 + number % MOST;
        seed = 1 + 77777U * number;
        rows = n + number / MOST % 2;
        good_enough = 1e-18;
        create(n, rows);
        draw_problem(n);
        expect_solution(n, 1 + n);
        expect_solution(n, 1);
    }
}

static double linear_value(double first, double second) {
    const double u[MOST] = {first, second};
    double r[ROWS];
    double sum = 0.0;
    (void)linear(u, r);
    for (size_t i = 0; i < rows; i++) {
        sum += r[i] * r[i];
    }
    return sum;
}

/* The smallest J if unknown `fixed` is `at` and the other one is within its bounds. */
static double value_on_edge(size_t fixed, double at) {
    size_t moving = 1 - fixed;
    double along = 0.0;
    double across = 0.0;
    for (size_t i = 0; i < rows; i++) {
        along += weights[i][moving] * weights[i][moving];
        across -= weights[i][moving] * (weights[i][fixed] * at + weights[i][MOST]);
    }
    double other = fmin(fmax(across / along, lower[moving]), upper[moving]);
    return fixed == 0 ? linear_value(at, other) : linear_value(other, at);
}

/* The smallest J within the bounds of two unknowns: inside, or on one of the four edges. */
static double value_within_bounds(void) {
    double u[MOST];
    solve_normal(2, u);
    if (u[0] >= lower[0] && u[0] <= upper[0] && u[1] >= lower[1] && u[1] <= upper[1]) {
        return linear_value(u[0], u[1]);
    }
    double first = fmin(value_on_edge(0, lower[0]), value_on_edge(0, upper[0]));
    double second = fmin(value_on_edge(1, lower[1]), value_on_edge(1, upper[1]));
    return fmin(first, second);
}

static void bounds_are_made_the_best_of(void) {
    for (uint32_t number = 0; number < 300; number++) {
        double start[MOST] = {0};
        tearDown();
        setUp();
        seed = 5 + 99991U * number;
        rows = 3;
        good_enough = 1e-18;
        for (size_t k = 0; k < 2; k++) {
            lower[k] = -1.0 - fabs(any());
            upper[k] = 1.0 + fabs(any());
            start[k] = 0.9 * any();
        }
        create(2, rows);
        draw_problem(2);
        (void)search(linear, start);
        double least = value_within_bounds();
        TEST_ASSERT_DOUBLE_WITHIN(1e-6 * least, least, best_value);
    }
}

/* ---- what is learnt ---- */

static bool saturating(const double *u, double *r) {
    r[0] = 10.0 * (exp(0.2 * u[0]) - 2.0);
    return true;
}

/* With one unknown and one residual, all evaluations after the first are those of the secant
 * method. */
static void one_unknown_is_the_secant_method(void) {
    const double start[] = {1.0};
    good_enough = 1e-8;
    create(1, 1);
    (void)search(saturating, start);
    double before = start[0];
    double at = asked[0][0];
    TEST_ASSERT_TRUE(questions > 4);
    for (size_t i = 1; i < questions; i++) {
        double here = 0.0;
        double there = 0.0;
        (void)saturating(&at, &here);
        (void)saturating(&before, &there);
        double next = at - here * (at - before) / (here - there);
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, next, asked[i][0]);
        before = at;
        at = next;
    }
}

static bool bent(const double *u, double *r) {
    r[0] = u[0] + 0.3 * u[1] * u[1] - 4.0;
    r[1] = 2.0 * u[1] - 0.2 * u[0] * u[0] + 1.0;
    return true;
}

/* Solves G·Δ = −r. */
static void solve_two(double g[2][2], const double *r, double *move) {
    double d = g[0][0] * g[1][1] - g[0][1] * g[1][0];
    move[0] = -(r[0] * g[1][1] - r[1] * g[0][1]) / d;
    move[1] = -(r[1] * g[0][0] - r[0] * g[1][0]) / d;
}

/* Two unknowns: all evaluations are those of Broyden's method, with the initial slope from the
 * first two. */
static void two_unknowns_are_broydens_method(void) {
    const double start[] = {0.0, 0.0};
    double g[2][2];
    double at[2];
    double r[2];
    good_enough = 1e-8;
    create(2, 2);
    (void)search(bent, start);
    TEST_ASSERT_TRUE(questions > 5);
    memcpy(at, start, sizeof at);
    (void)bent(at, r);
    for (size_t k = 0; k < 2; k++) { /* from the best point so far */
        double there[2];
        (void)bent(asked[k], there);
        g[0][k] = there[0] - r[0];
        g[1][k] = there[1] - r[1];
        if (there[0] * there[0] + there[1] * there[1] < r[0] * r[0] + r[1] * r[1]) {
            memcpy(at, asked[k], sizeof at);
            memcpy(r, there, sizeof r);
        }
    }
    for (size_t i = 2; i < questions; i++) {
        double move[2];
        double there[2];
        solve_two(g, r, move);
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, at[0] + move[0], asked[i][0]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, at[1] + move[1], asked[i][1]);
        (void)bent(asked[i], there);
        double length = move[0] * move[0] + move[1] * move[1];
        for (size_t row = 0; row < 2; row++) {
            double error = there[row] - r[row] - g[row][0] * move[0] - g[row][1] * move[1];
            g[row][0] += error * move[0] / length;
            g[row][1] += error * move[1] / length;
        }
        memcpy(at, asked[i], sizeof at);
        memcpy(r, there, sizeof r);
    }
}

static double wall;

/* All points behind the wall fail. */
static bool blocked(const double *u, double *r) {
    r[0] = u[0] - 10.0;
    return u[0] <= wall;
}

/* A failed move gives no slope. The next one is half as long; after the second failure the slope
 * is measured again. */
static void a_failed_move_is_halved_and_then_the_slope_is_measured_anew(void) {
    const double start[] = {0.0};
    wall = 1e9;
    create(1, 1);
    (void)search(blocked, start); /* learns the slope */
    wall = 4.0;
    limit = 4;
    (void)search(blocked, start);
    TEST_ASSERT_EQUAL_UINT64(4, questions);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 10.0, asked[0][0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 5.0, asked[1][0]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, asked[2][0]); /* for the slope: a step from the start */
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 3.5, asked[3][0]);
}

/* Each failure multiplies the damping by eight, so that the search comes close to the wall. */
static void damping_leads_to_the_good_side_of_a_wall(void) {
    const double start[] = {0.0};
    wall = 1e9;
    create(1, 1);
    (void)search(blocked, start);
    wall = 5.0;
    (void)search(blocked, start);
    TEST_ASSERT_TRUE(best[0] > 2.0 && best[0] <= 5.0);
    TEST_ASSERT_TRUE(questions < 30);
}

/* A search starts without damping, whatever the previous one needed. */
static void damping_is_forgotten(void) {
    const double start[] = {0.0};
    wall = 1e9;
    create(1, 1);
    (void)search(blocked, start);
    wall = 5.0;
    (void)search(blocked, start);
    wall = 1e9;
    (void)search(blocked, start);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 10.0, asked[0][0]);
}

static bool not_a_number(const double *u, double *r) {
    r[0] = u[0] <= wall ? u[0] - 10.0 : (double)NAN;
    return u[0] <= wall;
}

/* Residuals of a failed point are ignored, here of two moves and an evaluation for the slope. */
static void residuals_that_are_not_numbers_leave_no_trace(void) {
    const double start[] = {0.0};
    wall = 1e9;
    create(1, 1);
    (void)search(not_a_number, start);
    wall = 0.5;
    (void)search(not_a_number, start);
    TEST_ASSERT_TRUE(questions > 4);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, asked[2][0]);
    TEST_ASSERT_TRUE(best[0] > 0.0);
    wall = 1e9;
    (void)search(not_a_number, start);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 10.0, asked[0][0]);
}

/* Two unknowns with the same effect: the shortest move changes both equally. */
static void what_does_the_same_is_moved_alike(void) {
    const double start[] = {0.0, 0.5};
    good_enough = 1e-8;
    create(2, 2);
    (void)search(dependent, start);
    (void)search(dependent, start);
    TEST_ASSERT_EQUAL_UINT64(1, questions);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 1.25, best[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 1.75, best[1]);
}

/* ---- what a move promises ---- */

/* The minimum of J is 8, at 1. */
static bool never_within(const double *u, double *r) {
    r[0] = u[0] - 1.0 - 2.0;
    r[1] = u[0] - 1.0 + 2.0;
    return true;
}

/* The guess reaches its predicted J, and the slope predicts nothing better: the search ends. */
static void a_guess_that_kept_its_promise_ends_the_search(void) {
    const double start[] = {0.0};
    const double u[] = {0.5};
    const bool free[] = {true};
    double residuals[2];
    double guess[1];
    create(1, 2);
    (void)search(never_within, start);
    (void)never_within(u, residuals);
    const tl_forecast forecast = {u, residuals, quiet, free, u};
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &forecast, guess));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1.0, guess[0]);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(never_within, guess));
    TEST_ASSERT_EQUAL_UINT64(0, questions);
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &forecast, guess));
    const double elsewhere[] = {guess[0] + 0.25}; /* not the guess */
    (void)search(never_within, elsewhere);
    TEST_ASSERT_TRUE(questions > 0);
}

/* ---- held ---- */

static bool both(const double *u, double *r) {
    r[0] = u[0] - 1.0;
    r[1] = 2.0 * (u[1] - 1.0);
    return true;
}

static void create_held(size_t unknowns, size_t residual_count) {
    create(unknowns, residual_count);
    space.held = true; /* read at each move */
}

static void a_held_u_moves_only_as_far_as_will_do(void) {
    const double start[] = {0.0};
    slope = 2.0;
    target = 3.0;
    create_held(1, 1);
    good_enough = 1.0;
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
    TEST_ASSERT_EQUAL_UINT64(2, questions);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0 - sqrt(0.3) / 2.0, best[0]); /* J = 0.3 */
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.3, best_value);
}

/* The full move would lead to (3, 2). The solver makes the part of it that leads to J = 0.3. */
static void a_held_move_keeps_its_direction(void) {
    const double start[] = {0.0, 0.0};
    create_held(2, 2);
    good_enough = 1e-8;
    (void)search(both, start);
    good_enough = 1.0;
    const double again[] = {5.0, 3.0};
    (void)search(both, again);
    TEST_ASSERT_EQUAL_UINT64(1, questions);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.3, best_value);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, (5.0 - best[0]) / 4.0, (3.0 - best[1]) / 2.0);
}

static void a_held_u_goes_all_the_way_where_that_is_not_enough(void) {
    const double start[] = {0.0};
    create_held(1, 2);
    (void)search(never_within, start);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 1.0, best[0]);
}

static void a_held_u_is_guessed_to_stay_while_it_will_do(void) {
    const double start[] = {0.0};
    const double u[] = {2.6};
    const double good[] = {0.9};
    const double bad[] = {1.1};
    const bool free[] = {true};
    const tl_forecast within = {u, good, quiet, free, u};
    const tl_forecast outside = {u, bad, quiet, free, u};
    double guess[1];
    slope = 2.0;
    target = 3.0;
    create_held(1, 1);
    (void)search(line, start);
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &within, guess));
    TEST_ASSERT_EQUAL_DOUBLE(2.6, guess[0]);
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &outside, guess));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 2.6 - (1.1 - sqrt(0.3)) / 2.0, guess[0]);
}

/* ---- rows ---- */

static bool second_is_measured;

static bool two_rows(const double *u, double *r) {
    r[0] = u[0] - target;
    r[1] = second_is_measured ? 4.0 * (u[0] - 2.0 * target) : 0.0;
    return true;
}

static void rows_of_exactly_0_take_no_part(void) {
    const double start[] = {0.0};
    const double elsewhere[] = {0.5};
    target = 1.0;
    second_is_measured = true;
    create(1, 2);
    (void)search(two_rows, start);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 33.0 / 17.0, best[0]); /* both rows fitted */
    second_is_measured = false;
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(two_rows, elsewhere));
    TEST_ASSERT_EQUAL_UINT64(1, questions); /* fits the first row alone */
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1.0, best[0]);
    second_is_measured = true;
    target = 3.0;
    limit = 1;
    (void)search(two_rows, elsewhere);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 99.0 / 17.0, best[0]); /* the slope of the second row was kept */
}

/* The penalty is 0 at nominal, where many searches start. */
static bool penalised(const double *u, double *r) {
    r[0] = 2.0 * (u[0] - 3.0);
    r[1] = 4.0 * u[0];
    return true;
}

static void a_penalty_of_0_takes_part(void) {
    const double start[] = {0.0};
    create(1, 2);
    space.sample_count = 1;
    (void)search(penalised, start);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.6, best[0]); /* (2·2·3)/(2² + 4²) */
    (void)search(penalised, start);
    TEST_ASSERT_EQUAL_UINT64(1, questions);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.6, best[0]);
}

/* ---- guess ---- */

static void without_a_slope_there_is_no_guess(void) {
    const double u[] = {1.0};
    const double residuals[] = {2.0};
    const bool free[] = {true};
    const tl_forecast forecast = {u, residuals, quiet, free, u};
    double guess[] = {9.0};
    create(1, 1);
    TEST_ASSERT_FALSE(tl_secant.guess(solver, &forecast, guess));
    TEST_ASSERT_EQUAL_DOUBLE(9.0, guess[0]);
}

static void a_guess_moves_what_is_free_and_stays_within_the_bounds(void) {
    const double start[] = {0.0, 0.0};
    const double u[] = {1.0, 1.0};
    const double residuals[] = {-3.0, -3.0};
    const bool second[] = {false, true};
    const bool all[] = {true, true};
    const double nominal[] = {2.5, 2.5};
    const tl_forecast held = {u, residuals, quiet, second, nominal};
    const tl_forecast loose = {u, residuals, quiet, all, nominal};
    double guess[2];
    upper[0] = 2.5;
    create(2, 2);
    (void)search(both, start);
    questions = 0;
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &held, guess));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, guess[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 2.5, guess[1]);
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &loose, guess));
    TEST_ASSERT_EQUAL_DOUBLE(2.5, guess[0]); /* limited; the solver wants 4 */
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 2.5, guess[1]);
    TEST_ASSERT_EQUAL_UINT64(0, questions); /* a guess needs no evaluation */
}

/* r = 2·(u − 3): the guess of a solver with this slope, from u = 1. */
static double guess_towards(double nominal, double noise) {
    const double start[] = {0.0};
    const double u[] = {1.0};
    const double residuals[] = {-4.0};
    const double noises[] = {noise};
    const double nominals[] = {nominal};
    const bool free[] = {true};
    const tl_forecast forecast = {u, residuals, noises, free, nominals};
    double guess[1];
    tearDown();
    setUp();
    slope = 2.0;
    target = 3.0;
    create(1, 1);
    (void)search(line, start);
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &forecast, guess));
    return guess[0];
}

/* A guess corrects only until the square is 0.03. */
static void a_guess_stays_near_nominal(void) {
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0 - sqrt(0.03) / 2.0, guess_towards(0.0, 0.0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0 + sqrt(0.03) / 2.0, guess_towards(9.0, 0.0));
    TEST_ASSERT_EQUAL_DOUBLE(2.95, guess_towards(2.95, 0.0)); /* nominal is good enough */
}

/* A guess does not correct the part of the square that comes from noise. */
static void a_guess_does_not_follow_noise(void) {
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0 - sqrt(0.45 * 0.4) / 2.0, guess_towards(0.0, 0.4));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0 - sqrt(0.03) / 2.0, guess_towards(0.0, 0.01));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.0 - sqrt(0.5) / 2.0,
                              guess_towards(0.0, 100.0)); /* but it stays within tolerance */
}

/* If u has been on one side of nominal for long, the guess moves further back, by at most half a
 * tolerance. */
static void a_guess_lets_go_of_a_u_that_leans(void) {
    const double nominal[] = {0.0};
    const double residuals[] = {0.0625};
    const bool free[] = {true};
    double guess[1];
    double leaning[] = {0.5};
    (void)guess_towards(0.0, 0.0);
    const tl_forecast forecast = {leaning, residuals, quiet, free, nominal};
    double before = HUGE_VAL;
    for (int i = 0; i < 2000; i++) {
        TEST_ASSERT_TRUE(tl_secant.guess(solver, &forecast, guess));
        TEST_ASSERT_TRUE(guess[0] <= before);
        before = guess[0];
    }
    /* r = 0 at 0.5 − 0.0625/2. Without the limit, the move back would be 0.8·2·0.5. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0.5 - 0.0625 / 2.0 - 0.5 / 2.0, guess[0]);
}

/* ---- ends ---- */

static void it_stops_when_told(void) {
    const double start[] = {5.0, 5.0};
    for (limit = 1; limit < 12; limit++) {
        tearDown();
        size_t wanted = limit;
        setUp();
        limit = wanted;
        create(2, 3);
        tl_search_end end = search(overdetermined, start); /* the caller asserts that no evaluation follows */
        TEST_ASSERT_TRUE(end == TL_SEARCH_DONE || questions == limit);
        TEST_ASSERT_TRUE(end == TL_SEARCH_DONE || end == TL_SEARCH_STOPPED);
    }
}

static void equal_searches_ask_the_same(void) {
    static double first[ASKED][MOST];
    const double start[] = {0.0};
    good_enough = 1e-8;
    create(1, 1);
    (void)search(curve, start);
    size_t count = questions;
    memcpy(first, asked, sizeof first);
    tearDown();
    setUp();
    good_enough = 1e-8;
    create(1, 1);
    (void)search(curve, start);
    TEST_ASSERT_EQUAL_UINT64(count, questions);
    TEST_ASSERT_EQUAL_MEMORY(first, asked, count * sizeof first[0]);
}

/* After forget(), the solver measures a new slope. */
static void what_it_forgets_is_forgotten(void) {
    const double start[] = {0.0};
    const double nominal[] = {0.0};
    const double residuals[] = {0.0625};
    const bool free[] = {true};
    double leaning[] = {0.5};
    double guess[1];
    double fresh = guess_towards(0.0, 0.0);
    const tl_forecast forecast = {leaning, residuals, quiet, free, nominal};
    for (int i = 0; i < 2000; i++) {
        TEST_ASSERT_TRUE(tl_secant.guess(solver, &forecast, guess));
    }
    TEST_ASSERT_FALSE(tl_secant.is_new(solver));
    tl_secant.forget(solver);
    TEST_ASSERT_TRUE(tl_secant.is_new(solver));
    TEST_ASSERT_FALSE(tl_secant.guess(solver, &forecast, guess));
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(line, start));
    TEST_ASSERT_EQUAL_UINT64(2, questions); /* one for the slope, one for the move */
    const double u[] = {1.0};
    const double away[] = {-4.0};
    const tl_forecast again = {u, away, quiet, free, nominal};
    TEST_ASSERT_TRUE(tl_secant.guess(solver, &again, guess));
    TEST_ASSERT_EQUAL_DOUBLE(fresh, guess[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_line_needs_the_slope_and_one_question);
    RUN_TEST(a_slope_that_is_remembered_is_not_measured_again);
    RUN_TEST(a_slope_goes_along_into_other_units);
    RUN_TEST(residuals_may_come_and_go);
    RUN_TEST(a_slope_whose_last_question_was_good_enough_is_remembered);
    RUN_TEST(a_wrong_slope_is_recovered_from);
    RUN_TEST(steps_of_any_size_do);
    RUN_TEST(a_move_is_no_longer_than_25_steps);
    RUN_TEST(a_curve_is_followed);
    RUN_TEST(points_that_fail_are_turned_back_from);
    RUN_TEST(a_start_is_looked_for_up_to_32_steps_away);
    RUN_TEST(a_slope_is_measured_where_it_can_be);
    RUN_TEST(a_missing_column_is_measured_later);
    RUN_TEST(nothing_measured_is_no_slope);
    RUN_TEST(three_residuals_of_two_unknowns_are_fitted);
    RUN_TEST(a_slope_without_full_rank_still_leads_somewhere);
    RUN_TEST(an_unknown_without_effect_stays);
    RUN_TEST(where_nothing_has_an_effect_it_is_done_at_once);
    RUN_TEST(an_optimum_on_a_bound_is_found);
    RUN_TEST(a_start_on_a_bound_is_left);
    RUN_TEST(it_never_asks_outside_the_bounds_and_always_ends);
    RUN_TEST(a_linear_problem_ends_at_its_least_squares);
    RUN_TEST(bounds_are_made_the_best_of);
    RUN_TEST(one_unknown_is_the_secant_method);
    RUN_TEST(two_unknowns_are_broydens_method);
    RUN_TEST(a_failed_move_is_halved_and_then_the_slope_is_measured_anew);
    RUN_TEST(damping_leads_to_the_good_side_of_a_wall);
    RUN_TEST(damping_is_forgotten);
    RUN_TEST(residuals_that_are_not_numbers_leave_no_trace);
    RUN_TEST(what_does_the_same_is_moved_alike);
    RUN_TEST(a_guess_that_kept_its_promise_ends_the_search);
    RUN_TEST(a_held_u_moves_only_as_far_as_will_do);
    RUN_TEST(a_held_move_keeps_its_direction);
    RUN_TEST(a_held_u_goes_all_the_way_where_that_is_not_enough);
    RUN_TEST(a_held_u_is_guessed_to_stay_while_it_will_do);
    RUN_TEST(rows_of_exactly_0_take_no_part);
    RUN_TEST(a_penalty_of_0_takes_part);
    RUN_TEST(without_a_slope_there_is_no_guess);
    RUN_TEST(a_guess_moves_what_is_free_and_stays_within_the_bounds);
    RUN_TEST(a_guess_stays_near_nominal);
    RUN_TEST(a_guess_does_not_follow_noise);
    RUN_TEST(a_guess_lets_go_of_a_u_that_leans);
    RUN_TEST(it_stops_when_told);
    RUN_TEST(equal_searches_ask_the_same);
    RUN_TEST(what_it_forgets_is_forgotten);
    return UNITY_END();
}
