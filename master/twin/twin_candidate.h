/* Candidates outside of a search: does the twin survive a value of an adjusted variable?
 *
 * Purpose: a search may evaluate any value within the bounds, and an FMU may fail at some of them.
 *          `check` tests such values before a run does.
 * Thread:  the twin's. Call these functions between two ticks.
 */
#ifndef TL_MASTER_TWIN_TWIN_CANDIDATE_H
#define TL_MASTER_TWIN_TWIN_CANDIDATE_H

#include <stddef.h>

#include "master/base/status.h"
#include "master/twin/twin.h"

/* Executes one candidate as a search does: T_P steps from the state after the last committed step,
 * with `value` for one adjusted variable and the present values of all others. Then restores that
 * state. The twin must have computed a step. It must not use an event horizon (event_horizon.h).
 * adjust:   index of the adjusted variable.
 * values:   tl_twin_value_count() values at the end of the candidate, 0 for those that are no
 *           output of an FMU; undefined after a failure.
 * *failure: result of the candidate. TL_FMU_FAILED if an FMU rejects a step, or if an output
 *           becomes NaN or infinite; the text begins with the name of the component. Else TL_OK.
 * Returns TL_OK also if the candidate failed. Errors, after which the twin cannot be used any more:
 * TL_FMU_FAILED if a component could not be restored; TL_FMU_FATAL if an FMU returned fmi2Fatal. */
tl_status tl_twin_try_value(tl_twin *twin, size_t adjust, double value, double *values, tl_error *failure,
                            tl_error *error);

#endif
