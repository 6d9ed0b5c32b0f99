/* The job of a process with a twin: see twin_job.h. */
#include "firmware/twin/twin_job.h"

#include <stdlib.h>
#include <string.h>

/* In this order; the texts with the zero at their end. */
enum { PATH, TEXT, FOLDER, CHECKPOINT, TUNINGS, LIVE, PIECES };

/* What lies in the block: this, then the pieces one behind the other. Pointers and sizes in `job` mean nothing there. */
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
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the job of the process with the FMUs");
    }
    memcpy(bytes, &head, sizeof head);
    unsigned char *place = bytes + sizeof head;
    for (size_t i = 0; i < PIECES; i++) {
        if (head.sizes[i] > 0) {
            memcpy(place, pieces[i], head.sizes[i]);
        }
        place += head.sizes[i];
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
    job->checkpoint_size = head.sizes[CHECKPOINT];
    job->tunings = pieces[TUNINGS];
    job->tunings_size = head.sizes[TUNINGS];
    job->live = pieces[LIVE];
    job->live_size = head.sizes[LIVE];
    return TL_OK;
}
