/* Jobs and blocks of the processes of a live run: see live_blocks.h. A packed job is its fields,
 * then path and text of the configuration. */
#include "firmware/live/live_blocks.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/config/config.h"
#include "firmware/plant/live_plant.h"
#include "firmware/twin/checkpointer.h"
#include "firmware/twin/resume.h"

/* ---- jobs ---- */

unsigned char *tl_live_job_pack(const tl_live_job *job, const char *path, const char *text, size_t *size) {
    const size_t path_size = strlen(path) + 1;
    const size_t text_size = strlen(text) + 1;
    *size = sizeof *job + path_size + text_size;
    unsigned char *bytes = malloc(*size);
    if (bytes != NULL) {
        memcpy(bytes, job, sizeof *job);
        memcpy(bytes + sizeof *job, path, path_size);
        memcpy(bytes + sizeof *job + path_size, text, text_size);
    }
    return bytes;
}

tl_status tl_live_job_unpack(const void *bytes, size_t size, tl_live_job *job, const char **path, const char **text,
                             tl_error *error) {
    const char *end = (const char *)bytes + size;
    bool is_closed = size > sizeof *job && end[-1] == '\0';
    *path = is_closed ? (const char *)bytes + sizeof *job : NULL;
    *text = is_closed ? *path + strlen(*path) + 1 : end;
    if (*text == end) {
        return tl_fail(error, TL_BAD_DATA, "the job of a process is invalid");
    }
    memcpy(job, bytes, sizeof *job);
    return TL_OK;
}

void tl_live_job_apply(const tl_live_job *job, tl_config *config) {
    if (job->duration > 0) {
        config->duration = job->duration;
    }
    tl_config_use_lookups(config);
}

tl_status tl_live_job_read(const tl_live_job *job, const char *path, const char *text, tl_config *config,
                           tl_error *error) {
    tl_problems problems;
    tl_problems_init(&problems, path);
    tl_status status = tl_config_read_text(path, text, strlen(text), config, &problems.report);
    if (status != TL_OK) {
        return tl_fail(error, status, "%s: was valid, but a process of the run cannot parse it", path);
    }
    tl_live_job_apply(job, config);
    return TL_OK;
}

tl_status tl_live_job_take(int descriptor, tl_block *block, tl_live_job *job, tl_config *config, tl_error *error) {
    const char *path = NULL;
    const char *text = NULL;
    tl_status status = tl_block_take(descriptor, 0, TL_BLOCK_IS_WRITTEN, block, error);
    if (status == TL_OK) {
        status = tl_live_job_unpack(block->bytes, block->size, job, &path, &text, error);
    }
    return status == TL_OK ? tl_live_job_read(job, path, text, config, error) : status;
}

/* ---- access ---- */

#define ONE(number) (1U << (number))
#define BOTH(number) (3U << (number))

tl_live_access tl_live_access_of(tl_live_kind kind, const tl_live_job *job) {
    const unsigned slot = job->slot_index;
    const uint32_t recorded = ONE(TL_LIVE_RECORDER_STATUS) | BOTH(TL_LIVE_RESUME);
    const tl_live_access accesses[] = {
        [TL_LIVE_IS_IO] = {.reads = ONE(TL_LIVE_RECORDER_STATUS) | BOTH(TL_LIVE_TWIN_STATUS),
                           .writes = ONE(TL_LIVE_SAMPLES) | ONE(TL_LIVE_IO_BEATS) | ONE(TL_LIVE_IO_EVENTS)},
        [TL_LIVE_IS_RECORDER] = {.reads = ONE(TL_LIVE_SAMPLES) | ONE(TL_LIVE_IO_EVENTS) |
                                          ONE(TL_LIVE_SUPERVISOR_EVENTS) | ONE(TL_LIVE_CONFIG_MANAGER_EVENTS) |
                                          ONE(TL_HANDOVER) | BOTH(TL_LIVE_TWIN_STATUS) | ONE(TL_LIVE_TUNING + slot) |
                                          ONE(TL_LIVE_QUEUE + slot),
                                 .writes = ONE(TL_LIVE_RECORDER_STATUS) | BOTH(TL_LIVE_RESUME)},
        [TL_LIVE_IS_CONFIG_MANAGER] = {.reads =
                                           BOTH(TL_LIVE_TWIN_STATUS) | ONE(TL_LIVE_RECORDER_STATUS) | ONE(TL_HANDOVER),
                                       .writes = ONE(TL_LIVE_CONFIG_MANAGER_STATUS) |
                                                 ONE(TL_LIVE_CONFIG_MANAGER_EVENTS) | BOTH(TL_LIVE_TUNING) |
                                                 ONE(TL_LIVE_CANDIDATE)},
        [TL_LIVE_IS_EXPLAINER] = {.reads = 0, .writes = 0},
        [TL_LIVE_IS_TWIN] = {.reads = ONE(TL_LIVE_SAMPLES) | ONE(TL_LIVE_IO_BEATS) | ONE(TL_LIVE_RECORDER_STATUS) |
                                      ONE(TL_HANDOVER) | ONE(TL_LIVE_TUNING + slot) | ONE(TL_LIVE_RESUME + slot),
                             .writes = ONE(TL_LIVE_TWIN_STATUS + slot) | ONE(TL_LIVE_QUEUE + slot)},
    };
    tl_live_access access = accesses[kind];
    if (job->database[0] == '\0') {
        access.reads &= ~recorded;
    }
    return access;
}

void tl_live_block_sizes(const tl_config *config, size_t sizes[TL_LIVE_BLOCKS]) {
    const tl_record_queue_settings events = tl_live_event_queue();
    const tl_record_queue_settings twin = tl_live_twin_queue(config);
    tl_sample_buffers_shape sample_memory;
    tl_sample_buffers_shape_of(config, &sample_memory);
    memset(sizes, 0, TL_LIVE_BLOCKS * sizeof sizes[0]);
    sizes[TL_LIVE_SAMPLES] = tl_sample_buffers_bytes(&sample_memory);
    sizes[TL_LIVE_IO_BEATS] = sizeof(tl_heartbeats);
    sizes[TL_LIVE_RECORDER_STATUS] = sizeof(tl_live_recorder_status);
    sizes[TL_LIVE_IO_EVENTS] = tl_record_queue_bytes(&events);
    sizes[TL_LIVE_SUPERVISOR_EVENTS] = sizes[TL_LIVE_IO_EVENTS];
    sizes[TL_LIVE_CONFIG_MANAGER_EVENTS] = sizes[TL_LIVE_IO_EVENTS];
    sizes[TL_LIVE_CONFIG_MANAGER_STATUS] = sizeof(tl_live_config_manager_status);
    sizes[TL_HANDOVER] = sizeof(tl_handover);
    sizes[TL_LIVE_CANDIDATE] = sizeof(tl_live_candidate);
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
        sizes[TL_LIVE_TWIN_STATUS + i] = sizeof(tl_live_twin_status);
        sizes[TL_LIVE_TUNING + i] = sizeof(tl_live_tuning);
        sizes[TL_LIVE_RESUME + i] = TL_LIVE_RESUME_BYTES;
        sizes[TL_LIVE_QUEUE + i] = tl_record_queue_bytes(&twin);
    }
}

tl_status tl_live_blocks_take(tl_live_kind kind, const tl_live_job *job, const tl_config *config,
                              tl_block blocks[TL_LIVE_BLOCKS], tl_error *error) {
    const tl_live_access access = tl_live_access_of(kind, job);
    size_t sizes[TL_LIVE_BLOCKS];
    tl_status status = TL_OK;
    tl_live_block_sizes(config, sizes);
    for (int i = 0; i < TL_LIVE_BLOCKS && status == TL_OK; i++) {
        bool writes = (access.writes & ONE(i)) != 0;
        if (writes || (access.reads & ONE(i)) != 0) {
            status = tl_block_take(i, sizes[i], writes ? TL_BLOCK_THEY_WRITE : TL_BLOCK_WE_WRITE, &blocks[i], error);
        }
    }
    return status;
}

void tl_live_blocks_pass(tl_live_kind kind, const tl_live_job *job, const tl_block blocks[TL_LIVE_BLOCKS],
                         int descriptors[TL_ROLE_DESCRIPTORS]) {
    const tl_live_access access = tl_live_access_of(kind, job);
    for (int i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        descriptors[i] = -1;
        if (i < TL_LIVE_BLOCKS && (access.writes >> i & 1) != 0) {
            descriptors[i] = fcntl(blocks[i].descriptor, F_DUPFD_CLOEXEC, 0);
        } else if (i < TL_LIVE_BLOCKS && (access.reads >> i & 1) != 0) {
            descriptors[i] = tl_block_reader(&blocks[i]);
        }
    }
}

void tl_live_blocks_close_passed(const int descriptors[TL_ROLE_DESCRIPTORS]) {
    for (int i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        if (descriptors[i] >= 0) {
            (void)close(descriptors[i]);
        }
    }
}

tl_status tl_live_input_open(const tl_config *config, const tl_block *sample_memory, tl_plant_input *input,
                             tl_error *error) {
    tl_sample_buffers_shape shape;
    tl_sample_buffers_shape_of(config, &shape);
    tl_live_plant_set_limits(input, config);
    tl_sample_buffers_open(&shape, sample_memory->bytes, input->buffers);
    return tl_plant_input_open(input) ? TL_OK
                                      : tl_fail(error, TL_TRY_AGAIN, "not enough memory for the plant's readings");
}

/* ---- memory need ---- */

static size_t queue_bytes_with(const tl_config *config, size_t checkpoint) {
    tl_record_queue_settings settings = tl_live_twin_queue(config);
    settings.checkpoint_bytes = checkpoint;
    return tl_record_queue_bytes(&settings);
}

void tl_live_blocks_of(const tl_config *config, size_t checkpoint, tl_live_blocks *blocks) {
    const tl_recorder_shape ticks = tl_recorder_shape_of(config);
    size_t room = tl_checkpointer_room(checkpoint);
    size_t sizes[TL_LIVE_BLOCKS];
    tl_live_block_sizes(config, sizes);
    *blocks = (tl_live_blocks){
        .sample_memory = sizes[TL_LIVE_SAMPLES],
        .queue = queue_bytes_with(config, 0) + sizes[TL_LIVE_IO_BEATS] + 2 * sizes[TL_LIVE_IO_EVENTS] +
                 sizes[TL_LIVE_TWIN_STATUS] + sizes[TL_LIVE_RECORDER_STATUS],
    };
    if (room <= TL_LIVE_CHECKPOINT_BYTES) {
        blocks->checkpoints = queue_bytes_with(config, room) - queue_bytes_with(config, 0);
    }
    if (config->record_resume != 0) {
        blocks->resume = tl_resume_image_bytes(&ticks, TL_RESUME_TICKS, checkpoint, 0);
    }
    blocks->shadow = queue_bytes_with(config, 0) + sizes[TL_LIVE_TWIN_STATUS] + blocks->checkpoints + blocks->resume;
}

/* ---- samples for a shadow ---- */

static void answer_request(tl_live_samples *self, tl_live_request request, const char *path) {
    tl_live_resume_answer *reply = self->answer;
    int64_t from = __atomic_load_n(&self->live_status->resumed_from, __ATOMIC_RELAXED);
    size_t size = 0;
    tl_error error;
    memset(reply->words, 0, sizeof reply->words);
    if (tl_resume_samples_find(path, self->boot, from, self->resume->bytes, self->resume->size, &size, &error) !=
        TL_OK) {
        reply->words[0].severity = (int32_t)TL_EVENT_WARNING;
        (void)snprintf(reply->words[0].text, sizeof reply->words[0].text, "%.200s", error.text);
    }
    reply->size = size;
    self->answered = request;
    self->is_filled = self->is_filled || size != 0;
    __atomic_store_n(&reply->live_request, request, __ATOMIC_RELEASE);
}

void tl_live_samples_answer(tl_live_samples *self, const char *path) {
    tl_live_request request = __atomic_load_n(&self->live_status->resume, __ATOMIC_ACQUIRE);
    bool begun = __atomic_load_n(&self->live_status->begun, __ATOMIC_RELAXED) != 0;
    if (request != 0 && request != self->answered && !begun) {
        answer_request(self, request, path);
    } else if (begun && self->is_filled) {
        tl_block_forget(self->resume);
        self->is_filled = false;
    }
}
