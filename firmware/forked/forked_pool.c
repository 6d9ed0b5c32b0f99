/* Keepers, and the processes below them: see forked_pool.h. */
#include "firmware/forked/forked_pool.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/process/host_state.h"
#include "firmware/process/role.h"

/* Processes and threads of the user beyond what the machine has now: other programs begin some, too. */
enum { MORE_PROCESSES = 1024, LOADAVG = 128 };

/* Descriptors of a keeper: the end of a pipe that says nothing until the twin is gone. */
enum { TWIN = 3, FIRST_TO_CLOSE };

/* Of the process. */
static tl_forked_line lines[TL_FORKED_FMUS];
static size_t begun;
static size_t taken;

/* ---- what is not inherited ---- */

static void close_others(void) {
#if defined(SYS_close_range)
    if (syscall(SYS_close_range, (unsigned)FIRST_TO_CLOSE, ~0U, 0U) == 0) {
        return;
    }
#endif
    struct rlimit most = {.rlim_cur = FIRST_TO_CLOSE};
    (void)getrlimit(RLIMIT_NOFILE, &most);
    for (int number = FIRST_TO_CLOSE; number < (int)most.rlim_cur; number++) {
        (void)close(number);
    }
}

/* A crash is told by who asks; the handlers of this program are another process's. */
static void reset_signals(void) {
    const struct sigaction standard = {.sa_handler = SIG_DFL};
    for (int number = 1; number < NSIG; number++) {
        struct sigaction now;
        if (sigaction(number, NULL, &now) == 0 && now.sa_handler != SIG_DFL && now.sa_handler != SIG_IGN) {
            (void)tl_host_state_handle(number, &standard, NULL);
        }
    }
}

/* ---- the keeper ---- */

static void end_all(void) __attribute__((noreturn));

static void end_all(void) {
    (void)kill(0, SIGKILL); /* its group: all of them, and itself */
    _exit(1);
}

static void note_end(tl_forked_block *block, uint32_t slots, pid_t process, int how) {
    for (uint32_t i = 0; i < slots; i++) {
        tl_forked_slot *slot = &block->slots[i];
        if (__atomic_load_n(&slot->process, __ATOMIC_ACQUIRE) == (int32_t)process) {
            slot->process = 0;
            slot->how = how;
            __atomic_store_n(&slot->ended, 1, __ATOMIC_RELEASE);
            tl_forked_wake(&block->news);
            return;
        }
    }
}

static void reap(tl_forked_block *block, uint32_t slots) {
    int how = 0;
    pid_t process = waitpid(-1, &how, WNOHANG);
    while (process > 0) {
        note_end(block, slots, process, how);
        process = waitpid(-1, &how, WNOHANG);
    }
    if (process < 0 && errno == ECHILD) {
        end_all();
    }
}

/* Until the twin closes its end of the pipe, by ending or on purpose. `children` is to be read when one of them has ended. */
static void keep(tl_forked_block *block, uint32_t slots, int children) __attribute__((noreturn));

static void keep(tl_forked_block *block, uint32_t slots, int children) {
    struct pollfd watched[] = {{.fd = TWIN, .events = POLLIN}, {.fd = children, .events = POLLIN}};
    for (;;) {
        reap(block, slots);
        if (poll(watched, 2, -1) > 0 && watched[0].revents != 0) {
            end_all();
        }
        struct signalfd_siginfo ended;
        if (watched[1].revents != 0 && read(children, &ended, sizeof ended) < 0) {
            end_all();
        }
    }
}

/* ---- the first process of an FMU ---- */

/* One that forks without end is bounded, and so are the others of its user: that is what the kernel counts. */
static void bound_processes(void) {
    char text[LOADAVG] = "";
    int file = open("/proc/loadavg", O_RDONLY | O_CLOEXEC);
    ssize_t length = file < 0 ? 0 : read(file, text, sizeof text - 1);
    const char *all = length > 0 ? strchr(text, '/') : NULL;
    struct rlimit most;
    if (file >= 0) {
        (void)close(file);
    }
    if (all == NULL || getrlimit(RLIMIT_NPROC, &most) != 0) {
        return;
    }
    rlim_t wanted = strtoul(all + 1, NULL, 10) + MORE_PROCESSES;
    most.rlim_max = most.rlim_max == RLIM_INFINITY || most.rlim_max > wanted ? wanted : most.rlim_max;
    most.rlim_cur = most.rlim_max;
    (void)setrlimit(RLIMIT_NPROC, &most);
}

/* If memory is out, its processes are the ones to end. */
static void offer_to_end(void) {
    int file = open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
    if (file >= 0) {
        (void)!write(file, "1000", 4);
        (void)close(file);
    }
}

static void be_host(const tl_forked_line *line, pid_t keeper, const tl_forked_service *service)
    __attribute__((noreturn));

static void be_host(const tl_forked_line *line, pid_t keeper, const tl_forked_service *service) {
    (void)prctl(PR_SET_NAME, "fmu");
    tl_role_entitle("fmu");
    bound_processes();
    offer_to_end();
    tl_forked_host_run(line->block, line->slot_count, keeper, service);
}

/* SIGCHLD by a descriptor, from now on. */
static int hear_of_children(void) {
    sigset_t ends;
    (void)sigemptyset(&ends);
    (void)sigaddset(&ends, SIGCHLD);
    (void)sigprocmask(SIG_BLOCK, &ends, NULL);
    return signalfd(-1, &ends, SFD_CLOEXEC);
}

static void be_keeper(const tl_forked_line *line, int twin, const tl_forked_service *service) __attribute__((noreturn));

static void be_keeper(const tl_forked_line *line, int twin, const tl_forked_service *service) {
    tl_error error;
    reset_signals();
    (void)prctl(PR_SET_NAME, "keeper");
    tl_role_entitle("keeper");
    if (dup2(twin, TWIN) != TWIN || setpgid(0, 0) != 0) {
        _exit(1); /* end_all() would reach others */
    }
    close_others();
    pid_t keeper = getpid();
    pid_t host = fork();
    if (host == 0) {
        (void)close(TWIN);
        be_host(line, keeper, service);
    }
    int children = hear_of_children();
    (void)prctl(PR_SET_DUMPABLE, 0);
    if (host < 0 || children < 0 || (service->settle != NULL && service->settle(service->context, &error) != TL_OK)) {
        end_all();
    }
    keep(line->block, line->slot_count, children);
}

/* ---- the pool ---- */

tl_status tl_forked_begin(uint32_t snapshots, const tl_forked_service *service, tl_error *error) {
    if (begun == TL_FORKED_FMUS) {
        return tl_fail(error, TL_BAD_DATA, "more than %d FMUs are to be rolled back by forking", TL_FORKED_FMUS);
    }
    tl_forked_line *line = &lines[begun];
    tl_status status = tl_forked_line_open(snapshots, line, error);
    if (status != TL_OK) {
        return status;
    }
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) {
        tl_forked_line_close(line);
        return tl_fail(error, TL_TRY_AGAIN, "no descriptors for the process of an FMU");
    }
    pid_t keeper = fork();
    if (keeper == 0) {
        be_keeper(line, ends[0], service);
    }
    int fault = errno;
    (void)close(ends[0]);
    line->alive = ends[1];
    if (keeper < 0) {
        tl_forked_line_close(line);
        return tl_fail(error, TL_TRY_AGAIN, "no process for an FMU: %s", strerror(fault));
    }
    line->keeper = keeper;
    begun++;
    return TL_OK;
}

tl_forked_line *tl_forked_take(void) {
    return taken < begun ? &lines[taken++] : NULL;
}
