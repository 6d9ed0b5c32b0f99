/* The live twin: the process of a run that holds the FMUs and the real-time cycle.
 *
 * Purpose: builds the twin, goes on where an earlier one was ended, keeps it locked to the plant until it is told to end, and hands all that is
 *          to be kept to the recorder. Or, told to hold: reads and records the plant's samples without any FMU.
 * Holds:   nothing but that (confine.h). It reads the mailboxes that io writes; it writes its outbox and its pulse.
 * Past:    if a process before it has died in the same run, it goes on from the newest checkpoint in the outbox and what was put since. Else
 *          it asks the recorder, who reads the database.
 * Shadow:  a twin of another configuration beside the run's, in the other place (handover.h): it is led over what is recorded, then over the plant's
 *          ticks. What happens in it goes to the log only; a flip makes it the run's twin, and the run's twin a shadow. One that cannot keep pace ends.
 * Thread:  the main thread of its process; FMUs and cycle have another one.
 */
#include <inttypes.h>
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
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/process/role.h"
#include "firmware/twin/cycle.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/resume.h"
#include "firmware/twin/twin_recorder.h"

/* How long the start waits for a first reading of every signal, and for its priority. */
static const tl_time FIRST_READING = 2 * TL_SECOND;
static const tl_time PRIORITY = TL_SECOND / 2;

/* What the main thread's silence may last: while FMUs are loaded, and later (the log may be slow). */
static const tl_time PATIENCE_AT_START = 120 * TL_SECOND;
static const tl_time PATIENCE = 30 * TL_SECOND;

/* A shadow that has not made up what it missed after so long never will; nor is it any use if it misses this part of its ticks, which is judged after some
 * time. */
static const tl_time PATIENCE_BEHIND = 60 * TL_SECOND;
static const tl_time FIRST_JUDGED = 10 * TL_SECOND;
enum { MISSED_PART = 10 };

static const tl_time LOOK = TL_SECOND / 20;
static const tl_time LOOK_SOON = TL_SECOND / 1000;

/* How long the recorder's answer is waited for: the plant's lock comes first. */
static const tl_time PATIENCE_FOR_PAST = 10 * TL_SECOND;

/* Ticks that a twin has followed with a state that it was given as bytes: what is wrong with those shows in a step. */
enum { SOUND_AFTER = 3 };

/* All that this process has. */
typedef struct live_twin {
    tl_assembly *assembly;
    const tl_config *config;
    const tl_confine_facts *facts;
    tl_live_job job;
    bool was_plant_open;
    tl_block blocks[TL_LIVE_BLOCKS]; /* that it has of the run */
    tl_block *resume; /* what the recorder has found (resume.h), which is copied before it is looked at */
    const tl_live_recorder_pulse *recorder; /* NULL: nothing is recorded */
    tl_live_twin_pulse *pulse;
    tl_time ended; /* of a run before that is not gone on with: when its last tick was; 0: not known */
    tl_plant_input input;
    tl_record_queue queue;
    tl_config run; /* of a shadow: the configuration of the run beside which it is, whose recorded samples it reads */
    tl_thread_heartbeat *heartbeat;
    tl_journal journal;
    tl_fmu_thread *fmus; /* NULL if it holds */
    tl_cycle *cycle;
    tl_status built; /* what came of building the twin */
    tl_summary resumed;
    tl_account account; /* for the units of what is matched */
    bool is_shadow;     /* now */
    int64_t next;       /* of a shadow: the first tick of the cycle, */
    uint32_t asked;     /* for recorded samples so often, */
    void *samples;      /* and a copy of the last ones, */
    int64_t parent;     /* and the run with which it goes on if it becomes the run's */
    bool are_others;    /* the FMUs' files, than those of the twin before in this run */
    bool has_crashed;   /* the twin before: it had loaded a checkpoint, and made no step with it */
    bool unreadable;    /* states of these FMUs are of no use to another process */
    bool was_ready;
    bool has_run; /* a run has begun in the outbox, and has not ended */
} live_twin;

/* ---- what it shares with the others of the run ---- */

/* The outbox names what the twin is built with: another tuning is told by its block, whose text is the recorder's affair. */
static void open_queue(live_twin *self) {
    const tl_record_queue_settings settings = tl_live_twin_queue(self->config);
    const tl_live_recorder_pulse *recorder = self->recorder;
    tl_run_tuning configured = {.number = 0};
    tl_record_queue_open(&settings, self->blocks[TL_LIVE_QUEUE + self->job.place].bytes,
                         recorder != NULL ? &recorder->state.taken[TL_LIVE_QUEUE_TWIN + self->job.place] : NULL,
                         &self->queue);
    tl_record_queue_hide_unused(&self->queue);
    tl_live_tuning_hide_text(&self->blocks[TL_LIVE_TUNING + self->job.place]);
    memcpy(configured.hash, self->config->hash, sizeof configured.hash);
    tl_config_tuning(self->config, &configured.values);
    tl_record_queue_name_configuration(&self->queue, &configured);
}

/* `config` gets what the job changes. */
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
        status = tl_live_input_open(config, &self->blocks[TL_LIVE_MAIL], &self->input, error);
    }
    if (status == TL_OK) {
        self->pulse = self->blocks[TL_LIVE_TWIN_PULSE + self->job.place].bytes;
        self->resume = &self->blocks[TL_LIVE_PAST + self->job.place];
        self->recorder = self->blocks[TL_LIVE_RECORDER_PULSE].bytes;
        open_queue(self);
    }
    return status;
}

/* ---- the FMUs' files ---- */

/* Which they are; before any of them is loaded. What is in them is looked at once, since that takes its time. */
static void identify_files(live_twin *self) {
    tl_live_twin_pulse *pulse = self->pulse;
    int descriptors[TL_IDENTITY_FILES] = {0};
    const size_t components = self->config->component_count;
    const size_t count = components < TL_IDENTITY_FILES ? components : TL_IDENTITY_FILES; /* as many as are looked at */
    for (size_t i = 0; i < count; i++) {
        descriptors[i] = self->assembly->files[i].descriptor;
    }
    uint64_t number =
        tl_identity_number_of_open_files(descriptors, count); /* a checkpoint is of no use to another FMU */
    bool is_known = pulse->fmus == number && pulse->digest[0] != '\0' && tl_identity_is_sound(pulse->digest);
    self->are_others = pulse->fmus != 0 && pulse->fmus != number;
    if (!is_known && self->job.database[0] != '\0') {
        tl_identity_open_files(descriptors, count, pulse->digest);
    }
    pulse->fmus = number;
    self->has_crashed = pulse->loads != 0 && !self->are_others;
    self->unreadable = pulse->unreadable == number;
    pulse->loads = 0;
    tl_record_queue_name_fmus(&self->queue, pulse->digest);
}

/* ---- telling ---- */

/* Which start this is, and why: the box's memory of its own troubles. */
static void tell_start(live_twin *self) {
    if (!self->job.alone) {
        tl_journal_event(&self->journal, -1, self->job.how.again ? TL_EVENT_WARNING : TL_EVENT_INFO, "supervisor",
                         "start %llu, %llu of them after a failure; reason: %s",
                         (unsigned long long)self->job.how.starts, (unsigned long long)self->job.how.restarts,
                         self->job.how.reason);
    }
}

/* What the FMUs are held by, if that is not all there is. */
static void tell_confinement(live_twin *self) {
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

/* The process ends while an FMU has not returned. Whoever takes it out of the outbox lives on. */
static void keep(void *context, const char *why) {
    live_twin *self = context;
    if (!tl_journal_is_apart(&self->journal)) {
        tl_record_queue_event(&self->queue, -1, TL_EVENT_ERROR, "twin", why);
    }
}

/* ---- the cycle ---- */

/* io has opened all sources, once: one that is begun again later opens them again. */
static bool is_plant_open(live_twin *self) {
    self->was_plant_open = self->was_plant_open || tl_heartbeats_is_ready(self->blocks[TL_LIVE_IO_BEATS].bytes);
    return self->was_plant_open;
}

/* The supervisor changes the scheduling of the FMUs' thread when it is asked; here the main thread waits for it. */
static void wish_realtime(live_twin *self, bool wished) {
    int wanted = wished ? SCHED_FIFO : SCHED_OTHER;
    pid_t thread = tl_fmu_thread_number(self->fmus);
    tl_time until = tl_clock_now(NULL) + PRIORITY;
    if (self->config->realtime_priority <= 0) {
        return;
    }
    __atomic_store_n(&self->pulse->realtime, wished ? (int32_t)thread : 0, __ATOMIC_RELEASE);
    while (sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted && tl_clock_now(NULL) < until) {
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK_SOON);
    }
    if (wished && sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted) {
        tl_realtime_tell_refused(&self->journal);
    }
}

/* ---- figures ---- */

/* For whoever shows and compares them. */
static void publish(live_twin *self, tl_run_status *figures, const tl_metrics *match) {
    figures->outputs = (uint32_t)self->config->match_count;
    for (size_t i = 0; i < self->config->match_count; i++) {
        tl_run_output *output = &figures->output[i];
        (void)snprintf(output->name, sizeof output->name, "%s", self->config->match[i].variable);
        (void)snprintf(output->unit, sizeof output->unit, "%s", self->account.match[i].unit);
        output->pairs = match[i].pairs;
        output->sum_of_squares = match[i].sum_of_squares;
        output->tolerance = self->config->match[i].weight > 0.0 ? self->config->match[i].tolerance : 0.0;
    }
    tl_latest_publish(&self->pulse->figures, figures, sizeof *figures);
}

/* A shadow over recorded samples. */
static void show_recorded(void *context, const tl_run_status *status, const tl_metrics *match) {
    tl_run_status figures = *status;
    figures.phase = TL_RUN_RECORDED;
    figures.ticks = (uint64_t)status->tick;
    publish(context, &figures, match);
}

/* At the plant's ticks, or making up what was missed before. */
static void show_status(live_twin *self, const tl_cycle_status *status) {
    char line[TL_STATUS_LINE];
    tl_run_status figures = {
        .phase = status->is_live ? TL_RUN_LIVE : TL_RUN_RECORDED,
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
        .plant_is_shut = !is_plant_open(self),
        .lock = status->lock,
        .lock_before = status->lock_before,
    };
    tl_status_line_write(self->config, status, line);
    tl_heartbeats_set_status(&self->pulse->beats, line);
    publish(self, &figures, status->match);
}

/* ---- where it begins ---- */

/* t_start of the run, for a twin that may come beside this one. */
static void tell_beginning(live_twin *self, tl_time start, int64_t started) {
    __atomic_store_n(&self->pulse->started, started, __ATOMIC_RELAXED);
    __atomic_store_n(&self->pulse->start, start, __ATOMIC_RELEASE);
}

static void be_ready(live_twin *self) {
    tl_heartbeats_set_ready(&self->pulse->beats);
    self->was_ready = true;
}

/* Wishes for what has this number, and waits for the answer; a copy of it. False: it does not come. */
static bool ask(live_twin *self, uint32_t number, tl_live_past_answer *answer) {
    tl_live_wish wish = tl_live_wish_of(self->job.number, number);
    tl_time until = tl_clock_now(NULL) + PATIENCE_FOR_PAST;
    __atomic_store_n(&self->pulse->resume, wish, __ATOMIC_RELEASE);
    const tl_live_past_answer *given = &self->recorder->answer[self->job.place];
    while (__atomic_load_n(&given->wish, __ATOMIC_ACQUIRE) != wish) {
        if (tl_clock_now(NULL) > until || tl_interrupt_requested() != NULL) {
            return false;
        }
        tl_thread_heartbeat_beat(self->heartbeat);
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK_SOON);
    }
    *answer = *given;
    for (size_t i = 0; i < TL_LIVE_PAST_WORDS; i++) {
        answer->words[i].text[TL_RESUME_TEXT - 1] = '\0';
    }
    return true;
}

/* ---- following, in the thread of the FMUs ---- */

/* A job of the FMUs' thread, and what came of it. */
typedef struct follow_job {
    live_twin *twin;
    const tl_resume *resume;
    tl_resume_outcome outcome;
    tl_error *error;
    tl_status status;
} follow_job;

static void tell_past(void *context, tl_severity severity, const char *text) {
    tl_journal_event(context, -1, severity, "resume", "%s", text);
}

static void do_follow(void *context) {
    follow_job *job = context;
    const tl_resume_follow_settings following = {
        .assembly = job->twin->assembly, .queue = &job->twin->queue, .tell = tell_past, .context = &job->twin->journal};
    job->status = tl_resume_follow(&following, job->resume, &job->twin->resumed, &job->outcome, job->error);
}

/* The number of the newest run in the database: of a shadow, that with which it will go on. 0: nothing is recorded. */
static int64_t newest_run(const live_twin *self) {
    return self->recorder == NULL ? 0 : tl_recorder_state_get(&self->recorder->state).run;
}

/* What is noted here outlives this process: the FMUs are given bytes that another one has made. */
static void note_load(const live_twin *self, bool loads) {
    __atomic_store_n(&self->pulse->loads, loads ? 1 : 0, __ATOMIC_RELEASE);
}

/* *refused: it is of no use, and an older one may be. */
static tl_status follow(live_twin *self, const tl_resume *resume, bool *refused, tl_error *error) {
    const int64_t last = newest_run(self); /* before this one begins */
    follow_job job = {.twin = self, .resume = resume, .error = error};
    *refused = (self->has_crashed || self->unreadable) && resume->checkpoint != NULL;
    if (*refused) {
        return TL_OK;
    }
    note_load(self, resume->checkpoint != NULL);
    tl_fmu_thread_call(self->fmus, do_follow, &job);
    /* Before it was followed only its own steps can show whether the state that was loaded does harm. */
    if (job.status != TL_FMU_FATAL &&
        (job.outcome != TL_RESUME_FOLLOWED || resume->last - resume->first + 1 >= SOUND_AFTER)) {
        note_load(self, false);
    }
    *refused = job.status == TL_OK && job.outcome == TL_RESUME_REFUSED;
    if (job.status == TL_OK && job.outcome == TL_RESUME_FAILED) {
        (void)tl_record_queue_put_end(&self->queue, "could not go on with an earlier run");
    }
    if (self->resumed.resumption.from != TL_RESUMED_NOT && self->resumed.resumption.run < 0) {
        self->resumed.resumption.run = last;
    }
    return job.status;
}

/* ---- what a predecessor has left ---- */

/* *any: somebody has begun a run in it. */
static tl_status follow_queue(live_twin *self, bool *any, tl_error *error) {
    tl_resume_queue *left = tl_resume_queue_open(&self->queue, self->assembly, tell_past, &self->journal);
    tl_resume resume;
    bool refused = true;
    tl_status status = TL_OK;
    *any = left != NULL;
    while (status == TL_OK && refused && tl_resume_queue_next(left, &resume)) {
        status = follow(self, &resume, &refused, error);
    }
    tl_resume_queue_close(left);
    return status;
}

/* ---- what the recorder finds ---- */

static void tell_answer(live_twin *self, const tl_live_past_answer *answer) {
    for (size_t i = 0; i < TL_LIVE_PAST_WORDS && answer->words[i].text[0] != '\0'; i++) {
        const tl_live_past_word *word = &answer->words[i];
        bool is_known = word->severity >= TL_EVENT_INFO && word->severity <= TL_EVENT_ERROR;
        tell_past(&self->journal, is_known ? (tl_severity)word->severity : TL_EVENT_WARNING, word->text);
    }
}

/* Follows the image, of which nobody else has a copy. */
static tl_status follow_image(live_twin *self, size_t size, bool *refused, tl_error *error) {
    tl_resume resume;
    void *image = malloc(size);
    if (image == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the past");
    }
    memcpy(image, self->resume->bytes, size);
    tl_status status = tl_resume_read(image, size, self->config, tl_clock_now(NULL), &resume, error);
    if (status == TL_OK) {
        status = follow(self, &resume, refused, error);
    } else {
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "resume", "begins anew: %.180s", error->text);
        status = TL_OK;
        *refused = false;
    }
    free(image);
    return status;
}

static tl_status follow_recorder(live_twin *self, tl_error *error) {
    tl_live_past_answer answer;
    bool refused = true;
    tl_status status = TL_OK;
    for (uint32_t number = 1; status == TL_OK && refused; number++) {
        if (!ask(self, number, &answer)) {
            if (tl_interrupt_requested() != NULL) { /* who is told to end needs no answer */
                return TL_OK;
            }
            tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "resume",
                             "begins anew: the recorder does not say what was recorded before");
            return TL_OK;
        }
        tell_answer(self, &answer);
        self->ended = answer.ended;
        refused = answer.size > 0 && answer.size <= TL_LIVE_PAST_BYTES;
        if (refused) {
            status = follow_image(self, (size_t)answer.size, &refused, error);
        }
    }
    return status;
}

/* Leads the twin to where an earlier one was ended; `resumed` says what was done. A twin whose predecessor has died in the same run finds checkpoint and entries
 * in the outbox. Any other asks the recorder; if what that has found is of no use, for something older. */
static tl_status follow_past(live_twin *self, tl_error *error) {
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
    tl_live_past_answer answer = {.size = 0};
    if (self->recorder == NULL) {
        return 0;
    }
    __atomic_store_n(&self->pulse->past_from, from, __ATOMIC_RELAXED);
    if (!ask(self, ++self->asked, &answer) || answer.size > TL_LIVE_PAST_BYTES) {
        return 0;
    }
    tell_answer(self, &answer);
    free(self->samples);
    self->samples = malloc((size_t)answer.size + 1);
    if (self->samples == NULL) {
        return 0;
    }
    memcpy(self->samples, self->resume->bytes, (size_t)answer.size);
    *image = self->samples;
    return (size_t)answer.size;
}

/* A shadow is ready before its recorded part, which may take a minute. */
static tl_status begin_shadow(live_twin *self, tl_error *error) {
    static const tl_run_status none = {.ticks = 0};
    static const tl_metrics no_match[TL_MAX_MATCH];
    tell_beginning(self, self->job.start, self->job.started);
    be_ready(self);
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

static tl_status go_on(live_twin *self, tl_error *error) {
    if (self->has_crashed) { /* no checkpoint is tried twice: not that one, and no other one by this process */
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "resume",
                         "the twin before has ended as it loaded a checkpoint: this one loads none, and inputs are run "
                         "again%s",
                         self->unreadable ? "; no more are saved, nor loaded, with these FMUs" : "");
    }
    if (self->are_others) {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "resume",
                         "begins anew: the FMUs are not those of the run before");
        return TL_OK;
    }
    return follow_past(self, error);
}

/* ---- the cycle's start ---- */

static tl_cycle_settings settings_of_cycle(live_twin *self) {
    return (tl_cycle_settings){
        .assembly = self->assembly,
        .thread = self->fmus,
        .input = &self->input,
        .queue = &self->queue,
        .journal = &self->journal,
        .beats = &self->pulse->beats,
        .tuning = self->blocks[TL_LIVE_TUNING + self->job.place].bytes,
        .answer = &self->pulse->tuned,
        .resumed = self->resumed,
        .unreadable = self->unreadable,
        .place = {.stage = self->blocks[TL_HANDOVER].bytes,
                  .place = self->job.place,
                  .handovers = self->job.handovers,
                  .handed_over = &self->pulse->handed_over,
                  .is_shadow = self->is_shadow,
                  .tick = self->next,
                  .start = self->job.start,
                  .started = self->job.started},
    };
}

static tl_status start_cycle(live_twin *self, tl_error *error) {
    tl_account_take(self->assembly->twin, &self->account);
    tl_status status = self->is_shadow ? begin_shadow(self, error) : go_on(self, error);
    if (status != TL_OK) {
        return status;
    }
    if (!self->is_shadow) {
        /* A sample without unknown values is a better start; a dead device must not prevent one. */
        for (tl_time until = tl_clock_now(NULL) + FIRST_READING;
             tl_clock_now(NULL) < until && tl_interrupt_requested() == NULL &&
             !(is_plant_open(self) && tl_plant_input_is_complete(&self->input));) {
            tl_clock_sleep_until(tl_clock_now(NULL) + 5 * LOOK_SOON);
        }
        const tl_time gap = tl_clock_now(NULL) - self->ended; /* a change by a restart leaves one between two runs */
        if (self->ended != 0 && gap > 0) {
            tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "resume", "no twin ran for %.2f s (%lld ticks)",
                             tl_seconds(gap), (long long)(gap / self->config->step));
        }
    }
    if (self->config->realtime_lock_memory) {
        tl_realtime_lock_memory(&self->journal);
    }
    wish_realtime(self, !self->is_shadow);
    const tl_cycle_settings settings = settings_of_cycle(self);
    status = tl_cycle_start(&settings, &self->cycle, error);
    if (status == TL_OK) {
        if (!self->is_shadow) {
            tell_start(self);
        }
        tell_confinement(self);
        if (self->job.database[0] == '\0') {
            tl_log(TL_LOG_NOTICE,
                   "nothing is recorded: the configuration has no \"record\", and no --db was given; after a restart "
                   "of this program the twin begins anew");
        }
    }
    if (status == TL_OK && !self->is_shadow) {
        const tl_resumption *beginning = tl_record_queue_beginning(&self->queue);
        tell_beginning(self, beginning->start, beginning->started);
    }
    return status;
}

/* ---- while the cycle runs ---- */

/* A flip may have made it the run's, or the shadow. Nobody waits for the priority. */
static void look_at_part(live_twin *self, bool is_shadow) {
    if (is_shadow == self->is_shadow) {
        self->parent = is_shadow ? newest_run(self) : self->parent;
        return;
    }
    bool wishes = !is_shadow && self->config->realtime_priority > 0;
    char title[TL_ROLE_TITLE];
    self->is_shadow = is_shadow;
    (void)snprintf(title, sizeof title, "%s [%s]", is_shadow ? TL_LIVE_TWIN_SHADOW : TL_LIVE_TWIN, self->config->name);
    tl_role_entitle(title);
    __atomic_store_n(&self->pulse->realtime, wishes ? (int32_t)tl_fmu_thread_number(self->fmus) : 0, __ATOMIC_RELEASE);
}

/* A shadow that cannot keep pace tells nothing, and takes time from the run's twin. */
static tl_status judge_pace(const live_twin *self, const tl_cycle_status *status, tl_time since, tl_error *error) {
    if (!status->is_shadow) {
        return TL_OK;
    }
    if (!status->is_live && tl_clock_now(NULL) - since > PATIENCE_BEHIND) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "this box does not carry two twins: the shadow does not catch up with the plant");
    }
    bool judged = status->is_live && tl_time_of_step(0, self->config->step, (int64_t)status->ticks) >= FIRST_JUDGED;
    return !judged || status->skipped <= status->ticks / MISSED_PART
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN,
                         "this box does not carry two twins: the shadow has missed %llu of %llu ticks",
                         (unsigned long long)status->skipped, (unsigned long long)status->ticks);
}

/* Watches until the cycle ends or a signal comes; the cycle needs nothing of this. Errors: those of judge_pace(). */
static tl_status look_on(live_twin *self, tl_error *error) {
    tl_cycle_status status = {0};
    tl_status judged = TL_OK;
    tl_time since = tl_clock_now(NULL);
    while (tl_interrupt_requested() == NULL && !status.ended && judged == TL_OK) {
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK);
        tl_thread_heartbeat_beat(self->heartbeat);
        tl_fmu_thread_watch(self->fmus);
        tl_journal_drain(&self->journal);
        if (!tl_cycle_status_now(self->cycle, &status)) {
            continue;
        }
        judged = judge_pace(self, &status, since, error);
        if (status.steps != 0) {
            __atomic_store_n(&self->pulse->loads, 0, __ATOMIC_RELAXED);
            show_status(self, &status);
            look_at_part(self, status.is_shadow);
        }
    }
    return judged;
}

static void hold(live_twin *self) {
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
        tell_start(self);
    }
    tl_safe_hold(&settings);
}

/* ---- end ---- */

static void warn(void *context, const char *text) {
    tl_journal_event(context, -1, TL_EVENT_WARNING, "twin", "%s", text);
}

static tl_status close_cycle(live_twin *self, tl_error *error) {
    tl_live_end *end = &self->pulse->end;
    tl_status status = tl_cycle_stop(self->cycle, &end->summary, &self->has_run, error);
    if (end->summary.resumption.run < 0) {
        end->summary.resumption.run = self->parent;
    }
    wish_realtime(self, false);
    if (status != TL_OK) {
        tl_journal_event(&self->journal, -1, TL_EVENT_ERROR, "twin", "%s", error->text);
    }
    tl_account_take(self->assembly->twin, &end->account);
    tl_twin_recorder_check(&end->account, warn, &self->journal);
    __atomic_store_n(&end->is_there, 1, __ATOMIC_RELEASE);
    return status;
}

static void put_end(live_twin *self, tl_status status, const tl_error *error) {
    const tl_handover *stage = self->blocks[TL_HANDOVER].bytes;
    bool again = stage != NULL && __atomic_load_n(&stage->again, __ATOMIC_ACQUIRE) != 0;
    const char *signal = again ? TL_LIVE_BEGUN_ANEW : tl_interrupt_requested();
    const char *reason = status != TL_OK ? error->text : signal != NULL ? signal : "end of duration";
    (void)tl_record_queue_put_end(&self->queue, reason);
}

/* What it is there for, until it is told to end. */
static tl_status live(live_twin *self) {
    tl_error error = {0};
    tl_status status = self->job.how.hold ? TL_OK : start_cycle(self, &error);
    bool begun = status == TL_OK;
    tl_thread_heartbeat_set_timeout(self->heartbeat, PATIENCE);
    __atomic_store_n(&self->pulse->begun, 1, __ATOMIC_RELEASE);
    if (begun) {
        be_ready(self);
        if (self->job.how.hold) {
            hold(self);
        } else {
            status = look_on(self, &error);
        }
    }
    if (self->cycle != NULL) {
        tl_error of_cycle = {0};
        tl_status closed = close_cycle(self, &of_cycle);
        error = status == TL_OK ? of_cycle : error;
        status = status == TL_OK ? closed : status;
    }
    tl_process_keep(NULL, NULL);
    if (begun && (self->job.how.hold || self->has_run)) {
        put_end(self, status, &error);
    }
    tl_journal_drain(&self->journal);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        if (self->is_shadow) {
            tl_heartbeats_set_status(&self->pulse->beats, error.text); /* for who tells why it has ended */
        }
    }
    return status;
}

/* ---- the twin ---- */

static void do_build(void *context) {
    live_twin *self = context;
    self->assembly->trusts_states = self->job.how.failures > 0; /* a copy may have been what the one before failed by */
    self->built = tl_assembly_build(self->assembly);
}

static void do_free(void *context) {
    tl_assembly_free(context);
}

/* The FMUs' thread, and the twin built in it. */
static tl_status build(live_twin *self) {
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
    static live_twin self; /* one for the process */
    tl_error error;
    self.assembly = assembly;
    self.config = &assembly->config;
    self.facts = facts;
    tl_status status = open_memory(&self, job, &assembly->config, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    tl_fmu_calls_use(&self.pulse->beats.calls);
    self.heartbeat = tl_thread_heartbeat_start(&self.pulse->beats, "main", PATIENCE_AT_START);
    tl_live_role_open_journal(&self.journal, &self.queue);
    self.is_shadow = self.job.is_shadow;
    tl_journal_set_apart(&self.journal, self.is_shadow);
    tl_process_keep(keep, &self);
    if (!self.job.how.hold) {
        identify_files(&self);
        status = build(&self);
    }
    if (status == TL_OK) {
        status = live(&self);
    }
    int code = tl_live_role_end(&self.pulse->beats, self.was_ready, tl_exit_code(status));
    if (self.fmus != NULL) {
        tl_fmu_thread_call(self.fmus, do_free, assembly);
        tl_fmu_thread_end(self.fmus);
    }
    return code;
}
