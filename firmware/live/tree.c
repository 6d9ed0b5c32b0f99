/* The tree: see tree.h. */
#include "firmware/live/tree.h"

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
#include "firmware/base/output.h"
#include "firmware/live/tree_parts.h"
#include "firmware/plant/live_plant.h"
#include "firmware/report/run_end.h"
#include "firmware/store/outbox_rest.h"
#include "firmware/twin/twin_process.h"

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

void tl_tree_put_event(tl_tree *self, tl_severity severity, const char *source, const char *text) {
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
    char why[TL_TWIN_WARDEN_TEXT];
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
