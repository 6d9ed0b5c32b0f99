/* The twin of a live run, in the process with the FMUs: see live_twin.h. */
#include "firmware/live/live_twin.h"

#include <inttypes.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/live/live_blocks.h"
#include "firmware/live/live_role.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/process/role.h"
#include "firmware/twin/cycle.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/twin_recorder.h"

/* ---- live twin memory ---- */

/* ---- the plant ---- */

static tl_status take_mail(tl_live_twin_memory *self, const tl_config *config, tl_error *error) {
    tl_plant_mail_shape shape;
    tl_plant_mail_shape_of(config, &shape);
    tl_status status = tl_block_take(TL_LIVE_MAIL, tl_live_mail_bytes(&shape), TL_BLOCK_WE_WRITE, &self->mail, error);
    if (status == TL_OK) {
        tl_live_plant_set_limits(&self->input, config);
        tl_plant_mail_open(&shape, self->mail.bytes, self->input.mailboxes);
        self->mail_end = tl_live_mail_end_of(&shape, self->mail.bytes);
        if (!tl_plant_input_open(&self->input)) {
            status = tl_fail(error, TL_TRY_AGAIN, "not enough memory for the plant's readings");
        }
    }
    return status;
}

/* ---- its own ---- */

static tl_status take_own(tl_live_twin_memory *self, const tl_config *config, tl_error *error) {
    const tl_outbox_settings settings = tl_live_twin_outbox(config);
    const tl_outbox_taken *taken = NULL;
    tl_status status =
        tl_block_take(TL_LIVE_OWN_PULSE, sizeof *self->pulse, TL_BLOCK_THEY_WRITE, &self->pulse_block, error);
    if (status == TL_OK) {
        status = tl_block_take(TL_LIVE_TWIN_OUTBOX, tl_outbox_bytes(&settings), TL_BLOCK_THEY_WRITE,
                               &self->outbox_block, error);
    }
    if (status == TL_OK && self->job.database[0] != '\0') {
        self->past.place = self->job.place;
        status = tl_live_memory_take(&self->past, &taken, error);
    }
    if (status == TL_OK) {
        self->pulse = self->pulse_block.bytes;
        self->past.pulse = self->pulse;
        self->past.twin = self->job.number;
        tl_outbox_open(&settings, self->outbox_block.bytes, taken, &self->outbox);
        tl_outbox_hide_unused(&self->outbox);
    }
    return status;
}

/* What it is built with, and where it is told of another tuning. The text is the recorder's affair. */
static tl_status take_tuning(tl_live_twin_memory *self, const tl_config *config, tl_error *error) {
    tl_run_tuning configured = {.number = 0};
    tl_status status =
        tl_block_take(TL_LIVE_TUNING, sizeof(tl_live_tuning), TL_BLOCK_WE_WRITE, &self->tuning_block, error);
    if (status == TL_OK) {
        tl_live_tuning_hide_text(&self->tuning_block);
        memcpy(configured.hash, config->hash, sizeof configured.hash);
        tl_config_tuning(config, &configured.values);
        tl_outbox_name_configuration(&self->outbox, &configured);
    }
    return status;
}

tl_status tl_live_twin_memory_take(tl_live_twin_memory *memory, const tl_twin_job *job, tl_config *config,
                                   tl_error *error) {
    const char *of_run = "";
    tl_status status = tl_live_job_unpack(job->live, job->live_size, &memory->job, &of_run, error);
    if (status == TL_OK) {
        tl_live_job_apply(&memory->job, config);
        status =
            memory->job.is_shadow ? tl_live_job_read(&memory->job, config->path, of_run, &memory->run, error) : TL_OK;
    }
    if (status == TL_OK) {
        status = take_mail(memory, config, error);
    }
    if (status == TL_OK) {
        status = take_own(memory, config, error);
    }
    if (status == TL_OK) {
        status = tl_block_take(TL_LIVE_STAGE, sizeof(tl_live_stage), TL_BLOCK_WE_WRITE, &memory->stage_block, error);
    }
    return status == TL_OK ? take_tuning(memory, config, error) : status;
}

/* ---- live twin ---- */

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

/* All that this process has. */
typedef struct live_twin {
    tl_assembly *assembly;
    const tl_config *config;
    const tl_confine_facts *facts;
    tl_live_twin_memory shared;
    tl_heart *heart;
    tl_journal journal;
    tl_fmu_thread *fmus; /* NULL if it holds */
    tl_cycle *cycle;
    tl_summary resumed;
    tl_account account; /* for the units of what is matched */
    bool is_shadow;     /* now */
    int64_t next;       /* of a shadow: the first tick of the cycle, */
    int64_t parent;     /* and the run with which it goes on if it becomes the run's */
    bool are_others;    /* the FMUs' files, than those of the twin before in this run */
    bool has_crashed;   /* the twin before: it had loaded a checkpoint, and made no step with it */
    bool unreadable;    /* states of these FMUs are of no use to another process */
    bool was_ready;
    bool has_run; /* a run has begun in the outbox, and has not ended */
} live_twin;

/* ---- the FMUs' files ---- */

/* As many as are looked at. */
static size_t take_descriptors(const tl_assembly *assembly, int descriptors[TL_IDENTITY_FILES]) {
    size_t components = assembly->config.component_count;
    size_t count = components < TL_IDENTITY_FILES ? components : TL_IDENTITY_FILES;
    for (size_t i = 0; i < count; i++) {
        descriptors[i] = assembly->files[i].descriptor;
    }
    return count;
}

/* Which they are; before any of them is loaded. What is in them is looked at once, since that takes its time. */
static void identify_files(live_twin *self) {
    tl_live_twin_pulse *pulse = self->shared.pulse;
    int descriptors[TL_IDENTITY_FILES] = {0};
    const size_t count = take_descriptors(self->assembly, descriptors);
    uint64_t number =
        tl_identity_number_of_open_files(descriptors, count); /* a checkpoint is of no use to another FMU */
    bool is_known = pulse->fmus == number && pulse->digest[0] != '\0' && tl_identity_is_sound(pulse->digest);
    self->are_others = pulse->fmus != 0 && pulse->fmus != number;
    if (!is_known && self->shared.job.database[0] != '\0') {
        tl_identity_open_files(descriptors, count, pulse->digest);
    }
    pulse->fmus = number;
    self->has_crashed = pulse->loads != 0 && !self->are_others;
    self->unreadable = pulse->unreadable == number;
    pulse->loads = 0;
    tl_outbox_name_fmus(&self->shared.outbox, pulse->digest);
}

/* ---- telling ---- */

/* Which start this is, and why: the box's memory of its own troubles. */
static void tell_start(live_twin *self) {
    if (!self->shared.job.alone) {
        tl_journal_event(&self->journal, -1, self->shared.job.again ? TL_EVENT_WARNING : TL_EVENT_INFO, "supervisor",
                         "start %llu, %llu of them after a failure; reason: %s",
                         (unsigned long long)self->shared.job.starts, (unsigned long long)self->shared.job.restarts,
                         self->shared.job.reason);
    }
}

/* What the FMUs are held by, if that is not all there is. */
static void tell_confinement(live_twin *self) {
    char text[TL_CONFINE_TEXT];
    if (self->shared.job.holds) {
        return;
    }
    if (self->shared.job.unconfined) {
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "twin", "unconfined: FMUs can do what this user can");
        return;
    }
    tl_confine_describe(self->facts, text);
    if (text[0] != '\0') {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "twin", "%s", text);
    }
}

static void tell_recording(const live_twin *self) {
    if (self->shared.job.database[0] == '\0') {
        tl_log(TL_LOG_NOTICE,
               "nothing is recorded: the configuration has no \"record\", and no --db was given; after a restart "
               "of this program the twin begins anew");
    }
}

/* The process ends while an FMU has not returned. Whoever takes it out of the outbox lives on. */
static void keep(void *context, const char *why) {
    live_twin *self = context;
    if (!tl_journal_is_apart(&self->journal)) {
        tl_outbox_event(&self->shared.outbox, -1, TL_EVENT_ERROR, "twin", why);
    }
}

/* ---- the cycle ---- */

static bool is_complete(const live_twin *self) {
    return __atomic_load_n(&self->shared.mail_end->opened, __ATOMIC_ACQUIRE) != 0 &&
           tl_plant_input_is_complete(&self->shared.input);
}

/* A sample without unknown values is a better start; a dead device must not prevent one. */
static void wait_for_readings(const live_twin *self) {
    tl_time until = tl_clock_now(NULL) + FIRST_READING;
    while (tl_clock_now(NULL) < until && tl_interrupt_requested() == NULL && !is_complete(self)) {
        tl_clock_sleep_until(tl_clock_now(NULL) + 5 * LOOK_SOON);
    }
}

/* A change by a restart, for example, leaves a gap between two runs. */
static void tell_gap(live_twin *self) {
    const tl_time gap = tl_clock_now(NULL) - self->shared.past.ended;
    if (self->shared.past.ended != 0 && gap > 0) {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "resume", "no twin ran for %.2f s (%lld ticks)",
                         tl_seconds(gap), (long long)(gap / self->config->step));
    }
}

/* The supervisor changes the scheduling of the FMUs' thread when it is asked; here the main thread waits for it. */
static void wish_realtime(live_twin *self, bool wished) {
    int wanted = wished ? SCHED_FIFO : SCHED_OTHER;
    pid_t thread = tl_fmu_thread_number(self->fmus);
    tl_time until = tl_clock_now(NULL) + PRIORITY;
    if (self->config->realtime_priority <= 0) {
        return;
    }
    __atomic_store_n(&self->shared.pulse->realtime, wished ? (int32_t)thread : 0, __ATOMIC_RELEASE);
    while (sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted && tl_clock_now(NULL) < until) {
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK_SOON);
    }
    if (wished && sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted) {
        tl_realtime_tell_refused(&self->journal);
    }
}

/* ---- figures ---- */

static tl_live_shown shown_by(live_twin *self) {
    return (tl_live_shown){.config = self->config,
                           .account = &self->account,
                           .mail = self->shared.mail_end,
                           .figures = &self->shared.pulse->figures};
}

static void show_recorded(void *context, const tl_run_status *status, const tl_metrics *match) {
    const tl_live_shown shown = shown_by(context);
    tl_live_shown_recorded(&shown, status, match);
}

static void show_status(live_twin *self, const tl_cycle_status *status) {
    char line[TL_STATUS_LINE];
    const tl_live_shown shown = shown_by(self);
    tl_status_line_write(self->config, status, line);
    tl_heartbeats_set_status(&self->shared.pulse->beats, line);
    tl_live_shown_live(&shown, status);
}

/* ---- where it begins ---- */

/* t_start of the run, for a twin that may come beside this one. */
static void tell_beginning(live_twin *self, tl_time start, int64_t started) {
    __atomic_store_n(&self->shared.pulse->started, started, __ATOMIC_RELAXED);
    __atomic_store_n(&self->shared.pulse->start, start, __ATOMIC_RELEASE);
}

static void be_ready(live_twin *self) {
    tl_heartbeats_set_ready(&self->shared.pulse->beats);
    self->was_ready = true;
}

/* A shadow is ready before its recorded part, which may take a minute. */
static tl_status begin_shadow(live_twin *self, const tl_live_past_settings *past, tl_error *error) {
    const tl_live_past_show show = {.show = show_recorded, .context = self};
    static const tl_run_status none = {.ticks = 0};
    static const tl_metrics no_match[TL_MAX_MATCH];
    tell_beginning(self, self->shared.job.start, self->shared.job.started);
    be_ready(self);
    show_recorded(self, &none, no_match);
    return tl_live_past_begin_shadow(past, &show, self->shared.job.start, &self->next, error);
}

/* No checkpoint is tried twice: not the one that this happened with, and no other one by this process. */
static void tell_crash(live_twin *self) {
    if (self->has_crashed) {
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "resume",
                         "the twin before has ended as it loaded a checkpoint: this one loads none, and inputs are run "
                         "again%s",
                         self->unreadable ? "; no more are saved, nor loaded, with these FMUs" : "");
    }
}

static tl_status go_on(live_twin *self, const tl_live_past_settings *past, tl_error *error) {
    tell_crash(self);
    if (self->are_others) {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "resume",
                         "begins anew: the FMUs are not those of the run before");
        return TL_OK;
    }
    return tl_live_past_follow(past, &self->resumed, error);
}

static tl_status lead(live_twin *self, tl_error *error) {
    const tl_live_past_settings past = {
        .memory = &self->shared.past,
        .run = &self->shared.run,
        .assembly = self->assembly,
        .thread = self->fmus,
        .outbox = &self->shared.outbox,
        .journal = &self->journal,
        .heart = self->heart,
        .no_checkpoints = self->has_crashed || self->unreadable,
    };
    tl_account_take(self->assembly->twin, &self->account);
    return self->is_shadow ? begin_shadow(self, &past, error) : go_on(self, &past, error);
}

/* ---- the cycle's start ---- */

static tl_cycle_settings settings_of_cycle(live_twin *self) {
    return (tl_cycle_settings){
        .assembly = self->assembly,
        .thread = self->fmus,
        .input = &self->shared.input,
        .outbox = &self->shared.outbox,
        .journal = &self->journal,
        .beats = &self->shared.pulse->beats,
        .tuning = self->shared.tuning_block.bytes,
        .answer = &self->shared.pulse->tuned,
        .resumed = self->resumed,
        .unreadable = self->unreadable,
        .place = {.stage = self->shared.stage_block.bytes,
                  .place = self->shared.job.place,
                  .flips = self->shared.job.flips,
                  .flipped = &self->shared.pulse->flipped,
                  .is_shadow = self->is_shadow,
                  .tick = self->next,
                  .start = self->shared.job.start,
                  .started = self->shared.job.started},
    };
}

static tl_status start_cycle(live_twin *self, tl_error *error) {
    tl_status status = lead(self, error);
    if (status != TL_OK) {
        return status;
    }
    if (!self->is_shadow) {
        wait_for_readings(self);
        tell_gap(self);
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
        tell_recording(self);
    }
    if (status == TL_OK && !self->is_shadow) {
        const tl_resumption *beginning = tl_outbox_beginning(&self->shared.outbox);
        tell_beginning(self, beginning->start, beginning->started);
    }
    return status;
}

/* ---- while the cycle runs ---- */

/* The number of the run beside which a shadow runs: that with which it will go on. 0: nothing is recorded. */
static int64_t number_of_run(const live_twin *self) {
    const tl_live_recorder_pulse *recorder = self->shared.past.recorder.bytes;
    return recorder == NULL ? 0 : tl_recorder_state_get(&recorder->state).run;
}

/* A flip may have made it the run's, or the shadow. Nobody waits for the priority. */
static void look_at_part(live_twin *self, bool is_shadow) {
    if (is_shadow == self->is_shadow) {
        self->parent = is_shadow ? number_of_run(self) : self->parent;
        return;
    }
    bool wishes = !is_shadow && self->config->realtime_priority > 0;
    char title[TL_ROLE_TITLE];
    self->is_shadow = is_shadow;
    (void)snprintf(title, sizeof title, "%s [%s]", is_shadow ? TL_LIVE_TWIN_SHADOW : TL_LIVE_TWIN, self->config->name);
    tl_role_entitle(title);
    __atomic_store_n(&self->shared.pulse->realtime, wishes ? (int32_t)tl_fmu_thread_number(self->fmus) : 0,
                     __ATOMIC_RELEASE);
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
        tl_heart_beat(self->heart);
        tl_fmu_thread_watch(self->fmus);
        tl_journal_drain(&self->journal);
        if (!tl_cycle_status_now(self->cycle, &status)) {
            continue;
        }
        judged = judge_pace(self, &status, since, error);
        if (status.steps != 0) {
            __atomic_store_n(&self->shared.pulse->loads, 0, __ATOMIC_RELAXED);
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
        .heart = self->heart,
        .failures = self->shared.job.failures + self->shared.job.tries,
        .missing = self->shared.job.missing,
        .time = self->shared.job.hold_time,
        .reason = self->shared.job.reason,
        .records = self->shared.job.database[0] != '\0',
        .since = self->shared.job.start,
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
    tl_live_end *end = &self->shared.pulse->end;
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
    const tl_live_stage *stage = self->shared.stage_block.bytes;
    bool again = stage != NULL && __atomic_load_n(&stage->again, __ATOMIC_ACQUIRE) != 0;
    const char *signal = again ? TL_LIVE_BEGUN_ANEW : tl_interrupt_requested();
    const char *reason = status != TL_OK ? error->text : signal != NULL ? signal : "end of duration";
    (void)tl_outbox_put_end(&self->shared.outbox, reason);
}

/* What it is there for, until it is told to end. */
static tl_status live(live_twin *self) {
    tl_error error = {0};
    tl_status status = self->shared.job.holds ? TL_OK : start_cycle(self, &error);
    bool begun = status == TL_OK;
    tl_heart_be_patient(self->heart, PATIENCE);
    __atomic_store_n(&self->shared.pulse->begun, 1, __ATOMIC_RELEASE);
    if (begun) {
        be_ready(self);
        if (self->shared.job.holds) {
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
    if (begun && (self->shared.job.holds || self->has_run)) {
        put_end(self, status, &error);
    }
    tl_journal_drain(&self->journal);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        if (self->is_shadow) {
            tl_heartbeats_set_status(&self->shared.pulse->beats, error.text); /* for who tells why it has ended */
        }
    }
    return status;
}

/* ---- the twin ---- */

/* A job of the FMUs' thread, and what came of it. */
typedef struct build_job {
    tl_assembly *assembly;
    bool has_failed; /* the twin before this one */
    tl_status status;
} build_job;

static void do_build(void *context) {
    build_job *job = context;
    job->assembly->trusts_states = job->has_failed; /* a copy may have been what it failed by */
    job->status = tl_assembly_build(job->assembly);
}

static void do_free(void *context) {
    tl_assembly_free(context);
}

/* The FMUs' thread, and the twin built in it. */
static tl_status build(live_twin *self) {
    tl_error error;
    build_job job = {.assembly = self->assembly, .has_failed = self->shared.job.failures > 0};
    tl_status status = tl_fmu_thread_start(TL_FMU_WATCHED_HERE, &self->fmus, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return status;
    }
    tl_fmu_thread_call(self->fmus, do_build, &job);
    return job.status;
}

static void release(live_twin *self) {
    if (self->fmus != NULL) {
        tl_fmu_thread_call(self->fmus, do_free, self->assembly);
        tl_fmu_thread_end(self->fmus);
    }
}

int tl_live_twin(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts) {
    static live_twin self; /* one for the process */
    tl_error error;
    self.assembly = assembly;
    self.config = &assembly->config;
    self.facts = facts;
    tl_status status = tl_live_twin_memory_take(&self.shared, job, &assembly->config, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    tl_interrupt_install();
    tl_fmu_calls_use(tl_heartbeats_calls(&self.shared.pulse->beats));
    self.heart = tl_heart_begin(&self.shared.pulse->beats, "main", PATIENCE_AT_START);
    tl_live_role_open_journal(&self.journal, &self.shared.outbox);
    self.is_shadow = self.shared.job.is_shadow;
    tl_journal_set_apart(&self.journal, self.is_shadow);
    tl_process_keep(keep, &self);
    if (!self.shared.job.holds) {
        identify_files(&self);
        status = build(&self);
    }
    if (status == TL_OK) {
        status = live(&self);
    }
    int code = tl_live_role_end(&self.shared.pulse->beats, self.was_ready, tl_exit_code(status));
    release(&self);
    return code;
}
