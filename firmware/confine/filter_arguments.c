/* Calls of which the arguments decide: see filter.h.
 *
 * The kernel takes most arguments as 32 bits, while a filter sees 64 of which the upper ones may be anything. So what is allowed is compared by its
 * lower half (IS), and what must be a number of ours by all of it.
 */
#include "firmware/confine/filter_parts.h"

#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <termios.h>
#include <unistd.h>

#include "firmware/confine/sanitizer.h"

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* The lower half of argument `n`, under a mask, is `value`. */
#define MASKED(n, mask, value) ((struct scmp_arg_cmp){(n), SCMP_CMP_MASKED_EQ, (mask), (value)})
#define IS(n, value) MASKED(n, UINT32_MAX, (uint32_t)(value))

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

/* Which pages of its own memory a process has written, by descriptors from before (fmu_written.h): PAGEMAP_SCAN, whose order has 96 bytes, and UFFDIO_REGISTER.
 * Neither leads to memory of another process. */
static const uint32_t page_commands[] = {0xc0606610, 0xc020aa00};
static const uint32_t process_commands[] = {
    PR_SET_NAME,        PR_GET_NAME,         PR_GET_DUMPABLE,     PR_GET_PDEATHSIG,
    PR_GET_KEEPCAPS,    PR_GET_SECUREBITS,   PR_CAPBSET_READ,     PR_GET_SECCOMP,
    PR_GET_TIMERSLACK,  PR_SET_TIMERSLACK,   PR_GET_NO_NEW_PRIVS, PR_SET_THP_DISABLE,
    PR_GET_THP_DISABLE, PR_SET_NO_NEW_PRIVS, PR_GET_TID_ADDRESS,  PR_GET_SPECULATION_CTRL,
    PR_SET_VMA};

static int allow_values(scmp_filter_ctx context, const char *call, unsigned argument, const uint32_t *values,
                        size_t count) {
    int failure = 0;
    for (size_t i = 0; i < count && failure == 0; i++) {
        const struct scmp_arg_cmp condition = IS(argument, values[i]);
        failure = tl_filter_add(context, SCMP_ACT_ALLOW, call, &condition, 1);
    }
    return failure;
}

static int allow_one(scmp_filter_ctx context, const char *call, struct scmp_arg_cmp condition) {
    return tl_filter_add(context, SCMP_ACT_ALLOW, call, &condition, 1);
}

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

/* A copy of the process that is a child of its parent, not of its own, so that the parent reaps it and knows of all; and to be ended
 * with that. */
static int add_forks(scmp_filter_ctx context) {
    const struct scmp_arg_cmp copy[] = {{0, SCMP_CMP_EQ, CLONE_PARENT | SIGCHLD, 0}, {1, SCMP_CMP_EQ, 0, 0}};
    int failure = tl_filter_add(context, SCMP_ACT_ALLOW, "clone", copy, COUNT(copy));
    return failure != 0 ? failure : allow_one(context, "prctl", IS(0, PR_SET_PDEATHSIG));
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
        failure = failure != 0 ? failure : tl_filter_add(context, SCMP_ACT_ERRNO(EINVAL), calls[i], &droppable, 1);
    }
    return failure != 0 ? failure : tl_filter_allow_all(context, "mprotect pkey_mprotect");
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
        return tl_filter_add(context, SCMP_ACT_ALLOW, call, &named, nameless != 0 ? 1 : 0);
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
        failure = failure != 0 ? failure : tl_filter_add(context, SCMP_ACT_ERRNO(EOPNOTSUPP), "open", &nameless[0], 1);
        failure =
            failure != 0 ? failure : tl_filter_add(context, SCMP_ACT_ERRNO(EOPNOTSUPP), "openat", &nameless[1], 1);
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
            failure = tl_filter_add(context, SCMP_ACT_KILL_PROCESS, calls[i].call, other, COUNT(other));
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
    int failure = tl_filter_allow_all(context, "ptrace");
    (void)lives_on;
    failure = failure != 0 ? failure : allow_one(context, "clone", MASKED(0, CLONE_VM | CLONE_THREAD, CLONE_VM));
    return failure != 0 ? failure : allow_values(context, "prctl", 0, commands, COUNT(commands));
}
#else
static int add_tracing(scmp_filter_ctx context, bool lives_on) {
    const struct scmp_arg_cmp other = {0, SCMP_CMP_NE, PTRACE_TRACEME, 0};
    return lives_on ? 0 : tl_filter_add(context, SCMP_ACT_KILL_PROCESS, "ptrace", &other, 1);
}
#endif

int tl_filter_add_arguments(scmp_filter_ctx context, const tl_filter_settings *settings) {
    int (*const parts[])(scmp_filter_ctx) = {allow_commands, allow_threads, allow_memory, allow_own};
    int failure = 0;
    for (size_t i = 0; i < COUNT(parts) && failure == 0; i++) {
        failure = parts[i](context);
    }
    if (settings->forks) { /* a number of its own would be another process's once this one has ended */
        failure = failure != 0 ? failure : add_forks(context);
    } else {
        failure = failure != 0 ? failure : add_signals(context, settings->lives_on);
    }
    failure = failure != 0 ? failure : add_tracing(context, settings->lives_on);
    failure = failure != 0 ? failure : add_files(context, settings);
    if (settings->start_socket >= 0) {
        failure = failure != 0 ? failure : allow_one(context, "sendmsg", IS(0, settings->start_socket));
    }
    return failure;
}
