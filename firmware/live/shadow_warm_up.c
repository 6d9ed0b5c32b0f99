/* Warm-up of a shadow: see shadow_warm_up.h. */
#include "firmware/live/shadow_warm_up.h"

#include <string.h>

#include "firmware/base/os.h"
#include "firmware/fmu/fmu_guard.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/retune/comparison.h"
#include "firmware/twin/resume.h"

/* Computing time of one part. */
static const tl_time PART = TL_SECOND / 50;

/* Samples of less than this time are left to the cycle, which catches up. (AHEAD, in ticks: first
 * tick after now if nothing was recorded.) */
static const tl_time REMAINDER = 2 * TL_SECOND;

/* Maximum age of the newest recorded sample. */
static const tl_time STALE = 10 * TL_SECOND;

/* Heartbeat timeouts of the caller: at the first tick and after the warm-up; and in addition to the
 * timeout of an FMU call. */
static const tl_time PATIENCE = 120 * TL_SECOND;
static const tl_time EXTRA = TL_SECOND;
enum { AHEAD = 2 };

/* Required speed relative to the plant; it is checked after this computing and sleeping time. */
static const double PACE = 1.2;
static const tl_time FIRST_PACE = 5 * TL_SECOND;

typedef struct course_walk {
    const tl_shadow_warm_up *course;
    size_t recorded[TL_MAX_SIGNALS]; /* of each signal: its index among those of the live twin */
    tl_resume samples;
    int64_t next;
    bool has_begun;
    tl_time computed; /* in total */
    tl_time slept;
    tl_run_status status_now;
    tl_metrics match[TL_MAX_MATCH];
    tl_status status;
    tl_error *error;
} course_walk;

/* ---- signals ---- */

/* Both configurations have the same plant signals in the same order (config_change.h), but their
 * own look-ups. For a look-up that the live twin does not have, the signal's own value is used. */
static size_t find_recorded(const tl_config *run, const tl_config_signal *signal) {
    for (size_t i = 0; i < run->signal_count; i++) {
        if (strcmp(run->signals[i].plan.name, signal->plan.name) == 0) {
            return i;
        }
    }
    return signal->of;
}

static void sample_of(const course_walk *self, const tl_sample *of_run, tl_sample *sample) {
    *sample = (tl_sample){.tick = of_run->tick, .instant = of_run->instant};
    for (size_t i = 0; i < self->course->assembly->config.signal_count; i++) {
        const size_t at = self->recorded[i];
        sample->values[i] = of_run->values[at];
        sample->stamps[i] = of_run->stamps[at];
        sample->quality[i] = of_run->quality[at];
    }
    tl_live_plant_apply_bounds(&self->course->assembly->config, sample);
}

/* ---- in the thread of the FMUs ---- */

static void count_step(course_walk *self, const tl_record *record) {
    tl_run_status *status_now = &self->status_now;
    status_now->steps++;
    status_now->evaluations += record->evaluations;
    status_now->executions += record->executions;
    status_now->timed_out += record->stop == TL_STOP_TIME ? 1 : 0;
    status_now->used += record->used;
    for (size_t i = 0; i < self->course->assembly->config.match_count; i++) {
        tl_metrics_add(&self->match[i], record->y[i], record->measured[i], (tl_quality)record->measured_quality[i]);
    }
}

static void execute_tick(course_walk *self, const tl_sample *sample) {
    const tl_config *config = &self->course->assembly->config;
    const tl_budget budget = {
        .evaluations = config->budget_evaluations,
        .time = config->budget_time,
        .started = tl_clock_now(NULL),
        .now = tl_clock_now,
        .unrecorded = true,
    };
    tl_record record;
    bool ready = false;
    self->status = tl_twin_step(self->course->assembly->twin, sample, &budget, &record, &ready, self->error);
    if (ready) {
        count_step(self, &record);
    }
    if (self->status == TL_OK) {
        self->next++;
        self->status_now.tick++;
    }
}

static void execute_part(void *context) {
    course_walk *self = context;
    tl_time begun = tl_clock_now(NULL);
    tl_time now = begun;
    tl_resume_tick recorded;
    tl_sample sample;
    const int64_t most = self->computed == 0 ? 1 : INT64_MAX; /* the first tick is slow: initialisation */
    while (self->status == TL_OK && now - begun < PART && self->status_now.tick < most &&
           tl_resume_tick_at(&self->samples, self->next, &recorded)) {
        sample_of(self, &recorded.sample, &sample);
        execute_tick(self, &sample);
        now = tl_clock_now(NULL);
    }
    tl_fmu_guard_tick(true);
    self->computed += now - begun;
}

/* ---- in the main thread ---- */

static tl_status check_pace(const course_walk *self, tl_error *error) {
    double taken = tl_seconds(self->computed + self->slept);
    double pace = tl_seconds(tl_time_of_step(0, self->course->assembly->config.step, self->status_now.tick)) / taken;
    if (self->computed + self->slept < FIRST_PACE || pace >= PACE) {
        return TL_OK;
    }
    return tl_fail(error, TL_TRY_AGAIN,
                   TL_COMPARISON_TWO_TWINS ": with half a processor the shadow is %.2g times as fast as the plant "
                                           "(expected: at least %.1f times)",
                   pace, PACE);
}

static void sleep_after(course_walk *self, tl_time computed) {
    tl_clock_sleep_until(tl_clock_now(NULL) + computed);
    self->slept += computed;
    tl_thread_heartbeat_beat(self->course->heartbeat);
    tl_thread_heartbeat_set_timeout(self->course->heartbeat, self->course->assembly->config.realtime_hang + EXTRA);
    self->course->show(self->course->context, &self->status_now, self->match);
}

/* Simulates all samples of the image. */
static tl_status execute_samples(course_walk *self) {
    tl_status status = TL_OK;
    while (status == TL_OK && self->next <= self->samples.last && tl_interrupt_requested() == NULL) {
        tl_time before = self->computed;
        tl_fmu_thread_call(self->course->thread, execute_part, self);
        sleep_after(self, self->computed - before);
        status = self->status == TL_OK ? check_pace(self, self->error) : self->status;
    }
    return status;
}

static int64_t present_tick(const course_walk *self) {
    return (tl_clock_now(NULL) - self->course->start) / self->course->assembly->config.step;
}

/* Fetches the next samples. Returns false if none follow; an unexpected reason is reported. */
static bool fetch_samples(course_walk *self) {
    const tl_shadow_warm_up *course = self->course;
    const void *image = NULL;
    tl_error error;
    size_t size = course->fetch(course->context, self->has_begun ? self->next : -1, &image);
    if (size == 0) {
        return false;
    }
    if (tl_resume_read_samples(image, size, course->run, course->start, &self->samples, &error) != TL_OK) {
        tl_journal_event(course->journal, -1, TL_EVENT_INFO, "resume", "starts without recorded samples: %.180s",
                         error.text);
        return false;
    }
    return !self->has_begun || self->samples.first == self->next;
}

static void begin_at(course_walk *self, int64_t tick) {
    tl_twin_begin_at(self->course->assembly->twin, tick);
    self->next = tick;
    self->has_begun = true;
}

/* If the disk accepts no more data, the recorded samples end long ago, and the samples since then
 * are missing. */
static bool is_stale(const course_walk *self) {
    tl_time step = self->course->assembly->config.step;
    bool is_old =
        !self->has_begun && (present_tick(self) - self->samples.first) > (TL_RESUME_SAMPLES_BEFORE + STALE) / step;
    if (is_old) {
        tl_journal_event(
            self->course->journal, -1, TL_EVENT_WARNING, "resume",
            "starts without recorded samples: the newest are older than %.0f s: check that the run is recorded",
            tl_seconds(STALE));
    }
    return is_old;
}

tl_status tl_shadow_warm_up_run(const tl_shadow_warm_up *course, int64_t *next, tl_error *error) {
    course_walk self = {.course = course, .error = error};
    tl_status status = TL_OK;
    for (size_t i = 0; i < course->assembly->config.signal_count; i++) {
        self.recorded[i] = find_recorded(course->run, &course->assembly->config.signals[i]);
    }
    while (status == TL_OK &&
           (!self.has_begun || present_tick(&self) - self.next > REMAINDER / course->assembly->config.step) &&
           tl_interrupt_requested() == NULL && fetch_samples(&self) && !is_stale(&self)) {
        if (!self.has_begun) {
            tl_twin_set_start(course->assembly->twin, self.samples.start_s);
            begin_at(&self, self.samples.first);
        }
        self.status_now.last = self.status_now.tick + present_tick(&self) - self.next;
        status = execute_samples(&self);
    }
    if (!self.has_begun) {
        begin_at(&self, present_tick(&self) + AHEAD);
    }
    tl_thread_heartbeat_set_timeout(course->heartbeat, PATIENCE);
    *next = self.next;
    return status;
}
