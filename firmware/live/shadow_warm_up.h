/* Warm-up of a shadow: the shadow starts with start values and simulates the recorded samples.
 * Then it follows the live plant.
 *
 * Purpose: before a twin with another configuration is compared with the live twin, it must be in
 *          lock and have learned what a running twin knows: slope of the outputs, noise of the
 *          measurements. The shadow searches with the budget of a live twin. It simulates the
 *          samples of the last minute and those recorded meanwhile, then the plant's ticks.
 * Load:    after each part (20 ms of computing) the shadow sleeps as long as it has computed. So it
 *          uses at most half a processor. The live twin has priority.
 * Pace:    the warm-up fails if, after 5 s, it is not at least 1.2 times as fast as the plant,
 *          sleeps included. It would hardly catch up: this box is too slow for two twins.
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
#include "firmware/report/journal.h"
#include "firmware/twin/assembly.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_shadow_warm_up {
    tl_assembly *assembly; /* assembly of the shadow: its twin is built, and has not started */
    tl_fmu_thread *thread;
    tl_journal *journal;
    tl_thread_heartbeat *heartbeat; /* of the caller */
    tl_time start;                  /* t_start of the live twin's run, monotonic clock, ns */
    const tl_config *run;           /* configuration of the live twin: its signals are recorded */
    /* Gets the recorded samples from tick `from` on; if `from` < 0, from a minute before the newest
     * sample on. Sets *image to a resume image with them (resume.h), valid until the next call.
     * Returns the size of the image in bytes; 0: there are no more samples. */
    size_t (*fetch)(void *context, int64_t from, const void **image);
    /* Publishes the progress. `match`: metrics of each matched output. */
    void (*show)(void *context, const tl_run_status *status, const tl_metrics *match);
    void *context; /* of both callbacks */
} tl_shadow_warm_up;

/* Ends when less than two seconds of samples are left, when fetch() has no more samples, or when
 * SIGTERM or the like asks the process to end. Sets *next to the first tick that the shadow has not
 * simulated; if there are no recorded samples, or the newest are older than 10 s, to a future tick.
 * Errors: TL_TRY_AGAIN if the box is too slow; or the error of a step. */
tl_status tl_shadow_warm_up_run(const tl_shadow_warm_up *course, int64_t *next, tl_error *error);

#endif
