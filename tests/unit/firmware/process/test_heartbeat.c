/* Heartbeats of threads: another process detects a silent thread, also if the clock jumps. */
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/fmu_call.h"
#include "firmware/process/heartbeat.h"

static tl_heartbeats *beats; /* in memory that a forked process shares */
static tl_heartbeats_seen seen;
static tl_time now;
static tl_time silence;

void setUp(void) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *mapped = mmap(NULL, sizeof *beats, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(mapped != MAP_FAILED);
    beats = mapped;
    memset(&seen, 0, sizeof seen);
    now = 1000 * TL_SECOND;
    silence = 0;
}

void tearDown(void) {
    (void)munmap(beats, sizeof *beats);
}

/* Checks once, after the time `passed`. */
static const char *look_after(tl_time passed) {
    now += passed;
    return tl_heartbeats_read(beats, &seen, now, &silence);
}

/* Checks each 0.1 s for `time`. Returns the first silent thread, or NULL. */
static const char *look_for(tl_time time) {
    const char *silent = NULL;
    for (tl_time t = 0; t < time && silent == NULL; t += TL_SECOND / 10) {
        silent = look_after(TL_SECOND / 10);
    }
    return silent;
}

static void test_without_threads_none_is_silent(void) {
    TEST_ASSERT_NULL(look_for(100 * TL_SECOND));
}

static void test_silence(void) {
    tl_thread_heartbeat *heartbeat = tl_thread_heartbeat_start(beats, "cycle", 2 * TL_SECOND);
    (void)look_after(0);
    TEST_ASSERT_NULL(look_for(2 * TL_SECOND));
    TEST_ASSERT_EQUAL_STRING("cycle", look_after(TL_SECOND / 10));
    TEST_ASSERT_EQUAL_INT64(21 * TL_SECOND / 10, silence);
    tl_thread_heartbeat_beat(heartbeat);
    TEST_ASSERT_NULL(look_for(2 * TL_SECOND));
}

/* The time before the start of the thread does not count. */
static void test_silence_begins_with_the_thread(void) {
    (void)look_after(0);
    TEST_ASSERT_NULL(look_for(5 * TL_SECOND));
    (void)tl_thread_heartbeat_start(beats, "cycle", 2 * TL_SECOND);
    TEST_ASSERT_NULL(look_for(2 * TL_SECOND));
    TEST_ASSERT_EQUAL_STRING("cycle", look_after(TL_SECOND / 10));
}

static void test_one_beat_in_time_is_enough(void) {
    tl_thread_heartbeat *heartbeat = tl_thread_heartbeat_start(beats, "cycle", 2 * TL_SECOND);
    for (int i = 0; i < 50; i++) {
        TEST_ASSERT_NULL(look_for(19 * TL_SECOND / 10));
        tl_thread_heartbeat_beat(heartbeat);
    }
}

/* Heartbeats of other threads do not count for a silent one. */
static void test_the_silent_one_of_many(void) {
    tl_thread_heartbeat *hearts[TL_HEARTBEATS];
    char name[24];
    for (int i = 0; i < TL_HEARTBEATS; i++) {
        (void)snprintf(name, sizeof name, "thread %d", i);
        hearts[i] = tl_thread_heartbeat_start(beats, name, TL_SECOND);
        TEST_ASSERT_NOT_NULL(hearts[i]);
    }
    const char *silent = NULL;
    for (int round = 0; round < 12 && silent == NULL; round++) {
        for (int i = 0; i < TL_HEARTBEATS; i++) {
            if (i != 41) {
                tl_thread_heartbeat_beat(hearts[i]);
            }
        }
        silent = look_after(TL_SECOND / 10);
    }
    TEST_ASSERT_EQUAL_STRING("thread 41", silent);
    TEST_ASSERT_NULL(tl_thread_heartbeat_start(beats, "one too many", TL_SECOND));
}

/* The supervisor or the box was suspended, or the clock jumped: only one check interval counts. */
static void test_a_suspended_supervisor(void) {
    (void)tl_thread_heartbeat_start(beats, "cycle", TL_SECOND);
    (void)look_after(0);
    TEST_ASSERT_NULL(look_after(3600 * TL_SECOND));
    TEST_ASSERT_NULL(look_after(3600 * TL_SECOND));
}

static void test_a_longer_and_no_timeout(void) {
    tl_thread_heartbeat *heartbeat = tl_thread_heartbeat_start(beats, "cycle", TL_SECOND);
    (void)tl_thread_heartbeat_start(beats, "main", 1000 * TL_SECOND);
    (void)look_after(0);
    tl_thread_heartbeat_set_timeout(heartbeat, 5 * TL_SECOND);
    TEST_ASSERT_NULL(look_for(5 * TL_SECOND));
    tl_thread_heartbeat_stop(heartbeat);
    TEST_ASSERT_NULL(look_for(100 * TL_SECOND));
}

/* The memory of the heartbeats is overwritten, and the process hangs. */
static void test_overwritten_heartbeats(void) {
    (void)tl_thread_heartbeat_start(beats, "cycle", TL_SECOND);
    (void)tl_thread_heartbeat_start(beats, "main", 1000 * TL_SECOND);
    (void)look_after(0);
    memset(beats->hearts, 0, sizeof beats->hearts);
    TEST_ASSERT_NULL(look_for(TL_HEARTBEAT_NONE));
    const char *silent = look_after(TL_SECOND / 10);
    TEST_ASSERT_NOT_NULL(silent);
    TEST_ASSERT_FALSE_MESSAGE(strcmp(silent, "cycle") == 0 || strcmp(silent, "main") == 0, silent);
    TEST_ASSERT_EQUAL_INT64(TL_HEARTBEAT_NONE + TL_SECOND / 10, silence);
    (void)tl_thread_heartbeat_start(beats, "cycle", TL_SECOND);
    TEST_ASSERT_NULL(look_for(TL_SECOND));
}

static void test_without_a_supervisor(void) {
    tl_thread_heartbeat *heartbeat = tl_thread_heartbeat_start(NULL, "cycle", TL_SECOND);
    TEST_ASSERT_NULL(heartbeat);
    tl_thread_heartbeat_beat(heartbeat);
    tl_thread_heartbeat_set_timeout(heartbeat, TL_SECOND);
    tl_thread_heartbeat_stop(heartbeat);
}

static void test_seen_from_another_process(void) {
    char text[TL_HEARTBEAT_STATUS];
    TEST_ASSERT_FALSE(tl_heartbeats_is_ready(beats));
    TEST_ASSERT_TRUE(tl_heartbeats_get_status(beats, text));
    TEST_ASSERT_EQUAL_STRING("", text);
    pid_t child = fork();
    if (child == 0) {
        (void)tl_thread_heartbeat_start(beats, "0123456789012345678901234567890123456789", TL_SECOND);
        tl_heartbeats_set_ready(beats);
        tl_heartbeats_set_status(beats, "in lock");
        _exit(0);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, NULL, 0));
    TEST_ASSERT_TRUE(tl_heartbeats_is_ready(beats));
    TEST_ASSERT_TRUE(tl_heartbeats_get_status(beats, text));
    TEST_ASSERT_EQUAL_STRING("in lock", text);
    (void)look_after(0);
    const char *silent = look_for(2 * TL_SECOND);
    TEST_ASSERT_NOT_NULL(silent);
    TEST_ASSERT_EQUAL_STRING_LEN("012345678901234567890", silent, 21);
    memset(beats, 0, sizeof *beats);
    TEST_ASSERT_FALSE(tl_heartbeats_is_ready(beats));
    TEST_ASSERT_NULL(look_for(2 * TL_SECOND));
}

/* ---- calls of FMUs ---- */

static void test_the_age_of_a_call_counts_from_its_first_check(void) {
    tl_fmu_call call;
    tl_fmu_calls_use(&beats->calls);
    TEST_ASSERT_FALSE(tl_heartbeats_get_call(beats, &seen, 0, &call));
    tl_fmu_call_begin(tl_fmu_calls_name("motor"), TL_FMU_DO_STEP);
    TEST_ASSERT_TRUE(tl_heartbeats_get_call(beats, &seen, 0, &call));
    TEST_ASSERT_FALSE(tl_heartbeats_get_call(beats, &seen, TL_SECOND, &call));
    (void)look_after(0);
    (void)look_for(TL_SECOND);
    TEST_ASSERT_TRUE(tl_heartbeats_get_call(beats, &seen, TL_SECOND, &call));
    TEST_ASSERT_EQUAL_STRING("motor", call.fmu);
    TEST_ASSERT_EQUAL_STRING("fmi2DoStep", call.function);
    TEST_ASSERT_FALSE(tl_heartbeats_get_call(beats, &seen, 2 * TL_SECOND, &call));
    tl_fmu_calls_use(NULL);
}

static void test_another_call_has_a_new_age(void) {
    tl_fmu_call call;
    tl_fmu_calls_use(&beats->calls);
    for (int i = 0; i < 20; i++) {
        tl_fmu_call_begin(tl_fmu_calls_name("motor"), TL_FMU_DO_STEP);
        (void)look_after(TL_SECOND / 10);
    }
    TEST_ASSERT_TRUE(tl_heartbeats_get_call(beats, &seen, 0, &call));
    TEST_ASSERT_FALSE(tl_heartbeats_get_call(beats, &seen, TL_SECOND / 10, &call));
    tl_fmu_calls_use(NULL);
}

/* ---- announced ends ---- */

static void test_an_announced_end(void) {
    int code = -1;
    TEST_ASSERT_EQUAL_INT(TL_END_CAUSE_NONE, tl_heartbeats_get_end_cause(beats, &code));
    tl_heartbeats_announce(beats, TL_END_CAUSE_REFUSED, 65);
    TEST_ASSERT_EQUAL_INT(TL_END_CAUSE_REFUSED, tl_heartbeats_get_end_cause(beats, &code));
    TEST_ASSERT_EQUAL_INT(65, code);
    memset(beats, 0, sizeof *beats);
    TEST_ASSERT_EQUAL_INT(TL_END_CAUSE_NONE, tl_heartbeats_get_end_cause(beats, &code));
}

static void test_an_invalid_end_cause(void) {
    int code = -1;
    tl_heartbeats_announce(beats, (tl_end_cause)(TL_END_CAUSE_FAILED + 1), 1);
    TEST_ASSERT_EQUAL_INT(TL_END_CAUSE_NONE, tl_heartbeats_get_end_cause(beats, &code));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_without_threads_none_is_silent);
    RUN_TEST(test_silence);
    RUN_TEST(test_silence_begins_with_the_thread);
    RUN_TEST(test_one_beat_in_time_is_enough);
    RUN_TEST(test_the_silent_one_of_many);
    RUN_TEST(test_a_suspended_supervisor);
    RUN_TEST(test_a_longer_and_no_timeout);
    RUN_TEST(test_overwritten_heartbeats);
    RUN_TEST(test_without_a_supervisor);
    RUN_TEST(test_seen_from_another_process);
    RUN_TEST(test_the_age_of_a_call_counts_from_its_first_check);
    RUN_TEST(test_another_call_has_a_new_age);
    RUN_TEST(test_an_announced_end);
    RUN_TEST(test_an_invalid_end_cause);
    return UNITY_END();
}
