/* Child processes of the supervisor: see child.h. */
#include "firmware/live/child.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"

/* ---- reaper ---- */

/* The thread makes one call, and locked memory is limited. */
enum { STACK_BYTES = 256 * 1024 };

static void *reap_child(void *context) {
    pid_t *dead = context;
    siginfo_t info;
    id_t number = (id_t)*dead;
    free(dead);
    (void)waitid(P_PID, number, &info, WEXITED);
    return NULL;
}

void tl_reaper_start(tl_reaper *reaper, pid_t dead) {
    pid_t *copy = malloc(sizeof *copy); /* owned by the thread, which may outlive the caller */
    int result = ENOMEM;
    if (copy != NULL) {
        *copy = dead;
        result = tl_side_thread_start(&reaper->thread, STACK_BYTES, reap_child, copy);
    }
    reaper->works = result == 0;
    if (result != 0) {
        free(copy);
        tl_log(
            TL_LOG_WARNING,
            "process %d has ended, but no thread could be started to reap it: %s; it stays in the process list until this "
            "program ends",
            (int)dead, strerror(result));
    }
}

bool tl_reaper_is_idle(tl_reaper *reaper) {
    if (reaper->works && pthread_tryjoin_np(reaper->thread, NULL) == 0) {
        reaper->works = false;
    }
    return !reaper->works;
}

void tl_reaper_stop(tl_reaper *reaper) {
    if (!tl_reaper_is_idle(reaper)) {
        (void)pthread_detach(reaper->thread);
        reaper->works = false;
    }
}

/* ---- child ---- */

void tl_child_prepare(tl_child *child) {
    memset(child->beats, 0, sizeof *child->beats);
    child->seen = (tl_heartbeats_seen){0};
    child->end = (tl_child_end){.known = false};
    child->killed = false;
    child->asked = false;
    child->asking = 0;
}

bool tl_child_has_ended(tl_child *child) {
    siginfo_t info = {0};
    int result = waitid(P_PID, (id_t)child->pid, &info, WEXITED | WNOHANG | WNOWAIT);
    if (result == 0 ? info.si_pid == 0 : errno == EINTR) {
        return false;
    }
    child->end =
        (tl_child_end){.known = result == 0, .by_signal = info.si_code != CLD_EXITED, .number = info.si_status};
    child->end.announced_cause = tl_heartbeats_get_end_cause(child->beats, &child->end.code);
    return true;
}

/* An FMU call is reported as the cause if it lasted for most of the waited time. */
void tl_child_kill(tl_child *child, tl_time waited, const char *format, ...) {
    va_list arguments;
    if (!child->killed) {
        va_start(arguments, format);
        (void)vsnprintf(child->fault, sizeof child->fault, format, arguments);
        va_end(arguments);
        child->killed = true;
        child->blame_after = waited / 2;
        (void)kill(child->pid, SIGKILL);
    }
}

void tl_child_restart_timeouts(tl_child *child) {
    memset(child->seen.silence, 0, sizeof child->seen.silence);
    child->seen.no_heart = 0;
}

void tl_child_request_end(tl_child *child, int signal) {
    child->asked = true;
    child->signal = signal;
    child->asking = 0;
    (void)kill(child->pid, signal);
}

tl_time tl_child_passed(tl_time passed) {
    return passed < TL_HEARTBEAT_POLL ? passed : TL_HEARTBEAT_POLL;
}

/* Needed for a child that ignores the signal, hangs with a live heartbeat, or has a timeout longer
 * than the grace period. */
void tl_child_kill_late(tl_child *child, tl_time passed, tl_time grace) {
    if (!child->asked) {
        return;
    }
    child->asking += tl_child_passed(passed);
    if (child->asking > grace) {
        tl_child_kill(child, grace, "killed: still running %.0f s after the request to end", tl_seconds(grace));
    }
}

bool tl_child_ended_as_announced(const tl_child *child) {
    const tl_child_end *end = &child->end;
    return !child->killed && end->announced_cause != TL_END_CAUSE_NONE && end->known && !end->by_signal &&
           end->number == end->code;
}

/* The names are untrusted, because the process may be corrupted. */
static void append_call(const tl_child *child, char reason[TL_RESTARTS_REASON]) {
    tl_fmu_call call;
    size_t length = strlen(reason);
    tl_time least = child->killed ? child->blame_after : 0;
    if (!tl_heartbeats_get_call(child->beats, &child->seen, least, &call)) {
        return;
    }
    for (char *letter = call.fmu; *letter != '\0'; letter++) {
        *letter = (char)(*letter >= ' ' && *letter <= '~' ? *letter : '?');
    }
    (void)snprintf(reason + length, TL_RESTARTS_REASON - length, ", in %s of %s", call.function, call.fmu);
}

void tl_child_describe(const tl_child *child, char reason[TL_RESTARTS_REASON]) {
    const tl_child_end *end = &child->end;
    bool kept = tl_child_ended_as_announced(child);
    if (child->killed) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "%s", child->fault);
    } else if (!end->known) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "ended in an unknown way");
    } else if (end->by_signal) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "ended by signal %d, %s", end->number, strsignal(end->number));
    } else if (end->announced_cause == TL_END_CAUSE_REQUESTED && kept) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "ended on a request that did not come from its supervisor");
    } else {
        (void)snprintf(reason, TL_RESTARTS_REASON, "ended %swith exit code %d",
                       end->announced_cause != TL_END_CAUSE_NONE ? "" : "unexpectedly ", end->number);
    }
    if (!kept) {
        append_call(child, reason);
    }
}

void tl_child_reap(tl_child *child) {
    if (child->end.known) {
        tl_reaper_start(&child->reaper, child->pid);
    }
    child->pid = 0;
}

/* ---- debugger check ---- */

/* First bytes of a thread's status file: its name (the kernel escapes line ends in it), state and
 * tracer. */
enum { STATUS = 1024 };

/* Returns the text after this name, or "". */
static const char *find_field(const char *status, const char *name) {
    const char *found = strstr(status, name);
    return found != NULL ? found + strlen(name) : "";
}

/* A thread that has ended meanwhile does not count. */
static bool is_thread_held(int tasks, const char *name) {
    char path[64];
    char status[STATUS + 1];
    (void)snprintf(path, sizeof path, "%.20s/status", name);
    int file = openat(tasks, path, O_RDONLY | O_CLOEXEC);
    ssize_t length = file >= 0 ? read(file, status, STATUS) : 0;
    if (file >= 0) {
        (void)close(file);
    }
    status[length > 0 ? length : 0] = '\0';
    char state = *find_field(status, "\nState:\t");
    return state == 'T' || state == 't' || strtol(find_field(status, "\nTracerPid:\t"), NULL, 10) != 0;
}

bool tl_process_is_stopped(pid_t process) {
    char path[64];
    (void)snprintf(path, sizeof path, "/proc/%ld/task", (long)process);
    DIR *tasks = opendir(path);
    bool holds = false;
    for (const struct dirent *entry = NULL; !holds && tasks != NULL && (entry = readdir(tasks)) != NULL;) {
        holds = entry->d_name[0] != '.' && is_thread_held(dirfd(tasks), entry->d_name);
    }
    if (tasks != NULL) {
        (void)closedir(tasks);
    }
    return holds;
}
