/* A side thread does not inherit the signal mask and the scheduling of its creator. */
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>

#include <unity.h>

#include "firmware/base/os.h"

enum { STACK = 256 * 1024 };

typedef struct seen {
    bool every_signal_is_blocked;
    int policy;
    size_t stack;
} seen;

void setUp(void) {}

void tearDown(void) {}

static void *look(void *context) {
    seen *own = context;
    pthread_attr_t attributes;
    sigset_t mask;
    (void)pthread_sigmask(SIG_SETMASK, NULL, &mask);
    own->every_signal_is_blocked = sigismember(&mask, SIGTERM) == 1 && sigismember(&mask, SIGINT) == 1 &&
                                   sigismember(&mask, SIGUSR1) == 1 && sigismember(&mask, SIGALRM) == 1;
    own->policy = sched_getscheduler(0);
    (void)pthread_getattr_np(pthread_self(), &attributes);
    (void)pthread_attr_getstacksize(&attributes, &own->stack);
    (void)pthread_attr_destroy(&attributes);
    return context;
}

static seen run(size_t stack) {
    seen result = {.policy = -1};
    void *returned = NULL;
    pthread_t thread;
    TEST_ASSERT_EQUAL_INT(0, tl_side_thread_start(&thread, stack, look, &result));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, &returned));
    TEST_ASSERT_EQUAL_PTR(&result, returned);
    return result;
}

static void test_no_signals(void) {
    sigset_t before;
    sigset_t after;
    (void)pthread_sigmask(SIG_SETMASK, NULL, &before);
    TEST_ASSERT_TRUE(run(STACK).every_signal_is_blocked);
    (void)pthread_sigmask(SIG_SETMASK, NULL, &after);
    TEST_ASSERT_EQUAL_INT(sigismember(&before, SIGTERM), sigismember(&after, SIGTERM));
    TEST_ASSERT_EQUAL_INT(0, sigismember(&after, SIGUSR1));
}

/* The creator has another policy, which needs no rights. */
static void test_ordinary_scheduling(void) {
    const struct sched_param none = {.sched_priority = 0};
    TEST_ASSERT_EQUAL_INT(0, pthread_setschedparam(pthread_self(), SCHED_BATCH, &none));
    TEST_ASSERT_EQUAL_INT(SCHED_OTHER, run(STACK).policy);
    TEST_ASSERT_EQUAL_INT(0, pthread_setschedparam(pthread_self(), SCHED_OTHER, &none));
}

static void test_the_stack(void) {
    TEST_ASSERT_TRUE(run(STACK).stack <= 2 * (size_t)STACK);
    TEST_ASSERT_TRUE(run(0).stack > 2 * (size_t)STACK);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_no_signals);
    RUN_TEST(test_ordinary_scheduling);
    RUN_TEST(test_the_stack);
    return UNITY_END();
}
