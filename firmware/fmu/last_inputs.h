/* Last inputs of an FMU, saved with each of its states.
 *
 * Purpose: the states of some exporters' FMUs contain only time and variables, not the inputs that
 *          were set. So after each restore the guard sets the inputs that the FMU had when the
 *          state was saved. The guard does so only if the rollback proof (master/sync/proof.h) has
 *          found that the FMU needs it. In other FMUs, setting a value may have side effects.
 * Thread:  the thread that calls the FMU.
 * Memory:  malloc().
 */
#ifndef TL_FIRMWARE_FMU_LAST_INPUTS_H
#define TL_FIRMWARE_FMU_LAST_INPUTS_H

#include <stddef.h>

#include "firmware/rollback/fmu_replay.h"
#include "master/fmi/component.h"
#include "master/fmi/fmi2.h"

/* Fields are private. */
typedef struct tl_last_inputs {
    const tl_ports *ports; /* connected inputs and adjusted variables: those set before each step */
    size_t bytes;          /* size of `values` */
    double values[];       /* the values set last: reals, then integers, then Booleans */
} tl_last_inputs;

/* A state of the FMU, and the inputs that were set last before it was saved. */
typedef struct tl_last_inputs_state {
    fmi2FMUstate own; /* the FMU's own state; NULL: not saved yet */
    double values[];  /* as in tl_last_inputs */
} tl_last_inputs_state;

/* Allocates the last inputs, with the present values of the ports. `ports` must remain valid. The
 * caller frees the result with free(). Returns NULL if memory is out. */
tl_last_inputs *tl_last_inputs_open(const tl_ports *ports);

/* Notes the values of an FMI call if it sets all ports of one type. Ignores all other calls. */
void tl_last_inputs_note(tl_last_inputs *last_inputs, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         const void *values);

/* The first function copies the last inputs into `state` (NULL: into a new state, which the caller
 * frees with free()), and returns the state; NULL if memory is out. The second function copies the
 * inputs back from `state` and sets them in the instance, by the functions in `fmi`. It returns the
 * status of the last FMI call. Neither function saves or restores the FMU's own state. */
tl_last_inputs_state *tl_last_inputs_save(const tl_last_inputs *last_inputs, tl_last_inputs_state *state);
fmi2Status tl_last_inputs_restore(tl_last_inputs *last_inputs, const tl_last_inputs_state *state, const tl_fmi2 *fmi,
                                  fmi2Component instance);

#endif
