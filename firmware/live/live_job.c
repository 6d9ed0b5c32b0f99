/* The job of a process of a run: see live_job.h. Fields, then path and text of the configuration, each with its NUL. */
#include "firmware/live/live_job.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/config/problems.h"

static unsigned char *join(const tl_live_job *job, const char *first, size_t first_size, const char *second,
                           size_t second_size) {
    unsigned char *bytes = malloc(sizeof *job + first_size + second_size);
    if (bytes != NULL) {
        memcpy(bytes, job, sizeof *job);
        memcpy(bytes + sizeof *job, first, first_size);
        memcpy(bytes + sizeof *job + first_size, second, second_size);
    }
    return bytes;
}

tl_status tl_live_job_make(const tl_live_job *job, const char *path, const char *text, tl_block *block,
                           tl_error *error) {
    const size_t path_size = strlen(path) + 1;
    const size_t text_size = strlen(text) + 1;
    unsigned char *bytes = join(job, path, path_size, text, text_size);
    tl_status status = bytes == NULL
                           ? tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration")
                           : tl_block_make_of("twinlock job", bytes, sizeof *job + path_size + text_size, block, error);
    free(bytes);
    return status;
}

/* NULL: it does not end in the block. */
static const char *text_at(const tl_block *block, size_t at) {
    const char *bytes = block->bytes;
    return at < block->size && memchr(bytes + at, '\0', block->size - at) != NULL ? bytes + at : NULL;
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
        return tl_fail(error, status, "%s was read differently by a process of the run", path);
    }
    tl_live_job_apply(job, config);
    return TL_OK;
}

tl_status tl_live_job_take(int descriptor, tl_block *block, tl_live_job *job, tl_config *config, tl_error *error) {
    tl_status status = tl_block_take(descriptor, 0, TL_BLOCK_IS_WRITTEN, block, error);
    const char *path = status == TL_OK && block->size > sizeof *job ? text_at(block, sizeof *job) : NULL;
    const char *text = path == NULL ? NULL : text_at(block, sizeof *job + strlen(path) + 1);
    if (status != TL_OK || text == NULL) {
        return status != TL_OK ? status : tl_fail(error, TL_BAD_DATA, "the job of a process is none");
    }
    memcpy(job, block->bytes, sizeof *job);
    return tl_live_job_read(job, path, text, config, error);
}

/* ---- of a twin ---- */

unsigned char *tl_live_job_pack(const tl_live_job *job, const char *of_run, size_t *size) {
    *size = sizeof *job + strlen(of_run) + 1;
    return join(job, of_run, strlen(of_run) + 1, "", 0);
}

tl_status tl_live_job_unpack(const unsigned char *bytes, size_t size, tl_live_job *job, const char **of_run,
                             tl_error *error) {
    if (size <= sizeof *job || bytes[size - 1] != '\0') {
        return tl_fail(error, TL_BAD_DATA, "the job of the twin is none");
    }
    memcpy(job, bytes, sizeof *job);
    *of_run = (const char *)bytes + sizeof *job;
    return TL_OK;
}
