/* Nelder-Mead behind the solver contract: what it asks, where, how often, and how it ends. */
#include <math.h>
#include <stdbool.h>
#include <string.h>
#include <unity.h>

#include "master/sync/optimiser.h"

enum { MOST = 3, ASKED = 2000 };

/* The asker of a search: a function of u, and everything that was asked of it. */
typedef struct asker {
    double (*function)(const double *u);
    size_t count;
    size_t limit; /* says stop at this question; 0: never */
    size_t stopped;
    size_t questions;
    double asked[ASKED][MOST];
    double best[MOST];
    double best_value;
} asker;

static tl_arena arena;
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

void tearDown(void) {
    if (solver != NULL) {
        tl_nelder_mead.destroy(solver);
    }
    tl_arena_release(&arena);
}

static bool answer(void *context, const double *u, double *value) {
    asker *asked = context;
    asked->stopped += asked->limit != 0 && asked->questions >= asked->limit ? 1 : 0;
    if (asked->questions < ASKED) {
        memcpy(asked->asked[asked->questions], u, asked->count * sizeof *u);
    }
    asked->questions++;
    *value = asked->function(u);
    if (*value < asked->best_value) {
        asked->best_value = *value;
        memcpy(asked->best, u, asked->count * sizeof *u);
    }
    return asked->limit == 0 || asked->questions < asked->limit;
}

static void create(size_t count) {
    space = (tl_optimiser_space){count, step, lower, upper};
    solver = tl_nelder_mead.create(&arena, &space);
    TEST_ASSERT_NOT_NULL(solver);
    tl_arena_seal(&arena); /* nothing is taken after this */
    self.count = count;
}

static void search(double (*function)(const double *u), const double *start, double start_value) {
    self.function = function;
    self.questions = 0;
    self.stopped = 0;
    self.best_value = start_value;
    memcpy(self.best, start, self.count * sizeof *start);
    const tl_search search = {start, start_value, answer, &self};
    tl_nelder_mead.minimise(solver, &search);
    TEST_ASSERT_TRUE(self.questions < ASKED);
}

static double valley(const double *u) {
    return (u[0] - 3.0) * (u[0] - 3.0);
}

static double bowl(const double *u) {
    return (u[0] - 3.0) * (u[0] - 3.0) + 10.0 * (u[1] + 1.0) * (u[1] + 1.0) + u[0] * u[1];
}

static double hopeless(const double *u) {
    (void)u;
    return HUGE_VAL;
}

static void one_variable_is_found(void) {
    const double start[] = {0.0};
    create(1);
    search(valley, start, 9.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 3.0, self.best[0]);
}

static void two_variables_are_found(void) {
    const double start[] = {0.0, 0.0};
    create(2);
    search(bowl, start, bowl(start));
    /* From the gradient: 2(a − 3) + b = 0, 20(b + 1) + a = 0. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 140.0 / 39.0, self.best[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -46.0 / 39.0, self.best[1]);
}

static void the_start_is_never_asked_about(void) {
    const double start[] = {0.5};
    create(1);
    search(valley, start, 6.25);
    TEST_ASSERT_TRUE(self.questions > 2);
    for (size_t i = 0; i < self.questions; i++) {
        TEST_ASSERT_TRUE(self.asked[i][0] != 0.5);
    }
}

static void the_first_step_is_the_configured_one(void) {
    const double start[] = {0.5};
    step[0] = 0.25;
    create(1);
    search(valley, start, 6.25);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, fabs(self.asked[0][0] - 0.5));
}

static void the_start_value_is_believed(void) {
    const double start[] = {0.0};
    create(1);
    search(valley, start, -1.0); /* better than anything there is */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0.0, self.asked[self.questions - 1][0]);
}

static void every_question_is_within_the_bounds(void) {
    const double start[] = {2.0, 0.5};
    lower[0] = 0.0;
    upper[0] = 3.7;
    lower[1] = -1.25;
    upper[1] = 0.5;
    create(2);
    search(bowl, start, bowl(start));
    TEST_ASSERT_TRUE(self.questions > 3);
    for (size_t i = 0; i < self.questions; i++) {
        for (size_t k = 0; k < 2; k++) {
            TEST_ASSERT_TRUE(self.asked[i][k] >= lower[k] && self.asked[i][k] <= upper[k]);
        }
    }
}

static void a_start_on_a_bound_is_searched_from(void) {
    const double start[] = {5.0};
    lower[0] = 0.0;
    upper[0] = 5.0;
    create(1);
    search(valley, start, 4.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 3.0, self.best[0]);
}

static void told_to_stop_it_asks_no_more(void) {
    const double start[] = {0.0};
    create(1);
    for (size_t limit = 1; limit < 12; limit++) {
        self.limit = limit;
        search(valley, start, 9.0);
        TEST_ASSERT_EQUAL_UINT64(limit, self.questions);
        TEST_ASSERT_EQUAL_UINT64(0, self.stopped);
    }
}

static void a_search_leaves_no_trace_in_the_next(void) {
    static asker first;
    const double start[] = {0.0, 0.0};
    create(2);
    search(bowl, start, bowl(start));
    first = self;
    self.limit = 4;
    search(hopeless, start, HUGE_VAL);
    self.limit = 0;
    search(bowl, start, bowl(start));
    TEST_ASSERT_EQUAL_UINT64(first.questions, self.questions);
    TEST_ASSERT_EQUAL_MEMORY(first.asked, self.asked, sizeof first.asked[0] * first.questions);
}

static void nothing_but_failures_ends_by_itself(void) {
    const double start[] = {0.0, 0.0};
    create(2);
    search(hopeless, start, HUGE_VAL);
    TEST_ASSERT_TRUE(self.questions > 0 && self.questions < 500);
}

static void a_failing_start_is_left(void) {
    const double start[] = {0.0};
    create(1);
    search(valley, start, HUGE_VAL);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 3.0, self.best[0]);
}

static double even(const double *u) {
    return (u[0] - 3.0) * (u[0] - 3.0) + (u[1] - 2.0) * (u[1] - 2.0);
}

static double far_apart(const double *u) {
    const double scaled[] = {u[0] / 1e-6, u[1] / 1e6};
    return even(scaled);
}

static void variables_of_very_different_size_end_by_their_own_steps(void) {
    const double start[] = {0.0, 0.0};
    create(2);
    search(even, start, even(start));
    size_t questions = self.questions;
    tl_nelder_mead.destroy(solver);
    tl_arena_release(&arena);
    step[0] = 1e-6;
    step[1] = 1e6;
    create(2);
    search(far_apart, start, even(start));
    TEST_ASSERT_DOUBLE_WITHIN(1e-11, 3e-6, self.best[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e1, 2e6, self.best[1]);
    TEST_ASSERT_UINT64_WITHIN(questions / 10, questions, self.questions);
}

static void solvers_are_found_by_name(void) {
    TEST_ASSERT_EQUAL_PTR(&tl_nelder_mead, tl_optimiser_find("nelder-mead"));
    TEST_ASSERT_NULL(tl_optimiser_find("Nelder-Mead"));
    TEST_ASSERT_NULL(tl_optimiser_find(""));
    TEST_ASSERT_NOT_NULL(strstr(tl_optimiser_names(), "\"nelder-mead\""));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(one_variable_is_found);
    RUN_TEST(two_variables_are_found);
    RUN_TEST(the_start_is_never_asked_about);
    RUN_TEST(the_first_step_is_the_configured_one);
    RUN_TEST(the_start_value_is_believed);
    RUN_TEST(every_question_is_within_the_bounds);
    RUN_TEST(a_start_on_a_bound_is_searched_from);
    RUN_TEST(told_to_stop_it_asks_no_more);
    RUN_TEST(a_search_leaves_no_trace_in_the_next);
    RUN_TEST(nothing_but_failures_ends_by_itself);
    RUN_TEST(a_failing_start_is_left);
    RUN_TEST(variables_of_very_different_size_end_by_their_own_steps);
    RUN_TEST(solvers_are_found_by_name);
    return UNITY_END();
}
