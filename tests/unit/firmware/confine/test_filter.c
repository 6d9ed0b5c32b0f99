/* The list of system calls, by making them: what is refused, what ends the process, what works. */
#include "firmware/confine/filter.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/sched.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

#include <unity.h>

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
        TEST_IGNORE_MESSAGE("this kernel has no seccomp");
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

static char block[4096]; /* what an argument points at, where it must point at something */

/* Each would be allowed to root, or to who we are, or would say something else than EPERM. */
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
    /* memory that escapes limits, or is somebody else's */
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
    /* other ways into the kernel */
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
    /* who it is */
    {"setuid", SYS_setuid, {0}},
    {"setgid", SYS_setgid, {0}},
    {"setresuid", SYS_setresuid, {-1, -1, -1}},
    {"setresgid", SYS_setresgid, {-1, -1, -1}},
    {"setgroups", SYS_setgroups, {0}},
    {"setfsuid", SYS_setfsuid, {0}},
    {"capset", SYS_capset, {BLOCK, BLOCK}},
    /* files, but for what they hold */
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

/* With a sanitizer these two are its own. */
static bool is_for_sanitizer(const call *made) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    return made->number == SYS_ptrace || (made->number == SYS_prctl && (made->arguments[0] == PR_SET_DUMPABLE ||
                                                                        made->arguments[0] == PR_SET_PTRACER));
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

static void what_is_not_on_the_list_is_refused_and_named(void) {
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

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "tl_filter");
    RUN_TEST(what_is_not_on_the_list_is_refused_and_named);
    return tl_scratch_finish(&scratch, UNITY_END());
}
