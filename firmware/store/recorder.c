/* Recorder of a replay: the producer puts entries into a record queue; a thread runs the writer.
 *
 * The thread checks every PAUSE whether a commit is due or the ring is half full, so it shares no
 * lock with the producer.
 */
#include "firmware/store/recorder.h"

#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/process/crash.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_writer.h"

enum { STACK = 512 * 1024, PAGE = 4096 };

static const tl_time PATIENCE = 2 * TL_SECOND; /* default of settings.patience */
static const tl_time PAUSE = TL_SECOND / 200;  /* between two checks of the thread, and of a put that waits */

struct tl_recorder {
    tl_recorder_settings settings;
    tl_time patience;
    void *memory; /* of the record queue */
    tl_record_queue queue;
    tl_recorder_writer_state state;
    tl_record_queue_start start;
    uint32_t last_finding;
    bool stop;       /* atomic */
    bool is_stopped; /* the thread has ended */
    pthread_t thread;
    tl_recorder_writer *writer; /* used by the thread, and after its end by close() */
};

/* ---- Producer ---- */

/* Waits until there is room, or until the disk has refused for `patience`. */
static void wait_for_room(tl_recorder *recorder) {
    while (!tl_record_queue_wait_for_room(&recorder->queue, 0)) {
        tl_time now = tl_clock_now(NULL);
        tl_time since = tl_recorder_state_get(&recorder->state).refused_since;
        if (since != 0 && now - since >= recorder->patience) {
            return;
        }
        (void)tl_record_queue_wait_for_room(&recorder->queue, now + PAUSE);
    }
}

void tl_recorder_put_sample(tl_recorder *recorder, const tl_sample *sample) {
    wait_for_room(recorder);
    (void)tl_record_queue_put_sample(&recorder->queue, sample);
}

void tl_recorder_put_step(tl_recorder *recorder, const tl_record *record, const tl_execution_counts *ledger) {
    wait_for_room(recorder);
    (void)tl_record_queue_put_step(&recorder->queue, record, ledger);
}

void tl_recorder_put_tuning(tl_recorder *recorder, const tl_run_tuning *tuning) {
    wait_for_room(recorder);
    (void)tl_record_queue_put_tuning(&recorder->queue, tuning);
}

void tl_recorder_event(tl_recorder *recorder, int64_t tick, tl_severity severity, const char *source,
                       const char *text) {
    tl_record_queue_event(&recorder->queue, tick, severity, source, text);
}

tl_recorder_counts tl_recorder_get_counts(const tl_recorder *recorder) {
    tl_recorder_state_counts counts = tl_recorder_state_get(&recorder->state);
    return (tl_recorder_counts){
        .written = counts.written, .lost = counts.dropped + tl_record_queue_lost(&recorder->queue), .run = counts.run};
}

/* ---- Thread ---- */

static void *run_writer(void *argument) {
    tl_recorder *recorder = argument;
    tl_locale_use();
    tl_time due = tl_clock_now(NULL) + recorder->settings.commit;
    tl_crash_enter(TL_CRASH_OURS);
    while (!__atomic_load_n(&recorder->stop, __ATOMIC_ACQUIRE)) {
        if (tl_clock_now(NULL) >= due || tl_recorder_writer_is_pressed(recorder->writer)) {
            tl_recorder_writer_write(recorder->writer);
            due = tl_clock_now(NULL) + recorder->settings.commit;
        } else {
            tl_clock_sleep_until(tl_clock_now(NULL) + PAUSE);
        }
    }
    return NULL;
}

/* ---- Open and close ---- */

static void free_recorder(tl_recorder *recorder) {
    free(recorder->memory);
    free(recorder);
}

static tl_status start(tl_recorder *recorder, tl_error *error) {
    const tl_recorder_settings *settings = &recorder->settings;
    tl_recorder_writer_queue queue = {.name = "this process"};
    recorder->patience = settings->patience != 0 ? settings->patience : PATIENCE;
    queue.settings.shape = (tl_recorder_shape){settings->plant_count, settings->match_count, settings->adjust_count,
                                               settings->component_count};
    queue.settings.ring_bytes = tl_record_queue_ring_bytes(&queue.settings.shape, settings->step);
    size_t bytes = tl_record_queue_bytes(&queue.settings);
    if (posix_memalign(&recorder->memory, PAGE, bytes) != 0) {
        recorder->memory = NULL;
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    memset(recorder->memory, 0, bytes);
    tl_record_queue_open(&queue.settings, recorder->memory, &recorder->state.taken[0], &recorder->queue);
    queue.memory = recorder->memory;
    recorder->start.account = *settings->account;
    const tl_recorder_writer_settings writer_settings = {
        .record = settings, .queues = &queue, .queue_count = 1, .state = &recorder->state, .first = &recorder->start};
    tl_status status = tl_recorder_writer_open(&writer_settings, &recorder->writer, error);
    if (status != TL_OK) {
        return status;
    }
    unsigned char *learned = NULL; /* a replay learns from the start */
    (void)tl_recorder_writer_read_learned(recorder->writer, &learned, &bytes, &recorder->last_finding);
    free(learned);
    int code = tl_side_thread_start(&recorder->thread, STACK, run_writer, recorder);
    if (code != 0) {
        (void)tl_recorder_writer_close(recorder->writer, 0, NULL);
        return tl_fail(error, TL_TRY_AGAIN, "%s: the recorder's thread cannot be started: %s", settings->path,
                       strerror(code));
    }
    return TL_OK;
}

tl_status tl_recorder_open(const tl_recorder_settings *settings, tl_recorder **recorder, tl_error *error) {
    tl_recorder *opened = calloc(1, sizeof *opened);
    *recorder = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    opened->settings = *settings;
    tl_status status = start(opened, error);
    if (status != TL_OK) {
        free_recorder(opened);
        return status;
    }
    *recorder = opened;
    return TL_OK;
}

static void stop_thread(tl_recorder *recorder) {
    if (!recorder->is_stopped) {
        __atomic_store_n(&recorder->stop, true, __ATOMIC_RELEASE);
        (void)pthread_join(recorder->thread, NULL);
        recorder->is_stopped = true;
    }
}

uint32_t tl_recorder_last_finding(const tl_recorder *recorder) {
    return recorder->last_finding;
}

void tl_recorder_put_changes(tl_recorder *recorder, const tl_run_changes *changes) {
    stop_thread(recorder);
    tl_recorder_writer_write(recorder->writer);
    if (!tl_recorder_writer_keep(recorder->writer, changes)) {
        tl_log(TL_LOG_WARNING, "%s: the findings cannot be written", recorder->settings.path);
    }
}

/* The end follows all entries; if the ring is full, they are written first. */
static void put_end(tl_recorder *recorder, const char *reason, tl_time until) {
    while (!tl_record_queue_wait_for_room(&recorder->queue, 0) && tl_clock_now(NULL) < until) {
        tl_recorder_writer_write(recorder->writer);
        (void)tl_record_queue_wait_for_room(&recorder->queue, tl_clock_now(NULL) + PAUSE);
    }
    if (tl_record_queue_wait_for_room(&recorder->queue, 0)) {
        (void)tl_record_queue_put_end(&recorder->queue, reason);
    }
}

tl_status tl_recorder_close(tl_recorder *recorder, const char *reason, tl_recorder_counts *counts, tl_error *error) {
    if (recorder == NULL) {
        return TL_OK;
    }
    tl_time until = tl_clock_now(NULL) + recorder->patience;
    stop_thread(recorder);
    put_end(recorder, reason, until);
    tl_time left = until - tl_clock_now(NULL);
    tl_status status = tl_recorder_writer_close(recorder->writer, left < 0 ? 0 : left, error);
    if (counts != NULL) {
        *counts = tl_recorder_get_counts(recorder);
    }
    free_recorder(recorder);
    return status;
}
