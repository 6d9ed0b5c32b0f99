/* Fork and exec of this program: see role.h. Between the two only functions that POSIX allows after
 * fork() in a process with threads. */
#include "firmware/process/role.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/process/crash.h"
#include "firmware/process/process_end.h"

#define PREFIX "twinlock: "

/* Descriptors after those of the child: the program, and the pipe that reports the result of exec.
 * All are first duplicated to GATHER and above. */
enum { PROGRAM = TL_ROLE_DESCRIPTORS, EXEC_RESULT, FIRST_TO_CLOSE, FREE_NUMBERS = FIRST_TO_CLOSE, NOT_EXECUTED = 127 };

/* State of this process. */
static int program = -1;
static char **command_line;        /* the original command line; NULL: this process has a role */
static int program_fault = ENOSYS; /* errno of opening the program; 0: none */
static pid_t parent;               /* parent process, if this process has a role */
static char *own_title;            /* part of its argv[0] */

/* ---- At the start ---- */

/* Saves the order, because getopt_long() changes it later. */
static void keep_command_line(char *const *argv) {
    size_t count = 0;
    while (argv[count] != NULL) {
        count++;
    }
    command_line = calloc(count + 1, sizeof *command_line);
    for (size_t i = 0; command_line != NULL && i < count; i++) {
        command_line[i] = argv[i];
    }
}

const char *tl_role_begin(char *const *argv) {
    if (argv[0] != NULL && strncmp(argv[0], PREFIX, strlen(PREFIX)) == 0) {
        own_title = argv[0] + strlen(PREFIX);
        return own_title;
    }
    keep_command_line(argv);
    tl_role_open_program();
    while (waitpid(-1, NULL, WNOHANG) > 0) { /* children from before tl_role_restart() */
    }
    return NULL;
}

void tl_role_open_program(void) {
    program = open("/proc/self/exe", O_RDONLY | O_CLOEXEC);
    program_fault = program < 0 ? errno : 0;
}

void tl_role_entitle(const char *title) {
    if (own_title != NULL) {
        size_t room = strlen(own_title);
        memset(own_title, ' ', room);
        memcpy(own_title, title, strnlen(title, room));
    }
}

void tl_role_restart(void) {
    sigset_t none;
    (void)sigemptyset(&none);
    (void)pthread_sigmask(SIG_SETMASK, &none, NULL);
    if (command_line != NULL && program >= 0) {
        (void)fexecve(program, command_line, environ);
    }
}

void tl_role_enter(void) {
    pid_t now = getppid();
    parent = parent == 0 ? now : parent;
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != parent) {
        _exit(NOT_EXECUTED);
    }
}

/* ---- Between fork and exec ---- */

/* Data for a child, prepared before the fork. */
typedef struct launch {
    const tl_role_settings *settings;
    char *argv[2];
    char **environment;
    pid_t parent;
    int result_pipe[2]; /* pipe: errno of a failed exec; empty if exec succeeded */
} launch;

static void reset_signals(void) {
    const struct sigaction default_action = {.sa_handler = SIG_DFL};
    struct sigaction now;
    sigset_t none;
    for (int number = 1; number < NSIG; number++) {
        bool is_ignored = number == SIGHUP && sigaction(number, NULL, &now) == 0 && now.sa_handler == SIG_IGN;
        if (!is_ignored) {
            (void)sigaction(number, &default_action, NULL);
        }
    }
    (void)sigemptyset(&none);
    (void)sigprocmask(SIG_SETMASK, &none, NULL);
}

/* Duplicates a descriptor above all numbers of the child; −1 stays. */
static int move_up(int descriptor) {
    int moved = descriptor < 0 ? -1 : fcntl(descriptor, F_DUPFD_CLOEXEC, FREE_NUMBERS);
    errno = moved < 0 && errno == EINVAL ? EMFILE : errno; /* FREE_NUMBERS is above the limit */
    return moved;
}

/* Duplicates it to its number, without close-on-exec. −1 closes that number. */
static bool move_to(int descriptor, int number) {
    if (descriptor < 0) {
        (void)close(number);
        return true;
    }
    return dup2(descriptor, number) == number;
}

/* Returns false with errno if descriptors are missing. */
static bool move_descriptors(const launch *start) {
    int moved[TL_ROLE_DESCRIPTORS];
    int own_program = move_up(program);
    int result_pipe = move_up(start->result_pipe[1]);
    bool is_moved = result_pipe >= 0;
    for (int i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        moved[i] = move_up(start->settings->descriptors[i]);
        is_moved = is_moved && (moved[i] >= 0) == (start->settings->descriptors[i] >= 0);
    }
    if (!is_moved) {
        return false;
    }
    for (int i = 0; i < TL_ROLE_DESCRIPTORS && is_moved; i++) {
        is_moved = move_to(moved[i], i);
    }
    is_moved = is_moved && move_to(own_program, PROGRAM) && move_to(result_pipe, EXEC_RESULT);
    closefrom(FIRST_TO_CLOSE);
    (void)fcntl(PROGRAM, F_SETFD, FD_CLOEXEC);
    (void)fcntl(EXEC_RESULT, F_SETFD, FD_CLOEXEC);
    return is_moved;
}

/* Returns whether the kernel or emulator cannot execute a descriptor. Any other code is a failure.
 */
static bool cannot_execute(int code) {
    return code == ENOEXEC || code == ENOSYS || (program < 0 && code == program_fault);
}

static void send_exec_result(int descriptor, int code) {
    (void)!write(descriptor, &code, sizeof code);
}

static void run_forked(const launch *start) __attribute__((noreturn));

static void run_forked(const launch *start) {
    const tl_role_settings *settings = start->settings;
    (void)close(PROGRAM);
    (void)close(EXEC_RESULT);
    program = -1;
    environ = start->environment;
    parent = start->parent;
    tl_process_begin();
    tl_crash_install();
    tl_process_end(settings->fallback(settings->title, settings->context));
}

static void run_child(const launch *start) __attribute__((noreturn));

static void run_child(const launch *start) {
    reset_signals();
    (void)setsid();
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || !move_descriptors(start)) {
        send_exec_result(start->result_pipe[1], errno);
        _exit(NOT_EXECUTED);
    }
    if (getppid() != start->parent) {
        _exit(NOT_EXECUTED);
    }
    int code = program_fault;
    if (program >= 0) {
        (void)fexecve(PROGRAM, start->argv, start->environment);
        code = errno;
    }
    send_exec_result(EXEC_RESULT, code);
    if (start->settings->fallback == NULL || !cannot_execute(code)) {
        _exit(NOT_EXECUTED);
    }
    run_forked(start);
}

/* ---- Starting ---- */

static bool is_replaced(const tl_role_settings *settings, const char *variable) {
    size_t length = strcspn(variable, "=");
    for (size_t i = 0; i < settings->variable_count; i++) {
        if (strcspn(settings->variables[i], "=") == length && strncmp(settings->variables[i], variable, length) == 0) {
            return true;
        }
    }
    return false;
}

static bool is_inherited(const tl_role_settings *settings, const char *variable) {
    bool found = settings->inherits == NULL;
    for (const char *const *name = settings->inherits; !found && *name != NULL; name++) {
        size_t length = strcspn(*name, "*");
        found = strncmp(*name, variable, length) == 0 && ((*name)[length] == '*' || variable[length] == '=');
    }
    return found && !is_replaced(settings, variable);
}

/* Returns the inherited variables and the additions; free it with one free(). Returns NULL if
 * memory is out. */
static char **make_environment(const tl_role_settings *settings) {
    size_t count = 0;
    size_t used = 0;
    while (environ[count] != NULL) {
        count++;
    }
    char **made = calloc(count + settings->variable_count + 1, sizeof *made);
    for (size_t i = 0; made != NULL && i < count; i++) {
        if (is_inherited(settings, environ[i])) {
            made[used++] = environ[i];
        }
    }
    for (size_t i = 0; made != NULL && i < settings->variable_count; i++) {
        memcpy(&made[used++], &settings->variables[i], sizeof made[0]); /* removes const; exec() does not change it */
    }
    return made;
}

/* Blocks all signals, so that no handler of ours runs in the child. */
static pid_t fork_child(const launch *start) {
    sigset_t all;
    sigset_t before;
    (void)fflush(NULL); /* so that a forked child does not write buffered output again */
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    pid_t pid = fork();
    if (pid == 0) {
        run_child(start);
    }
    int code = errno;
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    errno = code;
    return pid;
}

/* Waits for the child's exec and returns its errno; 0: it succeeded. */
static int read_exec_result(int result_pipe) {
    int code = 0;
    return tl_file_bytes_read(result_pipe, (char *)&code, sizeof code) == (ssize_t)sizeof code ? code : 0;
}

static tl_status fail_start(const tl_role_settings *settings, int code, tl_error *error) {
    return tl_fail(error, TL_TRY_AGAIN,
                   "the process \"%s\" cannot be started: %s; free memory, processes or descriptors and try again",
                   settings->title, strerror(code));
}

static tl_status launch_child(launch *start, tl_role *role, tl_error *error) {
    const tl_role_settings *settings = start->settings;
    role->pid = fork_child(start);
    int code = role->pid < 0 ? errno : 0;
    (void)close(start->result_pipe[1]);
    if (code == 0) {
        code = read_exec_result(start->result_pipe[0]);
        role->is_forked = code != 0 && settings->fallback != NULL && cannot_execute(code);
    }
    (void)close(start->result_pipe[0]);
    if (code != 0 && !role->is_forked) {
        role->pid = role->pid < 0 ? 0 : role->pid;
        tl_role_kill(role);
        *role = (tl_role){0};
        return fail_start(settings, code, error);
    }
    return TL_OK;
}

tl_status tl_role_start(const tl_role_settings *settings, tl_role *role, tl_error *error) {
    char title[sizeof PREFIX + TL_ROLE_TITLE];
    launch start = {.settings = settings, .argv = {title, NULL}, .parent = getpid()};
    *role = (tl_role){0};
    (void)snprintf(title, sizeof title, PREFIX "%s", settings->title);
    if (pipe2(start.result_pipe, O_CLOEXEC) != 0) {
        return fail_start(settings, errno, error);
    }
    start.environment = make_environment(settings);
    if (start.environment == NULL) {
        (void)close(start.result_pipe[0]);
        (void)close(start.result_pipe[1]);
        return fail_start(settings, ENOMEM, error);
    }
    tl_status status = launch_child(&start, role, error);
    free(start.environment);
    return status;
}

/* ---- Watching ---- */

static bool collect_child(tl_role *role, int flags) {
    siginfo_t info = {.si_pid = 0};
    int result = 0;
    do {
        result = waitid(P_PID, (id_t)role->pid, &info, WEXITED | flags);
    } while (result != 0 && errno == EINTR);
    if (result == 0 && info.si_pid == 0) {
        return false;
    }
    role->pid = 0;
    role->has_ended = true;
    role->code = result != 0 ? -1 : info.si_code == CLD_EXITED ? info.si_status : 0;
    role->signal = result == 0 && info.si_code != CLD_EXITED ? info.si_status : 0;
    return true;
}

bool tl_role_watch(tl_role *role) {
    return role->pid == 0 ? role->has_ended : collect_child(role, WNOHANG);
}

void tl_role_kill(tl_role *role) {
    if (role->pid != 0 && !collect_child(role, WNOHANG)) {
        (void)kill(role->pid, SIGKILL);
        (void)collect_child(role, 0);
    }
}
