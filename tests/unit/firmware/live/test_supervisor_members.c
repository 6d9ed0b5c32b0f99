/* The supervisor and the other members: io, recorder and config manager.
 * Tests their order, their failures and the change of the recorder.
 * What each letter of a plan means: stage.h. */
#include <signal.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/live/supervisor.h"
#include "tests/support/message.h"
#include "tests/support/stage.h"

static tl_stage *stage;

void setUp(void) {
    tl_stage_set();
}

void tearDown(void) {
    tl_stage_clear();
}

static void test_all_end_in_order(void) {
    tl_stage_cast(TL_MEMBER_IO, "w");
    tl_stage_cast(TL_MEMBER_RECORDER, "w");
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 200));
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_TWIN].order);
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_IO].order);
    TEST_ASSERT_EQUAL_INT(3, stage->parts[TL_MEMBER_RECORDER].order);
    TEST_ASSERT_EQUAL_INT(3, stage->ends_reported);
}

static void test_the_others_end_with_the_twin(void) {
    tl_stage_cast(TL_MEMBER_IO, "w");
    tl_stage_cast(TL_MEMBER_RECORDER, "w");
    tl_stage_expect_code("0", 0);
    TEST_ASSERT_EQUAL_INT(3, stage->ends);
}

/* More often than a twin. The twin continues. */
static void test_they_are_always_restarted(void) {
    stage->settings.state = stage->scratch.folder;
    tl_stage_cast(TL_MEMBER_RECORDER, "kkkhkkw");
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 9000));
    TEST_ASSERT_EQUAL_INT(7, stage->parts[TL_MEMBER_RECORDER].starts);
    TL_EXPECT_PARTS("recorder|5|11|Segmentation fault", stage->event);
    tl_stage_expect_report(stage->event);
}

static void test_a_member_that_never_starts_ends_all(void) {
    tl_stage_cast(TL_MEMBER_IO, "6");
    tl_stage_cast(TL_MEMBER_RECORDER, "w");
    tl_stage_expect_code("a", 65);
    TEST_ASSERT_EQUAL_INT(3, stage->ends);
}

static void test_a_recorder_that_hangs_at_the_end_is_restarted(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "be");
    tl_stage_cast(TL_MEMBER_IO, "w");
    tl_stage_expect_code("0", 0);
    TL_EXPECT_PARTS("recorder|6 s|fmi2DoStep|motor", stage->event);
    tl_stage_expect_report(stage->event);
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_RECORDER].starts);
    TEST_ASSERT_EQUAL_INT(3, stage->parts[TL_MEMBER_RECORDER].order); /* after all others */
}

/* The records that it has not written are in shared memory, which outlives it. */
static void test_a_recorder_that_dies_at_the_end_is_restarted(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "kkw");
    tl_stage_expect_code("0", 0);
    TEST_ASSERT_TRUE(stage->parts[TL_MEMBER_RECORDER].starts <= 3);
}

/* ---- another recorder ---- */

static void change_the_recorder(bool ends, tl_orders *orders) {
    (void)ends;
    orders->recorder = tl_stage_is_ready(TL_MEMBER_RECORDER) && !tl_stage_has_died(TL_MEMBER_RECORDER);
}

static void test_another_recorder_is_started(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "ww");
    stage->play_on = change_the_recorder;
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 700));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_RECORDER].starts);
    tl_stage_expect_silence();
}

/* It counts as a failure. */
static void test_a_recorder_that_crashes_when_it_is_replaced(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "lw");
    stage->play_on = change_the_recorder;
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 1200));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_RECORDER].starts);
    TL_EXPECT_PARTS("recorder|11|Segmentation fault", stage->event);
    tl_stage_expect_report(stage->event);
}

static void change_it_in_the_end(bool ends, tl_orders *orders) {
    orders->recorder = ends && tl_stage_has_died(TL_MEMBER_RECORDER) && stage->parts[TL_MEMBER_RECORDER].starts == 1;
}

static void test_another_recorder_writes_the_rest_at_the_end(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "ww");
    stage->play_on = change_it_in_the_end;
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 400));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_RECORDER].starts);
    TEST_ASSERT_EQUAL_INT(3, stage->parts[TL_MEMBER_RECORDER].order);
    tl_stage_expect_silence();
}

/* ---- the first twin waits ---- */

static tl_wait wait_for_the_others(void *context) {
    (void)context;
    return tl_stage_is_ready(TL_MEMBER_RECORDER) && tl_stage_is_ready(TL_MEMBER_IO) ? TL_WAIT_OVER : TL_WAIT_BRIEF;
}

static void test_the_others_are_started_before(void) {
    tl_stage_cast(TL_MEMBER_IO, "w");
    tl_stage_cast(TL_MEMBER_RECORDER, "w");
    stage->settings.wait = wait_for_the_others;
    tl_stage_expect_code("0", 0);
    TEST_ASSERT_FALSE(stage->hold[0]);
}

static tl_wait wait_for_a_twin_that_holds(void *context) {
    (void)context;
    return tl_stage_is_ready(TL_MEMBER_TWIN) || tl_stage_has_died(TL_MEMBER_TWIN) ? TL_WAIT_OVER : TL_WAIT_LONG;
}

/* The restart record counts neither a start nor a failure for the holding twin.
 * The next twin has then never run, and is not restarted if it fails. */
static void test_a_twin_holds_until_the_first_may_begin(void) {
    tl_restarts kept;
    tl_error error;
    stage->settings.state = stage->scratch.folder;
    stage->settings.wait = wait_for_a_twin_that_holds;
    tl_stage_expect_code("w8", 70);
    TEST_ASSERT_TRUE(stage->hold[0]);
    TEST_ASSERT_FALSE(stage->hold[1] || stage->again[1]);
    TEST_ASSERT_EQUAL_STRING("", stage->event);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_restarts_open(stage->scratch.folder, false, &kept, &error));
    TEST_ASSERT_EQUAL_UINT64(1, kept.starts);
    tl_restarts_close(&kept);
}

static tl_wait wait_for_ever(void *context) {
    (void)context;
    return TL_WAIT_BRIEF;
}

static void end_once_io_is_ready(bool ends, tl_orders *orders) {
    (void)orders;
    if (!ends && tl_stage_is_ready(TL_MEMBER_IO)) {
        (void)kill(getpid(), SIGTERM);
    }
}

static void test_told_to_end_before_there_is_a_twin(void) {
    tl_stage_cast(TL_MEMBER_IO, "w");
    stage->settings.wait = wait_for_ever;
    stage->play_on = end_once_io_is_ready;
    tl_stage_expect_code("", 0);
}

/* ---- the config manager ---- */

static void order_the_config_manager(bool ends, tl_orders *orders) {
    const tl_stage_part *config_manager = &stage->parts[TL_MEMBER_CONFIG_MANAGER];
    orders->config_manager = config_manager->starts == 0;
    orders->end = !ends && config_manager->starts == 2 && config_manager->order > 0;
}

/* It is restarted until it has finished. The run does not end with it. */
static void test_a_config_manager_that_fails_and_one_that_finishes(void) {
    tl_stage_cast(TL_MEMBER_CONFIG_MANAGER, "k0");
    stage->play_on = order_the_config_manager;
    tl_stage_expect_code("w", 0);
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_CONFIG_MANAGER].starts);
    TEST_ASSERT_EQUAL_INT(1, stage->parts[TL_MEMBER_CONFIG_MANAGER].order);
    TL_EXPECT_PARTS("11|Segmentation fault", stage->event);
    tl_stage_expect_report(stage->event);
}

int main(void) {
    UNITY_BEGIN();
    stage = tl_stage_open(TL_BINARY_DIR, "test_supervisor_members");
    RUN_TEST(test_all_end_in_order);
    RUN_TEST(test_the_others_end_with_the_twin);
    RUN_TEST(test_they_are_always_restarted);
    RUN_TEST(test_a_member_that_never_starts_ends_all);
    RUN_TEST(test_a_recorder_that_hangs_at_the_end_is_restarted);
    RUN_TEST(test_a_recorder_that_dies_at_the_end_is_restarted);
    RUN_TEST(test_another_recorder_is_started);
    RUN_TEST(test_a_recorder_that_crashes_when_it_is_replaced);
    RUN_TEST(test_another_recorder_writes_the_rest_at_the_end);
    RUN_TEST(test_the_others_are_started_before);
    RUN_TEST(test_a_twin_holds_until_the_first_may_begin);
    RUN_TEST(test_told_to_end_before_there_is_a_twin);
    RUN_TEST(test_a_config_manager_that_fails_and_one_that_finishes);
    return tl_stage_close(UNITY_END());
}
