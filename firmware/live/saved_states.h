/* Whether another process can use what the FMUs of a run save: tried before its first twin begins, and remembered.
 *
 * Purpose: a checkpoint that ends the process that loads it costs a start; one that is loaded and goes on otherwise is noticed by nobody. So the FMUs are
 *          tried by a process of its own (worker.h) beside the supervisor, which reads the plant meanwhile. Nothing of that process is heard on the log: what
 *          is wrong with the FMUs otherwise the run will say.
 * Memory:  FOLDER/states.json, by the contents of the FMU files, how they are rolled back, the step and the version of this program. So the trial costs two
 *          starts of the FMUs once. Without a folder it would cost that at each start, and is left out.
 * Bad:     FMUs that crash or hang in the trial, or need more than 300 s, count as ones whose states cannot be used, and are not tried again either.
 *          What was interrupted, or could not begin, is not remembered.
 * Trust:   the answer comes from beside the FMUs, and harms only their own run: it is cleaned, and bounded.
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
    const tl_config *config; /* as it was read; this and the next three are set by the user, the rest is zeroed */
    bool unconfined;
    uint64_t memory_limit; /* bytes that the process of the FMUs may take; 0: tl_confine_fair_memory() */
    int (*be)(const char *title, void *context); /* where there is no exec (role.h) */
    uint64_t files; /* number of the FMU files whose saved states are of no use; 0: nothing is known against them */
    char why[TL_TWIN_CHECK_WHY]; /* then: why */
    /* private */
    uint64_t number;          /* of the FMU files */
    char key[TL_SHA256_TEXT]; /* by which they are remembered */
    char path[PATH_MAX];
    bool is_due; /* they are to be tried, or are being tried, */
    tl_worker worker;
    tl_time begun; /* since when */
    bool is_told;  /* that it takes long */
} tl_saved_states;

/* Reads the FMU files and what is remembered of them. Without a folder (NULL) nothing is tried. The configuration must stay. */
void tl_saved_states_open(const char *folder, tl_saved_states *states);

/* Does not wait. Begins the trial if it is due, and tells whether the twin has to wait for it: TL_WAIT_LONG after 10 s. After 3 s the log says so. */
tl_wait tl_saved_states_look(tl_saved_states *states);

/* Kills the trial: nothing comes of it. There need not be one. */
void tl_saved_states_stop(tl_saved_states *states);

#endif
