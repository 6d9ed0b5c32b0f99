/* What each process of a tree is given at its start: see tree_parts.h. */
#include "firmware/live/tree_parts.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/live/live_role.h"
#include "firmware/process/role.h"
#include "firmware/twin/twin_process.h"

/* ---- what is heard of FMUs ---- */

/* In a thread of a warden's. Of a shadow's FMUs nothing is kept but the log. */
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

int tl_tree_be(const char *title, void *context) {
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

pid_t tl_tree_begin_activator(void *context) {
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
    place->pid = status == TL_OK ? tl_twin_process_id(place->twin) : 0;
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

pid_t tl_tree_begin(void *context, tl_member which, const tl_start *start, tl_error *error) {
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
