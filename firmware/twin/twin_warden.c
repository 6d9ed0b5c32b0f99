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

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/process/fmu_patience.h"
#include "firmware/process/interrupt.h"
#include "firmware/twin/twin_output.h"

enum {
    LOOK_MS = 50,
    STACK = 256 * 1024, /* the supervisor locks it */
    ANSWERS = 64        /* refused calls between two looks at the process: who asks without end is not all there is */
};

struct tl_twin_warden {
    tl_twin_warden_settings settings;
    pthread_t thread;
    tl_twin_output *
        output; /* what it prints, and all that is said of it: another thread, since that may wait for who reads our log */
    int stop;     /* eventfd: told to end */
    int start;    /* -1: the process has handed over what it had to, and hears signals */
    int listener; /* what it was; -1: nothing */
    tl_fmu_patience patience;
    tl_time pass_on_at;               /* a signal that came; again, since an FMU may have swallowed it */
    size_t spoken;                    /* refusals that the other thread has said */
    pthread_mutex_t lock;             /* of all below */
    bool may_kill;                    /* its number is its own */
    char killed[TL_TWIN_WARDEN_TEXT]; /* why; "": not */
    tl_fmu_refusals refusals;
    size_t told; /* of them */
};

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
        .whatever = true,
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
    if (tl_twin_output_page_is_too_long(self->output)) {
        (void)snprintf(text, sizeof text,
                       "the process of the FMUs was killed: the page of the check is longer than %d MB",
                       TL_TWIN_OUTPUT_PAGE_MOST / 1000000);
        kill_it(self, text);
    }
}

/* Before it has a handler it would die of it. */
static void pass_signal_on(tl_twin_warden *self) {
    int asked = tl_interrupt_signal();
    tl_time now = tl_clock_now(NULL);
    if (asked != 0 && self->start < 0 && self->may_kill && now >= self->pass_on_at) {
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

/* Who asks waits for it, so nothing else is done before. Others look at what was said before, with the lock. */
static void answer_refusals(tl_twin_warden *self) {
    tl_refusal refusal;
    bool is_new = false;
    for (int i = 0; i < ANSWERS && tl_refusal_take(self->listener, &refusal); i++) {
        (void)pthread_mutex_lock(&self->lock);
        is_new = tl_fmu_refusals_note(&self->refusals, &refusal, self->settings.calls) || is_new;
        (void)pthread_mutex_unlock(&self->lock);
        tl_refusal_answer(self->listener, &refusal);
    }
    if (is_new) {
        tl_twin_output_wake(self->output);
    }
}

static const char *next_refusal(tl_twin_warden *self, size_t *told) {
    (void)pthread_mutex_lock(&self->lock);
    const char *said = tl_fmu_refusals_next(&self->refusals, told);
    (void)pthread_mutex_unlock(&self->lock);
    return said;
}

/* In the thread of the output. Who hears of it may wait for one who waits for our lock. */
static void speak(void *context) {
    tl_twin_warden *self = context;
    const char *said = NULL;
    while ((said = next_refusal(self, &self->spoken)) != NULL) {
        if (!self->settings.is_silent) {
            (void)tl_log_foreign(TL_LOG_WARNING, said, TL_TWIN_OUTPUT_PATIENCE);
        }
        if (self->settings.hear != NULL) {
            self->settings.hear(self->settings.context, said);
        }
    }
}

static void hear_end(void *context) {
    nudge(context);
}

/* ---- the thread ---- */

enum { STOP, START, LISTENER, WATCHED };

static void close_if_open(int descriptor) {
    if (descriptor >= 0) {
        (void)close(descriptor);
    }
}

static void fill(const tl_twin_warden *self, struct pollfd watched[WATCHED]) {
    watched[STOP] = (struct pollfd){.fd = self->stop, .events = POLLIN};
    watched[START] = (struct pollfd){.fd = self->start, .events = POLLIN};
    watched[LISTENER] = (struct pollfd){.fd = self->listener, .events = POLLIN};
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
    tl_twin_output_stop(self->output);
    close_if_open(self->listener);
    close_if_open(self->start);
    close_if_open(self->stop);
    (void)pthread_mutex_destroy(&self->lock);
    free(self);
}

static tl_status start_threads(tl_twin_warden *self, tl_error *error) {
    const tl_twin_output_settings output = {
        .output = self->settings.output,
        .page = self->settings.page,
        .page_file = self->settings.page_file,
        .speak = speak,
        .ended = hear_end,
        .context = self,
    };
    tl_status status = tl_twin_output_start(&output, &self->output, error);
    int result = status == TL_OK ? tl_side_thread_start(&self->thread, STACK, watch, self) : 0;
    return result == 0
               ? status
               : tl_fail(error, TL_TRY_AGAIN, "no thread to watch the process of the FMUs: %s", strerror(result));
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
    (void)pthread_mutex_init(&made->lock, NULL);
    tl_fmu_patience_init(&made->patience, settings->call_limit);
    tl_status status = start_threads(made, error);
    if (status != TL_OK) {
        release(made);
        return status;
    }
    *warden = made;
    return TL_OK;
}

void tl_twin_warden_tell(tl_twin_warden *warden, tl_fmu_refusals_listener *hear, void *context) {
    const char *said = NULL;
    while ((said = next_refusal(warden, &warden->told)) != NULL) {
        hear(context, said);
    }
}

bool tl_twin_warden_has_refused(tl_twin_warden *warden) {
    (void)pthread_mutex_lock(&warden->lock);
    bool has = warden->refusals.count > 0;
    (void)pthread_mutex_unlock(&warden->lock);
    return has;
}

void tl_twin_warden_flush(tl_twin_warden *warden) {
    tl_twin_output_flush(warden->output);
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
    release(warden);
}
