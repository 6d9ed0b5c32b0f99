/* Saved-state test: tests whether another process can load the states that the FMUs of a run save.
 * The test runs before the first twin starts; its result is saved.
 *
 * Purpose: a checkpoint contains saved states. If it crashes the process that loads it, a start
 *          fails. If it loads, but the FMU then computes other values, no later check detects that.
 *          So a worker (worker.h) tests the FMUs while io reads the plant. The output of the worker
 *          is not logged, because the run reports other errors of the FMUs.
 * Later:   while a twin loads a state, and until it is trusted, `loads` of its status block is 1
 *          (live_blocks.h). If the twin ends meanwhile, the next one loads no checkpoint. Unless
 *          another program ended it, states of these FMUs are not saved or loaded from then on.
 * Memory:  the result is saved to FOLDER/states.json. The result has a key, computed from the
 *          content of the FMU files, their rollback methods, the step and the version of this
 *          program. A test loads the FMUs in two processes; it is repeated only if the key has
 *          changed. Without a folder each start would repeat the test, so there is no test.
 * Bad:     if the FMUs crash, hang, or need more than 300 s, their states count as unusable, and
 *          the test is not repeated. An interrupted test, or one that could not start, is not
 *          saved.
 * Trust:   the result comes from a process with FMUs, and affects only the run of these FMUs. Its
 *          text is cleaned, and the length of the text is bounded.
 * Errors:  no function returns one. Without a result the states count as usable.
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
    const tl_config *config; /* as read; the caller sets the first four fields and zeroes the rest */
    bool unconfined;
    uint64_t memory_limit;                             /* bytes for an FMU process; 0: tl_confine_fair_memory() */
    int (*run_role)(const char *title, void *context); /* runs the worker without exec (role.h) */
    uint64_t files;              /* result: identity number of the FMU files if their states are unusable; else 0 */
    char why[TL_TWIN_CHECK_WHY]; /* result: the reason, if `files` is not 0 */
    /* private */
    uint64_t number;          /* identity number of the FMU files (identity.h) */
    char key[TL_SHA256_TEXT]; /* of the saved result */
    char path[PATH_MAX];
    bool is_due; /* the test must still start, or is running */
    tl_worker worker;
    tl_time begun;    /* start of the test, monotonic clock */
    bool is_reported; /* the wait for the test was logged */
} tl_saved_states;

/* Identifies the FMU files and loads the saved result. `folder` NULL: nothing is tested. The
 * configuration must outlive `states`. */
void tl_saved_states_open(const char *folder, tl_saved_states *states);

/* Starts the test if necessary, and polls it without blocking. Returns how the first twin must
 * wait: TL_WAIT_BRIEF during the test, TL_WAIT_LONG from 10 s on, TL_WAIT_OVER without a test. Logs
 * a notice after 3 s. */
tl_wait tl_saved_states_check(tl_saved_states *states);

/* Kills the worker of the test; no result is saved. Does nothing if no test is running. */
void tl_saved_states_stop(tl_saved_states *states);

#endif
