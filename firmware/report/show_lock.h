/* How much of a run was in which state of the lock, by the events that told its changes.
 *
 * Purpose: the database has no state for each step, but each change of it, with its tick. What is before the first one counts as that, as it does for the judge
 *          (lock_judge.h), unless the run's first steps are gone.
 * Strokes: with an event horizon the judge counts strokes; here are the steps that they took.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_SHOW_LOCK_H
#define TL_FIRMWARE_REPORT_SHOW_LOCK_H

#include <stdint.h>

#include "firmware/monitor/lock_tally.h"
#include "firmware/store/history.h"

/* Of the steps range[0] … range[1]. A tally without a step: no event tells of it. Errors: as of tl_history_events(). */
tl_status tl_show_lock(tl_history *history, const tl_history_run *run, const int64_t range[2], tl_lock_tally *tally,
                       tl_error *error);

#endif
