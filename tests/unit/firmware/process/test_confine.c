/* The whole sandbox: facts, limits, user, and third-party code that still runs in it. */
#include "firmware/process/confine.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "tests/support/confined.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

enum { MEGABYTE = 1024 * 1024, NOBODY = 65534 };

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/lsan_interface.h>
#endif

static tl_scratch scratch;
static tl_confined confined;
static char text[TL_CONFINE_TEXT];

void setUp(void) {}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

static tl_confine_settings settings(void) {
    return (tl_confine_settings){.folder = scratch.folder, .whole_process = true};
}

/* ---- facts ---- */

static bool do_nothing(void *context) {
    return context == NULL;
}

static void the_result_equals_the_probed_facts(void) {
    tl_confine_facts offered;
    tl_confine_probe(&offered);
    tl_confined_run(settings(), do_nothing, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    TEST_ASSERT_EQUAL_INT(offered.filter, confined.facts.filter);
    TEST_ASSERT_EQUAL_INT(offered.notifies, confined.facts.notifies);
    TEST_ASSERT_EQUAL_INT(offered.landlock, confined.facts.landlock);
    TEST_ASSERT_FALSE(confined.facts.memory); /* not requested */
    TEST_ASSERT_FALSE(confined.facts.user);
}

static void missing_protection_is_described(void) {
    tl_confine_facts facts = {.filter = true, .notifies = true, .landlock = 2, .memory = true};
    tl_confine_describe(&facts, text);
    TEST_ASSERT_EQUAL_STRING("", text);
    facts.landlock = 0;
    tl_confine_describe(&facts, text);
    TL_EXPECT_PARTS("Landlock|/proc/PID/mem", text);
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "seccomp"));
    facts.user = true;
    tl_confine_describe(&facts, text);
    TL_EXPECT_PARTS("Landlock|user", text);
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "/proc/PID/mem"));
    facts = (tl_confine_facts){0};
    tl_confine_describe(&facts, text);
    TL_EXPECT_PARTS("Landlock|/proc/PID/mem|seccomp|sockets|memory|limit", text);
    facts = (tl_confine_facts){.filter = true, .landlock = 1, .memory = true};
    tl_confine_describe(&facts, text);
    TL_EXPECT_PARTS("seccomp|notifications", text);
    TEST_ASSERT_FALSE(tl_test_has_parts(text, "Landlock"));
}

static void a_missing_folder_is_an_error(void) {
    tl_confine_facts facts;
    tl_error error;
    const tl_confine_settings wrong = {.folder = "/none/at/all", .start_socket = -1};
    TEST_ASSERT_EQUAL_INT(TL_BAD_USAGE, tl_confine(&wrong, &facts, NULL, &error));
    TL_EXPECT_PARTS("/none/at/all|No such file", error.text);
}

/* ---- limits ---- */

static bool is_emulated(void) {
    return getenv("TL_EMULATOR") != NULL; // NOLINT(concurrency-mt-unsafe): the only thread
}

static bool take_memory(void *context) {
    const void *const failed = MAP_FAILED; /* also the error of sbrk() */
    size_t megabytes = 0;
    (void)context;
    while (megabytes < 512 && sbrk(MEGABYTE) != failed) {
        megabytes++;
    }
    void *reserved = mmap(NULL, (size_t)512 * MEGABYTE, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, 0, 0);
    struct rlimit more = {RLIM_INFINITY, RLIM_INFINITY};
    return TL_EXPECT(megabytes >= 32 && megabytes <= 128) &&
           TL_EXPECT(reserved != MAP_FAILED) && /* address space does not count */
           TL_EXPECT(mprotect(reserved, (size_t)512 * MEGABYTE, PROT_READ | PROT_WRITE) == -1 && errno == ENOMEM) &&
           TL_EXPECT(setrlimit(RLIMIT_DATA, &more) == -1 && errno == EPERM);
}

static void memory_has_a_limit(void) {
    tl_confine_settings how = settings();
    tl_confine_facts offered;
    tl_confine_probe(&offered);
    if (!offered.memory || is_emulated()) {
        TEST_IGNORE_MESSAGE("not with a sanitizer or an emulator");
    }
    how.memory = (uint64_t)128 * MEGABYTE;
    tl_confined_run(how, take_memory, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    TEST_ASSERT_TRUE(confined.facts.memory);
}

static bool see_limits(void *context) {
    struct rlimit limit;
    (void)context;
    return TL_EXPECT(getrlimit(RLIMIT_CORE, &limit) == 0 && limit.rlim_max == 0) &&
           TL_EXPECT(getrlimit(RLIMIT_MSGQUEUE, &limit) == 0 && limit.rlim_max == 0) &&
           TL_EXPECT(getrlimit(RLIMIT_STACK, &limit) == 0 && limit.rlim_max != RLIM_INFINITY) &&
           TL_EXPECT(prctl(PR_GET_DUMPABLE) == 0) && TL_EXPECT(prctl(PR_GET_NO_NEW_PRIVS, 0, 0, 0, 0) == 1);
}

static void there_is_no_core_and_no_tracing(void) {
    if (is_emulated()) {
        TEST_IGNORE_MESSAGE("not with an emulator");
    }
    tl_confined_run(settings(), see_limits, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
}

/* Descriptors and timers take memory of the kernel. */
static bool take_descriptors_and_timers(void *context) {
    struct sigevent quiet = {.sigev_notify = SIGEV_NONE};
    timer_t timer = NULL;
    int descriptors = 0;
    int timers = 0;
    (void)context;
    while (descriptors < 2000 && fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0) >= 0) {
        descriptors++;
    }
    bool few = TL_EXPECT(descriptors >= 256 && descriptors < 1000 && errno == EMFILE);
    while (timers < 2000 && timer_create(CLOCK_MONOTONIC, &quiet, &timer) == 0) {
        timers++;
    }
    return few && TL_EXPECT(timers > 0 && timers <= 256 && errno == EAGAIN);
}

/* A high descriptor that is open already does not reduce the limit. */
static void descriptors_and_timers_have_a_limit(void) {
    if (is_emulated()) {
        TEST_IGNORE_MESSAGE("not with an emulator");
    }
    int high = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 500);
    tl_confined_run(settings(), take_descriptors_and_timers, NULL, &confined);
    (void)close(high);
    TEST_ASSERT_TRUE(high >= 500);
    TEST_ASSERT_TRUE(confined.succeeded);
}

static bool write_too_much(void *context) {
    char block[4096] = "";
    int file = open("file", O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    (void)context;
    for (int i = 0; i < 1000; i++) {
        (void)!write(file, block, sizeof block);
    }
    return true;
}

static void a_file_that_grows_too_long_ends_the_process(void) {
    tl_confine_settings how = settings();
    struct stat status;
    how.file_bytes = MEGABYTE;
    tl_confined_run(how, write_too_much, NULL, &confined);
    TEST_ASSERT_EQUAL_INT(SIGXFSZ, confined.signal);
    TEST_ASSERT_EQUAL_INT(0, stat(tl_scratch_path(&scratch, "file"), &status));
    TEST_ASSERT_EQUAL_INT64(MEGABYTE, status.st_size);
}

/* ---- user ---- */

static bool is_nobody(void *context) {
    uid_t users[3];
    gid_t groups[3];
    char status[4096] = "";
    int file = open("/proc/self/status", O_RDONLY | O_CLOEXEC);
    int own = open("file", O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    int signal = 0;
    (void)context;
    return TL_EXPECT(getresuid(&users[0], &users[1], &users[2]) == 0 && users[0] == NOBODY && users[1] == NOBODY &&
                     users[2] == NOBODY) &&
           TL_EXPECT(getresgid(&groups[0], &groups[1], &groups[2]) == 0 && groups[0] == NOBODY && groups[1] == NOBODY &&
                     groups[2] == NOBODY) &&
           TL_EXPECT(getgroups(0, NULL) == 0) && TL_EXPECT(own >= 0 && close(own) == 0) &&
           TL_EXPECT(file >= 0 && read(file, status, sizeof status - 1) > 0 && close(file) == 0) &&
           TL_EXPECT(strstr(status, "CapPrm:\t0000000000000000") != NULL) &&
           TL_EXPECT(strstr(status, "CapEff:\t0000000000000000") != NULL) &&
           TL_EXPECT(strstr(status, "CapBnd:\t0000000000000000") != NULL) &&
           TL_EXPECT(strstr(status, "CapAmb:\t0000000000000000") != NULL) &&
           TL_EXPECT(prctl(PR_GET_SECUREBITS) == 0xeb) &&
           TL_EXPECT(prctl(PR_GET_PDEATHSIG, &signal) == 0 && signal == SIGKILL);
}

static void root_changes_the_user(void) {
    tl_confine_settings how = settings();
    tl_confine_facts offered;
    tl_confine_probe(&offered);
    if (!offered.user) {
        TEST_IGNORE_MESSAGE("not root");
    }
    TEST_ASSERT_EQUAL_INT(0, chown(scratch.folder, NOBODY, NOBODY));
    how.user = NOBODY;
    tl_confined_run(how, is_nobody, NULL, &confined);
    TEST_ASSERT_EQUAL_INT(0, chown(scratch.folder, getuid(), getgid()));
    TEST_ASSERT_TRUE(confined.succeeded);
    TEST_ASSERT_TRUE(confined.facts.user);
}

/* Without root, a change of the user fails. */
static void only_root_can_change_the_user(void) {
    int status = 0;
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        tl_error error;
        tl_confine_facts facts;
        const tl_confine_settings how = {.start_socket = -1, .user = 1};
        bool good = (getuid() != 0 || setuid(NOBODY) == 0) && tl_confine(&how, &facts, NULL, &error) == TL_TRY_AGAIN &&
                    tl_test_has_parts(error.text, "user|1");
        tl_confine_probe(&facts);
        _exit(good && !facts.user ? EXIT_SUCCESS : EXIT_FAILURE);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
}

static bool has_no_capability(void *context) {
    (void)context;
    return TL_EXPECT(sethostname("x", 1) == -1 && errno == EPERM) &&
           TL_EXPECT(prctl(PR_CAPBSET_READ, 21) == 0 || getuid() != 0); /* CAP_SYS_ADMIN */
}

static void root_that_stays_root_has_no_capability(void) {
    tl_confined_run(settings(), has_no_capability, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
}

/* Installs a filter as systemd does for our unit: @privileged contains capset(). */
static bool refuse_capset(void) {
    struct sock_filter steps[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_capset, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    const struct sock_fprog program = {sizeof steps / sizeof steps[0], steps};
    return (getuid() != 0 || setuid(NOBODY) == 0) && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
           prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

static void a_service_without_rights_is_confined_too(void) {
    tl_confine_facts facts;
    int status = 0;
    tl_confine_probe(&facts);
    if (!facts.filter) {
        TEST_IGNORE_MESSAGE("no seccomp");
    }
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        tl_error error = {TL_OK, ""};
        const tl_confine_settings how = {.start_socket = -1};
        _exit(refuse_capset() && TL_EXPECT(tl_confine(&how, &facts, NULL, &error) == TL_OK) && facts.filter
                  ? EXIT_SUCCESS
                  : EXIT_FAILURE);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
}

/* ---- bombs ---- */

static bool fork_without_end(void *context) {
    (void)context;
    for (int i = 0; i < 1000; i++) {
        if (!TL_EXPECT(fork() == -1 && errno == EPERM)) {
            return false;
        }
    }
    return TL_EXPECT(system("true") != 0); // NOLINT(cert-env33-c,concurrency-mt-unsafe): what an FMU could try
}

static void nothing_forks(void) {
    tl_confine_facts offered;
    tl_confine_probe(&offered);
    if (!offered.filter) {
        TEST_IGNORE_MESSAGE("no seccomp");
    }
    tl_confined_run(settings(), fork_without_end, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
}

/* ---- programs of others ---- */

static bool load_library(void *context) {
    void *library = dlopen("libBrokenLocale.so.1", RTLD_NOW); /* of the C library; not loaded yet */
    (void)context;
    return TL_EXPECT(library != NULL && dlclose(library) == 0);
}

static void a_library_is_loaded(void) {
    tl_confined_run(settings(), load_library, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    TEST_ASSERT_EQUAL_size_t(0, confined.refusal_count);
}

static const char script[] =
    "import sys\n"
    "import json, os, subprocess, tempfile, threading, time, math, ctypes, shutil\n"
    "done = []\n"
    "threads = [threading.Thread(target=lambda: done.append(json.loads('[1]'))) for _ in range(4)]\n"
    "[t.start() for t in threads]\n"
    "[t.join() for t in threads]\n"
    "assert done == [[1]] * 4\n"
    "with tempfile.TemporaryDirectory() as folder:\n"
    "    assert folder.startswith(os.environ['TMPDIR'])\n"
    "    with open(folder + '/file', 'w') as file: file.write('text')\n"
    "with tempfile.TemporaryFile() as file: file.write(b'text')\n"
    "time.sleep(0.001)\n"
    "os.cpu_count(), os.getcwd(), os.listdir('.'), os.urandom(8)\n"
    "try:\n"
    "    subprocess.run(['true'])\n"
    "    sys.exit('a program was started')\n"
    "except OSError:\n"
    "    pass\n";

static void *library; /* stays open until the end of the process */

static bool run_interpreter(void *context) {
    void (*initialise)(int) = NULL;
    int (*run)(const char *, void *) = NULL;
    (void)context;
    library = dlopen("libpython3.11.so.1.0", RTLD_NOW | RTLD_GLOBAL);
    if (library != NULL) {
        *(void **)&initialise = dlsym(library, "Py_InitializeEx");
        *(void **)&run = dlsym(library, "PyRun_SimpleStringFlags");
    }
    if (initialise == NULL || run == NULL) {
        return TL_EXPECT(false);
    }
    initialise(0);
    return TL_EXPECT(run(script, NULL) == 0);
}

/* Asks in another process, because the confined one must load the library itself. */
static bool has_interpreter(void) {
    int status = -1;
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        library = dlopen("libpython3.11.so.1.0", RTLD_LAZY);
        _exit(library != NULL ? EXIT_SUCCESS : EXIT_FAILURE);
    }
    return waitpid(child, &status, 0) == child && status == 0;
}

/* Only the start of a program is refused. */
static void an_interpreter_runs(void) {
    if (!has_interpreter()) {
        TEST_IGNORE_MESSAGE("no libpython3.11");
    }
    tl_confined_run(settings(), run_interpreter, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    for (size_t i = 0; i < confined.refusal_count; i++) {
        const char *name = confined.refusals[i].name;
        TEST_ASSERT_TRUE_MESSAGE(strcmp(name, "clone") == 0 || strcmp(name, "vfork") == 0 || strcmp(name, "fork") == 0,
                                 name);
    }
}

#if defined(__SANITIZE_ADDRESS__)
static bool look_for_leaks(void *context) {
    (void)context;
    return TL_EXPECT(__lsan_do_recoverable_leak_check() == 0);
}

static void leaks_are_checked(void) {
    tl_confined_run(settings(), look_for_leaks, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
}
#endif

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "tl_confine");
    RUN_TEST(the_result_equals_the_probed_facts);
    RUN_TEST(missing_protection_is_described);
    RUN_TEST(a_missing_folder_is_an_error);
    RUN_TEST(memory_has_a_limit);
    RUN_TEST(there_is_no_core_and_no_tracing);
    RUN_TEST(descriptors_and_timers_have_a_limit);
    RUN_TEST(a_file_that_grows_too_long_ends_the_process);
    RUN_TEST(root_changes_the_user);
    RUN_TEST(only_root_can_change_the_user);
    RUN_TEST(root_that_stays_root_has_no_capability);
    RUN_TEST(a_service_without_rights_is_confined_too);
    RUN_TEST(nothing_forks);
    RUN_TEST(a_library_is_loaded);
    RUN_TEST(an_interpreter_runs);
#if defined(__SANITIZE_ADDRESS__)
    RUN_TEST(leaks_are_checked);
#endif
    return tl_scratch_finish(&scratch, UNITY_END());
}
