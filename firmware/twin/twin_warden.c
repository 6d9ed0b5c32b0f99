/* The warden of a process with FMUs: see twin_warden.h. */
#include "firmware/twin/twin_warden.h"

#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/base/side_thread.h"
#include "firmware/process/fmu_patience.h"
#include "firmware/process/interrupt.h"
#include "firmware/text/relay.h"

enum { LOOK_MS = 50, STACK = 256 * 1024 /* the supervisor locks it */ };

struct tl_twin_warden {
    tl_twin_warden_settings settings;
    pthread_t thread;
    int stop;     /* eventfd: told to end */
    int start;    /* -1: the process has handed over what it had to */
    int listener; /* what it was; -1: nothing */
    tl_fmu_patience patience;
    tl_time pass_on_at;   /* a signal that came; again, since an FMU may have swallowed it */
    pthread_mutex_t lock; /* of all below */
    tl_relay output;
    tl_relay page;
    bool output_ended;
    bool page_ended;
    bool may_kill;                    /* its number is its own */
    char killed[TL_TWIN_WARDEN_TEXT]; /* why; "": not */
    tl_fmu_refusals refusals;
};

/* ---- what it prints ---- */

/* A line of our own log begins with its level, as in a journal; any other is an FMU's. */
static void pass_output(void *context, const char *line) {
    (void)context;
    if (line[0] == '<' && line[1] >= '0' && line[1] <= '7' && line[2] == '>') {
        tl_log((tl_log_level)(line[1] - '0'), "%s", line + 3);
    } else {
        tl_log_plain(line);
    }
}

static void pass_page(void *context, const char *line) {
    (void)fprintf(context, "%s\n", line);
}

static void drain(tl_twin_warden *self) {
    self->output_ended = self->output_ended || !tl_relay_drain(&self->output);
    self->page_ended = self->page_ended || !tl_relay_drain(&self->page);
}

/* ---- its end ---- */

static void nudge(const tl_twin_warden *self) {
    if (self->settings.channel != NULL) {
        tl_channel_nudge(self->settings.channel);
    }
}

static void kill_it(tl_twin_warden *self, const char *why) {
    if (self->killed[0] == '\0' && self->may_kill) {
        (void)snprintf(self->killed, sizeof self->killed, "%s", why);
        (void)kill(self->settings.process, SIGKILL);
        nudge(self);
    }
}

static void look_at_calls(tl_twin_warden *self) {
    char text[256];
    tl_fmu_call call;
    bool is_called = tl_fmu_calls_look(self->settings.calls, &call);
    const tl_fmu_patience_view view = {
        .now = tl_clock_now(NULL),
        .call = is_called ? &call : NULL,
        .asked = tl_interrupt_requested(),
        .times = tl_interrupt_times(),
    };
    if (tl_fmu_patience_is_over(&self->patience, &view, text, sizeof text)) {
        kill_it(self, text);
    }
}

static void look_at_bounds(tl_twin_warden *self) {
    char found[TL_BOUNDS_TEXT];
    char text[TL_TWIN_WARDEN_TEXT];
    if (self->may_kill && !tl_bounds_are_kept(&self->settings.bounds, self->settings.process, found)) {
        (void)snprintf(text, sizeof text, "the process of the FMUs was killed: %s", found);
        kill_it(self, text);
    }
}

static void pass_signal_on(tl_twin_warden *self) {
    int asked = tl_interrupt_signal();
    tl_time now = tl_clock_now(NULL);
    if (asked != 0 && self->may_kill && now >= self->pass_on_at) {
        self->pass_on_at = now + TL_SECOND / 2;
        (void)kill(self->settings.process, asked);
    }
}

/* ---- refused calls ---- */

/* What the process has sent: the descriptor that tells of refused calls; -1: the kernel has none, or nothing is refused. */
static int receive_listener(int socket) {
    char byte = 0;
    struct iovec content = {.iov_base = &byte, .iov_len = 1};
    union {
        struct cmsghdr aligned;
        char bytes[CMSG_SPACE(sizeof(int))];
    } control = {.bytes = {0}};
    struct msghdr message = {
        .msg_iov = &content, .msg_iovlen = 1, .msg_control = control.bytes, .msg_controllen = sizeof control};
    int listener = -1;
    ssize_t length = recvmsg(socket, &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
    const struct cmsghdr *header = length > 0 ? CMSG_FIRSTHDR(&message) : NULL;
    if (header != NULL && header->cmsg_level == SOL_SOCKET && header->cmsg_type == SCM_RIGHTS &&
        header->cmsg_len == CMSG_LEN(sizeof listener)) {
        memcpy(&listener, CMSG_DATA(header), sizeof listener);
    }
    return listener;
}

/* One, with the lock: others look at what was said before. NULL: none waits. */
static const char *answer_one(tl_twin_warden *self) {
    (void)pthread_mutex_lock(&self->lock);
    const char *said = tl_fmu_refusals_answer(&self->refusals, self->listener, self->settings.calls);
    (void)pthread_mutex_unlock(&self->lock);
    return said;
}

/* Who hears of it may wait for one who waits for our lock. */
static void answer_refusals(tl_twin_warden *self) {
    const char *said = NULL;
    while ((said = answer_one(self)) != NULL) {
        tl_log(TL_LOG_WARNING, "%s", said);
        if (self->settings.hear != NULL) {
            self->settings.hear(self->settings.context, said);
        }
    }
}

/* ---- the thread ---- */

enum { STOP, OUTPUT, PAGE, START, LISTENER, WATCHED };

static void close_if_open(int descriptor) {
    if (descriptor >= 0) {
        (void)close(descriptor);
    }
}

/* Ended pipes are left out: they would be ready for ever. */
static void fill(tl_twin_warden *self, struct pollfd watched[WATCHED]) {
    (void)pthread_mutex_lock(&self->lock);
    watched[STOP] = (struct pollfd){.fd = self->stop, .events = POLLIN};
    watched[OUTPUT] = (struct pollfd){.fd = self->output_ended ? -1 : self->settings.output, .events = POLLIN};
    watched[PAGE] = (struct pollfd){.fd = self->page_ended ? -1 : self->settings.page, .events = POLLIN};
    watched[START] = (struct pollfd){.fd = self->start, .events = POLLIN};
    watched[LISTENER] = (struct pollfd){.fd = self->listener, .events = POLLIN};
    (void)pthread_mutex_unlock(&self->lock);
}

static void look_at_refusals(tl_twin_warden *self, const struct pollfd watched[WATCHED]) {
    if (watched[START].revents != 0) {
        self->listener = receive_listener(self->start);
        (void)close(self->start);
        self->start = -1;
    }
    answer_refusals(self);
    if ((watched[LISTENER].revents & (POLLHUP | POLLERR)) != 0) {
        (void)close(self->listener);
        self->listener = -1;
    }
}

static void look_at_output(tl_twin_warden *self) {
    (void)pthread_mutex_lock(&self->lock);
    bool had_ended = self->output_ended;
    drain(self);
    if (self->output_ended && !had_ended) {
        nudge(self); /* it ends, or has closed what it was given */
    }
    (void)pthread_mutex_unlock(&self->lock);
}

static void look_at_process(tl_twin_warden *self) {
    (void)pthread_mutex_lock(&self->lock);
    if (self->settings.passes_signals) {
        pass_signal_on(self);
        look_at_calls(self);
    }
    look_at_bounds(self);
    (void)pthread_mutex_unlock(&self->lock);
}

static void *watch(void *context) {
    tl_twin_warden *self = context;
    tl_time next = 0;
    for (;;) {
        struct pollfd watched[WATCHED];
        fill(self, watched);
        (void)poll(watched, WATCHED, LOOK_MS);
        if (watched[STOP].revents != 0) {
            return NULL;
        }
        look_at_output(self);
        look_at_refusals(self, watched);
        tl_time now = tl_clock_now(NULL);
        if (now >= next) {
            next = now + LOOK_MS * (TL_SECOND / 1000);
            look_at_process(self);
        }
    }
}

/* ---- for others ---- */

/* Its thread does not run. */
static void release(tl_twin_warden *self) {
    tl_relay_close(&self->output);
    if (self->settings.page >= 0) {
        tl_relay_close(&self->page);
    }
    close_if_open(self->listener);
    close_if_open(self->start);
    close_if_open(self->stop);
    (void)pthread_mutex_destroy(&self->lock);
    free(self);
}

tl_status tl_twin_warden_start(const tl_twin_warden_settings *settings, tl_twin_warden **warden, tl_error *error) {
    tl_twin_warden *made = calloc(1, sizeof *made);
    int stop = eventfd(0, EFD_CLOEXEC);
    if (made == NULL || stop < 0) {
        close_if_open(stop);
        close_if_open(settings->output);
        close_if_open(settings->page);
        close_if_open(settings->start);
        free(made);
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory or descriptors to watch the process of the FMUs");
    }
    made->settings = *settings;
    made->stop = stop;
    made->start = settings->start;
    made->listener = -1;
    made->may_kill = true;
    made->page_ended = settings->page < 0;
    (void)pthread_mutex_init(&made->lock, NULL);
    tl_fmu_patience_init(&made->patience, settings->call_limit);
    tl_relay_open(&made->output, settings->output, pass_output, NULL);
    if (settings->page >= 0) {
        tl_relay_open(&made->page, settings->page, pass_page, settings->page_file);
    }
    int result = tl_side_thread_start(&made->thread, STACK, watch, made);
    if (result != 0) {
        release(made);
        return tl_fail(error, TL_TRY_AGAIN, "no thread to watch the process of the FMUs: %s", strerror(result));
    }
    *warden = made;
    return TL_OK;
}

void tl_twin_warden_tell(tl_twin_warden *warden, tl_fmu_refusals_listener *hear, void *context) {
    (void)pthread_mutex_lock(&warden->lock);
    const char *said = NULL;
    while ((said = tl_fmu_refusals_next(&warden->refusals)) != NULL) {
        hear(context, said);
    }
    (void)pthread_mutex_unlock(&warden->lock);
}

bool tl_twin_warden_has_refused(tl_twin_warden *warden) {
    (void)pthread_mutex_lock(&warden->lock);
    bool has = warden->refusals.count > 0;
    (void)pthread_mutex_unlock(&warden->lock);
    return has;
}

void tl_twin_warden_flush(tl_twin_warden *warden) {
    (void)pthread_mutex_lock(&warden->lock);
    drain(warden);
    (void)pthread_mutex_unlock(&warden->lock);
}

bool tl_twin_warden_has_killed(tl_twin_warden *warden, char text[TL_TWIN_WARDEN_TEXT]) {
    (void)pthread_mutex_lock(&warden->lock);
    bool killed = warden->killed[0] != '\0';
    (void)snprintf(text, TL_TWIN_WARDEN_TEXT, "%s", warden->killed);
    (void)pthread_mutex_unlock(&warden->lock);
    return killed;
}

bool tl_twin_warden_reap(tl_twin_warden *warden, tl_role *process) {
    (void)pthread_mutex_lock(&warden->lock);
    bool ended = tl_role_watch(process);
    warden->may_kill = warden->may_kill && !ended;
    (void)pthread_mutex_unlock(&warden->lock);
    return ended;
}

void tl_twin_warden_let_go(tl_twin_warden *warden) {
    (void)pthread_mutex_lock(&warden->lock);
    warden->may_kill = false;
    (void)pthread_mutex_unlock(&warden->lock);
}

void tl_twin_warden_kill(tl_twin_warden *warden, tl_role *process) {
    tl_twin_warden_let_go(warden);
    tl_role_kill(process);
}

void tl_twin_warden_stop(tl_twin_warden *warden) {
    if (warden == NULL) {
        return;
    }
    const uint64_t one = 1;
    (void)!write(warden->stop, &one, sizeof one);
    (void)pthread_join(warden->thread, NULL);
    drain(warden);
    release(warden);
}
