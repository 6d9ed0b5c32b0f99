/* Going on with a past: the new twin is brought to where an earlier run was ended.
 *
 * Purpose: the twin loads the checkpoint, or begins with the FMUs' start values, and is led along the ticks of the past without a
 *          search; before the steps before which the FMUs of that run began anew, its own do too. The time in which nobody ran is missed ticks
 *          then, for the cycle to make up.
 * Own:     what is followed is recorded again, as the new run's, and so is the checkpoint: it then needs nothing of the earlier
 *          run, for its replay, or when it is itself ended before it has got any further.
 * Waiting: nobody is late while a twin goes on, so room in the outbox is waited for, for two seconds in all; what finds none after that is lost.
 * Thread:  that of the FMUs, before the cycle starts.
 */
#ifndef TL_FIRMWARE_TWIN_PAST_FOLLOW_H
#define TL_FIRMWARE_TWIN_PAST_FOLLOW_H

#include "firmware/report/summary.h"
#include "firmware/store/outbox.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/past.h"
#include "master/base/status.h"

typedef enum tl_past_outcome {
    TL_PAST_FOLLOWED, /* the twin is there */
    TL_PAST_REFUSED, /* its checkpoint is of no use. Nothing was recorded, and the twin is a new one again: try an older past */
    TL_PAST_FAILED /* the same, but a run was begun, and has got steps of the attempt: end it, and begin another, anew */
} tl_past_outcome;

typedef struct tl_past_follow_settings {
    tl_assembly *assembly; /* its twin has not begun, and may be built anew */
    tl_outbox *outbox;     /* into which the new run goes; NULL: nothing is recorded */
    tl_past_tell *tell;
    void *context; /* of tell */
} tl_past_follow_settings;

/* Leads the twin, and fills the summary, in which `resumption` says what was done; of what does not go well it is zeros.
 * Errors: TL_FMU_FATAL, or what building the twin anew has met. */
tl_status tl_past_follow(const tl_past_follow_settings *settings, const tl_past *past, tl_summary *summary,
                         tl_past_outcome *outcome, tl_error *error);

#endif
