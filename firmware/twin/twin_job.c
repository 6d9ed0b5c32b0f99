/* The job of a process with a twin: see twin_job.h. */
#include "firmware/twin/twin_job.h"

#include <stdlib.h>
#include <string.h>

/* What lies in the block: this, then the pieces one behind the other. The pointers in `job` mean nothing there. */
typedef struct packed {
    tl_twin_job job;
    size_t path_size; /* with the zero at the end, as the others */
    size_t text_size;
    size_t folder_size;
} packed;

static size_t size_of(const packed *head) {
    return sizeof *head + head->path_size + head->text_size + head->folder_size + head->job.checkpoint_size;
}

static unsigned char *put(unsigned char *place, const void *bytes, size_t size) {
    if (size > 0) {
        memcpy(place, bytes, size);
    }
    return place + size;
}

tl_status tl_twin_job_make(const tl_twin_job *job, tl_block *block, tl_error *error) {
    const packed head = {.job = *job,
                         .path_size = strlen(job->path) + 1,
                         .text_size = strlen(job->text) + 1,
                         .folder_size = strlen(job->folder) + 1};
    size_t size = size_of(&head);
    unsigned char *bytes = calloc(1, size);
    if (bytes == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the job of the process with the FMUs");
    }
    unsigned char *place = put(bytes, &head, sizeof head);
    place = put(place, job->path, head.path_size);
    place = put(place, job->text, head.text_size);
    place = put(place, job->folder, head.folder_size);
    (void)put(place, job->checkpoint, job->checkpoint_size);
    tl_status status = tl_block_make_of("twinlock-job", bytes, size, block, error);
    free(bytes);
    return status;
}

/* The text at `place`, of which the last byte is its end. */
static const char *text_at(const unsigned char *place, size_t size) {
    return size > 0 && place[size - 1] == '\0' ? (const char *)place : NULL;
}

tl_status tl_twin_job_read(const tl_block *block, tl_twin_job *job, tl_error *error) {
    packed head;
    const unsigned char *place = block->bytes;
    if (block->size < sizeof head) {
        return tl_fail(error, TL_BAD_DATA, "the job is too short");
    }
    memcpy(&head, place, sizeof head);
    place += sizeof head;
    size_t left = block->size - sizeof head;
    if (head.path_size > left || head.text_size > left - head.path_size ||
        head.folder_size > left - head.path_size - head.text_size || size_of(&head) != block->size) {
        return tl_fail(error, TL_BAD_DATA, "the job's parts are not as long as it says");
    }
    *job = head.job;
    job->path = text_at(place, head.path_size);
    place += head.path_size;
    job->text = text_at(place, head.text_size);
    place += head.text_size;
    job->folder = text_at(place, head.folder_size);
    place += head.folder_size;
    job->checkpoint = place;
    return job->path != NULL && job->text != NULL && job->folder != NULL
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA, "a text of the job has no end");
}
