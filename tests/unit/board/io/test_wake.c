/* Wake-ups from the same and from another thread, consumed or not; and the clock for waits. */
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <sys/resource.h>

#include <unity.h>

#include "board/io/monotonic.h"
#include "board/io/wake.h"

static tl_wake wake;

void setUp(void) {
    TEST_ASSERT_TRUE(tl_wake_make(&wake));
}

void tearDown(void) {
    tl_wake_release(&wake);
}

static bool wait_for_a_call(int timeout_ms) {
    struct pollfd one = {.fd = wake.descriptor, .events = POLLIN};
    return poll(&one, 1, timeout_ms) > 0;
}

static void test_no_call(void) {
    TEST_ASSERT_FALSE(tl_wake_is_called(&wake));
    TEST_ASSERT_FALSE(tl_wake_clear(&wake));
    TEST_ASSERT_FALSE(wait_for_a_call(0));
}

static void test_a_call_waits_until_it_is_answered(void) {
    tl_wake_call(&wake);
    TEST_ASSERT_TRUE(tl_wake_is_called(&wake));
    TEST_ASSERT_TRUE(tl_wake_is_called(&wake));
    TEST_ASSERT_TRUE(wait_for_a_call(0));
    TEST_ASSERT_TRUE(tl_wake_clear(&wake));
    TEST_ASSERT_FALSE(tl_wake_is_called(&wake));
    TEST_ASSERT_FALSE(tl_wake_clear(&wake));
}

static void test_several_calls_are_one(void) {
    tl_wake_call(&wake);
    tl_wake_call(&wake);
    tl_wake_call(&wake);
    TEST_ASSERT_TRUE(tl_wake_clear(&wake));
    TEST_ASSERT_FALSE(tl_wake_clear(&wake));
}

static void *call(void *context) {
    tl_wake_call(context);
    return NULL;
}

static void test_another_thread_ends_a_wait(void) {
    pthread_t caller;
    tl_time begun = tl_monotonic_now();
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&caller, NULL, call, &wake));
    TEST_ASSERT_TRUE(wait_for_a_call(60000));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(caller, NULL));
    TEST_ASSERT_TRUE(tl_wake_clear(&wake));
    TEST_ASSERT_TRUE(tl_monotonic_now() - begun < 60 * TL_SECOND);
}

static void test_no_descriptor_is_left(void) {
    struct rlimit before;
    tl_wake none = {.descriptor = 0};
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &before));
    const struct rlimit nothing = {.rlim_cur = 0, .rlim_max = before.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &nothing));
    bool made = tl_wake_make(&none);
    int failure = errno;
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &before));
    TEST_ASSERT_FALSE(made);
    TEST_ASSERT_EQUAL_INT(EMFILE, failure);
    tl_wake_release(&none);
    tl_wake_release(&none);
    TEST_ASSERT_EQUAL_INT(-1, none.descriptor);
}

/* poll() uses the same clock, so at least the timeout has passed. */
static void test_the_clock_goes_forward(void) {
    tl_time begun = tl_monotonic_now();
    TEST_ASSERT_FALSE(wait_for_a_call(20));
    tl_time passed = tl_monotonic_now() - begun;
    TEST_ASSERT_TRUE(begun > 0);
    TEST_ASSERT_TRUE(passed >= TL_SECOND / 50);
    TEST_ASSERT_TRUE(passed < 60 * TL_SECOND);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_no_call);
    RUN_TEST(test_a_call_waits_until_it_is_answered);
    RUN_TEST(test_several_calls_are_one);
    RUN_TEST(test_another_thread_ends_a_wait);
    RUN_TEST(test_no_descriptor_is_left);
    RUN_TEST(test_the_clock_goes_forward);
    return UNITY_END();
}
