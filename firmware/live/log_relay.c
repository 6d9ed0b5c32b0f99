/* Log relay of a run: see log_relay.h. */
#include "firmware/live/log_relay.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"

enum { STACK = 256 * 1024, TERMINAL_MS = 100, STATUS_MS = 1000 };

/* After this time, a line that a later process repeats is logged again. */
static const tl_time QUIET = 60 * TL_SECOND;

/* FNV-1a. */
static uint64_t hash_of(const char *line) {
    uint64_t hash = 0xcbf29ce484222325;
    for (; *line != '\0'; line++) {
        hash = (hash ^ (unsigned char)*line) * 0x100000001b3;
    }
    return hash;
}

/* The entry of this line; if there is none, the oldest one is used for it. */
static tl_logged_line *find_line(tl_log_source *source, uint64_t hash) {
    tl_logged_line *oldest = &source->lines[0];
    for (int i = 0; i < TL_LOG_RELAY_LINES; i++) {
        tl_logged_line *line = &source->lines[i];
        if (line->hash == hash) {
            return line;
        }
        oldest = line->time < oldest->time ? line : oldest;
    }
    *oldest = (tl_logged_line){.hash = hash};
    return oldest;
}

/* A process and its first successor may repeat lines; repeats of later processes are only counted.
 */
static bool is_to_be_counted(tl_log_source *source, tl_logged_line *line, tl_time now) {
    bool is_repeated = line->process != source->process && line->time != 0 && now - line->time < QUIET;
    bool was_loop = line->is_loop;
    line->process = source->process;
    line->is_loop = is_repeated || (was_loop && line->repeats > 0);
    return is_repeated && was_loop;
}

/* An empty line precedes the output of each process. */
static void log_line(void *context, const char *line) {
    tl_log_source *source = context;
    if (line[0] == '\0') {
        source->process++;
        return;
    }
    const char *text = NULL;
    char times[64] = "";
    int level = tl_log_level_of(line, &text);
    tl_time now = tl_clock_now(NULL);
    tl_logged_line *entry = find_line(source, hash_of(line));
    if (is_to_be_counted(source, entry, now)) {
        entry->repeats++;
        return;
    }
    if (entry->repeats > 0) {
        (void)snprintf(times, sizeof times, " (%u repeats were not logged)", entry->repeats);
    }
    entry->repeats = 0;
    entry->time = now;
    if (level == TL_LOG_FOREIGN) {
        tl_log_plain(text);
    } else {
        tl_log((tl_log_level)level, "%s%s", text, times);
    }
}

static void clear_dead(tl_log_relay *self) {
    for (int i = 0; i < TL_LOG_RELAY_DEAD; i++) {
        tl_twin_process_close(__atomic_exchange_n(&self->dead[i], NULL, __ATOMIC_ACQ_REL));
    }
}

/* Draws the status line; its text comes from a process with FMUs and is cleaned. */
static void draw_status(tl_log_relay *self) {
    char text[TL_HEARTBEAT_STATUS];
    char clean[TL_RELAY_CLEAN];
    tl_time now = tl_clock_now(NULL);
    tl_time interval = (self->terminal ? TERMINAL_MS : STATUS_MS) * (TL_SECOND / 1000);
    if ((!self->terminal && !self->status) || now - self->drawn < interval ||
        !tl_heartbeats_get_status(__atomic_load_n(&self->beats, __ATOMIC_ACQUIRE), text)) {
        return;
    }
    text[sizeof text - 1] = '\0';
    (void)tl_clean_text(text, strlen(text), clean, sizeof clean);
    if (clean[0] == '\0') {
        return;
    }
    self->drawn = now;
    if (self->terminal) {
        tl_log_status(clean);
    } else {
        tl_log_plain(clean);
    }
}

static void *relay_lines(void *context) {
    tl_log_relay *self = context;
    bool stop = false;
    while (!stop) {
        struct pollfd watched[1 + TL_LOG_RELAY_PIPES] = {{.fd = self->wake, .events = POLLIN}};
        for (int i = 0; i < TL_LOG_RELAY_PIPES; i++) {
            watched[1 + i] = (struct pollfd){.fd = self->sources[i].relay.descriptor, .events = POLLIN};
        }
        const bool draws = self->terminal || self->status || self->follow != NULL;
        bool is_ready = poll(watched, 1 + TL_LOG_RELAY_PIPES, draws ? TERMINAL_MS : -1) > 0;
        uint64_t count = 0;
        for (int i = 0; is_ready && i < TL_LOG_RELAY_PIPES; i++) {
            if (watched[1 + i].revents != 0) {
                (void)tl_relay_drain(&self->sources[i].relay);
            }
        }
        if (is_ready && watched[0].revents != 0) {
            (void)!read(self->wake, &count, sizeof count);
            stop = __atomic_load_n(&self->stop, __ATOMIC_ACQUIRE);
            clear_dead(self);
        }
        draw_status(self);
        if (self->follow != NULL) {
            tl_follow_poll(self->follow);
        }
    }
    return NULL;
}

static void wake_thread(const tl_log_relay *self) {
    const uint64_t one = 1;
    (void)!write(self->wake, &one, sizeof one);
}

static bool open_pipes(tl_log_relay *self) {
    int ends[2];
    self->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    bool is_open = self->wake >= 0;
    for (int i = 0; i < TL_LOG_RELAY_PIPES && is_open; i++) {
        is_open = pipe2(ends, O_CLOEXEC) == 0;
        if (is_open) {
            self->sources[i].pipe = ends[1];
            tl_relay_open(&self->sources[i].relay, ends[0], log_line, &self->sources[i]);
        }
    }
    return is_open;
}

int tl_log_relay_pipe(const tl_log_relay *self, unsigned which) {
    struct pollfd input = {.fd = self->sources[which].pipe, .events = POLLOUT};
    if (poll(&input, 1, 0) == 1) {         /* cannot block: no other process writes now */
        (void)!write(input.fd, "\n\n", 2); /* ends a line that the process before left unfinished */
    }
    return input.fd;
}

tl_status tl_log_relay_start(tl_log_relay *self, const tl_heartbeats *beats, bool status, tl_follow *follow,
                             tl_error *error) {
    *self = (tl_log_relay){
        .beats = beats, .status = status, .terminal = follow == NULL && isatty(STDERR_FILENO) == 1, .follow = follow};
    int failure = open_pipes(self) ? tl_side_thread_start(&self->thread, STACK, relay_lines, self) : errno;
    self->runs = failure == 0;
    return self->runs
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "the log of the run's processes cannot be opened: %s", strerror(failure));
}

void tl_log_relay_watch(tl_log_relay *self, const tl_heartbeats *beats) {
    __atomic_store_n(&self->beats, beats, __ATOMIC_RELEASE);
}

void tl_log_relay_close_process(tl_log_relay *self, tl_twin_process *process) {
    for (int i = 0; i < TL_LOG_RELAY_DEAD; i++) {
        tl_twin_process *free_slot = NULL;
        if (__atomic_compare_exchange_n(&self->dead[i], &free_slot, process, false, __ATOMIC_ACQ_REL,
                                        __ATOMIC_RELAXED)) {
            wake_thread(self);
            return;
        }
    }
    tl_twin_process_close(process); /* the thread is late: the processes must not pile up */
}

void tl_log_relay_stop(tl_log_relay *self) {
    if (self->runs) {
        __atomic_store_n(&self->stop, true, __ATOMIC_RELEASE);
        wake_thread(self);
        (void)pthread_join(self->thread, NULL);
        self->runs = false;
        clear_dead(self);
        tl_log_status(NULL);
    }
    for (int i = 0; i < TL_LOG_RELAY_PIPES; i++) {
        tl_log_source *source = &self->sources[i];
        if (source->pipe != 0) {
            (void)close(source->pipe);
            source->pipe = 0;
            (void)tl_relay_drain(&source->relay); /* all processes have ended */
            tl_relay_close(&source->relay);
        }
    }
    if (self->wake > 0) {
        (void)close(self->wake);
        self->wake = 0;
    }
}
