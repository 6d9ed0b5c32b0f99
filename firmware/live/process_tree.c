/* Process tree of a live run: see process_tree.h. */
#include "firmware/live/process_tree.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/live/child.h"
#include "firmware/live/handover_control.h"
#include "firmware/live/live_role.h"
#include "firmware/live/log_relay.h"
#include "firmware/live/saved_states.h"
#include "firmware/live/supervisor.h"
#include "firmware/live/twin_slots.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/private_folder.h"
#include "firmware/process/role.h"
#include "firmware/report/show.h"
#include "firmware/report/summary.h"
#include "firmware/retune/control.h"
#include "firmware/store/history.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_state.h"
#include "firmware/twin/twin_process.h"

/* ---- data: used by the supervisor's thread, except in put_event() ---- */

/* An explainer that runs longer is killed. */
static const tl_time EXPLAINER_LIMIT = 21600 * TL_SECOND;

typedef struct tl_process_tree {
    const tl_process_tree_settings *settings;
    tl_config config;                /* as in the processes, with the options of the command line */
    tl_live_job job;                 /* fields that are the same for all starts */
    tl_block blocks[TL_LIVE_BLOCKS]; /* they outlive each process that writes them */
    tl_twin_slot slots[TL_TWIN_SLOTS];
    tl_handover_control control;
    uint32_t twin_slot;       /* slot of the supervisor's twin; that of the run is in TL_HANDOVER */
    int listener;             /* control socket; -1: none, and no config manager */
    bool was_manager_started; /* the first config manager was started: it finishes earlier work */
    tl_saved_states states;   /* of the FMUs of the first configuration */
    bool has_reported_states; /* unusable states were reported */
    bool again;               /* start another run after this one */
    int stopped;              /* signal that asked to end; 0: none */
    bool had_twin;            /* a twin process has ended */
    tl_record_queue queue;    /* of the supervisor */
    tl_log_relay log;
    tl_follow follow;
    int32_t realtime_thread; /* thread of the live twin with real-time priority; 0: none */
    int idle_limit;          /* open file that keeps the processor from long idle states; -1: none */
    tl_child explainer;      /* pid 0: none */
    tl_heartbeats ignored;   /* of the explainer, which has none */
    uint32_t explanations;   /* number of explanations that were due at its last start */
    tl_time explained;       /* its last start */
    FILE *output;
    int standard_output; /* descriptor */
    tl_time began;
} tl_process_tree;

static inline tl_handover *handover_words(const tl_process_tree *self) {
    return self->blocks[TL_HANDOVER].bytes;
}

/* Slot of the live twin. */
static inline tl_twin_slot *live_slot(tl_process_tree *self) {
    return &self->slots[handover_words(self)->slot_index];
}

/* Slot of the supervisor's twin, or of its shadow. During a handover it may differ from that of the
 * handover block. */
static inline tl_twin_slot *member_slot(tl_process_tree *self, tl_member which) {
    return &self->slots[which == TL_MEMBER_TWIN ? self->twin_slot : 1 - self->twin_slot];
}

static inline tl_live_recorder_status *recorder_status(const tl_process_tree *self) {
    return self->blocks[TL_LIVE_RECORDER_STATUS].bytes;
}

static inline tl_live_config_manager_status *manager_status(const tl_process_tree *self) {
    return self->blocks[TL_LIVE_CONFIG_MANAGER_STATUS].bytes;
}

static inline bool is_recorded(const tl_process_tree *self) {
    return self->job.database[0] != '\0';
}

/* ---- events ---- */

static void put_event(tl_process_tree *self, tl_severity severity, const char *source, const char *text) {
    if (is_recorded(self)) {
        tl_record_queue_event(&self->queue, -1, severity, source, text);
    }
}

/* ---- refused system calls of FMUs ---- */

/* Called in the output thread of the twin process. For a shadow, only the log has it. */
static void put_refusal_of(tl_process_tree *self, uint32_t slot, const char *text) {
    if (__atomic_load_n(&handover_words(self)->slot_index, __ATOMIC_ACQUIRE) == slot) {
        put_event(self, TL_EVENT_WARNING, "twin", text);
    }
}

static void put_refusal(void *context, const char *text) {
    put_refusal_of(context, 0, text);
}

static void put_refusal_of_other(void *context, const char *text) {
    put_refusal_of(context, 1, text);
}

/* ---- starting processes ---- */

/* Starts a process without FMUs. `slot`: slot whose configuration it gets. Its output goes to a
 * pipe of the log relay. */
static pid_t start_plain(tl_process_tree *self, tl_live_kind kind, uint32_t slot, tl_error *error) {
    tl_role role = {.pid = 0};
    self->job.slot_index = slot;
    const tl_live_role_settings settings = {
        .kind = kind,
        .job = &self->job,
        .name = self->config.name,
        .path = self->settings->config->path,
        .text = self->slots[slot].text,
        .blocks = self->blocks,
        .output = tl_log_relay_pipe(&self->log, (unsigned)kind),
        .client = kind == TL_LIVE_IS_CONFIG_MANAGER ? self->listener : -1,
        .run_role = self->settings->run_role,
    };
    (void)tl_live_role_start(&settings, &role, error);
    return role.pid;
}

/* Clears the status block, except the fields that the next process needs. */
static void prepare_status(tl_live_twin_status *live_status, const tl_start *start, uint64_t unreadable) {
    live_status->unreadable = live_status->unreadable != 0 ? live_status->unreadable : unreadable;
    live_status->realtime = 0;
    live_status->begun = 0;
    live_status->resume = 0;
    live_status->start = 0;
    live_status->end.is_there = 0;
    live_status->number++;
    live_status->first += start->waits ? 1 : 0;
    live_status->holds = start->waits ? TL_LIVE_WAITS : start->hold ? TL_LIVE_HOLDS : 0;
}

/* Fills the job of a twin process. */
static tl_live_job job_of_twin(const tl_process_tree *self, const tl_twin_slot *slot, bool is_shadow,
                               const tl_start *start) {
    tl_live_job job = self->job;
    job.slot_index = (uint32_t)(slot - self->slots);
    job.number = slot->live_status->number;
    job.unconfined = slot->unconfined;
    job.is_shadow = is_shadow;
    job.start = is_shadow ? slot->start : 0;
    if (start->waits) { /* the sample memory still has all samples since then */
        job.start = slot->live_status->number == 1 ? self->states.begun : tl_clock_now(NULL);
    }
    job.started = is_shadow ? slot->started : 0;
    job.handovers = handover_words(self)->handovers;
    job.how = *start;
    return job;
}

/* A shadow also gets the configuration of the live twin, to read the recorded samples. */
static tl_status start_with_job(tl_process_tree *self, tl_twin_slot *slot, const tl_live_job *job, const char *title,
                                tl_error *error) {
    size_t live_size = 0;
    const char *of_run = job->is_shadow ? self->slots[1 - job->slot_index].text : "";
    unsigned char *live = tl_live_job_pack(job, self->settings->config->path, of_run, &live_size);
    if (live == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the job of a twin");
    }
    const tl_twin_job twin_job = {
        .task = TL_TASK_LIVE,
        .holds = job->how.hold,
        .path = self->settings->config->path,
        .text = slot->text,
        .unconfined = slot->unconfined,
        .live = live,
        .live_size = live_size,
    };
    tl_twin_process_settings settings = {
        .job = &twin_job,
        .fmus = slot->fmus,
        .which = job->slot_index,
        .title = title,
        .calls = &slot->live_status->beats.calls,
        .memory_limit = self->settings->memory_limit,
        .tasks = self->settings->tasks,
        .on_event = job->slot_index == 0 ? put_refusal : put_refusal_of_other,
        .context = self,
    };
    tl_live_blocks_pass(TL_LIVE_IS_TWIN, job, self->blocks, settings.given);
    tl_status status = tl_twin_process_start(&settings, &slot->twin, error);
    tl_live_blocks_close_passed(settings.given);
    free(live);
    return status;
}

static pid_t start_twin(tl_process_tree *self, tl_twin_slot *slot, bool is_shadow, const tl_start *start,
                        tl_error *error) {
    char title[TL_ROLE_TITLE];
    const uint64_t known = self->states.files != 0 ? self->states.files : start->unreadable;
    prepare_status(slot->live_status, start, start->waits ? 0 : known); /* keeps a value that is set */
    const tl_live_job job = job_of_twin(self, slot, is_shadow, start);
    const char *kind = start->waits  ? "twin, waits"
                       : start->hold ? "twin, safe hold"
                       : is_shadow   ? TL_LIVE_TWIN_SHADOW
                                     : TL_LIVE_TWIN;
    (void)snprintf(title, sizeof title, "%s [%s]%s", kind, self->config.name,
                   is_shadow || start->hold ? "" : TL_LIVE_TWIN_ROOM);
    tl_status status = start_with_job(self, slot, &job, title, error);
    slot->pid = status == TL_OK ? tl_twin_process_role(slot->twin)->pid : 0;
    return slot->pid;
}

/* As tl_supervisor_settings.begin; `context` is the process tree. */
static pid_t begin_member(void *context, tl_member which, const tl_start *start, tl_error *error) {
    tl_process_tree *self = context;
    pid_t pid = 0;
    switch (which) {
    case TL_MEMBER_TWIN:
        self->realtime_thread = 0;
        self->control.holds = start->hold;
        return start_twin(self, member_slot(self, which), false, start, error);
    case TL_MEMBER_SHADOW:
        pid = start_twin(self, member_slot(self, which), true, start, error);
        if (pid == 0) {
            tl_handover_control_note_end_of_shadow(&self->control, error->text);
        }
        return pid;
    case TL_MEMBER_IO:
        return start_plain(self, TL_LIVE_IS_IO, handover_words(self)->slot_index, error);
    case TL_MEMBER_CONFIG_MANAGER:
        self->was_manager_started = true;
        for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
            memcpy(self->job.hash[i], self->slots[i].hash, sizeof self->job.hash[i]);
        }
        return start_plain(self, TL_LIVE_IS_CONFIG_MANAGER, handover_words(self)->slot_index, error);
    default:
        tl_handover_control_begin_recorder(&self->control);
        self->job.handovers = self->control.recorder_handovers;
        return start_plain(self, TL_LIVE_IS_RECORDER, self->control.recorder_slot, error);
    }
}

/* ---- shared memory ---- */

static tl_status make_memory(tl_process_tree *self, tl_error *error) {
    static const struct {
        int number;
        const char *name;
        bool of_recorder; /* only if something is recorded */
        tl_block_writer writer;
    } blocks[] = {
        {TL_LIVE_SAMPLES, "twinlock samples", false, TL_BLOCK_SPARSE},
        {TL_LIVE_IO_BEATS, "twinlock io", false, TL_BLOCK_THEY_WRITE},
        {TL_LIVE_IO_EVENTS, "twinlock events", false, TL_BLOCK_THEY_WRITE},
        {TL_LIVE_CONFIG_MANAGER_EVENTS, "twinlock events", false, TL_BLOCK_THEY_WRITE},
        {TL_HANDOVER, "twinlock handover", false, TL_BLOCK_WE_WRITE},
        {TL_LIVE_CANDIDATE, "twinlock candidate", false, TL_BLOCK_SPARSE},
        {TL_LIVE_CONFIG_MANAGER_STATUS, "twinlock config manager", false, TL_BLOCK_THEY_WRITE},
        {TL_LIVE_RECORDER_STATUS, "twinlock recorder", true, TL_BLOCK_THEY_WRITE},
        {TL_LIVE_SUPERVISOR_EVENTS, "twinlock events", true, TL_BLOCK_WE_WRITE},
        {TL_LIVE_TWIN_STATUS, "twinlock twin", false, TL_BLOCK_THEY_WRITE},
        {TL_LIVE_TWIN_STATUS + 1, "twinlock twin", false, TL_BLOCK_THEY_WRITE},
        {TL_LIVE_TUNING, "twinlock tuning", false, TL_BLOCK_SPARSE},
        {TL_LIVE_TUNING + 1, "twinlock tuning", false, TL_BLOCK_SPARSE},
        {TL_LIVE_RESUME, "twinlock resume", true, TL_BLOCK_SPARSE},
        {TL_LIVE_RESUME + 1, "twinlock resume", true, TL_BLOCK_SPARSE},
    };
    const bool records = is_recorded(self);
    tl_config first = *self->settings->config; /* the configuration of the first twin */
    size_t sizes[TL_LIVE_BLOCKS];
    tl_status status = TL_OK;
    tl_config_use_lookups(&first); /* with all look-ups as signals */
    tl_live_block_sizes(&self->config, sizes);
    for (size_t i = 0; i < sizeof blocks / sizeof blocks[0] && status == TL_OK; i++) {
        tl_block *block = &self->blocks[blocks[i].number];
        const size_t size = sizes[blocks[i].number];
        if (records || !blocks[i].of_recorder) {
            status = tl_block_make(blocks[i].name, size, blocks[i].writer, block, error);
        }
    }
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) { /* allocated with a configuration */
        self->slots[i].live_status = self->blocks[TL_LIVE_TWIN_STATUS + i].bytes;
        self->slots[i].queue = &self->blocks[TL_LIVE_QUEUE + i];
    }
    if (status == TL_OK) {
        status = tl_twin_slot_load(&self->slots[0], &first, self->settings->unconfined, error);
    }
    if (status == TL_OK && records) {
        const tl_record_queue_settings events = tl_live_event_queue();
        tl_record_queue_open(&events, self->blocks[TL_LIVE_SUPERVISOR_EVENTS].bytes,
                             &recorder_status(self)->state.taken[TL_LIVE_QUEUE_SUPERVISOR], &self->queue);
    }
    return status;
}

/* ---- ending ---- */

static uint64_t end_twin(tl_process_tree *self, tl_twin_slot *slot, bool by_others, char reason[TL_RESTARTS_REASON]) {
    char why[TL_TWIN_KILLED_TEXT];
    bool was_killed = tl_twin_process_was_killed(slot->twin, why);
    if (was_killed) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "%.*s", TL_RESTARTS_REASON - 1, why);
    }
    tl_twin_process_let_go(slot->twin);
    tl_log_relay_close_process(&self->log, slot->twin);
    slot->twin = NULL;
    slot->pid = 0;
    /* A checkpoint that it had loaded may be the cause. */
    bool is_to_blame = slot->live_status->loads != 0 && (!by_others || was_killed) && slot->live_status->fmus != 0;
    slot->live_status->unreadable = is_to_blame ? slot->live_status->fmus : slot->live_status->unreadable;
    return is_to_blame ? slot->live_status->fmus : 0;
}

/* A shadow that failed has published the reason. It is bounded here, and the reader cleans it. */
static void note_end_of_shadow(tl_process_tree *self, const tl_heartbeats *beats, const char *reason) {
    char published[TL_HEARTBEAT_STATUS] = "";
    int code = 0;
    tl_end_cause end_cause = tl_heartbeats_get_end_cause(beats, &code);
    bool is_published = (end_cause == TL_END_CAUSE_REFUSED || end_cause == TL_END_CAUSE_FAILED) &&
                        tl_heartbeats_get_status(beats, published);
    published[sizeof published - 1] = '\0';
    tl_handover_control_note_end_of_shadow(&self->control, is_published && published[0] != '\0' ? published : reason);
}

static uint64_t note_end(void *context, tl_member which, bool by_others, char reason[TL_RESTARTS_REASON]) {
    tl_process_tree *self = context;
    uint64_t unreadable = 0;
    if (which == TL_MEMBER_TWIN || which == TL_MEMBER_SHADOW) {
        unreadable = end_twin(self, member_slot(self, which), by_others, reason);
    }
    if (which == TL_MEMBER_TWIN) {
        char why[TL_HANDOVER_WHY] = "";
        self->had_twin = true;
        (void)snprintf(why, sizeof why, "%.*s", TL_HANDOVER_WHY - 1, reason);
        tl_latest_publish(&handover_words(self)->failure, why, sizeof why);
    }
    if (which == TL_MEMBER_SHADOW) {
        note_end_of_shadow(self, &member_slot(self, which)->live_status->beats, reason);
    }
    return unreadable;
}

static void put_failure(void *context, const char *text) {
    put_event(context, TL_EVENT_ERROR, "supervisor", text);
}

/* ---- main loop ---- */

/* Accepts only a thread of that process, because the number comes from a process with FMUs. */
static void set_priority(pid_t process, int32_t thread, int priority) {
    const struct sched_param parameter = {.sched_priority = priority};
    char path[64];
    struct stat about;
    (void)snprintf(path, sizeof path, "/proc/%ld/task/%ld", (long)process, (long)thread);
    if (thread > 0 && stat(path, &about) == 0) {
        (void)sched_setscheduler(thread, priority > 0 ? SCHED_FIFO | SCHED_RESET_ON_FORK : SCHED_OTHER, &parameter);
    }
}

/* The cycle of the twin requests or returns its priority, because a process with FMUs cannot set
 * one. */
static void update_priority(tl_process_tree *self) {
    const tl_twin_slot *slot = live_slot(self);
    int32_t wanted = __atomic_load_n(&slot->live_status->realtime, __ATOMIC_ACQUIRE);
    if (slot->pid != 0 && wanted != self->realtime_thread) {
        set_priority(slot->pid, self->realtime_thread, 0);
        set_priority(slot->pid, wanted, self->config.realtime_priority);
        self->realtime_thread = wanted;
    }
}

/* Starts an explainer if one is due and none runs. At the end of the run it is killed: it stores
 * only its complete answer. */
static void update_explainer(tl_process_tree *self, bool ends) {
    tl_child *explainer = &self->explainer;
    tl_error error;
    const uint32_t due =
        is_recorded(self) ? __atomic_load_n(&recorder_status(self)->explanations, __ATOMIC_ACQUIRE) : 0;
    const tl_time now = tl_clock_now(NULL);
    if (explainer->pid != 0 && tl_child_has_ended(explainer)) {
        tl_child_reap(explainer);
    } else if (explainer->pid != 0 && ends) {
        tl_child_kill(explainer, INT64_MAX, "killed: the run ends");
    } else if (explainer->pid != 0 && now - self->explained > EXPLAINER_LIMIT && !explainer->killed) {
        tl_child_kill(explainer, INT64_MAX, "killed: it takes too long");
        tl_log(TL_LOG_NOTICE, "finding %" PRIu32 " is not explained: that takes longer than %.0f h", self->job.finding,
               tl_seconds(EXPLAINER_LIMIT) / 3600.0);
    } else if (explainer->pid == 0 && !ends && due != self->explanations && tl_reaper_is_idle(&explainer->reaper)) {
        self->explanations = due;
        self->explained = now;
        self->job.finding = __atomic_load_n(&recorder_status(self)->due_finding, __ATOMIC_RELAXED);
        explainer->beats = &self->ignored;
        tl_child_prepare(explainer);
        explainer->pid = start_plain(self, TL_LIVE_IS_EXPLAINER, handover_words(self)->slot_index, &error);
        if (explainer->pid == 0) {
            tl_log(TL_LOG_NOTICE, "the finding is not explained: %s", error.text);
        }
    }
}

static void report_handover(void *context, const char *text) {
    tl_log(TL_LOG_NOTICE, "%s", text);
    put_event(context, TL_EVENT_INFO, "supervisor", text);
}

static void poll_orders(void *context, bool ends, tl_orders *orders) {
    tl_process_tree *self = context;
    const tl_twin_slot *before = live_slot(self);
    tl_handover_control_poll(&self->control, tl_clock_now(NULL), ends, orders);
    if (orders->swap) {                                      /* at the end, the supervisor ignores it */
        set_priority(before->pid, self->realtime_thread, 0); /* a shadow has no real-time priority */
        self->realtime_thread = 0;
        tl_log_relay_watch(&self->log, &live_slot(self)->live_status->beats);
        self->twin_slot = ends ? self->twin_slot : handover_words(self)->slot_index;
    }
    if (ends) {
        tl_saved_states_stop(&self->states);
    }
    update_priority(self);
    update_explainer(self, ends);
    orders->end = __atomic_load_n(&manager_status(self)->restart, __ATOMIC_ACQUIRE) != 0;
    orders->config_manager =
        self->listener >= 0 && (!self->was_manager_started || tl_control_has_connection(self->listener));
    if (orders->end && !ends) {
        self->again = true;
        __atomic_store_n(&handover_words(self)->again, 1, __ATOMIC_RELEASE);
    }
}

static tl_wait wait_for_states(void *context) {
    tl_process_tree *self = context;
    tl_wait wait = tl_saved_states_check(&self->states);
    if (self->states.files != 0 && !self->has_reported_states) {
        char text[TL_EVENT_TEXT]; /* shorter than a line of the log */
        tl_log(TL_LOG_WARNING, "%s: no checkpoints are saved; a restarted twin repeats recorded inputs instead",
               self->states.why);
        (void)snprintf(text, sizeof text, "%.190s: no checkpoints are saved", self->states.why);
        put_event(self, TL_EVENT_WARNING, "supervisor", text);
        self->has_reported_states = true;
    }
    return wait;
}

/* Reported by the recorder, for the queues that it reads. */
static tl_time damage_time(void *context, tl_member which) {
    const tl_process_tree *self = context;
    size_t queue = which == TL_MEMBER_IO ? TL_LIVE_QUEUE_IO : TL_LIVE_QUEUE_TWIN + self->twin_slot;
    bool is_read = is_recorded(self) && (which == TL_MEMBER_IO || which == TL_MEMBER_TWIN);
    return is_read ? __atomic_load_n(&recorder_status(self)->damaged[queue], __ATOMIC_RELAXED) : 0;
}

/* ---- the run ---- */

/* A processor leaves a deep idle state only after some 100 µs, and so delays each tick. The limit
 * holds while the file is open (Linux, PM QoS interface). It permits the idle states that are left
 * faster, so that a box without a fan stays cool. */
static void limit_idle_states(tl_process_tree *self) {
    const int32_t most = 10; /* µs */
    char text[160];
    if (self->config.realtime_priority <= 0) {
        return;
    }
    self->idle_limit = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    if (self->idle_limit >= 0 && write(self->idle_limit, &most, sizeof most) == (ssize_t)sizeof most) {
        (void)snprintf(text, sizeof text, "idle states: limited to %d µs for the run", (int)most);
    } else {
        (void)snprintf(text, sizeof text, "idle states: not limited (/dev/cpu_dma_latency: %s); ticks may begin later",
                       strerror(errno));
    }
    put_event(self, TL_EVENT_INFO, "processor", text);
}

static tl_status open_all(tl_process_tree *self, tl_error *error) {
    const tl_process_tree_settings *settings = self->settings;
    tl_error ignored;
    if (settings->database != NULL) {
        (void)snprintf(self->job.database, sizeof self->job.database, "%s", settings->database);
    } else if (self->config.record_file != NULL) {
        (void)tl_config_file_path(&self->config, self->config.record_file, self->job.database,
                                  sizeof self->job.database);
    }
    self->states = (tl_saved_states){.config = settings->config,
                                     .unconfined = settings->unconfined,
                                     .memory_limit = settings->memory_limit,
                                     .run_role = settings->run_role};
    /* Without a restart record the result would not be saved. */
    tl_saved_states_open(settings->supervised ? settings->state : NULL, &self->states);
    tl_status status = make_memory(self, error);
    if (status == TL_OK && settings->control != NULL &&
        tl_control_listen(settings->control, &self->listener, &ignored) != TL_OK) { /* not fatal */
        tl_log(TL_LOG_ERROR, "%s; the run continues, but its configuration cannot be changed before a restart",
               ignored.text);
    }
    if (status == TL_OK) {
        limit_idle_states(self);
        self->control = (tl_handover_control){.handover_block = handover_words(self),
                                              .slots = self->slots,
                                              .orders = manager_status(self),
                                              .candidate = &self->blocks[TL_LIVE_CANDIDATE],
                                              .recorder = is_recorded(self) ? recorder_status(self) : NULL,
                                              .step = self->config.step,
                                              .unconfined = settings->unconfined,
                                              .context = self,
                                              .report = report_handover};
        tl_log(TL_LOG_NOTICE, "%s", settings->running);
        put_event(self, TL_EVENT_INFO, "retune", settings->running);
        self->follow = (tl_follow){.output = self->standard_output,
                                   .host = {.twins = {self->slots[0].live_status, self->slots[1].live_status},
                                            .recorder = self->control.recorder,
                                            .handover_block = self->control.handover_block,
                                            .step = self->config.step}};
        self->output = settings->follow ? stderr : self->output; /* of the summary */
        status = tl_log_relay_start(&self->log, &live_slot(self)->live_status->beats, settings->status,
                                    settings->follow ? &self->follow : NULL, error);
    }
    return status;
}

/* Reads the configuration of the last live twin. Parsing untrusted text is safe now, because the
 * run is over. */
static tl_status read_last_config(tl_process_tree *self, tl_error *error) {
    const char *text = live_slot(self)->text;
    if (text == self->settings->config->text) {
        return TL_OK;
    }
    tl_config_free(&self->config);
    self->config = (tl_config){.path = NULL};
    return tl_live_job_read(&self->job, self->settings->config->path, text, &self->config, error);
}

/* Checks the required lock. A run that a signal has ended before its first window is not judged,
 * nor is one that starts again. `summary`: NULL if the run has ended without a twin. */
static tl_status require_lock(const tl_process_tree *self, const tl_summary *summary, tl_error *error) {
    bool is_judged = self->stopped == 0 || (summary != NULL ? summary->lock.windows != 0 : self->had_twin);
    double percent = self->settings->require_lock;
    if (percent <= 0.0 && (!is_judged || self->again || self->config.adjust_count == 0)) {
        return TL_OK;
    }
    return summary != NULL ? tl_summary_require_lock(summary, &self->config, percent, error)
                           : tl_fail(error, TL_NOT_LOCKED, "not in lock: the run ended without a twin");
}

/* Prints the summary, with what the recorder has found if its database can be read. */
static tl_status print_with_changes(const tl_process_tree *self, const tl_summary *summary, const tl_account *account,
                                    tl_error *error) {
    const tl_recorder_mark *mark = is_recorded(self) ? tl_recorder_state_mark(&recorder_status(self)->state) : NULL;
    tl_show_request request = {.path = mark != NULL ? mark->path : ""};
    tl_run_finding rows[TL_SHOW_FINDINGS];
    tl_run_changes changes = {.finding = rows};
    tl_show_changes all = {.finding = NULL};
    tl_error ignored;
    tl_status found =
        mark != NULL && mark->run != 0 ? tl_history_open(mark->path, &request.history, &ignored) : TL_BAD_DATA;
    found = found == TL_OK ? tl_history_find(request.history, mark->run, &request.run, &ignored) : found;
    found = found == TL_OK ? tl_show_read_changes(&request, &all, &ignored) : found;
    if (found == TL_OK) {
        tl_show_changes_of_run(&all, request.run->run, rows, &changes);
    }
    const tl_run_changes *known = found == TL_OK && all.is_watched ? &changes : NULL;
    tl_status status = TL_OK;
    if (self->settings->json) {
        status = tl_summary_print_json(summary, &self->config, account, known, self->output, error);
    } else {
        tl_summary_print_table(summary, &self->config, account, known, self->settings->verbose, self->output);
    }
    tl_history_close(request.history);
    return status;
}

/* Prints the summary that the twin has left, and checks the lock. `code`: exit code so far. */
static tl_status print_summary(tl_process_tree *self, int code, tl_error *error) {
    tl_live_end *end = &live_slot(self)->live_status->end;
    tl_summary summary = end->summary;
    tl_account account = end->account;
    if (end->is_there == 0) {
        return code == 0 || self->settings->require_lock > 0.0 ? require_lock(self, NULL, error) : TL_OK;
    }
    tl_status status = read_last_config(self, error);
    if (status != TL_OK) {
        return status;
    }
    summary.wall_s = tl_seconds(tl_clock_now(NULL) - self->began);
    if (!tl_run_end_is_sound(&summary, &account, &self->config)) {
        return tl_fail(error, TL_FMU_FAILED, "no valid run summary: the FMU process corrupted it");
    }
    status = print_with_changes(self, &summary, &account, error);
    return status == TL_OK ? require_lock(self, &summary, error) : status;
}

static int run_members(tl_process_tree *self) {
    const tl_supervisor_settings settings = {
        .unsupervised = !self->settings->supervised,
        .call_limit = self->settings->call_limit,
        .has_duration = self->config.duration > 0,
        .state = self->settings->state,
        .watchdog = self->settings->watchdog,
        .watchdog_s = self->settings->watchdog_s,
        .beats = {[TL_MEMBER_RECORDER] = is_recorded(self) ? &recorder_status(self)->beats : NULL,
                  [TL_MEMBER_IO] = self->blocks[TL_LIVE_IO_BEATS].bytes,
                  [TL_MEMBER_TWIN] = &self->slots[0].live_status->beats,
                  [TL_MEMBER_SHADOW] = &self->slots[1].live_status->beats,
                  [TL_MEMBER_CONFIG_MANAGER] = &manager_status(self)->beats},
        .context = self,
        .begin = begin_member,
        .ended = note_end,
        .report = put_failure,
        .damaged = damage_time,
        .wait = wait_for_states,
        .read_orders = poll_orders,
    };
    return tl_supervise(&settings, &self->stopped);
}

static void close_all(tl_process_tree *self) {
    (void)dup2(self->standard_output, STDOUT_FILENO); /* for the next run, if there is one */
    if (self->idle_limit >= 0) {
        (void)close(self->idle_limit);
    }
    tl_log_relay_stop(&self->log);
    tl_saved_states_stop(&self->states);
    if (self->explainer.killed) {
        tl_private_folder_sweep("twin"); /* it could not remove its folders */
    }
    tl_reaper_stop(&self->explainer.reaper);
    if (self->listener >= 0) {
        (void)close(self->listener);
        (void)unlink(self->settings->control);
    }
    for (size_t i = 0; i < TL_TWIN_SLOTS && self->slots[i].queue != NULL; i++) {
        tl_twin_slot_unload(&self->slots[i]);
    }
    for (size_t i = 0; i < TL_LIVE_BLOCKS; i++) {
        tl_block_close(&self->blocks[i]);
    }
    tl_config_free(&self->config);
}

/* Reports data that was not recorded, unless the last recorder has announced its end and so has
 * reported that. */
static void report_lost(tl_process_tree *self) {
    const tl_record_queue_settings events = tl_live_event_queue();
    int code = 0;
    if (!is_recorded(self) || tl_heartbeats_get_end_cause(&recorder_status(self)->beats, &code) != TL_END_CAUSE_NONE) {
        return;
    }
    const tl_record_queue_taken *taken = recorder_status(self)->state.taken;
    uint64_t rest = 0;
    for (uint32_t i = 0; i < TL_TWIN_SLOTS; i++) {
        rest += tl_twin_slot_count_remaining(&self->slots[i], &taken[TL_LIVE_QUEUE_TWIN + i]);
    }
    rest += tl_record_queue_count_remaining(&events, self->blocks[TL_LIVE_IO_EVENTS].bytes, &taken[TL_LIVE_QUEUE_IO]);
    rest += tl_record_queue_count_remaining(&events, self->blocks[TL_LIVE_SUPERVISOR_EVENTS].bytes,
                                            &taken[TL_LIVE_QUEUE_SUPERVISOR]);
    if (rest > 0) {
        tl_log(TL_LOG_ERROR, "%" PRIu64 " %s lost: the recorder failed before it had written all", rest,
               rest == 1 ? "sample, step or event is" : "samples, steps and events are");
    }
}

static int finish_run(tl_process_tree *self, int code) {
    tl_error error = {0};
    tl_status printed = print_summary(self, code, &error);
    tl_log_relay_stop(&self->log); /* first all output of the processes */
    if (code != 0) {
        report_lost(self);
    }
    if (printed != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    printed = tl_output_finish(self->output, printed);
    close_all(self);
    return code != 0 ? code : tl_exit_code(printed);
}

int tl_process_tree_run(const tl_process_tree_settings *settings, tl_process_tree_end *end) {
    static tl_process_tree self; /* one per process; its threads may access it */
    tl_error error = {0};
    sigset_t asked;
    self.settings = settings;
    self.began = tl_clock_now(NULL);
    self.output = tl_output_claim();
    self.standard_output = fileno(self.output);
    self.job.unsupervised = !settings->supervised;
    self.job.unconfined = settings->unconfined;
    self.job.duration = settings->duration;
    self.job.memory_limit = settings->memory_limit;
    self.listener = -1;
    self.idle_limit = -1;
    *end = (tl_process_tree_end){.again = false};
    if (settings->control != NULL) {
        (void)snprintf(self.job.state, sizeof self.job.state, "%s", settings->state);
        (void)snprintf(self.job.allowed, sizeof self.job.allowed, "%s", settings->allowed);
    }
    tl_supervisor_block_signals(&asked, NULL); /* pending until the supervisor reads them */
    tl_status status =                         /* block sizes depend on it */
        tl_live_job_read(&self.job, settings->config->path, settings->config->text, &self.config, &error);
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
    int code = finish_run(&self, run_members(&self));
    end->again = self.again && code == 0 && self.stopped == 0;
    end->is_failure = code != 0 && self.stopped == 0;
    return code;
}
