/* What a live twin shares with the other processes of the run, and what it is told at its start.
 *
 * Purpose: takes all blocks that its supervisor has given it (live_wire.h), each of the size that follows from its own configuration.
 * Plant:   a shadow reads the mail of the run, as the run's twin does. It is told the run's configuration, to understand the recorded samples.
 * Trust:   the mail is io's: what is in it is judged by who looks it up. A mail of another size than it should have is not taken.
 * Owner:   the caller places it, zeroed at first; for as long as the process.
 * Thread:  the main thread of the twin's process.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_TWIN_MEMORY_H
#define TL_FIRMWARE_LIVE_LIVE_TWIN_MEMORY_H

#include <stdbool.h>

#include "firmware/live/live_job.h"
#include "firmware/live/live_past.h"
#include "firmware/live/live_wire.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/block.h"
#include "firmware/twin/twin_job.h"

typedef struct tl_live_twin_memory {
    tl_live_job job;
    tl_block mail;
    tl_block pulse_block;
    tl_block outbox_block;
    tl_block tuning_block;
    tl_block stage_block;
    tl_live_memory past;
    tl_live_twin_pulse *pulse;
    const tl_live_mail_end *mail_end;
    tl_plant_input input;
    tl_outbox outbox;
    tl_config run; /* of a shadow: the configuration of the run beside which it is */
} tl_live_twin_memory;

/* `config` is its own, and gets what its job changes. Errors: TL_BAD_DATA, TL_TRY_AGAIN. */
tl_status tl_live_twin_memory_take(tl_live_twin_memory *memory, const tl_twin_job *job, tl_config *config,
                                   tl_error *error);

#endif
