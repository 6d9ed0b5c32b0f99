/* The job of a process of a run: see live_job.h. Fields, then path and text of the configuration, each with its NUL. */
#include "firmware/live/live_job.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/config/problems.h"

tl_status tl_live_job_make(const tl_live_job *job, const tl_config *config, tl_block *block, tl_error *error) {
    size_t path = strlen(config->path) + 1;
    size_t text = strlen(config->text) + 1;
    unsigned char *bytes = malloc(sizeof *job + path + text);
    if (bytes == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration");
    }
    memcpy(bytes, job, sizeof *job);
    memcpy(bytes + sizeof *job, config->path, path);
    memcpy(bytes + sizeof *job + path, config->text, text);
    tl_status status = tl_block_make_of("twinlock job", bytes, sizeof *job + path + text, block, error);
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

tl_status tl_live_job_take(int descriptor, tl_block *block, tl_live_job *job, tl_config *config, tl_error *error) {
    tl_problems problems;
    tl_status status = tl_block_take(descriptor, 0, TL_BLOCK_IS_WRITTEN, block, error);
    const char *path = status == TL_OK && block->size > sizeof *job ? text_at(block, sizeof *job) : NULL;
    const char *text = path == NULL ? NULL : text_at(block, sizeof *job + strlen(path) + 1);
    if (status != TL_OK || text == NULL) {
        return status != TL_OK ? status : tl_fail(error, TL_BAD_DATA, "the job of a process is none");
    }
    memcpy(job, block->bytes, sizeof *job);
    tl_problems_init(&problems, path);
    status = tl_config_read_text(path, text, strlen(text), config, &problems.report);
    if (status != TL_OK) {
        return tl_fail(error, status, "%s was read differently by a process of the run", path);
    }
    tl_live_job_apply(job, config);
    return TL_OK;
}
