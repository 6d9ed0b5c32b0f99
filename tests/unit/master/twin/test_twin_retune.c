/* A new tuning during a run: the twin behaves as if built with it and keeps its learned state, or
 * rejects the tuning. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/test_scene.h"

enum { TICKS = 240, AT = 100 };

static tl_test_scene scene;
static tl_test_run *const run = &scene.run;

/* By step: the reference run, and the run under test. */
static tl_record wanted[TICKS], found[TICKS];
static bool in_wanted[TICKS], in_found[TICKS];

static void (*before_tick)(int64_t tick); /* NULL: none */
static tl_tuning given;
static tl_error error;

void setUp(void) {
    memset(in_wanted, 0, sizeof in_wanted);
    memset(in_found, 0, sizeof in_found);
    scene.change = NULL;
    scene.forgetful = false;
    scene.good = false;
    scene.shortest = false;
    before_tick = NULL;
}

void tearDown(void) {
    tl_test_scene_end(&scene);
}

/* ---- a run ---- */

static bool is_missed(int64_t tick) {
    return tick % 13 == 12;
}

static void run_to(int64_t last, tl_record *records, bool *there) {
    while (run->sample.tick <= last) {
        int64_t tick = run->sample.tick;
        tl_test_scene_show(&scene);
        if (before_tick != NULL) {
            before_tick(tick);
        }
        if (is_missed(tick)) {
            tl_test_run_catch_up(run);
        } else {
            tl_test_run_step(run);
        }
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run->status, run->error.text);
        if (run->ready) {
            records[run->record.step] = run->record;
            there[run->record.step] = true;
        }
    }
}

static bool same_bits(const double *a, const double *b, size_t count) {
    return memcmp(a, b, count * sizeof *a) == 0;
}

static bool is_same(const tl_record *a, const tl_record *b) {
    size_t adjusts = scene.plan.plan.adjust_count;
    return same_bits(a->y, b->y, TL_SCENE_MATCHES) && same_bits(a->measured, b->measured, TL_SCENE_MATCHES) &&
           same_bits(a->u, b->u, adjusts) && same_bits(a->nominal, b->nominal, adjusts) &&
           same_bits(&a->objective, &b->objective, 1) && same_bits(&a->objective_nominal, &b->objective_nominal, 1) &&
           a->outcome == b->outcome && a->evaluations == b->evaluations && a->executions == b->executions &&
           a->flags == b->flags && a->held == b->held && a->stop == b->stop;
}

/* Returns the number of steps in both runs; *differ: how many of them differ. */
static int compare(int64_t from, int *differ) {
    int compared = 0;
    *differ = 0;
    for (int64_t step = from; step < TICKS; step++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(in_wanted[step], in_found[step], tl_test_scene_name(scene.kind));
        compared += in_wanted[step] ? 1 : 0;
        *differ += in_wanted[step] && !is_same(&wanted[step], &found[step]) ? 1 : 0;
    }
    return compared;
}

static void expect_same(int64_t from, int at_least) {
    int differ = 0;
    int compared = compare(from, &differ);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, differ, tl_test_scene_name(scene.kind));
    TEST_ASSERT_TRUE_MESSAGE(compared >= at_least, tl_test_scene_name(scene.kind));
}

/* ---- tunings ---- */

static void retune(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_retune(run->twin, &given, &error), error.text);
}

/* Changes each value of a tuning. */
static void change(tl_test_plan *test) {
    tl_plan *plan = &test->plan;
    test->match[0].tolerance *= 2.5;
    test->match[0].weight = 0.7;
    test->match[0].huber = 3.0;
    plan->margin = 0.05;
    plan->noise_floor = 0.01;
    plan->evaluations = 45;
    for (size_t v = 0; v < plan->adjust_count; v++) {
        bool flag = scene.kind == TL_SCENE_FLAG;
        test->adjust[v].has_nominal = true;
        test->adjust[v].nominal = flag ? 1.0 : 0.4;
        test->adjust[v].lower = flag ? -HUGE_VAL : 0.2;
        test->adjust[v].upper = flag ? HUGE_VAL : 3.0;
        test->adjust[v].approved = 0.25;
        test->adjust[v].deviation_penalty = flag ? 0.0 : 1e-3;
        test->adjust[v].rate_penalty = flag ? 0.0 : 1e-4;
    }
}

/* The tuning before; it has the same fields. */
static void begin_with(tl_test_plan *test) {
    for (size_t v = 0; v < test->plan.adjust_count; v++) {
        test->adjust[v].has_nominal = true;
        test->adjust[v].nominal = 0.0;
    }
}

/* Reads the tuning of a scene that `made` has changed. */
static void take_tuning_of(tl_test_scene_kind kind, void (*made)(tl_test_plan *test)) {
    scene.change = made;
    tl_test_scene_build(&scene, kind);
    tl_tuning_of(&scene.plan.plan, &given);
    tl_test_scene_end(&scene);
}

/* Before the first tick a new tuning has the same effect as a build with it, in each mode. */
static void a_tuning_before_the_first_tick_is_like_a_build(void) {
    for (int kind = 0; kind < TL_SCENES; kind++) {
        setUp();
        scene.change = change;
        tl_test_scene_build(&scene, (tl_test_scene_kind)kind);
        run_to(TICKS - 1, wanted, in_wanted);
        tl_tuning_of(&scene.plan.plan, &given);
        tl_test_scene_end(&scene);
        scene.change = begin_with;
        tl_test_scene_build(&scene, (tl_test_scene_kind)kind);
        retune();
        run_to(TICKS - 1, found, in_found);
        expect_same(0, 150);
        tl_test_scene_end(&scene);
    }
}

static void retune_to_the_same(int64_t tick) {
    (void)tick;
    tl_twin_get_tuning(run->twin, &given);
    retune();
}

static void an_equal_tuning_changes_nothing(void) {
    for (int kind = 0; kind < TL_SCENES; kind++) {
        setUp();
        tl_test_scene_build(&scene, (tl_test_scene_kind)kind);
        run_to(TICKS - 1, wanted, in_wanted);
        tl_test_scene_end(&scene);
        before_tick = retune_to_the_same;
        tl_test_scene_build(&scene, (tl_test_scene_kind)kind);
        run_to(TICKS - 1, found, in_found);
        expect_same(0, 150);
        tl_test_scene_end(&scene);
    }
}

/* Changes the tuning and restores it between two ticks. Factors are powers of two, so conversions
 * are exact. */
static void there_and_back(int64_t tick) {
    tl_tuning own;
    tl_twin_get_tuning(run->twin, &own);
    given = own;
    given.match[0].tolerance *= tick % 2 == 0 ? 4.0 : 0.5;
    given.adjust[0].lower -= 1.0;
    given.margin = 0.5;
    retune();
    given = own;
    retune();
}

/* The slope of the solver is in units of the tolerance and is converted. */
static void the_solver_keeps_its_slope(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    run_to(TICKS - 1, wanted, in_wanted);
    tl_test_scene_end(&scene);
    before_tick = there_and_back;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    run_to(TICKS - 1, found, in_found);
    expect_same(0, 150);
}

static void retune_once(int64_t tick) {
    if (tick == AT) {
        retune();
    }
}

static uint64_t evaluations(const tl_record *records, int64_t from, int64_t count) {
    uint64_t sum = 0;
    for (int64_t step = from; step < from + count; step++) {
        sum += records[step].evaluations;
    }
    return sum;
}

/* A slope that is not converted would be wrong by the factor of the tolerance, and so would each
 * first guess. */
static void a_retuned_solver_guesses_as_well_as_before(void) {
    scene.good = true;
    scene.shortest = true;
    before_tick = retune_once;
    tl_test_scene_build(&scene, TL_SCENE_HOLD);
    tl_twin_get_tuning(run->twin, &given);
    given.match[0].tolerance *= 0.05;
    run_to(TICKS - 1, found, in_found);
    char text[80];
    uint64_t before = evaluations(found, AT - 21, 20);
    uint64_t after = evaluations(found, AT - 1, 20);
    (void)snprintf(text, sizeof text, "%llu evaluations before, %llu after", (unsigned long long)before,
                   (unsigned long long)after);
    TEST_ASSERT_TRUE_MESSAGE(after <= before, text);
    TEST_ASSERT_TRUE_MESSAGE(found[AT - 1].evaluations <= 2, text);
}

/* The runs are equal up to the new tuning and differ after it. Counts and metrics are not reset. */
static void counts_and_earlier_steps_stay(void) {
    for (int kind = 0; kind < TL_SCENES; kind++) {
        setUp();
        take_tuning_of((tl_test_scene_kind)kind, change);
        scene.change = begin_with;
        tl_test_scene_build(&scene, (tl_test_scene_kind)kind);
        int64_t lead = (int64_t)tl_twin_get_facts(run->twin).lead;
        run_to(TICKS - 1, wanted, in_wanted);
        tl_test_scene_end(&scene);
        tl_test_scene_build(&scene, (tl_test_scene_kind)kind);
        run_to(AT - 1, found, in_found);
        tl_metrics metrics = *tl_twin_metrics(run->twin, 0);
        uint64_t executions = tl_twin_executions(run->twin, 1);
        uint64_t predicted = tl_twin_get_ledger(run->twin, 1).predicted;
        retune();
        TEST_ASSERT_EQUAL_MEMORY(&metrics, tl_twin_metrics(run->twin, 0), sizeof metrics);
        TEST_ASSERT_EQUAL_UINT64(executions, tl_twin_executions(run->twin, 1));
        TEST_ASSERT_EQUAL_UINT64(predicted, tl_twin_get_ledger(run->twin, 1).predicted);
        run_to(TICKS - 1, found, in_found);
        for (int64_t step = 0; step < AT - lead - 1; step++) {
            TEST_ASSERT_TRUE_MESSAGE(is_same(&wanted[step], &found[step]), tl_test_scene_name(scene.kind));
        }
        int differ = 0;
        (void)compare(0, &differ);
        bool searches = scene.plan.plan.adjust_count != 0;
        TEST_ASSERT_TRUE_MESSAGE(searches == (differ > 0), tl_test_scene_name(scene.kind));
        for (size_t k = 0; k < tl_twin_get_facts(run->twin).components; k++) {
            TEST_ASSERT_EQUAL_INT64_MESSAGE(0, tl_twin_get_ledger(run->twin, k).difference,
                                            tl_test_scene_name(scene.kind));
        }
        tl_test_scene_end(&scene);
    }
}

/* A missed tick uses nominal plus the last Δu. This stays the last u, also if nominal changes. */
static void u_stays_if_nominal_changes(void) {
    scene.good = true;
    scene.change = begin_with;
    tl_test_scene_build(&scene, TL_SCENE_HOLD);
    run_to(AT - 1, found, in_found);
    double u = run->record.u[0];
    TEST_ASSERT_TRUE(fabs(u) > 0.05);
    tl_twin_get_tuning(run->twin, &given);
    given.adjust[0].nominal = 7.0;
    retune();
    tl_test_scene_show(&scene);
    tl_test_run_catch_up(run);
    TEST_ASSERT_TRUE(run->ready);
    TEST_ASSERT_EQUAL_DOUBLE(7.0, run->record.nominal[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, u, run->record.u[0]);
}

/* From the next search on, u is within the new bounds. */
static void u_moves_into_new_bounds(void) {
    scene.good = true;
    scene.change = begin_with;
    tl_test_scene_build(&scene, TL_SCENE_HOLD);
    run_to(AT - 1, found, in_found);
    tl_twin_get_tuning(run->twin, &given);
    given.adjust[0].lower = -0.02;
    given.adjust[0].upper = 0.03;
    TEST_ASSERT_TRUE(fabs(run->record.u[0]) > 0.05);
    retune();
    for (int i = 0; i < 20; i++) {
        tl_test_scene_show(&scene);
        tl_test_run_step(run);
        TEST_ASSERT_TRUE(run->ready);
        TEST_ASSERT_TRUE(run->record.u[0] >= -0.02 && run->record.u[0] <= 0.03);
    }
    tl_twin_adjusted adjusted = tl_twin_get_adjusted(run->twin, 0);
    TEST_ASSERT_EQUAL_DOUBLE(-0.02, adjusted.lower);
    TEST_ASSERT_EQUAL_DOUBLE(0.03, adjusted.upper);
}

static void declare_bounds(tl_test_plan *test) {
    begin_with(test);
    tl_test_fmu *fmu = test->fmus[1];
    for (size_t i = 0; i < fmu->model.variable_count; i++) {
        if (strcmp(fmu->variables[i].name, "offset") == 0) {
            fmu->variables[i].minimum = -5.0;
            fmu->variables[i].maximum = 5.0;
        }
    }
}

static void declared_bounds_stay_in_use(void) {
    scene.change = declare_bounds;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_twin_get_tuning(run->twin, &given);
    given.adjust[0].lower = -100.0;
    given.adjust[0].upper = 2.0;
    retune();
    TEST_ASSERT_EQUAL_DOUBLE(-5.0, tl_twin_get_adjusted(run->twin, 0).lower);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, tl_twin_get_adjusted(run->twin, 0).upper);
    given.adjust[0].lower = 6.0;
    given.adjust[0].upper = 7.0;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_retune(run->twin, &given, &error));
    TL_EXPECT_PARTS("offset|6|5", error.text);
}

/* ---- rejected tunings ---- */

static void expect_refused(const tl_tuning *tuning, const char *parts) {
    tl_tuning before;
    tl_tuning after;
    tl_twin_get_tuning(run->twin, &before);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, tl_twin_retune(run->twin, tuning, &error), parts);
    TL_EXPECT_PARTS(parts, error.text);
    tl_twin_get_tuning(run->twin, &after);
    TEST_ASSERT_EQUAL_MEMORY(&before, &after, sizeof before);
}

#define REFUSED(change, parts)                                                                                         \
    do {                                                                                                               \
        tl_tuning bad = given;                                                                                         \
        bad.change;                                                                                                    \
        expect_refused(&bad, parts);                                                                                   \
    } while (0)

static void numbers_that_cannot_be_are_refused(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_twin_get_tuning(run->twin, &given);
    REFUSED(matches = TL_MAX_MATCH + 1, "65 matches|64|8");
    REFUSED(adjusts = UINT32_MAX, "4294967295|64|8");
    REFUSED(match[0].tolerance = 0.0, "match 0|tolerance|0");
    REFUSED(match[0].tolerance = -1.0, "match 0|tolerance|-1");
    REFUSED(match[0].tolerance = (double)NAN, "match 0|tolerance|nan");
    REFUSED(match[0].tolerance = HUGE_VAL, "match 0|tolerance|inf");
    REFUSED(match[0].weight = (double)NAN, "match 0|weight|nan");
    REFUSED(match[0].weight = -1.0, "match 0|weight|-1");
    REFUSED(match[0].huber = HUGE_VAL, "match 0|inf");
    REFUSED(adjust[0].has_nominal = 2, "variable 0|nominal");
    REFUSED(adjust[0].nominal = (double)NAN, "variable 0|nominal|nan");
    REFUSED(adjust[0].approved = (double)NAN, "variable 0|approved|nan");
    REFUSED(adjust[0].lower = HUGE_VAL, "variable 0|bounds|inf");
    REFUSED(adjust[0].upper = (double)NAN, "variable 0|bounds|nan");
    REFUSED(adjust[0].deviation_penalty = -1.0, "variable 0|penalties|-1");
    REFUSED(adjust[0].rate_penalty = HUGE_VAL, "variable 0|penalties|inf");
    REFUSED(margin = 1.0, "margin|1");
    REFUSED(margin = (double)NAN, "margin|nan");
    REFUSED(noise_floor = -0.1, "noise_floor|-0.1");
    REFUSED(evaluations = 0, "0|evaluations|1");
    REFUSED(evaluations = UINT64_MAX, "18446744073709551615|evaluations|1");
    REFUSED(time = -1, "budget|-1e-09");
    REFUSED(time = INT64_MAX, "budget|9.22337e+09");
}

static void the_structure_of_the_twin_cannot_change(void) {
    scene.change = begin_with;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_twin_get_tuning(run->twin, &given);
    TEST_ASSERT_EQUAL_UINT64(60, given.evaluations);
    REFUSED(matches = 0, "0 matches|1");
    REFUSED(adjusts = 0, "variables|0|1");
    REFUSED(evaluations = 61, "61|evaluations|60");
    REFUSED(match[0].weight = 0.0, "match 0|weight|1");
    REFUSED(adjust[0].has_nominal = 0, "variable 0|nominal");
    given.evaluations = 5;
    retune();
    given.evaluations = 60; /* the limit is that of the build, not of the present tuning */
    retune();
}

static void begin_with_few(tl_test_plan *test) {
    begin_with(test);
    test->plan.evaluations = 27;
}

/* A budget that was small at the build may grow to the default. */
static void a_small_budget_may_grow(void) {
    scene.change = begin_with_few;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_twin_get_tuning(run->twin, &given);
    TEST_ASSERT_EQUAL_UINT64(27, given.evaluations);
    given.evaluations = 60;
    retune();
    REFUSED(evaluations = 61, "61|evaluations|60");
}

static void a_boolean_is_0_or_1(void) {
    scene.change = begin_with;
    tl_test_scene_build(&scene, TL_SCENE_FLAG);
    tl_twin_get_tuning(run->twin, &given);
    given.adjust[0].lower = -HUGE_VAL; /* bounds of a Boolean are ignored */
    given.adjust[0].upper = HUGE_VAL;
    REFUSED(adjust[0].nominal = 0.5, "flag|Boolean|0.5|0|1");
    given.adjust[0].nominal = 1.0;
    retune();
    TEST_ASSERT_EQUAL_DOUBLE(1.0, tl_twin_get_adjusted(run->twin, 0).nominal);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_tuning_before_the_first_tick_is_like_a_build);
    RUN_TEST(an_equal_tuning_changes_nothing);
    RUN_TEST(the_solver_keeps_its_slope);
    RUN_TEST(a_retuned_solver_guesses_as_well_as_before);
    RUN_TEST(counts_and_earlier_steps_stay);
    RUN_TEST(u_stays_if_nominal_changes);
    RUN_TEST(u_moves_into_new_bounds);
    RUN_TEST(declared_bounds_stay_in_use);
    RUN_TEST(numbers_that_cannot_be_are_refused);
    RUN_TEST(the_structure_of_the_twin_cannot_change);
    RUN_TEST(a_small_budget_may_grow);
    RUN_TEST(a_boolean_is_0_or_1);
    return UNITY_END();
}
