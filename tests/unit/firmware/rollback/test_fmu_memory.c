/* Copies of an FMU's memory as its states: any order, bit by bit; and resources that no copy
 * restores. Uses an unmodified FMU. */
#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <fenv.h>
#include <glob.h>
#include <limits.h>
#include <malloc.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/timerfd.h>
#include <sys/wait.h>
#include <threads.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/fmu/fmu_store.h"
#include "firmware/rollback/fmu_memory.h"
#include "tests/support/message.h"

enum { SKIPPED = 77, STATES = 8 };

static tl_fmu fmu;
static fmi2Component instance;
static int64_t steps;

static void begin(void) {
    tl_error error;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TL_OK, tl_fmu_load(TL_BINARY_DIR "/fmus/cylinder.fmu", -1, TL_ROLLBACK_MEMORY, &fmu, &error), error.text);
    const tl_fmi2 *fmi = &fmu.guard.functions;
    instance = fmi->instantiate("memory", fmi2CoSimulation, fmu.model.guid, fmu.resources, &fmu.guard.callbacks,
                                fmi2False, fmi2False);
    TEST_ASSERT_NOT_NULL(instance);
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->setup_experiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->enter_initialization_mode(instance));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->exit_initialization_mode(instance));
    steps = 0;
}

void setUp(void) {
    begin();
}

void tearDown(void) {
    fmu.guard.functions.free_instance(instance);
    tl_fmu_unload(&fmu);
}

static const tl_variable *variable_of(const char *name) {
    for (size_t i = 0; i < fmu.model.variable_count; i++) {
        if (strcmp(fmu.model.variables[i].name, name) == 0) {
            return &fmu.model.variables[i];
        }
    }
    TEST_FAIL_MESSAGE(name);
    return NULL;
}

/* Returns a weighted sum of all Real outputs and locals, which differs between states. */
static double look(void) {
    double sum = 0.0;
    for (size_t i = 0; i < fmu.model.variable_count; i++) {
        const tl_variable *variable = &fmu.model.variables[i];
        fmi2ValueReference reference = variable->reference;
        fmi2Real value = 0.0;
        if (variable->type == TL_REAL && (variable->causality == TL_OUTPUT || variable->causality == TL_LOCAL) &&
            fmu.guard.functions.get_real(instance, &reference, 1, &value) == fmi2OK) {
            sum += value * (double)(i + 1);
        }
    }
    return sum;
}

static double step(bool forward) {
    fmi2ValueReference reference = variable_of("move_out")->reference;
    fmi2Boolean value = forward ? fmi2True : fmi2False;
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.set_boolean(instance, &reference, 1, &value));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmu.guard.functions.do_step(instance, 0.005 * (double)steps++, 0.005, fmi2False));
    return look();
}

static void save(void **state) {
    tl_error error;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_fmu_memory_save(fmu.guard.memory, state, &error), error.text);
}

static void test_any_order(void) {
    static const int order[] = {3, 0, 7, 7, 1, 6, 2, 5, 4, 0};
    void *states[STATES] = {NULL};
    double next[STATES];
    for (int i = 0; i < STATES; i++) {
        save(&states[i]);
        next[i] = step(i % 3 != 0);
    }
    for (size_t i = 0; i < sizeof order / sizeof order[0]; i++) {
        tl_fmu_memory_restore(fmu.guard.memory, states[order[i]]);
        steps = order[i];
        double again = step(order[i] % 3 != 0);
        TEST_ASSERT_EQUAL_MEMORY(&next[order[i]], &again, sizeof again);
        (void)step(true);
    }
    for (int i = 0; i < STATES; i++) {
        tl_fmu_memory_forget(states[i]);
    }
}

static void test_by_the_function_table(void) {
    const tl_fmi2 *fmi = &fmu.guard.functions;
    fmi2FMUstate state = NULL;
    TEST_ASSERT_EQUAL_INT(TL_ROLLBACK_MEMORY, tl_fmu_rollback(&fmu));
    TEST_ASSERT_NULL(fmi->serialize_fmu_state);
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->get_fmu_state(instance, &state));
    double first = step(true);
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->set_fmu_state(instance, state));
    steps = 0;
    TEST_ASSERT_EQUAL_DOUBLE(first, step(true));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->free_fmu_state(instance, &state));
    TEST_ASSERT_NULL(state);
}

/* By the function table, as in a twin: the cycle allocates no state. */
static void test_what_is_reserved_is_enough(void) {
    const tl_fmi2 *fmi = &fmu.guard.functions;
    fmi2FMUstate states[STATES] = {NULL};
    int64_t saved_at[STATES] = {0};
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->get_fmu_state(instance, &states[0]));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->reserve_states(instance, STATES - 1));
    size_t given_out = mallinfo2().uordblks;
    for (int i = 0; i < 1000; i++) {
        (void)step(i % 7 < 4);
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->get_fmu_state(instance, &states[i % STATES]));
        saved_at[i % STATES] = steps;
        int back = i < STATES ? i / 2 : i * 5 % STATES;
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->set_fmu_state(instance, states[back]));
        steps = saved_at[back];
        TEST_ASSERT_EQUAL_size_t(given_out, mallinfo2().uordblks);
    }
    for (int i = 0; i < STATES; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->free_fmu_state(instance, &states[i]));
    }
}

/* Later allocations of the FMU need a larger state. */
static void test_a_state_that_is_used_again_grows(void) {
    void *state = NULL;
    save(&state);
    const void *before = state;
    save(&state);
    TEST_ASSERT_EQUAL_PTR(before, state);
    size_t size = tl_fmu_memory_size(fmu.guard.memory);
    tl_fmu_memory_enter(fmu.guard.memory);
    unsigned char *more = malloc(100000);
    memset(more, 3, 100000);
    tl_fmu_memory_leave(fmu.guard.memory);
    size_t grown = tl_fmu_memory_size(fmu.guard.memory);
    save(&state);
    tl_fmu_memory_enter(fmu.guard.memory);
    memset(more, 4, 100000);
    tl_fmu_memory_leave(fmu.guard.memory);
    tl_fmu_memory_restore(fmu.guard.memory, state);
    TEST_ASSERT_EQUAL_UINT8(3, more[99999]);
    free(more);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(size + 100000, grown);
    tl_fmu_memory_forget(state);
}

/* A small FMU, then a large one, whose states consist of pages. */
static void test_memory_with_the_same_bits(void) {
    static unsigned char *block; /* static: compilers assume that other functions read it */
    static unsigned char *more;
    tl_fmu_memory *memory = fmu.guard.memory;
    for (size_t size = 100; size <= 200000; size += 199900) {
        void *state = NULL;
        tl_fmu_memory_enter(memory);
        block = calloc(size, 1);
        tl_fmu_memory_leave(memory);
        save(&state);
        TEST_ASSERT_TRUE(tl_fmu_memory_is_same(memory, state));
        block[size - 1] ^= 1;
        TEST_ASSERT_FALSE(tl_fmu_memory_is_same(memory, state));
        block[size - 1] ^= 1;
        TEST_ASSERT_TRUE(tl_fmu_memory_is_same(memory, state));
        unsigned char *data = memory->regions.place[0].begin;
        data[0] ^= 1;
        TEST_ASSERT_FALSE(tl_fmu_memory_is_same(memory, state));
        data[0] ^= 1;
        tl_fmu_memory_enter(memory);
        more = malloc(30000);
        tl_fmu_memory_leave(memory);
        TEST_ASSERT_FALSE(tl_fmu_memory_is_same(memory, state));
        tl_fmu_memory_restore(memory, state);
        TEST_ASSERT_TRUE(more != NULL && tl_fmu_memory_is_same(memory, state));
        free(block);
        tl_fmu_memory_forget(state);
    }
}

/* A block that is freed between two calls is allocated again after a restore, also if no call came
 * between. */
static void test_a_block_that_is_freed_between_calls(void) {
    void *state = NULL;
    tl_fmu_memory_enter(fmu.guard.memory);
    unsigned char *block = malloc(200000); /* large: by pages */
    TEST_ASSERT_NOT_NULL(block);
    memset(block, 3, 200000);
    tl_fmu_memory_leave(fmu.guard.memory);
    for (int time = 0; time < 3; time++) {
        save(&state);
        tl_fmu_heap_release(fmu.guard.memory->heap, block); /* as free() does */
        tl_fmu_memory_restore(fmu.guard.memory, state);
        TEST_ASSERT_EACH_EQUAL_UINT8(3, block, 200000);
        tl_fmu_memory_enter(fmu.guard.memory);
        unsigned char *other = malloc(200000);
        free(other);
        tl_fmu_memory_leave(fmu.guard.memory);
        TEST_ASSERT_TRUE(other != block);
        tl_fmu_memory_restore(fmu.guard.memory, state);
    }
    free(block);
    tl_fmu_memory_forget(state);
}

/* Floating-point exceptions of the FMU and of the program are separate. */
static void test_exceptions_are_its_own(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    (void)feclearexcept(FE_ALL_EXCEPT);
    tl_fmu_memory_enter(memory);
    (void)feclearexcept(FE_ALL_EXCEPT);
    (void)feraiseexcept(FE_DIVBYZERO);
    tl_fmu_memory_leave(memory);
    void *state = NULL;
    save(&state);
    (void)feclearexcept(FE_ALL_EXCEPT);
    (void)feraiseexcept(FE_OVERFLOW);
    tl_fmu_memory_enter(memory);
    TEST_ASSERT_EQUAL_INT(FE_DIVBYZERO, fetestexcept(FE_DIVBYZERO | FE_OVERFLOW));
    (void)feclearexcept(FE_ALL_EXCEPT);
    tl_fmu_memory_leave(memory);
    tl_fmu_memory_enter(memory);
    TEST_ASSERT_EQUAL_INT(0, fetestexcept(FE_DIVBYZERO));
    tl_fmu_memory_leave(memory);
    tl_fmu_memory_restore(memory, state);
    tl_fmu_memory_enter(memory);
    TEST_ASSERT_EQUAL_INT(FE_DIVBYZERO, fetestexcept(FE_DIVBYZERO | FE_OVERFLOW));
    tl_fmu_memory_leave(memory);
    tl_fmu_memory_forget(state);
}

/* ---- resources that no copy restores ---- */

static void expect_left(const char *parts) {
    void *state = NULL;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_fmu_memory_save(fmu.guard.memory, &state, &error));
    TL_EXPECT_PARTS(parts, error.text);
    TEST_ASSERT_NULL(state);
}

static void *wait_on(void *pipe) {
    char byte = 0;
    (void)!read(*(int *)pipe, &byte, 1);
    return NULL;
}

static void test_a_thread(void) {
    int pipes[2];
    pthread_t thread;
    TEST_ASSERT_EQUAL_INT(0, pipe(pipes));
    tl_fmu_memory_enter(fmu.guard.memory);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, wait_on, &pipes[0]));
    tl_fmu_memory_leave(fmu.guard.memory);
    expect_left("thread");
    TEST_ASSERT_EQUAL_INT(0, close(pipes[1]));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_INT(0, close(pipes[0]));
}

static void *do_nothing(void *context) {
    return context;
}

/* The allocations of the thread are in no heap. */
static void test_a_thread_that_ends_within_the_call(void) {
    pthread_t thread;
    tl_fmu_memory_enter(fmu.guard.memory);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, do_nothing, NULL));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    tl_fmu_memory_leave(fmu.guard.memory);
    expect_left("thread");
}

static void test_a_file(void) {
    tl_fmu_memory_enter(fmu.guard.memory);
    int file = open("/dev/null", O_RDONLY | O_CLOEXEC);
    tl_fmu_memory_leave(fmu.guard.memory);
    TEST_ASSERT_EQUAL_INT(0, close(file));
    expect_left("open file");
}

static void test_a_process(void) {
    tl_fmu_memory_enter(fmu.guard.memory);
    pid_t child = fork();
    if (child == 0) {
        (void)pause();
        _exit(0);
    }
    tl_fmu_memory_leave(fmu.guard.memory);
    expect_left("process");
    (void)kill(child, SIGKILL);
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, NULL, 0));
}

static void copy_file(const char *from_path, const char *to_path) {
    char bytes[4096];
    size_t count = 0;
    FILE *from = fopen(from_path, "rb");
    FILE *to = fopen(to_path, "wb");
    TEST_ASSERT_TRUE(from != NULL && to != NULL);
    while ((count = fread(bytes, 1, sizeof bytes, from)) > 0) {
        TEST_ASSERT_EQUAL_size_t(count, fwrite(bytes, 1, count, to));
    }
    TEST_ASSERT_EQUAL_INT(0, fclose(from) + fclose(to));
}

/* Opens a copy of the FMU's binary under another name. Its data is in no earlier state.
 * Tries each binary, because only one is for this machine. `in_call`: by a call of the FMU. */
static void *open_late_library(const char *name, bool in_call) {
    char pattern[PATH_MAX];
    char late[PATH_MAX];
    void *opened = NULL;
    glob_t found;
    (void)snprintf(pattern, sizeof pattern, "%s/binaries/*/cylinder.so", fmu.guard.memory->folder);
    (void)snprintf(late, sizeof late, "%s/%s", fmu.guard.memory->folder, name);
    TEST_ASSERT_EQUAL_INT(0, glob(pattern, 0, NULL, &found));
    for (size_t i = 0; i < found.gl_pathc && opened == NULL; i++) {
        copy_file(found.gl_pathv[i], late);
        tl_fmu_heap *heap = in_call ? fmu.guard.memory->heap : NULL;
        (void)tl_fmu_libc_enter(heap);
        opened = dlopen(late, RTLD_NOW | RTLD_LOCAL);
        (void)tl_fmu_libc_enter(NULL);
    }
    globfree(&found);
    TEST_ASSERT_NOT_NULL(opened);
    return opened;
}

/* A state from before the library was opened restores its data as they were after opening, a later
 * one as they were then. */
static void test_a_library_that_is_opened_late(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    void *before = NULL;
    void *after = NULL;
    save(&before);
    size_t known = memory->regions.count;
    TEST_ASSERT_NOT_NULL(open_late_library("late.so", true));
    TEST_ASSERT_GREATER_THAN_UINT64(known, memory->regions.count);
    TEST_ASSERT_TRUE(tl_fmu_memory_has_new_library(memory, before));
    unsigned char *data = memory->regions.place[known].begin;
    unsigned char first = data[0];
    data[0]++;
    save(&after);
    TEST_ASSERT_FALSE(tl_fmu_memory_has_new_library(memory, after));
    data[0]++;
    TEST_ASSERT_NULL(tl_fmu_memory_obstacle(memory, before));
    tl_fmu_memory_restore(memory, before);
    TEST_ASSERT_EQUAL_UINT8(first, data[0]);
    tl_fmu_memory_restore(memory, after);
    TEST_ASSERT_EQUAL_UINT8((unsigned char)(first + 1), data[0]);
    tl_fmu_memory_forget(before);
    tl_fmu_memory_forget(after);
}

static void close_library(void *library) {
    (void)tl_fmu_libc_enter(fmu.guard.memory->heap);
    TEST_ASSERT_EQUAL_INT(0, dlclose(library));
    (void)tl_fmu_libc_enter(NULL);
}

/* States without the library stay valid. States that contain it do not, also if it is opened again.
 */
static void test_a_library_that_is_opened_and_closed(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    void *before = NULL;
    void *inside = NULL;
    save(&before);
    size_t known = memory->regions.count;
    for (int round = 0; round < 3; round++) {
        void *library = open_late_library("closed.so", true);
        TEST_ASSERT_GREATER_THAN_UINT64(known, memory->regions.count);
        TEST_ASSERT_TRUE(inside == NULL || tl_fmu_memory_obstacle(memory, inside) != NULL);
        save(&inside);
        close_library(library);
        TEST_ASSERT_EQUAL_UINT64(known, memory->regions.count);
        TL_EXPECT_PARTS("closed|library", tl_fmu_memory_obstacle(memory, inside));
        TEST_ASSERT_NULL(tl_fmu_memory_obstacle(memory, before));
        tl_fmu_memory_restore(memory, before);
    }
    save(&inside);
    TEST_ASSERT_NULL(tl_fmu_memory_obstacle(memory, inside));
    tl_fmu_memory_forget(before);
    tl_fmu_memory_forget(inside);
}

/* All states contain it, so no copy is possible any more. */
static void test_a_library_that_states_contain_is_closed(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    void *state = NULL;
    void *first = open_late_library("first.so", true);
    void *last = open_late_library("last.so", true);
    save(&state);
    close_library(first);
    TL_EXPECT_PARTS("closed|library", tl_fmu_memory_obstacle(memory, state));
    tl_fmu_memory_forget(state);
    expect_left("closed|library");
    close_library(last);
}

/* Its contents after opening are not known, so an earlier state cannot be restored. */
static void test_a_library_that_no_call_has_opened(void) {
    void *before = NULL;
    void *after = NULL;
    save(&before);
    TEST_ASSERT_NOT_NULL(open_late_library("unknown.so", false));
    close_library(dlopen(NULL, RTLD_NOW)); /* closes nothing */
    save(&after);
    TEST_ASSERT_NOT_NULL(tl_fmu_memory_obstacle(fmu.guard.memory, before));
    TEST_ASSERT_NULL(tl_fmu_memory_obstacle(fmu.guard.memory, after));
    tl_fmu_memory_forget(before);
    tl_fmu_memory_forget(after);
}

static FILE *stream;
static DIR *folder;

static int open_stream(void) {
    stream = fopen("/dev/null", "re");
    return fileno(stream);
}

static int open_other_file(void) {
    stream = freopen("/dev/null", "we", fopen("/dev/null", "re"));
    return fileno(stream);
}

static int open_temporary(void) {
    stream = tmpfile();
    return fileno(stream);
}

static int open_clock(void) {
    return timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC);
}

static int open_folder(void) {
    folder = opendir("/");
    return dirfd(folder);
}

static int close_stream(int descriptor) {
    (void)descriptor;
    return fclose(stream);
}

static int close_folder(int descriptor) {
    (void)descriptor;
    return closedir(folder);
}

static int open_by_pipe(void) {
    int ends[2];
    TEST_ASSERT_EQUAL_INT(0, pipe2(ends, O_CLOEXEC));
    (void)close(ends[0]);
    return ends[1];
}

static int open_by_name(void) {
    return open("/dev/null", O_RDONLY | O_CLOEXEC);
}

static int open_in_folder(void) {
    return openat(AT_FDCWD, "/dev/null", O_RDONLY | O_CLOEXEC);
}

static int open_copy(void) {
    return dup(STDERR_FILENO);
}

static int open_event(void) {
    return eventfd(0, EFD_CLOEXEC);
}

static int open_second_copy(void) {
    return dup2(STDERR_FILENO, TL_FMU_HEAP_DESCRIPTORS - 1);
}

static int open_copy_without_inheritance(void) {
    return fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0);
}

static int open_sockets(void) {
    int ends[2];
    TEST_ASSERT_EQUAL_INT(0, socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends));
    (void)close(ends[0]);
    return ends[1];
}

static int open_epoll(void) {
    return epoll_create1(EPOLL_CLOEXEC);
}

/* After the calls that are watched: what a call opens must be closed in it. */
static void test_a_descriptor_that_is_opened_late(void) {
    static const struct {
        int (*open)(void);
        int (*close)(int descriptor);
    } kinds[] = {{open_by_name, close},
                 {open_in_folder, close},
                 {open_stream, close_stream},
                 {open_other_file, close_stream},
                 {open_temporary, close_stream},
                 {open_clock, close},
                 {open_folder, close_folder},
                 {open_by_pipe, close},
                 {open_copy, close},
                 {open_event, close},
                 {open_sockets, close},
                 {open_epoll, close},
                 {open_second_copy, close},
                 {open_copy_without_inheritance, close}};
    tl_fmu_memory *memory = fmu.guard.memory;
    while (memory->calls_to_check > 0) {
        tl_fmu_memory_enter(memory);
        tl_fmu_memory_leave(memory);
    }
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        tl_fmu_memory_enter(memory);
        int closed = kinds[i].close(kinds[i].open());
        tl_fmu_memory_leave(memory);
        TEST_ASSERT_EQUAL_INT(0, closed);
        TEST_ASSERT_NULL(tl_fmu_memory_side_effect(memory));
        tl_fmu_memory_enter(memory);
        int descriptor = kinds[i].open();
        tl_fmu_memory_leave(memory);
        expect_left("file|socket");
        TEST_ASSERT_EQUAL_INT(0, kinds[i].close(descriptor));
        memory->side_effect[0] = '\0';
    }
    TEST_ASSERT_FALSE(memory->heap->writes_files);
}

/* It may stay open. */
static void test_a_file_that_is_written(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    void *state = NULL;
    memory->calls_to_check = 0;
    tl_fmu_memory_enter(memory);
    int file = open("/tmp", O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600);
    tl_fmu_memory_leave(memory);
    TEST_ASSERT_TRUE(memory->heap->writes_files);
    save(&state);
    tl_fmu_memory_forget(state);
    TEST_ASSERT_EQUAL_INT(0, close(file));
}

static FILE *open_in_call(const char *path, const char *mode, const char *text) {
    tl_fmu_memory_enter(fmu.guard.memory);
    FILE *opened = fopen(path, mode);
    TEST_ASSERT_NOT_NULL(opened);
    TEST_ASSERT_EQUAL_INT(0, setvbuf(opened, NULL, _IOLBF, 0));
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, fputs(text, opened));
    tl_fmu_memory_leave(fmu.guard.memory);
    return opened;
}

static int close_in_call(FILE *opened) {
    tl_fmu_memory_enter(fmu.guard.memory);
    int failed = fclose(opened);
    tl_fmu_memory_leave(fmu.guard.memory);
    return failed;
}

static void expect_content(const char *path, const char *wanted) {
    char found[64] = "";
    FILE *file = fopen(path, "r");
    TEST_ASSERT_NOT_NULL(file);
    (void)!fread(found, 1, sizeof found - 1, file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_STRING(wanted, found);
}

/* Opened after a state, which is restored: the C library's list of streams stays valid, and no
 * descriptor is lost. A state that contains the stream stays valid. */
static void test_a_log_that_stays_open(void) {
    char path[] = "/tmp/twinlock-log-XXXXXX";
    tl_fmu_memory *memory = fmu.guard.memory;
    void *before = NULL;
    void *inside = NULL;
    TEST_ASSERT_EQUAL_INT(0, close(mkstemp(path)));
    memory->calls_to_check = 0;
    save(&before);
    FILE *log = open_in_call(path, "a", "1\n");
    for (int i = 0; i < 3; i++) {
        tl_fmu_memory_restore(memory, before);
        TEST_ASSERT_EQUAL_PTR(log, open_in_call(path, "a", "2\n"));
        TEST_ASSERT_EQUAL_INT(0, fflush(NULL));
    }
    expect_content(path, "1\n2\n2\n2\n");
    FILE *other = open_in_call("/dev/null", "a", "");
    TEST_ASSERT_TRUE(other != log);
    TEST_ASSERT_EQUAL_INT(0, close_in_call(other)); /* no state contains it */
    save(&inside);
    TEST_ASSERT_EQUAL_INT(0, close_in_call(log)); /* the state contains it, so it stays open */
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, fcntl(fileno(log), F_GETFD));
    tl_fmu_memory_restore(memory, inside);
    tl_fmu_memory_restore(memory, before);
    FILE *emptied = open_in_call(path, "w", "3\n");
    TEST_ASSERT_TRUE(emptied != log);
    tl_fmu_memory_restore(memory, before);
    TEST_ASSERT_EQUAL_PTR(emptied, open_in_call(path, "w", "4\n"));
    expect_content(path, "4\n");
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    FILE *again = open_in_call(path, "a", "5\n"); /* another file */
    TEST_ASSERT_TRUE(again != log);
    expect_content(path, "5\n");
    TEST_ASSERT_NULL(tl_fmu_memory_side_effect(memory));
    tl_fmu_memory_forget(before);
    tl_fmu_memory_forget(inside);
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
}

/* Then one that stays open is no longer covered. */
static void test_more_logs_than_are_noted(void) {
    FILE *logs[TL_FMU_HEAP_LOGS + 1];
    fmu.guard.memory->calls_to_check = 0;
    for (int i = 0; i <= TL_FMU_HEAP_LOGS; i++) {
        TEST_ASSERT_NULL(tl_fmu_memory_side_effect(fmu.guard.memory));
        logs[i] = open_in_call("/dev/null", "w", "");
    }
    expect_left("open file");
    for (int i = 0; i <= TL_FMU_HEAP_LOGS; i++) {
        TEST_ASSERT_EQUAL_INT(0, close_in_call(logs[i]));
    }
}

/* The descriptor of a log may have been that of a file that the call has closed. */
static void test_a_log_with_the_number_of_a_closed_file(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    memory->calls_to_check = 0;
    tl_fmu_memory_enter(memory);
    int first = open("/dev/null", O_RDONLY | O_CLOEXEC);
    (void)close(first);
    FILE *log = fopen("/dev/null", "ae");
    tl_fmu_memory_leave(memory);
    TEST_ASSERT_EQUAL_INT(first, fileno(log));
    TEST_ASSERT_NULL(tl_fmu_memory_side_effect(memory));
    TEST_ASSERT_EQUAL_INT(0, close_in_call(log));
}

/* Each of them leaves something that a rollback does not undo. */
static void test_folders_and_names_that_are_changed(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    char place[] = "/tmp/twinlock-test-XXXXXX";
    char file[64];
    char moved[64];
    memory->calls_to_check = 0;
    TEST_ASSERT_NOT_NULL(mkdtemp(place));
    (void)snprintf(file, sizeof file, "%s/file", place);
    (void)snprintf(moved, sizeof moved, "%s/moved", place);
    for (int kind = 0; kind < 7; kind++) {
        memory->heap->writes_files = false;
        tl_fmu_memory_enter(memory);
        int made = kind == 0   ? creat(file, S_IRUSR | S_IWUSR)
                   : kind == 1 ? rename(file, moved)
                   : kind == 2 ? unlink(moved)
                   : kind == 3 ? mkdir(file, S_IRWXU)
                   : kind == 4 ? renameat(AT_FDCWD, file, AT_FDCWD, moved)
                   : kind == 5 ? rmdir(moved)
                               : mkdirat(AT_FDCWD, file, S_IRWXU);
        tl_fmu_memory_leave(memory);
        TEST_ASSERT_TRUE(made >= 0);
        TEST_ASSERT_TRUE_MESSAGE(memory->heap->writes_files, kind == 0 ? "creat" : "another");
        if (kind == 0) {
            TEST_ASSERT_EQUAL_INT(0, close(made));
        }
    }
    TEST_ASSERT_EQUAL_INT(0, remove(file));
    TEST_ASSERT_EQUAL_INT(0, rmdir(place));
}

static void test_environment_that_is_changed(void) {
    static char pair[] = "TWINLOCK_TEST=2";
    tl_fmu_memory *memory = fmu.guard.memory;
    for (int kind = 0; kind < 3; kind++) {
        memory->heap->changes_environment = false;
        tl_fmu_memory_enter(memory);
        int failed = kind == 0 ? setenv("TWINLOCK_TEST", "1", 1) : kind == 1 ? putenv(pair) : unsetenv("TWINLOCK_TEST");
        tl_fmu_memory_leave(memory);
        TEST_ASSERT_EQUAL_INT(0, failed);
        TEST_ASSERT_TRUE(memory->heap->changes_environment);
    }
    TEST_ASSERT_NULL(getenv("TWINLOCK_TEST"));
}

static int run_nothing(void *context) {
    (void)context;
    return 0;
}

static void notify_nothing(union sigval value) {
    (void)value;
}

/* The C library starts them itself. */
static void test_threads_that_are_not_started_by_posix(void) {
    tl_fmu_heap *heap = fmu.guard.memory->heap;
    struct sigevent event = {.sigev_notify = SIGEV_THREAD, .sigev_notify_function = notify_nothing};
    thrd_t thread;
    timer_t timer;
    tl_fmu_memory_enter(fmu.guard.memory);
    int started = thrd_create(&thread, run_nothing, NULL);
    tl_fmu_memory_leave(fmu.guard.memory);
    TEST_ASSERT_EQUAL_INT(thrd_success, started);
    TEST_ASSERT_EQUAL_INT(thrd_success, thrd_join(thread, NULL));
    TEST_ASSERT_TRUE(heap->has_threads);
    heap->has_threads = false;
    tl_fmu_memory_enter(fmu.guard.memory);
    started = timer_create(CLOCK_MONOTONIC, &event, &timer);
    tl_fmu_memory_leave(fmu.guard.memory);
    TEST_ASSERT_EQUAL_INT(0, started);
    TEST_ASSERT_EQUAL_INT(0, timer_delete(timer));
    TEST_ASSERT_TRUE(heap->has_threads);
    heap->has_threads = false;
}

/* An allocator that reserves addresses, and makes them usable as needed. */
static void try_protected(int protection) {
    tl_fmu_memory *memory = fmu.guard.memory;
    const size_t size = 1 << 20;
    tl_fmu_memory_enter(memory);
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *own = mmap(NULL, size, protection, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    tl_fmu_memory_leave(memory);
    TEST_ASSERT_TRUE(own != MAP_FAILED);
    TEST_ASSERT_NULL(tl_fmu_memory_side_effect(memory));
    tl_fmu_memory_enter(memory);
    int failed = mprotect(own, size, PROT_READ | PROT_WRITE);
    tl_fmu_memory_leave(memory);
    TEST_ASSERT_EQUAL_INT(0, failed);
    expect_left("memory");
    memory->heap->has_outside_memory = false;
    TEST_ASSERT_EQUAL_INT(0, munmap(own, size));
}

/* Values of keys are restored; a key that was created later is deleted. */
static void test_memory_that_is_made_writable(void) {
    try_protected(PROT_NONE);
    try_protected(PROT_READ);
}

static void test_thread_specific_values(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    int values[2] = {0};
    pthread_key_t key;
    pthread_key_t later;
    void *state = NULL;
    tl_fmu_memory_enter(memory);
    TEST_ASSERT_EQUAL_INT(0, pthread_key_create(&key, NULL));
    (void)pthread_setspecific(key, &values[0]);
    tl_fmu_memory_leave(memory);
    save(&state);
    for (int i = 0; i < 2000; i++) { /* more than a process can have */
        tl_fmu_memory_enter(memory);
        (void)pthread_setspecific(key, &values[1]);
        TEST_ASSERT_EQUAL_INT(0, pthread_key_create(&later, NULL));
        (void)pthread_setspecific(later, &values[1]);
        tl_fmu_memory_leave(memory);
        tl_fmu_memory_restore(memory, state);
        TEST_ASSERT_EQUAL_PTR(&values[0], pthread_getspecific(key));
    }
    tl_fmu_memory_enter(memory);
    TEST_ASSERT_EQUAL_INT(0, pthread_key_delete(key));
    tl_fmu_memory_leave(memory);
    expect_left("memory");
    tl_fmu_memory_forget(state);
}

static void test_thread_specific_values_of_c11(void) {
    tl_fmu_memory *memory = fmu.guard.memory;
    int values[2] = {0};
    tss_t key;
    void *state = NULL;
    tl_fmu_memory_enter(memory);
    TEST_ASSERT_EQUAL_INT(thrd_success, tss_create(&key, NULL));
    (void)tss_set(key, &values[0]);
    tl_fmu_memory_leave(memory);
    save(&state);
    (void)tss_set(key, &values[1]);
    tl_fmu_memory_restore(memory, state);
    TEST_ASSERT_EQUAL_PTR(&values[0], tss_get(key));
    tl_fmu_memory_enter(memory);
    tss_delete(key);
    tl_fmu_memory_leave(memory);
    expect_left("memory");
    tl_fmu_memory_forget(state);
}

static void fail_to_find(bool reads) {
    tl_fmu_memory_enter(fmu.guard.memory);
    TEST_ASSERT_NULL(dlsym(RTLD_DEFAULT, "no_such_function"));
    const char *text = reads ? dlerror() : "";
    tl_fmu_memory_leave(fmu.guard.memory);
    TEST_ASSERT_NOT_NULL(text);
}

/* The C library has its address. After a restore, it must not free or change the FMU's memory. */
static void test_an_error_of_the_loader(void) {
    enum { SIZE = 24, COUNT = 8 };
    tl_fmu_memory *memory = fmu.guard.memory;
    for (int i = 0; i < 4; i++) {
        unsigned char *blocks[COUNT];
        void *state = NULL;
        if (i >= 2) {
            fail_to_find(i % 2 == 0);
        }
        save(&state);
        fail_to_find(i % 2 == 0);
        tl_fmu_memory_restore(memory, state);
        tl_fmu_memory_enter(memory);
        for (int k = 0; k < COUNT; k++) {
            blocks[k] = malloc(SIZE);
            TEST_ASSERT_NOT_NULL(blocks[k]);
            memset(blocks[k], k + 1, SIZE);
        }
        tl_fmu_memory_leave(memory);
        fail_to_find(true);
        fail_to_find(false);
        for (int k = 0; k < COUNT; k++) {
            TEST_ASSERT_EACH_EQUAL_UINT8(k + 1, blocks[k], SIZE);
            free(blocks[k]);
        }
        tl_fmu_memory_forget(state);
    }
}

/* It has its own allocator. */
static void test_a_library_in_another_namespace(void) {
    tl_fmu_memory_enter(fmu.guard.memory);
    void *library = dlmopen(LM_ID_NEWLM, "libm.so.6", RTLD_NOW | RTLD_LOCAL);
    tl_fmu_memory_leave(fmu.guard.memory);
    TEST_ASSERT_NOT_NULL(library);
    expect_left("memory");
    TEST_ASSERT_EQUAL_INT(0, dlclose(library));
}

static void test_a_temporary_file(void) {
    char path[] = "/tmp/twinlock-temporary-XXXXXX";
    fmu.guard.memory->calls_to_check = 0;
    tl_fmu_memory_enter(fmu.guard.memory);
    int descriptor = mkstemp(path);
    tl_fmu_memory_leave(fmu.guard.memory);
    expect_left("open file");
    TEST_ASSERT_EQUAL_INT(0, close(descriptor));
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
}

int main(void) {
    if (!tl_fmu_libc_serves()) {
        printf("skipped: not with a sanitizer\n");
        return SKIPPED;
    }
    UNITY_BEGIN();
    RUN_TEST(test_what_is_reserved_is_enough);
    RUN_TEST(test_any_order);
    RUN_TEST(test_by_the_function_table);
    RUN_TEST(test_a_state_that_is_used_again_grows);
    RUN_TEST(test_memory_with_the_same_bits);
    RUN_TEST(test_a_block_that_is_freed_between_calls);
    RUN_TEST(test_exceptions_are_its_own);
    RUN_TEST(test_a_thread);
    RUN_TEST(test_a_thread_that_ends_within_the_call);
    RUN_TEST(test_a_file);
    RUN_TEST(test_a_process);
    RUN_TEST(test_a_library_that_is_opened_late);
    RUN_TEST(test_a_library_that_is_opened_and_closed);
    RUN_TEST(test_a_library_that_states_contain_is_closed);
    RUN_TEST(test_a_library_that_no_call_has_opened);
    RUN_TEST(test_a_descriptor_that_is_opened_late);
    RUN_TEST(test_a_file_that_is_written);
    RUN_TEST(test_a_log_that_stays_open);
    RUN_TEST(test_more_logs_than_are_noted);
    RUN_TEST(test_a_log_with_the_number_of_a_closed_file);
    RUN_TEST(test_folders_and_names_that_are_changed);
    RUN_TEST(test_environment_that_is_changed);
    RUN_TEST(test_threads_that_are_not_started_by_posix);
    RUN_TEST(test_memory_that_is_made_writable);
    RUN_TEST(test_thread_specific_values);
    RUN_TEST(test_thread_specific_values_of_c11);
    RUN_TEST(test_an_error_of_the_loader);
    RUN_TEST(test_a_library_in_another_namespace);
    RUN_TEST(test_a_temporary_file);
    return UNITY_END();
}
