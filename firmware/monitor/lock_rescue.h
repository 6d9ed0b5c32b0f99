/* Bringing back a twin that is lost: when its FMUs shall begin anew.
 *
 * Purpose: a twin can get to where no correction leads back from; its FMUs then begin anew with their start values (tl_twin_reset()). That
 *          takes the judge's word that it is astray, and is not done for ever: each time it did not help the pause is twice as long.
 * Same:    it follows from records and samples alone, so that a replay does what the run did.
 * Thread:  plain data; that of the twin.
 */
#ifndef TL_FIRMWARE_MONITOR_LOCK_RESCUE_H
#define TL_FIRMWARE_MONITOR_LOCK_RESCUE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/monitor/lock_judge.h"

/* Parts of the judge's window. */
enum { TL_LOCK_PAUSE_FIRST = 20, TL_LOCK_PAUSE_LAST = 6000 };

/* Fields are private. */
typedef struct tl_lock_rescue {
    tl_lock_judge judge;
    uint64_t windows; /* that were judged when it was looked at last */
    uint32_t pause;   /* parts after a reset; 0: there was none that is not forgotten */
    uint32_t passed;  /* since it */
    uint32_t well;    /* parts in lock, one after the other */
} tl_lock_rescue;

/* As tl_lock_judge_init(). With an event horizon a twin is never brought back: its steps are not compared. */
void tl_lock_rescue_init(tl_lock_rescue *rescue, const tl_config *config, const tl_account *account);

void tl_lock_rescue_sample(tl_lock_rescue *rescue, const tl_sample *sample);

/* A step. True: the FMUs shall begin anew before the next one. *change as the judge says, or NULL. */
bool tl_lock_rescue_step(tl_lock_rescue *rescue, const tl_record *record, const tl_lock_change **change);

#endif
