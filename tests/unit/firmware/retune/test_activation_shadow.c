/* Activations with a shadow, up to the handover: the comparison, what ends the shadow, and a
 * probation meanwhile. The run is simulated, see played_run.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/process/role.h"
#include "tests/support/message.h"
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
    tl_played_expect_refused(TL_CONTROL_INVALID, "lock|40 %|95 %|100 %");
}

/* The shadow has seen the plant for a moment only. The client is informed, and the candidate is not
 * refused. */
static void test_a_shadow_without_a_plant(void) {
    run->each.lock.steps[TL_LOCK_LOCKED] = 0;
    run->each.lock.steps[TL_LOCK_LOST] = 1;
    run->each.lock.steps[TL_LOCK_FREE] = 9;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_COMPARE, "signal|90 %"));
}

/* The lock window is longer than the time of the shadow. The client is informed before it waits. */
static void test_a_window_that_is_long(void) {
    run->step_s = "1";
    tl_played_begin_anew();
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "lock|20 s|3.75 s|--shadow 27"));
    TEST_ASSERT_FALSE(tl_played_was_said(TL_CONTROL_PROBATION, "--probation"));
}

/* With an event horizon, the plant determines when a stroke ends. */
static void test_strokes(void) {
    run->each.lock.steps[TL_LOCK_LOCKED] = 0;
    run->by_strokes = true;
    tl_played_begin_anew();
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "strokes|3|3.75 s|--shadow"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "live|5 s|lock"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_COMPARE, "lock|probation"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_PROBATION, "300 s|--probation"));
}

/* The run's twin locks as little, so the shadow is accepted. */
static void test_a_shadow_that_locks_as_little(void) {
    run->each.lock.steps[TL_LOCK_LOCKED] = 4;
    run->each.lock.steps[TL_LOCK_LOST] = 6;
    run->beside = run->each;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
}

/* The candidate has a huge tolerance, so that its shadow is always in lock. */
static void test_a_shadow_that_is_far_worse(void) {
    run->off = 17.0;
    (void)tl_played_take("1e6", 2, TL_CONTROL_MAY_RESTART);
    tl_played_expect_refused(TL_CONTROL_INVALID, "motor.omega|17|0.25|tolerance|1|--accept-worse");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1e6", 2, TL_CONTROL_ACCEPT_WORSE));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_COMPARE, "motor.omega|17|0.25|tolerance|1"));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
}

/* --accept-worse accepts a worse output, but not a lost lock. */
static void test_a_worse_shadow_that_does_not_lock(void) {
    run->off = 17.0;
    run->each.lock.steps[TL_LOCK_LOCKED] = 4;
    run->each.lock.steps[TL_LOCK_LOST] = 6;
    (void)tl_played_take("1", 2, TL_CONTROL_ACCEPT_WORSE | TL_CONTROL_ONLY_CHECK);
    TEST_ASSERT_EQUAL_size_t(0, run->refusals.count); /* it was a check only */
    (void)tl_played_take("1", 2, TL_CONTROL_ACCEPT_WORSE);
    tl_played_expect_refused(TL_CONTROL_INVALID, "lock|40 %");
    TEST_ASSERT_EQUAL_size_t(1, run->refusals.count);
    TL_EXPECT_PARTS("refused|40 %", run->refusals.list[0].result);
}

/* The recorder has not yet recorded the last change. The client is informed once that the shadow
 * waits. */
static void test_a_shadow_that_cannot_be_ordered_yet(void) {
    size_t times = 0;
    tl_played_offer("1", 2, 0);
    while (run->activation.step != TL_CONTROL_SHADOW) {
        TEST_ASSERT_FALSE(tl_played_is_ended());
        tl_activation_poll(&run->activation);
    }
    for (int seconds = 0; seconds < 5; seconds++) {
        run->is_slow = true;
        run->activation.polled_at -= TL_SECOND;
        tl_activation_poll(&run->activation);
    }
    tl_played_poll_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_DONE, run->said[run->count - 1].as.end.result);
    for (size_t i = 0; i < run->count; i++) {
        const char *text = run->said[i].kind == TL_CONTROL_STEP ? run->said[i].as.progress.text : "";
        times += tl_test_has_parts(text, "disk|database") ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_size_t(1, times);
}

static void expect_restart_instead(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "restart"));
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_EQUAL_INT(0, run->handovers);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
}

static void test_a_box_that_does_not_carry_both(void) {
    run->beside.deadline_misses = 5;
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "two twins|--restart");
    expect_restart_instead();
}

/* A shadow has no priority yet, so that skipped ticks do not refuse it. */
static void test_a_shadow_that_skips_ticks(void) {
    run->each.steps = 8;
    run->each.skipped = 2;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
}

static void test_a_shadow_that_dies(void) {
    (void)tl_played_offer("1", 2, TL_CONTROL_MAY_RESTART);
    while (run->other[0] == '\0') {
        tl_activation_poll(&run->activation);
    }
    tl_activation_poll(&run->activation);
    run->shadow.phase = TL_ACTIVATION_SHADOW_FAILED;
    (void)snprintf(run->shadow.why, sizeof run->shadow.why, "its FMU\033 has crashed");
    tl_played_poll_until(tl_played_is_ended);
    tl_played_expect_refused(TL_CONTROL_INVALID, "its FMU\\x1B has crashed");
    run->shadow.why[0] = '\0'; /* fails at once, without a reason */
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "shadow|--restart");
    expect_restart_instead();
}

/* FMUs may take long to load. The client gets replies meanwhile, up to a time-out of 15 minutes. */
static void test_a_shadow_that_never_runs(void) {
    run->shadow.phase = TL_ACTIVATION_SHADOW_BEGINS;
    (void)tl_played_take("1", 2, 0);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "FMUs"));
    tl_played_expect_refused(TL_CONTROL_INVALID, "15 minutes|--restart");
}

/* A check for which the box has too little memory does not end the twin of the version before. */
static void test_a_check_without_room_on_probation(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->active_hash, sizeof before);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_MEMORY", "500000000000000", 1));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 3, TL_CONTROL_ONLY_CHECK | TL_CONTROL_MAY_RESTART));
    TL_EXPECT_PARTS("activated|restart", tl_played_last_word());
    TEST_ASSERT_EQUAL_STRING(before, run->other);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
}

static void test_what_cannot_be(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_LEAST", "20000000", 1));
    (void)tl_played_take("1", 2, TL_CONTROL_MAY_RESTART);
    tl_played_expect_refused(TL_CONTROL_INVALID, "20 ms|10 ms");
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TRIAL_LEAST"));
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_ANSWERS", "2", 1));
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "trial");
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TRIAL_ANSWERS"));
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL_MEMORY", "500000000000000", 1));
    (void)tl_played_take("1", 2, 0);
    tl_played_expect_refused(TL_CONTROL_INVALID, "two twins|--restart");
    expect_restart_instead();
}

static void test_a_shadow_that_is_cancelled(void) {
    bool is_done = false;
    tl_played_offer("1", 2, 0);
    tl_played_poll_until(tl_played_is_live);
    TEST_ASSERT_TRUE(tl_activation_is_busy(&run->activation));
    TEST_ASSERT_FALSE(tl_activation_confirm(&run->activation, "bob", &is_done));
    TEST_ASSERT_TRUE(tl_activation_cancel(&run->activation, "bob"));
    tl_played_expect_refused(TL_CONTROL_CANCELLED, "bob");
    TEST_ASSERT_EQUAL_size_t(1, run->refusals.count);
    TL_EXPECT_PARTS("cancelled|bob", run->refusals.list[0].result);
    TEST_ASSERT_EQUAL_STRING("ann", run->refusals.list[0].who);
    TEST_ASSERT_EQUAL_STRING("reload", run->refusals.list[0].origin);
    TEST_ASSERT_FALSE(tl_activation_cancel(&run->activation, "bob"));
    tl_played_offer("1", 2, 0); /* now during the validation */
    TEST_ASSERT_TRUE(tl_activation_cancel(&run->activation, "bob"));
    tl_played_expect_refused(TL_CONTROL_CANCELLED, "bob");
}

/* In safe hold the run has no twin to compare the shadow with. */
static void test_safe_hold_beside_a_shadow(void) {
    tl_played_offer("1", 2, 0);
    tl_played_poll_until(tl_played_is_live);
    run->view.holds = true;
    tl_played_poll_until(tl_played_is_ended);
    tl_played_expect_refused(TL_CONTROL_INVALID, "safe hold");
}

/* A probation ends while the shadow of another candidate runs. */
static void test_a_probation_beside_a_shadow(void) {
    bool is_done = false;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 1, 0));
    tl_played_offer("0.5", 2, 0);
    tl_played_poll_until(tl_played_is_live);
    TEST_ASSERT_TRUE(tl_activation_confirm(&run->activation, "bob", &is_done));
    TEST_ASSERT_TRUE(is_done);
    TEST_ASSERT_EQUAL_INT(TL_VERSION_KEPT, tl_versions_get(&run->versions, 2)->result);
    tl_played_poll_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_DONE, run->said[run->count - 1].as.end.result);
    tl_played_offer("0.25", 1, 0);
    tl_played_poll_until(tl_played_is_live);
    run->view.figures.twin_failures = 1;
    tl_played_poll_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_FAILED, run->said[run->count - 1].as.end.result);
    TL_EXPECT_PARTS("probation|failed", tl_played_last_word());
    tl_played_poll_until(tl_played_is_quiet);
    tl_activation_poll(&run->activation);
    tl_played_poll_until(tl_played_is_quiet);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
}

/* A check runs the shadow, but does not activate the candidate. */
static void test_a_shadow_only(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, TL_CONTROL_ONLY_CHECK));
    TL_EXPECT_PARTS("activated|gap", tl_played_last_word());
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
    RUN_TEST(test_a_shadow_that_skips_ticks);
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
