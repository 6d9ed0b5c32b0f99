/* The reaper: dead processes are reaped, callers do not wait, and its thread has no real-time
 * priority. */
#include <dirent.h>
#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/live/child.h"

static tl_reaper reaper;

void setUp(void) {
    reaper = (tl_reaper){0};
}

void tearDown(void) {}

static pid_t make_child(void) {
    pid_t child = fork();
    if (child == 0) {
        for (;;) {
            (void)pause();
        }
    }
    TEST_ASSERT_GREATER_THAN_INT(0, child);
    return child;
}

static void wait_for_rest(void) {
    const struct timespec pause = {.tv_sec = 0, .tv_nsec = 10000000};
    for (int i = 0; i < 3000 && !tl_reaper_is_idle(&reaper); i++) {
        (void)nanosleep(&pause, NULL);
    }
    TEST_ASSERT_TRUE(tl_reaper_is_idle(&reaper));
}

static void expect_gone(pid_t child) {
    TEST_ASSERT_EQUAL_INT(-1, kill(child, 0));
    TEST_ASSERT_EQUAL_INT(ESRCH, errno);
}

static void it_rests_at_first(void) {
    TEST_ASSERT_TRUE(tl_reaper_is_idle(&reaper));
}

static void the_dead_go(void) {
    siginfo_t info;
    for (int i = 0; i < 3; i++) {
        pid_t child = make_child();
        TEST_ASSERT_EQUAL_INT(0, kill(child, SIGKILL));
        TEST_ASSERT_EQUAL_INT(0, waitid(P_PID, (id_t)child, &info, WEXITED | WNOWAIT));
        TEST_ASSERT_EQUAL_INT(0, kill(child, 0)); /* not reaped yet */
        tl_reaper_start(&reaper, child);
        wait_for_rest();
        expect_gone(child);
    }
}

/* The process is still alive: the caller does not wait for its end. */
static void nobody_waits_for_it(void) {
    pid_t child = make_child();
    tl_reaper_start(&reaper, child);
    TEST_ASSERT_FALSE(tl_reaper_is_idle(&reaper));
    TEST_ASSERT_FALSE(tl_reaper_is_idle(&reaper));
    TEST_ASSERT_EQUAL_INT(0, kill(child, SIGKILL));
    wait_for_rest();
    expect_gone(child);
}

/* The other thread of this process. */
static pid_t other_thread(void) {
    pid_t found = 0;
    DIR *folder = opendir("/proc/self/task");
    TEST_ASSERT_NOT_NULL(folder);
    for (struct dirent *entry = readdir(folder); entry != NULL; entry = readdir(folder)) {
        pid_t thread = (pid_t)strtol(entry->d_name, NULL, 10);
        found = thread > 0 && thread != getpid() ? thread : found;
    }
    (void)closedir(folder);
    TEST_ASSERT_GREATER_THAN_INT(0, found);
    return found;
}

static void it_has_no_real_time_priority(void) {
    const struct sched_param urgent = {.sched_priority = 1};
    const struct sched_param ordinary = {.sched_priority = 0};
    pid_t child = make_child();
    if (sched_setscheduler(0, SCHED_FIFO, &urgent) != 0) {
        (void)kill(child, SIGKILL);
        (void)waitpid(child, NULL, 0);
        TEST_IGNORE_MESSAGE("needs the permission for SCHED_FIFO");
    }
    tl_reaper_start(&reaper, child);
    TEST_ASSERT_EQUAL_INT(SCHED_OTHER, sched_getscheduler(other_thread()));
    (void)kill(child, SIGKILL);
    wait_for_rest();
    TEST_ASSERT_EQUAL_INT(0, sched_setscheduler(0, SCHED_OTHER, &ordinary));
}

static void it_can_be_left(void) {
    pid_t child = make_child();
    tl_reaper_start(&reaper, child);
    tl_reaper_stop(&reaper);
    TEST_ASSERT_TRUE(tl_reaper_is_idle(&reaper));
    (void)kill(child, SIGKILL);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(it_rests_at_first);
    RUN_TEST(the_dead_go);
    RUN_TEST(nobody_waits_for_it);
    RUN_TEST(it_has_no_real_time_priority);
    RUN_TEST(it_can_be_left);
    return UNITY_END();
}
