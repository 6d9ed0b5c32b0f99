/* The tree of processes of a live run: starting it, running it, and its end: see tree.h. */
#include "firmware/live/tree.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/live/live_activator.h"
#include "firmware/live/live_change.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_places.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_wire.h"
#include "firmware/live/saved_states.h"
#include "firmware/live/supervisor.h"
#include "firmware/live/voice.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/role.h"
#include "firmware/report/summary.h"
#include "firmware/store/outbox.h"
#include "firmware/twin/twin_process.h"

/* ---- the data: used by the supervisor's thread, but for tl_tree_put_event() ---- */

/* All shared memory of the run. It outlives each process that writes it. */
typedef struct tl_tree_memory {
    tl_block mail; /* in which io posts what it reads of the plant (mailbox.h) */
    tl_block io_pulse;
    tl_block recorder_pulse;
    tl_block supervisor; /* an outbox of ours */
    tl_block stage;
    tl_block candidate; /* of the activator */
} tl_tree_memory;

typedef struct tl_tree {
    const tl_tree_settings *settings;
    tl_config config; /* as the processes have it, with what the command line changes */
    tl_live_job job;  /* what does not change from start to start */
    tl_tree_memory memory;
    tl_live_place places[TL_LIVE_PLACES];
    tl_live_change change;
    uint32_t twins_place; /* the place of the supervisor's twin; that of the run is on the stage */
    tl_live_activator activator;
    tl_saved_states states; /* of the FMUs with which the run begins, */
    bool told_states;       /* and that they are of no use */
    bool again;             /* the run is to begin anew */
    int stopped;            /* by this signal; 0: by none */
    tl_outbox outbox;       /* of the supervisor */
    tl_voice *voice;
    int32_t urgent; /* the thread of the run's twin that has the priority; 0: none */
    FILE *output;
    tl_time began;
} tl_tree;

static inline tl_live_stage *tl_tree_stage(const tl_tree *self) {
    return self->memory.stage.bytes;
}

/* That of the run. */
static inline tl_live_place *tl_tree_place_of_run(tl_tree *self) {
    return &self->places[tl_tree_stage(self)->place];
}

/* The place in which the supervisor's twin is, or its shadow. */
static inline tl_live_place *tl_tree_place_of(tl_tree *self, tl_member which) {
    return &self->places[which == TL_MEMBER_TWIN ? self->twins_place : 1 - self->twins_place];
}

static inline tl_live_recorder_pulse *tl_tree_recorder_pulse(const tl_tree *self) {
    return self->memory.recorder_pulse.bytes;
}

static inline bool tl_tree_records(const tl_tree *self) {
    return self->job.database[0] != '\0';
}

/* ---- the start of each process ---- */

/* ---- tree.c ---- */

static void tl_tree_put_event(tl_tree *self, tl_severity severity, const char *source, const char *text);

/* ---- tree start ---- */

/* ---- what is heard of FMUs ---- */

/* In the output thread of the process. Of a shadow's FMUs nothing is kept but the log. */
static void hear_refusal_in(tl_tree *self, uint32_t place, const char *text) {
    if (__atomic_load_n(&tl_tree_stage(self)->place, __ATOMIC_ACQUIRE) == place) {
        tl_tree_put_event(self, TL_EVENT_WARNING, "twin", text);
    }
}

static void hear_refusal(void *context, const char *text) {
    hear_refusal_in(context, 0, text);
}

static void hear_refusal_of_other(void *context, const char *text) {
    hear_refusal_in(context, 1, text);
}

/* ---- descriptors ---- */

/* Descriptors for a process: closed here once it has them. */
typedef struct gift {
    int given[TL_ROLE_DESCRIPTORS];
} gift;

static gift no_gift(void) {
    gift made;
    for (int i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        made.given[i] = -1;
    }
    return made;
}

static void give(gift *made, int number, const tl_block *block) {
    made->given[number] = block->descriptor < 0 || block->size == 0 ? -1 : fcntl(block->descriptor, F_DUPFD_CLOEXEC, 0);
}

static void give_to_read(gift *made, int number, const tl_block *block) {
    made->given[number] = block->descriptor < 0 || block->size == 0 ? -1 : tl_block_reader(block);
}

static void take_back(gift *made) {
    for (int i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        if (made->given[i] >= 0) {
            (void)close(made->given[i]);
        }
    }
}

/* What main() does for a title; the context is the tree. */
static int tl_tree_be(const char *title, void *context) {
    const tl_tree *self = context;
    return self->settings->be(title, context);
}

/* One without FMUs: with a job of the configuration in a place, and a pipe for what it prints. */
static pid_t start_plain(tl_tree *self, const char *kind, unsigned ear, uint32_t place, gift *made, tl_error *error) {
    char title[TL_ROLE_TITLE];
    tl_block job = {.descriptor = -1};
    tl_role role = {.pid = 0};
    int output[2] = {-1, -1};
    (void)snprintf(title, sizeof title, "%s [%s]", kind, self->config.name);
    self->job.place = place;
    tl_status status =
        tl_live_job_make(&self->job, self->settings->config->path, self->places[place].text, &job, error);
    made->given[0] = open("/dev/null", O_RDWR | O_CLOEXEC);
    if (status == TL_OK && (made->given[0] < 0 || pipe2(output, O_CLOEXEC) != 0)) {
        status = tl_fail(error, TL_TRY_AGAIN, "no pipe for \"%s\": %s", title, strerror(errno));
    }
    if (status == TL_OK) {
        tl_role_settings settings = {.title = title, .fallback = tl_tree_be, .context = self};
        memcpy(settings.descriptors, made->given, sizeof settings.descriptors);
        settings.descriptors[1] = output[1];
        settings.descriptors[2] = output[1];
        settings.descriptors[TL_LIVE_JOB] = job.descriptor;
        status = tl_role_start(&settings, &role, error);
    }
    if (output[1] >= 0) {
        (void)close(output[1]);
    }
    if (status == TL_OK) {
        tl_voice_hear(self->voice, ear, output[0]);
    } else if (output[0] >= 0) {
        (void)close(output[0]);
    }
    tl_block_close(&job);
    return role.pid;
}

static pid_t start_io(tl_tree *self, tl_error *error) {
    gift made = no_gift();
    give(&made, TL_LIVE_MAIL, &self->memory.mail);
    give(&made, TL_LIVE_OWN_PULSE, &self->memory.io_pulse);
    give_to_read(&made, TL_LIVE_RECORDER_PULSE, &self->memory.recorder_pulse);
    pid_t pid = start_plain(self, TL_LIVE_IO, 0, tl_tree_stage(self)->place, &made, error);
    take_back(&made);
    return pid;
}

static pid_t start_recorder(tl_tree *self, tl_error *error) {
    gift made = no_gift();
    tl_live_change_begin_recorder(&self->change);
    const uint32_t number = self->change.recorder_place;
    const tl_live_place *place = &self->places[number];
    const tl_live_place *other = &self->places[1 - number];
    self->job.flips = self->change.recorder_flips;
    give(&made, TL_LIVE_OWN_PULSE, &self->memory.recorder_pulse);
    give(&made, TL_LIVE_PAST, &place->past);
    give(&made, TL_LIVE_OTHER_PAST, &other->past);
    give_to_read(&made, TL_LIVE_TWIN_PULSE_READ, &place->pulse_block);
    give_to_read(&made, TL_LIVE_OTHER_PULSE, &other->pulse_block);
    give_to_read(&made, TL_LIVE_TWIN_OUTBOX, &place->outbox);
    give_to_read(&made, TL_LIVE_STAGE, &self->memory.stage);
    give_to_read(&made, TL_LIVE_IO_PULSE_READ, &self->memory.io_pulse);
    give_to_read(&made, TL_LIVE_SUPERVISOR_READ, &self->memory.supervisor);
    give_to_read(&made, TL_LIVE_ACTIVATOR_READ, &self->activator.pulse);
    give_to_read(&made, TL_LIVE_TUNING, &place->tuning);
    give_to_read(&made, TL_LIVE_MAIL_READ, &self->memory.mail);
    pid_t pid = start_plain(self, TL_LIVE_RECORDER, 1, number, &made, error);
    take_back(&made);
    return pid;
}

static pid_t tl_tree_begin_activator(void *context) {
    tl_tree *self = context;
    tl_error error = {0};
    gift made = no_gift();
    const uint32_t number = tl_tree_stage(self)->place;
    const tl_live_place *place = &self->places[number];
    const tl_live_place *other = &self->places[1 - number];
    for (size_t i = 0; i < TL_LIVE_PLACES; i++) {
        memcpy(self->job.hash[i], self->places[i].hash, sizeof self->job.hash[i]);
    }
    made.given[TL_LIVE_KNOCKER] = fcntl(self->activator.listener, F_DUPFD_CLOEXEC, 0);
    give(&made, TL_LIVE_OWN_PULSE, &self->activator.pulse);
    give(&made, TL_LIVE_TUNING, &place->tuning);
    give(&made, TL_LIVE_OTHER_TUNING, &other->tuning);
    give(&made, TL_LIVE_CANDIDATE, &self->memory.candidate);
    give_to_read(&made, TL_LIVE_ACTIVATOR_TWIN, &place->pulse_block);
    give_to_read(&made, TL_LIVE_OTHER_PULSE, &other->pulse_block);
    give_to_read(&made, TL_LIVE_RECORDER_PULSE, &self->memory.recorder_pulse);
    give_to_read(&made, TL_LIVE_STAGE, &self->memory.stage);
    pid_t pid = start_plain(self, TL_LIVE_ACTIVATOR, 2, number, &made, &error);
    take_back(&made);
    if (pid == 0) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return pid;
}

/* Nothing of the one before is left but what its successor goes on with. */
static void prepare_pulse(tl_live_twin_pulse *pulse, const tl_start *start, uint64_t unreadable) {
    pulse->unreadable = pulse->unreadable != 0 ? pulse->unreadable : unreadable;
    pulse->realtime = 0;
    pulse->begun = 0;
    pulse->past = 0;
    pulse->start = 0;
    pulse->end.is_there = 0;
    pulse->number++;
    pulse->first += start->waits ? 1 : 0;
    pulse->holds = start->waits ? TL_LIVE_WAITS : start->hold ? TL_LIVE_HOLDS : 0;
}

/* The first one that waits records from the beginning of the wait on, which io's mail still has. */
static tl_time start_of(const tl_tree *self, const tl_live_place *place, bool is_shadow, const tl_start *start) {
    if (start->waits) {
        return place->pulse->number == 1 ? self->states.begun : tl_clock_now(NULL);
    }
    return is_shadow ? place->start : 0;
}

/* What a twin is told of its start. */
static tl_live_job job_of_twin(const tl_tree *self, const tl_live_place *place, bool is_shadow, const tl_start *start) {
    tl_live_job job = self->job;
    job.place = (uint32_t)(place - self->places);
    job.number = place->pulse->number;
    job.unconfined = place->unconfined;
    job.is_shadow = is_shadow;
    job.start = start_of(self, place, is_shadow, start);
    job.started = is_shadow ? place->started : 0;
    job.flips = tl_tree_stage(self)->flips;
    job.again = start->again;
    job.holds = start->hold;
    job.hold_time = start->hold_time;
    job.starts = start->restarts->starts;
    job.restarts = start->restarts->restarts;
    job.failures = start->failures;
    job.missing = start->missing;
    job.tries = start->restarts->tries;
    memcpy(job.reason, start->restarts->reason, sizeof job.reason);
    return job;
}

static void give_to_twin(const tl_tree *self, const tl_live_place *place, gift *made) {
    give_to_read(made, TL_LIVE_MAIL, &self->memory.mail);
    give_to_read(made, TL_LIVE_RECORDER_PULSE, &self->memory.recorder_pulse);
    give_to_read(made, TL_LIVE_STAGE, &self->memory.stage);
    give_to_read(made, TL_LIVE_PAST, &place->past);
    give_to_read(made, TL_LIVE_TUNING, &place->tuning);
    give(made, TL_LIVE_OWN_PULSE, &place->pulse_block);
    give(made, TL_LIVE_TWIN_OUTBOX, &place->outbox);
}

static const char *kind_of_twin(bool is_shadow, const tl_start *start) {
    const char *held = start->waits ? "twin, waits" : "twin, safe hold";
    return start->hold ? held : is_shadow ? TL_LIVE_TWIN_SHADOW : TL_LIVE_TWIN;
}

/* A shadow is told the run's configuration: it reads the samples that the run has recorded. */
static tl_status start_with_job(tl_tree *self, tl_live_place *place, const tl_live_job *job, const char *title,
                                tl_error *error) {
    gift made = no_gift();
    tl_live_job_bytes live = {.bytes = NULL};
    const char *of_run = job->is_shadow ? self->places[1 - job->place].text : "";
    tl_status status = tl_live_job_pack(job, of_run, &live, error);
    if (status != TL_OK) {
        return status;
    }
    give_to_twin(self, place, &made);
    const tl_twin_job twin_job = {
        .task = TL_TASK_LIVE,
        .holds = job->holds,
        .path = self->settings->config->path,
        .text = place->text,
        .unconfined = place->unconfined,
        .live = live.bytes,
        .live_size = live.size,
    };
    tl_twin_process_settings settings = {
        .job = &twin_job,
        .fmus = place->fmus,
        .which = job->place,
        .title = title,
        .calls = tl_heartbeats_calls(&place->pulse->beats),
        .memory_limit = self->settings->memory_limit,
        .tasks = self->settings->tasks,
        .hear = job->place == 0 ? hear_refusal : hear_refusal_of_other,
        .context = self,
    };
    memcpy(settings.given, made.given, sizeof made.given);
    status = tl_twin_process_start(&settings, &place->twin, error);
    take_back(&made);
    free(live.bytes);
    return status;
}

static pid_t start_twin(tl_tree *self, tl_live_place *place, bool is_shadow, const tl_start *start, tl_error *error) {
    char title[TL_ROLE_TITLE];
    const uint64_t known = self->states.files != 0 ? self->states.files : start->restarts->unreadable;
    prepare_pulse(place->pulse, start, start->waits ? 0 : known); /* the first number stays */
    const tl_live_job job = job_of_twin(self, place, is_shadow, start);
    (void)snprintf(title, sizeof title, "%s [%s]%s", kind_of_twin(is_shadow, start), self->config.name,
                   is_shadow || start->hold ? "" : TL_LIVE_TWIN_ROOM);
    tl_status status = start_with_job(self, place, &job, title, error);
    place->pid = status == TL_OK ? tl_twin_process_role(place->twin)->pid : 0;
    return place->pid;
}

static pid_t begin_shadow(tl_tree *self, const tl_start *start, tl_error *error) {
    const tl_start plain = {.restarts = start->restarts};
    pid_t pid = start_twin(self, tl_tree_place_of(self, TL_MEMBER_SHADOW), true, &plain, error);
    if (pid == 0) {
        tl_live_change_note_end_of_shadow(&self->change, error->text);
    } else {
        tl_live_change_note_shadow(&self->change, pid);
    }
    return pid;
}

static pid_t begin_twin(tl_tree *self, const tl_start *start, tl_error *error) {
    self->urgent = 0;
    tl_live_change_note_hold(&self->change, start->hold);
    return start_twin(self, tl_tree_place_of(self, TL_MEMBER_TWIN), false, start, error);
}

/* As tl_supervisor_settings.begin, and tl_live_activator_host.begin; the context is the tree. */
static pid_t tl_tree_begin(void *context, tl_member which, const tl_start *start, tl_error *error) {
    tl_tree *self = context;
    switch (which) {
    case TL_MEMBER_TWIN:
        return begin_twin(self, start, error);
    case TL_MEMBER_SHADOW:
        return begin_shadow(self, start, error);
    case TL_MEMBER_IO:
        return start_io(self, error);
    default:
        return start_recorder(self, error);
    }
}

/* ---- tree ---- */

/* ---- shared memory ---- */

static tl_status make_recorder_memory(tl_tree *self, tl_error *error) {
    const tl_outbox_settings events = tl_live_event_outbox();
    tl_tree_memory *made = &self->memory;
    if (!tl_tree_records(self)) {
        return TL_OK;
    }
    tl_status status = tl_block_make("twinlock recorder", sizeof(tl_live_recorder_pulse), TL_BLOCK_THEY_WRITE,
                                     &made->recorder_pulse, error);
    if (status == TL_OK) {
        status =
            tl_block_make("twinlock events", tl_outbox_bytes(&events), TL_BLOCK_WE_WRITE, &made->supervisor, error);
    }
    if (status == TL_OK) {
        tl_outbox_open(&events, made->supervisor.bytes,
                       &tl_tree_recorder_pulse(self)->state.taken[TL_LIVE_OUTBOX_SUPERVISOR], &self->outbox);
    }
    return status;
}

static tl_status make_memory(tl_tree *self, tl_error *error) {
    tl_config begun = *self->settings->config; /* whose text is in force first, */
    tl_plant_mail_shape shape;
    tl_tree_memory *made = &self->memory;
    tl_config_use_lookups(&begun); /* and of which the twin has all signals */
    tl_plant_mail_shape_of(&self->config, &shape);
    tl_status status = tl_block_make_sparse("twinlock mail", tl_live_mail_bytes(&shape), &made->mail, error);
    if (status == TL_OK) {
        status = tl_block_make("twinlock io", tl_live_io_bytes(), TL_BLOCK_THEY_WRITE, &made->io_pulse, error);
    }
    if (status == TL_OK) {
        status = tl_block_make("twinlock stage", sizeof(tl_live_stage), TL_BLOCK_WE_WRITE, &made->stage, error);
    }
    if (status == TL_OK) {
        status = tl_block_make_sparse("twinlock candidate", sizeof(tl_live_candidate), &made->candidate, error);
    }
    for (size_t i = 0; i < TL_LIVE_PLACES && status == TL_OK; i++) {
        status = tl_live_place_make(tl_tree_records(self), &self->places[i], error);
    }
    if (status == TL_OK) {
        status = tl_live_place_move_in(&self->places[0], &begun, self->settings->unconfined, error);
    }
    return status == TL_OK ? make_recorder_memory(self, error) : status;
}

static void free_memory(tl_tree_memory *made) {
    tl_block *const blocks[] = {&made->mail,       &made->io_pulse, &made->recorder_pulse,
                                &made->supervisor, &made->stage,    &made->candidate};
    for (size_t i = 0; i < sizeof blocks / sizeof blocks[0]; i++) {
        tl_block_close(blocks[i]);
    }
}

/* ---- events ---- */

static void tl_tree_put_event(tl_tree *self, tl_severity severity, const char *source, const char *text) {
    if (tl_tree_records(self)) {
        tl_outbox_event(&self->outbox, -1, severity, source, text);
    }
}

/* ---- ending ---- */

/* Whether that was because of a checkpoint that it had loaded (live_wire.h): the files of its FMUs, or 0. */
static uint64_t note_unreadable(tl_live_twin_pulse *pulse, bool by_others) {
    bool is_to_blame = pulse->loads != 0 && !by_others && pulse->fmus != 0;
    pulse->unreadable = is_to_blame ? pulse->fmus : pulse->unreadable;
    return is_to_blame ? pulse->fmus : 0;
}

static uint64_t end_twin(tl_tree *self, tl_live_place *place, bool by_others, char reason[TL_RESTARTS_REASON]) {
    char why[TL_TWIN_KILLED_TEXT];
    bool was_killed = tl_twin_process_was_killed(place->twin, why);
    if (was_killed) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "%.*s", TL_RESTARTS_REASON - 1, why);
    }
    tl_twin_process_let_go(place->twin);
    tl_voice_clear(self->voice, place->twin);
    place->twin = NULL;
    place->pid = 0;
    return note_unreadable(place->pulse, by_others && !was_killed);
}

/* One that could not go on has said why. It is bounded here, and cleaned by who shows it. */
static void note_end_of_shadow(tl_tree *self, const tl_heartbeats *beats, const char *reason) {
    char said[TL_HEARTBEAT_STATUS] = "";
    int code = 0;
    tl_farewell farewell = tl_heartbeats_get_farewell(beats, &code);
    bool is_said =
        (farewell == TL_FAREWELL_REFUSED || farewell == TL_FAREWELL_FAILED) && tl_heartbeats_get_status(beats, said);
    said[sizeof said - 1] = '\0';
    tl_live_change_note_end_of_shadow(&self->change, is_said && said[0] != '\0' ? said : reason);
}

static uint64_t ended(void *context, tl_member which, bool by_others, char reason[TL_RESTARTS_REASON]) {
    tl_tree *self = context;
    uint64_t unreadable = 0;
    if (which == TL_MEMBER_TWIN || which == TL_MEMBER_SHADOW) {
        unreadable = end_twin(self, tl_tree_place_of(self, which), by_others, reason);
    }
    if (which == TL_MEMBER_TWIN) {
        char why[TL_LIVE_STAGE_WHY] = "";
        (void)snprintf(why, sizeof why, "%.*s", TL_LIVE_STAGE_WHY - 1, reason);
        tl_latest_publish(&tl_tree_stage(self)->failure, why, sizeof why);
    }
    if (which == TL_MEMBER_SHADOW) {
        note_end_of_shadow(self, &tl_tree_place_of(self, which)->pulse->beats, reason);
    }
    return unreadable;
}

static void tell(void *context, const char *text) {
    tl_tree_put_event(context, TL_EVENT_ERROR, "supervisor", text);
}

/* ---- looking ---- */

/* Is that one of its threads? Its word alone is worth nothing. */
static bool is_thread_of(pid_t process, int32_t thread) {
    char path[64];
    struct stat about;
    (void)snprintf(path, sizeof path, "/proc/%ld/task/%ld", (long)process, (long)thread);
    return thread > 0 && stat(path, &about) == 0;
}

static void schedule(int32_t thread, int priority) {
    const struct sched_param parameter = {.sched_priority = priority};
    (void)sched_setscheduler(thread, priority > 0 ? SCHED_FIFO | SCHED_RESET_ON_FORK : SCHED_OTHER, &parameter);
}

/* The run's twin is another one from now on: a shadow has no priority. */
static void take_priority_away(tl_tree *self, const tl_live_place *before) {
    if (before->pid != 0 && is_thread_of(before->pid, self->urgent)) {
        schedule(self->urgent, 0);
    }
    self->urgent = 0;
}

/* The twin's cycle wants its priority, or does not any more: no thread beside FMUs can set one itself. */
static void look_at_priority(tl_tree *self) {
    const tl_live_place *place = tl_tree_place_of_run(self);
    int32_t wished = __atomic_load_n(&place->pulse->realtime, __ATOMIC_ACQUIRE);
    if (place->pid == 0 || wished == self->urgent) {
        return;
    }
    if (is_thread_of(place->pid, self->urgent)) {
        schedule(self->urgent, 0);
    }
    if (is_thread_of(place->pid, wished)) {
        schedule(wished, self->config.realtime_priority);
    }
    self->urgent = wished;
}

static void tell_of_activator(void *context, unsigned times, const char *reason) {
    char text[TL_RESTARTS_REASON + 192];
    char more[48] = "";
    if (times > 1) {
        (void)snprintf(more, sizeof more, " %u times, the last time", times);
    }
    (void)snprintf(text, sizeof text, "the activator failed%s: %s; another one is begun", more, reason);
    tl_log(TL_LOG_ERROR, "%s", text);
    tl_tree_put_event(context, TL_EVENT_ERROR, "supervisor", text);
}

static void tell_of_flip(void *context, const char *text) {
    tl_log(TL_LOG_NOTICE, "%s", text);
    tl_tree_put_event(context, TL_EVENT_INFO, "supervisor", text);
}

/* The supervisor swaps nothing any more once all end. */
static void look_at_change(tl_tree *self, bool ends, tl_orders *orders) {
    const tl_live_place *before = tl_tree_place_of_run(self);
    tl_live_change_look(&self->change, tl_clock_now(NULL), ends, orders);
    if (orders->swap) {
        take_priority_away(self, before);
        tl_voice_watch(self->voice, &tl_tree_place_of_run(self)->pulse->beats);
        self->twins_place = ends ? self->twins_place : tl_tree_stage(self)->place;
    }
}

static void look(void *context, bool ends, tl_orders *orders) {
    tl_tree *self = context;
    look_at_change(self, ends, orders);
    if (ends) {
        tl_saved_states_stop(&self->states);
    }
    const tl_live_activator_host host = {.context = self, .begin = tl_tree_begin_activator, .tell = tell_of_activator};
    look_at_priority(self);
    bool again = tl_live_activator_look(&self->activator, &host, ends);
    if (again && !ends) {
        self->again = true;
        __atomic_store_n(&tl_tree_stage(self)->again, 1, __ATOMIC_RELEASE);
    }
    orders->end = again;
}

/* An event has room for less. */
static void tell_states(tl_tree *self) {
    char text[TL_EVENT_TEXT];
    tl_log(TL_LOG_WARNING, "%s; no checkpoint holds them, and a twin that goes on follows the recorded inputs instead",
           self->states.why);
    (void)snprintf(text, sizeof text, "%.200s: none are saved", self->states.why);
    tl_tree_put_event(self, TL_EVENT_WARNING, "supervisor", text);
    self->told_states = true;
}

static tl_wait wait_for_states(void *context) {
    tl_tree *self = context;
    tl_wait wait = tl_saved_states_look(&self->states);
    if (self->states.files != 0 && !self->told_states) {
        tell_states(self);
    }
    return wait;
}

/* The recorder's word, of those whose outboxes it reads. */
static tl_time damaged(void *context, tl_member which) {
    const tl_tree *self = context;
    size_t outbox = which == TL_MEMBER_IO ? TL_LIVE_OUTBOX_IO : tl_live_outbox_of_place(self->twins_place);
    bool is_read = tl_tree_records(self) && (which == TL_MEMBER_IO || which == TL_MEMBER_TWIN);
    return is_read ? __atomic_load_n(&tl_tree_recorder_pulse(self)->damaged[outbox], __ATOMIC_RELAXED) : 0;
}

/* ---- the run ---- */

static void find_database(tl_tree *self) {
    const tl_config *config = &self->config;
    if (self->settings->database != NULL) {
        (void)snprintf(self->job.database, sizeof self->job.database, "%s", self->settings->database);
    } else if (config->record_file != NULL) {
        (void)tl_config_file_path(config, config->record_file, self->job.database, sizeof self->job.database);
    }
}

/* Without an account nothing would be remembered. */
static void open_states(tl_tree *self) {
    const tl_saved_states_settings settings = {
        .config = self->settings->config,
        .folder = self->settings->supervised ? self->settings->state : NULL,
        .unconfined = self->settings->unconfined,
        .memory_limit = self->settings->memory_limit,
        .be = tl_tree_be,
        .context = self,
    };
    tl_saved_states_open(&settings, &self->states);
}

static void open_change(tl_tree *self) {
    self->change =
        (tl_live_change){.settings = {.stage = tl_tree_stage(self),
                                      .places = self->places,
                                      .orders = self->activator.pulse.bytes,
                                      .candidate = &self->memory.candidate,
                                      .recorder = tl_tree_records(self) ? tl_tree_recorder_pulse(self) : NULL,
                                      .step = self->config.step,
                                      .unconfined = self->settings->unconfined,
                                      .context = self,
                                      .tell = tell_of_flip}};
}

static tl_status open_all(tl_tree *self, tl_error *error) {
    find_database(self);
    open_states(self);
    tl_status status = make_memory(self, error);
    if (status == TL_OK) {
        status = tl_live_activator_open(&self->activator, self->settings->control, error);
    }
    if (status == TL_OK) {
        open_change(self);
        const tl_voice_settings settings = {.status = self->settings->status,
                                            .beats = &tl_tree_place_of_run(self)->pulse->beats};
        status = tl_voice_start(&settings, &self->voice, error);
    }
    return status;
}

/* What the processes read, we read too: sizes of what is shared follow from it. */
static tl_status read_config(const tl_tree *self, const char *text, tl_config *config, tl_error *error) {
    return tl_live_job_read(&self->job, self->settings->config->path, text, config, error);
}

/* Of the run that is the last one. Nothing is left that could be harmed by reading what is not our own. */
static tl_status read_last_config(tl_tree *self, tl_error *error) {
    const char *text = tl_tree_place_of_run(self)->text;
    if (text == self->settings->config->text) {
        return TL_OK;
    }
    tl_config_free(&self->config);
    self->config = (tl_config){.path = NULL};
    return read_config(self, text, &self->config, error);
}

/* What the twin says of its run, as far as it can be; and whether that is what was wanted of it. */
static tl_status print_summary(tl_tree *self, tl_error *error) {
    tl_live_end *end = &tl_tree_place_of_run(self)->pulse->end;
    tl_summary summary = end->summary;
    tl_account account = end->account;
    if (end->is_there == 0) {
        return self->settings->require_lock <= 0.0
                   ? TL_OK
                   : tl_fail(error, TL_NOT_LOCKED, "the run ended without a twin: it was not in lock");
    }
    tl_status status = read_last_config(self, error);
    if (status != TL_OK) {
        return status;
    }
    summary.wall_s = tl_seconds(tl_clock_now(NULL) - self->began);
    if (!tl_run_end_is_sound(&summary, &account, &self->config)) {
        return tl_fail(error, TL_FMU_FAILED,
                       "the summary of the run is none: the process of the FMUs has destroyed it");
    }
    if (self->settings->json) {
        status = tl_summary_print_json(&summary, &self->config, &account, self->output, error);
    } else {
        tl_summary_print_table(&summary, &self->config, &account, self->output);
    }
    bool asked = self->settings->require_lock > 0.0 || !self->settings->supervised;
    return status == TL_OK && asked
               ? tl_summary_require_lock(&summary, &self->config, self->settings->require_lock, error)
               : status;
}

static int supervise(tl_tree *self) {
    const tl_supervisor_settings settings = {
        .alone = !self->settings->supervised,
        .call_limit = self->settings->call_limit,
        .has_duration = self->config.duration > 0,
        .state = self->settings->state,
        .watchdog = self->settings->watchdog,
        .watchdog_s = self->settings->watchdog_s,
        .beats = {[TL_MEMBER_RECORDER] = tl_tree_records(self) ? &tl_tree_recorder_pulse(self)->beats : NULL,
                  [TL_MEMBER_IO] = &((tl_live_io_pulse *)self->memory.io_pulse.bytes)->beats,
                  [TL_MEMBER_TWIN] = &self->places[0].pulse->beats,
                  [TL_MEMBER_SHADOW] = &self->places[1].pulse->beats},
        .context = self,
        .begin = tl_tree_begin,
        .ended = ended,
        .tell = tell,
        .damaged = damaged,
        .wait = wait_for_states,
        .look = look,
    };
    return tl_supervise(&settings, &self->stopped);
}

static void close_all(tl_tree *self) {
    tl_voice_stop(self->voice);
    tl_saved_states_stop(&self->states);
    tl_live_activator_close(&self->activator, self->settings->control);
    for (size_t i = 0; i < TL_LIVE_PLACES; i++) {
        tl_live_place_close(&self->places[i]);
    }
    free_memory(&self->memory);
    tl_config_free(&self->config);
}

/* Both outboxes; a place without one has none. */
static uint64_t count_rest_of_twins(const tl_tree *self, const tl_outbox_taken *taken) {
    uint64_t count = 0;
    for (uint32_t i = 0; i < TL_LIVE_PLACES; i++) {
        count += tl_live_place_count_rest(&self->places[i], &taken[tl_live_outbox_of_place(i)]);
    }
    return count;
}

/* What nobody has recorded, if the last one who could have has not said that itself. */
static void say_rest(tl_tree *self) {
    const tl_outbox_settings events = tl_live_event_outbox();
    int code = 0;
    if (!tl_tree_records(self) ||
        tl_heartbeats_get_farewell(&tl_tree_recorder_pulse(self)->beats, &code) != TL_FAREWELL_NONE) {
        return;
    }
    const tl_outbox_taken *taken = tl_tree_recorder_pulse(self)->state.taken;
    uint64_t rest = count_rest_of_twins(self, taken);
    rest += tl_outbox_rest_count(&events, tl_live_io_outbox_of(self->memory.io_pulse.bytes), &taken[TL_LIVE_OUTBOX_IO]);
    rest += tl_outbox_rest_count(&events, self->memory.supervisor.bytes, &taken[TL_LIVE_OUTBOX_SUPERVISOR]);
    if (rest > 0) {
        tl_log(TL_LOG_ERROR, "%" PRIu64 " %s lost: no recorder is left to write what came last", rest,
               rest == 1 ? "sample, step or event is" : "samples, steps and events are");
    }
}

static int finish(tl_tree *self, int code) {
    tl_error error = {0};
    tl_status printed = print_summary(self, &error);
    tl_voice_stop(self->voice); /* all that the processes have said comes before what is said of them */
    self->voice = NULL;
    if (code != 0) {
        say_rest(self);
    }
    if (printed != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    printed = tl_output_finish(self->output, printed);
    close_all(self);
    return code != 0 ? code : tl_exit_code(printed);
}

int tl_tree_run(const tl_tree_settings *settings, tl_tree_end *end) {
    static tl_tree self; /* one for the process; its threads may look at it */
    tl_error error = {0};
    sigset_t asked;
    self.settings = settings;
    self.began = tl_clock_now(NULL);
    self.output = tl_output_claim();
    self.job.alone = !settings->supervised;
    self.job.unconfined = settings->unconfined;
    self.job.duration = settings->duration;
    self.job.memory_limit = settings->memory_limit;
    self.activator = (tl_live_activator){.listener = -1, .pulse = {.descriptor = -1}};
    *end = (tl_tree_end){.again = false};
    if (settings->control != NULL) {
        (void)snprintf(self.job.state, sizeof self.job.state, "%s", settings->state);
        (void)snprintf(self.job.allowed, sizeof self.job.allowed, "%s", settings->allowed);
    }
    (void)sigemptyset(&asked);
    (void)sigaddset(&asked, SIGCHLD);
    (void)sigaddset(&asked, SIGTERM);
    (void)sigaddset(&asked, SIGINT);
    (void)sigaddset(&asked, SIGHUP);
    (void)pthread_sigmask(SIG_BLOCK, &asked, NULL); /* from now on they wait for the supervisor */
    tl_status status = read_config(&self, settings->config->text, &self.config, &error);
    if (status == TL_OK) {
        status = tl_live_plant_check(&self.config, &error);
    }
    if (status == TL_OK) {
        status = open_all(&self, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        close_all(&self);
        end->is_failure = true;
        return tl_exit_code(tl_output_finish(self.output, status));
    }
    int code = finish(&self, supervise(&self));
    end->again = self.again && code == 0 && self.stopped == 0;
    end->is_failure = code != 0 && self.stopped == 0;
    return code;
}
