/* Why an FMU does not come back to where it was: found out by leading it back in several ways.
 *
 * Purpose: a word for who asks the FMU's vendor, or reads of it. Each is by what was seen, and not by what exporter it is. It takes a copy of all that the FMU knows
 *          beside its states (tl_component_keep()), to which it always comes back.
 * Thread:  the twin's. It takes some twenty steps, and so the time of none that has a deadline.
 */
#ifndef TL_MASTER_SYNC_RESTORE_CAUSE_H
#define TL_MASTER_SYNC_RESTORE_CAUSE_H

#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/fmi/component.h"
#include "master/sync/record.h"

/* A component that stands at the beginning of `step`, and what it is given in `steps` steps from there on. */
typedef struct tl_restore_trial {
    tl_component *component;
    tl_time macro_step; /* ns */
    int64_t step;
    unsigned steps;
    fmi2FMUstate state;          /* one that there is, or NULL */
    const unsigned char *inputs; /* of the steps, one behind the other, so many bytes apart; */
    size_t input_bytes;
    const unsigned char *elsewhere; /* what leads it far from there, in as many steps; NULL: that is not tried */
    unsigned char *outputs;         /* scratch: the same, of steps + 1 */
    size_t output_bytes;
} tl_restore_trial;

/* What that means, for people: "incomplete state: …"; "" of one that says nothing. */
const char *tl_restore_cause_text(tl_restore_cause cause);

/* The component has been kept, and stands where it did afterwards; what is in its ports is anything. Errors: TL_FMU_FAILED: it could not be brought back;
 * TL_FMU_FATAL. */
tl_status tl_restore_cause_find(const tl_restore_trial *trial, tl_restore_cause *cause, tl_error *error);

#endif
