/* The supervisor of an unsupervised run: it ends after a failure or a long silence.
 * A twin that a debugger holds may be silent. What each letter of a plan means: stage.h. */
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
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

static void test_alone_a_failure_is_the_end(void) {
    stage->settings.unsupervised = true;
    tl_stage_expect_code("c", 70);
    TL_EXPECT_PARTS("twin|11|Segmentation fault|fmi2DoStep|motor", stage->event);
    tl_stage_expect_report(stage->event);
}

static void test_alone_a_failure_that_the_twin_logs_is_not_logged_again(void) {
    stage->settings.unsupervised = true;
    tl_stage_expect_code("7", 70);
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_STRING("", log);
    free(log);
}

static void test_alone_long_silence_is_the_end(void) {
    stage->settings.unsupervised = true;
    stage->settings.call_limit = TL_SECOND / 5;
    tl_stage_expect_code("f", 70);
    TL_EXPECT_PARTS("twin|\"cycle\"|fmi2DoStep|motor", stage->event);
    tl_test_expect_seconds(2, stage->event);
    tl_stage_expect_report(stage->event);
}

static tl_time held_at, let_go_at;

static void hold_and_let_go(bool ends, tl_orders *orders) {
    tl_time now = tl_clock_now(NULL);
    pid_t twin = stage->parts[TL_MEMBER_TWIN].pid;
    (void)ends;
    (void)orders;
    if (held_at == 0 && tl_stage_is_ready(TL_MEMBER_TWIN)) {
        held_at = now;
        TEST_ASSERT_EQUAL_INT(0, kill(twin, SIGSTOP));
    } else if (held_at != 0 && let_go_at == 0 && now - held_at > 3 * TL_SECOND) {
        let_go_at = now;
        TEST_ASSERT_FALSE(tl_stage_has_died(TL_MEMBER_TWIN));
        TEST_ASSERT_EQUAL_INT(0, kill(twin, SIGCONT));
    }
}

/* After the debugger has released it, it has the whole time again. */
static void test_alone_a_stopped_twin_is_not_killed(void) {
    stage->settings.unsupervised = true;
    stage->settings.call_limit = TL_SECOND / 8;
    stage->play_on = hold_and_let_go;
    tl_stage_expect_code("f", 70);
    TEST_ASSERT_NOT_EQUAL_INT64(0, let_go_at);
}

/* Up to the limit. */
static void test_alone_silence_is_allowed(void) {
    stage->settings.unsupervised = true;
    stage->settings.call_limit = 60 * TL_SECOND;
    TEST_ASSERT_EQUAL_INT(75, tl_stage_end("h", SIGTERM, 3000));
    tl_stage_expect_said("6 s");
}

static void test_alone_a_process_that_cannot_be_made(void) {
    stage->settings.unsupervised = true;
    tl_stage_expect_code("-", 75);
}

int main(void) {
    UNITY_BEGIN();
    stage = tl_stage_open(TL_BINARY_DIR, "test_supervisor_alone");
    RUN_TEST(test_alone_a_failure_is_the_end);
    RUN_TEST(test_alone_a_failure_that_the_twin_logs_is_not_logged_again);
    RUN_TEST(test_alone_long_silence_is_the_end);
    RUN_TEST(test_alone_a_stopped_twin_is_not_killed);
    RUN_TEST(test_alone_silence_is_allowed);
    RUN_TEST(test_alone_a_process_that_cannot_be_made);
    return tl_stage_close(UNITY_END());
}
