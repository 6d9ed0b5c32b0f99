/* Changes of an FMU to the process state are restored and described: a test for each kind. */
#include "firmware/process/host_state.h"

#include <fenv.h>
#include <float.h>
#include <locale.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "tests/support/message.h"

static char folder[4096];

static void ours(int signal) {
    (void)signal;
}

static void theirs(int signal) {
    (void)signal;
}

void setUp(void) {
    TEST_ASSERT_NOT_NULL(getcwd(folder, sizeof folder));
    const struct sigaction action = {.sa_handler = ours};
    TEST_ASSERT_EQUAL_INT(0, tl_host_state_handle(SIGTERM, &action, NULL));
    tl_host_state_save();
}

void tearDown(void) {
    (void)tl_host_state_restore();
}

static void expect_handler(int signal, void (*handler)(int)) {
    struct sigaction now;
    TEST_ASSERT_EQUAL_INT(0, sigaction(signal, NULL, &now));
    TEST_ASSERT_TRUE(now.sa_handler == handler);
}

static void expect_folder(const char *expected) {
    char now[4096];
    TEST_ASSERT_NOT_NULL(getcwd(now, sizeof now));
    TEST_ASSERT_EQUAL_STRING(expected, now);
}

static void without_a_change_nothing_is_reported(void) {
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
}

static void each_rounding_mode_is_put_back(void) {
    const uint64_t control = tl_fp_control_get();
    static const int modes[] = {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
    for (size_t i = 0; i < sizeof modes / sizeof modes[0]; i++) {
        TEST_ASSERT_EQUAL_INT(0, fesetround(modes[i]));
        bool usual = tl_fp_control_check(&control);
        unsigned changes = tl_host_state_restore();
        TEST_ASSERT_FALSE(usual);
        TEST_ASSERT_EQUAL_UINT(TL_HOST_ROUNDING, changes);
        TEST_ASSERT_EQUAL_INT(FE_TONEAREST, fegetround());
        TEST_ASSERT_TRUE(tl_fp_control_check(&control));
    }
}

#if defined(__x86_64__)
static void flushed_denormals_and_traps_are_put_back(void) {
    static const unsigned bits[] = {0x8000, 0x0040}; /* flush to zero, denormals are zeros */
    volatile double least = DBL_MIN / 4.0;
    const uint64_t control = tl_fp_control_get();
    for (size_t i = 0; i < sizeof bits / sizeof bits[0]; i++) {
        tl_fp_control_set(tl_fp_control_get() | bits[i]);
        bool usual = tl_fp_control_check(&control);
        TEST_ASSERT_EQUAL_UINT(TL_HOST_ROUNDING, tl_host_state_restore());
        TEST_ASSERT_FALSE(usual);
        TEST_ASSERT_TRUE(least + least > 0.0);
    }
    tl_fp_control_set(control & ~(uint64_t)0x0200); /* a trap of SSE only: restored, but not reported */
    TEST_ASSERT_TRUE(tl_fp_control_check(&control));
    TEST_ASSERT_EQUAL_HEX64(control, tl_fp_control_get());
    TEST_ASSERT_NOT_EQUAL_INT(-1, feenableexcept(FE_INVALID | FE_DIVBYZERO));
    TEST_ASSERT_FALSE(tl_fp_control_check(&control));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_ROUNDING, tl_host_state_restore());
    TEST_ASSERT_EQUAL_INT(0, fegetexcept());
    uint16_t single = 0x007F; /* x87: 24 bits of precision */
    __asm__ volatile("fldcw %0" : : "m"(single));
    TEST_ASSERT_FALSE(tl_fp_control_check(&control));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_ROUNDING, tl_host_state_restore());
    volatile long double third = 1.0L;
    third /= 3.0L;
    TEST_ASSERT_TRUE(third != (long double)(float)third);
}
#endif

/* Every system has POSIX and C.UTF-8. */
static void locales_of_thread_and_process_are_put_back(void) {
    locale_t before = uselocale((locale_t)0);
    char *process = strdup(setlocale(LC_ALL, NULL));
    locale_t other = newlocale(LC_ALL_MASK, "POSIX", (locale_t)0);
    locale_t changed = newlocale(LC_CTYPE_MASK, "C.UTF-8", other);
    TEST_ASSERT_TRUE(changed != (locale_t)0);
    (void)uselocale(changed);
    TEST_ASSERT_EQUAL_UINT(TL_HOST_LOCALE, tl_host_state_restore());
    TEST_ASSERT_TRUE(uselocale((locale_t)0) == before);
    TEST_ASSERT_NOT_NULL(setlocale(LC_NUMERIC, "C.UTF-8"));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_LOCALE, tl_host_state_restore());
    TEST_ASSERT_EQUAL_STRING(process, setlocale(LC_ALL, NULL));
    TEST_ASSERT_NOT_NULL(setlocale(LC_CTYPE, "C.UTF-8")); /* allowed, because interpreters do so */
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
    TEST_ASSERT_NOT_NULL(setlocale(LC_CTYPE, "C"));
    freelocale(changed);
    free(process);
}

static void a_signal_mask_is_put_back(void) {
    sigset_t all;
    sigset_t now;
    (void)sigfillset(&all);
    TEST_ASSERT_EQUAL_INT(0, pthread_sigmask(SIG_BLOCK, &all, NULL));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_SIGNAL_MASK, tl_host_state_restore());
    TEST_ASSERT_EQUAL_INT(0, pthread_sigmask(SIG_SETMASK, NULL, &now));
    TEST_ASSERT_EQUAL_INT(0, sigismember(&now, SIGTERM));
}

static void handlers_of_ours_are_put_back_and_others_left_alone(void) {
    TEST_ASSERT_TRUE(signal(SIGTERM, SIG_IGN) != SIG_ERR);
    TEST_ASSERT_TRUE(signal(SIGUSR2, theirs) != SIG_ERR);
    TEST_ASSERT_EQUAL_UINT(TL_HOST_HANDLERS, tl_host_state_restore());
    expect_handler(SIGTERM, ours);
    expect_handler(SIGUSR2, theirs);
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
}

static void the_newest_handler_of_ours_is_kept(void) {
    const struct sigaction ignore = {.sa_handler = SIG_IGN};
    TEST_ASSERT_EQUAL_INT(0, tl_host_state_handle(SIGTERM, &ignore, NULL));
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
    expect_handler(SIGTERM, SIG_IGN);
    TEST_ASSERT_EQUAL_INT(-1, tl_host_state_handle(SIGKILL, &ignore, NULL));
}

static void the_folder_is_put_back_even_if_the_other_one_is_gone(void) {
    char other[] = "/tmp/twinlock-test-XXXXXX";
    TEST_ASSERT_NOT_NULL(mkdtemp(other));
    TEST_ASSERT_EQUAL_INT(0, chdir(other));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_FOLDER, tl_host_state_restore());
    expect_folder(folder);
    TEST_ASSERT_EQUAL_INT(0, chdir(other));
    TEST_ASSERT_EQUAL_INT(0, rmdir(other));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_FOLDER, tl_host_state_restore());
    expect_folder(folder);
}

static void each_kind_is_put_back_in_its_turn(void) {
    sigset_t all;
    unsigned changes = 0;
    (void)sigfillset(&all);
    TEST_ASSERT_EQUAL_INT(0, pthread_sigmask(SIG_BLOCK, &all, NULL));
    TEST_ASSERT_TRUE(signal(SIGTERM, SIG_IGN) != SIG_ERR);
    TEST_ASSERT_EQUAL_INT(0, chdir("/"));
    (void)umask(0);
    TEST_ASSERT_EQUAL_INT(0, fesetround(FE_UPWARD));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_ROUNDING, tl_host_state_restore_part() & TL_HOST_ROUNDING);
    for (int i = 0; i < TL_HOST_STATE_TURNS; i++) {
        changes |= tl_host_state_restore_part();
    }
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
    TEST_ASSERT_EQUAL_UINT(0, changes & TL_HOST_ROUNDING);
    expect_handler(SIGTERM, ours);
    expect_folder(folder);
}

static void the_umask_is_put_back(void) {
    mode_t before = umask(0);
    TEST_ASSERT_NOT_EQUAL_UINT(0, before);
    TEST_ASSERT_EQUAL_UINT(TL_HOST_UMASK, tl_host_state_restore());
    TEST_ASSERT_EQUAL_UINT(before, umask(before));
}

static void the_scheduling_of_the_thread_is_put_back_as_far_as_permitted(void) {
    const struct sched_param idle = {.sched_priority = 0};
    TEST_ASSERT_EQUAL_INT(0, sched_setscheduler(0, SCHED_BATCH, &idle));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_SCHEDULING, tl_host_state_restore());
    TEST_ASSERT_EQUAL_INT(SCHED_OTHER, sched_getscheduler(0));
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
}

static void the_processors_of_the_thread_are_put_back(void) {
    cpu_set_t before;
    cpu_set_t now;
    cpu_set_t one;
    TEST_ASSERT_EQUAL_INT(0, sched_getaffinity(0, sizeof before, &before));
    if (CPU_COUNT(&before) < 2) {
        TEST_IGNORE_MESSAGE("the test may use only one processor");
    }
    size_t processor = 0;
    while (!CPU_ISSET(processor, &before)) {
        processor++;
    }
    CPU_ZERO(&one);
    CPU_SET(processor, &one);
    TEST_ASSERT_EQUAL_INT(0, sched_setaffinity(0, sizeof one, &one));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_PROCESSORS, tl_host_state_restore());
    TEST_ASSERT_EQUAL_INT(0, sched_getaffinity(0, sizeof now, &now));
    TEST_ASSERT_TRUE(CPU_EQUAL(&before, &now));
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
}

static void the_timer_slack_is_put_back(void) {
    int before = prctl(PR_GET_TIMERSLACK);
    TEST_ASSERT_EQUAL_INT(0, prctl(PR_SET_TIMERSLACK, (unsigned long)before + 1000000));
    TEST_ASSERT_EQUAL_UINT(TL_HOST_TIMER_SLACK, tl_host_state_restore());
    TEST_ASSERT_EQUAL_INT(before, prctl(PR_GET_TIMERSLACK));
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
}

static void set_limit(int resource, rlim_t soft, rlim_t hard) {
    const struct rlimit limit = {soft, hard};
    TEST_ASSERT_EQUAL_INT(0, setrlimit((__rlimit_resource_t)resource, &limit));
}

static void expect_limit(int resource, rlim_t soft, rlim_t hard) {
    struct rlimit now;
    TEST_ASSERT_EQUAL_INT(0, getrlimit((__rlimit_resource_t)resource, &now));
    TEST_ASSERT_EQUAL_UINT64(soft, now.rlim_cur);
    TEST_ASSERT_EQUAL_UINT64(hard, now.rlim_max);
}

static void a_soft_limit_is_put_back(void) {
    struct rlimit before;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &before));
    set_limit(RLIMIT_NOFILE, 10, before.rlim_max);
    TEST_ASSERT_EQUAL_UINT(TL_HOST_LIMITS, tl_host_state_restore());
    expect_limit(RLIMIT_NOFILE, before.rlim_cur, before.rlim_max);
    TEST_ASSERT_EQUAL_UINT(0, tl_host_state_restore());
}

/* In a process without privileges. The soft limit follows the hard one, and this is reported once.
 */
static void a_hard_limit_is_put_back_as_far_as_permitted(void) {
    int status = 0;
    pid_t child = fork();
    if (child == 0) {
        set_limit(RLIMIT_CORE, 0, 4096);
        tl_host_state_save();
        set_limit(RLIMIT_CORE, 0, 1024);
        bool drops = geteuid() != 0 || setresuid(65534, 65534, 65534) == 0;
        unsigned first = tl_host_state_restore();
        unsigned second = tl_host_state_restore();
        expect_limit(RLIMIT_CORE, 0, 1024);
        _exit(drops && first == TL_HOST_LIMITS && second == 0 ? 0 : 1);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
}

static void several_changes_are_described_together(void) {
    char text[TL_HOST_CHANGE_TEXT];
    (void)umask(umask(0) ^ 0007);
    TEST_ASSERT_EQUAL_INT(0, chdir("/"));
    TEST_ASSERT_EQUAL_INT(0, fesetround(FE_UPWARD));
    tl_host_state_describe(tl_host_state_restore(), text);
    TL_EXPECT_PARTS("floating-point|folder|umask", text);
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "locale") || tl_test_has_parts(text, "signal"));
    tl_host_state_describe(TL_HOST_HANDLERS, text);
    TL_EXPECT_PARTS("signal handlers", text);
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "mask") || tl_test_has_parts(text, "umask"));
    tl_host_state_describe((1U << TL_HOST_CHANGES) - 1, text);
    TL_EXPECT_PARTS(
        "floating-point|locale|signal mask|signal handlers|folder|umask|scheduling|processors|timer slack|limits",
        text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(without_a_change_nothing_is_reported);
    RUN_TEST(each_rounding_mode_is_put_back);
#if defined(__x86_64__)
    RUN_TEST(flushed_denormals_and_traps_are_put_back);
#endif
    RUN_TEST(locales_of_thread_and_process_are_put_back);
    RUN_TEST(a_signal_mask_is_put_back);
    RUN_TEST(handlers_of_ours_are_put_back_and_others_left_alone);
    RUN_TEST(the_newest_handler_of_ours_is_kept);
    RUN_TEST(the_folder_is_put_back_even_if_the_other_one_is_gone);
    RUN_TEST(each_kind_is_put_back_in_its_turn);
    RUN_TEST(the_umask_is_put_back);
    RUN_TEST(the_scheduling_of_the_thread_is_put_back_as_far_as_permitted);
    RUN_TEST(the_processors_of_the_thread_are_put_back);
    RUN_TEST(the_timer_slack_is_put_back);
    RUN_TEST(a_soft_limit_is_put_back);
    RUN_TEST(a_hard_limit_is_put_back_as_far_as_permitted);
    RUN_TEST(several_changes_are_described_together);
    return UNITY_END();
}
