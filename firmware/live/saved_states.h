/* Saved-state test: can another process load what the FMUs of a run save? Done before the first
 * twin starts; the result is saved.
 *
 * Purpose: a checkpoint that crashes the process that loads it costs a start. If it loads, but the
 *          FMU continues differently, that is never noticed. So a worker (worker.h) tests the FMUs
 *          while io reads the plant. The log has no output of the worker: the run reports other
 *          errors of the FMUs.
 * Memory:  the result is saved to FOLDER/states.json. Its key is computed from the content of the
 *          FMU files, their rollback methods, the step and the version of this program. So the test
 *          costs two starts of the FMUs only once. Without a folder every start would need it, so
 *          it is skipped.
 * Bad:     if the FMUs crash, hang, or need more than 300 s, their states count as unusable, and
 *          the test is not repeated. An interrupted test, or one that could not start, is not
 *          saved.
 * Trust:   the answer comes from a process with FMUs, and affects only their own run: it is cleaned
 *          and bounded.
 * Errors:  none is returned; without a result, nothing is assumed against the FMUs.
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_LIVE_SAVED_STATES_H
#define TL_FIRMWARE_LIVE_SAVED_STATES_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/config/config.h"
#include "firmware/live/supervisor.h"
#include "firmware/retune/worker.h"

typedef struct tl_saved_states {
    const tl_config *config; /* as read; the caller sets the first four and zeroes the rest */
    bool unconfined;
    uint64_t memory_limit;                       /* of an FMU process; 0: tl_confine_fair_memory() */
    int (*be)(const char *title, void *context); /* main function, without exec (role.h) */
    uint64_t files;                              /* number of unusable FMU files; 0: none known */
    char why[TL_TWIN_CHECK_WHY];                 /* the reason, if `files` is not 0 */
    /* private */
    uint64_t number;          /* of the FMU files */
    char key[TL_SHA256_TEXT]; /* of the saved result */
    char path[PATH_MAX];
    bool is_due; /* the test is to be done, or is running */
    tl_worker worker;
    tl_time begun;    /* start of the test */
    bool is_reported; /* the long test was logged */
} tl_saved_states;

/* Identifies the FMU files and loads the saved result. `folder` NULL: nothing is tested. The
 * configuration must outlive `states`. */
void tl_saved_states_open(const char *folder, tl_saved_states *states);

/* Starts the test if necessary, and polls it without blocking. Returns whether the twin must wait:
 * TL_WAIT_LONG after 10 s. Logs a notice after 3 s. */
tl_wait tl_saved_states_check(tl_saved_states *states);

/* Kills the test without a result. Does nothing if none is running. */
void tl_saved_states_stop(tl_saved_states *states);

#endif
