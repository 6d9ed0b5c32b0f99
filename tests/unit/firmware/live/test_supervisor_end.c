/* The end of a supervisor by one signal, by two, or by SIGKILL; members that do not end in time.
 * What each letter of a plan means: stage.h. */
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

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

/* The supervisor runs in a separate process here. Its restart record survives it. */
static void supervise_and_kill(void) {
    (void)fflush(NULL);
    pid_t supervisor = fork();
    if (supervisor == 0) {
        _exit(tl_supervise(&stage->settings, NULL));
    }
    for (int i = 0; i < 1000 && __atomic_load_n(&stage->last, __ATOMIC_ACQUIRE) == 0; i++) {
        tl_stage_pause_ms(10);
    }
    tl_stage_pause_ms(100);
    TEST_ASSERT_EQUAL_INT(0, kill(supervisor, SIGKILL));
    TEST_ASSERT_EQUAL_INT(supervisor, waitpid(supervisor, NULL, 0));
}

static void test_a_killed_supervisor_takes_its_child_along(void) {
    tl_stage_cast(TL_MEMBER_TWIN, "w");
    stage->settings.state = stage->scratch.folder;
    supervise_and_kill();
    for (int i = 0; i < 500 && kill(stage->last, 0) == 0; i++) {
        tl_stage_pause_ms(10); /* until init has reaped the twin */
    }
    TEST_ASSERT_EQUAL_INT(-1, kill(stage->last, 0));
    tl_stage_empty();
    tl_stage_expect_code("0", 0);
    TL_EXPECT_PARTS("supervisor|killed", stage->reason[0]);
    TEST_ASSERT_TRUE(stage->again[0]);
}

static void test_told_to_end(void) {
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 200));
}

/* An FMU may ignore the signal until the process has restored the handler. */
static void test_told_to_end_while_the_signal_is_ignored(void) {
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("i", SIGTERM, 100));
}

/* A child that does not end is killed after its silence. It is not restarted. */
static void test_told_to_end_while_it_hangs(void) {
    TEST_ASSERT_EQUAL_INT(75, tl_stage_end("s", SIGINT, 0));
}

/* The reason that a first start has. */
static void expect_orderly_reason(const char *reason) {
    tl_restarts fresh;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_restarts_open(NULL, false, &fresh, &error));
    TEST_ASSERT_EQUAL_STRING(fresh.reason, reason);
}

/* The child hangs while its heartbeat continues. The supervisor still ends in order.
 * Two signals at once, as from a terminal and a shell, count as one. */
static void test_told_to_end_and_deaf(void) {
    stage->settings.state = stage->scratch.folder;
    TEST_ASSERT_EQUAL_INT(75, tl_stage_signal("b", SIGTERM, 200, 300));
    TEST_ASSERT_EQUAL_INT(1, stage->starts);
    TL_EXPECT_PARTS("twin|6 s|fmi2DoStep|motor", stage->event);
    tl_stage_expect_report(stage->event);
    tl_stage_empty();
    tl_stage_expect_code("0", 0);
    expect_orderly_reason(stage->reason[0]);
    TEST_ASSERT_FALSE(stage->again[0]);
}

/* Ctrl-C right after the start is not an error. */
static void test_told_to_end_before_it_could_hear_it(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "d");
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("d", SIGTERM, 200));
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_STRING("", log);
    free(log);
}

/* It ends before the time limit of a hang. */
static int hurry(const char *plan) {
    tl_time begun = tl_clock_now(NULL);
    int code = tl_stage_signal(plan, SIGINT, 200, 1500);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begun < 12 * TL_SECOND);
    return code;
}

/* The wait for a recorder is limited. */
static void test_recorders_that_cannot_keep_all(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "bb");
    TEST_ASSERT_EQUAL_INT(75, hurry("w"));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_RECORDER].starts);
    TL_EXPECT_PARTS("recorder|2 s|fmi2DoStep|motor", stage->event);
    tl_stage_expect_report(stage->event);
}

/* The kernel has no free process; the end does not wait for one. */
static void test_a_recorder_that_cannot_be_started(void) {
    tl_stage_cast(TL_MEMBER_RECORDER, "k------------------------------------------");
    tl_time begun = tl_clock_now(NULL);
    TEST_ASSERT_EQUAL_INT(75, tl_stage_end("w", SIGTERM, 500));
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begun < 10 * TL_SECOND);
    TEST_ASSERT_TRUE(stage->parts[TL_MEMBER_RECORDER].starts < 10);
    tl_stage_expect_said("no process is left");
}

/* A second request shortens the wait. */
static void test_asked_again_to_end(void) {
    TEST_ASSERT_EQUAL_INT(75, hurry("b"));
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    log[strcspn(log, "\n")] = '\0';
    TL_EXPECT_PARTS("notice|2 s", log);
    free(log);
}

int main(void) {
    UNITY_BEGIN();
    stage = tl_stage_open(TL_BINARY_DIR, "test_supervisor_end");
    RUN_TEST(test_a_killed_supervisor_takes_its_child_along);
    RUN_TEST(test_told_to_end);
    RUN_TEST(test_told_to_end_while_the_signal_is_ignored);
    RUN_TEST(test_told_to_end_while_it_hangs);
    RUN_TEST(test_told_to_end_and_deaf);
    RUN_TEST(test_told_to_end_before_it_could_hear_it);
    RUN_TEST(test_recorders_that_cannot_keep_all);
    RUN_TEST(test_a_recorder_that_cannot_be_started);
    RUN_TEST(test_asked_again_to_end);
    return tl_stage_close(UNITY_END());
}
