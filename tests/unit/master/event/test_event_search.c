/* Which u is tried next: the search alone, with a plant whose event time is known for each u. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/event/event_search.h"
#include "master/sync/objective.h"
#include "tests/support/random_numbers.h"

enum { EVALUATIONS = 60, HALF = 8 };

static tl_arena arena;
static tl_event_search search;
static double wanted; /* instant of the plant's event, in steps */
static double travel; /* the simulated event comes after travel/u steps */
static bool rises;    /* true: after travel·u steps */

void setUp(void) {
    tl_arena_init(&arena);
    memset(&search, 0, sizeof search);
    travel = 1.0;
    rises = false;
}

void tearDown(void) {
    tl_event_search_end(&search);
    tl_arena_release(&arena);
}

static void make(const tl_optimiser_class *solver, double step, double lower, double upper) {
    const tl_event_search_settings settings = {
        .solver = solver, .step = step, .lower = lower, .upper = upper, .evaluations = EVALUATIONS};
    TEST_ASSERT_TRUE(tl_event_search_init(&search, &arena, &settings));
}

/* Reports J and the side, as a window of 2·HALF + 1 samples gives them. */
static void try(double u) {
    double steps = ceil(rises ? travel * u : travel / u);
    double late = fmin(fmax(steps - wanted, -HALF), HALF + 1);
    tl_event_side side = steps <= wanted - HALF  ? TL_EVENT_BEFORE
                         : steps > wanted + HALF ? TL_EVENT_AFTER
                         : late < 0.0            ? TL_EVENT_EARLY
                         : late > 0.0            ? TL_EVENT_LATE
                                                 : TL_EVENT_EXACT;
    tl_event_search_report(&search, u, fabs(late), side);
}

/* A whole search; returns the best u. */
static double run(double guess) {
    double u = guess;
    tl_event_search_begin(&search);
    try(guess);
    while (tl_event_search_next(&search, &u)) {
        TEST_ASSERT_TRUE(u >= search.lower && u <= search.upper);
        TEST_ASSERT_NULL(tl_event_search_find(&search, u));
        try(u);
    }
    return tl_event_search_best(&search)->u;
}

static void assert_exact(double u) {
    TEST_ASSERT_TRUE(ceil(rises ? travel * u : travel / u) == wanted);
    TEST_ASSERT_TRUE(tl_event_search_best(&search)->value < TL_OBJECTIVE_TOLERANCE);
}

static void every_first_step_finds_the_throttle(void) {
    static const double steps[] = {0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1};
    static const tl_optimiser_class *const solvers[] = {&tl_nelder_mead, &tl_bobyqa, &tl_sbplx};
    for (size_t s = 0; s < 3; s++) {
        for (size_t i = 0; i < 7; i++) {
            tearDown();
            setUp();
            make(solvers[s], steps[i], 0.0, HUGE_VAL);
            travel = 55 * 0.023;
            wanted = 55;
            assert_exact(run(0.01));
            TEST_ASSERT_TRUE(tl_event_search_met_plateau(&search));
            TEST_ASSERT_TRUE(search.count <= 20);
        }
    }
}

/* An exact u is found, from a guess on either side, and if u speeds up or slows down the event. */
static void any_plant_is_found(void) {
    tl_test_random chance = {11};
    size_t most = 0;
    for (int i = 0; i < 3000; i++) {
        tearDown();
        setUp();
        double truth = exp(tl_test_random_number(&chance, -6.0, 3.0));
        double guess = truth * exp(tl_test_random_number(&chance, -2.5, 2.5));
        double step = guess * exp(tl_test_random_number(&chance, -3.0, 2.0));
        rises = tl_test_random_number(&chance, 0.0, 1.0) < 0.5;
        wanted = ceil(tl_test_random_number(&chance, 20.0, 1000.0));
        travel = rises ? (wanted - 0.5) / truth : (wanted - 0.5) * truth;
        make(&tl_nelder_mead, step, truth / 100.0, truth * 100.0);
        assert_exact(run(guess));
        most = search.count > most ? search.count : most;
    }
    TEST_ASSERT_TRUE(most < EVALUATIONS);
}

static void a_guess_that_is_exact_is_all(void) {
    make(&tl_nelder_mead, 0.1, 0.0, 10.0);
    travel = 50.0;
    wanted = 50.0;
    TEST_ASSERT_TRUE(run(1.0) == 1.0);
    TEST_ASSERT_EQUAL_size_t(1, search.count);
    TEST_ASSERT_FALSE(tl_event_search_met_plateau(&search));
}

/* If no u is right, the search tries both bounds and ends. */
static void a_plateau_without_an_end_is_given_up(void) {
    make(&tl_nelder_mead, 0.1, 0.5, 2.0);
    travel = 1000.0;
    wanted = 50.0;
    (void)run(1.0);
    TEST_ASSERT_NOT_NULL(tl_event_search_find(&search, 0.5));
    TEST_ASSERT_NOT_NULL(tl_event_search_find(&search, 2.0));
    TEST_ASSERT_TRUE(search.count < 20);
    TEST_ASSERT_TRUE(tl_event_search_best(&search) == &search.candidates[0]); /* the first of equal ones */
}

static void the_room_for_candidates_is_the_limit(void) {
    make(&tl_nelder_mead, 1e-9, 0.0, HUGE_VAL); /* a step so small that it must be widened 30 times */
    search.most = 5;
    travel = 55 * 0.023;
    wanted = 55;
    (void)run(0.01);
    TEST_ASSERT_EQUAL_size_t(5, search.count);
    TEST_ASSERT_TRUE(tl_event_search_is_full(&search));
}

/* A failed candidate gives no information, and the search does not continue from it. */
static void a_candidate_that_fails_is_passed_by(void) {
    make(&tl_nelder_mead, 0.01, 0.0, 1.0);
    travel = 55 * 0.023;
    wanted = 55;
    double u = 0.0;
    tl_event_search_begin(&search);
    try(0.01);
    for (int i = 0; i < 30 && tl_event_search_next(&search, &u); i++) {
        if (u > 0.03) {
            tl_event_search_report(&search, u, HUGE_VAL, TL_EVENT_UNKNOWN);
        } else {
            try(u);
        }
    }
    assert_exact(tl_event_search_best(&search)->u);
}

/* Without a report, the next question is the same. */
static void the_same_question_has_the_same_answer(void) {
    make(&tl_nelder_mead, 0.02, 0.0, 1.0);
    travel = 55 * 0.023;
    wanted = 55;
    tl_event_search_begin(&search);
    try(0.01);
    double u = 0.0;
    while (tl_event_search_next(&search, &u)) {
        double again = 0.0;
        TEST_ASSERT_TRUE(tl_event_search_next(&search, &again));
        TEST_ASSERT_TRUE(again == u);
        try(u);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(every_first_step_finds_the_throttle);
    RUN_TEST(any_plant_is_found);
    RUN_TEST(a_guess_that_is_exact_is_all);
    RUN_TEST(a_plateau_without_an_end_is_given_up);
    RUN_TEST(the_room_for_candidates_is_the_limit);
    RUN_TEST(a_candidate_that_fails_is_passed_by);
    RUN_TEST(the_same_question_has_the_same_answer);
    return UNITY_END();
}
