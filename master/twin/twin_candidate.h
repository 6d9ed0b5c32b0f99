/* Candidates outside of a search, for `check`: does the twin survive a value of an adjusted
 * variable, and how fast do the matched outputs react to it?
 *
 * Purpose: a search may evaluate any value within the bounds, and an FMU may fail at some of them.
 *          A search over a horizon much shorter than the reaction finds nothing to correct.
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

/* Returns the present nominal u of an adjusted variable: it may come from the plant. */
double tl_twin_present_nominal(const tl_twin *twin, size_t adjust);

/* Measures how all outputs of `match` respond to a lasting change of one adjusted variable.
 * Executes `steps` steps from the state after the last committed step with nominal u, then again
 * with `change` added to nominal of this variable. Then restores that state. The plant's signals
 * keep their newest values. For the same twins as tl_twin_try_value().
 * response: [steps][number of match]: y with the change minus y without it, after each step; NaN if
 *           one of them is not finite; undefined after a failure.
 * *failure: TL_FMU_FAILED if an FMU rejects a step. TL_TRY_AGAIN if an FMU is rolled back by
 *           replay; then nothing is executed. Else TL_OK.
 * Returns TL_OK also after a failure. Errors: those of tl_twin_try_value(). */
tl_status tl_twin_respond(tl_twin *twin, size_t adjust, double change, size_t steps, double *response,
                          tl_error *failure, tl_error *error);

#endif
