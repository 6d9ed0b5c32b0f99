/* Warm-up of a shadow: starts with start values and simulates the recorded samples before it
 * follows the live plant.
 *
 * Purpose: a twin of another configuration must be locked, with learned state, before it is
 *          compared. It searches as it will do live, with the same budget: over the samples of the
 *          last minute, and those recorded meanwhile; then over the plant's ticks.
 * Load:    after each part it sleeps as long as it has computed, so that it takes at most half a
 *          processor. The live twin has priority.
 * Pace:    if it is not at least 1.2 times as fast as the plant, it never catches up: then this box
 *          is too slow for two twins.
 * Memory:  the caller owns all objects; they must outlive the call.
 * Thread:  the main thread of the shadow's process; FMUs are called in their own thread.
 */
#ifndef TL_FIRMWARE_LIVE_SHADOW_WARM_UP_H
#define TL_FIRMWARE_LIVE_SHADOW_WARM_UP_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/fmu/fmu_thread.h"
#include "firmware/monitor/run_status.h"
#include "firmware/process/heartbeat.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/journal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_shadow_warm_up {
    tl_assembly *assembly; /* its twin is built, and has not started */
    tl_fmu_thread *thread;
    tl_journal *journal;
    tl_thread_heartbeat *heartbeat; /* of the caller */
    tl_time start;                  /* t_start of the live twin's run */
    const tl_config *run;           /* configuration of the live twin: its signals are recorded */
    /* Returns the bytes of an image of recorded samples (resume.h) from this tick on; below 0: from
     * a minute before the newest. 0: there are none (any more). *image is valid until the next
     * call. */
    size_t (*fetch)(void *context, int64_t from, const void **image);
    /* Publishes the progress, with the metrics by matched output. */
    void (*show)(void *context, const tl_run_status *status, const tl_metrics *match);
    void *context; /* of both callbacks */
} tl_shadow_warm_up;

/* Runs until less than two seconds of samples are left, nothing more is recorded, or a signal asks
 * to end. *next is the tick that the twin is ready for; if nothing was recorded, a future one.
 * Errors: TL_TRY_AGAIN: too slow; or the error of a step. */
tl_status tl_shadow_warm_up_run(const tl_shadow_warm_up *course, int64_t *next, tl_error *error);

#endif
