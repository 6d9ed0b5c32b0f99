/* Activations beside a shadow, up to the flip: what is compared, what ends it, and what goes on meanwhile. What is played here: played_run.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/process/role.h"
#include "tests/support/played_run.h"

static tl_played *run;

void setUp(void) {
    tl_played_set();
}

void tearDown(void) {
    tl_played_clear();
}

static void test_a_shadow_that_does_not_lock(void) {
    run->each.lock.steps[TL_LOCK_LOCKED] = 4;
    run->each.lock.steps[TL_LOCK_LOST] = 6;
    (void)tl_played_take("1", 2, TL_CONTROL_MAY_RESTART);
    tl_played_expect_refused(TL_CONTROL_INVALID, "in lock for 40 % of the steps, asked are 95 %; the run's for 100 %");
}

/* It has seen the plant for a moment; that is told, and no reason to refuse it. */
static void test_a_shadow_without_a_plant(void) {
    run->each.lock.steps[TL_LOCK_LOCKED] = 0;
    run->each.lock.steps[TL_LOCK_LOST] = 1;
    run->each.lock.steps[TL_LOCK_FREE] = 9;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_TRUE(
        tl_played_was_said(TL_CONTROL_COMPARE, "the plant was not there for 90 % of the time: its lock is not judged"));
}

/* What its lock is judged by takes longer than it is given: told before anybody waits. */
static void test_a_window_that_is_long(void) {
    run->step_s = "1";
    tl_played_begin_anew();
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW,
                                        "its lock is judged over 20 s, and this gives it 3.75 s: use --shadow 27"));
    TEST_ASSERT_FALSE(tl_played_was_said(TL_CONTROL_PROBATION, "its lock is judged"));
}

/* An event horizon: strokes come when the plant wants. */
static void test_strokes(void) {
    run->each.lock.steps[TL_LOCK_LOCKED] = 0;
    run->by_strokes = true;
    tl_played_begin_anew();
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW,
                                        "its lock is judged by strokes that have ended, and by 3 of them at "
                                        "first: if they do not come within 3.75 s, it is not judged here; "
                                        "--shadow S gives it more"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "live: 5 of 5 s, its lock is not judged yet"));
    TEST_ASSERT_TRUE(
        tl_played_was_said(TL_CONTROL_COMPARE, "nothing came that its lock is judged by: that is left to its"));
    TEST_ASSERT_TRUE(
        tl_played_was_said(TL_CONTROL_PROBATION, "within 300 s, it is not judged here; --probation S gives"));
}

/* The run's twin is no better. */
static void test_a_shadow_that_locks_as_little(void) {
    run->each.lock.steps[TL_LOCK_LOCKED] = 4;
    run->each.lock.steps[TL_LOCK_LOST] = 6;
    run->beside = run->each;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
}

/* In lock all the time, by a tolerance of its own that is huge. */
static void test_a_shadow_that_is_far_worse(void) {
    run->off = 17.0;
    (void)tl_played_take("1e6", 2, TL_CONTROL_MAY_RESTART);
    tl_played_expect_refused(
        TL_CONTROL_INVALID,
        "motor.omega is worse: off by 17 as root mean square, and the run's by 0.25; its tolerance is 1: "
        "--accept-worse takes it all the same");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1e6", 2, TL_CONTROL_EVEN_WORSE));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_COMPARE, "its tolerance is 1: taken all the same, as asked"));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
}

/* Who insists on an output does not on the lock. */
static void test_a_worse_shadow_that_does_not_lock(void) {
    run->off = 17.0;
    run->each.lock.steps[TL_LOCK_LOCKED] = 4;
    run->each.lock.steps[TL_LOCK_LOST] = 6;
    (void)tl_played_take("1", 2, TL_CONTROL_EVEN_WORSE | TL_CONTROL_ONLY_CHECK);
    TEST_ASSERT_EQUAL_size_t(0, run->refusals.count); /* it was only to be looked at */
    (void)tl_played_take("1", 2, TL_CONTROL_EVEN_WORSE);
    tl_played_expect_refused(TL_CONTROL_INVALID, "in lock for 40 % of the steps");
    TEST_ASSERT_EQUAL_size_t(1, run->refusals.count);
    TEST_ASSERT_EQUAL_STRING_LEN("refused: ", run->refusals.list[0].result, 9);
}

/* The recorder has not written down what the last change has left: why nothing happens is said, once. */
static void test_a_shadow_that_cannot_be_ordered_yet(void) {
    size_t times = 0;
    tl_played_offer("1", 2, 0);
    while (run->activation.step != TL_CONTROL_SHADOW) {
        TEST_ASSERT_FALSE(tl_played_is_ended());
        tl_activation_look(&run->activation);
    }
    for (int seconds = 0; seconds < 5; seconds++) {
        run->is_slow = true;
        run->activation.looked -= TL_SECOND;
        tl_activation_look(&run->activation);
    }
    tl_played_look_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_DONE, run->said[run->count - 1].as.end.result);
    for (size_t i = 0; i < run->count; i++) {
        const char *text = run->said[i].kind == TL_CONTROL_STEP ? run->said[i].as.progress.text : "";
        times += strstr(text, "it waits until what the last change has left is recorded") != NULL;
    }
    TEST_ASSERT_EQUAL_size_t(1, times);
}

static void assert_restart_instead(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "by a restart, then"));
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_EQUAL_INT(0, run->handovers);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
}

static void test_a_box_that_does_not_carry_both(void) {
    run->beside.deadline_misses = 5;
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "this box does not carry two twins: use --restart");
    assert_restart_instead();
}

/* It has no priority yet: told, and no more. */
static void test_a_shadow_that_makes_ticks_up(void) {
    run->each.steps = 8;
    run->each.skipped = 2;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
}

static void test_a_shadow_that_dies(void) {
    (void)tl_played_offer("1", 2, TL_CONTROL_MAY_RESTART);
    while (run->other[0] == '\0') {
        tl_activation_look(&run->activation);
    }
    tl_activation_look(&run->activation);
    run->shadow.phase = TL_ACTIVATION_SHADOW_FAILED;
    (void)snprintf(run->shadow.why, sizeof run->shadow.why, "its FMU\033 has crashed");
    tl_played_look_until(tl_played_is_ended);
    tl_played_expect_refused(TL_CONTROL_INVALID, "its FMU\\x1B has crashed");
    run->shadow.why[0] = '\0'; /* and at once: there is no room for it */
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "it died: use --restart");
    assert_restart_instead();
}

/* Its FMUs may take long to load, and who listens is to know that it goes on; not for ever. */
static void test_a_shadow_that_never_runs(void) {
    run->shadow.phase = TL_ACTIVATION_SHADOW_BEGINS;
    (void)tl_played_take("1", 2, 0);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "its FMUs are loaded"));
    tl_played_expect_refused(TL_CONTROL_INVALID, "not at the plant's ticks after 15 minutes: use --restart");
}

/* A check that has no room leaves the twin before where it is. */
static void test_a_check_without_room_on_probation(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->in_force, sizeof before);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_MEMORY", "500000000000000", 1));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 3, TL_CONTROL_ONLY_CHECK | TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_EQUAL_STRING("it can be activated, with a restart of the run", tl_played_last_word());
    TEST_ASSERT_EQUAL_STRING(before, run->other);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
}

static void test_what_cannot_be(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_LEAST", "20000000", 1));
    (void)tl_played_take("1", 2, TL_CONTROL_MAY_RESTART);
    tl_played_expect_refused(TL_CONTROL_INVALID, "a step takes 20 ms here without any search, and has 10 ms");
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TRIAL_LEAST"));
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_ANSWERS", "2", 1));
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "its trial has not said what it takes");
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TRIAL_ANSWERS"));
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_MEMORY", "500000000000000", 1));
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "this box does not carry two twins: use --restart");
    assert_restart_instead();
}

static void test_a_shadow_that_is_cancelled(void) {
    bool is_done = false;
    tl_played_offer("1", 2, 0);
    tl_played_look_until(tl_played_is_live);
    TEST_ASSERT_TRUE(tl_activation_is_busy(&run->activation));
    TEST_ASSERT_FALSE(tl_activation_confirm(&run->activation, "bob", &is_done));
    TEST_ASSERT_TRUE(tl_activation_cancel(&run->activation, "bob"));
    tl_played_expect_refused(TL_CONTROL_CANCELLED, "by bob; nothing was changed");
    TEST_ASSERT_EQUAL_size_t(1, run->refusals.count);
    TEST_ASSERT_EQUAL_STRING("cancelled: by bob; nothing was changed", run->refusals.list[0].result);
    TEST_ASSERT_EQUAL_STRING("ann", run->refusals.list[0].who);
    TEST_ASSERT_EQUAL_STRING("reload", run->refusals.list[0].origin);
    TEST_ASSERT_FALSE(tl_activation_cancel(&run->activation, "bob"));
    tl_played_offer("1", 2, 0); /* while it is validated */
    TEST_ASSERT_TRUE(tl_activation_cancel(&run->activation, "bob"));
    tl_played_expect_refused(TL_CONTROL_CANCELLED, "by bob; nothing was changed");
}

/* A run that comes into safe hold has nothing to compare with. */
static void test_safe_hold_beside_a_shadow(void) {
    tl_played_offer("1", 2, 0);
    tl_played_look_until(tl_played_is_live);
    run->view.holds = true;
    tl_played_look_until(tl_played_is_ended);
    tl_played_expect_refused(TL_CONTROL_INVALID, "safe hold");
}

/* A probation does not wait for the shadow of another candidate. */
static void test_a_probation_beside_a_shadow(void) {
    bool is_done = false;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 1, 0));
    tl_played_offer("0.5", 2, 0);
    tl_played_look_until(tl_played_is_live);
    TEST_ASSERT_TRUE(tl_activation_confirm(&run->activation, "bob", &is_done));
    TEST_ASSERT_TRUE(is_done);
    TEST_ASSERT_EQUAL_INT(TL_VERSION_KEPT, tl_versions_get(&run->versions, 2)->result);
    tl_played_look_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_DONE, run->said[run->count - 1].as.end.result);
    tl_played_offer("0.25", 1, 0);
    tl_played_look_until(tl_played_is_live);
    run->view.figures.twin_failures = 1;
    tl_played_look_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_FAILED, run->said[run->count - 1].as.end.result);
    TEST_ASSERT_NOT_NULL(strstr(tl_played_last_word(), "is returned from first: the twin has failed"));
    tl_played_look_until(tl_played_is_quiet);
    tl_activation_look(&run->activation);
    tl_played_look_until(tl_played_is_quiet);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
}

/* There is another twin, and a person has a look first. */
static void test_a_shadow_only(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, TL_CONTROL_ONLY_CHECK));
    TEST_ASSERT_EQUAL_STRING("it can be activated without a gap", tl_played_last_word());
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_EQUAL_INT(0, run->handovers);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

int main(int argc, char **argv) {
    (void)argc;
    const char *title = tl_role_begin(argv);
    if (title != NULL) {
        return tl_played_be(title, NULL);
    }
    run = tl_played_open(TL_BINARY_DIR, "test_activation_shadow");
    UNITY_BEGIN();
    RUN_TEST(test_a_shadow_that_does_not_lock);
    RUN_TEST(test_a_shadow_that_locks_as_little);
    RUN_TEST(test_a_shadow_without_a_plant);
    RUN_TEST(test_a_window_that_is_long);
    RUN_TEST(test_strokes);
    RUN_TEST(test_a_shadow_that_is_far_worse);
    RUN_TEST(test_a_worse_shadow_that_does_not_lock);
    RUN_TEST(test_a_shadow_that_cannot_be_ordered_yet);
    RUN_TEST(test_a_box_that_does_not_carry_both);
    RUN_TEST(test_a_shadow_that_makes_ticks_up);
    RUN_TEST(test_a_shadow_that_dies);
    RUN_TEST(test_a_shadow_that_never_runs);
    RUN_TEST(test_a_check_without_room_on_probation);
    RUN_TEST(test_what_cannot_be);
    RUN_TEST(test_a_shadow_that_is_cancelled);
    RUN_TEST(test_safe_hold_beside_a_shadow);
    RUN_TEST(test_a_probation_beside_a_shadow);
    RUN_TEST(test_a_shadow_only);
    return tl_played_close(UNITY_END());
}
