/* The recorder: queues on the side of the cycle, a thread on the side of the disk.
 *
 * Samples and steps go through a byte ring (recorder_ring.h), events through a queue for many threads
 * (recorder_events.h). The writer thread wakes every `commit` interval and writes batches until both are empty. A batch
 * is released only after its commit: what failed is read again. The one lock is between the writer, close, and a
 * producer that chose to wait (wait_when_full); without that the producer never takes it. */
#include "firmware/record/recorder.h"

#include <pthread.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "firmware/base/c_locale.h"
#include "firmware/base/log.h"
#include "firmware/base/side_thread.h"
#include "firmware/process/crash.h"
#include "firmware/record/recorder_database.h"
#include "firmware/record/recorder_entry.h"
#include "firmware/record/recorder_events.h"
#include "firmware/record/recorder_ring.h"
#include "firmware/text/utc.h"

enum {
    RING_SECONDS = 30,
    RING_LEAST = 256 * 1024,
    RING_MOST = 16 * 1024 * 1024,
    STACK = 512 * 1024,
    OWN_EVENTS = 8,
    EVENT_BYTES = 256 /* what an event counts in a batch */
};

static const tl_time PATIENCE = 2 * TL_SECOND;            /* where the settings do not say it */
static const tl_time PATIENCE_OF_WRITER = 60 * TL_SECOND; /* a worn-out memory card takes its time for one commit */
static const tl_time WAKE = TL_SECOND;             /* the writer looks at least this often how full the ring is */
static const tl_time LOSS_PAUSE = 10 * TL_SECOND;  /* between two events that say what a slow disk has cost */
static const tl_time RETRY_PAUSE = TL_SECOND / 20; /* between two tries in close */

/* The writer's own words about writing, which cannot be written at once. */
typedef struct own_events {
    size_t count;
    tl_recorder_event_entry entries[OWN_EVENTS];
} own_events;

struct tl_recorder {
    /* set in open */
    char *path;
    tl_recorder_database *database;
    tl_recorder_shape shape;
    tl_time commit;
    bool wait_when_full;
    tl_time patience;
    int64_t run;
    tl_heart *heart; /* the writer's */

    /* between threads, by atomics */
    tl_recorder_ring ring;
    tl_recorder_events events;
    uint64_t written;
    uint64_t lost;

    /* the producer's */
    tl_time start;
    bool resumes; /* puts wait, though the run is live */

    /* the producer's while it is not full, else the writer's */
    tl_recorder_checkpoint checkpoint;
    bool checkpoint_is_full;

    /* between threads, by the lock */
    pthread_mutex_t lock;
    pthread_cond_t wake; /* the writer's */
    pthread_cond_t room; /* the producer's, with wait_when_full */
    bool stop;
    bool hurry;
    tl_time refused_since; /* monotonic; 0: the disk takes what it is given */

    /* the writer's; after the join, close's */
    pthread_t thread;
    tl_recorder_totals totals; /* committed; events with our own */
    uint64_t own_written;
    int refusal;        /* SQLite's code of the last refusal; SQLITE_OK: none */
    char reason[192];   /* its words */
    uint64_t lost_said; /* of `lost`, what an event has said */
    tl_time lost_said_at;
    own_events own;
    tl_log_limiter limiter;
    tl_recorder_entry entry; /* too large for a small stack */
};

static tl_time now(void) {
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (tl_time)time.tv_sec * TL_SECOND + time.tv_nsec;
}

static struct timespec timespec_of(tl_time time) {
    struct timespec result;
    result.tv_sec = (time_t)(time / TL_SECOND);
    result.tv_nsec = (long)(time % TL_SECOND);
    return result;
}

static uint64_t get(const uint64_t *counter) {
    return __atomic_load_n(counter, __ATOMIC_RELAXED);
}

/* ---- Producer ---------------------------------------------------------------------------------------------------- */

static void lose(tl_recorder *recorder) {
    (void)__atomic_add_fetch(&recorder->lost, 1, __ATOMIC_RELAXED);
}

/* Waits until there is room, or the disk has refused for too long. */
static void wait_for_room(tl_recorder *recorder, size_t size) {
    (void)pthread_mutex_lock(&recorder->lock);
    while (!tl_recorder_ring_has_room(&recorder->ring, size)) {
        tl_time at = now();
        if (recorder->refused_since != 0 && at - recorder->refused_since >= recorder->patience) {
            break;
        }
        struct timespec until = timespec_of(at + TL_SECOND / 10);
        recorder->hurry = true;
        (void)pthread_cond_signal(&recorder->wake);
        (void)pthread_cond_timedwait(&recorder->room, &recorder->lock, &until);
    }
    (void)pthread_mutex_unlock(&recorder->lock);
}

static void prepare_put(tl_recorder *recorder, tl_recorder_kind kind) {
    size_t size = tl_recorder_entry_size(&recorder->shape, kind);
    if ((recorder->wait_when_full || recorder->resumes) && !tl_recorder_ring_has_room(&recorder->ring, size)) {
        wait_for_room(recorder, size);
    }
}

void tl_recorder_start(tl_recorder *recorder, tl_time start) {
    const tl_resumption beginning = {.start = start, .started = tl_utc_now()};
    recorder->start = start;
    (void)tl_recorder_entry_put_start(&recorder->ring, &recorder->shape, &beginning);
}

void tl_recorder_resume(tl_recorder *recorder, const tl_resumption *resumption) {
    recorder->start = resumption->start;
    recorder->resumes = true;
    (void)tl_recorder_entry_put_start(&recorder->ring, &recorder->shape, resumption);
}

void tl_recorder_go_live(tl_recorder *recorder) {
    recorder->resumes = false;
}

bool tl_recorder_checkpoint_is_waiting(const tl_recorder *recorder) {
    return __atomic_load_n(&recorder->checkpoint_is_full, __ATOMIC_ACQUIRE);
}

bool tl_recorder_reserve_checkpoint(tl_recorder *recorder, size_t capacity) {
    tl_recorder_checkpoint *checkpoint = &recorder->checkpoint;
    if (tl_recorder_checkpoint_is_waiting(recorder) || capacity > tl_recorder_database_most(recorder->database)) {
        return false;
    }
    unsigned char *bytes = malloc(capacity);
    if (bytes == NULL) {
        return false;
    }
    memset(bytes, 0, capacity); /* so that the cycle meets no page fault */
    free(checkpoint->bytes);
    checkpoint->bytes = bytes;
    checkpoint->capacity = capacity;
    return true;
}

unsigned char *tl_recorder_checkpoint_room(tl_recorder *recorder, size_t *capacity) {
    *capacity = recorder->checkpoint.capacity;
    return tl_recorder_checkpoint_is_waiting(recorder) ? NULL : recorder->checkpoint.bytes;
}

void tl_recorder_put_checkpoint(tl_recorder *recorder, int64_t tick, size_t size) {
    recorder->checkpoint.tick = tick;
    recorder->checkpoint.size = size;
    __atomic_store_n(&recorder->checkpoint_is_full, true, __ATOMIC_RELEASE);
}

void tl_recorder_put_sample(tl_recorder *recorder, const tl_sample *sample) {
    prepare_put(recorder, TL_ENTRY_SAMPLE);
    if (!tl_recorder_entry_put_sample(&recorder->ring, &recorder->shape, sample, recorder->start)) {
        lose(recorder);
    }
}

void tl_recorder_put_step(tl_recorder *recorder, const tl_record *record, const tl_recorder_component *ledger) {
    prepare_put(recorder, TL_ENTRY_STEP);
    if (!tl_recorder_entry_put_step(&recorder->ring, &recorder->shape, record, ledger)) {
        lose(recorder);
    }
}

void tl_recorder_event(tl_recorder *recorder, int64_t tick, tl_severity severity, const char *source,
                       const char *text) {
    tl_recorder_event_entry entry;
    tl_recorder_event_fill(&entry, tick, severity, source, text);
    if (!tl_recorder_events_put(&recorder->events, &entry)) {
        lose(recorder);
    }
}

tl_recorder_counts tl_recorder_get_counts(const tl_recorder *recorder) {
    tl_recorder_counts counts = {
        .written = get(&recorder->written), .lost = get(&recorder->lost), .run = recorder->run};
    return counts;
}

/* ---- Writer: what it says ---------------------------------------------------------------------------------------- */

static void say(tl_recorder *recorder, tl_severity severity, const char *text) {
    own_events *own = &recorder->own;
    tl_log_level level = severity == TL_EVENT_ERROR     ? TL_LOG_ERROR
                         : severity == TL_EVENT_WARNING ? TL_LOG_WARNING
                                                        : TL_LOG_NOTICE;
    tl_log_limited(&recorder->limiter, level, "recorder: %s: %s", recorder->path, text);
    if (own->count == OWN_EVENTS) { /* the first one tells when it began: keep it, the second one goes */
        own->count--;
        memmove(&own->entries[1], &own->entries[2], (own->count - 1) * sizeof own->entries[0]);
    }
    tl_recorder_event_fill(&own->entries[own->count++], -1, severity, "recorder", text);
}

static void say_loss(tl_recorder *recorder, const char *why) {
    char text[TL_EVENT_TEXT];
    uint64_t lost = get(&recorder->lost);
    if (lost != recorder->lost_said) {
        (void)snprintf(text, sizeof text, "%llu samples, steps or events were lost: %s",
                       (unsigned long long)(lost - recorder->lost_said), why);
        recorder->lost_said = lost;
        recorder->lost_said_at = now();
        say(recorder, TL_EVENT_WARNING, text);
    }
}

static void set_refused(tl_recorder *recorder, bool refused) {
    (void)pthread_mutex_lock(&recorder->lock);
    if (!refused) {
        recorder->refused_since = 0;
    } else if (recorder->refused_since == 0) {
        recorder->refused_since = now();
    }
    (void)pthread_mutex_unlock(&recorder->lock);
}

static void note_refusal(tl_recorder *recorder, int code) {
    char text[TL_EVENT_TEXT];
    tl_recorder_database_text(recorder->database, code, recorder->reason, sizeof recorder->reason);
    set_refused(recorder, true);
    if ((recorder->refusal & 0xFF) != (code & 0xFF)) {
        (void)snprintf(text, sizeof text, "cannot write: %.160s; trying again", recorder->reason);
        say(recorder, TL_EVENT_ERROR, text);
    }
    recorder->refusal = code;
}

static void note_success(tl_recorder *recorder) {
    char text[TL_EVENT_TEXT];
    if (recorder->refusal != SQLITE_OK) {
        tl_time pause = now() - recorder->refused_since; /* only we write it */
        recorder->refusal = SQLITE_OK;
        set_refused(recorder, false);
        (void)snprintf(text, sizeof text, "writes again after %.1f s", tl_seconds(pause));
        say(recorder, TL_EVENT_INFO, text);
        say_loss(recorder, "the database could not be written");
    } else if (now() - recorder->lost_said_at >= LOSS_PAUSE) {
        say_loss(recorder, "they came faster than the disk takes them");
    }
}

/* ---- Writer: batches --------------------------------------------------------------------------------------------- */

/* What a batch is made of, and how far it came. */
typedef struct transaction {
    size_t cursor;
    uint32_t events;
    size_t own;
    tl_recorder_totals totals;
} transaction;

static int write_entries(tl_recorder *recorder, transaction *batch, size_t end, size_t limit) {
    size_t begin = batch->cursor;
    int code = SQLITE_OK;
    while (batch->cursor != end && batch->cursor - begin < limit && code == SQLITE_OK) {
        tl_recorder_entry_take(&recorder->ring, &recorder->shape, &batch->cursor, &recorder->entry);
        batch->totals.samples += recorder->entry.kind == TL_ENTRY_SAMPLE ? 1 : 0;
        batch->totals.steps += recorder->entry.kind == TL_ENTRY_STEP ? 1 : 0;
        code = tl_recorder_database_entry(recorder->database, &recorder->entry);
    }
    return code;
}

static int write_events(tl_recorder *recorder, transaction *batch, uint32_t count) {
    int code = SQLITE_OK;
    for (; batch->own < recorder->own.count && code == SQLITE_OK; batch->own++) {
        code = tl_recorder_database_event(recorder->database, &recorder->own.entries[batch->own]);
    }
    for (; batch->events < count && code == SQLITE_OK; batch->events++) {
        code =
            tl_recorder_database_event(recorder->database, tl_recorder_events_peek(&recorder->events, batch->events));
    }
    batch->totals.events += batch->own + batch->events;
    return code;
}

/* The batch is on disk: its entries are not needed any more. */
static void release(tl_recorder *recorder, const transaction *batch) {
    recorder->totals = batch->totals;
    recorder->own_written += batch->own;
    recorder->own.count = 0;
    tl_recorder_ring_release(&recorder->ring, batch->cursor);
    tl_recorder_events_release(&recorder->events, batch->events);
    __atomic_store_n(&recorder->written,
                     batch->totals.samples + batch->totals.steps + batch->totals.events - recorder->own_written,
                     __ATOMIC_RELAXED);
    if (recorder->wait_when_full) {
        (void)pthread_mutex_lock(&recorder->lock);
        (void)pthread_cond_signal(&recorder->room);
        (void)pthread_mutex_unlock(&recorder->lock);
    }
}

/* What is in a transaction, inside of it. *with_checkpoint: it is; false where there are entries before it still. */
static int fill(tl_recorder *recorder, transaction *batch, size_t end, uint32_t events, bool *with_checkpoint) {
    size_t limit = tl_recorder_database_batch(recorder->database);
    int code = write_events(recorder, batch, events);
    if (code == SQLITE_OK) {
        code = write_entries(recorder, batch, end, limit);
    }
    *with_checkpoint = *with_checkpoint && batch->cursor == end; /* what it goes on from is there before it */
    if (code == SQLITE_OK && *with_checkpoint) {
        code = tl_recorder_database_checkpoint(recorder->database, &recorder->checkpoint);
    }
    return code == SQLITE_OK ? tl_recorder_database_commit(recorder->database, &batch->totals) : code;
}

static uint32_t count_events(tl_recorder *recorder, size_t most) {
    uint32_t events = 0;
    while (events < most && tl_recorder_events_peek(&recorder->events, events) != NULL) {
        events++;
    }
    return events;
}

/* One transaction, of entries up to `end` of the ring and events as far as they fit. *more says whether it should be
 * followed by another one. */
static int write_batch(tl_recorder *recorder, size_t end, bool with_checkpoint, bool *more) {
    transaction batch = {.cursor = tl_recorder_ring_begin(&recorder->ring), .totals = recorder->totals};
    size_t limit = tl_recorder_database_batch(recorder->database);
    size_t bytes = end - batch.cursor < limit ? end - batch.cursor : limit;
    uint32_t events = count_events(recorder, limit / EVENT_BYTES);
    *more = false;
    if (bytes == 0 && events == 0 && recorder->own.count == 0 && !with_checkpoint) {
        return SQLITE_OK;
    }
    batch.totals.lost = get(&recorder->lost);
    bytes += with_checkpoint ? recorder->checkpoint.size : 0;
    int code = tl_recorder_database_begin(recorder->database, bytes + events * (size_t)EVENT_BYTES);
    if (code == SQLITE_OK) {
        code = fill(recorder, &batch, end, events, &with_checkpoint);
    }
    if (code != SQLITE_OK) {
        note_refusal(recorder, code); /* before the roll-back, which has words of its own */
        tl_recorder_database_rollback(recorder->database);
        return code;
    }
    release(recorder, &batch);
    if (with_checkpoint) {
        __atomic_store_n(&recorder->checkpoint_is_full, false, __ATOMIC_RELEASE);
    }
    *more = batch.cursor != end;
    code = tl_recorder_database_tidy(recorder->database);
    if (code != SQLITE_OK) {
        note_refusal(recorder, code);
    }
    return code;
}

/* Writes what is there now. */
static int write_all(tl_recorder *recorder) {
    bool with_checkpoint =
        tl_recorder_checkpoint_is_waiting(recorder); /* asked first: what came before it is before the end then */
    size_t end = tl_recorder_ring_end(&recorder->ring);
    bool more = true;
    int code = SQLITE_OK;
    while (more && code == SQLITE_OK) {
        tl_heart_beat(recorder->heart);
        code = write_batch(recorder, end, with_checkpoint, &more);
    }
    if (code == SQLITE_OK) {
        note_success(recorder);
    }
    if (code == SQLITE_OK && recorder->own.count > 0) {
        code = write_batch(recorder, end, false, &more);
    }
    return code;
}

/* Sleeps until `time`; earlier where it is to stop, or a producer waits for room. */
static bool sleep_until(tl_recorder *recorder, tl_time time) {
    struct timespec until = timespec_of(time);
    (void)pthread_mutex_lock(&recorder->lock);
    while (!recorder->stop && !(recorder->hurry && recorder->refused_since == 0) && now() < time) {
        (void)pthread_cond_timedwait(&recorder->wake, &recorder->lock, &until);
    }
    bool awake = recorder->hurry && recorder->refused_since == 0;
    recorder->hurry = false;
    (void)pthread_mutex_unlock(&recorder->lock);
    return awake || tl_recorder_ring_filled(&recorder->ring) > recorder->ring.capacity / 2;
}

static bool is_stopped(tl_recorder *recorder) {
    (void)pthread_mutex_lock(&recorder->lock);
    bool stop = recorder->stop;
    (void)pthread_mutex_unlock(&recorder->lock);
    return stop;
}

static void *run_writer(void *argument) {
    tl_recorder *recorder = argument;
    tl_locale_use();
    tl_time due = now() + recorder->commit;
    tl_crash_enter(TL_CRASH_OURS);
    while (!is_stopped(recorder)) {
        tl_heart_beat(recorder->heart);
        tl_time look = now() + WAKE;
        bool hurry = sleep_until(recorder, due < look ? due : look);
        if (now() >= due || (hurry && recorder->refusal == SQLITE_OK)) {
            (void)write_all(recorder);
            due = now() + recorder->commit;
        }
    }
    tl_heart_end(recorder->heart);
    return NULL;
}

/* ---- Open and close ---------------------------------------------------------------------------------------------- */

static size_t ring_size(const tl_recorder_settings *settings, const tl_recorder_shape *shape) {
    uint64_t step = tl_recorder_entry_size(shape, TL_ENTRY_SAMPLE) + tl_recorder_entry_size(shape, TL_ENTRY_STEP);
    uint64_t steps = (uint64_t)(RING_SECONDS * TL_SECOND / settings->step) + 1;
    uint64_t bytes = steps > RING_MOST ? RING_MOST : steps * step;
    return bytes > RING_MOST ? RING_MOST : bytes < RING_LEAST ? RING_LEAST : (size_t)bytes;
}

/* On the clock that nobody sets. Nothing of it can fail with these attributes on Linux. */
static void make_lock(tl_recorder *recorder) {
    pthread_condattr_t attributes;
    (void)pthread_condattr_init(&attributes);
    (void)pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    (void)pthread_cond_init(&recorder->wake, &attributes);
    (void)pthread_cond_init(&recorder->room, &attributes);
    (void)pthread_condattr_destroy(&attributes);
    (void)pthread_mutex_init(&recorder->lock, NULL);
}

static void destroy(tl_recorder *recorder) {
    tl_recorder_database_close(recorder->database);
    tl_recorder_ring_close(&recorder->ring);
    (void)pthread_mutex_destroy(&recorder->lock);
    (void)pthread_cond_destroy(&recorder->wake);
    (void)pthread_cond_destroy(&recorder->room);
    free(recorder->checkpoint.bytes);
    free(recorder->path);
    free(recorder);
}

static tl_status start(tl_recorder *recorder, const tl_recorder_settings *settings, tl_error *error) {
    recorder->path = strdup(settings->path);
    recorder->shape.plant = settings->plant_count;
    recorder->shape.match = settings->match_count;
    recorder->shape.adjust = settings->adjust_count;
    recorder->shape.components = settings->component_count;
    recorder->commit = settings->commit;
    recorder->wait_when_full = settings->wait_when_full;
    recorder->patience = settings->patience != 0 ? settings->patience : PATIENCE;
    recorder->lost_said_at = now() - LOSS_PAUSE;
    recorder->limiter = (tl_log_limiter)TL_LOG_LIMITER(5);
    if (recorder->path == NULL || !tl_recorder_ring_open(&recorder->ring, ring_size(settings, &recorder->shape))) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    tl_status status = tl_recorder_database_open(settings, &recorder->database, error);
    if (status != TL_OK) {
        return status;
    }
    recorder->run = tl_recorder_database_run(recorder->database);
    recorder->heart = tl_heart_begin(settings->beats, "recorder", PATIENCE_OF_WRITER);
    int code = tl_side_thread_start(&recorder->thread, STACK, run_writer, recorder);
    return code == 0 ? TL_OK
                     : tl_fail(error, TL_TRY_AGAIN, "%s: no thread to write it: %s", settings->path, strerror(code));
}

tl_status tl_recorder_open(const tl_recorder_settings *settings, tl_recorder **recorder, tl_error *error) {
    tl_recorder *opened = calloc(1, sizeof *opened);
    *recorder = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->path);
    }
    make_lock(opened);
    tl_status status = start(opened, settings, error);
    if (status != TL_OK) {
        destroy(opened);
        return status;
    }
    *recorder = opened;
    return TL_OK;
}

static void stop_thread(tl_recorder *recorder) {
    (void)pthread_mutex_lock(&recorder->lock);
    recorder->stop = true;
    (void)pthread_cond_signal(&recorder->wake);
    (void)pthread_mutex_unlock(&recorder->lock);
    (void)pthread_join(recorder->thread, NULL);
}

static uint64_t count_left(tl_recorder *recorder) {
    uint64_t left = 0;
    uint32_t events = 0;
    size_t cursor = tl_recorder_ring_begin(&recorder->ring);
    while (cursor != tl_recorder_ring_end(&recorder->ring)) {
        tl_recorder_entry_take(&recorder->ring, &recorder->shape, &cursor, &recorder->entry);
        left += recorder->entry.kind == TL_ENTRY_START ? 0 : 1;
    }
    while (tl_recorder_events_peek(&recorder->events, events) != NULL) {
        events++;
    }
    return left + events;
}

/* Everything that waits, then the end of the run. */
static int write_rest(tl_recorder *recorder, const char *reason) {
    int code = SQLITE_OK;
    do {
        code = write_all(recorder);
    } while (code == SQLITE_OK && count_left(recorder) > 0);
    if (code == SQLITE_OK) {
        say_loss(recorder, "they came faster than the disk takes them");
        code = write_all(recorder);
    }
    if (code == SQLITE_OK) {
        recorder->totals.lost = get(&recorder->lost);
        code = tl_recorder_database_end(recorder->database, reason, &recorder->totals);
        if (code != SQLITE_OK) {
            note_refusal(recorder, code);
        }
    }
    return code;
}

static int finish(tl_recorder *recorder, const char *reason) {
    const struct timespec pause = timespec_of(RETRY_PAUSE);
    tl_time began = now();
    int code = write_rest(recorder, reason);
    while (code != SQLITE_OK && now() - began < recorder->patience) {
        (void)nanosleep(&pause, NULL);
        code = write_rest(recorder, reason);
    }
    return code;
}

tl_status tl_recorder_close(tl_recorder *recorder, const char *reason, tl_recorder_counts *counts, tl_error *error) {
    if (recorder == NULL) {
        return TL_OK;
    }
    tl_status status = TL_OK;
    stop_thread(recorder);
    if (finish(recorder, reason) != SQLITE_OK) {
        uint64_t left = count_left(recorder);
        (void)__atomic_add_fetch(&recorder->lost, left, __ATOMIC_RELAXED);
        status = tl_fail(error, TL_TRY_AGAIN, "%s: the run's end and its last %llu entries could not be written: %s",
                         recorder->path, (unsigned long long)left, recorder->reason);
    }
    if (counts != NULL) {
        *counts = tl_recorder_get_counts(recorder);
    }
    tl_log_limiter_end(&recorder->limiter);
    destroy(recorder);
    return status;
}
