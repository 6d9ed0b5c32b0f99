/* The filter of system calls, tested with real calls: refused, fatal and allowed ones. */
#include "firmware/process/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/personality.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/sanitizer.h"
#include "tests/support/confined.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static tl_confined confined;

void setUp(void) {}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

static void need_filter(void) {
    if (!tl_filter_is_offered()) {
        TEST_IGNORE_MESSAGE("no seccomp");
    }
}

static tl_confine_settings settings(void) {
    return (tl_confine_settings){.folder = scratch.folder, .whole_process = true};
}

/* ---- refused ---- */

typedef struct call {
    const char *name;
    long number;
    long arguments[6];
} call;

static char shell[] = "/bin/sh";

#define OWN_FILE ((long)"own")
#define BLOCK ((long)block)

static char block[4096]; /* target of pointer arguments */

/* Without the filter, each of these calls would succeed or fail with an error other than EPERM. */
static const call refused[] = {
    /* the network */
    {"socket", SYS_socket, {AF_INET, SOCK_STREAM}},
    {"socket", SYS_socket, {AF_UNIX, SOCK_STREAM}},
    {"socket", SYS_socket, {AF_NETLINK, SOCK_RAW}},
    {"socketpair", SYS_socketpair, {AF_UNIX, SOCK_STREAM, 0, BLOCK}},
    {"connect", SYS_connect, {0, BLOCK, 16}},
    {"bind", SYS_bind, {0, BLOCK, 16}},
    {"listen", SYS_listen, {0, 1}},
    {"accept4", SYS_accept4, {0, 0, 0, 0}},
    {"sendto", SYS_sendto, {0, BLOCK, 1}},
    {"sendmsg", SYS_sendmsg, {0, BLOCK, 0}},
    {"sendmsg", SYS_sendmsg, {2, BLOCK, 0}},
    {"sendmmsg", SYS_sendmmsg, {0, BLOCK, 1}},
    {"recvfrom", SYS_recvfrom, {0, BLOCK, 1}},
    {"recvmsg", SYS_recvmsg, {0, BLOCK, 0}},
    {"setsockopt", SYS_setsockopt, {0, SOL_SOCKET, SO_KEEPALIVE, BLOCK, 4}},
    /* memory without limits, or of other processes */
    {"memfd_create", SYS_memfd_create, {BLOCK, 0}},
    {"userfaultfd", SYS_userfaultfd, {0}},
    {"process_vm_readv", SYS_process_vm_readv, {1, BLOCK, 1, BLOCK, 1}},
    {"process_vm_writev", SYS_process_vm_writev, {1, BLOCK, 1, BLOCK, 1}},
    {"process_madvise", 440, {0}},
    {"move_pages", SYS_move_pages, {1, 0, 0, 0, 0, 0}},
    {"shmget", SYS_shmget, {0, 4096, 01600}},
    {"semget", SYS_semget, {0, 1, 01600}},
    {"msgget", SYS_msgget, {0, 01600}},
    {"mq_open", SYS_mq_open, {BLOCK, O_RDONLY}},
    /* other interfaces of the kernel */
    {"io_uring_setup", 425, {1, BLOCK}},
    {"bpf", SYS_bpf, {0}},
    {"perf_event_open", SYS_perf_event_open, {BLOCK, 0, -1, -1}},
    {"keyctl", SYS_keyctl, {0}},
    {"add_key", SYS_add_key, {BLOCK, BLOCK}},
    {"request_key", SYS_request_key, {BLOCK, BLOCK}},
    {"seccomp", SYS_seccomp, {2, 0, BLOCK}},
    {"io_setup", SYS_io_setup, {1, BLOCK}},
    /* other processes */
    {"pidfd_open", 434, {1}},
    {"pidfd_send_signal", 424, {0}},
    {"pidfd_getfd", 438, {0}},
    {"kcmp", SYS_kcmp, {1, 1, 0}},
    {"setpriority", SYS_setpriority, {PRIO_PROCESS, 0, 1}},
    {"sched_setaffinity", SYS_sched_setaffinity, {1, sizeof block, BLOCK}},
    {"sched_setscheduler", SYS_sched_setscheduler, {1, SCHED_BATCH, BLOCK}},
    {"sched_setparam", SYS_sched_setparam, {1, BLOCK}},
    {"sched_setattr", SYS_sched_setattr, {1, BLOCK}},
    {"prlimit64", SYS_prlimit64, {1, RLIMIT_NOFILE, 0, BLOCK}},
    {"setpgid", SYS_setpgid, {0, 0}},
    {"setsid", SYS_setsid, {0}},
    {"ioprio_set", SYS_ioprio_set, {1, 0, 0}},
    {"ptrace", SYS_ptrace, {PTRACE_TRACEME}},
    /* the machine */
    {"mount", SYS_mount, {BLOCK, BLOCK}},
    {"umount2", SYS_umount2, {BLOCK}},
    {"fsopen", 430, {BLOCK}},
    {"open_tree", 428, {-100, BLOCK}},
    {"move_mount", 429, {-1, BLOCK}},
    {"mount_setattr", 442, {-1, BLOCK}},
    {"unshare", SYS_unshare, {0}},
    {"setns", SYS_setns, {0}},
    {"chroot", SYS_chroot, {(long)"."}},
    {"pivot_root", SYS_pivot_root, {BLOCK, BLOCK}},
    {"reboot", SYS_reboot, {0}},
    {"swapon", SYS_swapon, {BLOCK}},
    {"swapoff", SYS_swapoff, {BLOCK}},
    {"init_module", SYS_init_module, {BLOCK}},
    {"finit_module", SYS_finit_module, {0, BLOCK}},
    {"delete_module", SYS_delete_module, {BLOCK}},
    {"quotactl", SYS_quotactl, {0}},
    {"syslog", SYS_syslog, {10}},
    {"acct", SYS_acct, {0}},
    {"sethostname", SYS_sethostname, {BLOCK, 1}},
    {"clock_settime", SYS_clock_settime, {0, BLOCK}},
    {"clock_adjtime", SYS_clock_adjtime, {0, BLOCK}},
    {"sync", SYS_sync, {0}},
    {"inotify_init1", SYS_inotify_init1, {0}},
    {"fanotify_init", SYS_fanotify_init, {0}},
    {"personality", SYS_personality, {0}},
    /* user and group */
    {"setuid", SYS_setuid, {0}},
    {"setgid", SYS_setgid, {0}},
    {"setresuid", SYS_setresuid, {-1, -1, -1}},
    {"setresgid", SYS_setresgid, {-1, -1, -1}},
    {"setgroups", SYS_setgroups, {0}},
    {"setfsuid", SYS_setfsuid, {0}},
    {"capset", SYS_capset, {BLOCK, BLOCK}},
    /* metadata of files */
    {"fchmod", SYS_fchmod, {2, 0600}},
    {"fchmodat", SYS_fchmodat, {AT_FDCWD, OWN_FILE, 0600}},
    {"fchown", SYS_fchown, {2, -1, -1}},
    {"fchownat", SYS_fchownat, {AT_FDCWD, OWN_FILE, -1, -1}},
    {"utimensat", SYS_utimensat, {AT_FDCWD, OWN_FILE, 0, 0}},
    {"setxattr", SYS_setxattr, {OWN_FILE, BLOCK, BLOCK, 0}},
    {"removexattr", SYS_removexattr, {OWN_FILE, BLOCK}},
    {"mknodat", SYS_mknodat, {AT_FDCWD, OWN_FILE, S_IFIFO | 0600}},
    {"linkat", SYS_linkat, {AT_FDCWD, OWN_FILE, AT_FDCWD, BLOCK}},
    {"symlinkat", SYS_symlinkat, {OWN_FILE, AT_FDCWD, BLOCK}},
    {"name_to_handle_at", SYS_name_to_handle_at, {AT_FDCWD, OWN_FILE, BLOCK, BLOCK}},
    {"open_by_handle_at", SYS_open_by_handle_at, {0, BLOCK}},
#if defined(__x86_64__)
    {"chmod", SYS_chmod, {OWN_FILE, 0600}},
    {"chown", SYS_chown, {OWN_FILE, -1, -1}},
    {"utimes", SYS_utimes, {OWN_FILE, 0}},
    {"mknod", SYS_mknod, {OWN_FILE, S_IFIFO | 0600}},
    {"link", SYS_link, {OWN_FILE, BLOCK}},
    {"symlink", SYS_symlink, {OWN_FILE, BLOCK}},
    {"fork", SYS_fork, {0}},
    {"iopl", SYS_iopl, {0}},
    {"ioperm", SYS_ioperm, {0}},
    {"modify_ldt", SYS_modify_ldt, {0}},
#endif
    /* programs and processes */
    {"execve", SYS_execve, {(long)shell}},
    {"execveat", SYS_execveat, {AT_FDCWD, (long)shell}},
    {"clone", SYS_clone, {SIGCHLD}},
    {"clone", SYS_clone, {CLONE_THREAD | CLONE_VM | CLONE_SIGHAND | CLONE_NEWNS}},
    {"clone", SYS_clone, {CLONE_NEWUSER | SIGCHLD}},
    /* commands */
    {"ioctl", SYS_ioctl, {0, TIOCSTI, BLOCK}},
    {"ioctl", SYS_ioctl, {0, TIOCSCTTY, 0}},
    {"ioctl", SYS_ioctl, {0, 0x5402, BLOCK}}, /* TCSETS */
    {"fcntl", SYS_fcntl, {0, F_SETOWN, 1}},
    {"fcntl", SYS_fcntl, {0, F_SETSIG, 9}},
    {"fcntl", SYS_fcntl, {0, F_SETLEASE, F_RDLCK}},
    {"fcntl", SYS_fcntl, {0, F_NOTIFY, 0}},
    {"prctl", SYS_prctl, {PR_SET_DUMPABLE, 1}},
    {"prctl", SYS_prctl, {PR_SET_PTRACER, 1}},
    {"prctl", SYS_prctl, {PR_SET_PDEATHSIG, 0}},
    {"prctl", SYS_prctl, {PR_SET_SECCOMP, 1}},
    {"prctl", SYS_prctl, {PR_SET_MM, 0}},
    {"prctl", SYS_prctl, {PR_SET_CHILD_SUBREAPER, 1}},
};

enum { REFUSED = sizeof refused / sizeof refused[0] };

/* True if the sanitizer itself needs the call. */
static bool is_for_sanitizer(const call *made) {
#if TL_HAS_SANITIZER
    long first = made->arguments[0];
    return made->number == SYS_ptrace ||
           (made->number == SYS_prctl &&
            (first == PR_SET_DUMPABLE || first == PR_SET_PTRACER || first == PR_SET_PDEATHSIG));
#else
    (void)made;
    return false;
#endif
}

static bool make_refused(void *context) {
    bool good = true;
    (void)context;
    for (size_t i = 0; i < REFUSED; i++) {
        const long *with = refused[i].arguments;
        if (!is_for_sanitizer(&refused[i])) {
            errno = 0;
            long answer = syscall(refused[i].number, with[0], with[1], with[2], with[3], with[4], with[5]);
            good = tl_confined_expect(answer == -1 && errno == EPERM, refused[i].name, (int)i) && good;
        }
    }
    return good;
}

static void other_calls_are_refused_and_named(void) {
    need_filter();
    tl_confined_run(settings(), make_refused, NULL, &confined);
    TEST_ASSERT_EQUAL_INT(0, confined.signal);
    TEST_ASSERT_TRUE(confined.succeeded);
    if (confined.facts.notifies) {
        size_t expected = 0;
        for (size_t i = 0; i < REFUSED; i++) {
            if (!is_for_sanitizer(&refused[i])) {
                TEST_ASSERT_EQUAL_STRING(refused[i].name, confined.refusals[expected++].name);
            }
        }
        TEST_ASSERT_EQUAL_size_t(expected, confined.refusal_count);
    }
}

/* ---- memory ---- */

enum { MAPPED = 1 << 16 };

static bool maps(int flags, int file) {
    void *mapped = mmap(NULL, MAPPED, PROT_READ | PROT_WRITE, flags, file, 0);
    return mapped != MAP_FAILED && munmap(mapped, MAPPED) == 0;
}

static bool map_memory(void *context) {
    int own = open("memory", O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    (void)context;
    return TL_EXPECT(own >= 0 && ftruncate(own, MAPPED) == 0) && TL_EXPECT(maps(MAP_PRIVATE | MAP_ANONYMOUS, 0)) &&
           TL_EXPECT(maps(MAP_SHARED, own)) && TL_EXPECT(maps(MAP_PRIVATE, own)) &&
           TL_EXPECT(maps(MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK | MAP_NORESERVE, 0)) &&
           TL_EXPECT(!maps(MAP_SHARED | MAP_ANONYMOUS, 0) && errno == EPERM) &&
           TL_EXPECT(!maps(MAP_SHARED_VALIDATE | MAP_ANONYMOUS, 0) && errno == EPERM) &&
           TL_EXPECT(!maps(MAP_PRIVATE | MAP_GROWSDOWN, own) && errno == EPERM) &&
           TL_EXPECT(!maps(MAP_PRIVATE | MAP_ANONYMOUS | MAP_GROWSDOWN, 0) && errno == EPERM) &&
           TL_EXPECT(!maps(8 | MAP_ANONYMOUS, 0) && errno == EINVAL); /* MAP_DROPPABLE, which glibc 2.41 tries */
}

static void memory_is_private_or_has_a_file(void) {
    need_filter();
    tl_confined_run(settings(), map_memory, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
}

/* ---- what ends the process ---- */

/* An argument of zero is replaced by the pid of the parent. */
static bool make_call(void *context) {
    const call *made = context;
    const long *with = made->arguments;
    (void)syscall(made->number, with[0] == 0 ? getppid() : with[0], with[1] == 0 ? getppid() : with[1], with[2],
                  with[3], with[4], with[5]);
    return false;
}

static void signals_to_others_end_the_process(void) {
    static const call calls[] = {
        {"kill", SYS_kill, {0, SIGCONT}},
        {"tkill", SYS_tkill, {0, SIGCONT}},
        {"tgkill", SYS_tgkill, {0, 0, SIGCONT}},
        {"rt_sigqueueinfo", SYS_rt_sigqueueinfo, {0, SIGCONT, BLOCK}},
        {"rt_tgsigqueueinfo", SYS_rt_tgsigqueueinfo, {0, 0, SIGCONT, BLOCK}},
    };
    need_filter();
    for (size_t i = 0; i < sizeof calls / sizeof calls[0]; i++) {
        call made = calls[i];
        tl_confined_run(settings(), make_call, &made, &confined);
        TEST_ASSERT_EQUAL_INT_MESSAGE(SIGSYS, confined.signal, made.name);
    }
}

static void tracing_others_ends_the_process(void) {
#if TL_HAS_SANITIZER
    TEST_IGNORE_MESSAGE("not with a sanitizer");
#endif
    call made = {"ptrace", SYS_ptrace, {PTRACE_ATTACH, 0}};
    need_filter();
    tl_confined_run(settings(), make_call, &made, &confined);
    TEST_ASSERT_EQUAL_INT(SIGSYS, confined.signal);
}

static bool ask_for_parent(void *context) {
    (void)context;
    return TL_EXPECT(kill(getppid(), 0) == -1 && errno == EPERM);
}

static void asking_whether_another_process_is_there_is_only_refused(void) {
    need_filter();
    tl_confined_run(settings(), ask_for_parent, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
}

#if defined(__x86_64__)
static bool call_as_32_bits(void *context) {
    long answer = 20; /* getpid() of 32-bit x86 */
    (void)context;
    __asm__ volatile("int $0x80" : "+a"(answer) : : "memory", "r8", "r9", "r10", "r11");
    return false;
}

static void calls_of_other_machines_end_the_process(void) {
    call made = {"getpid of x32", 0x40000000 + SYS_getpid, {1}};
    need_filter();
    tl_confined_run(settings(), make_call, &made, &confined);
    TEST_ASSERT_EQUAL_INT(SIGSYS, confined.signal);
    tl_confined_run(settings(), call_as_32_bits, NULL, &confined);
    TEST_ASSERT_NOT_EQUAL_INT(0, confined.signal); /* SIGSEGV if the kernel has no 32-bit calls */
}
#endif

/* ---- an older kernel ---- */

static bool make_newer_calls(void *context) {
    static const long numbers[] = {435, 437, 451, 462,
                                   511}; /* clone3, openat2, cachestat, mseal, and an unused number */
    bool good = true;
    (void)context;
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        good = TL_EXPECT(syscall(numbers[i], -1, block, 0, 0) == -1 && errno == ENOSYS) && good;
    }
    return good;
}

static bool make_and_remove(void *context) {
    (void)context;
    int file = open("made", O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    return TL_EXPECT(file >= 0 && close(file) == 0) && TL_EXPECT(rename("made", "renamed") == 0) &&
           TL_EXPECT(unlink("renamed") == 0) && TL_EXPECT(mkdir("folder", 0700) == 0) &&
           TL_EXPECT(rmdir("folder") == 0);
}

static bool fail_to_remove(void *context) {
    (void)context;
    int file = open("made", O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    return TL_EXPECT(file >= 0 && close(file) == 0) && TL_EXPECT(rename("made", "renamed") == -1 && errno == EPERM) &&
           TL_EXPECT(unlink("made") == -1 && errno == EPERM) && TL_EXPECT(rmdir(".") == -1 && errno == EPERM);
}

/* Without Landlock no file can be removed, because nothing limits which ones. */
static void files_are_removed_only_with_landlock(void) {
    tl_confine_facts facts;
    tl_confine_settings how = settings();
    need_filter();
    how.landlock_newest = -1;
    tl_confined_run(how, fail_to_remove, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    tl_confine_probe(&facts);
    if (facts.landlock > 0) {
        tl_confined_run(settings(), make_and_remove, NULL, &confined);
        TEST_ASSERT_TRUE(confined.succeeded);
    }
}

/* A file without a name would escape the limits of the folder. */
static bool make_nameless(void *context) {
    int files[] = {open(".", O_RDWR | O_TMPFILE | O_CLOEXEC, 0600),
                   open(".", O_WRONLY | O_TMPFILE | O_EXCL | O_CLOEXEC, 0600)};
    (void)context;
    return TL_EXPECT(files[0] == -1 && errno == EOPNOTSUPP) && TL_EXPECT(files[1] == -1) &&
#if defined(__x86_64__)
           TL_EXPECT(syscall(SYS_open, ".", O_RDWR | O_TMPFILE, 0600) == -1 && errno == EOPNOTSUPP) &&
#endif
           TL_EXPECT(syscall(SYS_openat, AT_FDCWD, ".", O_RDWR | O_TMPFILE | O_TRUNC, 0600) == -1 &&
                     errno == EOPNOTSUPP);
}

static void files_without_a_name_are_not_there(void) {
    need_filter();
    for (int newest = -1; newest <= 0; newest++) {
        tl_confine_settings how = settings();
        how.landlock_newest = newest;
        tl_confined_run(how, make_nameless, NULL, &confined);
        TEST_ASSERT_TRUE(confined.succeeded);
        TEST_ASSERT_EQUAL_size_t(0, confined.refusal_count);
    }
}

static void newer_calls_are_not_there(void) {
    need_filter();
    tl_confined_run(settings(), make_newer_calls, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    TEST_ASSERT_EQUAL_size_t(0, confined.refusal_count);
}

/* ---- what works ---- */

static volatile sig_atomic_t signalled;

static void note(int signal) {
    signalled = signal;
}

static void *work(void *context) {
    *(int *)context += 1;
    return NULL;
}

static bool use_threads(void *context) {
    pthread_t threads[8];
    int counts[8] = {0};
    bool good = true;
    (void)context;
    for (size_t i = 0; i < 8; i++) {
        good = TL_EXPECT(pthread_create(&threads[i], NULL, work, &counts[i]) == 0) && good;
    }
    for (size_t i = 0; i < 8; i++) {
        good = TL_EXPECT(pthread_join(threads[i], NULL) == 0 && counts[i] == 1) && good;
    }
    return good && TL_EXPECT(signal(SIGUSR1, note) != SIG_ERR) &&
           TL_EXPECT(raise(SIGUSR1) == 0 && signalled == SIGUSR1) && TL_EXPECT(kill(getpid(), SIGUSR1) == 0) &&
           TL_EXPECT(pthread_kill(pthread_self(), SIGUSR1) == 0);
}

static bool use_descriptors(void *context) {
    int pipes[2];
    char letter = 'a';
    struct epoll_event event = {.events = EPOLLIN};
    int poller = epoll_create1(EPOLL_CLOEXEC);
    const int unknown =
        getenv("TL_EMULATOR") != NULL ? ENOSYS : EBADF; /* an emulator checks the request before the descriptor */
    (void)context;
    return TL_EXPECT(pipe2(pipes, O_CLOEXEC) == 0) && TL_EXPECT(write(pipes[1], &letter, 1) == 1) &&
           TL_EXPECT(poller >= 0 && epoll_ctl(poller, EPOLL_CTL_ADD, pipes[0], &event) == 0) &&
           TL_EXPECT(epoll_wait(poller, &event, 1, 1000) == 1) && TL_EXPECT(read(pipes[0], &letter, 1) == 1) &&
           TL_EXPECT(eventfd(0, EFD_CLOEXEC) >= 0) && TL_EXPECT(timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC) >= 0) &&
           TL_EXPECT(fcntl(pipes[0], F_SETFL, O_NONBLOCK) == 0) && TL_EXPECT(ioctl(pipes[0], FIONREAD, &event) == 0) &&
           TL_EXPECT(ioctl(-1, 0xc0606610UL, NULL) == -1 && errno == unknown) && /* PAGEMAP_SCAN */
           TL_EXPECT(ioctl(-1, 0xc020aa00UL, NULL) == -1 && errno == unknown) && /* UFFDIO_REGISTER */
           TL_EXPECT(fcntl(pipes[0], F_DUPFD_CLOEXEC, 0) >= 0) && TL_EXPECT(dup2(pipes[0], 100) == 100) &&
           TL_EXPECT(isatty(pipes[0]) == 0 && errno != EPERM);
}

static bool use_files(void *context) {
    struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    struct stat status;
    int file = open("file", O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    (void)context;
    return TL_EXPECT(file >= 0 && write(file, "12345", 5) == 5 && ftruncate(file, 3) == 0) &&
           TL_EXPECT(fstat(file, &status) == 0 && status.st_size == 3) && TL_EXPECT(fcntl(file, F_SETLK, &lock) == 0) &&
           TL_EXPECT(posix_fallocate(file, 0, 4096) == 0) && TL_EXPECT(fsync(file) == 0) &&
           TL_EXPECT(mkdir("below", 0700) == 0);
}

static bool use_the_system(void *context) {
    struct timespec moment = {0, 1000};
    struct rlimit limit;
    cpu_set_t processors;
    struct sched_param parameter = {0};
    timer_t timer = 0;
    struct sigevent quiet = {.sigev_notify = SIGEV_NONE};
    (void)context;
    return TL_EXPECT(nanosleep(&moment, NULL) == 0) &&
           TL_EXPECT(clock_nanosleep(CLOCK_MONOTONIC, 0, &moment, NULL) == 0) &&
           TL_EXPECT(getrandom(block, 8, 0) == 8) && TL_EXPECT(getrlimit(RLIMIT_NOFILE, &limit) == 0) &&
           TL_EXPECT(setrlimit(RLIMIT_NOFILE, &limit) == 0) &&
           TL_EXPECT(sched_getaffinity(0, sizeof processors, &processors) == 0) &&
           TL_EXPECT(sched_setaffinity(0, sizeof processors, &processors) == 0) &&
           TL_EXPECT(sched_setscheduler(0, SCHED_BATCH, &parameter) == 0) &&
           TL_EXPECT(timer_create(CLOCK_MONOTONIC, &quiet, &timer) == 0 && timer_delete(timer) == 0) &&
           TL_EXPECT(prctl(PR_SET_NAME, "fmu") == 0) && TL_EXPECT(personality(0xffffffff) != -1) &&
           TL_EXPECT(mlock(block, sizeof block) == 0) && TL_EXPECT(sysconf(_SC_NPROCESSORS_ONLN) > 0);
}

/* These calls are allowed, without and with Landlock. */
static void calls_of_ordinary_programs_work(void) {
    tl_confined_body *const bodies[] = {use_threads, use_descriptors, use_files, use_the_system};
    for (size_t i = 0; i < sizeof bodies / sizeof bodies[0]; i++) {
        for (int newest = -1; newest <= 0; newest++) {
            tl_confine_settings how = settings();
            how.landlock_newest = newest;
            tl_confined_run(how, bodies[i], NULL, &confined);
            tl_scratch_empty(&scratch);
            TEST_ASSERT_TRUE(confined.succeeded);
            TEST_ASSERT_EQUAL_size_t(0, confined.refusal_count);
        }
    }
}

/* ---- notifications and threads ---- */

/* Returns the exit code: 0 if a socket is refused without notifications. */
static int be_refused_without_notification(void) {
    tl_error error;
    tl_confine_facts facts;
    tl_confine_settings how = settings();
    how.start_socket = -1;
    return tl_confine(&how, &facts, NULL, &error) == TL_OK && !facts.notifies &&
                   TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_STREAM, 0))
               ? EXIT_SUCCESS
               : EXIT_FAILURE;
}

/* Like a kernel without seccomp notifications. */
static void without_notifications_the_answer_is_the_same(void) {
    int status = 0;
    need_filter();
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        _exit(be_refused_without_notification());
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
}

static bool others_are_refused;
static pthread_barrier_t barrier;

static void *try_socket_later(void *context) {
    (void)pthread_barrier_wait(&barrier);
    others_are_refused = tl_confined_has_no_socket(AF_INET, SOCK_DGRAM, 0);
    return context;
}

/* Confines a process that has a second thread already. Returns the exit code. */
static int confine_beside_thread(bool whole_process) {
    tl_error error;
    tl_confine_facts facts;
    pthread_t other;
    const tl_confine_settings how = {.start_socket = -1, .whole_process = whole_process};
    if (pthread_barrier_init(&barrier, NULL, 2) != 0 || pthread_create(&other, NULL, try_socket_later, NULL) != 0 ||
        tl_confine(&how, &facts, NULL, &error) != TL_OK) {
        return EXIT_FAILURE;
    }
    (void)pthread_barrier_wait(&barrier);
    (void)pthread_join(other, NULL);
    return TL_EXPECT(others_are_refused == whole_process) &&
                   TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_DGRAM, 0))
               ? EXIT_SUCCESS
               : EXIT_FAILURE;
}

static void the_list_holds_for_all_threads_or_for_one(void) {
    need_filter();
    for (int whole = 0; whole <= 1; whole++) {
        int status = 0;
        (void)fflush(NULL);
        pid_t child = fork();
        if (child == 0) {
            _exit(confine_beside_thread(whole == 1));
        }
        TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
        TEST_ASSERT_EQUAL_INT(0, status);
    }
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "tl_filter");
    RUN_TEST(other_calls_are_refused_and_named);
    RUN_TEST(memory_is_private_or_has_a_file);
    RUN_TEST(signals_to_others_end_the_process);
    RUN_TEST(tracing_others_ends_the_process);
    RUN_TEST(asking_whether_another_process_is_there_is_only_refused);
#if defined(__x86_64__)
    RUN_TEST(calls_of_other_machines_end_the_process);
#endif
    RUN_TEST(files_are_removed_only_with_landlock);
    RUN_TEST(files_without_a_name_are_not_there);
    RUN_TEST(newer_calls_are_not_there);
    RUN_TEST(calls_of_ordinary_programs_work);
    RUN_TEST(without_notifications_the_answer_is_the_same);
    RUN_TEST(the_list_holds_for_all_threads_or_for_one);
    return tl_scratch_finish(&scratch, UNITY_END());
}
