/* The recorded part of a shadow's course: it begins with start values, and is led over what was recorded of the plant, before it is live.
 *
 * Purpose: a twin of another configuration shall have found its lock, and have learnt, before it is compared. It searches as it will live, with the same
 *          budget, over the samples of the last minute, and of what has been recorded meanwhile; then over the plant's ticks.
 * Room:    after each piece it sleeps as long as it has computed, so that it takes half a processor at most: the run's twin comes first.
 * Pace:    if it is not faster than 1.2 times the plant, it never gets there: then the box does not carry two twins.
 * Thread:  the main thread of the shadow's process; FMUs are called in theirs.
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
    tl_assembly *assembly; /* its twin is built, and has not begun */
    tl_fmu_thread *thread;
    tl_journal *journal;
    tl_thread_heartbeat *heartbeat; /* of the caller */
    tl_time start;                  /* t_start of the run, */
    const tl_config *run;           /* and its configuration: what is recorded is of its signals */
    /* An image of samples (resume.h) from this tick on, below 0 from a minute before the newest on; it stays until the next call. 0: there is
     * none (any more). */
    size_t (*fetch)(void *context, int64_t from, const void **image);
    /* Told now and then: counts, and by match. */
    void (*show)(void *context, const tl_run_status *status, const tl_metrics *match);
    void *context; /* of both */
} tl_shadow_warm_up;

/* Until less than two seconds are left, or nothing more is recorded, or a signal asks to end. *next is the tick that the twin is ready for; if
 * nothing was recorded, one that is still to come.
 * Errors: TL_TRY_AGAIN: the pace; or what a step has met. */
tl_status tl_shadow_warm_up_run(const tl_shadow_warm_up *course, int64_t *next, tl_error *error);

#endif
