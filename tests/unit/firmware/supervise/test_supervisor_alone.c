/* The supervisor of a twin alone: a failure is the end, and silence is allowed. What each letter of a plan means: stage.h. */
#include <signal.h>
#include <stdlib.h>

#include <unity.h>

#include "firmware/supervise/supervisor.h"
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

/* Somebody may look at it with a debugger. */
static void test_alone_silence_is_allowed(void) {
    stage->settings.alone = true;
    TEST_ASSERT_EQUAL_INT(75, tl_stage_end("h", SIGTERM, 3000));
    tl_stage_expect_said("still there 16 s later");
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
    RUN_TEST(test_alone_silence_is_allowed);
    RUN_TEST(test_alone_a_process_that_cannot_be_made);
    return tl_stage_close(UNITY_END());
}
