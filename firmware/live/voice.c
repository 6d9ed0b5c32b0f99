/* The voice of a run: see voice.h. Dead processes are left in places that the thread empties. */
#include "firmware/live/voice.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/relay.h"
#include "firmware/base/text.h"

enum { STACK = 256 * 1024, TERMINAL_MS = 100, STATUS_MS = 1000, PLACES = 8, LINES = 16 };

/* A line that a later process repeats is logged again after this time. */
static const tl_time QUIET = 60 * TL_SECOND;

/* A line that was logged. */
typedef struct logged_line {
    uint64_t hash;
    unsigned process; /* that printed it the last time */
    unsigned repeats; /* by later processes, which were not logged */
    bool is_loop;     /* a later process has repeated it within QUIET */
    tl_time time;
} logged_line;

/* What processes of one kind print, one after the other. */
typedef struct ear {
    tl_relay relay;
    int pipe;         /* the end into which they print; 0: there is none */
    unsigned process; /* number of the process whose lines are read */
    logged_line lines[LINES];
} ear;

struct tl_voice {
    const tl_heartbeats *beats; /* of the twin: its status */
    bool status;
    bool terminal;
    pthread_t thread;
    int wake; /* eventfd */
    bool stop;
    ear ears[TL_VOICE_PIPES];
    tl_twin_process *dead[PLACES]; /* to be cleared away */
    tl_time drawn;
};

/* FNV-1a. */
static uint64_t hash_of(const char *line) {
    uint64_t hash = 0xcbf29ce484222325;
    for (; *line != '\0'; line++) {
        hash = (hash ^ (unsigned char)*line) * 0x100000001b3;
    }
    return hash;
}

/* The entry of this line; if there is none, the oldest one is used for it. */
static logged_line *find_line(ear *listening, uint64_t hash) {
    logged_line *oldest = &listening->lines[0];
    for (int i = 0; i < LINES; i++) {
        logged_line *line = &listening->lines[i];
        if (line->hash == hash) {
            return line;
        }
        oldest = line->time < oldest->time ? line : oldest;
    }
    *oldest = (logged_line){.hash = hash};
    return oldest;
}

/* A process may repeat itself, and so may its first successor. What further ones repeat is counted instead. */
static bool is_to_be_counted(ear *listening, logged_line *line, tl_time now) {
    bool is_repeated = line->process != listening->process && line->time != 0 && now - line->time < QUIET;
    bool was_loop = line->is_loop;
    line->process = listening->process;
    line->is_loop = is_repeated || (was_loop && line->repeats > 0);
    return is_repeated && was_loop;
}

/* An empty line stands before the output of each process. */
static void pass(void *context, const char *line) {
    ear *listening = context;
    if (line[0] == '\0') {
        listening->process++;
        return;
    }
    const char *text = NULL;
    char times[64] = "";
    int level = tl_log_level_of(line, &text);
    tl_time now = tl_clock_now(NULL);
    logged_line *entry = find_line(listening, hash_of(line));
    if (is_to_be_counted(listening, entry, now)) {
        entry->repeats++;
        return;
    }
    if (entry->repeats > 0) {
        (void)snprintf(times, sizeof times, " (and %u times in between)", entry->repeats);
    }
    entry->repeats = 0;
    entry->time = now;
    if (level == TL_LOG_FOREIGN) {
        tl_log_plain(text);
    } else {
        tl_log((tl_log_level)level, "%s%s", text, times);
    }
}

/* ---- the thread ---- */

static void clear_dead(tl_voice *voice) {
    for (int i = 0; i < PLACES; i++) {
        tl_twin_process_close(__atomic_exchange_n(&voice->dead[i], NULL, __ATOMIC_ACQ_REL));
    }
}

/* Its text is of a process with FMUs. */
static void draw(tl_voice *voice) {
    char text[TL_HEARTBEAT_STATUS];
    char clean[TL_RELAY_CLEAN];
    tl_time now = tl_clock_now(NULL);
    tl_time interval = (voice->terminal ? TERMINAL_MS : STATUS_MS) * (TL_SECOND / 1000);
    if ((!voice->terminal && !voice->status) || now - voice->drawn < interval ||
        !tl_heartbeats_get_status(__atomic_load_n(&voice->beats, __ATOMIC_ACQUIRE), text)) {
        return;
    }
    text[sizeof text - 1] = '\0';
    (void)tl_clean_text(text, strlen(text), clean, sizeof clean);
    if (clean[0] == '\0') {
        return;
    }
    voice->drawn = now;
    if (voice->terminal) {
        tl_log_status(clean);
    } else {
        tl_log_plain(clean);
    }
}

static void *speak(void *context) {
    tl_voice *voice = context;
    bool stop = false;
    while (!stop) {
        struct pollfd watched[1 + TL_VOICE_PIPES] = {{.fd = voice->wake, .events = POLLIN}};
        for (int i = 0; i < TL_VOICE_PIPES; i++) {
            watched[1 + i] = (struct pollfd){.fd = voice->ears[i].relay.descriptor, .events = POLLIN};
        }
        (void)poll(watched, 1 + TL_VOICE_PIPES, TERMINAL_MS);
        uint64_t count = 0;
        (void)!read(voice->wake, &count, sizeof count);
        stop = __atomic_load_n(&voice->stop, __ATOMIC_ACQUIRE);
        for (int i = 0; i < TL_VOICE_PIPES; i++) {
            (void)tl_relay_drain(&voice->ears[i].relay);
        }
        clear_dead(voice);
        draw(voice);
    }
    return NULL;
}

/* ---- the supervisor ---- */

static void wake(const tl_voice *voice) {
    const uint64_t one = 1;
    (void)!write(voice->wake, &one, sizeof one);
}

static void free_voice(tl_voice *voice) {
    for (int i = 0; i < TL_VOICE_PIPES; i++) {
        ear *listening = &voice->ears[i];
        if (listening->pipe != 0) {
            (void)close(listening->pipe);
            (void)tl_relay_drain(
                &listening->relay); /* of processes that are gone: all that they have printed is there */
            tl_relay_close(&listening->relay);
        }
    }
    if (voice->wake >= 0) {
        (void)close(voice->wake);
    }
    free(voice);
}

static bool open_pipes(tl_voice *voice) {
    int ends[2];
    voice->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    bool is_open = voice->wake >= 0;
    for (int i = 0; i < TL_VOICE_PIPES && is_open; i++) {
        is_open = pipe2(ends, O_CLOEXEC) == 0;
        if (is_open) {
            voice->ears[i].pipe = ends[1];
            tl_relay_open(&voice->ears[i].relay, ends[0], pass, &voice->ears[i]);
        }
    }
    return is_open;
}

tl_status tl_voice_start(const tl_heartbeats *beats, bool status, tl_voice **voice, tl_error *error) {
    tl_voice *made = calloc(1, sizeof *made);
    int failure = ENOMEM;
    if (made != NULL) {
        made->beats = beats;
        made->status = status;
        made->terminal = isatty(STDERR_FILENO) == 1;
        failure = open_pipes(made) ? tl_side_thread_start(&made->thread, STACK, speak, made) : errno;
    }
    if (failure != 0) {
        if (made != NULL) {
            free_voice(made);
        }
        return tl_fail(error, TL_TRY_AGAIN, "the processes of the run cannot be heard: %s", strerror(failure));
    }
    *voice = made;
    return TL_OK;
}

int tl_voice_pipe(tl_voice *voice, unsigned which) {
    struct pollfd input = {.fd = voice->ears[which].pipe, .events = POLLOUT};
    if (poll(&input, 1, 0) == 1) {         /* the write cannot block, since no other process writes now */
        (void)!write(input.fd, "\n\n", 2); /* ends a line that the process before left unfinished */
    }
    return input.fd;
}

void tl_voice_watch(tl_voice *voice, const tl_heartbeats *beats) {
    __atomic_store_n(&voice->beats, beats, __ATOMIC_RELEASE);
}

void tl_voice_clear(tl_voice *voice, tl_twin_process *process) {
    for (int i = 0; i < PLACES; i++) {
        tl_twin_process *free_place = NULL;
        if (__atomic_compare_exchange_n(&voice->dead[i], &free_place, process, false, __ATOMIC_ACQ_REL,
                                        __ATOMIC_RELAXED)) {
            wake(voice);
            return;
        }
    }
    tl_twin_process_close(process); /* nobody has cleared away for so long: it must not pile up */
}

void tl_voice_stop(tl_voice *voice) {
    if (voice == NULL) {
        return;
    }
    __atomic_store_n(&voice->stop, true, __ATOMIC_RELEASE);
    wake(voice);
    (void)pthread_join(voice->thread, NULL);
    clear_dead(voice);
    tl_log_status(NULL);
    free_voice(voice);
}
