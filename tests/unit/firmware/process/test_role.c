/* Roles: the program executes itself again. Tests what the child gets and does not get. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/role.h"
#include "tests/support/message.h"

enum { REPORT = 3, GATE = 4, OPEN_LOOK = 300 };

static tl_error error;
static tl_role role;
static int report[2]; /* output of the child */
static int gate[2];   /* the child ends when we close our end */

/* ---- the child process ---- */

static int inherited; /* a value that only a forked child has */

static void print_descriptors(FILE *out) {
    (void)fprintf(out, "open:");
    for (int i = 0; i < OPEN_LOOK; i++) {
        if (fcntl(i, F_GETFD) >= 0) {
            (void)fprintf(out, " %d", i);
        }
    }
    (void)fprintf(out, "\n");
}

static void print_signals(FILE *out) {
    struct sigaction now;
    sigset_t mask;
    int blocked = 0;
    (void)sigprocmask(SIG_SETMASK, NULL, &mask);
    for (int i = 1; i < NSIG; i++) {
        blocked += sigismember(&mask, i) == 1 ? 1 : 0;
    }
    (void)sigaction(SIGPIPE, NULL, &now);
    (void)fprintf(out, "blocked: %d, SIGPIPE: %s", blocked, now.sa_handler == SIG_DFL ? "default" : "kept");
    (void)sigaction(SIGUSR1, NULL, &now);
    (void)fprintf(out, ", SIGUSR1: %s", now.sa_handler == SIG_DFL ? "default" : "kept");
    (void)sigaction(SIGHUP, NULL, &now);
    (void)fprintf(out, ", SIGHUP: %s\n", now.sa_handler == SIG_IGN ? "ignored" : "default");
}

/* Prints the title as ps shows it, after a change. */
static void print_own_title(FILE *out) {
    char words[256] = "";
    tl_role_entitle("shadow [motor], which is too long for it");
    FILE *file = fopen("/proc/self/cmdline", "r");
    if (file != NULL) {
        (void)!fread(words, 1, sizeof words - 1, file);
        (void)fclose(file);
    }
    (void)fprintf(out, "now: %s.\n", words);
}

static int be_role(const char *title, void *context) {
    char byte = 0;
    int death = 0;
    (void)context;
    if (strcmp(title, "crash") == 0) {
        (void)signal(SIGSEGV, SIG_DFL);
        (void)raise(SIGSEGV);
    }
    tl_role_enter();
    tl_role_enter(); /* again, as after a change of the user */
    FILE *out = fdopen(REPORT, "w");
    if (out == NULL) {
        return 1;
    }
    (void)prctl(PR_GET_PDEATHSIG, &death);
    (void)fprintf(out, "title: %s, inherited: %d\n", title, inherited);
    print_descriptors(out);
    print_signals(out);
    (void)fprintf(out, "leads its session: %s, death: %d, ", getsid(0) == getpid() ? "yes" : "no", death);
    (void)fprintf(out, "TMPDIR: %s, TL_TEST_A: %s, TL_TEST_B: %s\n", getenv("TMPDIR"), getenv("TL_TEST_A"),
                  getenv("TL_TEST_B"));
    if (title[strlen(title) - 1] == ' ') {
        print_own_title(out);
    }
    (void)fflush(out);
    (void)!read(GATE, &byte, 1);
    return 42;
}

/* ---- tests ---- */

static void ignore(int number) {
    (void)number;
}

void setUp(void) {
    error = (tl_error){TL_OK, ""};
    role = (tl_role){0};
    inherited = 7;
    TEST_ASSERT_EQUAL_INT(0, pipe2(report, O_CLOEXEC));
    TEST_ASSERT_EQUAL_INT(0, pipe2(gate, O_CLOEXEC));
}

void tearDown(void) {
    tl_role_kill(&role);
    (void)close(report[0]);
    (void)close(report[1]);
    (void)close(gate[0]);
    (void)close(gate[1]);
}

static void start(const char *title) {
    static const char *const variables[] = {"TMPDIR=/nowhere", "TL_TEST_A=new"};
    /* In a wrong order: each descriptor is the target of another one. */
    const tl_role_settings settings = {.title = title,
                                       .descriptors = {0,  1,  2,  report[1], gate[0], -1, -1, 1,  -1, 2,  -1, 0,
                                                       -1, -1, -1, 1,         -1,      -1, -1, -1, -1, -1, -1, -1},
                                       .variables = variables,
                                       .variable_count = 2,
                                       .fallback = be_role};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_role_start(&settings, &role, &error), error.text);
    TEST_ASSERT_GREATER_THAN_INT(0, role.pid);
}

/* Reads the report of the child up to the point where it waits. */
static void read_report(char text[2000]) {
    size_t used = 0;
    ssize_t now = 1;
    while (now > 0 && strstr(text, "TMPDIR") == NULL) {
        now = read(report[0], text + used, 1999 - used);
        used += now > 0 ? (size_t)now : 0;
        text[used] = '\0';
    }
}

static void expect(const char *text, const char *part) {
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, part), text);
}

static void wait_for_end(void) {
    const struct timespec pause = {.tv_nsec = 1000000};
    while (!tl_role_watch(&role)) {
        (void)nanosleep(&pause, NULL);
    }
}

static void end_child(void) {
    (void)close(gate[1]);
    gate[1] = -1;
    wait_for_end();
}

/* Open descriptors, signal handlers, ignored and blocked signals are not inherited. */
static void test_a_child_gets_the_given_settings_only(void) {
    char text[2000] = "";
    sigset_t some;
    sigset_t before;
    int leak = fcntl(0, F_DUPFD, 200);
    int low = fcntl(0, F_DUPFD, TL_ROLE_DESCRIPTORS + 1);
    (void)signal(SIGPIPE, SIG_IGN);
    (void)signal(SIGUSR1, ignore);
    (void)sigemptyset(&some);
    (void)sigaddset(&some, SIGUSR2);
    (void)sigprocmask(SIG_BLOCK, &some, &before);
    (void)setenv("TL_TEST_A", "old", 1);
    (void)setenv("TL_TEST_B", "kept", 1);
    start("twin [motor]  ");
    read_report(text);
    sigset_t after;
    (void)sigprocmask(SIG_SETMASK, &before, &after);
    TEST_ASSERT_EQUAL_INT(1, sigismember(&after, SIGUSR2));
    TEST_ASSERT_EQUAL_INT(0, sigismember(&after, SIGUSR1));
    expect(text, role.is_forked ? "inherited: 7\n" : "inherited: 0\n");
    expect(text, "title: twin [motor]  ,");
    if (!role.is_forked) {
        expect(text, "now: twinlock: shadow [motor].\n");
    }
    expect(text, "open: 0 1 2 3 4 7 9 11 15\n");
    expect(text, "blocked: 0, SIGPIPE: default, SIGUSR1: default, SIGHUP: default\n");
    expect(text, "leads its session: yes, death: 9, TMPDIR: /nowhere, TL_TEST_A: new, TL_TEST_B: kept\n");
    TEST_ASSERT_FALSE(tl_role_watch(&role));
    end_child();
    TEST_ASSERT_EQUAL_INT(42, role.code);
    TEST_ASSERT_EQUAL_INT(0, role.signal);
    TEST_ASSERT_EQUAL_INT(0, role.pid);
    TEST_ASSERT_TRUE(tl_role_watch(&role));
    (void)close(leak);
    (void)close(low);
    (void)signal(SIGPIPE, SIG_DFL);
    (void)signal(SIGUSR1, SIG_DFL);
}

static void test_an_ignored_hangup_stays_so(void) {
    char text[2000] = "";
    (void)signal(SIGHUP, SIG_IGN);
    start("twin");
    (void)signal(SIGHUP, SIG_DFL);
    read_report(text);
    expect(text, "SIGHUP: ignored\n");
}

static void test_its_title_is_its_name(void) {
    char text[2000] = "";
    char path[64];
    char line[64] = "";
    start("twin [motor]");
    read_report(text);
    (void)snprintf(path, sizeof path, "/proc/%d/cmdline", (int)role.pid);
    FILE *file = fopen(path, "r");
    TEST_ASSERT_NOT_NULL(file);
    (void)!fread(line, 1, sizeof line - 1, file);
    (void)fclose(file);
    if (role.is_forked) {
        TEST_IGNORE_MESSAGE("a forked child keeps the title");
    }
    TEST_ASSERT_EQUAL_STRING("twinlock: twin [motor]", line);
}

static void test_it_can_be_killed(void) {
    char text[2000] = "";
    start("twin");
    read_report(text);
    tl_role_kill(&role);
    TEST_ASSERT_TRUE(role.has_ended);
    TEST_ASSERT_EQUAL_INT(SIGKILL, role.signal);
    TEST_ASSERT_EQUAL_INT(0, role.pid);
    tl_role_kill(&role); /* has no effect */
    TEST_ASSERT_EQUAL_INT(SIGKILL, role.signal);
}

static void test_a_crash_is_reported(void) {
    start("crash");
    wait_for_end();
    TEST_ASSERT_EQUAL_INT(SIGSEGV, role.signal);
}

/* A killed parent ends its child, which closes the child's end of the report. */
static void test_it_dies_with_its_parent(void) {
    char byte = 0;
    int ready[2];
    TEST_ASSERT_EQUAL_INT(0, pipe2(ready, O_CLOEXEC));
    pid_t middle = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, middle);
    if (middle == 0) {
        char text[2000] = "";
        start("twin");
        read_report(text);
        (void)!write(ready[1], "r", 1);
        (void)pause();
        _exit(0);
    }
    (void)close(report[1]);
    report[1] = -1;
    TEST_ASSERT_EQUAL_INT(1, read(ready[0], &byte, 1));
    TEST_ASSERT_EQUAL_INT(0, kill(middle, SIGKILL));
    TEST_ASSERT_EQUAL_INT(middle, waitpid(middle, NULL, 0));
    TEST_ASSERT_EQUAL_INT(0, read(report[0], &byte, 1));
    (void)close(ready[0]);
    (void)close(ready[1]);
}

static void test_an_invalid_descriptor(void) {
    const tl_role_settings settings = {
        .title = "twin",
        .descriptors = {0, 1, 2, 999, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1},
        .fallback = be_role};
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_role_start(&settings, &role, &error));
    TL_EXPECT_PARTS("process|\"twin\"|Bad file descriptor", error.text);
    TEST_ASSERT_EQUAL_INT(0, role.pid);
    TEST_ASSERT_EQUAL_INT(-1, waitpid(-1, NULL, WNOHANG)); /* no child remains */
    TEST_ASSERT_EQUAL_INT(ECHILD, errno);
}

int main(int argc, char **argv) {
    (void)argc;
    const char *title = tl_role_begin(argv);
    if (title != NULL) {
        return be_role(title, NULL);
    }
    UNITY_BEGIN();
    RUN_TEST(test_a_child_gets_the_given_settings_only);
    RUN_TEST(test_an_ignored_hangup_stays_so);
    RUN_TEST(test_its_title_is_its_name);
    RUN_TEST(test_it_can_be_killed);
    RUN_TEST(test_a_crash_is_reported);
    RUN_TEST(test_it_dies_with_its_parent);
    RUN_TEST(test_an_invalid_descriptor);
    return UNITY_END();
}
