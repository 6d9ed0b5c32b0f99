/* How a twin shows what it does: its figures, in its pulse, for whoever shows and compares them (tl_live_figures).
 *
 * Thread: one at a time. What is pointed to must stay.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_SHOWN_H
#define TL_FIRMWARE_LIVE_LIVE_SHOWN_H

#include "firmware/base/latest.h"
#include "firmware/config/config.h"
#include "firmware/live/live_wire.h"
#include "firmware/live/recorded_course.h"
#include "firmware/twin/cycle.h"
#include "master/twin/account.h"

typedef struct tl_live_shown {
    const tl_config *config;      /* for the names of what is matched, */
    const tl_account *account;    /* and its units */
    const tl_live_mail_end *mail; /* that it reads once it is the run's */
    tl_latest *figures;           /* of the pulse */
} tl_live_shown;

/* A shadow over recorded samples. */
void tl_live_shown_recorded(const tl_live_shown *shown, const tl_recorded_figures *recorded);

/* At the plant's ticks, or making up what was missed before. */
void tl_live_shown_live(const tl_live_shown *shown, const tl_cycle_status *status);

#endif
