/* Selects the version with which a run starts.
 *
 * Purpose: the first version is the configuration file on the box. A later version may have become
 *          active during a run; then the next run starts with that. If the file has changed since
 *          it was read last, the file is a candidate.
 * Steps:   a worker validates the candidate (worker.h). If it is valid, it runs on probation and
 *          may be rolled back to the version before. Else the active version runs, and the reason
 *          is logged.
 * Failure: if a run with a version on probation fails, the version before becomes active again
 *          (tl_version_start_failed()).
 * Names:   the text of a start names the version that runs, its file, and a different content of
 *          the file with the reason why it does not run.
 * Disk:    a disk that rejects writes does not prevent the run. The run starts with the text that
 *          can be read. An error is logged, because this text is not saved as a version.
 * Waiting: for the validator, at most about 20 s.
 * Thread:  the main thread, before the run.
 */
#ifndef TL_FIRMWARE_RETUNE_VERSION_START_H
#define TL_FIRMWARE_RETUNE_VERSION_START_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

/* Bytes of the text that names the configuration of a start. */
enum { TL_VERSION_RUNNING = 512 };

typedef struct tl_version_start {
    const char *state;                                 /* the folder that contains versions/ */
    const char *path;                                  /* of the configuration file */
    int (*run_role)(const char *title, void *context); /* runs the worker's role, as in worker.h */
} tl_version_start;

/* Sets *text to the text of the version to run, *size bytes and a final NUL; the caller calls
 * free(). Writes to `running` which version that is, and whether the file has another content. If a
 * changed file was rejected, logs which version runs instead. Errors: TL_BAD_DATA if no
 * configuration can be read; TL_TRY_AGAIN. */
tl_status tl_version_start_choose(const tl_version_start *start, char **text, size_t *size,
                                  char running[TL_VERSION_RUNNING], tl_error *error);

/* Call it if the run ended with an error, `reason`. If a version was on probation, rolls it back
 * and returns true; then the run can be restarted. */
bool tl_version_start_failed(const tl_version_start *start, const char *reason);

#endif
