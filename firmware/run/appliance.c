/* The appliance: see appliance.h. */
#include "firmware/run/appliance.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/private_folder.h"
#include "firmware/process/process_end.h"
#include "firmware/run/cycle.h"
#include "firmware/run/journal.h"
#include "firmware/run/live_confinement.h"
#include "firmware/run/realtime.h"
#include "firmware/run/resume.h"
#include "firmware/run/safe_hold.h"
#include "firmware/run/status_line.h"
#include "firmware/text/output.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_recorder.h"

/* How long the start waits for a first reading of every signal. */
static const tl_time FIRST_READING = 2 * TL_SECOND;

/* What the main thread's silence may last: while FMUs are loaded, and later (the log may be slow). */
static const tl_time PATIENCE_AT_START = 120 * TL_SECOND;
static const tl_time PATIENCE = 30 * TL_SECOND;

static const tl_time LOOK = TL_SECOND / 20;

/* Everything that is open while the appliance runs. */
typedef struct appliance {
    const tl_appliance_settings *settings;
    const tl_start *start; /* NULL: nobody supervises */
    tl_heartbeats *beats;  /* the same */
    tl_heart *heart;
    bool holds;     /* safe hold */
    bool was_ready; /* it did what it is there for */
    FILE *output;
    tl_fmu_thread *fmus;              /* NULL in safe hold */
    tl_live_confinement *confinement; /* NULL: in safe hold, and where it is unconfined */
    tl_assembly *assembly;
    tl_account account; /* of its twin, when it was taken last */
    tl_journal journal;
    tl_recorder *recorder;
    tl_live_plant *plant;
    tl_cycle *cycle;
    tl_summary resumed; /* what was done to go on with an earlier run */
} appliance;

/* ---- begin ---- */

static void on_link(void *context, const char *source, bool up, const char *text) {
    appliance *self = context;
    tl_journal_event(&self->journal, -1, up ? TL_EVENT_INFO : TL_EVENT_WARNING, "plant", "%s: %s", source, text);
}

/* False: nothing is recorded. */
static bool find_database(const appliance *self, char path[PATH_MAX]) {
    const tl_config *config = &self->assembly->config;
    if (self->settings->database != NULL) {
        (void)snprintf(path, PATH_MAX, "%s", self->settings->database);
    } else if (config->record_file != NULL) {
        tl_config_file_path(config, config->record_file, path, PATH_MAX);
    }
    return self->settings->database != NULL || config->record_file != NULL;
}

static tl_status open_recorder(appliance *self, tl_error *error) {
    char path[PATH_MAX];
    if (!find_database(self, path)) {
        return TL_OK;
    }
    if (!self->holds) {
        tl_account_take(self->assembly->twin, &self->account);
    }
    const tl_twin_recorder_settings settings = {
        .config = &self->assembly->config,
        .account = self->holds ? NULL : &self->account,
        .verb = self->holds ? "hold" : "run",
        .path = path,
        .beats = self->beats,
    };
    return tl_twin_recorder_open(&settings, &self->recorder, error);
}

/* Which start this is, and why: the box's memory of its own troubles. */
static void tell_start(appliance *self) {
    if (self->start == NULL) {
        return;
    }
    const tl_restarts *restarts = self->start->restarts;
    tl_journal_event(&self->journal, -1, self->start->again ? TL_EVENT_WARNING : TL_EVENT_INFO, "supervisor",
                     "start %llu, %llu of them after a failure; reason: %s", (unsigned long long)restarts->starts,
                     (unsigned long long)restarts->restarts, restarts->reason);
}

/* What the FMUs are held by, if that is not all there is. */
static void tell_confinement(appliance *self) {
    char text[TL_LIVE_CONFINEMENT_TEXT];
    if (self->holds) {
        return;
    }
    if (self->confinement == NULL) {
        tl_journal_event(&self->journal, -1, TL_EVENT_WARNING, "twin", "unconfined: FMUs can do what this user can");
        return;
    }
    tl_live_confinement_describe(self->confinement, text);
    if (text[0] != '\0') {
        tl_journal_event(&self->journal, -1, TL_EVENT_INFO, "twin", "%s", text);
    }
}

static void tell_refusals(appliance *self) {
    if (self->confinement != NULL) {
        tl_live_confinement_tell(self->confinement, &self->journal);
    }
}

/* A sample without unknown values is a better start; a dead device must not prevent one. */
static void wait_for_readings(const appliance *self) {
    tl_time until = tl_clock_now(NULL) + FIRST_READING;
    while (tl_clock_now(NULL) < until && tl_interrupt_requested() == NULL && !tl_live_plant_is_complete(self->plant)) {
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 100);
    }
}

/* The process ends while an FMU has not returned. What was recorded is on the disk after a commit or two. */
static void keep(void *context, const char *why) {
    const appliance *self = context;
    if (self->recorder != NULL) {
        tl_recorder_event(self->recorder, -1, TL_EVENT_ERROR, "twin", why);
        tl_clock_sleep_until(tl_clock_now(NULL) + 2 * self->assembly->config.record_commit);
    }
}

/* Recorder, events, plant. */
static tl_status open_all(appliance *self, tl_error *error) {
    tl_status status = open_recorder(self, error);
    if (status != TL_OK) {
        return status;
    }
    tl_journal_init(&self->journal, self->recorder);
    tl_process_keep(keep, self);
    tell_start(self);
    tell_confinement(self);
    status = tl_live_plant_open(&self->assembly->config, self->beats, on_link, self, &self->plant, error);
    if (status == TL_OK && self->recorder == NULL) { /* said only of a run that begins */
        tl_log(TL_LOG_NOTICE,
               "nothing is recorded: the configuration has no \"record\", and no --db was given; after a restart "
               "the twin begins anew");
    }
    return status;
}

/* ---- the twin ---- */

/* To where the run before was ended. An attempt that failed on its way has left a run of its own. */
static tl_status resume(appliance *self, tl_error *error) {
    char path[PATH_MAX];
    bool spoilt = false;
    if (!find_database(self, path)) {
        return TL_OK;
    }
    const tl_resume_settings settings = {
        .assembly = self->assembly,
        .thread = self->fmus,
        .path = path,
        .recorder = self->recorder,
        .journal = &self->journal,
    };
    tl_status status = tl_resume(&settings, &self->resumed, &spoilt, error);
    if (status == TL_OK && spoilt) {
        tl_journal_use_recorder(&self->journal, NULL);
        status = tl_recorder_close(self->recorder, "could not go on with an earlier run", NULL, error);
        self->recorder = NULL;
        status = status == TL_OK ? open_recorder(self, error) : status;
        tl_journal_use_recorder(&self->journal, self->recorder);
    }
    return status;
}

static tl_status start_cycle(appliance *self, tl_error *error) {
    tl_status status = resume(self, error);
    if (status != TL_OK) {
        return status;
    }
    wait_for_readings(self);
    if (self->assembly->config.realtime_lock_memory) {
        tl_realtime_lock_memory(&self->journal);
    }
    const tl_cycle_settings settings = {
        .assembly = self->assembly,
        .thread = self->fmus,
        .input = tl_live_plant_input(self->plant),
        .recorder = self->recorder,
        .journal = &self->journal,
        .beats = self->beats,
        .resumed = self->resumed,
    };
    return tl_cycle_start(&settings, &self->cycle, error);
}

static void show_status(const appliance *self, const tl_cycle_status *status, bool terminal) {
    char line[TL_STATUS_LINE];
    tl_status_line_write(&self->assembly->config, status, line);
    tl_heartbeats_set_status(self->beats, line);
    if (terminal || self->settings->status) {
        tl_status_line_print(line, terminal);
    }
}

/* Watches until the cycle ends or a signal comes; the cycle needs nothing of this. */
static void look_on(appliance *self) {
    bool terminal = isatty(STDERR_FILENO) == 1;
    tl_time interval = terminal ? TL_SECOND / 10 : TL_SECOND;
    tl_time next = tl_clock_now(NULL) + interval;
    tl_cycle_status status = {0};
    while (tl_interrupt_requested() == NULL && !status.ended) {
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK);
        tl_heart_beat(self->heart);
        tl_fmu_thread_watch(self->fmus);
        tell_refusals(self);
        if (terminal && tl_journal_has_events(&self->journal)) {
            (void)fputs("\r\033[K", stderr); /* an event begins its own line */
        }
        tl_journal_drain(&self->journal);
        if (tl_cycle_status_now(self->cycle, &status) && status.steps != 0 && tl_clock_now(NULL) >= next) {
            show_status(self, &status, terminal);
            next += interval;
        }
    }
    if (terminal) {
        (void)fputs("\r\033[K", stderr);
    }
}

/* ---- safe hold ---- */

static void hold(appliance *self) {
    const tl_safe_hold_settings settings = {
        .config = &self->assembly->config,
        .input = tl_live_plant_input(self->plant),
        .recorder = self->recorder,
        .journal = &self->journal,
        .beats = self->beats,
        .heart = self->heart,
        .failures = self->start->restarts->failures,
        .reason = self->start->restarts->reason,
    };
    tl_safe_hold(&settings);
}

/* ---- end ---- */

static tl_status close_cycle(appliance *self, tl_status status, tl_summary *summary, tl_error *error) {
    tl_error later;
    if (self->cycle == NULL) {
        return status;
    }
    tl_status ended = tl_cycle_stop(self->cycle, summary, &later);
    if (ended != TL_OK && status == TL_OK) {
        *error = later;
        status = ended;
        tl_journal_event(&self->journal, -1, TL_EVENT_ERROR, "twin", "%s", later.text);
    }
    tl_account_take(self->assembly->twin, &self->account);
    tl_twin_recorder_check(&self->account, self->recorder);
    return status;
}

static tl_status close_all(appliance *self, tl_status status, tl_summary *summary, tl_error *error) {
    tl_heart_be_patient(self->heart, PATIENCE);
    status = close_cycle(self, status, summary, error);
    tell_refusals(self);
    tl_live_plant_close(self->plant);
    tl_process_keep(NULL, NULL);
    if (self->recorder != NULL) {
        tl_error later;
        tl_recorder_counts counts;
        const char *signal = tl_interrupt_requested();
        const char *reason = status != TL_OK ? error->text : signal != NULL ? signal : "end of duration";
        tl_status closed = tl_recorder_close(self->recorder, reason, &counts, &later);
        if (closed != TL_OK && status == TL_OK) {
            *error = later;
            status = closed;
        }
        tl_journal_use_recorder(&self->journal, NULL);
    }
    tl_journal_drain(&self->journal);
    return status;
}

static tl_status print_summary(const appliance *self, const tl_summary *summary, tl_error *error) {
    const tl_assembly *assembly = self->assembly;
    if (self->settings->json) {
        return tl_summary_print_json(summary, &assembly->config, &self->account, self->output, error);
    }
    tl_summary_print_table(summary, &assembly->config, &self->account, self->output);
    return TL_OK;
}

static tl_status run(appliance *self) {
    tl_error error = {0};
    tl_summary summary = {0};
    tl_time started = tl_clock_now(NULL);
    tl_status status = open_all(self, &error);
    tl_heart_be_patient(self->heart, PATIENCE);
    if (status == TL_OK && !self->holds) {
        status = start_cycle(self, &error);
    }
    if (status == TL_OK) {
        tl_heartbeats_set_ready(self->beats);
        self->was_ready = true;
        if (self->holds) {
            hold(self);
        } else {
            look_on(self);
        }
    }
    bool ran = self->cycle != NULL;
    status = close_all(self, status, &summary, &error);
    summary.wall_s = tl_seconds(tl_clock_now(NULL) - started);
    if (ran) {
        tl_error later;
        tl_status printed = print_summary(self, &summary, &later);
        if (printed != TL_OK && status == TL_OK) {
            error = later;
            status = printed;
        }
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return status;
}

/* A job of the FMUs' thread, and what came of it. */
typedef struct appliance_job {
    appliance *self;
    tl_error *error;
    tl_status status;
} appliance_job;

static void build_job(void *context) {
    appliance_job *job = context;
    job->status = tl_assembly_build(job->self->assembly);
}

static void enter_job(void *context) {
    appliance_job *job = context;
    job->status = tl_live_confinement_enter(job->self->confinement, job->error);
}

/* Rights to files go before there is a second thread, the rest when the thread of the FMUs has its own list: see live_confinement.h. */
static tl_status confine(appliance *self, tl_error *error) {
    char path[PATH_MAX];
    tl_status status = tl_assembly_open(self->assembly, error);
    return status == TL_OK ? tl_live_confinement_begin(self->assembly, find_database(self, path) ? path : NULL,
                                                       &self->confinement, error)
                           : status;
}

static tl_status confine_threads(appliance *self, tl_error *error) {
    appliance_job job = {.self = self, .error = error};
    tl_fmu_thread_call(self->fmus, enter_job, &job);
    return job.status == TL_OK ? tl_live_confinement_finish(self->confinement, error) : job.status;
}

static void free_job(void *context) {
    tl_assembly_free(context);
}

/* The FMUs' thread, and the twin built in it. */
static tl_status build(appliance *self) {
    tl_error error;
    appliance_job job = {.self = self};
    const bool confined = !self->settings->unconfined;
    tl_status status = confined ? confine(self, &error) : TL_OK;
    status = status == TL_OK ? tl_fmu_thread_start(TL_FMU_WATCHED_HERE, &self->fmus, &error) : status;
    if (status == TL_OK && confined) {
        status = confine_threads(self, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return status;
    }
    tl_fmu_thread_call(self->fmus, build_job, &job);
    return job.status;
}

/* Everything that was built, the thread, and what held it. */
static void release(appliance *self) {
    if (self->fmus != NULL) {
        tl_fmu_thread_call(self->fmus, free_job, self->assembly);
        tl_fmu_thread_end(self->fmus);
    } else {
        tl_assembly_free(self->assembly);
    }
    tl_live_confinement_end(self->confinement);
}

/* What it says of its end to the supervisor. What is left to do then, such as to unload FMUs, loses nothing if it fails. */
static void announce(tl_heartbeats *beats, bool was_ready, int code) {
    if (code != 0) {
        tl_heartbeats_announce(beats, was_ready ? TL_FAREWELL_FAILED : TL_FAREWELL_REFUSED, code);
    } else {
        tl_heartbeats_announce(beats, tl_interrupt_requested() != NULL ? TL_FAREWELL_ASKED : TL_FAREWELL_OVER, 0);
    }
}

int tl_appliance_run(const tl_appliance_settings *settings, const tl_start *start) {
    tl_interrupt_install();
    tl_heartbeats *beats = start != NULL ? start->beats : NULL;
    appliance *self = calloc(1, sizeof *self);
    if (self == NULL) {
        tl_log(TL_LOG_ERROR, "not enough memory");
        announce(beats, false, tl_exit_code(TL_TRY_AGAIN));
        return tl_exit_code(TL_TRY_AGAIN);
    }
    self->settings = settings;
    self->start = start;
    self->assembly = settings->assembly;
    self->beats = beats;
    self->holds = start != NULL && start->hold;
    self->heart = tl_heart_begin(self->beats, "main", PATIENCE_AT_START);
    self->output = tl_output_claim();
    tl_status status = TL_OK;
    if (self->holds) { /* no FMU is touched: it may be what the appliance fails by */
        tl_fmu_archive_sweep();
        tl_private_folder_sweep(TL_LIVE_CONFINEMENT_KIND);
        tl_config_use_lookups(&self->assembly->config);
    } else {
        status = build(self);
    }
    if (status == TL_OK) {
        status = run(self);
    }
    status = tl_output_finish(self->output, status);
    int code = tl_exit_code(status);
    announce(beats, self->was_ready, code);
    release(self);
    free(self);
    return code;
}
