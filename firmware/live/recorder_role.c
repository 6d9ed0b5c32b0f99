/* Recorder: the process that writes SQLite, and watches what it writes for lasting changes. See
 * live_role.h. */
#include <libgen.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/live/live_detection.h"
#include "firmware/live/live_role.h"
#include "firmware/live/twin_slots.h"
#include "firmware/plant/live_plant.h"
#include "firmware/process/interrupt.h"
#include "firmware/store/recorder_writer.h"
#include "firmware/twin/resume.h"
#include "firmware/twin/twin_recorder.h"

/* Interval of the main loop: while a twin may request resume data, and later. */
static const tl_time POLL_SOON = TL_SECOND / 500;
static const tl_time POLL = TL_SECOND / 20;

/* Heartbeat timeout: one commit to a worn memory card may take long, and so may opening the
 * database of several years. */
static const tl_time PATIENCE = 60 * TL_SECOND;

/* Time limit to write the remaining data at the end if the disk rejects it. */
static const tl_time PATIENCE_AT_END = 2 * TL_SECOND;

/* After this time with an unwritable file, the recorder checks if the folder was replaced. */
static const tl_time PATIENCE_WITH_FOLDER = TL_SECOND;

/* It records the twin in the slot of the job. */
typedef struct recorder {
    tl_live_setup setup;
    tl_plant_input input; /* over the sample memory */
    tl_live_recorder_status *own;
    const tl_live_twin_status *twin;
    const tl_live_twin_status *other; /* in the other slot */
    tl_block *resume;
    const tl_handover *handover_block;
    tl_thread_heartbeat *heartbeat;
    tl_twin_record record; /* description of the run, except its twin */
    tl_recorder_writer *writer;
    tl_live_detection *detection; /* NULL: memory is out */
    tl_resume_history *history;   /* NULL: not requested yet, or finished */
    tl_live_request answered;
    tl_live_samples samples;            /* for the other slot */
    char fmus[TL_SHA256_TEXT];          /* hash of the FMU files for `history` */
    tl_live_tuning_head head;           /* newest tuning that was read */
    char text[TL_CONFIG_MAX_BYTES + 1]; /* configuration of that tuning */
    uint32_t checked;                   /* number of the tuning that was checked last */
    tl_recorder_known known;            /* the same for the writer */
    struct stat folder;                 /* of the database, at the start; st_ino 0: none */
} recorder;

static void take_sample_at(void *context, int64_t tick, tl_time instant, tl_sample *sample) {
    const recorder *self = context;
    tl_plant_input_take(&self->input, tick, instant, sample);
}

static void *bytes_of(const recorder *self, size_t block) {
    return self->setup.blocks[block].bytes;
}

/* The sample buffers provide the samples that the twin does not pass on. */
static tl_status open_memory(recorder *self, tl_error *error) {
    const uint32_t slot = self->setup.job.slot_index;
    self->own = bytes_of(self, TL_LIVE_RECORDER_STATUS);
    self->twin = bytes_of(self, TL_LIVE_TWIN_STATUS + slot);
    self->other = bytes_of(self, TL_LIVE_TWIN_STATUS + 1 - slot);
    self->resume = &self->setup.blocks[TL_LIVE_RESUME + slot];
    self->handover_block = bytes_of(self, TL_HANDOVER);
    return tl_live_input_open(&self->setup.config, &self->setup.blocks[TL_LIVE_SAMPLES], &self->input, error);
}

/* ---- the writer ---- */

/* Reads the newest tuning before any entries that refer to it. An invalid one is skipped, because
 * no twin applies it either. */
static void read_tuning(recorder *self) {
    const tl_live_tuning *block = bytes_of(self, TL_LIVE_TUNING + self->setup.job.slot_index);
    uint32_t number = tl_live_tuning_number(block);
    tl_error error;
    if (number == self->checked || number % 2 != 0) {
        return;
    }
    self->known = (tl_recorder_known){.hash = "", .text = ""};
    tl_status status = tl_live_tuning_read_text(block, &self->head, self->text, &error);
    if (status == TL_OK) {
        self->known = (tl_recorder_known){.number = self->head.number,
                                          .hash = self->head.hash,
                                          .text = self->text,
                                          .who = self->head.who,
                                          .origin = self->head.origin,
                                          .why = self->head.why};
    }
    self->checked = status != TL_TRY_AGAIN ? number : self->checked;
}

/* True if no handover was announced since this process started. */
static bool has_no_handover(void *context) {
    const recorder *self = context;
    return __atomic_load_n(&self->handover_block->handovers, __ATOMIC_ACQUIRE) == self->setup.job.handovers;
}

static void observe_entry(void *context, const tl_recorder_entry *entry) {
    const recorder *self = context;
    if (self->detection != NULL) {
        tl_live_detection_observe(self->detection, entry);
    }
}

static tl_status open_writer(recorder *self, tl_error *error) {
    const tl_record_queue_settings events = tl_live_event_queue();
    const size_t queue = TL_LIVE_QUEUE_TWIN + self->setup.job.slot_index;
    tl_recorder_writer_queue queues[TL_LIVE_QUEUES] = {
        [TL_LIVE_QUEUE_IO] = {"io", events, bytes_of(self, TL_LIVE_IO_EVENTS)},
        [TL_LIVE_QUEUE_SUPERVISOR] = {"supervisor", events, bytes_of(self, TL_LIVE_SUPERVISOR_EVENTS)},
        [TL_LIVE_QUEUE_CONFIG_MANAGER] = {"config manager", events, bytes_of(self, TL_LIVE_CONFIG_MANAGER_EVENTS)},
    };
    queues[queue] = (tl_recorder_writer_queue){"twin", tl_live_twin_queue(&self->setup.config),
                                               bytes_of(self, TL_LIVE_QUEUE + self->setup.job.slot_index)};
    tl_twin_recorder_describe(&self->setup.config, self->setup.job.database, &self->record);
    self->known = (tl_recorder_known){.hash = "", .text = ""};
    self->record.settings.known = &self->known;
    self->record.settings.known_count = 1;
    self->record.settings.open_policy = self->setup.job.unsupervised ? TL_DATABASE_IF_OURS : TL_DATABASE_ANYHOW;
    const tl_recorder_writer_settings settings = {
        .record = &self->record.settings,
        .queues = queues,
        .queue_count = TL_LIVE_QUEUES,
        .ring = queue,
        .hand_over = TL_LIVE_HANDED_OVER,
        .continues = has_no_handover,
        .observe = observe_entry,
        .context = self,
        .state = &self->own->state,
        .heartbeat = self->heartbeat,
        .plant = {.take = take_sample_at, .context = self, .kept = tl_sample_buffers_kept(&self->setup.config)},
        .is_last = true,
    };
    self->samples = (tl_live_samples){.live_status = self->other,
                                      .answer = &self->own->answer[1 - self->setup.job.slot_index],
                                      .resume = &self->setup.blocks[TL_LIVE_RESUME + 1 - self->setup.job.slot_index],
                                      .boot = self->record.boot};
    self->detection = tl_live_detection_create(&self->setup.config, settings.state);
    return tl_recorder_writer_open(&settings, &self->writer, error);
}

/* ---- resume data, for a twin without a previous process in this run ---- */

/* Messages that do not fit are dropped. */
static void add_message(void *context, tl_severity severity, const char *text) {
    tl_live_resume_answer *reply = context;
    for (size_t i = 0; i < TL_LIVE_RESUME_WORDS; i++) {
        tl_live_resume_word *message = &reply->words[i];
        if (message->text[0] == '\0') {
            message->severity = (int32_t)severity;
            (void)snprintf(message->text, sizeof message->text, "%s", text);
            return;
        }
    }
}

/* Uses the hash of the FMUs that the twin has loaded, because the files may have changed. */
static void open_history(recorder *self) {
    memcpy(self->fmus, self->twin->digest, sizeof self->fmus);
    self->fmus[TL_SHA256_TEXT - 1] = '\0';
    const tl_resume_history_settings settings = {
        .config = &self->setup.config,
        .path = tl_recorder_writer_path(self->writer),
        .fmus = self->fmus[0] != '\0' && tl_identity_is_sound(self->fmus) ? self->fmus : self->record.fmus,
        .boot = self->record.boot,
        .components = self->setup.config.component_count + 1,
        .report = add_message,
        .context = &self->own->answer[self->setup.job.slot_index],
    };
    self->history = tl_resume_history_open(&settings);
}

/* Writes the next older resume data to its block. */
static void answer_request(recorder *self, tl_live_request request) {
    tl_live_resume_answer *reply = &self->own->answer[self->setup.job.slot_index];
    memset(reply->words, 0, sizeof reply->words);
    if ((uint32_t)request == 1) {
        tl_resume_history_close(self->history);
        open_history(self);
    }
    const tl_resume *found = tl_resume_history_next(self->history);
    reply->size = found != NULL && tl_resume_size(found) <= TL_LIVE_RESUME_BYTES ? tl_resume_size(found) : 0;
    if (reply->size != 0) {
        tl_resume_write(found, self->resume->bytes);
    }
    reply->ended = tl_resume_history_ended(self->history);
    self->answered = request;
    __atomic_store_n(&reply->live_request, request, __ATOMIC_RELEASE);
}

static void poll_requests(recorder *self) {
    tl_live_request request = __atomic_load_n(&self->twin->resume, __ATOMIC_ACQUIRE);
    if (request != 0 && request != self->answered) {
        answer_request(self, request);
    } else if (self->history != NULL && __atomic_load_n(&self->twin->begun, __ATOMIC_RELAXED) != 0) {
        tl_resume_history_close(self->history); /* the twin has started */
        self->history = NULL;
        tl_block_forget(self->resume);
    }
}

/* ---- main loop ---- */

static struct stat folder_of(const char *path) {
    char copy[PATH_MAX];
    struct stat folder;
    (void)snprintf(copy, sizeof copy, "%s", path);
    if (stat(dirname(copy), &folder) != 0) {
        folder.st_ino = 0;
    }
    return folder;
}

/* The confinement fixes the folder that the process may write to. If the folder was created again,
 * or its disk was replaced, another recorder is needed. */
static bool needs_another(const recorder *self) {
    tl_time since = tl_recorder_state_get(&self->own->state).refused_since;
    if (since == 0 || tl_clock_now(NULL) - since < PATIENCE_WITH_FOLDER) {
        return false;
    }
    struct stat folder = folder_of(self->setup.job.database);
    return self->folder.st_ino != 0 && folder.st_ino != 0 &&
           (folder.st_ino != self->folder.st_ino || folder.st_dev != self->folder.st_dev);
}

/* Another twin is live and writes to the other record queue; the queue of this recorder gets no
 * more data of its run. */
static bool handover_result(const recorder *self) {
    uint32_t handovers = __atomic_load_n(&self->handover_block->handovers, __ATOMIC_ACQUIRE);
    uint32_t slot = __atomic_load_n(&self->handover_block->slot_index, __ATOMIC_ACQUIRE);
    return handovers != self->setup.job.handovers &&
           (handovers != self->setup.job.handovers + 1 || slot != self->setup.job.slot_index);
}

/* Reports to the supervisor that another recorder can continue with the other queue. */
static void report_drained(recorder *self) {
    __atomic_store_n(&self->own->drained, self->setup.job.handovers + 1, __ATOMIC_RELEASE);
}

static void store_changes(recorder *self, bool at_end) {
    if (self->detection != NULL) {
        tl_live_detection_store(self->detection, self->writer, at_end);
        __atomic_store_n(&self->own->open_findings, tl_live_detection_count_open(self->detection), __ATOMIC_RELAXED);
        const uint32_t due = tl_live_detection_take_due(self->detection);
        if (due != 0) {
            __atomic_store_n(&self->own->due_finding, due, __ATOMIC_RELAXED);
            __atomic_store_n(&self->own->explanations, self->own->explanations + 1, __ATOMIC_RELEASE);
        }
    }
}

static void write_now(recorder *self) {
    bool over = handover_result(self); /* first: all data before that is read now */
    if (over) {
        tl_recorder_writer_finish_ring(self->writer);
    }
    read_tuning(self);
    tl_recorder_writer_write(self->writer);
    store_changes(self, false);
    for (size_t i = 0; i < TL_LIVE_QUEUES; i++) { /* the supervisor reads it */
        __atomic_store_n(&self->own->damaged[i], tl_recorder_writer_damage(self->writer, i), __ATOMIC_RELAXED);
    }
    if (over && tl_recorder_writer_has_drained(self->writer)) {
        report_drained(self);
    }
}

static tl_status close_writer(recorder *self, tl_error *error) {
    bool over = handover_result(self);
    tl_recorder_writer_write(self->writer); /* what is found in the last entries is stored, too */
    store_changes(self, true);
    tl_live_detection_close(self->detection);
    self->detection = NULL;
    tl_status status = tl_recorder_writer_close(self->writer, PATIENCE_AT_END, error);
    if (over && status == TL_OK) {
        report_drained(self);
    }
    return status;
}

static void record_run(recorder *self) {
    tl_time due = tl_clock_now(NULL);
    while (tl_interrupt_requested() == NULL && !needs_another(self)) {
        tl_thread_heartbeat_beat(self->heartbeat);
        poll_requests(self);
        if (__atomic_load_n(&self->handover_block->slot_index, __ATOMIC_ACQUIRE) ==
            self->setup.job.slot_index) { /* the other twin is a shadow */
            tl_live_samples_answer(&self->samples, tl_recorder_writer_path(self->writer));
        }
        if (tl_clock_now(NULL) >= due || tl_recorder_writer_is_pressed(self->writer)) {
            write_now(self);
            due = tl_clock_now(NULL) + self->setup.config.record_commit;
        }
        tl_time now = tl_clock_now(NULL);
        tl_time next = now + (__atomic_load_n(&self->twin->begun, __ATOMIC_RELAXED) == 0 ? POLL_SOON : POLL);
        due = handover_result(self) && due > now + POLL ? now + POLL : due; /* the next recorder waits */
        tl_clock_sleep_until(next < due ? next : due);
    }
}

int tl_recorder_role_run(void) {
    static recorder self; /* one per process */
    tl_error error;
    tl_status status = tl_live_role_begin(TL_LIVE_IS_RECORDER, &self.setup);
    if (status != TL_OK) {
        return tl_exit_code(status);
    }
    (void)signal(SIGXFSZ, SIG_IGN); /* treat a file size limit like a full disk */
    status = open_memory(&self, &error);
    self.heartbeat = tl_thread_heartbeat_start(&self.own->beats, "recorder", PATIENCE);
    self.folder = folder_of(self.setup.job.database);
    if (status == TL_OK) {
        status = tl_twin_slots_confine_recorder(&self.setup.config, self.setup.job.database, &error);
    }
    if (status == TL_OK) {
        status = open_writer(&self, &error);
    }
    bool was_ready = status == TL_OK;
    if (was_ready) {
        tl_heartbeats_set_ready(&self.own->beats);
        record_run(&self);
        status = tl_interrupt_requested() != NULL
                     ? close_writer(&self, &error)
                     : tl_fail(&error, TL_TRY_AGAIN, "%s: its folder was replaced; the recorder restarts",
                               self.setup.job.database);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_live_role_end(&self.own->beats, was_ready, tl_exit_code(status));
}
