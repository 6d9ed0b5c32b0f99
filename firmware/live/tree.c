/* The tree: see tree.h. */
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

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/config/problems.h"
#include "firmware/live/live_activator.h"
#include "firmware/live/live_end.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_wire.h"
#include "firmware/live/voice.h"
#include "firmware/outbox/outbox_rest.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/role.h"
#include "firmware/supervise/supervisor.h"
#include "firmware/text/output.h"
#include "firmware/twin/twin_process.h"

/* All shared memory of the run. It outlives each process that writes it. */
typedef struct memory {
    tl_block mail;
    tl_block io_pulse;
    tl_block twin_pulse;
    tl_block twin_outbox;
    tl_block recorder_pulse;
    tl_block past;
    tl_block tuning;     /* of the activator */
    tl_block supervisor; /* an outbox of ours */
} memory;

typedef struct tree {
    const tl_tree_settings *settings;
    tl_config config; /* as the processes have it, with what the command line changes */
    tl_live_job job;  /* what does not change from start to start */
    memory memory;
    tl_live_activator activator;
    bool again;       /* the run is to begin anew */
    int stopped;      /* by this signal; 0: by none */
    tl_outbox outbox; /* of the supervisor */
    tl_voice *voice;
    tl_twin_process *twin; /* NULL: none */
    int32_t urgent;        /* its thread that has the priority; 0: none */
    FILE *output;
    tl_time began;
    tl_twin_job twin_job; /* of the twin that lives */
    tl_twin_process_settings twin_settings;
} tree;

/* ---- shared memory ---- */

static tl_live_twin_pulse *twin_pulse(const tree *self) {
    return self->memory.twin_pulse.bytes;
}

static tl_live_recorder_pulse *recorder_pulse(const tree *self) {
    return self->memory.recorder_pulse.bytes;
}

static bool records(const tree *self) {
    return self->job.database[0] != '\0';
}

static tl_status make_recorder_memory(tree *self, tl_error *error) {
    const tl_outbox_settings events = tl_live_event_outbox();
    memory *made = &self->memory;
    if (!records(self)) {
        return TL_OK;
    }
    tl_status status = tl_block_make("twinlock recorder", sizeof(tl_live_recorder_pulse), TL_BLOCK_THEY_WRITE,
                                     &made->recorder_pulse, error);
    if (status == TL_OK) {
        status = tl_block_make_sparse("twinlock past", TL_LIVE_PAST_BYTES, &made->past, error);
    }
    if (status == TL_OK) {
        status =
            tl_block_make("twinlock events", tl_outbox_bytes(&events), TL_BLOCK_WE_WRITE, &made->supervisor, error);
    }
    if (status == TL_OK) {
        tl_outbox_open(&events, made->supervisor.bytes, &recorder_pulse(self)->state.taken[TL_LIVE_OUTBOX_SUPERVISOR],
                       &self->outbox);
    }
    return status;
}

static tl_status make_memory(tree *self, tl_error *error) {
    const tl_outbox_settings outbox = tl_live_twin_outbox(&self->config);
    tl_plant_mail_shape shape;
    memory *made = &self->memory;
    tl_plant_mail_shape_of(&self->config, &shape);
    tl_status status = tl_block_make_sparse("twinlock mail", tl_live_mail_bytes(&shape), &made->mail, error);
    if (status == TL_OK) {
        status = tl_block_make("twinlock io", tl_live_io_bytes(), TL_BLOCK_THEY_WRITE, &made->io_pulse, error);
    }
    if (status == TL_OK) {
        status =
            tl_block_make("twinlock twin", sizeof(tl_live_twin_pulse), TL_BLOCK_THEY_WRITE, &made->twin_pulse, error);
    }
    if (status == TL_OK) {
        status = tl_block_make_sparse("twinlock outbox", tl_outbox_bytes(&outbox), &made->twin_outbox, error);
    }
    if (status == TL_OK) {
        status = tl_block_make_sparse("twinlock tuning", sizeof(tl_live_tuning), &made->tuning, error);
    }
    return status == TL_OK ? make_recorder_memory(self, error) : status;
}

static void free_memory(memory *made) {
    tl_block *const blocks[] = {&made->mail,           &made->io_pulse, &made->twin_pulse, &made->twin_outbox,
                                &made->recorder_pulse, &made->past,     &made->tuning,     &made->supervisor};
    for (size_t i = 0; i < sizeof blocks / sizeof blocks[0]; i++) {
        tl_block_close(blocks[i]);
    }
}

/* ---- events ---- */

/* For the database; on the log it is already. */
static void put_event(tree *self, tl_severity severity, const char *source, const char *text) {
    if (records(self)) {
        tl_outbox_event(&self->outbox, -1, severity, source, text);
    }
}

static void hear_refusal(void *context, const char *text) {
    put_event(context, TL_EVENT_WARNING, "twin", text);
}

/* ---- starting ---- */

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

static int be_forked(const char *title, void *context) {
    const tree *self = context;
    return self->settings->be(title, context);
}

/* io, or the recorder: with a job, and a pipe for what it prints. */
static pid_t start_plain(tree *self, const char *kind, unsigned ear, gift *made, tl_error *error) {
    char title[TL_ROLE_TITLE];
    tl_block job = {.descriptor = -1};
    tl_role role = {.pid = 0};
    int output[2] = {-1, -1};
    (void)snprintf(title, sizeof title, "%s [%s]", kind, self->config.name);
    tl_status status = tl_live_job_make(&self->job, self->settings->config, &job, error);
    made->given[0] = open("/dev/null", O_RDWR | O_CLOEXEC);
    if (status == TL_OK && (made->given[0] < 0 || pipe2(output, O_CLOEXEC) != 0)) {
        status = tl_fail(error, TL_TRY_AGAIN, "no pipe for \"%s\": %s", title, strerror(errno));
    }
    if (status == TL_OK) {
        tl_role_settings settings = {.title = title, .fallback = be_forked, .context = self};
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

static pid_t start_io(tree *self, tl_error *error) {
    gift made = no_gift();
    give(&made, TL_LIVE_MAIL, &self->memory.mail);
    give(&made, TL_LIVE_OWN_PULSE, &self->memory.io_pulse);
    give_to_read(&made, TL_LIVE_RECORDER_PULSE, &self->memory.recorder_pulse);
    pid_t pid = start_plain(self, TL_LIVE_IO, 0, &made, error);
    take_back(&made);
    return pid;
}

static pid_t start_recorder(tree *self, tl_error *error) {
    gift made = no_gift();
    give(&made, TL_LIVE_OWN_PULSE, &self->memory.recorder_pulse);
    give(&made, TL_LIVE_PAST, &self->memory.past);
    give_to_read(&made, TL_LIVE_TWIN_PULSE_READ, &self->memory.twin_pulse);
    give_to_read(&made, TL_LIVE_TWIN_OUTBOX, &self->memory.twin_outbox);
    give_to_read(&made, TL_LIVE_IO_PULSE_READ, &self->memory.io_pulse);
    give_to_read(&made, TL_LIVE_SUPERVISOR_READ, &self->memory.supervisor);
    give_to_read(&made, TL_LIVE_ACTIVATOR_READ, &self->activator.pulse);
    give_to_read(&made, TL_LIVE_TUNING, &self->memory.tuning);
    pid_t pid = start_plain(self, TL_LIVE_RECORDER, 1, &made, error);
    take_back(&made);
    return pid;
}

static pid_t start_activator(void *context) {
    tree *self = context;
    tl_error error = {0};
    gift made = no_gift();
    made.given[TL_LIVE_KNOCKER] = fcntl(self->activator.listener, F_DUPFD_CLOEXEC, 0);
    give(&made, TL_LIVE_OWN_PULSE, &self->activator.pulse);
    give(&made, TL_LIVE_TUNING, &self->memory.tuning);
    give_to_read(&made, TL_LIVE_ACTIVATOR_TWIN, &self->memory.twin_pulse);
    give_to_read(&made, TL_LIVE_RECORDER_PULSE, &self->memory.recorder_pulse);
    pid_t pid = start_plain(self, TL_LIVE_ACTIVATOR, 2, &made, &error);
    take_back(&made);
    if (pid == 0) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return pid;
}

/* Nothing of the one before is left but what its successor goes on with. */
static void prepare_twin(tree *self, const tl_start *start) {
    tl_live_twin_pulse *pulse = twin_pulse(self);
    pulse->realtime = 0;
    pulse->begun = 0;
    pulse->past = 0;
    pulse->end.is_there = 0;
    self->urgent = 0;
    self->job.number++;
    self->job.again = start->again;
    self->job.holds = start->hold;
    pulse->number = self->job.number;
    pulse->holds = start->hold ? 1 : 0;
    self->job.starts = start->restarts->starts;
    self->job.restarts = start->restarts->restarts;
    self->job.failures = start->restarts->failures;
    memcpy(self->job.reason, start->restarts->reason, sizeof self->job.reason);
}

static pid_t start_twin(tree *self, const tl_start *start, tl_error *error) {
    char title[TL_ROLE_TITLE];
    gift made = no_gift();
    prepare_twin(self, start);
    (void)snprintf(title, sizeof title, "%s [%s]", start->hold ? "twin, safe hold" : "twin", self->config.name);
    give_to_read(&made, TL_LIVE_MAIL, &self->memory.mail);
    give_to_read(&made, TL_LIVE_RECORDER_PULSE, &self->memory.recorder_pulse);
    give_to_read(&made, TL_LIVE_PAST, &self->memory.past);
    give_to_read(&made, TL_LIVE_TUNING, &self->memory.tuning);
    give(&made, TL_LIVE_OWN_PULSE, &self->memory.twin_pulse);
    give(&made, TL_LIVE_TWIN_OUTBOX, &self->memory.twin_outbox);
    self->twin_job = (tl_twin_job){
        .task = TL_TASK_LIVE,
        .holds = start->hold,
        .path = self->settings->config->path,
        .text = self->settings->config->text,
        .unconfined = self->settings->unconfined,
        .live = (const unsigned char *)&self->job,
        .live_size = sizeof self->job,
    };
    self->twin_settings = (tl_twin_process_settings){
        .job = &self->twin_job,
        .config = &self->config,
        .title = title,
        .calls = tl_heartbeats_calls(&twin_pulse(self)->beats),
        .memory_limit = self->settings->memory_limit,
        .tasks = self->settings->tasks,
        .hear = hear_refusal,
        .context = self,
    };
    memcpy(self->twin_settings.given, made.given, sizeof made.given);
    tl_status status = tl_twin_process_start(&self->twin_settings, &self->twin, error);
    take_back(&made);
    return status == TL_OK ? tl_twin_process_id(self->twin) : 0;
}

static pid_t begin(void *context, tl_member which, const tl_start *start) {
    tree *self = context;
    tl_error error = {0};
    pid_t pid = which == TL_MEMBER_TWIN ? start_twin(self, start, &error)
                : which == TL_MEMBER_IO ? start_io(self, &error)
                                        : start_recorder(self, &error);
    if (pid == 0) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return pid;
}

/* ---- ending ---- */

static void end_twin(tree *self, char reason[TL_RESTARTS_REASON]) {
    char why[TL_TWIN_WARDEN_TEXT];
    if (tl_twin_process_was_killed(self->twin, why)) {
        (void)snprintf(reason, TL_RESTARTS_REASON, "%.*s", TL_RESTARTS_REASON - 1, why);
    }
    tl_twin_process_let_go(self->twin);
    tl_voice_clear(self->voice, self->twin);
    self->twin = NULL;
}

static void ended(void *context, tl_member which, char reason[TL_RESTARTS_REASON]) {
    if (which == TL_MEMBER_TWIN) {
        end_twin(context, reason);
    }
}

static void tell(void *context, const char *text) {
    put_event(context, TL_EVENT_ERROR, "supervisor", text);
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

/* The twin's cycle wants its priority, or does not any more: no thread beside FMUs can set one itself. */
static void look_at_priority(tree *self) {
    int32_t wished = __atomic_load_n(&twin_pulse(self)->realtime, __ATOMIC_ACQUIRE);
    if (self->twin == NULL || wished == self->urgent) {
        return;
    }
    pid_t process = tl_twin_process_id(self->twin);
    if (is_thread_of(process, self->urgent)) {
        schedule(self->urgent, 0);
    }
    if (is_thread_of(process, wished)) {
        schedule(wished, self->config.realtime_priority);
    }
    self->urgent = wished;
}

static void tell_of_activator(void *context, const char *reason) {
    char text[TL_RESTARTS_REASON + 64];
    (void)snprintf(text, sizeof text, "the activator failed: %s; another one is begun", reason);
    tl_log(TL_LOG_ERROR, "%s", text);
    put_event(context, TL_EVENT_ERROR, "supervisor", text);
}

static bool look(void *context, bool ends) {
    tree *self = context;
    const tl_live_activator_host host = {.context = self, .begin = start_activator, .tell = tell_of_activator};
    look_at_priority(self);
    bool again = tl_live_activator_look(&self->activator, &host, ends);
    self->again = self->again || (again && !ends);
    return again;
}

/* The recorder's word. */
static tl_time damaged(void *context, tl_member which) {
    static const size_t outbox_of[TL_MEMBERS] = {
        [TL_MEMBER_TWIN] = TL_LIVE_OUTBOX_TWIN, [TL_MEMBER_IO] = TL_LIVE_OUTBOX_IO};
    const tree *self = context;
    bool is_read = records(self) && which != TL_MEMBER_RECORDER;
    return is_read ? __atomic_load_n(&recorder_pulse(self)->damaged[outbox_of[which]], __ATOMIC_RELAXED) : 0;
}

/* ---- the run ---- */

static void find_database(tree *self) {
    const tl_config *config = &self->config;
    if (self->settings->database != NULL) {
        (void)snprintf(self->job.database, sizeof self->job.database, "%s", self->settings->database);
    } else if (config->record_file != NULL) {
        (void)tl_config_file_path(config, config->record_file, self->job.database, sizeof self->job.database);
    }
}

static tl_status open_all(tree *self, tl_error *error) {
    find_database(self);
    tl_status status = make_memory(self, error);
    const tl_voice_settings voice = {.status = self->settings->status};
    if (status == TL_OK) {
        status = tl_live_activator_open(&self->activator, self->settings->control, error);
    }
    if (status == TL_OK) {
        tl_voice_settings settings = voice;
        settings.beats = &twin_pulse(self)->beats;
        status = tl_voice_start(&settings, &self->voice, error);
    }
    return status;
}

/* What the twin says of its run, as far as it can be; and whether that is what was wanted of it. */
static tl_status print_summary(tree *self, tl_error *error) {
    tl_live_end *end = &twin_pulse(self)->end;
    tl_summary summary = end->summary;
    tl_account account = end->account;
    if (end->is_there == 0) {
        return self->settings->require_lock <= 0.0
                   ? TL_OK
                   : tl_fail(error, TL_NOT_LOCKED, "the run ended without a twin: it was not in lock");
    }
    summary.wall_s = tl_seconds(tl_clock_now(NULL) - self->began);
    if (!tl_live_end_is_sound(&summary, &account, &self->config)) {
        return tl_fail(error, TL_FMU_FAILED,
                       "the summary of the run is none: the process of the FMUs has destroyed it");
    }
    tl_status status = TL_OK;
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

static int supervise(tree *self) {
    const tl_supervisor_settings settings = {
        .alone = !self->settings->supervised,
        .state = self->settings->state,
        .watchdog = self->settings->watchdog,
        .watchdog_s = self->settings->watchdog_s,
        .beats = {[TL_MEMBER_RECORDER] = records(self) ? &recorder_pulse(self)->beats : NULL,
                  [TL_MEMBER_IO] = &((tl_live_io_pulse *)self->memory.io_pulse.bytes)->beats,
                  [TL_MEMBER_TWIN] = &twin_pulse(self)->beats},
        .context = self,
        .begin = begin,
        .ended = ended,
        .tell = tell,
        .damaged = damaged,
        .look = look,
    };
    return tl_supervise(&settings, &self->stopped);
}

static void close_all(tree *self) {
    tl_voice_stop(self->voice);
    tl_live_activator_close(&self->activator, self->settings->control);
    free_memory(&self->memory);
    tl_config_free(&self->config);
}

/* What the processes read, we read too: sizes of what is shared follow from it. */
static tl_status read_config(tree *self, tl_error *error) {
    const tl_config *config = self->settings->config;
    tl_problems problems;
    tl_problems_init(&problems, config->path);
    tl_status status =
        tl_config_read_text(config->path, config->text, strlen(config->text), &self->config, &problems.report);
    if (status != TL_OK) {
        return tl_fail(error, status, "%s cannot be read a second time", config->path);
    }
    tl_live_job_apply(&self->job, &self->config);
    return TL_OK;
}

/* The twin's outbox is not ours to read before it is dead. */
static uint64_t count_rest_of_twin(tree *self, const tl_outbox_taken *taken) {
    const tl_outbox_settings settings = tl_live_twin_outbox(&self->config);
    tl_block outbox = {.descriptor = -1};
    tl_error error;
    uint64_t count = 0;
    if (tl_block_take(tl_block_reader(&self->memory.twin_outbox), tl_outbox_bytes(&settings), TL_BLOCK_WE_WRITE,
                      &outbox, &error) == TL_OK) {
        count = tl_outbox_rest_count(&settings, outbox.bytes, taken);
    }
    tl_block_close(&outbox);
    return count;
}

/* What nobody has recorded, if the last one who could have has not said that itself. */
static void say_rest(tree *self) {
    const tl_outbox_settings events = tl_live_event_outbox();
    int code = 0;
    if (!records(self) || tl_heartbeats_get_farewell(&recorder_pulse(self)->beats, &code) != TL_FAREWELL_NONE) {
        return;
    }
    const tl_outbox_taken *taken = recorder_pulse(self)->state.taken;
    uint64_t rest = count_rest_of_twin(self, &taken[TL_LIVE_OUTBOX_TWIN]);
    rest += tl_outbox_rest_count(&events, tl_live_io_outbox_of(self->memory.io_pulse.bytes), &taken[TL_LIVE_OUTBOX_IO]);
    rest += tl_outbox_rest_count(&events, self->memory.supervisor.bytes, &taken[TL_LIVE_OUTBOX_SUPERVISOR]);
    if (rest > 0) {
        tl_log(TL_LOG_ERROR, "%" PRIu64 " samples, steps and events are lost: no recorder is left to write them", rest);
    }
}

static int finish(tree *self, int code) {
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
    static tree self; /* one for the process; its threads may look at it */
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
    }
    (void)sigemptyset(&asked);
    (void)sigaddset(&asked, SIGCHLD);
    (void)sigaddset(&asked, SIGTERM);
    (void)sigaddset(&asked, SIGINT);
    (void)sigaddset(&asked, SIGHUP);
    (void)pthread_sigmask(SIG_BLOCK, &asked, NULL); /* from now on they wait for the supervisor */
    tl_status status = read_config(&self, &error);
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
