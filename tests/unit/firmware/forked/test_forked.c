/* An FMU in processes of its own: saved and restored in any order to the bit; who ends is told, and nobody is left. A real FMU, real processes. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/fmu/fmu_store.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/forked/forked_calls.h"
#include "firmware/forked/forked_pool.h"
#include "firmware/process/confine.h"
#include "tests/support/stderr_capture.h"

enum { SKIPPED = 77, STATES = 8, SNAPSHOTS = 12, BESIDE = 16 };

static tl_fmu fmu;
static fmi2Component instance;
static int64_t steps;

static void begin_processes(tl_status (*confine)(const void *, tl_error *)) {
    const tl_forked_service service = {.confine = confine, .load = tl_fmu_host_load};
    tl_error error;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_forked_begin(SNAPSHOTS, &service, &error), error.text);
}

static void begin(tl_status (*confine)(const void *, tl_error *)) {
    tl_error error;
    begin_processes(confine);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_fmu_load(TL_BINARY_DIR "/fmus/lag.fmu", -1, TL_ROLLBACK_FORK, &fmu, &error),
                                  error.text);
    const tl_fmi2 *fmi = &fmu.guard.functions;
    instance = fmi->instantiate("forked", fmi2CoSimulation, fmu.model.guid, fmu.resources, &fmu.guard.callbacks,
                                fmi2False, fmi2False);
    TEST_ASSERT_NOT_NULL(instance);
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->setup_experiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->enter_initialization_mode(instance));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->exit_initialization_mode(instance));
    steps = 0;
}

void setUp(void) {
    begin(NULL);
}

void tearDown(void) {
    tl_fmu_unload(&fmu);
}

static double step(double input) {
    const fmi2ValueReference u = 0;
    const fmi2ValueReference y = 1;
    fmi2Real value = 0.0;
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.set_real(instance, &u, 1, &input));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.do_step(instance, 0.01 * (double)steps++, 0.01, fmi2False));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_real(instance, &y, 1, &value));
    return value;
}

static void pause_ms(long ms) {
    const struct timespec while_ = {.tv_nsec = ms * 1000000};
    (void)nanosleep(&while_, NULL);
}

/* Whether a process is gone within 5 s; a zombie is not. */
static bool is_gone(pid_t process) {
    int looks = 0;
    while (kill(process, 0) == 0 && looks < 500) {
        (void)waitpid(process, NULL, WNOHANG); /* if it is ours */
        pause_ms(10);
        looks++;
    }
    return looks < 500;
}

/* That which goes on; and those of all slots. */
static pid_t process_in(uint32_t slot) {
    return (pid_t)__atomic_load_n(&fmu.line->block->slots[slot].process, __ATOMIC_ACQUIRE);
}

static pid_t settled_process_in(uint32_t slot) {
    for (int i = 0; i < 500 && process_in(slot) == 0; i++) {
        pause_ms(10);
    }
    return process_in(slot);
}

static void expect_said(const char *part) {
    char *said = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(said);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(said, part), said);
    free(said);
}

static void expect_failure(const char *expected) {
    tl_fmu_fork fork;
    TEST_ASSERT_TRUE(tl_fmu_look_at_fork(&fmu, &fork));
    TEST_ASSERT_EQUAL_STRING(expected, fork.failure);
}

/* What a state has for itself are the pages of a step, and what a process begins with; never what is read only. */
static void test_what_a_state_takes(void) {
    fmi2FMUstate states[2] = {NULL};
    tl_fmu_fork fork;
    TEST_ASSERT_TRUE(tl_fmu_look_at_fork(&fmu, &fork));
    TEST_ASSERT_EQUAL_UINT64(0, fork.bytes);
    for (size_t i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &states[i]));
        (void)step(1.0);
    }
    TEST_ASSERT_TRUE(tl_fmu_look_at_fork(&fmu, &fork));
    TEST_ASSERT_GREATER_THAN_UINT64(0, fork.bytes);
    expect_failure("");
}

static void test_any_order(void) {
    static const int order[] = {3, 0, 7, 7, 1, 6, 2, 5, 4, 0};
    fmi2FMUstate states[STATES] = {NULL};
    double next[STATES];
    TEST_ASSERT_EQUAL_INT(TL_ROLLBACK_FORK, tl_fmu_rollback(&fmu));
    TEST_ASSERT_NULL(fmu.guard.functions.serialize_fmu_state);
    TEST_ASSERT_EQUAL_UINT32(SNAPSHOTS, fmu.guard.functions.most_states);
    for (int i = 0; i < STATES; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &states[i]));
        next[i] = step(1.0 + i);
    }
    for (size_t i = 0; i < sizeof order / sizeof order[0]; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.set_fmu_state(instance, states[order[i]]));
        steps = order[i];
        double again = step(1.0 + order[i]);
        TEST_ASSERT_EQUAL_MEMORY(&next[order[i]], &again, sizeof again);
        (void)step(-3.0);
    }
    for (int i = 0; i < STATES; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.free_fmu_state(instance, &states[i]));
        TEST_ASSERT_NULL(states[i]);
    }
}

/* A handle is used again, and its process is another one; slots of those that have ended, too: many more than there are. */
static void test_handles_and_slots_are_used_again(void) {
    fmi2FMUstate state = NULL;
    fmi2FMUstate first = NULL;
    double next = 0.0;
    for (int i = 0; i < 300; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &state));
        first = first == NULL ? state : first;
        TEST_ASSERT_EQUAL_PTR(first, state);
        next = step(i);
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.set_fmu_state(instance, state));
        steps--;
        TEST_ASSERT_EQUAL_DOUBLE(next, step(i));
    }
}

static void test_no_more_than_there_are(void) {
    fmi2FMUstate states[SNAPSHOTS + BESIDE + 1] = {NULL};
    for (int i = 0; i < SNAPSHOTS + BESIDE; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &states[i]));
    }
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(fmi2Error, fmu.guard.functions.get_fmu_state(instance, &states[SNAPSHOTS + BESIDE]));
    expect_said("more than 28 snapshots");
    TEST_ASSERT_NULL(states[SNAPSHOTS + BESIDE]);
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.free_fmu_state(instance, &states[3]));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &states[SNAPSHOTS + BESIDE]));
    (void)step(1.0);
}

static void test_a_snapshot_that_is_killed(void) {
    fmi2FMUstate killed = NULL;
    fmi2FMUstate other = NULL;
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &killed));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &other));
    double next = step(2.0);
    pid_t process = settled_process_in(((const tl_forked_snapshot *)killed)->slot);
    TEST_ASSERT_EQUAL_INT(0, kill(process, SIGKILL));
    TEST_ASSERT_TRUE(is_gone(process));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.set_fmu_state(instance, other));
    steps = 0;
    TEST_ASSERT_EQUAL_DOUBLE(next, step(2.0));
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(fmi2Fatal, fmu.guard.functions.set_fmu_state(instance, killed));
    expect_said("an earlier state of FMU forked has ended: Killed");
}

static void test_the_one_that_goes_on_is_killed(void) {
    fmi2FMUstate state = NULL;
    const fmi2ValueReference y = 1;
    fmi2Real value = 0.0;
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &state));
    pid_t process = settled_process_in(fmu.line->current);
    TEST_ASSERT_EQUAL_INT(0, kill(process, SIGKILL));
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(fmi2Fatal, fmu.guard.functions.get_real(instance, &y, 1, &value));
    expect_said("FMU forked has ended: Killed");
    expect_failure("has lost the process that keeps the state: Killed");
}

static void test_the_keeper_is_killed(void) {
    fmi2FMUstate state = NULL;
    const fmi2ValueReference y = 1;
    fmi2Real value = 0.0;
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &state));
    pid_t snapshot = settled_process_in(((const tl_forked_snapshot *)state)->slot);
    pid_t current = settled_process_in(fmu.line->current);
    TEST_ASSERT_EQUAL_INT(0, kill(fmu.line->keeper, SIGKILL));
    TEST_ASSERT_TRUE(is_gone(snapshot));
    TEST_ASSERT_TRUE(is_gone(current));
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(fmi2Fatal, fmu.guard.functions.get_real(instance, &y, 1, &value));
    expect_said("FMU forked has ended: its process was killed");
}

/* ---- ends of the twin ---- */

static void test_unloaded(void) {
    fmi2FMUstate state = NULL;
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.get_fmu_state(instance, &state));
    pid_t snapshot = settled_process_in(((const tl_forked_snapshot *)state)->slot);
    pid_t current = settled_process_in(fmu.line->current);
    pid_t keeper = fmu.line->keeper;
    tl_fmu_unload(&fmu);
    TEST_ASSERT_TRUE(is_gone(snapshot) && is_gone(current) && is_gone(keeper));
}

/* ---- hostile ones, confined ---- */

static tl_status confine(const void *context, tl_error *error) {
    const char *const folder = getenv("TMPDIR") != NULL ? getenv("TMPDIR") : "/tmp"; /* where it is unpacked */
    const tl_confine_settings settings = {
        .read = &folder, .read_count = 1, .start_socket = -1, .whole_process = true, .forks = true};
    tl_confine_facts facts;
    (void)context;
    return tl_confine(&settings, &facts, NULL, error);
}

/* In the place of an FMU: what its loading does, in its process. */
static pid_t *shared;

enum { BOMB = 300, NOT_THIS_MANY = 1000000 };

static tl_status load_bomb(const char *folder, const char *label, tl_forked_fmu *loaded, tl_error *error) {
    (void)folder, (void)label, (void)loaded;
    struct rlimit most;
    shared[2] = getrlimit(RLIMIT_NPROC, &most) == 0 && most.rlim_max < NOT_THIS_MANY ? 1 : 2;
    shared[1] = fork() >= 0 || kill(getppid(), 0) == 0 || setpgid(0, 0) == 0 || setsid() > 0 ? 1 : 2;
    for (int i = 0; i < BOMB; i++) {
        if (syscall(SYS_clone, 0x8000UL | SIGCHLD, NULL, NULL, NULL, NULL) == 0) { /* CLONE_PARENT */
            for (;;) {
                (void)pause();
            }
        }
        shared[0] = i + 1;
    }
    return tl_fail(error, TL_BAD_DATA, "a bomb");
}

/* Those that do not die with anybody by themselves: the keeper's group. */
static void test_a_bomb_ends_with_the_rest(void) {
    const tl_forked_service service = {.confine = confine, .load = load_bomb};
    tl_error error;
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    shared = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(shared != MAP_FAILED);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_forked_begin(SNAPSHOTS, &service, &error), error.text);
    tl_forked_line *line = tl_forked_take();
    TEST_ASSERT_NOT_NULL(line);
    pid_t keeper = line->keeper;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_forked_load(line, "/", "bomb", "bomb", &error));
    TEST_ASSERT_EQUAL_STRING("a bomb", error.text);
    TEST_ASSERT_EQUAL_INT(BOMB, shared[0]);
    TEST_ASSERT_EQUAL_INT_MESSAGE(2, shared[1], "what is confined has forked, signalled or left its group");
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, shared[2], "it may make processes without end");
    TEST_ASSERT_EQUAL_INT(0, kill(-keeper, 0));
    tl_forked_line_close(line);
    TEST_ASSERT_TRUE(is_gone(-keeper));
    (void)munmap(shared, 4096);
}

static void test_confined(void) {
    tl_fmu_unload(&fmu);
    begin(confine);
    test_any_order();
}

/* A process that began some is killed: none of them is left. */
static void test_the_twin_is_killed(void) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    pid_t *told = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(told != MAP_FAILED);
    TEST_ASSERT_EQUAL_INT(0, prctl(PR_SET_CHILD_SUBREAPER, 1)); /* somebody must reap */
    pid_t twin = fork();
    if (twin == 0) {
        fmi2FMUstate state = NULL;
        begin(confine);
        (void)fmu.guard.functions.get_fmu_state(instance, &state);
        told[1] = settled_process_in(((const tl_forked_snapshot *)state)->slot);
        told[2] = settled_process_in(fmu.line->current);
        __atomic_store_n(&told[0], fmu.line->keeper, __ATOMIC_RELEASE);
        for (;;) {
            (void)pause();
        }
    }
    for (int i = 0; i < 500 && __atomic_load_n(&told[0], __ATOMIC_ACQUIRE) == 0; i++) {
        pause_ms(10);
    }
    TEST_ASSERT_NOT_EQUAL_INT(0, told[0]);
    TEST_ASSERT_EQUAL_INT(0, kill(twin, SIGKILL));
    TEST_ASSERT_EQUAL_INT(twin, waitpid(twin, NULL, 0));
    TEST_ASSERT_TRUE(is_gone(-told[0]));
    (void)munmap(told, 4096);
}

static void test_without_a_process(void) {
    tl_fmu other;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN,
                          tl_fmu_load(TL_BINARY_DIR "/fmus/lag.fmu", -1, TL_ROLLBACK_FORK, &other, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "there is no process for it"));
}

#if defined(__SANITIZE_THREAD__)
#define HAS_THREADS 1 /* of its own, which no fork takes back */
#else
#define HAS_THREADS 0
#endif

int main(void) {
    if (HAS_THREADS != 0 || getenv("TL_EMULATED") != NULL) {
        printf(
            "skipped: the thread sanitizer has a thread of its own, and qemu-user knows no clone() with CLONE_PARENT\n");
        return SKIPPED;
    }
    UNITY_BEGIN();
    RUN_TEST(test_what_a_state_takes);
    RUN_TEST(test_any_order);
    RUN_TEST(test_handles_and_slots_are_used_again);
    RUN_TEST(test_no_more_than_there_are);
    RUN_TEST(test_a_snapshot_that_is_killed);
    RUN_TEST(test_the_one_that_goes_on_is_killed);
    RUN_TEST(test_the_keeper_is_killed);
    RUN_TEST(test_unloaded);
    RUN_TEST(test_a_bomb_ends_with_the_rest);
    RUN_TEST(test_confined);
    RUN_TEST(test_the_twin_is_killed);
    RUN_TEST(test_without_a_process);
    return UNITY_END();
}
