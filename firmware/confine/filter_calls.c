/* The calls that are allowed whatever their arguments: see filter.h. */
#include "firmware/confine/filter_parts.h"

#include <errno.h>

/* Why, and which. Calls of all three machines; each takes those that it has. */
typedef struct group {
    const char *reason;
    const char *calls;
} group;

/* clang-format off */
static const group allowed[] = {
    {"what it holds open", "read write readv writev pread64 pwrite64 preadv pwritev preadv2 pwritev2 lseek _llseek close dup dup2 dup3"},
    {"copies between descriptors", "copy_file_range sendfile sendfile64 splice tee vmsplice"},
    {"making files, where Landlock lets it", "mkdir mkdirat"},
    {"files that it has open for writing", "ftruncate ftruncate64 fallocate fsync fdatasync msync sync_file_range arm_sync_file_range"},
    {"advice on reading", "fadvise64 arm_fadvise64_64 readahead"},
    {"looking at files", "stat lstat fstat newfstatat stat64 lstat64 fstat64 fstatat64 statx access faccessat faccessat2 readlink readlinkat"},
    {"looking at attributes", "getxattr lgetxattr fgetxattr listxattr llistxattr flistxattr"},
    {"looking at file systems and folders", "statfs fstatfs statfs64 fstatfs64 getdents getdents64 getcwd chdir fchdir"},
    {"what the process keeps for itself", "umask flock"},
    {"pipes and events within the process", "pipe pipe2 eventfd eventfd2 signalfd signalfd4 timerfd_create timerfd_settime timerfd_settime64 timerfd_gettime timerfd_gettime64"},
    {"waiting for descriptors", "poll ppoll ppoll_time64 select _newselect pselect6 pselect6_time64 epoll_create epoll_create1 epoll_ctl epoll_wait epoll_pwait epoll_pwait2"},
    {"memory of its own", "brk munmap mremap madvise mincore mlock mlock2 munlock mlockall munlockall pkey_alloc pkey_free"},
    {"memory on several nodes", "get_mempolicy set_mempolicy mbind getcpu"},
    {"threads", "futex futex_time64 futex_waitv set_robust_list get_robust_list set_tid_address gettid rseq membarrier exit sched_yield"},
    {"the thread's pointer", "arch_prctl set_tls get_tls"},
    {"caches of new code, where a program must say so", "cacheflush breakpoint"},
    {"its own signals", "rt_sigaction rt_sigprocmask rt_sigreturn sigreturn rt_sigpending rt_sigsuspend rt_sigtimedwait rt_sigtimedwait_time64 sigaltstack pause restart_syscall"},
    {"its own timers", "alarm setitimer getitimer timer_create timer_settime timer_settime64 timer_gettime timer_gettime64 timer_getoverrun timer_delete"},
    {"the time", "time gettimeofday clock_gettime clock_gettime64 clock_getres clock_getres_time64 nanosleep clock_nanosleep clock_nanosleep_time64 times"},
    {"who it is", "getpid getppid getuid geteuid getgid getegid getresuid getresgid getgroups getuid32 geteuid32 getgid32 getegid32 getresuid32 getresgid32 getgroups32 getpgrp getpgid getsid capget"},
    {"what it has used and may use", "getrusage getrlimit ugetrlimit setrlimit"},
    {"what the machine is", "uname sysinfo getrandom"},
    {"how anybody is scheduled", "sched_getaffinity sched_getscheduler sched_getparam sched_getattr sched_get_priority_max sched_get_priority_min sched_rr_get_interval sched_rr_get_interval_time64 getpriority"},
    {"children, of which there are none", "wait4 waitid"},
    {"the end", "exit_group"},
};
/* clang-format on */

/* Newer ways that the C library tries first, whose arguments lie in memory where a filter cannot see them: as if the kernel were older. */
static const char *const absent[] = {"clone3", "openat2"};

/* The first call that this program has not thought of (of Linux 6.5), and one that is long to come: the numbers are those of all machines. A
 * runtime that tries a newer one expects ENOSYS of a kernel that has it not. */
enum { FIRST_UNKNOWN = 451, LAST_UNKNOWN = 511 };

static int add_absent(scmp_filter_ctx context) {
    int failure = 0;
    for (size_t i = 0; i < sizeof absent / sizeof absent[0] && failure == 0; i++) {
        failure = tl_filter_add(context, SCMP_ACT_ERRNO(ENOSYS), absent[i], NULL, 0);
    }
    for (int number = FIRST_UNKNOWN; number <= LAST_UNKNOWN && failure == 0; number++) {
        failure = seccomp_rule_add(context, SCMP_ACT_ERRNO(ENOSYS), number, 0);
    }
    return failure;
}

int tl_filter_add_calls(scmp_filter_ctx context, const tl_filter_settings *settings) {
    int failure = add_absent(context);
    for (size_t i = 0; i < sizeof allowed / sizeof allowed[0] && failure == 0; i++) {
        failure = tl_filter_allow_all(context, allowed[i].calls);
    }
    failure = failure != 0 ? failure : tl_filter_allow_all(context, "creat");
    if (settings->removal_holds || settings->keeps_files) {
        failure =
            failure != 0 ? failure : tl_filter_allow_all(context, "rmdir unlink unlinkat rename renameat renameat2");
    }
    if (settings->keeps_files) { /* SQLite gives the files beside a database the mode and owner of that */
        failure = failure != 0 ? failure : tl_filter_allow_all(context, "fchmod fchown fchown32");
    }
    if (settings->truncation_holds) {
        failure = failure != 0 ? failure : tl_filter_allow_all(context, "truncate truncate64");
    }
    return failure;
}
