/* The supervisor and its twin: what hangs, dies, ends and loops, what has spoilt its memory, and what cannot be begun. What each letter of a plan means: stage.h. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

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

static void test_ends_with_its_child(void) {
    tl_stage_expect_code("0", 0);
    TEST_ASSERT_FALSE(stage->hold[0]);
    TEST_ASSERT_FALSE(stage->again[0]);
    TEST_ASSERT_EQUAL_STRING("it was told to", stage->reason[0]);
}

static void test_a_bad_configuration_is_not_tried_again(void) {
    tl_stage_expect_code("6", 65);
}

/* Who starts it is told at once. */
static void test_what_never_ran_is_not_tried_again(void) {
    tl_stage_expect_code("8", 70);
}

/* An FMU that was removed meanwhile: it may come back, and if not, the plant is recorded at least. */
static void test_what_ran_and_cannot_begin_any_more(void) {
    tl_stage_expect_code("766660", 0);
    TEST_ASSERT_TRUE(stage->hold[5]);
    TEST_ASSERT_EQUAL_STRING("it ended with exit code 65", stage->reason[5]);
}

static void test_what_ran_is_tried_again(void) {
    tl_stage_expect_code("780", 0);
    TEST_ASSERT_TRUE(stage->again[1]);
    TEST_ASSERT_EQUAL_STRING("it ended with exit code 70", stage->reason[1]);
}

static void test_a_crash(void) {
    tl_stage_expect_code("k0", 0);
    TEST_ASSERT_EQUAL_STRING("it was ended by signal 11, Segmentation fault", stage->reason[1]);
    TEST_ASSERT_EQUAL_STRING("", stage->event); /* that reason is one */
    TEST_ASSERT_FALSE(stage->was_killed_by_others);
}

/* As by the kernel, for want of memory: nothing that a state can be blamed for. */
static void test_killed_by_others(void) {
    tl_stage_expect_code("o0", 0);
    TEST_ASSERT_EQUAL_STRING("it was ended by signal 9, Killed", stage->reason[1]);
    TEST_ASSERT_TRUE(stage->was_killed_by_others);
}

/* It is in the account, and so each start from then on is told. */
static void test_states_that_are_to_blame(void) {
    stage->blames = 77;
    tl_stage_expect_code("k0", 0);
    TEST_ASSERT_EQUAL_UINT64(0, stage->unreadable[0]);
    TEST_ASSERT_EQUAL_UINT64(77, stage->unreadable[1]);
}

/* Whoever started us may not have wanted to hear of its children. */
static void test_a_crash_where_children_are_ignored(void) {
    (void)signal(SIGCHLD, SIG_IGN);
    tl_stage_expect_code("k0", 0);
    TEST_ASSERT_EQUAL_STRING("it was ended by signal 11, Segmentation fault", stage->reason[1]);
}

/* The next child may look for what the dead one left, and must not find a process of its number. */
static void test_the_dead_are_reaped(void) {
    unsigned before = tl_stage_processes_of(getpid());
    tl_stage_expect_code("kkk0", 0);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL_UINT(before + 1, stage->processes[i]);
    }
}

/* Only what was announced is an orderly end, whatever the exit code says. */
static void test_an_fmu_that_ends_the_process(void) {
    tl_stage_expect_code("x0", 0);
    TEST_ASSERT_EQUAL_STRING("it ended unannounced, with exit code 0, in fmi2DoStep of motor", stage->reason[1]);
    TEST_ASSERT_TRUE(stage->again[1]);
}

static void test_an_fmu_that_ends_the_process_at_start(void) {
    tl_stage_expect_code("y0", 0);
    TEST_ASSERT_EQUAL_STRING("it ended unannounced, with exit code 65, in fmi2DoStep of motor", stage->reason[1]);
}

static void test_an_fmu_that_crashes(void) {
    tl_stage_expect_code("c0", 0);
    TEST_ASSERT_EQUAL_STRING("it was ended by signal 11, Segmentation fault, in fmi2DoStep of motor", stage->reason[1]);
}

static void test_an_fmu_that_spoils_its_name(void) {
    tl_stage_expect_code("n0", 0);
    TEST_ASSERT_EQUAL_STRING_LEN("\\x0A\\x0A", strrchr(stage->reason[1], ' ') + 1, 8);
}

static void test_an_fmu_that_hangs(void) {
    const char *end = " s, in fmi2DoStep of motor";
    tl_stage_expect_code("f0", 0);
    size_t length = strlen(stage->reason[1]);
    TEST_ASSERT_EQUAL_STRING_LEN("it hung: \"cycle\" gave no sign of life for 1.", stage->reason[1], 44);
    TEST_ASSERT_TRUE(length > strlen(end));
    TEST_ASSERT_EQUAL_STRING(end, stage->reason[1] + length - strlen(end));
}

/* An FMU is not to blame for what hangs beside it. */
static void test_a_hang_beside_fmus(void) {
    tl_stage_expect_code("r0", 0);
    TEST_ASSERT_NULL(strstr(stage->reason[1], "fmi2"));
}

/* Nothing is lost, and nothing would be gained if it were done again. */
static void test_a_crash_after_all_was_done(void) {
    tl_stage_expect_code("l", 0);
    tl_stage_expect_said("the twin failed when all was done: it was ended by signal 11");
}

static void test_told_to_end_by_somebody_else(void) {
    tl_stage_expect_code("t0", 0);
    TEST_ASSERT_EQUAL_STRING("it was told to end, and not by its supervisor", stage->reason[1]);
}

static void test_a_hang(void) {
    tl_stage_expect_code("h0", 0);
    TEST_ASSERT_EQUAL_STRING_LEN("it hung: \"cycle\" gave no sign of life for 1.", stage->reason[1], 44);
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

static void test_safe_hold_is_held(void) {
    tl_stage_expect_code("kkkkkk0", 0);
    TEST_ASSERT_TRUE(stage->hold[5]);
    TEST_ASSERT_TRUE(stage->hold[6]);
}

/* Each safe hold lasts twice as long as the one before. */
static void test_safe_hold_tries_again(void) {
    tl_time begun = tl_clock_now(NULL);
    stage->settings.hold_time = TL_SECOND / 2;
    tl_stage_expect_code("kkkkkwkww0", 0);
    static const bool holds[] = {false, false, false, false, false, true, false, true, false};
    TEST_ASSERT_EQUAL_MEMORY(holds, stage->hold, sizeof holds);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begun >= (tl_time)(1.5 * TL_SECOND));
    tl_stage_expect_said("safe hold ends: retry 2 of the twin");
}

/* A box that was started again is there to run its twin. */
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

/* Once: whoever says so for ever is not believed for ever. */
static void test_damage_is_a_failure(void) {
    stage->settings.state = stage->scratch.folder;
    stage->damaged[TL_MEMBER_TWIN] = in_future();
    TEST_ASSERT_EQUAL_INT(0, tl_stage_signal_once("ww", SIGTERM, 1500));
    TEST_ASSERT_EQUAL_INT(2, stage->starts);
    TEST_ASSERT_EQUAL_STRING("it has destroyed its own memory: what it hands to the recorder cannot be read on",
                             stage->reason[1]);
}

/* Of the one before: found before this one was ready. */
static void test_damage_that_was_mended(void) {
    stage->damaged[TL_MEMBER_TWIN] = tl_clock_now(NULL);
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 700));
}

static void test_damage_before_it_is_ready(void) {
    stage->damaged[TL_MEMBER_TWIN] = in_future();
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("a", SIGTERM, 700));
}

static void test_damage_of_another_one(void) {
    tl_stage_cast(TL_MEMBER_IO, "ww");
    stage->damaged[TL_MEMBER_IO] = in_future();
    TEST_ASSERT_EQUAL_INT(0, tl_stage_end("w", SIGTERM, 1500));
    TEST_ASSERT_EQUAL_INT(2, stage->parts[TL_MEMBER_IO].starts);
    tl_stage_expect_said("the reading of the plant failed: it has destroyed its own memory");
}

static void end_after_the_second(bool ends, tl_orders *orders) {
    orders->end = !ends && stage->starts == 2 && tl_stage_is_ready(TL_MEMBER_TWIN);
}

/* A run without a duration is over when it is told to. */
static void test_an_end_that_cannot_be(void) {
    stage->settings.has_duration = false;
    stage->play_on = end_after_the_second;
    tl_stage_expect_code("0w", 0);
    TEST_ASSERT_EQUAL_STRING("it ended unannounced, with exit code 0", stage->reason[1]);
}

static void test_damage_alone(void) {
    stage->settings.alone = true;
    stage->damaged[TL_MEMBER_TWIN] = in_future();
    tl_stage_expect_code("w", 70);
    tl_stage_expect_said("the twin failed: it has destroyed its own memory");
}

/* ---- what cannot be begun ---- */

/* No failure of the twin, however often, and yet the plant is recorded meanwhile. One line a minute says it. */
static void test_a_process_that_cannot_be_made_is_tried_again(void) {
    stage->settings.state = stage->scratch.folder;
    stage->settings.hold_time = TL_SECOND / 2;
    tl_stage_expect_code("------w0", 0);
    TEST_ASSERT_TRUE(stage->hold[6]); /* for which there was a process */
    TEST_ASSERT_FALSE(stage->hold[7]);
    TEST_ASSERT_EQUAL_UINT(0, stage->failures[7]);
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_STRING("twinlock: error: the twin failed: no process is left; another one is begun\n"
                             "twinlock: notice: safe hold ends: retry 1 of the twin\n"
                             "twinlock: error: the twin failed 5 more times, the last time: no process is left\n",
                             log);
    free(log);
}

/* Who has killed it knows better. */
static void test_a_reason_can_be_bettered(void) {
    (void)snprintf(stage->better, sizeof stage->better, "it took too much memory");
    tl_stage_expect_code("k0", 0);
    TEST_ASSERT_EQUAL_STRING("it took too much memory", stage->reason[1]);
}

static void test_a_watchdog_that_is_none(void) {
    stage->settings.watchdog = "/dev/null";
    stage->settings.watchdog_s = 10;
    tl_stage_cast(TL_MEMBER_TWIN, "");
    TEST_ASSERT_EQUAL_INT(69, tl_supervise(&stage->settings, NULL));
    TEST_ASSERT_EQUAL_INT(0, stage->starts);
}

static void test_a_folder_that_is_none(void) {
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
    RUN_TEST(test_what_ran_and_cannot_begin_any_more);
    RUN_TEST(test_what_ran_is_tried_again);
    RUN_TEST(test_a_crash);
    RUN_TEST(test_killed_by_others);
    RUN_TEST(test_states_that_are_to_blame);
    RUN_TEST(test_a_crash_where_children_are_ignored);
    RUN_TEST(test_the_dead_are_reaped);
    RUN_TEST(test_an_fmu_that_ends_the_process);
    RUN_TEST(test_an_fmu_that_ends_the_process_at_start);
    RUN_TEST(test_an_fmu_that_crashes);
    RUN_TEST(test_an_fmu_that_spoils_its_name);
    RUN_TEST(test_an_fmu_that_hangs);
    RUN_TEST(test_a_hang_beside_fmus);
    RUN_TEST(test_a_crash_after_all_was_done);
    RUN_TEST(test_told_to_end_by_somebody_else);
    RUN_TEST(test_a_hang);
    RUN_TEST(test_a_hang_at_start);
    RUN_TEST(test_a_loop_ends_in_safe_hold);
    RUN_TEST(test_safe_hold_is_held);
    RUN_TEST(test_safe_hold_tries_again);
    RUN_TEST(test_a_start_is_a_try);
    RUN_TEST(test_damage_is_a_failure);
    RUN_TEST(test_damage_that_was_mended);
    RUN_TEST(test_damage_before_it_is_ready);
    RUN_TEST(test_damage_of_another_one);
    RUN_TEST(test_an_end_that_cannot_be);
    RUN_TEST(test_damage_alone);
    RUN_TEST(test_a_process_that_cannot_be_made_is_tried_again);
    RUN_TEST(test_a_reason_can_be_bettered);
    RUN_TEST(test_a_watchdog_that_is_none);
    RUN_TEST(test_a_folder_that_is_none);
    return tl_stage_close(UNITY_END());
}
