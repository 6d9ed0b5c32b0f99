/* Selects the version of the configuration with which a run starts.
 *
 * Purpose: the first version is the configuration file on the box. If another version became active
 *          during a run, the next run starts with that version. If the file has changed since a
 *          start or a reload processed it last, the file is a candidate.
 * Steps:   a worker validates the candidate (worker.h). If the candidate is valid, the run starts
 *          with it, on probation: it may be rolled back to the version before. Else the active
 *          version runs, and the reason is logged.
 * Failure: if a run with a version on probation fails, the version before becomes active again
 *          (tl_version_start_failed()).
 * Names:   the text `running` names the version that runs and the configuration file. If the file
 *          has another content, also that content and why it does not run.
 * Disk:    a disk that rejects writes does not prevent the run. The run starts with a text that can
 *          be read. If this text cannot be saved as a version, an error is logged.
 * Waiting: for the validator, at most about 20 s.
 * Thread:  the main thread, before the run.
 */
#ifndef TL_FIRMWARE_RETUNE_VERSION_START_H
#define TL_FIRMWARE_RETUNE_VERSION_START_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

/* Bytes of the text `running`, see Names. */
enum { TL_VERSION_RUNNING = 512 };

typedef struct tl_version_start {
    const char *state;                                 /* the folder that contains versions/ */
    const char *path;                                  /* of the configuration file */
    int (*run_role)(const char *title, void *context); /* as in tl_worker_settings (worker.h) */
} tl_version_start;

/* Sets *text to the text of the version with which the run starts, *size bytes and a final NUL; the
 * caller calls free(). Writes `running`, see Names. If a changed file was rejected, logs which
 * version runs instead. Errors: TL_BAD_DATA if no configuration can be read; then *text is NULL. */
tl_status tl_version_start_choose(const tl_version_start *start, char **text, size_t *size,
                                  char running[TL_VERSION_RUNNING], tl_error *error);

/* Call it if the run ended with an error, `reason`. If a version was on probation, rolls it back
 * and returns true; then the run can be restarted. */
bool tl_version_start_failed(const tl_version_start *start, const char *reason);

#endif
