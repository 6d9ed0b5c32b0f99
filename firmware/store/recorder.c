/* The recorder: an outbox on the side of the cycle, a thread with a writer on the side of the disk.
 *
 * The one lock is between the thread, close, and a producer that chose to wait (wait_when_full); without that the producer never takes it. */
#include "firmware/store/recorder.h"

#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "firmware/base/os.h"
#include "firmware/process/crash.h"
#include "firmware/store/outbox.h"
#include "firmware/store/recorder_writer.h"

enum { STACK = 512 * 1024, PAGE = 4096 };

static const tl_time PATIENCE = 2 * TL_SECOND;     /* where the settings do not say it */
static const tl_time WAKE = TL_SECOND;             /* the thread looks at least this often how full the ring is */
static const tl_time ROOM_PAUSE = TL_SECOND / 100; /* a producer that waits looks so often whether it is of any use */

struct tl_recorder {
    tl_recorder_settings settings;
    tl_time patience;
    void *memory; /* in which the outbox is */
    tl_outbox outbox;
    tl_recorder_writer_state state;
    tl_outbox_start start;

    /* between threads, by the lock */
    pthread_mutex_t lock;
    pthread_cond_t wake;
    bool stop;
    bool hurry;

    /* the thread's; after the join, close's */
    pthread_t thread;
    tl_recorder_writer *writer;
};

/* ---- Producer ---------------------------------------------------------------------------------------------------- */

/* One of the lock's flags is to be seen by the thread at once. */
static void wake_up(tl_recorder *recorder, bool *flag) {
    (void)pthread_mutex_lock(&recorder->lock);
    *flag = true;
    (void)pthread_cond_signal(&recorder->wake);
    (void)pthread_mutex_unlock(&recorder->lock);
}

/* Until there is room, or the disk has refused for too long. */
static void wait_for_room(tl_recorder *recorder) {
    while (recorder->settings.wait_when_full && !tl_outbox_wait_for_room(&recorder->outbox, 0)) {
        tl_time now = tl_clock_now(NULL);
        tl_time since = tl_recorder_state_get(&recorder->state).refused_since;
        if (since != 0 && now - since >= recorder->patience) {
            return;
        }
        wake_up(recorder, &recorder->hurry);
        (void)tl_outbox_wait_for_room(&recorder->outbox, now + ROOM_PAUSE);
    }
}

void tl_recorder_put_sample(tl_recorder *recorder, const tl_sample *sample) {
    wait_for_room(recorder);
    (void)tl_outbox_put_sample(&recorder->outbox, sample);
}

void tl_recorder_put_step(tl_recorder *recorder, const tl_record *record, const tl_recorder_component *ledger) {
    wait_for_room(recorder);
    (void)tl_outbox_put_step(&recorder->outbox, record, ledger);
}

void tl_recorder_put_tuning(tl_recorder *recorder, const tl_run_tuning *tuning) {
    wait_for_room(recorder);
    (void)tl_outbox_put_tuning(&recorder->outbox, tuning);
}

void tl_recorder_event(tl_recorder *recorder, int64_t tick, tl_severity severity, const char *source,
                       const char *text) {
    tl_outbox_event(&recorder->outbox, tick, severity, source, text);
}

tl_recorder_counts tl_recorder_get_counts(const tl_recorder *recorder) {
    tl_recorder_state_counts counts = tl_recorder_state_get(&recorder->state);
    return (tl_recorder_counts){
        .written = counts.written, .lost = counts.dropped + tl_outbox_lost(&recorder->outbox), .run = counts.run};
}

/* ---- The thread -------------------------------------------------------------------------------------------------- */

static bool is_refused(const tl_recorder *recorder) {
    return tl_recorder_state_get(&recorder->state).refused_since != 0;
}

/* Sleeps until `due`, at most WAKE; shorter if it is to stop: false; or if a producer waits for room: *hurry. */
static bool sleep_until(tl_recorder *recorder, tl_time due, bool *hurry) {
    tl_time look = tl_clock_now(NULL) + WAKE;
    tl_time time = due < look ? due : look;
    const struct timespec until = {.tv_sec = (time_t)(time / TL_SECOND), .tv_nsec = (long)(time % TL_SECOND)};
    (void)pthread_mutex_lock(&recorder->lock);
    while (!recorder->stop && !(recorder->hurry && !is_refused(recorder)) && tl_clock_now(NULL) < time) {
        (void)pthread_cond_timedwait(&recorder->wake, &recorder->lock, &until);
    }
    bool stop = recorder->stop;
    *hurry = recorder->hurry && !is_refused(recorder);
    recorder->hurry = false;
    (void)pthread_mutex_unlock(&recorder->lock);
    *hurry = *hurry || tl_recorder_writer_is_pressed(recorder->writer);
    return !stop;
}

static void *run_writer(void *argument) {
    tl_recorder *recorder = argument;
    tl_locale_use();
    tl_time due = tl_clock_now(NULL) + recorder->settings.commit;
    tl_crash_enter(TL_CRASH_OURS);
    bool hurry = false;
    while (sleep_until(recorder, due, &hurry)) {
        if (tl_clock_now(NULL) >= due || (hurry && !is_refused(recorder))) {
            tl_recorder_writer_write(recorder->writer);
            due = tl_clock_now(NULL) + recorder->settings.commit;
        }
    }
    return NULL;
}

/* ---- Open and close ---------------------------------------------------------------------------------------------- */

/* On the clock that nobody sets. Nothing of it can fail with these attributes on Linux. */
static void make_lock(tl_recorder *recorder) {
    pthread_condattr_t attributes;
    (void)pthread_condattr_init(&attributes);
    (void)pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    (void)pthread_cond_init(&recorder->wake, &attributes);
    (void)pthread_condattr_destroy(&attributes);
    (void)pthread_mutex_init(&recorder->lock, NULL);
}

static void destroy(tl_recorder *recorder) {
    (void)pthread_mutex_destroy(&recorder->lock);
    (void)pthread_cond_destroy(&recorder->wake);
    free(recorder->memory);
    free(recorder);
}

static tl_status start(tl_recorder *recorder, tl_error *error) {
    const tl_recorder_settings *settings = &recorder->settings;
    tl_recorder_writer_outbox outbox = {.name = "this process"};
    recorder->patience = settings->patience != 0 ? settings->patience : PATIENCE;
    outbox.settings.shape = (tl_recorder_shape){settings->plant_count, settings->match_count, settings->adjust_count,
                                                settings->component_count};
    outbox.settings.ring_bytes = tl_outbox_ring_bytes(&outbox.settings.shape, settings->step);
    size_t bytes = tl_outbox_bytes(&outbox.settings);
    if (posix_memalign(&recorder->memory, PAGE, bytes) != 0) {
        recorder->memory = NULL;
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    memset(recorder->memory, 0, bytes);
    tl_outbox_open(&outbox.settings, recorder->memory, &recorder->state.taken[0], &recorder->outbox);
    outbox.memory = recorder->memory;
    recorder->start.account = *settings->account;
    const tl_recorder_writer_settings made = {.record = settings,
                                              .outboxes = &outbox,
                                              .outbox_count = 1,
                                              .state = &recorder->state,
                                              .first = &recorder->start};
    tl_status status = tl_recorder_writer_open(&made, &recorder->writer, error);
    if (status != TL_OK) {
        return status;
    }
    int code = tl_side_thread_start(&recorder->thread, STACK, run_writer, recorder);
    if (code != 0) {
        (void)tl_recorder_writer_close(recorder->writer, 0, NULL);
        return tl_fail(error, TL_TRY_AGAIN, "%s: no thread to write it: %s", settings->path, strerror(code));
    }
    return TL_OK;
}

tl_status tl_recorder_open(const tl_recorder_settings *settings, tl_recorder **recorder, tl_error *error) {
    tl_recorder *opened = calloc(1, sizeof *opened);
    *recorder = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    make_lock(opened);
    opened->settings = *settings;
    tl_status status = start(opened, error);
    if (status != TL_OK) {
        destroy(opened);
        return status;
    }
    *recorder = opened;
    return TL_OK;
}

/* The end has its place behind all entries; the ring may have to be written first. */
static void put_end(tl_recorder *recorder, const char *reason, tl_time until) {
    while (!tl_outbox_wait_for_room(&recorder->outbox, 0) && tl_clock_now(NULL) < until) {
        tl_recorder_writer_write(recorder->writer);
        (void)tl_outbox_wait_for_room(&recorder->outbox, tl_clock_now(NULL) + ROOM_PAUSE);
    }
    if (tl_outbox_wait_for_room(&recorder->outbox, 0)) {
        (void)tl_outbox_put_end(&recorder->outbox, reason);
    }
}

tl_status tl_recorder_close(tl_recorder *recorder, const char *reason, tl_recorder_counts *counts, tl_error *error) {
    if (recorder == NULL) {
        return TL_OK;
    }
    tl_time until = tl_clock_now(NULL) + recorder->patience;
    wake_up(recorder, &recorder->stop);
    (void)pthread_join(recorder->thread, NULL);
    put_end(recorder, reason, until);
    tl_time left = until - tl_clock_now(NULL);
    tl_status status = tl_recorder_writer_close(recorder->writer, left < 0 ? 0 : left, error);
    if (counts != NULL) {
        *counts = tl_recorder_get_counts(recorder);
    }
    destroy(recorder);
    return status;
}
