/* The live twin: the process of a run that holds the FMUs and the real-time cycle.
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
#ifndef TL_FIRMWARE_LIVE_LIVE_TWIN_H
#define TL_FIRMWARE_LIVE_LIVE_TWIN_H

#include "firmware/process/confine.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_role.h"

/* For tl_twin_role_tasks: what its process does once it is confined. An exit code, which was announced. */
int tl_live_twin(tl_assembly *assembly, const tl_twin_job *job, const tl_confine_facts *facts);

#endif
