/* What two twins have done over the same time, in words, and whether the new one may take over. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/retune/comparison.h"

enum { LINES = 8 };

static tl_run_status before;
static struct { tl_run_status work, beside; } now;
static tl_comparison comparison;
static char why[TL_COMPARISON_TEXT];
static char told[LINES][TL_COMPARISON_TEXT];
static size_t lines;

static void hear(void *context, const char *text) {
    (void)context;
    TEST_ASSERT_LESS_THAN_size_t(LINES, lines);
    (void)snprintf(told[lines++], TL_COMPARISON_TEXT, "%s", text);
}

static void set_output(tl_run_status *work, size_t index, const char *name, uint64_t pairs, double sum) {
    work->outputs = work->outputs > index ? work->outputs : (uint32_t)index + 1;
    tl_run_output *output = &work->output[index];
    (void)snprintf(output->name, sizeof output->name, "%s", name);
    (void)snprintf(output->unit, sizeof output->unit, "rad/s");
    output->pairs = pairs;
    output->sum_of_squares = sum;
    output->tolerance = 1.0;
}

/* A thousand more steps, all in lock. */
static void do_steps(tl_run_status *work) {
    work->ticks += 1000;
    work->steps += 1000;
    work->lock.steps[TL_LOCK_LOCKED] += 1000;
    work->evaluations += 5000;
    work->executions += 20000;
    work->used += 2 * TL_SECOND;
}

void setUp(void) {
    before = (tl_run_status){.ticks = 1000, .steps = 1000};
    memset(&now, 0, sizeof now);
    now.beside = before;
    lines = 0;
    set_output(&now.beside, 0, "motor.omega", 100, 1e6);
    set_output(&now.work, 0, "motor.omega", 50, 1e9);
    comparison.before = before;
    tl_comparison_begin(&comparison, &now.work, &now.beside);
    do_steps(&now.work);
    do_steps(&now.beside);
}

void tearDown(void) {}

static tl_comparison_result judge(void) {
    tl_comparison_end(&comparison, &now.work, &now.beside);
    return tl_comparison_judge(&comparison, 95.0, why);
}

/* What was before it began does not count. */
static void test_the_words(void) {
    now.work.timed_out = 3;
    now.beside.deadline_misses = 2;
    set_output(&now.beside, 0, "motor.omega", 200, 1e6 + 400.0);
    set_output(&now.beside, 1, "motor.i", 0, 0.0);
    set_output(&now.work, 0, "motor.omega", 150, 1e9 + 100.0);
    set_output(&now.work, 1, "motor.T", 4, 16.0);
    tl_comparison_end(&comparison, &now.work, &now.beside);
    tl_comparison_tell(&comparison, hear, NULL);
    TEST_ASSERT_EQUAL_size_t(5, lines);
    TEST_ASSERT_EQUAL_STRING("motor.omega, root mean square of y − ŷ: now 2 rad/s, new 1 rad/s", told[0]);
    TEST_ASSERT_EQUAL_STRING("motor.i, root mean square of y − ŷ: now not seen, new not compared", told[1]);
    TEST_ASSERT_EQUAL_STRING("motor.T, root mean square of y − ŷ: now not compared, new 2 rad/s", told[2]);
    TEST_ASSERT_EQUAL_STRING(
        "now: 5 evaluations, 20 executions, 2 ms a step; of 1000 steps 0 cut short by time, 0 made "
        "up, 2 deadlines missed; in lock 100 %",
        told[3]);
    TEST_ASSERT_EQUAL_STRING(
        "new: 5 evaluations, 20 executions, 2 ms a step; of 1000 steps 3 cut short by time, 0 made "
        "up, 0 deadlines missed; in lock 100 %",
        told[4]);
}

static void test_what_no_twin_could_say(void) {
    now.work.output[0].pairs++;
    now.work.output[0].sum_of_squares = (double)NAN;
    now.work.used = INT64_MAX;
    set_output(&now.work, 1, "motor.T", 0, 0.0);
    for (size_t i = 2; i < TL_MAX_MATCH; i++) {
        set_output(&now.work, i, "motor.omega", 0, 0.0); /* that name is there already */
    }
    tl_comparison_end(&comparison, &now.work, &now.beside);
    tl_comparison_tell(&comparison, hear, NULL);
    TEST_ASSERT_EQUAL_size_t(4, lines);
    TEST_ASSERT_EQUAL_STRING("motor.omega, root mean square of y − ŷ: now not seen, new -", told[0]);
}

static void test_a_good_one(void) {
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
    TEST_ASSERT_EQUAL_STRING("", why);
}

static void test_the_runs_twin_suffers(void) {
    now.beside.deadline_misses = 20;
    now.work.deadline_misses = 20;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_NO_ROOM, judge());
    TEST_ASSERT_EQUAL_STRING(
        "beside it the run's twin missed 20 deadlines and made 0 ticks up of 1000: this box does not "
        "carry two twins",
        why);
}

/* A machine that stands still once, for however many ticks, is no lack of room; one that does so again and again is. */
static void test_the_runs_twin_makes_ticks_up(void) {
    now.beside.skipped = 200;
    now.beside.gaps = 2;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
    setUp();
    now.beside.skipped = 200;
    now.beside.gaps = 3;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_NO_ROOM, judge());
    TEST_ASSERT_NOT_NULL(strstr(why, "made 200 ticks up of 1000"));
    setUp();
    now.beside.skipped = 251;
    now.beside.gaps = 1;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_NO_ROOM, judge());
}

/* It did before: three times as much is allowed. */
static void test_the_runs_twin_as_ever(void) {
    comparison.before.deadline_misses = 10;
    tl_comparison_begin(&comparison, &(tl_run_status){.ticks = 0}, &(tl_run_status){.ticks = 0});
    now.beside.steps = now.beside.ticks = 1000;
    now.beside.deadline_misses = 29;
    now.work.outputs = 0;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
}

/* It has no priority yet. */
static void test_the_shadow_suffers(void) {
    now.work.skipped = now.work.ticks / 4;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
    setUp();
    now.work.skipped = now.work.ticks / 4 + 1;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_NO_ROOM, judge());
    TEST_ASSERT_NOT_NULL(strstr(why, "the new twin missed 0 deadlines"));
}

static void test_the_runs_twin_was_begun_again(void) {
    now.beside.twin_failures = before.twin_failures + 1;
    now.beside.skipped = 500;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, judge());
    TEST_ASSERT_NOT_NULL(strstr(why, "was begun again"));
}

static void test_few_misses_are_none(void) {
    now.work.deadline_misses = 10;
    now.work.skipped = 2;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
}

static void test_the_lock(void) {
    now.work.lock.steps[TL_LOCK_LOCKED] = 900;
    now.work.lock.steps[TL_LOCK_LOST] = 100;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, judge());
    TEST_ASSERT_EQUAL_STRING("the new twin was in lock for 90 % of the steps, asked are 95 %; the run's for 100 %",
                             why);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, tl_comparison_judge(&comparison, 90.0, why));
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, tl_comparison_judge(&comparison, 0.0, why));
}

static void test_the_lock_by_the_tolerances_before(void) {
    now.work.lock_before.steps[TL_LOCK_LOCKED] = 900;
    now.work.lock_before.steps[TL_LOCK_LOST] = 100;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_WORSE, judge());
    TEST_ASSERT_EQUAL_STRING("by the tolerances of the version before, the new twin was in lock for 90 % of the steps, "
                             "asked are 95 %; the run's for 100 %",
                             why);
}

static void test_no_step(void) {
    now.work = (tl_run_status){.ticks = 0};
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, judge());
    TEST_ASSERT_EQUAL_STRING("the new twin has not computed a step", why);
}

/* It has failed, and was begun again: its successor counts from 0. */
static void test_another_twin_of_the_run(void) {
    now.beside = (tl_run_status){.ticks = 500, .steps = 500, .lock.steps[TL_LOCK_LOCKED] = 500};
    tl_comparison_end(&comparison, &now.work, &now.beside);
    tl_comparison_tell(&comparison, hear, NULL);
    TEST_ASSERT_NOT_NULL(strstr(told[1], "of 500 steps"));
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, tl_comparison_judge(&comparison, 95.0, why));
}

/* An event horizon: no stroke has ended yet. */
static void test_a_lock_that_was_not_judged(void) {
    memset(&now.work.lock, 0, sizeof now.work.lock);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
    tl_comparison_tell(&comparison, hear, NULL);
    TEST_ASSERT_NOT_NULL(strstr(told[2], "0 deadlines missed; its lock is not judged yet"));
    TEST_ASSERT_EQUAL_STRING("nothing came that its lock is judged by: that is left to its probation", told[3]);
}

/* So many of a hundred steps in lock, lost, and with no good signal. */
static void set_lock(uint64_t locked, uint64_t lost, uint64_t free) {
    setUp();
    memset(&now.work.lock, 0, sizeof now.work.lock);
    now.work.lock.steps[TL_LOCK_LOCKED] = locked;
    now.work.lock.steps[TL_LOCK_LOST] = lost;
    now.work.lock.steps[TL_LOCK_FREE] = free;
}

/* Both have seen the plant for a moment, in which one tick more or less was in lock. */
static void test_a_plant_that_was_gone(void) {
    set_lock(1, 3, 96);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
    tl_comparison_tell(&comparison, hear, NULL);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(told[3], "the plant was not there for 96 % of the time: its lock is"), told[3]);
    set_lock(0, 49, 51);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, judge());
    set_lock(0, 50, 50);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, judge());
    tl_comparison_tell(&comparison, hear, NULL);
    TEST_ASSERT_EQUAL_size_t(3, lines);
}

/* So many pairs more, and what they are off by. */
static void set_outputs(uint64_t pairs, double now_off, double then_off) {
    setUp();
    set_output(&now.beside, 0, "motor.omega", 100 + pairs, 1e6 + (double)pairs * now_off * now_off);
    set_output(&now.work, 0, "motor.omega", 50 + pairs, 1e9 + (double)pairs * then_off * then_off);
}

static bool is_worse(void) {
    tl_comparison_result result = judge();
    TEST_ASSERT_TRUE(result == TL_COMPARISON_GOOD || result == TL_COMPARISON_WORSE);
    return result == TL_COMPARISON_WORSE;
}

/* Its own tolerance is huge: it was in lock all the time. */
static void test_far_worse_and_in_lock(void) {
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].tolerance = 1e6;
    TEST_ASSERT_TRUE(is_worse());
    TEST_ASSERT_EQUAL_STRING(
        "motor.omega is worse: off by 17 rad/s as root mean square, and the run's by 0.25 rad/s; its tolerance is 1",
        why);
}

static void test_limits_of_worse(void) {
    static const struct {
        double now_off, then_off;
        bool is_worse;
    } rows[] = {
        {0.25, 0.99, false},                          /* within the tolerance of the run, as noise is */
        {0.25, 1.01, true},                           /* and not */
        {0.51, 1.01, false},                          /* not twice as far off */
        {10.0, 19.9, false},                          /* both are out of tolerance: the plant is out of reach */
        {10.0, 20.1, true},        {0.0, 1.01, true}, /* a twin without a fault */
        {17.0, 0.25, false},       {0.25, (double)INFINITY, true},
        {0.25, (double)NAN, true}, {(double)NAN, 17.0, false}, /* nothing to be held against */
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        set_outputs(1000, rows[i].now_off, rows[i].then_off);
        TEST_ASSERT_EQUAL_INT_MESSAGE(rows[i].is_worse, is_worse(), why);
        TEST_ASSERT_EQUAL_INT(rows[i].is_worse, why[0] != '\0');
    }
}

static void test_what_cannot_be_held_against_another(void) {
    set_outputs(TL_COMPARISON_PAIRS - 1, 0.25, 17.0);
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(TL_COMPARISON_PAIRS, 0.25, 17.0);
    TEST_ASSERT_TRUE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].tolerance = 0.0; /* it is not matched any more */
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.beside.output[0].tolerance = 0.0; /* nor was it */
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].unit[0] = 'm'; /* another FMU */
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].name[0] = 'x'; /* another output */
    TEST_ASSERT_FALSE(is_worse());
}

/* The second one. */
static void test_one_of_many_is_worse(void) {
    set_outputs(1000, 0.25, 0.25);
    set_output(&now.beside, 1, "motor.T", 1000, 10.0);
    set_output(&now.work, 1, "motor.T", 1000, 9000.0);
    TEST_ASSERT_TRUE(is_worse());
    TEST_ASSERT_NOT_NULL(strstr(why, "motor.T is worse: off by 3 rad/s"));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_words);
    RUN_TEST(test_what_no_twin_could_say);
    RUN_TEST(test_a_good_one);
    RUN_TEST(test_the_runs_twin_suffers);
    RUN_TEST(test_the_runs_twin_makes_ticks_up);
    RUN_TEST(test_the_runs_twin_as_ever);
    RUN_TEST(test_the_shadow_suffers);
    RUN_TEST(test_the_runs_twin_was_begun_again);
    RUN_TEST(test_few_misses_are_none);
    RUN_TEST(test_the_lock);
    RUN_TEST(test_the_lock_by_the_tolerances_before);
    RUN_TEST(test_no_step);
    RUN_TEST(test_another_twin_of_the_run);
    RUN_TEST(test_a_lock_that_was_not_judged);
    RUN_TEST(test_a_plant_that_was_gone);
    RUN_TEST(test_far_worse_and_in_lock);
    RUN_TEST(test_limits_of_worse);
    RUN_TEST(test_what_cannot_be_held_against_another);
    RUN_TEST(test_one_of_many_is_worse);
    return UNITY_END();
}
