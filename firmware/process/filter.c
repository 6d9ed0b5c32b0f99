/* System call filter: builds the list of allowed calls and loads it, see confine.h.
 *
 * Each function adds rules to a filter that refuses all other calls. After the first failure no
 * more rules are added.
 * The kernel uses only the lower 32 bits of most arguments. A filter sees 64 bits, and the upper
 * ones can have any value. So allowed values are compared in the lower half (IS), and our own
 * process ID in all bits.
 */
#include "firmware/process/confine.h"

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

/* The lower half of argument `n`, masked, is `value`. */
#define MASKED(n, mask, value) ((struct scmp_arg_cmp){(n), SCMP_CMP_MASKED_EQ, (mask), (value)})
#define IS(n, value) MASKED(n, UINT32_MAX, (uint32_t)(value))

enum { NAME = 40 };

/* ---- kernel support ---- */

static bool has_action(uint32_t action) {
    return syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0;
}

bool tl_filter_is_offered(void) {
    return has_action(SECCOMP_RET_KILL_PROCESS) && has_action(SECCOMP_RET_ERRNO);
}

/* seccomp_api_get() returns libseccomp's interface level: 5 adds notifications, 6 adds them
 * together with SCMP_FLTATR_CTL_TSYNC (all threads). */
bool tl_filter_can_notify(void) {
    return tl_filter_is_offered() && has_action(SECCOMP_RET_USER_NOTIF) && seccomp_api_get() >= 6;
}

/* ---- rules ---- */

typedef struct rules {
    scmp_filter_ctx context;
    int failure; /* first error of libseccomp: negative errno */
} rules;

/* Skips a name that this machine or this libseccomp does not know, because then the call does not
 * exist. */
static void add_rule(rules *list, uint32_t action, const char *call, const struct scmp_arg_cmp *conditions,
                     unsigned count) {
    int number = seccomp_syscall_resolve_name(call);
    if (number >= 0 && list->failure == 0) {
        list->failure = seccomp_rule_add_array(list->context, action, number, count, conditions);
    }
}

/* Allows calls with any arguments; `calls`: names separated by blanks. */
static void allow_all(rules *list, const char *calls) {
    while (*calls != '\0') {
        char name[NAME] = "";
        size_t length = strcspn(calls, " ");
        memcpy(name, calls, length < NAME ? length : NAME - 1);
        add_rule(list, SCMP_ACT_ALLOW, name, NULL, 0);
        calls += length;
        calls += strspn(calls, " ");
    }
}

static void allow_one(rules *list, const char *call, struct scmp_arg_cmp condition) {
    add_rule(list, SCMP_ACT_ALLOW, call, &condition, 1);
}

static void allow_values(rules *list, const char *call, unsigned argument, const uint32_t *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        allow_one(list, call, IS(argument, values[i]));
    }
}

/* ---- calls that are allowed with any arguments ---- */

/* Calls of all three machines; names that a machine lacks are skipped. */
/* clang-format off */
static const char *const allowed[] = {
    /* open descriptors */ "read write readv writev pread64 pwrite64 preadv pwritev preadv2 pwritev2 lseek _llseek close dup dup2 dup3",
    /* copying between descriptors */ "copy_file_range sendfile sendfile64 splice tee vmsplice",
    /* making files, as Landlock allows */ "mkdir mkdirat",
    /* files that are open for writing */ "ftruncate ftruncate64 fallocate fsync fdatasync msync sync_file_range arm_sync_file_range",
    /* read-ahead hints */ "fadvise64 arm_fadvise64_64 readahead",
    /* status of files */ "stat lstat fstat newfstatat stat64 lstat64 fstat64 fstatat64 statx access faccessat faccessat2 readlink readlinkat",
    /* attributes */ "getxattr lgetxattr fgetxattr listxattr llistxattr flistxattr",
    /* status of file systems, listing of folders */ "statfs fstatfs statfs64 fstatfs64 getdents getdents64 getcwd chdir fchdir",
    /* state of the process */ "umask flock",
    /* pipes and events inside the process */ "pipe pipe2 eventfd eventfd2 signalfd signalfd4 timerfd_create timerfd_settime timerfd_settime64 timerfd_gettime timerfd_gettime64",
    /* waiting for descriptors */ "poll ppoll ppoll_time64 select _newselect pselect6 pselect6_time64 epoll_create epoll_create1 epoll_ctl epoll_wait epoll_pwait epoll_pwait2",
    /* own memory */ "brk munmap mremap madvise mincore mlock mlock2 munlock mlockall munlockall pkey_alloc pkey_free",
    /* NUMA memory */ "get_mempolicy set_mempolicy mbind getcpu",
    /* threads */ "futex futex_time64 futex_waitv set_robust_list get_robust_list set_tid_address gettid rseq membarrier exit sched_yield",
    /* thread pointer */ "arch_prctl set_tls get_tls",
    /* cache flush for new code, on some machines */ "cacheflush breakpoint",
    /* own signals */ "rt_sigaction rt_sigprocmask rt_sigreturn sigreturn rt_sigpending rt_sigsuspend rt_sigtimedwait rt_sigtimedwait_time64 sigaltstack pause restart_syscall",
    /* own timers */ "alarm setitimer getitimer timer_create timer_settime timer_settime64 timer_gettime timer_gettime64 timer_getoverrun timer_delete",
    /* time */ "time gettimeofday clock_gettime clock_gettime64 clock_getres clock_getres_time64 nanosleep clock_nanosleep clock_nanosleep_time64 times",
    /* identity */ "getpid getppid getuid geteuid getgid getegid getresuid getresgid getgroups getuid32 geteuid32 getgid32 getegid32 getresuid32 getresgid32 getgroups32 getpgrp getpgid getsid capget",
    /* own usage and limits */ "getrusage getrlimit ugetrlimit setrlimit",
    /* system information */ "uname sysinfo getrandom",
    /* scheduling of any process (read only) */ "sched_getaffinity sched_getscheduler sched_getparam sched_getattr sched_get_priority_max sched_get_priority_min sched_rr_get_interval sched_rr_get_interval_time64 getpriority",
    /* waiting for children, of which there are none */ "wait4 waitid",
    /* exit */ "exit_group",
};
/* clang-format on */

/* The C library tries these newer calls first. A filter cannot check their arguments, which are in
 * memory. So they fail as on an older kernel. */
static const char *const absent[] = {"clone3", "openat2"};

/* From the first call that this program does not know (Linux 6.5) to one far in the future; the
 * numbers are the same on all machines. Runtimes that try a newer call expect ENOSYS from a kernel
 * that lacks it. */
enum { FIRST_UNKNOWN = 451, LAST_UNKNOWN = 511 };

static void add_absent(rules *list) {
    for (size_t i = 0; i < COUNT(absent); i++) {
        add_rule(list, SCMP_ACT_ERRNO(ENOSYS), absent[i], NULL, 0);
    }
    for (int number = FIRST_UNKNOWN; number <= LAST_UNKNOWN && list->failure == 0; number++) {
        list->failure = seccomp_rule_add(list->context, SCMP_ACT_ERRNO(ENOSYS), number, 0);
    }
}

static void add_calls(rules *list, const tl_confine_settings *settings) {
    add_absent(list);
    for (size_t i = 0; i < COUNT(allowed); i++) {
        allow_all(list, allowed[i]);
    }
    allow_all(list, "creat");
    if (settings->landlock > 0 || settings->keeps_files) {
        allow_all(list, "rmdir unlink unlinkat rename renameat renameat2");
    }
    if (settings->keeps_files) { /* SQLite gives auxiliary files the mode and owner of the database */
        allow_all(list, "fchmod fchown fchown32");
    }
    if (settings->landlock >= TL_LANDLOCK_TRUNCATION) {
        allow_all(list, "truncate truncate64");
    }
}

/* ---- calls that are allowed with certain arguments ---- */

/* Constants that older headers lack. */
enum {
    CLONE_NEW_CGROUP = 0x02000000,
    CLOSE_APART = 1U << 1, /* CLOSE_RANGE_UNSHARE */
    ACCESS_MODES = 3,
    MAP_KINDS = 0x0f,
    MAP_DROPPABLE_KIND = 8, /* MAP_DROPPABLE, Linux 6.11 */
    QUERY = -1,
    NO_NAME = O_TMPFILE & ~O_DIRECTORY
};

/* Command numbers of the kernel: 12 to 14 are locks of files above 2 GiB on 32-bit machines. */
static const uint32_t file_commands[] = {
    F_DUPFD, F_DUPFD_CLOEXEC, F_GETFD,     F_SETFD,      F_GETFL,      F_SETFL,      5,          6, 7, 12, 13,
    14,      F_OFD_GETLK,     F_OFD_SETLK, F_OFD_SETLKW, F_GETPIPE_SZ, F_SETPIPE_SZ, F_GET_SEALS};
static const uint32_t device_commands[] = {FIONREAD, FIONBIO, FIOCLEX, FIONCLEX, TCGETS, TIOCGWINSZ};

/* Finding written pages of our own memory through descriptors that are already open (fmu_pages.h):
 * PAGEMAP_SCAN, whose argument has 96 bytes, and UFFDIO_REGISTER. Neither gives access to memory of
 * another process. */
static const uint32_t page_commands[] = {0xc0606610, 0xc020aa00};
static const uint32_t process_commands[] = {
    PR_SET_NAME,        PR_GET_NAME,         PR_GET_DUMPABLE,     PR_GET_PDEATHSIG,
    PR_GET_KEEPCAPS,    PR_GET_SECUREBITS,   PR_CAPBSET_READ,     PR_GET_SECCOMP,
    PR_GET_TIMERSLACK,  PR_SET_TIMERSLACK,   PR_GET_NO_NEW_PRIVS, PR_SET_THP_DISABLE,
    PR_GET_THP_DISABLE, PR_SET_NO_NEW_PRIVS, PR_GET_TID_ADDRESS,  PR_GET_SPECULATION_CTRL,
    PR_SET_VMA};

static void allow_commands(rules *list) {
    allow_values(list, "fcntl", 1, file_commands, COUNT(file_commands));
    allow_values(list, "fcntl64", 1, file_commands, COUNT(file_commands));
    allow_values(list, "ioctl", 1, device_commands, COUNT(device_commands));
    allow_values(list, "ioctl", 1, page_commands, COUNT(page_commands));
    allow_values(list, "prctl", 0, process_commands, COUNT(process_commands));
    allow_one(list, "personality", IS(0, QUERY));
}

/* Allows new threads, but neither processes nor namespaces. Threads must share descriptors, as
 * those of all C libraries do. With its own descriptor table a thread would get another full limit
 * of descriptors, and as much kernel memory in pipes. */
static void allow_threads(rules *list) {
    const uint32_t apart =
        CLONE_NEWNS | CLONE_NEW_CGROUP | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWUSER | CLONE_NEWPID | CLONE_NEWNET;
    const uint32_t shared = CLONE_THREAD | CLONE_FILES | CLONE_FS;
    allow_one(list, "clone", MASKED(0, shared | apart, shared));
    allow_one(list, "close_range", MASKED(2, CLOSE_APART, 0));
}

/* Shared anonymous memory and memory that grows automatically do not count as data, so they would
 * bypass the limit.
 * The C library from 2.41 on tries droppable memory for getrandom(). The filter refuses it
 * silently, as an older kernel does. */
static void allow_memory(rules *list) {
    const struct scmp_arg_cmp droppable = MASKED(3, MAP_ANONYMOUS | MAP_KINDS, MAP_ANONYMOUS | MAP_DROPPABLE_KIND);
    static const char *const calls[] = {"mmap", "mmap2"};
    for (size_t i = 0; i < COUNT(calls); i++) {
        allow_one(list, calls[i], MASKED(3, MAP_ANONYMOUS | MAP_GROWSDOWN, 0));
        allow_one(list, calls[i], MASKED(3, MAP_ANONYMOUS | MAP_GROWSDOWN | MAP_KINDS, MAP_ANONYMOUS | MAP_PRIVATE));
        add_rule(list, SCMP_ACT_ERRNO(EINVAL), calls[i], &droppable, 1);
    }
    allow_all(list, "mprotect pkey_mprotect");
}

/* Rules for a call that opens a file; `flags`: number of its flags argument. Before ABI 3 Landlock
 * does not check a truncation by an open for reading, or by access mode 3 (neither reading nor
 * writing). A file without a name is in no folder, so it would not be counted. It fails as on a
 * file system without such files. */
static void add_opening(rules *list, const char *call, unsigned flags, const tl_confine_settings *settings) {
    const uint32_t nameless = settings->keeps_files ? 0 : NO_NAME;
    const struct scmp_arg_cmp named = MASKED(flags, nameless, 0);
    const struct scmp_arg_cmp flag_masks[] = {
        MASKED(flags, O_TRUNC | nameless, 0),
        MASKED(flags, O_TRUNC | ACCESS_MODES | nameless, O_TRUNC | O_WRONLY),
        MASKED(flags, O_TRUNC | ACCESS_MODES | nameless, O_TRUNC | O_RDWR),
    };
    if (settings->landlock >= TL_LANDLOCK_TRUNCATION) {
        add_rule(list, SCMP_ACT_ALLOW, call, &named, nameless != 0 ? 1 : 0);
        return;
    }
    for (size_t i = 0; i < COUNT(flag_masks); i++) {
        allow_one(list, call, flag_masks[i]);
    }
}

static void add_files(rules *list, const tl_confine_settings *settings) {
    const struct scmp_arg_cmp nameless[] = {MASKED(1, NO_NAME, NO_NAME), MASKED(2, NO_NAME, NO_NAME)};
    add_opening(list, "open", 1, settings);
    add_opening(list, "openat", 2, settings);
    if (!settings->keeps_files) {
        add_rule(list, SCMP_ACT_ERRNO(EOPNOTSUPP), "open", &nameless[0], 1);
        add_rule(list, SCMP_ACT_ERRNO(EOPNOTSUPP), "openat", &nameless[1], 1);
    }
}

/* Allows signals to our own process. A signal to another one kills this process, or only fails if
 * `only_denies`. */
static void add_signals(rules *list, bool only_denies) {
    static const struct {
        const char *call;
        unsigned signal; /* index of its argument */
    } calls[] = {{"kill", 1}, {"tkill", 1}, {"tgkill", 2}, {"rt_sigqueueinfo", 1}, {"rt_tgsigqueueinfo", 2}};
    const uint64_t own = (uint64_t)getpid();
    for (size_t i = 0; i < COUNT(calls); i++) {
        const struct scmp_arg_cmp other[] = {{0, SCMP_CMP_NE, own, 0}, {calls[i].signal, SCMP_CMP_NE, 0, 0}};
        allow_one(list, calls[i].call, (struct scmp_arg_cmp){0, SCMP_CMP_EQ, own, 0});
        if (!only_denies) {
            add_rule(list, SCMP_ACT_KILL_PROCESS, calls[i].call, other, COUNT(other));
        }
    }
}

/* First argument 0: the calling thread, or this process. */
static void allow_own(rules *list) {
    static const char *const calls[] = {"sched_setscheduler", "sched_setparam", "sched_setattr", "sched_setaffinity",
                                        "prlimit64"};
    for (size_t i = 0; i < COUNT(calls); i++) {
        allow_one(list, calls[i], IS(0, 0));
    }
}

#if TL_HAS_SANITIZER
/* The leak check runs in a process that shares our memory, traces all threads, and ends with us. */
static void add_tracing(rules *list, bool only_denies) {
    static const uint32_t commands[] = {PR_SET_DUMPABLE, PR_SET_PTRACER, PR_SET_PDEATHSIG};
    (void)only_denies;
    allow_all(list, "ptrace");
    allow_one(list, "clone", MASKED(0, CLONE_VM | CLONE_THREAD, CLONE_VM));
    allow_values(list, "prctl", 0, commands, COUNT(commands));
}
#else
static void add_tracing(rules *list, bool only_denies) {
    const struct scmp_arg_cmp other = {0, SCMP_CMP_NE, PTRACE_TRACEME, 0};
    if (!only_denies) {
        add_rule(list, SCMP_ACT_KILL_PROCESS, "ptrace", &other, 1);
    }
}
#endif

static void add_arguments(rules *list, const tl_confine_settings *settings) {
    allow_commands(list);
    allow_threads(list);
    allow_memory(list);
    allow_own(list);
    add_signals(list, settings->only_denies);
    add_tracing(list, settings->only_denies);
    add_files(list, settings);
    if (settings->start_socket >= 0) {
        allow_one(list, "sendmsg", IS(0, settings->start_socket));
    }
}

/* ---- additional calls of a plant driver that reconnects ---- */

/* A filter cannot see memory, so addresses and the flags of a GPIO request are not checked. So each
 * kind of source allows only its own sockets and device commands. Landlock limits TCP to the given
 * ports, but it checks only connect() and only plain TCP. So two bypasses are refused here: other
 * protocols of the same socket type (MPTCP, SCTP), and connecting while sending (MSG_FASTOPEN). */

enum { SOCKET_KINDS = 0x0f }; /* type of a socket; the other bits are flags */

static const char tcp_calls[] = "connect shutdown getsockname getpeername getsockopt setsockopt recv recvfrom";

static const tl_plant_socket tcp_sockets[] = {
    {AF_INET, SOCK_STREAM, 0},
    {AF_INET, SOCK_STREAM, IPPROTO_TCP},
    {AF_INET6, SOCK_STREAM, 0},
    {AF_INET6, SOCK_STREAM, IPPROTO_TCP},
};

/* Name resolution also needs the TCP calls. Netlink lists the addresses of this machine. */
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
    .bind_address_bytes = sizeof(struct sockaddr_nl),
    .commands = name_commands,
    .command_count = COUNT(name_commands),
};
static const tl_plant_access tcp_access = {
    .calls = tcp_calls, .sockets = tcp_sockets, .socket_count = COUNT(tcp_sockets)};

/* Sending on a connection needs no address. Name resolution passes an address, so the address is
 * not checked then. */
static void add_sending(rules *list, bool names) {
    const struct scmp_arg_cmp connected[] = {MASKED(3, MSG_FASTOPEN, 0), {4, SCMP_CMP_EQ, 0, 0}};
    allow_one(list, "send", MASKED(3, MSG_FASTOPEN, 0));
    add_rule(list, SCMP_ACT_ALLOW, "sendto", connected, names ? 1 : COUNT(connected));
    if (names) {
        allow_one(list, "sendmsg", MASKED(2, MSG_FASTOPEN, 0));
        allow_one(list, "sendmmsg", MASKED(3, MSG_FASTOPEN, 0));
    }
}

/* Allows all of `access` except TCP. No process can listen, so bind() to an address of that length
 * is harmless. */
static void add_access(rules *list, const tl_plant_access *access) {
    if (access->calls != NULL) {
        allow_all(list, access->calls);
    }
    if (access->bind_address_bytes != 0) {
        allow_one(list, "bind", IS(2, access->bind_address_bytes));
    }
    for (size_t i = 0; i < access->socket_count; i++) {
        const tl_plant_socket *one = &access->sockets[i];
        const struct scmp_arg_cmp conditions[] = {IS(0, one->family), MASKED(1, SOCKET_KINDS, (uint32_t)one->type),
                                                  IS(2, one->protocol)};
        add_rule(list, SCMP_ACT_ALLOW, "socket", conditions, COUNT(conditions));
    }
    allow_values(list, "ioctl", 1, access->commands, access->command_count);
}

static void add_driver(rules *list, const tl_plant_access *plant, bool names) {
    allow_one(list, "sched_setscheduler", IS(1, SCHED_OTHER)); /* side threads have ordinary scheduling (os.h) */
    add_access(list, plant);
    if (plant->tcp || names) {
        add_access(list, &tcp_access);
        add_sending(list, names);
    }
    if (names) {
        add_access(list, &names_access);
    }
}

/* ---- additional calls of a network server that already listens ---- */

/* The server accepts connections and connects to local sockets. New sockets are local ones, so no
 * other host can be reached. It also makes memory to hand over. */
static void add_server(rules *list) {
    allow_all(list, "accept accept4 connect shutdown getsockname getpeername getsockopt "
                    "setsockopt send sendto sendmsg recv recvfrom recvmsg memfd_create");
    allow_one(list, "socket", IS(0, AF_UNIX));
    allow_one(list, "fcntl", IS(1, F_ADD_SEALS));
    allow_one(list, "fcntl64", IS(1, F_ADD_SEALS));
}

/* ---- load ---- */

static void set_attributes(rules *list, const tl_confine_settings *settings) {
    const struct {
        enum scmp_filter_attr attribute;
        uint32_t value;
    } attributes[] = {
        {SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS},
        {SCMP_FLTATR_CTL_NNP, 1},
        {SCMP_FLTATR_CTL_TSYNC, settings->whole_process ? 1 : 0},
        {SCMP_FLTATR_CTL_SSB, 1},      /* FMUs run faster without this mitigation */
        {SCMP_FLTATR_CTL_OPTIMIZE, 2}, /* binary tree of call numbers */
        {SCMP_FLTATR_API_SYSRAWRC, 1}, /* return the kernel's error codes */
    };
    for (size_t i = 0; i < COUNT(attributes) && list->failure == 0; i++) {
        list->failure = seccomp_attr_set(list->context, attributes[i].attribute, attributes[i].value);
    }
}

/* Returns 0 or a negative errno. */
static int load(const tl_confine_settings *settings, uint32_t refuse, int *listener) {
    rules list = {.context = seccomp_init(refuse)};
    if (list.context == NULL) {
        return -ENOMEM;
    }
    set_attributes(&list, settings);
    add_calls(&list, settings);
    add_arguments(&list, settings);
    if (settings->plant != NULL) {
        add_driver(&list, settings->plant, settings->names);
    }
    if (settings->is_server) {
        add_server(&list);
    }
    list.failure = list.failure != 0 ? list.failure : seccomp_load(list.context);
    if (list.failure == 0 && refuse == SCMP_ACT_NOTIFY) {
        *listener = seccomp_notify_fd(list.context);
    }
    seccomp_release(list.context);
    return list.failure;
}

tl_status tl_filter_load(const tl_confine_settings *settings, int *listener, tl_error *error) {
    int failure = -EBUSY; /* the kernel's error for a second listener, for example a container's */
    if (listener != NULL) {
        *listener = -1;
        failure = tl_filter_can_notify() ? load(settings, SCMP_ACT_NOTIFY, listener) : failure;
    }
    if (failure == -EBUSY) {
        failure = load(settings, SCMP_ACT_ERRNO(EPERM), NULL);
    }
    return failure == 0
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "the system call filter cannot be loaded: %s", strerror(-failure));
}
