/* The Boolean solver: which evaluations it requests, what it keeps, and how long a variable rests
 * after a change. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "master/solve/optimiser.h"

enum { MOST = 3, ASKED = 10 };

static const double step[MOST] = {1.0, 1.0, 1.0};
static const double lower[MOST] = {0.0, 0.0, 0.0};
static const double upper[MOST] = {1.0, 1.0, 1.0};

static tl_arena arena;
static tl_optimiser *solver;
static uint32_t dwell[MOST];
static tl_optimiser_space space;

/* The objective is the number of variables that differ from `wanted`. */
static double wanted[MOST];
static size_t questions;
static size_t limit; /* the search is stopped at this evaluation; 0: never */
static double asked[ASKED][MOST];

void setUp(void) {
    tl_arena_init(&arena);
    memset(dwell, 0, sizeof dwell);
    memset(wanted, 0, sizeof wanted);
    limit = 0;
}

void tearDown(void) {
    tl_boolean.destroy(solver);
    tl_arena_release(&arena);
}

static void create(size_t count) {
    space = (tl_optimiser_space){.count = count, .step = step, .lower = lower, .upper = upper, .dwell = dwell};
    solver = tl_boolean.create(&arena, &space);
    TEST_ASSERT_NOT_NULL(solver);
    tl_arena_seal(&arena); /* later allocations would fail */
}

static double cost(const double *u) {
    double sum = 1.0;
    for (size_t i = 0; i < MOST && i < space.count; i++) {
        sum += fabs(u[i] - wanted[i]);
    }
    return sum;
}

static bool answer(void *context, const double *u, double *value, const double **residuals) {
    (void)context;
    TEST_ASSERT_NULL(residuals);
    TEST_ASSERT_TRUE(questions < ASKED && (limit == 0 || questions < limit));
    memcpy(asked[questions], u, space.count * sizeof *u);
    questions++;
    *value = cost(u);
    return limit == 0 || questions < limit;
}

static bool fail(void *context, const double *u, double *value, const double **residuals) {
    (void)answer(context, u, value, residuals);
    *value = HUGE_VAL;
    return true;
}

static tl_search_end search_valued(const double *start, double value,
                                   bool (*evaluate)(void *, const double *, double *, const double **)) {
    const tl_search search = {.start = start, .start_value = value, .evaluate = evaluate};
    questions = 0;
    return tl_boolean.minimise(solver, &search);
}

static tl_search_end search(const double *start) {
    return search_valued(start, cost(start), answer);
}

static void assert_asked(size_t question, double first, double second, double third) {
    const double expected[MOST] = {first, second, third};
    for (size_t i = 0; i < MOST && i < space.count; i++) {
        TEST_ASSERT_EQUAL_DOUBLE(expected[i], asked[question][i]);
    }
}

/* Number of evaluations in the next search of one variable that has `value` now. */
static size_t asks_at(double value) {
    const double start[MOST] = {value};
    (void)search(start);
    return questions;
}

static void commit(double value) {
    const double u[MOST] = {value};
    tl_boolean.committed(solver, u);
}

static void one_variable_costs_one_question(void) {
    create(1);
    for (int i = 0; i < 4; i++) {
        const double start[MOST] = {i % 2 == 0 ? 0.0 : 1.0};
        wanted[0] = i < 2 ? 0.0 : 1.0;
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(start));
        TEST_ASSERT_EQUAL_UINT64(1, questions);
        assert_asked(0, 1.0 - start[0], 0.0, 0.0);
    }
}

static void each_variable_is_asked_about_with_the_others_at_their_best(void) {
    const double start[MOST] = {0.0, 0.0, 1.0};
    wanted[0] = 1.0;
    create(3);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(start));
    TEST_ASSERT_EQUAL_UINT64(3, questions);
    assert_asked(0, 1.0, 0.0, 1.0); /* better: kept */
    assert_asked(1, 1.0, 1.0, 1.0); /* worse: changed back */
    assert_asked(2, 1.0, 0.0, 0.0);
}

static bool answer_two(void *context, const double *u, double *value, const double **residuals) {
    (void)answer(context, u, value, residuals);
    *value = 2.0;
    return true;
}

static void what_is_no_better_is_not_kept(void) {
    const double start[MOST] = {0.0, 0.0};
    create(2);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search_valued(start, 2.0, answer_two));
    TEST_ASSERT_EQUAL_UINT64(2, questions);
    assert_asked(0, 1.0, 0.0, 0.0);
    assert_asked(1, 0.0, 1.0, 0.0);
}

static void failures_are_not_kept(void) {
    const double start[MOST] = {0.0, 1.0};
    create(2);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search_valued(start, HUGE_VAL, fail));
    TEST_ASSERT_EQUAL_UINT64(2, questions);
    assert_asked(0, 1.0, 1.0, 0.0);
    assert_asked(1, 0.0, 0.0, 0.0);
}

static void a_failing_start_is_left(void) {
    const double start[MOST] = {0.0, 0.0};
    wanted[0] = 1.0;
    create(2);
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search_valued(start, HUGE_VAL, answer));
    assert_asked(1, 1.0, 1.0, 0.0);
}

static void told_to_stop_it_asks_no_more(void) {
    const double start[MOST] = {0.0, 0.0, 0.0};
    create(3);
    for (limit = 1; limit <= 3; limit++) {
        TEST_ASSERT_EQUAL_INT(TL_SEARCH_STOPPED, search(start));
        TEST_ASSERT_EQUAL_UINT64(limit, questions);
    }
}

static void a_search_leaves_no_trace_in_the_next(void) {
    const double start[MOST] = {0.0, 0.0, 0.0};
    const double other[MOST] = {1.0, 1.0, 1.0};
    create(3);
    limit = 2;
    (void)search(other);
    limit = 0;
    TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(start));
    assert_asked(0, 1.0, 0.0, 0.0);
    assert_asked(1, 0.0, 1.0, 0.0);
    assert_asked(2, 0.0, 0.0, 1.0);
}

/* A value stays for `dwell` steps, including the step of its change. */
static void a_variable_rests_after_a_change(void) {
    for (uint32_t steps = 0; steps <= 4; steps++) {
        dwell[0] = steps;
        create(1);
        commit(0.0);
        commit(1.0);
        for (uint32_t stayed = 1; stayed < steps; stayed++) {
            TEST_ASSERT_EQUAL_UINT64(0, asks_at(1.0));
            TEST_ASSERT_EQUAL_INT(TL_SEARCH_DONE, search(upper));
            commit(1.0);
        }
        TEST_ASSERT_EQUAL_UINT64(1, asks_at(1.0));
        commit(1.0);
        TEST_ASSERT_EQUAL_UINT64(1, asks_at(1.0));
        tearDown();
        tl_arena_init(&arena);
    }
}

static void the_first_commit_is_no_change(void) {
    dwell[0] = 5;
    create(1);
    TEST_ASSERT_EQUAL_UINT64(1, asks_at(0.0));
    commit(1.0);
    TEST_ASSERT_EQUAL_UINT64(1, asks_at(1.0));
    commit(1.0);
    TEST_ASSERT_EQUAL_UINT64(1, asks_at(1.0));
}

/* The caller may commit nominal without a search. The rest starts again. */
static void a_change_while_resting_begins_the_rest_anew(void) {
    dwell[0] = 3;
    create(1);
    commit(0.0);
    commit(1.0);
    commit(1.0);
    commit(0.0);
    TEST_ASSERT_EQUAL_UINT64(0, asks_at(0.0));
    commit(0.0);
    TEST_ASSERT_EQUAL_UINT64(0, asks_at(0.0));
    commit(0.0);
    TEST_ASSERT_EQUAL_UINT64(1, asks_at(0.0));
}

static void searches_alone_do_not_count_as_steps(void) {
    dwell[0] = 2;
    create(1);
    commit(0.0);
    commit(1.0);
    for (int i = 0; i < 5; i++) {
        TEST_ASSERT_EQUAL_UINT64(0, asks_at(1.0));
    }
}

static void variables_rest_independently(void) {
    const double before[MOST] = {0.0, 0.0, 0.0};
    const double after[MOST] = {1.0, 0.0, 1.0};
    dwell[0] = 2;
    dwell[1] = 9;
    dwell[2] = 3;
    create(3);
    tl_boolean.committed(solver, before);
    tl_boolean.committed(solver, after);
    (void)search(after);
    TEST_ASSERT_EQUAL_UINT64(1, questions);
    assert_asked(0, 1.0, 1.0, 1.0);
    tl_boolean.committed(solver, after);
    (void)search(after);
    TEST_ASSERT_EQUAL_UINT64(2, questions);
    assert_asked(0, 0.0, 0.0, 1.0);
}

/* After forget(), nothing rests, and the next commit is no change. */
static void what_it_forgets_is_forgotten(void) {
    dwell[0] = 5;
    create(1);
    commit(0.0);
    commit(1.0);
    TEST_ASSERT_EQUAL_UINT64(0, asks_at(1.0));
    tl_boolean.forget(solver);
    TEST_ASSERT_EQUAL_UINT64(1, asks_at(1.0));
    commit(0.0);
    TEST_ASSERT_EQUAL_UINT64(1, asks_at(0.0));
}

static void it_never_guesses(void) {
    create(1);
    TEST_ASSERT_NULL(tl_boolean.guess);
}

static void without_memory_there_is_no_solver(void) {
    create(1); /* seals the memory, too */
    TEST_ASSERT_NULL(tl_boolean.create(&arena, &space));
    tl_arena_release(&arena);
    space.count = SIZE_MAX;
    TEST_ASSERT_NULL(tl_boolean.create(&arena, &space));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(one_variable_costs_one_question);
    RUN_TEST(each_variable_is_asked_about_with_the_others_at_their_best);
    RUN_TEST(what_is_no_better_is_not_kept);
    RUN_TEST(failures_are_not_kept);
    RUN_TEST(a_failing_start_is_left);
    RUN_TEST(told_to_stop_it_asks_no_more);
    RUN_TEST(a_search_leaves_no_trace_in_the_next);
    RUN_TEST(a_variable_rests_after_a_change);
    RUN_TEST(the_first_commit_is_no_change);
    RUN_TEST(a_change_while_resting_begins_the_rest_anew);
    RUN_TEST(searches_alone_do_not_count_as_steps);
    RUN_TEST(variables_rest_independently);
    RUN_TEST(what_it_forgets_is_forgotten);
    RUN_TEST(it_never_guesses);
    RUN_TEST(without_memory_there_is_no_solver);
    return UNITY_END();
}
