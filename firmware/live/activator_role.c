/* The process that changes the configuration of the run. No plant, no FMU, no network, no database. See live_role.h. */
#include <stdio.h>
#include <string.h>

#include "firmware/activate/activator.h"
#include "firmware/base/log.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_wire.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/role.h"
#include "firmware/run/journal.h"
#include "firmware/run/live_tuning.h"

/* A worn-out memory card takes its time for one version. */
static const tl_time PATIENCE = 60 * TL_SECOND;

typedef struct activator_process {
    tl_block job_block;
    tl_live_job job;
    tl_config config;
    tl_block pulse_block;
    tl_block twin_block;
    tl_block recorder_block;
    tl_block tuning_block;
    tl_live_activator_pulse *pulse;
    const tl_live_twin_pulse *twin;
    const tl_live_recorder_pulse *recorder; /* NULL: nothing is recorded */
    tl_live_tuning *tuning;
    uint32_t given; /* number of the tuning that was written last, by us */
    tl_outbox outbox;
    tl_journal journal;
    tl_heart *heart;
    tl_activation_host host;
    tl_activator *activator;
} activator_process;

/* ---- what it sees, and can do ---- */

static void look(void *context, tl_activation_view *view) {
    const activator_process *self = context;
    tl_live_figures figures = {.ticks = 0};
    int code = 0;
    memset(view, 0, sizeof *view);
    view->step_s = tl_seconds(self->config.step);
    view->holds = self->twin->holds != 0;
    (void)tl_latest_read(&self->twin->figures, &figures, sizeof figures);
    view->figures = (tl_probation_snapshot){
        .ticks = figures.ticks,
        .steps = figures.steps,
        .skipped = figures.skipped,
        .deadline_misses = figures.deadline_misses,
        .lock = figures.lock,
        .twin_failures = self->twin->number > 0 ? self->twin->number - 1 : 0,
        .twin_alive = !view->holds && tl_heartbeats_is_ready(&self->twin->beats) &&
                      tl_heartbeats_get_farewell(&self->twin->beats, &code) == TL_FAREWELL_NONE,
    };
    view->figures.lock.state = figures.lock.state <= TL_LOCK_LOST ? figures.lock.state : TL_LOCK_FREE;
    (void)tl_heartbeats_get_status(&self->twin->beats, view->line);
    view->line[sizeof view->line - 1] = '\0';
}

/* What the twin was given last; the run's own configuration as long as that is nothing. */
static void in_force(void *context, char hash[TL_SHA256_TEXT]) {
    const activator_process *self = context;
    tl_live_tuning_head head;
    bool is_given = tl_live_tuning_read(self->tuning, &head, NULL) == TL_OK;
    memcpy(hash, is_given ? head.hash : self->config.hash, TL_SHA256_TEXT);
}

static void tell(void *context, tl_severity severity, const char *text) {
    activator_process *self = context;
    tl_journal_event(&self->journal, -1, severity, "retune", "%s", text);
}

static void ask_for_restart(void *context) {
    activator_process *self = context;
    __atomic_store_n(&self->pulse->restart, 1, __ATOMIC_RELEASE);
}

/* ---- tunings ---- */

/* The recorder keeps a tuning's text before the next one is written over it; unless nothing can be recorded now, or the twin has refused it. */
static bool is_kept(const activator_process *self) {
    uint32_t number = tl_live_tuning_number(self->tuning);
    tl_live_tuning_answer answer;
    bool is_refused = tl_live_tuning_answered(&self->twin->tuned, number, &answer) && answer.refused != 0;
    if (self->recorder == NULL || number == 0 || is_refused) {
        return true;
    }
    tl_recorder_state_counts counts = tl_recorder_state_get(&self->recorder->state);
    return counts.tuning >= number || counts.refused_since != 0;
}

static void copy_words(char *to, size_t room, const char *from) {
    (void)snprintf(to, room, "%s", from);
}

static bool tune(void *context, const tl_activation_tuning *tuning) {
    activator_process *self = context;
    tl_live_tuning_head head = {.size = (uint32_t)tuning->size, .tuning = *tuning->tuning};
    if (!is_kept(self)) {
        return false;
    }
    copy_words(head.hash, sizeof head.hash, tuning->hash);
    copy_words(head.who, sizeof head.who, tuning->who);
    copy_words(head.origin, sizeof head.origin, tuning->origin);
    copy_words(head.why, sizeof head.why, tuning->why);
    self->given = tl_live_tuning_write(self->tuning, &head, tuning->text);
    return true;
}

static tl_activation_news was_taken(void *context, char why[TL_ACTIVATION_WHY]) {
    const activator_process *self = context;
    tl_live_tuning_answer answer;
    if (!tl_live_tuning_answered(&self->twin->tuned, self->given, &answer)) {
        return TL_ACTIVATION_WAITS;
    }
    (void)snprintf(why, TL_ACTIVATION_WHY, "%.*s", TL_ACTIVATION_WHY - 1, answer.why);
    return answer.refused != 0 ? TL_ACTIVATION_REFUSED : TL_ACTIVATION_TAKEN;
}

/* ---- its life ---- */

static tl_status take_blocks(activator_process *self, tl_error *error) {
    const struct {
        int descriptor;
        size_t size;
        tl_block_writer writer;
        tl_block *block;
    } wanted[] = {
        {TL_LIVE_OWN_PULSE, tl_live_activator_bytes(), TL_BLOCK_THEY_WRITE, &self->pulse_block},
        {TL_LIVE_ACTIVATOR_TWIN, sizeof *self->twin, TL_BLOCK_WE_WRITE, &self->twin_block},
        {TL_LIVE_TUNING, sizeof *self->tuning, TL_BLOCK_THEY_WRITE, &self->tuning_block},
    };
    tl_status status = TL_OK;
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0] && status == TL_OK; i++) {
        status = tl_block_take(wanted[i].descriptor, wanted[i].size, wanted[i].writer, wanted[i].block, error);
    }
    if (status == TL_OK && self->job.database[0] != '\0') {
        status = tl_block_take(TL_LIVE_RECORDER_PULSE, sizeof *self->recorder, TL_BLOCK_WE_WRITE, &self->recorder_block,
                               error);
    }
    return status;
}

static tl_status take_memory(activator_process *self, tl_error *error) {
    const tl_outbox_settings events = tl_live_event_outbox();
    tl_status status = tl_live_job_take(TL_LIVE_JOB, &self->job_block, &self->job, &self->config, error);
    if (status == TL_OK) {
        status = take_blocks(self, error);
    }
    if (status == TL_OK) {
        self->pulse = self->pulse_block.bytes;
        self->twin = self->twin_block.bytes;
        self->tuning = self->tuning_block.bytes;
        self->recorder = self->recorder_block.bytes;
        tl_outbox_open(&events, tl_live_activator_outbox_of(self->pulse),
                       self->recorder != NULL ? &self->recorder->state.taken[TL_LIVE_OUTBOX_ACTIVATOR] : NULL,
                       &self->outbox);
    }
    return status;
}

static tl_status open_activator(activator_process *self, tl_error *error) {
    self->host = (tl_activation_host){
        .context = self,
        .look = look,
        .in_force = in_force,
        .tune = tune,
        .was_taken = was_taken,
        .restart = ask_for_restart,
        .tell = tell,
    };
    const tl_activator_settings settings = {
        .listener = TL_LIVE_KNOCKER,
        .state = self->job.state,
        .plant = self->config.name,
        .path = self->config.path,
        .memory_limit = self->job.memory_limit,
        .unconfined = self->job.unconfined,
        .host = &self->host,
    };
    return tl_activator_open(&settings, &self->activator, error);
}

static void work(activator_process *self) {
    bool goes_on = true;
    while (goes_on && tl_interrupt_requested() == NULL) {
        goes_on = tl_activator_work(self->activator);
        tl_heart_beat(self->heart);
        tl_journal_drain(&self->journal);
    }
}

int tl_activator_role_run(void) {
    static activator_process self; /* one for the process */
    tl_error error;
    tl_live_role_begin();
    tl_role_open_program();
    tl_status status = take_memory(&self, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    self.heart = tl_heart_begin(&self.pulse->beats, "activator", PATIENCE);
    tl_live_role_open_journal(&self.journal, &self.outbox);
    status = open_activator(&self, &error);
    bool was_ready = status == TL_OK;
    if (was_ready) {
        tl_heartbeats_set_ready(&self.pulse->beats);
        work(&self);
        tl_activator_close(self.activator);
    } else {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    tl_journal_drain(&self.journal);
    return tl_live_role_end(&self.pulse->beats, was_ready, tl_exit_code(status));
}
