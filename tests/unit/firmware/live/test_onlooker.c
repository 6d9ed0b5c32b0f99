/* Detection of a process that is stopped or traced. */
#include <signal.h>
#include <stdbool.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/live/child.h"

static pid_t process;

void setUp(void) {
    process = fork();
    for (; process == 0;) {
        (void)pause();
    }
}

void tearDown(void) {
    (void)kill(process, SIGKILL);
    (void)waitpid(process, NULL, 0);
}

static void test_nobody(void) {
    TEST_ASSERT_FALSE(tl_process_is_stopped(process));
}

static void test_one_that_is_stopped(void) {
    TEST_ASSERT_EQUAL_INT(0, kill(process, SIGSTOP));
    TEST_ASSERT_EQUAL_INT(process, waitpid(process, NULL, WUNTRACED));
    TEST_ASSERT_TRUE(tl_process_is_stopped(process));
    TEST_ASSERT_EQUAL_INT(0, kill(process, SIGCONT));
    TEST_ASSERT_EQUAL_INT(process, waitpid(process, NULL, WCONTINUED));
    TEST_ASSERT_FALSE(tl_process_is_stopped(process));
}

/* A traced process may continue to run. */
static void test_one_that_is_traced(void) {
    if (ptrace(PTRACE_SEIZE, process, NULL, NULL) != 0) {
        TEST_IGNORE_MESSAGE("nobody may trace here");
    }
    TEST_ASSERT_TRUE(tl_process_is_stopped(process));
}

static void test_one_that_is_not_there(void) {
    TEST_ASSERT_EQUAL_INT(0, kill(process, SIGKILL));
    TEST_ASSERT_EQUAL_INT(process, waitpid(process, NULL, 0));
    TEST_ASSERT_FALSE(tl_process_is_stopped(process));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_nobody);
    RUN_TEST(test_one_that_is_stopped);
    RUN_TEST(test_one_that_is_traced);
    RUN_TEST(test_one_that_is_not_there);
    return UNITY_END();
}
