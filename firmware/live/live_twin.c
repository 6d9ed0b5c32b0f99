/* Live twin: the process of a run that runs the FMUs and the real-time cycle.
 *
 * Purpose: builds the twin, resumes an earlier run, and keeps the twin locked to the plant until
 *          the process is asked to end. Passes all records to the recorder. In safe hold it only
 *          reads and records the plant's samples, without FMUs.
 * Access:  only what these tasks need (confine.h). It reads the sample memory that io writes; it
 *          writes its record queue and its status block.
 * Resume:  if an earlier process of this run has died, the twin resumes from the newest checkpoint
 *          in the record queue and the later entries. Else it requests resume data from the
 *          recorder, which reads the database.
 * Shadow:  a twin of another configuration in the other slot (handover.h). It simulates the
 *          recorded samples first, then the plant's ticks. Its events go to the log only. A
 *          handover swaps the roles of live twin and shadow. A shadow that is too slow ends.
 * Thread:  the main thread of its process; FMUs and cycle have another one.
 */
#include <inttypes.h>
#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/live/live_role.h"
#include "firmware/live/shadow_warm_up.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/process/role.h"
#include "firmware/report/journal.h"
#include "firmware/retune/comparison.h"
#include "firmware/twin/cycle.h"
#include "firmware/twin/resume.h"
#include "firmware/twin/twin_recorder.h"

/* How long the start waits for a first reading of every signal, and for its real-time priority. */
static const tl_time FIRST_READING = 2 * TL_SECOND;
static const tl_time PRIORITY = TL_SECOND / 2;

/* Heartbeat timeouts of the main thread: while FMUs are loaded, and later (the log may be slow). */
static const tl_time PATIENCE_AT_START = 120 * TL_SECOND;
static const tl_time PATIENCE = 30 * TL_SECOND;

/* A shadow ends if it has not caught up after PATIENCE_BEHIND. It also ends if it misses more than
 * 1/MISSED_PART of its ticks, which is checked from FIRST_CHECK on. */
static const tl_time PATIENCE_BEHIND = 60 * TL_SECOND;
static const tl_time FIRST_CHECK = 10 * TL_SECOND;
enum { MISSED_PART = 10 };

static const tl_time POLL = TL_SECOND / 20;
static const tl_time POLL_SOON = TL_SECOND / 1000;

/* The time limit for the recorder's answer: the lock to the plant is more important. */
static const tl_time PATIENCE_FOR_RESUME = 10 * TL_SECOND;

/* After so many ticks with a loaded state, that state counts as harmless: a broken state shows in a
 * step. */
enum { SOUND_AFTER = 3 };

/* State of this process. */
typedef struct live_twin {
    tl_assembly *assembly;
    const tl_config *config;
    const tl_confine_facts *facts;
    tl_live_job job;
    bool was_plant_open;
    tl_block blocks[TL_LIVE_BLOCKS];         /* those that this process maps */
    tl_block *resume;                        /* resume block; copied before it is parsed */
    const tl_live_recorder_status *recorder; /* NULL: nothing is recorded */
    tl_live_twin_status *live_status;
    tl_time ended; /* last tick of an earlier run that is not resumed; 0: unknown */
    tl_plant_input input;
    tl_record_queue queue;
    tl_config run; /* shadow: configuration of the live twin, whose samples were recorded */
    tl_thread_heartbeat *heartbeat;
    tl_journal journal;
    tl_fmu_thread *fmus; /* NULL in safe hold */
    tl_cycle *cycle;
    tl_status built; /* result of building the twin */
    tl_summary resumed;
    tl_account account;     /* units of the matched outputs */
    bool is_shadow;         /* now */
    int64_t next;           /* shadow: first tick of the cycle */
    uint32_t request_count; /* shadow: number of requests for samples */
    void *samples;          /* shadow: copy of the last samples */
    int64_t parent;         /* shadow: run that it continues after a handover */
    bool files_changed;     /* the FMU files differ from those of the previous process */
    bool has_crashed;       /* the previous process loaded a checkpoint and made no step */
    bool unreadable;        /* other processes cannot load states of these FMUs */
    bool was_ready;
    tl_realtime_missing missing;
    bool has_run; /* the record queue has a run that has not ended */
} live_twin;

/* ---- shared memory ---- */

/* The record queue names the configuration of the build. Another tuning is in its own block, whose
 * text only the recorder reads. */
static void open_queue(live_twin *self) {
    const tl_record_queue_settings settings = tl_live_twin_queue(self->config);
    const tl_live_recorder_status *recorder = self->recorder;
    tl_run_tuning configured = {.number = 0};
    tl_record_queue_open(&settings, self->blocks[TL_LIVE_QUEUE + self->job.slot_index].bytes,
                         recorder != NULL ? &recorder->state.taken[TL_LIVE_QUEUE_TWIN + self->job.slot_index] : NULL,
                         &self->queue);
    tl_record_queue_hide_unused(&self->queue);
    tl_live_tuning_hide_text(&self->blocks[TL_LIVE_TUNING + self->job.slot_index]);
    memcpy(configured.hash, self->config->hash, sizeof configured.hash);
    tl_config_tuning(self->config, &configured.values);
    tl_record_queue_name_configuration(&self->queue, &configured);
}

/* Applies the job to `config`. */
static tl_status open_memory(live_twin *self, const tl_twin_job *job, tl_config *config, tl_error *error) {
    const char *path = NULL;
    const char *of_run = NULL;
    tl_status status = tl_live_job_unpack(job->live, job->live_size, &self->job, &path, &of_run, error);
    if (status == TL_OK) {
        tl_live_job_apply(&self->job, config);
        status = self->job.is_shadow ? tl_live_job_read(&self->job, path, of_run, &self->run, error) : TL_OK;
    }
    if (status == TL_OK) {
        status = tl_live_blocks_take(TL_LIVE_IS_TWIN, &self->job, config, self->blocks, error);
    }
    if (status == TL_OK) {
        status = tl_live_input_open(config, &self->blocks[TL_LIVE_SAMPLES], &self->input, error);
    }
    if (status == TL_OK) {
        self->live_status = self->blocks[TL_LIVE_TWIN_STATUS + self->job.slot_index].bytes;
        self->resume = &self->blocks[TL_LIVE_RESUME + self->job.slot_index];
        self->recorder = self->blocks[TL_LIVE_RECORDER_STATUS].bytes;
        open_queue(self);
    }
    return status;
}

/* ---- the FMUs' files ---- */

/* Identifies the FMU files before any of them is loaded. Their content is hashed only once, because
 * that takes time. */
static void identify_files(live_twin *self) {
    tl_live_twin_status *live_status = self->live_status;
    int descriptors[TL_IDENTITY_FILES] = {0};
    const size_t components = self->config->component_count;
    const size_t count = components < TL_IDENTITY_FILES ? components : TL_IDENTITY_FILES; /* maximum */
    for (size_t i = 0; i < count; i++) {
        descriptors[i] = self->assembly->files[i].descriptor;
    }
    uint64_t number = tl_identity_number_of_open_files(descriptors, count); /* checkpoints need it */
    bool is_known =
        live_status->fmus == number && live_status->digest[0] != '\0' && tl_identity_is_sound(live_status->digest);
    self->files_changed = live_status->fmus != 0 && live_status->fmus != number;
    if (!is_known && self->job.database[0] != '\0') {
        tl_identity_open_files(descriptors, count, live_status->digest);
    }
    live_status->fmus = number;
    self->has_crashed = live_status->loads != 0 && !self->files_changed;
    self->unreadable = live_status->unreadable == number;
    live_status->loads = 0;
    tl_record_queue_name_fmus(&self->queue, live_status->digest);
}

/* ---- events ---- */

/* Reports the number and the reason of this start. */
static void report_start(live_twin *self) {
    const tl_start *how = &self->job.how;
    char number[32] = "first start";
    char failures[48] = "no failures";
    if (self->job.unsupervised) {
        return;
    }
    if (how->starts > 1) {
        (void)snprintf(number, sizeof number, "start %llu", (unsigned long long)how->starts);
    }
    if (how->restarts > 0) {
        (void)snprintf(failures, sizeof failures, "%llu after a failure", (unsigned long long)how->restarts);
    }
    tl_journal_event(&self->journal, -1, how->again ? TL_EVENT_WARNING : TL_EVENT_INFO, "supervisor",
                     "the twin has started (%s, %s)%s%s", number, failures, how->reason[0] != '\0' ? ": " : "",
                     how->reason);
}

/* Reports confinement features that are missing. */
static void report_confinement(live_twin *self) {
    char text[TL_CONFINE_TEXT];
    if (self->job.how.hold) {
        return;
    }
    if (self->job.unconfined) {
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "twin", "unconfined: FMUs can do what this user can");
        return;
    }
    tl_confine_describe(self->facts, text);
    if (text[0] != '\0') {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "twin", "%s", text);
    }
}

/* Called if the process ends during an FMU call. The recorder outlives this process and reads the
 * event from the queue. */
static void record_exit(void *context, const char *why) {
    live_twin *self = context;
    if (!tl_journal_is_apart(&self->journal)) {
        tl_record_queue_event(&self->queue, -1, TL_EVENT_ERROR, "twin", why);
    }
}

/* ---- the cycle ---- */

/* True when io has opened all sources once; a restarted io opens them again. */
static bool is_plant_open(live_twin *self) {
    self->was_plant_open = self->was_plant_open || tl_heartbeats_is_ready(self->blocks[TL_LIVE_IO_BEATS].bytes);
    return self->was_plant_open;
}

/* The supervisor changes the scheduling of the FMU thread on request; the main thread waits for
 * that. */
static void request_realtime(live_twin *self, bool is_realtime) {
    int wanted = is_realtime ? SCHED_FIFO : SCHED_OTHER;
    pid_t thread = tl_fmu_thread_number(self->fmus);
    tl_time until = tl_clock_now(NULL) + PRIORITY;
    if (self->config->realtime_priority <= 0) {
        return;
    }
    __atomic_store_n(&self->live_status->realtime, is_realtime ? (int32_t)thread : 0, __ATOMIC_RELEASE);
    while (sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted && tl_clock_now(NULL) < until) {
        tl_clock_sleep_until(tl_clock_now(NULL) + POLL_SOON);
    }
    self->missing.priority = is_realtime && sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted;
}

/* ---- status ---- */

/* For the config manager and clients, which show and compare them. `record`: the newest; NULL: none
 * yet. */
static void publish_status(live_twin *self, tl_run_status *published, const tl_metrics *match,
                           const tl_record *record) {
    published->outputs = (uint32_t)self->config->match_count;
    for (size_t i = 0; i < self->config->match_count; i++) {
        tl_run_output *output = &published->output[i];
        (void)snprintf(output->name, sizeof output->name, "%s", self->config->match[i].variable);
        (void)snprintf(output->unit, sizeof output->unit, "%s", self->account.match[i].unit);
        output->pairs = match[i].pairs;
        output->sum_of_squares = match[i].sum_of_squares;
        output->tolerance = self->config->match[i].weight > 0.0 ? self->config->match[i].tolerance : 0.0;
        output->y = record != NULL ? record->y[i] : (double)NAN;
        output->measured = record != NULL && record->measured_quality[i] == TL_GOOD ? record->measured[i] : (double)NAN;
    }
    tl_latest_publish(&self->live_status->figures, published, sizeof *published);
}

/* Warm-up of a shadow. */
static void show_recorded(void *context, const tl_run_status *status, const tl_metrics *match) {
    tl_run_status published = *status;
    published.phase = TL_RUN_RECORDED;
    published.ticks = (uint64_t)status->tick;
    publish_status(context, &published, match, NULL);
}

/* Live, or while missed ticks are caught up. */
static void show_status(live_twin *self, const tl_cycle_status *status) {
    char line[TL_STATUS_LINE];
    tl_run_status published = {
        .phase = status->has_caught_up ? TL_RUN_LIVE : TL_RUN_RECORDED,
        .tick = status->tick,
        .last = status->tick,
        .ticks = status->ticks,
        .steps = status->steps,
        .skipped = status->skipped,
        .gaps = status->gaps,
        .deadline_misses = status->deadline_misses,
        .evaluations = status->evaluations,
        .executions = status->executions,
        .timed_out = status->timed_out,
        .used = status->used,
        .late = status->late,
        .plant_is_shut = !is_plant_open(self),
        .lock = status->lock,
        .lock_before = status->lock_before,
    };
    const tl_live_recorder_status *recorder = self->recorder;
    uint32_t open = recorder != NULL ? __atomic_load_n(&recorder->open_findings, __ATOMIC_RELAXED) : 0;
    tl_status_line_write(self->config, status, open, line);
    tl_heartbeats_set_status(&self->live_status->beats, line);
    published.corrections = (uint32_t)self->config->adjust_count;
    for (size_t i = 0; i < self->config->adjust_count; i++) {
        tl_run_correction *correction = &published.correction[i];
        (void)snprintf(correction->name, sizeof correction->name, "%s", self->config->adjust[i].variable);
        correction->count = status->adjust[i].count;
        correction->sum = status->adjust[i].correction_sum;
    }
    publish_status(self, &published, status->match, &status->record);
}

/* ---- resume ---- */

/* Publishes t_start of the run for a shadow that may start later. */
static void publish_start(live_twin *self, tl_time start, int64_t started) {
    __atomic_store_n(&self->live_status->started, started, __ATOMIC_RELAXED);
    __atomic_store_n(&self->live_status->start, start, __ATOMIC_RELEASE);
}

static void set_ready(live_twin *self) {
    tl_heartbeats_set_ready(&self->live_status->beats);
    self->was_ready = true;
}

/* Requests resume data with this number, waits for the answer, and copies it. Returns false if
 * there is no answer in time. */
static bool request_resume(live_twin *self, uint32_t number, tl_live_resume_answer *answer) {
    tl_live_request request = tl_live_request_of(self->job.number, number);
    tl_time until = tl_clock_now(NULL) + PATIENCE_FOR_RESUME;
    __atomic_store_n(&self->live_status->resume, request, __ATOMIC_RELEASE);
    const tl_live_resume_answer *reply = &self->recorder->answer[self->job.slot_index];
    while (__atomic_load_n(&reply->live_request, __ATOMIC_ACQUIRE) != request) {
        if (tl_clock_now(NULL) > until || tl_interrupt_requested() != NULL) {
            return false;
        }
        tl_thread_heartbeat_beat(self->heartbeat);
        tl_clock_sleep_until(tl_clock_now(NULL) + POLL_SOON);
    }
    *answer = *reply;
    for (size_t i = 0; i < TL_LIVE_RESUME_WORDS; i++) {
        answer->words[i].text[TL_RESUME_TEXT - 1] = '\0';
    }
    return true;
}

/* ---- following, in the FMU thread ---- */

/* A job for the FMU thread, and its result. */
typedef struct follow_job {
    live_twin *twin;
    const tl_resume *resume;
    tl_resume_outcome outcome;
    tl_error *error;
    tl_status status;
} follow_job;

static void report_resume(void *context, tl_severity severity, const char *text) {
    tl_journal_event(context, -1, severity, "resume", "%s", text);
}

static void do_follow(void *context) {
    follow_job *job = context;
    const tl_resume_follow_settings following = {.assembly = job->twin->assembly,
                                                 .queue = &job->twin->queue,
                                                 .report = report_resume,
                                                 .context = &job->twin->journal};
    job->status = tl_resume_follow(&following, job->resume, &job->twin->resumed, &job->outcome, job->error);
}

/* Returns the number of the newest run in the database; for a shadow, that is the run that it
 * continues. 0: nothing is recorded. */
static int64_t newest_run(const live_twin *self) {
    return self->recorder == NULL ? 0 : tl_recorder_state_get(&self->recorder->state).run;
}

/* Notes whether the FMUs load bytes that another process has saved. The note outlives this process.
 */
static void note_load(const live_twin *self, bool loads) {
    __atomic_store_n(&self->live_status->loads, loads ? 1 : 0, __ATOMIC_RELEASE);
}

/* *refused: this data cannot be used; older data may work. */
static tl_status follow_resume(live_twin *self, const tl_resume *resume, bool *refused, tl_error *error) {
    const int64_t last = newest_run(self); /* before this run starts */
    follow_job job = {.twin = self, .resume = resume, .error = error};
    *refused = (self->has_crashed || self->unreadable) && resume->checkpoint != NULL;
    if (*refused) {
        return TL_OK;
    }
    note_load(self, resume->checkpoint != NULL);
    tl_fmu_thread_call(self->fmus, do_follow, &job);
    /* Until some ticks were followed, only the twin's own steps can show if the loaded state is
     * harmful. */
    if (job.status != TL_FMU_FATAL &&
        (job.outcome != TL_RESUME_FOLLOWED || resume->last - resume->first + 1 >= SOUND_AFTER)) {
        note_load(self, false);
    }
    *refused = job.status == TL_OK && job.outcome == TL_RESUME_REFUSED;
    if (job.status == TL_OK && job.outcome == TL_RESUME_FAILED) {
        (void)tl_record_queue_put_end(&self->queue, "could not resume an earlier run");
    }
    if (self->resumed.resumption.from != TL_RESUMED_NOT && self->resumed.resumption.run < 0) {
        self->resumed.resumption.run = last;
    }
    return job.status;
}

/* ---- data of the previous process ---- */

/* *any: the record queue has a run. */
static tl_status follow_queue(live_twin *self, bool *any, tl_error *error) {
    tl_resume_queue *points = tl_resume_queue_open(&self->queue, self->assembly, report_resume, &self->journal);
    tl_resume resume;
    bool refused = true;
    tl_status status = TL_OK;
    *any = points != NULL;
    while (status == TL_OK && refused && tl_resume_queue_next(points, &resume)) {
        status = follow_resume(self, &resume, &refused, error);
    }
    tl_resume_queue_close(points);
    return status;
}

/* ---- data of the recorder ---- */

static void report_answer(live_twin *self, const tl_live_resume_answer *answer) {
    for (size_t i = 0; i < TL_LIVE_RESUME_WORDS && answer->words[i].text[0] != '\0'; i++) {
        const tl_live_resume_word *message = &answer->words[i];
        bool is_known = message->severity >= TL_EVENT_INFO && message->severity <= TL_EVENT_ERROR;
        report_resume(&self->journal, is_known ? (tl_severity)message->severity : TL_EVENT_WARNING, message->text);
    }
}

/* Copies the image first, because the recorder could change it during the parsing. */
static tl_status follow_image(live_twin *self, size_t size, bool *refused, tl_error *error) {
    tl_resume resume;
    void *image = malloc(size);
    if (image == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory to resume");
    }
    memcpy(image, self->resume->bytes, size);
    tl_status status = tl_resume_read(image, size, self->config, tl_clock_now(NULL), &resume, error);
    if (status == TL_OK) {
        status = follow_resume(self, &resume, refused, error);
    } else {
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "resume", "starts a new run: %.180s", error->text);
        status = TL_OK;
        *refused = false;
    }
    free(image);
    return status;
}

static tl_status follow_recorder(live_twin *self, tl_error *error) {
    tl_live_resume_answer answer;
    bool refused = true;
    tl_status status = TL_OK;
    for (uint32_t number = 1; status == TL_OK && refused; number++) {
        if (!request_resume(self, number, &answer)) {
            if (tl_interrupt_requested() != NULL) { /* no answer is needed at the end */
                return TL_OK;
            }
            tl_journal_event(
                &self->journal, -1, TL_EVENT_WARNING, "resume",
                "starts a new run: the recorder did not send the records of the previous one within %.0f s",
                tl_seconds(PATIENCE_FOR_RESUME));
            return TL_OK;
        }
        report_answer(self, &answer);
        self->ended = answer.ended;
        refused = answer.size > 0 && answer.size <= TL_LIVE_RESUME_BYTES;
        if (refused) {
            status = follow_image(self, (size_t)answer.size, &refused, error);
        }
    }
    return status;
}

/* Resumes an earlier run; `resumed` reports how. If the previous process died in the same run,
 * checkpoint and entries are in the record queue. Else the recorder is asked; if its data cannot be
 * used, for older data. */
static tl_status follow_resumed(live_twin *self, tl_error *error) {
    bool any = false;
    if (self->config->record_resume == 0) {
        return TL_OK;
    }
    tl_status status = follow_queue(self, &any, error);
    if (status == TL_OK && !any && self->recorder != NULL) {
        status = follow_recorder(self, error);
    }
    tl_block_close(self->resume);
    return status;
}

/* ---- a shadow ---- */

static size_t fetch_samples(void *context, int64_t from, const void **image) {
    live_twin *self = context;
    tl_live_resume_answer answer = {.size = 0};
    if (self->recorder == NULL) {
        return 0;
    }
    __atomic_store_n(&self->live_status->resumed_from, from, __ATOMIC_RELAXED);
    if (!request_resume(self, ++self->request_count, &answer) || answer.size > TL_LIVE_RESUME_BYTES) {
        return 0;
    }
    report_answer(self, &answer);
    free(self->samples);
    self->samples = malloc((size_t)answer.size + 1);
    if (self->samples == NULL) {
        return 0;
    }
    memcpy(self->samples, self->resume->bytes, (size_t)answer.size);
    *image = self->samples;
    return (size_t)answer.size;
}

/* The shadow is ready before its warm-up, which may take a minute. */
static tl_status begin_shadow(live_twin *self, tl_error *error) {
    static const tl_run_status none = {.ticks = 0};
    static const tl_metrics no_match[TL_MAX_MATCH];
    publish_start(self, self->job.start, self->job.started);
    set_ready(self);
    show_recorded(self, &none, no_match);
    const tl_shadow_warm_up course = {
        .assembly = self->assembly,
        .thread = self->fmus,
        .journal = &self->journal,
        .heartbeat = self->heartbeat,
        .start = self->job.start,
        .run = &self->run,
        .fetch = fetch_samples,
        .show = show_recorded,
        .context = self,
    };
    tl_status status = tl_shadow_warm_up_run(&course, &self->next, error);
    free(self->samples);
    tl_block_close(self->resume);
    return status;
}

static tl_status resume_run(live_twin *self, tl_error *error) {
    if (self->has_crashed) { /* neither that checkpoint nor another one is loaded by this process */
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "resume",
                         "the previous twin process ended after it had loaded a checkpoint: this one repeats recorded "
                         "inputs instead%s",
                         self->unreadable ? "; checkpoints of these FMUs are neither saved nor loaded any more" : "");
    }
    if (self->files_changed) {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "resume", "starts a new run: the FMU files have changed");
        return TL_OK;
    }
    return follow_resumed(self, error);
}

/* ---- the cycle's start ---- */

static tl_cycle_settings settings_of_cycle(live_twin *self) {
    return (tl_cycle_settings){
        .assembly = self->assembly,
        .thread = self->fmus,
        .input = &self->input,
        .queue = &self->queue,
        .journal = &self->journal,
        .beats = &self->live_status->beats,
        .tuning = self->blocks[TL_LIVE_TUNING + self->job.slot_index].bytes,
        .answer = &self->live_status->tuned,
        .resumed = self->resumed,
        .missing = self->missing,
        .unreadable = self->unreadable,
        .slot_index = {.handover_block = self->blocks[TL_HANDOVER].bytes,
                       .slot_index = self->job.slot_index,
                       .handovers = self->job.handovers,
                       .handed_over = &self->live_status->handed_over,
                       .is_shadow = self->is_shadow,
                       .tick = self->next,
                       .start = self->job.start,
                       .started = self->job.started},
    };
}

static tl_status start_cycle(live_twin *self, tl_error *error) {
    tl_account_take(self->assembly->twin, &self->account);
    tl_config_use_bounds(&self->assembly->config, &self->account);
    tl_live_plant_set_limits(&self->input, self->config);
    tl_status status = self->is_shadow ? begin_shadow(self, error) : resume_run(self, error);
    if (status != TL_OK) {
        return status;
    }
    if (!self->is_shadow) {
        /* A sample without unknown values is a better start, but a failed device must not prevent
         * the start. */
        for (tl_time until = tl_clock_now(NULL) + FIRST_READING;
             tl_clock_now(NULL) < until && tl_interrupt_requested() == NULL &&
             !(is_plant_open(self) && tl_plant_input_is_complete(&self->input));) {
            tl_clock_sleep_until(tl_clock_now(NULL) + 5 * POLL_SOON);
        }
        const tl_time gap = tl_clock_now(NULL) - self->ended; /* a change by restart leaves a gap */
        if (self->ended != 0 && gap > 0) {
            tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "resume", "no twin ran for %.2f s (%lld ticks)",
                             tl_seconds(gap), (long long)(gap / self->config->step));
        }
    }
    if (self->config->realtime_lock_memory) {
        self->missing.lock_error = tl_realtime_lock_memory();
    }
    request_realtime(self, !self->is_shadow);
    const tl_cycle_settings settings = settings_of_cycle(self);
    status = tl_cycle_start(&settings, &self->cycle, error);
    if (status == TL_OK) {
        if (!self->is_shadow) {
            report_start(self);
        }
        report_confinement(self);
        if (self->job.database[0] == '\0') {
            tl_log(
                TL_LOG_NOTICE,
                "nothing is recorded: add \"record\" to the configuration or use --db; without it the twin cannot resume "
                "after a restart of this program");
        }
    }
    if (status == TL_OK && !self->is_shadow) {
        const tl_resumption *beginning = tl_record_queue_beginning(&self->queue);
        publish_start(self, beginning->start, beginning->started);
    }
    return status;
}

/* ---- while the cycle runs ---- */

/* A handover may have swapped live twin and shadow. Does not wait for the priority. */
static void update_role(live_twin *self, bool is_shadow) {
    if (is_shadow == self->is_shadow) {
        self->parent = is_shadow ? newest_run(self) : self->parent;
        return;
    }
    bool wishes = !is_shadow && self->config->realtime_priority > 0;
    char title[TL_ROLE_TITLE];
    self->is_shadow = is_shadow;
    (void)snprintf(title, sizeof title, "%s [%s]", is_shadow ? TL_LIVE_TWIN_SHADOW : TL_LIVE_TWIN, self->config->name);
    tl_role_entitle(title);
    __atomic_store_n(&self->live_status->realtime, wishes ? (int32_t)tl_fmu_thread_number(self->fmus) : 0,
                     __ATOMIC_RELEASE);
}

/* A shadow that is too slow has no meaningful result, and takes time from the live twin. */
static tl_status check_pace(const live_twin *self, const tl_cycle_status *status, tl_time since, tl_error *error) {
    if (!status->is_shadow) {
        return TL_OK;
    }
    if (!status->has_caught_up && tl_clock_now(NULL) - since > PATIENCE_BEHIND) {
        return tl_fail(error, TL_TRY_AGAIN,
                       TL_COMPARISON_TWO_TWINS ": the shadow has not caught up with the plant within %.0f s",
                       tl_seconds(PATIENCE_BEHIND));
    }
    bool checked =
        status->has_caught_up && tl_time_of_step(0, self->config->step, (int64_t)status->ticks) >= FIRST_CHECK;
    return !checked || status->skipped <= status->ticks / MISSED_PART
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, TL_COMPARISON_TWO_TWINS ": the shadow missed %llu of %llu ticks",
                         (unsigned long long)status->skipped, (unsigned long long)status->ticks);
}

/* Monitors the cycle until it ends or a signal comes; the cycle does not depend on it. Errors:
 * those of check_pace(). */
static tl_status monitor_cycle(live_twin *self, tl_error *error) {
    tl_cycle_status status = {0};
    tl_status checked = TL_OK;
    tl_time since = tl_clock_now(NULL);
    while (tl_interrupt_requested() == NULL && !status.ended && checked == TL_OK) {
        tl_clock_sleep_until(tl_clock_now(NULL) + POLL);
        tl_thread_heartbeat_beat(self->heartbeat);
        tl_fmu_thread_watch(self->fmus);
        tl_journal_drain(&self->journal);
        if (!tl_cycle_status_now(self->cycle, &status)) {
            continue;
        }
        checked = check_pace(self, &status, since, error);
        if (status.steps != 0) {
            __atomic_store_n(&self->live_status->loads, 0, __ATOMIC_RELAXED);
            show_status(self, &status);
            update_role(self, status.is_shadow);
        }
    }
    return checked;
}

static void run_safe_hold(live_twin *self) {
    const tl_cycle_settings cycle = settings_of_cycle(self);
    const tl_safe_hold_settings settings = {
        .cycle = &cycle,
        .heartbeat = self->heartbeat,
        .failures = self->job.how.failures + self->job.how.tries,
        .missing = self->job.how.missing,
        .time = self->job.how.hold_time,
        .reason = self->job.how.reason,
        .records = self->job.database[0] != '\0',
        .since = self->job.start,
    };
    if (settings.since == 0) {
        report_start(self);
    }
    tl_safe_hold(&settings);
}

/* ---- end ---- */

static void report_warning(void *context, const char *text) {
    tl_journal_event(context, -1, TL_EVENT_WARNING, "twin", "%s", text);
}

static tl_status close_cycle(live_twin *self, tl_error *error) {
    tl_live_end *end = &self->live_status->end;
    tl_status status = tl_cycle_stop(self->cycle, &end->summary, &self->has_run, error);
    if (end->summary.resumption.run < 0) {
        end->summary.resumption.run = self->parent;
    }
    request_realtime(self, false);
    tl_account_take(self->assembly->twin, &end->account);
    if (status != TL_OK) { /* a failed step also explains a difference between predicted and real executions */
        tl_journal_event(&self->journal, -1, TL_EVENT_ERROR, "twin", "%s", error->text);
    } else {
        tl_twin_recorder_check(&end->account, report_warning, &self->journal);
    }
    if (end->summary.ages.values != 0) {
        char ages[TL_AGES_TEXT];
        tl_ages_write(&end->summary.ages, ages);
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "plant", "%s", ages);
    }
    __atomic_store_n(&end->is_there, 1, __ATOMIC_RELEASE);
    return status;
}

static void put_end(live_twin *self, tl_status status, const tl_error *error) {
    const tl_handover *handover_block = self->blocks[TL_HANDOVER].bytes;
    bool again = handover_block != NULL && __atomic_load_n(&handover_block->again, __ATOMIC_ACQUIRE) != 0;
    const char *signal = again ? TL_LIVE_RESTARTED : tl_interrupt_requested();
    const char *reason = status != TL_OK ? error->text : signal != NULL ? signal : "end of duration";
    (void)tl_record_queue_put_end(&self->queue, reason);
}

/* Runs the cycle or safe hold until it is asked to end. */
static tl_status run_live(live_twin *self) {
    tl_error error = {0};
    tl_status status = self->job.how.hold ? TL_OK : start_cycle(self, &error);
    bool begun = status == TL_OK;
    tl_thread_heartbeat_set_timeout(self->heartbeat, PATIENCE);
    __atomic_store_n(&self->live_status->begun, 1, __ATOMIC_RELEASE);
    if (begun) {
        set_ready(self);
        if (self->job.how.hold) {
            run_safe_hold(self);
        } else {
            status = monitor_cycle(self, &error);
        }
    }
    if (self->cycle != NULL) {
        tl_error of_cycle = {0};
        tl_status closed = close_cycle(self, &of_cycle);
        error = status == TL_OK ? of_cycle : error;
        status = status == TL_OK ? closed : status;
    }
    tl_process_set_saver(NULL, NULL);
    if (begun && (self->job.how.hold || self->has_run)) {
        put_end(self, status, &error);
    }
    tl_journal_end(&self->journal);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        if (self->is_shadow) {
            tl_heartbeats_set_status(&self->live_status->beats, error.text); /* for the config manager */
        }
    }
    return status;
}

/* ---- the twin ---- */

static void do_build(void *context) {
    live_twin *self = context;
    self->assembly->trusts_states = self->job.how.failures > 0; /* a memory copy may have failed */
    self->built = tl_assembly_build(self->assembly);
}

static void do_free(void *context) {
    tl_assembly_free(context);
}

/* Starts the FMU thread and builds the twin in it. */
static tl_status build_twin(live_twin *self) {
    tl_error error;
    tl_status status = tl_fmu_thread_start(TL_FMU_WATCHED_HERE, &self->fmus, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return status;
    }
    tl_fmu_thread_call(self->fmus, do_build, self);
    return self->built;
}

int tl_live_twin(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts) {
    static live_twin self; /* one per process */
    tl_error error;
    self.assembly = assembly;
    assembly->recorded.length = assembly->config.duration;
    self.config = &assembly->config;
    self.facts = facts;
    tl_status status = open_memory(&self, job, &assembly->config, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    tl_fmu_calls_use(&self.live_status->beats.calls);
    self.heartbeat = tl_thread_heartbeat_start(&self.live_status->beats, "main", PATIENCE_AT_START);
    tl_live_role_open_journal(&self.journal, &self.queue);
    self.is_shadow = self.job.is_shadow;
    tl_journal_set_apart(&self.journal, self.is_shadow);
    tl_process_set_saver(record_exit, &self);
    if (!self.job.how.hold) {
        identify_files(&self);
        status = build_twin(&self);
    }
    if (status == TL_OK) {
        status = run_live(&self);
    }
    int code = tl_live_role_end(&self.live_status->beats, self.was_ready, tl_exit_code(status));
    if (self.fmus != NULL) {
        tl_process_complete(code);
        tl_fmu_thread_call(self.fmus, do_free, assembly);
        tl_fmu_thread_end(self.fmus);
    }
    return code;
}
