/* Plant readers: see plant_reader.h. */
#include "firmware/plant/plant_reader.h"

#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "firmware/base/os.h"
#include "firmware/plant/poll_phase.h"
#include "firmware/process/crash.h"

/* ---- repeated reading ---- */

bool tl_repeated_reading_is(tl_repeated_reading *self, tl_time within, const tl_reading *reading) {
    bool is_early = self->has_last && reading->stamp - self->last.stamp < within;
    bool is_again = is_early && self->last.quality == TL_GOOD && reading->quality == TL_GOOD &&
                    memcmp(&self->last.value, &reading->value, sizeof reading->value) == 0;
    if (!is_again) {
        self->last = *reading;
        self->has_last = true;
    }
    return is_again;
}

/* ---- One polling thread per plant source.
 *
 * Between polls a thread waits on a condition variable until the absolute instant of the next poll.
 * clock_nanosleep() would wake up at the same instant, but this wait ends at once when the readers
 * are stopped.
 */

/* Drivers need little; the host name resolver needs most. With mlockall() all of it is resident. */
enum { STACK = 512 * 1024, NAME = 16 };

typedef struct source_thread {
    tl_plant_readers *readers;
    const tl_plant_source *source;
    pthread_t thread;
    tl_repeated_reading before[TL_MAX_SIGNALS]; /* by channel */
} source_thread;

struct tl_plant_readers {
    const tl_sample_buffer *buffers;
    void (*on_link)(void *context, const char *source, bool good, const char *text);
    void *context;
    pthread_mutex_t lock;
    pthread_cond_t stopped;
    bool stop; /* protected by the lock */
    const tl_plant_source *sources;
    size_t source_count;
    size_t started;          /* number of threads */
    source_thread threads[]; /* one per source */
};

static void post(void *context, size_t channel, const tl_reading *reading) {
    source_thread *own = context;
    tl_thread_heartbeat_beat(own->source->heartbeat); /* a poll with many requests may take long */
    const tl_plant_source *source = own->source;
    if (channel < source->signal_count &&
        !tl_repeated_reading_is(&own->before[channel], source->repeats[channel], reading)) {
        tl_sample_buffer_post(&own->readers->buffers[source->signals[channel]], reading);
    }
}

static void forward_report(void *context, bool good, const char *text) {
    const source_thread *own = context;
    own->readers->on_link(own->readers->context, own->source->name, good, text);
}

static void forward_failure(void *context, const char *text) {
    forward_report(context, false, text);
}

/* Waits until the instant. Returns true if the thread must stop. */
static bool wait_until(tl_plant_readers *readers, tl_time instant) {
    struct timespec until = {.tv_sec = (time_t)(instant / TL_SECOND), .tv_nsec = (long)(instant % TL_SECOND)};
    int waited = 0;
    (void)pthread_mutex_lock(&readers->lock);
    while (!readers->stop && waited != ETIMEDOUT) {
        waited = pthread_cond_timedwait(&readers->stopped, &readers->lock, &until);
    }
    bool stop = readers->stop;
    (void)pthread_mutex_unlock(&readers->lock);
    return stop;
}

static tl_time grid_of(const source_thread *own) {
    return own->source->run_start != NULL ? own->source->run_start(own->readers->context) : -1;
}

static void *run(void *context) {
    source_thread *own = context;
    const tl_plant_source *source = own->source;
    const tl_plant_io_sink sink = {
        .post = post, .link = forward_report, .part_failed = forward_failure, .context = own};
    char name[NAME];
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, source->period, tl_clock_now(NULL));
    /* The thread sets its own name. Another thread would have to write to /proc, to which `run` has
     * no access any more. */
    (void)snprintf(name, sizeof name, "io %.12s", source->name);
    (void)pthread_setname_np(pthread_self(), name);
    tl_locale_use();
    tl_crash_enter(TL_CRASH_OURS);
    do {
        tl_thread_heartbeat_beat(source->heartbeat);
        source->driver->poll(source->io, &sink);
    } while (!wait_until(own->readers, tl_poll_phase_next(&phase, grid_of(own), tl_clock_now(NULL))));
    if (source->driver->finish != NULL) {
        source->driver->finish(source->io, &sink);
    }
    tl_thread_heartbeat_stop(source->heartbeat);
    return NULL;
}

static void close_all(const tl_plant_source *sources, size_t count) {
    for (size_t i = 0; i < count; i++) {
        sources[i].driver->close(sources[i].io);
    }
}

void tl_plant_readers_stop(tl_plant_readers *readers) {
    (void)pthread_mutex_lock(&readers->lock);
    readers->stop = true;
    (void)pthread_cond_broadcast(&readers->stopped);
    (void)pthread_mutex_unlock(&readers->lock);
    for (size_t i = 0; i < readers->started; i++) {
        readers->sources[i].driver->interrupt(readers->sources[i].io);
    }
    for (size_t i = 0; i < readers->started; i++) {
        (void)pthread_join(readers->threads[i].thread, NULL);
    }
    close_all(readers->sources, readers->source_count);
    (void)pthread_cond_destroy(&readers->stopped);
    (void)pthread_mutex_destroy(&readers->lock);
    free(readers);
}

static tl_plant_readers *make_readers(const tl_plant_source *sources, size_t count) {
    tl_plant_readers *readers = calloc(1, sizeof *readers + count * sizeof readers->threads[0]);
    pthread_condattr_t clock;
    if (readers == NULL || pthread_condattr_init(&clock) != 0) {
        free(readers);
        return NULL;
    }
    (void)pthread_condattr_setclock(&clock, CLOCK_MONOTONIC);
    (void)pthread_mutex_init(&readers->lock, NULL); /* this call and the next one cannot fail on Linux */
    (void)pthread_cond_init(&readers->stopped, &clock);
    (void)pthread_condattr_destroy(&clock);
    readers->sources = sources;
    readers->source_count = count;
    for (size_t i = 0; i < count; i++) {
        readers->threads[i].readers = readers;
        readers->threads[i].source = &sources[i];
    }
    return readers;
}

tl_status tl_plant_readers_start(const tl_plant_source *sources, size_t count, const tl_sample_buffer *buffers,
                                 void (*on_link)(void *context, const char *source, bool good, const char *text),
                                 void *context, tl_plant_readers **readers, tl_error *error) {
    tl_plant_readers *made = make_readers(sources, count);
    if (made == NULL) {
        close_all(sources, count);
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for %zu plant sources", count);
    }
    made->buffers = buffers;
    made->on_link = on_link;
    made->context = context;
    int failure = 0;
    while (made->started < count && failure == 0) {
        source_thread *own = &made->threads[made->started];
        failure = tl_side_thread_start(&own->thread, STACK, run, own);
        made->started += failure == 0 ? 1 : 0;
    }
    if (failure != 0) {
        tl_plant_readers_stop(made);
        return tl_fail(error, TL_TRY_AGAIN, "cannot start a thread for a plant source: %s", strerror(failure));
    }
    *readers = made;
    return TL_OK;
}
