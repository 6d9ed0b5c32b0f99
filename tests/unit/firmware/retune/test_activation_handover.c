/* Activations by a flip, and the way back: on probation, after a death, and when another one comes first. What is played here: played_run.h. */
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

static void test_a_handover(void) {
    const tl_run_status misses = {.steps = 100, .deadline_misses = 50};
    char before[TL_SHA256_TEXT];
    memcpy(before, run->in_force, sizeof before);
    run->shadow.phase = TL_ACTIVATION_SHADOW_BEGINS;
    run->is_slow = true;
    run->view.figures.steps = 1000;
    tl_played_offer("1", 2, 0);
    while (run->other[0] == '\0') {
        tl_activation_look(&run->activation);
    }
    TEST_ASSERT_EQUAL_UINT(1, run->needs.match);
    TEST_ASSERT_EQUAL_UINT(2, run->needs.adjust);
    TEST_ASSERT_EQUAL_UINT(3, run->needs.components);
    run->shadow.phase = TL_ACTIVATION_SHADOW_RECORDED;
    run->shadow.work.tick = 1200;
    run->shadow.work.last = 6000;
    tl_played_add(&run->shadow.work, &misses); /* are not compared, nor what comes before the lead-in is over */
    run->activation.looked -= 11 * TL_SECOND;
    tl_activation_look(&run->activation);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "recorded samples: 1200 of 6000"));
    run->shadow.phase = TL_ACTIVATION_SHADOW_LIVE;
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active); /* until the flip nothing is on disk */
    tl_played_look_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_DONE, run->said[run->count - 1].as.end.result);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_PREDICT, "a step takes 1 ms of 10 ms"));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "live: 5 of 5 s, in lock "));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_COMPARE, "new: "));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_ACTIVATE, "between two ticks"));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_STRING("", run->given);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 2)->hash, run->in_force);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.probation.version);
    TEST_ASSERT_EQUAL_STRING(before, run->other); /* goes on as a shadow, until the version is kept */
    bool is_done = false;
    TEST_ASSERT_TRUE(tl_activation_confirm(&run->activation, "ann", &is_done));
    TEST_ASSERT_TRUE(is_done);
    TEST_ASSERT_EQUAL_STRING("", run->other);
}

/* What the run did before the flip is nothing that its probation counts. */
static void test_figures_after_a_handover(void) {
    run->view.figures.ticks = run->view.figures.steps = 1000;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    run->view.figures.ticks = run->view.figures.steps = 10;
    run->view.figures.deadline_misses = 2;
    tl_activation_look(&run->activation);
    TEST_ASSERT_EQUAL_UINT64(10, run->activation.probation.account.steps);
    TEST_ASSERT_EQUAL_UINT64(2, run->activation.probation.account.misses);
    TEST_ASSERT_EQUAL_UINT64(1000, run->activation.probation.account.before_steps);
}

/* The same text, and an FMU's file that was replaced: another twin, which comes and goes as any other. */
static void test_an_fmu_that_was_replaced(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_SAME, tl_played_take("1", 1, 0));
    run->are_others = true;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 1, 0));
    TEST_ASSERT_TRUE(
        tl_played_was_said(TL_CONTROL_VALIDATE, "an FMU's file is another than the one that the twin has loaded"));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_INT(TL_CHANGE_NEW_TWIN, tl_versions_get(&run->versions, 2)->kind);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 1)->hash, tl_versions_get(&run->versions, 2)->hash);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* Who looks on hears within seconds why nothing happens, and not only when it is given up. */
static void test_a_handover_that_takes_long(void) {
    run->handed_over = TL_ACTIVATION_WAITS;
    tl_played_offer("1", 2, 0);
    while (run->activation.row != TL_ACTIVATION_ROW_ANSWER) {
        TEST_ASSERT_FALSE(tl_played_is_ended());
        run->activation.looked -= run->activation.step == TL_CONTROL_SHADOW ? TL_SECOND / 10 : 0;
        tl_activation_look(&run->activation);
    }
    TEST_ASSERT_FALSE(tl_played_was_said(TL_CONTROL_ACTIVATE, "has not answered yet"));
    run->activation.looked -= 3 * TL_SECOND;
    tl_activation_look(&run->activation);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_ACTIVATE, "the twin has not answered yet; it has 60 s"));
    size_t before = run->count;
    run->activation.looked -= 3 * TL_SECOND;
    tl_activation_look(&run->activation);
    TEST_ASSERT_EQUAL_size_t(before, run->count);
    run->activation.looked -= 60 * TL_SECOND;
    tl_activation_look(&run->activation);
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_FAILED, run->said[run->count - 1].as.end.result);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

static void test_a_handover_that_is_refused(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->in_force, sizeof before);
    run->handed_over = TL_ACTIVATION_REFUSED;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FAILED, tl_played_take("1", 2, 0));
    TEST_ASSERT_NOT_NULL(strstr(tl_played_last_word(), "could not take over: it has died"));
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_EQUAL_UINT64(0, run->versions.probation.version);
    TEST_ASSERT_EQUAL_STRING(before, run->in_force);
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_TRUE(tl_activation_is_idle(&run->activation));
}

/* The process ended when the disk had it, and before the flip: by a restart. One that was ordered and comes while the next one looks needs none. */
static void test_a_handover_that_was_not_finished(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_activation_end(&run->activation);
    memcpy(run->in_force, tl_versions_get(&run->versions, 1)->hash, sizeof run->in_force);
    tl_played_begin();
    memcpy(run->in_force, tl_versions_get(&run->versions, 2)->hash, sizeof run->in_force);
    tl_played_look_until(tl_played_is_quiet);
    TEST_ASSERT_FALSE(run->has_restarted);
    tl_activation_end(&run->activation);
    memcpy(run->in_force, tl_versions_get(&run->versions, 1)->hash, sizeof run->in_force);
    tl_played_begin();
    tl_played_look_until(tl_played_is_quiet);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.probation.version);
}

/* ---- the way back ---- */

static void test_a_handover_back(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->in_force, sizeof before);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_STRING(before, run->in_force);
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_EQUAL_INT(TL_VERSION_RETURNED, tl_versions_get(&run->versions, 2)->result);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_RETURNED, "by a flip: the twin has failed"));
    TEST_ASSERT_TRUE(tl_activation_is_idle(&run->activation));
}

/* The disk says the version before, and the run is to follow: by a restart. */
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

/* Whose process ended on probation: the next one finds the twin before where it was. */
static void test_the_way_back_after_the_activators_death(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_activation_end(&run->activation);
    tl_played_begin();
    tl_activation_look(&run->activation);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* Whose process ended beside the shadow of another candidate: that is not what would be returned to. */
static void test_a_death_beside_a_shadow(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    tl_played_offer("1", 3, 0);
    tl_played_look_until(tl_played_is_live);
    tl_worker_close(&run->activation.worker);
    free(run->activation.text);
    tl_played_begin();
    TEST_ASSERT_EQUAL_STRING("", run->other);
    tl_activation_look(&run->activation);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(1, run->handovers);
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* ---- another one on probation ---- */

/* In place, by the twin that has taken over: what is returned to is the version before both, and its twin is there. */
static void test_in_place_after_a_handover(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->in_force, sizeof before);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 2, 0));
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 3)->hash, run->in_force);
    TEST_ASSERT_EQUAL_STRING(before, run->other);
    tl_played_fail();
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_STRING(before, run->in_force);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

/* The second one needs the place; and the twin of the first is not what would be returned to. */
static void test_a_second_handover_on_probation(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, 0));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 3, 0));
    TEST_ASSERT_EQUAL_INT(2, run->handovers);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.probation.return_to);
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_SHADOW, "the twin before makes room for it"));
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
    run = tl_played_open(TL_BINARY_DIR, "test_activation_flip");
    UNITY_BEGIN();
    RUN_TEST(test_a_handover);
    RUN_TEST(test_figures_after_a_handover);
    RUN_TEST(test_an_fmu_that_was_replaced);
    RUN_TEST(test_a_handover_that_takes_long);
    RUN_TEST(test_a_handover_back);
    RUN_TEST(test_a_handover_back_without_the_twin_before);
    RUN_TEST(test_a_handover_back_that_is_refused);
    RUN_TEST(test_the_way_back_after_the_activators_death);
    RUN_TEST(test_a_death_beside_a_shadow);
    RUN_TEST(test_in_place_after_a_handover);
    RUN_TEST(test_a_second_handover_on_probation);
    RUN_TEST(test_a_handover_that_is_refused);
    RUN_TEST(test_a_handover_that_was_not_finished);
    return tl_played_close(UNITY_END());
}
