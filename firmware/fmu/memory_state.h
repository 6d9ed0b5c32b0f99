/* States of an FMU that are copies of its memory, by the functions of FMI's table.
 *
 * Purpose: saves, restores and frees a copy (rollback/fmu_memory.h), and logs side effects that a
 *          copy does not contain. Serialising is only for an FMU whose own states are exact too:
 *          another process reads the bytes, and a copy of memory is useless there. To serialise,
 *          the copy is restored, the FMU saves its own state, and that state is serialised. To
 *          deserialise, the FMU restores its own state from the bytes, and then its memory is
 *          copied. After both, the FMU's memory is as before.
 * Source:  FMI 2.0.4, section 2.1.8 (fmi2SerializeFMUstate).
 * Errors:  fmi2Error if memory is out, if the FMU has side effects that a copy cannot restore, or
 *          if the FMU rejects a call.
 * Thread:  the thread that calls the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_MEMORY_STATE_H
#define TL_FIRMWARE_FMU_MEMORY_STATE_H

#include "firmware/fmu/guarded_fmu.h"
#include "master/fmi/fmi2.h"

/* The functions for states; all others are NULL. Their `component`: a tl_fmu_guarded with memory.
 */
extern const tl_fmi2 tl_memory_state_functions;

/* The functions get_fmu_state and set_fmu_state of this table. */
fmi2Status tl_memory_state_save(fmi2Component component, fmi2FMUstate *state);
fmi2Status tl_memory_state_restore(fmi2Component component, fmi2FMUstate state);

#endif
