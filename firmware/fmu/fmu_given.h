/* What an FMU was given last, kept with each of its states.
 *
 * Purpose: for an FMU whose states do not hold what is set (some exporters restore time and variables only): it is given again after each restore what it had when
 *          it was saved. Only for those that have been shown to need it; others may do more on being set than to take a value.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_FMU_GIVEN_H
#define TL_FIRMWARE_FMU_FMU_GIVEN_H

#include <stdbool.h>

#include "firmware/rollback/fmu_replay.h"
#include "master/fmi/component.h"

/* Fields are private. */
typedef struct tl_fmu_given {
    const tl_ports *ports; /* that are set, */
    double *values;        /* and the last values: reals, then integers, then Booleans */
    size_t bytes;
} tl_fmu_given;

/* A state with what was given before it. */
typedef struct tl_fmu_given_state {
    fmi2FMUstate own; /* the FMU's; NULL: none yet */
    double values[];
} tl_fmu_given_state;

/* What is in the ports was given last; they must stay. False: there is no memory. */
bool tl_fmu_given_open(tl_fmu_given *given, const tl_ports *ports);
void tl_fmu_given_close(tl_fmu_given *given);

/* A call that sets values of the ports, or another one, which says nothing. */
void tl_fmu_given_note(tl_fmu_given *given, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                       const void *values);

/* A state with what is given now; without the FMU's own yet. NULL: there is no memory. */
tl_fmu_given_state *tl_fmu_given_make_state(const tl_fmu_given *given);

/* What is given now is what a state has; and the other way round: the instance is given that again, by `fmi`. */
void tl_fmu_given_keep(const tl_fmu_given *given, tl_fmu_given_state *state);
fmi2Status tl_fmu_given_give_again(const tl_fmu_given *given, const tl_fmu_given_state *state, const tl_fmi2 *fmi,
                                   fmi2Component instance);

#endif
