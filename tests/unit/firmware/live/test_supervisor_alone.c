/* The supervisor of a twin alone: a failure is the end, and so is long silence, unless somebody holds the twin. What each letter of a plan means: stage.h. */
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/live/supervisor.h"
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
    stage->settings.alone = true;
    tl_stage_expect_code("c", 70);
    tl_stage_expect_told("the twin failed: it was ended by signal 11, Segmentation fault, in fmi2DoStep of motor");
}

static void test_alone_what_it_says_itself_is_not_said_again(void) {
    stage->settings.alone = true;
    tl_stage_expect_code("7", 70);
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_STRING("", log);
    free(log);
}

static void test_alone_long_silence_is_the_end(void) {
    stage->settings.alone = true;
    stage->settings.call_limit = TL_SECOND / 5;
    tl_stage_expect_code("f", 70);
    tl_stage_expect_said("the twin failed: it hung: \"cycle\" gave no sign of life for 2.");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(stage->event, " s, in fmi2DoStep of motor"), stage->event);
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

/* Until it is let go, and then it has that time again. */
static void test_alone_it_is_let_be_while_somebody_holds_it(void) {
    stage->settings.alone = true;
    stage->settings.call_limit = TL_SECOND / 8;
    stage->play_on = hold_and_let_go;
    tl_stage_expect_code("f", 70);
    TEST_ASSERT_NOT_EQUAL_INT64(0, let_go_at);
}

/* For the limit. */
static void test_alone_silence_is_allowed(void) {
    stage->settings.alone = true;
    stage->settings.call_limit = 60 * TL_SECOND;
    TEST_ASSERT_EQUAL_INT(75, tl_stage_end("h", SIGTERM, 3000));
    tl_stage_expect_said("still there 6 s later");
}

static void test_alone_a_process_that_cannot_be_made(void) {
    stage->settings.alone = true;
    tl_stage_expect_code("-", 75);
}

int main(void) {
    UNITY_BEGIN();
    stage = tl_stage_open(TL_BINARY_DIR, "test_supervisor_alone");
    RUN_TEST(test_alone_a_failure_is_the_end);
    RUN_TEST(test_alone_what_it_says_itself_is_not_said_again);
    RUN_TEST(test_alone_long_silence_is_the_end);
    RUN_TEST(test_alone_it_is_let_be_while_somebody_holds_it);
    RUN_TEST(test_alone_silence_is_allowed);
    RUN_TEST(test_alone_a_process_that_cannot_be_made);
    return tl_stage_close(UNITY_END());
}
