/* The supervisor and a shadow: start on order, failures that do not count, the swap with the twin.
 * What each letter of a plan means: stage.h. */
#include <signal.h>
#include <stdlib.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/live/supervisor.h"
#include "tests/support/message.h"
#include "tests/support/stage.h"
#include "tests/support/stderr_capture.h"

static tl_stage *stage;

void setUp(void) {
    tl_stage_set();
}

void tearDown(void) {
    tl_stage_clear();
}

/* True `time` after the first call. */
static bool is_later(tl_time time) {
    tl_time now = tl_clock_now(NULL);
    stage->at = stage->at == 0 ? now : stage->at;
    return now - stage->at >= time;
}

static int supervise_both(const char *twin, const char *shadow, long ms, void (*play_)(bool, tl_orders *)) {
    tl_stage_cast(TL_MEMBER_SHADOW, shadow);
    stage->play_on = play_;
    return tl_stage_signal_once(twin, SIGTERM, ms);
}

static void order_for_a_while(bool ends, tl_orders *orders) {
    (void)ends;
    orders->shadow = tl_stage_is_ready(TL_MEMBER_TWIN) && !is_later(TL_SECOND / 5);
}

static void test_a_shadow_is_there_on_order(void) {
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", "w", 700, order_for_a_while));
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_SHADOW].starts);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_SHADOW].order);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_SHADOW].ends_reported);
    TEST_ASSERT_EQUAL_INT(1, stage->starts);
    tl_stage_expect_silence();
}

static void order_until_it_has_died(bool ends, tl_orders *orders) {
    (void)ends;
    orders->shadow = !tl_stage_has_died(TL_MEMBER_SHADOW);
}

/* The shadow is not restarted. Neither the supervisor nor its restart record counts a failure. */
static void expect_no_harm_by(const char *shadow) {
    stage->settings.state = stage->scratch.folder;
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", shadow, 2500, order_until_it_has_died));
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_SHADOW].starts);
    TEST_ASSERT_EQUAL_INT(1, stage->starts);
    tl_stage_expect_silence();
    tl_stage_empty();
    tl_stage_expect_code("0", 0);
    TEST_ASSERT_EQUAL_UINT(0, stage->failures[0]);
}

static void test_a_shadow_that_crashes(void) {
    expect_no_harm_by("c");
}

static void test_a_shadow_that_hangs(void) {
    expect_no_harm_by("h");
}

static void test_a_shadow_that_cannot_start(void) {
    expect_no_harm_by("6");
}

static void test_a_shadow_that_announces_the_end_of_the_run(void) {
    expect_no_harm_by("0");
}

static void order_always(bool ends, tl_orders *orders) {
    (void)ends;
    orders->shadow = true;
}

static void test_the_shadow_ends_first(void) {
    tl_stage_cast(TL_MEMBER_IO, "w");
    tl_stage_cast(TL_MEMBER_RECORDER, "w");
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", "w", 400, order_always));
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_SHADOW].order);
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_TWIN].order);
    TEST_ASSERT_EQUAL_INT(4, stage->parts[TL_MEMBER_RECORDER].order);
}

/* The log does not mention it. */
static void test_a_shadow_that_does_not_end(void) {
    tl_time begun = tl_clock_now(NULL);
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", "b", 400, order_always));
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begun < 6 * TL_SECOND);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_TWIN].order);
    tl_stage_expect_silence();
}

/* ---- a swap ---- */

/* When both are ready, they swap slots. Then the old twin is stopped. */
static void swap_and_let_go(bool ends, tl_orders *orders) {
    (void)ends;
    orders->swap = !stage->swapped && tl_stage_is_ready(TL_MEMBER_TWIN) && tl_stage_is_ready(TL_MEMBER_SHADOW);
    orders->shadow = !stage->swapped && !orders->swap;
}

static void test_twin_and_shadow_change_places(void) {
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", "w", 700, swap_and_let_go));
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_TWIN].order);
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_SHADOW].order);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_TWIN].starts);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_SHADOW].starts);
    tl_stage_expect_silence();
}

static void swap_and_kill(bool ends, tl_orders *orders) {
    swap_and_let_go(ends, orders);
    orders->shadow = true;
    if (stage->swapped && !tl_stage_has_died(TL_MEMBER_SHADOW)) {
        (void)kill(stage->parts[TL_MEMBER_SHADOW].pid, SIGKILL);
    }
}

/* After the swap it is the twin, and is restarted. */
static void test_a_twin_that_was_a_shadow_and_dies(void) {
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", "ww", 1000, swap_and_kill));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_SHADOW].starts);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_TWIN].starts);
    TEST_ASSERT_EQUAL_INT(2, stage->starts);
    TEST_ASSERT_TRUE(stage->again[1]);
    TEST_ASSERT_EQUAL_UINT(1, stage->failures[1]);
    TL_EXPECT_PARTS("9|Killed", stage->reason[1]);
}

static void swap_with_a_dead_one(bool ends, tl_orders *orders) {
    (void)ends;
    orders->shadow = !stage->swapped && !tl_stage_has_died(TL_MEMBER_SHADOW);
    orders->swap = !stage->swapped && tl_stage_has_died(TL_MEMBER_SHADOW) && tl_stage_is_ready(TL_MEMBER_TWIN);
}

/* Its death before the swap does not count as a failure of the twin. */
static void test_a_shadow_that_is_dead_when_it_is_to_be_the_twin(void) {
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", "cw", 1000, swap_with_a_dead_one));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_SHADOW].starts);
    TEST_ASSERT_EQUAL_INT(2, stage->starts);
    TEST_ASSERT_TRUE(stage->again[1]);
    TEST_ASSERT_EQUAL_UINT(0, stage->failures[1]);
    TL_EXPECT_PARTS("11|Segmentation fault|fmi2DoStep|motor", stage->reason[1]);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_TWIN].order); /* no longer ordered */
}

static void swap_once_the_twin_has_died(bool ends, tl_orders *orders) {
    (void)ends;
    bool is_time = tl_stage_has_died(TL_MEMBER_TWIN) && tl_stage_is_ready(TL_MEMBER_SHADOW);
    orders->shadow = !stage->swapped && !is_time;
    orders->swap = !stage->swapped && is_time;
    if (!tl_stage_has_died(TL_MEMBER_TWIN) && tl_stage_is_ready(TL_MEMBER_TWIN) &&
        tl_stage_is_ready(TL_MEMBER_SHADOW)) {
        (void)kill(stage->parts[TL_MEMBER_TWIN].pid, SIGKILL);
    }
}

/* The other twin continues. The dead one is not restarted. */
static void test_a_twin_that_is_dead_when_another_one_is_to_take_over(void) {
    TEST_ASSERT_EQUAL_INT(0, supervise_both("w", "w", 1000, swap_once_the_twin_has_died));
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_TWIN].starts);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_SHADOW].starts);
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TL_EXPECT_PARTS("error|twin|9|Killed", log);
    free(log);
}

static void kill_it(bool ends, tl_orders *orders) {
    (void)ends;
    orders->kill_twin = tl_stage_is_ready(TL_MEMBER_TWIN) && !tl_stage_has_died(TL_MEMBER_TWIN);
}

static void test_a_twin_that_does_not_hand_over(void) {
    stage->play_on = kill_it;
    TEST_ASSERT_EQUAL_INT(0, tl_stage_signal_once("ww", SIGTERM, 700));
    TEST_ASSERT_EQUAL_INT(2, stage->starts);
    TL_EXPECT_PARTS("handover", stage->reason[1]);
    TEST_ASSERT_FALSE(tl_test_has_parts(stage->reason[1], "Killed"));
}

int main(void) {
    UNITY_BEGIN();
    stage = tl_stage_open(TL_BINARY_DIR, "test_supervisor_shadow");
    RUN_TEST(test_a_shadow_is_there_on_order);
    RUN_TEST(test_a_shadow_that_crashes);
    RUN_TEST(test_a_shadow_that_hangs);
    RUN_TEST(test_a_shadow_that_cannot_start);
    RUN_TEST(test_a_shadow_that_announces_the_end_of_the_run);
    RUN_TEST(test_the_shadow_ends_first);
    RUN_TEST(test_a_shadow_that_does_not_end);
    RUN_TEST(test_twin_and_shadow_change_places);
    RUN_TEST(test_a_twin_that_was_a_shadow_and_dies);
    RUN_TEST(test_a_shadow_that_is_dead_when_it_is_to_be_the_twin);
    RUN_TEST(test_a_twin_that_is_dead_when_another_one_is_to_take_over);
    RUN_TEST(test_a_twin_that_does_not_hand_over);
    return tl_stage_close(UNITY_END());
}
