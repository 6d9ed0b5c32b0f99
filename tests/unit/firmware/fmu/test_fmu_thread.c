/* The FMU thread: one thread for all jobs, its stack size, wake-ups from sleeps, and its priority
 * while requested. */
#include "firmware/fmu/fmu_thread.h"

#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <unity.h>

#include "firmware/base/os.h"

static tl_fmu_thread *thread;

void setUp(void) {
    tl_error error;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_fmu_thread_start(TL_FMU_WATCHED_HERE, &thread, &error), error.text);
}

void tearDown(void) {
    tl_fmu_thread_end(thread);
}

static void note_thread(void *context) {
    *(pid_t *)context = (pid_t)syscall(SYS_gettid);
}

static void all_jobs_are_done_in_one_other_thread(void) {
    pid_t first = 0;
    pid_t again = 0;
    tl_fmu_thread_call(thread, note_thread, &first);
    for (int i = 0; i < 1000; i++) {
        tl_fmu_thread_call(thread, note_thread, &again);
        TEST_ASSERT_EQUAL_INT(first, again);
    }
    TEST_ASSERT_NOT_EQUAL_INT(getpid(), first);
}

static void note_stack(void *context) {
    pthread_attr_t attributes;
    void *lowest = NULL;
    size_t *size = context;
    (void)pthread_getattr_np(pthread_self(), &attributes);
    (void)pthread_attr_getstack(&attributes, &lowest, size);
    (void)pthread_attr_destroy(&attributes);
    *size = (size_t)((char *)__builtin_frame_address(0) - (char *)lowest);
}

static void its_stack_is_as_large_as_it_says(void) {
    size_t left = 0;
    tl_fmu_thread_call(thread, note_stack, &left);
    TEST_ASSERT_GREATER_THAN_size_t(TL_FMU_THREAD_STACK - 64 * 1024, left);
}

static void sleep_long(void *context) {
    tl_time *slept = context;
    tl_time begun = tl_clock_now(NULL);
    tl_clock_sleep_until(begun + 60 * TL_SECOND);
    *slept = tl_clock_now(NULL) - begun;
}

static void told_to_hurry_it_does_not_sleep(void) {
    tl_time slept = 0;
    tl_fmu_thread_begin(thread, sleep_long, &slept);
    tl_fmu_thread_wake_and_wait(thread);
    TEST_ASSERT_GREATER_THAN_INT64(0, slept);
    TEST_ASSERT_LESS_THAN_INT64(30 * TL_SECOND, slept);
}

static void note_mask(void *context) {
    (void)pthread_sigmask(SIG_SETMASK, NULL, context);
}

/* An FMU's threads and processes would inherit a blocked signal. */
static void no_signal_is_blocked_in_it(void) {
    sigset_t mask;
    tl_fmu_thread_call(thread, note_mask, &mask);
    for (int signal = 1; signal < NSIG; signal++) {
        TEST_ASSERT_NOT_EQUAL_INT(1, sigismember(&mask, signal));
    }
}

static void note_policy(void *context) {
    int *policy = context;
    *policy = sched_getscheduler(0);
}

static void it_is_scheduled_from_outside(void) {
    const struct sched_param urgent = {.sched_priority = 10};
    const struct sched_param ordinary = {.sched_priority = 0};
    int policy = -1;
    tl_fmu_thread_call(thread, note_policy, &policy);
    TEST_ASSERT_EQUAL_INT(SCHED_OTHER, policy);
    int refused = sched_setscheduler(tl_fmu_thread_number(thread), SCHED_FIFO, &urgent);
    tl_fmu_thread_call(thread, note_policy, &policy);
    TEST_ASSERT_EQUAL_INT(refused != 0 ? SCHED_OTHER : SCHED_FIFO, policy);
    TEST_ASSERT_EQUAL_INT(0, sched_setscheduler(tl_fmu_thread_number(thread), SCHED_OTHER, &ordinary));
    tl_fmu_thread_call(thread, note_policy, &policy);
    TEST_ASSERT_EQUAL_INT(SCHED_OTHER, policy);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(all_jobs_are_done_in_one_other_thread);
    RUN_TEST(its_stack_is_as_large_as_it_says);
    RUN_TEST(told_to_hurry_it_does_not_sleep);
    RUN_TEST(no_signal_is_blocked_in_it);
    RUN_TEST(it_is_scheduled_from_outside);
    return UNITY_END();
}
