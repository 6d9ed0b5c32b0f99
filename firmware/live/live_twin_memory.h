/* What a live twin shares with the other processes of the run, and what it is told at its start.
 *
 * Purpose: takes all blocks that its supervisor has given it (live_wire.h), each of the size that follows from its own configuration.
 * Plant:   a shadow is told of which configuration the run is. If both read the plant alike they have one mail; else the shadow has its own, which nobody
 *          writes yet, and looks up in that of the run what is the same (mail_change.h).
 * Trust:   mails are io's: what is in them is judged by who looks it up. A mail of another size than it should have is not taken.
 * Owner:   the caller places it, zeroed at first; for as long as the process.
 * Thread:  the main thread of the twin's process.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_TWIN_MEMORY_H
#define TL_FIRMWARE_LIVE_LIVE_TWIN_MEMORY_H

#include <stdbool.h>

#include "firmware/config/config_same_signals.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_past.h"
#include "firmware/live/live_wire.h"
#include "firmware/plant/mail_change.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/block.h"
#include "firmware/twin/twin_job.h"

typedef struct tl_live_twin_memory {
    tl_live_job job;
    tl_block mail;
    tl_block run_mail; /* of a shadow with another plant; none once nothing is looked up there any more */
    tl_block pulse_block;
    tl_block outbox_block;
    tl_block tuning_block;
    tl_block stage_block;
    tl_live_memory past;
    tl_live_twin_pulse *pulse;
    const tl_live_mail_end *mail_end;
    tl_plant_input input;
    tl_outbox outbox;
    tl_config run;         /* of a shadow: of the run beside which it is, */
    tl_same_signals same;  /* and what of it is its own */
    tl_mail_change change; /* over, but of a shadow with another plant */
} tl_live_twin_memory;

/* `config` is its own, and gets what its job changes. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_twin_memory_take(tl_live_twin_memory *memory, const tl_twin_job *job, tl_config *config,
                                   tl_error *error);

/* Now and then: gives up the mail of the run before, if nothing is looked up there any more. */
void tl_live_twin_memory_look(tl_live_twin_memory *memory);

#endif
