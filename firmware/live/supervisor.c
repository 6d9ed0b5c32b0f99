/* Supervisor: see supervisor.h. */
#include "firmware/live/supervisor.h"

#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include "board/watchdog/watchdog.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/live/child.h"
#include "firmware/process/fmu_call_timeout.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/service.h"

/* Interval of the main loop: a hang lasts that much longer than its timeout. It is shorter while an
 * event is expected, for example while a twin waits for its priority or a dead process is reaped.
 */
static const tl_time POLL = TL_SECOND / 20;
static const tl_time POLL_SOON = TL_SECOND / 500;

/* While a dead twin is being reaped, keepalives are sent for this time after its pause. */
static const tl_time REAPING = 30 * TL_SECOND;

/* First and longest pause before a restart that follows another one. */
static const tl_time PAUSE_FIRST = TL_SECOND / 4;
static const tl_time PAUSE_LAST = 8 * TL_SECOND;

/* Longest pause before a config manager for which a client waits. */
static const tl_time PAUSE_OF_CLIENT = TL_SECOND;

/* Longest pause before a recorder that writes the remaining data. */
static const tl_time PAUSE_IN_END = TL_SECOND;

/* io and recorder: after a shorter life, although it was ready, the next process starts after
 * PAUSE_FIRST; after a longer one, at once. */
static const tl_time SHORT_LIFE = TL_SECOND;

/* Longest interval of keepalives; shortest interval of status messages. */
static const tl_time KEEPALIVE = TL_SECOND;
static const tl_time STATUS = 5 * TL_SECOND;

/* Grace period of a process that was asked to end. It is longer than the timeout of a hung FMU
 * call, because a twin that ends after that timeout can still save data. */
static const tl_time GRACE = TL_FMU_CALL_TIMEOUT_END + TL_SECOND;

/* Grace period of all processes together: each has the time that those before it have left, but at
 * least GRACE_AGAIN. */
static const tl_time GRACE_OF_ALL = 8 * TL_SECOND;

/* Grace period of a process that is asked again, because the user does not want to wait. */
static const tl_time GRACE_AGAIN = 2 * TL_SECOND;

/* Shortest interval of the log lines of a restart loop. */
static const tl_time QUIET = 60 * TL_SECOND;

/* Grace period of io: none of its data is kept at the end. */
static const tl_time GRACE_OF_IO = TL_SECOND;

/* Signals within this time count as one, because a terminal and a service manager may both send
 * one. */
static const tl_time AGAIN = TL_SECOND;

enum { TRY_AGAIN = 75, FMU_FAILED = 70 };

/* Failed recorders at the end, before the remaining data is lost. A recorder that had to be killed
 * has taken so much time that it counts as two. */
enum { LAST_TRIES = 3 };

/* After so many starts of the twin without a process (about 5 min), no keepalive is sent: a reset
 * may help. */
enum { MOST_WITHOUT_PROCESS = 40 };

/* If no process could be started for the twin, the first safe hold lasts 1/12 of the usual time.
 * The process of safe hold could be started, so the system has processes again. */
enum { SHORTER_HOLD = 12 };

typedef enum state {
    ABSENT, /* not a member, or not any more */
    PAUSED, /* starts when the dead process is reaped and the pause is over */
    RUNNING
} state;

typedef struct member {
    tl_child child;
    state state;
    tl_time ended;                    /* start of the pause */
    tl_time pause;                    /* its minimum length */
    unsigned failures;                /* in a row, never ready; twin: starts without a process */
    unsigned unlogged;                /* failures that were not logged yet */
    tl_time logged;                   /* time of the last log line; 0: never */
    char failure[TL_RESTARTS_REASON]; /* reason of the last failure */
    tl_time lived;                    /* ns since its start */
    tl_time ready;                    /* time when it was seen to be ready; 0: not yet */
    tl_time sound;                    /* ns since it was ready */
    bool was_damaged;                 /* a process of this member was damaged */
    bool is_changed;                  /* asked to end so that another process replaces it */
    tl_time hold_time;                /* of safe hold, until the twin is retried */
    char reason[TL_RESTARTS_REASON];  /* shadow: why the last one ended; "": none did */
} member;

typedef struct supervisor {
    const tl_supervisor_settings *settings;
    member processes[TL_MEMBERS];
    member *members[TL_MEMBERS]; /* current roles; a swap exchanges two */
    tl_restarts restarts;        /* of the twin */
    tl_watchdog watchdog;
    tl_time keepalive_interval; /* interval */
    tl_time last_keepalive, notified;
    sigset_t signals;  /* that the supervisor waits for */
    sigset_t before;   /* the caller's mask */
    bool ran;          /* a twin has been ready */
    bool was_notified; /* and the service manager was notified */
    int stop;          /* signal that asked to end; 0: none */
    tl_time stopped;   /* time of that signal */
    bool hurries;      /* asked to end again */
    bool is_ending;    /* all processes are ending */
    tl_time ending;    /* ns since then, while this process was running */
    int code;          /* exit code of the run so far */
    int tries;         /* recorders that failed during the end */
    bool held;         /* the running twin process is in safe hold */
    bool waits;        /* only until the first twin may start */
    bool only_waited;  /* no real twin has been ready yet */
    bool retries;      /* start the next twin in spite of a restart loop */
    unsigned bad_holds;
    bool is_excused; /* the next start of the twin does not follow a failure of its own */
    bool hastens;    /* the next loop is in 2 ms */
} supervisor;

static const char *const member_names[TL_MEMBERS] = {[TL_MEMBER_RECORDER] = "the recorder",
                                                     [TL_MEMBER_IO] = "the plant reader",
                                                     [TL_MEMBER_TWIN] = "the twin",
                                                     [TL_MEMBER_SHADOW] = "the shadow",
                                                     [TL_MEMBER_CONFIG_MANAGER] = "the config manager"};

/* Order of the end: the twin needs io to its end, and both pass their last data to the recorder. */
static const tl_member end_order[TL_MEMBERS] = {TL_MEMBER_SHADOW, TL_MEMBER_CONFIG_MANAGER, TL_MEMBER_TWIN,
                                                TL_MEMBER_IO, TL_MEMBER_RECORDER};

/* Members that are started on order; the run does not depend on them. */
static bool is_ordered(tl_member which) {
    return which == TL_MEMBER_SHADOW || which == TL_MEMBER_CONFIG_MANAGER;
}

static member *twin_of(supervisor *self) {
    return self->members[TL_MEMBER_TWIN];
}

static member *shadow_of(supervisor *self) {
    return self->members[TL_MEMBER_SHADOW];
}

/* ---- keepalives ---- */

/* If the main loop is late, keepalives are missing. */
static void send_keepalive(supervisor *self, tl_time now) {
    if (self->bad_holds >= TL_RESTARTS_MOST || now - self->last_keepalive < self->keepalive_interval) {
        return;
    }
    self->last_keepalive = now;
    if (self->watchdog.file >= 0 && !tl_watchdog_keepalive(&self->watchdog)) {
        tl_log(TL_LOG_WARNING, "watchdog %s: no keepalive could be sent: %s; it may reset the box",
               self->settings->watchdog, strerror(errno));
    }
    (void)tl_service_notify("WATCHDOG=1");
}

/* The text is untrusted: a second line in it would be another message to the service manager. */
static void notify_status(supervisor *self, tl_time now) {
    char text[TL_HEARTBEAT_STATUS];
    char line[4 * TL_HEARTBEAT_STATUS + 16] = "STATUS="; /* cleaning may need 4 bytes each */
    const size_t begun = strlen(line);
    if (now - self->notified < STATUS || !tl_heartbeats_get_status(twin_of(self)->child.beats, text) ||
        text[0] == '\0') {
        return;
    }
    self->notified = now;
    (void)tl_clean_text(text, strnlen(text, sizeof text), line + begun, sizeof line - begun);
    (void)tl_service_notify(line);
}

/* ---- start ---- */

/* No pause after the first failure. */
static tl_time pause_after(unsigned failures) {
    tl_time pause = 0;
    for (unsigned i = 1; i < failures && pause < PAUSE_LAST; i++) {
        pause = pause == 0 ? PAUSE_FIRST : 2 * pause;
    }
    return pause;
}

static void begin_pause(member *paused, tl_time now, tl_time pause) {
    paused->state = PAUSED;
    paused->ended = now;
    paused->pause = pause;
}

/* A member that was ready before can be ready again soon: retry a device or a disk as soon as
 * possible. */
static tl_time pause_of_other(member *failed) {
    if (tl_heartbeats_is_ready(failed->child.beats)) {
        failed->failures = 0;
        return failed->lived < SHORT_LIFE ? PAUSE_FIRST : 0;
    }
    failed->failures++;
    return pause_after(failed->failures);
}

static void end_all(supervisor *self, int code) {
    self->is_ending = true;
    self->code = self->code != 0 ? self->code : code;
}

/* Logs a failure; if `is_reported`, also records it as an event. */
static void log_failure(supervisor *self, tl_member which, const char *when, const char *reason, bool is_followed,
                        bool is_reported) {
    char text[TL_RESTARTS_REASON + 128];
    (void)snprintf(text, sizeof text, "%s failed%s: %s%s", member_names[which], when, reason,
                   is_followed ? "; it is restarted" : "");
    tl_log(TL_LOG_ERROR, "%s", text);
    if (is_reported) {
        self->settings->report(self->settings->context, text);
    }
}

/* Logs failures of a member that is restarted: the first at once, later ones once a minute. */
static void log_failures(supervisor *self, tl_member which, tl_time now) {
    member *failed = self->members[which];
    char times[48] = "";
    if (failed->unlogged == 0 || (failed->logged != 0 && now - failed->logged < QUIET)) {
        return;
    }
    if (failed->logged != 0 && failed->unlogged > 1) {
        (void)snprintf(times, sizeof times, " %u more times, the last time", failed->unlogged);
    }
    log_failure(self, which, times, failed->failure, failed->state != ABSENT, true);
    failed->unlogged = 0;
    failed->logged = now;
}

static void count_failure(supervisor *self, tl_member which, tl_time now, const char *reason) {
    member *failed = self->members[which];
    (void)snprintf(failed->failure, sizeof failed->failure, "%.*s", TL_RESTARTS_REASON - 1, reason);
    failed->unlogged++;
    log_failures(self, which, now);
}

static tl_wait wait_of(const supervisor *self) {
    return self->settings->wait != NULL ? self->settings->wait(self->settings->context) : TL_WAIT_OVER;
}

/* Returns the start information of a new twin, and counts the start in the restart record. */
static tl_start start_of_twin(supervisor *self) {
    const tl_time first = self->settings->hold_time > 0 ? self->settings->hold_time : TL_RESTARTS_HOLD;
    tl_start start = {.unreadable = self->restarts.unreadable,
                      .tries = self->restarts.tries,
                      .again = self->restarts.failures > 0 || self->is_excused,
                      .failures = self->restarts.failures,
                      .missing = twin_of(self)->failures};
    bool is_failing = start.failures >= TL_RESTARTS_MOST;
    bool is_loop = is_failing || start.missing >= TL_RESTARTS_MOST;
    bool holds = is_loop && !self->retries;
    self->waits = !holds && wait_of(self) != TL_WAIT_OVER;
    self->held = holds || self->waits;
    start.hold = self->held;
    start.hold_time = tl_restarts_hold_time(&self->restarts, is_failing ? first : first / SHORTER_HOLD);
    start.waits = self->waits;
    if (!self->waits) {
        self->retries = false;
        self->is_excused = false;
        tl_restarts_begin(&self->restarts, start.again);
    }
    start.starts = self->restarts.starts;
    start.restarts = self->restarts.restarts;
    memcpy(start.reason, self->restarts.reason, sizeof start.reason);
    return start;
}

/* The kernel provided no process: that is no failure of the member. At the end, starts are not
 * retried for ever. */
static void note_no_process(supervisor *self, tl_member which, tl_time now, bool again, const tl_error *error) {
    member *missing = self->members[which];
    bool is_last = self->is_ending && ++self->tries >= LAST_TRIES;
    if (is_last || which == TL_MEMBER_SHADOW || (which == TL_MEMBER_TWIN && self->settings->unsupervised)) {
        tl_log(TL_LOG_ERROR, "%s could not be started: %s", member_names[which], error->text);
        missing->state = ABSENT;
        if (which != TL_MEMBER_SHADOW) {
            end_all(self, TRY_AGAIN);
        }
        return;
    }
    missing->failures++;
    if (which == TL_MEMBER_TWIN) {
        tl_restarts_undo(&self->restarts, again);
        self->is_excused = true;
        tl_restarts_excuse(&self->restarts, error->text);
    }
    begin_pause(missing, now, pause_after(missing->failures));
    count_failure(self, which, now, error->text);
}

static void begin_member(supervisor *self, tl_member which, tl_time now) {
    member *begun = self->members[which];
    tl_start start = {.unreadable = self->restarts.unreadable};
    tl_error error = {0};
    tl_child_prepare(&begun->child);
    begun->lived = 0;
    begun->ready = 0;
    begun->sound = 0;
    begun->is_changed = false;
    begun->reason[0] = '\0';
    if (which == TL_MEMBER_TWIN) {
        start = start_of_twin(self);
    }
    pid_t pid = self->settings->begin(self->settings->context, which, &start, &error);
    if (pid == 0) {
        note_no_process(self, which, now, start.again, &error);
        return;
    }
    begun->child.pid = pid;
    begun->state = RUNNING;
    begun->hold_time = start.hold_time;
    begun->failures = which == TL_MEMBER_TWIN ? 0 : begun->failures;
}

/* ---- ends ---- */

/* Returns true if the member was asked to end before it could handle signals, and had no data to
 * save yet. */
static bool was_asked_early(const supervisor *self, tl_member which) {
    const tl_child *child = &self->members[which]->child;
    const tl_child_end *end = &child->end;
    bool has_nothing = which != TL_MEMBER_RECORDER || !self->ran;
    return has_nothing && child->asked && end->by_signal &&
           (end->number == SIGTERM || end->number == SIGINT || end->number == SIGHUP) &&
           !tl_heartbeats_is_ready(child->beats);
}

/* Logs a failure and records it. For a twin that is restarted, the start information of the next
 * twin has the reason instead. */
static void report_failure(supervisor *self, tl_member which, const char *reason, bool is_followed) {
    bool was_asked = self->is_ending && self->members[which]->child.asked;
    log_failure(self, which, was_asked ? " at the end of the run" : "", reason, is_followed,
                which != TL_MEMBER_TWIN || !is_followed);
}

/* The exit code of a process that ends last: it may have failed at the end, or could not save
 * everything. If the run is not supervised, an FMU that ends its process decides the exit code. */
static void set_last_code(supervisor *self, tl_member which, const char *reason) {
    const tl_child *child = &self->members[which]->child;
    bool is_reported = self->settings->unsupervised && which == TL_MEMBER_TWIN;
    if (was_asked_early(self, which)) {
        end_all(self, 0);
        return;
    }
    if (child->killed || child->end.announced_cause == TL_END_CAUSE_NONE) {
        report_failure(self, which, reason, false);
        end_all(self, which == TL_MEMBER_IO ? 0 : is_reported && !child->killed ? FMU_FAILED : TRY_AGAIN);
        return;
    }
    if (!tl_child_ended_as_announced(child)) {
        tl_log(TL_LOG_WARNING, "%s failed after it had finished its work: %s", member_names[which], reason);
        end_all(self, is_reported ? FMU_FAILED : 0);
    }
    end_all(self, child->end.code);
}

/* The data that a failed recorder has not written is in shared memory that outlives it: another one
 * can write it. */
static bool is_worth_another(supervisor *self, tl_member which) {
    const tl_child *child = &self->members[which]->child;
    if (which != TL_MEMBER_RECORDER || !self->is_ending || was_asked_early(self, which) ||
        child->end.announced_cause != TL_END_CAUSE_NONE) {
        return false;
    }
    self->tries += child->killed ? 2 : 1;
    return self->tries < LAST_TRIES;
}

/* Returns true if the run ends with this process: the run was asked to end or is over, or nothing
 * ever ran and the exit code reports why. */
static bool is_final(const supervisor *self, tl_member which) {
    const tl_child *child = &self->members[which]->child;
    bool never_ran = !self->ran || (which == TL_MEMBER_TWIN && self->only_waited);
    bool refused = child->end.announced_cause == TL_END_CAUSE_REFUSED;
    return self->is_ending || (refused && never_ran) ||
           (which == TL_MEMBER_TWIN && child->end.announced_cause == TL_END_CAUSE_OVER);
}

/* The run is not supervised: the twin is not restarted. */
static void end_alone(supervisor *self, const char *reason) {
    const tl_child *child = &twin_of(self)->child;
    if (child->end.announced_cause == TL_END_CAUSE_FAILED && tl_child_ended_as_announced(child)) {
        end_all(self, child->end.code); /* the twin has logged the reason */
        return;
    }
    report_failure(self, TL_MEMBER_TWIN, reason, false);
    end_all(self, FMU_FAILED);
}

/* By a user or the kernel (out of memory), not by this run. */
static bool was_killed_by_others(const tl_child *child) {
    return child->end.by_signal && child->end.number == SIGKILL && !child->killed;
}

/* The handover control decides what follows. */
static void note_end_of_shadow(supervisor *self) {
    member *ended = shadow_of(self);
    tl_child_describe(&ended->child, ended->reason);
    (void)self->settings->ended(self->settings->context, TL_MEMBER_SHADOW, was_killed_by_others(&ended->child),
                                ended->reason);
    tl_child_reap(&ended->child);
    ended->state = ABSENT;
}

/* The next config manager finishes its work. */
static void note_end_of_manager(supervisor *self, tl_time now) {
    member *ended = self->members[TL_MEMBER_CONFIG_MANAGER];
    char reason[TL_RESTARTS_REASON];
    bool is_orderly = tl_child_ended_as_announced(&ended->child) && ended->child.end.code == 0;
    tl_child_describe(&ended->child, reason);
    tl_child_reap(&ended->child);
    ended->state = ABSENT;
    ended->failures = is_orderly ? 0 : ended->failures + 1;
    if (!is_orderly && !self->is_ending) {
        begin_pause(ended, now, pause_after(ended->failures + 1));
        count_failure(self, TL_MEMBER_CONFIG_MANAGER, now, reason);
    }
}

static void note_end(supervisor *self, tl_member which, tl_time now) {
    member *ended = self->members[which];
    tl_child_end *end = &ended->child.end;
    char reason[TL_RESTARTS_REASON];
    if (which == TL_MEMBER_TWIN && end->announced_cause == TL_END_CAUSE_OVER && !self->settings->has_duration) {
        end->announced_cause = TL_END_CAUSE_NONE; /* FMUs can write this announcement */
    }
    bool is_last = is_final(self, which) && !is_worth_another(self, which);
    bool is_alone = which == TL_MEMBER_TWIN && self->settings->unsupervised;
    tl_child_describe(&ended->child, reason);
    tl_restarts_note_unreadable(&self->restarts, self->settings->ended(self->settings->context, which,
                                                                       was_killed_by_others(&ended->child), reason));
    if (ended->is_changed && tl_child_ended_as_announced(&ended->child) &&
        end->code == 0) { /* it was asked to end for a replacement */
        tl_child_reap(&ended->child);
        begin_pause(ended, now, 0);
        return;
    }
    if (is_last) {
        ended->state = ABSENT;
        set_last_code(self, which, reason);
        return;
    }
    if (is_alone) {
        ended->state = ABSENT;
        end_alone(self, reason);
        return;
    }
    bool is_single = which == TL_MEMBER_TWIN && !self->held; /* few: a loop ends in safe hold */
    if (is_single || self->is_ending) {
        report_failure(self, which, reason, true);
    } else {
        count_failure(self, which, now, reason);
    }
    tl_child_reap(&ended->child);
    if (which == TL_MEMBER_TWIN) { /* the next start reports the reason */
        self->bad_holds += self->held ? 1 : 0;
        tl_restarts_fail(&self->restarts, reason);
    }
    begin_pause(ended, now, which == TL_MEMBER_TWIN ? pause_after(self->restarts.failures) : pause_of_other(ended));
}

/* ---- monitoring ---- */

/* The user who asks again does not want to wait: a hung FMU call is not waited for either. */
static void shorten_end(supervisor *self, int signal) {
    self->hurries = true;
    tl_log(TL_LOG_NOTICE, "asked again to end: processes that still run after %.0f s are killed",
           tl_seconds(GRACE_AGAIN));
    for (tl_member which = 0; which < TL_MEMBERS; which++) {
        member *asked = self->members[which];
        if (asked->state == RUNNING && asked->child.asked) {
            tl_child_request_end(&asked->child, which == TL_MEMBER_TWIN ? signal : SIGTERM);
        }
    }
}

static void stop_run(supervisor *self, int signal) {
    tl_time now = tl_clock_now(NULL);
    if (self->stop == 0) {
        (void)tl_service_notify("STOPPING=1");
        self->stop = signal;
        self->stopped = now;
        end_all(self, 0);
        if (twin_of(self)->state == RUNNING && shadow_of(self)->state != RUNNING) {
            tl_child_request_end(&twin_of(self)->child, signal);
        }
    } else if (now - self->stopped >= AGAIN && !self->hurries) {
        shorten_end(self, signal);
    }
}

/* Waits for a signal. `time` < 1 s, in ns. */
static void wait_signal(supervisor *self, tl_time time) {
    const struct timespec most = {.tv_sec = 0, .tv_nsec = (long)time};
    int signal = sigtimedwait(&self->signals, NULL, &most);
    if (signal == SIGTERM || signal == SIGINT || signal == SIGHUP) {
        stop_run(self, signal);
    }
}

/* If safe hold lasted for its time, a twin follows. */
static void retry_from_hold(supervisor *self) {
    member *holding = twin_of(self);
    if (holding->sound >= holding->hold_time && !holding->child.asked && !self->is_ending) {
        self->bad_holds = 0;
        self->retries = true;
        tl_restarts_retry(&self->restarts);
        tl_log(TL_LOG_NOTICE, "safe hold ends: retry %u of the twin", self->restarts.tries);
        holding->is_changed = true;
        tl_child_request_end(&holding->child, SIGTERM);
    }
}

/* Called for a twin that is ready. */
static void note_ready(supervisor *self, tl_time now, tl_time passed) {
    self->ran = true;
    self->only_waited = self->waits;
    if (!self->was_notified) {
        self->was_notified = tl_service_notify("READY=1");
    }
    if (self->held && !self->waits) {
        retry_from_hold(self);
    } else if (!self->held) {
        tl_restarts_live(&self->restarts, passed);
    }
    notify_status(self, now);
}

/* Returns true if the process was found damaged and was killed. */
static bool check_damage(supervisor *self, tl_member which, tl_time now, tl_time passed) {
    member *living = self->members[which];
    living->sound += living->ready != 0 ? passed : 0;
    if (living->ready == 0 && tl_heartbeats_is_ready(living->child.beats)) {
        living->ready = now;
    }
    bool is_believed = !living->was_damaged || living->sound > TL_RESTARTS_FORGIVEN;
    /* Damage found before the process was ready was left by its predecessor and is repaired. */
    bool damaged = is_believed && living->ready != 0 && !living->child.asked &&
                   self->settings->damaged(self->settings->context, which) > living->ready;
    if (damaged) {
        living->was_damaged = true;
        tl_child_kill(&living->child, INT64_MAX,
                      "killed: it has corrupted its memory: the recorder cannot read its records");
    }
    return damaged;
}

static tl_time grace_of(supervisor *self, tl_member which) {
    if (self->hurries || (is_ordered(which) && self->is_ending)) {
        return GRACE_AGAIN;
    }
    if (which == TL_MEMBER_IO) {
        return GRACE_OF_IO;
    }
    tl_time remaining = GRACE_OF_ALL - (self->ending - self->members[which]->child.asking);
    remaining = remaining < GRACE ? remaining : GRACE;
    return remaining > GRACE_AGAIN ? remaining : GRACE_AGAIN;
}

/* If the run is not supervised, the limit is longer, because no other twin would follow. A debugger
 * may hold the process for any time. */
static bool is_to_be_killed(supervisor *self, tl_member which, const char *silent, tl_time silence) {
    member *living = self->members[which];
    if (silent == NULL || which != TL_MEMBER_TWIN || !self->settings->unsupervised) {
        return silent != NULL;
    }
    if (silence / TL_FMU_CALL_TIMEOUT_CALLS <= self->settings->call_limit) {
        return false;
    }
    bool is_held = tl_process_is_stopped(living->child.pid);
    if (is_held) {
        tl_child_restart_timeouts(&living->child);
    }
    return !is_held;
}

static void monitor_running(supervisor *self, tl_member which, tl_time now, tl_time passed) {
    member *living = self->members[which];
    bool is_twin = which == TL_MEMBER_TWIN;
    tl_time silence = 0;
    const char *silent = tl_heartbeats_read(living->child.beats, &living->child.seen, now, &silence);
    if (is_to_be_killed(self, which, silent, silence)) {
        tl_child_kill(&living->child, silence, "killed: no heartbeat from \"%.40s\" for %.1f s", silent,
                      tl_seconds(silence));
        return;
    }
    if (check_damage(self, which, now, passed)) {
        return;
    }
    tl_child_kill_late(&living->child, passed, grace_of(self, which));
    living->lived += passed;
    if (!is_twin) {
        return;
    }
    send_keepalive(self, now);
    if (living->child.asked && !tl_fmu_calls_end_is_requested(&living->child.beats->calls)) {
        (void)kill(living->child.pid, living->child.signal);
    }
    if (tl_heartbeats_is_ready(living->child.beats)) {
        note_ready(self, now, passed);
        if (self->waits && !living->child.asked && wait_of(self) == TL_WAIT_OVER) { /* the first twin may start */
            living->is_changed = true;
            tl_child_request_end(&living->child, SIGTERM);
        }
    }
}

/* Starts it after its pause; at the end of all only a recorder, which has data to write. */
static void monitor_paused(supervisor *self, tl_member which, tl_time now) {
    member *paused = self->members[which];
    bool is_reaped = tl_reaper_is_idle(&paused->child.reaper);
    bool waits = which == TL_MEMBER_TWIN && wait_of(self) == TL_WAIT_BRIEF;
    tl_time pause = self->is_ending && paused->pause > PAUSE_IN_END ? PAUSE_IN_END : paused->pause;
    bool needs_keepalive = now - paused->ended < paused->pause + REAPING && paused->failures < MOST_WITHOUT_PROCESS;
    if (which == TL_MEMBER_TWIN && (waits || needs_keepalive)) {
        send_keepalive(self, now);
    }
    if (self->is_ending && which != TL_MEMBER_RECORDER) {
        paused->state = ABSENT;
    } else if (is_reaped && !waits && now - paused->ended >= pause) {
        begin_member(self, which, now);
    }
}

static void monitor_member(supervisor *self, tl_member which, tl_time now, tl_time passed) {
    member *member_ = self->members[which];
    log_failures(self, which, now);
    switch (member_->state) {
    case ABSENT:
        break;
    case PAUSED:
        monitor_paused(self, which, now);
        break;
    case RUNNING:
        if (!tl_child_has_ended(&member_->child)) {
            monitor_running(self, which, now, passed);
        } else if (which == TL_MEMBER_SHADOW) {
            note_end_of_shadow(self);
        } else if (which == TL_MEMBER_CONFIG_MANAGER) {
            note_end_of_manager(self, now);
        } else {
            self->ran = self->ran || (which == TL_MEMBER_TWIN && tl_heartbeats_is_ready(member_->child.beats));
            note_end(self, which, now);
        }
        break;
    }
}

/* Asks the next process to end. Returns true if none is left. A killed config manager is not waited
 * for, because a failed disk may delay its death. */
static bool continue_end(supervisor *self, tl_time now) {
    for (int i = 0; i < TL_MEMBERS; i++) {
        member *next = self->members[end_order[i]];
        if (next->state == ABSENT ||
            (end_order[i] == TL_MEMBER_CONFIG_MANAGER && next->state == RUNNING && next->child.killed)) {
            continue;
        }
        /* A recorder that has just started would be killed by the signal, and there is data to
         * write. */
        bool is_young = end_order[i] == TL_MEMBER_RECORDER && self->ran && next->lived < GRACE_AGAIN &&
                        !tl_heartbeats_is_ready(next->child.beats);
        if (next->state == RUNNING && !next->child.asked && !is_young) {
            tl_child_request_end(&next->child,
                                 self->stop != 0 && end_order[i] == TL_MEMBER_TWIN ? self->stop : SIGTERM);
        }
        if (twin_of(self)->state == ABSENT) { /* else its heartbeats decide about it */
            send_keepalive(self, now);
        }
        return false;
    }
    return true;
}

/* ---- orders ---- */

/* A config manager ends when it has no work; it restarts sooner if a client waits. */
static void update_ordered(supervisor *self, tl_member which, bool wanted, tl_time now) {
    member *ordered = self->members[which];
    bool shall_be = wanted && !self->is_ending;
    if (which == TL_MEMBER_SHADOW && ordered->state == RUNNING && !shall_be && !ordered->child.asked) {
        tl_child_request_end(&ordered->child, SIGTERM);
        return;
    }
    bool is_due = ordered->state == ABSENT || (ordered->state == PAUSED && now - ordered->ended >= PAUSE_OF_CLIENT);
    if (is_due && shall_be && tl_reaper_is_idle(&ordered->child.reaper)) {
        begin_member(self, which, now);
    }
}

static void swap_twins(supervisor *self, tl_time now) {
    member *before = twin_of(self);
    member *after = shadow_of(self);
    self->members[TL_MEMBER_TWIN] = after;
    self->members[TL_MEMBER_SHADOW] = before;
    before->state = before->state == RUNNING ? RUNNING : ABSENT;
    before->reason[0] = '\0';
    self->held = false;
    if (after->state != RUNNING) {
        tl_restarts_excuse(&self->restarts,
                           after->reason[0] != '\0' ? after->reason : "the shadow had ended before the handover");
        self->is_excused = true;
        begin_pause(after, now, 0);
    }
}

/* A recorder that ended with the run may have left data for another one. */
static void change_recorder(supervisor *self, tl_time now) {
    member *recorder = self->members[TL_MEMBER_RECORDER];
    if (recorder->state == RUNNING && !recorder->child.asked && tl_heartbeats_is_ready(recorder->child.beats)) {
        recorder->is_changed = true;
        tl_child_request_end(&recorder->child, SIGTERM);
    } else if (recorder->state == ABSENT && recorder->child.pid != 0) {
        tl_child_reap(&recorder->child);
        begin_pause(recorder, now, 0);
    }
}

static void poll_orders(supervisor *self, tl_time now) {
    tl_orders orders = {.end = false};
    self->settings->read_orders(self->settings->context, self->is_ending, &orders);
    self->hastens = orders.soon;
    if (orders.end) {
        end_all(self, 0);
    }
    if (orders.kill_twin && twin_of(self)->state == RUNNING) {
        tl_child_kill(&twin_of(self)->child, 0, "killed: it did not end its run at the handover");
    }
    if (orders.swap && !self->is_ending) {
        swap_twins(self, now);
    }
    update_ordered(self, TL_MEMBER_SHADOW, orders.shadow, now);
    update_ordered(self, TL_MEMBER_CONFIG_MANAGER, orders.config_manager, now);
    if (orders.recorder) {
        change_recorder(self, now);
    }
}

/* ---- the run ---- */

/* Members on order need no fast loop. */
static bool is_something_about_to_happen(supervisor *self) {
    bool is_about = self->is_ending || self->hastens;
    for (tl_member which = 0; which < TL_MEMBER_SHADOW; which++) {
        member *member_ = self->members[which];
        is_about = is_about || (member_->state == PAUSED && !tl_reaper_is_idle(&member_->child.reaper)) ||
                   (member_->state == RUNNING && !tl_heartbeats_is_ready(member_->child.beats));
    }
    return is_about;
}

/* Runs until no process is left. Returns the exit code. */
static int run_members(supervisor *self) {
    tl_time polled = tl_clock_now(NULL);
    for (tl_member which = 0; which < TL_MEMBERS; which++) {
        if (which == TL_MEMBER_TWIN && wait_of(self) != TL_WAIT_OVER) {
            begin_pause(twin_of(self), polled, 0);
        } else if (self->settings->beats[which] != NULL && !is_ordered(which)) {
            begin_member(self, which, polled);
        }
    }
    for (;;) {
        wait_signal(self, is_something_about_to_happen(self) ? POLL_SOON : POLL);
        tl_time now = tl_clock_now(NULL);
        for (tl_member which = 0; which < TL_MEMBERS; which++) {
            monitor_member(self, which, now, now - polled);
        }
        self->ending += self->is_ending ? tl_child_passed(now - polled) : 0;
        polled = now;
        poll_orders(self, now);
        if (self->is_ending && continue_end(self, now)) {
            break;
        }
    }
    for (tl_member which = 0; which < TL_MEMBERS; which++) {
        log_failures(self, which, INT64_MAX);
    }
    return self->code;
}

/* ---- open and close ---- */

/* The priority is above that of the cycle, so that an endless cycle cannot block the supervisor.
 * Children start with ordinary priority. */
static void set_realtime(void) {
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
        tl_log(TL_LOG_NOTICE, "watchdog %s (%s): resets the box if it gets no keepalive for %d s%s",
               self->settings->watchdog, watchdog->name, watchdog->timeout_s,
               watchdog->can_be_disarmed ? "" : "; it cannot be disarmed");
    }
    return status;
}

/* A quarter of the shorter watchdog timeout, at most KEEPALIVE. */
static tl_time find_keepalive_interval(const supervisor *self) {
    tl_time interval = KEEPALIVE;
    tl_time service = tl_service_watchdog_period() / 4;
    tl_time watchdog = self->watchdog.file >= 0 ? self->watchdog.timeout_s * TL_SECOND / 4 : 0;
    interval = service > 0 && service < interval ? service : interval;
    return watchdog > 0 && watchdog < interval ? watchdog : interval;
}

static tl_status open_all(supervisor *self, tl_error *error) {
    self->watchdog.file = -1;
    self->restarts.lock = -1;
    for (tl_member which = 0; which < TL_MEMBERS; which++) {
        self->members[which] = &self->processes[which];
        self->members[which]->child = (tl_child){.beats = self->settings->beats[which]};
    }
    tl_status status = open_watchdog(self, error);
    if (status == TL_OK) {
        status = tl_restarts_open(self->settings->state, self->watchdog.has_reset_the_box, &self->restarts, error);
    }
    if (tl_restarts_is_loop(&self->restarts)) { /* a start of the box counts as a retry */
        tl_restarts_retry(&self->restarts);
    }
    self->retries = true;
    self->is_excused = self->restarts.interrupted;
    self->keepalive_interval = find_keepalive_interval(self);
    return status;
}

static void close_all(supervisor *self) {
    if (self->watchdog.file >= 0 && !tl_watchdog_close(&self->watchdog)) {
        tl_log(TL_LOG_WARNING, "watchdog %s: could not be disarmed: it resets the box in %d s",
               self->settings->watchdog, self->watchdog.timeout_s);
    }
    for (tl_member which = 0; which < TL_MEMBERS; which++) {
        tl_reaper_stop(&self->members[which]->child.reaper);
    }
    (void)munlockall(); /* the caller may need large memory */
    tl_restarts_close(&self->restarts);
}

void tl_supervisor_block_signals(sigset_t *blocked, sigset_t *before) {
    (void)sigemptyset(blocked);
    (void)sigaddset(blocked, SIGCHLD);
    (void)sigaddset(blocked, SIGTERM);
    (void)sigaddset(blocked, SIGINT);
    if (!tl_interrupt_ignores_hangup()) {
        (void)sigaddset(blocked, SIGHUP);
    }
    (void)pthread_sigmask(SIG_BLOCK, blocked, before);
}

int tl_supervise(const tl_supervisor_settings *settings, int *stopped) {
    supervisor self = {.settings = settings};
    tl_error error = {0};
    tl_supervisor_block_signals(&self.signals, &self.before);
    (void)signal(SIGCHLD, SIG_DFL); /* if ignored by the parent process, no ends are reported */
    int code = 0;
    tl_status status = open_all(&self, &error);
    if (status == TL_OK) {
        if (!settings->unsupervised) {
            set_realtime();
        }
        code = run_members(&self);
        tl_restarts_end(&self.restarts);
    } else {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        code = tl_exit_code(status);
    }
    close_all(&self);
    (void)pthread_sigmask(SIG_SETMASK, &self.before, NULL);
    if (stopped != NULL) {
        *stopped = self.stop;
    }
    return code;
}
