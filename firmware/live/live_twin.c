/* The live twin: see live_twin.h. */
#include "firmware/live/live_twin.h"

#include <inttypes.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/base/clock.h"
#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/sha256.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_past.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_wire.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/run/cycle.h"
#include "firmware/run/journal.h"
#include "firmware/run/realtime.h"
#include "firmware/run/safe_hold.h"
#include "firmware/run/status_line.h"
#include "firmware/twin/twin_recorder.h"

/* How long the start waits for a first reading of every signal, and for its priority. */
static const tl_time FIRST_READING = 2 * TL_SECOND;
static const tl_time PRIORITY = TL_SECOND / 2;

/* What the main thread's silence may last: while FMUs are loaded, and later (the log may be slow). */
static const tl_time PATIENCE_AT_START = 120 * TL_SECOND;
static const tl_time PATIENCE = 30 * TL_SECOND;

static const tl_time LOOK = TL_SECOND / 20;
static const tl_time LOOK_SOON = TL_SECOND / 1000;

/* All that this process has. */
typedef struct live_twin {
    tl_assembly *assembly;
    const tl_config *config;
    const tl_confine_facts *facts;
    tl_live_job job;
    tl_block mail;
    tl_block pulse_block;
    tl_block outbox_block;
    tl_block tuning_block;
    tl_live_memory memory; /* for the past */
    tl_live_twin_pulse *pulse;
    const tl_live_mail_end *mail_end;
    tl_plant_input input;
    tl_outbox outbox;
    tl_heart *heart;
    tl_journal journal;
    tl_fmu_thread *fmus; /* NULL if it holds */
    tl_cycle *cycle;
    tl_summary resumed;
    bool are_others; /* the FMUs' files, than those of the twin before in this run */
    bool was_ready;
} live_twin;

/* ---- shared memory ---- */

static tl_status take_mail(live_twin *self, tl_error *error) {
    tl_plant_mail_shape shape;
    tl_plant_mail_shape_of(self->config, &shape);
    tl_status status = tl_block_take(TL_LIVE_MAIL, tl_live_mail_bytes(&shape), TL_BLOCK_WE_WRITE, &self->mail, error);
    if (status == TL_OK) {
        tl_live_plant_set_limits(&self->input, self->config);
        tl_plant_mail_open(&shape, self->mail.bytes, self->input.mailboxes);
        self->mail_end = tl_live_mail_end_of(&shape, self->mail.bytes);
    }
    return status;
}

/* What it is built with, and where it is told of another tuning. The text is the recorder's affair. */
static tl_status take_tuning(live_twin *self, tl_error *error) {
    const tl_config *config = self->config;
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

static tl_status take_own(live_twin *self, tl_error *error) {
    const tl_outbox_settings settings = tl_live_twin_outbox(self->config);
    const tl_outbox_taken *taken = NULL;
    tl_status status =
        tl_block_take(TL_LIVE_OWN_PULSE, sizeof *self->pulse, TL_BLOCK_THEY_WRITE, &self->pulse_block, error);
    if (status == TL_OK) {
        status = tl_block_take(TL_LIVE_TWIN_OUTBOX, tl_outbox_bytes(&settings), TL_BLOCK_THEY_WRITE,
                               &self->outbox_block, error);
    }
    if (status == TL_OK && self->job.database[0] != '\0') {
        status = tl_live_memory_take(&self->memory, &taken, error);
    }
    if (status == TL_OK) {
        self->pulse = self->pulse_block.bytes;
        self->memory.pulse = self->pulse;
        self->memory.twin = self->job.number;
        tl_outbox_open(&settings, self->outbox_block.bytes, taken, &self->outbox);
        tl_outbox_hide_unused(&self->outbox);
    }
    return status;
}

/* ---- the FMUs' files ---- */

/* Another number where a file was replaced or written since: a checkpoint is of no use to another FMU. Never 0. */
static uint64_t number_of_files(const tl_assembly *assembly) {
    char digest[TL_SHA256_TEXT] = ""; /* of the files before, and this one */
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        struct stat about;
        char text[TL_SHA256_TEXT + 100];
        if (fstat(assembly->files[i].descriptor, &about) == 0) {
            int length = snprintf(text, sizeof text, "%s %" PRIuMAX " %" PRIdMAX " %" PRIdMAX ".%09ld", digest,
                                  (uintmax_t)about.st_ino, (intmax_t)about.st_size, (intmax_t)about.st_mtim.tv_sec,
                                  about.st_mtim.tv_nsec);
            tl_sha256(text, (size_t)length, digest);
        }
    }
    digest[2 * sizeof(uint64_t)] = '\0';
    uint64_t number = strtoull(digest, NULL, 16);
    return number == 0 ? 1 : number;
}

static void digest_files(const tl_assembly *assembly, char digest[TL_SHA256_TEXT]) {
    int descriptors[TL_IDENTITY_FILES] = {0};
    size_t components = assembly->config.component_count;
    size_t count = components < TL_IDENTITY_FILES ? components : TL_IDENTITY_FILES;
    for (size_t i = 0; i < count; i++) {
        descriptors[i] = assembly->files[i].descriptor;
    }
    tl_identity_open_files(descriptors, count, digest);
}

/* Which they are; before any of them is loaded. What is in them is looked at once, since that takes its time. */
static void identify_files(live_twin *self) {
    tl_live_twin_pulse *pulse = self->pulse;
    uint64_t number = number_of_files(self->assembly);
    bool is_known = pulse->fmus == number && pulse->digest[0] != '\0' && tl_identity_is_sound(pulse->digest);
    self->are_others = pulse->fmus != 0 && pulse->fmus != number;
    if (!is_known && self->job.database[0] != '\0') {
        digest_files(self->assembly, pulse->digest);
    }
    pulse->fmus = number;
    tl_outbox_name_fmus(&self->outbox, pulse->digest);
}

/* ---- telling ---- */

/* Which start this is, and why: the box's memory of its own troubles. */
static void tell_start(live_twin *self) {
    if (!self->job.alone) {
        tl_journal_event(&self->journal, -1, self->job.again ? TL_EVENT_WARNING : TL_EVENT_INFO, "supervisor",
                         "start %llu, %llu of them after a failure; reason: %s", (unsigned long long)self->job.starts,
                         (unsigned long long)self->job.restarts, self->job.reason);
    }
}

/* What the FMUs are held by, if that is not all there is. */
static void tell_confinement(live_twin *self) {
    char text[TL_CONFINE_TEXT];
    if (self->job.holds) {
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

static void tell_recording(const live_twin *self) {
    if (self->job.database[0] == '\0') {
        tl_log(TL_LOG_NOTICE,
               "nothing is recorded: the configuration has no \"record\", and no --db was given; after a restart "
               "of this program the twin begins anew");
    }
}

/* The process ends while an FMU has not returned. Whoever takes it out of the outbox lives on. */
static void keep(void *context, const char *why) {
    live_twin *self = context;
    tl_outbox_event(&self->outbox, -1, TL_EVENT_ERROR, "twin", why);
}

/* ---- the cycle ---- */

static bool is_complete(const live_twin *self) {
    return __atomic_load_n(&self->mail_end->opened, __ATOMIC_ACQUIRE) != 0 && tl_plant_input_is_complete(&self->input);
}

/* A sample without unknown values is a better start; a dead device must not prevent one. */
static void wait_for_readings(const live_twin *self) {
    tl_time until = tl_clock_now(NULL) + FIRST_READING;
    while (tl_clock_now(NULL) < until && tl_interrupt_requested() == NULL && !is_complete(self)) {
        tl_clock_sleep_until(tl_clock_now(NULL) + 5 * LOOK_SOON);
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
    __atomic_store_n(&self->pulse->realtime, wished ? (int32_t)thread : 0, __ATOMIC_RELEASE);
    while (sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted && tl_clock_now(NULL) < until) {
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK_SOON);
    }
    if (wished && sched_getscheduler(thread) % SCHED_RESET_ON_FORK != wanted) {
        tl_realtime_tell_refused(&self->journal);
    }
}

static tl_status start_cycle(live_twin *self, tl_error *error) {
    const tl_live_past_settings past = {
        .memory = &self->memory,
        .assembly = self->assembly,
        .thread = self->fmus,
        .outbox = &self->outbox,
        .journal = &self->journal,
        .heart = self->heart,
    };
    tl_status status = TL_OK;
    if (!self->are_others) {
        status = tl_live_past_follow(&past, &self->resumed, error);
    } else {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "resume",
                         "begins anew: the FMUs are not those of the run before");
    }
    if (status != TL_OK) {
        return status;
    }
    wait_for_readings(self);
    if (self->config->realtime_lock_memory) {
        tl_realtime_lock_memory(&self->journal);
    }
    wish_realtime(self, true);
    const tl_cycle_settings settings = {
        .assembly = self->assembly,
        .thread = self->fmus,
        .input = &self->input,
        .outbox = &self->outbox,
        .journal = &self->journal,
        .beats = &self->pulse->beats,
        .tuning = self->tuning_block.bytes,
        .answer = &self->pulse->tuned,
        .resumed = self->resumed,
    };
    status = tl_cycle_start(&settings, &self->cycle, error);
    if (status == TL_OK) {
        tell_start(self);
        tell_confinement(self);
        tell_recording(self);
    }
    return status;
}

static void show_status(const live_twin *self, const tl_cycle_status *status) {
    char line[TL_STATUS_LINE];
    const tl_live_figures figures = {
        .ticks = status->ticks,
        .steps = status->steps,
        .skipped = status->skipped,
        .deadline_misses = status->deadline_misses,
        .lock = status->lock,
    };
    tl_status_line_write(self->config, status, line);
    tl_heartbeats_set_status(&self->pulse->beats, line);
    tl_latest_publish(&self->pulse->figures, &figures, sizeof figures);
}

/* Watches until the cycle ends or a signal comes; the cycle needs nothing of this. */
static void look_on(live_twin *self) {
    tl_cycle_status status = {0};
    while (tl_interrupt_requested() == NULL && !status.ended) {
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK);
        tl_heart_beat(self->heart);
        tl_fmu_thread_watch(self->fmus);
        tl_journal_drain(&self->journal);
        if (tl_cycle_status_now(self->cycle, &status) && status.steps != 0) {
            show_status(self, &status);
        }
    }
}

static void hold(live_twin *self) {
    const tl_safe_hold_settings settings = {
        .config = self->config,
        .input = &self->input,
        .outbox = &self->outbox,
        .journal = &self->journal,
        .beats = &self->pulse->beats,
        .heart = self->heart,
        .failures = self->job.failures,
        .reason = self->job.reason,
    };
    tell_start(self);
    tl_safe_hold(&settings);
}

/* ---- end ---- */

static void warn(void *context, const char *text) {
    tl_journal_event(context, -1, TL_EVENT_WARNING, "twin", "%s", text);
}

static tl_status close_cycle(live_twin *self, tl_error *error) {
    tl_live_end *end = &self->pulse->end;
    tl_status status = tl_cycle_stop(self->cycle, &end->summary, error);
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
    const char *signal = tl_interrupt_requested();
    const char *reason = status != TL_OK ? error->text : signal != NULL ? signal : "end of duration";
    (void)tl_outbox_put_end(&self->outbox, reason);
}

/* What it is there for, until it is told to end. */
static tl_status live(live_twin *self) {
    tl_error error = {0};
    tl_status status = self->job.holds ? TL_OK : start_cycle(self, &error);
    bool begun = status == TL_OK;
    tl_heart_be_patient(self->heart, PATIENCE);
    __atomic_store_n(&self->pulse->begun, 1, __ATOMIC_RELEASE);
    if (begun) {
        tl_heartbeats_set_ready(&self->pulse->beats);
        self->was_ready = true;
        if (self->job.holds) {
            hold(self);
        } else {
            look_on(self);
        }
    }
    if (self->cycle != NULL) {
        status = close_cycle(self, &error);
    }
    tl_process_keep(NULL, NULL);
    if (begun) {
        put_end(self, status, &error);
    }
    tl_journal_drain(&self->journal);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return status;
}

/* ---- the twin ---- */

/* A job of the FMUs' thread, and what came of it. */
typedef struct build_job {
    tl_assembly *assembly;
    tl_status status;
} build_job;

static void do_build(void *context) {
    build_job *job = context;
    job->status = tl_assembly_build(job->assembly);
}

static void do_free(void *context) {
    tl_assembly_free(context);
}

/* The FMUs' thread, and the twin built in it. */
static tl_status build(live_twin *self) {
    tl_error error;
    build_job job = {.assembly = self->assembly};
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

static tl_status take_memory(live_twin *self, const tl_twin_job *job, tl_error *error) {
    if (job->live_size != sizeof self->job) {
        return tl_fail(error, TL_BAD_DATA, "the job of the twin is none");
    }
    memcpy(&self->job, job->live, sizeof self->job);
    tl_live_job_apply(&self->job, &self->assembly->config);
    tl_status status = take_mail(self, error);
    if (status == TL_OK) {
        status = take_own(self, error);
    }
    return status == TL_OK ? take_tuning(self, error) : status;
}

int tl_live_twin(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts) {
    static live_twin self; /* one for the process */
    tl_error error;
    self.assembly = assembly;
    self.config = &assembly->config;
    self.facts = facts;
    tl_status status = take_memory(&self, job, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    tl_interrupt_install();
    tl_fmu_calls_use(tl_heartbeats_calls(&self.pulse->beats));
    self.heart = tl_heart_begin(&self.pulse->beats, "main", PATIENCE_AT_START);
    tl_live_role_open_journal(&self.journal, &self.outbox);
    tl_process_keep(keep, &self);
    if (!self.job.holds) {
        identify_files(&self);
        status = build(&self);
    }
    if (status == TL_OK) {
        status = live(&self);
    }
    int code = tl_live_role_end(&self.pulse->beats, self.was_ready, tl_exit_code(status));
    release(&self);
    return code;
}
