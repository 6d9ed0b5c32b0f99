/* The FMU process of a live twin: its descriptors and rights, how it is monitored, and how it ends.
 * The process is this program, executed again. Its job selects what it does. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/process/bounds.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/twin/twin_process.h"
#include "firmware/twin/twin_role.h"
#include "tests/support/confined.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/stderr_capture.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"
#define SLOW "twin slow"

enum { PULSE = 6, QUEUE = 8, GATE = 9, NUMBERS = 12, DONE = 42, WAIT_S = 20 };

/* A block that the process writes. */
typedef struct child_report {
    tl_fmu_calls calls;
    tl_confine_facts facts;
    struct rlimit locked;
    struct rlimit priority;
    struct rlimit nice;
    uid_t user;
    bool locks_memory;
    bool has_files; /* of FMUs */
    bool is_refused;
    unsigned open; /* a bit for each descriptor below NUMBERS */
    unsigned asked;
    int lives; /* written last */
} child_report;

/* ---- the process ---- */

static void sleep_for(tl_time time) {
    tl_clock_sleep_until(tl_clock_now(NULL) + time);
}

static void write_report(child_report *what, const tl_assembly *assembly, const tl_confine_facts *facts) {
    what->facts = *facts;
    what->user = getuid();
    what->has_files = assembly->files != NULL && assembly->files[0].descriptor >= 0;
    (void)getrlimit(RLIMIT_MEMLOCK, &what->locked);
    (void)getrlimit(RLIMIT_RTPRIO, &what->priority);
    (void)getrlimit(RLIMIT_NICE, &what->nice);
    what->locks_memory = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    for (int i = 0; i < NUMBERS; i++) {
        what->open |= fcntl(i, F_GETFD) >= 0 ? 1U << i : 0;
    }
    __atomic_store_n(&what->lives, 1, __ATOMIC_SEQ_CST);
}

/* Longer than a test. A forked process has the count of requests of its parent. */
static int wait_long(child_report *what) {
    const unsigned before = tl_interrupt_times();
    for (int i = 0; i < 3 * WAIT_S * 1000; i++) {
        sleep_for(TL_SECOND / 1000);
        __atomic_store_n(&what->asked, tl_interrupt_times() - before, __ATOMIC_SEQ_CST);
    }
    return 102;
}

/* Tries each call twice, and continues. */
static int ask(child_report *what) {
    what->is_refused = true;
    for (int i = 0; i < 2; i++) {
        what->is_refused = what->is_refused && tl_confined_has_no_socket(AF_INET, SOCK_STREAM, 0);
        what->is_refused = what->is_refused && kill(getppid(), SIGTERM) != 0 && errno == EPERM;
    }
    return DONE;
}

static int hang(child_report *what) {
    tl_fmu_calls_use(&what->calls);
    tl_fmu_call_begin(tl_fmu_calls_name("motor"), TL_FMU_DO_STEP);
    return wait_long(what);
}

static int print(child_report *what) {
    (void)what;
    (void)!write(STDOUT_FILENO, "printed\n", 8);
    return DONE;
}

static int end(child_report *what) {
    (void)what;
    return DONE;
}

static int live(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts) {
    static const struct {
        const char *name;
        int (*act)(child_report *what);
    } acts[] = {{"end", end}, {"wait", wait_long}, {"ask", ask}, {"hang", hang}, {"print", print}};
    tl_block block;
    if (tl_block_take(PULSE, sizeof(child_report), TL_BLOCK_THEY_WRITE, &block, NULL) != TL_OK) {
        return 100;
    }
    write_report(block.bytes, assembly, facts);
    for (size_t i = 0; i < sizeof acts / sizeof acts[0]; i++) {
        if (strlen(acts[i].name) == job->live_size && memcmp(acts[i].name, job->live, job->live_size) == 0) {
            return acts[i].act(block.bytes);
        }
    }
    return 101;
}

static const tl_twin_role_tasks tasks = {.live = live};

/* ---- the parent ---- */

static tl_scratch scratch; /* TMPDIR */
static tl_config config;
static tl_twin_job order;
static tl_block block;
static const child_report *seen;
static tl_twin_process_settings settings;
static tl_twin_process *process;
static tl_error error;
static int nothing = -1;
static int open_before;

static int count_open(void) {
    int count = 0;
    for (int i = 0; i < 256; i++) {
        count += fcntl(i, F_GETFD) >= 0 ? 1 : 0;
    }
    return count;
}

static void act(const char *name) {
    order.live = (const unsigned char *)name;
    order.live_size = strlen(name);
}

void setUp(void) {
    tl_report report = {0};
    open_before = count_open();
    error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", scratch.folder, 1));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read(LOCK, &config, &report));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make("pulse", sizeof(child_report), TL_BLOCK_THEY_WRITE, &block, &error));
    seen = block.bytes;
    order = (tl_twin_job){.task = TL_TASK_LIVE, .path = LOCK, .text = config.text};
    act("end");
    settings = (tl_twin_process_settings){.job = &order,
                                          .fmus = tl_twin_fmus_of(&config),
                                          .title = "twin [motor]",
                                          .calls = &seen->calls,
                                          .tasks = &tasks};
    for (int i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        settings.given[i] = -1;
    }
    settings.given[PULSE] = block.descriptor;
    nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
}

/* No process, no folder and no descriptor is left. */
void tearDown(void) {
    tl_twin_process_close(process);
    process = NULL;
    TEST_ASSERT_EQUAL_INT(-1, waitpid(-1, NULL, WNOHANG));
    TEST_ASSERT_EQUAL_INT(ECHILD, errno);
    TEST_ASSERT_EQUAL_INT(0, tl_scratch_count(&scratch));
    tl_block_close(&block);
    tl_config_free(&config);
    (void)close(nothing);
    TEST_ASSERT_EQUAL_INT(open_before, count_open());
}

static void start(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_process_start(&settings, &process, &error), error.text);
    TEST_ASSERT_GREATER_THAN_INT(0, tl_twin_process_role(process)->pid);
}

static void start_and_see_it_live(void) {
    start();
    for (int i = 0; i < WAIT_S * 1000 && __atomic_load_n(&seen->lives, __ATOMIC_SEQ_CST) == 0; i++) {
        sleep_for(TL_SECOND / 1000);
    }
    TEST_ASSERT_EQUAL_INT(1, seen->lives);
}

static void expect_end(int code, int number) {
    for (int i = 0; i < WAIT_S * 1000 && !tl_twin_process_reap(process); i++) {
        sleep_for(TL_SECOND / 1000);
    }
    const tl_role *role = tl_twin_process_role(process);
    TEST_ASSERT_TRUE(role->has_ended);
    TEST_ASSERT_EQUAL_INT(number, role->signal);
    TEST_ASSERT_EQUAL_INT(code, role->code);
    TEST_ASSERT_EQUAL_INT(0, tl_twin_process_role(process)->pid);
}

static bool is_emulated(void) {
    return getenv("TL_EMULATOR") != NULL;
}

static void need_notifications(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    if (!facts.notifies) {
        TEST_IGNORE_MESSAGE("no notifications here");
    }
}

/* ---- descriptors and rights ---- */

static void test_it_lives_confined(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    start();
    expect_end(DONE, 0);
    TEST_ASSERT_EQUAL_INT(1, seen->lives);
    TEST_ASSERT_EQUAL_INT(facts.filter, seen->facts.filter);
    TEST_ASSERT_EQUAL_INT(facts.notifies, seen->facts.notifies);
    TEST_ASSERT_EQUAL_INT(facts.landlock, seen->facts.landlock);
    TEST_ASSERT_EQUAL_INT(facts.memory, seen->facts.memory);
    TEST_ASSERT_EQUAL_INT(facts.user && geteuid() == 0, seen->facts.user);
    TEST_ASSERT_EQUAL_UINT(seen->facts.user ? 0x70000000U + (unsigned)getpid() : getuid(), seen->user);
    TEST_ASSERT_TRUE(seen->has_files);
}

/* Two processes have different users, so that neither can affect the other. */
static void test_another_one_is_another_user(void) {
    settings.which = 1;
    start();
    expect_end(DONE, 0);
    TEST_ASSERT_EQUAL_UINT(seen->facts.user ? 0x70400000U + (unsigned)getpid() : getuid(), seen->user);
}

/* In safe hold no FMU is loaded. The process has only its own descriptors and the given ones. */
static void test_it_holds(void) {
    order.holds = true;
    order.unconfined = true; /* because confinement keeps some descriptors open */
    settings.given[QUEUE] = nothing;
    settings.given[NUMBERS - 1] = nothing;
    start();
    expect_end(DONE, 0);
    TEST_ASSERT_FALSE(seen->has_files);
    TEST_ASSERT_FALSE(seen->facts.filter);
    TEST_ASSERT_EQUAL_HEX(
        1U << 0 | 1U << 1 | 1U << 2 | 1U << TL_TWIN_JOB | 1U << PULSE | 1U << QUEUE | 1U << (NUMBERS - 1), seen->open);
}

static void test_it_holds_confined(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    order.holds = true;
    start();
    expect_end(DONE, 0);
    TEST_ASSERT_FALSE(seen->has_files);
    TEST_ASSERT_EQUAL_INT(facts.filter, seen->facts.filter);
}

/* In safe hold nothing is unpacked, so that no folder is needed. */
static void test_it_holds_without_a_folder(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", "/nowhere/at/all", 1));
    TEST_ASSERT_NOT_EQUAL(TL_OK, tl_twin_process_start(&settings, &process, &error));
    order.holds = true;
    start();
    expect_end(DONE, 0);
    TEST_ASSERT_EQUAL_INT(facts.filter, seen->facts.filter);
    TEST_ASSERT_EQUAL_INT(facts.landlock, seen->facts.landlock);
    TEST_ASSERT_EQUAL_INT(facts.user && geteuid() == 0, seen->facts.user);
}

/* Returns true if this process may raise the limit. A child tries it; it is irreversible. */
static bool may_raise(int resource, rlim_t limit) {
    int status = 1;
    pid_t pid = fork();
    if (pid == 0) {
        const struct rlimit wanted = {limit, limit};
        _exit(setrlimit((__rlimit_resource_t)resource, &wanted) == 0 ? 0 : 1);
    }
    (void)waitpid(pid, &status, 0);
    return status == 0;
}

static void expect_limit(int resource, rlim_t least, const struct rlimit *has) {
    struct rlimit ours;
    (void)getrlimit((__rlimit_resource_t)resource, &ours);
    TEST_ASSERT_TRUE(has->rlim_cur >= least || !may_raise(resource, least));
    TEST_ASSERT_TRUE(has->rlim_cur >= least || has->rlim_cur == ours.rlim_max); /* the hard limit */
}

/* Only our hard limits restrict its memory and its priority. */
static void test_it_may_be_in_real_time(void) {
    struct rlimit locked;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_MEMLOCK, &locked));
    const struct rlimit lower = {.rlim_cur = 4096, .rlim_max = locked.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_MEMLOCK, &lower));
    start();
    expect_end(DONE, 0);
    (void)setrlimit(RLIMIT_MEMLOCK, &locked);
    TEST_ASSERT_GREATER_THAN_INT(0, config.realtime_priority);
    expect_limit(RLIMIT_MEMLOCK, RLIM_INFINITY, &seen->locked);
    expect_limit(RLIMIT_RTPRIO, (rlim_t)config.realtime_priority, &seen->priority);
    expect_limit(RLIMIT_NICE, 20, &seen->nice);
    TEST_ASSERT_TRUE(seen->locks_memory || seen->locked.rlim_cur != RLIM_INFINITY);
}

/* The process blocks at its start, as on a slow disk. */
static void test_the_start_does_not_wait(void) {
    int gate[2];
    if (is_emulated()) {
        TEST_IGNORE_MESSAGE("an emulator cannot execute this program again");
    }
    TEST_ASSERT_EQUAL_INT(0, pipe2(gate, O_CLOEXEC));
    settings.title = SLOW;
    settings.given[GATE] = gate[0];
    (void)alarm(WAIT_S); /* a hang ends the test */
    start();
    (void)alarm(0);
    TEST_ASSERT_EQUAL_INT(0, seen->lives);
    TEST_ASSERT_FALSE(tl_twin_process_reap(process));
    (void)close(gate[0]);
    (void)close(gate[1]);
    expect_end(DONE, 0);
}

/* ---- refused calls ---- */

typedef struct refusals {
    pthread_t thread;
    int count;
    char texts[4][TL_FMU_REFUSAL_TEXT];
} refusals;

static void on_event(void *context, const char *text) {
    refusals *all = context;
    all->thread = pthread_self();
    (void)snprintf(all->texts[all->count++ % 4], TL_FMU_REFUSAL_TEXT, "%s", text);
}

static void expect_two(const refusals *all) {
    TEST_ASSERT_EQUAL_INT(2, all->count);
    for (int i = 0; i < 2; i++) {
        TL_EXPECT_PARTS(i == 0 ? "thread|FMU|socket" : "thread|FMU|kill", all->texts[i]);
    }
}

/* The log, the listener and the job each get a refusal once. */
static void test_refusals_are_reported_once(void) {
    refusals all = {.count = 0};
    refusals asked = {.count = 0};
    need_notifications();
    act("ask");
    settings.on_event = on_event;
    settings.context = &all;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    start();
    expect_end(DONE, 0);
    TEST_ASSERT_TRUE(tl_twin_process_refusal_may_be_cause(process));
    tl_twin_process_report(process, on_event, &asked);
    tl_twin_process_report(process, on_event, &asked);
    tl_twin_process_close(process);
    process = NULL;
    char *said = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(seen->is_refused);
    expect_two(&all);
    expect_two(&asked);
    TEST_ASSERT_FALSE(pthread_equal(all.thread, pthread_self()));
    TEST_ASSERT_TRUE(pthread_equal(asked.thread, pthread_self()));
    TEST_ASSERT_EQUAL_size_t(2, tl_test_count_lines(said));
    TL_EXPECT_PARTS("warning|thread|FMU|kill", said);
    free(said);
}

/* ---- monitoring ---- */

/* The supervisor monitors calls itself. */
static void test_the_supervisor_monitors_long_calls(void) {
    char text[TL_TWIN_KILLED_TEXT];
    act("hang");
    settings.call_limit = TL_SECOND / 20;
    start_and_see_it_live();
    sleep_for(TL_SECOND / 2);
    TEST_ASSERT_FALSE(tl_twin_process_reap(process));
    TEST_ASSERT_FALSE(tl_twin_process_was_killed(process, text));
    TEST_ASSERT_EQUAL_STRING("", text);
}

static void test_a_long_call_is_ended(void) {
    char text[TL_TWIN_KILLED_TEXT];
    act("hang");
    settings.call_limit = TL_SECOND / 20;
    settings.passes_signals = true;
    start();
    expect_end(0, SIGKILL);
    TEST_ASSERT_TRUE(tl_twin_process_was_killed(process, text));
    TL_EXPECT_PARTS("motor|fmi2DoStep", text);
}

/* Opens the folder of the process, the only one in our folder. */
static int open_its_folder(void) {
    DIR *ours = opendir(scratch.folder);
    int found = -1;
    TEST_ASSERT_NOT_NULL(ours);
    for (const struct dirent *entry = readdir(ours); entry != NULL; entry = readdir(ours)) {
        if (entry->d_name[0] != '.') {
            found = openat(dirfd(ours), entry->d_name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        }
    }
    (void)closedir(ours);
    TEST_ASSERT_NOT_EQUAL_INT(-1, found);
    return found;
}

/* Nests more folders than allowed. */
static void dig(void) {
    int folder = open_its_folder();
    for (int i = 0; i < TL_BOUNDS_DEPTH + 1; i++) {
        TEST_ASSERT_EQUAL_INT(0, mkdirat(folder, "d", S_IRWXU));
        int deeper = openat(folder, "d", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        (void)close(folder);
        folder = deeper;
    }
    (void)close(folder);
}

static void test_a_bound_is_kept(void) {
    char text[TL_TWIN_KILLED_TEXT];
    act("wait");
    start_and_see_it_live();
    dig();
    expect_end(0, SIGKILL);
    TEST_ASSERT_TRUE(tl_twin_process_was_killed(process, text));
    TL_EXPECT_PARTS("killed|folders", text);
}

static void wait_until_dead(void) {
    siginfo_t info;
    TEST_ASSERT_EQUAL_INT(0, waitid(P_PID, (id_t)tl_twin_process_role(process)->pid, &info, WEXITED | WNOWAIT));
    TEST_ASSERT_EQUAL_INT(DONE, info.si_status);
}

/* Another thread reaps the process. Then its number may be reused. */
static void test_a_dead_one_is_let_go(void) {
    char text[TL_TWIN_KILLED_TEXT];
    act("print");
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    start();
    pid_t number = tl_twin_process_role(process)->pid;
    wait_until_dead();
    tl_twin_process_let_go(process);
    tl_stderr_expect("fmu: printed\n");
    TEST_ASSERT_EQUAL_INT(0, tl_twin_process_role(process)->pid);
    TEST_ASSERT_EQUAL_INT(-1, tl_twin_process_role(process)->code);
    dig(); /* a live process would be killed for it */
    sleep_for(TL_SECOND / 4);
    TEST_ASSERT_FALSE(tl_twin_process_was_killed(process, text));
    TEST_ASSERT_TRUE(tl_twin_process_reap(process));
    tl_twin_process_kill(process);
    tl_twin_process_close(process);
    process = NULL;
    TEST_ASSERT_EQUAL_INT(number, waitpid(number, NULL, 0)); /* not reaped before */
}

static void test_it_is_killed(void) {
    act("wait");
    start_and_see_it_live();
    tl_twin_process_kill(process);
    expect_end(0, SIGKILL);
    tl_twin_process_let_go(process); /* has no effect */
    TEST_ASSERT_EQUAL_INT(SIGKILL, tl_twin_process_role(process)->signal);
}

static void test_its_end_is_not_waited_for(void) {
    act("wait");
    start(); /* tearDown() closes it */
}

/* ---- missing resources ---- */

/* Tries each number of descriptors, up to the first that suffices. */
static void test_descriptors_are_missing(void) {
    struct rlimit limit;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &limit));
    const struct rlimit enough = limit;
    const int open_now = count_open();
    int failures = 0;
    tl_status status = TL_TRY_AGAIN;
    for (limit.rlim_cur = 3; status != TL_OK; limit.rlim_cur++) {
        TEST_ASSERT_LESS_THAN_INT(100, failures);
        TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &limit));
        status = tl_twin_process_start(&settings, &process, &error);
        (void)setrlimit(RLIMIT_NOFILE, &enough);
        if (status != TL_OK) {
            failures++;
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_TRY_AGAIN, status, error.text);
            TEST_ASSERT_EQUAL_INT(open_now, count_open());
            TEST_ASSERT_EQUAL_INT(-1, waitpid(-1, NULL, WNOHANG));
            TEST_ASSERT_EQUAL_INT(0, tl_scratch_count(&scratch));
        }
    }
    TEST_ASSERT_GREATER_THAN_INT(5, failures);
}

/* ---- signals: last, because a request to end is not reset ---- */

static void test_a_signal_is_passed_on(void) {
    act("wait");
    settings.passes_signals = true;
    tl_interrupt_install();
    start_and_see_it_live();
    (void)raise(SIGTERM);
    for (int i = 0; i < WAIT_S * 1000 && __atomic_load_n(&seen->asked, __ATOMIC_SEQ_CST) == 0; i++) {
        sleep_for(TL_SECOND / 1000);
    }
    TEST_ASSERT_GREATER_THAN_UINT(0, __atomic_load_n(&seen->asked, __ATOMIC_SEQ_CST));
}

/* A signal from before the process has handlers is passed on afterwards. */
static void test_an_early_signal_kills_nobody(void) {
    TEST_ASSERT_EQUAL_INT(SIGTERM, tl_interrupt_signal());
    act("wait");
    settings.passes_signals = true;
    start();
    for (int i = 0; i < WAIT_S * 1000 && __atomic_load_n(&seen->asked, __ATOMIC_SEQ_CST) == 0; i++) {
        sleep_for(TL_SECOND / 1000);
        TEST_ASSERT_FALSE(tl_twin_process_reap(process));
    }
    TEST_ASSERT_GREATER_THAN_UINT(0, __atomic_load_n(&seen->asked, __ATOMIC_SEQ_CST));
}

static void test_the_supervisor_handles_signals(void) {
    TEST_ASSERT_EQUAL_INT(SIGTERM, tl_interrupt_signal());
    act("wait");
    start_and_see_it_live();
    sleep_for(3 * TL_SECOND / 4);
    TEST_ASSERT_EQUAL_UINT(0, __atomic_load_n(&seen->asked, __ATOMIC_SEQ_CST));
}

int main(int argc, char **argv) {
    (void)argc;
    const char *title = tl_role_begin(argv);
    if (title != NULL) {
        char byte = 0;
        (void)!(strcmp(title, SLOW) == 0 && read(GATE, &byte, 1));
        tl_process_end(tl_twin_role_run(&tasks));
    }
    tl_scratch_make(&scratch, "/tmp", "twin_process");
    (void)chmod(scratch.folder, S_IRWXU | S_IXOTH); /* open to another user */
    UNITY_BEGIN();
    RUN_TEST(test_it_lives_confined);
    RUN_TEST(test_another_one_is_another_user);
    RUN_TEST(test_it_holds);
    RUN_TEST(test_it_holds_confined);
    RUN_TEST(test_it_holds_without_a_folder);
    RUN_TEST(test_it_may_be_in_real_time);
    RUN_TEST(test_the_start_does_not_wait);
    RUN_TEST(test_refusals_are_reported_once);
    RUN_TEST(test_the_supervisor_monitors_long_calls);
    RUN_TEST(test_a_long_call_is_ended);
    RUN_TEST(test_a_bound_is_kept);
    RUN_TEST(test_a_dead_one_is_let_go);
    RUN_TEST(test_it_is_killed);
    RUN_TEST(test_its_end_is_not_waited_for);
    RUN_TEST(test_descriptors_are_missing);
    RUN_TEST(test_a_signal_is_passed_on);
    RUN_TEST(test_an_early_signal_kills_nobody);
    RUN_TEST(test_the_supervisor_handles_signals);
    return tl_scratch_finish(&scratch, UNITY_END());
}
