/* Activations by a handover, and the return on probation: after a failure, after a crash of the
 * activation process, and with a second candidate. The run is simulated, see played_run.h. */
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

static void test_a_handover(void) {
    const tl_run_status misses = {.steps = 100, .deadline_misses = 50};
    char before[TL_SHA256_TEXT];
    memcpy(before, run->active_hash, sizeof before);
    run->shadow.phase = TL_ACTIVATION_SHADOW_BEGINS;
    run->is_slow = true;
    run->view.figures.steps = 1000;
    tl_played_offer("1", 2, 0);
    while (run->other[0] == '\0') {
        tl_activation_poll(&run->activation);
    }
    TEST_ASSERT_EQUAL_UINT(1, run->needs.match);
    TEST_ASSERT_EQUAL_UINT(2, run->needs.adjust);
    TEST_ASSERT_EQUAL_UINT(3, run->needs.components);
    run->shadow.phase = TL_ACTIVATION_SHADOW_RECORDED;
    run->shadow.work.tick = 1200;
    run->shadow.work.last = 6000;
    tl_played_add(&run->shadow.work, &misses); /* before the comparison begins */
    run->activation.polled_at -= 11 * TL_SECOND;
    tl_activation_poll(&run->activation);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "1200|6000"));
    run->shadow.phase = TL_ACTIVATION_SHADOW_LIVE;
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active); /* the handover writes the version to disk */
    tl_played_poll_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_DONE, run->said[run->count - 1].as.end.result);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_PREDICT, "1 ms|10 ms"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "live|5 s|lock"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_COMPARE, "new|lock"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_ACTIVATE, "twin"));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_STRING("", run->given);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 2)->hash, run->active_hash);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.probation.version);
    TEST_ASSERT_EQUAL_STRING(before, run->other); /* runs as a shadow until the version is kept */
    bool is_done = false;
    TEST_ASSERT_TRUE(tl_activation_confirm(&run->activation, "ann", &is_done));
    TEST_ASSERT_TRUE(is_done);
    TEST_ASSERT_EQUAL_STRING("", run->other);
}

/* The probation does not count steps before the handover. */
static void test_figures_after_a_handover(void) {
    run->view.figures.ticks = run->view.figures.steps = 1000;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    run->view.figures.ticks = run->view.figures.steps = 10;
    run->view.figures.deadline_misses = 2;
    tl_activation_poll(&run->activation);
    TEST_ASSERT_EQUAL_UINT64(10, run->activation.probation.account.steps);
    TEST_ASSERT_EQUAL_UINT64(2, run->activation.probation.account.misses);
    TEST_ASSERT_EQUAL_UINT64(1000, run->activation.probation.account.before_steps);
}

/* The text is the same, but the file of an FMU was replaced: the change needs a new twin. */
static void test_an_fmu_that_was_replaced(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_SAME, tl_played_take("1", 1, 0));
    run->are_others = true;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 1, 0));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_VALIDATE, "FMU|file|new twin"));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_INT(TL_CHANGE_NEW_TWIN, tl_versions_get(&run->versions, 2)->kind);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 1)->hash, tl_versions_get(&run->versions, 2)->hash);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* The client learns within 3 s that the twin has not answered, not only at the time-out. */
static void test_a_handover_that_takes_long(void) {
    run->handed_over = TL_ACTIVATION_WAITS;
    tl_played_offer("1", 2, 0);
    while (run->activation.row != TL_ACTIVATION_ROW_ANSWER) {
        TEST_ASSERT_FALSE(tl_played_is_ended());
        run->activation.polled_at -= run->activation.step == TL_CONTROL_SHADOW ? TL_SECOND / 10 : 0;
        tl_activation_poll(&run->activation);
    }
    TEST_ASSERT_FALSE(tl_played_was_said(TL_CONTROL_ACTIVATE, "60 s"));
    run->activation.polled_at -= 3 * TL_SECOND;
    tl_activation_poll(&run->activation);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_ACTIVATE, "twin|60 s"));
    size_t before = run->count;
    run->activation.polled_at -= 3 * TL_SECOND;
    tl_activation_poll(&run->activation);
    TEST_ASSERT_EQUAL_size_t(before, run->count);
    run->activation.polled_at -= 60 * TL_SECOND;
    tl_activation_poll(&run->activation);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_FAILED, run->said[run->count - 1].as.end.result);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

static void test_a_handover_that_is_refused(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->active_hash, sizeof before);
    run->handed_over = TL_ACTIVATION_REFUSED;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FAILED, tl_played_take("1", 2, 0));
    TL_EXPECT_PARTS("twin|it has died", tl_played_last_word());
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_EQUAL_UINT64(0, run->versions.probation.version);
    TEST_ASSERT_EQUAL_STRING(before, run->active_hash);
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_TRUE(tl_activation_is_idle(&run->activation));
}

/* The activation process ends after the write to disk. If the handover has not happened, the next
 * process restarts the run. If the handover happens while it polls, no restart is needed. */
static void test_a_handover_that_was_not_finished(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_activation_end(&run->activation);
    memcpy(run->active_hash, tl_versions_get(&run->versions, 1)->hash, sizeof run->active_hash);
    tl_played_begin();
    memcpy(run->active_hash, tl_versions_get(&run->versions, 2)->hash, sizeof run->active_hash);
    tl_played_poll_until(tl_played_is_quiet);
    TEST_ASSERT_FALSE(run->has_restarted);
    tl_activation_end(&run->activation);
    memcpy(run->active_hash, tl_versions_get(&run->versions, 1)->hash, sizeof run->active_hash);
    tl_played_begin();
    tl_played_poll_until(tl_played_is_quiet);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.probation.version);
}

/* ---- return to the version before ---- */

static void test_a_handover_back(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->active_hash, sizeof before);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_STRING(before, run->active_hash);
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_EQUAL_INT(TL_VERSION_ROLLED_BACK, tl_versions_get(&run->versions, 2)->result);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_RETURNED, "twin|failed"));
    TEST_ASSERT_TRUE(tl_activation_is_idle(&run->activation));
}

/* The version before is active on disk. Its twin is gone, so the run restarts. */
static void test_a_handover_back_without_the_twin_before(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    run->shadow.phase = TL_ACTIVATION_SHADOW_FAILED;
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

static void test_a_handover_back_that_is_refused(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    run->handed_over = TL_ACTIVATION_REFUSED;
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* The activation process ends on probation. The next one finds the twin of the version before. */
static void test_a_handover_back_after_a_crash_of_the_process(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_activation_end(&run->activation);
    tl_played_begin();
    tl_activation_poll(&run->activation);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* The activation process ends while the shadow of a second candidate runs. The next process does
 * not return to that shadow. */
static void test_a_crash_of_the_process_beside_a_shadow(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_played_offer("1", 3, 0);
    tl_played_poll_until(tl_played_is_live);
    tl_worker_close(&run->activation.worker);
    free(run->activation.text);
    tl_played_begin();
    TEST_ASSERT_EQUAL_STRING("", run->other);
    tl_activation_poll(&run->activation);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* ---- a second candidate on probation ---- */

/* The twin that took over accepts a second change in place. A failure returns to the version before
 * both, whose twin still runs. */
static void test_in_place_after_a_handover(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->active_hash, sizeof before);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 2, 0));
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 3)->hash, run->active_hash);
    TEST_ASSERT_EQUAL_STRING(before, run->other);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_STRING(before, run->active_hash);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* The second shadow needs the slot of the twin before. Then a return needs a restart. */
static void test_a_second_handover_on_probation(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 3, 0));
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.probation.return_to);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "twin|rollback"));
    TEST_ASSERT_EQUAL_STRING("", run->other);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

int main(int argc, char **argv) {
    (void)argc;
    const char *title = tl_role_begin(argv);
    if (title != NULL) {
        return tl_played_be(title, NULL);
    }
    run = tl_played_open(TL_BINARY_DIR, "test_activation_handover");
    UNITY_BEGIN();
    RUN_TEST(test_a_handover);
    RUN_TEST(test_figures_after_a_handover);
    RUN_TEST(test_an_fmu_that_was_replaced);
    RUN_TEST(test_a_handover_that_takes_long);
    RUN_TEST(test_a_handover_back);
    RUN_TEST(test_a_handover_back_without_the_twin_before);
    RUN_TEST(test_a_handover_back_that_is_refused);
    RUN_TEST(test_a_handover_back_after_a_crash_of_the_process);
    RUN_TEST(test_a_crash_of_the_process_beside_a_shadow);
    RUN_TEST(test_in_place_after_a_handover);
    RUN_TEST(test_a_second_handover_on_probation);
    RUN_TEST(test_a_handover_that_is_refused);
    RUN_TEST(test_a_handover_that_was_not_finished);
    return tl_played_close(UNITY_END());
}
