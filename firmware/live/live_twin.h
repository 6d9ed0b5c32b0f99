/* The twin of a live run, in the process with the FMUs.
 *
 * Thread:  the cycle's.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_TWIN_H
#define TL_FIRMWARE_LIVE_LIVE_TWIN_H

#include <stdbool.h>

#include "firmware/live/live_job.h"
#include "firmware/live/live_past.h"
#include "firmware/live/live_wire.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/block.h"
#include "firmware/process/confine.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_job.h"

/* ---- What a live twin shares with the other processes of the run, and what it is told at its start.
 *
 * Purpose: takes all blocks that its supervisor has given it (live_wire.h), each of the size that follows from its own configuration.
 * Plant:   a shadow reads the mail of the run, as the run's twin does. It is told the run's configuration, to understand the recorded samples.
 * Trust:   the mail is io's: what is in it is judged by who looks it up. A mail of another size than it should have is not taken.
 * Owner:   the caller places it, zeroed at first; for as long as the process.
 * Thread:  the main thread of the twin's process.
 */

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

/* ---- The live twin: the process of a run that holds the FMUs and the real-time cycle.
 *
 * Purpose: builds the twin, goes on where an earlier one was ended, keeps it locked to the plant until it is told to end, and hands all that is
 *          to be kept to the recorder. Or, told to hold: reads and records the plant's samples without any FMU.
 * Holds:   nothing but that (confine.h). It reads the mailboxes that io writes; it writes its outbox and its pulse.
 * Past:    if a process before it has died in the same run, it goes on from the newest checkpoint in the outbox and what was put since. Else
 *          it asks the recorder, who reads the database.
 * Shadow:  a twin of another configuration beside the run's, in the other place (live_stage.h): it is led over what is recorded, then over the plant's
 *          ticks. What happens in it goes to the log only; a flip makes it the run's twin, and the run's twin a shadow. One that cannot keep pace ends.
 * Thread:  the main thread of its process; FMUs and cycle have another one.
 */

/* For tl_twin_role_tasks: what its process does once it is confined. An exit code, which was announced. */
int tl_live_twin(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts);

#endif
