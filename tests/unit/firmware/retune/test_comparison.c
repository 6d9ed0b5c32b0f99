/* Comparison of two twins over the same time: its text, and whether the new twin may take over. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/retune/comparison.h"
#include "tests/support/message.h"

enum { LINES = 8 };

static tl_run_status before;
static struct { tl_run_status work, beside; } now;
static tl_comparison comparison;
static char why[TL_COMPARISON_TEXT];
static char line[LINES][TL_COMPARISON_TEXT];
static size_t lines;

static void on_event(void *context, const char *text) {
    (void)context;
    TEST_ASSERT_LESS_THAN_size_t(LINES, lines);
    (void)snprintf(line[lines++], TL_COMPARISON_TEXT, "%s", text);
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

/* Adds 1000 steps, all in lock. */
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

static tl_comparison_result lock_monitor(void) {
    tl_comparison_end(&comparison, &now.work, &now.beside);
    return tl_comparison_evaluate(&comparison, 95.0, why);
}

/* The text has `first`, the value of the run's twin, before `second`, the value of the new twin. */
static void expect_order(const char *first, const char *second, const char *text) {
    const char *at = strstr(text, first);
    TEST_ASSERT_TRUE_MESSAGE(at != NULL && strstr(at, second) != NULL, text);
}

/* Steps before the begin of the comparison do not count. */
static void test_text(void) {
    now.work.timed_out = 3;
    now.beside.deadline_misses = 2;
    set_output(&now.beside, 0, "motor.omega", 200, 1e6 + 400.0);
    set_output(&now.beside, 1, "motor.i", 0, 0.0);
    set_output(&now.work, 0, "motor.omega", 150, 1e9 + 100.0);
    set_output(&now.work, 1, "motor.T", 4, 16.0);
    tl_comparison_end(&comparison, &now.work, &now.beside);
    tl_comparison_report(&comparison, on_event, NULL);
    TEST_ASSERT_EQUAL_size_t(5, lines);
    TL_EXPECT_PARTS("motor.omega|2 rad/s|1 rad/s", line[0]);
    expect_order("2 rad/s", "1 rad/s", line[0]);
    TL_EXPECT_PARTS("motor.i|good|matched", line[1]);
    expect_order("good", "matched", line[1]);
    TL_EXPECT_PARTS("motor.T|matched|2 rad/s", line[2]);
    expect_order("matched", "2 rad/s", line[2]);
    TL_EXPECT_PARTS("5 evaluations|20 executions|2 ms|1000 steps|2 deadlines|100 %", line[3]);
    TL_EXPECT_PARTS("5 evaluations|20 executions|2 ms|1000 steps|3|0 deadlines|100 %", line[4]);
}

static void test_impossible_values(void) {
    now.work.output[0].pairs++;
    now.work.output[0].sum_of_squares = (double)NAN;
    now.work.used = INT64_MAX;
    set_output(&now.work, 1, "motor.T", 0, 0.0);
    for (size_t i = 2; i < TL_MAX_MATCH; i++) {
        set_output(&now.work, i, "motor.omega", 0, 0.0); /* a second output of that name */
    }
    tl_comparison_end(&comparison, &now.work, &now.beside);
    tl_comparison_report(&comparison, on_event, NULL);
    TEST_ASSERT_EQUAL_size_t(4, lines);
    TL_EXPECT_PARTS("motor.omega|good|-", line[0]);
    TEST_ASSERT_NULL(strstr(line[0], "rad/s"));
}

static void test_a_good_one(void) {
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
    TEST_ASSERT_EQUAL_STRING("", why);
}

static void test_the_runs_twin_suffers(void) {
    now.beside.deadline_misses = 20;
    now.work.deadline_misses = 20;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_TOO_SLOW, lock_monitor());
    TL_EXPECT_PARTS("run's twin|20 deadlines|0|1000|two twins", why);
}

/* One or two long gaps of the machine are accepted. More gaps mean that it is too slow for two
 * twins. */
static void test_the_runs_twin_skips_ticks(void) {
    now.beside.skipped = 200;
    now.beside.gaps = 2;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
    setUp();
    now.beside.skipped = 200;
    now.beside.gaps = 3;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_TOO_SLOW, lock_monitor());
    TL_EXPECT_PARTS("run's twin|200|1000", why);
    setUp();
    now.beside.skipped = 251;
    now.beside.gaps = 1;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_TOO_SLOW, lock_monitor());
}

/* The run's twin missed deadlines before: up to three times as many are accepted. */
static void test_the_runs_twin_as_ever(void) {
    comparison.before.deadline_misses = 10;
    tl_comparison_begin(&comparison, &(tl_run_status){.ticks = 0}, &(tl_run_status){.ticks = 0});
    now.beside.steps = now.beside.ticks = 1000;
    now.beside.deadline_misses = 29;
    now.work.outputs = 0;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
}

/* The shadow has no priority yet. */
static void test_the_shadow_suffers(void) {
    now.work.skipped = now.work.ticks / 4;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
    setUp();
    now.work.skipped = now.work.ticks / 4 + 1;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_TOO_SLOW, lock_monitor());
    TL_EXPECT_PARTS("new twin|0 deadlines|251|1000", why);
}

static void test_the_runs_twin_was_restarted(void) {
    now.beside.twin_failures = before.twin_failures + 1;
    now.beside.skipped = 500;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, lock_monitor());
    TL_EXPECT_PARTS("run's twin", why);
}

static void test_few_misses_are_none(void) {
    now.work.deadline_misses = 10;
    now.work.skipped = 2;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
}

static void test_the_lock(void) {
    now.work.lock.steps[TL_LOCK_LOCKED] = 900;
    now.work.lock.steps[TL_LOCK_LOST] = 100;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, lock_monitor());
    TL_EXPECT_PARTS("new twin|lock|90 %|95 %|100 %", why);
    TEST_ASSERT_FALSE(tl_test_has_parts(why, "tolerances"));
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, tl_comparison_evaluate(&comparison, 90.0, why));
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, tl_comparison_evaluate(&comparison, 0.0, why));
}

static void test_the_lock_by_the_tolerances_before(void) {
    now.work.lock_before.steps[TL_LOCK_LOCKED] = 900;
    now.work.lock_before.steps[TL_LOCK_LOST] = 100;
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_WORSE, lock_monitor());
    TL_EXPECT_PARTS("tolerances|new twin|lock|90 %|95 %|100 %", why);
}

static void test_no_step(void) {
    now.work = (tl_run_status){.ticks = 0};
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, lock_monitor());
    TL_EXPECT_PARTS("new twin|step", why);
}

/* The run's twin has failed and was restarted: its successor counts from 0. */
static void test_another_twin_of_the_run(void) {
    now.beside = (tl_run_status){.ticks = 500, .steps = 500, .lock.steps[TL_LOCK_LOCKED] = 500};
    tl_comparison_end(&comparison, &now.work, &now.beside);
    tl_comparison_report(&comparison, on_event, NULL);
    TL_EXPECT_PARTS("500 steps", line[1]);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, tl_comparison_evaluate(&comparison, 95.0, why));
}

/* With an event horizon, the lock is not judged until a stroke ends. */
static void test_a_lock_that_was_not_judged(void) {
    memset(&now.work.lock, 0, sizeof now.work.lock);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
    tl_comparison_report(&comparison, on_event, NULL);
    TL_EXPECT_PARTS("0 deadlines|lock", line[2]);
    TL_EXPECT_PARTS("lock|probation", line[3]);
}

/* Sets how many of 100 steps are in lock, lost, or without a good signal. */
static void set_lock(uint64_t locked, uint64_t lost, uint64_t free) {
    setUp();
    memset(&now.work.lock, 0, sizeof now.work.lock);
    now.work.lock.steps[TL_LOCK_LOCKED] = locked;
    now.work.lock.steps[TL_LOCK_LOST] = lost;
    now.work.lock.steps[TL_LOCK_FREE] = free;
}

/* Both twins have seen the plant for a moment only, so that their locks cannot be compared. */
static void test_a_plant_that_was_gone(void) {
    set_lock(1, 3, 96);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
    tl_comparison_report(&comparison, on_event, NULL);
    TL_EXPECT_PARTS("signal|96 %|lock", line[3]);
    set_lock(0, 49, 51);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_GOOD, lock_monitor());
    set_lock(0, 50, 50);
    TEST_ASSERT_EQUAL_INT(TL_COMPARISON_BAD, lock_monitor());
    tl_comparison_report(&comparison, on_event, NULL);
    TEST_ASSERT_EQUAL_size_t(3, lines);
}

/* Adds pairs with a constant error: of the run's twin, and of the new twin. */
static void set_outputs(uint64_t pairs, double now_off, double then_off) {
    setUp();
    set_output(&now.beside, 0, "motor.omega", 100 + pairs, 1e6 + (double)pairs * now_off * now_off);
    set_output(&now.work, 0, "motor.omega", 50 + pairs, 1e9 + (double)pairs * then_off * then_off);
}

static bool is_worse(void) {
    tl_comparison_result result = lock_monitor();
    TEST_ASSERT_TRUE(result == TL_COMPARISON_GOOD || result == TL_COMPARISON_WORSE);
    return result == TL_COMPARISON_WORSE;
}

/* The new twin has a huge tolerance, so that it is always in lock. */
static void test_far_worse_and_in_lock(void) {
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].tolerance = 1e6;
    TEST_ASSERT_TRUE(is_worse());
    TL_EXPECT_PARTS("motor.omega|17 rad/s|0.25 rad/s|tolerance|1", why);
}

static void test_limits_of_worse(void) {
    static const struct {
        double now_off, then_off;
        bool is_worse;
    } rows[] = {
        {0.25, 0.99, false},                          /* within the run's tolerance */
        {0.25, 1.01, true},                           /* outside the run's tolerance */
        {0.51, 1.01, false},                          /* less than twice the run's error */
        {10.0, 19.9, false},                          /* less than twice the error */
        {10.0, 20.1, true},        {0.0, 1.01, true}, /* the run's twin has no error */
        {17.0, 0.25, false},       {0.25, (double)INFINITY, true},
        {0.25, (double)NAN, true}, {(double)NAN, 17.0, false}, /* the run's error is unknown */
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        set_outputs(1000, rows[i].now_off, rows[i].then_off);
        TEST_ASSERT_EQUAL_INT_MESSAGE(rows[i].is_worse, is_worse(), why);
        TEST_ASSERT_EQUAL_INT(rows[i].is_worse, why[0] != '\0');
    }
}

static void test_outputs_that_are_not_compared(void) {
    set_outputs(TL_COMPARISON_PAIRS - 1, 0.25, 17.0);
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(TL_COMPARISON_PAIRS, 0.25, 17.0);
    TEST_ASSERT_TRUE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].tolerance = 0.0; /* no longer matched */
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.beside.output[0].tolerance = 0.0; /* not matched before */
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].unit[0] = 'm'; /* another unit */
    TEST_ASSERT_FALSE(is_worse());
    set_outputs(1000, 0.25, 17.0);
    now.work.output[0].name[0] = 'x'; /* another output */
    TEST_ASSERT_FALSE(is_worse());
}

/* Only the second output is worse. */
static void test_one_of_many_is_worse(void) {
    set_outputs(1000, 0.25, 0.25);
    set_output(&now.beside, 1, "motor.T", 1000, 10.0);
    set_output(&now.work, 1, "motor.T", 1000, 9000.0);
    TEST_ASSERT_TRUE(is_worse());
    TL_EXPECT_PARTS("motor.T|3 rad/s|0.1 rad/s", why);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_text);
    RUN_TEST(test_impossible_values);
    RUN_TEST(test_a_good_one);
    RUN_TEST(test_the_runs_twin_suffers);
    RUN_TEST(test_the_runs_twin_skips_ticks);
    RUN_TEST(test_the_runs_twin_as_ever);
    RUN_TEST(test_the_shadow_suffers);
    RUN_TEST(test_the_runs_twin_was_restarted);
    RUN_TEST(test_few_misses_are_none);
    RUN_TEST(test_the_lock);
    RUN_TEST(test_the_lock_by_the_tolerances_before);
    RUN_TEST(test_no_step);
    RUN_TEST(test_another_twin_of_the_run);
    RUN_TEST(test_a_lock_that_was_not_judged);
    RUN_TEST(test_a_plant_that_was_gone);
    RUN_TEST(test_far_worse_and_in_lock);
    RUN_TEST(test_limits_of_worse);
    RUN_TEST(test_outputs_that_are_not_compared);
    RUN_TEST(test_one_of_many_is_worse);
    return UNITY_END();
}
