/* The supervisor: see supervisor.h. */
#include "firmware/supervise/supervisor.h"

#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "board/watchdog/watchdog.h"
#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/process/crash.h"
#include "firmware/process/fmu_patience.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/supervise/reaper.h"
#include "firmware/supervise/service.h"

/* Between two looks at the child: what a hang costs beyond the patience. */
static const tl_time LOOK = TL_SECOND / 20;

/* The same at the reaper, who has next to nothing to do; and for how long he is worth a stroke. */
static const tl_time LOOK_AT_REAPER = TL_SECOND / 500;
static const tl_time REAPING = 30 * TL_SECOND;

/* The first pause before a restart that follows another, and the longest. */
static const tl_time PAUSE_FIRST = TL_SECOND / 4;
static const tl_time PAUSE_LAST = 8 * TL_SECOND;

/* Strokes are no more than this apart, and status lines. */
static const tl_time STROKE = TL_SECOND;
static const tl_time STATUS = 5 * TL_SECOND;

/* What an appliance may take to end when it is asked to: that it ends by itself without an FMU that does not return, and keeps what can
 * be kept then, is better than to be killed. */
static const tl_time GRACE = TL_FMU_PATIENCE_END + (TL_PROCESS_END_S + 1) * TL_SECOND;

enum { TRY_AGAIN = 75 };

/* How a child ended. */
typedef struct ending {
    bool known;
    bool by_signal;
    int number; /* of the signal, or the exit code */
    tl_farewell farewell;
    int code; /* announced */
} ending;

typedef struct supervisor {
    const tl_supervisor_settings *settings;
    tl_heartbeats *beats;
    tl_heartbeats_seen seen;
    tl_restarts restarts;
    tl_watchdog watchdog;
    tl_time stroke; /* interval */
    tl_time stroked, told;
    sigset_t signals; /* that are waited for */
    sigset_t before;  /* the caller's mask */
    pid_t child;      /* 0: none */
    tl_reaper reaper;
    bool killed; /* by us, and why; */
    char fault[TL_RESTARTS_REASON];
    tl_time blamed;     /* the FMU call that is to blame has lasted for so long */
    bool ran;           /* a child has been ready, */
    bool told_ready;    /* and the service manager has heard of it */
    bool stop;          /* asked to end, */
    tl_time stopping;   /* and what has passed since, of the child's life */
    unsigned bad_holds; /* safe holds in a row that failed */
} supervisor;

/* ---- the child ---- */

static void enter_child(supervisor *self, const tl_start *start, pid_t parent) {
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) {
        _exit(TRY_AGAIN); /* it was too late for that */
    }
    tl_watchdog_leave(&self->watchdog);
    tl_service_leave();
    tl_process_begin();
    tl_crash_install();
    tl_fmu_calls_use(tl_heartbeats_calls(self->beats));
    tl_interrupt_install(); /* before a signal can come: it is a wish, and no reason to drop dead */
    (void)sigprocmask(SIG_SETMASK, &self->before, NULL);
    tl_process_end(self->settings->run(self->settings->context, start));
}

/* False where there can be no process. */
static bool begin_child(supervisor *self, bool again) {
    const tl_start start = {
        .beats = self->beats,
        .restarts = &self->restarts,
        .again = again,
        .hold = tl_restarts_is_loop(&self->restarts),
    };
    pid_t parent = getpid();
    tl_heartbeats_clear(self->beats);
    self->seen = (tl_heartbeats_seen){0};
    self->killed = false;
    tl_restarts_begin(&self->restarts, again);
    (void)fflush(NULL);
    self->child = fork();
    if (self->child == 0) {
        enter_child(self, &start, parent);
    }
    if (self->child < 0) {
        self->child = 0;
        tl_log(TL_LOG_ERROR, "no process for the twin: %s", strerror(errno));
        return false;
    }
    return true;
}

/* ---- strokes ---- */

/* The last one is not retracted by what comes after it: a look that is late is a stroke that is missing. */
static void stroke(supervisor *self, tl_time now) {
    if (now - self->stroked < self->stroke) {
        return;
    }
    self->stroked = now;
    if (self->watchdog.file >= 0 && !tl_watchdog_stroke(&self->watchdog)) {
        tl_log(TL_LOG_WARNING, "watchdog %s cannot be stroked: %s", self->settings->watchdog, strerror(errno));
    }
    (void)tl_service_tell("WATCHDOG=1");
}

static void tell_status(supervisor *self, tl_time now) {
    char text[TL_HEARTBEAT_STATUS];
    char line[TL_HEARTBEAT_STATUS + 16];
    if (now - self->told >= STATUS && tl_heartbeats_get_status(self->beats, text) && text[0] != '\0') {
        self->told = now;
        (void)snprintf(line, sizeof line, "STATUS=%s", text);
        (void)tl_service_tell(line);
    }
}

/* ---- watching ---- */

/* Waits a little for a signal: `most` < 1 s. */
static void listen(supervisor *self, tl_time time) {
    const struct timespec most = {.tv_sec = 0, .tv_nsec = (long)time};
    siginfo_t info;
    int signal = sigtimedwait(&self->signals, &info, &most);
    if (signal != SIGTERM && signal != SIGINT && signal != SIGHUP) {
        return;
    }
    if (!self->stop) {
        (void)tl_service_tell("STOPPING=1");
    }
    self->stop = true;
    if (self->child > 0 && info.si_code != SI_KERNEL) { /* a terminal's Ctrl-C has reached it already */
        (void)kill(self->child, signal);
    }
}

static void note_ready(supervisor *self) {
    self->ran = self->ran || tl_heartbeats_is_ready(self->beats);
    if (self->ran && !self->told_ready) {
        self->told_ready = tl_service_tell("READY=1");
    }
}

/* The fault is in self->fault. An FMU call is to blame for it where it has lasted for most of the `time` that was waited. */
static void end_child(supervisor *self, tl_time time) {
    self->killed = true;
    self->blamed = time / 2;
    (void)kill(self->child, SIGKILL);
}

/* Asked to end, it has not: it is deaf, or hangs with a heart that beats or has more patience than we have now. */
static void look_at_clock(supervisor *self, tl_time passed) {
    self->stopping += passed < TL_HEARTBEAT_LOOK ? passed : TL_HEARTBEAT_LOOK;
    if (self->stopping > GRACE && !self->killed) {
        (void)snprintf(self->fault, sizeof self->fault, "it was told to end, and was still there %.0f s later",
                       tl_seconds(GRACE));
        end_child(self, GRACE);
    }
}

/* Everybody alive? A child with a silent thread is ended: nothing in it can be trusted to end by itself. */
static void look(supervisor *self, tl_time passed) {
    tl_time now = tl_clock_now(NULL);
    tl_time silence = 0;
    const char *silent = tl_heartbeats_look(self->beats, &self->seen, now, &silence);
    if (silent != NULL && !self->killed) {
        (void)snprintf(self->fault, sizeof self->fault, "it hung: \"%.40s\" gave no sign of life for %.1f s", silent,
                       tl_seconds(silence));
        end_child(self, silence);
    }
    if (silent != NULL) {
        return;
    }
    if (self->stop) {
        look_at_clock(self, passed);
    }
    if (self->bad_holds < TL_RESTARTS_MOST) {
        stroke(self, now);
    }
    note_ready(self);
    if (tl_heartbeats_is_ready(self->beats)) {
        tl_restarts_live(&self->restarts, passed);
        tell_status(self, now);
    }
}

/* Not reaped: that may take long (reaper.h). */
static bool has_ended(supervisor *self, ending *how) {
    siginfo_t info = {0};
    int result = waitid(P_PID, (id_t)self->child, &info, WEXITED | WNOHANG | WNOWAIT);
    if (result == 0 ? info.si_pid == 0 : errno == EINTR) {
        return false;
    }
    *how = (ending){.known = result == 0, .by_signal = info.si_code != CLD_EXITED, .number = info.si_status};
    how->farewell = tl_heartbeats_get_farewell(self->beats, &how->code);
    return true;
}

/* Until the child has ended; how it did. */
static ending watch(supervisor *self) {
    ending how;
    tl_time looked = tl_clock_now(NULL);
    for (;;) {
        listen(self, LOOK);
        if (has_ended(self, &how)) {
            note_ready(self);
            return how;
        }
        tl_time now = tl_clock_now(NULL);
        look(self, now - looked);
        looked = now;
    }
}

/* Nobody is there to be alive, until the dead child is reaped and the pause is over. */
static void rest(supervisor *self, tl_time pause) {
    tl_time begun = tl_clock_now(NULL);
    tl_time now = begun;
    bool reaped = tl_reaper_rests(&self->reaper);
    while (!self->stop && (!reaped || now - begun < pause)) {
        listen(self, reaped ? LOOK : LOOK_AT_REAPER);
        now = tl_clock_now(NULL);
        if (self->bad_holds < TL_RESTARTS_MOST && now - begun < pause + REAPING) {
            stroke(self, now);
        }
        reaped = reaped || tl_reaper_rests(&self->reaper);
    }
}

/* How it ended is known. */
static void bury(supervisor *self, const ending *how) {
    if (how->known) {
        tl_reaper_take(&self->reaper, self->child);
    }
    self->child = 0;
}

/* ---- what an end means ---- */

/* Names are those of a process that may have lost its mind. */
static void append_call(const supervisor *self, char reason[TL_RESTARTS_REASON]) {
    tl_fmu_call call;
    size_t length = strlen(reason);
    tl_time least = self->killed ? self->blamed : 0;
    if (!tl_heartbeats_get_call(self->beats, &self->seen, least, &call)) {
        return;
    }
    for (char *letter = call.fmu; *letter != '\0'; letter++) {
        *letter = (char)(*letter >= ' ' && *letter <= '~' ? *letter : '?');
    }
    (void)snprintf(reason + length, TL_RESTARTS_REASON - length, ", in %s of %s", call.function, call.fmu);
}

/* It said that it would end, and then it did as it had said. */
static bool is_as_announced(const ending *how) {
    return how->farewell != TL_FAREWELL_NONE && how->known && !how->by_signal && how->number == how->code;
}

static void describe(const supervisor *self, const ending *how, char reason[TL_RESTARTS_REASON]) {
    bool announced = how->farewell != TL_FAREWELL_NONE;
    bool as_announced = is_as_announced(how);
    if (self->killed) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "%s", self->fault);
    } else if (!how->known) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "it ended, and nobody knows how");
    } else if (how->by_signal) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "it was ended by signal %d, %s", how->number,
                       strsignal(how->number));
    } else if (how->farewell == TL_FAREWELL_ASKED && as_announced) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "it was told to end, and not by its supervisor");
    } else {
        (void)snprintf(reason, TL_RESTARTS_REASON, "it ended %swith exit code %d", announced ? "" : "unannounced, ",
                       how->number);
    }
    if (self->killed || !as_announced) {
        append_call(self, reason);
    }
}

/* The child may have left a status line on a terminal. */
static void say(tl_log_level level, const char *what, const char *reason) {
    if (isatty(STDERR_FILENO) == 1) {
        (void)fputs("\r\033[K", stderr);
    }
    tl_log(level, "%s: %s", what, reason);
}

/* The supervisor ends with it: it was asked to, the run is over, or it never ran, and who started it is told why. */
static bool is_final(const supervisor *self, const ending *how) {
    return self->stop || how->farewell == TL_FAREWELL_OVER || (how->farewell == TL_FAREWELL_REFUSED && !self->ran);
}

/* Says so where the end was no good one. */
static int final_code(const supervisor *self, const ending *how) {
    char reason[TL_RESTARTS_REASON];
    bool announced = how->farewell != TL_FAREWELL_NONE;
    describe(self, how, reason);
    if (self->killed || !announced) {
        say(TL_LOG_ERROR, "the twin failed when it was to end", reason);
        return TRY_AGAIN;
    }
    if (!is_as_announced(how)) {
        say(TL_LOG_WARNING, "the twin failed when all was done", reason);
    }
    return how->code;
}

/* None after the first failure. */
static tl_time pause_of(const supervisor *self) {
    tl_time pause = 0;
    for (unsigned i = 1; i < self->restarts.failures && pause < PAUSE_LAST; i++) {
        pause = pause == 0 ? PAUSE_FIRST : 2 * pause;
    }
    return pause;
}

/* Children one after the other; the exit code of the last. */
static int supervise(supervisor *self) {
    for (bool again = self->restarts.failures > 0;; again = true) {
        bool held = tl_restarts_is_loop(&self->restarts);
        char reason[TL_RESTARTS_REASON] = "no process could be made for it";
        if (begin_child(self, again)) {
            ending how = watch(self);
            if (is_final(self, &how)) {
                return final_code(self, &how);
            }
            bury(self, &how);
            describe(self, &how, reason);
        }
        say(TL_LOG_ERROR, "the twin failed", reason);
        self->bad_holds += held ? 1 : 0;
        tl_restarts_fail(&self->restarts, reason);
        rest(self, pause_of(self));
        if (self->stop) {
            return 0;
        }
    }
}

/* ---- begin and end ---- */

/* Above the cycle, so that one that never ends cannot keep us from looking; the children begin as ordinary ones. */
static void be_urgent(void) {
    struct sched_param parameter = {.sched_priority = sched_get_priority_max(SCHED_FIFO)};
    struct rlimit limit;
    if (geteuid() != 0 && getrlimit(RLIMIT_RTPRIO, &limit) == 0 && limit.rlim_cur < (rlim_t)parameter.sched_priority) {
        parameter.sched_priority = (int)limit.rlim_cur;
    }
    if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameter) == 0) {
        (void)mlockall(MCL_CURRENT | MCL_FUTURE);
    }
}

static tl_status open_watchdog(supervisor *self, tl_error *error) {
    tl_watchdog *watchdog = &self->watchdog;
    if (self->settings->watchdog == NULL) {
        return TL_OK;
    }
    tl_status status = tl_watchdog_open(self->settings->watchdog, self->settings->watchdog_s, watchdog, error);
    if (status == TL_OK) {
        tl_log(TL_LOG_NOTICE, "watchdog %s (%s) resets the box unless it is stroked within %d s%s",
               self->settings->watchdog, watchdog->name, watchdog->timeout_s,
               watchdog->can_be_disarmed ? "" : ", and cannot be disarmed");
    }
    return status;
}

/* A quarter of the shorter patience, and at most STROKE. */
static tl_time stroke_interval(const supervisor *self) {
    tl_time interval = STROKE;
    tl_time service = tl_service_patience() / 4;
    tl_time watchdog = self->watchdog.file >= 0 ? self->watchdog.timeout_s * TL_SECOND / 4 : 0;
    interval = service > 0 && service < interval ? service : interval;
    return watchdog > 0 && watchdog < interval ? watchdog : interval;
}

static tl_status open_all(supervisor *self, tl_error *error) {
    self->watchdog.file = -1;
    self->restarts.lock = -1;
    self->beats = tl_heartbeats_new();
    if (self->beats == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the supervisor");
    }
    tl_status status = open_watchdog(self, error);
    if (status == TL_OK) {
        status = tl_restarts_open(self->settings->state, self->watchdog.has_reset_the_box, &self->restarts, error);
    }
    self->stroke = stroke_interval(self);
    return status;
}

static void close_all(supervisor *self) {
    if (self->watchdog.file >= 0 && !tl_watchdog_close(&self->watchdog)) {
        tl_log(TL_LOG_WARNING, "watchdog %s could not be disarmed, and will reset the box", self->settings->watchdog);
    }
    tl_reaper_leave(&self->reaper);
    tl_restarts_close(&self->restarts);
    tl_heartbeats_free(self->beats);
}

int tl_supervise(const tl_supervisor_settings *settings) {
    supervisor self = {.settings = settings};
    tl_error error = {0};
    (void)sigemptyset(&self.signals);
    (void)sigaddset(&self.signals, SIGCHLD);
    (void)sigaddset(&self.signals, SIGTERM);
    (void)sigaddset(&self.signals, SIGINT);
    if (!tl_interrupt_ignores_hangup()) {
        (void)sigaddset(&self.signals, SIGHUP);
    }
    (void)sigprocmask(SIG_BLOCK, &self.signals, &self.before);
    (void)signal(SIGCHLD,
                 SIG_DFL); /* whoever started us may have ignored it, and the kernel tells nobody of an end then */
    int code = 0;
    tl_status status = open_all(&self, &error);
    if (status == TL_OK) {
        be_urgent();
        code = supervise(&self);
        tl_restarts_end(&self.restarts);
    } else {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        code = tl_exit_code(status);
    }
    close_all(&self);
    (void)sigprocmask(SIG_SETMASK, &self.before, NULL);
    return code;
}
