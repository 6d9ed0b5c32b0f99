/* The four solvers of NLopt: the points that they evaluate, their number, and how a search ends. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "master/solve/optimiser.h"

enum { MOST = 5, ASKED = 4000, SOLVERS = 4 };

/* L-BFGS: distance of the points of a difference, in steps. */
static const double DIFFERENCE = 1e-3;

static const tl_optimiser_class *const classes[SOLVERS] = {&tl_nelder_mead, &tl_bobyqa, &tl_lbfgs, &tl_sbplx};

/* The caller of a search: a function of u, and all its evaluations. */
typedef struct asker {
    double (*function)(const double *u);
    size_t count;
    size_t limit; /* the search is stopped at this evaluation; 0: never */
    size_t questions;
    size_t outside; /* evaluations outside the bounds */
    double asked[ASKED][MOST];
    double best[MOST];
    double best_value;
} asker;

static tl_arena arena;
static const tl_optimiser_class *class;
static tl_optimiser *solver;
static asker self;
static double step[MOST];
static double lower[MOST];
static double upper[MOST];
static tl_optimiser_space space;

void setUp(void) {
    tl_arena_init(&arena);
    solver = NULL;
    memset(&self, 0, sizeof self);
    for (size_t i = 0; i < MOST; i++) {
        step[i] = 1.0;
        lower[i] = -HUGE_VAL;
        upper[i] = HUGE_VAL;
    }
}

static void end(void) {
    if (solver != NULL) {
        class->destroy(solver);
        solver = NULL;
    }
    tl_arena_release(&arena);
}

void tearDown(void) {
    end();
}

static bool answer(void *context, const double *u, double *value, const double **residuals) {
    asker *asked = context;
    TEST_ASSERT_NULL(residuals);
    TEST_ASSERT_TRUE_MESSAGE(asked->limit == 0 || asked->questions < asked->limit, class->name);
    TEST_ASSERT_TRUE_MESSAGE(asked->questions < ASKED, class->name);
    memcpy(asked->asked[asked->questions], u, asked->count * sizeof *u);
    asked->questions++;
    for (size_t i = 0; i < asked->count; i++) {
        asked->outside += u[i] >= lower[i] && u[i] <= upper[i] ? 0 : 1;
    }
    *value = asked->function(u);
    if (*value < asked->best_value) {
        asked->best_value = *value;
        memcpy(asked->best, u, asked->count * sizeof *u);
    }
    return asked->limit == 0 || asked->questions < asked->limit;
}

static void create(const tl_optimiser_class *kind, size_t count) {
    end();
    class = kind;
    space = (tl_optimiser_space){.count = count, .step = step, .lower = lower, .upper = upper};
    solver = class->create(&arena, &space);
    TEST_ASSERT_NOT_NULL(solver);
    tl_arena_seal(&arena); /* later allocations would fail */
    self.count = count;
}

static tl_search_end search_valued(double (*function)(const double *u), const double *start, double start_value) {
    self.function = function;
    self.questions = 0;
    self.outside = 0;
    self.best_value = start_value;
    memcpy(self.best, start, self.count * sizeof *start);
    const tl_search search = {.start = start, .start_value = start_value, .evaluate = answer, .context = &self};
    tl_search_end how = class->minimise(solver, &search);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(0, self.outside, class->name);
    return how;
}

static tl_search_end search(double (*function)(const double *u), const double *start) {
    return search_valued(function, start, function(start));
}

static void assert_best(size_t i, double expected, double within) {
    TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(within, expected, self.best[i], class->name);
}

static double square(double x) {
    return x * x;
}

/* ---- Functions to minimise ---- */

static double valley(const double *u) {
    return square(u[0] - 3.0);
}

static double bent_valley(const double *u) {
    return square(10.0 * (exp(0.2 * u[0]) - 2.0));
}

static double bowl(const double *u) {
    return square(u[0] - 3.0) + square(3.0 * (u[1] + 1.0) + 0.2 * u[0]);
}

/* Coupled residuals, which are all 0 at 1, 2, 3, 4, 5. */
static double chain(const double *u) {
    double sum = square(2.0 * (u[0] - 1.0));
    for (size_t i = 1; i < 5; i++) {
        sum += square(2.0 * (u[i] - (double)(i + 1)) + 0.5 * (u[i - 1] - (double)i));
    }
    return sum;
}

static double hopeless(const double *u) {
    (void)u;
    return HUGE_VAL;
}

static double level(const double *u) {
    (void)u;
    return 5.0;
}

/* ---- The optimum is found ---- */

static void smooth_problems_of_any_size_are_solved(void) {
    const double start[MOST] = {0};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(valley, start));
        assert_best(0, 3.0, 1e-5);
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(bent_valley, start));
        assert_best(0, 5.0 * log(2.0), 1e-5);
        create(classes[k], 2);
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(bowl, start));
        assert_best(0, 3.0, 1e-4);
        assert_best(1, -1.2, 1e-4);
        create(classes[k], 5);
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(chain, start));
        for (size_t i = 0; i < 5; i++) {
            assert_best(i, (double)(i + 1), 1e-3);
        }
    }
}

static void an_optimum_on_a_bound_is_found_exactly(void) {
    const double start[] = {0.1, 0.1};
    upper[0] = 2.7;
    lower[1] = -1.0;
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        (void)search(valley, start);
        TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(2.7, self.best[0], class->name);
        create(classes[k], 2);
        (void)search(bowl, start);
        TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(2.7, self.best[0], class->name);
        TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(-1.0, self.best[1], class->name);
    }
}

static void a_start_on_a_bound_is_searched_from(void) {
    const double low[] = {0.1, -4.0};
    const double high[] = {5.3, 3.3};
    for (size_t i = 0; i < 2; i++) {
        lower[i] = low[i];
        upper[i] = high[i];
    }
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        (void)search(bowl, low);
        assert_best(0, 3.0, 1e-4);
        assert_best(1, -1.2, 1e-4);
        (void)search(bowl, high);
        assert_best(0, 3.0, 1e-4);
        assert_best(1, -1.2, 1e-4);
    }
}

static void bounds_may_be_closer_than_a_step(void) {
    const double rooms[] = {3.9, 2.0, 1.9, 0.3, 1e-2};
    for (size_t k = 0; k < SOLVERS; k++) {
        for (size_t i = 0; i < sizeof rooms / sizeof rooms[0]; i++) {
            lower[0] = 3.0 - rooms[i] / 3.0;
            upper[0] = lower[0] + rooms[i];
            const double starts[] = {lower[0], lower[0] + 0.1 * rooms[i], lower[0] + 0.5 * rooms[i], upper[0]};
            create(classes[k], 1);
            for (size_t s = 0; s < sizeof starts / sizeof starts[0]; s++) {
                TEST_ASSERT_EQUAL_INT_MESSAGE(TL_SEARCH_DONE, search(valley, &starts[s]), class->name);
                assert_best(0, 3.0, 1e-5);
            }
        }
    }
}

static double even(const double *u) {
    return square(u[0] - 3.0) + square(u[1] - 2.0);
}

static double far_apart(const double *u) {
    const double scaled[] = {u[0] / 1e-6, u[1] / 1e6};
    return even(scaled);
}

static void variables_of_very_different_size_end_by_their_own_steps(void) {
    const double start[] = {0.0, 0.0};
    for (size_t k = 0; k < SOLVERS; k++) {
        step[0] = 1.0;
        step[1] = 1.0;
        create(classes[k], 2);
        (void)search(even, start);
        size_t questions = self.questions;
        step[0] = 1e-6;
        step[1] = 1e6;
        create(classes[k], 2);
        (void)search(far_apart, start);
        assert_best(0, 3e-6, 1e-11);
        assert_best(1, 2e6, 1e1);
        TEST_ASSERT_UINT64_WITHIN_MESSAGE(questions / 10, questions, self.questions, class->name);
    }
}

static double offset;

static double bent_at_offset(const double *u) {
    return square(10.0 * (u[0] - offset) + square(u[0] - offset));
}

/* In so many searches, rounding limits BOBYQA in some. */
static void to_be_limited_by_rounding_is_no_failure(void) {
    const double start[] = {0.0};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        for (int i = 1; i < 400; i++) {
            offset = 0.00731 * (double)i;
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_SEARCH_DONE, search(bent_at_offset, start), class->name);
            assert_best(0, offset, 1e-5);
        }
    }
}

/* ---- Evaluations ---- */

static void the_start_is_never_asked_about(void) {
    const double start[] = {0.3, 0.7};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        (void)search(bowl, start);
        TEST_ASSERT_TRUE_MESSAGE(self.questions > 3, class->name);
        for (size_t i = 0; i < self.questions; i++) {
            TEST_ASSERT_TRUE_MESSAGE(self.asked[i][0] != start[0] || self.asked[i][1] != start[1], class->name);
        }
    }
}

static void the_first_step_is_the_configured_one(void) {
    const double start[] = {0.5};
    step[0] = 0.25;
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        (void)search(valley, start);
        size_t first = class == &tl_lbfgs ? 4 : 0; /* after the gradient */
        TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(1e-12, 0.25, fabs(self.asked[first][0] - 0.5), class->name);
    }
}

static void the_start_value_is_believed(void) {
    const double start[] = {0.0};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        (void)search_valued(valley, start, -1.0); /* below the minimum */
        TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(1e-2, 0.0, self.asked[self.questions - 1][0], class->name);
    }
}

static void every_question_is_within_the_bounds(void) {
    const double starts[][2] = {{2.0, 0.5},       {0.1, -1.25},      {3.7, 0.5},
                                {0.1001, 0.4999}, {3.6985, -1.2485}, {0.102, -1.248}};
    lower[0] = 0.1;
    upper[0] = 3.7;
    lower[1] = -1.25;
    upper[1] = 0.5;
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        for (size_t i = 0; i < sizeof starts / sizeof starts[0]; i++) {
            (void)search(bowl, starts[i]); /* the caller checks the bounds at each evaluation */
            TEST_ASSERT_TRUE(self.questions > 3);
        }
    }
}

/* A gradient evaluates four points for each unknown; the other unknowns do not move. */
static void a_gradient_is_a_four_point_difference(void) {
    const double around[] = {2.0, 1.0, -1.0, -2.0};
    const double start[] = {1.0, 2.0, 3.0};
    step[0] = 0.5;
    create(&tl_lbfgs, 3);
    self.limit = 12;
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(bowl, start));
    for (size_t q = 0; q < 12; q++) {
        for (size_t i = 0; i < 3; i++) {
            double expected = start[i] + (i == q / 4 ? around[q % 4] * DIFFERENCE * step[i] : 0.0);
            TEST_ASSERT_EQUAL_DOUBLE(expected, self.asked[q][i]);
        }
    }
}

static void beside_a_bound_a_gradient_is_one_sided(void) {
    const double starts[] = {0.0, 0.5 * DIFFERENCE, 2.0, 2.0 - 1.5 * DIFFERENCE};
    lower[0] = 0.0;
    upper[0] = 2.0;
    step[0] = 0.5;
    create(&tl_lbfgs, 1);
    self.limit = 4;
    for (size_t s = 0; s < sizeof starts / sizeof starts[0]; s++) {
        double h = (starts[s] < 1.0 ? 1.0 : -1.0) * DIFFERENCE * step[0];
        double near = fabs(starts[s] - (h > 0.0 ? lower[0] : upper[0]));
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(valley, &starts[s]));
        for (size_t q = 0; q < 4 && near < 2.0 * fabs(h); q++) {
            TEST_ASSERT_EQUAL_DOUBLE(starts[s] + (double)(q + 1) * h, self.asked[q][0]);
        }
    }
}

/* Both formulas are exact for polynomials of degree 4. A wrong one would miss the optimum by about
 * h. */
static void an_optimum_beside_a_bound_is_as_exact(void) {
    const double start[] = {1.5};
    lower[0] = 0.0;
    upper[0] = 4.0;
    create(&tl_lbfgs, 1);
    for (int i = -5; i <= 5; i++) {
        offset = i == 0 ? 2.0 : (i < 0 ? 4.0 : 0.0) + 0.7 * i * DIFFERENCE;
        (void)search(bent_at_offset, start);
        assert_best(0, offset, 1e-7);
    }
}

/* ---- Stop ---- */

/* Each solver is stopped at evaluation 1, 2 … `most`. */
static void expect_stops(double (*of)(const double *u), const double *start, size_t most) {
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        for (size_t limit = 1; limit <= most; limit++) {
            self.limit = limit;
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_SEARCH_STOPPED, search(of, start), class->name);
            TEST_ASSERT_EQUAL_UINT64_MESSAGE(limit, self.questions, class->name);
        }
    }
}

/* The caller asserts that no evaluation follows the stop. L-BFGS is mostly stopped within a
 * gradient. */
static void told_to_stop_it_asks_no_more(void) {
    const double start[] = {0.2, 0.1};
    expect_stops(bowl, start, 20);
}

static double wall_at_offset(const double *u);

static void told_to_stop_among_failures_it_asks_no_more(void) {
    const double start[] = {0.0, 0.0};
    offset = 0.9;
    expect_stops(wall_at_offset, start, 15);
}

/* ---- Searches are independent ---- */

static void a_search_leaves_no_trace_in_the_next(void) {
    static asker first;
    const double start[] = {0.2, 0.1};
    const double elsewhere[] = {-3.0, 0.4};
    lower[0] = -3.0;
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        (void)search(bowl, start);
        first = self;
        self.limit = 3;
        (void)search(far_apart, elsewhere);
        self.limit = 0;
        (void)search(hopeless, start);
        (void)search(bowl, start);
        TEST_ASSERT_EQUAL_UINT64(first.questions, self.questions);
        TEST_ASSERT_EQUAL_MEMORY(first.asked, self.asked, sizeof first.asked[0] * first.questions);
    }
}

/* A replay must use as many evaluations as the recorded run. These numbers are those of NLopt
 * 2.7. */
static void the_number_of_questions_is_the_same_on_every_machine(void) {
    const size_t expected[SOLVERS] = {45, 15, 14, 74};
    const double start[] = {0.0};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        (void)search(valley, start);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(expected[k], self.questions, class->name);
    }
}

/* ---- Failures ---- */

/* Fails if u0 is beyond the offset. The optimum is at 2 in both variables. */
static double wall_at_offset(const double *u) {
    return u[0] > offset ? HUGE_VAL : square(10.0 * (u[0] - 2.0)) + square(10.0 * (u[1] - 2.0));
}

static double wall_below(const double *u) {
    return u[0] < 1.0 ? HUGE_VAL : square(100.0 * (u[0] - 3.0));
}

static void a_failing_half_is_kept_out_of(void) {
    const double start[] = {0.0, 0.0};
    offset = 2.5;
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_SEARCH_DONE, search(wall_at_offset, start), class->name);
        assert_best(0, 2.0, 1e-4);
        assert_best(1, 2.0, 1e-4);
    }
}

static void an_optimum_among_failures_is_come_close_to(void) {
    const double start[] = {0.0, 0.0};
    offset = 1.6;
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        (void)search(wall_at_offset, start);
        TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(1e-2, 1.6, self.best[0], class->name);
    }
}

static void a_failing_start_is_left_or_a_failure(void) {
    const double start[] = {0.0};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        tl_search_end how = search(wall_below, start);
        if (class == &tl_lbfgs) {
            TEST_ASSERT_EQUAL_INT(TL_SEARCH_FAILED, how);
            TEST_ASSERT_EQUAL_UINT64(0, self.questions);
        } else {
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_SEARCH_DONE, how, class->name);
            assert_best(0, 3.0, 1e-4);
        }
    }
}

static void nothing_but_failures_ends_by_itself(void) {
    const double start[MOST] = {0};
    for (size_t k = 0; k < SOLVERS; k++) {
        for (size_t count = 1; count <= MOST; count++) {
            create(classes[k], count);
            tl_search_end how = search(hopeless, start);
            TEST_ASSERT_EQUAL_INT(class == &tl_lbfgs ? TL_SEARCH_FAILED : TL_SEARCH_DONE, how);
            TEST_ASSERT_TRUE_MESSAGE(self.questions < 500, class->name);
        }
    }
}

static void nothing_to_find_ends_by_itself(void) {
    const double start[] = {0.0, 0.0};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 2);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_SEARCH_DONE, search(level, start), class->name);
        TEST_ASSERT_TRUE_MESSAGE(self.questions < 500, class->name);
    }
}

static double immense(const double *u) {
    return 1e300 * square(u[0] - 3.0);
}

/* The squares of the values are not finite. For L-BFGS that is a failed start. */
static void immense_values_end_by_themselves(void) {
    const double start[] = {0.0};
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        tl_search_end how = search(immense, start);
        TEST_ASSERT_EQUAL_INT_MESSAGE(class == &tl_lbfgs ? TL_SEARCH_FAILED : TL_SEARCH_DONE, how, class->name);
        TEST_ASSERT_TRUE_MESSAGE(self.questions < 500, class->name);
    }
}

static double gap_low;
static double gap_high;

static double gap(const double *u) {
    return u[0] < gap_low || u[0] > gap_high ? HUGE_VAL : square(u[0] - 3.0);
}

/* If some of its points fail, the gradient uses the others. Evaluation 5 is the first step. */
static void a_gradient_makes_do_with_the_points_that_do_not_fail(void) {
    const double h = DIFFERENCE;
    const double gaps[][2] = {{-0.5, 0.5}, {-0.5, 1.5}, {-1.5, 0.5}, {-2.5, 0.5}, {-0.5, 2.5}};
    const double start[] = {0.0};
    create(&tl_lbfgs, 1);
    self.limit = 5;
    for (size_t i = 0; i < sizeof gaps / sizeof gaps[0]; i++) {
        gap_low = gaps[i][0] * h;
        gap_high = gaps[i][1] * h;
        bool blind = gap_low > -h && gap_high < h;
        TEST_ASSERT_EQUAL_INT(blind ? TL_SEARCH_DONE : TL_SEARCH_STOPPED, search(gap, start));
        TEST_ASSERT_EQUAL_UINT64(blind ? 4 : 5, self.questions);
        TEST_ASSERT_TRUE(blind || fabs(self.asked[4][0] - 1.0) < 1e-9);
    }
    lower[0] = 0.0;
    create(&tl_lbfgs, 1);
    gap_high = 2.5 * h;
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(gap, start));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.0, self.asked[4][0]);
}

static void what_nlopt_gives_up_is_a_failure(void) {
    const double start[] = {0.0, 0.0};
    offset = 1.6;
    create(&tl_lbfgs, 2);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_FAILED, search(wall_at_offset, start)); /* no direction of descent */
}

static void what_nlopt_refuses_is_a_failure(void) {
    const double start[] = {-1.0};
    lower[0] = 0.0;
    for (size_t k = 0; k < SOLVERS; k++) {
        create(classes[k], 1);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_SEARCH_FAILED, search(valley, start), class->name);
        TEST_ASSERT_EQUAL_UINT64(0, self.questions);
    }
}

static void without_memory_there_is_no_solver(void) {
    space = (tl_optimiser_space){.count = 1, .step = step, .lower = lower, .upper = upper};
    for (size_t k = 0; k < SOLVERS; k++) {
        tl_optimiser_space immeasurable = space;
        immeasurable.count = SIZE_MAX;
        TEST_ASSERT_NULL(classes[k]->create(&arena, &immeasurable));
        tl_arena_seal(&arena);
        TEST_ASSERT_NULL(classes[k]->create(&arena, &space));
        tl_arena_release(&arena);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(smooth_problems_of_any_size_are_solved);
    RUN_TEST(an_optimum_on_a_bound_is_found_exactly);
    RUN_TEST(a_start_on_a_bound_is_searched_from);
    RUN_TEST(bounds_may_be_closer_than_a_step);
    RUN_TEST(variables_of_very_different_size_end_by_their_own_steps);
    RUN_TEST(to_be_limited_by_rounding_is_no_failure);
    RUN_TEST(the_start_is_never_asked_about);
    RUN_TEST(the_first_step_is_the_configured_one);
    RUN_TEST(the_start_value_is_believed);
    RUN_TEST(every_question_is_within_the_bounds);
    RUN_TEST(a_gradient_is_a_four_point_difference);
    RUN_TEST(beside_a_bound_a_gradient_is_one_sided);
    RUN_TEST(an_optimum_beside_a_bound_is_as_exact);
    RUN_TEST(told_to_stop_it_asks_no_more);
    RUN_TEST(told_to_stop_among_failures_it_asks_no_more);
    RUN_TEST(a_search_leaves_no_trace_in_the_next);
    RUN_TEST(the_number_of_questions_is_the_same_on_every_machine);
    RUN_TEST(a_failing_half_is_kept_out_of);
    RUN_TEST(an_optimum_among_failures_is_come_close_to);
    RUN_TEST(a_failing_start_is_left_or_a_failure);
    RUN_TEST(nothing_but_failures_ends_by_itself);
    RUN_TEST(nothing_to_find_ends_by_itself);
    RUN_TEST(immense_values_end_by_themselves);
    RUN_TEST(a_gradient_makes_do_with_the_points_that_do_not_fail);
    RUN_TEST(what_nlopt_gives_up_is_a_failure);
    RUN_TEST(what_nlopt_refuses_is_a_failure);
    RUN_TEST(without_memory_there_is_no_solver);
    return UNITY_END();
}
