/* The list of system calls, loaded: see filter.h.
 *
 * Each part adds rules to a filter that refuses by default. These functions return 0, or what libseccomp returned (negative, as errno).
 * The kernel takes most arguments as 32 bits, but a filter sees 64 bits, of which the upper ones may be anything. So an
 * allowed value is compared by its lower half (IS), and a number of our own by all of it.
 */
#include "firmware/process/filter.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/netlink.h>
#include <linux/seccomp.h>
#include <netinet/in.h>
#include <sched.h>
#include <seccomp.h>
#include <signal.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <termios.h>
#include <unistd.h>

#include "firmware/process/sanitizer.h"

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* The lower half of argument `n`, under a mask, is `value`. */
#define MASKED(n, mask, value) ((struct scmp_arg_cmp){(n), SCMP_CMP_MASKED_EQ, (mask), (value)})
#define IS(n, value) MASKED(n, UINT32_MAX, (uint32_t)(value))

enum { NAME = 40 };

/* ---- what the kernel has ---- */

static bool has_action(uint32_t action) {
    return syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0;
}

bool tl_filter_is_offered(void) {
    return has_action(SECCOMP_RET_KILL_PROCESS) && has_action(SECCOMP_RET_ERRNO);
}

/* Version 5 of the interface, as libseccomp counts: notifications; 6: also for all threads. */
bool tl_filter_can_notify(void) {
    return tl_filter_is_offered() && has_action(SECCOMP_RET_USER_NOTIF) && seccomp_api_get() >= 6;
}

/* ---- rules ---- */

/* A name that this machine or this libseccomp does not know is skipped: there is no such call to allow. */
static int add_rule(scmp_filter_ctx context, uint32_t action, const char *call, const struct scmp_arg_cmp *conditions,
                    unsigned count) {
    int number = seccomp_syscall_resolve_name(call);
    return number < 0 ? 0 : seccomp_rule_add_array(context, action, number, count, conditions);
}

/* Allows the calls with these names, with blanks between them, whatever their arguments. */
static int allow_all(scmp_filter_ctx context, const char *calls) {
    int failure = 0;
    while (*calls != '\0' && failure == 0) {
        char name[NAME] = "";
        size_t length = strcspn(calls, " ");
        memcpy(name, calls, length < NAME ? length : NAME - 1);
        failure = add_rule(context, SCMP_ACT_ALLOW, name, NULL, 0);
        calls += length;
        calls += strspn(calls, " ");
    }
    return failure;
}

static int allow_one(scmp_filter_ctx context, const char *call, struct scmp_arg_cmp condition) {
    return add_rule(context, SCMP_ACT_ALLOW, call, &condition, 1);
}

static int allow_values(scmp_filter_ctx context, const char *call, unsigned argument, const uint32_t *values,
                        size_t count) {
    int failure = 0;
    for (size_t i = 0; i < count && failure == 0; i++) {
        const struct scmp_arg_cmp condition = IS(argument, values[i]);
        failure = add_rule(context, SCMP_ACT_ALLOW, call, &condition, 1);
    }
    return failure;
}

/* ---- calls that are allowed whatever their arguments ---- */

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
    for (size_t i = 0; i < COUNT(absent) && failure == 0; i++) {
        failure = add_rule(context, SCMP_ACT_ERRNO(ENOSYS), absent[i], NULL, 0);
    }
    for (int number = FIRST_UNKNOWN; number <= LAST_UNKNOWN && failure == 0; number++) {
        failure = seccomp_rule_add(context, SCMP_ACT_ERRNO(ENOSYS), number, 0);
    }
    return failure;
}

static int add_calls(scmp_filter_ctx context, const tl_filter_settings *settings) {
    int failure = add_absent(context);
    for (size_t i = 0; i < COUNT(allowed) && failure == 0; i++) {
        failure = allow_all(context, allowed[i].calls);
    }
    failure = failure != 0 ? failure : allow_all(context, "creat");
    if (settings->removal_holds || settings->keeps_files) {
        failure = failure != 0 ? failure : allow_all(context, "rmdir unlink unlinkat rename renameat renameat2");
    }
    if (settings->keeps_files) { /* SQLite gives the files beside a database the mode and owner of that */
        failure = failure != 0 ? failure : allow_all(context, "fchmod fchown fchown32");
    }
    if (settings->truncation_holds) {
        failure = failure != 0 ? failure : allow_all(context, "truncate truncate64");
    }
    return failure;
}

/* ---- calls of which the arguments decide ---- */

/* What older headers do not have. */
enum {
    CLONE_NEW_CGROUP = 0x02000000,
    CLOSE_APART = 1U << 1, /* CLOSE_RANGE_UNSHARE */
    ACCESS_MODES = 3,
    MAP_KINDS = 0x0f,
    MAP_DROPPABLE_KIND = 8, /* MAP_DROPPABLE, Linux 6.11 */
    QUERY = -1,
    NO_NAME = O_TMPFILE & ~O_DIRECTORY
};

/* Commands as the kernel numbers them: 12 to 14 are those of locks on files of more than 2 GiB, for 32 bits. */
static const uint32_t file_commands[] = {
    F_DUPFD, F_DUPFD_CLOEXEC, F_GETFD,     F_SETFD,      F_GETFL,      F_SETFL,      5,          6, 7, 12, 13,
    14,      F_OFD_GETLK,     F_OFD_SETLK, F_OFD_SETLKW, F_GETPIPE_SZ, F_SETPIPE_SZ, F_GET_SEALS};
static const uint32_t device_commands[] = {FIONREAD, FIONBIO, FIOCLEX, FIONCLEX, TCGETS, TIOCGWINSZ};

/* Which pages of its own memory a process has written, by descriptors from before (fmu_pages.h): PAGEMAP_SCAN, whose order has 96 bytes, and UFFDIO_REGISTER.
 * Neither leads to memory of another process. */
static const uint32_t page_commands[] = {0xc0606610, 0xc020aa00};
static const uint32_t process_commands[] = {
    PR_SET_NAME,        PR_GET_NAME,         PR_GET_DUMPABLE,     PR_GET_PDEATHSIG,
    PR_GET_KEEPCAPS,    PR_GET_SECUREBITS,   PR_CAPBSET_READ,     PR_GET_SECCOMP,
    PR_GET_TIMERSLACK,  PR_SET_TIMERSLACK,   PR_GET_NO_NEW_PRIVS, PR_SET_THP_DISABLE,
    PR_GET_THP_DISABLE, PR_SET_NO_NEW_PRIVS, PR_GET_TID_ADDRESS,  PR_GET_SPECULATION_CTRL,
    PR_SET_VMA};

static int allow_commands(scmp_filter_ctx context) {
    int failure = allow_values(context, "fcntl", 1, file_commands, COUNT(file_commands));
    failure = failure != 0 ? failure : allow_values(context, "fcntl64", 1, file_commands, COUNT(file_commands));
    failure = failure != 0 ? failure : allow_values(context, "ioctl", 1, device_commands, COUNT(device_commands));
    failure = failure != 0 ? failure : allow_values(context, "ioctl", 1, page_commands, COUNT(page_commands));
    failure = failure != 0 ? failure : allow_values(context, "prctl", 0, process_commands, COUNT(process_commands));
    return failure != 0 ? failure : allow_one(context, "personality", IS(0, QUERY));
}

/* A thread, and nothing else: no process, no namespace. It shares descriptors with all others, as those of every C library do: with a table of its
 * own it would have the limit of descriptors once more, and as much memory of the kernel's in pipes. */
static int allow_threads(scmp_filter_ctx context) {
    const uint32_t apart =
        CLONE_NEWNS | CLONE_NEW_CGROUP | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWUSER | CLONE_NEWPID | CLONE_NEWNET;
    const uint32_t shared = CLONE_THREAD | CLONE_FILES | CLONE_FS;
    int failure = allow_one(context, "clone", MASKED(0, shared | apart, shared));
    return failure != 0 ? failure : allow_one(context, "close_range", MASKED(2, CLOSE_APART, 0));
}

/* Memory that is shared and has no file, or grows by itself, does not count as data: it would be a way around the limit.
 * The C library from 2.41 on tries droppable memory for getrandom(). Like an older kernel, the filter refuses it silently. */
static int allow_memory(scmp_filter_ctx context) {
    const struct scmp_arg_cmp droppable = MASKED(3, MAP_ANONYMOUS | MAP_KINDS, MAP_ANONYMOUS | MAP_DROPPABLE_KIND);
    static const char *const calls[] = {"mmap", "mmap2"};
    int failure = 0;
    for (size_t i = 0; i < COUNT(calls) && failure == 0; i++) {
        failure = allow_one(context, calls[i], MASKED(3, MAP_ANONYMOUS | MAP_GROWSDOWN, 0));
        failure = failure != 0
                      ? failure
                      : allow_one(context, calls[i],
                                  MASKED(3, MAP_ANONYMOUS | MAP_GROWSDOWN | MAP_KINDS, MAP_ANONYMOUS | MAP_PRIVATE));
        failure = failure != 0 ? failure : add_rule(context, SCMP_ACT_ERRNO(EINVAL), calls[i], &droppable, 1);
    }
    return failure != 0 ? failure : allow_all(context, "mprotect pkey_mprotect");
}

/* Opening a file by a call whose flags are the argument `flags`. Before ABI 3 Landlock does not look when a file is emptied that is opened for
 * reading, or (access mode 3) for neither. A file without a name counts in no folder: as on a file system that has none. */
static int add_opening(scmp_filter_ctx context, const char *call, unsigned flags, const tl_filter_settings *settings) {
    const uint32_t nameless = settings->keeps_files ? 0 : NO_NAME;
    const struct scmp_arg_cmp named = MASKED(flags, nameless, 0);
    const struct scmp_arg_cmp ways[] = {
        MASKED(flags, O_TRUNC | nameless, 0),
        MASKED(flags, O_TRUNC | ACCESS_MODES | nameless, O_TRUNC | O_WRONLY),
        MASKED(flags, O_TRUNC | ACCESS_MODES | nameless, O_TRUNC | O_RDWR),
    };
    if (settings->truncation_holds) {
        return add_rule(context, SCMP_ACT_ALLOW, call, &named, nameless != 0 ? 1 : 0);
    }
    int failure = 0;
    for (size_t way = 0; way < COUNT(ways) && failure == 0; way++) {
        failure = allow_one(context, call, ways[way]);
    }
    return failure;
}

static int add_files(scmp_filter_ctx context, const tl_filter_settings *settings) {
    const struct scmp_arg_cmp nameless[] = {MASKED(1, NO_NAME, NO_NAME), MASKED(2, NO_NAME, NO_NAME)};
    int failure = add_opening(context, "open", 1, settings);
    failure = failure != 0 ? failure : add_opening(context, "openat", 2, settings);
    if (!settings->keeps_files) {
        failure = failure != 0 ? failure : add_rule(context, SCMP_ACT_ERRNO(EOPNOTSUPP), "open", &nameless[0], 1);
        failure = failure != 0 ? failure : add_rule(context, SCMP_ACT_ERRNO(EOPNOTSUPP), "openat", &nameless[1], 1);
    }
    return failure;
}

/* Signals to its own process; an attempt on another one ends it, but for `lives_on`. Whether another one is there may be asked, in vain. */
static int add_signals(scmp_filter_ctx context, bool lives_on) {
    static const struct {
        const char *call;
        unsigned signal; /* which argument */
    } calls[] = {{"kill", 1}, {"tkill", 1}, {"tgkill", 2}, {"rt_sigqueueinfo", 1}, {"rt_tgsigqueueinfo", 2}};
    const uint64_t own = (uint64_t)getpid();
    int failure = 0;
    for (size_t i = 0; i < COUNT(calls) && failure == 0; i++) {
        const struct scmp_arg_cmp other[] = {{0, SCMP_CMP_NE, own, 0}, {calls[i].signal, SCMP_CMP_NE, 0, 0}};
        failure = allow_one(context, calls[i].call, (struct scmp_arg_cmp){0, SCMP_CMP_EQ, own, 0});
        if (!lives_on && failure == 0) {
            failure = add_rule(context, SCMP_ACT_KILL_PROCESS, calls[i].call, other, COUNT(other));
        }
    }
    return failure;
}

/* Of the thread that calls, or of this process: 0. */
static int allow_own(scmp_filter_ctx context) {
    static const char *const calls[] = {"sched_setscheduler", "sched_setparam", "sched_setattr", "sched_setaffinity",
                                        "prlimit64"};
    int failure = 0;
    for (size_t i = 0; i < COUNT(calls) && failure == 0; i++) {
        failure = allow_one(context, calls[i], IS(0, 0));
    }
    return failure;
}

#if TL_HAS_SANITIZER
/* The search for leaks stops all threads from a process that shares our memory, which traces us, and dies with us. */
static int add_tracing(scmp_filter_ctx context, bool lives_on) {
    static const uint32_t commands[] = {PR_SET_DUMPABLE, PR_SET_PTRACER, PR_SET_PDEATHSIG};
    int failure = allow_all(context, "ptrace");
    (void)lives_on;
    failure = failure != 0 ? failure : allow_one(context, "clone", MASKED(0, CLONE_VM | CLONE_THREAD, CLONE_VM));
    return failure != 0 ? failure : allow_values(context, "prctl", 0, commands, COUNT(commands));
}
#else
static int add_tracing(scmp_filter_ctx context, bool lives_on) {
    const struct scmp_arg_cmp other = {0, SCMP_CMP_NE, PTRACE_TRACEME, 0};
    return lives_on ? 0 : add_rule(context, SCMP_ACT_KILL_PROCESS, "ptrace", &other, 1);
}
#endif

static int add_arguments(scmp_filter_ctx context, const tl_filter_settings *settings) {
    int (*const parts[])(scmp_filter_ctx) = {allow_commands, allow_threads, allow_memory, allow_own};
    int failure = 0;
    for (size_t i = 0; i < COUNT(parts) && failure == 0; i++) {
        failure = parts[i](context);
    }
    failure = failure != 0 ? failure : add_signals(context, settings->lives_on);
    failure = failure != 0 ? failure : add_tracing(context, settings->lives_on);
    failure = failure != 0 ? failure : add_files(context, settings);
    if (settings->start_socket >= 0) {
        failure = failure != 0 ? failure : allow_one(context, "sendmsg", IS(0, settings->start_socket));
    }
    return failure;
}

/* ---- what a driver of a plant needs besides, to connect again ---- */

/* A filter sees numbers, not memory: addresses and the flags of a GPIO request are unseen. So each kind of source allows only its own
 * sockets and device commands. Landlock binds TCP to ports. It checks connect() only, and plain TCP only. So two ways around it are refused here:
 * other protocols of the same socket type (MPTCP, SCTP), and connecting by sending (MSG_FASTOPEN). */

enum { SOCKET_KINDS = 0x0f }; /* of sockets: the rest are flags */

static const char tcp_calls[] = "connect shutdown getsockname getpeername getsockopt setsockopt recv recvfrom";

static const tl_plant_socket tcp_sockets[] = {
    {AF_INET, SOCK_STREAM, 0},
    {AF_INET, SOCK_STREAM, IPPROTO_TCP},
    {AF_INET6, SOCK_STREAM, 0},
    {AF_INET6, SOCK_STREAM, IPPROTO_TCP},
};

/* The look-up of names also needs what TCP does. Netlink tells which addresses this machine has itself. */
static const tl_plant_socket name_sockets[] = {
    {AF_INET, SOCK_DGRAM, 0},
    {AF_INET, SOCK_DGRAM, IPPROTO_UDP},
    {AF_INET6, SOCK_DGRAM, 0},
    {AF_INET6, SOCK_DGRAM, IPPROTO_UDP},
    {AF_NETLINK, SOCK_RAW, NETLINK_ROUTE},
};
static const uint32_t name_commands[] = {SIOCGIFINDEX};
static const tl_plant_access names_access = {
    .calls = "recvmsg",
    .sockets = name_sockets,
    .socket_count = COUNT(name_sockets),
    .address_bytes = sizeof(struct sockaddr_nl),
    .commands = name_commands,
    .command_count = COUNT(name_commands),
};
static const tl_plant_access tcp_access = {
    .calls = tcp_calls, .sockets = tcp_sockets, .socket_count = COUNT(tcp_sockets)};

/* Sending on a connection has no address; looking names up gives one, but for TCP. */
static int add_sending(scmp_filter_ctx context, bool names) {
    const struct scmp_arg_cmp connected[] = {MASKED(3, MSG_FASTOPEN, 0), {4, SCMP_CMP_EQ, 0, 0}};
    const struct scmp_arg_cmp flags_2 = MASKED(2, MSG_FASTOPEN, 0);
    const struct scmp_arg_cmp flags_3 = MASKED(3, MSG_FASTOPEN, 0);
    int failure = add_rule(context, SCMP_ACT_ALLOW, "send", &flags_3, 1);
    if (!names) {
        return failure != 0 ? failure : add_rule(context, SCMP_ACT_ALLOW, "sendto", connected, COUNT(connected));
    }
    failure = failure != 0 ? failure : add_rule(context, SCMP_ACT_ALLOW, "sendto", &flags_3, 1);
    failure = failure != 0 ? failure : add_rule(context, SCMP_ACT_ALLOW, "sendmsg", &flags_2, 1);
    return failure != 0 ? failure : add_rule(context, SCMP_ACT_ALLOW, "sendmmsg", &flags_3, 1);
}

/* All of `access` but TCP. Nobody can listen, so bind() to an address of that length does no harm elsewhere. */
static int add_access(scmp_filter_ctx context, const tl_plant_access *access) {
    const struct scmp_arg_cmp size = IS(2, access->address_bytes);
    int failure = access->calls != NULL ? allow_all(context, access->calls) : 0;
    if (failure == 0 && access->address_bytes != 0) {
        failure = add_rule(context, SCMP_ACT_ALLOW, "bind", &size, 1);
    }
    for (size_t i = 0; i < access->socket_count && failure == 0; i++) {
        const tl_plant_socket *one = &access->sockets[i];
        const struct scmp_arg_cmp conditions[] = {IS(0, one->family), MASKED(1, SOCKET_KINDS, (uint32_t)one->type),
                                                  IS(2, one->protocol)};
        failure = add_rule(context, SCMP_ACT_ALLOW, "socket", conditions, COUNT(conditions));
    }
    for (size_t i = 0; i < access->command_count && failure == 0; i++) {
        const struct scmp_arg_cmp command = IS(1, access->commands[i]);
        failure = add_rule(context, SCMP_ACT_ALLOW, "ioctl", &command, 1);
    }
    return failure;
}

static int add_driver(scmp_filter_ctx context, const tl_plant_access *plant, bool names) {
    /* A thread of a source is an ordinary one, whoever starts it (os.h). */
    const struct scmp_arg_cmp ordinary = IS(1, SCHED_OTHER);
    int failure = add_rule(context, SCMP_ACT_ALLOW, "sched_setscheduler", &ordinary, 1);
    failure = failure != 0 ? failure : add_access(context, plant);
    if (failure == 0 && (plant->tcp || names)) {
        failure = add_access(context, &tcp_access);
        failure = failure != 0 ? failure : add_sending(context, names);
    }
    return failure == 0 && names ? add_access(context, &names_access) : failure;
}

/* ---- what a server on the network needs besides, which listens already ---- */

/* It accepts, and connects to local sockets: a new socket is a local one, so that it reaches nobody else. It makes memory that it hands over. */
static int add_server(scmp_filter_ctx context) {
    const struct scmp_arg_cmp local = IS(0, AF_UNIX);
    const struct scmp_arg_cmp seal = IS(1, F_ADD_SEALS);
    int failure = allow_all(context, "accept accept4 connect shutdown getsockname getpeername getsockopt "
                                     "setsockopt send sendto sendmsg recv recvfrom recvmsg memfd_create");
    failure = failure != 0 ? failure : add_rule(context, SCMP_ACT_ALLOW, "socket", &local, 1);
    failure = failure != 0 ? failure : add_rule(context, SCMP_ACT_ALLOW, "fcntl", &seal, 1);
    return failure != 0 ? failure : add_rule(context, SCMP_ACT_ALLOW, "fcntl64", &seal, 1);
}

/* ---- load ---- */

static int set_attributes(scmp_filter_ctx context, const tl_filter_settings *settings) {
    const struct {
        enum scmp_filter_attr attribute;
        uint32_t value;
    } attributes[] = {
        {SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS},
        {SCMP_FLTATR_CTL_NNP, 1},
        {SCMP_FLTATR_CTL_TSYNC, settings->whole_process ? 1 : 0},
        {SCMP_FLTATR_CTL_SSB, 1}, /* FMUs run as fast as without: they do not defend themselves against each other */
        {SCMP_FLTATR_CTL_OPTIMIZE, 2}, /* a binary tree by the numbers of calls */
        {SCMP_FLTATR_API_SYSRAWRC, 1}, /* what the kernel says, not "it failed" */
    };
    int failure = 0;
    for (size_t i = 0; i < COUNT(attributes) && failure == 0; i++) {
        failure = seccomp_attr_set(context, attributes[i].attribute, attributes[i].value);
    }
    return failure;
}

/* 0, or a negative number as errno. */
static int load(const tl_filter_settings *settings, uint32_t refuse, int *listener) {
    scmp_filter_ctx context = seccomp_init(refuse);
    if (context == NULL) {
        return -ENOMEM;
    }
    int failure = set_attributes(context, settings);
    failure = failure != 0 ? failure : add_calls(context, settings);
    failure = failure != 0 ? failure : add_arguments(context, settings);
    if (settings->plant != NULL) {
        failure = failure != 0 ? failure : add_driver(context, settings->plant, settings->names);
    }
    if (settings->may_answer) {
        failure = failure != 0 ? failure : add_server(context);
    }
    failure = failure != 0 ? failure : seccomp_load(context);
    if (failure == 0 && refuse == SCMP_ACT_NOTIFY) {
        *listener = seccomp_notify_fd(context);
    }
    seccomp_release(context);
    return failure;
}

tl_status tl_filter_load(const tl_filter_settings *settings, int *listener, tl_error *error) {
    int failure = -EBUSY; /* the kernel's word for a second listener, as one of a container's may be there */
    if (listener != NULL) {
        *listener = -1;
        failure = tl_filter_can_notify() ? load(settings, SCMP_ACT_NOTIFY, listener) : failure;
    }
    if (failure == -EBUSY) {
        failure = load(settings, SCMP_ACT_ERRNO(EPERM), NULL);
    }
    return failure == 0
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "the filter of system calls could not be loaded: %s", strerror(-failure));
}
