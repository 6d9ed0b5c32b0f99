/* FMU process: see twin_role.h. */
#include "firmware/twin/twin_role.h"

#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/fmu/fmu_store.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/process/confine.h"
#include "firmware/process/crash.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/private_folder.h"
#include "firmware/process/process_end.h"
#include "firmware/process/role.h"

/* ---- the job ---- */

/* Order of the pieces; texts include their NUL. */
enum { PATH, TEXT, FOLDER, CHECKPOINT, TUNINGS, LIVE, PIECES };

/* Content of the block: this, then the pieces one after the other. Pointers and sizes in `job` are
 * not valid there. */
typedef struct packed {
    tl_twin_job job;
    size_t sizes[PIECES];
} packed;

tl_status tl_twin_job_make(const tl_twin_job *job, tl_block *block, tl_error *error) {
    const void *const pieces[PIECES] = {job->path, job->text, job->folder, job->checkpoint, job->tunings, job->live};
    const packed head = {.job = *job,
                         .sizes = {strlen(job->path) + 1, strlen(job->text) + 1, strlen(job->folder) + 1,
                                   job->checkpoint_size, job->tunings_size, job->live_size}};
    size_t size = sizeof head;
    for (size_t i = 0; i < PIECES; i++) {
        size += head.sizes[i];
    }
    unsigned char *bytes = calloc(1, size);
    if (bytes == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the job of the FMU process");
    }
    memcpy(bytes, &head, sizeof head);
    unsigned char *slot_index = bytes + sizeof head;
    for (size_t i = 0; i < PIECES; i++) {
        if (head.sizes[i] > 0) {
            memcpy(slot_index, pieces[i], head.sizes[i]);
        }
        slot_index += head.sizes[i];
    }
    tl_status status = tl_block_make_of("twinlock-job", bytes, size, block, error);
    free(bytes);
    return status;
}

tl_status tl_twin_job_read(const tl_block *block, tl_twin_job *job, tl_error *error) {
    packed head = {.sizes = {0}};
    const unsigned char *pieces[PIECES];
    size_t size = sizeof head;
    if (block->size >= sizeof head) {
        memcpy(&head, block->bytes, sizeof head);
    }
    for (size_t i = 0; i < PIECES; i++) {
        pieces[i] = (const unsigned char *)block->bytes + size;
        size += head.sizes[i];
    }
    if (size != block->size) {
        return tl_fail(error, TL_BAD_DATA, "the job has %zu bytes, expected %zu", block->size, size);
    }
    *job = head.job;
    job->path = (const char *)pieces[PATH];
    job->text = (const char *)pieces[TEXT];
    job->folder = (const char *)pieces[FOLDER];
    job->checkpoint = pieces[CHECKPOINT];
    job->tunings = pieces[TUNINGS];
    job->live = pieces[LIVE];
    return TL_OK;
}

/* ---- the role ---- */

/* Longest sleep before signals are checked. */
static const tl_time POLL = TL_SECOND / 4;

enum { TOGETHER = 64 };

/* State of this process. */
typedef struct role {
    const tl_twin_role_tasks *tasks;
    tl_block job_block;
    tl_block blocks[TL_SIDES];
    tl_block read_back; /* if the job requires it */
    tl_twin_job job;
    tl_channel_settings wire;
    tl_channel channel;
    tl_twin_extra *extra;
    const tl_twin_orders *orders;
    tl_assembly assembly;
    tl_assembly second; /* of a comparison */
    tl_recovery recovery;
    tl_explainer *explainer; /* NULL: there is nothing to explain */
    tl_twin_tunings tunings; /* not applied yet */
    union {
        tl_recording_tick tick;
        int32_t status;
    } received;
    tl_twin_result result; /* of the newest tick */
    unsigned unpushed;     /* results since the parent was last notified */
    bool over;             /* a step has failed: further requests are not answered */
} role;

/* ---- sending ---- */

/* Waits for room: the parent takes the messages, or it is dead and this process ends too. A result
 * is visible at once, even if this process dies. The parent is notified once for several results,
 * or when this process is idle. */
static void send_message(role *self, tl_message type, const void *payload) {
    while (!tl_channel_offer(&self->channel, type, payload)) {
        if (tl_channel_wait(&self->channel, 0, 1, tl_clock_now(NULL) + POLL) == TL_CHANNEL_BROKEN) {
            return;
        }
    }
    self->unpushed++;
    if (type != TL_MESSAGE_RESULT || self->unpushed >= TOGETHER) {
        tl_channel_push(&self->channel);
        self->unpushed = 0;
    } else {
        tl_channel_show(&self->channel);
    }
}

/* `error` has no text if the error was logged. */
static void send_status(role *self, tl_message type, tl_status status, const tl_error *error) {
    const int32_t number = (int32_t)status;
    (void)snprintf(self->extra->error, sizeof self->extra->error, "%s", error->text);
    send_message(self, type, &number);
}

/* Receives the next message of the parent into self->received. */
static tl_status receive_message(role *self, tl_message *type, tl_error *error) {
    tl_channel_event outcome = tl_channel_take(&self->channel, type, &self->received);
    while (outcome != TL_CHANNEL_SOMETHING && outcome != TL_CHANNEL_BROKEN) {
        (void)tl_channel_wait(&self->channel, 1, 0, tl_clock_now(NULL) + POLL);
        outcome = tl_channel_take(&self->channel, type, &self->received);
    }
    *error = self->channel.fault;
    return error->status;
}

/* ---- start ---- */

/* Must be parsed as in the parent, because the sizes of messages depend on it. */
static tl_status read_config(const role *self, tl_assembly *assembly, tl_error *error) {
    tl_problems *problems = &assembly->problems;
    tl_problems_init(problems, self->job.path);
    tl_status status = tl_config_read_text(self->job.path, self->job.text, strlen(self->job.text), &assembly->config,
                                           &problems->report);
    if (status != TL_OK) {
        return tl_fail(error, status, "%s: was valid, but the FMU process cannot parse it", self->job.path);
    }
    problems->config = &assembly->config;
    if (self->job.plain) {
        assembly->config.saving.structure = false;
        assembly->config.saving.sequences = false;
    }
    if (self->job.attached == TL_ATTACHED_OUTPUTS) { /* an emulated plant has no delays */
        tl_config_forget_delays(&assembly->config);
    }
    tl_config_use_lookups(&assembly->config);
    return TL_OK;
}

static bool has_second(const role *self) {
    return self->job.task == TL_TASK_PAIR && !self->job.alone;
}

static tl_status read_job(role *self, tl_error *error) {
    tl_status status = tl_block_take(TL_TWIN_JOB, 0, TL_BLOCK_IS_WRITTEN, &self->job_block, error);
    if (status == TL_OK) {
        status = tl_twin_job_read(&self->job_block, &self->job, error);
    }
    status = status == TL_OK ? read_config(self, &self->assembly, error) : status;
    for (size_t i = 0; status == TL_OK && i < self->assembly.config.component_count;
         i++) { /* rollback methods to test, and what a recorded run has kept */
        const tl_rollback method = (tl_rollback)self->job.rollback[i];
        tl_config_component *component = &self->assembly.config.components[i];
        component->rollback = method != TL_ROLLBACK_NONE ? method : component->rollback;
        if (self->job.keep.is_known && component->keep == TL_KEEP_AUTO && i < TL_TWIN_UNSAVED) {
            component->keep = (self->job.keep.unsaved >> i & 1U) != 0 ? TL_KEEP_NONE : TL_KEEP_STATES;
        }
    }
    return status == TL_OK && has_second(self) ? read_config(self, &self->second, error) : status;
}

static tl_status open_channel(role *self, tl_error *error) {
    self->wire = tl_twin_wire(&self->assembly.config, self->job.attached);
    tl_status status = tl_block_take(TL_TWIN_PARENTS_BLOCK, tl_channel_bytes(&self->wire, TL_PARENT), TL_BLOCK_WE_WRITE,
                                     &self->blocks[TL_PARENT], error);
    if (status == TL_OK) {
        status = tl_block_take(TL_TWIN_OWN_BLOCK, tl_channel_bytes(&self->wire, TL_CHILD), TL_BLOCK_THEY_WRITE,
                               &self->blocks[TL_CHILD], error);
    }
    if (status == TL_OK) {
        void *const bytes[TL_SIDES] = {self->blocks[TL_PARENT].bytes, self->blocks[TL_CHILD].bytes};
        self->extra = tl_channel_extra(&self->wire, TL_CHILD, self->blocks[TL_CHILD].bytes);
        self->orders = tl_channel_extra(&self->wire, TL_PARENT, self->blocks[TL_PARENT].bytes);
        tl_channel_open(&self->wire, TL_CHILD, bytes, &self->channel);
    }
    if (status == TL_OK && self->job.reads_back) {
        status = tl_block_take(TL_TWIN_READ_BACK, TL_READ_BACK_BYTES, TL_BLOCK_THEY_WRITE, &self->read_back, error);
    }
    return status;
}

static tl_status confine_role(const role *self, tl_confine_facts *facts, tl_error *error) {
    int listener = -1;
    tl_readable_paths places = {.count = 0};
    if (!self->job.holds) {
        tl_readable_paths_find(&self->assembly, &places);
    }
    const tl_confine_settings settings = {
        .read = (const char *const *)places.path,
        .read_count = places.count,
        .folder = self->job.folder[0] != '\0' ? self->job.folder : NULL, /* for files that are unpacked or written */
        .file_bytes = TL_FMU_ENTRY_BYTES, /* limit of one file; the parent limits their sum */
        .memory = self->job.memory,
        .user = self->job.user,
        .start_socket = TL_TWIN_START_SOCKET,
        .whole_process = true,
        .only_denies = self->job.task == TL_TASK_LIVE,
    };
    tl_status status = tl_confine(&settings, facts, &listener, error);
    tl_readable_paths_free(&places);
    if (status == TL_OK && listener >= 0) { /* the parent needs it to see denied calls */
        const char byte = 0;
        (void)tl_packet_send(TL_TWIN_START_SOCKET, &byte, sizeof byte, listener);
        (void)close(listener);
    }
    return status;
}

static tl_status start_role(role *self, tl_confine_facts *facts, tl_error *error) {
    enum { NICE_0 = 20 }; /* offset in RLIMIT_NICE */
    tl_status status = read_job(self, error);
    if (status == TL_OK && self->job.task == TL_TASK_LIVE) {
        /* While the process may still be root. The parent sets the priorities and reads the limits
         * of this process for that. */
        tl_process_limits_permit(RLIMIT_MEMLOCK, RLIM_INFINITY);
        tl_process_limits_permit(RLIMIT_RTPRIO, (rlim_t)self->assembly.config.realtime_priority);
        tl_process_limits_permit(RLIMIT_NICE, NICE_0);
    } else if (status == TL_OK) {
        status = open_channel(self, error);
    }
    if (status == TL_OK && self->job.task == TL_TASK_EXPLAIN) { /* must never delay a live run */
        (void)sched_setscheduler(0, SCHED_IDLE, &(struct sched_param){.sched_priority = 0});
    }
    if (status == TL_OK && !self->job.holds) {
        status = tl_assembly_open(&self->assembly, error);
    }
    if (status == TL_OK && has_second(self)) {
        status = tl_assembly_open(&self->second, error);
    }
    *facts = (tl_confine_facts){0};
    if (status == TL_OK && !self->job.unconfined) {
        tl_fmu_prepare();
        tl_private_folder_leave(); /* a confined process deletes no files; the parent deletes the folder */
        status = confine_role(self, facts, error);
    }
    (void)close(TL_TWIN_START_SOCKET);
    return status;
}

/* ---- work, in the FMU thread ---- */

static bool is_stopped(const role *self) {
    return __atomic_load_n(&self->orders->stop, __ATOMIC_RELAXED) != 0;
}

static tl_status execute_tick(role *self, tl_error *error) {
    int64_t tick = self->received.tick.sample.tick;
    tl_run_tuning tuning;
    tl_status status = TL_OK;
    while (status == TL_OK && tl_twin_tunings_next(&self->tunings, tick, &tuning)) {
        status = tl_assembly_retune(&self->assembly, &tuning.values, error);
        if (status == TL_OK) {
            tl_lock_monitor_retune(&self->recovery.lock_monitor, &tuning.values);
        }
    }
    if (status != TL_OK) {
        self->result = (tl_twin_result){.tick = tick, .status = (int32_t)status};
        return status;
    }
    status = tl_twin_execute(&self->assembly, &self->received.tick, self->job.attached, &self->recovery, &self->result,
                             error);
    if (status == TL_OK && self->explainer != NULL) {
        status = tl_explainer_take(self->explainer, &self->result, error);
        self->result.status = (int32_t)status;
    }
    return status;
}

static void answer_tick(role *self, bool last) {
    tl_error error;
    if (self->over || is_stopped(self)) {
        return;
    }
    if (last) {
        tl_twin_execute_last(&self->assembly, &self->received.tick, self->job.attached, &self->result);
    } else if (execute_tick(self, &error) != TL_OK) {
        (void)snprintf(self->extra->error, sizeof self->extra->error, "%s", error.text);
        self->over = true;
    }
    send_message(self, TL_MESSAGE_RESULT, &self->result);
}

/* Computes steps until the parent ends the work. */
static tl_status step_until_end(role *self, tl_error *error) {
    tl_message type = TL_MESSAGE_END;
    tl_status status = receive_message(self, &type, error);
    while (status == TL_OK && type != TL_MESSAGE_END) {
        answer_tick(self, type == TL_MESSAGE_FINISH);
        status = receive_message(self, &type, error);
    }
    return status;
}

static bool is_explainer_stopped(void *context) {
    return is_stopped(context);
}

static void report_rerun(void *context) {
    send_message(context, TL_MESSAGE_SHOWN, NULL);
}

/* The parent has sent all ticks, and waits for the explanation. */
static tl_status explain(role *self, tl_error *error) {
    if (self->over || is_stopped(self)) {
        return TL_OK;
    }
    return tl_explainer_run(self->explainer, is_explainer_stopped, report_rerun, self, &self->extra->explanation,
                            error);
}

/* Asks the parent for a reader process; returns when that has ended. If the work is to end
 * meanwhile, continues without it. */
static tl_status request_reader(void *context, tl_error *error) {
    role *self = context;
    tl_message type = TL_MESSAGE_END;
    send_message(self, TL_MESSAGE_SHOWN, NULL);
    tl_status status = receive_message(self, &type, error);
    if (status != TL_OK) {
        return status;
    }
    if (type == TL_MESSAGE_END) {
        return tl_fail(error, TL_INTERRUPTED, "it was interrupted");
    }
    tl_status seen = (tl_status)self->received.status;
    return seen == TL_OK ? TL_OK : tl_fail(error, seen, "%s", self->orders->error);
}

static tl_status run_check(role *self, tl_status built, tl_error *error) {
    const tl_read_back_host host = {.start_reader = request_reader, .context = self, .block = self->read_back.bytes};
    if (built == TL_OK && is_stopped(self)) {
        return TL_INTERRUPTED;
    }
    FILE *page = fdopen(TL_TWIN_PAGE, "w");
    if (page == NULL) {
        return tl_fail(error, TL_FMU_FAILED,
                       "the page of the check cannot be printed: an FMU has closed its file descriptor");
    }
    tl_status status = self->tasks->print_page(&self->assembly, &self->job, built, self->job.reads_back ? &host : NULL,
                                               page, &self->extra->check);
    if (built == TL_OK) {
        tl_component_methods_note(&self->assembly, &self->extra->ways);
    }
    bool done = fclose(page) == 0;
    return status != TL_OK || done
               ? status
               : tl_fail(error, TL_FMU_FAILED,
                         "the page of the check is incomplete: an FMU has closed its file descriptor");
}

/* Performs the task with the built assembly. Twins that differ, or an inexact rollback, are no
 * failure; *error describes them. */
static tl_status perform_task(role *self, tl_error *error) {
    tl_status status = TL_OK;
    switch (self->job.task) {
    case TL_TASK_READ:
        return tl_read_back_run_reader(&self->assembly, self->read_back.bytes, error);
    case TL_TASK_PAIR:
        status = tl_twin_pair_compare(&self->assembly, &self->second, self->job.alone, &self->extra->pair, error);
        return status;
    case TL_TASK_METHODS: /* builds it in the function */
        return tl_component_methods_try(&self->assembly, &self->extra->ways, error);
    default:
        status = step_until_end(self, error);
        if (status == TL_OK && self->explainer != NULL) {
            status = explain(self, error);
        }
        tl_account_take(self->assembly.twin, &self->extra->ended);
        return status;
    }
}

static void run_task(void *context) {
    role *self = context;
    tl_error error = {TL_OK, ""};
    bool checks = self->job.task == TL_TASK_CHECK;
    bool tries = self->job.task == TL_TASK_METHODS;
    if (checks || tries) { /* verify as often as possible (twin_trial.h) */
        self->assembly.config.verify_every = self->assembly.config.verify_every != 0 ? 1 : 0;
    }
    self->assembly.recorded = self->job.time;
    self->assembly.may_rerun = self->job.task == TL_TASK_EXPLAIN;
    tl_status status = tries ? TL_OK : tl_assembly_build(&self->assembly);
    if (self->assembly.twin != NULL) {
        if (self->job.checkpoint_size != 0) {
            status = tl_twin_load(self->assembly.twin, self->job.tick, self->job.checkpoint, self->job.checkpoint_size,
                                  &error);
        } else {
            tl_twin_begin_at(self->assembly.twin, self->job.tick);
        }
        if (status == TL_OK && self->job.task == TL_TASK_EXPLAIN) {
            status = tl_explainer_create(&self->assembly, &self->job.explain, &self->explainer, &error);
        }
        tl_account_take(self->assembly.twin, &self->extra->built);
        tl_recovery_init(&self->recovery, &self->assembly.config, &self->extra->built);
        self->tunings =
            (tl_twin_tunings){.bytes = self->job.tunings, .count = self->job.tunings_size / sizeof(tl_run_tuning)};
    }
    send_status(self, TL_MESSAGE_BUILT, status, &error);
    if (checks) {
        status = run_check(self, status, &error);
    } else if (status == TL_OK) {
        status = perform_task(self, &error);
    }
    send_status(self, TL_MESSAGE_ENDED, status, &error);
    tl_process_complete(tl_exit_code(TL_OK));
    tl_explainer_free(self->explainer);
    tl_assembly_free(&self->assembly);
    tl_assembly_free(&self->second);
}

int tl_twin_role_run(const tl_twin_role_tasks *tasks) {
    static role self; /* the only one in the process */
    tl_confine_facts facts;
    tl_error error;
    self.tasks = tasks;
    tl_log_use_levels();
    tl_role_enter();
    tl_process_begin();
    tl_crash_install();
    tl_interrupt_install(); /* before the parent forwards signals, which it does once it has the listener */
    tl_locale_use();
    tl_status status = start_role(&self, &facts, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return tl_exit_code(status);
    }
    if (self.job.task == TL_TASK_LIVE) {
        return tasks->live(&self.assembly, &self.job, &facts);
    }
    tl_fmu_calls_use(&self.extra->calls);
    send_message(&self, TL_MESSAGE_READY, &facts);
    return tl_exit_code(tl_fmu_thread_run(run_task, &self));
}
