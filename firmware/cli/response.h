/* Response of the matched outputs to the adjusted variables, for `check`.
 *
 * Purpose: a search simulates T_P steps only. If the whole range of a variable hardly moves a
 *          matched output within T_P, the search finds nothing to correct. T_D does not show this:
 *          T_D counts components, not their time constants.
 * Method:  two free runs of a twin that has begun, with constant signals of the plant: one with a
 *          lasting change of the variable, by one `step` at most, and one without. The effect of
 *          larger changes is extrapolated linearly.
 * Not for: an event horizon, Boolean variables, FMUs that are rolled back by replay, and those that
 *          are too slow for T_P steps.
 * Thread:  the FMU thread. The twin remains as it was.
 */
#ifndef TL_FIRMWARE_CLI_RESPONSE_H
#define TL_FIRMWARE_CLI_RESPONSE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/twin/assembly.h"
#include "master/base/simtime.h"

/* Response to one adjusted variable. */
typedef struct tl_response {
    bool is_known;  /* false: nothing was measured, and the other fields are 0 */
    bool has_range; /* the variable has both bounds; false: its range counts as ten times its `step` each way */
    size_t match;   /* index of the matched output that moves by a tolerance first; if none does, that moves most */
    double soon;  /* largest movement of this output within T_P, by one `step` of the variable; in the output's unit */
    double most;  /* as `soon`, but within `length` */
    tl_time half; /* time to half of `most`, ns */
    tl_time length;    /* simulated duration of each free run, ns */
    double tolerances; /* movement within T_P by the whole range of the variable, in tolerances */
    uint32_t steps;    /* steps until the whole range has moved it by a tolerance; 0: not within `length` */
} tl_response;

/* Usual value of `longest` below, ns. */
#define TL_RESPONSE_LONGEST (TL_SECOND / 4)

/* Fills one entry per adjusted variable. A failure of an FMU leaves the entry unknown. `step_time`:
 * duration of a free step on this machine, ns. `longest`: limit of the computing time for all
 * variables together, ns; 0: measures nothing. Errors: those of tl_twin_respond(). */
tl_status tl_response_measure(const tl_assembly *assembly, tl_time step_time, tl_time longest,
                              tl_response responses[TL_MAX_ADJUST], tl_error *error);

#endif
