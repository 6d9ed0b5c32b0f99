/* The supervisor and its twin: hangs, crashes, ends, restart loops, damaged memory, failed starts.
 * What each letter of a plan means: stage.h. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/live/supervisor.h"
#include "tests/support/message.h"
#include "tests/support/stage.h"
#include "tests/support/stderr_capture.h"

#define CRASH "11|Segmentation fault"
#define IN_FMU "fmi2DoStep|motor"

static tl_stage *stage;

void setUp(void) {
    tl_stage_set();
}

void tearDown(void) {
    tl_stage_clear();
}

/* The log has one line per list of parts. */
static void expect_log(const char *const *parts, size_t count) {
    char *log = tl_stderr_capture_end();
    size_t at = 0;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, tl_test_count_lines(log), log);
    char *rest = NULL;
    for (char *line = strtok_r(log, "\n", &rest); line != NULL && at < count; line = strtok_r(NULL, "\n", &rest)) {
        TL_EXPECT_PARTS(parts[at++], line);
    }
    TEST_ASSERT_EQUAL_size_t(count, at);
    free(log);
}

/* The reason that a first start has. */
static void expect_orderly_reason(const char *reason) {
    tl_restarts fresh;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_restarts_open(NULL, false, &fresh, &error));
    TEST_ASSERT_EQUAL_STRING(fresh.reason, reason);
}

static void test_ends_with_its_child(void) {
    tl_stage_expect_code("0", 0);
    TEST_ASSERT_FALSE(stage->hold[0]);
    TEST_ASSERT_FALSE(stage->again[0]);
    expect_orderly_reason(stage->reason[0]);
}

static void test_a_bad_configuration_is_not_tried_again(void) {
    tl_stage_expect_code("6", 65);
}

/* The user who starts it gets the exit code at once. */
static void test_what_never_ran_is_not_tried_again(void) {
    tl_stage_expect_code("8", 70);
}

/* For example, an FMU was removed. It may return; until then the plant is recorded. */
static void test_what_ran_and_cannot_start_any_more(void) {
    tl_stage_expect_code("766660", 0);
    TEST_ASSERT_TRUE(stage->hold[5]);
    TL_EXPECT_PARTS("code|65", stage->reason[5]);
}

static void test_what_ran_is_tried_again(void) {
    tl_stage_expect_code("780", 0);
    TEST_ASSERT_TRUE(stage->again[1]);
    TL_EXPECT_PARTS("code|70", stage->reason[1]);
}

static void test_a_crash(void) {
    tl_stage_expect_code("k0", 0);
    TL_EXPECT_PARTS(CRASH, stage->reason[1]);
    TEST_ASSERT_EQUAL_STRING("", stage->event); /* the next start has the reason */
    TEST_ASSERT_FALSE(stage->was_killed_by_others);
}

/* For example by the kernel if memory is short. A restored state is not the cause. */
static void test_killed_by_others(void) {
    tl_stage_expect_code("o0", 0);
    TL_EXPECT_PARTS("9|Killed", stage->reason[1]);
    TEST_ASSERT_TRUE(stage->was_killed_by_others);
}

/* The restart record holds it, and each later start gets it. */
static void test_states_that_are_to_blame(void) {
    stage->blames = 77;
    tl_stage_expect_code("k0", 0);
    TEST_ASSERT_EQUAL_UINT64(0, stage->unreadable[0]);
    TEST_ASSERT_EQUAL_UINT64(77, stage->unreadable[1]);
}

/* The parent process may have set SIGCHLD to ignored. */
static void test_a_crash_where_children_are_ignored(void) {
    (void)signal(SIGCHLD, SIG_IGN);
    tl_stage_expect_code("k0", 0);
    TL_EXPECT_PARTS(CRASH, stage->reason[1]);
}

/* The next child may clean up after the dead one. So the process number of the dead one must be
 * free. */
static void test_the_dead_are_reaped(void) {
    unsigned before = tl_stage_processes_of(getpid());
    tl_stage_expect_code("kkk0", 0);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL_UINT(before + 1, stage->processes[i]);
    }
}

/* Only an announced end is orderly, whatever the exit code. */
static void test_an_fmu_that_ends_the_process(void) {
    tl_stage_expect_code("x0", 0);
    TL_EXPECT_PARTS("code|0|" IN_FMU, stage->reason[1]);
    TEST_ASSERT_TRUE(stage->again[1]);
}

static void test_an_fmu_that_ends_the_process_at_start(void) {
    tl_stage_expect_code("y0", 0);
    TL_EXPECT_PARTS("code|65|" IN_FMU, stage->reason[1]);
}

static void test_an_fmu_that_crashes(void) {
    tl_stage_expect_code("c0", 0);
    TL_EXPECT_PARTS(CRASH "|" IN_FMU, stage->reason[1]);
}

static void test_an_fmu_that_overwrites_its_name(void) {
    tl_stage_expect_code("n0", 0);
    TEST_ASSERT_EQUAL_STRING_LEN("\\x0A\\x0A", strrchr(stage->reason[1], ' ') + 1, 8);
}

static void test_an_fmu_that_hangs(void) {
    tl_stage_expect_code("f0", 0);
    TL_EXPECT_PARTS("\"cycle\"|" IN_FMU, stage->reason[1]);
    tl_test_expect_seconds(1, stage->reason[1]);
}

/* The reason does not name an FMU if another thread hangs. */
static void test_a_hang_beside_fmus(void) {
    tl_stage_expect_code("r0", 0);
    TL_EXPECT_PARTS("\"cycle\"", stage->reason[1]);
    TEST_ASSERT_NULL(strstr(stage->reason[1], "fmi2"));
}

/* Nothing is lost, so there is no restart. */
static void test_a_crash_after_all_was_done(void) {
    tl_stage_expect_code("l", 0);
    expect_log((const char *const[]){"warning|twin|" CRASH}, 1);
}

static void test_stopped_by_another_process(void) {
    tl_stage_expect_code("t0", 0);
    TL_EXPECT_PARTS("supervisor", stage->reason[1]);
}

static void test_a_hang(void) {
    tl_stage_expect_code("h0", 0);
    TL_EXPECT_PARTS("\"cycle\"", stage->reason[1]);
    tl_test_expect_seconds(1, stage->reason[1]);
    TEST_ASSERT_NULL(strstr(stage->reason[1], "fmi2"));
}

static void test_a_hang_at_start(void) {
    tl_stage_expect_code("s0", 0);
}

static void test_a_loop_ends_in_safe_hold(void) {
    tl_stage_expect_code("khkkk0", 0);
    for (int i = 0; i < TL_RESTARTS_MOST; i++) {
        TEST_ASSERT_FALSE(stage->hold[i]);
    }
    TEST_ASSERT_TRUE(stage->hold[TL_RESTARTS_MOST]);
}

static void test_safe_hold_continues(void) {
    tl_stage_expect_code("kkkkkk0", 0);
    TEST_ASSERT_TRUE(stage->hold[5]);
    TEST_ASSERT_TRUE(stage->hold[6]);
}

/* Each safe hold lasts twice as long as the previous one. */
static void test_safe_hold_tries_again(void) {
    tl_time begun = tl_clock_now(NULL);
    stage->settings.hold_time = TL_SECOND / 2;
    tl_stage_expect_code("kkkkkwkww0", 0);
    static const bool holds[] = {false, false, false, false, false, true, false, true, false};
    TEST_ASSERT_EQUAL_MEMORY(holds, stage->hold, sizeof holds);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begun >= (tl_time)(1.5 * TL_SECOND));
    tl_stage_expect_said("retry 2");
}

/* After a start of the box the twin gets one try. */
static void test_a_start_is_a_try(void) {
    stage->settings.state = stage->scratch.folder;
    FILE *file = fopen(tl_scratch_path(&stage->scratch, "supervisor.json"), "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs(
        "{\"starts\": 9, \"restarts\": 4, \"failures\": 5, \"running\": true, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0}",
        file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    tl_stage_expect_code("k0", 0);
    TEST_ASSERT_FALSE(stage->hold[0]);
    TEST_ASSERT_TRUE(stage->hold[1]);
}

/* ---- damage ---- */

static tl_time in_future(void) {
    return tl_clock_now(NULL) + 3600 * TL_SECOND;
}

/* Only the first report counts; a repeated one is not trusted. */
static void test_damage_is_a_failure(void) {
    stage->settings.state = stage->scratch.folder;
    stage->damaged[TL_MEMBER_TWIN] = in_future();
    TEST_ASSERT_EQUAL_INT(0, tl_stage_signal_once("ww", SIGTERM, 1500));
    TEST_ASSERT_EQUAL_INT(2, stage->starts);
    TL_EXPECT_PARTS("memory|recorder", stage->reason[1]);
}

/* The damage is from its predecessor: it was found before this twin was ready. */
static void test_damage_that_was_repaired(void) {
    stage->damaged[TL_MEMBER_TWIN] = tl_clock_now(NULL);
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 700));
}

static void test_damage_before_it_is_ready(void) {
    stage->damaged[TL_MEMBER_TWIN] = in_future();
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("a", SIGTERM, 700));
}

static void test_damage_of_another_member(void) {
    tl_stage_cast(TL_MEMBER_IO, "ww");
    stage->damaged[TL_MEMBER_IO] = in_future();
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 1500));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_IO].starts);
    TL_EXPECT_PARTS("plant|memory", stage->event);
    tl_stage_expect_report(stage->event);
}

static void end_after_the_second(bool ends, tl_orders *orders) {
    orders->end = !ends && stage->starts == 2 && tl_stage_is_ready(TL_MEMBER_TWIN);
}

/* A run without a duration ends only on request. */
static void test_an_end_without_a_duration(void) {
    stage->settings.has_duration = false;
    stage->play_on = end_after_the_second;
    tl_stage_expect_code("0w", 0);
    TL_EXPECT_PARTS("code|0", stage->reason[1]);
    TEST_ASSERT_NULL(strstr(stage->reason[1], "fmi2"));
}

static void test_damage_alone(void) {
    stage->settings.unsupervised = true;
    stage->damaged[TL_MEMBER_TWIN] = in_future();
    tl_stage_expect_code("w", 70);
    TL_EXPECT_PARTS("twin|memory", stage->event);
    tl_stage_expect_report(stage->event);
}

/* ---- failed starts ---- */

/* It never counts as a failure of the twin, and the plant is recorded meanwhile.
 * The log has at most one line a minute. */
static void test_a_process_that_cannot_be_made_is_tried_again(void) {
    stage->settings.state = stage->scratch.folder;
    stage->settings.hold_time = TL_SECOND / 2;
    tl_stage_expect_code("------w0", 0);
    TEST_ASSERT_TRUE(stage->hold[6]); /* this process could be made */
    TEST_ASSERT_FALSE(stage->hold[7]);
    TEST_ASSERT_EQUAL_UINT(0, stage->failures[7]);
    const char *const lines[] = {"error|twin|no process is left", "notice|safe hold|retry 1",
                                 "error|twin|5|no process is left"};
    expect_log(lines, 3);
}

/* The caller that killed the process knows the reason. */
static void test_a_reason_can_be_replaced(void) {
    (void)snprintf(stage->better, sizeof stage->better, "it took too much memory");
    tl_stage_expect_code("k0", 0);
    TEST_ASSERT_EQUAL_STRING("it took too much memory", stage->reason[1]);
}

static void test_an_invalid_watchdog(void) {
    stage->settings.watchdog = "/dev/null";
    stage->settings.watchdog_s = 10;
    tl_stage_cast(TL_MEMBER_TWIN, "");
    TEST_ASSERT_EQUAL_INT(69, tl_supervise(&stage->settings, NULL));
    TEST_ASSERT_EQUAL_INT(0, stage->starts);
}

static void test_a_missing_state_folder(void) {
    stage->settings.state = "/nowhere/state";
    tl_stage_cast(TL_MEMBER_TWIN, "");
    TEST_ASSERT_EQUAL_INT(65, tl_supervise(&stage->settings, NULL));
    TEST_ASSERT_EQUAL_INT(0, stage->starts);
}

int main(void) {
    UNITY_BEGIN();
    stage = tl_stage_open(TL_BINARY_DIR, "test_supervisor");
    RUN_TEST(test_ends_with_its_child);
    RUN_TEST(test_a_bad_configuration_is_not_tried_again);
    RUN_TEST(test_what_never_ran_is_not_tried_again);
    RUN_TEST(test_what_ran_and_cannot_start_any_more);
    RUN_TEST(test_what_ran_is_tried_again);
    RUN_TEST(test_a_crash);
    RUN_TEST(test_killed_by_others);
    RUN_TEST(test_states_that_are_to_blame);
    RUN_TEST(test_a_crash_where_children_are_ignored);
    RUN_TEST(test_the_dead_are_reaped);
    RUN_TEST(test_an_fmu_that_ends_the_process);
    RUN_TEST(test_an_fmu_that_ends_the_process_at_start);
    RUN_TEST(test_an_fmu_that_crashes);
    RUN_TEST(test_an_fmu_that_overwrites_its_name);
    RUN_TEST(test_an_fmu_that_hangs);
    RUN_TEST(test_a_hang_beside_fmus);
    RUN_TEST(test_a_crash_after_all_was_done);
    RUN_TEST(test_stopped_by_another_process);
    RUN_TEST(test_a_hang);
    RUN_TEST(test_a_hang_at_start);
    RUN_TEST(test_a_loop_ends_in_safe_hold);
    RUN_TEST(test_safe_hold_continues);
    RUN_TEST(test_safe_hold_tries_again);
    RUN_TEST(test_a_start_is_a_try);
    RUN_TEST(test_damage_is_a_failure);
    RUN_TEST(test_damage_that_was_repaired);
    RUN_TEST(test_damage_before_it_is_ready);
    RUN_TEST(test_damage_of_another_member);
    RUN_TEST(test_an_end_without_a_duration);
    RUN_TEST(test_damage_alone);
    RUN_TEST(test_a_process_that_cannot_be_made_is_tried_again);
    RUN_TEST(test_a_reason_can_be_replaced);
    RUN_TEST(test_an_invalid_watchdog);
    RUN_TEST(test_a_missing_state_folder);
    return tl_stage_close(UNITY_END());
}
