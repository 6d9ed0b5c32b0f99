/* The version that a run begins with.
 *
 * Purpose: the file on the box is the first version. Later the active one may be another, that came while the plant ran: then a run begins with that one,
 *          unless somebody has changed the file since, which is then a candidate like any other.
 * Steps:   such a candidate is validated by a process of its own (worker.h). If it is good it is on probation, with the one before to
 *          return to; else the active version runs, and a line says why.
 * Also:    if a run with a version on probation cannot even begin, the one before is brought back (tl_version_start_failed()).
 * Disk:    one that refuses keeps no twin from its plant: what can be read runs, and the log says that it is no version.
 * Waiting: for the validator, some 20 s at most.
 * Thread:  the main thread, before the run.
 */
#ifndef TL_FIRMWARE_RETUNE_VERSION_START_H
#define TL_FIRMWARE_RETUNE_VERSION_START_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

typedef struct tl_version_start {
    const char *state;                           /* the folder in which versions/ is */
    const char *path;                            /* of the file */
    int (*be)(const char *title, void *context); /* as in worker.h */
} tl_version_start;

/* The text to run, with a NUL behind it: the caller's to free(). What a person should know was said on the log.
 * Errors: TL_BAD_DATA if there is no configuration that can be read, TL_TRY_AGAIN. */
tl_status tl_version_start_choose(const tl_version_start *start, char **text, size_t *size, tl_error *error);

/* The run ended with an error. True: it was on probation, and was returned from; another run may begin. */
bool tl_version_start_failed(const tl_version_start *start, const char *reason);

#endif
